//! One structure of an open file: its record, its index, its pages.
//!
//! In: ordinals. Out: page records and pages, each index block and page read and checked when it is first asked for.
//! Blocks are kept; pages belong to the caller ([`crate::query`] keeps them in a table).

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing,
    clippy::cast_possible_truncation
)]

use std::sync::{Arc, OnceLock};

use umbrage_format::index::{IndexBlock, IndexContext, check_follows};
use umbrage_format::projection::Lattice;
use umbrage_format::{
    BlockHeader, FormatError, Header, Kind, PageRecord, Place, Rule, SectionRecord, StructureRecord, Value,
};

use crate::container::{Counts, Shared};
use crate::{CheckedPage, Limits, PageBytes, ReaderError};

/// A structure of an open file. Clones are cheap and share the file.
#[derive(Clone)]
pub struct Structure {
    shared: Arc<Shared>,
    state: Arc<StructureState>,
}

/// What is kept of a structure.
pub(crate) struct StructureState {
    pub(crate) number: u32,
    pub(crate) record: StructureRecord,
    pub(crate) index_offset: u64,
    pub(crate) pages_offset: u64,
    pub(crate) pages_end: u64,
    /// Made when the first block is kept: its length comes from the file.
    blocks: OnceLock<Box<[OnceLock<Block>]>>,
}

/// An index block that has been checked.
struct Block {
    records: Box<[PageRecord]>,
    /// For each record, in order, the dependencies one behind the other.
    dependencies: Box<[u32]>,
}

impl StructureState {
    pub(crate) fn new(number: u32, record: StructureRecord, index: &SectionRecord, pages: &SectionRecord) -> Self {
        Self {
            number,
            record,
            index_offset: index.offset.get(),
            pages_offset: pages.offset.get(),
            pages_end: pages.end(),
            blocks: OnceLock::new(),
        }
    }

    pub(crate) fn context<'a>(&'a self, header: &'a Header) -> IndexContext<'a> {
        IndexContext {
            file_id: header.id(),
            alignment: header.alignment(),
            structure: self.number,
            record: &self.record,
            index_offset: self.index_offset,
            pages_offset: self.pages_offset,
            pages_end: self.pages_end,
        }
    }

    fn blocks(&self) -> &[OnceLock<Block>] {
        // One slot for each block that the file's length has room for, at least 4 KiB each.
        self.blocks.get_or_init(|| (0..self.record.block_count()).map(|_| OnceLock::new()).collect())
    }

    /// Checks a block and keeps it.
    pub(crate) fn keep_block(&self, number: u32, bytes: &[u8], shared: &Shared) -> Result<(), FormatError> {
        let cx = self.context(&shared.header);
        let block = IndexBlock::check(bytes, number, &cx)?;
        let records: Box<[PageRecord]> = block.records().into();
        let at = self.index_offset + u64::from(number) * self.record.block_bytes() + BlockHeader::BYTES as u64;
        if number == 0 && records.first() != Some(&self.record.root_page) {
            let (expected, found) = (Value::Text("the record in the structure's"), Value::Text("another"));
            return Err(FormatError::new(Rule::StructureRoot, Place::Index(self.number), at, expected, found));
        }
        let kept = |number: Option<u32>| self.blocks().get(number? as usize)?.get();
        let before = kept(number.checked_sub(1)).and_then(|b| b.records.last());
        if let (Some(before), Some(first)) = (before, records.first()) {
            check_follows(before, first, block.first_ordinal(), at, &cx)?;
        }
        // Lookups touch blocks in any order: the one behind may have been first.
        let next = kept(number.checked_add(1)).and_then(|b| b.records.first());
        if let (Some(last), Some(next)) = (records.last(), next) {
            let ordinal = block.first_ordinal().saturating_add(u32::from(self.record.records_per_block.get()));
            check_follows(last, next, ordinal, at + self.record.block_bytes(), &cx)?;
        }
        let dependencies = records.iter().flat_map(|r| block.dependencies(r)).map(|d| d.get()).collect();
        if let Some(slot) = self.blocks().get(number as usize) {
            // Where another thread was faster, its block is the same.
            let _ = slot.set(Block { records, dependencies });
            Counts::add(&shared.counts.blocks, 1);
        }
        Ok(())
    }
}

impl Structure {
    pub(crate) fn new(shared: &Arc<Shared>, number: u32) -> Option<Self> {
        let state = shared.structures.get(number as usize)?.clone();
        Some(Self { shared: shared.clone(), state })
    }

    /// Its place in the file.
    pub fn number(&self) -> u32 {
        self.state.number
    }

    /// Its name.
    pub fn name(&self) -> &str {
        self.record().name().unwrap_or_default()
    }

    /// Its record, checked.
    pub fn record(&self) -> &StructureRecord {
        &self.state.record
    }

    /// How it is encoded.
    pub fn kind(&self) -> Kind {
        self.record().kind().unwrap_or(Kind::Mh)
    }

    /// World to light-space lattice, resolution and sub-texel bits.
    pub fn lattice(&self) -> Lattice {
        self.record().lattice()
    }

    /// Number of pages, shared ones included.
    pub fn page_count(&self) -> u32 {
        self.record().page_count.get()
    }

    /// Number of index blocks.
    pub fn block_count(&self) -> u32 {
        self.record().block_count()
    }

    /// Name of the source.
    pub fn file(&self) -> &Arc<str> {
        &self.shared.file
    }

    /// The limits that the file was opened with.
    pub fn limits(&self) -> &Limits {
        &self.shared.limits
    }

    pub(crate) fn fault(&self, error: FormatError) -> ReaderError {
        ReaderError::Format { file: self.shared.file.clone(), error }
    }

    fn block(&self, ordinal: u32) -> Result<(&Block, usize), ReaderError> {
        let state = &self.state;
        if ordinal >= self.page_count() {
            return Err(ReaderError::OutOfRange {
                file: self.shared.file.clone(),
                what: format!("page of structure '{}'", self.name()),
                number: ordinal,
                count: self.page_count(),
            });
        }
        let per_block = u32::from(state.record.records_per_block.get()).max(1);
        let (number, place) = (ordinal / per_block, (ordinal % per_block) as usize);
        let missing = || {
            let place = Place::Index(self.number());
            self.fault(FormatError::new(Rule::IndexHead, place, 0, Value::Text("a block"), Value::Text("none")))
        };
        let slot = state.blocks().get(number as usize).ok_or_else(missing)?;
        if slot.get().is_none() {
            let mut bytes = vec![0; usize::try_from(state.record.block_bytes()).unwrap_or(0)];
            self.shared.read(state.index_offset + u64::from(number) * state.record.block_bytes(), &mut bytes)?;
            state.keep_block(number, &bytes, &self.shared).map_err(|e| self.fault(e))?;
        }
        Ok((slot.get().ok_or_else(missing)?, place))
    }

    /// The record of a page; reads and checks its index block where that has not been done.
    ///
    /// # Errors
    /// No such page, the source can't be read, or the block breaks a rule.
    pub fn page_record(&self, ordinal: u32) -> Result<PageRecord, ReaderError> {
        // The root page's record stands in the structure's, which spares a reader the index.
        if ordinal == 0 {
            return Ok(self.record().root_page);
        }
        let (block, place) = self.block(ordinal)?;
        block.records.get(place).copied().ok_or_else(|| {
            let place = Place::Index(self.number());
            self.fault(FormatError::new(Rule::IndexHead, place, 0, Value::Text("a record"), Value::Text("none")))
        })
    }

    /// Ordinals of the shared pages that a page depends on.
    ///
    /// # Errors
    /// As [`page_record`](Self::page_record).
    pub fn dependencies(&self, ordinal: u32) -> Result<Vec<u32>, ReaderError> {
        let (block, place) = self.block(ordinal)?;
        let Some(record) = block.records.get(place) else { return Ok(Vec::new()) };
        let first = usize::from(record.dep_first.get());
        let list = block.dependencies.get(first..first + usize::from(record.dep_count.get()));
        Ok(list.unwrap_or_default().to_vec())
    }

    /// Reads the stored bytes of a page and checks their CRC.
    ///
    /// # Errors
    /// No such page, the source can't be read, the page breaks `page.crc`, or a limit.
    pub fn page_bytes(&self, ordinal: u32) -> Result<PageBytes, ReaderError> {
        let record = self.page_record(ordinal)?;
        let place = Place::Page { structure: self.number(), ordinal };
        let most = self.limits().page_bytes.into();
        let longest = record.stored_bytes().max(u64::from(record.hot_words.get()) * 4);
        Limits::hold(Rule::LimitPageBytes, place, most, longest).map_err(|e| self.fault(e))?;
        let bytes = PageBytes::read(self, &self.shared, ordinal, record)?;
        Counts::add(&self.shared.counts.pages, 1);
        Counts::add(&self.shared.counts.page_bytes, record.stored_bytes());
        Ok(bytes)
    }

    /// A page that can be queried: CRC, frame and nodes checked.
    ///
    /// # Errors
    /// As [`page_bytes`](Self::page_bytes), a rule of frame or kind, or a kind that this version can't query.
    pub fn page(&self, ordinal: u32) -> Result<CheckedPage, ReaderError> {
        self.page_bytes(ordinal)?.check_frame()?.check_kind()
    }

    pub(crate) fn shared(&self) -> &Shared {
        &self.shared
    }

    /// Reads and checks the block of an ordinal, also where its first record is known already.
    pub(crate) fn touch_block(&self, ordinal: u32) -> Result<(), ReaderError> {
        self.block(ordinal).map(drop)
    }
}

impl std::fmt::Debug for Structure {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Structure").field("file", &self.shared.file).field("name", &self.name()).finish()
    }
}
