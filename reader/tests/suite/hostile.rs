//! Bytes that nobody promised: truncations, flipped bits, flipped bits with all checksums made good again, and
//! breaches made by hand. Nothing panics or loops; what is accepted answers every texel, lazily and resident alike.

use umbrage_format::checksum::{SectionCrc, block_crc, content_hash, header_crc, page_crc};
use umbrage_format::section::PAGES;
use umbrage_format::{BlockHeader, Header, PageRecord, Rule, SectionRecord, StructureRecord};
use umbrage_reader::query::Map;
use umbrage_reader::{Container, Limits, ReaderError};
use zerocopy::{FromBytes, IntoBytes};

use crate::tree::{ID, open, small};
use Breach::{Put, Raw};

/// Asks everything that can be asked; the answers of the lazy and the resident map must agree.
fn exercise(file: &Container) {
    for s in file.structures() {
        for ordinal in 0..s.page_count().min(100) {
            let _ = s.page_bytes(ordinal).and_then(|b| b.check_frame()).and_then(|f| f.check_kind());
            let _ = s.dependencies(ordinal);
        }
        let Ok(map) = Map::new(s) else { continue };
        let resident = map.preload().ok();
        let side = map.resolution().min(8);
        for level in [0, 1, 2, 3, 9, 255] {
            for (x, y) in (0..side).flat_map(|y| (0..side).map(move |x| (x, y))) {
                let answer = map.texel(x, y, level);
                if let (Ok(answer), Some(resident)) = (answer, &resident) {
                    assert_eq!(answer.value, resident.value(x, y, level));
                }
            }
        }
    }
}

fn faults(file: &Container) -> Vec<ReaderError> {
    let mut faults = Vec::new();
    file.verify(|e| faults.push(e));
    faults
}

#[test]
fn every_truncation_is_refused_when_opened() {
    let (_, bytes) = small("truncation");
    for n in 0..bytes.len() {
        let error = open(bytes[..n].to_vec()).expect_err("a truncated file");
        assert!(error.rule().is_some(), "{n}: {error}");
    }
    let mut longer = bytes;
    longer.push(0);
    assert_eq!(open(longer).unwrap_err().rule().map(|r| r.id()), Some("header.length"));
}

#[test]
fn every_flipped_bit_is_found() {
    let (_, bytes) = small("flips");
    for bit in 0..bytes.len() * 8 {
        let mut bad = bytes.clone();
        bad[bit / 8] ^= 1 << (bit % 8);
        let Ok(file) = open(bad) else { continue };
        exercise(&file);
        assert!(!faults(&file).is_empty(), "byte {} bit {}", bit / 8, bit % 8);
    }
}

/// Makes every checksum of a file of one `small` structure good again, as far as the bytes still say where they are.
fn repair(bytes: &mut [u8]) {
    let (header, sections) = {
        let header = *Header::ref_from_prefix(bytes).unwrap().0;
        let count = (header.section_count.get() as usize).min(8);
        let table = <[SectionRecord]>::ref_from_prefix_with_elems(&bytes[Header::BYTES..], count).unwrap().0;
        (header, table.to_vec())
    };
    let id = header.file_id;
    let at = |n: usize| sections.get(n).map_or(usize::MAX, |s| s.offset.get() as usize);
    let whole = bytes.to_vec();
    let range = |start: usize, length: usize| whole.get(start..start.checked_add(length)?);
    if let Some(block) = range(at(1), 4096) {
        let mut block = block.to_vec();
        let count = (BlockHeader::ref_from_prefix(&block).unwrap().0.record_count.get() as usize).min(63);
        let records = <[PageRecord]>::mut_from_prefix_with_elems(&mut block[64..], count).unwrap().0;
        for (i, r) in records.iter_mut().enumerate() {
            if let Some(page) = range(r.offset.get() as usize, r.stored_bytes() as usize) {
                r.crc32 = page_crc(&id, 0, i as u32, page).into();
                r.content_hash = content_hash(page).into();
            }
        }
        let crc = block_crc(&id, 0, 0, &block[4..]);
        block[..4].copy_from_slice(&crc.to_le_bytes());
        let first = *PageRecord::ref_from_prefix(&block[64..]).unwrap().0;
        bytes[at(1)..at(1) + 4096].copy_from_slice(&block);
        if range(at(0), StructureRecord::BYTES).is_some() {
            let s = StructureRecord::mut_from_prefix(&mut bytes[at(0)..]).unwrap().0;
            s.root_page = first;
            s.crc32 = s.computed_crc(&id, 0).into();
        }
    }
    let crc = header_crc(&header, sections.as_bytes());
    bytes[124..128].copy_from_slice(&crc.to_le_bytes());
}

#[test]
fn every_flipped_bit_with_good_checksums_is_safe() {
    let (_, bytes) = small("repaired");
    let mut unchanged = bytes.clone();
    repair(&mut unchanged);
    assert_eq!(unchanged, bytes);
    let (mut opened, mut accepted) = (0, 0);
    for bit in 0..bytes.len() * 8 {
        let mut bad = bytes.clone();
        bad[bit / 8] ^= 1 << (bit % 8);
        repair(&mut bad);
        let Ok(file) = open(bad) else { continue };
        opened += 1;
        exercise(&file);
        accepted += usize::from(faults(&file).is_empty());
    }
    // Values, names and counts may change; most structure may not.
    assert!(accepted > 500 && accepted < opened, "{accepted} of {opened}");
}

/// Random words behind a frame that agrees with the index.
#[test]
fn pages_of_random_words_are_safe() {
    let (_, bytes) = small("random");
    let mut dice = crate::tree::Dice(99);
    let pages = open(bytes.clone()).unwrap().sections()[2].offset.get() as usize;
    for _ in 0..20_000 {
        let mut bad = bytes.clone();
        for _ in 0..=dice.roll(4) {
            let at = pages + 4 * dice.roll(((bytes.len() - pages) / 4) as u32) as usize;
            let word = match dice.roll(3) {
                0 => dice.roll(u32::MAX),
                1 => dice.roll(64) << 16 | dice.roll(512),
                _ => dice.roll(16) << 16 | 0x100 | dice.roll(256),
            };
            bad[at..at + 4].copy_from_slice(&word.to_le_bytes());
        }
        repair(&mut bad);
        if let Ok(file) = open(bad) {
            exercise(&file);
            faults(&file);
        }
    }
}

/// A change of one byte, and whether the checksums are made good behind it.
#[derive(Clone, Copy)]
enum Breach {
    Put(usize, u8),
    Raw(usize, u8),
}
/// First bytes of the structure record, the index, its records and the pages in a `small` file.
const STRUCTURE: usize = 256;
const INDEX: usize = STRUCTURE + 512;
const RECORD: usize = INDEX + 64;
const PAGE: usize = INDEX + 4096;

/// Rules and a byte that breaks each, and it alone.
const BREACHES: &[(&str, Breach)] = &[
    ("header.magic", Put(0, b'U')),
    ("header.version", Put(8, 2)),
    ("header.size", Put(12, 0)),
    ("header.length", Put(16, 0)),
    ("header.feature", Put(40, 4)),
    ("header.alignment", Put(56, 17)),
    ("header.reserved", Put(57, 1)),
    ("header.truncated", Put(63, 1)),
    ("header.crc", Raw(48, 1)),
    ("section.missing", Put(64, 2)),
    ("section.trailing", Put(60, 2)),
    ("section.flags", Put(128 + 4, 2)),
    ("section.unknown", Put(128 + 40, 9)),
    ("section.order", Put(128 + 40, 1)),
    ("section.structure", Put(128 + 40 + 8, 1)),
    ("section.crc-field", Put(128 + 40 + 12, 1)),
    ("section.offset", Put(128 + 40 + 16, 1)),
    ("section.length", Put(128 + 80 + 24 + 3, 0x7F)),
    ("section.reserved", Put(128 + 32, 1)),
    ("section.padding", Put(250, 1)),
    ("structure.crc", Raw(STRUCTURE, b'r')),
    ("structure.name", Put(STRUCTURE, 0)),
    ("structure.name", Put(STRUCTURE, 0xFF)),
    ("structure.kind", Put(STRUCTURE + 256, 8)),
    ("structure.projection", Put(STRUCTURE + 260, 2)),
    ("structure.policy", Put(STRUCTURE + 264, 0)),
    ("structure.policy", Put(STRUCTURE + 264, 9)),
    ("structure.guarantee", Put(STRUCTURE + 268, 5)),
    ("structure.promise", Put(STRUCTURE + 268, 2)),
    ("structure.promise", Put(STRUCTURE + 264, 4)),
    // The fixture's geometry promises everywhere, which depth layers can't.
    ("structure.promise", Put(STRUCTURE + 264, 6)),
    ("structure.promise", Put(STRUCTURE + 264, 7)),
    ("structure.roots", Put(STRUCTURE + 272, 0)),
    ("structure.pages", Put(STRUCTURE + 276, 0)),
    ("structure.block", Put(STRUCTURE + 288, 64)),
    ("structure.block", Put(STRUCTURE + 290, 11)),
    ("structure.resolution", Put(STRUCTURE + 291, 25)),
    ("structure.resolution", Put(STRUCTURE + 292, 46)),
    ("structure.light", Put(STRUCTURE + 160 + 7, 0x40)),
    ("structure.guard", Put(STRUCTURE + 192 + 7, 0x40)),
    ("structure.parameter", Put(STRUCTURE + 264, 3)),
    ("structure.parameter", Put(STRUCTURE + 200, 1)),
    ("structure.reserved", Put(STRUCTURE + 300, 1)),
    ("structure.nodes", Put(STRUCTURE + 224, 0)),
    ("structure.nodes", Put(STRUCTURE + 240 + 7, 1)),
    ("index.length", Put(STRUCTURE + 288, 1)),
    ("index.crc", Raw(INDEX + 4095, 1)),
    ("index.head", Put(INDEX + 12, 1)),
    ("index.reserved", Put(INDEX + 30, 1)),
    ("index.unused", Put(INDEX + 4095, 1)),
    ("index.page-type", Put(RECORD + 64 + 63, 2)),
    ("index.page-type", Put(RECORD + 64 + 63, 16)),
    ("index.words", Put(RECORD + 64 + 51, 0xFF)),
    ("index.offset", Put(RECORD + 64 + 1, 0xFF)),
    ("index.children", Put(RECORD + 64 + 20, 1)),
    ("index.root", Put(RECORD + 64 + 46, 1)),
    ("index.footprint", Put(RECORD + 64 + 58, 4)),
    ("index.levels", Put(RECORD + 64 + 62, 4)),
    ("index.depths", Put(RECORD + 64 + 35, 0xFF)),
    ("index.dependency", Put(RECORD + 64 + 56, 1)),
    ("page.crc", Raw(PAGE + 12, 1)),
    ("page.tag", Put(PAGE, 2)),
    ("page.children", Put(PAGE + 2, 9)),
    ("page.length", Put(PAGE + 4, 1)),
    ("page.level", Put(PAGE + 6, 2)),
    ("page.flags", Put(PAGE + 7, 1)),
    ("mh.root", Put(PAGE + 1, 3)),
    ("mh.place", Put(PAGE + 9, 2)),
    ("mh.childless", Put(PAGE + 8, 0)),
];

/// Rules whose breach needs more than a byte of the `small` file, and the test that has it.
const ELSEWHERE: &[(&str, &str)] = &[
    ("section.crc", "an_unknown_optional_section_is_skipped_and_verified"),
    ("structure.unique", "breaches_of_more_than_a_byte_are_named"),
    ("structure.number", "breaches_of_more_than_a_byte_are_named"),
    ("structure.transform", "breaches_of_more_than_a_byte_are_named"),
    ("structure.root", "breaches_of_more_than_a_byte_are_named"),
    ("page.padding", "breaches_of_more_than_a_byte_are_named"),
    ("page.hash", "breaches_of_more_than_a_byte_are_named"),
    ("cold.model", "tests/suite/cold.rs: a_damaged_cold_page_is_named_with_its_rule"),
    ("page.cold", "breaches_of_more_than_a_byte_are_named"),
    ("index.shared", "later::shared_pages_have_no_footprint"),
    ("mh.link", "a_child_in_the_wrong_place_is_found_by_preload_and_verify"),
    ("mh.depths", "format: depths_of_a_child_page_hold_what_it_can_answer"),
    ("mh.plain", "format: every_breach_is_named"),
    ("mh.footprint", "format: every_breach_is_named"),
    ("mh.bounds", "format: every_breach_is_named"),
    ("mh.overlap", "format: every_breach_is_named"),
    ("mh.depth", "format: every_breach_is_named"),
    ("mh.order", "format: every_breach_is_named"),
    ("mh.reference", "format: every_breach_is_named"),
    ("mh.hole", "format: every_breach_is_named"),
    ("mh.levels", "format: every_breach_is_named"),
    ("mh.values", "format: every_breach_is_named"),
    ("mmh.plain", "the samples of the workspace's suite"),
    ("mmh.root", "the samples of the workspace's suite"),
    ("mmh.footprint", "the samples of the workspace's suite"),
    ("mmh.entries", "the samples of the workspace's suite"),
    ("mmh.hole", "the samples of the workspace's suite"),
    ("mmh.bounds", "the samples of the workspace's suite"),
    ("mmh.childless", "the samples of the workspace's suite"),
    ("mmh.depth", "the samples of the workspace's suite"),
    ("mmh.order", "the samples of the workspace's suite"),
    ("mmh.overlap", "the samples of the workspace's suite"),
    ("mmh.reference", "the samples of the workspace's suite"),
    ("mmh.dependency", "the samples of the workspace's suite"),
    ("mmh.levels", "the samples of the workspace's suite"),
    ("mmh.values", "the samples of the workspace's suite"),
    ("mmh.link", "the samples of the workspace's suite"),
    ("mmh.depths", "the samples of the workspace's suite"),
    ("vector.plain", "the samples of the workspace's suite"),
    ("vector.root", "the samples of the workspace's suite"),
    ("vector.footprint", "the samples of the workspace's suite"),
    ("vector.header", "the samples of the workspace's suite"),
    ("vector.length", "the samples of the workspace's suite"),
    ("vector.ranks", "the samples of the workspace's suite"),
    ("vector.order", "the samples of the workspace's suite"),
    ("vector.stubs", "the samples of the workspace's suite"),
    ("vector.depth", "the samples of the workspace's suite"),
    ("vector.padding", "the samples of the workspace's suite"),
    ("vector.levels", "the samples of the workspace's suite"),
    ("vector.line", "the samples of the workspace's suite"),
    ("vector.plane", "the samples of the workspace's suite"),
    ("vector.split", "the samples of the workspace's suite"),
    ("vector.mask", "the samples of the workspace's suite"),
    ("vector.raw", "the samples of the workspace's suite"),
    ("vector.index", "the samples of the workspace's suite"),
    ("vector.values", "the samples of the workspace's suite"),
    ("vector.link", "the samples of the workspace's suite"),
    ("vector.depths", "the samples of the workspace's suite"),
    ("limit.sections", "limits_are_held"),
    ("limit.structures", "limits_are_held"),
    ("limit.pages", "limits_are_held"),
    ("limit.page-bytes", "limits_are_held"),
    ("limit.allocation", "limits_are_held"),
];

/// Ids of the rules that a file breaks.
fn broken(bytes: Vec<u8>) -> Vec<&'static str> {
    match open(bytes) {
        Err(e) => e.rule().map(|r| r.id()).into_iter().collect(),
        Ok(file) => faults(&file).iter().filter_map(|e| e.rule()).map(|r| r.id()).collect(),
    }
}

#[test]
fn breaches_are_named() {
    let (_, bytes) = small("breaches");
    for (rule, breach) in BREACHES {
        let mut bytes = bytes.clone();
        match *breach {
            Raw(at, byte) => bytes[at] = byte,
            Put(at, byte) => {
                bytes[at] = byte;
                repair(&mut bytes);
            }
        }
        assert_eq!(broken(bytes), [*rule]);
    }
}

#[test]
fn every_rule_has_a_breach() {
    let covered: Vec<_> = BREACHES.iter().map(|b| b.0).chain(ELSEWHERE.iter().map(|e| e.0)).collect();
    for rule in Rule::ALL {
        assert!(covered.contains(&rule.id()), "{}", rule.id());
    }
    for id in covered {
        assert!(Rule::ALL.iter().any(|r| r.id() == id), "{id}");
    }
}

#[test]
fn breaches_of_more_than_a_byte_are_named() {
    let (_, bytes) = small("more-breaches");
    let change = |f: &dyn Fn(&mut Vec<u8>)| {
        let mut bytes = bytes.clone();
        f(&mut bytes);
        broken(bytes)
    };
    let structure = |b: &mut Vec<u8>, f: &dyn Fn(&mut StructureRecord)| {
        let s = StructureRecord::mut_from_prefix(&mut b[STRUCTURE..]).unwrap().0;
        f(s);
        s.crc32 = s.computed_crc(&ID, 0).into();
    };
    let nan = |b: &mut Vec<u8>| structure(b, &|s| s.light_direction[1] = f64::NAN.into());
    assert_eq!(change(&nan), ["structure.number"]);
    let flat = |b: &mut Vec<u8>| structure(b, &|s| s.world_to_lattice[0] = 0.0.into());
    assert_eq!(change(&flat), ["structure.transform"]);
    let root = |b: &mut Vec<u8>| structure(b, &|s| s.root_page.stop_error = 7.into());
    assert_eq!(change(&root), ["structure.root"]);
    let cold = |b: &mut Vec<u8>| {
        (b[RECORD + 52], b[RECORD + 53]) = (b[RECORD + 50], b[RECORD + 51]);
        repair(b);
    };
    assert_eq!(change(&cold), ["page.cold"]);
    let hash = |b: &mut Vec<u8>| {
        b[RECORD + 64 + 8] ^= 1;
        let crc = block_crc(&ID, 0, 0, &b[INDEX + 4..PAGE]);
        b[INDEX..INDEX + 4].copy_from_slice(&crc.to_le_bytes());
    };
    assert_eq!(change(&hash), ["page.hash"]);
    let padding = |b: &mut Vec<u8>| {
        let second = PageRecord::ref_from_prefix(&b[RECORD + 64..]).unwrap().0.offset.get() as usize;
        b[second - 1] = 1;
    };
    assert_eq!(change(&padding), ["page.padding"]);

    let pages = crate::tree::pages(&crate::tree::Naive::Leaf(5), 0, &[]);
    let part = |name: &str| (crate::tree::structure(name, umbrage_format::Kind::Mh, 0, 1), pages.clone());
    let options = umbrage_writer::container::ContainerOptions::new(ID);
    let mut twins = crate::tree::write("twins", options, &[part("a"), part("b")]);
    let start = (128 + 5 * 40usize).next_multiple_of(64) + 512;
    let s = StructureRecord::mut_from_prefix(&mut twins[start..]).unwrap().0;
    s.name[0] = b'a';
    s.crc32 = s.computed_crc(&ID, 1).into();
    assert_eq!(broken(twins), ["structure.unique"]);
}

/// Puts an optional section of an unknown type and `length` bytes between index and pages of a `small` file. Gives the
/// bytes up to the section, the section's record, where the pages then lie, and the pages.
fn with_unknown(bytes: &[u8], length: u64, crc: u32) -> (Vec<u8>, SectionRecord, u64, Vec<u8>) {
    let mut header = *Header::ref_from_prefix(bytes).unwrap().0;
    let mut table = <[SectionRecord]>::ref_from_prefix_with_elems(&bytes[128..], 3).unwrap().0.to_vec();
    // One record more moves all that follows by one step of the alignment.
    let shift = 64;
    let mut extra = SectionRecord::zeroed();
    (extra.kind, extra.structure, extra.crc32) = (77.into(), u32::MAX.into(), crc.into());
    (extra.offset, extra.length) = ((PAGE as u64 + shift).into(), length.into());
    let pages_at = extra.end().next_multiple_of(64);
    let moved = pages_at - PAGE as u64;
    for (s, by) in table.iter_mut().zip([shift, shift, moved]) {
        s.offset = (s.offset.get() + by).into();
    }
    table.insert(2, extra);
    header.section_count = 4.into();
    header.total_bytes = (header.total_bytes.get() + moved).into();
    header.crc32 = header_crc(&header, table.as_bytes()).into();
    let mut head = [header.as_bytes(), table.as_bytes()].concat();
    head.resize(STRUCTURE + shift as usize, 0);
    head.extend(&bytes[STRUCTURE..PAGE]);
    let index = INDEX + shift as usize;
    let count = BlockHeader::ref_from_prefix(&head[index..]).unwrap().0.record_count.get() as usize;
    let records = <[PageRecord]>::mut_from_prefix_with_elems(&mut head[index + 64..], count).unwrap().0;
    for r in records.iter_mut() {
        r.offset = (r.offset.get() + moved).into();
    }
    let first = records[0];
    let crc = block_crc(&ID, 0, 0, &head[index + 4..index + 4096]);
    head[index..index + 4].copy_from_slice(&crc.to_le_bytes());
    let s = StructureRecord::mut_from_prefix(&mut head[STRUCTURE + shift as usize..]).unwrap().0;
    s.root_page = first;
    s.crc32 = s.computed_crc(&ID, 0).into();
    (head, extra, pages_at, bytes[PAGE..].to_vec())
}

#[test]
fn an_unknown_optional_section_is_skipped_and_verified() {
    let (tree, bytes) = small("unknown");
    let mut crc = SectionCrc::default();
    crc.update(b"later");
    let (mut file, extra, pages_at, pages) = with_unknown(&bytes, 5, crc.finish());
    file.extend(b"later");
    file.resize(pages_at as usize, 0);
    file.extend(pages);
    let opened = open(file.clone()).unwrap();
    assert_eq!(opened.sections()[3].kind.get(), PAGES);
    assert!(faults(&opened).is_empty(), "{:?}", faults(&opened));
    let map = Map::new(opened.structure(0).unwrap()).unwrap();
    assert_eq!(map.texel(3, 4, 0).unwrap().value, tree.lookup(3, 3, 4, 0));

    let mut bad = file.clone();
    bad[extra.offset.get() as usize] ^= 1;
    assert_eq!(broken(bad), ["section.crc"]);
    // The same section flagged as required is refused by number.
    file[128 + 2 * 40 + 4] = 1;
    let header = *Header::ref_from_prefix(&file).unwrap().0;
    let crc = header_crc(&header, &file[128..128 + 4 * 40]);
    file[124..128].copy_from_slice(&crc.to_le_bytes());
    let error = open(file).unwrap_err();
    assert_eq!(error.rule().map(|r| r.id()), Some("section.unknown"));
    assert!(error.to_string().contains("77"));
}

/// Pages behind 5 GiB, in a sparse file.
#[test]
fn nothing_ends_at_4_gib() {
    use std::io::{Seek, SeekFrom, Write};
    let (tree, bytes) = small("sparse");
    let (head, _, pages_at, pages) = with_unknown(&bytes, 5 << 30, 0);
    let folder = crate::tree::Folder::new("sparse-read");
    let path = folder.0.join("big.umb");
    let mut file = std::fs::File::create(&path).unwrap();
    file.write_all(&head).unwrap();
    file.seek(SeekFrom::Start(pages_at)).unwrap();
    file.write_all(&pages).unwrap();
    drop(file);
    let source = umbrage_reader::FileSource::open(&path).unwrap();
    let file = Container::open(std::sync::Arc::new(source), Limits::default()).unwrap();
    let map = Map::new(file.structure(0).unwrap()).unwrap();
    for (x, y) in (0..8).flat_map(|y| (0..8).map(move |x| (x, y))) {
        let answer = map.texel(x, y, 0).unwrap();
        assert_eq!(answer.value, tree.lookup(3, x, y, 0));
        assert!(map.page(answer.page).unwrap().record().offset.get() > 1 << 32);
    }
}

#[test]
fn a_page_or_block_of_another_place_is_refused() {
    let (_, bytes) = small("moved");
    let mut bad = bytes.clone();
    let mut header = *Header::ref_from_prefix(&bytes).unwrap().0;
    header.file_id[0] ^= 1;
    header.crc32 = header_crc(&header, &bytes[128..248]).into();
    bad[..128].copy_from_slice(header.as_bytes());
    assert_ne!(header.file_id, ID);
    assert_eq!(open(bad).unwrap_err().rule().map(|r| r.id()), Some("structure.crc"));
}

/// A child page that is whole, but not the one its parent's node describes.
#[test]
fn a_child_in_the_wrong_place_is_found_by_preload_and_verify() {
    let (_, mut bytes) = small("link");
    let third = PageRecord::ref_from_prefix(&bytes[RECORD + 128..]).unwrap().0;
    // From the lower to the upper half of the map, or back: still a square inside it.
    let (size, y) = (1u32 << third.log2_y, third.origin_y.get());
    bytes[RECORD + 128 + 28..][..4].copy_from_slice(&(y ^ size).to_le_bytes());
    repair(&mut bytes);
    assert_eq!(broken(bytes.clone()).first(), Some(&"mh.link"));
    let map = Map::new(open(bytes).unwrap().structure(0).unwrap()).unwrap();
    assert_eq!(map.preload().unwrap_err().rule().map(|r| r.id()), Some("mh.link"));
}

/// A child page whose depths miss the inherited value, or reach beyond the parent's.
#[test]
fn depths_that_do_not_hold_every_answer_are_found_by_preload_and_verify() {
    let (_, good) = small("depths");
    let at = |ordinal: usize| RECORD + 64 * ordinal;
    let record = |ordinal: usize| *PageRecord::ref_from_prefix(&good[at(ordinal)..]).unwrap().0;
    let count = BlockHeader::ref_from_prefix(&good[INDEX..]).unwrap().0.record_count.get() as usize;
    let last = count - 1;
    // Beyond the parent's depths, which are the map's, and for a page of the second level its own parent's.
    for (ordinal, min, max) in [(1, 0, record(1).max_depth.get()), (last, record(last).min_depth.get(), u32::MAX)] {
        let mut bytes = good.clone();
        let r = PageRecord::mut_from_prefix(&mut bytes[at(ordinal)..]).unwrap().0;
        (r.min_depth, r.max_depth) = (min.into(), max.into());
        repair(&mut bytes);
        assert_eq!(broken(bytes.clone()), ["mh.depths"], "page {ordinal}");
        let map = Map::new(open(bytes).unwrap().structure(0).unwrap()).unwrap();
        assert_eq!(map.preload().unwrap_err().rule().map(|r| r.id()), Some("mh.depths"));
    }
}

/// Pages below a page that is lost are not held against it, nor are counts of nodes.
#[test]
fn a_lost_page_is_reported_alone() {
    let (_, good) = small("lost");
    for ordinal in 0..3 {
        let mut bytes = good.clone();
        let r = PageRecord::ref_from_prefix(&good[RECORD + 64 * ordinal..]).unwrap().0;
        bytes[r.offset.get() as usize + 8] ^= 1;
        assert_eq!(broken(bytes), ["page.crc"], "page {ordinal}");
    }
}

/// Neighbouring index blocks are held against each other in whatever order lookups touch them.
#[test]
fn blocks_that_do_not_meet_are_refused_in_any_order() {
    let (log2, block) = (3, 4096);
    let pages = crate::tree::pages(&crate::tree::grow(&mut crate::tree::Dice(7), log2, true, 6), log2, &[3, 2]);
    let mut sun = crate::tree::structure("sun", umbrage_format::Kind::Mh, log2, pages.len());
    (sun.records_per_block, sun.index_block_log2) = (1.into(), 12);
    let options = umbrage_writer::container::ContainerOptions::new(ID);
    let mut bytes = crate::tree::write("blocks", options, &[(sun, pages)]);
    // The second page takes the space of the third as well.
    let record = PageRecord::mut_from_prefix(&mut bytes[INDEX + block + 64..]).unwrap().0;
    record.hot_words = (record.hot_words.get() + 16).into();
    let crc = block_crc(&ID, 0, 1, &bytes[INDEX + block + 4..INDEX + 2 * block]);
    bytes[INDEX + block..][..4].copy_from_slice(&crc.to_le_bytes());
    for order in [[1, 2], [2, 1]] {
        let s = open(bytes.clone()).unwrap().structure(0).unwrap();
        let found = order.map(|ordinal| s.page_record(ordinal).err().and_then(|e| e.rule()).map(|r| r.id()));
        assert_eq!(found, [None, Some("index.offset")], "{order:?}");
    }
}

#[test]
fn limits_are_held() {
    let (_, bytes) = small("limits");
    let with = |limits| {
        let source = umbrage_reader::MemorySource::new(bytes.clone(), "limited.umb");
        Container::open(std::sync::Arc::new(source), limits)
    };
    let full = Limits::default();
    let rule = |r: Result<Container, ReaderError>| r.unwrap_err().rule().map(|r| r.id());
    assert_eq!(rule(with(Limits { sections: 2, ..full })), Some("limit.sections"));
    assert_eq!(rule(with(Limits { structures: 0, ..full })), Some("limit.structures"));
    assert_eq!(rule(with(Limits { pages: 2, ..full })), Some("limit.pages"));
    assert_eq!(rule(with(Limits { allocation: 100, ..full })), Some("limit.allocation"));
    let page = with(Limits { page_bytes: 8, ..full }).unwrap().structure(0).unwrap().page_bytes(0).unwrap_err();
    assert_eq!(page.rule().map(|r| r.id()), Some("limit.page-bytes"));
}
