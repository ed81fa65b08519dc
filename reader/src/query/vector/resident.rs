//! The walk of kind `vector` over all pages in one array, with a table of where each page's sections start.

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing,
    clippy::cast_possible_truncation
)]

use umbrage_format::kind::mh::child_of;
use umbrage_format::kind::vector::{Child, Layout, value};
use umbrage_format::projection::UNCOVERED;

use super::{PageView, centre, inside, side_mask};
use crate::query::resident::GRID_LEVELS;

/// Pages that are all checked and linked.
#[derive(Debug)]
pub(in crate::query) struct Tree {
    /// The pages one behind the other.
    words: Vec<u32>,
    pages: Vec<Page>,
    /// Walks that have come down to `grid_level` already, row by row.
    grid: Vec<Walk>,
    grid_level: u8,
    log2_resolution: u8,
}

/// What a lookup needs of a page before it looks at its words.
#[derive(Clone, Copy, Debug, Default)]
struct Page {
    /// First word in the array.
    first: u32,
    /// First child page.
    first_child: u32,
    /// Bits of coordinates that count in the footprint.
    side_mask: u32,
    layout: Layout,
}

/// A walk between two groups.
#[derive(Clone, Copy, Debug)]
struct Walk {
    /// Page of the next group, a stub's parent page where that is a stub; where the walk has ended, what was found
    /// ([`Tree::found`]).
    page: u32,
    /// Next group; [`ENDED`] where the walk has ended.
    group: u32,
    /// Page of the finest node with an entry; [`NOTHING`] where there was none.
    found_page: u32,
    /// That node: `4 * group + c`.
    found: u32,
    /// Level of the next group's nodes.
    level: u8,
}

/// No group: there are at most 32767 in a page.
const ENDED: u32 = u32::MAX;
/// No page.
const NOTHING: u32 = u32::MAX;
/// Bit of a found entry: it is proven where lookups end with it.
const PROVEN: u32 = 1 << 31;

impl Tree {
    /// From the pages, their first words and first children, and the walks to the grid's cells.
    pub(in crate::query) fn new(words: Vec<u32>, pages: &[(u32, u32)], log2_resolution: u8) -> Self {
        let page = |&(first, first_child): &(u32, u32)| {
            let own = words.get(first as usize..).unwrap_or_default();
            Page { first, first_child, side_mask: side_mask(own), layout: Layout::of(own) }
        };
        let pages = pages.iter().map(page).collect();
        let mut tree = Self { words, pages, grid: Vec::new(), grid_level: log2_resolution, log2_resolution };
        tree.build_grid();
        tree
    }

    /// Walks to every cell of the grid once.
    fn build_grid(&mut self) {
        let levels = GRID_LEVELS.min(self.log2_resolution);
        let level = self.log2_resolution - levels;
        let side = 1u32 << levels;
        let cells = (0..side).flat_map(|y| (0..side).map(move |x| (x << level, y << level)));
        self.grid = cells.map(|(x, y)| self.walk(self.start(), x, y, level)).collect();
        self.grid_level = level;
    }

    const fn start(&self) -> Walk {
        Walk { page: 0, group: 0, found_page: NOTHING, found: 0, level: self.log2_resolution }
    }

    #[inline]
    fn page(&self, ordinal: u32) -> (Page, &[u32]) {
        let page = self.pages.get(ordinal as usize).copied().unwrap_or_default();
        (page, self.words(&page))
    }

    /// The words from a page's first on. Checked pages read nothing behind their end.
    #[inline]
    fn words(&self, page: &Page) -> &[u32] {
        self.words.get(page.first as usize..).unwrap_or_default()
    }

    /// Goes on until `level` has been visited or the walk ends.
    #[inline]
    fn walk(&self, mut w: Walk, x: u32, y: u32, level: u8) -> Walk {
        let (mut page, mut words) = self.page(w.page);
        loop {
            let c = child_of(x, y, w.level);
            let mut child = Child::of(words, w.group, c);
            if child.mask.0 == 0 && w.group != 0 {
                // Checked pages have a place for every stub.
                w.page = page.first_child.wrapping_add(page.layout.stub(words, w.group).unwrap_or(0).into());
                (page, words) = self.page(w.page);
                w.group = 0;
                child = Child::of(words, 0, c);
            }
            let kind = u32::from(child.mask.0) >> (2 * c) & 3;
            // Types 1 and 2 have an entry, 2 and 3 children.
            if kind == 1 || kind == 2 {
                (w.found_page, w.found) = (w.page, 4 * w.group + c);
            }
            if kind < 2 {
                // A leaf is itself what was found; its index is at hand.
                w.page = if kind == 1 { Self::entry(&page, words, child.index) } else { self.found(&w) };
                w.group = ENDED;
                return w;
            }
            // Level 0 ends here in any case; checked pages have no children there.
            let end = w.level <= level;
            w.group = child.below;
            w.level = w.level.saturating_sub(1);
            if end {
                return w;
            }
        }
    }

    /// The walk to a texel of the map.
    #[inline]
    fn find(&self, x: u32, y: u32, level: u8) -> Walk {
        if level > self.grid_level {
            return self.walk(self.start(), x, y, level);
        }
        let (shift, width) = (u32::from(self.grid_level), u32::from(self.log2_resolution - self.grid_level));
        let cell = ((y >> shift) << width | x >> shift) as usize;
        let start = self.grid.get(cell).copied().unwrap_or_else(|| self.start());
        if level == self.grid_level || start.group == ENDED { start } else { self.walk(start, x, y, level) }
    }

    /// Entry of a node of a page, with [`PROVEN`].
    #[inline]
    fn entry(page: &Page, words: &[u32], index: u32) -> u32 {
        let proven = if page.layout.proven(words, index) { PROVEN } else { 0 };
        page.layout.entry(words, index) | proven
    }

    /// Entry that a walk found, with [`PROVEN`]; any where it found none.
    #[inline]
    fn found(&self, w: &Walk) -> u32 {
        if w.group == ENDED {
            return w.page;
        }
        let (page, words) = self.page(w.found_page);
        Self::entry(&page, words, Child::of(words, w.found / 4, w.found % 4).index)
    }

    /// Stored depth at a texel of the map.
    #[inline]
    pub(in crate::query) fn value(&self, x: u32, y: u32, level: u8) -> u32 {
        let w = self.find(x, y, level);
        let Some(page) = self.pages.get(w.found_page as usize) else { return UNCOVERED };
        let level = level.min(self.log2_resolution);
        let (x, y) = (centre(x & page.side_mask, level), centre(y & page.side_mask, level));
        value(self.words(page), &page.layout, self.found(&w) & !PROVEN, x, y)
    }

    /// Depth at a place inside a texel of the map.
    #[inline]
    pub(in crate::query) fn continuous(&self, x: u32, y: u32, sub: [u8; 2]) -> u32 {
        let w = self.find(x, y, 0);
        let Some(page) = self.pages.get(w.found_page as usize) else { return UNCOVERED };
        let entry = self.found(&w);
        let [fx, fy] = if entry & PROVEN == 0 { [128; 2] } else { sub };
        let (x, y) = (inside(x & page.side_mask, fx), inside(y & page.side_mask, fy));
        value(self.words(page), &page.layout, entry & !PROVEN, x, y)
    }

    /// A page, for walks that say which pages they need.
    pub(in crate::query) fn view(&self, ordinal: u32) -> Option<PageView<'_>> {
        let page = self.pages.get(ordinal as usize)?;
        let end = self.pages.get(ordinal as usize + 1).map_or(self.words.len(), |next| next.first as usize);
        Some(PageView { words: self.words.get(page.first as usize..end)?, first_child: page.first_child })
    }

    /// Bytes held.
    pub(in crate::query) fn bytes(&self) -> usize {
        let pages = self.pages.len() * size_of::<Page>();
        self.words.len() * 4 + pages + self.grid.len() * size_of::<Walk>()
    }
}
