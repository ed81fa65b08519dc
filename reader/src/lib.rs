//! Source -> checked pages -> views -> CPU queries.
//!
//! - [`source`]: where bytes come from: positioned reads (the default), memory, a mapped file;
//! - [`Container`]: opens a source, checks header, sections, structure records and the head of the index;
//! - [`Structure`]: one named structure; loads index blocks and pages and checks each on first touch;
//! - [`page`]: the steps of a page: [`PageBytes`] (CRC) -> [`FrameChecked`] -> [`CheckedPage`]; only the last can be
//!   queried;
//! - [`query`]: lookups; the walk of a kind is a pure function over pages;
//! - [`verify`]: checks a whole file and reports every fault;
//! - [`Limits`], [`ReaderError`]: what a caller allows, and what went wrong.
//!
//! Any bytes are safe to open and to query: nothing panics, loops or reads out of bounds.
#![deny(unsafe_code)]

pub mod container;
pub mod error;
pub mod limits;
pub mod page;
pub mod query;
pub mod source;
pub mod structure;
pub mod verify;

pub use container::{Container, Counters};
pub use error::ReaderError;
pub use limits::Limits;
pub use page::{CheckedPage, FrameChecked, PageBytes};
pub use source::{FileSource, MapSource, MemorySource, Source};
pub use structure::Structure;
pub use verify::VerifySummary;
