//! Cells at silhouettes, where the front of a stretch and its end meet.

use super::strip::strip;
use super::{MANY_TEXELS, MOST_CLOSE, MOST_MOVED, MOST_STRIP, MOST_TIPS, Search, Tip};
use crate::hierarchy::vector::entry::{Entry, Palette, Plane, between};
use crate::interval::proof::{HalfPlane, Region, strictly_behind};
use crate::interval::{Event, Interval, ceil};

impl Search<'_> {
    /// Whether the surface covers the polygon, a part of the region, alone or with the flattest neighbour: then that one, and the
    /// most that it lies off this one's plane there, in depth.
    pub(super) fn covers(&self, list: &[u32], region: &Region<'_>, i: u32) -> Option<(u32, f64)> {
        let l = &self.rays.locals[i as usize];
        if self.polygon.covered(&self.rays, l, region, 3) {
            return Some((i, 0.0));
        }
        for (k, mate) in (0u8..).zip(self.edges[l.index as usize].across).filter(|a| a.1 != u32::MAX) {
            let Some(other) = list.iter().copied().find(|n| self.rays.locals[*n as usize].index == mate) else {
                continue;
            };
            let m = &self.rays.locals[other as usize];
            let shared = self.edges[m.index as usize].across.iter().position(|b| *b == l.index);
            let Some(shared) = shared else { continue };
            if !self.polygon.covered(&self.rays, l, region, k)
                || !self.polygon.covered(&self.rays, m, region, shared as u8)
            {
                continue;
            }
            let (low, high) = self.polygon.range(m.z0 - l.z0, m.sx - l.sx, m.sy - l.sy);
            return Some((other, low.abs().max(high.abs()) + m.eps + l.eps));
        }
        None
    }

    /// A tip that answers the region: with this plane, with one near by where single texels need it, with one of just these
    /// two surfaces, or with this one but for a texel.
    pub(super) fn tip(
        &mut self,
        palette: &Palette,
        list: &[u32],
        region: Region<'_>,
        (front, end): (u32, u32),
        plane: Plane,
    ) -> Option<Tip> {
        let tip = Tip { front, end, plane, edges: 0, excepted: None, mate: end, far: 0.0, bend: 0.0 };
        let found = self.tip_with(list, region, tip, false);
        // other planes help where single texels are wrong
        if found.is_some() || self.close.is_empty() {
            return found;
        }
        let moved = self.moved(palette, plane);
        let [f, e] = [front, end].map(|i| &self.rays.surfaces[self.rays.locals[i as usize].index as usize]);
        let own = between(f, e, self.guard, self.scale).filter(|own| *own != plane);
        let others = [moved, own].into_iter().flatten();
        let found = others.map(|plane| Tip { plane, ..tip }).find_map(|tip| self.tip_with(list, region, tip, false));
        found.or_else(|| if self.may_except { self.tip_with(list, region, tip, true) } else { None })
    }

    /// The tip with what is known of it, if its plane answers the region; with `but_one` all of it but a texel.
    fn tip_with(&mut self, list: &[u32], region: Region<'_>, tip: Tip, but_one: bool) -> Option<Tip> {
        self.close.clear();
        let (bend, mate) = self.is_tip(list, region, tip)?;
        self.tip_fits(region, Tip { mate, far: self.far(tip, bend), bend, ..tip }, but_one)
    }

    /// Whether, where front and end are close, the stretch of every ray begins at the one and ends at the other, or at a
    /// neighbour in the same face: then how far these lie off the planes of the two, in depth, and the end's neighbour.
    pub(super) fn is_tip(&mut self, list: &[u32], region: Region<'_>, tip: Tip) -> Option<(f64, u32)> {
        let e = &self.rays.locals[tip.end as usize];
        let f = &self.rays.locals[tip.front as usize];
        let near = |far: f64| [f.sx - e.sx, f.sy - e.sy, far - (e.z0 - f.z0)];
        // a first guess without what the faces' neighbours add
        let [a, b, c] = near(1.2 * self.far(tip, 0.0));
        self.polygon.region(&region);
        self.polygon.keep_plane(a, b, c);
        let (front, bend) = self.covers(list, &region, tip.front)?;
        let (end, more) = self.covers(list, &region, tip.end)?;
        let bend = bend + more;
        if 4.0 * bend > 0.2 * self.far(tip, 0.0) {
            return None;
        }
        let other_end = &self.rays.locals[end as usize];
        let between = self.polygon.range(e.z0 - f.z0, e.sx - f.sx, e.sy - f.sy).0;
        // the margin of the region reaches beyond the line where both meet
        let slack = (e.sx - f.sx).abs() + (e.sy - f.sy).abs() + 2.0 * (e.eps + f.eps);
        if between < -slack - bend {
            return None;
        }
        let [a, b, c] = near(self.far(tip, bend));
        self.polygon.region(&region);
        self.polygon.keep_plane(a, b, c);
        let (near, spare) = (&self.polygon, &mut self.part);
        let sound = list.iter().all(|i| {
            let t = &self.rays.locals[*i as usize];
            let covers = self.covers[*i as usize];
            [tip.front, tip.end, front, end].contains(i)
                || t.event == Event::Wall
                || t.zmin > e.zmax.max(other_end.zmax)
                || (strictly_behind((t, covers), e, &region, near, spare)
                    && (end == tip.end || strictly_behind((t, covers), other_end, &region, near, spare)))
        });
        if !sound {
            return None;
        }
        // elsewhere as in any region
        let far = self.far_side(&region, tip, self.far(tip, bend))?;
        let mut lines = region.lines.to_vec();
        lines.push(far);
        let region = Region { lines: &lines, ..region };
        self.polygon.region(&region);
        if self.polygon.extent(0).is_none() {
            return Some((bend, end));
        }
        let rest: Vec<u32> = list.iter().copied().filter(|i| self.reaches(*i, far)).collect();
        self.holds(Entry::Plane(tip.plane), &rest, region, false).then_some((bend, end))
    }

    /// Where front and end are at least `far` apart in the region's square, and a little more.
    pub(super) fn far_side(&self, region: &Region<'_>, tip: Tip, far: f64) -> Option<HalfPlane> {
        let (f, e) = (&self.rays.locals[tip.front as usize], &self.rays.locals[tip.end as usize]);
        let (dx, dy) = (e.sx - f.sx, e.sy - f.sy);
        let largest = dx.abs().max(dy.abs());
        // a normal of 2^24 keeps edge functions of a tile far below 2^62
        let by = 16777216.0 / largest;
        let offset = (e.z0 - f.z0 - far) * by;
        if !offset.is_finite() || offset.abs() > 4e18 {
            return None;
        }
        let (a, b) = ((dx * by).round(), (dy * by).round());
        // rounded toward the near part, within the square
        let reach = (region.p[0].abs() + region.p[1].abs() + 2 * region.size) as f64;
        let c = (offset + reach + offset.abs() * 1e-15 + (f.eps + e.eps) * by + 2.0).ceil();
        Some(HalfPlane { a: a as i64, b: b as i64, c: c as i64 })
    }

    /// The distance of front and end from which on everything is linear and far from rounding.
    pub(super) fn far(&self, tip: Tip, bend: f64) -> f64 {
        let (f, e) = (&self.rays.locals[tip.front as usize], &self.rays.locals[tip.end as usize]);
        let reach = (f.sx.abs() + f.sy.abs() + e.sx.abs() + e.sy.abs()) * self.scale.half();
        // from twice the reach on the plane keeps its own reach from both, and the rounding of a gradient over a long face
        // does no harm
        2.2 * reach + 4.0 * f64::from(self.guard) + 10.0 + 4.0 * bend
    }

    /// Whether the tip's plane is right where front and end are close: for every texel inside the region, and for the
    /// centres of those that are not inside, or have an empty interval. Some for which rounding may matter are looked at one
    /// by one; with `but_one` it may be wrong for one of these. Then the tip with that one, and the number of those with an empty
    /// interval.
    pub(super) fn tip_fits(&mut self, region: Region<'_>, tip: Tip, but_one: bool) -> Option<Tip> {
        let own = TipPlane::new(self, tip, tip.bend);
        let (dz, dx, dy) = own.gap;
        let texel = 1i64 << self.scale.subtexel_bits;
        self.close.clear();
        self.polygon.region(&region);
        self.polygon.keep_plane(-dx, -dy, self.far(tip, tip.bend) - dz);
        if self.polygon.extent(1).is_none() {
            return Some(Tip { edges: 0, excepted: None, ..tip });
        }
        let edges = if region.size >= MANY_TEXELS * texel
            && let Some(edges) = self.few_are_close(region, &own)
        {
            edges
        } else {
            match self.all_fit(region, &own) {
                Some(edges) => edges,
                None => {
                    self.close.clear();
                    return None;
                }
            }
        };
        let close = std::mem::take(&mut self.close);
        let corners = close.iter().map(|c| c.map(|v| v - texel / 2));
        let mut wrong = corners.filter(|q| !self.keeps(Entry::Plane(tip.plane), *q));
        let excepted = wrong.next();
        let right = excepted.is_none() || (but_one && wrong.next().is_none());
        self.close = close;
        right.then_some(Tip { edges, excepted, ..tip })
    }

    /// After [`Self::tip_fits`]: the plane nearest by that is right for the texels that were looked at one by one, where the
    /// tip's own is not.
    pub(super) fn moved(&mut self, palette: &Palette, plane: Plane) -> Option<Plane> {
        let texel = 1i64 << self.scale.subtexel_bits;
        let close = std::mem::take(&mut self.close);
        let allowed = close.iter().try_fold((-MOST_MOVED, MOST_MOVED), |(low, high), c| {
            let q = c.map(|v| v - texel / 2);
            let interval = self.interval(q);
            let [x, y] = self.texel_at(q);
            // pages store this or one less
            let by = [i64::from(interval.min) + 1, i64::from(interval.max)].map(|v| v - plane.texel(x, y, self.scale));
            let (low, high) = (low.max(by[0]), high.min(by[1]));
            (low <= high && interval != Interval::UNCOVERED).then_some((low, high))
        });
        self.close = close;
        let (low, high) = allowed.filter(|(low, high)| *low > 0 || *high < 0)?;
        let there = palette.parallel(&plane, plane.offset + low, plane.offset + high);
        Some(there.unwrap_or(Plane { offset: plane.offset + if low > 0 { low } else { high }, ..plane }))
    }

    /// Holds the plane against each texel of the polygon; those for which rounding may matter are put on the list.
    fn all_fit(&mut self, region: Region<'_>, own: &TipPlane) -> Option<u64> {
        let texel = 1i64 << self.scale.subtexel_bits;
        let t = texel as f64;
        if self.polygon.area() > MOST_TIPS * t * region.size as f64 {
            return None;
        }
        let mut edges = 0;
        let (first, last) = self.polygon.extent(1)?;
        let clamp = |v: f64, axis: usize| {
            let (a, b) = (region.p[axis] / texel, (region.p[axis] + region.size) / texel - 1);
            ((v / t).floor() as i64).clamp(a, b)
        };
        for row in clamp(first, 1)..=clamp(last, 1) {
            let y = row * texel + texel / 2;
            let Some((from, to)) = self.polygon.row(y as f64, t) else { continue };
            for column in clamp(from, 0)..=clamp(to, 0) {
                let c = [column * texel + texel / 2, y];
                if region.lines.iter().any(|l| l.at(c) < 0) {
                    continue;
                }
                let (fits, empty) = own.fits(c);
                // those that a line crosses are counted with the line
                let whole = |l: &HalfPlane| l.at(c) >= (l.a.abs() + l.b.abs()) * (texel / 2);
                edges += u64::from(empty && region.lines.iter().all(whole));
                if !fits {
                    self.close.push(c);
                }
            }
            if self.close.len() > MOST_CLOSE {
                return None;
            }
        }
        Some(edges)
    }

    /// Like [`Self::all_fit`], without looking at each texel: what has to hold is linear where the distance of front and end
    /// is far from what rounding makes, so it holds for all texels there if it holds at the corners of that part. Only
    /// centres in the two strips between are looked at. None where some corner says no; the number is an estimate, by area.
    fn few_are_close(&mut self, region: Region<'_>, own: &TipPlane) -> Option<u64> {
        let texel = 1i64 << self.scale.subtexel_bits;
        let t = texel as f64;
        let TipPlane { gap: (dz, dx, dy), reach, eps, .. } = *own;
        // further from the ends of an interval than the plane may lie off its place between them
        let off = own.off(self.polygon.corners());
        let least = 4.0 * own.guard + 4.0 + (off + 3.0 * eps) / own.part.min(1.0 - own.part);
        let empty = reach - 1.0 - eps;
        if least > empty {
            return None;
        }
        // below the line where front and end meet there is only the region's margin
        if self.polygon.range(dz, dx, dy).0 < -0.5 * least {
            return None;
        }
        let part = &mut self.part;
        part.copy(&self.polygon);
        part.keep_plane(dx, dy, dz - reach - least);
        if !part.corners().iter().all(|p| own.keeps(*p, true)) {
            return None;
        }
        part.copy(&self.polygon);
        part.keep_plane(-dx, -dy, empty - dz);
        part.keep_plane(dx, dy, dz - least);
        if !part.corners().iter().all(|p| own.keeps(*p, false)) {
            return None;
        }
        region.lines.iter().for_each(|l| part.keep(l, -t / 2.0));
        let edges = (part.area() / (t * t)).round() as u64;
        let mut looked = 0;
        // along the axis across which the distance changes more
        let (u, v) = if dx.abs() > dy.abs() { (1, 0) } else { (0, 1) };
        let (along, across) = if v == 0 { (dy, dx) } else { (dx, dy) };
        for (low, high) in [(f64::NEG_INFINITY, least + 1.0), (empty - 1.0, reach + least + 1.0)] {
            part.copy(&self.polygon);
            part.keep_plane(-dx, -dy, high - dz);
            part.keep_plane(dx, dy, dz - low.max(-least));
            let (Some(rows), Some(columns)) = (part.extent(u), part.extent(v)) else { continue };
            if part.area() > MOST_STRIP * t * t {
                return None;
            }
            let index = |x: f64| (x - t / 2.0) / t;
            let (first, last) = (ceil(index(rows.0) - 1e-3), -ceil(-index(rows.1) - 1e-3));
            // the column where the strip begins in a row, and how much more it does so from row to row
            let begins = |row: i64| {
                let at = (row * texel + texel / 2) as f64;
                let ends = [low.max(-least), high].map(|g| (g - dz - along * at) / across);
                index(ends[0].min(ends[1])) - 1e-4
            };
            let width = ((high - low.max(-least)) / across / t).abs() + 2e-4;
            let all = strip(first, last, begins, -along / across, width, |row, column| {
                let mut c = [0; 2];
                (c[u], c[v]) = (row * texel + texel / 2, column * texel + texel / 2);
                let outside = (0..2).any(|i| c[i] < region.p[i] || c[i] > region.p[i] + region.size);
                let off = (c[v] as f64) < columns.0 - t || (c[v] as f64) > columns.1 + t;
                if !outside && !off && region.lines.iter().all(|l| l.at(c) >= 0) && !own.fits(c).0 {
                    self.close.push(c);
                }
                looked += 1;
                (self.close.len() <= MOST_CLOSE && looked <= 4 * MOST_CLOSE).then_some(())
            });
            if all.is_none() {
                self.close.clear();
                return None;
            }
        }
        Some(edges)
    }
}

/// Front, end and plane of a tip as linear functions, tile-relative.
struct TipPlane {
    front: (f64, f64, f64),
    end: (f64, f64, f64),
    plane: (f64, f64, f64),
    /// End less front.
    gap: (f64, f64, f64),
    /// What front and end rise within half a texel.
    rise: [f64; 2],
    /// Their sum.
    reach: f64,
    /// The share of the distance in front of the plane.
    part: f64,
    guard: f64,
    /// What rounding may make, and what faces of more triangles lie off.
    eps: f64,
}

fn at((z, sx, sy): (f64, f64, f64), p: [f64; 2]) -> f64 {
    z + sx * p[0] + sy * p[1]
}

impl TipPlane {
    fn new(search: &Search<'_>, tip: Tip, bend: f64) -> Self {
        let (f, e) = (&search.rays.locals[tip.front as usize], &search.rays.locals[tip.end as usize]);
        let half = search.scale.half();
        let rise = [f, e].map(|l| (l.sx.abs() + l.sy.abs()) * half);
        let (whole, part) = tip.plane.at(search.rays.corner, search.scale);
        let g = tip.plane.gradient(search.scale);
        let reach = rise[0] + rise[1];
        TipPlane {
            front: (f.z0, f.sx, f.sy),
            end: (e.z0, e.sx, e.sy),
            plane: (whole as f64 + part, g[0], g[1]),
            gap: (e.z0 - f.z0, e.sx - f.sx, e.sy - f.sy),
            rise,
            reach,
            part: if reach > 0.0 { (rise[0] / reach).clamp(0.002, 0.998) } else { 0.5 },
            guard: f64::from(search.guard),
            eps: 4.0 * (f.eps + e.eps) + (g[0].abs() + g[1].abs()) * 1e-7 + 0.01 + bend,
        }
    }

    /// Whether the plane is surely right for the texel with this centre, if that lies inside; whether its interval is empty.
    fn fits(&self, c: [i64; 2]) -> (bool, bool) {
        let c = c.map(|v| v as f64);
        let (front, end, p) = (at(self.front, c), at(self.end, c), at(self.plane, c));
        let room = (end - self.rise[1]) - (front + self.rise[0]);
        let (low, high, width, empty) = if room >= 2.0 + self.eps {
            (front + self.rise[0], end - self.rise[1], room, false)
        } else if room < -1.0 - self.eps {
            (front, end, end - front, true)
        } else {
            return (false, false);
        };
        let guard = if width >= 4.0 * self.guard - 2.0 { self.guard } else { 0.0 };
        (p - 2.0 - self.eps >= low + guard && p + self.eps <= high - guard, empty)
    }

    /// Whether the plane keeps the guard from front and end, with `reach` from what they rise in a texel, too.
    fn keeps(&self, p: [f64; 2], reach: bool) -> bool {
        let [h, k] = if reach { self.rise } else { [0.0; 2] };
        let z = at(self.plane, p);
        z - 2.0 - self.eps >= at(self.front, p) + h + self.guard && z + self.eps <= at(self.end, p) - k - self.guard
    }

    /// Most that the plane lies off its share of the distance, at some corners.
    fn off(&self, corners: &[[f64; 2]]) -> f64 {
        let off = |p: &[f64; 2]| {
            let gap = at(self.gap, *p) - 2.0 * self.guard - 4.0;
            (at(self.plane, *p) - at(self.front, *p) - self.guard - 3.0 - gap * self.part).abs()
        };
        corners.iter().map(off).fold(0.0, f64::max)
    }
}
