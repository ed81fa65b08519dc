//! What the baker stores against the exact oracle, texel by texel.

use umbrage::certify::place::{self, SpotTally};
use umbrage::certify::sample::{Borders, spots};
use umbrage::certify::{Oracle, Region};
use umbrage::reader::query::PageView;
use umbrage::reader::query::vector::descend;
use umbrage::writer::hierarchy::build::{Options, build};
use umbrage::writer::hierarchy::page::Page;
use umbrage::writer::hierarchy::spool::Spool;
use umbrage::writer::hierarchy::vector;
use umbrage::writer::mesh::Mesh;
use umbrage::writer::solid::{Policy, snap};
use umbrage::writer::{frame, scene};

/// Answers of a tree at level 0, read straight from the draft pages.
fn stored(pages: &[Page], resolution: u32, x: u32, y: u32) -> u32 {
    use umbrage::format::kind::mh::{Children, Mask, Node, NodeType, child_of};
    let mut page = 0usize;
    let mut mask = pages[0].draft.root_mask;
    let mut start = 2usize;
    let mut level = resolution.ilog2() as u8;
    let mut value = 0;
    loop {
        let words = &pages[page].draft.words;
        let c = if level == resolution.ilog2() as u8 { 0 } else { child_of(x, y, level) };
        let at = start + mask.words_before(c) as usize;
        match mask.child(c) {
            NodeType::None => return value,
            NodeType::Leaf => return words[at],
            NodeType::Inner => value = words[at + 1],
            NodeType::Empty => {}
        }
        if level == 0 {
            return value;
        }
        let node = Node::decode(words[at]);
        match node.children {
            Children::Here(w) => {
                start = usize::from(w);
                mask = Mask(node.mask.0);
            }
            Children::Page(p) => {
                page = pages[page].first_child as usize + usize::from(p);
                start = 2;
                mask = pages[page].draft.root_mask;
            }
        }
        level -= 1;
    }
}

fn check(mesh: &Mesh, direction: [f64; 3], resolution: u32, policy: Policy, exhaustive: bool) {
    let k = frame::log2_resolution(resolution.into()).unwrap();
    let behind = if let Policy::Thickness(t) = policy { t } else { 0.0 };
    let lattice = frame::orthographic(direction, k, &mesh.positions, behind).unwrap();
    let snapped = snap(mesh, lattice, policy).unwrap();
    let guard = if resolution == 64 { 1000 } else { 3 };
    for top_down in [false, true] {
        let options = Options { exhaustive, guard, top_down };
        let tree = build(&snapped, options, Spool::in_memory(), &Default::default()).unwrap();
        let pages: Vec<Page> = tree.spool.pages(tree.root).map(Result::unwrap).collect();
        let oracle = Oracle::new(&snapped).with_guard(guard);
        let region = Region { x: 0, y: 0, width: resolution, height: resolution };
        let t = oracle.check(region, |x, y| stored(&pages, resolution, x, y));
        let case = format!("{direction:?} {resolution} {policy:?}, top-down {top_down}");
        assert_eq!(t.wrong, 0, "{case}: {:?}", t.examples);
        assert_eq!(t.edge(), tree.counts.edge_texels, "{case}");
        assert_eq!(t.thin, tree.counts.thin_texels, "{case}");
    }
}

/// The same for kind `vector`, whose edge texels are counted by lines where lines prove a square; and its continuous
/// lookups at some places.
fn check_vector(mesh: &Mesh, direction: [f64; 3], resolution: u32, policy: Policy, places: u64) -> SpotTally {
    let k = frame::log2_resolution(resolution.into()).unwrap();
    let behind = if let Policy::Thickness(t) = policy { t } else { 0.0 };
    let lattice = frame::orthographic(direction, k, &mesh.positions, behind).unwrap();
    let snapped = snap(mesh, lattice, policy).unwrap();
    let guard = if resolution == 64 { 1000 } else { 3 };
    let options = Options { exhaustive: false, guard, top_down: false };
    let tree = vector::build::build(&snapped, options, Spool::in_memory(), &Default::default()).unwrap();
    let pages: Vec<Page> = tree.spool.pages(tree.root).map(Result::unwrap).collect();
    let oracle = Oracle::new(&snapped).with_guard(guard);
    let region = Region { x: 0, y: 0, width: resolution, height: resolution };
    let page = |o: u32| {
        let page = &pages[o as usize];
        Some(PageView { words: &page.draft.words, first_child: page.first_child, dependencies: &[] })
    };
    let t = oracle.check(region, |x, y| descend(page, 0, k, x, y, 0).value);
    assert_eq!(t.wrong, 0, "{direction:?} {resolution} {policy:?}: {:?}", t.examples);
    let footprint = |o: u32| {
        let draft = &pages[o as usize].draft;
        Some((draft.origin, (draft.root_level + 1).min(k)))
    };
    let leaf = |x, y| Some(descend(page, 0, k, x, y, 0).level);
    let borders = Borders { pages: pages.len() as u32, page: &footprint, leaf: &leaf };
    let spots = spots(&snapped, places, &borders).into_iter();
    let t = spots.map(|s| place::check(&oracle, page, k, s)).fold(SpotTally::default(), SpotTally::merge);
    assert_eq!(t.wrong, 0, "{direction:?} {resolution} {policy:?}: {:?}", t.examples);
    t
}

const LIGHTS: [[f64; 3]; 4] = [[0.4, -0.8, 0.3], [-0.23, -0.71, 0.52], [0.05, -0.99, -0.11], [0.83, -0.31, -0.4]];

#[test]
fn generated_scenes_store_only_right_values() {
    for spec in ["city:1:0.05", "scan:3:0.05", "forest:2:0.05"] {
        let mesh = scene::generated(spec).unwrap().unwrap();
        for (i, d) in LIGHTS.into_iter().enumerate() {
            for resolution in [1, 16, 64, 256, 1024] {
                check(&mesh, d, resolution, Policy::Closed, i == 1 && resolution <= 64);
                let t = check_vector(&mesh, d, resolution, Policy::Closed, 4000);
                assert!(resolution < 1024 || t.share() > 0.5, "{spec} {d:?}: {t:?}");
            }
        }
    }
}

/// Level plates that coincide in part, above a solid.
fn plates() -> Mesh {
    let mut mesh = Mesh::default();
    let level = [(0.5, -1.0, 0.25), (0.5, -0.3, 1.0), (0.5, 0.1, 0.9), (0.2, -0.9, 0.8)];
    for (y, from, to) in level {
        let positions = [[from, y, -1.0], [from, y, 0.7], [to, y, 0.7], [to, y, -1.0]].to_vec();
        mesh.append(&Mesh { positions, triangles: vec![[0, 1, 2], [0, 2, 3]] });
    }
    let positions = [[-1.0, -1.0, -1.0], [1.0, -0.9, -0.8], [-0.7, -0.5, 1.0], [0.1, 0.1, 0.0]].to_vec();
    mesh.append(&Mesh { positions, triangles: vec![[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]] });
    mesh
}

/// Under a light from straight above they certify no texel, but have one depth: squares are not looked at texel by texel.
#[test]
fn level_plates_are_done_by_the_square() {
    let down = [0.0, -1.0, 0.0];
    for policy in [Policy::SecondSurface, Policy::Thickness(1e-12), Policy::Thickness(1e-8), Policy::Thickness(0.3)] {
        for resolution in [64, 512] {
            check(&plates(), down, resolution, policy, false);
            check_vector(&plates(), down, resolution, policy, 4000);
        }
        let behind = if let Policy::Thickness(t) = policy { t } else { 0.0 };
        let lattice = frame::orthographic(down, 12, &plates().positions, behind).unwrap();
        let snapped = snap(&plates(), lattice, policy).unwrap();
        let options = Options { exhaustive: false, guard: 3, top_down: false };
        for build in [build, vector::build::build] {
            let tree = build(&snapped, options, Spool::in_memory(), &Default::default()).unwrap();
            // borders and diagonals are lines
            assert!(tree.counts.texels_evaluated < 100 * 4096, "{policy:?}: {:?}", tree.counts);
        }
    }
}

/// A flat roof that stands out beside a high mast: its silhouettes' intervals are so narrow that no plane is right for some texels.
fn roof() -> Mesh {
    let mut mesh = Mesh::default();
    let (low, high) = (-0.9994, -0.9981);
    let corners = [[-0.9, low, -0.83], [0.87, low, -0.9], [0.9, low, 0.91], [-0.88, low, 0.86], [0.03, high, -0.07]];
    let faces = [[0, 1, 2], [0, 2, 3], [0, 4, 1], [1, 4, 2], [2, 4, 3], [3, 4, 0]];
    mesh.append(&Mesh { positions: corners.to_vec(), triangles: faces.to_vec() });
    let mast = [[-1.0, -1.0, -1.0], [-0.99, -1.0, -1.0], [-1.0, -1.0, -0.99], [-1.0, 1.0, -1.0]];
    mesh.append(&Mesh { positions: mast.to_vec(), triangles: vec![[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]] });
    mesh
}

/// A large square that one entry answers but for one texel, which has a leaf of its own.
#[test]
fn single_texels_beside_an_entry_are_right() {
    let k = 12;
    let side = 1u32 << k;
    let mut found = 0;
    for light in [[0.0, -1.0, 0.0], [0.02, -1.0, 0.013]] {
        let lattice = frame::orthographic(light, k, &roof().positions, 0.0).unwrap();
        let snapped = snap(&roof(), lattice, Policy::Auto).unwrap();
        let options = Options { exhaustive: false, guard: 3, top_down: false };
        let tree = vector::build::build(&snapped, options, Spool::in_memory(), &Default::default()).unwrap();
        let pages: Vec<Page> = tree.spool.pages(tree.root).map(Result::unwrap).collect();
        let page = |o: u32| {
            let page = &pages[o as usize];
            Some(PageView { words: &page.draft.words, first_child: page.first_child, dependencies: &[] })
        };
        let at = |x, y| descend(page, 0, k, x, y, 0);
        let oracle = Oracle::new(&snapped).with_guard(3);
        for y in 0..side {
            for x in 0..side {
                let alone = |level: u8| level >= 5;
                if at(x, y).level != 0 || !alone(at(x ^ 1, y).level) || !alone(at(x, y ^ 1).level) {
                    continue;
                }
                found += 1;
                for (u, v) in (x - 2..=x + 2).flat_map(|u| (y - 2..=y + 2).map(move |v| (u, v))) {
                    assert!(oracle.accepts(u, v, at(u, v).value).0, "{light:?}: {u} {v} beside {x} {y}");
                }
            }
        }
    }
    assert!(found > 5, "{found}");
}

/// A sequence that is the same everywhere.
struct Random(u64);

impl Random {
    fn next(&mut self, below: u64) -> u64 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 33) % below
    }

    /// -1 to 1, from few values so that coincidences happen.
    fn coarse(&mut self) -> f64 {
        self.next(9) as f64 / 4.0 - 1.0
    }

    fn fine(&mut self) -> f64 {
        self.next(1 << 30) as f64 / (1u64 << 29) as f64 - 1.0
    }
}

/// Boxes (some turned, flat, needle-like, sharing planes), tetrahedra, loose triangles.
fn soup(seed: u64, open: bool) -> Mesh {
    let mut r = Random(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1);
    let mut mesh = Mesh::default();
    for _ in 0..1 + r.next(6) {
        let lattice = r.next(2) == 0;
        let coordinate = |r: &mut Random| if lattice { r.coarse() } else { r.fine() };
        let mut part = Mesh::default();
        match r.next(if open { 4 } else { 3 }) {
            0 | 1 => {
                let centre = [0; 3].map(|_| coordinate(&mut r));
                let half = [0; 3].map(|_| if r.next(5) == 0 { 0.01 } else { coordinate(&mut r).abs() + 0.05 });
                let turn = if r.next(3) == 0 { r.fine() } else { 0.0 };
                // a rational turn about y and a shear keep it closed and convex
                let (c, s) = ((1.0 - turn * turn) / (1.0 + turn * turn), 2.0 * turn / (1.0 + turn * turn));
                for i in 0..8 {
                    let p = [0, 1, 2].map(|a| if i >> a & 1 == 1 { half[a] } else { -half[a] });
                    part.positions.push([
                        centre[0] + c * p[0] + s * p[2],
                        centre[1] + p[1] + turn * 0.3 * p[0],
                        centre[2] - s * p[0] + c * p[2],
                    ]);
                }
                let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
                for [a, b, c, d] in quads {
                    part.triangles.extend([[a, b, c], [a, c, d]]);
                }
            }
            2 => {
                part.positions = (0..4).map(|_| [0; 3].map(|_| coordinate(&mut r))).collect();
                part.triangles = vec![[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]];
            }
            _ => {
                part.positions = (0..3).map(|_| [0; 3].map(|_| coordinate(&mut r))).collect();
                part.triangles = vec![[0, 1, 2]];
            }
        }
        if r.next(6) == 0 {
            part.triangles.iter_mut().for_each(|t| t.swap(1, 2));
        }
        mesh.append(&part);
    }
    mesh
}

#[test]
fn adversarial_solids_store_only_right_values() {
    let seeds: u64 = std::env::var("UMBRAGE_SEEDS").ok().and_then(|s| s.parse().ok()).unwrap_or(400);
    for seed in 0..seeds {
        let open = seed % 2 == 1;
        let mesh = soup(seed, open);
        let policies: &[Policy] = if open {
            &[Policy::Auto, Policy::OneSided, Policy::SecondSurface, Policy::Thickness(0.07)]
        } else {
            &[Policy::Closed, Policy::SecondSurface]
        };
        let light = match seed % 3 {
            0 => [0.0, -1.0, 0.0],
            1 => [0.4, -0.8, 0.3],
            _ => LIGHTS[1 + seed as usize / 3 % 3],
        };
        for policy in policies {
            for resolution in [4, 32] {
                check(&mesh, light, resolution, *policy, seed % 5 == 0);
            }
            // splits are made above 256 texels on a side
            if seed % 4 == 0 {
                check_vector(&mesh, light, 512, *policy, 600);
            }
            check_vector(&mesh, light, 32, *policy, 200);
        }
    }
}
