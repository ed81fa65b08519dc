//! Kind `mmh`: the merged quadtree of Scandolo 2019, section 2.6: kind [`mh`](super::mh) with values relative to the
//! node above, in which several nodes may refer to one group of children.
//!
//! ```text
//! leaf    word 0   the rise
//! inner   word 0   bits 0..8 mask | 8..16 place | 16..32 at        word 1   the rise
//! empty   word 0   as inner, no rise
//!
//! rise    the node's value less the value above it, modulo 2^32; the value above a root node is 0
//! mask    as in mh: bits 2c..2c+2 are the type of child c
//! place   0: the children lie in this page, from word `at`
//!         1: they are the root group of child page `at`: the page of ordinal record.first_child + at
//!         2 + d: they lie in the page of dependency d, from word `at`
//! ```
//!
//! So a reference has 24 bits, 8 of the page and 16 of the place in it (the paper: 24 bits of offset). A group that
//! several nodes refer to has no place in the map, and none of its own value: a lookup adds up rises on its way.
//!
//! **Tree pages** begin as those of kind `mh`. **Shared pages** hold groups that nodes of several pages refer to; their
//! word 2 is a number n of entries, followed by n masks of 8 bits, 4 to a word, and then the groups: at each word where
//! no group before has announced one, the next entry's begins. A page depends on shared pages; these depend on none.
//!
//! In every page children lie behind all nodes that refer to them: one pass from front to back knows the types of each
//! group before it comes to it.

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing,
    clippy::cast_possible_truncation
)]

mod check;
mod link;

pub use check::{check, check_values};
pub use link::{Link, References, check_link, links, shared_groups};

use super::mh::{Mask, NodeType};
use crate::index::MAX_PAGE_WORDS;

/// Most dependencies of a page: what is left of 8 bits.
pub const MAX_DEPENDENCIES: u16 = 254;
/// Most words of a page and its dependencies together: a device has the list of ordinals behind the words.
pub const MAX_WORDS: u32 = MAX_PAGE_WORDS as u32;
/// First word of a shared page behind the frame: the number of its entries.
pub const ENTRIES: usize = 2;

/// Where the children of a node lie.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Children {
    /// In the same page, from this word.
    Here(u16),
    /// They are the root group of this child page, an index below `child_refs`.
    Page(u16),
    /// In the page of this dependency, from this word.
    Shared(u8, u16),
}

/// First word of an inner or empty node.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Node {
    /// Types of the children.
    pub mask: Mask,
    /// Where they lie.
    pub children: Children,
}

impl Node {
    /// The word. Dependencies from 254 on do not fit and are taken modulo 256.
    #[inline]
    pub const fn encode(self) -> u32 {
        let (place, at) = match self.children {
            Children::Here(word) => (0, word),
            Children::Page(child) => (1, child),
            Children::Shared(dependency, word) => (dependency.wrapping_add(2), word),
        };
        self.mask.0 as u32 | (place as u32) << 8 | (at as u32) << 16
    }

    /// Reads the word.
    #[inline]
    pub const fn decode(word: u32) -> Self {
        let [mask, place, low, high] = word.to_le_bytes();
        let at = u16::from_le_bytes([low, high]);
        let children = match place {
            0 => Children::Here(at),
            1 => Children::Page(at),
            _ => Children::Shared(place - 2, at),
        };
        Self { mask: Mask(mask), children }
    }
}

/// Words of the table of entries of a shared page, the number included.
#[inline]
pub const fn entry_words(entries: u32) -> u32 {
    1 + entries.div_ceil(4)
}

/// Mask of entry `i` of a shared page; 0 outside.
#[inline]
pub fn entry(page: &[u32], i: u32) -> Mask {
    let word = page.get(ENTRIES + 1 + (i / 4) as usize).copied().unwrap_or(0);
    let [byte, ..] = (word >> (8 * (i % 4))).to_le_bytes();
    Mask(byte)
}

/// A group, as the nodes say that refer to it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Announced {
    mask: Mask,
    /// Lowest level of a node that refers to it, less 1.
    level: u8,
    /// Whether only one node refers to it, and to the group that this node is in, and so on: it has one place in the map.
    alone: bool,
}

/// What waits in a page: for each word the group that begins there, in 16 bits.
struct Waiting {
    groups: [u16; MAX_PAGE_WORDS as usize],
}

impl Waiting {
    fn new() -> Self {
        Self { groups: [0; MAX_PAGE_WORDS as usize] }
    }

    fn get(&self, at: u32) -> Option<Announced> {
        let group = self.groups.get(at as usize).copied().filter(|g| *g != 0)?;
        let [mask, rest] = group.to_le_bytes();
        Some(Announced { mask: Mask(mask), level: rest & 31, alone: rest & 32 != 0 })
    }

    /// Notes a group; `None` where another one is noted there or the word lies outside, else whether it is the first
    /// time.
    fn announce(&mut self, at: u32, group: Announced) -> Option<bool> {
        let before = self.get(at);
        let slot = self.groups.get_mut(at as usize)?;
        let (group, fresh) = match before {
            Some(b) if b.mask != group.mask => return None,
            Some(b) => (Announced { level: b.level.min(group.level), alone: false, ..b }, false),
            None => (group, true),
        };
        *slot = u16::from(group.mask.0) | u16::from(group.level & 31 | u8::from(group.alone) << 5) << 8;
        Some(fresh)
    }
}

/// The nodes of a group: child, type, word.
fn nodes(mask: Mask, start: u32) -> impl Iterator<Item = (u32, NodeType, u32)> {
    (0..4)
        .map(move |c| (c, mask.child(c), start.saturating_add(mask.words_before(c))))
        .filter(|(_, kind, _)| *kind != NodeType::None)
}

/// First word of the first group of a page.
fn first_group(page: &[u32], shared: bool) -> u32 {
    let entries = page.get(ENTRIES).copied().unwrap_or(0).min(MAX_WORDS);
    if shared { 2 + entry_words(entries) } else { 2 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nodes_keep_their_bits() {
        let all = [Children::Here(0xFFFF), Children::Page(513), Children::Shared(0, 9), Children::Shared(253, 0x1234)];
        for children in all {
            let node = Node { mask: Mask(0b11_10_01_00), children };
            assert_eq!(Node::decode(node.encode()), node);
        }
        assert_eq!(Node { mask: Mask(0xE4), children: Children::Shared(1, 0x1234) }.encode(), 0x1234_03E4);
    }

    #[test]
    fn entries_lie_four_to_a_word() {
        let page = [0, 0, 5, 0x4433_2211, 0x55];
        assert_eq!([0, 1, 2, 3, 4, 5, 40].map(|i| entry(&page, i).0), [0x11, 0x22, 0x33, 0x44, 0x55, 0, 0]);
        assert_eq!([0, 1, 4, 5].map(entry_words), [1, 2, 2, 3]);
        assert_eq!((first_group(&page, true), first_group(&page, false)), (5, 2));
    }
}
