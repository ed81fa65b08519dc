//! The frame that every page has, whatever its kind: two words of 32 bits before the words of the kind.
//!
//! ```text
//! word 0   bits 0..8 tag | 8..16 root_mask | 16..32 child_refs
//! word 1   bits 0..16 words | 16..24 root_level | 24..32 flags (zero)
//! word 2.. as the kind says
//! ```
//!
//! Words are little-endian in the file and in host order here. A page names no ordinal, no offset in the file and no
//! structure: its content stays the same when the file around it changes. A child page is referred to by its place
//! among the page's children, a shared page by its place among the record's dependencies.
//!
//! In: words and the page's record. Out: a [`FrameHead`] that agrees with it. Next: [`crate::kind`].

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing,
    clippy::cast_possible_truncation
)]

use crate::error::{FormatError, Place, Rule, Value};
use crate::index::PageRecord;
use crate::kind::Kind;
use crate::structure::StructureRecord;

/// Words of the frame; the kind's words follow.
pub const FRAME_WORDS: usize = 2;
/// Tag of a flat page of any kind; other pages have the code of their kind.
pub const TAG_FLAT: u8 = 0xFF;

/// The two words before the kind's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameHead {
    /// Kind's code, or [`TAG_FLAT`].
    pub tag: u8,
    /// Types of the root group in kinds of 4 children; zero in kinds whose masks are wider and in flat pages.
    pub root_mask: u8,
    /// Child pages that the words refer to.
    pub child_refs: u16,
    /// Words of the page, these two included.
    pub words: u16,
    /// Level of the nodes of the root group; zero in flat pages.
    pub root_level: u8,
}

impl FrameHead {
    /// The two words.
    pub fn encode(&self) -> [u32; FRAME_WORDS] {
        [
            u32::from(self.tag) | u32::from(self.root_mask) << 8 | u32::from(self.child_refs) << 16,
            u32::from(self.words) | u32::from(self.root_level) << 16,
        ]
    }

    /// Reads the two words, flags excepted; `None` where the page is shorter.
    pub fn decode(page: &[u32]) -> Option<Self> {
        let &[w0, w1, ..] = page else { return None };
        let [tag, root_mask, refs0, refs1] = w0.to_le_bytes();
        let [words0, words1, root_level, _] = w1.to_le_bytes();
        let (child_refs, words) = (u16::from_le_bytes([refs0, refs1]), u16::from_le_bytes([words0, words1]));
        Some(Self { tag, root_mask, child_refs, words, root_level })
    }
}

/// What a page is checked against: its record and its structure's, both checked.
#[derive(Clone, Copy, Debug)]
pub struct PageContext<'a> {
    /// Number of the structure.
    pub structure: u32,
    /// Ordinal of the page.
    pub ordinal: u32,
    /// Record of the page.
    pub page: &'a PageRecord,
    /// Record of the structure.
    pub record: &'a StructureRecord,
}

impl PageContext<'_> {
    /// Whether the page holds the root of one of the structure's trees.
    pub fn is_root(&self) -> bool {
        self.ordinal < self.record.root_count.get()
    }

    /// An error at word `word` of this page.
    pub fn fault(&self, rule: Rule, word: usize, expected: Value, found: Value) -> FormatError {
        let offset = self.page.offset.get().saturating_add(word as u64 * 4);
        FormatError::new(
            rule,
            Place::Page { structure: self.structure, ordinal: self.ordinal },
            offset,
            expected,
            found,
        )
    }
}

/// Checks the frame of a page against its record: tag, length, children, level, flags.
///
/// # Errors
/// `page.*`.
pub fn check_frame(page: &[u32], cx: &PageContext<'_>) -> Result<FrameHead, FormatError> {
    let number = |v: u64| Value::Number(v);
    let hot = usize::from(cx.page.hot_words.get());
    let Some(head) = FrameHead::decode(page).filter(|_| page.len() == hot) else {
        return Err(cx.fault(Rule::PageLength, 0, number(hot as u64), number(page.len() as u64)));
    };
    let flat = cx.page.is_flat();
    let tag = if flat { TAG_FLAT } else { cx.record.kind().map_or(0, Kind::tag) };
    let equal = |rule, word, expected: u64, found: u64| {
        if expected == found { Ok(()) } else { Err(cx.fault(rule, word, number(expected), number(found))) }
    };
    equal(Rule::PageTag, 0, tag.into(), head.tag.into())?;
    equal(Rule::PageChildren, 0, cx.page.child_count.get().into(), head.child_refs.into())?;
    equal(Rule::PageLength, 1, hot as u64, head.words.into())?;
    equal(Rule::PageLevel, 1, cx.page.level_coarsest.into(), head.root_level.into())?;
    if flat {
        equal(Rule::PageLevel, 1, 0, head.root_level.into())?;
    }
    equal(Rule::PageFlags, 1, 0, page.get(1).map_or(0, |w| u64::from(w >> 24)))?;
    let masked = cx.record.kind().is_some_and(Kind::has_frame_mask) && !flat;
    if head.root_mask != 0 && !masked {
        return Err(cx.fault(Rule::PageFlags, 0, number(0), number(head.root_mask.into())));
    }
    Ok(head)
}
