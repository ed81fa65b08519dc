//! Checksums: CRC32 (IEEE, as in zip and PNG) finds damage, XXH3-64 names the content of a page.
//!
//! Each CRC but the header's also covers the file id and the number of what it protects, so that a block or page
//! of another file, structure or ordinal is refused although its bytes are whole. Byte offsets are not covered.

use crate::Header;

/// Identity of a file: hash of its sources, options, format and generator.
pub type FileId = [u8; 16];

/// CRC of a page as stored: `crc32(file_id || structure || ordinal || bytes)`, both numbers as little-endian u32. For
/// many pages of a structure: [`PageCrc`].
pub fn page_crc(file_id: &FileId, structure: u32, ordinal: u32, bytes: &[u8]) -> u32 {
    PageCrc::new(file_id, structure).of(ordinal, bytes)
}

/// CRCs of the pages of one structure: what all of them begin with is taken once.
#[derive(Clone, Copy, Debug)]
pub struct PageCrc {
    /// CRC of file id and structure.
    begun: u32,
}

impl PageCrc {
    /// Of a structure in a file.
    pub fn new(file_id: &FileId, structure: u32) -> Self {
        Self { begun: bound(file_id, &[structure], &[]) }
    }

    /// [`page_crc`] of one of its pages.
    #[inline]
    pub fn of(self, ordinal: u32, bytes: &[u8]) -> u32 {
        let mut h = crc32fast::Hasher::new_with_initial(with_word(self.begun, ordinal));
        h.update(bytes);
        h.finalize()
    }
}

/// What 1 byte does to a CRC with 0 to 3 bytes of zero behind it.
static STEPS: [[u32; 256]; 4] = steps();

const fn steps() -> [[u32; 256]; 4] {
    let mut steps = [[0; 256]; 4];
    let mut byte = 0;
    while byte < 256 {
        let mut crc = byte as u32;
        let mut k = 0;
        while k < 32 {
            crc = if crc & 1 == 1 { crc >> 1 ^ 0xEDB8_8320 } else { crc >> 1 };
            k += 1;
            if k % 8 == 0 {
                steps[k / 8 - 1][byte] = crc;
            }
        }
        byte += 1;
    }
    steps
}

/// A CRC with the 4 bytes of a number behind it. Pages may be so short that an update for these would count.
#[inline]
fn with_word(crc: u32, word: u32) -> u32 {
    let [a, b, c, d] = (!crc ^ word).to_le_bytes().map(usize::from);
    !(STEPS[3][a] ^ STEPS[2][b] ^ STEPS[1][c] ^ STEPS[0][d])
}

/// CRC of an index block: `crc32(file_id || structure || block number || bytes of the block after its crc field)`.
pub fn block_crc(file_id: &FileId, structure: u32, block: u32, after_crc: &[u8]) -> u32 {
    bound(file_id, &[structure, block], after_crc)
}

/// CRC of a structure record: `crc32(file_id || structure || bytes of the record before its crc field)`.
pub fn structure_crc(file_id: &FileId, structure: u32, before_crc: &[u8]) -> u32 {
    bound(file_id, &[structure], before_crc)
}

/// CRC of a model of cold pages, or of a section of a type that this version does not know: its bytes, nothing else, taken piece by piece.
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

/// Hash of a page's bytes as they are queried; equal content has equal hashes in every file.
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

/// One short update for the id and the numbers.
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
    fn a_word_behind_a_crc() {
        let mut word = 1u32;
        for _ in 0..1000 {
            word = word.wrapping_mul(0x9E37_79B9).rotate_left(5);
            let bytes = [b"some bytes".as_slice(), &word.to_le_bytes(), b"page"].concat();
            let found = PageCrc { begun: crc32fast::hash(b"some bytes") }.of(word, b"page");
            assert_eq!(found, crc32fast::hash(&bytes), "{word:#X}");
        }
    }

    #[test]
    fn binding_tells_places_apart() {
        let id = [7; 16];
        assert_ne!(page_crc(&id, 0, 1, b"page"), page_crc(&id, 1, 0, b"page"));
        assert_ne!(page_crc(&id, 0, 1, b"page"), page_crc(&[8; 16], 0, 1, b"page"));
    }
}
