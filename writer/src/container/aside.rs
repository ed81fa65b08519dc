//! Pages of a cold structure on their way: put aside as they come, since the model is known behind the last one.
//!
//! They lie in a file without a name beside the target; in memory is one of them, and what [`Tally`] counts.

use std::fs::File;
use std::io::{self, BufReader, BufWriter, Read, Seek, Write};
use std::path::{Path, PathBuf};

use umbrage_format::PageRecord;
use zerocopy::{FromBytes, IntoBytes};

use super::{Target, WriteError};
use crate::cold::{Tables, Tally};

/// Bytes read or written at once.
const BUFFER: usize = 1 << 18;

/// The pages so far.
#[derive(Debug)]
pub(super) struct Aside {
    file: BufWriter<File>,
    target: PathBuf,
    tally: Tally,
    pages: u32,
}

/// A page as it was put aside.
pub(super) struct Waiting {
    pub(super) record: PageRecord,
    pub(super) words: Vec<u32>,
    pub(super) dependencies: Vec<u32>,
}

impl Aside {
    pub(super) fn new(target: &Path, tally: Tally) -> Result<Self, WriteError> {
        let file = BufWriter::with_capacity(BUFFER, Target::nameless(target)?);
        Ok(Self { file, target: target.to_path_buf(), tally, pages: 0 })
    }

    /// Puts the next page aside; its record has its length and the number of its dependencies.
    pub(super) fn push(&mut self, record: &PageRecord, words: &[u32], dependencies: &[u32]) -> Result<(), WriteError> {
        self.tally.note(words);
        self.pages += 1;
        let numbers = words.iter().chain(dependencies).flat_map(|w| w.to_le_bytes()).collect::<Vec<u8>>();
        let count = (dependencies.len() as u32).to_le_bytes();
        let all = [record.as_bytes(), &count, &numbers];
        all.iter().try_for_each(|bytes| self.file.write_all(bytes)).map_err(|e| self.failed(e))
    }

    fn failed(&self, e: io::Error) -> WriteError {
        WriteError::io(&self.target, "put pages aside in a temporary file beside it", 0, e)
    }

    /// What the pages are encoded with, and the pages from the first on.
    pub(super) fn finish(mut self) -> Result<(Tables, Back), WriteError> {
        self.file.flush().map_err(|e| self.failed(e))?;
        let Self { file, target, tally, pages } = self;
        let failed = |e| WriteError::io(&target, "read pages back from a temporary file beside it", 0, e);
        let file = file.into_inner().map_err(|e| failed(e.into_error()))?;
        let mut back = Back { file: BufReader::with_capacity(BUFFER, file), target: target.clone(), pages, left: 0 };
        let mut tables = tally.tables();
        back.rewind()?;
        while let Some(page) = back.next()? {
            tables.count(&page.words);
        }
        back.rewind()?;
        Ok((tables.finish(), back))
    }
}

/// Pages that come back in their order.
pub(super) struct Back {
    file: BufReader<File>,
    target: PathBuf,
    pages: u32,
    left: u32,
}

impl Back {
    fn rewind(&mut self) -> Result<(), WriteError> {
        self.left = self.pages;
        self.file.rewind().map_err(|e| self.failed(e))
    }

    fn failed(&self, e: io::Error) -> WriteError {
        WriteError::io(&self.target, "read pages back from a temporary file beside it", 0, e)
    }

    pub(super) fn next(&mut self) -> Result<Option<Waiting>, WriteError> {
        let Some(left) = self.left.checked_sub(1) else { return Ok(None) };
        self.left = left;
        self.read().map(Some).map_err(|e| self.failed(e))
    }

    fn read(&mut self) -> io::Result<Waiting> {
        let mut head = [0; PageRecord::BYTES + 4];
        self.file.read_exact(&mut head)?;
        let (record, count) = PageRecord::read_from_prefix(&head).map_err(|_| io::ErrorKind::InvalidData)?;
        let count = u32::read_from_bytes(count).map_err(|_| io::ErrorKind::InvalidData)?;
        let length = usize::from(record.hot_words.get());
        let mut bytes = vec![0; 4 * (length + u32::from_le(count) as usize)];
        self.file.read_exact(&mut bytes)?;
        let mut words: Vec<u32> = bytes.chunks_exact(4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect();
        let dependencies = words.split_off(length);
        Ok(Waiting { record, words, dependencies })
    }
}
