//! Rings of buffers between CPU and device. A buffer whose turn has not come is simply not there this frame.

use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};

/// Belongs to nobody (readback), or is mapped for writing (staging).
const FREE: u8 = 0;
/// The device has it.
const BUSY: u8 = 1;
/// Mapped for reading.
const MAPPED: u8 = 2;
/// Mapping failed: the device is lost.
const LOST: u8 = 3;

#[derive(Debug)]
struct Turn {
    buffer: wgpu::Buffer,
    state: Arc<AtomicU8>,
    /// Number of the use, so that readbacks are taken in order.
    number: u64,
}

impl Turn {
    fn is(&self, state: u8) -> bool {
        self.state.load(Ordering::Acquire) == state
    }

    /// Maps the buffer once the encoder's commands are done.
    fn map(&self, encoder: &wgpu::CommandEncoder, mode: wgpu::MapMode, then: u8) {
        let state = self.state.clone();
        state.store(BUSY, Ordering::Release);
        encoder.map_buffer_on_submit(&self.buffer, mode, .., move |result| {
            state.store(if result.is_ok() { then } else { LOST }, Ordering::Release);
        });
    }
}

/// Buffers that pages and table entries pass through.
#[derive(Debug)]
pub struct Staging(Vec<Turn>);

impl Staging {
    /// `count` buffers of `bytes` each.
    pub fn new(device: &wgpu::Device, count: u64, bytes: u64) -> Self {
        let turn = |_| Turn {
            buffer: device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("umbrage staging"),
                size: bytes,
                usage: wgpu::BufferUsages::MAP_WRITE | wgpu::BufferUsages::COPY_SRC,
                mapped_at_creation: true,
            }),
            state: Arc::new(AtomicU8::new(FREE)),
            number: 0,
        };
        Self((0..count).map(turn).collect())
    }

    /// Whether a buffer could not be mapped any more.
    pub fn is_lost(&self) -> bool {
        self.0.iter().any(|t| t.is(LOST))
    }

    /// Whether a buffer is free.
    pub fn is_free(&self) -> bool {
        self.0.iter().any(|t| t.is(FREE))
    }

    /// Writes the parts one behind the other into a free buffer and gives it to `copies`, with the offset of each
    /// part. `false` where none is free or the parts do not fit; nothing is recorded then.
    pub fn pass(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        parts: &[&[u8]],
        copies: impl FnOnce(&mut wgpu::CommandEncoder, &wgpu::Buffer, &[u64]),
    ) -> bool {
        let Some(turn) = self.0.iter().find(|t| t.is(FREE)) else { return false };
        let offsets: Vec<u64> = parts
            .iter()
            .scan(0u64, |end, p| {
                let start = *end;
                *end += p.len() as u64;
                Some(start)
            })
            .collect();
        {
            let Ok(mut view) = turn.buffer.get_mapped_range_mut(..) else { return false };
            let total: usize = parts.iter().map(|p| p.len()).sum();
            if total > view.len() {
                return false;
            }
            for (part, &offset) in parts.iter().zip(&offsets) {
                let start = offset as usize;
                view.slice(start..start + part.len()).copy_from_slice(part);
            }
        }
        turn.buffer.unmap();
        copies(encoder, &turn.buffer, &offsets);
        turn.map(encoder, wgpu::MapMode::Write, FREE);
        true
    }
}

/// Buffers that feedback comes back through.
#[derive(Debug)]
pub struct Readback {
    turns: Vec<Turn>,
    next: u64,
}

impl Readback {
    /// `count` buffers of `bytes` each.
    pub fn new(device: &wgpu::Device, count: u64, bytes: u64) -> Self {
        let turn = |_| Turn {
            buffer: device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("umbrage readback"),
                size: bytes,
                usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            }),
            state: Arc::new(AtomicU8::new(FREE)),
            number: 0,
        };
        Self { turns: (0..count).map(turn).collect(), next: 0 }
    }

    /// Whether a buffer could not be mapped any more.
    pub fn is_lost(&self) -> bool {
        self.turns.iter().any(|t| t.is(LOST))
    }

    /// Copies the start of `source`, to be read once the device is done; skipped where no buffer is free.
    pub fn record(&mut self, encoder: &mut wgpu::CommandEncoder, source: &wgpu::Buffer) {
        self.next += 1;
        let Some(turn) = self.turns.iter_mut().find(|t| t.is(FREE)) else { return };
        turn.number = self.next;
        encoder.copy_buffer_to_buffer(source, 0, &turn.buffer, 0, turn.buffer.size());
        turn.map(encoder, wgpu::MapMode::Read, MAPPED);
    }

    /// Hands the words of the oldest finished copy to `f`; `false` where none is finished.
    pub fn take(&mut self, f: impl FnOnce(&[u32])) -> bool {
        let Some(turn) = self.turns.iter().filter(|t| t.is(MAPPED)).min_by_key(|t| t.number) else { return false };
        {
            let Ok(view) = turn.buffer.get_mapped_range(..) else { return false };
            // Mapped ranges begin at multiples of 8 bytes, and WebGPU's hosts are little-endian.
            f(bytemuck::try_cast_slice(&view).unwrap_or_default());
        }
        turn.buffer.unmap();
        turn.state.store(FREE, Ordering::Release);
        true
    }
}
