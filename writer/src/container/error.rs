//! What can go wrong while a container is written.

use std::io;
use std::path::{Path, PathBuf};

use umbrage_format::FormatError;

/// Why no file was written. The old target, where there was one, is as it was.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum WriteError {
    /// The target is a folder.
    #[error("{}: is a directory; name a file in it", .0.display())]
    IsDirectory(PathBuf),
    /// The target is a device, a pipe or has no name.
    #[error("{}: is not a regular file; name a file that may be replaced", .0.display())]
    NotAFile(PathBuf),
    /// The folder of the target does not exist.
    #[error("{}: the directory does not exist; create it first", .0.display())]
    NoDirectory(PathBuf),
    /// The folder of the target or the file system does not let us write.
    #[error("{}: not writable ({source}); check the permissions of its directory", path.display())]
    NotWritable {
        /// The target.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The disk or the quota is used up.
    #[error("{}: no space left after {written} bytes ({source}); free some, or name a target on another disk", path.display())]
    NoSpace {
        /// The target.
        path: PathBuf,
        /// Bytes of the file so far.
        written: u64,
        /// What the system said.
        source: io::Error,
    },
    /// Another failure of the system.
    #[error("{}: could not {action}: {source}", path.display())]
    Io {
        /// The target.
        path: PathBuf,
        /// What was tried.
        action: &'static str,
        /// What the system said.
        source: io::Error,
    },
    /// What was handed in breaks a rule of the format.
    #[error("refused to write what no reader accepts: {0}")]
    Rejected(#[from] FormatError),
    /// A file without structures, or with too many.
    #[error("a file has 1 to 2^30 structures, not {found}")]
    StructureCount {
        /// Structures handed in.
        found: usize,
    },
    /// Two structures of one name.
    #[error("two structures are named '{name}'; give each a name of its own")]
    NameTwice {
        /// The name.
        name: String,
    },
    /// The alignment exponent is out of its range.
    #[error("the alignment exponent is 2 to 16, not {found}")]
    Alignment {
        /// The exponent.
        found: u8,
    },
    /// A page has no frame or is too long.
    #[error("page {ordinal} of structure {structure} has {words} words; a page has 2 to {most}")]
    PageLength {
        /// Number of the structure.
        structure: u32,
        /// Ordinal of the page.
        ordinal: u32,
        /// Its words.
        words: usize,
        /// Most words.
        most: u16,
    },
    /// The dependencies of a page do not fit its index block.
    #[error(
        "page {ordinal} of structure {structure} has {count} dependencies, but its index block has room for {room}; \
         put fewer records into a block, or make the blocks larger"
    )]
    Dependencies {
        /// Number of the structure.
        structure: u32,
        /// Ordinal of the page.
        ordinal: u32,
        /// Its dependencies.
        count: usize,
        /// How many would fit.
        room: usize,
    },
    /// `finish` came before the last page.
    #[error("structure '{name}' has {found} of {expected} pages")]
    MissingPages {
        /// Name of the first unfinished structure.
        name: String,
        /// Pages announced.
        expected: u32,
        /// Pages pushed.
        found: u32,
    },
    /// More pages than announced.
    #[error("all {pages} announced pages are written already")]
    TooManyPages {
        /// Pages of all structures.
        pages: u64,
    },
}

impl WriteError {
    /// Sorts a failure of the system by its cause.
    pub(crate) fn io(path: &Path, action: &'static str, written: u64, source: io::Error) -> Self {
        use io::ErrorKind as K;
        let path = path.to_path_buf();
        match source.kind() {
            K::StorageFull | K::QuotaExceeded | K::FileTooLarge => Self::NoSpace { path, written, source },
            K::PermissionDenied | K::ReadOnlyFilesystem => Self::NotWritable { path, source },
            _ => Self::Io { path, action, source },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_full_disk_is_called_by_its_name() {
        let error = |kind: io::ErrorKind| WriteError::io(Path::new("map.umb"), "write", 4096, kind.into());
        assert!(error(io::ErrorKind::StorageFull).to_string().starts_with("map.umb: no space left after 4096 bytes"));
        assert!(error(io::ErrorKind::ReadOnlyFilesystem).to_string().contains("not writable"));
        assert!(error(io::ErrorKind::TimedOut).to_string().starts_with("map.umb: could not write"));
    }
}
