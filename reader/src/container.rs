//! Opening a file.
//!
//! In: a [`Source`] and [`Limits`]. Out: a [`Container`] whose header, section table and structure records are
//! checked, and whose index is checked as far as it lies in the first 16 KiB. Next: [`crate::structure`].

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing,
    clippy::cast_possible_truncation
)]

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use umbrage_format::index::check_record;
use umbrage_format::section::{COLD, INDEX, PAGES, check_table};
use umbrage_format::{FileId, FormatError, Header, PageRecord, Place, Rule, SectionRecord, StructureRecord, Value};
use zerocopy::FromBytes;

use crate::structure::StructureState;
use crate::{Limits, ReaderError, Source, Structure};

/// Offset of the root page's record in a structure record.
const ROOT_PAGE_AT: u64 = std::mem::offset_of!(StructureRecord, root_page) as u64;

/// Bytes of the first read. With a root page of at most 48 KiB, a first answer takes 2 reads and 64 KiB.
pub const HEAD_BYTES: usize = 16 << 10;

/// An open file. Clones share it; it may be used from any thread.
#[derive(Clone)]
pub struct Container {
    shared: Arc<Shared>,
}

/// What was read so far, for all users of a container.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Pages loaded.
    pub pages: u64,
    /// Bytes of those pages.
    pub page_bytes: u64,
    /// Index blocks loaded.
    pub blocks: u64,
    /// Reads of the source, the first one included.
    pub reads: u64,
    /// Bytes of those reads.
    pub bytes: u64,
}

/// The checked head of a file and its source.
pub(crate) struct Shared {
    pub(crate) source: Arc<dyn Source>,
    pub(crate) file: Arc<str>,
    pub(crate) limits: Limits,
    pub(crate) header: Header,
    pub(crate) sections: Vec<SectionRecord>,
    pub(crate) structures: Vec<Arc<StructureState>>,
    pub(crate) counts: Counts,
}

/// [`Counters`] as they grow.
#[derive(Default)]
pub(crate) struct Counts {
    pub(crate) pages: AtomicU64,
    pub(crate) page_bytes: AtomicU64,
    pub(crate) blocks: AtomicU64,
    pub(crate) reads: AtomicU64,
    pub(crate) bytes: AtomicU64,
}

impl Counts {
    pub(crate) fn add(counter: &AtomicU64, n: u64) {
        counter.fetch_add(n, Ordering::Relaxed);
    }
}

/// Reads ranges, from the head where it holds them.
struct Head<'a> {
    source: &'a dyn Source,
    file: &'a Arc<str>,
    bytes: Vec<u8>,
    counts: Counts,
}

impl Head<'_> {
    /// Copy of a range; its length has been held against the limits and the length of the file.
    fn range(&self, offset: u64, length: u64) -> Result<Vec<u8>, ReaderError> {
        let whole = usize::try_from(offset).ok().zip(usize::try_from(length).ok());
        if let Some(bytes) = whole.and_then(|(o, l)| self.bytes.get(o..o.checked_add(l)?)) {
            return Ok(bytes.to_vec());
        }
        let mut bytes = vec![0; whole.map_or(0, |(_, l)| l)];
        self.source.read_at(offset, &mut bytes).map_err(|e| ReaderError::io(self.file, "read", e))?;
        Counts::add(&self.counts.reads, 1);
        Counts::add(&self.counts.bytes, length);
        Ok(bytes)
    }
}

impl Container {
    /// Opens a source: one read of at most 16 KiB, more only where the section table or the structure records reach
    /// beyond it.
    ///
    /// # Errors
    /// The source can't be read, or the file breaks a rule or a limit.
    pub fn open(source: Arc<dyn Source>, limits: Limits) -> Result<Self, ReaderError> {
        let file: Arc<str> = Arc::from(source.name());
        let fault = ReaderError::format(&file);
        let length = source.len();
        let first = usize::try_from(length).map_or(HEAD_BYTES, |l| l.min(HEAD_BYTES));
        let mut bytes = vec![0; first];
        source.read_at(0, &mut bytes).map_err(|e| ReaderError::io(&file, "read", e))?;
        let counts = Counts::default();
        Counts::add(&counts.reads, 1);
        Counts::add(&counts.bytes, first as u64);
        let head = Head { source: source.as_ref(), file: &file, bytes, counts };

        let header = *Header::read(&head.bytes, length).map_err(&fault)?;
        let table_end = Header::BYTES as u64 + header.table_bytes();
        if table_end > length {
            let (expected, found) = (Value::AtLeast(table_end), Value::Number(length));
            return Err(fault(FormatError::new(Rule::HeaderTruncated, Place::Header, 60, expected, found)));
        }
        let (most, found) = (limits.sections.into(), header.section_count.get().into());
        Limits::hold(Rule::LimitSections, Place::Header, most, found).map_err(&fault)?;
        limits.allocate(Place::SectionTable, header.table_bytes()).map_err(&fault)?;
        let table = head.range(Header::BYTES as u64, header.table_bytes())?;
        header.check_crc(&table).map_err(&fault)?;
        let (most, found) = (limits.structures.into(), header.structure_count.get().into());
        Limits::hold(Rule::LimitStructures, Place::Header, most, found).map_err(&fault)?;
        let sections = <[SectionRecord]>::ref_from_bytes(&table).unwrap_or_default().to_vec();
        check_table(&header, &sections).map_err(&fault)?;
        let structures = read_structures(&head, &header, &sections, &limits, &fault)?;
        let Head { bytes, counts, .. } = head;
        let shared =
            Shared { source: source.clone(), file: file.clone(), limits, header, sections, structures, counts };
        shared.check_head(&bytes).map_err(&fault)?;
        Ok(Self { shared: Arc::new(shared) })
    }

    /// Number of structures.
    pub fn structure_count(&self) -> u32 {
        self.shared.header.structure_count.get()
    }

    /// The structures in the file's order.
    pub fn structures(&self) -> impl Iterator<Item = Structure> + '_ {
        (0..self.structure_count()).filter_map(|i| self.structure(i).ok())
    }

    /// The structure of a number.
    ///
    /// # Errors
    /// [`ReaderError::OutOfRange`].
    pub fn structure(&self, number: u32) -> Result<Structure, ReaderError> {
        Structure::new(&self.shared, number).ok_or_else(|| ReaderError::OutOfRange {
            file: self.shared.file.clone(),
            what: "structure".to_string(),
            number,
            count: self.structure_count(),
        })
    }

    /// The structure of a name.
    ///
    /// # Errors
    /// [`ReaderError::UnknownStructure`], which lists the names there are.
    pub fn structure_named(&self, name: &str) -> Result<Structure, ReaderError> {
        self.structures().find(|s| s.name() == name).ok_or_else(|| ReaderError::UnknownStructure {
            file: self.shared.file.clone(),
            name: name.to_string(),
            names: self.structures().map(|s| s.name().to_string()).collect(),
        })
    }

    /// The header.
    pub fn header(&self) -> &Header {
        &self.shared.header
    }

    /// The file's identity.
    pub fn file_id(&self) -> &FileId {
        self.shared.header.id()
    }

    /// The section table.
    pub fn sections(&self) -> &[SectionRecord] {
        &self.shared.sections
    }

    /// Name of the source.
    pub fn file(&self) -> &str {
        &self.shared.file
    }

    /// The limits that the file was opened with.
    pub fn limits(&self) -> &Limits {
        &self.shared.limits
    }

    /// What was read so far.
    pub fn counters(&self) -> Counters {
        let c = &self.shared.counts;
        let get = |v: &AtomicU64| v.load(Ordering::Relaxed);
        Counters {
            pages: get(&c.pages),
            page_bytes: get(&c.page_bytes),
            blocks: get(&c.blocks),
            reads: get(&c.reads),
            bytes: get(&c.bytes),
        }
    }

    pub(crate) fn shared(&self) -> &Arc<Shared> {
        &self.shared
    }
}

/// Checks the structure records and what their sections owe them.
fn read_structures(
    head: &Head<'_>,
    header: &Header,
    sections: &[SectionRecord],
    limits: &Limits,
    fault: &impl Fn(FormatError) -> ReaderError,
) -> Result<Vec<Arc<StructureState>>, ReaderError> {
    // The table's check has seen to it that the first section is this one and has a record for each structure.
    let Some(section) = sections.first() else { return Ok(Vec::new()) };
    limits.allocate(Place::Section(0), section.length.get()).map_err(fault)?;
    let bytes = head.range(section.offset.get(), section.length.get())?;
    let records = <[StructureRecord]>::ref_from_bytes(&bytes).unwrap_or_default();
    let mut names = std::collections::HashSet::new();
    let mut states = Vec::with_capacity(records.len());
    let mut models = (0u32..).zip(sections).filter(|s| s.1.kind.get() == COLD).peekable();
    let of = |kind| sections.iter().filter(move |s| s.kind.get() == kind);
    for (i, ((record, index), pages)) in (0u32..).zip(records.iter().zip(of(INDEX)).zip(of(PAGES))) {
        let at = section.offset.get() + u64::from(i) * StructureRecord::BYTES as u64;
        record.check(header.id(), i, at).map_err(fault)?;
        let name = record.name().unwrap_or_default();
        if !names.insert(name) {
            let (expected, found) = (Value::Text("a name of its own"), Value::Text("the name of another"));
            return Err(fault(FormatError::new(Rule::StructureUnique, Place::Structure(i), at, expected, found)));
        }
        let place = Place::Structure(i);
        let count = record.page_count.get().into();
        Limits::hold(Rule::LimitPages, place, limits.pages.into(), count).map_err(fault)?;
        let expected = u64::from(record.block_count()) * record.block_bytes();
        if expected != index.length.get() {
            let (expected, found) = (Value::Number(expected), Value::Number(index.length.get()));
            let at = index.offset.get();
            return Err(fault(FormatError::new(Rule::IndexLength, Place::Index(i), at, expected, found)));
        }
        // A slot for each block and each page is the most that a reader keeps of an index.
        limits.allocate(place, u64::from(record.page_count.get()) * PageRecord::BYTES as u64).map_err(fault)?;
        let mut state = StructureState::new(i, *record, index, pages);
        // Models come in the order of their structures.
        state.cold = models.next_if(|m| m.1.structure.get() == i).map(|(number, s)| (number, *s));
        check_record(&record.root_page, 0, at + ROOT_PAGE_AT, &state.context(header)).map_err(fault)?;
        states.push(Arc::new(state));
    }
    Ok(states)
}

impl std::fmt::Debug for Container {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Container").field("file", &self.shared.file).field("header", &self.shared.header).finish()
    }
}

impl Shared {
    /// Checks padding and first index blocks that lie whole in the head.
    fn check_head(&self, head: &[u8]) -> Result<(), FormatError> {
        let mut end = Header::BYTES as u64 + self.header.table_bytes();
        for (i, s) in (0u32..).zip(&self.sections) {
            let range = usize::try_from(end).ok().zip(usize::try_from(s.offset.get()).ok());
            if let Some(padding) = range.and_then(|(a, b)| head.get(a..b)) {
                check_padding(padding, end, Rule::SectionPadding, Place::Section(i))?;
            }
            end = s.end();
        }
        for s in &self.structures {
            let start = usize::try_from(s.index_offset).ok();
            let length = usize::try_from(s.record.block_bytes()).ok();
            if let Some(block) = start.zip(length).and_then(|(o, l)| head.get(o..o.checked_add(l)?)) {
                s.keep_block(0, block, self)?;
            }
        }
        Ok(())
    }

    /// Reads a range of at most `limits` bytes; the range was checked to lie in the file.
    pub(crate) fn read(&self, offset: u64, out: &mut [u8]) -> Result<(), ReaderError> {
        Counts::add(&self.counts.reads, 1);
        Counts::add(&self.counts.bytes, out.len() as u64);
        self.source.read_at(offset, out).map_err(|e| ReaderError::io(&self.file, "read", e))
    }
}

/// Refuses padding that is not zero; `offset` is its first byte in the file.
pub(crate) fn check_padding(bytes: &[u8], offset: u64, rule: Rule, place: Place) -> Result<(), FormatError> {
    match bytes.iter().position(|&b| b != 0) {
        None => Ok(()),
        Some(i) => {
            let found = bytes.get(i).copied().unwrap_or(0);
            let at = offset + i as u64;
            Err(FormatError::new(rule, place, at, Value::Number(0), Value::Number(found.into())))
        }
    }
}
