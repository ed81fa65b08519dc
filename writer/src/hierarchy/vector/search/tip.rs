//! Cells at silhouettes, where the front of a stretch and its end meet.

use super::{MOST_CLOSE, MOST_TIPS, Search, Tip};
use crate::hierarchy::vector::entry::Entry;
use crate::interval::Event;
use crate::interval::proof::{HalfPlane, Region};

impl Search<'_> {
    /// Whether the surface covers the part of the region, alone or with the flattest neighbour: then that one, and the most that
    /// it lies off this one's plane there, in depth.
    fn covers(&mut self, list: &[u32], region: &Region<'_>, i: u32, part: [f64; 3]) -> Option<(u32, f64)> {
        let l = &self.rays.locals[i as usize];
        if self.polygon.covered(&self.rays, l, region, 3, part) {
            return Some((i, 0.0));
        }
        for (k, mate) in (0u8..).zip(self.edges[l.index as usize].across).filter(|a| a.1 != u32::MAX) {
            let Some(other) = list.iter().copied().find(|n| self.rays.locals[*n as usize].index == mate) else {
                continue;
            };
            let m = &self.rays.locals[other as usize];
            let shared = self.edges[m.index as usize].across.iter().position(|b| *b == l.index);
            let Some(shared) = shared else { continue };
            if !self.polygon.covered(&self.rays, l, region, k, part)
                || !self.polygon.covered(&self.rays, m, region, shared as u8, part)
            {
                continue;
            }
            self.polygon.region(region);
            self.polygon.keep_plane(part[0], part[1], part[2]);
            let (low, high) = self.polygon.range(m.z0 - l.z0, m.sx - l.sx, m.sy - l.sy);
            return Some((other, low.abs().max(high.abs()) + m.eps + l.eps));
        }
        None
    }

    /// Whether, where front and end are close, the stretch of every ray begins at the one and ends at the other, or at their
    /// neighbours in the same faces: then how far these lie off the planes of the two, in depth.
    pub(super) fn is_tip(&mut self, list: &[u32], region: Region<'_>, tip: Tip) -> Option<f64> {
        let e = &self.rays.locals[tip.end as usize];
        let f = &self.rays.locals[tip.front as usize];
        let near = |far: f64| [f.sx - e.sx, f.sy - e.sy, far - (e.z0 - f.z0)];
        // a first guess without what the faces' neighbours add
        let part = near(1.2 * self.far(tip, 0.0));
        let (front, bend) = self.covers(list, &region, tip.front, part)?;
        let (end, more) = self.covers(list, &region, tip.end, part)?;
        let bend = bend + more;
        if 4.0 * bend > 0.2 * self.far(tip, 0.0) {
            return None;
        }
        let other_end = &self.rays.locals[end as usize];
        self.polygon.region(&region);
        self.polygon.keep_plane(part[0], part[1], part[2]);
        let between = self.polygon.range(e.z0 - f.z0, e.sx - f.sx, e.sy - f.sy).0;
        // the margin of the region reaches beyond the line where both meet
        let slack = (e.sx - f.sx).abs() + (e.sy - f.sy).abs() + 2.0 * (e.eps + f.eps);
        if between < -slack - bend {
            return None;
        }
        let part = near(self.far(tip, bend));
        let sound = list.iter().all(|i| {
            let t = &self.rays.locals[*i as usize];
            [tip.front, tip.end, front, end].contains(i)
                || t.event == Event::Wall
                || t.zmin > e.zmax.max(other_end.zmax)
                || (self.polygon.strictly_behind(t, e, &region, part)
                    && (end == tip.end || self.polygon.strictly_behind(t, other_end, &region, part)))
        });
        if !sound {
            return None;
        }
        // elsewhere as in any region
        let far = self.far_side(&region, tip, bend)?;
        let mut lines = region.lines.to_vec();
        lines.push(far);
        let region = Region { lines: &lines, ..region };
        self.polygon.region(&region);
        if self.polygon.extent(0).is_none() {
            return Some(bend);
        }
        let rest: Vec<u32> = list.iter().copied().filter(|i| self.reaches(*i, far)).collect();
        self.holds(Entry::Plane(tip.plane), &rest, region, false).then_some(bend)
    }

    /// Where front and end are at least [`Self::far`] apart in the region's square, and a little more.
    pub(super) fn far_side(&self, region: &Region<'_>, tip: Tip, bend: f64) -> Option<HalfPlane> {
        let (f, e) = (&self.rays.locals[tip.front as usize], &self.rays.locals[tip.end as usize]);
        let (dx, dy) = (e.sx - f.sx, e.sy - f.sy);
        let largest = dx.abs().max(dy.abs());
        // a normal of 2^24 keeps edge functions of a tile far below 2^62
        let by = 16777216.0 / largest;
        let offset = (e.z0 - f.z0 - self.far(tip, bend)) * by;
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
    /// by one.
    pub(super) fn tip_fits(&mut self, region: Region<'_>, tip: Tip, bend: f64) -> Option<u64> {
        let (f, e) = (&self.rays.locals[tip.front as usize], &self.rays.locals[tip.end as usize]);
        let half = self.scale.half();
        let (h, k) = ((f.sx.abs() + f.sy.abs()) * half, (e.sx.abs() + e.sy.abs()) * half);
        let guard = f64::from(self.guard);
        let (whole, part) = tip.plane.at(self.rays.corner, self.scale);
        let g = tip.plane.gradient(self.scale);
        let z = whole as f64 + part;
        let eps = 4.0 * (f.eps + e.eps) + (g[0].abs() + g[1].abs()) * 1e-7 + 0.01 + bend;

        let far = self.far(tip, bend);
        let (dz, dx, dy) = (e.z0 - f.z0, e.sx - f.sx, e.sy - f.sy);
        self.close.clear();
        let polygon = &mut self.polygon;
        polygon.region(&region);
        polygon.keep_plane(-dx, -dy, far - dz);
        let texel = 1i64 << self.scale.subtexel_bits;
        let t = texel as f64;
        if polygon.area() > MOST_TIPS * t * region.size as f64 {
            return None;
        }
        let mut edges = 0;
        let rows = polygon.extent(1);
        let Some((first, last)) = rows else { return Some(0) };
        let clamp = |v: f64, axis: usize| {
            let (a, b) = (region.p[axis] / texel, (region.p[axis] + region.size) / texel - 1);
            ((v / t).floor() as i64).clamp(a, b)
        };
        for row in clamp(first, 1)..=clamp(last, 1) {
            let y = row * texel + texel / 2;
            let Some((from, to)) = polygon.row(y as f64, t) else { continue };
            for column in clamp(from, 0)..=clamp(to, 0) {
                let c = [column * texel + texel / 2, y];
                if region.lines.iter().any(|l| l.at(c) < 0) {
                    continue;
                }
                let [x, y] = c.map(|v| v as f64);
                let front = f.z0 + f.sx * x + f.sy * y;
                let end = e.z0 + e.sx * x + e.sy * y;
                let p = z + g[0] * x + g[1] * y;
                let room = (end - k) - (front + h);
                let (low, high, width) = if room >= 2.0 + eps {
                    (front + h, end - k, room)
                } else if room < -1.0 - eps {
                    // those that a line crosses are counted with the line
                    let whole = |l: &HalfPlane| l.at(c) >= (l.a.abs() + l.b.abs()) * (texel / 2);
                    edges += u64::from(region.lines.iter().all(whole));
                    (front, end, end - front)
                } else {
                    self.close.push(c);
                    continue;
                };
                let guard = if width >= 4.0 * guard - 2.0 { guard } else { 0.0 };
                if p - 2.0 - eps < low + guard || p + eps > high - guard {
                    self.close.push(c);
                }
            }
            if self.close.len() > MOST_CLOSE {
                return None;
            }
        }
        let close = std::mem::take(&mut self.close);
        let right = close.iter().all(|c| self.keeps(Entry::Plane(tip.plane), c.map(|v| v - texel / 2)));
        self.close = close;
        right.then_some(edges)
    }
}
