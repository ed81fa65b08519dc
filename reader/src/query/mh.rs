//! The walk of kind `mh`.
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

use umbrage_format::kind::mh::{Children, Mask, Node, NodeType, ROOT_GROUP, child_of};
use umbrage_format::projection::UNCOVERED;

pub use super::{Descent, PageView};

/// Walks from root `root` to texel (x, y) at `level`. `lookup` gives the page of an ordinal, or `None` where it is not
/// there. Ends after at most 25 nodes on any words; words outside a page read as 0.
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
    loop {
        let c = child_of(x, y, at_level);
        let kind = mask.child(c);
        if kind == NodeType::None {
            return d;
        }
        let at = group.saturating_add(mask.words_before(c));
        let word = page.words.get(at as usize).copied().unwrap_or(0);
        if kind.has_value() {
            let value = if kind == NodeType::Leaf { word } else { next(page.words, at) };
            d = Descent { value, level: at_level, page: ordinal, word: at, missing: None };
        }
        if kind == NodeType::Leaf || at_level <= level {
            return d;
        }
        let node = Node::decode(word);
        match node.children {
            Children::Here(first) => (mask, group) = (node.mask, first.into()),
            Children::Page(child) => {
                ordinal = page.first_child.saturating_add(child.into());
                let Some(next) = lookup(ordinal) else {
                    d.missing = Some(ordinal);
                    return d;
                };
                page = next;
                (mask, group) = (root_mask(page.words), u32::from(ROOT_GROUP));
            }
        }
        // Not below 0: at level 0 the walk has ended above, whatever level was asked for.
        at_level -= 1;
    }
}

pub(super) fn next(words: &[u32], at: u32) -> u32 {
    words.get(at as usize + 1).copied().unwrap_or(0)
}

/// Types of a page's root group.
pub(super) fn root_mask(words: &[u32]) -> Mask {
    let [_, mask, _, _] = words.first().copied().unwrap_or(0).to_le_bytes();
    Mask(mask)
}
