//! Kind `mh`: the compressed quadtree of Scandolo, Bauszat and Eisemann 2016, section 3.2.
//!
//! Two departures from the paper: child offsets count within a page of at most 16384 words, so the 16-bit pointer
//! needs no scale per level; and a group of children may lie in another page.
//!
//! ```text
//! leaf    word 0   the value
//! inner   word 0   bits 0..8 mask | 8..16 place | 16..32 at        word 1   the value
//! empty   word 0   as inner, no value
//!
//! mask    bits 2c..2c+2 are the type of child c: 0 none, 1 leaf, 2 inner, 3 empty; c = x bit | y bit << 1
//! place   0: the children lie in this page, one behind the other by rising c, from word `at`
//!         1: they are the root group of child page `at`: the page of ordinal record.first_child + at
//! ```
//!
//! The root group of a page starts at word 2, directly behind the frame; its types are the frame's `root_mask`, its
//! nodes are at the frame's `root_level`. The page of a tree's root has one child in it, number 0: the root node, a
//! leaf or inner, at level `log2_resolution`. Level 0 is the texel.
//!
//! **Lookup** (x, y, level L): take child c of the group, c from bit l of x and y where l is the group's level; keep
//! the value last seen; stop at a missing child, at a leaf, or when l = L; the value last seen is the answer. A lookup
//! takes the types of a page's root group from that page, never from the parent, so that it is safe on any page that
//! passed [`check`] alone.

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing,
    clippy::cast_possible_truncation
)]

mod check;

pub use check::check;

pub use super::tree::PageCounts;
use super::tree::check_announced;
use crate::error::{FormatError, Rule};
use crate::page::{FRAME_WORDS, FrameHead, PageContext};

/// First word of the root group.
pub const ROOT_GROUP: u16 = 2;
const _: () = assert!(ROOT_GROUP as usize == FRAME_WORDS);

/// Type of a node, as the mask of its parent has it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum NodeType {
    /// No node: the value from above holds.
    None = 0,
    /// A value and no children; 1 word.
    Leaf = 1,
    /// Children and a value; 2 words.
    Inner = 2,
    /// Children and no value; 1 word.
    Empty = 3,
}

impl NodeType {
    /// From the low 2 bits.
    #[inline]
    pub const fn from_bits(bits: u8) -> Self {
        match bits & 3 {
            0 => Self::None,
            1 => Self::Leaf,
            2 => Self::Inner,
            _ => Self::Empty,
        }
    }

    /// Words that a node of this type takes.
    #[inline]
    pub const fn words(self) -> u32 {
        match self {
            Self::None => 0,
            Self::Leaf | Self::Empty => 1,
            Self::Inner => 2,
        }
    }

    /// Whether the node has a value.
    #[inline]
    pub const fn has_value(self) -> bool {
        matches!(self, Self::Leaf | Self::Inner)
    }

    /// Whether the node has children.
    #[inline]
    pub const fn has_children(self) -> bool {
        matches!(self, Self::Inner | Self::Empty)
    }
}

/// Types of the 4 children of a group, 2 bits each.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Mask(pub u8);

impl Mask {
    /// Mask of 4 types by rising child number.
    pub const fn new(types: [NodeType; 4]) -> Self {
        let [a, b, c, d] = types;
        Self(a as u8 | (b as u8) << 2 | (c as u8) << 4 | (d as u8) << 6)
    }

    /// Whether there is no inner and no empty child.
    #[inline]
    pub const fn is_leaves(self) -> bool {
        self.0 & 0b1010_1010 == 0
    }

    /// Type of child `c`, 0 to 3.
    #[inline]
    pub const fn child(self, c: u32) -> NodeType {
        NodeType::from_bits(self.0 >> ((c & 3) * 2))
    }

    /// Whether some child has no value of its own: then a lookup in the group may answer the value from above.
    #[inline]
    pub const fn inherits(self) -> bool {
        let (first, second) = (self.0 & 0x55, self.0 >> 1 & 0x55);
        // Bits 01 and 10 are leaf and inner.
        first ^ second != 0x55
    }

    /// Words of the children before child `c`, 0 to 4: what to add to the group's first word.
    #[inline]
    pub const fn words_before(self, c: u32) -> u32 {
        let low = self.0 as u32 & ((1 << ((c & 7) * 2)) - 1);
        let (first, second) = (low & 0x55, (low >> 1) & 0x55);
        // Every node takes a word; inner nodes (bits 10) one more.
        (first | second).count_ones() + (second & !first).count_ones()
    }

    /// Words of the whole group, 0 to 8.
    #[inline]
    pub const fn words(self) -> u32 {
        self.words_before(4)
    }
}

/// Where the children of a node lie.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Children {
    /// In the same page, from this word.
    Here(u16),
    /// They are the root group of this child page, an index below `child_refs`.
    Page(u16),
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
    /// The word.
    #[inline]
    pub const fn encode(self) -> u32 {
        let (place, at) = match self.children {
            Children::Here(word) => (0, word),
            Children::Page(child) => (1, child),
        };
        self.mask.0 as u32 | place << 8 | (at as u32) << 16
    }

    /// Reads the word. Only bit 0 of `place` counts; [`check`] refuses the others.
    #[inline]
    pub const fn decode(word: u32) -> Self {
        let [mask, place, low, high] = word.to_le_bytes();
        let at = u16::from_le_bytes([low, high]);
        Self { mask: Mask(mask), children: if place & 1 == 0 { Children::Here(at) } else { Children::Page(at) } }
    }
}

/// Number of the child of a group at `level` that texel (x, y) lies in; level at most 31.
#[inline]
pub const fn child_of(x: u32, y: u32, level: u8) -> u32 {
    (x >> (level & 31) & 1) | (y >> (level & 31) & 1) << 1
}

/// Groups that wait: a group leaves at most 4 groups behind at each of 25 levels, of which one is taken at once.
const WAITING: usize = 4 * 25;

/// What a page and one of its nodes say about the child page that holds the node's children.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Link {
    /// Root that the page belongs to.
    pub root: u16,
    /// Smallest and largest depth of the page.
    pub depths: (u32, u32),
    /// The value that holds above the children; none where it is not known.
    pub inherited: Option<u32>,
    /// Types of the children.
    pub mask: Mask,
    /// Level of the children.
    pub level: u8,
    /// First texel of the node in x, finest level.
    pub x: u32,
    /// First texel of the node in y.
    pub y: u32,
}

/// Calls `visit` with the index and the [`Link`] of every child page that a page refers to; `inherited` is the value
/// that holds above the page, none where it is not known or the page is a root's. The page must have passed [`check`],
/// which makes the walk linear; on other words it may take exponential time.
pub fn links(
    page: &[u32],
    head: &FrameHead,
    cx: &PageContext<'_>,
    inherited: Option<u32>,
    mut visit: impl FnMut(u16, Link),
) {
    let top = Link {
        root: cx.page.root.get(),
        depths: (cx.page.min_depth.get(), cx.page.max_depth.get()),
        inherited,
        mask: Mask(head.root_mask),
        level: head.root_level,
        x: cx.page.origin_x.get(),
        y: cx.page.origin_y.get(),
    };
    let mut waiting = [(ROOT_GROUP, top); WAITING];
    let mut count = 1usize;
    while let Some(&(start, group)) = count.checked_sub(1).and_then(|top| waiting.get(top)) {
        count -= 1;
        for c in (0..4).filter(|&c| group.mask.child(c).has_children()) {
            let at = u32::from(start) + group.mask.words_before(c);
            let (Some(&word), Some(below)) = (page.get(at as usize), group.level.checked_sub(1)) else { continue };
            let node = Node::decode(word);
            // An empty node passes on what it inherits.
            let own = group.mask.child(c).has_value().then(|| page.get(at as usize + 1).copied()).flatten();
            let link = Link {
                inherited: own.or(group.inherited),
                mask: node.mask,
                level: below,
                x: group.x.wrapping_add((c & 1) << (group.level & 31)),
                y: group.y.wrapping_add((c >> 1) << (group.level & 31)),
                ..group
            };
            match node.children {
                Children::Page(child) => visit(child, link),
                Children::Here(first) => {
                    if let Some(slot) = waiting.get_mut(count) {
                        *slot = (first, link);
                        count += 1;
                    }
                }
            }
        }
    }
}

/// Checks that a page is the one that its parent's node describes: types, level, place in the map, root; and that its
/// depths lie within the parent's and hold the inherited value where a lookup in it may answer that.
///
/// With [`check`] for every page, each answer of a lookup that needs a page lies in the page's depths: it is a value of
/// the page, of a page below, or the inherited one.
///
/// # Errors
/// `mh.link`, `mh.depths`.
pub fn check_link(link: &Link, head: &FrameHead, cx: &PageContext<'_>) -> Result<(), FormatError> {
    let pairs = [
        (u64::from(link.mask.0), u64::from(head.root_mask)),
        (link.level.into(), head.root_level.into()),
        (link.x.into(), cx.page.origin_x.get().into()),
        (link.y.into(), cx.page.origin_y.get().into()),
        (link.root.into(), cx.page.root.get().into()),
    ];
    let inherited = link.inherited.filter(|_| link.mask.inherits()).map(|v| (v, v));
    check_announced(&pairs, link.depths, inherited, cx, [Rule::MhLink, Rule::MhDepths])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_before_counts_every_mask() {
        for bits in 0..=255u8 {
            let mask = Mask(bits);
            let mut sum = 0;
            for c in 0..4 {
                assert_eq!(mask.words_before(c), sum, "{bits:#X} {c}");
                sum += mask.child(c).words();
            }
            assert_eq!(mask.words(), sum);
            assert_eq!(mask.inherits(), (0..4).any(|c| !mask.child(c).has_value()));
        }
    }

    #[test]
    fn nodes_keep_their_bits() {
        for children in [Children::Here(0), Children::Here(65535), Children::Page(0), Children::Page(513)] {
            let node = Node { mask: Mask(0b11_10_01_00), children };
            assert_eq!(Node::decode(node.encode()), node);
        }
        assert_eq!(Node { mask: Mask(0xE4), children: Children::Page(0x1234) }.encode(), 0x1234_01E4);
    }

    #[test]
    fn children_come_from_the_bits_of_the_texel() {
        assert_eq!([(0, 0), (1, 0), (0, 1), (1, 1)].map(|(x, y)| child_of(x << 5, y << 5, 5)), [0, 1, 2, 3]);
    }
}
