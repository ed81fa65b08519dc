//! What can go wrong in the runtime.

use umbrage_format::Kind;
use umbrage_reader::ReaderError;

use crate::residency::{BudgetError, TableFull};

/// Why a streamer could not be made or a view not be answered.
#[derive(Debug, Clone, thiserror::Error)]
#[non_exhaustive]
pub enum RuntimeError {
    /// A page or the index could not be read.
    #[error(transparent)]
    Reader(#[from] ReaderError),
    /// The budget is too small for the structure.
    #[error(transparent)]
    Budget(#[from] BudgetError),
    /// The page table has no room for a structure.
    #[error(transparent)]
    Table(#[from] TableFull),
    /// The pool, as large as the device binds it, is too small for the structures.
    #[error(
        "the structures need {needed} blocks of 64 KiB, and the pool has {blocks}, which is what the device binds; detach one, or \
         use a second streamer"
    )]
    Pool {
        /// Blocks that would do.
        needed: u32,
        /// Blocks of the pool.
        blocks: u32,
    },
    /// More structures than the device is told of.
    #[error("{most} structures are attached, which is the most; detach one")]
    Structures {
        /// That number.
        most: u32,
    },
    /// The structure that was named has been detached.
    #[error("the structure has been detached")]
    Gone,
    /// Other structures have all rectangles for stale regions.
    #[error("all {most} stale regions are in other structures; clear some, or swap in new versions of those")]
    Stale {
        /// That number.
        most: u32,
    },
    /// The roots wait for pages that never fit, or that wait for each other.
    #[error("the roots need pages that do not fit {budget} bytes or need each other ({resident} pages came in)")]
    Roots {
        /// Pages that did come in.
        resident: u32,
        /// Bytes that were given.
        budget: u64,
    },
    /// No Vulkan adapter.
    #[error(
        "no Vulkan adapter was found ({reason}); install a driver, or the software one: \
         apt-get install -y --no-install-recommends mesa-vulkan-drivers libvulkan1"
    )]
    NoAdapter {
        /// What the loader said.
        reason: String,
    },
    /// The adapter gave no device.
    #[error("adapter '{adapter}' gave no device: {reason}")]
    NoDevice {
        /// Name of the adapter.
        adapter: String,
        /// What it said.
        reason: String,
    },
    /// A buffer is larger than the device binds.
    #[error("{what} needs {needed} bytes and the device binds at most {most}; ask it for larger limits")]
    Binding {
        /// Which buffer.
        what: &'static str,
        /// Its bytes.
        needed: u64,
        /// `max_storage_buffer_binding_size` or `max_buffer_size`; for the pool as often as it may be bound, which
        /// `max_storage_buffers_per_shader_stage` says.
        most: u64,
    },
    /// The device was lost, or an operation on it failed.
    #[error("device: {reason}")]
    Device {
        /// What it said.
        reason: String,
    },
    /// Queries of this kind have no kernel.
    #[error("kind {} has no kernel in this version; its pages can be streamed", .0.name())]
    UnsupportedKind(Kind),
}
