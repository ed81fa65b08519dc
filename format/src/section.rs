//! The table of sections, directly behind the header.
//!
//! In: the table's records, already under the header's CRC. Out: [`check_table`] says that sections rise without
//! holes and without overlap up to the end of the file, and that every required one is known.
//! Next: [`crate::structure`] for the contents of section type 1, [`crate::index`] for type 2, [`crate::page`] for 3.

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing,
    clippy::cast_possible_truncation
)]

use zerocopy::IntoBytes;

use crate::error::{FormatError, Place, Rule, Value};
use crate::header::{Header, align_up};
use crate::le::{U32, U64};
use crate::record::{record, reserved_fault};

/// Section of the structure records; exactly one, the first of the file.
pub const STRUCTURES: u32 = 1;
/// Section of the index blocks of one structure.
pub const INDEX: u32 = 2;
/// Section of the pages of one structure.
pub const PAGES: u32 = 3;
/// Section of the model by which the cold pages of one structure are decoded; see [`crate::cold`].
pub const COLD: u32 = 4;
/// Flag bit: a reader that does not know the type must refuse the file.
pub const REQUIRED: u32 = 1;
/// Value of [`SectionRecord::structure`] where a section belongs to no structure.
pub const NO_STRUCTURE: u32 = u32::MAX;
/// Sections start at multiples of this many bytes; sections of pages at the file's alignment where that is larger.
pub const SECTION_ALIGNMENT: u64 = 64;

record! {
    /// One section: what it is, whose it is and where it lies.
    SectionRecord: 40 bytes {
        /// 1 structures, 2 index, 3 pages, 4 model of cold pages; others may come later.
        0 => kind: U32;
        /// Bit 0: a reader that does not know the type must refuse the file. Other bits zero.
        4 => flags: U32;
        /// Number of the structure it belongs to, or 0xFFFFFFFF.
        8 => structure: U32;
        /// CRC32 of the contents; zero for types 1 to 3, whose contents have CRCs of their own.
        12 => crc32: U32;
        /// First byte, counted from the start of the file.
        16 => offset: U64;
        /// Length in bytes, without the padding behind it.
        24 => length: U64;
        /// Zero.
        32 => reserved: [u8; 8];
    }
}

impl SectionRecord {
    /// First byte behind the section; saturates.
    pub fn end(&self) -> u64 {
        self.offset.get().saturating_add(self.length.get())
    }

    /// Whether this version knows the type.
    pub fn is_known(&self) -> bool {
        matches!(self.kind.get(), STRUCTURES | INDEX | PAGES | COLD)
    }

    /// Alignment of the section's first byte.
    pub fn alignment(kind: u32, header: &Header) -> u64 {
        if kind == PAGES { header.alignment().max(SECTION_ALIGNMENT) } else { SECTION_ALIGNMENT }
    }
}

/// Checks the whole table: types and flags, order, gaps, end of the file, one structures section, and one index and
/// one page section for each structure.
///
/// Time is linear in the table where sections of the structures come in order, as the writer leaves them: the index
/// sections by rising structure number, and so the page sections; another order is refused.
///
/// # Errors
/// `section.*`; the offset is that of the broken field.
pub fn check_table(header: &Header, table: &[SectionRecord]) -> Result<(), FormatError> {
    let mut end = Header::BYTES as u64 + header.table_bytes();
    // The structure whose index, or whose pages, must come next.
    let (mut next_index, mut next_pages) = (0u32, 0u32);
    // The first structure that may yet have a model.
    let mut next_model = 0u32;
    let structures = header.structure_count.get();
    let take = |next: &mut u32| {
        let owner = *next;
        *next = next.wrapping_add(1);
        owner
    };
    for (i, s) in table.iter().enumerate() {
        let base = (Header::BYTES + i * SectionRecord::BYTES) as u64;
        let fault = |rule, at: u64, expected, found| {
            Err(FormatError::new(rule, Place::SectionTable, base + at, expected, found))
        };
        let number = |v: u32| Value::Number(v.into());
        if let Some((at, byte)) = reserved_fault(s.as_bytes(), SectionRecord::RECORD.fields) {
            return fault(Rule::SectionReserved, at, Value::Number(0), Value::Number(byte.into()));
        }
        if s.flags.get() & !REQUIRED != 0 {
            return fault(Rule::SectionFlags, 4, Value::AtMost(REQUIRED.into()), number(s.flags.get()));
        }
        if !s.is_known() && s.flags.get() & REQUIRED != 0 {
            return fault(Rule::SectionUnknown, 0, Value::Between(1, 3), number(s.kind.get()));
        }
        if (i == 0) != (s.kind.get() == STRUCTURES) {
            let expected = if i == 0 { Value::Number(STRUCTURES.into()) } else { Value::Text("another type than 1") };
            return fault(Rule::SectionOrder, 0, expected, number(s.kind.get()));
        }
        let owner = match s.kind.get() {
            STRUCTURES => Some(NO_STRUCTURE),
            INDEX => Some(take(&mut next_index)),
            PAGES => Some(take(&mut next_pages)),
            _ => None,
        };
        if let Some(owner) = owner {
            if s.structure.get() != owner {
                return fault(Rule::SectionStructure, 8, number(owner), number(s.structure.get()));
            }
            if s.crc32.get() != 0 {
                return fault(Rule::SectionCrcField, 12, Value::Number(0), Value::Hex(s.crc32.get().into()));
            }
        } else if s.kind.get() == COLD {
            if !(next_model..structures).contains(&s.structure.get()) {
                let expected = Value::Text("a structure of the file behind that of the model before");
                return fault(Rule::SectionStructure, 8, expected, number(s.structure.get()));
            }
            next_model = s.structure.get().saturating_add(1);
        } else if s.structure.get() != NO_STRUCTURE && s.structure.get() >= structures {
            return fault(Rule::SectionStructure, 8, Value::Text("a structure of the file"), number(s.structure.get()));
        }
        let start = align_up(end, SectionRecord::alignment(s.kind.get(), header));
        if s.offset.get() != start {
            return fault(Rule::SectionOffset, 16, Value::Number(start), Value::Number(s.offset.get()));
        }
        let room = header.total_bytes.get().saturating_sub(start);
        if s.length.get() > room || s.length.get() == 0 {
            return fault(Rule::SectionLength, 24, Value::Between(1, room), Value::Number(s.length.get()));
        }
        end = s.end();
    }
    let fault = |rule, at, expected: u64, found: u64| {
        Err(FormatError::new(rule, Place::SectionTable, at, Value::Number(expected), Value::Number(found)))
    };
    if end != header.total_bytes.get() {
        return fault(Rule::SectionTrailing, 16, end, header.total_bytes.get());
    }
    for found in [next_index, next_pages] {
        if found != structures {
            return fault(Rule::SectionMissing, 64, structures.into(), found.into());
        }
    }
    match table.first() {
        Some(s) if s.length.get() == u64::from(structures) * crate::StructureRecord::BYTES as u64 => Ok(()),
        Some(s) => fault(
            Rule::SectionLength,
            Header::BYTES as u64 + 24,
            u64::from(structures) * crate::StructureRecord::BYTES as u64,
            s.length.get(),
        ),
        None => fault(Rule::SectionMissing, 60, 1, 0),
    }
}
