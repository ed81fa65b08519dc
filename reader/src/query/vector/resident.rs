//! The walk of kind `vector` over all pages at once, laid out anew: nodes point at what lies two levels below, entries
//! are decoded and count places from the corner of the map, so that a lookup needs no page, no header and no counting of
//! bits.
//!
//! - [`Tree`]: a grid of nodes where walks begin, and the nodes below, 16 in a brick;
//! - [`Entries`]: those of the palettes, ready to be evaluated;
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
mod entries;

use umbrage_format::kind::mh::child_of;
use umbrage_format::projection::UNCOVERED;

use super::{centre, inside};
use crate::query::filter::{Rect, Taps};
use crate::query::pyramid::Pyramid;
use entries::Entries;

pub(in crate::query) use build::{Page, words_held};

/// Pages that are all checked and linked.
#[derive(Debug)]
pub(in crate::query) struct Tree {
    /// A node is [`LEAF`] with what answers in its square, or the number of the brick of what lies below it.
    bricks: Vec<Brick>,
    /// For each brick what answers on the levels that it spans: in its own square, then in the four of one level below.
    holds: Vec<[u32; 5]>,
    /// The nodes of `grid_level`, or the leaves above, row by row.
    grid: Vec<u32>,
    /// What answers on the levels above, coarsest first, row by row.
    above: Vec<u32>,
    /// Even, so that bricks end at level 0.
    grid_level: u8,
    log2_resolution: u8,
    entries: Entries,
    /// Values of the coarsest levels.
    pyramid: Pyramid,
}

/// The nodes two levels below a node, or the leaves between, row by row: one line of cache.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
struct Brick([u32; 16]);

/// Bit of a child: no children; the others say what answers: a reference to an entry, and [`PROVEN`].
const LEAF: u32 = 1 << 31;
/// Bit of what answers: it is proven where lookups end with it.
const PROVEN: u32 = 1 << 30;
/// Most levels that the grid spans: 16 MiB of cells.
const GRID_LEVELS: u8 = 11;

impl Tree {
    /// What answers at a texel of the map: a reference to an entry, and [`PROVEN`].
    #[inline]
    fn find(&self, x: u32, y: u32, level: u8) -> u32 {
        if level > self.grid_level {
            return self.coarse(x, y, level);
        }
        let (shift, width) = (u32::from(self.grid_level), u32::from(self.log2_resolution - self.grid_level));
        let cell = ((y >> shift) << width | x >> shift) as usize;
        let mut node = self.grid.get(cell).copied().unwrap_or(LEAF);
        let mut at = self.grid_level;
        while node & LEAF == 0 {
            if at < level + 2 {
                return self.between(node, at, x, y, level);
            }
            at -= 2;
            let [x, y] = [x, y].map(|v| v >> (at & 31) & 3);
            let Some(Brick(nodes)) = self.bricks.get(node as usize) else { return 0 };
            node = nodes.get((y << 2 | x) as usize).copied().unwrap_or(LEAF);
        }
        node & !LEAF
    }

    /// The same on a level above the grid's.
    fn coarse(&self, x: u32, y: u32, level: u8) -> u32 {
        let (shift, width) = (u32::from(level), u32::from(self.log2_resolution - level));
        // Cells of the levels above: 1 + 4 + 16 + …
        let first = ((1u32 << (2 * width)) - 1) / 3;
        let cell = first.wrapping_add((y >> shift) << width | x >> shift) as usize;
        self.above.get(cell).copied().unwrap_or(0)
    }

    /// The same in the square of a brick on level `at`, on this level or the next.
    fn between(&self, brick: u32, at: u8, x: u32, y: u32, level: u8) -> u32 {
        let square = if level < at { 1 + child_of(x, y, level) } else { 0 };
        self.holds.get(brick as usize).and_then(|h| h.get(square as usize)).copied().unwrap_or(0)
    }

    /// Makes the pyramid.
    fn build(&mut self) {
        let held = self.bytes() as u64 / 4;
        self.pyramid = Pyramid::new(self.log2_resolution, held, |x, y, level| self.evaluate(x, y, level));
    }

    /// Stored depth at a texel of the map.
    #[inline]
    pub(in crate::query) fn value(&self, x: u32, y: u32, level: u8) -> u32 {
        if self.pyramid.holds(level) { self.pyramid.value(x, y, level) } else { self.evaluate(x, y, level) }
    }

    /// The same from the entry that answers.
    #[inline]
    fn evaluate(&self, x: u32, y: u32, level: u8) -> u32 {
        let found = self.find(x, y, level);
        self.entries.value(found, centre(x, level), centre(y, level))
    }

    /// Depth at a place inside a texel of the map.
    #[inline]
    pub(in crate::query) fn continuous(&self, x: u32, y: u32, sub: [u8; 2]) -> u32 {
        let found = self.find(x, y, 0);
        let [fx, fy] = if found & PROVEN == 0 { [128; 2] } else { sub };
        self.entries.value(found, inside(x, fx), inside(y, fy))
    }

    /// Lit taps of those in the map: their parts go on together from the grid's cells.
    pub(in crate::query) fn lit(&self, taps: &Taps) -> u32 {
        if self.pyramid.holds(taps.level) {
            return self.pyramid.lit(taps);
        }
        let part = taps.inside;
        if taps.level > self.grid_level {
            let place = |v: u32| centre(v << (taps.level & 31), taps.level);
            return taps.lit_each(&part, |x, y| {
                let found = self.coarse(x << (taps.level & 31), y << (taps.level & 31), taps.level);
                self.entries.value(found, place(x), place(y))
            });
        }
        let width = u32::from(self.log2_resolution - self.grid_level);
        let node = |column: u32, row: u32| self.grid.get((row << width | column) as usize).copied().unwrap_or(LEAF);
        let shift = u32::from(self.grid_level - taps.level);
        if part.is_in_cell(shift) {
            let ([x, _], [y, _]) = (part.x, part.y);
            return self.lit_below(node(x >> shift, y >> shift), self.grid_level, part, taps);
        }
        self.lit_apart(self.grid_level, part, taps, node)
    }

    /// Lit taps of a part in several cells, `node` being the nodes of level `at` by column and row.
    #[inline]
    fn lit_apart(&self, at: u8, part: Rect, taps: &Taps, node: impl Fn(u32, u32) -> u32) -> u32 {
        let shift = u32::from(at - taps.level);
        let ([x, u], [y, v]) = (part.x.map(|x| x >> shift), part.y.map(|y| y >> shift));
        // A leaf above fills several cells.
        let first = node(x, y);
        if first & LEAF != 0 && (y..=v).all(|y| (x..=u).all(|x| node(x, y) == first)) {
            return self.entries.lit(first & !LEAF, taps, &part);
        }
        let mut lit = 0;
        part.cells(shift, |x, y, part| {
            let node = node(x, y);
            lit += match node & LEAF {
                0 => self.lit_below(node, at, part, taps),
                _ => self.entries.lit(node & !LEAF, taps, &part),
            };
        });
        lit
    }

    /// Lit taps of a part that lies in the square of a node of level `at`: together to their lowest common node (figure 5),
    /// then apart.
    fn lit_below(&self, mut node: u32, mut at: u8, part: Rect, taps: &Taps) -> u32 {
        let level = taps.level;
        let ([x, _], [y, _]) = (part.x, part.y);
        while node & LEAF == 0 {
            if at < level + 2 {
                let place = |v: u32| centre(v << (level & 31), level);
                return taps.lit_each(&part, |x, y| {
                    let found = self.between(node, at, x << (level & 31), y << (level & 31), level);
                    self.entries.value(found, place(x), place(y))
                });
            }
            let Some(Brick(nodes)) = self.bricks.get(node as usize) else { return taps.lit(&part, UNCOVERED) };
            let cell = |x: u32, y: u32| nodes.get(((y & 3) << 2 | (x & 3)) as usize).copied().unwrap_or(LEAF);
            at -= 2;
            let shift = u32::from(at - level);
            if !part.is_in_cell(shift) {
                return self.lit_apart(at, part, taps, cell);
            }
            node = cell(x >> shift, y >> shift);
        }
        self.entries.lit(node & !LEAF, taps, &part)
    }

    /// Bytes held.
    pub(in crate::query) fn bytes(&self) -> usize {
        let words = 21 * self.bricks.len() + self.grid.len() + self.above.len();
        words * 4 + self.entries.bytes() + self.pyramid.bytes()
    }
}
