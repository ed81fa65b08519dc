//! Which triangles a part of the map may hold: a uniform grid over the map.

use umbrage_writer::solid::SnappedMesh;

/// Most entries in all; a grid with more makes way for a coarser one.
const ENTRIES: usize = 1 << 26;

/// The map is `1 << log2_side` lattice steps and `1 << log2_cells` cells on a side.
#[derive(Clone, Copy)]
struct Shape {
    log2_cells: u32,
    log2_side: u32,
}

impl Shape {
    fn column(self, v: i64) -> i64 {
        (v >> (self.log2_side - self.log2_cells)).clamp(0, (1 << self.log2_cells) - 1)
    }
}

/// Lists of triangles that share a point with each cell, or nearly so. Lower rims belong to a cell, upper ones to the
/// next, except at the end of the map.
pub(super) struct Grid {
    shape: Shape,
    starts: Vec<u32>,
    triangles: Vec<u32>,
}

impl Grid {
    pub(super) fn new(mesh: &SnappedMesh) -> Self {
        let resolution = u32::from(mesh.lattice.log2_resolution);
        let log2_side = resolution + u32::from(mesh.lattice.subtexel_bits);
        let by_count = (2 * mesh.triangles.len()).max(1).next_power_of_two().ilog2() / 2;
        // No more than 64 texels to a cell's side, so that a cell is a fair share of work.
        let mut log2_cells = by_count.max(resolution.saturating_sub(6)).min(resolution).min(12);
        loop {
            let shape = Shape { log2_cells, log2_side };
            let mut counts = vec![0u32; (1 << (2 * log2_cells)) + 1];
            let mut total = 0;
            for_each(mesh, shape, |_, cell| {
                counts[cell + 1] += 1;
                total += 1;
            });
            if total > ENTRIES && log2_cells > 0 {
                log2_cells -= 1;
                continue;
            }
            for i in 1..counts.len() {
                counts[i] += counts[i - 1];
            }
            let mut triangles = vec![0; total];
            let mut next = counts.clone();
            for_each(mesh, shape, |triangle, cell| {
                triangles[next[cell] as usize] = triangle;
                next[cell] += 1;
            });
            return Self { shape, starts: counts, triangles };
        }
    }

    /// Cells on a side.
    pub(super) fn cells(&self) -> u32 {
        1 << self.shape.log2_cells
    }

    /// Number of the cell that holds the point.
    pub(super) fn cell_of(&self, p: [i64; 2]) -> usize {
        let [x, y] = p.map(|v| self.shape.column(v));
        (y << self.shape.log2_cells | x) as usize
    }

    /// Triangles that may share a point with the cell.
    pub(super) fn triangles(&self, cell: usize) -> &[u32] {
        &self.triangles[self.starts[cell] as usize..self.starts[cell + 1] as usize]
    }
}

/// Calls `each(triangle, cell)` for all pairs that may share a point.
fn for_each(mesh: &SnappedMesh, shape: Shape, mut each: impl FnMut(u32, usize)) {
    let side = (1i64 << (shape.log2_side - shape.log2_cells)) as f64;
    for (i, t) in mesh.triangles.iter().enumerate() {
        let p = t.map(|v| mesh.positions[v as usize]);
        let range = |axis: usize| {
            let [a, b, c] = p.map(|p| p[axis]);
            (shape.column(a.min(b).min(c)), shape.column(a.max(b).max(c)))
        };
        let ((x0, x1), (y0, y1)) = (range(0), range(1));
        if (x0, y0) == (x1, y1) || x1 - x0 + y1 - y0 == 1 {
            for y in y0..=y1 {
                for x in x0..=x1 {
                    each(i as u32, (y << shape.log2_cells | x) as usize);
                }
            }
            continue;
        }
        // Edge functions, counted from the first corner so that they round little; `slack` is far above that.
        let at = |k: usize| [(p[k][0] - p[0][0]) as f64, (p[k][1] - p[0][1]) as f64];
        let [u, v] = [at(1), at(2)];
        let turn = if u[0] * v[1] - u[1] * v[0] < 0.0 { -1.0 } else { 1.0 };
        let edges = [0, 1, 2].map(|k| {
            let (q, r) = (at(k), at((k + 1) % 3));
            let (a, b) = (turn * (q[1] - r[1]), turn * (r[0] - q[0]));
            (a, b, q)
        });
        let slack = (1u64 << (2 * shape.log2_side).saturating_sub(45).min(63)) as f64;
        for y in y0..=y1 {
            for x in x0..=x1 {
                let o = [x as f64 * side - p[0][0] as f64, y as f64 * side - p[0][1] as f64];
                let apart = edges.iter().any(|&(a, b, q)| {
                    a * (o[0] - q[0]) + b * (o[1] - q[1]) + (a.max(0.0) + b.max(0.0)) * side < -slack
                });
                if !apart {
                    each(i as u32, (y << shape.log2_cells | x) as usize);
                }
            }
        }
    }
}
