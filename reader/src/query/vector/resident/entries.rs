//! Entries ready to be evaluated: a plane in 16 bytes, a line and its two sides in one line of cache, found without a
//! branch on which of both it is.
//!
//! Places count from the corner of the map: what lies between the corners of map and page is in `c`, together with
//! what else is the same everywhere, which keeps every rounding as it is: floor(a / n) + b = floor((a + b * n) / n).

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing,
    clippy::cast_possible_truncation
)]

use umbrage_format::kind::vector::entry::{FINE_SHIFT, PLANE_MAX};
use umbrage_format::kind::vector::{Header, Layout, Line, Plane, eval};
use umbrage_format::projection::UNCOVERED;

use super::centre;
use crate::query::filter::{Rect, Taps};

/// Bit of a reference: it is to a line, whose sides are the two slots behind it. The bits below are the slot's number.
pub(super) const SPLIT: u32 = 1 << 29;

/// A function `a * x + b * y + c` of the place.
///
/// Of a line: negative beyond it. Of a plane: the value times a power of two, not clamped; `a` and `b` hold
/// 27 bits above 5, which in `a` are the power less [`FINE_SHIFT`] and in `b` what the slot is.
#[derive(Clone, Copy, Debug)]
struct Slot {
    c: i64,
    a: i32,
    b: i32,
}

/// Bits below the gradients of a plane.
const LOW: u32 = 5;
/// Low bits of `b`: a plane that is clamped to [`PLANE_MAX`].
const PLANE: i32 = 0;
/// A constant, which may be one more.
const CONSTANT: i32 = 1;
/// `c` is a reference.
const NEXT: i32 = 2;
/// `c` is a number of `others`.
const OTHER: i32 = 3;

/// Four slots in a line of cache; a line and its sides never lie in two.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
struct Four([Slot; 4]);

const FREE: Slot = Slot { c: 0, a: 0, b: CONSTANT };

/// What no slots hold. Sides and entries are references.
#[derive(Clone, Copy, Debug)]
enum Other {
    /// As a slot, with products that need more than 64 bits, or a power that a slot does not hold.
    Plane {
        c: i128,
        a: i32,
        b: i32,
        shift: u8,
    },
    /// The same of a line.
    Split {
        c: i128,
        a: i32,
        b: i32,
        sides: [u32; 2],
    },
    /// `from` is the texel of the page's corner, of its 4 x 4.
    Mask {
        entries: [u32; 3],
        selectors: u32,
        from: (u8, u8),
    },
    Raw {
        raw: u32,
        from: (u8, u8),
    },
}

/// Number of the texel of 4 x 4 that a place lies in.
#[inline]
fn cell(x: i64, y: i64, from: (u8, u8)) -> u32 {
    let part = |v: i64, from: u8| u32::from(((v >> 8).to_le_bytes()[0]).wrapping_sub(from) & 3);
    part(y, from.1) << 2 | part(x, from.0)
}

/// The entries of all pages that nodes refer to.
#[derive(Debug, Default)]
pub(super) struct Entries {
    slots: Vec<Four>,
    /// Slots that are free: the last of each line.
    free: Vec<u32>,
    others: Vec<Other>,
    /// The depths of raws.
    raws: Vec<[u32; 16]>,
}

/// A page's palette, whose entries come in as they are referred to.
#[derive(Debug)]
pub(super) struct Palette<'a> {
    pub(super) page: &'a [u32],
    pub(super) layout: Layout,
    /// First place of the footprint.
    corner: [i64; 2],
    /// Places on a side, at least.
    side: i64,
    /// By number.
    known: Vec<Option<u32>>,
}

impl<'a> Palette<'a> {
    pub(super) fn new(page: &'a [u32], origin: (u32, u32)) -> Self {
        let [_, _, level, _] = page.get(1).copied().unwrap_or(0).to_le_bytes();
        let known = vec![None; Header::decode(page).palette() as usize];
        let corner = [i64::from(origin.0) << 8, i64::from(origin.1) << 8];
        Self { page, layout: Layout::of(page), corner, side: 512 << level.min(31), known }
    }

    /// A function of the place in the page as one of the place in the map.
    fn moved(&self, a: i32, b: i32, c: i128) -> i128 {
        let [x, y] = self.corner.map(i128::from);
        c - i128::from(a) * x - i128::from(b) * y
    }

    /// Whether a function fits 64 bits at every place of the page; it is largest and smallest at corners. Sums on the
    /// way may wrap.
    fn fits(&self, a: i32, b: i32, c: i128) -> Option<i64> {
        let fits = |x: i64, y: i64| i64::try_from(i128::from(a) * i128::from(x) + i128::from(b) * i128::from(y) + c);
        let [x, y] = self.corner;
        let all = [(0, 0), (self.side, 0), (0, self.side), (self.side, self.side)];
        let inside = all.iter().all(|(dx, dy)| fits(x + dx, y + dy).is_ok());
        if inside { i64::try_from(c).ok() } else { None }
    }

    fn corner_texel(&self) -> (u8, u8) {
        let [x, y] = self.corner.map(|v| (v >> 8).to_le_bytes()[0] & 3);
        (x, y)
    }

    /// `(a, b, c)` of a line, negative beyond it: T * 2^12 >= c + floor(m * U / 2^19) is
    /// m * U - T * 2^31 + (c - 1) * 2^19 < 0.
    fn line(&self, l: &Line) -> (i32, i32, i128) {
        let (a, b) = if l.axis { (i32::MIN, l.m) } else { (l.m, i32::MIN) };
        (a, b, self.moved(a, b, (i128::from(l.c) - 1) << 19))
    }

    fn plane(&self, p: &Plane) -> i128 {
        self.moved(p.gx, p.gy, i128::from(p.offset) << p.shift)
    }
}

impl Entries {
    /// Reference to entry `number` of a palette.
    pub(super) fn add(&mut self, palette: &mut Palette<'_>, number: u32) -> u32 {
        if let Some(known) = palette.known.get(number as usize).copied().flatten() {
            return known;
        }
        let (page, layout) = (palette.page, &{ palette.layout });
        let simple = number < layout.first_split.into();
        let reference = if !simple && number < layout.first_mask.into() {
            let s = eval::split(page, layout, number);
            let (a, b, c) = palette.line(&eval::line(page, layout, s.line));
            match palette.fits(a, b, c) {
                Some(c) => {
                    let [near, far] = [s.a, s.b].map(|n| self.slot(palette, n.into()));
                    let at = count(&self.slots) * 4;
                    self.slots.push(Four([Slot { c, a, b }, near, far, FREE]));
                    self.free.push(at + 3);
                    at | SPLIT
                }
                None => {
                    let sides = [s.a, s.b].map(|n| self.add(palette, n.into()));
                    let slot = self.other(Other::Split { c, a, b, sides });
                    self.put(slot)
                }
            }
        } else {
            let slot = self.slot(palette, number);
            self.put(slot)
        };
        if let Some(known) = palette.known.get_mut(number as usize) {
            *known = Some(reference);
        }
        reference
    }

    /// An entry as a side, or alone.
    fn slot(&mut self, palette: &mut Palette<'_>, number: u32) -> Slot {
        let (page, layout) = (palette.page, &{ palette.layout });
        if number < layout.first_plane.into() {
            return Self::constant(eval::value(page, layout, number, 0, 0));
        }
        if number < layout.first_split.into() {
            let p = eval::plane(page, layout, number);
            let c = palette.plane(&p);
            let power = p.shift.checked_sub(FINE_SHIFT).filter(|power| power >> LOW == 0);
            return match power.zip(palette.fits(p.gx, p.gy, c)) {
                Some((power, c)) => Slot { c, a: p.gx << LOW | i32::from(power), b: p.gy << LOW | PLANE },
                None => self.other(Other::Plane { c, a: p.gx, b: p.gy, shift: p.shift }),
            };
        }
        if number < layout.first_mask.into() {
            return Slot { c: self.add(palette, number).into(), a: 0, b: NEXT };
        }
        let from = palette.corner_texel();
        if number < layout.first_raw.into() {
            let m = eval::mask(page, layout, number);
            let entries = m.entries.map(|n| self.add(palette, n.into()));
            return self.other(Other::Mask { entries, selectors: m.selectors, from });
        }
        let raw = count(&self.raws);
        let cell = |n: i64| eval::value(page, layout, number, (n & 3) << 8, (n >> 2) << 8);
        self.raws.push(std::array::from_fn(|n| cell(i64::try_from(n).unwrap_or(0))));
        self.other(Other::Raw { raw, from })
    }

    fn constant(v: u32) -> Slot {
        Slot { c: i64::from(v) << FINE_SHIFT, a: 0, b: CONSTANT }
    }

    fn other(&mut self, other: Other) -> Slot {
        self.others.push(other);
        Slot { c: i64::from(count(&self.others) - 1), a: 0, b: OTHER }
    }

    /// Reference to a slot that stands alone, in one that is free.
    fn put(&mut self, slot: Slot) -> u32 {
        let at = self.free.pop().unwrap_or_else(|| {
            let at = count(&self.slots) * 4;
            self.slots.push(Four([FREE; 4]));
            self.free.extend([at + 3, at + 2, at + 1]);
            at
        });
        if let Some(place) = self.slots.get_mut(at as usize / 4).and_then(|f| f.0.get_mut(at as usize % 4)) {
            *place = slot;
        }
        at
    }

    /// A reference to the same value everywhere.
    pub(super) fn put_constant(&mut self, v: u32) -> u32 {
        self.put(Self::constant(v))
    }

    /// Gives back what building took.
    pub(super) fn finish(&mut self) {
        self.free = Vec::new();
        self.slots.shrink_to_fit();
        self.others.shrink_to_fit();
        self.raws.shrink_to_fit();
    }

    /// Value at a place of the map.
    #[inline]
    pub(super) fn value(&self, mut reference: u32, x: i64, y: i64) -> u32 {
        // Splits are at most four deep.
        loop {
            let at = reference & (SPLIT - 1);
            let Some(Four(slots)) = self.slots.get((at >> 2) as usize) else { return UNCOVERED };
            let slot = |n: u32| slots.get((n & 3) as usize).unwrap_or(&FREE);
            // No branch: of a slot that stands alone the sign means nothing, and is not asked for.
            let split = u32::from(reference & SPLIT != 0);
            let beyond = u32::from(slot(at).at(x, y) < 0);
            let found = slot(at + split + (split & beyond));
            match found.b & ((1 << LOW) - 1) {
                PLANE | CONSTANT => return found.plane(x, y),
                NEXT => reference = found.number(),
                _ => return self.other_value(found.number(), x, y),
            }
        }
    }

    /// Lit taps of a part that one entry answers. Lines and planes are extreme at corners: often these decide for all.
    pub(super) fn lit(&self, reference: u32, taps: &Taps, part: &Rect) -> u32 {
        let place = |v: u32| centre(v << (taps.level & 31), taps.level);
        let ([x, u], [y, v]) = (part.x, part.y);
        let across = (u - x + 1) as usize;
        if x == u && y == v {
            return u32::from(taps.is_lit(x, y, self.value(reference, place(x), place(y))));
        }
        let at = reference & (SPLIT - 1);
        let Some(Four(slots)) = self.slots.get((at >> 2) as usize) else { return taps.lit(part, UNCOVERED) };
        let slot = |n: u32| slots.get((n & 3) as usize).unwrap_or(&FREE);
        let centres = Centres { first: [place(x), place(y)], step: 256 << (taps.level & 31), more: [u - x, v - y] };
        let mut found = slot(at);
        if reference & SPLIT != 0 {
            let line = found.line(&centres);
            let [a, b, c, d] = line.corners(&centres).map(|v| v < 0);
            let [near, far] = [slot(at + 1), slot(at + 2)];
            if a != b || a != c || a != d {
                if !near.is_plane() || !far.is_plane() {
                    return taps.lit_each(part, |x, y| self.value(reference, place(x), place(y)));
                }
                let [near_sums, far_sums] = [near, far].map(|s| s.sums(&centres));
                let row = |y: u32| {
                    let [lines, nears, fars] = [line, near_sums, far_sums].map(|s| s.row(y - part.y[0]));
                    let depth = |(l, (n, f))| if l < 0 { far.depth(f) } else { near.depth(n) };
                    taps.lit_row(x, y, lines.zip(nears.zip(fars)).take(across).map(depth))
                };
                return (y..=v).map(row).sum();
            }
            found = if a { far } else { near };
        }
        match found.b & ((1 << LOW) - 1) {
            CONSTANT => taps.lit(part, found.depth(found.c)),
            PLANE => {
                let sums = found.sums(&centres);
                let values = sums.corners(&centres).map(|v| found.depth(v));
                if values.iter().all(|v| (1..PLANE_MAX).contains(&i64::from(*v)))
                    && let Some(lit) = taps.lit_by_corners(part, values)
                {
                    return lit;
                }
                let row = |y: u32| {
                    let depths = sums.row(y - part.y[0]).take(across).map(|v| found.depth(v));
                    taps.lit_row(x, y, depths)
                };
                (y..=v).map(row).sum()
            }
            NEXT => self.lit(found.number(), taps, part),
            _ => taps.lit_each(part, |x, y| self.value(reference, place(x), place(y))),
        }
    }

    #[inline(never)]
    fn other_value(&self, number: u32, x: i64, y: i64) -> u32 {
        let wide = |c: i128, a: i32, b: i32| i128::from(a) * i128::from(x) + i128::from(b) * i128::from(y) + c;
        match self.others.get(number as usize) {
            Some(Other::Plane { c, a, b, shift }) => {
                let v = (wide(*c, *a, *b) >> (shift & 63)).clamp(0, PLANE_MAX.into());
                u32::try_from(v).unwrap_or(UNCOVERED)
            }
            Some(Other::Split { c, a, b, sides: [near, far] }) => {
                self.value(if wide(*c, *a, *b) < 0 { *far } else { *near }, x, y)
            }
            Some(Other::Mask { entries: [a, b, c], selectors, from }) => {
                let entry = match selectors >> (2 * cell(x, y, *from)) & 3 {
                    0 => a,
                    1 => b,
                    _ => c,
                };
                self.value(*entry, x, y)
            }
            Some(Other::Raw { raw, from }) => {
                let depth = self.raws.get(*raw as usize).and_then(|r| r.get(cell(x, y, *from) as usize));
                depth.copied().unwrap_or(UNCOVERED)
            }
            None => UNCOVERED,
        }
    }

    /// Bytes held.
    pub(super) fn bytes(&self) -> usize {
        self.slots.len() * size_of::<Four>() + self.others.len() * size_of::<Other>() + self.raws.len() * 64
    }
}

/// Places of the centres of a part's texels.
#[derive(Clone, Copy)]
struct Centres {
    first: [i64; 2],
    /// From one to the next.
    step: i64,
    /// How many there are in a row and in a column behind the first.
    more: [u32; 2],
}

/// A function over centres. May wrap on the way, and not in the end: [`Palette::fits`].
#[derive(Clone, Copy)]
struct Sums {
    first: i64,
    across: i64,
    down: i64,
}

impl Sums {
    fn new(a: i32, b: i32, c: i64, centres: &Centres) -> Self {
        let [x, y] = centres.first;
        let [across, down] = [a, b].map(|v| i64::from(v).wrapping_mul(centres.step));
        Self { first: Slot::sum(a, b, c, x, y), across, down }
    }

    /// At the corners.
    #[inline]
    fn corners(&self, centres: &Centres) -> [i64; 4] {
        let [across, down] = centres.more.map(i64::from);
        let (across, down) = (self.across.wrapping_mul(across), self.down.wrapping_mul(down));
        let below = self.first.wrapping_add(down);
        [self.first, self.first.wrapping_add(across), below, below.wrapping_add(across)]
    }

    /// Along a row, and on.
    #[inline]
    fn row(self, number: u32) -> impl Iterator<Item = i64> {
        let mut next = self.first.wrapping_add(self.down.wrapping_mul(number.into()));
        std::iter::repeat_with(move || {
            let sum = next;
            next = next.wrapping_add(self.across);
            sum
        })
    }
}

impl Slot {
    /// The function of a line.
    #[inline]
    fn at(&self, x: i64, y: i64) -> i64 {
        Self::sum(self.a, self.b, self.c, x, y)
    }

    /// May wrap on the way, and not in the end: [`Palette::fits`].
    #[inline]
    fn sum(a: i32, b: i32, c: i64, x: i64, y: i64) -> i64 {
        i64::from(a).wrapping_mul(x).wrapping_add(i64::from(b).wrapping_mul(y)).wrapping_add(c)
    }

    #[inline]
    fn plane(&self, x: i64, y: i64) -> u32 {
        self.depth(Self::sum(self.a >> LOW, self.b >> LOW, self.c, x, y))
    }

    /// What a plane's sum says.
    #[inline]
    fn depth(&self, sum: i64) -> u32 {
        // Clamped to 32 bits.
        let [a, b, c, d, ..] =
            (sum >> ((self.a & 31) + i32::from(FINE_SHIFT))).clamp(0, PLANE_MAX + i64::from(self.b & 1)).to_le_bytes();
        u32::from_le_bytes([a, b, c, d])
    }

    /// A line over centres.
    #[inline]
    fn line(&self, centres: &Centres) -> Sums {
        Sums::new(self.a, self.b, self.c, centres)
    }

    /// A plane or constant over centres, as sums.
    #[inline]
    fn sums(&self, centres: &Centres) -> Sums {
        Sums::new(self.a >> LOW, self.b >> LOW, self.c, centres)
    }

    /// Whether it is a plane or constant.
    #[inline]
    fn is_plane(&self) -> bool {
        matches!(self.b & ((1 << LOW) - 1), PLANE | CONSTANT)
    }

    /// The reference or number in `c`.
    #[inline]
    fn number(&self) -> u32 {
        let [a, b, c, d, ..] = self.c.to_le_bytes();
        u32::from_le_bytes([a, b, c, d])
    }
}

/// A length as a number; all arrays are held to 32 bits by their words.
pub(super) fn count<T>(list: &[T]) -> u32 {
    u32::try_from(list.len()).unwrap_or(u32::MAX)
}

/// Bytes that a page's palette takes, at most. With those of the nodes that refer to it more than 32 for each slot: 32 bits
/// of words, the most that a map may hold, have fewer slots than a reference reaches.
pub(super) fn bytes_held(h: &Header) -> u64 {
    let (slot, four, other) = (size_of::<Slot>() as u64, size_of::<Four>() as u64, size_of::<Other>() as u64);
    let each = [
        (h.constants, slot),
        (h.planes, slot + other),
        (h.splits, four + other + slot),
        (h.masks, slot + other),
        (h.raws, slot + other + 64),
    ];
    each.iter().map(|(n, bytes)| u64::from(*n) * bytes).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Lookups count on it for their speed, limits for their sums.
    #[test]
    fn a_line_and_its_sides_lie_in_one_line_of_cache() {
        assert_eq!((size_of::<Slot>(), size_of::<Four>(), align_of::<Four>()), (16, 64, 64));
    }
}
