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

use super::ray::Rays;
use super::triangle::{Cover, Local};
use super::{DEEPEST, Event, Interval, ceil};

/// Outward margin of clipped surfaces, lattice steps. Edge functions of a tile stay below 2^57 and their edges are at
/// least one step long, so f64 misplaces an edge by less than 2^-52 of the tile's 2^28 steps a side.
const MARGIN: f64 = 1.0 / 1024.0;

/// An open half-plane `a x + b y + c > 0`, tile-relative and exact over the tile.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HalfPlane {
    /// See the type.
    pub a: i64,
    /// See the type.
    pub b: i64,
    /// See the type.
    pub c: i64,
}

impl HalfPlane {
    /// The other side.
    pub fn beyond(self) -> HalfPlane {
        HalfPlane { a: -self.a, b: -self.b, c: -self.c }
    }

    /// Positive inside; exact for points of the tile.
    pub fn at(self, p: [i64; 2]) -> i64 {
        self.a * p[0] + self.b * p[1] + self.c
    }

    /// Exact for any lattice point.
    pub fn wide(self, p: [i64; 2]) -> i128 {
        i128::from(self.a) * i128::from(p[0]) + i128::from(self.b) * i128::from(p[1]) + i128::from(self.c)
    }
}

/// What a proof is about: the part of a tile-relative square inside some half-planes, and depths that are counted from
/// a plane through the tile's corner: `z - shear . (x, y)`.
#[derive(Clone, Copy, Debug)]
pub struct Region<'a> {
    /// Corner of the square.
    pub p: [i64; 2],
    /// Its side.
    pub size: i64,
    /// All of these hold.
    pub lines: &'a [HalfPlane],
    /// Depth per lattice step.
    pub shear: [f64; 2],
}

impl<'a> Region<'a> {
    /// A whole square, depths as they are.
    pub fn square(p: [i64; 2], size: i64) -> Self {
        Region { p, size, lines: &[], shear: [0.0; 2] }
    }

    fn is_plain(&self) -> bool {
        self.lines.is_empty() && self.shear == [0.0; 2]
    }

    /// Extremes of the shearing plane over the square.
    fn lift(&self) -> (f64, f64) {
        let at = |p: [i64; 2]| self.shear[0] * p[0] as f64 + self.shear[1] * p[1] as f64;
        let (z, s) = (at(self.p), self.size as f64);
        let (dx, dy) = (self.shear[0] * s, self.shear[1] * s);
        (z + dx.min(0.0) + dy.min(0.0), z + dx.max(0.0) + dy.max(0.0))
    }

    /// What rounding may do to a sheared depth in the tile: coordinates stay below 2^27.
    fn slack(&self) -> f64 {
        (self.shear[0].abs() + self.shear[1].abs()) * 134217728.0 * 8.0 * f64::EPSILON
    }

    /// Lattice points inside, near its corners.
    pub(crate) fn corners(&self, polygon: &mut Polygon, out: &mut Vec<[i64; 2]>) {
        polygon.region(self);
        let n = polygon.points.len() as f64;
        let sum = polygon.points.iter().fold([0.0; 2], |s, p| [s[0] + p[0], s[1] + p[1]]);
        out.extend(polygon.points.iter().filter_map(|q| {
            let q = [0, 1].map(|i| (q[i] + (sum[i] / n - q[i]) / 32.0).round() as i64);
            let inside = (0..2).all(|i| self.p[i] < q[i] && q[i] < self.p[i] + self.size);
            (inside && self.lines.iter().all(|l| l.at(q) > 0)).then_some(q)
        }));
    }

    /// A lattice point inside, or none that was found.
    pub(crate) fn sample(&self, polygon: &mut Polygon) -> Option<[i64; 2]> {
        let centre = [self.p[0] + self.size / 2, self.p[1] + self.size / 2];
        if self.lines.is_empty() {
            return Some(centre);
        }
        polygon.square(self.p, self.size);
        self.lines.iter().for_each(|l| polygon.keep(l, 0.0));
        let n = polygon.points.len() as f64;
        let sum = polygon.points.iter().fold([0.0; 2], |s, p| [s[0] + p[0], s[1] + p[1]]);
        let point = [(sum[0] / n).floor() as i64, (sum[1] / n).floor() as i64];
        let inside = (0..2).all(|i| self.p[i] < point[i] && point[i] < self.p[i] + self.size);
        (n > 0.0 && inside && self.lines.iter().all(|l| l.at(point) > 0)).then_some(point)
    }
}

#[derive(Clone, Copy)]
struct Reach {
    low: i64,
    high: i64,
    /// It covers the region.
    all: bool,
    /// It covers the region's square.
    square: bool,
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
    region: Region<'a>,
    /// The region.
    base: &'a Polygon,
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
        let mut test = |n: usize| {
            let f = &self.locals[self.list[n] as usize];
            behind(t, f, &self.region) || (self.close && self.lies_behind(k, n, polygon))
        };
        match front().filter(|k| self.reach[*k].all).min_by_key(|k| self.reach[*k].high) {
            Some(f) => test(f),
            None => front().all(test),
        }
    }

    /// Whether surface `t` of the list is nowhere in front of `f` where both lie over the region.
    fn lies_behind(&self, t: usize, f: usize, polygon: &mut Polygon) -> bool {
        polygon.copy(self.base);
        for n in [t, f] {
            // the edges of others are all outside the square
            if !self.reach[n].square {
                polygon.clip(&self.locals[self.list[n] as usize]);
            }
        }
        let [t, f] = [t, f].map(|n| &self.locals[self.list[n] as usize]);
        let (sx, sy) = (t.sx - f.sx, t.sy - f.sy);
        let slack = 2.0 * (t.eps + f.eps) + 2.0 * MARGIN * (sx.abs() + sy.abs());
        polygon.range(t.z0 - f.z0, sx, sy).0 >= slack
    }
}

/// Proves intervals for squares; owns the buffers.
#[derive(Default)]
pub struct Prover {
    reach: Vec<Reach>,
    slabs: Vec<Slab>,
    polygon: Polygon,
    /// The region.
    base: Polygon,
    /// Largest depth that stays in the lattice, counted as the region says.
    deepest: i64,
    /// A point inside the region.
    sample: [i64; 2],
}

impl Prover {
    /// A lattice point inside the region, or none that was found.
    pub(crate) fn sample(&mut self, region: &Region<'_>) -> Option<[i64; 2]> {
        region.sample(&mut self.polygon)
    }

    /// An interval that is right for every ray of the tile-relative square, or nothing. `list` holds the surfaces that
    /// overlap the open square, sorted by solid. `close` clips where that may help.
    pub fn prove(
        &mut self,
        rays: &Rays,
        list: &[u32],
        p: [i64; 2],
        size: i64,
        second_surface: bool,
        close: bool,
    ) -> Option<Interval> {
        let (low, high) = self.prove_in(rays, list, &[], Region::square(p, size), second_surface, close, None)?;
        interval(low, high)
    }

    /// Sheared depths `low <= v <= high` that are right for every ray of the region, as integers: `lo <= v` and `v < hi`.
    /// They leave the lattice nowhere in the square. `list` holds at least the surfaces that overlap the open region, sorted
    /// by solid. `covers` says of all of the tile's surfaces which of them cover the region's square, or is empty. Where the
    /// values that can be right are known to lie in a `window`, surfaces off it are not looked at closely.
    #[expect(clippy::too_many_arguments, reason = "what is known of the region differs from call to call")]
    pub fn prove_in(
        &mut self,
        rays: &Rays,
        list: &[u32],
        covers: &[bool],
        region: Region<'_>,
        second_surface: bool,
        close: bool,
        window: Option<(i64, i64)>,
    ) -> Option<(i64, i64)> {
        let locals = rays.locals;
        let Region { p, size, .. } = region;
        let close = close || !region.lines.is_empty();
        self.reach.clear();
        self.base.region(&region);
        let (plain, slack) = (region.is_plain(), region.slack());
        for &i in list {
            let l = &locals[i as usize];
            let off = |low: i64, high: i64| window.is_some_and(|(first, last)| low > last || high < first);
            let (mut low, mut high) =
                if plain { l.ceil_range(p[0], p[1], size) } else { sheared(rays, l, &region, slack, off) };
            // of exits nobody asks, but where they may be the only surface
            let matters = l.event == Event::Enter || second_surface && l.event != Event::Wall;
            let over = || covers.get(i as usize).copied().unwrap_or_else(|| l.cover(p[0], p[1], size) == Cover::All);
            let square = (matters || close) && l.event != Event::Wall && over();
            let mut all = square;
            if close
                && !all
                && l.event != Event::Wall
                && (!off(low, high) || !region.lines.is_empty() && l.event == Event::Enter)
            {
                all = matters && !region.lines.is_empty() && self.base.covered(rays, l, &region, 3);
                self.polygon.points.clone_from(&self.base.points);
                self.polygon.clip(l);
                let (sx, sy) = (l.sx - region.shear[0], l.sy - region.shear[1]);
                let (a, b) = self.polygon.range(l.z0, sx, sy);
                let slack = l.eps + region.slack() + 2.0 * MARGIN * (sx.abs() + sy.abs());
                low = low.max(ceil(a - slack));
                high = high.min(ceil(b + slack)).max(low);
            }
            self.reach.push(Reach { low, high, all, square });
        }
        let (least, most) = region.lift();
        self.deepest = (DEEPEST as f64 - most).floor() as i64;
        self.sample = region.sample(&mut self.polygon)?;
        let (low, high) = if second_surface {
            self.prove_second(locals, list)?
        } else {
            self.prove_slabs(locals, list, region, close)?
        };
        let (low, high) = (low.max(ceil(-least)), high.min(self.deepest));
        (low <= high).then_some((low, high))
    }

    fn prove_slabs(&mut self, locals: &[Local], list: &[u32], region: Region<'_>, close: bool) -> Option<(i64, i64)> {
        self.slabs.clear();
        let mut start = 0;
        while start < list.len() {
            let solid = locals[list[start] as usize].solid;
            let mut end = start + 1;
            while end < list.len() && locals[list[end] as usize].solid == solid {
                end += 1;
            }
            if let Some((low, high)) = self.slab(locals, list, start, end) {
                self.slabs.push(Slab { low, high, start, end });
            }
            start = end;
        }
        let &first = self.slabs.iter().min_by_key(|s| s.low)?;
        let low = first.low;
        let front = |k: usize| locals[list[k] as usize].event == Event::Leave && self.reach[k].low <= low;
        let mut polygon = std::mem::take(&mut self.polygon);
        let view = View { locals, list, reach: &self.reach, region, base: &self.base, close };
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
        Some((low, high))
    }

    /// The depths at which every ray of the square is inside the solid of `list[start..end]`.
    fn slab(&self, locals: &[Local], list: &[u32], start: usize, end: usize) -> Option<(i64, i64)> {
        let event = |k: usize| locals[list[k] as usize].event;
        let exit = (start..end).filter(|k| event(*k) == Event::Leave).map(|k| self.reach[k].low).min();
        let last = exit.unwrap_or(self.deepest + 1) - 1;
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
        let centre = self.sample;
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
    fn prove_second(&mut self, locals: &[Local], list: &[u32]) -> Option<(i64, i64)> {
        let mut order: Vec<usize> =
            (0..list.len()).filter(|k| locals[list[*k] as usize].event != Event::Wall).collect();
        order.sort_by_key(|k| (self.reach[*k].low, *k));
        let local = |k: usize| &locals[list[k] as usize];
        let mut highest = i64::MIN;
        for (n, &k) in order.iter().enumerate() {
            highest = highest.max(self.reach[k].high);
            let next = order.get(n + 1).map_or(self.deepest + 1, |j| self.reach[*j].low);
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
            let centre = self.sample;
            let met = group.iter().filter(|k| local(**k).covers(centre[0], centre[1], 1, 1)).count();
            // a group that meets no ray, or more than one, settles nothing
            return (met == 1 && group.iter().all(|k| constant(*k))).then_some((highest, next - 1));
        }
        None
    }
}

fn interval(low: i64, high: i64) -> Option<Interval> {
    let (low, high) = (low.max(0), high.min(DEEPEST));
    (low <= high).then_some(Interval { min: low as u32, max: high as u32 })
}

/// Bounds of ceil(sheared depth) over the part of the surface in the square.
fn sheared(rays: &Rays, l: &Local, region: &Region<'_>, slack: f64, off: impl Fn(i64, i64) -> bool) -> (i64, i64) {
    let Region { p, size, shear, .. } = *region;
    if l.event == Event::Wall {
        // its bounds, cut to the square, and its corners' depths
        let (mut least, mut most) = (0.0, 0.0);
        for i in 0..2 {
            let (a, b) = (l.low[i].clamp(p[i], p[i] + size) as f64, l.high[i].clamp(p[i], p[i] + size) as f64);
            least += (shear[i] * a).min(shear[i] * b);
            most += (shear[i] * a).max(shear[i] * b);
        }
        return (ceil(l.zmin as f64 - most - slack), ceil(l.zmax as f64 - least + slack));
    }
    let (sx, sy) = (l.sx - shear[0], l.sy - shear[1]);
    let z = l.z0 + sx * p[0] as f64 + sy * p[1] as f64;
    let (dx, dy) = (sx * size as f64, sy * size as f64);
    let (mut low, mut high) = (z + dx.min(0.0) + dy.min(0.0), z + dx.max(0.0) + dy.max(0.0));
    let (loose, wide) = (ceil(low - slack - l.eps), ceil(high + slack + l.eps));
    if off(loose, wide) {
        return (loose, wide);
    }
    // and the corners bound the whole surface
    let s = &rays.surfaces[l.index as usize];
    let (mut least, mut most) = (f64::INFINITY, f64::NEG_INFINITY);
    for k in 0..3 {
        let at = |v: u32, o: i64| (i64::from(v) - o) as f64;
        let v = f64::from(s.z[k]) - shear[0] * at(s.x[k], rays.corner[0]) - shear[1] * at(s.y[k], rays.corner[1]);
        // a corner may lie far outside the tile
        let far = (shear[0] * at(s.x[k], rays.corner[0])).abs() + (shear[1] * at(s.y[k], rays.corner[1])).abs();
        let slack = far * 4.0 * f64::EPSILON;
        least = least.min(v - slack);
        most = most.max(v + slack);
    }
    let slack = slack + l.eps;
    low = low.max(least);
    high = high.min(most).max(low);
    (ceil(low - slack), ceil(high + slack))
}

/// Whether `t` is nowhere in front of `f` over the square, as surfaces or as planes.
fn behind(t: &Local, f: &Local, region: &Region<'_>) -> bool {
    let Region { p, size, .. } = *region;
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
pub(crate) struct Polygon {
    points: Vec<[f64; 2]>,
    spare: Vec<[f64; 2]>,
}

impl Polygon {
    /// The square.
    pub(crate) fn square(&mut self, p: [i64; 2], size: i64) {
        let ([x, y], s) = (p.map(|c| c as f64), size as f64);
        self.points.clear();
        self.points.extend([[x, y], [x + s, y], [x + s, y + s], [x, y + s]]);
    }

    /// The region, its half-planes widened by [`MARGIN`].
    pub(crate) fn region(&mut self, region: &Region<'_>) {
        self.square(region.p, region.size);
        region.lines.iter().for_each(|l| self.keep(l, MARGIN));
    }

    /// Keeps what lies in the surface's projection or within [`MARGIN`] of it.
    fn clip(&mut self, l: &Local) {
        for k in 0..3 {
            // an edge that the whole tile lies inside of
            if l.a[k] != 0 || l.b[k] != 0 {
                self.keep(&HalfPlane { a: l.a[k], b: l.b[k], c: l.c[k] }, MARGIN);
            }
        }
    }

    /// Keeps what lies in the half-plane or within `margin` of it.
    pub(crate) fn keep(&mut self, l: &HalfPlane, margin: f64) {
        let (a, b) = (l.a as f64, l.b as f64);
        self.keep_linear(a, b, l.c as f64 + (a.abs() + b.abs()) * margin);
    }

    fn keep_linear(&mut self, a: f64, b: f64, c: f64) {
        let at = |p: &[f64; 2]| a * p[0] + b * p[1] + c;
        // most edges do not cross the region
        if self.points.iter().all(|p| at(p) >= 0.0) {
            return;
        }
        self.spare.clear();
        let Some(&last) = self.points.last() else { return };
        let mut p = last;
        let mut e = at(&p);
        for &q in &self.points {
            let f = at(&q);
            if (e >= 0.0) != (f >= 0.0) {
                let t = e / (e - f);
                self.spare.push([p[0] + (q[0] - p[0]) * t, p[1] + (q[1] - p[1]) * t]);
            }
            if f >= 0.0 {
                self.spare.push(q);
            }
            (p, e) = (q, f);
        }
        std::mem::swap(&mut self.points, &mut self.spare);
    }

    /// Whether the surface covers this polygon, which lies in the region: each edge runs outside the region's square, outside the
    /// polygon, or along one of the region's lines. Edge `but` is left out; 3: none is.
    pub(crate) fn covered(&self, rays: &Rays, l: &Local, region: &Region<'_>, but: u8) -> bool {
        let s = &rays.surfaces[l.index as usize];
        (0..3).filter(|k| *k != usize::from(but)).all(|k| {
            let e = HalfPlane { a: l.a[k], b: l.b[k], c: l.c[k] };
            let (dx, dy) = (e.a.min(0) * region.size, e.b.min(0) * region.size);
            if e.at(region.p) + dx + dy >= 0 {
                return true;
            }
            let corner = |j: usize| [i64::from(s.x[j % 3]) - rays.corner[0], i64::from(s.y[j % 3]) - rays.corner[1]];
            let same = |h: &HalfPlane| {
                h.wide(corner(k)) == 0
                    && h.wide(corner(k + 1)) == 0
                    && i128::from(h.a) * i128::from(e.a) + i128::from(h.b) * i128::from(e.b) > 0
            };
            if region.lines.iter().any(same) {
                return true;
            }
            let (a, b, c) = (e.a as f64, e.b as f64, e.c as f64);
            let far = (a.abs() + b.abs()) * MARGIN;
            self.points.iter().all(|p| a * p[0] + b * p[1] + c >= far)
        })
    }

    /// Extremes of `z + sx x + sy y`; (inf, -inf) when nothing is left.
    pub(crate) fn range(&self, z: f64, sx: f64, sy: f64) -> (f64, f64) {
        self.points.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), p| {
            let v = z + sx * p[0] + sy * p[1];
            (low.min(v), high.max(v))
        })
    }

    /// Keeps what has `sx x + sy y + z >= 0`.
    pub(crate) fn keep_plane(&mut self, sx: f64, sy: f64, z: f64) {
        self.keep_linear(sx, sy, z);
    }

    /// Becomes another one.
    pub(crate) fn copy(&mut self, other: &Polygon) {
        self.points.clone_from(&other.points);
    }

    /// Its corners; none where nothing is left.
    pub(crate) fn corners(&self) -> &[[f64; 2]] {
        &self.points
    }

    /// Doubled area over two.
    pub(crate) fn area(&self) -> f64 {
        let n = self.points.len();
        let cross = |i: usize| {
            let (p, q) = (self.points[i], self.points[(i + 1) % n]);
            p[0] * q[1] - p[1] * q[0]
        };
        (0..n).map(cross).sum::<f64>().abs() / 2.0
    }

    /// Extremes along an axis, or nothing where nothing is left.
    pub(crate) fn extent(&self, axis: usize) -> Option<(f64, f64)> {
        let fold = |s: (f64, f64), p: &[f64; 2]| (s.0.min(p[axis]), s.1.max(p[axis]));
        (!self.points.is_empty()).then(|| self.points.iter().fold((f64::INFINITY, f64::NEG_INFINITY), fold))
    }

    /// Extremes of x in the row of height `height` around y, or nothing.
    pub(crate) fn row(&self, y: f64, height: f64) -> Option<(f64, f64)> {
        let (low, high) = (y - height / 2.0, y + height / 2.0);
        let (mut from, mut to) = (f64::INFINITY, f64::NEG_INFINITY);
        for i in 0..self.points.len() {
            let (p, q) = (self.points[i], self.points[(i + 1) % self.points.len()]);
            if p[1].max(q[1]) < low || p[1].min(q[1]) > high {
                continue;
            }
            for at in [low, high] {
                if (p[1] - at) * (q[1] - at) < 0.0 {
                    let x = p[0] + (q[0] - p[0]) * (at - p[1]) / (q[1] - p[1]);
                    (from, to) = (from.min(x), to.max(x));
                }
            }
            for v in [p, q] {
                if low <= v[1] && v[1] <= high {
                    (from, to) = (from.min(v[0]), to.max(v[0]));
                }
            }
        }
        (from <= to).then_some((from, to))
    }
}

/// How far `t` lies at least behind the plane `z + sx x + sy y` where it lies over a polygon; without end where it doesn't.
/// `covers`: it covers the polygon.
pub(crate) fn clearance(
    (t, covers): (&Local, bool),
    (z, sx, sy): (f64, f64, f64),
    polygon: &Polygon,
    spare: &mut Polygon,
) -> f64 {
    spare.copy(polygon);
    if !covers {
        spare.clip(t);
    }
    let (dx, dy) = (t.sx - sx, t.sy - sy);
    spare.range(t.z0 - z, dx, dy).0 - 2.0 * t.eps - 2.0 * MARGIN * (dx.abs() + dy.abs()) - 0.01
}

/// Whether `t` is behind `e`, and nowhere at the same depth, where it lies over a polygon of the region. `covers`: `t` covers the
/// region's square.
pub(crate) fn strictly_behind(
    (t, covers): (&Local, bool),
    e: &Local,
    region: &Region<'_>,
    polygon: &Polygon,
    spare: &mut Polygon,
) -> bool {
    let (sx, sy) = (t.sx - e.sx, t.sy - e.sy);
    let slack = 2.0 * (t.eps + e.eps) + 2.0 * MARGIN * (sx.abs() + sy.abs());
    // all over the square, with as much room again for rounding
    let (z, s) = ((t.z0 - e.z0) + sx * region.p[0] as f64 + sy * region.p[1] as f64, region.size as f64);
    if z + (sx * s).min(0.0) + (sy * s).min(0.0) > 2.0 * slack {
        return true;
    }
    spare.copy(polygon);
    if !covers {
        spare.clip(t);
    }
    spare.range(t.z0 - e.z0, sx, sy).0 > slack
}
