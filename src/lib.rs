//! Umbrage: precomputed light in a container, and the way back out.
//!
//! The crates under their own names: [`mod@format`] (bytes), [`writer`] (bakes), [`reader`] (opens, checks, answers),
//! `runtime` (streams to the GPU; feature `gpu`). Here:
//! [`render`] (pictures on the CPU), `view` (pictures on a device while pages come; feature `gpu`) and [`certify`] (the exact
//! oracle that shares no code with the baker's rasteriser).
#![forbid(unsafe_code)]

pub mod certify;
pub mod render;
#[cfg(feature = "gpu")]
pub mod view;

pub use umbrage_format as format;
pub use umbrage_reader as reader;
#[cfg(feature = "gpu")]
pub use umbrage_runtime as runtime;
pub use umbrage_writer as writer;
