//! What attacks are made of: closed shapes, maps of space, and numbers from a seed.

use umbrage::writer::mesh::Mesh;

/// Numbers that depend on nothing but a seed (splitmix64).
pub struct Dice(u64);

impl Dice {
    /// The stream of a seed.
    pub fn new(seed: u64) -> Self {
        Dice(seed.wrapping_mul(0xD6E8_FEB8_6659_FD93) ^ 0x5DEE_CE66_D1CE_4E5B)
    }

    /// 64 bits.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// A whole number from 0 to `n` - 1; 0 where `n` is 0.
    pub fn below(&mut self, n: u64) -> u64 {
        if n == 0 { 0 } else { self.bits() % n }
    }

    /// A real number from -1 (included) to 1 (excluded).
    pub fn signed(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    /// -1 to 1 in quarters, so that coincidences happen.
    pub fn coarse(&mut self) -> f64 {
        self.below(9) as f64 / 4.0 - 1.0
    }
}

/// All of them in one.
pub fn union(parts: impl IntoIterator<Item = Mesh>) -> Mesh {
    parts.into_iter().fold(Mesh::default(), |mut all, part| {
        all.append(&part);
        all
    })
}

/// Every vertex moved by a map.
pub fn mapped(mut mesh: Mesh, f: impl Fn([f64; 3]) -> [f64; 3]) -> Mesh {
    mesh.positions.iter_mut().for_each(|p| *p = f(*p));
    mesh
}

/// Moved.
pub fn moved(mesh: Mesh, by: [f64; 3]) -> Mesh {
    mapped(mesh, |p| [0, 1, 2].map(|k| p[k] + by[k]))
}

/// Stretched; an odd number of negative factors mirrors, and the winding stays as it was.
pub fn scaled(mesh: Mesh, by: [f64; 3]) -> Mesh {
    mapped(mesh, |p| [0, 1, 2].map(|k| p[k] * by[k]))
}

/// Turned about an axis through the origin; `t` is the tangent of half the angle.
pub fn turned(mesh: Mesh, axis: usize, t: f64) -> Mesh {
    let (c, s) = ((1.0 - t * t) / (1.0 + t * t), 2.0 * t / (1.0 + t * t));
    let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
    mapped(mesh, |mut p| {
        (p[u], p[v]) = (c * p[u] - s * p[v], s * p[u] + c * p[v]);
        p
    })
}

/// Inside out.
pub fn flipped(mut mesh: Mesh) -> Mesh {
    mesh.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    mesh
}

/// A box; 12 triangles.
pub fn cuboid(low: [f64; 3], high: [f64; 3]) -> Mesh {
    let positions = (0..8).map(|i| [0, 1, 2].map(|a| if i >> a & 1 == 1 { high[a] } else { low[a] })).collect();
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    Mesh { positions, triangles: quads.into_iter().flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]]).collect() }
}

/// A box about its middle.
pub fn block(middle: [f64; 3], half: [f64; 3]) -> Mesh {
    cuboid([0, 1, 2].map(|k| middle[k] - half[k]), [0, 1, 2].map(|k| middle[k] + half[k]))
}

/// A tetrahedron, which may be inside out.
pub fn tetrahedron(corners: [[f64; 3]; 4]) -> Mesh {
    Mesh { positions: corners.to_vec(), triangles: vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]] }
}

/// A prism over an outline (x, z) about the origin, its caps fans about the y axis; it crosses itself where the
/// outline does. 4 n triangles.
pub fn prism(outline: &[[f64; 2]], low: f64, high: f64) -> Mesh {
    let n = outline.len() as u32;
    let mut positions: Vec<[f64; 3]> =
        [low, high].into_iter().flat_map(|y| outline.iter().map(move |p| [p[0], y, p[1]])).collect();
    positions.extend([[0.0, low, 0.0], [0.0, high, 0.0]]);
    let side = |i: u32| {
        let j = (i + 1) % n;
        [[i, i + n, j + n], [i, j + n, j], [2 * n, i, j], [2 * n + 1, j + n, i + n]]
    };
    Mesh { positions, triangles: (0..n).flat_map(side).collect() }
}

/// Points on a circle, every `step`-th of `n` after the other; a step above 1 gives a star that crosses itself.
pub fn ring(n: u32, step: u32, radius: f64) -> Vec<[f64; 2]> {
    let at = |i: u32| {
        let angle = f64::from(i * step % n) / f64::from(n) * std::f64::consts::TAU;
        [radius * angle.cos(), radius * angle.sin()]
    };
    (0..n).map(at).collect()
}

/// Loose triangles.
pub fn triangles(corners: &[[[f64; 3]; 3]]) -> Mesh {
    let n = corners.len() as u32;
    Mesh { positions: corners.concat(), triangles: (0..n).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect() }
}

/// A rectangle of two triangles, one corner and two sides.
pub fn rectangle(corner: [f64; 3], u: [f64; 3], v: [f64; 3]) -> Mesh {
    let at = |s: f64, t: f64| [0, 1, 2].map(|k| corner[k] + s * u[k] + t * v[k]);
    Mesh {
        positions: vec![at(0.0, 0.0), at(1.0, 0.0), at(1.0, 1.0), at(0.0, 1.0)],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
    }
}

/// Random solids of one seed: boxes, tetrahedra and star-like prisms, turned, sheared, mirrored, inside out, some of
/// them flat or needle-like, and half of the numbers coarse so that planes, edges and corners fall together. Where
/// `open`, loose triangles and boxes without a lid among them.
pub fn solids(seed: u64, open: bool) -> Mesh {
    let mut d = Dice::new(seed);
    let part = |d: &mut Dice| {
        let coarse = d.below(2) == 0;
        let number = |d: &mut Dice| if coarse { d.coarse() } else { d.signed() };
        let size = |d: &mut Dice| if d.below(6) == 0 { 0.003 } else { number(d).abs() * 0.6 + 0.05 };
        let place = [0; 3].map(|_| number(d));
        let shape = match d.below(if open { 5 } else { 3 }) {
            0 => block([0.0; 3], [0; 3].map(|_| size(d))),
            1 => tetrahedron([0; 4].map(|_| [0; 3].map(|_| number(d)))),
            2 => {
                let n = 3 + d.below(6) as u32;
                let mut longer = |p: [f64; 2]| {
                    let r = 0.2 + size(d);
                    p.map(|c| c * r)
                };
                let outline: Vec<_> = ring(n, 1, 1.0).into_iter().map(&mut longer).collect();
                prism(&outline, -size(d), size(d))
            }
            3 => triangles(&[[0; 3].map(|_| [0; 3].map(|_| number(d)))]),
            _ => {
                let mut lidless = block([0.0; 3], [0; 3].map(|_| size(d)));
                lidless.triangles.truncate(10);
                lidless
            }
        };
        let shape = if d.below(2) == 0 { turned(shape, d.below(3) as usize, number(d)) } else { shape };
        let shape = if d.below(5) == 0 { scaled(shape, [-1.0, 1.0, 1.0]) } else { shape };
        let shape = if d.below(6) == 0 { flipped(shape) } else { shape };
        moved(shape, place)
    };
    union((0..1 + d.below(7)).map(|_| part(&mut d)).collect::<Vec<_>>())
}
