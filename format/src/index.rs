//! The page index: where every page lies and what it can answer, apart from the pages themselves.
//!
//! ```text
//! block  0      64                                  64 + 64 * records_per_block       1 << index_block_log2
//!        | head | record 0 | record 1 | ...          | dependency 0 | 1 | ... | zero    |
//! ```
//!
//! A block holds `records_per_block` records (the last block what is left), so the block of an ordinal is
//! arithmetic, and any prefix of the blocks is an index of the pages it lists. Pages stand in level order: the roots
//! first, then the children of ordinal 0, of ordinal 1, and so on. Hence `first_child` of a record is `first_child +
//! child_count` of the one before, also where a page has no children, and each page is the child of exactly one
//! other. Shared pages follow behind the tree; they are reached through dependencies only.
//! Payload offsets rise with the ordinal; each page starts where the one before ends, aligned up.
//!
//! In: the bytes of a block. Out: [`IndexBlock`], whose records have been checked one by one and against their
//! neighbours. [`check_follows`] holds the first record of a block against the last one of the block before.

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing,
    clippy::cast_possible_truncation
)]

use zerocopy::{FromBytes, IntoBytes};

use crate::checksum::{FileId, block_crc};
use crate::error::{FormatError, Place, Rule, Value};
use crate::header::align_up;
use crate::le::{U16, U32, U64};
use crate::record::{record, reserved_fault};
use crate::structure::StructureRecord;

/// Most words of a page: 64 KiB.
pub const MAX_PAGE_WORDS: u16 = 16384;
/// Most dependencies of a page.
pub const MAX_DEPENDENCIES: u16 = 256;
/// Bits of [`PageRecord::page_type`] that tell the form: 0 tree, 1 flat.
pub const FORM_MASK: u8 = 0x0F;
/// Form of a page of tree nodes.
pub const FORM_TREE: u8 = 0;
/// Form of a flat payload: a list or a table.
pub const FORM_FLAT: u8 = 1;
/// Bit of [`PageRecord::page_type`]: a shared page, which has neither footprint, depths nor stop error of its own.
pub const SHARED: u8 = 0x10;

record! {
    /// First 64 bytes of an index block.
    BlockHeader: 64 bytes {
        /// CRC32 bound to file id, structure and block number over the rest of the block.
        0 => crc32: U32;
        /// Number of the structure.
        4 => structure: U32;
        /// Ordinal of the first record: block number times `records_per_block`.
        8 => first_ordinal: U32;
        /// Records in this block.
        12 => record_count: U32;
        /// Entries of the dependency list, which starts behind `records_per_block` records.
        16 => dep_count: U32;
        /// Zero.
        20 => reserved: [u8; 44];
    }
}

record! {
    /// One page: place, length, footprint, what it can answer, children and dependencies.
    PageRecord: 64 bytes {
        /// First byte, counted from the start of the file.
        0 => offset: U64;
        /// XXH3-64 of the bytes as queried.
        8 => content_hash: U64;
        /// CRC32 of the bytes as stored, bound to file id, structure and ordinal.
        16 => crc32: U32;
        /// Ordinal of the first child page; where it has none, of the next page's first child. 0 for shared pages.
        20 => first_child: U32;
        /// First texel of the footprint in x, finest level.
        24 => origin_x: U32;
        /// First texel of the footprint in y, finest level.
        28 => origin_y: U32;
        /// Smallest depth that a lookup in the footprint can answer, inherited values included.
        32 => min_depth: U32;
        /// Largest such depth. Shared pages have none: smallest 0xFFFFFFFF, largest 0.
        36 => max_depth: U32;
        /// Largest lattice distance of the answer to a texel's interval if the descent stops before this page.
        40 => stop_error: U32;
        /// First light of the footprint.
        44 => origin_l: U16;
        /// Root that the page belongs to.
        46 => root: U16;
        /// Number of child pages, consecutive ordinals.
        48 => child_count: U16;
        /// Length of the page as queried, in 32-bit words, 2 to 16384.
        50 => hot_words: U16;
        /// Length as stored where the page is cold; 0: stored as queried.
        52 => cold_words: U16;
        /// First entry in the block's dependency list; 0 where there are none.
        54 => dep_first: U16;
        /// Number of dependencies, at most 256.
        56 => dep_count: U16;
        /// Footprint in x: `1 << log2_x` texels, aligned to its size.
        58 => log2_x: u8;
        /// Footprint in y: `1 << log2_y` texels, aligned to its size.
        59 => log2_y: u8;
        /// Footprint over the lights: `1 << log2_l`, aligned to its size.
        60 => log2_l: u8;
        /// Finest level of the page's nodes.
        61 => level_finest: u8;
        /// Coarsest level of the page's nodes: that of its root group.
        62 => level_coarsest: u8;
        /// Low 4 bits: 0 tree, 1 flat. Bit 4: shared. Others zero.
        63 => page_type: u8;
    }
}

impl PageRecord {
    /// Words of the page as stored.
    pub fn stored_words(&self) -> u16 {
        if self.cold_words.get() == 0 { self.hot_words.get() } else { self.cold_words.get() }
    }

    /// Bytes of the page as stored.
    pub fn stored_bytes(&self) -> u64 {
        u64::from(self.stored_words()) * 4
    }

    /// First byte behind the page in the file; saturates.
    pub fn end(&self) -> u64 {
        self.offset.get().saturating_add(self.stored_bytes())
    }

    /// Ordinal behind the last child; saturates.
    pub fn children_end(&self) -> u32 {
        self.first_child.get().saturating_add(self.child_count.get().into())
    }

    /// Whether the page is shared.
    pub fn is_shared(&self) -> bool {
        self.page_type & SHARED != 0
    }

    /// Whether the page is a flat payload.
    pub fn is_flat(&self) -> bool {
        self.page_type & FORM_MASK == FORM_FLAT
    }
}

/// What a block is checked against.
#[derive(Clone, Copy, Debug)]
pub struct IndexContext<'a> {
    /// Identity of the file.
    pub file_id: &'a FileId,
    /// Alignment of pages in bytes, a power of two.
    pub alignment: u64,
    /// Number of the structure.
    pub structure: u32,
    /// Its record, checked.
    pub record: &'a StructureRecord,
    /// First byte of its index section.
    pub index_offset: u64,
    /// First byte of its pages.
    pub pages_offset: u64,
    /// First byte behind its pages.
    pub pages_end: u64,
}

/// A block of the index that has been checked.
#[derive(Clone, Copy, Debug)]
pub struct IndexBlock<'a> {
    head: &'a BlockHeader,
    records: &'a [PageRecord],
    dependencies: &'a [U32],
}

impl<'a> IndexBlock<'a> {
    /// Checks block `number` whole: CRC, counts, every record, neighbours, dependencies, unused bytes.
    ///
    /// # Errors
    /// `index.*`; the offset is that of the broken field in the file.
    pub fn check(bytes: &'a [u8], number: u32, cx: &IndexContext<'_>) -> Result<Self, FormatError> {
        let place = Place::Index(cx.structure);
        let base = cx.index_offset.saturating_add(u64::from(number).saturating_mul(cx.record.block_bytes()));
        let fault = |rule, at: u64, expected, found| FormatError::new(rule, place, base + at, expected, found);
        let lengths = (Value::Number(cx.record.block_bytes()), Value::Number(bytes.len() as u64));
        let short = || fault(Rule::IndexLength, 0, lengths.0, lengths.1);
        if bytes.len() as u64 != cx.record.block_bytes() {
            return Err(short());
        }
        let (head, rest) = BlockHeader::ref_from_prefix(bytes).map_err(|_| short())?;
        let crc = block_crc(cx.file_id, cx.structure, number, bytes.get(4..).unwrap_or_default());
        FormatError::crc(Rule::IndexCrc, place, base, crc, head.crc32.get())?;
        if let Some((at, byte)) = reserved_fault(head.as_bytes(), BlockHeader::RECORD.fields) {
            return Err(fault(Rule::IndexReserved, at, Value::Number(0), Value::Number(byte.into())));
        }
        let per_block = u32::from(cx.record.records_per_block.get());
        let first = number.saturating_mul(per_block);
        let count = cx.record.page_count.get().saturating_sub(first).min(per_block);
        let fields =
            [(4u64, cx.structure, head.structure), (8, first, head.first_ordinal), (12, count, head.record_count)];
        for (at, expected, found) in fields {
            if expected != found.get() {
                let (expected, found) = (Value::Number(expected.into()), Value::Number(found.get().into()));
                return Err(fault(Rule::IndexHead, at, expected, found));
            }
        }
        let slots = usize::from(cx.record.records_per_block.get());
        let (slots, tail) = <[PageRecord]>::ref_from_prefix_with_elems(rest, slots).map_err(|_| short())?;
        let (records, unused) = slots.split_at_checked(count as usize).ok_or_else(short)?;
        let deps = head.dep_count.get();
        let room = (tail.len() / 4) as u64;
        let (dependencies, spare) = <[U32]>::ref_from_prefix_with_elems(tail, deps as usize)
            .map_err(|_| fault(Rule::IndexHead, 16, Value::AtMost(room), Value::Number(deps.into())))?;
        if unused.as_bytes().iter().chain(spare).any(|&b| b != 0) {
            let at = (BlockHeader::BYTES + records.as_bytes().len()) as u64;
            return Err(fault(Rule::IndexUnused, at, Value::Text("zero bytes"), Value::Text("other bytes")));
        }
        let mut dep_next = 0u32;
        let mut before: Option<&PageRecord> = None;
        for (i, record) in (0u32..).zip(records) {
            let at = base + BlockHeader::BYTES as u64 + u64::from(i) * PageRecord::BYTES as u64;
            check_record(record, first.saturating_add(i), at, cx)?;
            if let Some(before) = before {
                check_follows(before, record, first.saturating_add(i), at, cx)?;
            }
            before = Some(record);
            // Lists lie one behind the other in the order of their pages, so that none overlap and none is unused.
            let (dep_first, dep_count) = (u32::from(record.dep_first.get()), u32::from(record.dep_count.get()));
            let expected = if dep_count == 0 { 0 } else { dep_next };
            if dep_first != expected || dep_next + dep_count > deps {
                let (expected, found) = (Value::Number(expected.into()), Value::Number(dep_first.into()));
                return Err(FormatError::new(Rule::IndexDependency, place, at + 54, expected, found));
            }
            let list = dependencies.get(dep_next as usize..(dep_next + dep_count) as usize).unwrap_or_default();
            let lowest = cx.record.tree_pages().max(first.saturating_add(i).saturating_add(1));
            if let Some(bad) = list.iter().find(|d| d.get() < lowest || d.get() >= cx.record.page_count.get()) {
                let most = cx.record.page_count.get().saturating_sub(1);
                let expected = Value::Between(lowest.into(), most.into());
                return Err(FormatError::new(
                    Rule::IndexDependency,
                    place,
                    at + 54,
                    expected,
                    Value::Number(bad.get().into()),
                ));
            }
            dep_next += dep_count;
        }
        if dep_next != deps {
            return Err(fault(Rule::IndexHead, 16, Value::Number(dep_next.into()), Value::Number(deps.into())));
        }
        Ok(Self { head, records, dependencies })
    }

    /// Ordinal of the first record.
    pub fn first_ordinal(&self) -> u32 {
        self.head.first_ordinal.get()
    }

    /// The records in order.
    pub fn records(&self) -> &'a [PageRecord] {
        self.records
    }

    /// Ordinals of the pages that a record of this block depends on.
    pub fn dependencies(&self, record: &PageRecord) -> &'a [U32] {
        let first = usize::from(record.dep_first.get());
        self.dependencies.get(first..first + usize::from(record.dep_count.get())).unwrap_or_default()
    }
}

/// Checks what one record alone can break; `at` is its first byte in the file.
///
/// # Errors
/// `index.*`.
pub fn check_record(r: &PageRecord, ordinal: u32, at: u64, cx: &IndexContext<'_>) -> Result<(), FormatError> {
    let fault = |rule, field: u64, expected, found| {
        Err(FormatError::new(rule, Place::Index(cx.structure), at + field, expected, found))
    };
    let within = |rule, field, lo: u64, hi: u64, v: u64| {
        if (lo..=hi).contains(&v) { Ok(()) } else { fault(rule, field, Value::Between(lo, hi), Value::Number(v)) }
    };
    let s = cx.record;
    let (tree, roots) = (s.tree_pages(), s.root_count.get());
    let shared = ordinal >= tree;
    if r.page_type & !(FORM_MASK | SHARED) != 0 || r.page_type & FORM_MASK > FORM_FLAT || r.is_shared() != shared {
        let expected = Value::Text(if shared { "tree or flat, shared" } else { "tree or flat, not shared" });
        return fault(Rule::IndexPageType, 63, expected, Value::Hex(r.page_type.into()));
    }
    within(Rule::IndexWords, 50, 2, MAX_PAGE_WORDS.into(), r.hot_words.get().into())?;
    within(Rule::IndexWords, 52, 0, MAX_PAGE_WORDS.into(), r.cold_words.get().into())?;
    within(Rule::IndexOffset, 0, cx.pages_offset, cx.pages_end, r.offset.get())?;
    within(Rule::IndexOffset, 0, cx.pages_offset, cx.pages_end.saturating_sub(r.stored_bytes()), r.offset.get())?;
    if r.offset.get() & (cx.alignment - 1) != 0 || (ordinal == 0 && r.offset.get() != cx.pages_offset) {
        let expected = align_up(r.offset.get().min(cx.pages_offset), cx.alignment);
        return fault(Rule::IndexOffset, 0, Value::Number(expected), Value::Number(r.offset.get()));
    }
    if ordinal == s.page_count.get().saturating_sub(1) && r.end() != cx.pages_end {
        return fault(Rule::IndexOffset, 50, Value::Number(cx.pages_end), Value::Number(r.end()));
    }
    within(Rule::IndexDependency, 56, 0, MAX_DEPENDENCIES.into(), r.dep_count.get().into())?;
    if shared {
        let words = [r.origin_x, r.origin_y, r.max_depth, r.stop_error].map(|v| v.get());
        let rest = [r.origin_l.get(), r.root.get(), r.log2_x.into(), r.log2_y.into(), r.log2_l.into()];
        if words.iter().any(|&v| v != 0) || rest.iter().any(|&v| v != 0) || r.min_depth.get() != u32::MAX {
            let expected = Value::Text("no footprint, no depths, no stop error");
            return fault(Rule::IndexShared, 24, expected, Value::Text("one"));
        }
        within(Rule::IndexChildren, 48, 0, 0, r.child_count.get().into())?;
        within(Rule::IndexChildren, 20, 0, 0, r.first_child.get().into())?;
    } else {
        within(Rule::IndexRoot, 46, 0, u64::from(roots).saturating_sub(1), r.root.get().into())?;
        within(Rule::IndexDepths, 32, 0, r.max_depth.get().into(), r.min_depth.get().into())?;
        if ordinal < roots {
            within(Rule::IndexRoot, 46, ordinal.into(), ordinal.into(), r.root.get().into())?;
        }
        let lowest = if ordinal == 0 { roots } else { roots.max(ordinal.saturating_add(1)) };
        let highest = if ordinal == 0 { roots } else { tree };
        within(Rule::IndexChildren, 20, lowest.into(), highest.into(), r.first_child.get().into())?;
        let children_end = u64::from(r.first_child.get()) + u64::from(r.child_count.get());
        let end = if ordinal == tree - 1 { u64::from(tree) } else { 0 };
        within(Rule::IndexChildren, 48, end, tree.into(), children_end)?;
    }
    let side = u64::from(s.log2_resolution);
    for (extent, origin, log2, bound) in [
        (58, u64::from(r.origin_x.get()), r.log2_x, side),
        (59, u64::from(r.origin_y.get()), r.log2_y, side),
        (60, u64::from(r.origin_l.get()), r.log2_l, 16),
    ] {
        within(Rule::IndexFootprint, extent, 0, bound, log2.into())?;
        let size = 1u64 << log2.min(63);
        if origin & (size - 1) != 0 || origin + size > 1 << bound {
            let expected = Value::Text("a multiple of its size inside the map");
            return fault(Rule::IndexFootprint, extent, expected, Value::Number(origin));
        }
    }
    within(Rule::IndexLevels, 62, 0, side, r.level_coarsest.into())?;
    within(Rule::IndexLevels, 61, 0, r.level_coarsest.into(), r.level_finest.into())
}

/// Checks that `record` (of `ordinal`, at byte `at` of the file) continues where `before` ends: its offset is the next
/// aligned one and its children are the next ordinals.
///
/// # Errors
/// `index.offset`, `index.children`.
pub fn check_follows(
    before: &PageRecord,
    record: &PageRecord,
    ordinal: u32,
    at: u64,
    cx: &IndexContext<'_>,
) -> Result<(), FormatError> {
    let checks = [
        (Rule::IndexOffset, 0, align_up(before.end(), cx.alignment), record.offset.get()),
        (
            Rule::IndexChildren,
            20,
            if ordinal >= cx.record.tree_pages() { 0 } else { before.children_end().into() },
            record.first_child.get().into(),
        ),
    ];
    for (rule, field, expected, found) in checks {
        if expected != found {
            let place = Place::Index(cx.structure);
            return Err(FormatError::new(rule, place, at + field, Value::Number(expected), Value::Number(found)));
        }
    }
    Ok(())
}
