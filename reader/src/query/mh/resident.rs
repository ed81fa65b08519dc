//! The walk of kind `mh` over all pages in one array.

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing,
    clippy::cast_possible_truncation
)]

use std::cmp::Ordering;

use umbrage_format::kind::mh::{Mask, ROOT_GROUP, child_of};
use umbrage_format::projection::UNCOVERED;

use super::root_mask;
use crate::query::filter::{Rect, Taps};
use crate::query::pyramid::Pyramid;
use crate::query::resident::GRID_LEVELS;

/// Pages that are all checked and linked.
#[derive(Debug)]
pub(in crate::query) struct Tree {
    /// The pages one behind the other.
    words: Vec<u32>,
    /// For each page its first word and its first child.
    pages: Vec<(u32, u32)>,
    /// Walks that have come down to `grid_level` already, row by row.
    grid: Vec<Walk>,
    grid_level: u8,
    /// What answers from `grid_level` up, at least.
    pyramid: Pyramid,
    log2_resolution: u8,
}

/// A walk between two groups.
#[derive(Clone, Copy, Debug)]
struct Walk {
    /// Value last seen.
    value: u32,
    /// First word of the page.
    page: u32,
    /// First child of the page.
    first_child: u32,
    /// First word of the next group in the array.
    group: u32,
    /// Types of the next group; none where the walk has ended.
    mask: Mask,
    /// Level of the next group's nodes.
    level: u8,
}

impl Tree {
    /// From the pages, their first words and first children, and the walks to the grid's cells.
    pub(in crate::query) fn new(words: Vec<u32>, pages: Vec<(u32, u32)>, log2_resolution: u8) -> Self {
        let mut tree = Self {
            words,
            pages,
            grid: Vec::new(),
            grid_level: log2_resolution,
            pyramid: Pyramid::default(),
            log2_resolution,
        };
        tree.build();
        tree
    }

    /// Walks to every cell of the grid once, then on from these.
    fn build(&mut self) {
        let levels = GRID_LEVELS.min(self.log2_resolution);
        let level = self.log2_resolution - levels;
        let side = 1u32 << levels;
        let cells = (0..side).flat_map(|y| (0..side).map(move |x| (x << level, y << level)));
        self.grid = cells.map(|(x, y)| self.walk(self.start(), x, y, level)).collect();
        self.grid_level = level;
        let value = |x: u32, y: u32, l: u8| {
            let cell = self.cell(x >> level, y >> level);
            match l.cmp(&level) {
                Ordering::Greater => self.walk(self.start(), x, y, l).value,
                Ordering::Less if cell.mask.0 != 0 => self.walk(cell, x, y, l).value,
                _ => cell.value,
            }
        };
        self.pyramid = Pyramid::new(self.log2_resolution, self.words.len() as u64, value);
    }

    fn start(&self) -> Walk {
        let mask = root_mask(&self.words);
        let first_child = self.pages.first().map_or(0, |p| p.1);
        let level = self.log2_resolution.min(31);
        Walk { value: UNCOVERED, page: 0, first_child, group: ROOT_GROUP.into(), mask, level }
    }

    #[inline]
    fn word(&self, at: u32) -> u32 {
        self.words.get(at as usize).copied().unwrap_or(0)
    }

    /// Goes on until `level` has been visited or the walk ends.
    #[inline]
    fn walk(&self, mut w: Walk, x: u32, y: u32, level: u8) -> Walk {
        loop {
            // Level 0 ends here in any case; checked pages have no children there.
            let end = w.level <= level;
            w = self.step(w, child_of(x, y, w.level));
            if end || w.mask.0 == 0 {
                return w;
            }
        }
    }

    /// Visits child c of the next group.
    #[inline(always)]
    fn step(&self, mut w: Walk, c: u32) -> Walk {
        let kind = u32::from(w.mask.0) >> (2 * c) & 3;
        if kind == 0 {
            w.mask = Mask(0);
            return w;
        }
        let at = w.group.wrapping_add(w.mask.words_before(c));
        let word = self.word(at);
        if kind == 1 {
            (w.value, w.mask) = (word, Mask(0));
            return w;
        }
        if kind == 2 {
            w.value = self.word(at.wrapping_add(1));
        }
        let [mask, place, low, high] = word.to_le_bytes();
        let first = u32::from(u16::from_le_bytes([low, high]));
        if place & 1 == 0 {
            (w.mask, w.group) = (Mask(mask), w.page.wrapping_add(first));
        } else {
            let child = w.first_child.wrapping_add(first) as usize;
            let (page, first_child) = self.pages.get(child).copied().unwrap_or((u32::MAX, 0));
            let [_, mask, _, _] = self.word(page).to_le_bytes();
            (w.page, w.first_child, w.mask) = (page, first_child, Mask(mask));
            w.group = page.wrapping_add(ROOT_GROUP.into());
        }
        w.level = w.level.saturating_sub(1);
        w
    }

    /// The cell of the grid that a walk to a texel begins in, by the cell's column and row.
    #[inline]
    fn cell(&self, column: u32, row: u32) -> Walk {
        let width = u32::from(self.log2_resolution - self.grid_level);
        self.grid.get((row << width | column) as usize).copied().unwrap_or_else(|| self.start())
    }

    /// Stored depth at a texel of the map.
    #[inline]
    pub(in crate::query) fn value(&self, x: u32, y: u32, level: u8) -> u32 {
        if self.pyramid.holds(level) {
            return self.pyramid.value(x, y, level);
        }
        let shift = u32::from(self.grid_level);
        let start = self.cell(x >> shift, y >> shift);
        if start.mask.0 == 0 { start.value } else { self.walk(start, x, y, level).value }
    }

    /// Lit taps of those in the map: their parts go on together from the grid's cells.
    pub(in crate::query) fn lit(&self, taps: &Taps) -> u32 {
        if self.pyramid.holds(taps.level) {
            return self.pyramid.lit(taps);
        }
        let (part, shift) = (taps.inside, u32::from(self.grid_level - taps.level));
        if part.is_in_cell(shift) {
            let ([x, _], [y, _]) = (part.x, part.y);
            return self.lit_below(self.cell(x >> shift, y >> shift), part, taps);
        }
        let mut lit = 0;
        part.cells(shift, |column, row, part| lit += self.lit_below(self.cell(column, row), part, taps));
        lit
    }

    /// Lit taps of a part that a walk leads to: together to their lowest common node (figure 5), then apart.
    fn lit_below(&self, mut w: Walk, part: Rect, taps: &Taps) -> u32 {
        let ([x, _], [y, _]) = (part.x, part.y);
        let mut shift = u32::from(w.level.saturating_sub(taps.level));
        while w.mask.0 != 0 && part.is_in_cell(shift) {
            w = self.step(w, x >> (shift & 31) & 1 | (y >> (shift & 31) & 1) << 1);
            if shift == 0 {
                return taps.lit(&part, w.value);
            }
            shift -= 1;
        }
        if w.mask.0 == 0 {
            return taps.lit(&part, w.value);
        }
        let mut lit = 0;
        part.cells(shift, |column, row, part| {
            let child = self.step(w, column & 1 | (row & 1) << 1);
            lit += match shift {
                0 => u32::from(taps.is_lit(column, row, child.value)),
                _ => self.lit_below(child, part, taps),
            };
        });
        lit
    }

    /// Bytes held.
    pub(in crate::query) fn bytes(&self) -> usize {
        self.words.len() * 4 + self.pages.len() * 8 + self.grid.len() * size_of::<Walk>() + self.pyramid.bytes()
    }
}
