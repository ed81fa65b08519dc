//! The walk of kind `vector`.
//!
//! - [`descend`]: a pure function over pages that are there or not; what is missing is answered by the entry from above
//!   and named;
//! - [`continuous`]: the same for a place inside a texel;
//! - `resident`: both over all pages in one array.

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing,
    clippy::cast_possible_truncation
)]

pub(super) mod resident;

use umbrage_format::kind::mh::child_of;
use umbrage_format::kind::vector::{Child, Layout, value};
use umbrage_format::projection::UNCOVERED;

use super::filter::{Rect, Taps};
pub use super::{Descent, PageView};

/// The node whose entry answers.
#[derive(Clone, Copy)]
struct Found<'a> {
    page: PageView<'a>,
    index: u32,
}

/// Walks from root `root` to texel (x, y) at `level`. `lookup` gives the page of an ordinal, or `None` where it is not
/// there. Ends after at most 25 nodes on any words; words outside a page read as 0.
pub fn descend<'a>(
    lookup: impl FnMut(u32) -> Option<PageView<'a>>,
    root: u32,
    log2_resolution: u8,
    x: u32,
    y: u32,
    level: u8,
) -> Descent {
    let (mut d, found) = walk(lookup, root, log2_resolution, x, y, level);
    if let Some(f) = found {
        let (layout, mask) = (Layout::of(f.page.words), side_mask(f.page.words));
        let level = level.min(log2_resolution);
        let entry = layout.entry(f.page.words, f.index);
        d.value = value(f.page.words, &layout, entry, centre(x & mask, level), centre(y & mask, level));
    }
    d
}

/// The value of the entry of a node, `word` = `4 * group + c`, at texel (x, y) of level 0: what lookups answer in place
/// of a page below the node, and in its footprint.
pub fn node_value(page: PageView<'_>, word: u32, x: u32, y: u32) -> u32 {
    let (layout, mask) = (Layout::of(page.words), side_mask(page.words));
    let entry = layout.entry(page.words, Child::of(page.words, word / 4, word % 4).index);
    value(page.words, &layout, entry, centre(x & mask, 0), centre(y & mask, 0))
}

/// Whether the entry of a node, `word` = `4 * group + c`, is proven where it answers: continuous lookups that end there
/// are evaluated at their place, others at the texel's centre.
pub fn is_proven(page: PageView<'_>, word: u32) -> bool {
    Layout::of(page.words).proven(page.words, Child::of(page.words, word / 4, word % 4).index)
}

/// Answer at a place inside texel (x, y), `sub` 1/256 of a texel from its corner: the entry's value there where it is
/// proven, else that of the texel.
pub fn continuous<'a>(
    lookup: impl FnMut(u32) -> Option<PageView<'a>>,
    root: u32,
    log2_resolution: u8,
    x: u32,
    y: u32,
    sub: [u8; 2],
) -> Descent {
    let (mut d, found) = walk(lookup, root, log2_resolution, x, y, 0);
    if let Some(f) = found {
        let (layout, mask) = (Layout::of(f.page.words), side_mask(f.page.words));
        let [fx, fy] = if layout.proven(f.page.words, f.index) { sub } else { [128; 2] };
        let entry = layout.entry(f.page.words, f.index);
        d.value = value(f.page.words, &layout, entry, inside(x & mask, fx), inside(y & mask, fy));
    }
    d
}

/// The way to the finest node with an entry, which is not evaluated yet.
fn walk<'a>(
    mut lookup: impl FnMut(u32) -> Option<PageView<'a>>,
    root: u32,
    log2_resolution: u8,
    x: u32,
    y: u32,
    level: u8,
) -> (Descent, Option<Found<'a>>) {
    let w = Walk::new(&mut lookup, root, log2_resolution).go(&mut lookup, x, y, level).0;
    (w.found, w.entry)
}

/// A walk on its way.
#[derive(Clone, Copy)]
pub(super) struct Walk<'a> {
    /// The answer without its value.
    pub(super) found: Descent,
    /// The node whose entry is the value.
    entry: Option<Found<'a>>,
    page: PageView<'a>,
    ordinal: u32,
    group: u32,
    /// Level of the group.
    level: u8,
    /// The group below a node of `group` that has been visited.
    opens: Option<u32>,
    ended: bool,
}

impl<'a> Walk<'a> {
    /// At the root's group.
    pub(super) fn new(mut lookup: impl FnMut(u32) -> Option<PageView<'a>>, root: u32, log2_resolution: u8) -> Self {
        let page = lookup(root);
        let missing = if page.is_none() { Some(root) } else { None };
        let found = Descent { value: UNCOVERED, level: log2_resolution, page: root, word: 0, missing };
        let page = page.unwrap_or(PageView { words: &[], first_child: 0, dependencies: &[] });
        let (level, ended) = (log2_resolution.min(31), missing.is_some());
        Self { found, entry: None, page, ordinal: root, group: 0, level, opens: None, ended }
    }

    /// Goes on towards texel (x, y) until a node of `level` or above has been visited, or the walk has ended, which it says.
    pub(super) fn go(
        mut self,
        mut lookup: impl FnMut(u32) -> Option<PageView<'a>>,
        x: u32,
        y: u32,
        level: u8,
    ) -> (Self, bool) {
        while !self.ended {
            if let Some(below) = self.opens {
                // Not below 0: a walk to level 0 is done there, whatever level was asked for.
                if self.level <= level {
                    break;
                }
                (self.group, self.opens, self.level) = (below, None, self.level - 1);
            }
            let c = child_of(x, y, self.level);
            let mut child = Child::of(self.page.words, self.group, c);
            if child.mask.0 == 0 && self.group != 0 {
                let Some(place) = Layout::of(self.page.words).stub(self.page.words, self.group) else {
                    self.ended = true;
                    break;
                };
                let there = self.page.first_child.saturating_add(place.into());
                let Some(next) = lookup(there) else {
                    (self.found.missing, self.ended) = (Some(there), true);
                    break;
                };
                (self.page, self.ordinal, self.group) = (next, there, 0);
                child = Child::of(next.words, 0, c);
            }
            let kind = child.mask.child(c);
            if kind.has_value() {
                self.entry = Some(Found { page: self.page, index: child.index });
                let word = 4 * self.group + c;
                self.found = Descent { level: self.level, page: self.ordinal, word, ..self.found };
            }
            (self.opens, self.ended) = (Some(child.below), !kind.has_children());
        }
        (self, self.ended)
    }

    /// Lit taps of a part that the node found answers.
    pub(super) fn lit(&self, taps: &Taps, part: &Rect) -> u32 {
        let Some(Found { page, index }) = self.entry else { return taps.lit(part, UNCOVERED) };
        let (layout, mask) = (Layout::of(page.words), side_mask(page.words));
        let entry = layout.entry(page.words, index);
        let place = |v: u32| centre((v << (taps.level & 31)) & mask, taps.level);
        taps.lit_each(part, |x, y| value(page.words, &layout, entry, place(x), place(y)))
    }
}

impl Walk<'_> {
    /// What the node found answers at texel (x, y) of `level`.
    pub(super) fn value(&self, x: u32, y: u32, level: u8) -> u32 {
        let Some(Found { page, index }) = self.entry else { return UNCOVERED };
        let (layout, mask) = (Layout::of(page.words), side_mask(page.words));
        let place = |v: u32| centre((v << (level & 31)) & mask, level);
        value(page.words, &layout, layout.entry(page.words, index), place(x), place(y))
    }
}

/// The bits of a texel's coordinates that count in a page's footprint: its side is twice that of the root group's nodes.
/// In a root page, whose footprint is the map, this is one bit more than there are.
#[inline]
fn side_mask(words: &[u32]) -> u32 {
    let [_, _, level, _] = words.get(1).copied().unwrap_or(0).to_le_bytes();
    (2u32 << (level & 31)).wrapping_sub(1)
}

/// Place of the centre of the texel of `level` around texel `v` of the footprint.
#[inline]
fn centre(v: u32, level: u8) -> i64 {
    let level = level & 31;
    (i64::from(v >> level) << (level + 8)) + (128i64 << level)
}

/// Place inside texel `v` of the footprint.
#[inline]
fn inside(v: u32, sub: u8) -> i64 {
    i64::from(v) << 8 | i64::from(sub)
}
