//! The cut is held against direct sampling, written here once more.

use std::collections::HashMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

use super::*;
use crate::scene::load::{AlphaImage, Wrap};
use crate::scene::random::Random;

const EVERY: [Wrap; 3] = [Wrap::Repeat, Wrap::Clamp, Wrap::Mirror];

fn texel(mask: &AlphaMask, i: i64, j: i64) -> f64 {
    let wrapped = |i: i64, n: u32, wrap: Wrap| -> usize {
        let n = i64::from(n);
        let k = match wrap {
            Wrap::Repeat => (i % n + n) % n,
            Wrap::Clamp => i.max(0).min(n - 1),
            Wrap::Mirror if (i.div_euclid(n)) % 2 == 0 => i.rem_euclid(n),
            Wrap::Mirror => n - 1 - i.rem_euclid(n),
        };
        k as usize
    };
    let (w, h) = (mask.image.width, mask.image.height);
    let (x, y) = (wrapped(i, w, mask.wrap[0]), wrapped(j, h, mask.wrap[1]));
    f64::from(mask.image.alpha[y * w as usize + x]) / 255.0
}

/// Alpha at a place in pixels, (0, 0) being the outer corner of the first.
fn alpha(mask: &AlphaMask, [x, y]: [f64; 2]) -> f64 {
    if !mask.linear {
        return texel(mask, x.floor() as i64, y.floor() as i64);
    }
    let (x, y) = (x - 0.5, y - 0.5);
    let (i, j) = (x.floor() as i64, y.floor() as i64);
    let (s, t) = (x - x.floor(), y - y.floor());
    let row = |j| texel(mask, i, j) * (1.0 - s) + texel(mask, i + 1, j) * s;
    row(j) * (1.0 - t) + row(j + 1) * t
}

/// One triangle over the weights of its second and third corner.
struct Single {
    mask: AlphaMask,
    uv: [[f64; 2]; 3],
    opacity: [f64; 3],
}

impl Single {
    fn new(mask: &AlphaMask, triangle: &MaskedTriangle) -> Self {
        let size = [f64::from(mask.image.width), f64::from(mask.image.height)];
        let uv = triangle.uv.map(|uv| [f64::from(uv[0]) * size[0], f64::from(uv[1]) * size[1]]);
        Single { mask: mask.clone(), uv, opacity: triangle.opacity.map(f64::from) }
    }

    fn mixed<const N: usize>(&self, of: [[f64; N]; 3], [v, w]: [f64; 2]) -> [f64; N] {
        std::array::from_fn(|d| of[0][d] * (1.0 - v - w) + of[1][d] * v + of[2][d] * w)
    }

    fn solid(&self, p: [f64; 2]) -> bool {
        let [opacity] = self.mixed(self.opacity.map(|o| [o]), p);
        alpha(&self.mask, self.mixed(self.uv, p)) * opacity >= f64::from(self.mask.cutoff) * (1.0 - 1e-7)
    }

    /// The weights so many pixels away.
    fn moved(&self, p: [f64; 2], d: [f64; 2]) -> [f64; 2] {
        let [a, b, c] = self.uv;
        let (u, v) = ([b[0] - a[0], b[1] - a[1]], [c[0] - a[0], c[1] - a[1]]);
        let area = u[0] * v[1] - u[1] * v[0];
        [p[0] + (d[0] * v[1] - d[1] * v[0]) / area, p[1] + (u[0] * d[1] - u[1] * d[0]) / area]
    }

    /// Whether sampling says the same within `radius` pixels of `p`, as far as `rings` x `spokes` samples show.
    fn alike(&self, p: [f64; 2], radius: f64, rings: u32, spokes: u32) -> bool {
        let here = self.solid(p);
        (0..rings * spokes).all(|k| {
            let (ring, angle) = (1 + k / spokes, f64::from(k % spokes) / f64::from(spokes) * std::f64::consts::TAU);
            let r = radius * f64::from(ring) / f64::from(rings);
            let q = self.moved(p, [r * angle.cos(), r * angle.sin()]);
            !within(q) || self.solid(q) == here
        })
    }
}

fn within(p: [f64; 2]) -> bool {
    p[0] >= 0.0 && p[1] >= 0.0 && p[0] + p[1] <= 1.0
}

fn cover(mesh: &Mesh, p: [f64; 2]) -> usize {
    let inside = |t: &&[u32; 3]| {
        let [a, b, c] = t.map(|i| mesh.positions[i as usize]);
        let left = |a: [f64; 3], b: [f64; 3]| (b[0] - a[0]) * (p[1] - a[1]) > (b[1] - a[1]) * (p[0] - a[0]);
        left(a, b) && left(b, c) && left(c, a)
    };
    mesh.triangles.iter().filter(inside).count()
}

fn random_mask(r: &Random, wrap: usize) -> AlphaMask {
    let (width, height) = (r.count(1, 7), r.count(1, 7));
    let hard = r.count(0, 2);
    let alpha = (0..width * height).map(|_| match hard {
        0 => 255 * r.count(0, 1) as u8,
        1 => (r.count(0, 3) * 85) as u8,
        _ => r.count(0, 255) as u8,
    });
    AlphaMask {
        material: 0,
        cutoff: if r.count(0, 7) == 0 { 1.0 } else { r.range(0.02, 0.98) as f32 },
        image: Arc::new(AlphaImage { width, height, alpha: alpha.collect() }),
        wrap: [EVERY[wrap / 3 % 3], EVERY[wrap % 3]],
        linear: r.count(0, 1) == 0,
        triangles: Vec::new(),
    }
}

fn random_triangle(r: &Random, varying: bool) -> MaskedTriangle {
    let neat = r.count(0, 2) == 0;
    let one = r.range(0.6, 1.2) as f32;
    let c = || if neat { r.count(0, 8) as f32 / 4.0 - 1.0 } else { r.range(-1.5, 1.5) as f32 };
    let uv = [[c(), c()], [c(), c()], [c(), c()]];
    let opacity = if varying { [0; 3].map(|_| r.range(0.0, 1.3) as f32) } else { [one; 3] };
    MaskedTriangle { triangle: 0, uv, opacity }
}

/// The triangle of corners (0, 0), (1, 0), (0, 1), cut.
fn cut_of(mask: &AlphaMask, triangle: &MaskedTriangle) -> Mesh {
    let mut mask = mask.clone();
    mask.triangles.push(*triangle);
    let mesh = Mesh { positions: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], triangles: vec![[0, 1, 2]] };
    let mut scene = Loaded { mesh, masks: vec![mask], notes: Vec::new() };
    cut(&mut scene, &Bounds::default()).unwrap();
    assert!(scene.masks.is_empty());
    scene.mesh
}

/// Directed edges that no other edge runs against.
fn rims(mesh: &Mesh) -> Vec<[[u64; 3]; 2]> {
    let bits = |i: u32| mesh.positions[i as usize].map(|c| (c + 0.0).to_bits());
    let mut open: HashMap<[[u64; 3]; 2], i32> = HashMap::new();
    for t in &mesh.triangles {
        for k in 0..3 {
            let (a, b) = (bits(t[k]), bits(t[(k + 1) % 3]));
            let (edge, sign) = if a < b { ([a, b], 1) } else { ([b, a], -1) };
            *open.entry(edge).or_default() += sign;
        }
    }
    open.into_iter().filter(|(_, n)| *n != 0).map(|(e, _)| e).collect()
}

fn position(bits: [u64; 3]) -> [f64; 3] {
    bits.map(f64::from_bits)
}

#[test]
fn points_are_covered_iff_sampling_says_solid() {
    let r = Random::new(7, [0; 2]);
    let (mut checked, mut near, mut solid) = (0, 0, 0);
    for round in 0..1200 {
        let mask = random_mask(&r, round);
        let triangle = random_triangle(&r, round % 4 == 0);
        let single = Single::new(&mask, &triangle);
        let ([a, b, c], size) = (single.uv, single.uv.iter().flatten().fold(0.0, |m: f64, v| m.max(v.abs())));
        let area = ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])).abs();
        if area < 0.01 * size || area == 0.0 {
            continue;
        }
        let mesh = cut_of(&mask, &triangle);
        let bound = if mask.linear { DEVIATION } else { 1e-5 };
        let mut points = Vec::new();
        let random = || loop {
            let p = [r.range(0.0, 1.0), r.range(0.0, 1.0)];
            if within(p) {
                return p;
            }
        };
        for _ in 0..60 {
            let (mut p, mut q) = (random(), random());
            if single.solid(p) == single.solid(q) {
                if r.count(0, 9) == 0 {
                    points.push((random(), false));
                }
                continue;
            }
            points.push((random(), false));
            for _ in 0..50 {
                let m = [0, 1].map(|k| 0.5 * (p[k] + q[k]));
                if single.solid(m) == single.solid(p) { p = m } else { q = m }
            }
            for _ in 0..6 {
                let (far, turn) = (random(), random());
                let (far, turn) = (bound * (1.0 + 0.5 * far[0]), turn[0] * std::f64::consts::TAU);
                let near = single.moved(p, [far * turn.cos(), far * turn.sin()]);
                if within(near) && single.alike(near, bound, 2, 24) {
                    points.push((near, true));
                    break;
                }
            }
        }
        for (p, close) in points {
            if !within(p) || !single.alike(p, bound, 2, 24) {
                continue;
            }
            let expected = usize::from(single.solid(p));
            let found = cover(&mesh, p);
            // Thin parts may have slipped between the samples.
            if found != expected && !single.alike(p, bound, 16, 256) {
                continue;
            }
            assert_eq!(found, expected, "round {round} at {p:?}: {mask:?} {triangle:?}");
            checked += 1;
            near += usize::from(close);
            solid += expected;
        }
    }
    assert!(checked > 20_000 && near > checked / 3 && solid > checked / 5, "{checked} {near} {solid}");
}

#[test]
fn pieces_close_but_for_outline_and_border() {
    let r = Random::new(8, [0; 2]);
    let (mut outlines, mut borders) = (0, 0);
    for round in 0..600 {
        let mask = random_mask(&r, round);
        let triangle = random_triangle(&r, round % 4 == 0);
        let single = Single::new(&mask, &triangle);
        let mesh = cut_of(&mask, &triangle);
        for t in &mesh.triangles {
            let [a, b, c] = t.map(|i| mesh.positions[i as usize]);
            let area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
            assert!(area > 0.0, "round {round}: turned or empty {t:?}");
        }
        for [a, b] in rims(&mesh) {
            let (a, b) = (position(a), position(b));
            let on = |d: fn([f64; 3]) -> f64| d(a) == 0.0 && d(b) == 0.0;
            if on(|p| p[0]) || on(|p| p[1]) || on(|p| p[0] + p[1] - 1.0) {
                borders += 1;
                continue;
            }
            let [a2, b2, c2] = single.uv;
            if (b2[0] - a2[0]) * (c2[1] - a2[1]) == (b2[1] - a2[1]) * (c2[0] - a2[0]) {
                continue;
            }
            let middle = [0, 1].map(|k| 0.5 * (a[k] + b[k]));
            let bound = if mask.linear { DEVIATION * 1.05 } else { 1e-5 };
            assert!(!single.alike(middle, bound, 8, 128), "round {round} at {middle:?}: {mask:?} {triangle:?}");
            outlines += 1;
        }
    }
    assert!(outlines > 3_000 && borders > 1_000, "{outlines} {borders}");
}

#[test]
fn neighbours_share_their_points() {
    let r = Random::new(9, [0; 2]);
    let (mut shared, mut along) = (0, 0);
    for round in 0..200 {
        let mut mask = random_mask(&r, round);
        let n = 4u32;
        let at = |i: u32, j: u32| j * n + i;
        let mut uv = Vec::new();
        let mut mesh = Mesh::default();
        for k in 0..n * n {
            let (i, j) = (f64::from(k % n), f64::from(k / n));
            mesh.positions.push([i + r.range(-0.2, 0.2), j + r.range(-0.2, 0.2), r.range(-0.2, 0.2)]);
            let jitter = if round % 3 == 0 { [0.0; 2] } else { [r.range(-0.1, 0.1), r.range(-0.1, 0.1)] };
            let opacity = if round % 2 == 0 { 1.0 } else { r.range(0.3, 1.3) as f32 };
            uv.push(([(i / 3.0 + jitter[0]) as f32, (j / 3.0 + jitter[1]) as f32], opacity));
        }
        for (i, j) in (0..n - 1).flat_map(|j| (0..n - 1).map(move |i| (i, j))) {
            mesh.triangles.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
            mesh.triangles.push([at(i + 1, j + 1), at(i, j + 1), at(i, j)]);
        }
        for (k, t) in mesh.triangles.iter().enumerate() {
            mask.triangles.push(MaskedTriangle {
                triangle: k as u32,
                uv: t.map(|i| uv[i as usize].0),
                opacity: t.map(|i| uv[i as usize].1),
            });
        }
        let before = mesh.clone();
        let mut scene = Loaded { mesh, masks: vec![mask.clone()], notes: Vec::new() };
        cut(&mut scene, &Bounds::default()).unwrap();
        // Edges of the mesh between two triangles, and both sides' open pieces on them.
        let inner: Vec<[u32; 2]> = (before.triangles.iter())
            .flat_map(|t| [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]])
            .filter(|e| before.triangles.iter().any(|t| (0..3).any(|k| [t[(k + 1) % 3], t[k]] == *e)))
            .collect();
        let on = |p: [f64; 3], [a, b]: [u32; 2]| {
            let (a, b) = (before.positions[a as usize], before.positions[b as usize]);
            let d = [0, 1, 2].map(|k| b[k] - a[k]);
            let e = [0, 1, 2].map(|k| p[k] - a[k]);
            let s = (d[0] * e[0] + d[1] * e[1] + d[2] * e[2]) / (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
            (0..3).all(|k| (a[k] + d[k] * s - p[k]).abs() < 1e-12)
        };
        for p in scene.mesh.positions.iter().skip(before.positions.len()) {
            shared += usize::from(inner.iter().any(|e| on(*p, *e)));
        }
        // An edge along the border of pixels has other pixels on its two sides.
        if !mask.linear && round % 3 == 0 {
            continue;
        }
        for [a, b] in rims(&scene.mesh) {
            let (a, b) = (position(a), position(b));
            let Some(e) = inner.iter().find(|e| on(a, **e) && on(b, **e)) else { continue };
            // The outline may run along the edge, within the bound.
            let middle = [0, 1, 2].map(|k| 0.5 * (a[k] + b[k]));
            let outline = before.triangles.iter().enumerate().any(|(k, t)| {
                let ends = e.map(|i| t.iter().position(|v| *v == i));
                let [Some(i), Some(j)] = ends else { return false };
                let [p, q] = e.map(|i| before.positions[i as usize]);
                let s = (middle[0] - p[0]) / (q[0] - p[0]);
                let weight = |k: usize| if k == i { 1.0 - s } else { f64::from(k == j) * s };
                !Single::new(&mask, &mask.triangles[k]).alike([weight(1), weight(2)], DEVIATION, 16, 128)
            });
            assert!(outline, "round {round}: crack on {e:?} from {a:?} to {b:?} {mask:?}");
            along += 1;
        }
    }
    assert!(shared > 1_000 && along < shared / 100, "{shared} {along}");
}

fn checker(width: u32, height: u32, alpha: impl Fn(u32, u32) -> u8) -> AlphaMask {
    let all = (0..width * height).map(|k| alpha(k % width, k / width));
    AlphaMask {
        material: 3,
        cutoff: 0.5,
        image: Arc::new(AlphaImage { width, height, alpha: all.collect() }),
        wrap: [Wrap::Repeat; 2],
        linear: false,
        triangles: Vec::new(),
    }
}

fn area(mesh: &Mesh) -> f64 {
    let one = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|i| mesh.positions[i as usize]);
        0.5 * ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))
    };
    mesh.triangles.iter().map(one).sum()
}

#[test]
fn wholes_stay_and_holes_go() {
    let solid = checker(2, 2, |_, _| 255);
    let triangle = MaskedTriangle { triangle: 0, uv: [[0.0, 0.0], [3.3, 0.1], [0.2, 2.9]], opacity: [1.0; 3] };
    assert_eq!(cut_of(&solid, &triangle).triangles, [[0, 1, 2]]);
    assert!(cut_of(&checker(2, 2, |_, _| 0), &triangle).triangles.is_empty());
    // a square hole of 2 x 2 pixels in 8 x 8 under half of a square: few triangles
    let hole = checker(8, 8, |x, y| if (1..3).contains(&x) && (1..3).contains(&y) { 0 } else { 255 });
    let half = MaskedTriangle { uv: [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]], ..triangle };
    let mesh = cut_of(&hole, &half);
    assert_eq!(mesh.triangles.len(), 7);
    assert!((area(&mesh) - (0.5 - 4.0 / 64.0)).abs() < 1e-12);
}

#[test]
fn order_and_facing_stay() {
    let mut mask = checker(4, 1, |x, _| if x < 2 { 255 } else { 0 });
    let uv = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]];
    for triangle in [1, 3] {
        // The second one is mirrored in the image.
        let uv = if triangle == 1 { uv } else { uv.map(|[u, v]| [u, -v]) };
        mask.triangles.push(MaskedTriangle { triangle, uv, opacity: [1.0; 3] });
    }
    let positions = vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [9.0, 9.0, 9.0]];
    let mesh = Mesh { positions, triangles: vec![[0, 1, 3], [0, 1, 2], [1, 2, 3], [0, 1, 2], [2, 0, 3]] };
    let mut scene = Loaded { mesh, masks: vec![mask], notes: Vec::new() };
    cut(&mut scene, &Bounds::default()).unwrap();
    let with: Vec<&[u32; 3]> = scene.mesh.triangles.iter().filter(|t| t.contains(&3)).collect();
    assert_eq!(with, [&[0, 1, 3], &[1, 2, 3], &[2, 0, 3]]);
    let count = scene.mesh.triangles.len() - 3;
    assert_eq!(scene.notes, [format!("2 triangles with an alpha mask are cut into {count}")]);
    let places: Vec<usize> = (0..count + 3).filter(|k| scene.mesh.triangles[*k].contains(&3)).collect();
    assert_eq!(places, [0, 1 + count / 2, 2 + count]);
    scene.mesh.triangles.retain(|t| !t.contains(&3));
    assert!((area(&scene.mesh) - 2.0 * 0.375).abs() < 1e-12);
}

#[test]
fn coordinates_in_a_line_or_point() {
    let mask = checker(4, 4, |x, _| if x < 2 { 255 } else { 0 });
    let triangle = MaskedTriangle { triangle: 0, uv: [[0.3, 0.6]; 3], opacity: [1.0; 3] };
    assert_eq!(cut_of(&mask, &triangle).triangles, [[0, 1, 2]]);
    assert!(cut_of(&mask, &MaskedTriangle { uv: [[0.7, 0.6]; 3], ..triangle }).triangles.is_empty());
    // opacity alone: solid where it is at least a half
    let mesh = cut_of(&mask, &MaskedTriangle { uv: [[0.3, 0.6]; 3], opacity: [0.0, 1.0, 0.0], ..triangle });
    assert!((area(&mesh) - 0.125).abs() < 1e-6, "{mesh:?}");
    // along a line: stripes across
    for uv in [[[0.0, 0.1], [2.0, 0.1], [1.0, 0.1]], [[0.0, 0.0], [2.0, 2.0], [0.5, 0.5]], [[1.0, 0.5]; 3].map(|c| c)] {
        let triangle = MaskedTriangle { uv, ..triangle };
        let single = Single::new(&mask, &triangle);
        let mesh = cut_of(&mask, &triangle);
        let r = Random::new(10, [0; 2]);
        for _ in 0..500 {
            let p = [r.range(0.0, 1.0), r.range(0.0, 1.0)];
            if within(p) {
                assert_eq!(cover(&mesh, p), usize::from(single.solid(p)), "{uv:?} {p:?}");
            }
        }
    }
}

#[test]
fn repeats_beyond_sense_are_refused() {
    let mask = checker(2, 2, |x, y| if x == y { 255 } else { 0 });
    for far in [1e4f32, 1e6, 1e12, 3e38] {
        let mut mask = mask.clone();
        mask.triangles.push(MaskedTriangle {
            triangle: 0,
            uv: [[-far, -far], [far, -far], [-far, far]],
            opacity: [1.0; 3],
        });
        let mesh = Mesh { positions: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], triangles: vec![[0, 1, 2]] };
        let fault = cut(&mut Loaded { mesh, masks: vec![mask], notes: Vec::new() }, &Bounds::default()).unwrap_err();
        assert!(matches!(fault, Fault::TooLarge { .. }), "{fault}");
        assert!(fault.to_string().starts_with("alpha mask of material 3, triangle 0: expected at most "), "{fault}");
    }
}

#[test]
fn threads_do_not_matter() {
    let r = Random::new(11, [0; 2]);
    let mut mask = random_mask(&r, 4);
    let mut mesh = Mesh { positions: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], triangles: Vec::new() };
    for triangle in 0..500 {
        mask.triangles.push(MaskedTriangle { triangle, ..random_triangle(&r, triangle % 2 == 0) });
        mesh.triangles.push([0, 1, 2]);
    }
    let scene = Loaded { mesh, masks: vec![mask], notes: Vec::new() };
    let run = |threads| {
        let mut scene = scene.clone();
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| cut(&mut scene, &Bounds::default())).unwrap();
        scene
    };
    assert_eq!(run(1), run(4));
}

#[test]
fn narrow_triangles_have_a_limit_of_their_own() {
    let mask = checker(2, 1, |x, _| if x == 0 { 255 } else { 0 });
    let uv = [[0.0, 0.0], [2_000.0, 0.0], [2_000.0, 1.0]];
    let mesh = cut_of(&mask, &MaskedTriangle { triangle: 0, uv, opacity: [1.0; 3] });
    assert!((3_999..8_000).contains(&mesh.triangles.len()), "{}", mesh.triangles.len());
    assert!((area(&mesh) - 0.25).abs() < 1e-3);
    // So narrow that each is in the way of all others.
    let mut flat = mask.clone();
    let uv = [[0.0, 0.0], [20_000.0, 0.0], [10_000.0, 0.7]];
    flat.triangles.push(MaskedTriangle { triangle: 0, uv, opacity: [1.0; 3] });
    let mesh = Mesh { positions: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], triangles: vec![[0, 1, 2]] };
    let fault = cut(&mut Loaded { mesh, masks: vec![flat], notes: Vec::new() }, &Bounds::default()).unwrap_err();
    assert!(fault.to_string().contains("at most 16384 lines along its outline"), "{fault}");
}

/// Right triangles of 32 repeats of noise; eight that differ, the others are like them.
fn noisy(count: u32) -> Loaded {
    let r = Random::new(12, [0; 2]);
    let mut mask = checker(32, 32, |_, _| if r.range(0.0, 1.0) < 0.5 { 255 } else { 0 });
    let mut mesh = Mesh { positions: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], triangles: Vec::new() };
    for triangle in 0..count {
        let at = (triangle % 8) as f32;
        mask.triangles.push(MaskedTriangle {
            triangle,
            uv: [[at, 0.0], [at + 8.0, 0.0], [at, 8.0]],
            opacity: [1.0; 3],
        });
        mesh.triangles.push([0, 1, 2]);
    }
    Loaded { mesh, masks: vec![mask], notes: Vec::new() }
}

#[test]
fn a_budget_is_kept_or_the_scene_is_refused() {
    let within = |mib: u64, threads| {
        let bounds = Bounds { memory_bytes: Some(mib << 20), ..Bounds::default() };
        let mut scene = noisy(64);
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| cut(&mut scene, &bounds)).map(|()| scene)
    };
    let whole = within(1 << 20, 2).unwrap();
    assert!(whole.mesh.triangles.len() > 1_000_000, "{}", whole.mesh.triangles.len());
    // One after another they fit where all at once do not.
    for threads in [1, 8] {
        assert_eq!(within(64, threads).as_ref(), Ok(&whole), "{threads}");
    }
    for (mib, at) in [(0, "alpha masks"), (4, "alpha mask of material 3, triangle 0"), (24, "triangles cut by")] {
        let fault = within(mib, 1).unwrap_err();
        let Fault::Memory { budget, needed, .. } = fault else { panic!("{mib}: {fault}") };
        assert!(budget == mib << 20 && needed > budget, "{fault}");
        let line = fault.to_string();
        let next = needed.div_ceil(1 << 20) + 1;
        assert!(line.starts_with(&format!("memory budget of {mib} MiB: {at}")), "{line}");
        assert!(line.contains(&format!("give at least --memory {next}")), "{line}");
    }
}

#[test]
fn cutting_ends_when_it_is_told_to() {
    let asked = AtomicU32::new(0);
    let keep_on = || {
        asked.fetch_add(1, Relaxed);
        true
    };
    cut(&mut noisy(8), &Bounds { keep_on: &keep_on, ..Bounds::default() }).unwrap();
    let whole = asked.load(Relaxed);
    assert!(whole > 8 * 10, "in each triangle often: {whole}");
    for most in [0, 1, 5, whole / 2, whole - 1] {
        asked.store(0, Relaxed);
        let keep_on = || asked.fetch_add(1, Relaxed) < most;
        let mut scene = noisy(8);
        let fault = cut(&mut scene, &Bounds { keep_on: &keep_on, ..Bounds::default() }).unwrap_err();
        assert_eq!(fault, Fault::Stopped, "{most}");
    }
    assert_eq!(Fault::Stopped.to_string(), "interrupted; nothing was loaded");
}
