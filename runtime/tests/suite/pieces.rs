//! A pool that is larger than the device binds in one buffer lies in several, and nothing else changes.

use umbrage_format::Kind;
use umbrage_reader::Structure;
use umbrage_runtime::query::pool::NONE;
use umbrage_runtime::{GpuStreamer, Headless, RuntimeError};

use crate::agree;
use crate::parity::fill;
use crate::support::{city_as, opened, queries, random_merged, random_tree, random_vector};
use crate::tree::{Dice, Folder};

/// Two blocks: the least that holds the feedback, too.
const LARGEST: u64 = 128 << 10;

/// A device that binds so little, with so many storage buffers.
fn narrow(buffers: u32) -> Headless {
    let (adapter, _) = Headless::of(&Headless::instance(), None).unwrap();
    let required_limits = wgpu::Limits {
        max_storage_buffer_binding_size: LARGEST,
        max_storage_buffers_per_shader_stage: buffers,
        ..wgpu::Limits::downlevel_defaults()
    };
    let descriptor = wgpu::DeviceDescriptor { label: Some("narrow"), required_limits, ..Default::default() };
    let (device, queue) = pollster::block_on(adapter.request_device(&descriptor)).unwrap();
    Headless { device, queue, name: "narrow".to_string() }
}

fn streamer(headless: &Headless, structure: &Structure, budget: u64) -> GpuStreamer {
    GpuStreamer::new(&headless.device, &headless.queue, structure, budget).unwrap()
}

/// Pieces in which pages lie, after the device's answers were held against twin and reader.
fn hold(gpu: &mut GpuStreamer, structure: &Structure, queries: &[[u32; 4]]) -> Vec<u64> {
    let answered = agree::ask(gpu, 0, queries);
    agree::compare(&answered, structure, 0, queries);
    let places = answered.table.iter().map(|e| e[0]).filter(|at| *at != NONE);
    let mut pieces: Vec<u64> = places.map(|at| u64::from(at) * 4 / LARGEST).collect();
    pieces.sort_unstable();
    pieces.dedup();
    pieces
}

#[test]
fn every_kind_answers_from_all_pieces() {
    let headless = narrow(8);
    let folder = Folder::new("pieces");
    let files = [
        city_as(&folder.0.join("mh.umb"), 2048, Kind::Mh),
        city_as(&folder.0.join("vector.umb"), 1 << 14, Kind::Vector),
        city_as(&folder.0.join("mmh.umb"), 2048, Kind::Mmh),
        random_vector("pieces-vector", 2, 10, 6).1,
        random_merged("pieces-mmh", 3, 8).1,
    ];
    let mut dice = Dice(31);
    let mut most = 0;
    for bytes in files {
        let structure = opened(bytes);
        let mut gpu = streamer(&headless, &structure, 4 << 20);
        let sizes: Vec<u64> = gpu.buffers().iter().map(|b| b.size()).collect();
        assert_eq!((gpu.pools(), sizes.len()), (4, 7));
        assert_eq!([0, 4, 5, 6].map(|i| sizes[i]), [LARGEST; 4]);
        fill(&mut gpu, &mut dice, true);
        let asked = queries(&mut dice, structure.record().log2_resolution, 8000);
        let pieces = hold(&mut gpu, &structure, &asked);
        eprintln!("{}: pages in the pieces {pieces:?}", structure.kind().name());
        most = most.max(pieces.len());
    }
    assert_eq!(most, 4, "no file reached the last piece");
}

#[test]
fn a_pool_shrinks_to_fewer_pieces_and_grows_again() {
    let headless = narrow(8);
    let folder = Folder::new("pieces-shrink");
    let structure = opened(city_as(&folder.0.join("mh.umb"), 2048, Kind::Mh));
    let mut gpu = streamer(&headless, &structure, 4 << 20);
    let mut dice = Dice(37);
    let asked = queries(&mut dice, 11, 8000);
    fill(&mut gpu, &mut dice, true);
    assert_eq!(hold(&mut gpu, &structure, &asked).len(), 4);
    let least = match gpu.set_budget(1) {
        Err(RuntimeError::Budget(e)) => e.needed,
        other => panic!("{other:?}"),
    };
    gpu.set_budget(least).unwrap();
    fill(&mut gpu, &mut dice, true);
    assert_eq!(gpu.exchanges(), 1);
    let (pieces, sizes) =
        (hold(&mut gpu, &structure, &asked), gpu.buffers().iter().map(|b| b.size()).collect::<Vec<_>>());
    assert!(pieces.len() < 4 && gpu.streamer().budget().pool() < 3 * LARGEST, "{pieces:?} {sizes:?}");
    assert_eq!(sizes.len(), 7, "the group keeps its layout");
    gpu.set_budget(4 << 20).unwrap();
    fill(&mut gpu, &mut dice, true);
    assert_eq!((gpu.exchanges(), hold(&mut gpu, &structure, &asked).len()), (2, 4));
}

#[test]
fn where_the_device_has_no_more_buffers_the_pool_is_what_one_holds() {
    let four = narrow(4);
    // Roots, the longest way and a page more are more than that; no budget helps.
    let deep = opened(random_vector("pieces-four", 2, 10, 6).1);
    match GpuStreamer::new(&four.device, &four.queue, &deep, 4 << 20) {
        Err(RuntimeError::Binding { what, needed, most }) => {
            assert!((what, most) == ("the pool", LARGEST) && needed > most);
        }
        other => panic!("{:?}", other.map(|g| g.pools())),
    }
    let structure = opened(random_tree("pieces-flat", 3, 6, &[4]).1);
    let mut gpu = streamer(&four, &structure, 4 << 20);
    assert_eq!((gpu.pools(), gpu.buffers().len()), (1, 4));
    assert_eq!(gpu.streamer().budget().pool(), LARGEST);
    let mut dice = Dice(41);
    fill(&mut gpu, &mut dice, true);
    let asked = queries(&mut dice, 6, 8000);
    assert_eq!(hold(&mut gpu, &structure, &asked), [0]);
}

#[test]
fn the_least_budget_is_told_whatever_one_buffer_holds() {
    let headless = narrow(8);
    // Its least pool is more than one buffer.
    let structure = opened(random_vector("pieces-least", 2, 10, 6).1);
    let least = match GpuStreamer::new(&headless.device, &headless.queue, &structure, 1000) {
        Err(RuntimeError::Budget(e)) => e.needed,
        other => panic!("{:?}", other.map(|g| g.pools())),
    };
    let gpu = streamer(&headless, &structure, least);
    let pool = gpu.streamer().budget().pool();
    assert!(gpu.pools() > 1 && u64::from(gpu.pools()) == pool.div_ceil(LARGEST), "{} of {pool}", gpu.pools());
}

#[test]
fn another_device_may_bind_less() {
    let structure = opened(random_vector("pieces-recover", 2, 10, 6).1);
    let first = streamer(&narrow(8), &structure, 4 << 20);
    let four = narrow(4);
    // The budget was divided for four pieces.
    match first.recover(&four.device, &four.queue) {
        Err(RuntimeError::Binding { what, needed, most }) => {
            assert_eq!((what, needed, most), ("the pool", 4 * LARGEST, LARGEST));
        }
        other => panic!("{:?}", other.map(|g| g.pools())),
    }
}
