//! The orthographic (directional) light.

/// Depth of a texel that nothing covers: lit at any receiver depth.
pub const UNCOVERED: u32 = u32::MAX;

/// World to light-space lattice of a directional light.
///
/// Lattice x and y run from 0 to `1 << (log2_resolution + subtexel_bits)` across the map; lattice z is the
/// depth that grows along the light and stays in `1 ..= u32::MAX - 1` for the scene itself.
/// Texel (i, j) is the closed square `[i, i + 1] x [j, j + 1]` times `1 << subtexel_bits`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lattice {
    /// Rows of the affine map: lattice = m * (x, y, z, 1), in f64, world units in, lattice steps out.
    pub world_to_lattice: [[f64; 4]; 3],
    /// The map is `1 << log2_resolution` texels on a side, 0 to 24.
    pub log2_resolution: u8,
    /// Lattice steps per texel are `1 << subtexel_bits`, at least 8.
    pub subtexel_bits: u8,
}

impl Lattice {
    /// Texels on a side.
    pub const fn resolution(&self) -> u32 {
        1 << self.log2_resolution
    }

    /// Lattice steps across the map.
    pub const fn side(&self) -> i64 {
        1 << (self.log2_resolution + self.subtexel_bits)
    }

    /// A world point in real lattice units, each row summed from left to right.
    pub fn to_lattice(&self, p: [f64; 3]) -> [f64; 3] {
        self.world_to_lattice.map(|r| ((r[0] * p[0] + r[1] * p[1]) + r[2] * p[2]) + r[3])
    }
}
