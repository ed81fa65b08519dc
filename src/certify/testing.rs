//! Meshes for tests.

use umbrage_format::projection::Lattice;
use umbrage_writer::solid::{SnappedMesh, SolidKind};

/// splitmix64.
pub struct Rng(pub u64);

impl Rng {
    pub fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// A number in `low..=high`.
    pub fn within(&mut self, low: i64, high: i64) -> i64 {
        low + (self.next() % (high - low + 1) as u64) as i64
    }
}

/// An empty mesh on a map of `1 << log2_resolution` texels a side with `bits` lattice bits in all.
pub fn empty(log2_resolution: u8, bits: u8) -> SnappedMesh {
    let lattice = Lattice {
        world_to_lattice: [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]],
        log2_resolution,
        subtexel_bits: bits - log2_resolution,
    };
    SnappedMesh {
        lattice,
        positions: Vec::new(),
        triangles: Vec::new(),
        solid: Vec::new(),
        solids: Vec::new(),
        second_surface: false,
        displacement: 0.0,
        components: Default::default(),
    }
}

/// Adds triangles to a solid, new if `solid` is the next free number.
pub fn add(mesh: &mut SnappedMesh, solid: u32, kind: SolidKind, points: &[[i64; 3]], triangles: &[[u32; 3]]) {
    if solid as usize == mesh.solids.len() {
        mesh.solids.push(kind);
    }
    let base = mesh.positions.len() as u32;
    mesh.positions.extend_from_slice(points);
    mesh.triangles.extend(triangles.iter().map(|t| t.map(|v| v + base)));
    mesh.solid.resize(mesh.triangles.len(), solid);
}

/// Adds a hexahedron: corner `i` is high in axis k where bit k of i is set. `flip` turns it inside out.
pub fn add_hexahedron(mesh: &mut SnappedMesh, solid: u32, corners: [[i64; 3]; 8], flip: bool) {
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let mut triangles = Vec::new();
    for [a, b, c, d] in quads {
        for t in [[a, b, c], [a, c, d]] {
            triangles.push(if flip { [t[0], t[2], t[1]] } else { t });
        }
    }
    add(mesh, solid, SolidKind::Closed, &corners, &triangles);
}

/// Adds a box from `low` to `high`.
pub fn add_box(mesh: &mut SnappedMesh, solid: u32, low: [i64; 3], high: [i64; 3], flip: bool) {
    let corners =
        [0, 1, 2, 3, 4, 5, 6, 7usize].map(|i| [0, 1, 2].map(|k: usize| if i >> k & 1 == 1 { high[k] } else { low[k] }));
    add_hexahedron(mesh, solid, corners, flip);
}

/// Adds a tetrahedron, turned outside out; one without volume is left out.
pub fn add_tetrahedron(mesh: &mut SnappedMesh, solid: u32, mut p: [[i64; 3]; 4]) {
    let e = |k: usize| [0, 1, 2].map(|a| i128::from(p[k][a] - p[0][a]));
    let (a, b, c) = (e(1), e(2), e(3));
    let cross = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    // In f64: only wildly thin ones could come out with the wrong sign, and those as cavities are fair game.
    let volume: f64 = (0..3).map(|k| cross[k] as f64 * c[k] as f64).sum();
    if volume == 0.0 {
        return;
    }
    if volume < 0.0 {
        p.swap(2, 3);
    }
    add(mesh, solid, SolidKind::Closed, &p, &[[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]);
}
