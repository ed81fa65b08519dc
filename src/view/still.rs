//! A frame that waits for its pages, as a picture in memory. For tools and tests; a game shows what it has.

use std::time::{Duration, Instant};

use umbrage_runtime::{Headless, RuntimeError};

use super::{Stage, Style, ViewError};
use crate::render::{Camera, RgbImage};

/// Format of a stage for pictures in memory.
const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;
/// Drawings in a row to which no page came, after which nothing more is waited for; longer than a page is parked.
const STUCK: u32 = 12;

/// How long a frame is drawn again.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Patience {
    /// Once, as a game would: what is there answers.
    None,
    /// Until no ancestor answers, or the budget can't hold more.
    Exact,
}

/// A picture, and what it took.
#[derive(Clone)]
pub struct Still {
    /// The picture.
    pub image: RgbImage,
    /// How often it was drawn.
    pub drawn: u32,
    /// Pixels of the last drawing that an ancestor answered.
    pub by_ancestors: u32,
    /// Levels by which the coarsest of these was above the level asked for.
    pub worst_levels: u32,
    /// From the first drawing to the last, without reading back.
    pub time: Duration,
}

/// Bytes of a row of pixels in a buffer.
fn row_bytes(width: u32) -> u32 {
    (width * 4).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT)
}

impl Stage {
    /// A stage for pictures in memory.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn headless(
        device: &Headless,
        structure: &umbrage_reader::Structure,
        mesh: &umbrage_writer::solid::SnappedMesh,
        budget: u64,
        size: [u32; 2],
    ) -> Result<Self, ViewError> {
        Self::new(&device.device, &device.queue, structure, mesh, budget, FORMAT, size)
    }

    /// Draws a frame and waits for the device; with [`Patience::Exact`] also for pages, and
    /// again until all is exact. `go_on` is asked between drawings: where it says no, the picture is that of the last one.
    ///
    /// # Errors
    /// The device was lost.
    pub fn still(
        &mut self,
        camera: &Camera,
        style: &Style,
        patience: Patience,
        go_on: &dyn Fn() -> bool,
    ) -> Result<Still, ViewError> {
        let [width, height] = self.size();
        let (needed, most) = (u64::from(row_bytes(width)) * u64::from(height), self.device.limits().max_buffer_size);
        if needed > most {
            return Err(RuntimeError::Binding { what: "the picture", needed, most }.into());
        }
        let target = self.device.create_texture(&wgpu::TextureDescriptor {
            label: Some("umbrage still"),
            size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: self.format,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC,
            view_formats: &[],
        });
        let view = target.create_view(&Default::default());
        let start = Instant::now();
        let (mut drawn, mut idle, mut admitted) = (0, 0, self.shadows.streamer().stats().admitted);
        loop {
            let mut encoder = self.device.create_command_encoder(&Default::default());
            self.draw(&mut encoder, &view, camera, style);
            self.queue.submit([encoder.finish()]);
            self.wait()?;
            drawn += 1;
            // The device is done: what it said of this very drawing is there.
            self.shadows.begin(&[]);
            if patience == Patience::None || self.shadows.report().approximate == 0 || !go_on() {
                break;
            }
            while self.shadows.streamer().is_loading() && go_on() {
                self.shadows.streamer_mut().wait(Duration::from_millis(50));
            }
            let now = self.shadows.streamer().stats().admitted;
            idle = if now == admitted { idle + 1 } else { 0 };
            admitted = now;
            if idle == STUCK {
                break;
            }
        }
        let time = start.elapsed();
        let report = self.shadows.report();
        let image = RgbImage { width, height, pixels: self.read(&target)? };
        Ok(Still { image, drawn, by_ancestors: report.approximate, worst_levels: report.worst_levels, time })
    }

    fn wait(&self) -> Result<(), ViewError> {
        let done = self.device.poll(wgpu::PollType::wait_indefinitely());
        done.map(drop).map_err(|e| RuntimeError::Device { reason: e.to_string() }.into())
    }

    fn read(&self, texture: &wgpu::Texture) -> Result<Vec<[u8; 3]>, ViewError> {
        let lost = |reason: String| ViewError::from(RuntimeError::Device { reason });
        let (width, height) = (texture.width(), texture.height());
        let row = row_bytes(width);
        let buffer = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("umbrage still"),
            size: u64::from(row) * u64::from(height),
            usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let mut encoder = self.device.create_command_encoder(&Default::default());
        encoder.copy_texture_to_buffer(
            texture.as_image_copy(),
            wgpu::TexelCopyBufferInfo {
                buffer: &buffer,
                layout: wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(row), rows_per_image: None },
            },
            texture.size(),
        );
        self.queue.submit([encoder.finish()]);
        let (send, receive) = std::sync::mpsc::channel();
        buffer.map_async(wgpu::MapMode::Read, .., move |result| {
            // The receiver lives until it has come.
            let _ = send.send(result);
        });
        self.wait()?;
        receive.recv().map_err(|e| lost(e.to_string()))?.map_err(|e| lost(e.to_string()))?;
        let bytes = buffer.get_mapped_range(..).map_err(|e| lost(e.to_string()))?;
        let rows = bytes.chunks_exact(row as usize).map(|r| &r[..width as usize * 4]);
        let order = if texture.format() == wgpu::TextureFormat::Bgra8Unorm { [2, 1, 0] } else { [0, 1, 2] };
        Ok(rows.flat_map(|r| r.chunks_exact(4).map(|p| order.map(|k| p[k]))).collect())
    }
}
