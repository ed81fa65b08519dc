//! The outline of the solid part of a triangle, cell by cell.
//!
//! A triangle is cut into columns and these into its pieces within single cells. On the border of a piece the places
//! where the mask changes are found exactly; they depend on the border alone, so that neighbouring pieces agree. Inside,
//! two of them are joined by a chord if the mask, along the chord's normal, is proven to rise all over the piece fast
//! enough that its contour is within [`CHORD`] of the chord; otherwise the piece is split.

use super::DEVIATION;
use super::bounds::{Halt, Work};
use super::edge::{Corner, Edge, along, cubic, local};
use super::root::roots;
use super::sample::{Cell, Class, Field, UNIT};

/// The farthest that a chord may be from the contour, in pixels.
pub const CHORD: f64 = DEVIATION / 8.0;

/// The most chords of one triangle.
pub const MOST_CHORDS: usize = 1 << 22;

/// A directed line in the image; to its left is solid.
pub type Chord = [[i64; 2]; 2];

/// A triangle, counter-clockwise in the image, under a mask.
pub struct Shape<'a> {
    pub field: &'a Field<'a>,
    pub corners: [Corner; 3],
    /// From each corner to the next.
    pub edges: [Edge; 3],
    /// How the opacity changes by a pixel along x and y.
    slope: [f64; 2],
}

/// What a side of a piece lies on.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Carrier {
    /// An edge of the triangle.
    Edge(usize),
    /// A border of cells: across this axis, at this coordinate.
    Line(usize, i64),
}

/// Corners, counter-clockwise, each with what the side to the next lies on.
type Polygon = Vec<(Corner, Carrier)>;

#[derive(Clone, Copy, Debug)]
struct Node {
    /// Within the cell.
    p: [f64; 2],
    /// The mask changes here.
    root: bool,
}

/// A cell and the opacity in it.
struct Patch<'a> {
    field: &'a Field<'a>,
    index: [i64; 2],
    cell: Cell,
    opacity: f64,
    slope: [f64; 2],
}

impl<'a> Shape<'a> {
    pub fn new(field: &'a Field, corners: [Corner; 3]) -> Self {
        let edges = [0, 1, 2].map(|k| Edge::new(field, corners[k], corners[(k + 1) % 3]));
        let [a, b, c] = corners;
        let side = |p: Corner| ([0, 1].map(|k| (p.at[k] - a.at[k]) as f64 / UNIT as f64), p.opacity - a.opacity);
        let ((u, du), (v, dv)) = (side(b), side(c));
        let area = u[0] * v[1] - u[1] * v[0];
        let slope = if du == 0.0 && dv == 0.0 {
            [0.0; 2]
        } else {
            [(du * v[1] - dv * u[1]) / area, (dv * u[0] - du * v[0]) / area]
        };
        Shape { field, corners, edges, slope }
    }

    fn opacity(&self, at: [i64; 2]) -> f64 {
        let from = &self.corners[0];
        let d = [0, 1].map(|k| (at[k] - from.at[k]) as f64 / UNIT as f64);
        from.opacity + (self.slope[0] * d[0] + self.slope[1] * d[1])
    }

    /// All chords.
    ///
    /// # Errors
    /// More than [`MOST_CHORDS`], memory, or stopped.
    pub fn outline(&self, work: &mut Work) -> Result<Vec<Chord>, Halt> {
        let mut chords = Vec::new();
        let whole: Polygon = [0, 1, 2].map(|k| (self.corners[k], Carrier::Edge(k))).to_vec();
        for i in span(&whole, 0) {
            let column = self.within(&whole, 0, i);
            if column.len() < 3 {
                continue;
            }
            for j in span(&column, 1) {
                self.piece([i, j], &column, &mut chords);
                if chords.len() > MOST_CHORDS {
                    return Err(Halt::Lines(MOST_CHORDS));
                }
                work.step()?;
            }
            work.found(chords.len())?;
        }
        Ok(chords)
    }

    fn piece(&self, index: [i64; 2], column: &Polygon, chords: &mut Vec<Chord>) {
        let class = self.field.class(index);
        let [i, j] = index;
        let plain = if self.field.linear() {
            class != Class::Mixed
        } else {
            let around = [[i - 1, j], [i + 1, j], [i, j - 1], [i, j + 1]];
            class == Class::Hole || class == Class::Solid && around.iter().all(|n| self.field.class(*n) == Class::Solid)
        };
        if plain {
            return;
        }
        let polygon = self.square(index).unwrap_or_else(|| self.within(column, 1, j));
        if polygon.len() < 3 {
            return;
        }
        let cell = self.field.cell(index);
        if class == Class::Mixed {
            let opacity = self.opacity(index.map(|k| k * UNIT));
            let patch = Patch { field: self.field, index, cell, opacity, slope: self.slope };
            let (nodes, solid) = self.nodes(&patch, &polygon);
            patch.trace(nodes, solid, chords);
        }
        if !self.field.linear() {
            self.borders(index, &cell, &polygon, chords);
        }
    }

    /// The whole cell if it is within the triangle.
    fn square(&self, index: [i64; 2]) -> Option<Polygon> {
        let [[x, y], [right, up]] = [index.map(|k| k * UNIT), index.map(|k| (k + 1) * UNIT)];
        let corners = [[x, y], [right, y], [right, up], [x, up]];
        let lines = [Carrier::Line(1, y), Carrier::Line(0, right), Carrier::Line(1, up), Carrier::Line(0, x)];
        let inside = (0..3).all(|k| {
            let (a, b) = (self.corners[k].at, self.corners[(k + 1) % 3].at);
            corners.iter().all(|p| cross(a, b, *p) > 0)
        });
        inside.then(|| {
            let all = corners.into_iter().zip(lines);
            all.map(|(at, line)| (Corner { at, opacity: self.opacity(at) }, line)).collect()
        })
    }

    /// The part of a polygon within a column or row of cells.
    fn within(&self, polygon: &Polygon, axis: usize, k: i64) -> Polygon {
        let above = self.clipped(polygon, axis, k * UNIT, 1);
        self.clipped(&above, axis, (k + 1) * UNIT, -1)
    }

    /// The part of a polygon on one side of a line (Sutherland and Hodgman, 1974).
    fn clipped(&self, polygon: &Polygon, axis: usize, line: i64, side: i64) -> Polygon {
        let height = |c: &Corner| (c.at[axis] - line) * side;
        let mut part = Polygon::with_capacity(polygon.len() + 2);
        for (k, (corner, carrier)) in polygon.iter().enumerate() {
            let next = &polygon[(k + 1) % polygon.len()].0;
            let (here, there) = (height(corner), height(next));
            if here >= 0 {
                let leaves = here == 0 && there < 0;
                part.push((*corner, if leaves { Carrier::Line(axis, line) } else { *carrier }));
            }
            if here.signum() * there.signum() < 0 {
                let met = match carrier {
                    Carrier::Edge(k) => self.edges[*k].cross(axis, line).1,
                    Carrier::Line(_, other) => {
                        let mut at = [*other; 2];
                        at[axis] = line;
                        Corner { at, opacity: self.opacity(at) }
                    }
                };
                part.push((met, if here > 0 { Carrier::Line(axis, line) } else { *carrier }));
            }
        }
        part
    }

    /// The border of a piece; whether its last side is solid at its end.
    fn nodes(&self, patch: &Patch, polygon: &Polygon) -> (Vec<Node>, bool) {
        let mut nodes = Vec::new();
        let node = |at, root| Node { p: local(patch.index, at), root };
        for (k, (corner, carrier)) in polygon.iter().enumerate() {
            let next = polygon[(k + 1) % polygon.len()].0;
            nodes.push(node(corner.at, false));
            let roots = match carrier {
                _ if corner.at == next.at => Vec::new(),
                Carrier::Edge(k) => self.edges[*k].roots(patch.index),
                Carrier::Line(..) => places(self.field, &patch.cell, patch.index, *corner, next),
            };
            nodes.extend(roots.into_iter().map(|at| node(at, true)));
        }
        let first = polygon[0].0;
        (nodes, self.field.value(patch.cell.at(local(patch.index, first.at)), first.opacity) >= 0.0)
    }

    /// Where a solid pixel meets a hole; for nearest sampling.
    fn borders(&self, index: [i64; 2], cell: &Cell, polygon: &Polygon, chords: &mut Vec<Chord>) {
        for (k, (corner, carrier)) in polygon.iter().enumerate() {
            let next = polygon[(k + 1) % polygon.len()].0;
            let Carrier::Line(axis, line) = *carrier else { continue };
            if corner.at == next.at {
                continue;
            }
            let mut beyond = index;
            beyond[axis] += if line == index[axis] * UNIT { -1 } else { 1 };
            let other = self.field.cell(beyond);
            let solid = |c: &Cell, opacity| self.field.value(c.b, opacity) >= 0.0;
            let states = |o| (solid(cell, o), solid(&other, o));
            let mut state = states(corner.opacity);
            let mut flips: Vec<([i64; 2], bool)> =
                places(self.field, cell, index, *corner, next).into_iter().map(|at| (at, true)).collect();
            flips.extend(places(self.field, &other, beyond, *corner, next).into_iter().map(|at| (at, false)));
            let along = 1 - axis;
            flips.sort_by_key(|f| (f.0[along] - corner.at[along]).abs());
            let mut from = corner.at;
            for (at, own) in flips.into_iter().chain([(next.at, true)]) {
                if state == (true, false) && from != at {
                    chords.push([from, at]);
                }
                state = if own { (!state.0, state.1) } else { (state.0, !state.1) };
                from = at;
            }
        }
    }
}

/// Where the mask changes from `p` to `q` on a border of cells, whichever cell asks and in whichever direction.
fn places(field: &Field, cell: &Cell, index: [i64; 2], p: Corner, q: Corner) -> Vec<[i64; 2]> {
    let (a, b) = if q.at < p.at { (q, p) } else { (p, q) };
    let c = along(field, cell, index, a, b);
    let end = field.value(cell.at(local(index, b.at)), b.opacity);
    let place = |s: f64| [0, 1].map(|k| a.at[k] + ((b.at[k] - a.at[k]) as f64 * s).round() as i64);
    let mut places: Vec<[i64; 2]> = roots(&c, [c[0] >= 0.0, end >= 0.0]).map(place).collect();
    if a.at != p.at {
        places.reverse();
    }
    places
}

/// The cells that a polygon reaches over along an axis.
fn span(polygon: &Polygon, axis: usize) -> std::ops::Range<i64> {
    let low = polygon.iter().map(|c| c.0.at[axis]).min().unwrap_or(0);
    let high = polygon.iter().map(|c| c.0.at[axis]).max().unwrap_or(0);
    low.div_euclid(UNIT)..(high + UNIT - 1).div_euclid(UNIT)
}

/// Twice the area of a triangle, counter-clockwise.
pub fn cross(a: [i64; 2], b: [i64; 2], c: [i64; 2]) -> i128 {
    let d = |p: [i64; 2], k: usize| i128::from(p[k] - a[k]);
    d(b, 0) * d(c, 1) - d(b, 1) * d(c, 0)
}

type Range = [f64; 2];

fn times(a: Range, b: Range) -> Range {
    let all = [a[0] * b[0], a[0] * b[1], a[1] * b[0], a[1] * b[1]];
    hull(all)
}

fn plus(a: Range, b: Range) -> Range {
    [a[0] + b[0], a[1] + b[1]]
}

fn hull(all: impl IntoIterator<Item = f64>) -> Range {
    all.into_iter().fold([f64::INFINITY, f64::NEG_INFINITY], |r, v| [r[0].min(v), r[1].max(v)])
}

impl Patch<'_> {
    fn opacity(&self, p: [f64; 2]) -> f64 {
        self.opacity + (self.slope[0] * p[0] + self.slope[1] * p[1])
    }

    /// Ranges of the mask's value and of its derivatives along x and y within a box.
    fn ranges(&self, [low, high]: [[f64; 2]; 2]) -> [Range; 3] {
        let corners = [low, [high[0], low[1]], [low[0], high[1]], high];
        let b = hull(corners.map(|p| self.cell.at(p)));
        let o = hull(corners.map(|p| self.opacity(p)));
        let c = &self.cell;
        let dx = hull([c.bx + c.bxy * low[1], c.bx + c.bxy * high[1]]);
        let dy = hull([c.by + c.bxy * low[0], c.by + c.bxy * high[0]]);
        let slope = |k: usize| [self.slope[k]; 2];
        let value = times(b, o).map(|v| v - self.field.level());
        [value, plus(times(dx, o), times(b, slope(0))), plus(times(dy, o), times(b, slope(1)))]
    }

    /// Whether the contour is within [`CHORD`] of the chord from `a` to `b`, all over the box.
    fn close(&self, a: [f64; 2], b: [f64; 2], around: [[f64; 2]; 2]) -> bool {
        let d = [b[0] - a[0], b[1] - a[1]];
        let length = (d[0] * d[0] + d[1] * d[1]).sqrt();
        if length == 0.0 {
            return false;
        }
        // towards solid
        let n = [-d[1] / length, d[0] / length];
        let [_, dx, dy] = self.ranges(around);
        let rise = plus(times(dx, [n[0]; 2]), times(dy, [n[1]; 2]))[0];
        let c = cubic(self.field, &self.cell, [a, b], [self.opacity(a), self.opacity(b)]);
        // Taylor: a function that is 0 at both ends of 0..=1 stays within an eighth of its largest second derivative.
        let bend = (2.0 * c[2]).abs().max((2.0 * c[2] + 6.0 * c[3]).abs()) / 8.0;
        let ends = c[0].abs().max((c[0] + c[1] + c[2] + c[3]).abs());
        rise > 0.0 && bend + ends <= CHORD * rise
    }

    /// Chords of a convex piece, given its border and whether that is solid just before the first node.
    fn trace(&self, nodes: Vec<Node>, solid: bool, chords: &mut Vec<Chord>) {
        let mut work = vec![(nodes, solid)];
        while let Some((nodes, solid)) = work.pop() {
            let [[left, right], [bottom, top]] = [0, 1].map(|k| hull(nodes.iter().map(|n| n.p[k])));
            let (low, high) = ([left, bottom], [right, top]);
            let size = [high[0] - low[0], high[1] - low[1]];
            let tiny = size[0] * size[0] + size[1] * size[1] <= CHORD * CHORD;
            let pairs = pairs(&nodes, solid);
            let done = match pairs.as_slice() {
                [] => tiny || self.settled([low, high]),
                [[a, b]] => tiny || self.close(*a, *b, [low, high]),
                _ => tiny,
            };
            let halves = if done { None } else { self.split(&nodes, solid, low, size) };
            match halves {
                Some(halves) => work.extend(halves),
                None => {
                    let place =
                        |p: [f64; 2]| [0, 1].map(|k| self.index[k] * UNIT + (p[k] * UNIT as f64).round() as i64);
                    chords.extend(pairs.into_iter().map(|p| p.map(place)).filter(|c| c[0] != c[1]));
                }
            }
        }
    }

    /// Whether a box on whose border nothing changes holds no contour that closes within.
    fn settled(&self, around: [[f64; 2]; 2]) -> bool {
        // A bilinear function has no extreme but saddles.
        self.slope == [0.0; 2] || self.ranges(around).iter().any(|r| r[0] > 0.0 || r[1] < 0.0)
    }

    /// Two halves along the longer side.
    fn split(&self, nodes: &[Node], solid: bool, low: [f64; 2], size: [f64; 2]) -> Option<[(Vec<Node>, bool); 2]> {
        let axis = usize::from(size[1] > size[0]);
        // Away from all nodes, so that rounding can't say which side they are on.
        let line = [8, 7, 9, 6, 10, 5, 11, 4, 12].into_iter().find_map(|sixteenths| {
            let line = low[axis] + size[axis] * f64::from(sixteenths) / 16.0;
            nodes.iter().all(|n| (n.p[axis] - line).abs() > 1e-6).then_some(line)
        })?;
        let mut parts: [(Vec<Node>, bool); 2] = [(Vec::new(), solid), (Vec::new(), solid)];
        let first = usize::from(nodes[0].p[axis] > line);
        let mut state = solid;
        let mut met: Vec<([f64; 2], bool)> = Vec::new();
        let mut gap = 0;
        for (k, node) in nodes.iter().enumerate() {
            let next = &nodes[(k + 1) % nodes.len()];
            let side = usize::from(node.p[axis] > line);
            parts[side].0.push(*node);
            state ^= node.root;
            if usize::from(next.p[axis] > line) == side {
                continue;
            }
            let s = (line - node.p[axis]) / (next.p[axis] - node.p[axis]);
            let mut p = [0, 1].map(|d| node.p[d] + (next.p[d] - node.p[d]) * s);
            p[axis] = line;
            let vertex = Node { p, root: false };
            parts[side].0.push(vertex);
            if met.is_empty() {
                gap = parts[first].0.len();
                parts[1 - first].1 = state;
            }
            parts[1 - side].0.push(vertex);
            met.push((p, state));
        }
        let [(p, from), (q, to)] = met.try_into().ok()?;
        let c = cubic(self.field, &self.cell, [p, q], [self.opacity(p), self.opacity(q)]);
        let step = |v: f64| (v * UNIT as f64).round() / UNIT as f64;
        let mut between: Vec<Node> = roots(&c, [from, to])
            .map(|s| Node { p: [0, 1].map(|d| step(p[d] + (q[d] - p[d]) * s)), root: true })
            .collect();
        parts[1 - first].0.extend(between.iter().rev());
        parts[first].0.splice(gap..gap, between.drain(..));
        Some(parts)
    }
}

/// Chords that cut off what isn't solid of a border.
fn pairs(nodes: &[Node], solid: bool) -> Vec<[[f64; 2]; 2]> {
    let roots: Vec<[f64; 2]> = nodes.iter().filter(|n| n.root).map(|n| n.p).collect();
    let first = usize::from(!solid);
    let pairs = (0..roots.len() / 2).map(|k| {
        let at = |i: usize| roots[(first + 2 * k + i) % roots.len()];
        [at(0), at(1)]
    });
    pairs.collect()
}
