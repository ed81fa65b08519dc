//! The temporary file beside the target: a kill at any moment leaves the old target or the new one.

use std::collections::hash_map::RandomState;
use std::fs::{self, File, OpenOptions};
use std::hash::BuildHasher;
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use super::WriteError;

/// Gaps of at least a page of the usual file systems are not written.
const HOLE: u64 = 4096;

/// More links one behind the other are a ring, or as good as one.
const MOST_LINKS: u32 = 40;

/// A file that takes its name only when it is whole; dropped before [`commit`](Self::commit), it is removed.
#[derive(Debug)]
pub struct Target {
    /// `None` once it is closed.
    file: Option<BufWriter<File>>,
    /// Where it is now.
    temporary: PathBuf,
    /// Where it shall be.
    target: PathBuf,
    /// Bytes appended.
    end: u64,
}

impl Target {
    /// Creates the temporary file in the folder of `target`. A link is followed, so that it stays a link, also where
    /// nothing is behind it yet.
    ///
    /// # Errors
    /// The target is a folder or a device, or its folder can't be written.
    pub fn create(target: &Path) -> Result<Self, WriteError> {
        let target = resolved(target)?;
        let (file, temporary) = hidden(&target)?;
        Ok(Self { file: Some(BufWriter::with_capacity(1 << 18, file)), temporary, target, end: 0 })
    }

    /// A file for reading and writing in the folder of `target` that nobody else finds and that goes when it is closed.
    ///
    /// # Errors
    /// As [`create`](Self::create).
    pub fn nameless(target: &Path) -> Result<File, WriteError> {
        let target = resolved(target)?;
        tempfile::tempfile_in(directory(&target))
            .map_err(|e| WriteError::io(&target, "create a temporary file beside it", 0, e))
    }

    /// Where the temporary file lies.
    pub fn temporary(&self) -> &Path {
        &self.temporary
    }

    fn run(
        &mut self,
        action: &'static str,
        f: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>,
    ) -> Result<(), WriteError> {
        let result = match &mut self.file {
            Some(file) => f(file),
            None => Err(io::Error::other("the file is closed")),
        };
        result.map_err(|e| WriteError::io(&self.target, action, self.end, e))
    }

    /// Appends bytes.
    ///
    /// # Errors
    /// The system's.
    pub fn append(&mut self, bytes: &[u8]) -> Result<(), WriteError> {
        self.run("write", |f| f.write_all(bytes))?;
        self.end += bytes.len() as u64;
        Ok(())
    }

    /// Appends zero bytes up to `offset`; something must be appended behind them. Long gaps are left as holes, which
    /// read as zero and take no room where the file system can do it.
    ///
    /// # Errors
    /// The system's.
    pub fn pad_to(&mut self, offset: u64) -> Result<(), WriteError> {
        let gap = offset.saturating_sub(self.end);
        self.run("write", |f| match gap {
            0 => Ok(()),
            1..HOLE => io::copy(&mut io::Read::take(io::repeat(0), gap), f).map(drop),
            _ => f.seek(SeekFrom::Start(offset)).map(drop),
        })?;
        self.end += gap;
        Ok(())
    }

    /// Overwrites bytes that have been appended before; appending goes on at the end.
    ///
    /// # Errors
    /// The system's.
    pub fn write_at(&mut self, offset: u64, bytes: &[u8]) -> Result<(), WriteError> {
        let end = self.end;
        self.run("write", |f| {
            f.seek(SeekFrom::Start(offset))?;
            f.write_all(bytes)?;
            f.seek(SeekFrom::Start(end)).map(drop)
        })
    }

    /// Syncs, renames to the target, and syncs the folder, so that the name too survives a power cut.
    ///
    /// # Errors
    /// The system's. Before the rename the old target stays.
    pub fn commit(&mut self) -> Result<(), WriteError> {
        self.run("write", |f| f.flush())?;
        self.run("sync", |f| f.get_ref().sync_all())?;
        self.file = None;
        fs::rename(&self.temporary, &self.target)
            .map_err(|e| WriteError::io(&self.target, "rename the finished file to its name", self.end, e))?;
        self.temporary.clear();
        sync_directory(directory(&self.target))
            .map_err(|e| WriteError::io(&self.target, "sync its directory", self.end, e))
    }
}

impl Drop for Target {
    fn drop(&mut self) {
        // Unwritten bytes of a file that is thrown away need no flush.
        if let Some(file) = self.file.take() {
            drop(file.into_parts());
        }
        if !self.temporary.as_os_str().is_empty() {
            let _ = fs::remove_file(&self.temporary);
        }
    }
}

/// The target with links followed, if a file can be put there.
fn resolved(target: &Path) -> Result<PathBuf, WriteError> {
    let mut end = target.to_path_buf();
    let mut links = 0;
    while let Ok(to) = fs::read_link(&end) {
        links += 1;
        if links > MOST_LINKS {
            let e = io::Error::other("too many links, one to another");
            return Err(WriteError::io(target, "follow the link to its end", 0, e));
        }
        end = directory(&end).join(to);
    }
    let target = fs::canonicalize(&end).unwrap_or(end);
    match fs::metadata(&target) {
        Ok(m) if m.is_dir() => return Err(WriteError::IsDirectory(target)),
        Ok(m) if !m.is_file() => return Err(WriteError::NotAFile(target)),
        _ => {}
    }
    if target.file_name().is_none() {
        return Err(WriteError::NotAFile(target));
    }
    if !directory(&target).is_dir() {
        return Err(WriteError::NoDirectory(directory(&target).to_path_buf()));
    }
    Ok(target)
}

/// A new file beside the target.
fn hidden(target: &Path) -> Result<(File, PathBuf), WriteError> {
    let random = RandomState::new();
    let mut attempt = 0u32;
    loop {
        // Keyed by the system's random source: nobody can lay a link in our way. Not part of the bytes.
        let mut name = std::ffi::OsString::from(".");
        name.push(target.file_name().unwrap_or_default());
        name.push(format!(".{:016x}.tmp", random.hash_one((std::process::id(), attempt))));
        let temporary = directory(target).join(name);
        match OpenOptions::new().write(true).create_new(true).open(&temporary) {
            Ok(file) => return Ok((file, temporary)),
            Err(e) if e.kind() == io::ErrorKind::AlreadyExists && attempt < 16 => attempt += 1,
            Err(e) => return Err(WriteError::io(target, "create a temporary file beside it", 0, e)),
        }
    }
}

/// The folder of a file; "." where the path is a bare name.
fn directory(path: &Path) -> &Path {
    path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

#[cfg(unix)]
fn sync_directory(path: &Path) -> io::Result<()> {
    File::open(path)?.sync_all()
}

#[cfg(not(unix))]
fn sync_directory(_: &Path) -> io::Result<()> {
    Ok(())
}
