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
    let mut d = Descent { value: UNCOVERED, level: log2_resolution, page: root, word: 0, missing: None };
    let mut found = None;
    let mut ordinal = root;
    let Some(mut page) = lookup(root) else {
        d.missing = Some(root);
        return (d, found);
    };
    let (mut group, mut at_level) = (0, log2_resolution.min(31));
    loop {
        let c = child_of(x, y, at_level);
        let mut child = Child::of(page.words, group, c);
        if child.mask.0 == 0 && group != 0 {
            let Some(place) = Layout::of(page.words).stub(page.words, group) else { return (d, found) };
            ordinal = page.first_child.saturating_add(place.into());
            let Some(next) = lookup(ordinal) else {
                d.missing = Some(ordinal);
                return (d, found);
            };
            (page, group) = (next, 0);
            child = Child::of(page.words, 0, c);
        }
        let kind = child.mask.child(c);
        if kind.has_value() {
            found = Some(Found { page, index: child.index });
            d = Descent { level: at_level, page: ordinal, word: 4 * group + c, ..d };
        }
        if !kind.has_children() || at_level <= level {
            return (d, found);
        }
        group = child.below;
        // Not below 0: at level 0 the walk has ended above, whatever level was asked for.
        at_level -= 1;
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
