//! Sizes at which formats break: a thousand structures, a hundred thousand pages.

use std::sync::Arc;
use std::time::Instant;

use umbrage::format::{Header, Kind, SectionRecord, StructureRecord};
use umbrage::reader::query::Map;
use umbrage::reader::{Container, FileSource, Limits};
use umbrage::writer::container::{ContainerOptions, ContainerWriter};
use umbrage::writer::hierarchy::build::Progress;
use umbrage::writer::layers::{DepthSource, LayersOptions, Projection, Second, SourceError, Square, bake_layers};

use crate::tree::{Dice, Folder, ID, grow, pages, structure};

/// Bytes of the first read, and of that with a root page.
const FIRST: u64 = 16 << 10;
const COARSE: u64 = 64 << 10;

#[test]
fn one_of_a_thousand_structures_answers_after_the_tables_and_two_reads() {
    let folder = Folder::new("thousand");
    let path = folder.0.join("map.umb");
    let parts: Vec<_> = (0..1000)
        .map(|i| {
            let tree = grow(&mut Dice(i), 4, true, 7);
            (tree, format!("light {i}"))
        })
        .collect();
    let laid: Vec<_> = parts.iter().map(|(tree, _)| pages(tree, 4, &[2])).collect();
    let records = parts.iter().zip(&laid).map(|((_, name), p)| structure(name, Kind::Mh, 4, p.len())).collect();
    let mut writer = ContainerWriter::create(&path, ContainerOptions::new(ID), records).unwrap();
    writer.push_all(laid.iter().flatten().cloned().map(Ok)).unwrap();
    writer.finish().unwrap();
    let start = Instant::now();
    let file = Container::open(Arc::new(FileSource::open(&path).unwrap()), Limits::default()).unwrap();
    let tables = Header::BYTES + file.sections().len() * SectionRecord::BYTES + 1000 * StructureRecord::BYTES;
    let opened = file.counters();
    assert!(opened.reads <= 3 && opened.bytes <= FIRST + tables as u64, "{opened:?}, tables {tables}");
    for i in [0usize, 7, 999] {
        let (before, (tree, name)) = (file.counters(), &parts[i]);
        let map = Map::new(file.structure_named(name).unwrap()).unwrap();
        assert_eq!(map.texel(9, 5, 4).unwrap().value, tree.lookup(4, 9, 5, 4));
        let after = file.counters();
        // the root page; its record is in the structure's
        assert!(after.reads - before.reads <= 1 && after.bytes - before.bytes <= COARSE - FIRST, "{after:?}");
        for (x, y, level) in (0..256).map(|k| (k & 15, k >> 4, (k % 5) as u8)) {
            assert_eq!(map.texel(x, y, level).unwrap().value, tree.lookup(4, x, y, level));
        }
    }
    assert_eq!(file.verify(|e| panic!("{e}")).pages, laid.iter().map(|p| p.len() as u64).sum::<u64>());
    assert!(start.elapsed().as_secs() < 20, "{:?}", start.elapsed());
}

/// White noise of depth: every texel is a leaf of its own.
struct Noise;

impl DepthSource for Noise {
    fn name(&self) -> &str {
        "noise"
    }

    fn projection(&self) -> Projection {
        Projection::image(2048).unwrap()
    }

    fn second(&self) -> Second {
        Second::Exit
    }

    fn key(&self) -> Vec<u8> {
        b"noise".to_vec()
    }

    fn render(&self, square: Square, first: &mut [f64], second: &mut [f64]) -> Result<(), SourceError> {
        for i in 0..square.texels() {
            let [x, y] = square.texel(i);
            let h = (u64::from(x) << 32 | u64::from(y)).wrapping_mul(0x9E37_79B9_7F4A_7C15);
            first[i] = ((h ^ h >> 29).wrapping_mul(0xBF58_476D_1CE4_E5B9) >> 40) as f64;
            second[i] = first[i] + 0.01;
        }
        Ok(())
    }
}

/// The run of 1 GiB and 262,144 pages is `cargo bench-umbrage check --full`.
#[test]
fn a_level_of_64_x_64_answers_after_2_reads_and_64_kib() {
    let folder = Folder::new("noise");
    let path = folder.0.join("map.umb");
    let baked = bake_layers(&[&Noise], &LayersOptions::default(), &path, &Progress::default()).unwrap();
    assert!(baked.bytes > 20 << 20 && baked.lights[0].pages > 4000, "{} {}", baked.bytes, baked.lights[0].pages);
    let file = Container::open(Arc::new(FileSource::open(&path).unwrap()), Limits::default()).unwrap();
    assert_eq!((file.counters().reads, file.counters().bytes), (1, FIRST));
    let map = Map::new(file.structure(0).unwrap()).unwrap();
    for k in 0..4096u32 {
        let a = map.texel((k & 63) << 5, (k >> 6) << 5, 5).unwrap();
        assert!(a.level >= 5);
    }
    let found = file.counters();
    assert!(found.reads <= 2 && found.bytes <= COARSE, "{found:?}");
}
