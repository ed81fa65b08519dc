//! A mapped file. The only room of this crate with `unsafe` in it.
#![allow(unsafe_code)]

use std::fs::File;
use std::io;
use std::path::Path;
use std::sync::Arc;

use memmap2::Mmap;

use super::{Source, copy_from};
use crate::ReaderError;

/// A file in the address space of the process: pages are read in place.
#[derive(Debug)]
pub struct MapSource {
    map: Mmap,
    name: String,
}

impl MapSource {
    /// Maps a file.
    ///
    /// # Safety
    /// While the source lives, nobody may change or truncate the file, in this process or another: changed bytes are
    /// undefined behaviour, a truncated file kills the process at the next touch. Where that can't be promised, take
    /// [`super::FileSource`]. (The writer of this project never changes a file in place; it renames a new one over it.)
    ///
    /// # Errors
    /// [`ReaderError::Io`] where the file does not open or map.
    pub unsafe fn map(path: &Path) -> Result<Self, ReaderError> {
        let name = path.display().to_string();
        let fail = |action, e| ReaderError::io(&Arc::from(name.as_str()), action, e);
        let file = File::open(path).map_err(|e| fail("open", e))?;
        // SAFETY: `Mmap::map` asks that the file is not changed while the map lives; our caller promises that. The map
        // is private to this struct and lent out only as `&[u8]` bound to its life.
        let map = unsafe { Mmap::map(&file) }.map_err(|e| fail("map", e))?;
        Ok(Self { map, name })
    }
}

impl Source for MapSource {
    fn len(&self) -> u64 {
        self.map.len() as u64
    }

    fn read_at(&self, offset: u64, out: &mut [u8]) -> io::Result<()> {
        copy_from(&self.map, offset, out)
    }

    fn bytes(&self) -> Option<&[u8]> {
        Some(&self.map)
    }

    fn name(&self) -> &str {
        &self.name
    }
}
