//! What the index says of the lookups that need a page, so that they can be settled without reading it.

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing,
    clippy::cast_possible_truncation
)]

use umbrage_format::PageRecord;

/// Bounds of the answers in a page's footprint (spec/container.md, `min_depth` and `stop_error`).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Bounds {
    /// Smallest depth that a lookup which needs the page can answer.
    pub min_depth: u32,
    /// Largest such depth.
    pub max_depth: u32,
    /// Lattice distance of the answer without the page to a texel's depth interval, at most.
    pub stop_error: u32,
}

impl Bounds {
    /// Nothing is known.
    pub const UNKNOWN: Self = Self { min_depth: 0, max_depth: u32::MAX, stop_error: u32::MAX };

    /// Of a page's record; nothing is known of shared pages.
    pub fn of(record: &PageRecord) -> Self {
        if record.is_shared() {
            return Self::UNKNOWN;
        }
        Self {
            min_depth: record.min_depth.get(),
            max_depth: record.max_depth.get(),
            stop_error: record.stop_error.get(),
        }
    }

    /// Light or shadow at `depth`, rounded up, where the page is not needed for it: all answers there lie on one side, or
    /// the `value` that stands above the page is off by at most `error` lattice steps. An error of 0 asks for the very value of
    /// the page: then only the first counts.
    #[inline]
    pub fn settle(&self, depth: u32, value: u32, error: u32) -> Option<bool> {
        if depth <= self.min_depth {
            return Some(true);
        }
        if depth > self.max_depth {
            return Some(false);
        }
        self.suffices(error).then_some(depth <= value)
    }

    /// Whether what stands above the page is good enough for `error`.
    #[inline]
    pub fn suffices(&self, error: u32) -> bool {
        error != 0 && self.stop_error <= error
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use umbrage_format::index::SHARED;

    use super::*;

    #[test]
    fn one_side_or_good_enough() {
        let b = Bounds { min_depth: 100, max_depth: 200, stop_error: 30 };
        assert_eq!([100, 101, 200, 201].map(|d| b.settle(d, 150, 0)), [Some(true), None, None, Some(false)]);
        assert_eq!([150, 151].map(|d| b.settle(d, 150, 30)), [Some(true), Some(false)]);
        assert_eq!(b.settle(150, 150, 29), None);
        // Right in every texel, and still not the page's own value.
        assert_eq!(Bounds { stop_error: 0, ..b }.settle(150, 150, 0), None);
        for depth in [1, 2, u32::MAX] {
            assert_eq!(Bounds::UNKNOWN.settle(depth, 5, u32::MAX - 1), None);
        }
    }

    #[test]
    fn nothing_is_known_of_shared_pages() {
        let mut record = PageRecord::zeroed();
        (record.min_depth, record.page_type) = (u32::MAX.into(), SHARED);
        assert_eq!(Bounds::of(&record), Bounds::UNKNOWN);
        record.page_type = 0;
        assert_ne!(Bounds::of(&record), Bounds::UNKNOWN);
    }
}
