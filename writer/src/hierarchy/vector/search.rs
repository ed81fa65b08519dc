//! One entry for a whole square, proven for every texel of it, or nothing.
//!
//! A square is answered by one constant or plane, or cut along silhouette edges, else along edges between two faces of the
//! front or the end, into a few cells with one each.
//!
//! Claim of [`Search::square`]: at every texel of the square the stored function's value lies in the texel's interval
//! (CONVENTIONS, Intervals: the area interval where it is not empty, else the centre's), and keeps the guard where that is wide;
//! but for the one texel that [`Search::exception`] names, which the caller stores apart.
//!
//! Argument. A cell's plane P is proven in one of two ways.
//! - *Slab*: [`Prover::prove_in`] gives sheared depths `low..=high` that are right on every ray of the cell. P lies at
//!   least its reach over half a texel inside them, so its value at a texel's centre is right on every ray of the texel that lies in
//!   the cell.
//! - *Tip*: on every ray of the cell the front f is met first, the end e of the stretch second, and nothing before or at e
//!   otherwise. So the texels inside the cell have the area interval from f's largest to e's smallest depth, which are
//!   linear. [`between`] is right for all of them, up to rounding; those where rounding may matter are looked at one by one,
//!   and the plane is moved where that is right for all of them.
//!
//! A texel that two cells share is an edge texel if on the border between them, somewhere inside it, one cell's stretch ends
//! before the other one's begins: then only its centre counts, and the centre's cell is told exactly. (A texel may hold parts of
//! two cells and nothing of their border: a third one between them may be narrower than it.) If both cells hold
//! the same entry and neither is a tip, that is right for all of the texel; so are two entries if each is proven for the other
//! cell, as far as texels with their centres on the other side reach (`holds`, `holds_across`), where front and end of a tip are
//! far from each other. All other texels that two cells share, and those of a tip that rounding may reach, are looked at one by
//! one: what is stored must lie in their exact intervals.
//!
//! What is true between the centres is told apart from this: module `continuous`.

mod borders;
mod continuous;
mod cuts;
mod strip;
mod tip;

use rustc_hash::FxHashMap as HashMap;
use umbrage_format::projection::UNCOVERED;

use super::entry::{Entry, EntryId, Line, OPEN, Palette, Plane, Scale, behind, between};
use crate::interval::proof::{HalfPlane, Polygon, Prover, Region};
use crate::interval::ray::{RayScratch, Rays, Stretch};
use crate::interval::texel::Scratch;
use crate::interval::triangle::{Local, Surface};
use crate::interval::{Event, Interval, wide};

/// Most cuts of a square.
const MOST_CUTS: usize = 4;
/// Most surfaces of a square that is tried at all.
const PROOF_LIST: usize = 256;
/// Intervals of texels that are kept.
const MOST_INTERVALS: usize = 1 << 14;
/// Most surfaces among which proofs for a new entry look closely.
const CLOSE_LIST: usize = 16;
/// Most surfaces of a square that is cut.
const CUT_LIST: usize = 64;
/// Maps up to here are so small that the root page holds most of them, where splits and masks can't refer to everything.
pub const SMALL_LOG2: u8 = 8;
/// Edges between faces of which cuts are tried.
const MOST_CREASES: usize = 1;
/// Side, in powers of two of texels, of squares that are looked at texel by texel where nothing answers them.
pub const BLOCK_LEVEL: u8 = 2;
/// Most words that the new entries of a square of this level may take, if it is cut: dividing it takes about as much.
const PRICES: [u32; 5] = [4, 4, 4, 6, 12];
/// Texels on borders of cells that are looked at one by one, for each texel of the square's side.
const DOUBTS: usize = 4;
/// Texels of a tip that are looked at one by one because rounding may matter.
const MOST_CLOSE: usize = 32;
/// Side of squares, in texels, from which on the texels of a tip are not looked at one after the other.
const MANY_TEXELS: i64 = 32;
/// Side of squares, in texels, from which on the columns of texels at a line are not looked at one after the other.
const MANY_COLUMNS: i64 = 32;
/// Area of a strip, in texels, whose centres are looked at one by one.
const MOST_STRIP: f64 = 64.0;
/// Difference of two faces' slopes, as a share of them, from which on the edge between them counts.
const BEND: f64 = 0.05;
/// Facts that are tried.
const MOST_FACTS: usize = 24;
/// Most that a tip's plane is moved for single texels, in depth.
const MOST_MOVED: i64 = 16;
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
    /// Whether another face of the solid goes on behind the edge.
    crease: bool,
}

/// A surface's edges.
#[derive(Clone, Copy, Debug)]
pub struct Edges {
    /// Those that bound the front of its solid, seen from the light: bits 0 to 2.
    pub silhouettes: u8,
    /// The surfaces behind the others, `u32::MAX` where there is none.
    pub across: [u32; 3],
    /// The steepest of these, and of those of other triangles in the same face: depth per lattice step, both axes together.
    pub beside: f64,
    /// The largest triangle of the face, itself or another one: all have the planes of this one.
    pub face: u32,
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

/// A constant or plane that is proven for the part of a square inside some half-planes.
struct Fact {
    lines: Vec<HalfPlane>,
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
    /// Corner of a texel with its centre in the region for which the plane is wrong.
    excepted: Option<[i64; 2]>,
    /// The end's neighbour in the same face, or the end.
    mate: u32,
    /// Up to this distance of front and end the stretch is known to begin at the one and to end at the other or its mate.
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
    /// Texels that were looked at one by one.
    pub looked: u64,
    /// Whether squares are cut.
    pub lines: bool,
    prover: Prover,
    polygon: Polygon,
    /// A part of it.
    part: Polygon,
    cuts: Vec<Cut>,
    cells: Vec<Cell>,
    simple: Vec<EntryId>,
    facts: Vec<Fact>,
    ray: RayScratch,
    /// Places of rays, and their stretches.
    probes: Vec<([i64; 2], i64, i64)>,
    /// Places of rays, and the sides of edges that they take.
    places: Vec<([i64; 2], [i64; 2])>,
    inner: Vec<[i64; 2]>,
    /// Texels that are looked at one by one.
    doubtful: Vec<[i64; 2]>,
    close: Vec<[i64; 2]>,
    /// Whether the square's entry may be wrong for one texel.
    may_except: bool,
    /// Corner of that texel.
    excepted: Option<[i64; 2]>,
    near: Vec<u32>,
    /// Which of the tile's surfaces cover the square, of those in its list.
    covers: Vec<bool>,
    /// Those of a list.
    whole: Vec<u32>,
    /// Intervals of texels that were looked at one by one: the squares around ask for them again.
    intervals: HashMap<[i64; 2], Interval>,
    /// The square's surfaces.
    list: Vec<u32>,
    scratch: Scratch,
}

impl<'a> Search<'a> {
    /// For one tile.
    pub fn new(rays: Rays<'a>, scale: Scale, guard: u32, edges: &'a [Edges]) -> Self {
        let covers = vec![false; rays.locals.len()];
        Search {
            rays,
            scale,
            guard,
            edges,
            edge_texels: 0,
            looked: 0,
            lines: scale.log2_resolution > SMALL_LOG2,
            prover: Prover::default(),
            polygon: Polygon::default(),
            part: Polygon::default(),
            cuts: Vec::new(),
            cells: Vec::new(),
            simple: Vec::new(),
            facts: Vec::new(),
            ray: RayScratch::default(),
            probes: Vec::new(),
            places: Vec::new(),
            inner: Vec::new(),
            doubtful: Vec::new(),
            close: Vec::new(),
            may_except: false,
            excepted: None,
            near: Vec::new(),
            covers,
            whole: Vec::new(),
            intervals: HashMap::default(),
            list: Vec::new(),
            scratch: Scratch::default(),
        }
    }

    fn local(&self, i: u32) -> &Local {
        &self.rays.locals[i as usize]
    }

    /// How many facts are known.
    pub fn facts(&self) -> usize {
        self.facts.len()
    }

    /// Forgets all facts but the first `count`: before a square that does not lie in those that they are about.
    pub fn forget(&mut self, count: usize) {
        self.facts.truncate(count);
    }

    /// An entry for the tile-relative square, and whether it is proven between the texels' centres, too; `list` holds the
    /// surfaces that overlap the square, sorted by solid, and `over` which of them cover all of it. Entries of `above` are tried
    /// first, in this order. Where there is none, what was proven of parts of the square is kept for squares in it.
    /// With `may_except` the entry may be wrong for one texel, which [`Self::exception`] tells.
    pub fn square(
        &mut self,
        palette: &mut Palette,
        (list, over): (&[u32], &[bool]),
        p: [i64; 2],
        size: i64,
        above: &[EntryId],
        may_except: bool,
    ) -> Option<(EntryId, bool)> {
        (self.may_except, self.excepted) = (may_except, None);
        list.iter().zip(over).for_each(|(i, over)| self.covers[*i as usize] = *over);
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
        self.list.clear();
        self.list.extend_from_slice(list);
        let (mark, facts) = (palette.mark(), self.facts.len());
        let id = self.cell(palette, list, p, size, &mut Vec::new());
        let level = (size >> self.scale.subtexel_bits).trailing_zeros() as usize;
        let id = id.filter(|id| {
            (0..self.cells.len()).all(|n| self.cells[n].tip.and_then(|t| t.excepted).is_none_or(|q| self.except(q)))
                && (self.cells.len() == 1
                    || (palette.price(*id, mark) <= PRICES.get(level).copied().unwrap_or(u32::MAX)
                        && self.sound(palette, *id, p, size)))
        });
        let Some(id) = id else {
            palette.back(mark);
            return None;
        };
        self.facts.truncate(facts);
        self.edge_texels += self.cells.iter().filter_map(|c| c.tip).map(|t| t.edges).sum::<u64>();
        Some((id, self.is_proven(p, size)))
    }

    /// Whether the entry may be wrong for a texel: for one it may.
    fn except(&mut self, q: [i64; 2]) -> bool {
        let free = self.may_except && self.excepted.is_none();
        if free {
            self.excepted = Some(q);
        }
        free || self.excepted == Some(q)
    }

    /// Corner of the texel for which the entry of the last square is wrong, and a value that is right.
    pub fn exception(&mut self, palette: &Palette) -> Option<([i64; 2], u32)> {
        let q = self.excepted?;
        Some((q, known(palette, self.interval(q))))
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
        let known = self.known(palette, region);
        if let Some((entry, tip)) = known.or_else(|| self.simple(palette, list, region)) {
            let value = palette.get(entry);
            if known.is_none() && entry != OPEN {
                self.facts.push(Fact { lines: lines.clone(), value, tip });
            }
            self.cells.push(Cell { path: path.clone(), list: list.to_vec(), entry, value, tip });
            return Some(entry);
        }
        let level = (size >> self.scale.subtexel_bits).trailing_zeros() as u8;
        let most_cuts = if level <= BLOCK_LEVEL { 1 } else { MOST_CUTS };
        if !self.lines || path.len() >= most_cuts || list.len() > CUT_LIST || self.cells.len() >= 6 {
            return None;
        }
        let candidates = self.candidates(list, region, path);
        if path.is_empty() && self.is_crowded(list, &candidates, p, size) {
            return None;
        }
        // one line alone: see NOTES.md
        let mut cuts: Vec<Cut> = candidates.into_iter().take(1).map(|c| c.cut).collect();
        if cuts.is_empty() && level > BLOCK_LEVEL {
            cuts = self.creases(list, region, path);
        }
        for cut in cuts {
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
                let mut near = Vec::with_capacity(list.len());
                near.extend(list.iter().copied().filter(|i| self.reaches(*i, h)));
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

    /// What is known of squares around, if it answers the whole region.
    fn known(&mut self, palette: &mut Palette, region: Region<'_>) -> Option<(EntryId, Option<Tip>)> {
        let Region { p, size, lines, .. } = region;
        for n in (0..self.facts.len()).rev().take(MOST_FACTS) {
            let fact = &self.facts[n];
            let within = |h: &HalfPlane| lines.contains(h) || h.at(p) + (h.a.min(0) + h.b.min(0)) * size >= 0;
            if !fact.lines.iter().all(within) {
                continue;
            }
            let (value, tip) = (fact.value, fact.tip);
            match tip {
                None => return Some((palette.entry(value), None)),
                Some(tip) => {
                    if let Some(tip) = self.tip_fits(region, tip, self.may_except) {
                        return Some((palette.entry(value), Some(tip)));
                    }
                }
            }
        }
        None
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
            if id != OPEN && self.passes(palette.get(id)) && self.holds(palette.get(id), list, region, true) {
                return Some((id, None));
            }
        }
        let texel = 1i64 << self.scale.subtexel_bits;
        let close = list.len() <= CLOSE_LIST;
        let plane = self.behind(front);
        if let Some(plane) = plane.filter(|_| region.size > texel)
            && let Some(found) = self.sloped(palette, list, region, &plane)
        {
            let id = palette.entry(Entry::Plane(found));
            if found == plane {
                self.remember(id);
            }
            return Some((id, None));
        }
        if self.may_be_level()
            && let window = Some(self.window([0.0; 2]))
            && let Some((low, high)) =
                self.prover.prove_in(&self.rays, list, &self.covers, region, self.rays.second_surface, close, window)
            && let Some(v) = self.constant(palette, low, high)
        {
            return Some((palette.entry(Entry::Constant(v)), None));
        }
        // a slope between that of the front and that of the end of the stretch
        if let Some(end) = self.end(list, sample, front)
            && let Some(plane) = between(self.face(front), self.face(end), self.guard, self.scale)
        {
            if let Some(found) = self.sloped(palette, list, region, &plane) {
                return Some((palette.entry(Entry::Plane(found)), None));
            }
            if self.may_be_tip(&plane)
                && let Some(tip) = self.tip(palette, list, region, (front, end), plane)
            {
                return Some((palette.entry(Entry::Plane(tip.plane)), Some(tip)));
            }
        }
        None
    }

    /// This plane, or one of its slope, if it is right all over the region; after [`Self::probe`].
    fn sloped(&mut self, palette: &Palette, list: &[u32], region: Region<'_>, plane: &Plane) -> Option<Plane> {
        let sheared = Region { shear: plane.gradient(self.scale), ..region };
        let window = self.window(sheared.shear);
        if !self.may_slope(plane) || !self.has_room(plane, window) {
            return None;
        }
        let (second, close) = (self.rays.second_surface, list.len() <= CLOSE_LIST);
        let range = self.prover.prove_in(&self.rays, list, &self.covers, sheared, second, close, Some(window))?;
        if self.fits(plane, range) { Some(*plane) } else { self.fitted(palette, plane, range) }
    }

    /// Casts rays at the sample and, in a whole square, at its corners; false where one of them meets nothing.
    fn probe(&mut self, list: &[u32], region: Region<'_>, sample: [i64; 2]) -> bool {
        self.probes.clear();
        let (p, far) = (region.p, region.p.map(|v| v + region.size));
        let corners = [(p, [1, 1]), ([far[0], p[1]], [-1, 1]), ([p[0], far[1]], [1, -1]), (far, [-1, -1])];
        let mut places = std::mem::take(&mut self.places);
        places.clear();
        places.push((sample, [1, 1]));
        if region.lines.is_empty() {
            places.extend(corners);
        } else {
            self.inner.clear();
            region.corners(&mut self.polygon, &mut self.inner);
            places.extend(self.inner.iter().map(|q| (*q, [1, 1])));
        }
        // most surfaces cover all of the square: rays into it, from its border or inside, meet them
        let (mut whole, mut rest) = (std::mem::take(&mut self.whole), std::mem::take(&mut self.near));
        whole.clear();
        rest.clear();
        for &i in list {
            if self.covers[i as usize] { whole.push(i) } else { rest.push(i) }
        }
        let met = places.iter().all(|(q, d)| match self.rays.stretch_among(&whole, &rest, *q, *d, &mut self.ray) {
            Stretch::Uncovered => false,
            Stretch::Covered { lo, hi } => {
                self.probes.push((*q, lo, hi));
                true
            }
        });
        (self.places, self.whole, self.near) = (places, whole, rest);
        met
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

    /// Whether a tip's plane lies between front and end on the rays of the probe, or within what bends may make.
    fn may_be_tip(&self, plane: &Plane) -> bool {
        let slack = plane.reach(self.scale) as i64 + 2 * i64::from(self.guard) + 8;
        self.probes.iter().all(|(q, lo, hi)| {
            let v = plane.at([q[0] + self.rays.corner[0], q[1] + self.rays.corner[1]], self.scale).0;
            lo - slack <= v && v - slack <= *hi
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

    /// Bounds of what the probe's rays allow, counted from a sheared plane through the tile's corner.
    fn window(&self, [sx, sy]: [f64; 2]) -> (i64, i64) {
        let (mut low, mut high) = (f64::NEG_INFINITY, f64::INFINITY);
        for (q, lo, hi) in &self.probes {
            let lift = sx * q[0] as f64 + sy * q[1] as f64;
            low = low.max(*lo as f64 - 2.0 - lift);
            high = high.min(*hi as f64 + 2.0 - lift);
        }
        (low.floor() as i64, high.ceil() as i64)
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
    fn holds(&mut self, entry: Entry, list: &[u32], region: Region<'_>, probed: bool) -> bool {
        let close = list.len() <= 12;
        let window = |shear| probed.then(|| self.window(shear));
        match entry {
            Entry::Constant(UNCOVERED) => false,
            Entry::Constant(v) => {
                let guard = i64::from(self.guard);
                let fits = |(low, high): (i64, i64)| {
                    low + guard <= i64::from(v)
                        && i64::from(v) <= high - guard
                        && (high - low) as u64 >= wide(self.guard)
                };
                let window = window([0.0; 2]);
                window.is_none_or(fits)
                    && self
                        .prover
                        .prove_in(&self.rays, list, &self.covers, region, self.rays.second_surface, close, window)
                        .is_some_and(fits)
            }
            Entry::Plane(plane) => {
                let Region { p, size, lines, .. } = region;
                let sheared = Region { p, size, lines, shear: plane.gradient(self.scale) };
                let window = window(sheared.shear);
                // what can be proven lies in the window
                if window.is_some_and(|window| !self.fits(&plane, window)) {
                    return false;
                }
                let range = self.prover.prove_in(
                    &self.rays,
                    list,
                    &self.covers,
                    sheared,
                    self.rays.second_surface,
                    close,
                    window,
                );
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

    /// Whether [`Self::fits`] or [`Self::fitted`] may find something in a range within the window.
    fn has_room(&self, plane: &Plane, (low, high): (i64, i64)) -> bool {
        let margin = plane.reach(self.scale).ceil() as i64 + i64::from(self.guard);
        low.saturating_add(margin + 2) <= high.saturating_sub(margin + 1)
    }

    /// The plane of the same slope in the middle, if there is room.
    fn fitted(&self, palette: &Palette, plane: &Plane, (low, high): (i64, i64)) -> Option<Plane> {
        let margin = plane.reach(self.scale).ceil() as i64 + i64::from(self.guard);
        let (low, high) = (low + margin + 2, high - margin - 1);
        let (whole, _) = plane.at(self.rays.corner, self.scale);
        if low > high {
            return None;
        }
        let [low, high] = [low, high].map(|v| plane.offset + v - whole);
        let there = palette.parallel(plane, low, high);
        Some(there.unwrap_or(Plane { offset: low + (high - low) / 2, ..*plane }))
    }

    /// The value with the fewest significant bits that keeps the guard.
    fn constant(&self, palette: &Palette, low: i64, high: i64) -> Option<u32> {
        let low = u32::try_from(low).ok()?;
        let high = u32::try_from(high).ok()?;
        let interval = Interval { min: low, max: high };
        if interval.width() < wide(self.guard) {
            return None;
        }
        Some(known(palette, interval.guarded(self.guard)))
    }

    /// The surface that the ray at the point meets first, and the one at which it leaves.
    pub fn met(&self, list: &[u32], p: [i64; 2]) -> Option<(u32, Option<u32>)> {
        let front = self.front(list, p)?;
        Some((front, self.end(list, p, front)))
    }

    /// What stands for a surface's face.
    fn face(&self, i: u32) -> &'a Surface {
        let index = self.local(i).index as usize;
        &self.rays.surfaces[self.edges[index].face as usize]
    }

    /// The plane just behind a front.
    fn behind(&self, front: u32) -> Option<Plane> {
        behind(self.face(front), self.edges[self.local(front).index as usize].beside, self.guard, self.scale)
    }

    /// Planes for masks: behind a front, and between front and end.
    pub fn guesses(&self, (front, end): (u32, Option<u32>)) -> [Option<Plane>; 2] {
        let f = self.face(front);
        let e = end.map(|e| self.face(e));
        [self.behind(front), e.and_then(|e| between(f, e, self.guard, self.scale))]
    }
}

/// A value of the interval that the palette has, or the one that ends in the most zero bits.
pub fn known(palette: &Palette, interval: Interval) -> u32 {
    let v = fewest_bits(interval);
    if palette.has(v) { v } else { palette.constant(interval.min, interval.max).unwrap_or(v) }
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
