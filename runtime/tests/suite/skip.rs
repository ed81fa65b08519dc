//! What the index settles: kernel against twin to the bit, and answers that never differ from those of all pages.

use umbrage_format::Kind;
use umbrage_reader::Structure;
use umbrage_reader::query::{Bounds, Map};
use umbrage_runtime::query::pool::{EXACT, LEVEL_SHIFT, LIT, OUTSIDE, Pool, SETTLED, Shadow};
use umbrage_runtime::residency::foresee::Viewpoint;
use umbrage_runtime::stream::Streamer;
use umbrage_runtime::{GpuStreamer, Receiver, ViewOptions};

use crate::parity::fill;
use crate::support::{city_as, device, opened, random_merged, random_tree, random_vector, shared_city};
use crate::tree::{Dice, Folder};

/// Receivers everywhere; half of their depths about what a page on the way says of its answers, or the texel's own.
fn receivers(structure: &Structure, dice: &mut Dice, count: usize) -> Vec<Receiver> {
    let log2 = structure.record().log2_resolution;
    let side = 1u32 << log2;
    let bounds: Vec<Bounds> =
        (0..structure.page_count()).map(|o| Bounds::of(&structure.page_record(o).unwrap())).collect();
    let map = Map::new(structure.clone()).unwrap();
    let receiver = |_| {
        let (x, y) = (dice.roll(side + side / 64), dice.roll(side + side / 64));
        let b = bounds[dice.roll(bounds.len() as u32) as usize];
        let own = map.texel(x.min(side - 1), y.min(side - 1), 0).unwrap().value;
        let depth = [b.min_depth, b.max_depth, own, dice.roll(u32::MAX)][dice.roll(4) as usize];
        let depth = depth.saturating_add(dice.roll(3)).saturating_sub(1);
        Receiver { x, y, depth, level: [0, dice.roll(u32::from(log2) + 1) as u8][dice.roll(2) as usize] }
    };
    (0..count).map(receiver).collect()
}

/// Some pages there: one frame on the device against the twin. Then frames until every receiver has what it needs, with
/// skipping and without.
fn hold(name: &str, structure: &Structure, seed: u64) {
    let headless = device();
    let mut dice = Dice(seed);
    let receivers = receivers(structure, &mut dice, 60_000);
    let log2_resolution = structure.record().log2_resolution;
    let map = Map::new(structure.clone()).unwrap();
    let mut read = Vec::new();
    for skips in [None, Some(0), Some(1 << 20)] {
        let mut gpu = GpuStreamer::new(&headless.device, &headless.queue, structure, 64 << 20).unwrap();
        gpu.skip(skips);
        fill(&mut gpu, &mut dice, false);
        let once = ViewOptions { max_frames: 1, ..ViewOptions::default() };
        let view = gpu.answer_view(&receivers, &once).unwrap();
        let (words, table) = gpu.read_back().unwrap();
        let pool =
            Pool { words: &words, table: &table, base: 0, stale: &[], kind: structure.kind(), log2_resolution, skips };
        let (mut settled, mut missing) = (0, 0);
        for (r, p) in receivers.iter().zip(&view.pixels) {
            let Shadow { state, missing: missed, .. } = pool.shadow(0, [r.x, r.y], r.level.into(), r.depth);
            let bit = |b| state & b != 0;
            let level = (state >> LEVEL_SHIFT & 31) as u8;
            let found = (p.lit, !p.ancestor, p.outside, p.settled, p.level);
            assert_eq!(found, (bit(LIT), bit(EXACT), bit(OUTSIDE), bit(SETTLED), level), "{name}: {r:?}");
            settled += u32::from(p.settled);
            missing += u32::from(p.ancestor);
            // The pages that the index spared would have said the same.
            if skips != Some(1 << 20) && !p.ancestor && !p.outside {
                let value = map.texel(r.x, r.y, r.level).unwrap().value;
                assert_eq!(p.lit, r.depth <= value, "{name}: {r:?}, page {missed}");
            }
        }
        eprintln!("{name}: {skips:?}: {settled} settled by the index, {missing} by ancestors");
        // Trees that no scene was baked into promise that nothing is off.
        assert_eq!(settled > 100, skips.is_some(), "{name}");
        assert!(missing > 100 || skips == Some(1 << 20), "{name}");
        drop(gpu);
        let mut gpu = GpuStreamer::new(&headless.device, &headless.queue, structure, 64 << 20).unwrap();
        gpu.skip(skips);
        let view = gpu.answer_view(&receivers, &ViewOptions::default()).unwrap();
        assert!(view.stats.exact, "{:?}", view.stats);
        read.push((view.stats.pages_read, view.pixels.iter().map(|p| p.lit).collect::<Vec<_>>()));
    }
    let [all, same, less] = [0, 1, 2].map(|i| read[i].0);
    eprintln!("{name}: pages read with all, with error 0, with an error: {all}, {same}, {less}");
    assert_eq!(read[0].1, read[1].1);
    assert!(same <= all && less <= same);
}

#[test]
fn random_trees_are_settled_alike() {
    hold("mh", &opened(random_tree("skip-tree", 5, 10, &[8, 6, 4, 2]).1), 17);
    hold("mmh", &opened(random_merged("skip-mmh", 3, 8).1), 19);
    hold("vector", &opened(random_vector("skip-vector", 2, 10, 6).1), 23);
}

#[test]
fn cities_are_settled_alike() {
    hold("city", &opened(shared_city()), 29);
    let folder = Folder::new("skip-city");
    for kind in [Kind::Vector, Kind::Mmh] {
        hold("a city", &opened(city_as(&folder.0.join("city.umb"), 2048, kind)), 31);
    }
}

/// Receivers above all walls and below all floors need no page but the root.
#[test]
fn what_is_wholly_lit_or_dark_is_never_read() {
    let headless = device();
    let structure = opened(shared_city());
    let mut gpu = GpuStreamer::new(&headless.device, &headless.queue, &structure, 64 << 20).unwrap();
    let receivers: Vec<Receiver> =
        (0..10_000).map(|i| Receiver { x: i * 37 % 2048, y: i * 91 % 2048, depth: 0, level: 0 }).collect();
    let view = gpu.answer_view(&receivers, &ViewOptions::default()).unwrap();
    assert!(view.pixels.iter().all(|p| p.lit && !p.ancestor));
    assert_eq!((view.stats.pages_read, view.stats.frames), (0, 1));
    gpu.skip(None);
    let view = gpu.answer_view(&receivers, &ViewOptions::default()).unwrap();
    assert!(view.pixels.iter().all(|p| p.lit && !p.settled) && view.stats.pages_read > 3, "{:?}", view.stats);
}

/// A camera flies towards a city: pages come that no receiver has missed, and none once it stands still.
#[test]
fn pages_that_a_moving_camera_will_need_come_by_themselves() {
    let structure = opened(shared_city());
    let mut streamer = Streamer::new(&structure, 64 << 20, 64 << 20, 1).unwrap();
    let frame = |streamer: &mut Streamer| {
        streamer.wait(std::time::Duration::from_millis(50));
        streamer.frame();
        streamer.feedback([], &[], false);
    };
    while !streamer.residency().roots_resident() {
        frame(&mut streamer);
    }
    let axes = [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]];
    let at = |x: f64| Viewpoint { eye: [x, 30.0, 0.0], axes, half: [0.8, 0.45], pixels: [1280, 720] };
    let mut named = 0;
    for n in 0..120 {
        named += streamer.look(&[at(f64::from(n) * 100.0 - 14000.0)], 20.0);
        frame(&mut streamer);
    }
    let came = streamer.stats().resident;
    eprintln!("foreseen: named {named} times, {came} of {} pages came", structure.page_count());
    assert!(named > 10 && came > 5, "{named} {came}");
    assert_eq!(streamer.stats().evicted, 0);
    // Away from it nothing is foreseen, and a camera that stands still foresees nothing.
    let mut away = Streamer::new(&structure, 64 << 20, 64 << 20, 1).unwrap();
    while !away.residency().roots_resident() {
        frame(&mut away);
    }
    let back = |x: f64| Viewpoint { axes: [[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]], ..at(x) };
    assert_eq!((0..50).map(|n| away.look(&[back(f64::from(n) * -10.0 - 500.0)], 20.0)).sum::<usize>(), 0);
    assert_eq!((0..5).map(|_| streamer.look(&[at(-300.0)], 20.0)).skip(1).sum::<usize>(), 0);
}
