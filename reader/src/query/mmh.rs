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

use umbrage_format::kind::mh::{Mask, NodeType, ROOT_GROUP, child_of};
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
    Walk::new(&mut lookup, root, log2_resolution).go(&mut lookup, x, y, level).0.found
}

/// A walk on its way.
#[derive(Clone, Copy)]
pub(super) struct Walk<'a> {
    pub(super) found: Descent,
    page: PageView<'a>,
    ordinal: u32,
    /// Rises so far; the value above a root node is 0.
    sum: u32,
    /// The next group, unless a node has been visited that must be opened first.
    mask: Mask,
    group: u32,
    /// Level of the next group or of that node.
    level: u8,
    opens: Option<Node>,
    ended: bool,
}

impl<'a> Walk<'a> {
    /// At the root's group.
    pub(super) fn new(mut lookup: impl FnMut(u32) -> Option<PageView<'a>>, root: u32, log2_resolution: u8) -> Self {
        let page = lookup(root);
        let missing = if page.is_none() { Some(root) } else { None };
        let found = Descent { value: UNCOVERED, level: log2_resolution, page: root, word: 0, missing };
        let page = page.unwrap_or(PageView { words: &[], first_child: 0, dependencies: &[] });
        let (mask, group, level) = (root_mask(page.words), u32::from(ROOT_GROUP), log2_resolution.min(31));
        Self { found, page, ordinal: root, sum: 0, mask, group, level, opens: None, ended: missing.is_some() }
    }

    /// Opens a node; false where the page of its children is not there.
    fn open(&mut self, lookup: &mut impl FnMut(u32) -> Option<PageView<'a>>, node: &Node) -> bool {
        let there = match node.children {
            Children::Here(_) => self.ordinal,
            Children::Page(child) => self.page.first_child.saturating_add(child.into()),
            Children::Shared(dependency, _) => {
                self.page.dependencies.get(usize::from(dependency)).copied().unwrap_or(u32::MAX)
            }
        };
        if there != self.ordinal {
            let Some(next) = lookup(there) else {
                (self.found.missing, self.ended) = (Some(there), true);
                return false;
            };
            (self.page, self.ordinal) = (next, there);
        }
        (self.mask, self.group) = match node.children {
            Children::Here(first) | Children::Shared(_, first) => (node.mask, first.into()),
            Children::Page(_) => (root_mask(self.page.words), u32::from(ROOT_GROUP)),
        };
        true
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
            if let Some(node) = self.opens {
                // Not below 0: a walk to level 0 is done there, whatever level was asked for.
                if self.level <= level || !self.open(&mut lookup, &node) {
                    break;
                }
                (self.opens, self.level) = (None, self.level - 1);
            }
            let c = child_of(x, y, self.level);
            let kind = self.mask.child(c);
            if kind == NodeType::None {
                self.ended = true;
                break;
            }
            let at = self.group.saturating_add(self.mask.words_before(c));
            let word = self.page.words.get(at as usize).copied().unwrap_or(0);
            if kind.has_value() {
                self.sum = self.sum.wrapping_add(if kind == NodeType::Leaf { word } else { next(self.page.words, at) });
                self.found =
                    Descent { value: self.sum, level: self.level, page: self.ordinal, word: at, missing: None };
            }
            (self.opens, self.ended) = (Some(Node::decode(word)), kind == NodeType::Leaf);
        }
        (self, self.ended)
    }
}
