//! Positioned reads of a file.

use std::fs::File;
use std::io;
use std::path::Path;
use std::sync::Arc;

use super::Source;
use crate::ReaderError;

/// A file that is read by offset, without a shared cursor. Its length is taken when it is opened; a file that shrinks
/// afterwards gives read errors.
#[derive(Debug)]
pub struct FileSource {
    file: File,
    len: u64,
    name: String,
}

impl FileSource {
    /// Opens a file.
    ///
    /// # Errors
    /// [`ReaderError::Io`] where it does not exist, is not readable, or is a folder.
    pub fn open(path: &Path) -> Result<Self, ReaderError> {
        let name = path.display().to_string();
        let fail = |action, e| ReaderError::io(&Arc::from(name.as_str()), action, e);
        let file = File::open(path).map_err(|e| fail("open", e))?;
        let meta = file.metadata().map_err(|e| fail("get the length", e))?;
        if meta.is_dir() {
            return Err(fail("open", io::ErrorKind::IsADirectory.into()));
        }
        Ok(Self { file, len: meta.len(), name })
    }
}

impl Source for FileSource {
    fn len(&self) -> u64 {
        self.len
    }

    #[cfg(unix)]
    fn read_at(&self, offset: u64, out: &mut [u8]) -> io::Result<()> {
        std::os::unix::fs::FileExt::read_exact_at(&self.file, out, offset)
    }

    #[cfg(windows)]
    fn read_at(&self, mut offset: u64, mut out: &mut [u8]) -> io::Result<()> {
        use std::os::windows::fs::FileExt;
        while !out.is_empty() {
            match self.file.seek_read(out, offset) {
                Ok(0) => return Err(io::ErrorKind::UnexpectedEof.into()),
                Ok(n) => {
                    out = out.get_mut(n..).unwrap_or_default();
                    offset += n as u64;
                }
                Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
                Err(e) => return Err(e),
            }
        }
        Ok(())
    }

    fn name(&self) -> &str {
        &self.name
    }
}
