//! Checksums: CRC32 (IEEE, as in zip and PNG) finds damage, XXH3-64 names the content of a page.
//!
//! Each CRC but the header's also covers the file id and the number of what it protects, so that a block or page
//! of another file, structure or ordinal is refused although its bytes are whole. Byte offsets are not covered.

use crate::Header;

/// Identity of a file: hash of its sources, options, format and generator.
pub type FileId = [u8; 16];

/// CRC of a page as stored: `crc32(file_id || structure || ordinal || bytes)`, both numbers as little-endian u32.
pub fn page_crc(file_id: &FileId, structure: u32, ordinal: u32, bytes: &[u8]) -> u32 {
    bound(file_id, &[structure, ordinal], bytes)
}

/// CRC of an index block: `crc32(file_id || structure || block number || bytes of the block after its crc field)`.
pub fn block_crc(file_id: &FileId, structure: u32, block: u32, after_crc: &[u8]) -> u32 {
    bound(file_id, &[structure, block], after_crc)
}

/// CRC of a structure record: `crc32(file_id || structure || bytes of the record before its crc field)`.
pub fn structure_crc(file_id: &FileId, structure: u32, before_crc: &[u8]) -> u32 {
    bound(file_id, &[structure], before_crc)
}

/// CRC of a section of a type that this version does not know: its bytes, nothing else, taken piece by piece.
#[derive(Clone, Debug, Default)]
pub struct SectionCrc(crc32fast::Hasher);

impl SectionCrc {
    /// Adds the next bytes.
    pub fn update(&mut self, bytes: &[u8]) {
        self.0.update(bytes);
    }

    /// The CRC of all bytes so far.
    pub fn finish(self) -> u32 {
        self.0.finalize()
    }
}

/// CRC of the header and the section table behind it, the header's own crc field read as zero.
pub fn header_crc(header: &Header, table: &[u8]) -> u32 {
    let mut h = crc32fast::Hasher::new();
    let mut copy = *header;
    copy.crc32 = 0.into();
    h.update(zerocopy::IntoBytes::as_bytes(&copy));
    h.update(table);
    h.finalize()
}

/// Hash of a page's stored bytes; equal content has equal hashes in every file.
pub fn content_hash(bytes: &[u8]) -> u64 {
    xxhash_rust::xxh3::xxh3_64(bytes)
}

/// What a CRC is bound to, as bytes.
#[derive(zerocopy::IntoBytes, zerocopy::Immutable)]
#[repr(C)]
struct Bound<const N: usize> {
    id: FileId,
    numbers: [[u8; 4]; N],
}

/// One short update for the id and the numbers: pages may be as short.
fn bound<const N: usize>(id: &FileId, numbers: &[u32; N], bytes: &[u8]) -> u32 {
    let head = Bound { id: *id, numbers: numbers.map(u32::to_le_bytes) };
    let mut h = crc32fast::Hasher::new();
    h.update(zerocopy::IntoBytes::as_bytes(&head));
    h.update(bytes);
    h.finalize()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_values() {
        let mut crc = SectionCrc::default();
        crc.update(b"12345");
        crc.update(b"6789");
        assert_eq!(crc.finish(), 0xCBF4_3926);
        assert_eq!(content_hash(b""), 0x2D06_8005_38D3_94C2);
    }

    #[test]
    fn binding_tells_places_apart() {
        let id = [7; 16];
        assert_ne!(page_crc(&id, 0, 1, b"page"), page_crc(&id, 1, 0, b"page"));
        assert_ne!(page_crc(&id, 0, 1, b"page"), page_crc(&[8; 16], 0, 1, b"page"));
    }
}
