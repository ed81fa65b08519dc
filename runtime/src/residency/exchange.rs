//! What goes into the state machine and comes out of it.

use std::sync::Arc;

use umbrage_reader::query::Bounds;

use super::heirs::Content;
use super::slots::BLOCK_WORDS;
use crate::query::pool::NOT_RESIDENT;

/// What the state machine must know of its budget.
#[derive(Debug, Clone, Copy)]
pub struct Config {
    /// Entries of the page table.
    pub table: u32,
    /// Blocks of the pool.
    pub blocks: u32,
    /// Bytes of pages that a frame can upload, at least one block.
    pub frame_bytes: u64,
    /// Bytes of pages in host memory, those being loaded counted as the largest page.
    pub host_bytes: u64,
}

/// What the index says of a page before it is read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Child {
    /// Of its answers.
    pub bounds: Bounds,
    /// Its words in the pool, a list of dependencies behind them included.
    pub words: u32,
    /// Hash of its content; none of a page that depends on others.
    pub hash: Option<u64>,
}

impl Child {
    /// Of a page whose record can't be read.
    pub fn unknown() -> Self {
        Self { bounds: Bounds::UNKNOWN, words: BLOCK_WORDS, hash: None }
    }

    /// What tells it from pages of other content.
    pub fn content(&self) -> Option<Content> {
        self.hash.map(|h| (h, self.words))
    }
}

/// A page that has been read and checked. Its ordinal and those in it are places in the page table.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LoadedPage {
    /// Its place in the table.
    pub ordinal: u32,
    /// Place of its first child.
    pub first_child: u32,
    /// Its children.
    pub child_count: u16,
    /// What the index says of each of them, in order; empty where the index can't be read.
    pub children: Arc<[Child]>,
    /// Shared pages it needs.
    pub dependencies: Vec<u32>,
    /// Hash of its content; none of a page that depends on others.
    pub hash: Option<u64>,
    /// Its words, frame included, in host order; in kind `mmh` the dependencies behind them, as places in the table. None of a
    /// page whose words the pool still has ([`Residency::is_kept`](super::Residency::is_kept)).
    pub words: Arc<[u32]>,
}

/// One step on the pool's words, to be carried out in order.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Op {
    /// Write a page.
    Upload {
        /// First word.
        at: u32,
        /// The page's words.
        words: Arc<[u32]>,
    },
    /// Copy a page to another place; the places do not overlap.
    Move {
        /// First word now.
        from: u32,
        /// First word after.
        to: u32,
        /// Words of the page.
        words: u32,
    },
}

/// An entry of the page table: of a resident page its first word in the pool and its first child; of another
/// [`NOT_RESIDENT`], its stop error, and the smallest and the largest depth that lookups in it can answer.
pub type Entry = [u32; 4];

/// The entry of a page of which nothing is known.
pub const ABSENT: Entry = [NOT_RESIDENT, u32::MAX, 0, u32::MAX];

/// What to do before the queries of a frame.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Frame {
    /// Copies, in order.
    pub ops: Vec<Op>,
    /// Page table: ordinal and its entry, ordinals rising.
    pub table: Vec<(u32, Entry)>,
}

/// Totals since the start, and the state after the last frame.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Stats {
    /// Pages that live in the pool.
    pub resident: u32,
    /// Their words.
    pub resident_words: u64,
    /// Pages that are wanted and not in the pool: asked for, being loaded, parked.
    pub wanted: u32,
    /// Of those, the ones that found no room: the starvation signal.
    pub starved: u32,
    /// Pages whose last try to load failed.
    pub failing: u32,
    /// Pages admitted.
    pub admitted: u64,
    /// Pages evicted.
    pub evicted: u64,
    /// Pages of a replaced version that went on where they were.
    pub kept: u64,
    /// Pages moved within the pool.
    pub moved: u64,
    /// Bytes of pages uploaded.
    pub uploaded_bytes: u64,
    /// Pages that nobody waited for any more before they were read.
    pub cancelled: u64,
}
