//! Values of entries at places, and their bounds over squares. Words that no check has seen give any value, but end and
//! read nothing outside the page.

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing,
    clippy::cast_possible_truncation
)]

use super::{Layout, Line, MAX_DEPTH, Mask4, Plane, Raw, Split, Square, word, words};

/// First word of entry `number` in a section. Numbers beyond every palette may give any word.
#[inline]
const fn place(section: u16, number: u32, first: u16, words: u32) -> u32 {
    (section as u32).wrapping_add(number.wrapping_sub(first as u32).wrapping_mul(words))
}

/// Plane that entry `number` is.
#[inline]
pub fn plane(page: &[u32], l: &Layout, number: u32) -> Plane {
    Plane::decode(words(page, place(l.planes_at, number, l.first_plane, 3)))
}

/// Line `number`.
#[inline]
pub fn line(page: &[u32], l: &Layout, number: u16) -> Line {
    let (first, number) = (u32::from(l.lines_at), u32::from(number));
    if l.short_lines {
        Line::decode_short(words(page, first + 2 * number))
    } else {
        Line::decode(words(page, first + 3 * number))
    }
}

/// Split that entry `number` is.
#[inline]
pub fn split(page: &[u32], l: &Layout, number: u32) -> Split {
    Split::decode(word(page, place(l.splits_at, number, l.first_split, 1)))
}

/// Mask that entry `number` is.
#[inline]
pub fn mask(page: &[u32], l: &Layout, number: u32) -> Mask4 {
    Mask4::decode(words(page, place(l.masks_at, number, l.first_mask, 2)))
}

/// Raw that entry `number` is.
#[inline]
pub fn raw(page: &[u32], l: &Layout, number: u32) -> Raw {
    Raw::decode(words(page, place(l.raws_at, number, l.first_raw, 2)))
}

/// Number of the texel of 4 x 4 that a place lies in.
#[inline]
const fn cell(x: i64, y: i64) -> u32 {
    let cell = (y >> 8 & 3) << 2 | (x >> 8 & 3);
    super::cut(cell.cast_unsigned())
}

/// Value of entry `number` of the palette at a place of the page; `x` and `y` in 1/256 of a texel from the corner of its
/// footprint, 0 to 2^32.
#[inline]
pub fn value(page: &[u32], l: &Layout, mut number: u32, x: i64, y: i64) -> u32 {
    let first_split = u32::from(l.first_split);
    if number >= l.first_mask.into() {
        if number >= l.first_raw.into() {
            return super::cut(raw(page, l, number).value(page, cell(x, y)));
        }
        number = mask(page, l, number).entry(cell(x, y)).into();
    } else {
        for _ in 0..MAX_DEPTH {
            if number < first_split {
                break;
            }
            let s = split(page, l, number);
            number = if line(page, l, s.line).beyond(x, y) { s.b } else { s.a }.into();
        }
    }
    if number < l.first_plane.into() {
        return word(page, u32::from(l.constants_at) + number);
    }
    plane(page, l, number).at(x, y)
}

/// What an entry may answer with over a square.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// Values in a range, wherever the place: a constant, or a raw.
    Range(u32, u32),
    /// A plane.
    Plane(Plane),
}

impl Part {
    /// Smallest and largest value over a square of places.
    #[inline]
    pub const fn bounds(&self, square: &Square) -> (u32, u32) {
        match self {
            Self::Range(low, high) => (*low, *high),
            Self::Plane(plane) => plane.bounds(square),
        }
    }
}

/// Calls `visit` with every part of entry `number`; at most 16 times.
#[inline]
pub fn parts(page: &[u32], l: &Layout, number: u32, mut visit: impl FnMut(Part)) {
    let simple = |number: u32| {
        if number < l.first_plane.into() {
            let v = word(page, u32::from(l.constants_at) + number);
            return Part::Range(v, v);
        }
        Part::Plane(plane(page, l, number))
    };
    if number < l.first_split.into() {
        visit(simple(number));
    } else if number < l.first_mask.into() {
        // The entries still to be seen: each split leaves one behind, and splits are at most 4 deep.
        let mut waiting = [(number, 0u32); MAX_DEPTH as usize + 1];
        let mut count = 1usize;
        while let Some(&(number, depth)) = count.checked_sub(1).and_then(|top| waiting.get(top)) {
            count -= 1;
            if number < l.first_split.into() || depth == MAX_DEPTH {
                visit(simple(number));
                continue;
            }
            let s = split(page, l, number);
            if let Some(both) = waiting.get_mut(count..).and_then(|w| w.first_chunk_mut::<2>()) {
                *both = [(s.b.into(), depth + 1), (s.a.into(), depth + 1)];
                count += 2;
            }
        }
    } else if number < l.first_raw.into() {
        let m = mask(page, l, number);
        for (entry, named) in m.entries.into_iter().zip(m.named()) {
            if named {
                visit(simple(entry.into()));
            }
        }
    } else {
        let (low, high) = raw_bounds(page, &raw(page, l, number));
        visit(Part::Range(low, high));
    }
}

/// Smallest and largest of a raw's 16 values, each held to 32 bits.
fn raw_bounds(page: &[u32], raw: &Raw) -> (u32, u32) {
    (0..16).fold((u32::MAX, 0), |(low, high), n| {
        let v = u32::try_from(raw.value(page, n)).unwrap_or(u32::MAX);
        (low.min(v), high.max(v))
    })
}

/// Smallest and largest value that entry `number` is held to over a square of places: those of every part of it.
#[inline]
pub fn bounds(page: &[u32], l: &Layout, number: u32, square: &Square) -> (u32, u32) {
    if (u32::from(l.first_plane)..l.first_split.into()).contains(&number) {
        return plane(page, l, number).bounds(square);
    }
    let mut range = (u32::MAX, 0);
    parts(page, l, number, |part| {
        let (low, high) = part.bounds(square);
        range = (low.min(range.0), high.max(range.1));
    });
    range
}
