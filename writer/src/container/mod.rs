//! Pages -> container file.
//!
//! In: the file's identity, one [`StructureRecord`] for each structure with the number of its pages, then the pages
//! themselves in ordinal order, structure by structure. Out: a whole file under the target's name, or none.
//!
//! - [`ContainerWriter`] (here): the layout of the file and the walk through it; pages go straight to their place, each
//!   index block as soon as it is full, header and structure records last. Memory: one block, one page, and 32 bytes
//!   for each page that a parent has announced, with the planes that a `vector` page inherits about 200 more.
//! - [`Target`]: the temporary file beside the target, sync, rename.
//! - [`WriteError`]: what can go wrong, in words for the one who called.
//!
//! Every page and every block is checked with the rules of `umbrage_format` before it is written, so that the writer
//! leaves no file that the reader refuses.

mod aside;
mod block;
mod error;
mod target;

use std::collections::VecDeque;
use std::path::{Path, PathBuf};

use umbrage_format::checksum::{SectionCrc, content_hash, header_crc, page_crc};
use umbrage_format::header::{ALIGNMENT_LOG2, DEFAULT_ALIGNMENT_LOG2, MAGIC, VERSION_MAJOR, VERSION_MINOR, align_up};
use umbrage_format::index::{BlockHeader, IndexContext, MAX_PAGE_WORDS};
use umbrage_format::kind::mmh::References;
use umbrage_format::kind::tree::{self, Link};
use umbrage_format::page::{FrameHead, PageContext, check_frame};
use umbrage_format::section::{COLD, INDEX, NO_STRUCTURE, PAGES, REQUIRED, STRUCTURES, check_table};
use umbrage_format::{FileId, Header, Kind, PageRecord, SectionRecord, StructureRecord};
use zerocopy::IntoBytes;

pub use error::WriteError;
pub use target::Target;

use aside::Aside;
use block::BlockBuilder;

use crate::cold::Tally;

/// What holds for the whole file.
#[derive(Clone, Copy, Debug)]
pub struct ContainerOptions {
    /// Hash of sources, options, format and generator version; the same input must give the same id.
    pub file_id: FileId,
    /// Pages start at multiples of `1 << alignment_log2` bytes, 2 to 16.
    pub alignment_log2: u8,
    /// Store pages in their cold form, where that is shorter; root pages stay as they are queried, so that a first look
    /// needs no model.
    pub cold: bool,
}

impl ContainerOptions {
    /// Options with pages on cache lines.
    pub fn new(file_id: FileId) -> Self {
        Self { file_id, alignment_log2: DEFAULT_ALIGNMENT_LOG2, cold: false }
    }

    /// Options with cold pages, one directly behind the other: nobody maps them.
    pub fn cold(file_id: FileId) -> Self {
        Self { file_id, alignment_log2: *ALIGNMENT_LOG2.start(), cold: true }
    }
}

/// One finished page.
#[derive(Clone, Debug)]
pub struct PageInput {
    /// The page, frame included, 2 to 16384 words.
    pub words: Vec<u32>,
    /// Footprint, levels, depths, stop error, root and page type; the other fields are filled in by the writer.
    pub record: PageRecord,
    /// Ordinals of the shared pages that it refers to, at most 256, in the order in which its words number them.
    pub dependencies: Vec<u32>,
}

/// What was written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Written {
    /// Bytes of the file.
    pub bytes: u64,
    /// Pages of all structures.
    pub pages: u64,
}

/// Writes a container: [`create`](Self::create), [`push`](Self::push) for each page, [`finish`](Self::finish).
/// Dropped before `finish`, it leaves no trace and the old target as it was.
#[derive(Debug)]
pub struct ContainerWriter {
    target: Target,
    header: Header,
    sections: Vec<SectionRecord>,
    structures: Vec<StructureRecord>,
    /// Which of them have cold pages.
    cold: Vec<bool>,
    path: PathBuf,
    /// Structure that the next page belongs to.
    current: usize,
    state: StructureState,
    pages: u64,
}

/// What is known of the structure being written.
#[derive(Debug, Default)]
struct StructureState {
    /// Next ordinal.
    ordinal: u32,
    /// First child of the next page.
    first_child: u32,
    /// First free byte behind the last page.
    end: u64,
    /// Nodes by type, for kinds that are counted here.
    nodes: [u64; 3],
    /// What parents said of the pages to come, in ordinal order.
    announced: VecDeque<Link>,
    /// What nodes said of groups in shared pages to come.
    references: References,
    block: BlockBuilder,
    /// Where pages wait that become cold ones.
    aside: Option<Aside>,
}

impl ContainerWriter {
    /// Opens a temporary file beside `target` and lays out the file.
    ///
    /// Of each structure record the caller fills in everything but `root_page`, `crc32`, and for `mh` the node
    /// counts; `page_count` and `shared_pages` must be final. 0 in `records_per_block` and `index_block_log2` means
    /// 63 records in 4096 bytes, which leaves no room for dependencies.
    ///
    /// # Errors
    /// The target can't be written, or a structure breaks a rule of the format.
    pub fn create(
        target: &Path,
        options: ContainerOptions,
        structures: Vec<StructureRecord>,
    ) -> Result<Self, WriteError> {
        let cold = vec![options.cold; structures.len()];
        Self::create_each(target, options, structures, cold)
    }

    /// As [`create`](Self::create), with a word for each structure whether its pages become cold ones. Kinds without a
    /// layout have no cold pages.
    ///
    /// # Errors
    /// As [`create`](Self::create).
    pub fn create_each(
        target: &Path,
        options: ContainerOptions,
        structures: Vec<StructureRecord>,
        mut cold: Vec<bool>,
    ) -> Result<Self, WriteError> {
        let structures = prepare(structures, &options)?;
        cold.resize(structures.len(), false);
        cold.iter_mut().zip(&structures).for_each(|(c, s)| *c &= s.kind().is_some_and(Kind::has_layout));
        let models = cold.iter().filter(|c| **c).count();
        let header = header(&options, structures.len(), models)?;
        let mut writer = Self {
            target: Target::create(target)?,
            header,
            sections: Vec::new(),
            structures,
            cold,
            path: target.to_path_buf(),
            current: 0,
            state: StructureState::default(),
            pages: 0,
        };
        writer.lay_out()?;
        writer.begin()?;
        Ok(writer)
    }

    /// Places the sections whose sizes are known, all but the lengths of the page sections.
    fn lay_out(&mut self) -> Result<(), WriteError> {
        let count = self.structures.len();
        let mut end = Header::BYTES as u64 + self.header.table_bytes();
        let mut section = |kind: u32, structure: u32, length: u64| {
            let mut s = SectionRecord::zeroed();
            let offset = align_up(end, SectionRecord::alignment(kind, &self.header));
            (s.kind, s.flags, s.structure) = (kind.into(), REQUIRED.into(), structure.into());
            (s.offset, s.length) = (offset.into(), length.into());
            end = s.end();
            self.sections.push(s);
        };
        section(STRUCTURES, NO_STRUCTURE, (count * StructureRecord::BYTES) as u64);
        for (i, s) in (0u32..).zip(&self.structures) {
            section(INDEX, i, u64::from(s.block_count()) * s.block_bytes());
        }
        // The first pages follow; the others are placed when those before are written.
        self.state.end = end;
        Ok(())
    }

    /// Starts the pages of the current structure; those that become cold ones are put aside first.
    fn begin(&mut self) -> Result<(), WriteError> {
        let record = &self.structures[self.current];
        let tally = record.kind().filter(|_| self.cold[self.current]).and_then(Tally::new);
        self.state = StructureState {
            first_child: record.root_count.get(),
            end: self.state.end,
            block: BlockBuilder::new(record),
            aside: tally.map(|tally| Aside::new(&self.path, tally)).transpose()?,
            ..StructureState::default()
        };
        if self.state.aside.is_some() { Ok(()) } else { self.open_section(PAGES, 0, 0).map(drop) }
    }

    /// Places a section of the current structure behind what is written; returns where it starts.
    fn open_section(&mut self, kind: u32, length: u64, crc: u32) -> Result<u64, WriteError> {
        let start = align_up(self.state.end, SectionRecord::alignment(kind, &self.header));
        self.target.pad_to(start)?;
        let mut s = SectionRecord::zeroed();
        (s.kind, s.flags, s.structure) = (kind.into(), REQUIRED.into(), number(self.current).into());
        (s.offset, s.length, s.crc32) = (start.into(), length.into(), crc.into());
        self.sections.push(s);
        self.state.end = start + length;
        Ok(start)
    }

    /// Adds the next page of the current structure; behind the last page of one structure follows the first of the
    /// next.
    ///
    /// # Errors
    /// The page breaks a rule, there are more pages than announced, or the file can't be written.
    pub fn push(&mut self, page: &PageInput) -> Result<(), WriteError> {
        if self.current == self.structures.len() {
            return Err(WriteError::TooManyPages { pages: self.pages });
        }
        let (number, structure) = (number(self.current), self.structures[self.current]);
        let ordinal = self.state.ordinal;
        let head = FrameHead::decode(&page.words).filter(|_| page.words.len() <= usize::from(MAX_PAGE_WORDS)).ok_or(
            WriteError::PageLength { structure: number, ordinal, words: page.words.len(), most: MAX_PAGE_WORDS },
        )?;
        let mut record = page.record;
        record.first_child = if ordinal < structure.tree_pages() { self.state.first_child } else { 0 }.into();
        record.child_count = head.child_refs.into();
        // At most MAX_PAGE_WORDS, checked above.
        record.hot_words = (page.words.len() as u16).into();
        // More than fit are refused below; their place in the block is known then.
        record.dep_count = (page.dependencies.len().min(usize::from(u16::MAX)) as u16).into();
        self.check(page, &head, &record)?;
        if let Some(aside) = &mut self.state.aside {
            aside.push(&record, &page.words, &page.dependencies)?;
        } else {
            self.place(record, ordinal, &page.words, None, &page.dependencies)?;
        }
        self.state.first_child = self.state.first_child.saturating_add(head.child_refs.into());
        self.state.ordinal += 1;
        self.pages += 1;
        if self.state.ordinal == structure.page_count.get() {
            self.bring_back()?;
            if !self.state.block.is_empty() {
                self.write_block()?;
            }
            self.end_structure()?;
        }
        Ok(())
    }

    /// Writes a page that has been checked to its place, and the index block that it fills.
    fn place(
        &mut self,
        mut record: PageRecord,
        ordinal: u32,
        words: &[u32],
        cold: Option<Vec<u8>>,
        dependencies: &[u32],
    ) -> Result<(), WriteError> {
        let number = number(self.current);
        let hot: Vec<u8> = words.iter().flat_map(|w| w.to_le_bytes()).collect();
        let stored = cold.as_ref().unwrap_or(&hot);
        let start = align_up(self.state.end, self.header.alignment());
        record.offset = start.into();
        record.content_hash = content_hash(&hot).into();
        record.crc32 = page_crc(&self.header.file_id, number, ordinal, stored).into();
        // Shorter than the page.
        record.cold_words = cold.as_ref().map_or(0, |cold| (cold.len() / 4) as u16).into();
        if !self.state.block.push(&mut record, dependencies) {
            let room = self.state.block.dependency_room();
            return Err(WriteError::Dependencies { structure: number, ordinal, count: dependencies.len(), room });
        }
        if ordinal == 0 {
            self.structures[self.current].root_page = record;
        }
        self.target.pad_to(start)?;
        self.target.append(stored)?;
        self.state.end = record.end();
        if self.state.block.is_full() { self.write_block() } else { Ok(()) }
    }

    /// Writes the model and the pages that were put aside, if they were.
    fn bring_back(&mut self) -> Result<(), WriteError> {
        let Some(aside) = self.state.aside.take() else { return Ok(()) };
        let (tables, mut pages) = aside.finish()?;
        let mut crc = SectionCrc::default();
        crc.update(tables.section());
        self.open_section(COLD, tables.section().len() as u64, crc.finish())?;
        self.target.append(tables.section())?;
        self.open_section(PAGES, 0, 0)?;
        let roots = self.structures[self.current].root_count.get();
        let mut ordinal = 0;
        while let Some(page) = pages.next()? {
            let cold = if ordinal < roots { None } else { tables.encode(&page.words) };
            self.place(page.record, ordinal, &page.words, cold, &page.dependencies)?;
            ordinal += 1;
        }
        Ok(())
    }

    /// Checks frame and nodes of a page and that it is what its parent announced; notes what it announces itself.
    fn check(&mut self, page: &PageInput, head: &FrameHead, record: &PageRecord) -> Result<(), WriteError> {
        let cx = PageContext {
            structure: number(self.current),
            ordinal: self.state.ordinal,
            page: record,
            record: &self.structures[self.current],
        };
        check_frame(&page.words, &cx)?;
        let Some(counts) = tree::check(&page.words, head, &cx) else { return Ok(()) };
        let counts = counts?;
        for (sum, n) in self.state.nodes.iter_mut().zip([counts.leaves, counts.inner, counts.empty]) {
            *sum += u64::from(n);
        }
        let said = if cx.is_root() || record.is_shared() { None } else { self.state.announced.pop_front() };
        if let Some(link) = &said {
            tree::check_link(link, &page.words, head, &cx)?;
        }
        if cx.record.kind() == Some(Kind::Mmh) && record.is_shared() {
            self.state.references.check(&page.words, &cx)?;
        } else if cx.record.kind() == Some(Kind::Mmh) {
            let inherited = tree::inherited(said.as_ref(), &cx);
            self.state.references.note(&page.words, head, &cx, &page.dependencies, inherited);
        }
        let mut links = vec![None; usize::from(head.child_refs)];
        tree::links(&page.words, head, &cx, said.as_ref(), |child, link| links[usize::from(child)] = Some(link));
        self.state.announced.extend(links.into_iter().flatten());
        Ok(())
    }

    /// Checks the block that is being filled and writes it to its place.
    fn write_block(&mut self) -> Result<(), WriteError> {
        let structure = number(self.current);
        let (index, pages) = (self.sections[1 + self.current], self.sections[self.sections.len() - 1]);
        let cx = IndexContext {
            file_id: &self.header.file_id,
            alignment: self.header.alignment(),
            structure,
            record: &self.structures[self.current],
            index_offset: index.offset.get(),
            pages_offset: pages.offset.get(),
            // Behind the last page this is the end of the section; before, a bound that the pages so far meet.
            pages_end: self.state.end,
        };
        let (number, bytes) = self.state.block.take(&cx)?;
        let at = index.offset.get() + u64::from(number) * cx.record.block_bytes();
        self.target.write_at(at, &bytes)
    }

    /// Closes the page section of the current structure and starts the next.
    fn end_structure(&mut self) -> Result<(), WriteError> {
        if let Some(s) = self.sections.last_mut() {
            s.length = (self.state.end - s.offset.get()).into();
        }
        let record = &mut self.structures[self.current];
        if record.kind().is_some_and(Kind::has_layout) {
            let [leaves, inner, empty] = self.state.nodes;
            (record.leaf_nodes, record.inner_nodes, record.empty_nodes) = (leaves.into(), inner.into(), empty.into());
        }
        record.crc32 = record.computed_crc(&self.header.file_id, number(self.current)).into();
        self.current += 1;
        if self.current < self.structures.len() { self.begin() } else { Ok(()) }
    }

    /// Adds pages from an iterator; see [`push`](Self::push). Pages that are read from a spool file bring its errors.
    ///
    /// # Errors
    /// Of the iterator or of `push`.
    pub fn push_all<I>(&mut self, pages: I) -> Result<(), WriteError>
    where
        I: IntoIterator<Item = Result<PageInput, WriteError>>,
    {
        pages.into_iter().try_for_each(|page| self.push(&page?))
    }

    /// Writes structure records, section table and header, syncs and renames the file to its name.
    ///
    /// # Errors
    /// Pages are missing, or the file can't be written; the old target then stays.
    pub fn finish(mut self) -> Result<Written, WriteError> {
        if let Some(s) = self.structures.get(self.current) {
            let name = s.name().unwrap_or_default().to_string();
            return Err(WriteError::MissingPages { name, expected: s.page_count.get(), found: self.state.ordinal });
        }
        self.header.total_bytes = self.state.end.into();
        self.header.crc32 = header_crc(&self.header, self.sections.as_bytes()).into();
        check_table(&self.header, &self.sections)?;
        let at = self.sections[0].offset.get();
        for (i, s) in (0u32..).zip(&self.structures) {
            s.check(&self.header.file_id, i, at + u64::from(i) * StructureRecord::BYTES as u64)?;
        }
        self.target.write_at(at, self.structures.as_bytes())?;
        self.target.write_at(Header::BYTES as u64, self.sections.as_bytes())?;
        self.target.write_at(0, self.header.as_bytes())?;
        self.target.commit()?;
        Ok(Written { bytes: self.header.total_bytes.get(), pages: self.pages })
    }
}

/// Number of a structure; `prepare` keeps the count within u32.
fn number(index: usize) -> u32 {
    index as u32
}

fn header(options: &ContainerOptions, structures: usize, models: usize) -> Result<Header, WriteError> {
    if !ALIGNMENT_LOG2.contains(&options.alignment_log2) {
        return Err(WriteError::Alignment { found: options.alignment_log2 });
    }
    let mut h = Header::zeroed();
    h.magic = MAGIC;
    (h.version_major, h.version_minor) = (VERSION_MAJOR.into(), VERSION_MINOR.into());
    h.header_bytes = (Header::BYTES as u32).into();
    h.file_id = options.file_id;
    h.alignment_log2 = options.alignment_log2;
    h.section_count = (1 + 2 * number(structures) + number(models)).into();
    h.structure_count = number(structures).into();
    Ok(h)
}

/// Fills in defaults and checks what can be checked before the first page.
fn prepare(
    mut structures: Vec<StructureRecord>,
    options: &ContainerOptions,
) -> Result<Vec<StructureRecord>, WriteError> {
    // At most three sections each, counted in u32.
    if structures.is_empty() || structures.len() > (u32::MAX / 4) as usize {
        return Err(WriteError::StructureCount { found: structures.len() });
    }
    let mut names = std::collections::HashSet::new();
    for (i, s) in structures.iter_mut().enumerate() {
        if s.index_block_log2 == 0 && s.records_per_block.get() == 0 {
            s.index_block_log2 = 12;
            s.records_per_block = (((4096 - BlockHeader::BYTES) / PageRecord::BYTES) as u16).into();
        }
        let name = s.name().unwrap_or_default().to_string();
        s.root_page = PageRecord::zeroed();
        s.crc32 = s.computed_crc(&options.file_id, number(i)).into();
        s.check(&options.file_id, number(i), 0)?;
        if !names.insert(name.clone()) {
            return Err(WriteError::NameTwice { name });
        }
    }
    Ok(structures)
}
