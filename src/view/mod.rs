//! Pictures drawn on a device while pages come: what the viewer and recorded flights show.
//!
//! A [`Stage`] holds a snapped mesh and the structure that was baked from it, on one device and under one budget. Each
//! [`draw`](Stage::draw) is a frame of the streamer around two passes: which triangle each pixel sees, then one receiver and one
//! colour for each pixel ([`Style`]: filter, overlay). Nothing waits; [`still`](Stage::still) draws a frame again until all that it
//! asks for has come, and reads it back.
//!
//! The mesh lies on the device as integers of the light's lattice, so that receivers are as exact as f32 lets a ray be. Depth is
//! taken back by what rounding may be off, so that no surface throws a shadow on itself: about 2^-21 of the distance to the eye
//! and to the triangle's nearest corner, more on thin triangles. Surfaces that face away from the light ask for nothing.
//!
//! | Room | What is in it |
//! |---|---|
//! | `mesh`, `uniform` | what the device is told once, and in each frame |
//! | `passes`, `picture.wgsl` | pipelines and targets, and their shader |
//! | `still` | a frame that waits, as a picture in memory |
//! | `fly` | a camera that keys and mouse move |
//! | `window` | a window with a panel of controls (feature `viewer`) |

mod fly;
mod mesh;
mod passes;
mod still;
mod uniform;
#[cfg(feature = "viewer")]
pub mod window;

use umbrage_reader::Structure;
use umbrage_runtime::residency::foresee::Viewpoint;
use umbrage_runtime::{GpuStreamer, RuntimeError};
use umbrage_writer::solid::SnappedMesh;

pub use fly::{Fly, Keys};
pub use mesh::bounds;
pub use still::{Patience, Still};

use crate::render::{Camera, Look};
use mesh::MeshWords;
use passes::{Passes, Targets};
use uniform::Frame;

/// What is laid over a picture to see how it came about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Overlay {
    /// Green: exact. Blue: exact without a page that is not there, since the index was enough. Yellow to red: an ancestor answered,
    /// the redder the coarser. Violet: out of date.
    Residency,
    /// A colour for the level of each answer.
    Level,
    /// A colour for each page that is missing, black where none is.
    Missing,
    /// A colour for each page that answers.
    Pages,
    /// The texels that answer, as a chequerboard.
    Texels,
}

impl Overlay {
    /// All of them.
    pub const ALL: [Overlay; 5] =
        [Overlay::Residency, Overlay::Level, Overlay::Missing, Overlay::Pages, Overlay::Texels];

    /// Its name on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Overlay::Residency => "residency",
            Overlay::Level => "level",
            Overlay::Missing => "missing",
            Overlay::Pages => "pages",
            Overlay::Texels => "texels",
        }
    }

    /// The one of this name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|o| o.name() == name)
    }
}

/// How a frame looks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Style {
    /// How the map is looked up.
    pub look: Look,
    /// What is laid over the picture.
    pub overlay: Option<Overlay>,
}

/// Why nothing can be drawn.
#[derive(Debug, thiserror::Error)]
pub enum ViewError {
    /// The streamer or the device.
    #[error(transparent)]
    Runtime(#[from] RuntimeError),
    /// More triangles than the device binds in one buffer.
    #[error(
        "the mesh takes {needed} bytes on the device, which binds at most {most} in one buffer; give a smaller scene or a \
         device that binds more, or draw on the CPU (`umbrage render --backend cpu`)"
    )]
    Mesh {
        /// Bytes of the mesh.
        needed: u64,
        /// Bytes of the largest binding.
        most: u64,
    },
    /// More pixels than the device draws.
    #[error("a picture of {width} x {height} pixels: the device draws from 1 to {most} on a side")]
    Size {
        /// Pixels across.
        width: u32,
        /// Pixels down.
        height: u32,
        /// Pixels on a side of its largest texture.
        most: u32,
    },
    /// A lattice whose steps don't fit the device's integers; none that this project bakes.
    #[error(
        "the map has 2^{log2} texels a side of 2^{bits} lattice steps; a device takes at least 2^8 steps a texel and at most \
         2^32 in all; draw on the CPU (`umbrage render --backend cpu`)"
    )]
    Lattice {
        /// Binary logarithm of the texels on a side.
        log2: u8,
        /// Binary logarithm of the steps in a texel.
        bits: u8,
    },
    /// The camera is where none can be.
    #[error(transparent)]
    Camera(#[from] crate::render::CameraError),
    /// The display has no place for a window, or lost it.
    #[error("no window: {0}; draw without one by `umbrage render SCENE FILE --flight FLIGHT.json -o FOLDER`")]
    Window(String),
}

/// A scene on a device, and the pages that its frames asked for.
pub struct Stage {
    device: wgpu::Device,
    queue: wgpu::Queue,
    shadows: GpuStreamer,
    passes: Passes,
    targets: Targets,
    frame: Frame,
    format: wgpu::TextureFormat,
    triangles: u32,
    /// Number of the structure in the streamer.
    number: u32,
}

impl Stage {
    /// Puts a mesh and the structure that was baked from it on a device; pictures are of `format`, which is `Rgba8Unorm` or
    /// `Bgra8Unorm` (the shader encodes sRGB itself), and `size` pixels. The streamer
    /// holds at most `budget` bytes; the mesh and the targets come on top. Waits for the roots.
    ///
    /// # Errors
    /// The budget is too small, a root can't be read, the mesh or the picture is larger than the device takes.
    pub fn new(
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        structure: &Structure,
        mesh: &SnappedMesh,
        budget: u64,
        format: wgpu::TextureFormat,
        size: [u32; 2],
    ) -> Result<Self, ViewError> {
        let lattice = structure.lattice();
        let (log2, bits) = (lattice.log2_resolution, lattice.subtexel_bits);
        if bits < 8 || log2 + bits > 32 {
            return Err(ViewError::Lattice { log2, bits });
        }
        let limits = device.limits();
        let most = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size);
        let needed = mesh::bytes(mesh);
        if needed > most {
            return Err(ViewError::Mesh { needed, most });
        }
        let shadows = GpuStreamer::new(device, queue, structure, budget)?;
        let number = shadows.streamer().structures().next().map_or(0, |id| id.index());
        let words = MeshWords::new(mesh);
        let passes = Passes::new(device, &shadows, &words.words, format)?;
        let targets = Targets::new(device, &passes, size)?;
        let frame = Frame::new(lattice, words.triangles_at);
        let (device, queue) = (device.clone(), queue.clone());
        Ok(Self { device, queue, shadows, passes, targets, frame, format, triangles: words.triangles, number })
    }

    /// Other pictures from now on.
    ///
    /// # Errors
    /// Larger than the device draws.
    pub fn resize(&mut self, size: [u32; 2]) -> Result<(), ViewError> {
        if size != self.targets.size {
            self.targets = Targets::new(&self.device, &self.passes, size)?;
        }
        Ok(())
    }

    /// Pixels across and down.
    pub fn size(&self) -> [u32; 2] {
        self.targets.size
    }

    /// World length of the map's diagonal.
    pub fn extent(&self) -> f64 {
        self.frame.extent
    }

    /// The streamer.
    pub fn shadows(&self) -> &GpuStreamer {
        &self.shadows
    }

    /// The streamer: budget, skipping, looking ahead.
    pub fn shadows_mut(&mut self) -> &mut GpuStreamer {
        &mut self.shadows
    }

    /// One frame into `target`, a view of the format and size that the stage has: begins, records and ends the streamer's frame.
    /// The encoder must be submitted. Where the map can't say all yet ancestors answer; nothing waits.
    pub fn draw(
        &mut self,
        encoder: &mut wgpu::CommandEncoder,
        target: &wgpu::TextureView,
        camera: &Camera,
        style: &Style,
    ) {
        let size = self.targets.size;
        let half = camera.half(size[0], size[1]);
        self.shadows.begin(&[Viewpoint { eye: camera.eye(), axes: camera.axes(), half, pixels: size }]);
        let uniform = self.frame.uniform(camera, size, style, self.number);
        self.queue.write_buffer(&self.passes.uniform, 0, bytemuck::bytes_of(&uniform));
        self.shadows.record(encoder);
        self.passes.identify(encoder, &self.targets, self.triangles);
        self.passes.resolve(encoder, &self.targets, &self.shadows, target);
        self.shadows.end(encoder);
    }
}
