//! Filters against their definition: each tap looked up by itself from the root of a naive tree, held in 128-bit integers.

use umbrage_format::projection::UNCOVERED;
use umbrage_format::{Kind, StructureRecord};
use umbrage_reader::query::filter::{
    MAX_SIDE, Receiver, Share, gradient, level_of_detail, levels_around, nearest_level,
};
use umbrage_reader::query::{Map, Resident};
use umbrage_writer::container::{ContainerOptions, PageInput};

use crate::tree::{self, Dice, ID, open, structure, write};
use crate::{mmh_tree, vector_tree};

/// The definition, tap by tap.
fn naive(r: &Receiver, side: u32, level: u8, log2: u8, value: &dyn Fn(u32, u32, u8) -> u32) -> Share {
    let map = 1i128 << log2;
    let level = level.min(log2);
    let inside = i128::from(r.x) < map && i128::from(r.y) < map;
    let mut lit = 0;
    for j in 0..i128::from(side) {
        for i in 0..i128::from(side) {
            let (i, j) = (i - i128::from(side / 2), j - i128::from(side / 2));
            let (x, y) = ((i128::from(r.x >> level) + i) << level, (i128::from(r.y >> level) + j) << level);
            if !inside || x < 0 || y < 0 || x >= map || y >= map {
                lit += 1;
                continue;
            }
            // Of all texels of level 0 under the tap the plane is nearest to the light at a corner.
            let last = (1i128 << level) - 1;
            let corners = [(x, y), (x + last, y), (x, y + last), (x + last, y + last)];
            let [gx, gy] = r.gradient.map(i128::from);
            let rises = corners.map(|(x, y)| gx * (x - i128::from(r.x)) + gy * (y - i128::from(r.y)));
            let rise = rises.into_iter().fold(i128::MAX, i128::min);
            // Rounded up and clamped, as any lookup's depth.
            let depth = (i128::from(r.depth) + (rise + 15).div_euclid(16)).clamp(0, u32::MAX.into());
            lit += u32::from(depth <= i128::from(value(x as u32, y as u32, level)));
        }
    }
    Share { lit, taps: side * side, inside }
}

/// What one file gave: kernels in part lit, across the map's border, in one node.
#[derive(Debug, Default)]
struct Seen {
    partial: u32,
    border: u32,
    uniform: u32,
}

/// Random kernels and ones at borders, of every level, on both ways to look up.
fn hold(map: &Map, resident: &Resident, dice: &mut Dice, count: u32, value: &dyn Fn(u32, u32, u8) -> u32) -> Seen {
    let log2 = map.structure().record().log2_resolution;
    let mut seen = Seen::default();
    for n in 0..count {
        let mut coordinate = || match dice.roll(6) {
            // Beside a border of nodes or pages.
            0 | 1 => {
                let step = 1u32 << dice.roll(u32::from(log2) + 1);
                (dice.roll((1 << log2) / step + 1) * step).wrapping_add(dice.roll(5)).wrapping_sub(2)
            }
            2 => [0, (1 << log2) - 1, 1 << log2, u32::MAX][dice.roll(4) as usize],
            _ => dice.roll(1 << log2),
        };
        let (x, y) = (coordinate(), coordinate());
        let side = [1, 2, 3, 3, 4, 5, 5, 9, 16, MAX_SIDE][dice.roll(10) as usize];
        let level = if n % 2 == 0 { 0 } else { dice.roll(u32::from(log2) + 2) as u8 };
        let steep = dice.roll(33);
        let mut slope = || (dice.roll(u32::MAX) as i32).checked_shr(steep).unwrap_or(0);
        let gradient = [slope(), slope()];
        // Half of the depths are about that of the texel itself.
        let own = if (x | y) >> log2 == 0 { value(x, y, level) } else { 7 };
        let depth = match dice.roll(4) {
            0 => own.saturating_sub(dice.roll(3)).saturating_add(1),
            1 => own,
            2 => [0, u32::MAX][dice.roll(2) as usize],
            _ => dice.roll(u32::MAX),
        };
        let r = Receiver { x, y, depth, gradient };
        let expected = naive(&r, side, level, log2, value);
        assert_eq!(resident.pcf(&r, side, level), expected, "resident: {r:?}, side {side}, level {level}");
        assert_eq!(map.pcf(&r, side, level).unwrap(), expected, "paged: {r:?}, side {side}, level {level}");
        let lod = dice.roll((u32::from(log2) + 1) << 8);
        let (level, part) = levels_around(lod);
        let [fine, coarse] = [0, 1].map(|l| naive(&r, side, level + l, log2, value).lit);
        let lit = fine * (256 - part) + coarse * part;
        let expected = Share { lit, taps: 256 * side * side, inside: expected.inside };
        assert_eq!(resident.trilinear(&r, side, lod), expected, "resident: {r:?}, side {side}, {lod}/256");
        assert_eq!(map.trilinear(&r, side, lod).unwrap(), expected, "paged: {r:?}, side {side}, {lod}/256");
        let own = naive(&r, side, 0, log2, value);
        seen.partial += u32::from(own.lit != 0 && own.lit != own.taps);
        seen.border += u32::from(own.inside && [x, y].iter().any(|v| *v < side / 2 || v + side / 2 >= 1 << log2));
        seen.uniform += u32::from(own.lit == 0);
    }
    seen
}

fn held(name: &str, record: StructureRecord, pages: Vec<PageInput>, value: &dyn Fn(u32, u32, u8) -> u32) {
    let count = pages.len();
    let bytes = write(name, ContainerOptions::new(ID), &[(record, pages)]);
    // Pages come one by one, in the order in which kernels ask for them.
    let map = Map::new(open(bytes.clone()).unwrap().structure(0).unwrap()).unwrap();
    let resident = Map::new(open(bytes).unwrap().structure(0).unwrap()).unwrap().preload().unwrap();
    let seen = hold(&map, &resident, &mut Dice(count as u64), 4000, value);
    eprintln!("{name}: {count} pages, {seen:?}");
    let small = record.log2_resolution < 3;
    assert!(small || (seen.partial > 300 && seen.border > 300 && seen.uniform > 300), "{seen:?}");
}

#[test]
fn mh_is_filtered_as_tap_by_tap() {
    for (seed, log2, cuts) in [(1, 0, &[][..]), (2, 1, &[1]), (3, 6, &[5, 3, 1]), (4, 10, &[8, 6, 4, 2])] {
        let tree = tree::grow(&mut Dice(seed), log2, true, 7);
        let pages = tree::pages(&tree, log2, cuts);
        let record = structure("sun", Kind::Mh, log2, pages.len());
        held(&format!("filter-mh-{seed}"), record, pages, &|x, y, l| tree.lookup(log2, x, y, l));
    }
}

#[test]
fn mmh_is_filtered_as_tap_by_tap() {
    for (seed, log2) in [(3, 8), (90, 7), (11, 4)] {
        let mut dice = Dice(seed);
        let tree = mmh_tree::grow(&mut |n| dice.roll(n), log2);
        let (pages, shared) = mmh_tree::pages(&tree, log2, &[log2 - 2, log2 - 3]);
        let record = mmh_tree::structure("sun", log2, &pages, shared);
        held(&format!("filter-mmh-{seed}"), record, pages, &|x, y, l| tree.lookup(log2, x, y, l));
    }
}

#[test]
fn vector_is_filtered_as_tap_by_tap() {
    for (seed, log2, bushy) in [(1, 0, 0), (2, 1, 8), (4, 6, 7), (6, 10, 6), (7, 9, 7), (9, 10, 4)] {
        let mut dice = Dice(seed);
        let tree = vector_tree::grow(&mut |n| dice.roll(n), log2, true, bushy);
        let pages = vector_tree::pages(&tree, log2);
        let record = structure("sun", Kind::Vector, log2, pages.len());
        held(&format!("filter-vector-{seed}"), record, pages, &|x, y, l| tree.lookup(log2, x, y, l));
    }
}

/// On the smallest and the largest numbers nothing overflows: a map of 2^24 texels, all slopes there are.
#[test]
fn extremes_are_held() {
    for value in [0, 1, 1 << 31, u32::MAX - 1, UNCOVERED] {
        let tree = tree::Naive::Leaf(value);
        let pages = tree::pages(&tree, 24, &[]);
        let record: StructureRecord = structure("sun", Kind::Mh, 24, pages.len());
        let bytes = write(&format!("filter-extremes-{value}"), ContainerOptions::new(ID), &[(record, pages)]);
        let map = Map::new(open(bytes).unwrap().structure(0).unwrap()).unwrap();
        let resident = map.preload().unwrap();
        for (level, depth) in [0, 11, 23, 24, 99].iter().flat_map(|l| [0, 1, 1 << 31, u32::MAX].map(|d| (*l, d))) {
            for gradient in [[i32::MIN; 2], [i32::MAX; 2], [i32::MIN, i32::MAX], [1, -1], [0; 2]] {
                for (x, y) in [(0, 0), (1 << 23, (1 << 24) - 1), (12_345_678, 7_654_321)] {
                    let r = Receiver { x, y, depth, gradient };
                    let expected = naive(&r, MAX_SIDE, level, 24, &|_, _, _| value);
                    assert_eq!(resident.pcf(&r, MAX_SIDE, level), expected, "{r:?}, level {level}, value {value}");
                    assert_eq!(map.pcf(&r, MAX_SIDE, level).unwrap(), expected);
                }
            }
        }
        let r = Receiver { x: 5, y: 5, depth: 1, gradient: [0; 2] };
        assert_eq!((resident.pcf(&r, 0, 0).taps, resident.pcf(&r, 1000, 0).taps), (1, MAX_SIDE * MAX_SIDE));
    }
}

#[test]
fn gradients_and_footprints_are_rounded_and_clamped() {
    assert_eq!(gradient([1.0, -0.03], 100.0), [16, 0]);
    assert_eq!(gradient([1e9, f64::NEG_INFINITY], 3.5), [56, -56]);
    assert_eq!(gradient([f64::NAN, 1e300], f64::INFINITY), [0, i32::MAX]);
    assert_eq!(gradient([1.0, 2.0], f64::NAN), [0, 0]);
    assert_eq!(level_of_detail([[4.0, 0.0], [0.0, 1.0]], 10), 512);
    assert_eq!(level_of_detail([[0.0, 0.0], [3.0, 4.0]], 10), (5f64.log2() * 256.0).round() as u32);
    assert_eq!((level_of_detail([[0.1, 0.0]; 2], 10), level_of_detail([[1e9, 0.0]; 2], 10)), (0, 2560));
    assert_eq!((level_of_detail([[f64::NAN; 2]; 2], 10), level_of_detail([[f64::INFINITY; 2]; 2], 10)), (0, 2560));
    assert_eq!((nearest_level(127), nearest_level(128), nearest_level(u32::MAX)), (0, 1, 255));
    assert_eq!(levels_around(0x3_40), (3, 0x40));
    let share = |lit, taps| Share { lit, taps, inside: true };
    assert_eq!([share(0, 9), share(9, 9), share(5, 9)].map(|s| s.coverage()), [0, 255, 142]);
    assert_eq!(share(9, 9).blend(&share(0, 9), 64), share(9 * 192, 9 * 256));
}
