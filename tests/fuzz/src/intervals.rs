//! A few triangles on a small lattice: the baker's tree against the exact oracle, texel by texel, under every policy.
//!
//! Coordinates are multiples of a coarse step, most of the time, so that shapes touch, nest, coincide and degenerate.

use umbrage::certify::{Oracle, Region};
use umbrage_format::projection::Lattice;
use umbrage_reader::query::mh::{PageView, descend};
use umbrage_writer::frame;
use umbrage_writer::hierarchy::build::{Options, Progress, build};
use umbrage_writer::hierarchy::page::Page;
use umbrage_writer::hierarchy::spool::Spool;
use umbrage_writer::mesh::Mesh;
use umbrage_writer::solid::{Policy, SnappedMesh, snap};

use crate::input::Input;

/// Most shapes of one scene: the oracle's exact method grows with the square of the triangles over a texel.
const SHAPES: usize = 5;

/// A scene as the bytes describe it.
#[derive(Debug)]
pub struct Scene {
    /// The triangles.
    pub mesh: Mesh,
    /// The light.
    pub lattice: Lattice,
    /// The policy.
    pub policy: Policy,
}

/// Places corners: a coarse grid, with a small step beside it now and then.
struct Corners {
    xy: i64,
    z: i64,
    side: i64,
}

impl Corners {
    fn read(&self, input: &mut Input) -> [f64; 3] {
        let mut one = |step: i64, most: i64| {
            let b = i64::from(input.byte());
            // two high bits: one step to the left or right of the grid
            let beside = [0, 0, 1, -1][(b >> 6) as usize];
            (((b & 31) * step) + beside).clamp(0, most) as f64
        };
        [one(self.xy, self.side), one(self.xy, self.side), one(self.z, i64::from(u32::MAX) - 1)]
    }
}

/// Reads a scene.
pub fn scene(input: &mut Input) -> Option<Scene> {
    let setup = input.byte();
    let log2_resolution = setup & 3;
    // 28 bits over the map as the frame has them, or the fewest that a texel may have
    let subtexel_bits = if setup & 4 == 0 { 28 - log2_resolution } else { 8 };
    let side = 1i64 << (log2_resolution + subtexel_bits);
    let steps = input.byte();
    let z = [1, 7, 1 << 20, 1 << 26][usize::from(steps & 3)];
    // 32 steps across the map, or steps that are not in line with the texels
    let xy = [side >> 5, side / 33, side / 17, (side >> 5) + 1][usize::from(steps >> 2 & 3)];
    let corners = Corners { xy: xy.max(1), z, side };
    let policy = match input.below(5) {
        0 => Policy::Closed,
        1 => Policy::OneSided,
        2 => Policy::Thickness(f64::from(input.below(32).max(1)) * z as f64),
        3 => Policy::SecondSurface,
        _ => Policy::Auto,
    };
    let mut mesh = Mesh::default();
    for _ in 0..SHAPES {
        if input.is_empty() {
            break;
        }
        shape(input, &corners, policy, &mut mesh);
    }
    if mesh.triangles.is_empty() {
        return None;
    }
    // Straight down the lattice, or the same shapes as a world under a light of their own.
    let lattice = if setup & 8 == 0 {
        let world_to_lattice = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];
        Lattice { world_to_lattice, log2_resolution, subtexel_bits }
    } else {
        let direction = [setup >> 4 & 3, setup >> 6, steps >> 4 & 3].map(|v| f64::from(v) - 1.5);
        // a world of even proportions, so that slopes are of every size
        mesh.positions.iter_mut().for_each(|p| *p = [p[0] / xy as f64, p[1] / xy as f64, p[2] / z as f64]);
        let behind = if let Policy::Thickness(t) = policy { t / z as f64 } else { 0.0 };
        frame::orthographic(direction, log2_resolution, &mesh.positions, behind).ok()?
    };
    let policy = match policy {
        Policy::Thickness(t) if setup & 8 != 0 => Policy::Thickness(t / z as f64),
        p => p,
    };
    Some(Scene { mesh, lattice, policy })
}

fn shape(input: &mut Input, corners: &Corners, policy: Policy, mesh: &mut Mesh) {
    const BOX: [[usize; 4]; 6] = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let tag = input.byte();
    let base = mesh.positions.len() as u32;
    let start = mesh.triangles.len();
    let quad = |mesh: &mut Mesh, q: [usize; 4], diagonal: bool| {
        let [a, b, c, d] = q.map(|i| base + i as u32);
        let pair = if diagonal { [[a, b, c], [a, c, d]] } else { [[a, b, d], [b, c, d]] };
        mesh.triangles.extend(pair);
    };
    let open = policy != Policy::Closed;
    match tag & 7 {
        // an upright box
        0 | 1 => {
            let (low, high) = (corners.read(input), corners.read(input));
            for i in 0..8 {
                mesh.positions.push([0, 1, 2].map(|k| if i >> k & 1 == 1 { high[k] } else { low[k] }));
            }
            for (i, q) in BOX.into_iter().enumerate() {
                quad(mesh, q, tag >> 5 & 1 == 0 || i > 1);
            }
        }
        // a tetrahedron
        2 | 3 => {
            mesh.positions.extend([0; 4].map(|_| corners.read(input)));
            mesh.triangles.extend([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]].map(|t| t.map(|i| base + i)));
        }
        // a sheared slab between two faces: flat ones are degenerate solids
        4 => {
            let (o, u, v) = (corners.read(input), corners.read(input), corners.read(input));
            let deep = f64::from(input.byte() & 31) * corners.z as f64;
            for i in 0..8 {
                let p = [o, u, v, [0, 1, 2].map(|k| u[k] + v[k] - o[k])][i & 3];
                let top = (corners.side as f64, f64::from(u32::MAX) - 1.0);
                let z = p[2] + if i > 3 { deep } else { 0.0 };
                mesh.positions.push([p[0].clamp(0.0, top.0), p[1].clamp(0.0, top.0), z.clamp(1.0, top.1)]);
            }
            for q in BOX {
                quad(mesh, q, true);
            }
        }
        // a triangle alone; closed policies get it with its back
        5 => {
            mesh.positions.extend([0; 3].map(|_| corners.read(input)));
            mesh.triangles.push([base, base + 1, base + 2]);
            if !open {
                mesh.triangles.push([base, base + 2, base + 1]);
            }
        }
        // two triangles with a common edge
        6 => {
            mesh.positions.extend([0; 4].map(|_| corners.read(input)));
            quad(mesh, [0, 1, 2, 3], true);
            if !open {
                quad(mesh, [3, 2, 1, 0], false);
            }
        }
        // what was there before, once more: beside itself, or in the same place
        _ => {
            let (dx, dz) = (f64::from(input.byte() & 31), f64::from(input.byte() & 31));
            let moved = mesh.positions.iter().map(|p| {
                let x = (p[0] + dx * corners.xy as f64).min(corners.side as f64);
                [x, p[1], (p[2] + dz * corners.z as f64).min(f64::from(u32::MAX) - 1.0)]
            });
            let moved: Vec<_> = moved.collect();
            let last = mesh.triangles.len().saturating_sub(12);
            let again: Vec<_> = mesh.triangles[last..].iter().map(|t| t.map(|i| base + i)).collect();
            mesh.positions.extend(moved);
            mesh.triangles.extend(again);
        }
    }
    // inside out: turned, or a cavity where it lies inside another
    if tag & 8 != 0 {
        mesh.triangles[start..].iter_mut().for_each(|t| t.swap(1, 2));
    }
}

/// Distance that stored values must keep from the ends of wide intervals.
const GUARD: u32 = 2;

/// Answer at level 0 of pages that have no frame yet.
fn stored(pages: &[(Vec<u32>, u32)], log2: u8, x: u32, y: u32) -> u32 {
    let view = |o: u32| {
        let (words, first_child) = pages.get(o as usize)?;
        Some(PageView { words, first_child: *first_child, dependencies: &[] })
    };
    descend(view, 0, log2, x, y, 0).value
}

fn compare(mesh: &SnappedMesh, oracle: &Oracle, exhaustive: bool, policy: Policy) {
    let tree =
        build(mesh, Options { exhaustive, guard: GUARD, top_down: false }, Spool::in_memory(), &Progress::default())
            .expect("nobody cancels");
    let framed = |page: Page| {
        let mut words = page.draft.words;
        words[0] = u32::from(page.draft.root_mask.0) << 8;
        (words, page.first_child)
    };
    let pages: Vec<_> = tree.spool.pages(tree.root).map(|p| framed(p.expect("all in memory"))).collect();
    let (side, log2) = (mesh.lattice.resolution(), mesh.lattice.log2_resolution);
    let region = Region { x: 0, y: 0, width: side, height: side };
    let truth = oracle.check(region, |x, y| stored(&pages, log2, x, y));
    let counts = tree.counts;
    assert!(
        (truth.wrong, truth.edge(), truth.thin) == (0, counts.edge_texels, counts.thin_texels),
        "{policy:?}, exhaustive {exhaustive}, {side} x {side}: {} wrong {:?}; edge texels {} for {}, thin {} for {}; \
         {:?}, positions {:?}, triangles {:?}, solid {:?}, solids {:?}",
        truth.wrong,
        truth.examples,
        counts.edge_texels,
        truth.edge(),
        counts.thin_texels,
        truth.thin,
        mesh.lattice,
        mesh.positions,
        mesh.triangles,
        mesh.solid,
        mesh.solids
    );
}

/// One input.
pub fn run(data: &[u8]) {
    let Some(scene) = scene(&mut Input(data)) else { return };
    let Ok(mesh) = snap(&scene.mesh, scene.lattice, scene.policy) else { return };
    let oracle = Oracle::new(&mesh).with_guard(GUARD);
    compare(&mesh, &oracle, false, scene.policy);
    compare(&mesh, &oracle, true, scene.policy);
}
