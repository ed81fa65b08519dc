//! Closed solids and the frames they stand in.
//!
//! [`Frame`] places a solid; its rotations are rational or quarter turns, so no sine is ever taken. [`Builder`] adds
//! one solid per call. Each solid has its own vertices, is closed and is oriented outward; solids of one scene may
//! touch or overlap, but must not share vertices, so callers never repeat a corner exactly.

use crate::mesh::Mesh;

/// An orthonormal right-handed frame: where local coordinates lie in the world.
#[derive(Clone, Copy)]
pub(super) struct Frame {
    origin: [f64; 3],
    /// Images of the local x, y and z axes.
    axes: [[f64; 3]; 3],
}

impl Frame {
    /// The world itself.
    pub(super) const WORLD: Self = Self { origin: [0.0; 3], axes: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]] };

    /// The world position of a local point.
    pub(super) fn point(&self, p: [f64; 3]) -> [f64; 3] {
        let turned = self.turn(p);
        [0, 1, 2].map(|k| self.origin[k] + turned[k])
    }

    /// The world direction of a local direction.
    pub(super) fn turn(&self, p: [f64; 3]) -> [f64; 3] {
        [0, 1, 2].map(|k| p[0] * self.axes[0][k] + p[1] * self.axes[1][k] + p[2] * self.axes[2][k])
    }

    /// This frame with its origin moved to a local point.
    pub(super) fn at(&self, p: [f64; 3]) -> Self {
        Self { origin: self.point(p), axes: self.axes }
    }

    fn turned(&self, axes: [[f64; 3]; 3]) -> Self {
        Self { origin: self.origin, axes: axes.map(|a| self.turn(a)) }
    }

    /// Turned about the local y axis by twice the angle whose tangent is `t`.
    pub(super) fn yawed(&self, t: f64) -> Self {
        let (c, s) = rational(t);
        self.turned([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])
    }

    /// Turned about the local y axis by `k` quarter turns, exactly.
    pub(super) fn quarter(&self, k: u32) -> Self {
        let (c, s) = [(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)][k as usize % 4];
        self.turned([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])
    }

    /// Turned so that what faced local +z faces up, and what was up faces local -z, exactly.
    pub(super) fn tipped(&self) -> Self {
        self.turned([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    }

    /// Turned by the quaternion (w, x, y, z), which need not be of unit length but must not be zero.
    pub(super) fn spun(&self, [w, x, y, z]: [f64; 4]) -> Self {
        let n = 2.0 / (w * w + x * x + y * y + z * z);
        self.turned([
            [1.0 - n * (y * y + z * z), n * (x * y + w * z), n * (x * z - w * y)],
            [n * (x * y - w * z), 1.0 - n * (x * x + z * z), n * (y * z + w * x)],
            [n * (x * z + w * y), n * (y * z - w * x), 1.0 - n * (x * x + y * y)],
        ])
    }
}

/// The point of the unit circle at twice the angle whose tangent is `t`.
pub(super) fn rational(t: f64) -> (f64, f64) {
    let n = 1.0 + t * t;
    ((1.0 - t * t) / n, 2.0 * t / n)
}

/// A regular polygon of 3 to 8 corners about the origin of the (x, z) plane, from x towards z, corner radius 1.
pub(super) fn polygon(sides: u32) -> Vec<[f64; 2]> {
    // Cosine and sine of one step; written out, because library functions differ between machines.
    let (c, s) = match sides {
        3 => (-0.5, 0.866_025_403_784_438_6),
        4 => (0.0, 1.0),
        5 => (0.309_016_994_374_947_45, 0.951_056_516_295_153_5),
        6 => (0.5, 0.866_025_403_784_438_6),
        7 => (0.623_489_801_858_733_6, 0.781_831_482_468_029_8),
        _ => (std::f64::consts::FRAC_1_SQRT_2, std::f64::consts::FRAC_1_SQRT_2),
    };
    let mut corners = vec![[1.0, 0.0]];
    for i in 1..sides.clamp(3, 8) as usize {
        let [x, z] = corners[i - 1];
        corners.push([c * x - s * z, s * x + c * z]);
    }
    corners
}

/// Collects closed solids into one mesh.
#[derive(Default)]
pub(super) struct Builder {
    pub(super) mesh: Mesh,
}

impl Builder {
    /// Adds one solid given by local points and triangles among them.
    pub(super) fn solid(&mut self, frame: &Frame, points: &[[f64; 3]], triangles: &[[u32; 3]]) {
        let base = self.mesh.positions.len() as u32;
        self.mesh.positions.extend(points.iter().map(|&p| frame.point(p)));
        self.mesh.triangles.extend(triangles.iter().map(|t| t.map(|i| i + base)));
    }

    /// A box from corner `low` to corner `high`; 12 triangles.
    pub(super) fn cuboid(&mut self, frame: &Frame, low: [f64; 3], high: [f64; 3]) {
        let (points, triangles) = cuboid(low, high);
        self.solid(frame, &points, &triangles);
    }

    /// An inside-out box: a cavity of the solid that surrounds it.
    pub(super) fn cavity(&mut self, frame: &Frame, low: [f64; 3], high: [f64; 3]) {
        let (points, triangles) = cuboid(low, high);
        self.solid(frame, &points, &triangles.map(|[a, b, c]| [a, c, b]));
    }

    /// A roof on the rectangle from `low` to `high` (x, z) at height `base`, its ridge along x at height `ridge`.
    ///
    /// `hip` is how far each end of the ridge lies inside the rectangle (0: a gable), `side` the place of the ridge
    /// across it from 0 to 1 (an end: a shed roof). 8 triangles.
    pub(super) fn roof(
        &mut self,
        frame: &Frame,
        [low, high]: [[f64; 2]; 2],
        [base, ridge]: [f64; 2],
        hip: f64,
        side: f64,
    ) {
        let across = low[1] + (high[1] - low[1]) * side;
        let points = [
            [low[0], base, low[1]],
            [high[0], base, low[1]],
            [high[0], base, high[1]],
            [low[0], base, high[1]],
            [low[0] + hip, ridge, across],
            [high[0] - hip, ridge, across],
        ];
        let triangles = [[0, 1, 2], [0, 2, 3], [0, 4, 5], [0, 5, 1], [3, 2, 5], [3, 5, 4], [0, 3, 4], [1, 5, 2]];
        self.solid(frame, &points, &triangles);
    }

    /// A tube through rings of equally many local points, closed by flat fans at both ends.
    ///
    /// Rings run from local x towards z as seen along the tube's own +y.
    pub(super) fn loft(&mut self, frame: &Frame, rings: &[Vec<[f64; 3]>]) {
        let n = rings[0].len() as u32;
        let last = (rings.len() as u32 - 1) * n;
        let mut triangles = Vec::new();
        for ring in 0..rings.len() as u32 - 1 {
            for i in 0..n {
                let (a, b) = (ring * n + i, ring * n + (i + 1) % n);
                triangles.extend([[a, a + n, b + n], [a, b + n, b]]);
            }
        }
        for i in 1..n - 1 {
            triangles.extend([[0, i, i + 1], [last, last + i + 1, last + i]]);
        }
        self.solid(frame, &rings.concat(), &triangles);
    }

    /// A convex outline (x, z; from x towards z) raised from `low` to `high`; 4 n - 4 triangles.
    pub(super) fn extrude(&mut self, frame: &Frame, outline: &[[f64; 2]], [low, high]: [f64; 2]) {
        let ring = |y: f64| outline.iter().map(|p| [p[0], y, p[1]]).collect::<Vec<_>>();
        self.loft(frame, &[ring(low), ring(high)]);
    }

    /// An upright prism or frustum about the frame's y axis; radii at the bottom and at the top; 4 n - 4 triangles.
    pub(super) fn pole(&mut self, frame: &Frame, sides: u32, [r0, r1]: [f64; 2], [y0, y1]: [f64; 2]) {
        let outline = polygon(sides);
        let ring = |r: f64, y: f64| outline.iter().map(|p| [p[0] * r, y, p[1] * r]).collect::<Vec<_>>();
        self.loft(frame, &[ring(r0, y0), ring(r1, y1)]);
    }

    /// Two pyramids on one ring of radius `r` at height `y`, apexes at `low` and `high`; 2 n triangles.
    pub(super) fn spindle(&mut self, frame: &Frame, sides: u32, r: [f64; 2], [low, y, high]: [f64; 3]) {
        let mut points: Vec<_> = polygon(sides).iter().map(|p| [p[0] * r[0], y, p[1] * r[1]]).collect();
        let n = points.len() as u32;
        points.extend([[0.0, high, 0.0], [0.0, low, 0.0]]);
        let triangles: Vec<_> = (0..n).flat_map(|i| [[i, n, (i + 1) % n], [i, (i + 1) % n, n + 1]]).collect();
        self.solid(frame, &points, &triangles);
    }

    /// A rectangular ring wall: outer half sizes, thickness inward, from `low` to `high`; 32 triangles.
    pub(super) fn rim(&mut self, frame: &Frame, half: [f64; 2], thick: f64, [low, high]: [f64; 2]) {
        let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
        let mut points = Vec::new();
        for (inset, y) in [(0.0, low), (0.0, high), (thick, high), (thick, low)] {
            points.extend(corners.map(|c| [c[0] * (half[0] - inset), y, c[1] * (half[1] - inset)]));
        }
        let mut triangles = Vec::new();
        for band in 0..4 {
            for i in 0..4 {
                let (a, b) = (band * 4 + i, band * 4 + (i + 1) % 4);
                let (c, d) = ((a + 4) % 16, (b + 4) % 16);
                triangles.extend([[a, c, d], [a, d, b]]);
            }
        }
        self.solid(frame, &points, &triangles);
    }

    /// A box whose +z face has a row of `niches`, each `depth` deep and separated by `post` in x and `rail` in y.
    ///
    /// One solid, not convex; 24 n + 20 triangles.
    pub(super) fn niched(
        &mut self,
        frame: &Frame,
        [low, high]: [[f64; 3]; 2],
        niches: u32,
        [post, rail, depth]: [f64; 3],
    ) {
        let columns = 2 * niches + 1;
        let width = (high[0] - low[0] - post * f64::from(niches + 1)) / f64::from(niches);
        let across = |i: u32| match i {
            0 => low[0],
            i if i == columns => high[0],
            i => low[0] + f64::from(i / 2) * (post + width) + if i % 2 == 1 { post } else { 0.0 },
        };
        let up = [low[1], low[1] + rail, high[1] - rail, high[1]];
        let mut points: Vec<_> = (0..=columns).flat_map(|i| up.map(|y| [across(i), y, high[2]])).collect();
        let front = |i: u32, j: u32| i * 4 + j;
        let [k00, k10, k11, k01] = [0, 1, 2, 3].map(|k| points.len() as u32 + k);
        points.extend(
            [[low[0], low[1]], [high[0], low[1]], [high[0], high[1]], [low[0], high[1]]].map(|[x, y]| [x, y, low[2]]),
        );
        let mut triangles = Vec::new();
        let mut quad = |a: u32, b: u32, c: u32, d: u32| triangles.extend([[a, b, c], [a, c, d]]);
        quad(k10, k00, k01, k11);
        for i in 0..columns {
            for j in 0..3 {
                let f = [front(i, j), front(i + 1, j), front(i + 1, j + 1), front(i, j + 1)];
                if i % 2 == 1 && j == 1 {
                    let back = points.len() as u32;
                    for corner in f {
                        let [x, y, z] = points[corner as usize];
                        points.push([x, y, z - depth]);
                    }
                    let b = [back, back + 1, back + 2, back + 3];
                    quad(b[0], b[1], b[2], b[3]);
                    for (k, l) in [(0, 1), (1, 2), (2, 3), (3, 0)] {
                        quad(f[k], f[l], b[l], b[k]);
                    }
                } else {
                    quad(f[0], f[1], f[2], f[3]);
                }
            }
        }
        // The other faces are fans, for the front's edges carry the corners of its grid.
        triangles.extend([[k00, k10, front(columns, 0)], [k11, k01, front(0, 3)]]);
        triangles.extend([[k00, front(0, 3), k01], [k10, k11, front(columns, 3)]]);
        for i in 0..columns {
            triangles.extend([[k00, front(i + 1, 0), front(i, 0)], [k11, front(i, 3), front(i + 1, 3)]]);
        }
        for j in 0..3 {
            triangles.extend([[k00, front(0, j), front(0, j + 1)], [k10, front(columns, j + 1), front(columns, j)]]);
        }
        self.solid(frame, &points, &triangles);
    }

    /// A slab under `height(x, z)` on the square of half size `half`, `cells` cells a side, its bottom flat at `bottom`.
    ///
    /// The height must stay above `bottom`. 2 n^2 + 12 n triangles.
    pub(super) fn ground(&mut self, half: f64, cells: u32, bottom: f64, height: impl Fn(f64, f64) -> f64) {
        let n = cells + 1;
        let place = |i: u32| if i == cells { half } else { half * (2.0 * f64::from(i) / f64::from(cells) - 1.0) };
        let mut points = Vec::with_capacity((n * n + 4 * n) as usize);
        for (z, x) in (0..n).flat_map(|k| (0..n).map(move |i| (place(k), place(i)))) {
            points.push([x, height(x, z), z]);
        }
        let mut triangles = Vec::with_capacity((2 * cells * cells + 12 * cells) as usize);
        for (k, i) in (0..cells).flat_map(|k| (0..cells).map(move |i| (k, i))) {
            let a = k * n + i;
            triangles.extend([[a, a + n, a + n + 1], [a, a + n + 1, a + 1]]);
        }
        // Once around the border, from x towards z.
        let border: Vec<u32> = (0..4 * cells)
            .map(|s| match (s / cells, s % cells) {
                (0, i) => i,
                (1, k) => k * n + cells,
                (2, i) => cells * n + cells - i,
                (_, k) => (cells - k) * n,
            })
            .collect();
        let under = points.len() as u32;
        for &top in &border {
            let [x, _, z] = points[top as usize];
            points.push([x, bottom, z]);
        }
        let centre = points.len() as u32;
        points.push([0.0, bottom, 0.0]);
        for s in 0..4 * cells {
            let next = (s + 1) % (4 * cells);
            let (a, b) = (under + s, under + next);
            triangles.extend([
                [a, border[s as usize], border[next as usize]],
                [a, border[next as usize], b],
                [a, b, centre],
            ]);
        }
        self.solid(&Frame::WORLD, &points, &triangles);
    }
}

fn cuboid(low: [f64; 3], high: [f64; 3]) -> ([[f64; 3]; 8], [[u32; 3]; 12]) {
    // Corner i takes the high side of axis k where bit k of i is set.
    let points = [0, 1, 2, 3, 4, 5, 6, 7].map(|i| [0, 1, 2].map(|k| if i >> k & 1 == 1 { high[k] } else { low[k] }));
    let triangles = [
        [0, 4, 6],
        [0, 6, 2],
        [1, 3, 7],
        [1, 7, 5],
        [0, 1, 5],
        [0, 5, 4],
        [2, 6, 7],
        [2, 7, 3],
        [0, 2, 3],
        [0, 3, 1],
        [4, 5, 7],
        [4, 7, 6],
    ];
    (points, triangles)
}

/// The unit sphere as an octahedron of `n` steps an edge, in points and triangles; 8 n^2 triangles.
pub(super) fn sphere(n: u32) -> (Vec<[f64; 3]>, Vec<[u32; 3]>) {
    let around = [[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]];
    let mut points = Vec::with_capacity((4 * n * n + 2) as usize);
    let mut starts = Vec::with_capacity(2 * n as usize + 1);
    // Rings from the top down; ring m has min(m, 2 n - m) points in each quadrant, the poles have one.
    let width = |m: u32| m.min(2 * n - m);
    for m in 0..=2 * n {
        starts.push(points.len() as u32);
        let (r, y) = (width(m), f64::from(n) - f64::from(m));
        if r == 0 {
            points.push([0.0, y / f64::from(n), 0.0]);
        }
        for (q, k) in (0..4).flat_map(|q| (0..r).map(move |k| (q, k))) {
            let (a, b): ([f64; 2], [f64; 2]) = (around[q], around[(q + 1) % 4]);
            let (u, v) = (f64::from(r - k), f64::from(k));
            let p = [a[0] * u + b[0] * v, y, a[1] * u + b[1] * v];
            let length = (p[0] * p[0] + p[1] * p[1] + p[2] * p[2]).sqrt();
            points.push(p.map(|c| c / length));
        }
    }
    let at = |m: u32, q: u32, k: u32| match width(m) {
        0 => starts[m as usize],
        r => starts[m as usize] + (q * r + k) % (4 * r),
    };
    let mut triangles = Vec::with_capacity(8 * (n * n) as usize);
    for (m, q) in (0..2 * n).flat_map(|m| (0..4).map(move |q| (m, q))) {
        // Between a narrow ring (`s`) and a wide one (`w`); below the equator the same upside down.
        let upper = m < n;
        let (s, w) = if upper { (m, m + 1) } else { (m + 1, m) };
        let mut put = |t: [u32; 3]| triangles.push(if upper { t } else { [t[0], t[2], t[1]] });
        for k in 0..=width(s) {
            put([at(s, q, k), at(w, q, k + 1), at(w, q, k)]);
        }
        for k in 0..width(s) {
            put([at(s, q, k), at(s, q, k + 1), at(w, q, k + 1)]);
        }
    }
    (points, triangles)
}

#[cfg(test)]
mod tests {
    use super::super::check::audit;
    use super::*;

    fn alone(triangles: usize, build: impl FnOnce(&mut Builder, &Frame)) {
        let mut builder = Builder::default();
        build(&mut builder, &Frame::WORLD.at([5.0, -3.0, 2.0]).yawed(0.3).spun([2.0, 0.5, -1.0, 0.25]));
        let report = audit(&builder.mesh);
        assert_eq!((report.triangles, report.solids, report.cavities), (triangles, 1, 0));
    }

    #[test]
    fn every_shape_is_closed_and_faces_outward() {
        alone(12, |b, f| b.cuboid(f, [-1.0; 3], [1.0, 2.0, 3.0]));
        for (hip, side) in [(0.0, 0.5), (0.4, 0.5), (0.0, 1.0), (0.2, 0.0)] {
            alone(8, |b, f| b.roof(f, [[-1.0, -1.0], [2.0, 1.0]], [0.0, 1.0], hip, side));
        }
        for sides in 3..=8 {
            alone(4 * sides as usize - 4, |b, f| b.pole(f, sides, [0.2, 0.1], [-1.0, 4.0]));
            alone(2 * sides as usize, |b, f| b.spindle(f, sides, [0.2, 0.1], [-1.0, 0.5, 4.0]));
        }
        alone(32, |b, f| b.rim(f, [3.0, 2.0], 0.3, [0.0, 1.0]));
        for n in 1..5 {
            let sizes = [0.2, 0.1, 0.3];
            alone(24 * n as usize + 20, |b, f| b.niched(f, [[-3.0, 0.0, -0.5], [3.0, 2.0, 0.0]], n, sizes));
        }
        for n in 1..5 {
            let (points, triangles) = sphere(n);
            alone(8 * (n * n) as usize, |b, f| b.solid(f, &points, &triangles));
        }
        alone(2 * 36 + 12 * 6, |b, _| b.ground(10.0, 6, -2.0, |x, z| 0.01 * x * z));
    }

    #[test]
    fn an_inside_out_box_is_a_cavity() {
        let mut builder = Builder::default();
        builder.cuboid(&Frame::WORLD, [-2.0; 3], [2.0; 3]);
        builder.cavity(&Frame::WORLD, [-1.0; 3], [1.0; 3]);
        let report = audit(&builder.mesh);
        assert_eq!((report.solids, report.cavities), (1, 1));
    }

    #[test]
    fn frames_keep_lengths_and_handedness() {
        let quaternion = Frame::WORLD.yawed(-0.7).quarter(3).tipped().spun([0.3, 1.0, -2.0, 0.5]);
        let [x, y, z] = quaternion.axes;
        let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
        let cross = [x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]];
        assert!((dot(cross, z) - 1.0).abs() < 1e-12 && dot(x, y).abs() < 1e-12);
    }
}
