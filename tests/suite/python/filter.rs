//! The independent filters `spec/filter.py` against the Rust reader's, on all kinds.

use std::fs;
use std::path::Path;

use umbrage::format::Kind;
use umbrage::reader::Limits;
use umbrage::reader::query::filter::{Receiver, Share, nearest_level};
use umbrage::reader::query::{Map, Resident};
use umbrage::writer::bake::{BakeOptions, Light, bake};
use umbrage::writer::container::ContainerOptions;
use umbrage::writer::scene;
use umbrage::writer::solid::Policy;

use super::run;
use crate::golden::{open, workspace};
use crate::tree::{self, Dice, Folder, ID, structure, write};
use crate::{mmh_tree, vector_tree};

/// Rows of each filter and file.
const ROWS: u32 = 700;

/// Runs `spec/filter.py`; what it printed.
fn python(filter: &str, path: &Path, name: &str, rows: &str) -> String {
    let args = [filter, path.to_str().unwrap(), "--structure", name];
    let (code, stdout, stderr) = run("spec/filter.py", &args, rows);
    assert_eq!((code, stderr.as_str()), (Some(0), ""), "{args:?}");
    stdout
}

/// A receiver, most of them where something changes: near borders of the map, of nodes and pages, about as deep as what is
/// stored; slopes from none to all there are.
fn receiver(map: &Resident, dice: &mut Dice) -> Receiver {
    let side = map.resolution();
    let mut coordinate = || match dice.roll(8) {
        0..3 => {
            let step = 1u32 << dice.roll(side.trailing_zeros() + 1);
            (dice.roll(side / step + 1) * step).wrapping_add(dice.roll(5)).wrapping_sub(2)
        }
        3 => [0, side - 1, side, u32::MAX][dice.roll(4) as usize],
        _ => dice.roll(side),
    };
    let (x, y) = (coordinate(), coordinate());
    let steep = 1 + dice.roll(32);
    let mut slope = || (dice.roll(u32::MAX) as i32).checked_shr(steep).unwrap_or(0);
    let gradient = [slope(), slope()];
    let own = map.value(x, y, 0);
    let [before, behind] = [own.saturating_sub(dice.roll(1 << 20)), own.saturating_add(dice.roll(1 << 28))];
    let depth = [own, own.saturating_add(1), before, behind, dice.roll(u32::MAX)];
    Receiver { x, y, depth: depth[dice.roll(5) as usize], gradient }
}

/// What was seen: kernels wholly and partly lit and dark ones, outside, across the border of the map, on coarse levels.
type Seen = [u32; 6];

/// Holds all filters on one file against each other, Rust's on both ways to look up.
fn same_shares(path: &Path, seed: u64) -> Seen {
    let map = Map::new(open(fs::read(path).unwrap(), Limits::default()).unwrap().structure(0).unwrap()).unwrap();
    let (resident, name) = (map.preload().unwrap(), map.structure().name());
    let log2 = map.structure().record().log2_resolution;
    let (mut dice, mut seen) = (Dice(seed), Seen::default());
    for filter in ["pcf", "hierarchical", "trilinear"] {
        let last = if filter == "pcf" { "level" } else { "lod" };
        let mut rows = String::new();
        let mut expected = format!("x,y,depth,gx,gy,side,{last},lit,taps,inside\n");
        for _ in 0..ROWS {
            let r = receiver(&resident, &mut dice);
            let side = [1, 2, 3, 5, 8][dice.roll(5) as usize];
            let lod = match dice.roll(4) {
                0 => 0,
                1 => dice.roll(u32::from(log2) + 2) << 8,
                _ => dice.roll((u32::from(log2) + 1) << 8),
            };
            let (last, level) =
                if filter == "pcf" { (lod >> 8, lod >> 8) } else { (lod, u32::from(nearest_level(lod))) };
            let level = u8::try_from(level).unwrap();
            let [share, paged] = match filter {
                "trilinear" => [resident.trilinear(&r, side, lod), map.trilinear(&r, side, lod).unwrap()],
                _ => [resident.pcf(&r, side, level), map.pcf(&r, side, level).unwrap()],
            };
            assert_eq!(share, paged, "{r:?}, side {side}, {filter} {last}");
            let Share { lit, taps, inside } = share;
            let (Receiver { x, y, depth, gradient: [gx, gy] }, level) = (r, level.min(log2));
            let row = format!("{x},{y},{depth},{gx},{gy},{side},{last}");
            expected += &format!("{row},{lit},{taps},{}\n", u8::from(inside));
            rows += &(row + "\n");
            let reaches = |v: u32| v < side / 2 || u64::from(v) + u64::from((side - 1) / 2) >= 1 << (log2 - level);
            let border = [x, y].iter().any(|v| reaches(v >> level));
            let counts =
                [lit == taps, lit != 0 && lit != taps, lit == 0, !inside, inside && border, inside && level > 0];
            counts.iter().zip(&mut seen).for_each(|(c, n)| *n += u32::from(*c));
        }
        let found = python(filter, path, name, &rows);
        for (found, expected) in found.lines().zip(expected.lines()) {
            assert_eq!(found, expected, "{}, {filter}", path.display());
        }
        assert_eq!(found.len(), expected.len());
    }
    eprintln!("{}: lit, partly lit, dark, outside, at borders, on coarse levels {seen:?}", path.display());
    seen
}

#[test]
fn filters_of_all_kinds_agree() {
    let folder = Folder::new("python-filter");
    let mut files = Vec::new();
    let mut keep = |name: &str, bytes: Vec<u8>| {
        let path = folder.0.join(name);
        fs::write(&path, bytes).unwrap();
        files.push(path);
    };
    let grown = tree::grow(&mut Dice(4), 9, true, 7);
    let pages = tree::pages(&grown, 9, &[7, 5, 3]);
    let record = structure("sun", Kind::Mh, 9, pages.len());
    keep("mh.umb", write("python-filter-mh", ContainerOptions::new(ID), &[(record, pages)]));
    let mut dice = Dice(3);
    let grown = mmh_tree::grow(&mut |n| dice.roll(n), 8);
    let (pages, shared) = mmh_tree::pages(&grown, 8, &[6, 5]);
    let record = mmh_tree::structure("sun", 8, &pages, shared);
    keep("mmh.umb", write("python-filter-mmh", ContainerOptions::new(ID), &[(record, pages)]));
    let mut dice = Dice(7);
    let grown = vector_tree::grow(&mut |n| dice.roll(n), 9, true, 7);
    let pages = vector_tree::pages(&grown, 9);
    let record = structure("sun", Kind::Vector, 9, pages.len());
    keep("vector.umb", write("python-filter-vector", ContainerOptions::new(ID), &[(record, pages)]));
    for kind in [Kind::Mh, Kind::Mmh, Kind::Vector] {
        let path = folder.0.join(format!("city-{}.umb", kind.name()));
        let options = BakeOptions {
            lights: vec![Light { name: "sun".to_string(), direction: [0.4, -0.8, 0.3] }],
            resolution: 512,
            policy: Policy::Closed,
            kind,
            exhaustive: false,
            top_down: kind == Kind::Mmh,
            mmh: Default::default(),
            memory_bytes: None,
            cold: false,
        };
        bake(&scene::generated("city:1:0.05").unwrap().unwrap(), &options, &path, &Default::default()).unwrap();
        files.push(path);
    }
    for (seed, path) in files.iter().enumerate() {
        let seen = same_shares(path, seed as u64 + 1);
        assert!(seen.iter().all(|n| *n >= 100), "{}: {seen:?}", path.display());
    }
}

#[test]
fn filters_refuse_what_they_cannot_read() {
    let path = workspace("tests/golden/example.umb");
    let map = Map::new(open(fs::read(&path).unwrap(), Limits::default()).unwrap().structure(0).unwrap()).unwrap();
    let args = ["pcf", path.to_str().unwrap(), "--structure", map.structure().name()];
    for rows in ["1,2,3\n", "0,0,-1,0,0,3,0\n", "0,0,5,2147483648,0,3,0\n", "0,0,5,0,0,3,x\n"] {
        let (code, _, stderr) = run("spec/filter.py", &args, rows);
        assert_eq!((code, stderr.lines().count()), (Some(3), 1), "{rows}: {stderr}");
    }
}
