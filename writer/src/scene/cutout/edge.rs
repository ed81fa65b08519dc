//! An edge of a triangle: where the mask changes along it.
//!
//! Everything is worked out from the lesser to the greater end, by place and opacity, so that the triangles on both
//! sides of an edge of the mesh find the same points if their texture coordinates and opacities agree.

use std::collections::HashMap;

use super::root::{Cubic, roots};
use super::sample::{Cell, Field, UNIT};

/// Steps along an edge: places between its ends are multiples of 1 / this, so that 1 - t is exact.
pub const STEPS: f64 = (1u64 << 44) as f64;

/// A corner of a triangle, or another point on the border of a piece.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Corner {
    /// Position in the image.
    pub at: [i64; 2],
    pub opacity: f64,
}

/// Where solid and hole meet on an edge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mark {
    /// From 0 at `Edge::from` to 1 at `Edge::to`, exclusive.
    pub t: f64,
    /// Position in the image.
    pub at: [i64; 2],
}

pub struct Edge {
    pub from: Corner,
    pub to: Corner,
    /// Whether it runs against the triangle's direction.
    pub turned: bool,
    /// Rising.
    pub marks: Vec<Mark>,
    /// From which place on the triangle's side is solid, or not.
    runs: Vec<(f64, bool)>,
    /// Marks within a cell, rising.
    roots: HashMap<[i64; 2], Vec<[i64; 2]>>,
}

impl Edge {
    /// The edge of a counter-clockwise triangle from `a` to `b`.
    pub fn new(field: &Field, a: Corner, b: Corner) -> Edge {
        let key = |c: &Corner| (c.at, c.opacity);
        let turned = key(&b) < key(&a);
        let (from, to) = if turned { (b, a) } else { (a, b) };
        let mut edge = Edge { from, to, turned, marks: Vec::new(), runs: Vec::new(), roots: HashMap::new() };
        edge.walk(field);
        edge
    }

    /// The point where it crosses the line at this coordinate; its ends lie on both sides.
    pub fn cross(&self, axis: usize, line: i64) -> (f64, Corner) {
        let (a, b) = (self.from.at, self.to.at);
        let (gone, whole) = (line - a[axis], b[axis] - a[axis]);
        let t = gone as f64 / whole as f64;
        let other = 1 - axis;
        let mut at = [line; 2];
        at[other] = a[other] + divided(i128::from(b[other] - a[other]) * i128::from(gone), i128::from(whole));
        (t, Corner { at, opacity: self.opacity(t) })
    }

    fn opacity(&self, t: f64) -> f64 {
        self.from.opacity + (self.to.opacity - self.from.opacity) * t
    }

    /// Marks within a cell, in the triangle's direction.
    pub fn roots(&self, cell: [i64; 2]) -> Vec<[i64; 2]> {
        let mut roots = self.roots.get(&cell).cloned().unwrap_or_default();
        if self.turned {
            roots.reverse();
        }
        roots
    }

    /// Whether the triangle is solid at this place on it.
    pub fn solid(&self, t: f64) -> bool {
        let next = self.runs.partition_point(|r| r.0 <= t);
        self.runs[next.saturating_sub(1)].1
    }

    /// Its ends and the points where it crosses the borders of cells, in order.
    fn crossings(&self) -> Vec<(f64, Corner)> {
        let lines = |a: i64, b: i64| {
            let (low, high) = (a.min(b).div_euclid(UNIT) + 1, (a.max(b) - 1).div_euclid(UNIT));
            (low..=high).map(move |k| if a < b { k } else { low + high - k } * UNIT)
        };
        let mut columns = vec![(0.0, self.from)];
        columns.extend(lines(self.from.at[0], self.to.at[0]).map(|x| self.cross(0, x)));
        columns.push((1.0, self.to));
        let mut all = vec![columns[0]];
        for pair in columns.windows(2) {
            all.extend(lines(pair[0].1.at[1], pair[1].1.at[1]).map(|y| self.cross(1, y)));
            all.push(pair[1]);
        }
        all
    }

    /// The cells on the triangle's side and on the other side of a part of it.
    fn sides(&self, p: [i64; 2], q: [i64; 2]) -> [[i64; 2]; 2] {
        let d = [0, 1].map(|k| self.to.at[k] - self.from.at[k]);
        // to the left of the triangle's direction
        let inward = if self.turned { [d[1], -d[0]] } else { [-d[1], d[0]] };
        [1, -1].map(|side| {
            [0, 1].map(|k| {
                let middle = p[k] + q[k];
                let cell = middle.div_euclid(2 * UNIT);
                if middle.rem_euclid(2 * UNIT) == 0 && inward[k] * side < 0 { cell - 1 } else { cell }
            })
        })
    }

    fn walk(&mut self, field: &Field) {
        let crossings = self.crossings();
        let mut marks = Vec::new();
        let mut before: [Option<bool>; 2] = [None; 2];
        let (a, b) = (self.from.at.map(|c| c as f64), self.to.at.map(|c| c as f64));
        for pair in crossings.windows(2) {
            let [(start, p), (end, q)] = [pair[0], pair[1]];
            // The edge as a whole may be a point of the image.
            if p.at == q.at && crossings.len() > 2 {
                continue;
            }
            for (side, cell) in self.sides(p.at, q.at).into_iter().enumerate() {
                let c = along(field, &field.cell(cell), cell, p, q);
                let ends = [c[0], field.value(field.cell(cell).at(local(cell, q.at)), q.opacity)].map(|v| v >= 0.0);
                if before[side].is_some_and(|b| b != ends[0]) {
                    marks.push(Mark { t: start, at: p.at });
                }
                let mut solid = ends[0];
                if side == 0 && before[0] != Some(solid) {
                    self.runs.push((start, solid));
                }
                for s in roots(&c, ends) {
                    let t = start + s * (end - start);
                    let at = [0, 1].map(|k| {
                        let (low, high) = (p.at[k].min(q.at[k]), p.at[k].max(q.at[k]));
                        ((a[k] + (b[k] - a[k]) * t).round() as i64).clamp(low, high)
                    });
                    marks.push(Mark { t, at });
                    if side == 0 {
                        solid = !solid;
                        self.runs.push((t, solid));
                        self.roots.entry(cell).or_default().push(at);
                    }
                }
                before[side] = Some(ends[1]);
            }
        }
        for mark in &mut marks {
            mark.t = (mark.t * STEPS).round() / STEPS;
        }
        marks.sort_by(|m, n| m.t.total_cmp(&n.t).then(m.at.cmp(&n.at)));
        let point = self.from.at == self.to.at;
        marks.retain(|m| m.t > 0.0 && m.t < 1.0 && (point || (m.at != self.from.at && m.at != self.to.at)));
        marks.dedup_by(|m, n| m.t == n.t || (!point && m.at == n.at));
        self.marks = marks;
    }
}

/// Position within a cell.
pub fn local(cell: [i64; 2], at: [i64; 2]) -> [f64; 2] {
    [0, 1].map(|k| (at[k] - cell[k] * UNIT) as f64 / UNIT as f64)
}

/// The mask from `p` to `q` in a cell.
pub fn along(field: &Field, cell: &Cell, index: [i64; 2], p: Corner, q: Corner) -> Cubic {
    cubic(field, cell, [local(index, p.at), local(index, q.at)], [p.opacity, q.opacity])
}

/// The mask along a line in a cell, with the opacities at its ends.
pub fn cubic(field: &Field, cell: &Cell, [p, q]: [[f64; 2]; 2], [from, to]: [f64; 2]) -> Cubic {
    let d = [q[0] - p[0], q[1] - p[1]];
    let b = cell.at(p);
    let b1 = cell.bx * d[0] + cell.by * d[1] + cell.bxy * (p[0] * d[1] + p[1] * d[0]);
    let b2 = cell.bxy * d[0] * d[1];
    let o = to - from;
    [field.value(b, from), b1 * from + b * o, b2 * from + b1 * o, b2 * o]
}

/// The quotient, to the nearest.
fn divided(n: i128, d: i128) -> i64 {
    let (n, d) = if d < 0 { (-n, -d) } else { (n, d) };
    (2 * n + d).div_euclid(2 * d) as i64
}
