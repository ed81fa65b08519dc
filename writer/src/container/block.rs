//! One index block while it fills.

use umbrage_format::checksum::block_crc;
use umbrage_format::index::{IndexBlock, IndexContext, MAX_DEPENDENCIES};
use umbrage_format::{BlockHeader, PageRecord, StructureRecord};
use zerocopy::IntoBytes;

use super::WriteError;

/// Records and dependencies of the block that is being filled.
#[derive(Debug, Default)]
pub(super) struct BlockBuilder {
    records: Vec<PageRecord>,
    dependencies: Vec<u32>,
    /// Number of the block.
    number: u32,
    /// Records that a block holds.
    capacity: usize,
    /// Dependencies that a block holds.
    room: usize,
    bytes: usize,
}

impl BlockBuilder {
    /// The first block of a structure whose block sizes have been checked.
    pub(super) fn new(s: &StructureRecord) -> Self {
        let (bytes, capacity) = (s.block_bytes() as usize, usize::from(s.records_per_block.get()));
        let room = (bytes - BlockHeader::BYTES - capacity * PageRecord::BYTES) / 4;
        Self { capacity, room, bytes, ..Self::default() }
    }

    /// Adds a record and fills in its place in the dependency list; `false` where its dependencies have no room.
    pub(super) fn push(&mut self, record: &mut PageRecord, dependencies: &[u32]) -> bool {
        if dependencies.len() > self.dependency_room() {
            return false;
        }
        let first = if dependencies.is_empty() { 0 } else { self.dependencies.len() };
        // Both at most 16384: a block has at most 65536 bytes.
        (record.dep_first, record.dep_count) = ((first as u16).into(), (dependencies.len() as u16).into());
        self.records.push(*record);
        self.dependencies.extend_from_slice(dependencies);
        true
    }

    /// Dependencies that the next page may have.
    pub(super) fn dependency_room(&self) -> usize {
        (self.room - self.dependencies.len()).min(usize::from(MAX_DEPENDENCIES))
    }

    /// Whether the block has no records yet.
    pub(super) fn is_empty(&self) -> bool {
        self.records.is_empty()
    }

    /// Whether the block has all its records.
    pub(super) fn is_full(&self) -> bool {
        self.records.len() == self.capacity
    }

    /// Number and bytes of the block, checked; the next block is then empty.
    pub(super) fn take(&mut self, cx: &IndexContext<'_>) -> Result<(u32, Vec<u8>), WriteError> {
        let number = self.number;
        let mut head = BlockHeader::zeroed();
        head.structure = cx.structure.into();
        head.first_ordinal = (number * self.capacity as u32).into();
        head.record_count = (self.records.len() as u32).into();
        head.dep_count = (self.dependencies.len() as u32).into();
        let mut bytes = vec![0; self.bytes];
        let lists = BlockHeader::BYTES + self.capacity * PageRecord::BYTES;
        bytes[..BlockHeader::BYTES].copy_from_slice(head.as_bytes());
        let records = self.records.as_bytes();
        bytes[BlockHeader::BYTES..BlockHeader::BYTES + records.len()].copy_from_slice(records);
        for (to, d) in bytes[lists..].chunks_exact_mut(4).zip(&self.dependencies) {
            to.copy_from_slice(&d.to_le_bytes());
        }
        let crc = block_crc(cx.file_id, cx.structure, number, &bytes[4..]);
        bytes[..4].copy_from_slice(&crc.to_le_bytes());
        IndexBlock::check(&bytes, number, cx)?;
        self.records.clear();
        self.dependencies.clear();
        self.number += 1;
        Ok((number, bytes))
    }
}
