//! Lays out a page from its parts.

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing,
    clippy::cast_possible_truncation
)]

use alloc::vec::Vec;

use super::{BLOCK_GROUPS, Header, Line, Mask4, Plane, Raw, Split, TOPOLOGY, cut};
use crate::kind::Kind;
use crate::kind::mh::Mask;
use crate::page::FrameHead;

/// Everything that a page holds.
#[derive(Clone, Copy, Debug, Default)]
pub struct Parts<'a> {
    /// Level of the nodes of the root group.
    pub root_level: u8,
    /// Masks of the groups in level order, the root group first; a mask of 0 stands for a child page.
    pub groups: &'a [u8],
    /// For each node with an entry, by rising group and child, the number of its entry in the palette: constants first,
    /// then planes, splits, masks, raws.
    pub indexes: &'a [u32],
    /// For each node with an entry whether the entry is proven where lookups end with it; none leaves the section out.
    pub proofs: Option<&'a [bool]>,
    /// Lines that splits refer to.
    pub lines: &'a [Line],
    /// Constants of the palette.
    pub constants: &'a [u32],
    /// Planes of the palette.
    pub planes: &'a [Plane],
    /// Splits of the palette.
    pub splits: &'a [Split],
    /// Masks of the palette.
    pub masks: &'a [Mask4],
    /// Raws of the palette: 16 values row by row; each is packed with the smallest width.
    pub raws: &'a [[u32; 16]],
}

impl Parts<'_> {
    /// Words of the page. A page has at most [`MAX_PAGE_WORDS`](crate::index::MAX_PAGE_WORDS).
    pub fn words(&self) -> usize {
        let sections = self.header().section_words(self.child_refs());
        let heap: u32 = self.raws.iter().map(|r| Raw::of(r).heap_words()).sum();
        (TOPOLOGY + sections.iter().sum::<u32>() + heap) as usize
    }

    /// Groups that stand for child pages.
    pub fn child_refs(&self) -> u16 {
        narrow(self.groups.iter().skip(1).filter(|mask| **mask == 0).count())
    }

    /// The counts; such as are beyond their field are as large as it allows.
    pub fn header(&self) -> Header {
        let proofs = if self.proofs.is_some() { Header::PROOFS } else { 0 };
        let short = !self.lines.is_empty() && self.lines.iter().all(Line::is_short);
        let header = Header {
            groups: narrow(self.groups.len()),
            entries: narrow(self.indexes.len()),
            index_bits: 0,
            flags: proofs | if short { Header::SHORT_LINES } else { 0 },
            lines: narrow(self.lines.len()),
            constants: narrow(self.constants.len()),
            planes: narrow(self.planes.len()),
            splits: narrow(self.splits.len()),
            masks: narrow(self.masks.len()),
            raws: narrow(self.raws.len()),
            unused: 0,
        };
        let [index_bits, ..] = header.needed_bits().to_le_bytes();
        Header { index_bits, ..header }
    }
}

/// The words of a page, frame included. Parts that contradict each other, or are more than a page has room for, give
/// words that [`check`](super::check) refuses; [`Parts::words`] says beforehand how long a page would be.
pub fn assemble(parts: &Parts<'_>) -> Vec<u32> {
    let (header, child_refs) = (parts.header(), parts.child_refs());
    let words = parts.words();
    let mut out = Vec::with_capacity(words);
    let root_mask = parts.groups.first().copied().unwrap_or(0);
    let (tag, root_level) = (Kind::Vector.tag(), parts.root_level);
    out.extend(FrameHead { tag, root_mask, child_refs, words: narrow(words), root_level }.encode());
    out.extend(header.encode());
    topology(parts.groups, &mut out);
    let stubs = (0u32..).zip(parts.groups).skip(1).filter(|(_, mask)| **mask == 0);
    pack(stubs.map(|(number, _)| number), 16, &mut out);
    pack(parts.indexes.iter().copied(), header.index_bits.into(), &mut out);
    pack(parts.proofs.unwrap_or_default().iter().map(|p| u32::from(*p)), 1, &mut out);
    if header.flags & Header::SHORT_LINES == 0 {
        out.extend(parts.lines.iter().flat_map(Line::encode));
    } else {
        out.extend(parts.lines.iter().flat_map(Line::encode_short));
    }
    out.extend(parts.constants);
    out.extend(parts.planes.iter().flat_map(Plane::encode));
    out.extend(parts.splits.iter().map(Split::encode));
    out.extend(parts.masks.iter().flat_map(Mask4::encode));
    let mut at = out.len() + 2 * parts.raws.len();
    for values in parts.raws {
        let raw = Raw { at: narrow(at), ..Raw::of(values) };
        at += raw.heap_words() as usize;
        out.extend(raw.encode());
    }
    for values in parts.raws {
        let raw = Raw::of(values);
        pack(values.iter().map(|v| v.wrapping_sub(raw.base) >> raw.shift), raw.width.into(), &mut out);
    }
    out
}

impl Raw {
    /// Base, shift and smallest width for 16 values; `at` is 0.
    pub fn of(values: &[u32; 16]) -> Self {
        let base = values.iter().copied().min().unwrap_or(0);
        let all = values.iter().fold(0, |all, v| all | (v - base));
        let shift = if all == 0 { 0 } else { all.trailing_zeros() };
        let ([width, ..], [shift, ..]) =
            ((u32::BITS - (all >> shift).leading_zeros()).to_le_bytes(), shift.to_le_bytes());
        Self { base, at: 0, width, shift }
    }
}

/// Blocks of 16 groups, each with the ranks before it.
fn topology(groups: &[u8], out: &mut Vec<u32>) {
    let (mut children, mut entries) = (0u32, 0u32);
    for block in groups.chunks(BLOCK_GROUPS as usize) {
        out.push(children & 0xFFFF | entries << 16);
        let mut masks = [0u32; 4];
        for (word, four) in masks.iter_mut().zip(block.chunks(4)) {
            for (j, mask) in (0u32..).zip(four) {
                *word |= u32::from(*mask) << (8 * j);
                for c in 0..4 {
                    let kind = Mask(*mask).child(c);
                    children += u32::from(kind.has_children());
                    entries += u32::from(kind.has_value());
                }
            }
        }
        out.extend(masks);
    }
}

/// Numbers of `width` bits, at most 32, without gaps; the last word is filled with zeros.
fn pack(numbers: impl Iterator<Item = u32>, width: u32, out: &mut Vec<u32>) {
    let (mut waiting, mut bits) = (0u64, 0);
    for n in numbers {
        waiting |= (u64::from(n) & ((1u64 << (width & 63)) - 1)) << bits;
        bits += width;
        if bits >= 32 {
            out.push(cut(waiting));
            (waiting, bits) = (waiting >> 32, bits - 32);
        }
    }
    if bits > 0 {
        out.push(cut(waiting));
    }
}

/// A count, at most 65535.
fn narrow(n: usize) -> u16 {
    u16::try_from(n).unwrap_or(u16::MAX)
}
