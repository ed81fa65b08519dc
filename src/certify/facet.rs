//! One triangle, seen along the light, with exact tests and an exact plane.

use super::Depth;
use umbrage_writer::solid::{SnappedMesh, SolidKind};

/// What a triangle does to a ray.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Role {
    /// The ray enters the solid.
    Entry,
    /// The ray leaves the solid.
    Exit,
    /// The ray enters here and leaves so many lattice steps behind.
    Sheet(u32),
    /// Parallel to the light or degenerate: covers no area and counts nowhere.
    Wall,
}

/// A triangle whose projection runs counter-clockwise; its plane is
/// `z = p.z + (slope . (x - p.x, y - p.y)) / area` with `p` its first corner.
#[derive(Clone, Debug)]
pub(super) struct Facet {
    pub(super) solid: u32,
    pub(super) role: Role,
    pub(super) corners: [[i64; 3]; 3],
    /// Below 2^66 each.
    pub(super) slope: [i128; 2],
    /// Twice the projected area: at most 2^64, zero for walls only.
    pub(super) area: i128,
}

impl Facet {
    pub(super) fn new(mesh: &SnappedMesh, triangle: usize) -> Self {
        let mut p = mesh.triangles[triangle].map(|i| mesh.positions[i as usize]);
        let d = |k: usize, axis: usize| i128::from(p[k][axis] - p[0][axis]);
        let minor = |i, j| d(1, i) * d(2, j) - d(1, j) * d(2, i);
        let normal = [minor(1, 2), minor(2, 0), minor(0, 1)];
        let solid = mesh.solid[triangle];
        let role = match (normal[2].signum(), mesh.solids[solid as usize]) {
            (0, _) => Role::Wall,
            (_, SolidKind::Sheet { thickness }) => Role::Sheet(thickness),
            (-1, SolidKind::Closed) => Role::Entry,
            (_, SolidKind::Closed) => Role::Exit,
        };
        let slope = if normal[2] < 0 { [normal[0], normal[1]] } else { [-normal[0], -normal[1]] };
        if normal[2] < 0 {
            p.swap(1, 2);
        }
        Self { solid, role, corners: p, slope, area: normal[2].abs() }
    }

    /// The same on a lattice whose steps in x and y are `2^k` times as fine; k is at most 4.
    pub(super) fn finer(mut self, k: u32) -> Self {
        for p in &mut self.corners {
            (p[0], p[1]) = (p[0] << k, p[1] << k);
        }
        self.slope = self.slope.map(|s| s << k);
        self.area <<= 2 * k;
        self
    }

    /// The edge function of edge `k` as `[a, b, c]`: `a x + b y + c` is positive inside, x and y counted from `o`.
    pub(super) fn edge(&self, k: usize, o: [i64; 2]) -> [i128; 3] {
        let (p, q) = (self.corners[k], self.corners[(k + 1) % 3]);
        let (a, b) = (i128::from(p[1] - q[1]), i128::from(q[0] - p[0]));
        [a, b, -(a * i128::from(p[0] - o[0]) + b * i128::from(p[1] - o[1]))]
    }

    /// `[a, b, c]` with depth `(a x + b y + c) / area`, x and y counted from `o`; c stays below 2^101.
    pub(super) fn plane(&self, o: [i64; 2]) -> [i128; 3] {
        let [a, b] = self.slope;
        let p = self.corners[0];
        let c = i128::from(p[2]) * self.area - a * i128::from(p[0] - o[0]) - b * i128::from(p[1] - o[1]);
        [a, b, c]
    }

    /// Depth of the plane at a lattice point; the facet is not a wall.
    pub(super) fn depth(&self, p: [i64; 2]) -> Depth {
        Depth::new(self.plane(p)[2], self.area)
    }

    /// Whether the ray at the limit of `p + (eps, eps^2)` meets the facet.
    pub(super) fn meets(&self, p: [i64; 2]) -> bool {
        self.area > 0
            && (0..3).all(|k| {
                let [a, b, c] = self.edge(k, p);
                (c, a, b) > (0, 0, 0)
            })
    }

    /// Whether the closed projection holds `p`.
    pub(super) fn touches(&self, p: [i64; 2]) -> bool {
        self.area > 0 && (0..3).all(|k| self.edge(k, p)[2] >= 0)
    }

    /// Whether the projection shares area with the square of the given side whose lowest corner is `o`.
    pub(super) fn overlaps(&self, o: [i64; 2], side: i64) -> bool {
        let apart = |axis: usize| {
            self.corners.iter().all(|p| p[axis] <= o[axis]) || self.corners.iter().all(|p| p[axis] >= o[axis] + side)
        };
        // Open convex sets are disjoint iff a line along a side of one of them parts them.
        self.area > 0
            && !apart(0)
            && !apart(1)
            && (0..3).all(|k| {
                let [a, b, c] = self.edge(k, o);
                c + (a.max(0) + b.max(0)) * i128::from(side) > 0
            })
    }
}
