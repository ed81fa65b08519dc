//! What needs no paper: an array, compressed tiles, and the product's own kinds behind the same trait.

use std::cell::RefCell;
use std::sync::atomic::{AtomicU64, Ordering};

use rayon::prelude::*;
use umbrage::reader::query::Resident;

use super::image::Image;
use super::{Baseline, answers_by_value};

/// 4 bytes a texel, row by row: the middle of each interval.
pub struct Array {
    log2: u32,
    values: Vec<u32>,
}

impl Array {
    /// From the intervals.
    pub fn new(image: &Image) -> Array {
        let side = image.side();
        let values = (0..side * side).into_par_iter().map(|i| image.allowed(i % side, i / side).middle()).collect();
        Array { log2: image.log2, values }
    }

    fn value_of(&self, x: u32, y: u32) -> u32 {
        self.values[(y as usize) << self.log2 | x as usize]
    }
}

impl Baseline for Array {
    fn name(&self) -> String {
        "array u32".to_string()
    }

    fn citation(&self) -> &'static str {
        "row-major array of 32-bit depths"
    }

    fn bytes(&self) -> u64 {
        4 * self.values.len() as u64
    }

    answers_by_value!();
}

/// Side of a compressed tile.
const TILE: usize = 256;

/// Tiles of 256 x 256 first depths (the lower ends), each compressed alone with zstd, and 4 bytes a tile that say where
/// it begins. A lookup unpacks its tile, unless it is the one that the thread unpacked last.
pub struct Tiles {
    /// Tells apart what threads hold.
    id: u64,
    level: i32,
    tile_log2: u32,
    across_log2: u32,
    starts: Vec<u32>,
    data: Vec<u8>,
}

thread_local! {
    /// Map, tile and texels that were unpacked last.
    static LAST: RefCell<(u64, usize, Vec<u8>)> = const { RefCell::new((0, 0, Vec::new())) };
}

impl Tiles {
    /// Compresses the lower ends with zstd's `level`.
    ///
    /// # Errors
    /// Those of zstd; more than 4 GB.
    pub fn new(image: &Image, level: i32) -> std::io::Result<Tiles> {
        static NEXT: AtomicU64 = AtomicU64::new(1);
        let tile = image.side().min(TILE);
        let across = image.side() / tile;
        let compress = |i: usize| -> std::io::Result<Vec<u8>> {
            let [x0, y0] = [i % across * tile, i / across * tile];
            let mut raw = Vec::with_capacity(4 * tile * tile);
            for (y, x) in (y0..y0 + tile).flat_map(|y| (x0..x0 + tile).map(move |x| (y, x))) {
                raw.extend_from_slice(&image.truth(x, y).min.to_le_bytes());
            }
            zstd::bulk::compress(&raw, level)
        };
        let parts = (0..across * across).into_par_iter().map(compress).collect::<std::io::Result<Vec<_>>>()?;
        let mut starts = vec![0];
        let mut end = 0usize;
        for part in &parts {
            end += part.len();
            starts.push(u32::try_from(end).map_err(|_| std::io::Error::other("more than 4 GB of tiles"))?);
        }
        Ok(Tiles {
            id: NEXT.fetch_add(1, Ordering::Relaxed),
            level,
            tile_log2: tile.ilog2(),
            across_log2: across.ilog2(),
            starts,
            data: parts.concat(),
        })
    }

    fn value_of(&self, x: u32, y: u32) -> u32 {
        let tile = ((y >> self.tile_log2) << self.across_log2 | x >> self.tile_log2) as usize;
        let mask = (1 << self.tile_log2) - 1;
        let at = 4 * ((y & mask) << self.tile_log2 | x & mask) as usize;
        LAST.with_borrow_mut(|last| {
            if (last.0, last.1) != (self.id, tile) {
                last.2.resize(4 << (2 * self.tile_log2), 0);
                let [from, to] = [tile, tile + 1].map(|i| self.starts[i] as usize);
                let unpacked = zstd::bulk::decompress_to_buffer(&self.data[from..to], &mut last.2[..]);
                assert!(unpacked.is_ok_and(|n| n == last.2.len()), "tile {tile} was packed here");
                (last.0, last.1) = (self.id, tile);
            }
            u32::from_le_bytes([0, 1, 2, 3].map(|k| last.2[at + k]))
        })
    }
}

impl Baseline for Tiles {
    fn name(&self) -> String {
        format!("zstd tiles, level {}", self.level)
    }

    fn citation(&self) -> &'static str {
        "zstd (RFC 8878), raw tiles of 256 x 256 depths, each alone"
    }

    fn bytes(&self) -> u64 {
        (self.data.len() + 4 * self.starts.len()) as u64
    }

    fn is_slow(&self) -> bool {
        true
    }

    answers_by_value!();
}

/// A file of the product: bytes of the file, lookups in what is resident.
pub struct Product {
    name: &'static str,
    file_bytes: u64,
    resident: Resident,
}

impl Product {
    /// A file that is loaded.
    pub fn new(name: &'static str, file_bytes: u64, resident: Resident) -> Product {
        Product { name, file_bytes, resident }
    }

    fn value_of(&self, x: u32, y: u32) -> u32 {
        self.resident.value(x, y, 0)
    }
}

impl Baseline for Product {
    fn name(&self) -> String {
        self.name.to_string()
    }

    fn citation(&self) -> &'static str {
        match self.name {
            "vector" => "this project, kind vector, whole file",
            "mmh" => "Scandolo, Bauszat, Eisemann 2016 and Scandolo 2019, kind mmh, whole file",
            _ => "Scandolo, Bauszat, Eisemann, Multiresolution Hierarchies, 2016, kind mh, whole file",
        }
    }

    fn bytes(&self) -> u64 {
        self.file_bytes
    }

    answers_by_value!();
}

#[cfg(test)]
mod tests {
    use super::super::error::Errors;
    use super::super::tests::{city, made};
    use super::*;

    #[test]
    fn arrays_and_tiles_lose_nothing() {
        let (_, image) = city(512);
        let array = Array::new(&image);
        assert_eq!(array.bytes(), 4 * 512 * 512);
        assert_eq!(Errors::of(&array, &image, None).outside, 0);
        for level in [3, 19] {
            let tiles = Tiles::new(&image, level).expect("fits");
            assert_eq!(Errors::of(&tiles, &image, None).outside, 0);
            assert!(tiles.bytes() < array.bytes());
            // Two maps on one thread don't take each other's tile.
            let other = Tiles::new(&made(9, |x, y| [(x + y) as u32; 2]), level).expect("fits");
            assert_eq!((tiles.value_of(300, 300), other.value_of(300, 300)), (image.truth(300, 300).min, 600));
        }
    }
}
