//! CPU twins of the shaders, over the same words: pool and page table as the device has them. Used by tests and by
//! callers that want the device's very answer; for plain lookups see `umbrage_reader::query`.
//!
//! - [`pool`]: the buffers, pages in them, what an answer is; the walk for the structure's kind;
//! - [`mh`], [`mmh`], [`vector`]: the walk of each kind;
//! - [`filter`]: percentage-closer filtering over all of them.

pub mod filter;
pub mod mh;
pub mod mmh;
pub mod pool;
pub mod vector;

pub use pool::{Answer, Pool};
