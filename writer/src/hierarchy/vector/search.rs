//! One entry for a whole square, proven for every texel of it, or nothing.
//!
//! A square is answered by one constant or plane, or cut along silhouette edges into at most four cells with one each.
//!
//! Claim of [`Search::square`]: at every texel of the square the stored function's value lies in the texel's interval
//! (CONVENTIONS, Intervals: the area interval where it is not empty, else the centre's), and keeps the guard where that is wide.
//!
//! Argument. A cell's plane P is proven in one of two ways.
//! - *Slab*: [`Prover::prove_in`] gives sheared depths `low..=high` that are right on every ray of the cell. P lies at
//!   least its reach over half a texel inside them, so its value at a texel's centre is right on every ray of the texel that lies in
//!   the cell.
//! - *Tip*: on every ray of the cell the front f is met first, the end e of the stretch second, and nothing before or at e
//!   otherwise. So the texels inside the cell have the area interval from f's largest to e's smallest depth, which are
//!   linear. [`between`] is right for all of them, up to rounding; those where rounding may matter are looked at one by one.
//!
//! A texel that two cells share is an edge texel if on the border between them, somewhere inside it, one cell's stretch ends
//! before the other one's begins: then only its centre counts, and the centre's cell is told exactly. If both cells hold
//! the same entry and neither is a tip, that is right for all of the texel; so are two entries if each is proven for the other
//! cell, as far as such texels reach. Nothing else is accepted.
//!
//! What is true between the centres is told apart from this: module `continuous`.

mod continuous;

use umbrage_format::projection::UNCOVERED;

use super::entry::{Entry, EntryId, Line, OPEN, Palette, Plane, Scale, behind, between};
use super::segment::{border, clip_segment, clip_to_surface};
use crate::interval::proof::{HalfPlane, Polygon, Prover, Region};
use crate::interval::ray::{RayScratch, Rays, Stretch};
use crate::interval::triangle::Local;
use crate::interval::{Event, Interval, wide};

/// Most cuts of a square.
const MOST_CUTS: usize = 3;
/// Most surfaces of a square that is tried at all.
const PROOF_LIST: usize = 48;
/// Most surfaces of a square that is cut.
const CUT_LIST: usize = 32;
/// Maps up to here are so small that the root page holds most of them, where splits and masks can't refer to everything.
pub const SMALL_LOG2: u8 = 8;
/// Texels that are looked at one by one, for each texel of the square's side.
const MOST_TIPS: f64 = 12.0;

/// A line through a square.
#[derive(Clone, Copy)]
struct Cut {
    /// Inside of the surface whose edge it is.
    inside: HalfPlane,
    line: Line,
    /// Whether the surface lies beyond the line.
    beyond: bool,
}

/// A surface's edges.
#[derive(Clone, Copy, Debug)]
pub struct Edges {
    /// Those that bound the front of its solid, seen from the light: bits 0 to 2.
    pub silhouettes: u8,
    /// The surfaces behind the others, `u32::MAX` where there is none.
    pub across: [u32; 3],
}

/// A part of the square and what answers it.
struct Cell {
    /// Number of a cut, and whether the cell lies inside it.
    path: Vec<(usize, bool)>,
    list: Vec<u32>,
    entry: EntryId,
    value: Entry,
    tip: Option<Tip>,
}

#[derive(Clone, Copy)]
struct Tip {
    front: u32,
    end: u32,
    plane: Plane,
    /// Texels inside the region whose interval is empty.
    edges: u64,
    /// Up to this distance of front and end the stretch is known to begin and end there.
    far: f64,
    /// How far the stretch's ends may lie off the planes of the two, in depth.
    bend: f64,
}

/// Proves squares; owns the buffers.
pub struct Search<'a> {
    /// The surfaces of the tile.
    pub rays: Rays<'a>,
    /// Scale of the map.
    pub scale: Scale,
    /// Distance from the ends of wide intervals.
    pub guard: u32,
    /// What is known of each surface's edges.
    pub edges: &'a [Edges],
    /// Texels that were found to be edge texels, by the lines through them.
    pub edge_texels: u64,
    /// Whether squares are cut.
    pub lines: bool,
    prover: Prover,
    polygon: Polygon,
    cuts: Vec<Cut>,
    cells: Vec<Cell>,
    simple: Vec<EntryId>,
    ray: RayScratch,
    /// Places of rays, and their stretches.
    probes: Vec<([i64; 2], i64, i64)>,
}

impl<'a> Search<'a> {
    /// For one tile.
    pub fn new(rays: Rays<'a>, scale: Scale, guard: u32, edges: &'a [Edges]) -> Self {
        Search {
            rays,
            scale,
            guard,
            edges,
            edge_texels: 0,
            lines: scale.log2_resolution > SMALL_LOG2,
            prover: Prover::default(),
            polygon: Polygon::default(),
            cuts: Vec::new(),
            cells: Vec::new(),
            simple: Vec::new(),
            ray: RayScratch::default(),
            probes: Vec::new(),
        }
    }

    fn local(&self, i: u32) -> &Local {
        &self.rays.locals[i as usize]
    }

    /// An entry for the tile-relative square, and whether it is proven between the texels' centres, too; `list` holds the
    /// surfaces that overlap the square, sorted by solid. Entries of `above` are tried first, in this order.
    pub fn square(
        &mut self,
        palette: &mut Palette,
        list: &[u32],
        p: [i64; 2],
        size: i64,
        above: &[EntryId],
    ) -> Option<(EntryId, bool)> {
        if list.len() > PROOF_LIST {
            return None;
        }
        self.cuts.clear();
        self.cells.clear();
        self.simple.clear();
        for &id in above {
            palette.simple(id, &mut self.simple);
        }
        self.simple.truncate(6);
        let id = self.cell(palette, list, p, size, &mut Vec::new())?;
        if self.cells.len() > 1 && !self.sound(p, size) {
            return None;
        }
        self.edge_texels += self.cells.iter().filter_map(|c| c.tip).map(|t| t.edges).sum::<u64>();
        Some((id, self.is_proven(p, size)))
    }

    fn half_planes(&self, path: &[(usize, bool)]) -> Vec<HalfPlane> {
        path.iter()
            .map(|&(c, inside)| if inside { self.cuts[c].inside } else { self.cuts[c].inside.beyond() })
            .collect()
    }

    fn cell(
        &mut self,
        palette: &mut Palette,
        list: &[u32],
        p: [i64; 2],
        size: i64,
        path: &mut Vec<(usize, bool)>,
    ) -> Option<EntryId> {
        let lines = self.half_planes(path);
        let region = Region { p, size, lines: &lines, shear: [0.0; 2] };
        if let Some((entry, tip)) = self.simple(palette, list, region) {
            let value = palette.get(entry);
            self.cells.push(Cell { path: path.clone(), list: list.to_vec(), entry, value, tip });
            return Some(entry);
        }
        if !self.lines || path.len() >= MOST_CUTS || list.len() > CUT_LIST || self.cells.len() >= 4 {
            return None;
        }
        // one line alone: see NOTES.md
        for cut in self.candidates(list, region, 1, path) {
            let (cuts, cells) = (self.cuts.len(), self.cells.len());
            let number = match self.cuts.iter().position(|c| c.line == cut.line) {
                Some(n) => n,
                None => {
                    self.cuts.push(cut);
                    cuts
                }
            };
            let half = self.cuts[number].inside;
            let mut sides = [OPEN; 2];
            let mut whole = true;
            for (side, h) in [(1, half.beyond()), (0, half)] {
                let near: Vec<u32> = list.iter().copied().filter(|i| self.reaches(*i, h)).collect();
                path.push((number, side == 0));
                let id = self.cell(palette, &near, p, size, path);
                path.pop();
                match id {
                    Some(id) => sides[side] = id,
                    None => {
                        whole = false;
                        break;
                    }
                }
            }
            if whole {
                let [inside, outside] = sides;
                if inside == outside {
                    return Some(inside);
                }
                let line = palette.line(cut.line);
                let (near, beyond) = if self.cuts[number].beyond { (outside, inside) } else { (inside, outside) };
                return Some(palette.entry(Entry::Split { line, near, beyond }));
            }
            self.cuts.truncate(cuts);
            self.cells.truncate(cells);
        }
        None
    }

    /// Whether some of the surface lies in the open half-plane; exact.
    fn reaches(&self, i: u32, h: HalfPlane) -> bool {
        let s = &self.rays.surfaces[self.local(i).index as usize];
        (0..3).any(|k| h.wide([i64::from(s.x[k]) - self.rays.corner[0], i64::from(s.y[k]) - self.rays.corner[1]]) > 0)
    }

    /// Silhouette edges through the region, the one nearest to the light first.
    fn candidates(&mut self, list: &[u32], region: Region<'_>, most: usize, path: &[(usize, bool)]) -> Vec<Cut> {
        let mut found: Vec<(f64, Cut)> = Vec::new();
        for &i in list {
            let l = &self.rays.locals[i as usize];
            let edges = self.edges[l.index as usize].silhouettes;
            if edges == 0 || l.event != Event::Enter {
                continue;
            }
            for k in 0..3 {
                if edges >> k & 1 == 0 || (l.a[k] == 0 && l.b[k] == 0) {
                    continue;
                }
                let inside = HalfPlane { a: l.a[k], b: l.b[k], c: l.c[k] };
                let s = &self.rays.surfaces[l.index as usize];
                let corner = |j: usize| {
                    [0, 1].map(|a| i64::from(if a == 0 { s.x[j % 3] } else { s.y[j % 3] }) - self.rays.corner[a])
                };
                let ends = [corner(k), corner(k + 1)];
                let Some(part) = clip_segment(ends.map(|e| e.map(|v| v as f64)), &region) else { continue };
                let middle = [0, 1].map(|a| (part[0][a] + part[1][a]) / 2.0);
                let z = l.z0 + l.sx * middle[0] + l.sy * middle[1];
                let absolute = ends.map(|e| [e[0] + self.rays.corner[0], e[1] + self.rays.corner[1]]);
                // the same whichever triangle it comes from
                let [a, b] = if absolute[0] < absolute[1] { absolute } else { [absolute[1], absolute[0]] };
                let Some(line) = Line::through(a, b, self.scale) else { continue };
                if found.iter().any(|f| f.1.line == line) || path.iter().any(|c| self.cuts[c.0].line == line) {
                    continue;
                }
                let beyond = if line.axis { inside.a > 0 } else { inside.b > 0 };
                found.push((z, Cut { inside, line, beyond }));
            }
        }
        found.sort_by(|a, b| a.0.total_cmp(&b.0));
        found.truncate(most);
        found.into_iter().map(|f| f.1).collect()
    }

    /// One constant or plane for the whole region.
    fn simple(&mut self, palette: &mut Palette, list: &[u32], region: Region<'_>) -> Option<(EntryId, Option<Tip>)> {
        if list.iter().all(|i| self.local(*i).event == Event::Wall) {
            return Some((OPEN, None));
        }
        let sample = self.prover.sample(&region)?;
        let front = self.front(list, sample)?;
        if !self.probe(list, region, sample) {
            return None;
        }
        for n in 0..self.simple.len() {
            let id = self.simple[n];
            if id != OPEN && self.passes(palette.get(id)) && self.holds(palette.get(id), list, region) {
                return Some((id, None));
            }
        }
        let texel = 1i64 << self.scale.subtexel_bits;
        let surface = self.rays.surfaces[self.local(front).index as usize];
        let close = list.len() <= 16;
        let plane = behind(&surface, self.guard, self.scale);
        if let Some(plane) = plane.filter(|p| region.size > texel && self.may_slope(p)) {
            let Region { p, size, lines, .. } = region;
            let sheared = Region { p, size, lines, shear: plane.gradient(self.scale) };
            if let Some(range) = self.prover.prove_in(&self.rays, list, sheared, self.rays.second_surface, close) {
                if self.fits(&plane, range) {
                    let id = palette.entry(Entry::Plane(plane));
                    self.remember(id);
                    return Some((id, None));
                }
                if let Some(own) = self.fitted(&plane, range) {
                    return Some((palette.entry(Entry::Plane(own)), None));
                }
            }
        }
        if self.may_be_level()
            && let Some((low, high)) = self.prover.prove_in(&self.rays, list, region, self.rays.second_surface, close)
            && let Some(v) = self.constant(low, high)
        {
            return Some((palette.entry(Entry::Constant(v)), None));
        }
        // a slope between that of the front and that of the end of the stretch
        if let Some(end) = self.end(list, sample, front) {
            let ends = self.rays.surfaces[self.local(end).index as usize];
            if let Some(plane) = between(&surface, &ends, self.guard, self.scale) {
                let Region { p, size, lines, .. } = region;
                let sheared = Region { p, size, lines, shear: plane.gradient(self.scale) };
                if self.may_slope(&plane)
                    && let Some(range) =
                        self.prover.prove_in(&self.rays, list, sheared, self.rays.second_surface, close)
                {
                    if self.fits(&plane, range) {
                        return Some((palette.entry(Entry::Plane(plane)), None));
                    }
                    if let Some(own) = self.fitted(&plane, range) {
                        return Some((palette.entry(Entry::Plane(own)), None));
                    }
                }
                let mut tip = Tip { front, end, plane, edges: 0, far: 0.0, bend: 0.0 };
                if let Some(bend) = self.is_tip(list, region, tip)
                    && let Some(edges) = self.tip_fits(region, tip, bend)
                {
                    tip.edges = edges;
                    (tip.far, tip.bend) = (self.far(tip, bend), bend);
                    return Some((palette.entry(Entry::Plane(plane)), Some(tip)));
                }
            }
        }
        None
    }

    /// Casts rays at the sample and, in a whole square, at its corners; false where one of them meets nothing.
    fn probe(&mut self, list: &[u32], region: Region<'_>, sample: [i64; 2]) -> bool {
        self.probes.clear();
        let (p, far) = (region.p, region.p.map(|v| v + region.size));
        let corners = [(p, [1, 1]), ([far[0], p[1]], [-1, 1]), ([p[0], far[1]], [1, -1]), (far, [-1, -1])];
        let corners = if region.lines.is_empty() { &corners[..] } else { &[] };
        for (q, d) in [(sample, [1, 1])].iter().chain(corners) {
            match self.rays.stretch(list, *q, *d, &mut self.ray) {
                Stretch::Uncovered => return false,
                Stretch::Covered { lo, hi } => self.probes.push((*q, lo, hi)),
            }
        }
        true
    }

    /// Whether an entry is right on the rays of the probe.
    fn passes(&self, entry: Entry) -> bool {
        self.probes.iter().all(|(q, lo, hi)| {
            let v = match entry {
                Entry::Constant(v) => i64::from(v),
                Entry::Plane(plane) => plane.at([q[0] + self.rays.corner[0], q[1] + self.rays.corner[1]], self.scale).0,
                _ => return false,
            };
            lo - 1 <= v && v < *hi
        })
    }

    /// Whether the probe's rays leave room for a plane of this slope.
    fn may_slope(&self, plane: &Plane) -> bool {
        let [sx, sy] = plane.gradient(self.scale);
        let (mut low, mut high) = (f64::NEG_INFINITY, f64::INFINITY);
        for (q, lo, hi) in &self.probes {
            let lift = sx * q[0] as f64 + sy * q[1] as f64;
            low = low.max(*lo as f64 - 1.0 - lift);
            high = high.min(*hi as f64 - lift);
        }
        low <= high
    }

    fn may_be_level(&self) -> bool {
        let low = self.probes.iter().map(|p| p.1).max();
        low < self.probes.iter().map(|p| p.2).min()
    }

    /// Tries it first in the cells and squares to come.
    fn remember(&mut self, id: EntryId) {
        if !self.simple.contains(&id) {
            self.simple.push(id);
        }
    }

    /// The entering surface that the ray at the point meets first.
    fn front(&self, list: &[u32], p: [i64; 2]) -> Option<u32> {
        let met = list.iter().copied().filter(|i| {
            let l = self.local(*i);
            l.event == Event::Enter && l.covers(p[0], p[1], 1, 1)
        });
        met.min_by(|a, b| {
            let z = |i: u32| self.local(i).approximate(p[0], p[1]);
            z(*a).total_cmp(&z(*b))
        })
    }

    /// The surface at which the ray leaves the front's solid first, or the second surface.
    fn end(&self, list: &[u32], p: [i64; 2], front: u32) -> Option<u32> {
        let f = self.local(front);
        let met = list.iter().copied().filter(|i| {
            let l = self.local(*i);
            let right = if self.rays.second_surface {
                *i != front && l.event != Event::Wall
            } else {
                l.event == Event::Leave && l.solid == f.solid
            };
            right && l.covers(p[0], p[1], 1, 1)
        });
        met.min_by(|a, b| {
            let z = |i: u32| self.local(i).approximate(p[0], p[1]);
            z(*a).total_cmp(&z(*b))
        })
    }

    /// Whether a stored entry is right all over the region.
    fn holds(&mut self, entry: Entry, list: &[u32], region: Region<'_>) -> bool {
        let close = list.len() <= 12;
        match entry {
            Entry::Constant(UNCOVERED) => false,
            Entry::Constant(v) => {
                let range = self.prover.prove_in(&self.rays, list, region, self.rays.second_surface, close);
                let guard = i64::from(self.guard);
                range.is_some_and(|(low, high)| {
                    low + guard <= i64::from(v)
                        && i64::from(v) <= high - guard
                        && (high - low) as u64 >= wide(self.guard)
                })
            }
            Entry::Plane(plane) => {
                let Region { p, size, lines, .. } = region;
                let sheared = Region { p, size, lines, shear: plane.gradient(self.scale) };
                let range = self.prover.prove_in(&self.rays, list, sheared, self.rays.second_surface, close);
                range.is_some_and(|range| self.fits(&plane, range))
            }
            _ => false,
        }
    }

    /// What `prove_in` says of a plane's own shear leaves room for the texels' reach, pages' rounding and the guard.
    fn fits(&self, plane: &Plane, (low, high): (i64, i64)) -> bool {
        let (whole, _) = plane.at(self.rays.corner, self.scale);
        let margin = plane.reach(self.scale).ceil() as i64 + i64::from(self.guard);
        low + margin + 2 <= whole && whole + 1 + margin <= high
    }

    /// The plane of the same slope in the middle, if there is room.
    fn fitted(&self, plane: &Plane, (low, high): (i64, i64)) -> Option<Plane> {
        let margin = plane.reach(self.scale).ceil() as i64 + i64::from(self.guard);
        let (low, high) = (low + margin + 2, high - margin - 1);
        let (whole, _) = plane.at(self.rays.corner, self.scale);
        (low <= high).then(|| Plane { offset: plane.offset + (low + (high - low) / 2 - whole), ..*plane })
    }

    /// The value with the fewest significant bits that keeps the guard.
    pub fn constant(&self, low: i64, high: i64) -> Option<u32> {
        let low = u32::try_from(low).ok()?;
        let high = u32::try_from(high).ok()?;
        let interval = Interval { min: low, max: high };
        if interval.width() < wide(self.guard) {
            return None;
        }
        Some(fewest_bits(interval.guarded(self.guard)))
    }

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
    fn is_tip(&mut self, list: &[u32], region: Region<'_>, tip: Tip) -> Option<f64> {
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
        let far = HalfPlane { a: a as i64, b: b as i64, c: c as i64 };
        let mut lines = region.lines.to_vec();
        lines.push(far);
        let region = Region { lines: &lines, ..region };
        self.polygon.region(&region);
        if self.polygon.extent(0).is_none() {
            return Some(bend);
        }
        let rest: Vec<u32> = list.iter().copied().filter(|i| self.reaches(*i, far)).collect();
        self.holds(Entry::Plane(tip.plane), &rest, region).then_some(bend)
    }

    /// The distance of front and end from which on everything is linear and far from rounding.
    fn far(&self, tip: Tip, bend: f64) -> f64 {
        let (f, e) = (&self.rays.locals[tip.front as usize], &self.rays.locals[tip.end as usize]);
        let reach = (f.sx.abs() + f.sy.abs() + e.sx.abs() + e.sy.abs()) * self.scale.half();
        // from twice the reach on the plane keeps its own reach from both, and the rounding of a gradient over a long face
        // does no harm
        2.2 * reach + 4.0 * f64::from(self.guard) + 10.0 + 4.0 * bend
    }

    /// Whether the tip's plane is right where front and end are close: for every texel inside the region, and for the
    /// centres of those that are not inside, or have an empty interval.
    fn tip_fits(&mut self, region: Region<'_>, tip: Tip, bend: f64) -> Option<u64> {
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
                    return None;
                };
                let guard = if width >= 4.0 * guard - 2.0 { guard } else { 0.0 };
                if p - 2.0 - eps < low + guard || p + eps > high - guard {
                    return None;
                }
            }
        }
        Some(edges)
    }

    /// Whether all cells fit together, and every centre is told to be in the right one.
    fn sound(&mut self, p: [i64; 2], size: i64) -> bool {
        for i in 0..self.cells.len() {
            for j in i + 1..self.cells.len() {
                // a tip's plane is right for texels that lie inside its cell, and for centres of edge texels
                let (a, b) = (&self.cells[i], &self.cells[j]);
                let same = a.entry == b.entry && a.tip.is_none() && b.tip.is_none();
                if !same && !self.apart(i, j, p, size) {
                    return false;
                }
            }
        }
        let mut edges = 0;
        for n in 0..self.cuts.len() {
            match self.told(n, p, size) {
                Some(texels) => edges += texels,
                None => return false,
            }
        }
        self.edge_texels += edges;
        true
    }

    /// Whether every texel that both cells share has an empty area interval, or is shared with a border of no length.
    fn apart(&mut self, i: usize, j: usize, p: [i64; 2], size: i64) -> bool {
        let (a, b) = (&self.cells[i], &self.cells[j]);
        let Some(at) = a.path.iter().zip(&b.path).position(|(x, y)| x != y) else { return false };
        let (cut, _) = a.path[at];
        let mut lines = Vec::new();
        for cell in [a, b] {
            let others: Vec<(usize, bool)> = cell.path.iter().copied().filter(|x| x.0 != cut).collect();
            lines.extend(self.half_planes(&others));
        }
        let region = Region { p, size, lines: &lines, shear: [0.0; 2] };
        let Some(border) = border(&self.cuts[cut].inside, &region) else { return true };
        let ends_before = |tip: &Cell, other: &Cell| {
            let Some(t) = tip.tip else { return false };
            let e = &self.rays.locals[t.end as usize];
            let f = &self.rays.locals[t.front as usize];
            let apart = |q: &[f64; 2]| (e.z0 - f.z0) + (e.sx - f.sx) * q[0] + (e.sy - f.sy) * q[1];
            // further away the stretch may go on behind the end
            if border.iter().any(|q| apart(q) > t.far) {
                return false;
            }
            let mates = self.edges[e.index as usize].across;
            let ends = tip.list.iter().map(|n| &self.rays.locals[*n as usize]).filter(|l| mates.contains(&l.index));
            let ends: Vec<&Local> = ends.chain([e]).collect();
            other.list.iter().all(|n| {
                ends.iter().all(|e| {
                    let l = &self.rays.locals[*n as usize];
                    if l.event == Event::Wall || l.zmin > e.zmax {
                        return true;
                    }
                    let Some(part) = clip_to_surface(border, l) else { return true };
                    let slack = 2.0 * (l.eps + e.eps) + 0.01 + ((l.sx - e.sx).abs() + (l.sy - e.sy).abs()) * 0.01;
                    part.iter().all(|q| {
                        let d = (l.z0 - e.z0) + (l.sx - e.sx) * q[0] + (l.sy - e.sy) * q[1];
                        d >= slack
                    })
                })
            })
        };
        ends_before(a, b) || ends_before(b, a) || self.meets(i, j, cut, p, size)
    }

    /// Whether each of two cells' entries is right in the other cell, too, as far as a texel on their border reaches.
    fn meets(&mut self, i: usize, j: usize, cut: usize, p: [i64; 2], size: i64) -> bool {
        let HalfPlane { a, b, c } = self.cuts[cut].inside;
        let far = (a.abs() + b.abs()) << self.scale.subtexel_bits;
        [(i, j), (j, i)].into_iter().all(|(own, other)| {
            let cell = &self.cells[own];
            let inside = cell.path.contains(&(cut, true));
            let strip = if inside { HalfPlane { a: -a, b: -b, c: far - c } } else { HalfPlane { a, b, c: c + far } };
            let mut lines = self.half_planes(&cell.path);
            lines.push(strip);
            let list: Vec<u32> = cell.list.iter().copied().filter(|n| self.reaches(*n, strip)).collect();
            let region = Region { p, size, lines: &lines, shear: [0.0; 2] };
            let entry = self.cells[other].value;
            self.holds(entry, &list, region)
        })
    }

    /// Whether the stored line tells the side of every texel centre of the square as the exact one does, with room for
    /// the rounding of pages; the number of texels that it crosses.
    fn told(&self, cut: usize, p: [i64; 2], size: i64) -> Option<u64> {
        let Cut { inside, line, beyond } = self.cuts[cut];
        let (u, t) = if line.axis { (1, 0) } else { (0, 1) };
        let bits = self.scale.subtexel_bits;
        let texel = 1i64 << bits;
        let corner = self.rays.corner.map(|c| c >> bits);
        let (first, count) = (p.map(|v| v >> bits), size >> bits);
        let mut crossed = 0;
        for n in first[u]..first[u] + count {
            let place = (corner[u] + n) * 256;
            let boundary = line.boundary(place + 128) - (corner[t] << 20);
            // the first centre at or beyond the boundary: T = 2^20 t + 2^19
            let at = (boundary - (1 << 19) + (1 << 20) - 1) >> 20;
            let edge = (line.boundary(place) - (corner[t] << 20)) >> 20;
            let next = (line.boundary(place + 256) - (corner[t] << 20)) >> 20;
            let (low, high) = (edge.min(next).max(first[t]), edge.max(next).min(first[t] + count - 1));
            crossed += (high - low + 1).max(0) as u64;
            for (c, is_beyond) in [(at, true), (at - 1, false)] {
                if c < first[t] || c >= first[t] + count {
                    continue;
                }
                let room = ((c << 20) + (1 << 19) - boundary).abs();
                let mut q = [0; 2];
                q[u] = n * texel + texel / 2;
                q[t] = c * texel + texel / 2;
                let side = inside.at(q);
                if room < 4 || side == 0 || (side > 0) != (is_beyond == beyond) {
                    return None;
                }
            }
            // nothing of the line in this column: the side of any centre must still be right
            if at < first[t] || at > first[t] + count {
                let c = if at < first[t] { first[t] } else { first[t] + count - 1 };
                let mut q = [0; 2];
                q[u] = n * texel + texel / 2;
                q[t] = c * texel + texel / 2;
                let side = inside.at(q);
                if side == 0 || (side > 0) != ((c >= at) == beyond) {
                    return None;
                }
            }
        }
        Some(crossed)
    }

    /// Planes of the surfaces that rays at the texel's centre meet, for masks: behind the front, and between front and end.
    pub fn guesses(&self, list: &[u32], centre: [i64; 2]) -> [Option<Plane>; 2] {
        let Some(front) = self.front(list, centre) else { return [None; 2] };
        let f = &self.rays.surfaces[self.local(front).index as usize];
        let e = self.end(list, centre, front).map(|e| &self.rays.surfaces[self.local(e).index as usize]);
        [behind(f, self.guard, self.scale), e.and_then(|e| between(f, e, self.guard, self.scale))]
    }

    /// Silhouette edges through the square.
    pub fn silhouettes(&mut self, list: &[u32], p: [i64; 2], size: i64, most: usize) -> Vec<Line> {
        self.candidates(list, Region::square(p, size), most, &[]).into_iter().map(|c| c.line).collect()
    }
}

/// The value of the interval that ends in the most zero bits.
pub fn fewest_bits(interval: Interval) -> u32 {
    let (min, max) = (interval.min, interval.max);
    if min == max {
        return min;
    }
    // the highest bit in which they differ: with all lower bits zero, max is above min
    let top = 31 - (min ^ max).leading_zeros();
    let v = max >> top << top;
    if min & ((1u32 << top) - 1) == 0 && min.trailing_zeros() > top { min } else { v }
}
