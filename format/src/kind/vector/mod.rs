//! Kind `vector`: a quadtree whose nodes hold entries of a palette: constants, planes, splits of both along lines, masks
//! of 4 x 4 texels, raw depths. `spec/vector.md` is the definition.
//!
//! - here: [`Header`], the counts of a page; [`Layout`], where its sections start; the topology ([`Group`], [`Child`]);
//! - [`entry`]: the entries, bit by bit;
//! - [`eval`]: the value of an entry at a place, and its bounds over a square;
//! - [`check()`]: the rules of a page; [`link`]: what a page says of its child pages;
//! - [`nodes()`]: every node with its square;
//! - [`assemble()`]: lays out a page.
//!
//! Types of nodes and their masks are those of [`mh`](super::mh); "has a value" reads as "has an entry" here.

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing,
    clippy::cast_possible_truncation
)]

pub mod assemble;
mod check;
pub mod entry;
pub mod eval;
pub mod link;
mod nodes;
pub use assemble::{Parts, assemble};
pub use check::check;
pub use entry::{Line, Mask4, Plane, Raw, Split, Square};
pub use eval::{bounds, value};
pub use link::{Link, check_link, links};
pub use nodes::{Node, nodes};

use super::mh::Mask;
use crate::page::FrameHead;

/// First word of the topology: frame and header come before.
pub const TOPOLOGY: u32 = 7;
/// Groups of a block of the topology.
pub const BLOCK_GROUPS: u32 = 16;
/// Words of a block of the topology.
pub const BLOCK_WORDS: u32 = 5;
/// Most groups of a page.
pub const MAX_GROUPS: u16 = 32_767;
/// Most splits one behind the other.
pub const MAX_DEPTH: u32 = 4;
/// Bits of a mask that say that a child has children.
const CHILDREN: u64 = 0xAAAA_AAAA_AAAA_AAAA;

/// Word `at`; 0 outside.
#[inline]
pub(crate) fn word(page: &[u32], at: u32) -> u32 {
    page.get(at as usize).copied().unwrap_or(0)
}

/// Words `at` to `at + N`; 0 where they do not all lie inside.
#[inline]
fn words<const N: usize>(page: &[u32], at: u32) -> [u32; N] {
    page.get(at as usize..).and_then(|w| w.first_chunk()).copied().unwrap_or([0; N])
}

/// Number `n` of those packed from word `at` on, `width` bits each, at most 32; words outside read as 0.
#[inline]
pub(crate) fn packed(page: &[u32], at: u32, width: u32, n: u32) -> u32 {
    let bit = n * width;
    let first = at.saturating_add(bit / 32);
    let low = u64::from(word(page, first));
    // The second word counts only where the number reaches into it.
    let high = if bit % 32 + width > 32 { u64::from(word(page, first.saturating_add(1))) } else { 0 };
    cut((low | high << 32) >> (bit % 32) & ((1u64 << (width & 63)) - 1))
}

/// Low 32 bits.
#[allow(clippy::cast_possible_truncation)]
#[inline]
const fn cut(v: u64) -> u32 {
    // The cut is what is asked for.
    v as u32
}

/// Words 2 to 6 of a page: how much of everything it holds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Header {
    /// Groups, stubs included: 1 to [`MAX_GROUPS`].
    pub groups: u16,
    /// Nodes with an entry.
    pub entries: u16,
    /// Bits of an index.
    pub index_bits: u8,
    /// Bit 0: there are proofs. Bit 1: all lines are short.
    pub flags: u8,
    /// Lines.
    pub lines: u16,
    /// Constants of the palette.
    pub constants: u16,
    /// Planes of the palette.
    pub planes: u16,
    /// Splits of the palette.
    pub splits: u16,
    /// Masks of the palette.
    pub masks: u16,
    /// Raws of the palette.
    pub raws: u16,
    /// Bits 16..32 of word 6: zero.
    pub unused: u16,
}

impl Header {
    /// Bit of `flags`: there are proofs.
    pub const PROOFS: u8 = 1;
    /// Bit of `flags`: all lines are short.
    pub const SHORT_LINES: u8 = 2;

    /// The 5 words.
    pub const fn encode(&self) -> [u32; 5] {
        [
            self.groups as u32 | (self.entries as u32) << 16,
            self.index_bits as u32 | (self.flags as u32) << 8 | (self.lines as u32) << 16,
            self.constants as u32 | (self.planes as u32) << 16,
            self.splits as u32 | (self.masks as u32) << 16,
            self.raws as u32 | (self.unused as u32) << 16,
        ]
    }

    /// Reads words 2 to 6 of a page; all zero where they do not all lie inside.
    #[inline]
    pub fn decode(page: &[u32]) -> Self {
        let [w2, w3, w4, w5, w6] = words(page, 2);
        let halves = |word: u32| {
            let [a, b, c, d] = word.to_le_bytes();
            (u16::from_le_bytes([a, b]), u16::from_le_bytes([c, d]))
        };
        let ((groups, entries), (_, lines), (constants, planes)) = (halves(w2), halves(w3), halves(w4));
        let ((splits, masks), (raws, unused)) = (halves(w5), halves(w6));
        let [index_bits, flags, _, _] = w3.to_le_bytes();
        Self { groups, entries, index_bits, flags, lines, constants, planes, splits, masks, raws, unused }
    }

    /// Entries of the palette.
    #[inline]
    pub const fn palette(&self) -> u32 {
        self.constants as u32 + self.planes as u32 + self.splits as u32 + self.masks as u32 + self.raws as u32
    }

    /// The smallest number of bits that holds every number of the palette.
    #[inline]
    pub const fn needed_bits(&self) -> u32 {
        u32::BITS - self.palette().saturating_sub(1).leading_zeros()
    }

    /// Words of a line.
    #[inline]
    pub const fn line_words(&self) -> u32 {
        if self.flags & Self::SHORT_LINES == 0 { 3 } else { 2 }
    }

    /// Words of each section, in order, without the heap; `child_refs` is the frame's. None is above 2^20.
    pub const fn section_words(&self, child_refs: u16) -> [u32; 10] {
        let entries = self.entries as u32;
        [
            BLOCK_WORDS * (self.groups as u32).div_ceil(BLOCK_GROUPS),
            (child_refs as u32).div_ceil(2),
            (entries * self.index_bits as u32).div_ceil(32),
            if self.flags & Self::PROOFS == 0 { 0 } else { entries.div_ceil(32) },
            self.line_words() * self.lines as u32,
            self.constants as u32,
            3 * self.planes as u32,
            self.splits as u32,
            2 * self.masks as u32,
            2 * self.raws as u32,
        ]
    }
}

/// Where the sections of a page start, and where the classes of the palette begin. Made from any words; numbers that are
/// beyond 16 bits, which a checked page has none of, are 65535, behind the end of every page.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Layout {
    /// First word of the stubs.
    pub stubs_at: u16,
    /// Stubs.
    pub stubs: u16,
    /// First word of the indexes.
    pub indexes_at: u16,
    /// First word of the proofs.
    pub proofs_at: u16,
    /// First word of the lines.
    pub lines_at: u16,
    /// First word of the constants.
    pub constants_at: u16,
    /// First word of the planes.
    pub planes_at: u16,
    /// First word of the splits.
    pub splits_at: u16,
    /// First word of the masks.
    pub masks_at: u16,
    /// First word of the raws.
    pub raws_at: u16,
    /// First word of the heap.
    pub heap_at: u16,
    /// Number of the first plane in the palette.
    pub first_plane: u16,
    /// Number of the first split.
    pub first_split: u16,
    /// Number of the first mask.
    pub first_mask: u16,
    /// Number of the first raw.
    pub first_raw: u16,
    /// Bits of an index, 0 to 31.
    pub index_bits: u8,
    /// Whether there are proofs.
    pub proofs: bool,
    /// Whether lines are short.
    pub short_lines: bool,
}

impl Layout {
    /// From the words of a page, frame included.
    pub fn of(page: &[u32]) -> Self {
        let refs = word(page, 0) >> 16;
        Self::new(&Header::decode(page), u16::try_from(refs).unwrap_or(u16::MAX))
    }

    /// From the counts of a page.
    pub fn new(h: &Header, child_refs: u16) -> Self {
        let narrow = |v: u32| u16::try_from(v).unwrap_or(u16::MAX);
        let mut end = TOPOLOGY;
        // The end of each section is the start of the next.
        let ends = h.section_words(child_refs).map(|length| {
            end += length;
            narrow(end)
        });
        let [stubs_at, indexes_at, proofs_at, lines_at, constants_at, planes_at, splits_at, masks_at, raws_at, heap_at] =
            ends;
        let first_split = u32::from(h.constants) + u32::from(h.planes);
        let first_mask = first_split + u32::from(h.splits);
        Self {
            stubs_at,
            stubs: child_refs,
            indexes_at,
            proofs_at,
            lines_at,
            constants_at,
            planes_at,
            splits_at,
            masks_at,
            raws_at,
            heap_at,
            first_plane: h.constants,
            first_split: narrow(first_split),
            first_mask: narrow(first_mask),
            first_raw: narrow(first_mask + u32::from(h.masks)),
            index_bits: h.index_bits & 31,
            proofs: h.flags & Header::PROOFS != 0,
            short_lines: h.flags & Header::SHORT_LINES != 0,
        }
    }

    /// Entry of the palette that node `index` has.
    #[inline]
    pub fn entry(&self, page: &[u32], index: u32) -> u32 {
        // Indexes of a page are below 2^17, whatever its words are.
        packed(page, self.indexes_at.into(), self.index_bits.into(), index & 0x1_FFFF)
    }

    /// Whether the entry of node `index` is proven where lookups end with it.
    #[inline]
    pub fn proven(&self, page: &[u32], index: u32) -> bool {
        self.proofs && word(page, u32::from(self.proofs_at).saturating_add(index / 32)) >> (index % 32) & 1 == 1
    }

    /// The child page of a stub: its place in the list, none where the group is not in it.
    #[inline]
    pub fn stub(&self, page: &[u32], group: u32) -> Option<u16> {
        let at = |i: u16| word(page, u32::from(self.stubs_at) + u32::from(i / 2)) >> (16 * u32::from(i % 2)) & 0xFFFF;
        let (mut low, mut high) = (0, self.stubs);
        while low < high {
            let middle = low + (high - low) / 2;
            if at(middle) < group {
                low = middle + 1;
            } else {
                high = middle;
            }
        }
        (low < self.stubs && at(low) == group).then_some(low)
    }
}

/// A block of the topology that holds a group: the ranks before it, and the masks before a child and at it.
#[derive(Clone, Copy)]
struct Block {
    ranks: u32,
    /// Types of the children of the first 8 groups that come before the child, and of the other 8.
    before: (u64, u64),
    /// Types of the group's children.
    mask: Mask,
}

impl Block {
    /// Around child `c`, 0 to 3, of group `number`; words outside read as 0.
    #[inline]
    fn of(page: &[u32], number: u32, c: u32) -> Self {
        let at = TOPOLOGY + BLOCK_WORDS * (number / BLOCK_GROUPS);
        let [ranks, w1, w2, w3, w4] = words::<5>(page, at);
        let (low, high) = (u64::from(w1) | u64::from(w2) << 32, u64::from(w3) | u64::from(w4) << 32);
        let first = number % BLOCK_GROUPS < 8;
        let (own, shift) = (if first { low } else { high }, 8 * (number % 8));
        let part = own & ((1u64 << (shift + 2 * (c & 3))) - 1);
        let [mask, ..] = (own >> shift).to_le_bytes();
        Self { ranks, before: if first { (part, 0) } else { (low, part) }, mask: Mask(mask) }
    }

    /// Nodes with children before the child.
    #[inline]
    const fn children(&self) -> u32 {
        let (low, high) = self.before;
        (self.ranks & 0xFFFF) + count(low & CHILDREN, high & CHILDREN)
    }

    /// Nodes with an entry before the child.
    #[inline]
    const fn entries(&self) -> u32 {
        let (low, high) = self.before;
        // Of types 1 and 2 the two bits differ.
        (self.ranks >> 16) + count((low ^ low << 1) & CHILDREN, (high ^ high << 1) & CHILDREN)
    }
}

/// Group `number` of a page as the topology has it, with the ranks of its first node.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Group {
    /// Types of its children; 0 on a stub.
    pub mask: Mask,
    /// Nodes with children in groups before.
    pub children: u32,
    /// Nodes with an entry in groups before.
    pub entries: u32,
}

impl Group {
    /// Reads a group; words outside read as 0.
    #[inline]
    pub fn of(page: &[u32], number: u32) -> Self {
        let block = Block::of(page, number, 0);
        Self { mask: block.mask, children: block.children(), entries: block.entries() }
    }
}

/// One child of a group, as a lookup needs it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Child {
    /// Types of the group's children; 0 on a stub.
    pub mask: Mask,
    /// The group of the child's own children, if it has some.
    pub below: u32,
    /// Its index, if it has an entry.
    pub index: u32,
}

impl Child {
    /// Child `c`, 0 to 3, of group `number`; words outside read as 0.
    #[inline]
    pub fn of(page: &[u32], number: u32, c: u32) -> Self {
        let block = Block::of(page, number, c);
        Self { mask: block.mask, below: 1 + block.children(), index: block.entries() }
    }
}

/// Bits set in two words that have only odd bits.
#[inline]
const fn count(first: u64, second: u64) -> u32 {
    (first | second >> 1).count_ones()
}

/// Levels of the groups of a page, asked for in order.
#[derive(Clone, Copy, Debug)]
struct Levels {
    level: u8,
    /// First group of the next level below.
    next: u32,
}

impl Levels {
    const fn new(head: &FrameHead) -> Self {
        Self { level: head.root_level, next: 1 }
    }

    /// Level of group `number`; groups are asked for in order, each with the nodes with children in groups before it.
    #[inline]
    const fn of(&mut self, number: u32, children: u32) -> u8 {
        if number >= self.next {
            self.level = self.level.saturating_sub(1);
            self.next = 1 + children;
        }
        self.level
    }
}

#[cfg(test)]
mod tests;
