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

use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use umbrage_format::checksum::{PageCrc, SectionCrc};
use umbrage_format::cold::Model;
use umbrage_format::index::{IndexBlock, IndexContext, check_follows};
use umbrage_format::projection::Lattice;
use umbrage_format::{
    BlockHeader, FormatError, Header, Kind, PageRecord, Place, Rule, SectionRecord, StructureRecord, Value,
};

use crate::container::{Counts, Shared};
use crate::{CheckedPage, Limits, PageBytes, ReaderError};

/// Most bytes of the index that are read at once.
const READ_AHEAD: u64 = 1 << 20;

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
    /// Section of the model of its cold pages and its number, where there is one.
    pub(crate) cold: Option<(u32, SectionRecord)>,
    /// Read when the first cold page is.
    model: OnceLock<Arc<Model>>,
    /// Begun when the first page is read.
    page_crc: OnceLock<PageCrc>,
    /// Made when the first block is kept: its length comes from the file.
    blocks: OnceLock<Box<[OnceLock<Block>]>>,
    /// Held while a block is checked against its neighbours and stored.
    storing: Mutex<()>,
}

/// An index block that has been checked alone.
#[derive(Clone)]
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
            cold: None,
            model: OnceLock::new(),
            page_crc: OnceLock::new(),
            blocks: OnceLock::new(),
            storing: Mutex::new(()),
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
        if number == 0 && records.first() != Some(&self.record.root_page) {
            let (expected, found) = (Value::Text("the record in the structure's"), Value::Text("another"));
            let (place, at) = (Place::Index(self.number), self.first_record(number));
            return Err(FormatError::new(Rule::StructureRoot, place, at, expected, found));
        }
        let dependencies = records.iter().flat_map(|r| block.dependencies(r)).map(|d| d.get()).collect();
        self.store(number, Block { records, dependencies }, &cx)?;
        Counts::add(&shared.counts.blocks, 1);
        Ok(())
    }

    /// First byte in the file of a block's first record.
    fn first_record(&self, number: u32) -> u64 {
        self.index_offset + u64::from(number) * self.record.block_bytes() + BlockHeader::BYTES as u64
    }

    /// Keeps a block if it meets the kept blocks before and behind it. Under a lock: of two threads that bring
    /// neighbours at the same moment, the second must see the block of the first.
    fn store(&self, number: u32, block: Block, cx: &IndexContext<'_>) -> Result<(), FormatError> {
        let _alone = self.storing.lock().unwrap_or_else(PoisonError::into_inner);
        let at = self.first_record(number);
        let ordinal = number.saturating_mul(self.record.records_per_block.get().into());
        let kept = |number: Option<u32>| self.blocks().get(number? as usize)?.get();
        let before = kept(number.checked_sub(1)).and_then(|b| b.records.last());
        if let (Some(before), Some(first)) = (before, block.records.first()) {
            check_follows(before, first, ordinal, at, cx)?;
        }
        // Lookups touch blocks in any order: the one behind may have been first.
        let next = kept(number.checked_add(1)).and_then(|b| b.records.first());
        if let (Some(last), Some(next)) = (block.records.last(), next) {
            let ordinal = ordinal.saturating_add(self.record.records_per_block.get().into());
            check_follows(last, next, ordinal, at + self.record.block_bytes(), cx)?;
        }
        if let Some(slot) = self.blocks().get(number as usize) {
            // Where another thread was faster, its block is the same.
            let _ = slot.set(block);
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

    /// Whether the records of pages are in memory.
    pub fn has_records(&self, pages: std::ops::Range<u32>) -> bool {
        self.missing_blocks(pages).next().is_none()
    }

    /// Index blocks of pages that have not been read.
    fn missing_blocks(&self, pages: std::ops::Range<u32>) -> impl Iterator<Item = u32> {
        let per_block = u32::from(self.record().records_per_block.get()).max(1);
        let end = pages.end.min(self.page_count());
        let numbers = if pages.start < end { pages.start / per_block..end.div_ceil(per_block) } else { 0..0 };
        let blocks = self.state.blocks();
        numbers.filter(move |n| blocks.get(*n as usize).is_some_and(|b| b.get().is_none()))
    }

    /// Reads the records of pages that are not in memory, blocks that stand together at once. What goes wrong is said when a
    /// record is asked for.
    pub fn read_records(&self, pages: std::ops::Range<u32>) {
        let size = self.record().block_bytes();
        let most = (READ_AHEAD / size.max(1)).max(1);
        let missing: Vec<u32> = self.missing_blocks(pages).collect();
        for run in missing.chunk_by(|a, b| a + 1 == *b) {
            for run in run.chunks(usize::try_from(most).unwrap_or(1)) {
                let (Some(&first), Ok(bytes)) = (run.first(), usize::try_from(size * run.len() as u64)) else { return };
                let mut blocks = vec![0; bytes];
                if self.shared.read(self.state.index_offset + u64::from(first) * size, &mut blocks).is_err() {
                    return;
                }
                let parts = blocks.chunks_exact(usize::try_from(size).unwrap_or(1));
                for (number, block) in run.iter().zip(parts) {
                    if self.state.keep_block(*number, block, &self.shared).is_err() {
                        return;
                    }
                }
            }
        }
    }

    /// Whether it pays to name pages before they are read: see [`Source::gathers`](crate::Source::gathers).
    pub fn gathers(&self) -> bool {
        self.shared.source.gathers()
    }

    /// Says that pages will be read soon; those whose records are not in memory are left out.
    pub fn prefetch(&self, pages: impl IntoIterator<Item = u32>) {
        let known = |o: &u32| *o == 0 || self.has_records(*o..o.saturating_add(1));
        let records = pages.into_iter().filter(known).filter_map(|o| self.page_record(o).ok());
        let range = |r: PageRecord| r.offset.get()..r.offset.get().saturating_add(r.stored_bytes());
        self.shared.source.prefetch(&mut records.map(range).collect());
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

    /// What its cold pages are decoded with; read and checked where that has not been done. None where no page is cold.
    ///
    /// # Errors
    /// The source can't be read, `section.crc`, `cold.model`, or a limit.
    pub fn cold_model(&self) -> Result<Option<Arc<Model>>, ReaderError> {
        let Some((number, section)) = &self.state.cold else { return Ok(None) };
        if let Some(model) = self.state.model.get() {
            return Ok(Some(model.clone()));
        }
        let (place, at, length) = (Place::Section(*number), section.offset.get(), section.length.get());
        let needed = length.saturating_add(Model::most_bytes(self.kind()));
        self.limits().allocate(place, needed).map_err(|e| self.fault(e))?;
        let mut bytes = vec![0; usize::try_from(length).unwrap_or(0)];
        self.shared.read(at, &mut bytes)?;
        let mut crc = SectionCrc::default();
        crc.update(&bytes);
        let stored = section.crc32.get();
        FormatError::crc(Rule::SectionCrc, place, at, crc.finish(), stored).map_err(|e| self.fault(e))?;
        let model = Model::read(self.kind(), &bytes).ok_or_else(|| {
            let expected = Value::Text("the tables of its kind");
            self.fault(FormatError::new(Rule::ColdModel, place, at, expected, Value::Text("other bytes")))
        })?;
        Ok(Some(self.state.model.get_or_init(|| Arc::new(model)).clone()))
    }

    /// The section of that model, where there is one.
    pub fn cold_section(&self) -> Option<&SectionRecord> {
        self.state.cold.as_ref().map(|c| &c.1)
    }

    /// CRCs of its pages.
    pub(crate) fn page_crc(&self) -> PageCrc {
        *self.state.page_crc.get_or_init(|| PageCrc::new(self.shared.header.id(), self.number()))
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

#[cfg(test)]
#[allow(clippy::unwrap_used, clippy::indexing_slicing)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::*;

    /// Three blocks of one page each; the third does not begin where the second ends.
    fn three() -> (StructureState, [Block; 3]) {
        let mut record = StructureRecord::zeroed();
        (record.root_count, record.page_count) = (1.into(), 3.into());
        (record.records_per_block, record.index_block_log2) = (1.into(), 12);
        let blocks = [(0u64, 1u32), (64, 3), (256, 3)].map(|(offset, first_child)| {
            let mut page = PageRecord::zeroed();
            (page.offset, page.first_child, page.hot_words) = (offset.into(), first_child.into(), 16.into());
            page.child_count = if offset == 0 { 2 } else { 0 }.into();
            Block { records: [page].into(), dependencies: [].into() }
        });
        (StructureState::new(0, record, &SectionRecord::zeroed(), &SectionRecord::zeroed()), blocks)
    }

    fn header() -> Header {
        let mut header = Header::zeroed();
        header.alignment_log2 = 6;
        header
    }

    /// Both blocks have been read and checked alone before either is stored, as two threads may do it.
    #[test]
    fn of_neighbours_that_do_not_meet_only_the_first_is_kept() {
        let header = header();
        for order in [[1, 2], [2, 1]] {
            let (state, blocks) = three();
            let found = order.map(|n| state.store(n, blocks[n as usize].clone(), &state.context(&header)));
            assert_eq!(found.map(|r| r.err().map(|e| e.rule)), [None, Some(Rule::IndexOffset)], "{order:?}");
            let kept = order.map(|n| state.blocks()[n as usize].get().is_some());
            assert_eq!(kept, [true, false]);
        }
        let (state, blocks) = three();
        for n in [1, 0, 1] {
            state.store(n, blocks[n as usize].clone(), &state.context(&header)).unwrap();
        }
    }

    #[test]
    fn of_neighbours_stored_at_once_one_is_kept() {
        const ROUNDS: usize = 20_000;
        let header = header();
        let (_, blocks) = three();
        let states: Vec<StructureState> = (0..ROUNDS).map(|_| three().0).collect();
        let arrived = AtomicUsize::new(0);
        let run = |n: u32| {
            let mut refused = Vec::with_capacity(ROUNDS);
            for (i, state) in states.iter().enumerate() {
                let block = blocks[n as usize].clone();
                let cx = state.context(&header);
                // Made before, and no lock to wait at, so that both threads come to the neighbours together.
                state.blocks();
                arrived.fetch_add(1, Ordering::AcqRel);
                let mut spins = 0u32;
                while arrived.load(Ordering::Acquire) < 2 * (i + 1) {
                    spins += 1;
                    if spins.is_multiple_of(1000) {
                        std::thread::yield_now();
                    }
                    std::hint::spin_loop();
                }
                refused.push(state.store(n, block, &cx).is_err());
            }
            refused
        };
        let (first, second) = std::thread::scope(|s| {
            let other = s.spawn(|| run(2));
            (run(1), other.join().unwrap())
        });
        for (i, (a, b)) in first.into_iter().zip(second).enumerate() {
            assert!(a != b, "round {i}: block 1 refused {a}, block 2 refused {b}");
        }
    }
}
