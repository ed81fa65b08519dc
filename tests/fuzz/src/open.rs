//! Files that nobody promised: arbitrary bytes, or a sound small file with changes, its checksums made good again or
//! not. When a file is accepted, every texel of every level answers, the same lazily and preloaded; when `verify` finds
//! no fault, everything loads.

use std::sync::{Arc, OnceLock};

use umbrage_format::checksum::{block_crc, content_hash, header_crc, page_crc};
use umbrage_format::section::{INDEX, STRUCTURES};
use umbrage_format::{BlockHeader, Header, Kind, PageRecord, SectionRecord, StructureRecord};
use umbrage_reader::query::Map;
use umbrage_reader::{Container, Limits, MemorySource};
use umbrage_writer::container::ContainerOptions;
use zerocopy::{FromBytes, IntoBytes};

use crate::input::Input;
use crate::tree::{Dice, ID, grow, pages, structure, write};
use crate::{mmh_tree, vector_tree};

/// Sound files to change: one leaf, a tree of three levels of pages, two structures; behind them trees of kinds `mmh` and
/// `vector`.
fn bases() -> &'static [Vec<u8>] {
    static BASES: OnceLock<Vec<Vec<u8>>> = OnceLock::new();
    BASES.get_or_init(|| {
        let part = |name: &str, seed, log2, cuts: &[u8], bushy| {
            let pages = pages(&grow(&mut Dice(seed), log2, true, bushy), log2, cuts);
            (structure(name, Kind::Mh, log2, pages.len()), pages)
        };
        let vector = |name: &str, seed, log2, bushy| {
            let mut dice = Dice(seed);
            let pages = vector_tree::pages(&vector_tree::grow(&mut |n| dice.roll(n), log2, true, bushy), log2);
            (structure(name, Kind::Vector, log2, pages.len()), pages)
        };
        // The first from seed 12 on with two shared pages.
        let merged = |name: &str, log2| {
            let made = (12..).map(|seed| {
                let mut dice = Dice(seed);
                mmh_tree::pages(&mmh_tree::grow(&mut |n| dice.roll(n), log2), log2, &[2])
            });
            let (pages, shared) =
                made.into_iter().find(|(p, shared)| *shared == 2 && p.len() > 3).expect("one of them");
            (mmh_tree::structure(name, log2, &pages, shared), pages)
        };
        let options = ContainerOptions::new(ID);
        vec![
            write("fuzz-leaf", options, &[part("sun", 1, 0, &[], 6)]),
            write("fuzz-tree", options, &[part("sun", 7, 3, &[3, 2], 6)]),
            write("fuzz-two", options, &[part("sun", 2, 4, &[2], 6), part("moon", 3, 2, &[], 8)]),
            write("fuzz-mmh", options, &[merged("sun", 4)]),
            write("fuzz-vector", options, &[vector("sun", 12, 4, 7)]),
            write("fuzz-vector-two", options, &[vector("sun", 1, 0, 0), vector("moon", 3, 3, 8)]),
        ]
    })
}

/// Changes a file where there is something to change: fields and words, not the unused part of index blocks.
fn change(file: &mut Vec<u8>, input: &mut Input) {
    let sections = sections(file);
    while !input.is_empty() {
        let (tag, at, value) = (input.byte(), usize::from(input.pair()), input.word());
        let region = usize::from(tag & 7);
        let (start, length) = match region {
            0 => (0, Header::BYTES),
            1 => (Header::BYTES, sections.len() * SectionRecord::BYTES),
            _ => match sections.get(region - 2) {
                Some(s) if s.kind.get() == INDEX => (s.offset.get() as usize, 64 + 64 * 8),
                Some(s) => (s.offset.get() as usize, s.length.get() as usize),
                None => (0, file.len()),
            },
        };
        let at = start.saturating_add(at % length.max(1));
        if at + 4 > file.len() {
            continue;
        }
        let bytes = value.to_le_bytes();
        match tag >> 3 & 7 {
            0 => file[at] = bytes[0],
            1 => file[at] ^= 1 << (bytes[0] & 7),
            2 => file[at] = file[at].wrapping_add(bytes[0]),
            3 => file[at..at + 2].copy_from_slice(&bytes[..2]),
            4 => file[at..at + 4].copy_from_slice(&bytes),
            // a record in another's place
            5 => {
                let from = start + usize::from(bytes[0]) * 4;
                let n = usize::from(bytes[1] & 63).min(file.len() - at);
                if from + n <= file.len() {
                    file.copy_within(from..from + n, at);
                }
            }
            6 => file.truncate(at),
            _ => file.extend_from_slice(&bytes),
        }
    }
}

fn sections(file: &[u8]) -> Vec<SectionRecord> {
    let Ok((header, rest)) = Header::read_from_prefix(file) else { return Vec::new() };
    let count = header.section_count.get().min(64) as usize;
    <[SectionRecord]>::ref_from_prefix_with_elems(rest, count).map(|(t, _)| t.to_vec()).unwrap_or_default()
}

/// Makes every checksum good again, as far as the bytes still say where they are, from the pages up to the header.
fn repair(file: &mut [u8]) {
    let Ok((mut header, _)) = Header::read_from_prefix(file) else { return };
    header.total_bytes = (file.len() as u64).into();
    let (id, sections) = (header.file_id, sections(file));
    let range = |start: u64, length: u64| {
        let (start, length) = (usize::try_from(start).ok()?, usize::try_from(length).ok()?);
        Some(start..start.checked_add(length)?).filter(|r| r.end <= file.len())
    };
    let records = sections.iter().find(|s| s.kind.get() == STRUCTURES).map_or(0, |s| s.offset.get());
    let indices: Vec<_> = sections.iter().filter(|s| s.kind.get() == INDEX).collect();
    let mut done = file.to_vec();
    for (i, index) in (0u32..).zip(indices) {
        let at = records + u64::from(i) * StructureRecord::BYTES as u64;
        let Some(at) = range(at, StructureRecord::BYTES as u64) else { continue };
        let Ok(mut record) = StructureRecord::read_from_bytes(&file[at.clone()]) else { continue };
        let per_block = record.records_per_block.get().min(64);
        if !(12..=16).contains(&record.index_block_log2) {
            record.crc32 = record.computed_crc(&id, i).into();
            done[at].copy_from_slice(record.as_bytes());
            continue;
        }
        for number in 0..record.page_count.get().div_ceil(per_block.max(1).into()).min(8) {
            let length = 1u64 << record.index_block_log2;
            let Some(block) = range(index.offset.get() + u64::from(number) * length, length) else { break };
            let mut bytes = file[block.clone()].to_vec();
            let Ok((head, rest)) = BlockHeader::read_from_prefix(&bytes) else { break };
            let count = head.record_count.get().min(per_block.into()) as usize;
            let Ok((old, _)) = <[PageRecord]>::ref_from_prefix_with_elems(rest, count) else { break };
            let mut pages = old.to_vec();
            for (ordinal, page) in (number * u32::from(per_block)..).zip(&mut pages) {
                let Some(words) = range(page.offset.get(), page.stored_bytes()) else { continue };
                page.crc32 = page_crc(&id, i, ordinal, &file[words.clone()]).into();
                page.content_hash = content_hash(&file[words]).into();
            }
            if let (0, Some(first)) = (number, pages.first()) {
                record.root_page = *first;
            }
            bytes[BlockHeader::BYTES..][..pages.as_bytes().len()].copy_from_slice(pages.as_bytes());
            let crc = block_crc(&id, i, number, &bytes[4..]);
            bytes[..4].copy_from_slice(&crc.to_le_bytes());
            done[block].copy_from_slice(&bytes);
        }
        record.crc32 = record.computed_crc(&id, i).into();
        done[at].copy_from_slice(record.as_bytes());
    }
    // Only whole tables; a header that asks for more is refused before its checksum.
    header.crc32 = header_crc(&header, sections.as_bytes()).into();
    done[..Header::BYTES].copy_from_slice(header.as_bytes());
    file.copy_from_slice(&done);
}

/// Texels of a side worth asking: all of a small map, both ends of a large one.
pub fn steps(side: u32) -> impl Iterator<Item = u32> + Clone {
    (0..side.min(16)).chain(side.saturating_sub(4).max(16)..side)
}

fn ask(file: &Container) {
    let mut faults = 0;
    file.verify(|_| faults += 1);
    for s in file.structures() {
        let supported = s.kind().has_layout();
        let map = match Map::new(s) {
            Ok(map) => map,
            Err(e) => {
                assert!(faults > 0 || !supported, "verified, but no map: {e}");
                continue;
            }
        };
        let resident = map.preload();
        assert!(faults > 0 || resident.is_ok(), "verified, but not loaded: {:?}", resident.err());
        let (roots, top) = (map.structure().record().root_count.get(), map.resolution().ilog2() as u8);
        for level in (0..=top).chain([31, 255]) {
            for (x, y) in steps(map.resolution()).flat_map(|y| steps(map.resolution()).map(move |x| (x, y))) {
                let lazy = map.texel(x, y, level);
                if let Ok(resident) = &resident {
                    let lazy = lazy.expect("all pages are loaded");
                    assert_eq!(lazy.value, resident.value(x, y, level), "texel {x} {y} level {level}");
                    assert!(lazy.level >= level.min(top) && lazy.level <= top);
                }
            }
            if roots > 1 {
                let _ = map.texel_of(roots - 1, 0, 0, level);
            }
        }
    }
}

/// The file that an input stands for: a byte that says what the others are.
pub fn file(data: &[u8]) -> Vec<u8> {
    let mut input = Input(data);
    let mode = input.byte();
    let mut file;
    if mode & 1 == 0 {
        file = input.0.to_vec();
    } else {
        let bases = bases();
        file = bases[usize::from(mode >> 2) % bases.len()].clone();
        change(&mut file, &mut input);
    }
    if mode & 2 != 0 {
        repair(&mut file);
    }
    file
}

/// Opens it with small limits.
pub fn container(data: &[u8]) -> Option<Container> {
    let limits = Limits { sections: 64, structures: 8, pages: 1 << 12, page_bytes: 1 << 16, allocation: 1 << 22 };
    Container::open(Arc::new(MemorySource::new(file(data), "input")), limits).ok()
}

/// One input.
pub fn run(data: &[u8]) {
    if let Some(container) = container(data) {
        ask(&container);
    }
}
