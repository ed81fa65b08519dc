//! Bytes of the Umbrage container and their meaning.
//!
//! A file is read from the front, and the rooms are met in this order:
//!
//! - [`header`]: the first 128 bytes; who the file is and whether this version can read it;
//! - [`section`]: the table of sections behind it;
//! - [`structure`]: one record for each named structure: its kind, place in the world, counts and root page;
//! - [`index`]: the records of a structure's pages in checksummed blocks;
//! - [`page`]: the frame that all pages share, an array of 32-bit words;
//! - [`kind`]: what the words of a page mean, one room for each kind of structure;
//! - [`cold`]: pages in a shorter form, decoded when they are loaded;
//! - [`checksum`], [`error`], [`record`]: the CRCs, the rules and their errors, the tables of fields;
//! - [`projection`]: how a point of the world becomes a point of the light-space lattice.
//!
//! Nothing here reads files; bytes come in, checked views and errors go out. [`kind::vector`] allocates for the
//! squares of a page's groups while it is checked, and where it lays out pages; [`cold`] for tables and decoded pages.
#![cfg_attr(not(any(test, feature = "std")), no_std)]
#![forbid(unsafe_code)]

extern crate alloc;

pub mod checksum;
pub mod cold;
pub mod error;
pub mod header;
pub mod index;
pub mod kind;
pub mod page;
pub mod projection;
pub mod record;
pub mod section;
pub mod structure;

/// Little-endian numbers as they stand in records, without alignment.
pub mod le {
    pub use zerocopy::little_endian::{F64, U16, U32, U64};
}

pub use checksum::FileId;
pub use error::{FormatError, Place, Rule, Value};
pub use header::Header;
pub use index::{BlockHeader, PageRecord};
pub use kind::Kind;
pub use section::SectionRecord;
pub use structure::StructureRecord;
