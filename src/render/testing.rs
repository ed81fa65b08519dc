//! Meshes and numbers for the tests of this folder.

use umbrage_format::projection::Lattice;

use super::scene::Surface;

/// splitmix64: the same numbers everywhere.
pub(super) struct Rng(pub(super) u64);

impl Rng {
    pub(super) fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// Below `n`.
    pub(super) fn below(&mut self, n: u64) -> u64 {
        self.next() % n
    }

    /// In [-1, 1).
    pub(super) fn signed(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }
}

/// An owned [`Surface`].
pub(super) struct TestMesh {
    pub(super) lattice: Lattice,
    pub(super) positions: Vec<[i64; 3]>,
    pub(super) triangles: Vec<[u32; 3]>,
}

impl TestMesh {
    pub(super) fn surface(&self) -> Surface<'_> {
        Surface { lattice: &self.lattice, positions: &self.positions, triangles: &self.triangles }
    }

    fn corner(&mut self, p: [i64; 3]) -> u32 {
        self.positions.push(p);
        self.positions.len() as u32 - 1
    }
}

/// World [-1, 1]^3 to a map of 2^log2 texels with 8 sub-texel bits, depth 2^32, light along the world's -Y.
pub(super) fn lattice(log2: u8) -> Lattice {
    let half = (1u64 << (log2 + 8)) as f64 * 0.5;
    let deep = 2_147_483_648.0;
    let world_to_lattice = [[half, 0.0, 0.0, half], [0.0, 0.0, half, half], [0.0, -deep * 0.99, 0.0, deep]];
    Lattice { world_to_lattice, log2_resolution: log2, subtexel_bits: 8 }
}

/// Snaps world triangles.
pub(super) fn snap(lattice: Lattice, positions: &[[f64; 3]], triangles: Vec<[u32; 3]>) -> TestMesh {
    let positions = positions.iter().map(|&p| lattice.to_lattice(p).map(|v| v.round() as i64)).collect();
    TestMesh { lattice, positions, triangles }
}

/// `count` triangles at random, about `size` of the map wide, some of them edge-on or without any area at all.
pub(super) fn soup(rng: &mut Rng, log2: u8, count: usize, size: u64) -> TestMesh {
    let lattice = lattice(log2);
    let (side, deep) = (lattice.side() as u64, 1u64 << 32);
    let mut mesh = TestMesh { lattice, positions: Vec::new(), triangles: Vec::new() };
    for _ in 0..count {
        let (sx, sz) = ((side / size).max(2), (deep / size).max(2));
        let at = [rng.below(side - sx / 2), rng.below(side - sx / 2), rng.below((deep - sz).max(1))];
        let mut t: [[i64; 3]; 3] = std::array::from_fn(|_| {
            [
                (at[0] + rng.below(sx)).min(side) as i64,
                (at[1] + rng.below(sx)).min(side) as i64,
                (at[2] + rng.below(sz)) as i64,
            ]
        });
        match rng.below(10) {
            0 => t[2] = std::array::from_fn(|k| if k == 2 { t[2][2] } else { t[0][k] }),
            1 => t.iter_mut().for_each(|c| c[0] = at[0] as i64),
            _ => {}
        }
        let t = t.map(|c| mesh.corner(c));
        mesh.triangles.push(t);
    }
    mesh
}

/// A closed sphere of `2 * n * n` or so triangles.
pub(super) fn sphere(lattice: Lattice, n: u32, radius: f64) -> TestMesh {
    let mut positions = vec![[0.0, radius, 0.0], [0.0, -radius, 0.0]];
    let ring = |i: u32, j: u32| 2 + (i - 1) * n + j % n;
    for i in 1..n {
        for j in 0..n {
            let (a, b) = (
                f64::from(i) * std::f64::consts::PI / f64::from(n),
                f64::from(j) * std::f64::consts::TAU / f64::from(n),
            );
            positions.push([radius * a.sin() * b.cos(), radius * a.cos(), radius * a.sin() * b.sin()]);
        }
    }
    let mut triangles = Vec::new();
    for j in 0..n {
        triangles.push([0, ring(1, j + 1), ring(1, j)]);
        triangles.push([1, ring(n - 1, j), ring(n - 1, j + 1)]);
        for i in 1..n - 1 {
            triangles.push([ring(i, j), ring(i, j + 1), ring(i + 1, j)]);
            triangles.push([ring(i, j + 1), ring(i + 1, j + 1), ring(i + 1, j)]);
        }
    }
    snap(lattice, &positions, triangles)
}

/// An axis-aligned box of the world, 12 triangles, wound outwards.
pub(super) fn boxed(positions: &mut Vec<[f64; 3]>, triangles: &mut Vec<[u32; 3]>, low: [f64; 3], high: [f64; 3]) {
    let base = positions.len() as u32;
    for i in 0..8 {
        positions.push(std::array::from_fn(|k| if i >> k & 1 == 0 { low[k] } else { high[k] }));
    }
    for q in [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]] {
        triangles.push([q[0], q[1], q[2]].map(|v: u32| v + base));
        triangles.push([q[0], q[2], q[3]].map(|v: u32| v + base));
    }
}

/// A floor and `count` boxes of very different sizes.
pub(super) fn boxes(rng: &mut Rng, log2: u8, count: usize) -> TestMesh {
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    boxed(&mut positions, &mut triangles, [-0.99, -0.95, -0.99], [0.99, -0.9, 0.99]);
    for _ in 0..count {
        let size = 0.3 * 0.5_f64.powi(rng.below(8) as i32);
        let at = [rng.signed() * 0.6, rng.signed() * 0.6, rng.signed() * 0.6];
        boxed(&mut positions, &mut triangles, at.map(|v| v - size), at.map(|v| v + size * (1.2 + rng.signed()) * 0.5));
    }
    snap(lattice(log2), &positions, triangles)
}
