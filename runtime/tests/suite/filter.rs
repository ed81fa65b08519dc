//! Filters on the device: kernel against twin to the bit, whatever is resident; twin against the reader where all is.

use umbrage_format::Kind;
use umbrage_reader::Structure;
use umbrage_reader::query::Map;
use umbrage_reader::query::filter::{MAX_SIDE, Receiver};
use umbrage_runtime::query::filter::FilterQuery;
use umbrage_runtime::query::pool::{ANCESTOR, EXACT, LIT, OUTSIDE, Pool};
use umbrage_runtime::{GpuStreamer, ViewOptions};

use crate::parity::fill;
use crate::support::{city_as, device, opened, random_merged, random_tree, random_vector, shared_city};
use crate::tree::Dice;

/// Random kernels and such at borders of nodes and of the map; half of the depths are about the texel's own.
fn queries(dice: &mut Dice, map: &Map, count: usize) -> Vec<FilterQuery> {
    let log2 = map.structure().record().log2_resolution;
    let side = 1u32 << log2;
    let coordinate = |dice: &mut Dice| match dice.roll(8) {
        0 | 1 => {
            let step = 1u32 << dice.roll(u32::from(log2) + 1);
            (dice.roll(side / step + 1) * step).wrapping_add(dice.roll(5)).wrapping_sub(2)
        }
        2 => [0, side - 1, side, u32::MAX][dice.roll(4) as usize],
        _ => dice.roll(side),
    };
    let query = |_| {
        let (x, y) = (coordinate(dice), coordinate(dice));
        let steep = dice.roll(33);
        let mut slope = || (dice.roll(u32::MAX) as i32).checked_shr(steep).unwrap_or(0);
        let gradient = [slope(), slope()];
        let own = map.texel(x, y, 0).map_or(9, |a| a.value);
        let depth = [own, own.saturating_add(1), dice.roll(u32::MAX), 0][dice.roll(4) as usize];
        let lod = [0, dice.roll(u32::from(log2) + 2) << 8, dice.roll(u32::from(log2 + 1) << 8), u32::MAX];
        let lod = lod[dice.roll(7).saturating_sub(3) as usize];
        let side = [1, 2, 3, 3, 4, 5, 5, 9, 0, MAX_SIDE + 1][dice.roll(10) as usize];
        FilterQuery { receiver: Receiver { x, y, depth, gradient }, lod, side }
    };
    (0..count).map(query).collect()
}

/// All pages, then a part of them; then frames until all is exact.
fn hold(name: &str, structure: &Structure, seed: u64) {
    let headless = device();
    let map = Map::new(structure.clone()).unwrap();
    let mut dice = Dice(seed);
    let queries = queries(&mut dice, &map, 40_000);
    let naive: Vec<_> = queries.iter().map(|q| map.trilinear(&q.receiver, q.side, q.lod).unwrap()).collect();
    for all in [true, false] {
        let mut gpu = GpuStreamer::new(&headless.device, &headless.queue, structure, 64 << 20).unwrap();
        fill(&mut gpu, &mut dice, all);
        let states = gpu.filter(0, &queries).unwrap();
        let (words, table) = gpu.read_back().unwrap();
        let log2_resolution = structure.record().log2_resolution;
        let pool = Pool {
            words: &words,
            table: &table,
            base: 0,
            stale: &[],
            kind: structure.kind(),
            log2_resolution,
            skips: Some(0),
        };
        let mut seen = [0; 5];
        for ((q, state), naive) in queries.iter().zip(&states).zip(&naive) {
            assert_eq!(*state, pool.filter(0, q), "{name}: twin, {q:?}");
            let share = q.share(*state);
            let bit = |b| state & b != 0;
            assert!(bit(EXACT) != bit(ANCESTOR) && bit(OUTSIDE) != share.inside);
            if bit(EXACT) {
                assert_eq!(share, *naive, "{name}: reader, {q:?}");
            }
            assert!(bit(EXACT) || !all, "{name}: {q:?}");
            let partly = share.lit != 0 && !bit(LIT);
            let counts = [bit(ANCESTOR), bit(OUTSIDE), partly, bit(LIT), share.lit == 0];
            counts.iter().zip(&mut seen).for_each(|(c, n)| *n += u32::from(*c));
        }
        eprintln!("{name}: by ancestors, outside, partly, wholly and not lit {seen:?}");
        assert!((seen[0] > 100) != all && seen[1..].iter().all(|n| *n > 100), "{name}: {seen:?}");
        // What is asked for comes, until nothing is missing.
        let (states, stats) = gpu.filter_view(&queries, &ViewOptions::default()).unwrap();
        assert!(stats.exact, "{stats:?}");
        assert!(queries.iter().zip(&states).zip(&naive).all(|((q, s), n)| q.share(*s) == *n), "{name}");
    }
}

#[test]
fn random_trees_are_filtered_alike() {
    hold("mh", &opened(random_tree("filter-tree", 5, 10, &[8, 6, 4, 2]).1), 17);
    hold("mmh", &opened(random_merged("filter-mmh", 3, 8).1), 19);
    hold("vector", &opened(random_vector("filter-vector", 2, 10, 6).1), 23);
}

#[test]
fn cities_are_filtered_alike() {
    hold("city", &opened(shared_city()), 29);
    let folder = crate::tree::Folder::new("filter-city");
    hold("vector city", &opened(city_as(&folder.0.join("city.umb"), 2048, Kind::Vector)), 31);
}
