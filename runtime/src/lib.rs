//! Streams Umbrage structures to the GPU: pages in, light or shadow out.
//!
//! One page walks through the rooms like this:
//!
//! - [`stream`]: loader threads read and check it, off the render thread;
//! - [`residency`]: decides whether and where it lives, within a hard budget; knows no GPU and no thread;
//! - `gpu`: the one folder that names wgpu (feature `wgpu`): copies it into the pool, dispatches queries, reads the feedback back;
//! - [`shader`]: the WGSL that walks it, a module without entry points whose constants are made from the format's;
//! - [`query`]: the CPU twin of that module over the same words;
//! - [`lattice`]: from a point of the world, in f32 relative to the camera, to integers of the lattice.
//!
//! A page that is missing, late or broken is answered by its nearest resident ancestor, and the answer says so.
#![forbid(unsafe_code)]

pub mod error;
#[cfg(feature = "wgpu")]
pub mod gpu;
pub mod lattice;
pub mod query;
pub mod residency;
pub mod shader;
pub mod stream;

pub use error::RuntimeError;
#[cfg(feature = "wgpu")]
pub use gpu::{GpuStreamer, Headless, Receiver, ViewAnswer, ViewOptions};
