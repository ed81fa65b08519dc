//! The coarsest levels of a map as plain arrays: what lookups on them answer, texel by texel. Hierarchical filters ask them more
//! often than any other, and the nodes there differ most.

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing,
    clippy::cast_possible_truncation
)]

use umbrage_format::projection::UNCOVERED;

use super::filter::Taps;
use super::resident::GRID_LEVELS;

/// Levels that are held at most: 1024 x 1024 texels on the finest, 5.3 MiB in all.
const MOST: u8 = 10;
/// Levels that are held however small a file is.
const LEAST: u8 = GRID_LEVELS;

/// Values of the levels from `finest` up.
#[derive(Debug, Default)]
pub(super) struct Pyramid {
    /// Coarsest level first, row by row.
    values: Vec<u32>,
    finest: u8,
    log2_resolution: u8,
}

impl Pyramid {
    /// Levels of the pyramid of a map that holds so many words otherwise: at most half of them are added.
    fn levels(log2_resolution: u8, words: u64) -> u8 {
        let fits = |levels: &u8| 2 * words_of(*levels) <= words;
        (LEAST..=MOST).rev().find(fits).unwrap_or(LEAST).min(log2_resolution)
    }

    /// Words that it takes.
    pub(super) fn words_held(log2_resolution: u8, words: u64) -> u64 {
        words_of(Self::levels(log2_resolution, words))
    }

    /// From lookups, `value` at a texel of level 0 and a level.
    pub(super) fn new(log2_resolution: u8, words: u64, value: impl Fn(u32, u32, u8) -> u32) -> Self {
        let levels = Self::levels(log2_resolution, words);
        let mut values = Vec::with_capacity(usize::try_from(words_of(levels)).unwrap_or(0));
        for width in 0..=levels {
            let (level, side) = (log2_resolution - width, 1u32 << width);
            let texels = (0..side).flat_map(|y| (0..side).map(move |x| (x << level, y << level)));
            values.extend(texels.map(|(x, y)| value(x, y, level)));
        }
        Self { values, finest: log2_resolution - levels, log2_resolution }
    }

    /// Whether it answers a level.
    #[inline]
    pub(super) fn holds(&self, level: u8) -> bool {
        level >= self.finest
    }

    /// Place of a texel of a level.
    #[inline]
    fn place(&self, x: u32, y: u32, level: u8) -> usize {
        let width = u32::from(self.log2_resolution.saturating_sub(level)) & 15;
        // Texels of the levels above: 1 + 4 + 16 + …
        let first = ((1u32 << (2 * width)) - 1) / 3;
        first.wrapping_add(y << width | x) as usize
    }

    /// What a lookup at a texel of level 0 answers; levels above the root's as the root's.
    #[inline]
    pub(super) fn value(&self, x: u32, y: u32, level: u8) -> u32 {
        let level = level.min(self.log2_resolution) & 31;
        self.values.get(self.place(x >> level, y >> level, level)).copied().unwrap_or(UNCOVERED)
    }

    /// Lit taps of those in the map.
    pub(super) fn lit(&self, taps: &Taps) -> u32 {
        let ([x, u], [y, v]) = (taps.inside.x, taps.inside.y);
        let row = |y: u32| {
            let first = self.place(x, y, taps.level);
            let values = self.values.get(first..=first + (u - x) as usize).unwrap_or_default();
            taps.lit_row(x, y, values.iter().copied())
        };
        (y..=v).map(row).sum()
    }

    /// Bytes held.
    pub(super) fn bytes(&self) -> usize {
        self.values.len() * 4
    }
}

/// Texels of a level of `1 << levels` on a side and of those above.
fn words_of(levels: u8) -> u64 {
    ((4u64 << (2 * (levels & 15))) - 1) / 3
}
