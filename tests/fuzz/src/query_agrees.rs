//! Accepted files on the device: whatever pages pass their checks, the kernel answers as the reader's walk over the same
//! pages does, to the bit, pages that fail being missing. The files are those of target `open`.

use std::sync::{Arc, OnceLock};
use std::time::Duration;

use umbrage_reader::Structure;
use umbrage_runtime::gpu::Kernels;
use umbrage_runtime::{GpuStreamer, Headless};

use crate::agree;
use crate::open::{container, steps};

/// Device memory for one structure.
const BUDGET: u64 = 4 << 20;
/// Pages of one structure that are brought in.
const PAGES: u32 = 64;

fn device() -> &'static Headless {
    static DEVICE: OnceLock<Headless> = OnceLock::new();
    DEVICE.get_or_init(|| Headless::new().unwrap_or_else(|e| panic!("{e}")))
}

fn streamer(structure: &Structure) -> Option<GpuStreamer> {
    static KERNELS: OnceLock<Arc<Kernels>> = OnceLock::new();
    let headless = device();
    let mut gpu = GpuStreamer::new(&headless.device, &headless.queue, structure, BUDGET).ok()?;
    match KERNELS.get() {
        Some(kernels) => gpu.use_kernels(kernels.clone()),
        None => {
            let _ = KERNELS.set(gpu.kernels().expect("kinds with a layout have kernels"));
        }
    }
    Some(gpu)
}

/// Whether a page or one that it depends on can't be read. Ordinals of dependencies rise, so this ends.
fn is_broken(structure: &Structure, ordinal: u32) -> bool {
    let dependencies = structure.dependencies(ordinal);
    structure.page(ordinal).is_err() || dependencies.map_or(true, |d| d.into_iter().any(|d| is_broken(structure, d)))
}

fn compare(structure: &Structure) {
    let Some(mut gpu) = streamer(structure) else {
        // A root, or a page that one depends on, that can't be read; nothing else may be wrong with a kind that has kernels
        // and fits the budget.
        let roots = structure.record().root_count.get();
        assert!((0..roots).any(|r| is_broken(structure, r)), "no streamer for a structure with sound roots");
        return;
    };
    let (log2, side) = (structure.record().log2_resolution, structure.lattice().resolution());
    for _ in 0..4 {
        (0..structure.page_count().min(PAGES)).for_each(|o| gpu.streamer_mut().request(o, 1));
        gpu.answer(0, &[[0, 0, 255, 0]]).expect("a frame");
        while gpu.streamer().is_loading() {
            gpu.streamer_mut().wait(Duration::from_millis(5));
        }
    }
    let queries: Vec<[u32; 4]> = (0..=log2.min(6))
        .chain([31, 255])
        .flat_map(|l| {
            steps(side).flat_map(move |y| steps(side).map(move |x| [x, y, l.into(), x.wrapping_mul(0x9E37_79B9)]))
        })
        .collect();
    let answered = agree::ask(&mut gpu, 0, &queries);
    agree::compare(&answered, structure, 0, &queries);
}

/// One input.
pub fn run(data: &[u8]) {
    let Some(file) = container(data) else { return };
    for s in file.structures().filter(|s| s.kind().has_layout()) {
        compare(&s);
    }
}
