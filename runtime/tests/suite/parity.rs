//! Kernel against twin against reader: equal to the bit, whatever is resident and whatever the bytes say.

use std::time::Instant;

use umbrage_format::Kind;
use umbrage_format::checksum::{block_crc, content_hash, header_crc, page_crc};
use umbrage_format::{BlockHeader, Header, PageRecord, SectionRecord, StructureRecord};
use umbrage_reader::{Container, Limits, MemorySource, Structure};
use umbrage_runtime::GpuStreamer;
use umbrage_runtime::query::pool::Pool;
use zerocopy::{FromBytes, IntoBytes};

use crate::agree::{self, Answered};
use crate::support::{
    city_as, city_with, container, device, opened, queries, random_merged, random_tree, random_vector, shared_city,
};
use crate::tree::Dice;

/// Streams whatever the dice ask for until nothing more comes; with `all`, every page.
pub fn fill(gpu: &mut GpuStreamer, dice: &mut Dice, all: bool) {
    let pages = gpu.streamer().table();
    let wanted: Vec<bool> = (0..pages).map(|_| all || dice.roll(3) != 0).collect();
    for _ in 0..60 {
        for (ordinal, _) in (0u32..).zip(&wanted).filter(|(_, w)| **w) {
            gpu.streamer_mut().request(ordinal, 1);
        }
        // One query at a place that is answered at once: its feedback adds no wish.
        gpu.answer(0, &[[0, 0, 255, 0]]).unwrap();
        while gpu.streamer().is_loading() {
            gpu.streamer_mut().wait(std::time::Duration::from_millis(20));
        }
    }
}

/// Asks the device and holds its answers; times of device and twin where they are many.
fn compare(gpu: &mut GpuStreamer, structure: &Structure, root: u32, queries: &[[u32; 4]]) -> [usize; 3] {
    let start = Instant::now();
    let answered = agree::ask(gpu, root, queries);
    let device_time = start.elapsed();
    let seen = agree::compare(&answered, structure, root, queries);
    if queries.len() > 100_000 {
        let Answered { words, table, .. } = &answered;
        let log2_resolution = structure.record().log2_resolution;
        let pool = Pool { words, table, base: 0, stale: &[], kind: structure.kind(), log2_resolution, skips: None };
        let start = Instant::now();
        let sum = queries.iter().map(|q| u64::from(pool.answer(root, *q)[0])).fold(0, u64::wrapping_add);
        eprintln!("device with reading back {device_time:.1?}, twin on one core {:.1?} (sum {sum})", start.elapsed());
    }
    seen
}

/// All pages, then a part of them in a new streamer.
fn hold(name: &str, structure: &Structure, seed: u64) {
    let headless = device();
    let log2 = structure.record().log2_resolution;
    let mut dice = Dice(seed);
    let queries = queries(&mut dice, log2, 1_000_000);
    for all in [true, false] {
        let start = Instant::now();
        let mut gpu = GpuStreamer::new(&headless.device, &headless.queue, structure, 64 << 20).unwrap();
        fill(&mut gpu, &mut dice, all);
        let stats = gpu.streamer().stats();
        assert_eq!(stats.resident == structure.page_count(), all, "{stats:?}");
        let seen = compare(&mut gpu, structure, 0, &queries);
        assert_eq!(seen[1] == 0, all);
        assert!(seen[0] > 100_000 && seen[2] > 10_000, "{seen:?}");
        eprintln!(
            "{name}: {} of {} pages, exact, by ancestors, outside {seen:?}, {:.1} s",
            stats.resident,
            structure.page_count(),
            start.elapsed().as_secs_f64()
        );
    }
}

#[test]
fn a_million_queries_on_a_random_tree() {
    let (tree, bytes) = random_tree("parity-tree", 5, 10, &[8, 6, 4, 2]);
    let structure = opened(bytes);
    hold("tree", &structure, 17);
    // And the reader's walk is the naive tree's, so the device's is.
    let map = umbrage_reader::query::Map::new(structure).unwrap();
    assert_eq!(map.texel(517, 300, 0).unwrap().value, tree.lookup(10, 517, 300, 0));
}

#[test]
fn a_million_queries_on_random_vector_trees() {
    for (seed, log2, bushy) in [(2, 10, 6), (5, 8, 7)] {
        let (tree, bytes) = random_vector(&format!("parity-vector-{seed}"), seed, log2, bushy);
        let structure = opened(bytes);
        hold("vector tree", &structure, 17);
        let map = umbrage_reader::query::Map::new(structure).unwrap();
        assert_eq!(map.texel(117, 30, 0).unwrap().value, tree.lookup(log2, 117, 30, 0));
    }
}

#[test]
fn a_million_queries_on_random_merged_trees() {
    for (seed, log2) in [(3, 8), (90, 7)] {
        let (tree, bytes) = random_merged(&format!("parity-mmh-{seed}"), seed, log2);
        let structure = opened(bytes);
        hold("merged tree", &structure, 19);
        let map = umbrage_reader::query::Map::new(structure).unwrap();
        assert_eq!(map.texel(17, 30, 0).unwrap().value, tree.lookup(log2, 17, 30, 0));
    }
}

#[test]
fn a_million_queries_on_a_city() {
    hold("city", &opened(shared_city()), 23);
}

#[test]
fn a_million_queries_on_a_merged_city() {
    let folder = crate::tree::Folder::new("parity-merged-city");
    let structure = opened(city_as(&folder.0.join("city.umb"), 2048, Kind::Mmh));
    assert!(structure.record().shared_pages.get() > 0);
    hold("merged city", &structure, 29);
}

/// Cold pages are decoded on their way to the device: all answers are those of the hot file.
#[test]
fn a_cold_city_answers_as_a_hot_one() {
    let headless = device();
    for kind in [Kind::Mh, Kind::Mmh, Kind::Vector] {
        let folder = crate::tree::Folder::new(&format!("parity-cold-{}", kind.name()));
        let [hot, cold] = [false, true].map(|cold| opened(city_with(&folder.0.join("city.umb"), 1024, kind, cold)));
        let is_cold = |o: u32| cold.page_record(o).unwrap().cold_words.get() != 0;
        assert!((0..cold.page_count()).any(is_cold), "{kind:?}");
        let queries = queries(&mut Dice(31), 10, 100_000);
        let answers = [&hot, &cold].map(|structure| {
            let mut gpu = GpuStreamer::new(&headless.device, &headless.queue, structure, 64 << 20).unwrap();
            fill(&mut gpu, &mut Dice(37), true);
            assert_eq!(gpu.streamer().stats().resident, structure.page_count());
            let answered = agree::ask(&mut gpu, 0, &queries);
            assert_eq!(agree::compare(&answered, structure, 0, &queries)[1], 0);
            answered.answers
        });
        assert!(answers[0] == answers[1], "{kind:?}");
    }
}

/// Makes the checksums of a file of one structure and one index block good again.
fn repair(bytes: &mut [u8]) {
    let header = *Header::ref_from_prefix(bytes).unwrap().0;
    let count = header.section_count.get() as usize;
    let sections = <[SectionRecord]>::ref_from_prefix_with_elems(&bytes[Header::BYTES..], count).unwrap().0.to_vec();
    let [structures, index] = [0, 1].map(|i| sections[i].offset.get() as usize);
    let id = header.file_id;
    let mut block = bytes[index..index + 4096].to_vec();
    let records = BlockHeader::ref_from_prefix(&block).unwrap().0.record_count.get() as usize;
    let records = <[PageRecord]>::mut_from_prefix_with_elems(&mut block[64..], records).unwrap().0;
    for (i, r) in (0u32..).zip(records.iter_mut()) {
        let page = &bytes[r.offset.get() as usize..r.end() as usize];
        (r.crc32, r.content_hash) = (page_crc(&id, 0, i, page).into(), content_hash(page).into());
        // Any value may stand in a page here: the test is about walks.
        if !r.is_shared() {
            (r.min_depth, r.max_depth) = (0.into(), u32::MAX.into());
        }
    }
    let crc = block_crc(&id, 0, 0, &block[4..]);
    block[..4].copy_from_slice(&crc.to_le_bytes());
    let first = *PageRecord::ref_from_prefix(&block[64..]).unwrap().0;
    bytes[index..index + 4096].copy_from_slice(&block);
    let s = StructureRecord::mut_from_prefix(&mut bytes[structures..]).unwrap().0;
    s.root_page = first;
    s.crc32 = s.computed_crc(&id, 0).into();
    let crc = header_crc(&header, sections.as_bytes());
    bytes[124..128].copy_from_slice(&crc.to_le_bytes());
}

/// Files whose pages were changed at random and whose checksums are right: pages that pass their checks, next to pages
/// that do not and are missing. Some parents then announce other children than the child page has. Of `rounds` files
/// about one in `every` that has a sound root is asked on the device.
fn garbage(bytes: &[u8], rounds: u32, every: u32, mut change: impl FnMut(&mut Dice, u32) -> u32) -> [u32; 2] {
    let headless = device();
    let first = opened(bytes.to_vec()).page_record(0).unwrap().offset.get() as usize;
    let mut dice = Dice(4);
    let mut kernels = None;
    let (mut changed, mut refused) = (0, 0);
    for _ in 0..rounds {
        let mut bad = bytes.to_vec();
        for _ in 0..=dice.roll(6) {
            let at = first + 4 * dice.roll(((bytes.len() - first) / 4) as u32) as usize;
            let word = change(&mut dice, u32::from_le_bytes(bad[at..at + 4].try_into().unwrap()));
            bad[at..at + 4].copy_from_slice(&word.to_le_bytes());
        }
        repair(&mut bad);
        let Ok(file) = Container::open(std::sync::Arc::new(MemorySource::new(bad.clone(), "bad")), Limits::default())
        else {
            continue;
        };
        let structure = file.structure(0).unwrap();
        let good = (0..structure.page_count()).filter(|&o| structure.page(o).is_ok()).count() as u32;
        // A root is there when the shared pages are that it depends on.
        let needed = structure.dependencies(0).unwrap_or_default();
        if structure.page(0).is_err() || needed.iter().any(|&d| structure.page(d).is_err()) {
            refused += 1;
            let error = GpuStreamer::new(&headless.device, &headless.queue, &structure, 4 << 20);
            assert!(error.is_err(), "a root that breaks a rule");
            continue;
        }
        if bad == bytes || dice.roll(every) != 0 {
            continue;
        }
        changed += u32::from(good == structure.page_count());
        let mut gpu = GpuStreamer::new(&headless.device, &headless.queue, &structure, 4 << 20).unwrap();
        match &kernels {
            None => kernels = Some(gpu.kernels().unwrap()),
            Some(kernels) => gpu.use_kernels(std::sync::Arc::clone(kernels)),
        }
        for _ in 0..5 {
            (0..structure.page_count()).for_each(|o| gpu.streamer_mut().request(o, 1));
            gpu.answer(0, &[[0, 0, 255, 0]]).unwrap();
            while gpu.streamer().is_loading() {
                gpu.streamer_mut().wait(std::time::Duration::from_millis(20));
            }
        }
        compare(&mut gpu, &structure, 0, &every_texel(structure.record().log2_resolution));
    }
    [changed, refused]
}

/// Every texel at every level and beyond.
fn every_texel(log2: u8) -> Vec<[u32; 4]> {
    let side = 1 << log2;
    let texels = |l: u32| (0..side * side).map(move |i| [i % side, i / side, l, i.wrapping_mul(0x9E37_79B9)]);
    (0..=u32::from(log2) + 1).chain([255]).flat_map(texels).collect()
}

#[test]
fn accepted_garbage_gives_the_same_answers() {
    let (_, bytes) = crate::tree::small("parity-garbage");
    let [changed, refused] = garbage(&bytes, 1500, 4, |dice, word| match dice.roll(4) {
        0 => dice.roll(u32::MAX),
        1 => dice.roll(64) << 16 | dice.roll(256),
        2 => dice.roll(4) << 16 | 0x100 | dice.roll(256),
        // A type in a mask: the likeliest to be accepted.
        _ => word ^ 1 << dice.roll(16),
    });
    eprintln!("garbage: {changed} files wholly accepted and compared, {refused} roots refused");
    assert!(changed >= 20 && refused >= 20, "{changed} {refused}");
}

#[test]
fn accepted_vector_garbage_gives_the_same_answers() {
    let (_, bytes) = random_vector("parity-vector-garbage", 12, 4, 7);
    let [changed, refused] = garbage(&bytes, 900, 3, |dice, word| match dice.roll(3) {
        0 => word ^ 1 << dice.roll(32),
        1 => word ^ 1 << dice.roll(32) ^ 1 << dice.roll(32),
        _ => word.rotate_left(dice.roll(32)),
    });
    eprintln!("vector garbage: {changed} files wholly accepted and compared, {refused} roots refused");
    assert!(changed >= 20 && refused >= 20, "{changed} {refused}");
}

#[test]
fn accepted_merged_garbage_gives_the_same_answers() {
    let (_, bytes) = random_merged("parity-mmh-garbage", 12, 4);
    let [changed, refused] = garbage(&bytes, 1200, 3, |dice, word| match dice.roll(4) {
        0 => word ^ 1 << dice.roll(32),
        // Another dependency or another place.
        1 => word & 0xFF | (dice.roll(5) << 8) | (dice.roll(64) << 16),
        2 => word & 0xFFFF | (dice.roll(64) << 16),
        _ => word ^ 1 << dice.roll(16),
    });
    eprintln!("merged garbage: {changed} files wholly accepted and compared, {refused} roots refused");
    assert!(changed >= 20 && refused >= 20, "{changed} {refused}");
}

#[test]
fn golden_files_answer_on_the_device() {
    let headless = device();
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/golden");
    let mut kinds = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_none_or(|e| e != "umb") {
            continue;
        }
        let file = container(std::fs::read(path).unwrap());
        for structure in file.structures().filter(|s| s.kind().has_layout()) {
            let mut gpu = GpuStreamer::new(&headless.device, &headless.queue, &structure, 4 << 20).unwrap();
            fill(&mut gpu, &mut Dice(1), true);
            for root in 0..structure.record().root_count.get() {
                compare(&mut gpu, &structure, root, &every_texel(structure.record().log2_resolution));
            }
            kinds.push(structure.kind());
        }
    }
    assert!([Kind::Mh, Kind::Mmh, Kind::Vector].iter().all(|k| kinds.contains(k)), "{kinds:?}");
}
