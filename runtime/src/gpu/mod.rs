//! The executor for wgpu: the only folder that names it.
//!
//! - [`GpuStreamer`]: buffers, bindings and the three steps of a frame: `begin`, `record`, `end`;
//! - `pool`: the pool in as many buffers as the device binds it in;
//! - [`view`]: answers a whole view, frame after frame, until it is exact;
//! - [`kernel`]: the entry points that the runtime dispatches itself;
//! - [`transfer`]: staging and readback rings that never wait;
//! - [`headless`]: a device without a window.

pub mod headless;
pub mod kernel;
mod pool;
mod streamer;
pub mod transfer;
pub mod view;

pub use headless::Headless;
pub use kernel::Kernels;
pub use streamer::{GpuStreamer, Report};
pub use view::{Pixel, Receiver, ViewAnswer, ViewOptions, ViewStats};
