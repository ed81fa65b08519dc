//! The snapped mesh as words for the device: what is drawn is what was baked, to the lattice step.

use umbrage_writer::solid::SnappedMesh;

use super::uniform::lattice_steps;

/// Positions, three words each, then for each triangle the numbers of three positions and of its solid.
pub(super) struct MeshWords {
    pub words: Vec<u32>,
    /// Word at which the triangles begin.
    pub triangles_at: u32,
    /// Triangles.
    pub triangles: u32,
}

/// Bytes of the words of a mesh.
pub(super) fn bytes(mesh: &SnappedMesh) -> u64 {
    4 * (3 * mesh.positions.len() as u64 + 4 * mesh.triangles.len() as u64)
}

/// The smallest and the largest coordinates of a mesh in the world; of one without positions infinite ones, the largest first.
pub fn bounds(mesh: &SnappedMesh) -> [[f64; 3]; 2] {
    let (rows, steps) = (mesh.lattice.world_to_lattice, lattice_steps(&mesh.lattice));
    let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    for p in &mesh.positions {
        let off = [0, 1, 2].map(|i| p[i] as f64 - rows[i][3]);
        let world: [f64; 3] = std::array::from_fn(|k| (0..3).map(|i| steps[i][k] * off[i]).sum());
        low = std::array::from_fn(|k| low[k].min(world[k]));
        high = std::array::from_fn(|k| high[k].max(world[k]));
    }
    [low, high]
}

impl MeshWords {
    /// Of a mesh whose [`bytes`] a device binds: less than 2^32 words. On maps whose far border is 2^32 steps away, what lies
    /// upon it is drawn one step inside.
    pub fn new(mesh: &SnappedMesh) -> Self {
        let word = |v: i64| u32::try_from(v.max(0)).unwrap_or(u32::MAX);
        let mut words = Vec::with_capacity(3 * mesh.positions.len() + 4 * mesh.triangles.len());
        words.extend(mesh.positions.iter().flat_map(|p| p.map(word)));
        let triangles_at = words.len() as u32;
        let solid = |t: usize| mesh.solid.get(t).copied().unwrap_or(0);
        words.extend(mesh.triangles.iter().enumerate().flat_map(|(t, &[a, b, c])| [a, b, c, solid(t)]));
        Self { words, triangles_at, triangles: mesh.triangles.len() as u32 }
    }
}
