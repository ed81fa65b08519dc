//! The walk of kind `vector` over all pages at once, laid out anew: nodes point at their children, entries are decoded
//! and count places from the corner of the map, so that a lookup needs no page, no header and no counting of bits.
//!
//! - [`Tree`]: the groups of all pages, a grid of nodes where most walks begin, the entries;
//! - [`Entry`]: one of a palette, ready to be evaluated;
//! - `build`: from pages to both.
//!
//! `NOTES.md` has the figures of what was tried.

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing,
    clippy::cast_possible_truncation
)]

mod build;

use umbrage_format::kind::mh::child_of;
use umbrage_format::projection::UNCOVERED;

use super::{centre, inside};

pub(in crate::query) use build::{Page, words_held};

/// Pages that are all checked and linked.
#[derive(Debug)]
pub(in crate::query) struct Tree {
    /// The children of each group, four and four. Group 0 has the root alone, at c = 0.
    ///
    /// A child is [`LEAF`] with what answers in its square, or the group of its own children.
    nodes: Vec<u32>,
    /// For each group what answers in its parent's square on the parent's level.
    holds: Vec<u32>,
    /// The nodes of each level from the root's down to `grid_level`, or the leaves above, row by row.
    grid: Vec<u32>,
    grid_level: u8,
    log2_resolution: u8,
    entries: Vec<Entry>,
    /// The depths of raws.
    raws: Vec<[u32; 16]>,
}

/// Bit of a child: no children; the others say what answers: number of an entry, and [`PROVEN`].
const LEAF: u32 = 1 << 31;
/// Bit of what answers: it is proven where lookups end with it.
const PROVEN: u32 = 1 << 30;
/// Most levels that the grid spans.
const GRID_LEVELS: u8 = 11;

/// An entry of a page. Places count from the corner of the map: what lies between the corners of map and page is in
/// `k` and `c`, which keeps every rounding as it is.
#[derive(Clone, Copy, Debug)]
enum Entry {
    /// A plane, or a constant: a plane without slopes, so that the branch between them is none. `most` is the largest
    /// value.
    Plane {
        offset: i64,
        k: i64,
        gx: i32,
        gy: i32,
        most: u32,
        shift: u8,
    },
    Split {
        c: i64,
        k: i64,
        m: i32,
        axis: bool,
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

impl Entry {
    /// The same value everywhere.
    const fn constant(v: u32) -> Self {
        Self::Plane { offset: v as i64, k: 0, gx: 0, gy: 0, most: v, shift: 0 }
    }
}

impl Tree {
    /// The level where most walks begin: the finest that has no more nodes than the tree.
    fn build_grid(&mut self) {
        let fits = |levels: u8| self.nodes.len() >> (2 * levels) != 0;
        let levels = (0..=GRID_LEVELS.min(self.log2_resolution)).rev().find(|l| fits(*l)).unwrap_or(0);
        let mut grid = Vec::new();
        for width in 0..=levels {
            let (level, side) = (self.log2_resolution - width, 1u32 << width);
            let cells = (0..side).flat_map(|y| (0..side).map(move |x| (x << level, y << level)));
            grid.extend(cells.map(|(x, y)| self.walk(0, self.log2_resolution + 1, x, y, level).0));
        }
        self.grid = grid;
        self.grid_level = self.log2_resolution - levels;
    }

    /// From a node of `from` (group 0 counts as one above the root) down to `level`, or to a leaf above: the child that
    /// it is, and whether it is a leaf.
    #[inline]
    fn walk(&self, mut node: u32, from: u8, x: u32, y: u32, level: u8) -> (u32, bool) {
        let mut at = from;
        while node & LEAF == 0 {
            if at <= level {
                return (node, false);
            }
            at -= 1;
            node = self.nodes.get((4 * node + child_of(x, y, at)) as usize).copied().unwrap_or(LEAF);
        }
        (node, true)
    }

    /// What answers at a texel of the map: number of an entry, and [`PROVEN`].
    #[inline]
    fn find(&self, x: u32, y: u32, level: u8) -> u32 {
        // From the cell of the grid, or of the grid's own level above it.
        let from = level.clamp(self.grid_level, self.log2_resolution);
        let (shift, width) = (u32::from(from), u32::from(self.log2_resolution - from));
        // Cells of the levels above, coarsest first: 1 + 4 + 16 + …
        let above = ((1u32 << (2 * width)) - 1) / 3;
        let cell = above.wrapping_add((y >> shift) << width | x >> shift) as usize;
        let (node, leaf) = self.walk(self.grid.get(cell).copied().unwrap_or(LEAF), from, x, y, level);
        if leaf { node & !LEAF } else { self.holds.get(node as usize).copied().unwrap_or(0) }
    }

    /// Value of an entry at a place of the map.
    #[inline]
    fn value_at(&self, mut number: u32, x: i64, y: i64) -> u32 {
        // Splits are at most four deep, and a mask's entries are constants or planes.
        loop {
            match self.entries.get(number as usize) {
                Some(Entry::Plane { offset, k, gx, gy, most, shift }) => {
                    let rise = i64::from(*gx).wrapping_mul(x).wrapping_add(i64::from(*gy).wrapping_mul(y));
                    let v = offset.wrapping_add(rise.wrapping_sub(*k) >> (shift & 63)).clamp(0, i64::from(*most));
                    // Clamped to 32 bits.
                    let [a, b, c, d, ..] = v.to_le_bytes();
                    return u32::from_le_bytes([a, b, c, d]);
                }
                Some(Entry::Split { c, k, m, axis, sides: [a, b] }) => {
                    let (u, t) = if *axis { (y, x) } else { (x, y) };
                    let beyond = t << 12 >= c.wrapping_add(i64::from(*m).wrapping_mul(u).wrapping_sub(*k) >> 19);
                    number = if beyond { *b } else { *a };
                }
                Some(Entry::Mask { entries: [a, b, c], selectors, from }) => {
                    number = match selectors >> (2 * cell(x, y, *from)) & 3 {
                        0 => *a,
                        1 => *b,
                        _ => *c,
                    };
                }
                Some(Entry::Raw { raw, from }) => {
                    let depth = self.raws.get(*raw as usize).and_then(|r| r.get(cell(x, y, *from) as usize));
                    return depth.copied().unwrap_or(UNCOVERED);
                }
                None => return UNCOVERED,
            }
        }
    }

    /// Stored depth at a texel of the map.
    #[inline]
    pub(in crate::query) fn value(&self, x: u32, y: u32, level: u8) -> u32 {
        let found = self.find(x, y, level);
        let level = level.min(self.log2_resolution);
        self.value_at(found & !PROVEN, centre(x, level), centre(y, level))
    }

    /// Depth at a place inside a texel of the map.
    #[inline]
    pub(in crate::query) fn continuous(&self, x: u32, y: u32, sub: [u8; 2]) -> u32 {
        let found = self.find(x, y, 0);
        let [fx, fy] = if found & PROVEN == 0 { [128; 2] } else { sub };
        self.value_at(found & !PROVEN, inside(x, fx), inside(y, fy))
    }

    /// Bytes held.
    pub(in crate::query) fn bytes(&self) -> usize {
        let words = self.nodes.len() + self.holds.len() + self.grid.len() + 16 * self.raws.len();
        words * 4 + self.entries.len() * size_of::<Entry>()
    }
}
