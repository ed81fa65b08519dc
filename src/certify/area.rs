//! The area interval of a texel: supremum of lo and infimum of hi over its open square, exactly.
//!
//! The square is cut into convex pieces, along edges of triangles and along lines where two planes cross, until in
//! each piece the order of events is the same everywhere, as far as its stretch reaches. Only lines that matter there
//! are used, so a texel costs what is visible in it. In a finished piece lo and hi are linear and their extremes lie at
//! corners.

use super::facet::Facet;
use super::plot::{Piece, Plot, ROUNDING, Triple, sign};
use super::ray::{DEEPEST, Windings};
use super::{Depth, Interval};
use num_bigint::BigInt;
use num_integer::Integer;
use num_traits::ToPrimitive;
use std::cmp::Ordering;
use umbrage_format::projection::UNCOVERED;

/// So many surfaces that end somewhere over a piece are too many to cut along them at once.
const CROWD: usize = 24;

/// A surface that makes an event, its plane counted from the texel's lowest corner.
struct Surface {
    facet: usize,
    solid: u32,
    step: i32,
    /// Distance behind the facet.
    raise: u32,
    /// Surfaces of one class lie in one plane.
    class: usize,
    plane: [i128; 3],
    area: i128,
    float: [f64; 3],
}

/// A surface that may cover a piece, and which of its three edges may still cross it.
#[derive(Clone, Copy)]
struct Live {
    surface: u32,
    open: u8,
}

/// How two surfaces lie over a piece.
#[derive(PartialEq)]
enum Lie {
    Before,
    Same,
    Behind,
    Crossing,
}

/// What to do with a piece.
enum Step {
    /// Cut it along a line first.
    Cut(u32),
    Uncovered,
    /// The surfaces of lo and hi; no hi means that the stretch never ends.
    Stretch(usize, Option<usize>),
}

struct Texel<'a> {
    facets: &'a [Facet],
    second_surface: bool,
    plot: Plot,
    /// Bounds of the facets: lowest and highest corner.
    bounds: Vec<[[f64; 2]; 2]>,
    surfaces: Vec<Surface>,
    /// The line of each pair of surfaces that was needed.
    crossings: Vec<([usize; 2], u32)>,
    /// Depths at the corners of the piece at hand, one row per live surface: value and error bound.
    depths: Vec<(f64, f64)>,
    covered: bool,
    uncovered: bool,
    min: i128,
    max: i128,
}

/// The area interval of the square of `side` steps at `o`, or `None` where there is no such interval.
///
/// `facets` are those that share area with the square.
pub(super) fn area_interval(facets: &[Facet], o: [i64; 2], side: i64, second_surface: bool) -> Option<Interval> {
    let (mut texel, square) = Texel::new(facets, side, second_surface);
    texel.set_up(o);
    texel.walk(square, |texel, piece, step| texel.take(piece, step))?;
    Some(if texel.covered {
        Interval { min: texel.min as u32, max: texel.max as u32 }
    } else {
        Interval { min: UNCOVERED, max: UNCOVERED }
    })
}

/// Whether some ray of the open square of `side` steps at `o` has `lo <= value + slack` and `value - slack < hi`, over a
/// part of the square that has an area; of one that meets nothing whether the value is that of such rays.
pub(super) fn right_somewhere(
    facets: &[Facet],
    o: [i64; 2],
    side: i64,
    second_surface: bool,
    value: u32,
    slack: u32,
) -> bool {
    let (mut texel, square) = Texel::new(facets, side, second_surface);
    texel.set_up(o);
    let right = |texel: &mut Texel, piece: &Piece, step: Step| match step {
        Step::Stretch(lo, hi) => texel.allows(piece, lo, hi, value, slack),
        _ => value == UNCOVERED,
    };
    texel.walk(square, |texel, piece, step| if right(texel, piece, step) { None } else { Some(()) }).is_none()
}

impl<'a> Texel<'a> {
    /// Without its surfaces; and its square.
    fn new(facets: &'a [Facet], side: i64, second_surface: bool) -> (Self, Piece) {
        let (plot, square) = Plot::new(side);
        let texel = Texel {
            facets,
            second_surface,
            plot,
            bounds: Vec::new(),
            surfaces: Vec::new(),
            crossings: Vec::new(),
            depths: Vec::new(),
            covered: false,
            uncovered: false,
            min: 0,
            max: DEEPEST.into(),
        };
        (texel, square)
    }

    fn set_up(&mut self, o: [i64; 2]) {
        for (i, f) in self.facets.iter().enumerate() {
            let p = f.corners;
            for k in 0..3 {
                self.plot.line(Triple::Small(f.edge(k, o)));
            }
            for e in f.role.events(self.second_surface) {
                let mut plane = f.plane(o);
                plane[2] += i128::from(e.offset) * f.area;
                let float = plane.map(|v| v as f64 / f.area as f64);
                let class = self.surfaces.len();
                let raise = e.offset;
                let s = Surface { facet: i, solid: f.solid, step: e.step, raise, class, plane, area: f.area, float };
                self.surfaces.push(s);
            }
            let fold = |axis: usize, f: fn(i64, i64) -> i64| f(f(p[0][axis], p[1][axis]), p[2][axis]);
            self.bounds.push([i64::min, i64::max].map(|f| [0, 1].map(|k| (fold(k, f) - o[k]) as f64)));
        }

        // Planes that are the same have nearly the same float, so they are neighbours in this order.
        let mut order: Vec<usize> = (0..self.surfaces.len()).collect();
        order.sort_by(|&i, &j| self.surfaces[i].float[2].total_cmp(&self.surfaces[j].float[2]));
        for (n, &i) in order.iter().enumerate() {
            let s = &self.surfaces[i];
            let raise = s.raise;
            let points = self.facets[s.facet].corners.map(|p| [p[0] - o[0], p[1] - o[1], p[2] + i64::from(raise)]);
            let before = order[..n].iter().rev().map(|&j| &self.surfaces[j]);
            let mut close = before.take_while(|t| near(t.float[2], s.float[2]));
            if let Some(class) = close.find(|t| t.holds(s, points)).map(|t| t.class) {
                self.surfaces[i].class = class;
            }
        }
    }

    /// Works through all pieces that are finished; `None` as soon as `each` says so.
    fn walk(&mut self, square: Piece, mut each: impl FnMut(&mut Self, &Piece, Step) -> Option<()>) -> Option<()> {
        let live: Vec<Live> = (0..self.surfaces.len() as u32).map(|surface| Live { surface, open: 7 }).collect();
        // Halves never outnumber the surfaces by much, however they lie: edges that coincide cannot be told apart so.
        let halvings = (live.len() / CROWD + 1).ilog2() + 2;
        let mut todo = vec![(square, live, halvings)];
        while let Some((piece, mut live, mut halvings)) = todo.pop() {
            self.settle(&piece, &mut live);
            let half = if halvings > 0 { self.halve(&piece, &live) } else { None };
            halvings -= u32::from(half.is_some());
            let step = half.map_or_else(|| self.judge(&piece, &live), Step::Cut);
            match step {
                Step::Cut(line) => {
                    let [behind, before] = self.plot.cut(&piece, line);
                    todo.push((behind, live.clone(), halvings));
                    todo.push((before, live, halvings));
                }
                step => each(self, &piece, step)?,
            }
        }
        Some(())
    }

    /// Takes in a finished piece; `None` as soon as it is certain that no area interval exists.
    fn take(&mut self, piece: &Piece, step: Step) -> Option<()> {
        match step {
            Step::Stretch(lo, hi) => {
                self.covered = true;
                for &(c, _) in piece {
                    self.min = self.ceil(lo, c, |a| a > self.min).unwrap_or(self.min);
                    if let Some(hi) = hi {
                        // max = ceil - 1
                        self.max = self.ceil(hi, c, |a| a <= self.max).map_or(self.max, |a| a - 1);
                    }
                }
            }
            _ => self.uncovered = true,
        }
        if (self.covered && self.uncovered) || self.min > self.max { None } else { Some(()) }
    }

    /// Whether `lo <= value + slack` and `value - slack < hi` somewhere in a finished piece.
    fn allows(&mut self, piece: &Piece, lo: usize, hi: Option<usize>, value: u32, slack: u32) -> bool {
        let (value, slack) = (i128::from(value), i128::from(slack));
        let level = |s: &Surface, sign: i128| {
            let value = value - sign * slack;
            let [a, b, c] = s.plane;
            Triple::Small([a * sign, b * sign, (c - value * s.area) * sign])
        };
        let front = self.plot.line(level(&self.surfaces[lo], -1));
        let behind = match self.plot.sides(piece, front) {
            (true, true) => self.plot.cut(piece, front).into_iter().nth(1).unwrap_or_default(),
            (true, false) => return false,
            _ => piece.clone(),
        };
        let Some(hi) = hi else { return value <= DEEPEST.into() };
        let end = self.plot.line(level(&self.surfaces[hi], 1));
        value <= DEEPEST.into() && self.plot.sides(&behind, end).1
    }

    /// Drops surfaces that do not cover the piece, and notes edges that do not cross it.
    fn settle(&self, piece: &Piece, live: &mut Vec<Live>) {
        let [low, high] = self.plot.bounds(piece);
        live.retain_mut(|l| {
            let facet = self.surfaces[l.surface as usize].facet;
            if l.open != 0 {
                let [least, most] = self.bounds[facet];
                if (0..2).any(|k| most[k] < low[k] || least[k] > high[k]) {
                    return false;
                }
            }
            for k in 0..3 {
                if l.open & (1 << k) != 0 {
                    let (behind, before) = self.plot.sides(piece, edge_line(facet, k));
                    if !before {
                        return false;
                    }
                    if !behind {
                        l.open &= !(1 << k);
                    }
                }
            }
            true
        });
    }

    /// A line across the middle of a piece over which so many edges run that halves are cheaper than one edge at a time.
    fn halve(&mut self, piece: &Piece, live: &[Live]) -> Option<u32> {
        if live.iter().filter(|l| l.open != 0).count() <= CROWD {
            return None;
        }
        let [low, high] = self.plot.bounds(piece);
        let axis = usize::from(high[1] - low[1] > high[0] - low[0]);
        let middle = ((low[axis] + high[axis]) / 2.0).floor();
        if high[axis] - low[axis] < 8.0 {
            return None;
        }
        let mut line = [0, 0, -(middle as i128)];
        line[axis] = 1;
        Some(self.plot.line(Triple::Small(line)))
    }

    /// The first edge of the surface that crosses the piece.
    fn open_edge(&self, l: Live) -> Option<u32> {
        (l.open != 0).then(|| edge_line(self.surfaces[l.surface as usize].facet, l.open.trailing_zeros() as usize))
    }

    /// Follows the events through the piece until the stretch ends or a line turns up that must cut the piece first.
    fn judge(&mut self, piece: &Piece, live: &[Live]) -> Step {
        let n = piece.len();
        self.depths.clear();
        for l in live {
            let [a, b, c] = self.surfaces[l.surface as usize].float;
            self.depths.extend(piece.iter().map(|&(corner, _)| {
                let corner = &self.plot.corners[corner as usize];
                let (p, q) = (a * corner.at[0], b * corner.at[1]);
                let err = ROUNDING * (p.abs() + q.abs() + c.abs()) + corner.err * (a.abs() + b.abs());
                (p + q + c, err)
            }));
        }
        let mean = |i: usize| self.depths[i * n..][..n].iter().map(|d| d.0).sum::<f64>();
        let mut rest: Vec<usize> = (0..live.len()).collect();
        rest.sort_by(|&i, &j| mean(i).total_cmp(&mean(j)));

        let mut windings = Windings::default();
        let mut lo = None;
        while !rest.is_empty() {
            let mut first = rest[0];
            let mut scan = 0;
            while scan < rest.len() {
                let other = rest[scan];
                scan += 1;
                match self.lie(piece, live, other, first) {
                    Lie::Same | Lie::Behind => {}
                    // Rounding misled the means: the other is the first so far.
                    Lie::Before => (first, scan) = (other, 0),
                    Lie::Crossing => {
                        let edge = self.open_edge(live[other]).or_else(|| self.open_edge(live[first]));
                        let pair = [live[first].surface as usize, live[other].surface as usize];
                        return Step::Cut(edge.unwrap_or_else(|| self.crossing(pair)));
                    }
                }
            }
            let head = live[first].surface as usize;
            let class = self.surfaces[head].class;
            let group = rest.extract_if(.., |i| self.surfaces[live[*i].surface as usize].class == class);
            let group: Vec<Live> = group.map(|i| live[i]).collect();
            if let Some(edge) = group.iter().find_map(|l| self.open_edge(*l)) {
                return Step::Cut(edge);
            }
            let lo = *lo.get_or_insert(head);
            if self.second_surface {
                if lo != head || group.len() > 1 {
                    return Step::Stretch(lo, Some(head));
                }
                continue;
            }
            for l in &group {
                let s = &self.surfaces[l.surface as usize];
                windings.add(s.solid, s.step);
            }
            if !windings.inside() {
                return Step::Stretch(lo, Some(head));
            }
        }
        lo.map_or(Step::Uncovered, |lo| Step::Stretch(lo, None))
    }

    /// How live surface `i` lies to live surface `j`, along the light.
    fn lie(&self, piece: &Piece, live: &[Live], i: usize, j: usize) -> Lie {
        let n = piece.len();
        let pair = [i, j].map(|i| &self.surfaces[live[i].surface as usize]);
        if pair[0].class == pair[1].class {
            return Lie::Same;
        }
        let (mut before, mut behind) = (false, false);
        for (k, &(corner, _)) in piece.iter().enumerate() {
            let [(z, e), (y, d)] = [i, j].map(|i| self.depths[i * n + k]);
            let order = if (z - y).abs() > (e + d) * (1.0 + ROUNDING) {
                z.total_cmp(&y)
            } else {
                self.compare(pair[0], pair[1], corner)
            };
            before |= order.is_lt();
            behind |= order.is_gt();
            if before && behind {
                return Lie::Crossing;
            }
        }
        if before { Lie::Before } else { Lie::Behind }
    }

    fn compare(&self, s: &Surface, t: &Surface, corner: u32) -> Ordering {
        let at = self.plot.exact(corner);
        if let (Some(p), Some(q)) = (at.small_dot(&s.plane), at.small_dot(&t.plane)) {
            return Depth::new(p, s.area).cmp(&Depth::new(q, t.area));
        }
        let [p, q] = [s, t].map(|s| at.dot(&s.plane.map(BigInt::from)));
        sign(&(p * t.area - q * s.area))
    }

    /// The line on which two surfaces' planes cross.
    fn crossing(&mut self, pair: [usize; 2]) -> u32 {
        if let Some((_, line)) = self.crossings.iter().find(|(p, _)| *p == pair) {
            return *line;
        }
        let [s, t] = pair.map(|i| &self.surfaces[i]);
        let line = [0, 1, 2].map(|k| BigInt::from(s.plane[k]) * t.area - BigInt::from(t.plane[k]) * s.area);
        let line = self.plot.line(Triple::from_big(line));
        self.crossings.push((pair, line));
        line
    }

    /// The depth of a surface at a corner, rounded up; `None` if it does not pass the test, which holds from some
    /// value on upwards or downwards.
    fn ceil(&self, surface: usize, corner: u32, wanted: impl Fn(i128) -> bool) -> Option<i128> {
        let s = &self.surfaces[surface];
        let c = &self.plot.corners[corner as usize];
        let [a, b, k] = s.float;
        let (p, q) = (a * c.at[0], b * c.at[1]);
        let err = ROUNDING * (p.abs() + q.abs() + k.abs()) + c.err * (a.abs() + b.abs());
        let [low, high] = [p + q + k - err, p + q + k + err].map(|z| z.ceil() as i128);
        if !wanted(low) && !wanted(high) {
            return None;
        }
        let exact = if low == high { low } else { self.exact_ceil(s, corner) };
        wanted(exact).then_some(exact)
    }

    fn exact_ceil(&self, s: &Surface, corner: u32) -> i128 {
        let at = self.plot.exact(corner);
        if let (Some(num), Some(den)) = (at.small_dot(&s.plane), at.small_dot(&[0, 0, s.area])) {
            return Integer::div_ceil(&num, &den);
        }
        let num = at.dot(&s.plane.map(BigInt::from));
        let den = at.dot(&[BigInt::ZERO, BigInt::ZERO, BigInt::from(s.area)]);
        // Over its own triangle a surface stays within the depths of its corners.
        num.div_ceil(&den).to_i128().expect("depth of a covered point")
    }
}

impl Surface {
    /// Whether the other surface, through these points (counted from the texel), lies in the plane of this one.
    fn holds(&self, other: &Surface, points: [[i64; 3]; 3]) -> bool {
        near(self.float[0], other.float[0])
            && near(self.float[1], other.float[1])
            && points.iter().all(|p| {
                let [x, y, z] = p.map(i128::from);
                self.plane[0] * x + self.plane[1] * y + self.plane[2] == z * self.area
            })
    }
}

/// Whether two floats may stand for one rational.
fn near(p: f64, q: f64) -> bool {
    (p - q).abs() <= ROUNDING * (p.abs() + q.abs())
}

/// Number of the line of edge `k` of a facet: behind the square's four sides.
fn edge_line(facet: usize, k: usize) -> u32 {
    (4 + 3 * facet + k) as u32
}
