//! The pool in as many buffers as the device binds it in.

use super::streamer::{filled, largest};
use crate::error::RuntimeError;
use crate::residency::budget::BLOCK_BYTES;
use crate::shader::MOST_POOLS;

/// Storage buffers of a stage that are not the pool's: table, feedback, and two that are left to the caller.
const OTHERS: u32 = 4;

/// How a pool is divided into buffers.
#[derive(Debug, Clone, Copy)]
pub struct Pieces {
    /// Buffers that are bound.
    pub count: u32,
    /// Bytes of each but the last; a power of two where they are several, so that the device finds a word's piece by a shift.
    bytes: u64,
}

impl Pieces {
    /// As many as a pool needs, and no more than the device binds.
    pub fn new(device: &wgpu::Device, pool_bytes: u64) -> Self {
        let most = device.limits().max_storage_buffers_per_shader_stage.saturating_sub(OTHERS).clamp(1, MOST_POOLS);
        Self::divide(pool_bytes, largest(device), most)
    }

    fn divide(pool_bytes: u64, largest: u64, most: u32) -> Self {
        // Pages lie in blocks, and no block in two buffers; a shift is at most 31.
        let bytes = 1u64 << largest.clamp(1, 1 << 33).ilog2();
        let count = pool_bytes.div_ceil(bytes).min(most.into()) as u32;
        // Two of half the largest hold no more than that one.
        if pool_bytes <= largest || bytes < BLOCK_BYTES || bytes * u64::from(count) <= largest {
            return Self { count: 1, bytes: largest };
        }
        Self { count, bytes }
    }

    /// Bytes of the largest pool that a device binds.
    pub fn largest_pool(device: &wgpu::Device) -> u64 {
        Self::new(device, u64::MAX).most()
    }

    /// Bytes that all hold together.
    pub fn most(&self) -> u64 {
        self.bytes * u64::from(self.count)
    }

    /// Binary logarithm of the words of a piece, where there are several.
    pub fn words_log2(&self) -> u32 {
        (self.bytes / 4).max(1).ilog2()
    }
}

/// The words of the pages.
#[derive(Debug)]
pub struct Pool {
    pieces: Vec<wgpu::Buffer>,
    piece_bytes: u64,
}

impl Pool {
    /// Makes the buffers of a pool, zero all over.
    ///
    /// # Errors
    /// It does not fit into the pieces.
    pub fn new(device: &wgpu::Device, bytes: u64, pieces: &Pieces) -> Result<Self, RuntimeError> {
        if bytes > pieces.most() {
            return Err(RuntimeError::Binding { what: "the pool", needed: bytes, most: pieces.most() });
        }
        let piece = |at: u64| {
            let size = (bytes - at).min(pieces.bytes);
            filled(device, "umbrage pool", size, wgpu::BufferUsages::STORAGE, &[])
        };
        let starts = (0..bytes.max(1)).step_by(pieces.bytes as usize);
        Ok(Self { pieces: starts.map(piece).collect::<Result<_, _>>()?, piece_bytes: pieces.bytes })
    }

    /// The buffers that there are.
    pub fn pieces(&self) -> &[wgpu::Buffer] {
        &self.pieces
    }

    /// What is bound as a piece: where the pool has become too small to have that one, the first, of which nothing is read
    /// there.
    pub fn bound(&self, piece: u32) -> &wgpu::Buffer {
        self.pieces.get(piece as usize).unwrap_or(&self.pieces[0])
    }

    /// Buffer and byte of a word.
    pub fn place(&self, word: u32) -> (&wgpu::Buffer, u64) {
        let byte = u64::from(word) * 4;
        (self.bound((byte / self.piece_bytes) as u32), byte % self.piece_bytes)
    }

    /// Copies what both have.
    pub fn copy_to(&self, other: &Pool, encoder: &mut wgpu::CommandEncoder) {
        for (from, to) in self.pieces.iter().zip(&other.pieces) {
            encoder.copy_buffer_to_buffer(from, 0, to, 0, from.size().min(to.size()));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pool_takes_as_many_buffers_as_it_needs() {
        const MIB: u64 = 1 << 20;
        let found = [
            // A pool that one buffer holds; the limit need not be a power of two.
            (100, 128, 4),
            (130, 200, 4),
            // Several; no more than there are, nor than fit beside what the caller binds.
            (200, 128, 4),
            (500, 128, 4),
            (900, 128, 4),
            (900, 128, 1),
            // Two of the next lower power of two are more than one of the limit, one is not.
            (250, 200, 2),
            (250, 200, 1),
        ];
        let found = found.map(|(pool, largest, most)| {
            let p = Pieces::divide(pool * MIB, largest * MIB, most);
            (p.count, p.most() / MIB)
        });
        assert_eq!(found, [(1, 128), (1, 200), (2, 256), (4, 512), (4, 512), (1, 128), (2, 256), (1, 200)]);
    }
}
