//! A device for all tests, files to stream, and a generator of queries.

use std::path::Path;
use std::sync::{Arc, OnceLock};

use umbrage_format::Kind;
use umbrage_reader::{Container, Limits, MemorySource, Structure};
use umbrage_runtime::Headless;
use umbrage_writer::bake::{BakeOptions, Light, bake};
use umbrage_writer::container::ContainerOptions;
use umbrage_writer::hierarchy::build::Progress;
use umbrage_writer::mesh::Mesh;
use umbrage_writer::solid::Policy;

use crate::mmh_tree::{self, Piece};
use crate::tree::{Dice, Folder, ID, Naive, grow, pages, structure, write};
use crate::vector_tree::{self, Node};

/// One device for the whole program; without a driver every test fails and says what to install.
pub fn device() -> &'static Headless {
    static DEVICE: OnceLock<Headless> = OnceLock::new();
    DEVICE.get_or_init(|| match Headless::new() {
        Ok(headless) => {
            eprintln!("adapter: {}", headless.name);
            headless
        }
        Err(error) => panic!("{error}"),
    })
}

/// A file in memory.
pub fn container(bytes: Vec<u8>) -> Container {
    Container::open(Arc::new(MemorySource::new(bytes, "memory")), Limits::default()).unwrap()
}

/// Structure 0 of a file in memory.
pub fn opened(bytes: Vec<u8>) -> Structure {
    container(bytes).structure(0).unwrap()
}

/// A small city, baked.
pub fn city(path: &Path, resolution: u64) -> Vec<u8> {
    city_as(path, resolution, Kind::Mh)
}

/// A small city, baked in a kind.
pub fn city_as(path: &Path, resolution: u64, kind: Kind) -> Vec<u8> {
    city_with(path, resolution, kind, false)
}

/// The same, with cold pages or without.
pub fn city_with(path: &Path, resolution: u64, kind: Kind, cold: bool) -> Vec<u8> {
    let mesh = umbrage_writer::scene::generated("city:1:0.05").unwrap().unwrap();
    city_of(&mesh, path, resolution, kind, cold)
}

/// A mesh under that city's light.
pub fn city_of(mesh: &Mesh, path: &Path, resolution: u64, kind: Kind, cold: bool) -> Vec<u8> {
    let options = BakeOptions {
        lights: vec![Light { name: "sun".into(), direction: [0.4, -1.0, 0.3] }],
        resolution,
        policy: Policy::Closed,
        kind,
        exhaustive: false,
        top_down: false,
        mmh: Default::default(),
        memory_bytes: None,
        cold,
    };
    bake(mesh, &options, path, &Progress::default()).unwrap();
    std::fs::read(path).unwrap()
}

/// [`city`], baked once for all tests that want 2048 texels on a side.
pub fn shared_city() -> Vec<u8> {
    static CITY: OnceLock<Vec<u8>> = OnceLock::new();
    CITY.get_or_init(|| {
        let folder = Folder::new("runtime-city");
        city(&folder.0.join("city.umb"), 2048)
    })
    .clone()
}

/// A random tree in a file of many pages.
pub fn random_tree(name: &str, seed: u64, log2: u8, cuts: &[u8]) -> (Naive, Vec<u8>) {
    let tree = grow(&mut Dice(seed), log2, true, 7);
    let pages = pages(&tree, log2, cuts);
    let record = structure("sun", Kind::Mh, log2, pages.len());
    let bytes = write(name, ContainerOptions::new(ID), &[(record, pages)]);
    (tree, bytes)
}

/// A random tree of kind `mmh` in a file of child pages and two shared pages; the first from `seed` on that has them.
pub fn random_merged(name: &str, seed: u64, log2: u8) -> (Piece, Vec<u8>) {
    let (tree, pages, shared) = (seed..)
        .map(|seed| {
            let mut dice = Dice(seed);
            let tree = mmh_tree::grow(&mut |n| dice.roll(n), log2);
            let (pages, shared) = mmh_tree::pages(&tree, log2, &[log2 - 2, log2 - 3]);
            (tree, pages, shared)
        })
        .find(|(_, pages, shared)| *shared == 2 && pages.len() > if log2 > 4 { 12 } else { 4 })
        .unwrap();
    let record = mmh_tree::structure("sun", log2, &pages, shared);
    (tree, write(name, ContainerOptions::new(ID), &[(record, pages)]))
}

/// A random tree of kind `vector` in a file of at least 10 pages; the first from `seed` on that has so many.
pub fn random_vector(name: &str, seed: u64, log2: u8, bushy: u32) -> (Node, Vec<u8>) {
    let (tree, pages) = (seed..)
        .map(|seed| {
            let mut dice = Dice(seed);
            let tree = vector_tree::grow(&mut |n| dice.roll(n), log2, true, bushy);
            let pages = vector_tree::pages(&tree, log2);
            (tree, pages)
        })
        .find(|(_, pages)| pages.len() >= 10)
        .unwrap();
    let record = structure("sun", Kind::Vector, log2, pages.len());
    let bytes = write(name, ContainerOptions::new(ID), &[(record, pages)]);
    (tree, bytes)
}

/// Queries (x, y, level, depth): random ones, and ones along the borders of nodes of every level and of the map.
pub fn queries(dice: &mut Dice, log2: u8, count: usize) -> Vec<[u32; 4]> {
    let side = 1u32 << log2;
    let coordinate = |dice: &mut Dice| match dice.roll(8) {
        0 => {
            let step = 1u32 << dice.roll(u32::from(log2) + 1);
            let border = dice.roll(side / step + 1) * step;
            border.wrapping_add(dice.roll(3)).wrapping_sub(1)
        }
        1 => [0, side - 1, side, u32::MAX][dice.roll(4) as usize],
        _ => dice.roll(side),
    };
    (0..count)
        .map(|_| {
            let level = [dice.roll(u32::from(log2) + 2), 0, 255][dice.roll(3).min(2) as usize];
            [coordinate(dice), coordinate(dice), level, dice.roll(u32::MAX)]
        })
        .collect()
}
