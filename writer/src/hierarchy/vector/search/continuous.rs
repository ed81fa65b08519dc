//! Whether an entry that answers a square's texels is right between their centres, too (spec/vector.md, Proofs).
//!
//! Claim of [`Sight::is_proven`]: at every place p of the closed square whose stored cell is the one given, the stored value
//! lies in the interval of the ray through some point q of the open square, at most 2^-12 texel from p in x and in y, or at
//! most [`SLACK`] steps of depth and the guard beyond its ends.
//!
//! Argument. Stored lines lie off the exact ones by at most [`Border::off`], so p lies in the cell with its half-planes
//! widened by that; q is looked for inside the exact cell. What [`super`] knows of a cell's plane P:
//! - it is right on every ray of a slab, also where it is evaluated at another point within half a texel, and of a tip's
//!   far part;
//! - in a tip's near part the stretch of every ray begins within `bend` of the front f and ends within `bend` of the end e
//!   (under second-surface: the first and the second surface lie there), so that a value v is right at q where
//!   `f(q) + bend <= v < e(q) - bend`, give or take the slack; and what pages store at p lies above `P(p) - 2` and not above
//!   `P(p)`.
//!
//! All of these conditions are linear in (p, q), so the pairs that meet them are a convex set, and so are the places p
//! that have a q: if each corner of the widened cell has one, all of it has.

use umbrage_format::projection::UNCOVERED;

use super::{Cell, Cut, Search, Tip};
use crate::hierarchy::vector::entry::{Entry, EntryId, Palette, Plane, Scale};
use crate::interval::Event;
use crate::interval::proof::{HalfPlane, Polygon, Region};
use crate::interval::triangle::Local;

/// Silhouette edges among which that of a block's split is looked for: not less than were candidates.
const MOST_EDGES: usize = 6;
/// Steps of depth that a value may lie beyond a ray's interval, besides the guard (spec/vector.md, Proofs).
const SLACK: u32 = 8;
/// What exact cells and squares are drawn in by, lattice steps: far above what rounding can move an edge of a tile, far
/// below the distance of p and q.
const INWARD: f64 = -1.0 / 1024.0;

impl Search<'_> {
    /// Whether what [`Search::square`] found is right at every place of the square.
    pub(super) fn is_proven(&mut self, p: [i64; 2], size: i64) -> bool {
        (0..self.cells.len()).all(|n| {
            let Cell { path, tip, .. } = &self.cells[n];
            let (path, tip) = (path.clone(), *tip);
            self.is_seen(p, size, &path, tip)
        })
    }

    /// Whether every place of a cell has a ray of the exact cell near it.
    fn is_seen(&mut self, p: [i64; 2], size: i64, path: &[(usize, bool)], tip: Option<Tip>) -> bool {
        let borders = path.iter().map(|&(c, inside)| {
            let Cut { inside: half, line, .. } = self.cuts[c];
            let off = line.off(&half, self.rays.corner, p, size, self.scale);
            Border { half: if inside { half } else { half.beyond() }, off }
        });
        let borders: Vec<Border> = borders.collect();
        let wedge = tip.map(|tip| {
            let [front, end] = [tip.front, tip.end].map(|i| &self.rays.locals[i as usize]);
            let wedge = Wedge::new(front, end, (&tip.plane, self.rays.corner, self.scale), tip.far, tip.bend);
            Wedge { room: wedge.room - f64::from(SLACK) - f64::from(self.guard), ..wedge }
        });
        Sight::new(self.scale).is_proven(&mut self.polygon, p, size, &borders, wedge)
    }

    /// Whether an entry that was chosen for single texels is right at every place of the square: a constant, a plane,
    /// or two of them along a silhouette edge. The square is the one that [`Self::square`] was asked for last.
    pub fn is_right(&mut self, palette: &Palette, id: EntryId, list: &[u32], p: [i64; 2], size: i64) -> bool {
        self.cuts.clear();
        let Entry::Split { line, near, beyond } = palette.get(id) else {
            return self.is_right_in(palette.get(id), list, p, size, &[]);
        };
        let line = palette.lines[line as usize];
        let cuts = self.candidates(list, Region::square(p, size), &[]);
        let cut = cuts.into_iter().take(MOST_EDGES).map(|c| c.cut).find(|c| c.line == line);
        let Some(cut) = cut else { return false };
        self.cuts.push(cut);
        [(near, !cut.beyond), (beyond, cut.beyond)].into_iter().all(|(id, inside)| {
            let half = if inside { cut.inside } else { cut.inside.beyond() };
            let list: Vec<u32> = list.iter().copied().filter(|i| self.reaches(*i, half)).collect();
            self.is_right_in(palette.get(id), &list, p, size, &[(0, inside)])
        })
    }

    fn is_right_in(&mut self, entry: Entry, list: &[u32], p: [i64; 2], size: i64, path: &[(usize, bool)]) -> bool {
        let lines = self.half_planes(path);
        let region = Region { p, size, lines: &lines, shear: [0.0; 2] };
        let second = self.rays.second_surface;
        match entry {
            Entry::Constant(UNCOVERED) => {
                list.iter().all(|i| self.local(*i).event == Event::Wall) && self.is_seen(p, size, path, None)
            }
            Entry::Constant(v) => {
                let range = self.prover.prove_in(&self.rays, list, &self.covers, region, second, true, None);
                range.is_some_and(|(low, high)| low <= i64::from(v) && i64::from(v) <= high)
                    && self.is_seen(p, size, path, None)
            }
            Entry::Plane(plane) => {
                let sheared = Region { shear: plane.gradient(self.scale), ..region };
                let (whole, _) = plane.at(self.rays.corner, self.scale);
                // what pages round, and the plane's rise from p to q
                let rise = (plane.reach(self.scale) / 2048.0).ceil() as i64;
                let range = self.prover.prove_in(&self.rays, list, &self.covers, sheared, second, true, None);
                if range.is_some_and(|(low, high)| low + rise + 2 <= whole && whole + 1 + rise <= high) {
                    return self.is_seen(p, size, path, None);
                }
                let Some(sample) = self.prover.sample(&region) else { return false };
                let Some(front) = self.front(list, sample) else { return false };
                let Some(end) = self.end(list, sample, front) else { return false };
                let tip = Tip { front, end, plane, edges: 0, excepted: None, mate: end, far: 0.0, bend: 0.0 };
                let Some((bend, mate)) = self.is_tip(list, region, tip) else { return false };
                let tip = Tip { mate, far: self.far(tip, bend), bend, ..tip };
                self.is_seen(p, size, path, Some(tip))
            }
            _ => false,
        }
    }
}

/// A side of a cell.
struct Border {
    /// The cell lies inside.
    half: HalfPlane,
    /// Most that the stored line lies off it in the square, lattice steps.
    off: f64,
}

/// A function `a x + b y + c` of tile-relative lattice points.
type Linear = [f64; 3];

/// A cell whose plane lies between a front and the end behind it.
#[derive(Clone, Copy)]
struct Wedge {
    front: Linear,
    end: Linear,
    plane: Linear,
    far: f64,
    /// What the ends of the stretch may lie off the two, and rounding, less the slack.
    room: f64,
}

impl Wedge {
    /// Of a plane of the map, with the tile's corner; the near part is where the two are at most `far` apart.
    fn new(f: &Local, e: &Local, plane: (&Plane, [i64; 2], Scale), far: f64, bend: f64) -> Self {
        let (plane, corner, scale) = plane;
        let (whole, part) = plane.at(corner, scale);
        let [gx, gy] = plane.gradient(scale);
        // coordinates of a tile stay below 2^27
        let room = bend + 4.0 * (f.eps + e.eps) + (gx.abs() + gy.abs()) * 1e-7 + 0.01;
        let linear = |l: &Local| [l.sx, l.sy, l.z0];
        Wedge { front: linear(f), end: linear(e), plane: [gx, gy, whole as f64 + part], far, room }
    }

    /// `far` less the distance of end and front, or its opposite: not negative in the near part, or in the far one.
    fn part(&self, near: bool) -> Linear {
        let way = if near { 1.0 } else { -1.0 };
        let [a, b, c] = [0, 1, 2].map(|i| (self.front[i] - self.end[i]) * way);
        [a, b, c + self.far * way]
    }
}

/// How far q may lie from p.
struct Sight {
    /// Lattice steps.
    reach: f64,
}

impl Sight {
    /// A little less than 2^-12 texel, for rounding.
    fn new(scale: Scale) -> Self {
        Sight { reach: 2f64.powi(i32::from(scale.subtexel_bits) - 12) * (63.0 / 64.0) }
    }

    /// See the module. The square is tile-relative; `wedge` is that of a tip, nothing for a slab.
    fn is_proven(
        &self,
        polygon: &mut Polygon,
        p: [i64; 2],
        size: i64,
        borders: &[Border],
        wedge: Option<Wedge>,
    ) -> bool {
        let parts: &[Option<bool>] = if wedge.is_some() { &[Some(true), Some(false)] } else { &[None] };
        // a slab without borders is right at p itself
        (borders.is_empty() && wedge.is_none())
            || parts.iter().all(|part| {
                let part = wedge.zip(*part).map(|(w, near)| (w.part(near), near));
                let within = |polygon: &mut Polygon| {
                    if let Some(([a, b, c], _)) = part {
                        polygon.keep_plane(a, b, c);
                    }
                };
                polygon.square(p, size);
                borders.iter().for_each(|b| polygon.keep(&b.half, b.off));
                within(polygon);
                let places = polygon.corners().to_vec();
                polygon.square(p, size);
                let far = size as f64 + INWARD;
                for (axis, start) in [(0, p[0] as f64), (1, p[1] as f64)] {
                    keep_from(polygon, axis, start - INWARD);
                    keep_to(polygon, axis, start + far);
                }
                borders.iter().for_each(|b| polygon.keep(&b.half, INWARD));
                within(polygon);
                let cell = polygon.clone();
                let near = wedge.filter(|_| part.is_some_and(|p| p.1));
                places.iter().all(|place| self.sees(&cell, polygon, *place, near))
            })
    }

    /// Whether a place has its q in the cell.
    fn sees(&self, cell: &Polygon, polygon: &mut Polygon, place: [f64; 2], near: Option<Wedge>) -> bool {
        let [x, y] = place;
        let mut near_place = [
            [1.0, 0.0, self.reach - x],
            [-1.0, 0.0, x + self.reach],
            [0.0, 1.0, self.reach - y],
            [0.0, -1.0, y + self.reach],
            [0.0; 3],
            [0.0; 3],
        ];
        if let Some(w) = near {
            let value = w.plane[0] * place[0] + w.plane[1] * place[1] + w.plane[2];
            let [a, b, c] = w.front;
            near_place[4] = [-a, -b, value - 2.0 - w.room - c];
            let [a, b, c] = w.end;
            near_place[5] = [a, b, c - value - w.room];
        }
        // mostly a corner of the cell will do
        let holds = |q: &[f64; 2]| near_place.iter().all(|[a, b, c]| a * q[0] + b * q[1] + c >= 0.0);
        cell.corners().iter().any(holds) || {
            polygon.copy(cell);
            near_place.iter().for_each(|[a, b, c]| polygon.keep_plane(*a, *b, *c));
            !polygon.corners().is_empty()
        }
    }
}

fn keep_from(polygon: &mut Polygon, axis: usize, at: f64) {
    let [a, b] = if axis == 0 { [1.0, 0.0] } else { [0.0, 1.0] };
    polygon.keep_plane(a, b, -at);
}

fn keep_to(polygon: &mut Polygon, axis: usize, at: f64) {
    let [a, b] = if axis == 0 { [-1.0, 0.0] } else { [0.0, -1.0] };
    polygon.keep_plane(a, b, at);
}
