//! The walk of kind `mmh`.
//!
//! - [`descend`]: a pure function over pages that are there or not; what is missing is answered by the value from above
//!   and named;
//! - `resident`: the same over all pages in one array.

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing,
    clippy::cast_possible_truncation
)]

pub(super) mod resident;

use umbrage_format::kind::mh::{NodeType, ROOT_GROUP, child_of};
use umbrage_format::kind::mmh::{Children, Node};
use umbrage_format::projection::UNCOVERED;

use super::mh::{next, root_mask};
pub use super::{Descent, PageView};

/// Walks from root `root` to texel (x, y) at `level` and adds up the rises on its way (Scandolo 2019, algorithm 3).
/// `lookup` gives the page of an ordinal, or `None` where it is not there. Ends after at most 25 nodes on any words;
/// words outside a page read as 0, and dependencies that a page does not have are missing as page `u32::MAX`.
pub fn descend<'a>(
    mut lookup: impl FnMut(u32) -> Option<PageView<'a>>,
    root: u32,
    log2_resolution: u8,
    x: u32,
    y: u32,
    level: u8,
) -> Descent {
    let mut d = Descent { value: UNCOVERED, level: log2_resolution, page: root, word: 0, missing: None };
    let mut ordinal = root;
    let Some(mut page) = lookup(root) else {
        d.missing = Some(root);
        return d;
    };
    let (mut mask, mut group) = (root_mask(page.words), u32::from(ROOT_GROUP));
    let mut at_level = log2_resolution.min(31);
    // The value above a root node is 0.
    let mut sum = 0u32;
    loop {
        let c = child_of(x, y, at_level);
        let kind = mask.child(c);
        if kind == NodeType::None {
            return d;
        }
        let at = group.saturating_add(mask.words_before(c));
        let word = page.words.get(at as usize).copied().unwrap_or(0);
        if kind.has_value() {
            sum = sum.wrapping_add(if kind == NodeType::Leaf { word } else { next(page.words, at) });
            d = Descent { value: sum, level: at_level, page: ordinal, word: at, missing: None };
        }
        if kind == NodeType::Leaf || at_level <= level {
            return d;
        }
        let node = Node::decode(word);
        let there = match node.children {
            Children::Here(_) => ordinal,
            Children::Page(child) => page.first_child.saturating_add(child.into()),
            Children::Shared(dependency, _) => {
                page.dependencies.get(usize::from(dependency)).copied().unwrap_or(u32::MAX)
            }
        };
        if there != ordinal {
            let Some(next) = lookup(there) else {
                d.missing = Some(there);
                return d;
            };
            (page, ordinal) = (next, there);
        }
        (mask, group) = match node.children {
            Children::Here(first) | Children::Shared(_, first) => (node.mask, first.into()),
            Children::Page(_) => (root_mask(page.words), u32::from(ROOT_GROUP)),
        };
        // Not below 0: at level 0 the walk has ended above, whatever level was asked for.
        at_level -= 1;
    }
}
