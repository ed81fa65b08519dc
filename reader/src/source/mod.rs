//! Where bytes come from.
//!
//! - [`FileSource`]: positioned reads, the safe default;
//! - [`MemorySource`]: bytes that are in memory already;
//! - [`MapSource`]: a mapped file; `unsafe`, since others may change the file;
//! - `HttpSource`: a file on a web server (feature `remote`).

mod file;
mod map;
mod memory;
#[cfg(feature = "remote")]
mod remote;

use std::io;

pub use file::FileSource;
pub use map::MapSource;
pub use memory::MemorySource;
#[cfg(feature = "remote")]
pub use remote::{HttpSource, Patience};

/// Bytes of a container, read by offset from any thread.
pub trait Source: Send + Sync {
    /// Length in bytes; the same for the life of the source.
    fn len(&self) -> u64;

    /// Fills `out` with the bytes from `offset`.
    ///
    /// # Errors
    /// `UnexpectedEof` where the range is not inside the source; else the system's.
    fn read_at(&self, offset: u64, out: &mut [u8]) -> io::Result<()>;

    /// All bytes, where they can be borrowed; pages are then read in place, without a copy.
    fn bytes(&self) -> Option<&[u8]> {
        None
    }

    /// Whether a read costs a round trip, so that it pays to name several at once ([`prefetch`](Self::prefetch)).
    fn gathers(&self) -> bool {
        false
    }

    /// These ranges will be read soon. A source that [gathers](Self::gathers) brings those that lie together at once; what
    /// goes wrong is said when they are read. The list is the source's to change.
    fn prefetch(&self, _ranges: &mut Vec<std::ops::Range<u64>>) {}

    /// Name for messages: the path, or what stands for it.
    fn name(&self) -> &str {
        "(unnamed source)"
    }

    /// Whether there are no bytes.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// Copies from borrowed bytes.
fn copy_from(bytes: &[u8], offset: u64, out: &mut [u8]) -> io::Result<()> {
    let range = usize::try_from(offset).ok().and_then(|start| bytes.get(start..start.checked_add(out.len())?));
    out.copy_from_slice(range.ok_or(io::ErrorKind::UnexpectedEof)?);
    Ok(())
}
