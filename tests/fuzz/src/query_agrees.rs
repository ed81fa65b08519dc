//! Accepted files on the device: whatever pages pass their checks, the kernel answers as the reader's walk over the same
//! pages does, to the bit, pages that fail being missing. The files are those of target `open`.

use std::sync::{Arc, OnceLock};
use std::time::Duration;

use umbrage_format::Kind;
use umbrage_reader::query::{PageView, mh, vector};
use umbrage_reader::{CheckedPage, Structure};
use umbrage_runtime::gpu::Kernels;
use umbrage_runtime::query::pool::{ANCESTOR, EXACT, LEVEL_SHIFT, LIT, NONE, Pool, WORD_SHIFT};
use umbrage_runtime::{GpuStreamer, Headless};

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

fn compare(structure: &Structure) {
    let Some(mut gpu) = streamer(structure) else {
        // A root that can't be read; nothing else may be wrong with a kind that has kernels and fits the budget.
        let roots = structure.record().root_count.get();
        assert!((0..roots).any(|r| structure.page(r).is_err()), "no streamer for a structure with sound roots");
        return;
    };
    let (log2, side) = (structure.record().log2_resolution, structure.lattice().resolution());
    for _ in 0..4 {
        (0..structure.page_count().min(PAGES)).for_each(|o| gpu.streamer_mut().request(o));
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
    let answers = gpu.answer(0, &queries).expect("answers");
    let (words, table) = gpu.read_back().expect("bytes");
    let pool = Pool { words: &words, table: &table, kind: structure.kind(), log2_resolution: log2 };
    let pages: Vec<Option<CheckedPage>> = (0u32..)
        .zip(&table)
        .map(|(o, e)| (e[0] != NONE).then(|| structure.page(o).expect("it was uploaded")))
        .collect();
    let lookup = |o: u32| {
        let page = pages.get(o as usize)?.as_ref()?;
        Some(PageView { words: page.words(), first_child: page.record().first_child.get() })
    };
    for (query, answer) in queries.iter().zip(&answers) {
        assert_eq!(*answer, pool.answer(0, *query), "twin, query {query:?}");
        let [x, y, level, depth] = *query;
        if pool.outside(x, y) {
            continue;
        }
        let level = level.min(255) as u8;
        let d = match structure.kind() {
            Kind::Vector => vector::descend(lookup, 0, log2, x, y, level),
            _ => mh::descend(lookup, 0, log2, x, y, level),
        };
        let whole = if d.missing.is_none() { EXACT } else { ANCESTOR };
        let lit = if depth <= d.value { LIT } else { 0 };
        let state = u32::from(d.level) << LEVEL_SHIFT | d.word << WORD_SHIFT | lit | whole;
        assert_eq!(*answer, [d.value, state, d.missing.unwrap_or(NONE), d.page], "reader, query {query:?}");
    }
}

/// One input.
pub fn run(data: &[u8]) {
    let Some(file) = container(data) else { return };
    for s in file.structures().filter(|s| s.kind().has_layout()) {
        compare(&s);
    }
}
