//! One interval for a whole square, proven by a few comparisons.
//!
//! Claim of [`Prover::prove`]: every value `v` in the answer satisfies ceil(lo) <= v < ceil(hi) on every ray of every
//! open cell of the square. Nothing is claimed when there is no answer.
//!
//! Argument. Take one solid c. Let X be the smallest ceil(depth) of any of its exits in the square and F its entries
//! whose largest ceil(depth) is below X. At the depth v0 = (smallest of the largest depths of entries in F that cover
//! the whole square; else the largest depth in F) every ray is inside c: in the first case because it has passed an
//! entry and no exit, in the second because no surface of c crosses depth v0 (the other entries begin behind it, walls seen edge-on end
//! before it or begin behind), so
//! c's counter there is one number over the whole square, and it is counted at one ray. (Open geometry is met from
//! both sides: there the entries in F must all face the light or all face away, and its rims count as walls.) The ray stays inside c up to
//! X: the *slab* [v0, X - 1] of c. Take the slab that begins first, [v, h]. Every lo is at most v. A ray can be out
//! of all solids between its lo and v only after an exit of another solid in front of c's entry: refuse unless each
//! exit that begins at or before v lies nowhere in front of c's entries (compared as planes over the square). Another
//! slab carries the ray on to its end if it begins at or before h, or if no exit of c that begins before it lies in
//! front of its entries: then every ray that leaves c is inside the other solid already.
//!
//! Extremes over a surface come first from its plane over the whole square, which costs a few additions. A *close*
//! proof clips the surface to the square (and, for the comparison with an entry, to that entry) with a margin of
//! `MARGIN` lattice steps outward, far above what rounding can move an edge.

use super::triangle::{Cover, Local};
use super::{DEEPEST, Event, Interval};

/// Outward margin of clipped surfaces, lattice steps. Edge functions of a tile stay below 2^57 and their edges are at
/// least one step long, so f64 misplaces an edge by less than 2^-52 of the tile's 2^28 steps a side.
const MARGIN: f64 = 1.0 / 1024.0;

#[derive(Clone, Copy)]
struct Reach {
    low: i64,
    high: i64,
    all: bool,
}

/// Depths at which every ray of the square is inside the solid of `list[start..end]`.
#[derive(Clone, Copy)]
struct Slab {
    low: i64,
    high: i64,
    start: usize,
    end: usize,
}

/// What comparisons of surfaces need.
struct View<'a> {
    locals: &'a [Local],
    list: &'a [u32],
    reach: &'a [Reach],
    p: [i64; 2],
    size: i64,
    close: bool,
}

impl View<'_> {
    fn event(&self, k: usize) -> Event {
        self.locals[self.list[k] as usize].event
    }

    /// Whether exit `k` is nowhere in front of the entries that make the slab: a covering one alone if there is one.
    fn behind(&self, k: usize, slab: &Slab, polygon: &mut Polygon) -> bool {
        let t = &self.locals[self.list[k] as usize];
        let front =
            || (slab.start..slab.end).filter(|k| self.event(*k) == Event::Enter && self.reach[*k].high <= slab.high);
        let mut test = |f: usize| {
            let f = &self.locals[self.list[f] as usize];
            behind(t, f, self.p, self.size) || (self.close && polygon.behind(t, f, self.p, self.size))
        };
        match front().filter(|k| self.reach[*k].all).min_by_key(|k| self.reach[*k].high) {
            Some(f) => test(f),
            None => front().all(test),
        }
    }
}

/// Proves intervals for squares; owns the buffers.
#[derive(Default)]
pub struct Prover {
    reach: Vec<Reach>,
    slabs: Vec<Slab>,
    polygon: Polygon,
}

impl Prover {
    /// An interval that is right for every ray of the tile-relative square, or nothing. `list` holds the surfaces that
    /// overlap the open square, sorted by solid. `close` clips where that may help.
    pub fn prove(
        &mut self,
        locals: &[Local],
        list: &[u32],
        p: [i64; 2],
        size: i64,
        second_surface: bool,
        close: bool,
    ) -> Option<Interval> {
        self.reach.clear();
        for &i in list {
            let l = &locals[i as usize];
            let (mut low, mut high) = l.ceil_range(p[0], p[1], size);
            let all = l.cover(p[0], p[1], size) == Cover::All;
            if close && !all && l.event != Event::Wall {
                self.polygon.square(p, size);
                self.polygon.clip(l);
                let (a, b) = self.polygon.range(l.z0, l.sx, l.sy);
                let slack = l.eps + 2.0 * MARGIN * (l.sx.abs() + l.sy.abs());
                low = low.max((a - slack).ceil() as i64);
                high = high.min((b + slack).ceil() as i64).max(low);
            }
            self.reach.push(Reach { low, high, all });
        }
        if second_surface {
            return self.prove_second(locals, list, p, size);
        }
        self.slabs.clear();
        let mut start = 0;
        while start < list.len() {
            let solid = locals[list[start] as usize].solid;
            let mut end = start + 1;
            while end < list.len() && locals[list[end] as usize].solid == solid {
                end += 1;
            }
            if let Some((low, high)) = self.slab(locals, list, start, end, p, size) {
                self.slabs.push(Slab { low, high, start, end });
            }
            start = end;
        }
        let &first = self.slabs.iter().min_by_key(|s| s.low)?;
        let low = first.low;
        let front = |k: usize| locals[list[k] as usize].event == Event::Leave && self.reach[k].low <= low;
        let mut polygon = std::mem::take(&mut self.polygon);
        let view = View { locals, list, reach: &self.reach, p, size, close };
        let harmless = (0..list.len())
            .filter(|k| front(*k) && !(first.start..first.end).contains(k))
            .all(|k| view.behind(k, &first, &mut polygon));
        if !harmless {
            self.polygon = polygon;
            return None;
        }
        let mut current = first;
        let mut high = first.high;
        loop {
            // the slab that carries on furthest, of those that every ray has entered where it leaves this one
            let further = self.slabs.iter().filter(|s| s.high > high).filter(|s| {
                s.low <= high
                    || (current.start..current.end)
                        .filter(|k| view.event(*k) == Event::Leave && self.reach[*k].low <= s.low)
                        .all(|k| view.behind(k, s, &mut polygon))
            });
            match further.max_by_key(|s| s.high) {
                Some(s) => (current, high) = (*s, s.high),
                None => break,
            }
        }
        self.polygon = polygon;
        interval(low, high)
    }

    /// The depths at which every ray of the square is inside the solid of `list[start..end]`.
    fn slab(
        &self,
        locals: &[Local],
        list: &[u32],
        start: usize,
        end: usize,
        p: [i64; 2],
        size: i64,
    ) -> Option<(i64, i64)> {
        let event = |k: usize| locals[list[k] as usize].event;
        let exit = (start..end).filter(|k| event(*k) == Event::Leave).map(|k| self.reach[k].low).min();
        let last = exit.unwrap_or(DEEPEST + 1) - 1;
        let mut covering = i64::MAX;
        let mut deepest = i64::MIN;
        let mut others = i64::MAX;
        for k in start..end {
            if event(k) == Event::Enter {
                let r = self.reach[k];
                if r.high <= last {
                    deepest = deepest.max(r.high);
                    if r.all {
                        covering = covering.min(r.high);
                    }
                } else {
                    others = others.min(r.low);
                }
            }
        }
        if covering != i64::MAX {
            return Some((covering, last));
        }
        let facing = |k: usize| locals[list[k] as usize].facing;
        let mut front = (start..end).filter(|k| event(*k) == Event::Enter && self.reach[*k].high <= last);
        let turned = front.next().is_some_and(|first| front.any(|k| facing(k) != facing(first)));
        let walled = (start..end).any(|k| {
            let r = self.reach[k];
            event(k) == Event::Wall && r.low <= deepest && deepest < r.high
        });
        if deepest == i64::MIN || others <= deepest || walled || turned {
            return None;
        }
        let centre = [p[0] + size / 2, p[1] + size / 2];
        let inside = (start..end).any(|k| {
            let l = &locals[list[k] as usize];
            event(k) == Event::Enter && self.reach[k].high <= last && l.covers(centre[0], centre[1], 1, 1)
        });
        inside.then_some((deepest, last))
    }

    /// Second-surface: a first group of surfaces that meets every ray exactly once, then a gap.
    ///
    /// How many surfaces of a component a ray meets before the gap is one number over the square if all of them face the
    /// light or all face away, and no wall or rim of it crosses the gap.
    fn prove_second(&mut self, locals: &[Local], list: &[u32], p: [i64; 2], size: i64) -> Option<Interval> {
        let mut order: Vec<usize> =
            (0..list.len()).filter(|k| locals[list[*k] as usize].event != Event::Wall).collect();
        order.sort_by_key(|k| (self.reach[*k].low, *k));
        let local = |k: usize| &locals[list[k] as usize];
        let mut highest = i64::MIN;
        for (n, &k) in order.iter().enumerate() {
            highest = highest.max(self.reach[k].high);
            let next = order.get(n + 1).map_or(DEEPEST + 1, |j| self.reach[*j].low);
            if next <= highest {
                continue;
            }
            let group = &order[..=n];
            let walled = (0..list.len()).any(|k| {
                let r = self.reach[k];
                local(k).event == Event::Wall && r.low <= highest && highest < r.high
            });
            let constant = |k: usize| {
                let same = |j: &usize| local(*j).solid != local(k).solid || local(*j).facing == local(k).facing;
                self.reach[k].all || (!walled && group.iter().all(same))
            };
            let centre = [p[0] + size / 2, p[1] + size / 2];
            let met = group.iter().filter(|k| local(**k).covers(centre[0], centre[1], 1, 1)).count();
            // a group that meets no ray, or more than one, settles nothing
            return if met == 1 && group.iter().all(|k| constant(*k)) { interval(highest, next - 1) } else { None };
        }
        None
    }
}

fn interval(low: i64, high: i64) -> Option<Interval> {
    let (low, high) = (low.max(0), high.min(DEEPEST));
    (low <= high).then_some(Interval { min: low as u32, max: high as u32 })
}

/// Whether `t` is nowhere in front of `f` over the square, as surfaces or as planes.
fn behind(t: &Local, f: &Local, p: [i64; 2], size: i64) -> bool {
    if t.zmin >= f.zmax {
        return true;
    }
    let (sx, sy) = (t.sx - f.sx, t.sy - f.sy);
    let z = (t.z0 - f.z0) + sx * p[0] as f64 + sy * p[1] as f64;
    let s = size as f64;
    // the differences round once more than each plane does
    z + (sx * s).min(0.0) + (sy * s).min(0.0) >= 2.0 * (t.eps + f.eps)
}

/// A convex polygon in tile-relative lattice steps.
#[derive(Clone, Default)]
struct Polygon {
    points: Vec<[f64; 2]>,
    spare: Vec<[f64; 2]>,
}

impl Polygon {
    fn square(&mut self, p: [i64; 2], size: i64) {
        let ([x, y], s) = (p.map(|c| c as f64), size as f64);
        self.points.clear();
        self.points.extend([[x, y], [x + s, y], [x + s, y + s], [x, y + s]]);
    }

    /// Keeps what lies in the surface's projection or within [`MARGIN`] of it.
    fn clip(&mut self, l: &Local) {
        for k in 0..3 {
            let (a, b) = (l.a[k] as f64, l.b[k] as f64);
            let c = l.c[k] as f64 + (a.abs() + b.abs()) * MARGIN;
            self.spare.clear();
            for i in 0..self.points.len() {
                let (p, q) = (self.points[i], self.points[(i + 1) % self.points.len()]);
                let (e, f) = (a * p[0] + b * p[1] + c, a * q[0] + b * q[1] + c);
                if e >= 0.0 {
                    self.spare.push(p);
                }
                if (e >= 0.0) != (f >= 0.0) {
                    let t = e / (e - f);
                    self.spare.push([p[0] + (q[0] - p[0]) * t, p[1] + (q[1] - p[1]) * t]);
                }
            }
            std::mem::swap(&mut self.points, &mut self.spare);
        }
    }

    /// Extremes of `z + sx x + sy y`; (inf, -inf) when nothing is left.
    fn range(&self, z: f64, sx: f64, sy: f64) -> (f64, f64) {
        self.points.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), p| {
            let v = z + sx * p[0] + sy * p[1];
            (low.min(v), high.max(v))
        })
    }

    /// Whether `t` is nowhere in front of `f` where both lie over the square.
    fn behind(&mut self, t: &Local, f: &Local, p: [i64; 2], size: i64) -> bool {
        self.square(p, size);
        self.clip(t);
        self.clip(f);
        let (sx, sy) = (t.sx - f.sx, t.sy - f.sy);
        let slack = 2.0 * (t.eps + f.eps) + 2.0 * MARGIN * (sx.abs() + sy.abs());
        self.range(t.z0 - f.z0, sx, sy).0 >= slack
    }
}
