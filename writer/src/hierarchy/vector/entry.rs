//! Entries of kind `vector` in map coordinates, each kept once (spec/vector.md, Entries).
//!
//! Planes and lines are functions of the surfaces that they come from, not of the square that asked for them, so that
//! all leaves on a face or along an edge share them. A page stores them relative to its own corner, which rounds: a
//! plane's stored function lies above `P - 2` and not above `P`, a line's within 2^-19 texel.

use rustc_hash::FxHashMap as HashMap;
use std::collections::BTreeSet;

use umbrage_format::kind::vector::Raw;
use umbrage_format::kind::vector::entry::{self, FINE_SLOPE_BITS};
use umbrage_format::projection::UNCOVERED;

use crate::interval::proof::HalfPlane;
use crate::interval::triangle::Surface;

/// Number of an entry in a [`Palette`].
pub type EntryId = u32;
/// The entry of squares that nothing covers.
pub const OPEN: EntryId = 0;

/// Most that a plane may rise over the whole map, as a power of two: its offset then fits every page.
const RISE_LOG2: u32 = 37;
/// Bits of a gradient, sign excluded.
const GRADIENT_BITS: i32 = 24;
/// The same of a fine plane.
const FINE_BITS: i32 = FINE_SLOPE_BITS as i32 - 1;
/// Smallest power of a fine plane.
const FINE_SHIFT: i32 = entry::FINE_SHIFT as i32;
/// Most that a fine plane may rise over the whole map: its offset then fits every page.
const FINE_RISE: f64 = 27.0 * (1u64 << 30) as f64;

/// `offset + (gx X + gy Y) / 2^shift`, X and Y in 1/256 texel from the map's corner.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Plane {
    /// Depth at the map's corner.
    pub offset: i64,
    /// Below 2^26 in magnitude, or 2^24 where the plane is too steep for a fine one.
    pub gx: i32,
    /// As `gx`.
    pub gy: i32,
    /// 0 to 63.
    pub shift: u8,
}

/// The places with `T * 2^12 >= c + floor(m U / 2^19)` are beyond the line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Line {
    /// Slope of T over U in 2^-31; even.
    pub m: i32,
    /// Intercept in 2^-20 texel.
    pub c: i64,
    /// T is x and U is y.
    pub axis: bool,
}

/// What a node may hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Entry {
    /// A depth.
    Constant(u32),
    /// A plane.
    Plane(Plane),
    /// Two entries on the two sides of a line: `near`, and `beyond`.
    Split {
        /// Number of the line.
        line: u32,
        /// Entry on this side.
        near: EntryId,
        /// Entry beyond the line.
        beyond: EntryId,
    },
    /// 4 x 4 texels, each of up to 3 entries.
    Mask {
        /// Constants or planes.
        entries: [EntryId; 3],
        /// 2 bits for each texel, by rows.
        selectors: u32,
    },
    /// 4 x 4 depths: number in [`Palette::raws`].
    Raw(u32),
}

/// Sub-texel scale of a map: lattice steps in a texel, as a power of two, at least 8; and the map's side.
#[derive(Clone, Copy, Debug)]
pub struct Scale {
    /// Lattice steps per texel, log2.
    pub subtexel_bits: u8,
    /// Texels on a side, log2.
    pub log2_resolution: u8,
}

impl Scale {
    /// Lattice steps in 1/256 texel, log2.
    pub fn fine(self) -> u32 {
        u32::from(self.subtexel_bits) - 8
    }

    /// Half a texel in lattice steps.
    pub fn half(self) -> f64 {
        f64::from(1u32 << (self.subtexel_bits - 1))
    }
}

impl Plane {
    /// A plane of this gradient (depth per lattice step) through depth `z` at lattice point `at`, rounded down; none
    /// where it is too steep to be stored anywhere in the map.
    pub fn through(gradient: [f64; 2], at: [i64; 2], z: f64, scale: Scale) -> Option<Plane> {
        let fine = f64::from(1u32 << scale.fine());
        let g = gradient.map(|s| s * fine);
        let largest = g[0].abs().max(g[1].abs());
        if !largest.is_finite() || largest * two(i32::from(scale.log2_resolution) + 8) > two(RISE_LOG2 as i32) {
            return None;
        }
        // flat enough to be a constant over the whole map
        if largest * two(i32::from(scale.log2_resolution) + 8) < 1.0 {
            return None;
        }
        let by = |shift: i32| g.map(|s| (s * two(shift)).round() as i32);
        let bits = bits(g, scale);
        let most = if bits == FINE_BITS { FINE_SHIFT + 31 } else { 63 };
        let mut shift = (bits - 1 - largest.log2().floor() as i32).min(most);
        // the last gradient below a power of two rounds up to it
        if !by(shift).iter().all(|s| s.abs() < 1 << bits) {
            shift -= 1;
        }
        // on small maps a plane may rise too much within a texel for one that does not over the map
        if shift < 0 {
            return None;
        }
        let [gx, gy] = by(shift);
        let mut plane = Plane { offset: 0, gx, gy, shift: shift as u8 };
        let (whole, part) = plane.at(at, scale);
        plane.offset = (z.floor() as i64 - whole) + ((z - z.floor()) - part).floor() as i64;
        Some(plane)
    }

    /// Depth at a lattice point: integer part, and the rest in [0, 1).
    pub fn at(&self, p: [i64; 2], scale: Scale) -> (i64, f64) {
        let n = i128::from(self.gx) * i128::from(p[0]) + i128::from(self.gy) * i128::from(p[1]);
        let bits = u32::from(self.shift) + scale.fine();
        let whole = n >> bits;
        let rest = n - (whole << bits);
        (self.offset + whole as i64, rest as f64 / two(bits as i32))
    }

    /// Depth per lattice step; exact.
    pub fn gradient(&self, scale: Scale) -> [f64; 2] {
        let by = two(-i32::from(self.shift) - scale.fine() as i32);
        [f64::from(self.gx) * by, f64::from(self.gy) * by]
    }

    /// Largest difference of its depth between a texel's centre and a point of the texel.
    pub fn reach(&self, scale: Scale) -> f64 {
        let [x, y] = self.gradient(scale);
        (x.abs() + y.abs()) * scale.half()
    }

    /// What a page stores may be this or one less, at the centre of texel (x, y).
    pub fn texel(&self, x: u32, y: u32, scale: Scale) -> i64 {
        let centre = |v: u32| (i64::from(v) << scale.subtexel_bits) + (1i64 << (scale.subtexel_bits - 1));
        self.at([centre(x), centre(y)], scale).0
    }
}

/// 2 to a power from -1022 to 1023.
fn two(power: i32) -> f64 {
    f64::from_bits(((1023 + power) as u64) << 52)
}

/// Bits of a plane's gradient (depth per 1/256 texel), sign excluded.
fn bits(g: [f64; 2], scale: Scale) -> i32 {
    let rise = (g[0].abs() + g[1].abs()) * two(i32::from(scale.log2_resolution) + 8);
    // with room for what rounds up to a power of two
    let steep = g[0].abs().max(g[1].abs()) > two(FINE_BITS - FINE_SHIFT - 1);
    if rise <= FINE_RISE && !steep { FINE_BITS } else { GRADIENT_BITS }
}

impl Line {
    /// The line through two lattice points; none where they are one.
    pub fn through(a: [i64; 2], b: [i64; 2], scale: Scale) -> Option<Line> {
        let d = [b[0] - a[0], b[1] - a[1]];
        let axis = d[0].abs() < d[1].abs();
        let (u, t) = if axis { (1, 0) } else { (0, 1) };
        if d[u] == 0 {
            return None;
        }
        // even, so that pages may store it short
        let m = 2 * (d[t] as f64 / d[u] as f64 * 1073741824.0).round().clamp(-1073741823.0, 1073741823.0) as i32;
        // through the middle, where the rounding of m costs least
        let fine = scale.fine();
        let middle = |i: usize| i128::from(a[i]) + i128::from(b[i]);
        // in 2^-20 texel: a lattice step is 2^(12 - fine) of them, the middle is half the sum
        let position = |i: usize| (middle(i) << 12) >> (fine + 1);
        let rise = (i128::from(m) * middle(u)) >> (19 + fine + 1);
        Some(Line { m, c: (position(t) - rise) as i64, axis })
    }

    /// Whether a place of the map, in 1/256 texel, lies beyond the line; nothing where pages may tell it apart.
    pub fn tells(&self, place: [i64; 2]) -> Option<bool> {
        let (u, t) = if self.axis { (place[1], place[0]) } else { (place[0], place[1]) };
        let d = (t << 12) - self.boundary(u);
        (d.abs() >= 4).then_some(d >= 0)
    }

    /// Most that any page's line may lie off the exact border of a half-plane in the tile-relative square, across the
    /// line's axis; lattice steps. `corner` is the tile's.
    pub fn off(&self, half: &HalfPlane, corner: [i64; 2], p: [i64; 2], size: i64, scale: Scale) -> f64 {
        let (u, t) = if self.axis { (1, 0) } else { (0, 1) };
        let bits = scale.subtexel_bits;
        let unit = two(i32::from(bits) - 20);
        let (across, along) = if self.axis { (half.a, half.b) } else { (half.b, half.a) };
        // both are straight, so that the ends say all
        let ends = [p[u], p[u] + size].map(|at| {
            let place = (corner[u] + at) >> bits << 8;
            let stored = (self.boundary(place) - (corner[t] >> bits << 20)) as f64 * unit;
            (along as f64 * at as f64 + across as f64 * stored + half.c as f64).abs() / across.abs() as f64
        });
        // this boundary, a page's intercept and a page's product each round down by less than one
        ends[0].max(ends[1]) + 4.0 * unit
    }

    /// Intercept of the boundary at U, in 1/256 texel of the map: T in 2^-20 texel.
    pub fn boundary(&self, u: i64) -> i64 {
        self.c + ((i128::from(self.m) * i128::from(u)) >> 19) as i64
    }
}

/// Entries and lines, each once.
#[derive(Clone, Debug)]
pub struct Palette {
    /// Entries by number; an entry refers to lower numbers only.
    pub entries: Vec<Entry>,
    /// Lines by number.
    pub lines: Vec<Line>,
    /// Depths of raws by number, 4 x 4 by rows.
    pub raws: Vec<[u32; 16]>,
    by_entry: HashMap<Entry, EntryId>,
    values: BTreeSet<u32>,
    offsets: HashMap<(i32, i32, u8), Vec<i64>>,
    by_line: HashMap<Line, u32>,
    by_raw: HashMap<[u32; 16], u32>,
}

/// How much a palette holds: entries, lines, raws.
#[derive(Clone, Copy, Debug)]
pub struct Mark([usize; 3]);

impl Default for Palette {
    fn default() -> Self {
        let mut palette = Palette {
            entries: Vec::new(),
            lines: Vec::new(),
            raws: Vec::new(),
            by_entry: HashMap::default(),
            values: BTreeSet::new(),
            offsets: HashMap::default(),
            by_line: HashMap::default(),
            by_raw: HashMap::default(),
        };
        palette.entry(Entry::Constant(UNCOVERED));
        palette
    }
}

impl Palette {
    /// Number of an entry.
    pub fn entry(&mut self, entry: Entry) -> EntryId {
        *self.by_entry.entry(entry).or_insert_with(|| {
            self.entries.push(entry);
            match entry {
                Entry::Constant(v) => {
                    self.values.insert(v);
                }
                Entry::Plane(p) => self.offsets.entry((p.gx, p.gy, p.shift)).or_default().push(p.offset),
                _ => {}
            }
            self.entries.len() as u32 - 1
        })
    }

    /// A constant that is there, of those from `low` to `high`.
    pub fn constant(&self, low: u32, high: u32) -> Option<u32> {
        self.values.range(low..=high).next().copied()
    }

    /// Whether the constant is there.
    pub fn has(&self, value: u32) -> bool {
        self.values.contains(&value)
    }

    /// A plane of this slope that is there, with an offset from `low` to `high`.
    pub fn parallel(&self, plane: &Plane, low: i64, high: i64) -> Option<Plane> {
        let offsets = self.offsets.get(&(plane.gx, plane.gy, plane.shift))?;
        let offset = offsets.iter().rev().take(64).copied().find(|o| low <= *o && *o <= high)?;
        Some(Plane { offset, ..*plane })
    }

    /// Number of a line.
    pub fn line(&mut self, line: Line) -> u32 {
        *self.by_line.entry(line).or_insert_with(|| {
            self.lines.push(line);
            self.lines.len() as u32 - 1
        })
    }

    /// Number of a raw.
    pub fn raw(&mut self, depths: [u32; 16]) -> u32 {
        *self.by_raw.entry(depths).or_insert_with(|| {
            self.raws.push(depths);
            self.raws.len() as u32 - 1
        })
    }

    /// The entry of a number.
    pub fn get(&self, id: EntryId) -> Entry {
        self.entries[id as usize]
    }

    /// How much there is so far.
    pub fn mark(&self) -> Mark {
        Mark([self.entries.len(), self.lines.len(), self.raws.len()])
    }

    /// Forgets what came after the mark.
    pub fn back(&mut self, Mark([entries, lines, raws]): Mark) {
        for entry in self.entries.drain(entries..) {
            self.by_entry.remove(&entry);
            match entry {
                Entry::Constant(v) => {
                    self.values.remove(&v);
                }
                Entry::Plane(p) => {
                    if let Some(o) = self.offsets.get_mut(&(p.gx, p.gy, p.shift)) {
                        o.retain(|o| *o != p.offset);
                    }
                }
                _ => {}
            }
        }
        for line in self.lines.drain(lines..) {
            self.by_line.remove(&line);
        }
        for depths in self.raws.drain(raws..) {
            self.by_raw.remove(&depths);
        }
    }

    /// Whether an entry was there at the mark.
    pub fn is_older(&self, id: EntryId, mark: Mark) -> bool {
        (id as usize) < mark.0[0]
    }

    /// Words that an entry takes that was not there at the mark; lines as in pages whose lines are short, which most are.
    pub fn price(&self, id: EntryId, mark: Mark) -> u32 {
        if self.is_older(id, mark) {
            return 0;
        }
        let parts: u32 = self.parts(id).into_iter().flatten().map(|p| self.price(p, mark)).sum();
        parts
            + match self.get(id) {
                Entry::Constant(_) => 1,
                Entry::Plane(_) => 3,
                Entry::Split { line, .. } => 1 + if (line as usize) < mark.0[1] { 0 } else { 2 },
                Entry::Mask { .. } => 2,
                Entry::Raw(n) => raw_words(&self.raws[n as usize]),
            }
    }

    /// Takes in what `other` has; returns its entries' numbers here, [`EntryId::MAX`] where `used` says no.
    pub fn absorb(&mut self, other: &Palette, used: &[bool]) -> Vec<EntryId> {
        let mut map = vec![EntryId::MAX; other.entries.len()];
        for (i, entry) in other.entries.iter().enumerate() {
            if !used[i] {
                continue;
            }
            let at = |id: EntryId| map[id as usize];
            let entry = match *entry {
                Entry::Split { line, near, beyond } => {
                    Entry::Split { line: self.line(other.lines[line as usize]), near: at(near), beyond: at(beyond) }
                }
                Entry::Mask { entries, selectors } => Entry::Mask { entries: entries.map(at), selectors },
                Entry::Raw(n) => Entry::Raw(self.raw(other.raws[n as usize])),
                e => e,
            };
            map[i] = self.entry(entry);
        }
        map
    }

    /// Marks what the marked entries refer to.
    pub fn close(&self, used: &mut [bool]) {
        for i in (0..self.entries.len()).rev() {
            if used[i] {
                self.parts(i as u32).into_iter().flatten().for_each(|p| used[p as usize] = true);
            }
        }
    }

    /// Entries that an entry refers to.
    pub fn parts(&self, id: EntryId) -> [Option<EntryId>; 3] {
        match self.get(id) {
            Entry::Split { near, beyond, .. } => [Some(near), Some(beyond), None],
            Entry::Mask { entries, .. } => entries.map(Some),
            _ => [None; 3],
        }
    }

    /// Whether it is a constant or a plane.
    pub fn is_simple(&self, id: EntryId) -> bool {
        matches!(self.get(id), Entry::Constant(_) | Entry::Plane(_))
    }

    /// Itself, or a constant or plane that it answers with somewhere.
    pub fn simplified(&mut self, mut id: EntryId) -> EntryId {
        while let Some(part) = self.parts(id)[0] {
            id = part;
        }
        match self.get(id) {
            Entry::Raw(n) => {
                let mut depths = self.raws[n as usize];
                depths.sort_unstable();
                self.entry(Entry::Constant(depths[8]))
            }
            _ => id,
        }
    }

    /// Constants and planes that an entry answers with, the nearest first.
    pub fn simple(&self, id: EntryId, out: &mut Vec<EntryId>) {
        match self.get(id) {
            Entry::Constant(_) | Entry::Plane(_) => {
                if !out.contains(&id) {
                    out.push(id);
                }
            }
            _ => self.parts(id).into_iter().flatten().for_each(|p| self.simple(p, out)),
        }
    }
}

/// Words that a raw takes.
pub fn raw_words(depths: &[u32; 16]) -> u32 {
    2 + Raw::of(depths).heap_words()
}

/// The plane just behind a surface: the same for all leaves on it. `guard` is kept from the surface. Texels on an edge
/// hold some of the face behind it, too; `beside` says how steep that may be, depth per lattice step.
pub fn behind(s: &Surface, beside: f64, guard: u32, scale: Scale) -> Option<Plane> {
    let g = gradient(s);
    let reach = (g[0].abs() + g[1].abs()).max(beside) * scale.half();
    let extent = |v: [u32; 3]| f64::from(v.iter().max().unwrap_or(&0) - v.iter().min().unwrap_or(&0));
    // what the rounding of the gradient makes over the whole face, and two for pages
    let bits = bits(g.map(|s| s * f64::from(1u32 << scale.fine())), scale);
    let rounding = g[0].abs().max(g[1].abs()) * (extent(s.x) + extent(s.y)) / f64::from(1u32 << (bits - 1));
    let z = f64::from(s.z[0]) + reach + f64::from(guard) + 4.0 + rounding;
    Plane::through(g, [i64::from(s.x[0]), i64::from(s.y[0])], z, scale)
}

/// The plane between a front and an end of the stretch behind it that is right for every texel that lies between them,
/// up to rounding: with reaches h and k of the two over half a texel it divides their distance as h to k. Where the
/// distance is at least h + k the texel's area interval is not empty and the plane's value at the centre lies in it; elsewhere the value
/// lies between both at the centre.
pub fn between(front: &Surface, end: &Surface, guard: u32, scale: Scale) -> Option<Plane> {
    let (f, e) = (gradient(front), gradient(end));
    let reach = |g: [f64; 2]| (g[0].abs() + g[1].abs()) * scale.half();
    let (h, k) = (reach(f), reach(e));
    let part = if h + k > 0.0 { (h / (h + k)).clamp(0.002, 0.998) } else { 0.5 };
    let at = [i64::from(front.x[0]), i64::from(front.y[0])];
    let depth = end.depth(at[0], at[1]);
    let far = depth.floor as f64 + depth.rem as f64 / depth.den as f64 - f64::from(guard) - 1.0;
    let near = f64::from(front.z[0]) + f64::from(guard) + 3.0;
    let g = [0, 1].map(|i| f[i] + (e[i] - f[i]) * part);
    Plane::through(g, at, near + (far - near) * part, scale)
}

/// Depth per lattice step.
pub fn gradient(s: &Surface) -> [f64; 2] {
    let (gx, gy) = s.slope();
    let den = s.area() as f64;
    [gx as f64 / den, gy as f64 / den]
}

#[cfg(test)]
mod tests {
    use super::*;
    use umbrage_format::kind::vector;

    #[test]
    fn gradients_fit_a_page_or_there_is_no_plane() {
        let (mut planes, mut fine, mut none) = (0, 0, 0);
        for log2_resolution in 0..=24u8 {
            let scale = Scale { subtexel_bits: (28 - log2_resolution as i32).max(8) as u8, log2_resolution };
            for log2 in -40..40 {
                for part in [1.0, 1.0 - f64::EPSILON, 1.0 - two(-26), 1.3] {
                    // per 1/256 texel
                    let g = part * two(log2) / f64::from(1u32 << scale.fine());
                    for gradient in [[g, -g / 3.0], [g / 7.0, -g]] {
                        let Some(p) = Plane::through(gradient, [12345, 6789], 1e9, scale) else {
                            none += 1;
                            continue;
                        };
                        planes += 1;
                        let page = vector::Plane { offset: p.offset, gx: p.gx, gy: p.gy, shift: p.shift };
                        assert!(page.fits(), "{log2_resolution} {gradient:?}: {p:?}");
                        fine += usize::from(page.is_fine());
                        let kept = p.gradient(scale);
                        for k in 0..2 {
                            // or 2^-8 over the largest map
                            let most = (g * two(-22)).max(two(-40) / f64::from(1u32 << scale.fine()));
                            assert!((kept[k] - gradient[k]).abs() <= most, "{gradient:?}: {kept:?}");
                        }
                    }
                }
            }
        }
        assert!(planes > 1000 && fine > 500 && planes - fine > 200 && none > 1000, "{planes} {fine} {none}");
    }
}
