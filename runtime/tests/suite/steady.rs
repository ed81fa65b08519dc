//! Frames in which nothing comes and nothing goes allocate nothing.

use umbrage_format::Kind;
use umbrage_reader::Structure;
use umbrage_runtime::residency::foresee::Viewpoint;
use umbrage_runtime::residency::slots::UNIT_WORDS;
use umbrage_runtime::stream::Streamer;

use crate::support::{city_as, opened, shared_city};
use crate::tree::Folder;

/// Two cities, every page there and in use, two cameras that fly over them.
#[test]
fn the_steady_state_allocates_nothing() {
    let folder = Folder::new("steady");
    let all = [opened(shared_city()), opened(city_as(&folder.0.join("city.umb"), 1024, Kind::Vector))];
    let table: u32 = all.iter().map(Structure::page_count).sum();
    let mut streamer = Streamer::with_table(64 << 20, table, 1 << 30, 2).unwrap();
    let ids = [0, 1].map(|i: usize| streamer.attach(&all[i]).unwrap());
    while streamer.stats().resident < table {
        (0..table).for_each(|o| streamer.request(o, 1));
        streamer.wait(std::time::Duration::from_millis(50));
        streamer.frame();
    }
    streamer.wait(std::time::Duration::from_millis(50));
    assert!(ids.iter().all(|id| streamer.is_ready(*id)) && streamer.maps().is_some());
    // What the device would say: every second page was used.
    let mut used = vec![0u32; streamer.budget().pool() as usize / 4 / UNIT_WORDS as usize / 32];
    for ordinal in (0..table).step_by(2) {
        let unit = streamer.residency().entry(ordinal)[0] / UNIT_WORDS;
        used[unit as usize / 32] |= 1 << (unit % 32);
    }
    let axes = [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]];
    let view = |x: f64| Viewpoint { eye: [x, 30.0, 0.0], axes, half: [0.8, 0.45], pixels: [1280, 720] };
    let mut frame = |n: u32| {
        let x = f64::from(n);
        streamer.feedback([], &used, false);
        streamer.answered(0, 0);
        streamer.begin(&[view(x), view(500.0 - 2.0 * x)]);
        let maps = streamer.maps();
        let frame = streamer.frame();
        assert!(maps.is_none() && frame.ops.is_empty() && frame.table.is_empty());
        let coverage = streamer.coverage(ids[0], [x, 0.0, x]).unwrap();
        assert!(!coverage.inside || coverage.level == Some(0));
        assert_eq!((streamer.frame_stats().admitted, streamer.frame_stats().resident), (0, table));
    };
    // Lists grow to what they need.
    (0..50).for_each(&mut frame);
    let counted = allocation_counter::measure(|| (50..1050).for_each(&mut frame));
    assert_eq!(counted.count_total, 0, "{counted:?}");
    let one = allocation_counter::measure(|| drop(std::hint::black_box(vec![1u8; 100])));
    assert_eq!(one.count_total, 1, "allocations are counted");
}
