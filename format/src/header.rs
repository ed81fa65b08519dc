//! The first 128 bytes of a file.
//!
//! In: the bytes of the header and of the section table behind it. Out: a [`Header`] that has been checked.
//! Next: [`crate::section`], which lies directly behind.

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing,
    clippy::cast_possible_truncation
)]

use zerocopy::{FromBytes, IntoBytes};

use crate::checksum::{FileId, header_crc};
use crate::error::{FormatError, Place, Rule, Value};
use crate::le::{U16, U32, U64};
use crate::record::{record, reserved_fault};

/// First bytes of every file. The high bit catches 7-bit transfer, CR LF and LF catch translated line ends,
/// SUB ends the listing of a text tool.
pub const MAGIC: [u8; 8] = *b"\xD5UMB\r\n\x1A\n";
/// Major version this crate reads and writes; a file of another one is refused.
pub const VERSION_MAJOR: u16 = 1;
/// Minor version this crate writes; a reader accepts every minor version.
pub const VERSION_MINOR: u16 = 0;
/// Bits of [`Header::required_features`] that this version knows.
pub const KNOWN_REQUIRED_FEATURES: u64 = 0;
/// Smallest and largest alignment exponent of the pages.
pub const ALIGNMENT_LOG2: core::ops::RangeInclusive<u8> = 2..=16;
/// Alignment exponent where the caller has no wish: 64 B, a cache line.
pub const DEFAULT_ALIGNMENT_LOG2: u8 = 6;

record! {
    /// Header of the file, at byte 0; the section table follows directly.
    Header: 128 bytes {
        /// `D5 55 4D 42 0D 0A 1A 0A`.
        0 => magic: [u8; 8];
        /// Version whose change breaks readers: 1.
        8 => version_major: U16;
        /// Version whose change does not break readers.
        10 => version_minor: U16;
        /// Size of this header in bytes: 128.
        12 => header_bytes: U32;
        /// Size of the whole file in bytes.
        16 => total_bytes: U64;
        /// Hash of sources, options, format and generator version.
        24 => file_id: [u8; 16];
        /// One bit for each feature that a reader must know; an unknown bit is refused by number.
        40 => required_features: U64;
        /// One bit for each feature that a reader may ignore.
        48 => optional_features: U64;
        /// Pages start at multiples of `1 << alignment_log2` bytes, 2 to 16.
        56 => alignment_log2: u8;
        /// Zero.
        57 => reserved0: [u8; 3];
        /// Records in the section table.
        60 => section_count: U32;
        /// Records in the structures section.
        64 => structure_count: U32;
        /// Zero.
        68 => reserved1: [u8; 56];
        /// CRC32 of header and section table, this field read as zero.
        124 => crc32: U32;
    }
}

impl Header {
    /// Reads the header from the start of the file and checks all that needs no other bytes: magic, version, sizes,
    /// features, alignment and reserved bytes. `file_bytes` is the true length of the file.
    ///
    /// # Errors
    /// The rule that is broken; see [`Rule`] for `header.*`.
    pub fn read(bytes: &[u8], file_bytes: u64) -> Result<&Header, FormatError> {
        let fault = |rule, offset, expected, found| FormatError::new(rule, Place::Header, offset, expected, found);
        if bytes.get(..MAGIC.len()) != Some(MAGIC.as_slice()) {
            let start = bytes.get(..8).and_then(|b| b.try_into().ok()).map_or(0, u64::from_be_bytes);
            return Err(fault(
                Rule::HeaderMagic,
                0,
                Value::Hex(u64::from_be_bytes(MAGIC)),
                if bytes.len() < 8 { Value::Number(bytes.len() as u64) } else { Value::Hex(start) },
            ));
        }
        let Ok((h, _)) = Header::ref_from_prefix(bytes) else {
            return Err(fault(
                Rule::HeaderTruncated,
                0,
                Value::AtLeast(Self::BYTES as u64),
                Value::Number(bytes.len() as u64),
            ));
        };
        let equal = |rule, offset, expected: u64, found: u64| {
            if expected == found {
                Ok(())
            } else {
                Err(fault(rule, offset, Value::Number(expected), Value::Number(found)))
            }
        };
        equal(Rule::HeaderVersion, 8, VERSION_MAJOR.into(), h.version_major.get().into())?;
        equal(Rule::HeaderSize, 12, Self::BYTES as u64, h.header_bytes.get().into())?;
        equal(Rule::HeaderLength, 16, h.total_bytes.get(), file_bytes)?;
        let unknown = h.required_features.get() & !KNOWN_REQUIRED_FEATURES;
        if unknown != 0 {
            let bit = Value::Number(unknown.trailing_zeros().into());
            return Err(fault(Rule::HeaderFeature, 40, Value::Text("only known feature bits"), bit));
        }
        if !ALIGNMENT_LOG2.contains(&h.alignment_log2) {
            let range = Value::Between((*ALIGNMENT_LOG2.start()).into(), (*ALIGNMENT_LOG2.end()).into());
            return Err(fault(Rule::HeaderAlignment, 56, range, Value::Number(h.alignment_log2.into())));
        }
        if let Some((at, byte)) = reserved_fault(h.as_bytes(), Self::RECORD.fields) {
            return Err(fault(Rule::HeaderReserved, at, Value::Number(0), Value::Number(byte.into())));
        }
        Ok(h)
    }

    /// Checks the CRC over the header and the bytes of the section table.
    ///
    /// # Errors
    /// `header.crc`.
    pub fn check_crc(&self, table: &[u8]) -> Result<(), FormatError> {
        FormatError::crc(Rule::HeaderCrc, Place::Header, 124, header_crc(self, table), self.crc32.get())
    }

    /// The file's identity.
    pub fn id(&self) -> &FileId {
        &self.file_id
    }

    /// Bytes of the section table.
    pub fn table_bytes(&self) -> u64 {
        u64::from(self.section_count.get()) * crate::section::SectionRecord::BYTES as u64
    }

    /// Alignment of the pages in bytes.
    pub fn alignment(&self) -> u64 {
        1 << self.alignment_log2.min(63)
    }
}

/// Smallest multiple of `alignment` (a power of two) that is at least `at`; the largest u64 where none exists.
pub fn align_up(at: u64, alignment: u64) -> u64 {
    let mask = alignment.wrapping_sub(1);
    at.checked_add(mask).map_or(u64::MAX, |v| v & !mask)
}
