//! Golden files with a bit flipped or an end cut off, as a disk or a network may hand them over.
//!
//! Every byte is under a checksum or must be zero, so no flip is accepted in silence: opening refuses it or `verify`
//! reports it, and a lookup that answers all the same answers as before. With all checksums made good behind the flip a
//! file may be accepted: then it can be walked, lazily and preloaded alike, within the depths that its index states.

use rayon::prelude::*;
use umbrage::reader::query::Map;
use umbrage::reader::{Container, Limits};

use crate::golden::samples::{Seal, repair};
use crate::golden::{self, open, points};
use crate::tree::Dice;

/// Files up to this size are tried bit by bit.
const WHOLE: usize = 8 << 10;
/// Bits of a larger file that are tried.
const SAMPLED: u32 = 8192;
/// Maps of larger sides, which a flip can state, are asked at this side.
const MOST_LOG2: u8 = 5;

/// The bits of a file to flip.
fn bits(file: &[u8]) -> Vec<usize> {
    let count = file.len() * 8;
    if file.len() <= WHOLE {
        return (0..count).collect();
    }
    let mut dice = Dice(file.len() as u64);
    (0..SAMPLED).map(|_| dice.roll(count as u32) as usize).collect()
}

fn flipped(file: &[u8], bit: usize) -> Vec<u8> {
    let mut bytes = file.to_vec();
    bytes[bit / 8] ^= 1 << (bit % 8);
    bytes
}

fn faults(file: &Container) -> u64 {
    file.verify(|e| assert!(e.rule().is_some(), "{e}")).faults
}

/// The answers at every texel of every level of every map, none where a lookup fails; each page is asked for, too.
/// What can be preloaded must answer alike.
fn answers(file: &Container) -> Vec<Option<u32>> {
    let mut out = Vec::new();
    for s in file.structures() {
        for ordinal in 0..s.page_count().min(100) {
            let _ = s.page_bytes(ordinal).and_then(|b| b.check_frame()).and_then(|f| f.check_kind());
            let _ = s.dependencies(ordinal);
        }
        let (kind, roots, log2) = (s.kind(), s.record().root_count.get().min(4), s.record().log2_resolution);
        let Ok(map) = Map::new(s) else {
            assert!(!kind.has_layout());
            continue;
        };
        let resident = map.preload().ok();
        for root in 0..roots {
            for (x, y, level) in points(log2.min(MOST_LOG2)) {
                let (x, y) = (x << level, y << level);
                let lazy = map.texel_of(root, x, y, level).map(|a| a.value).ok();
                if let (0, Some(resident)) = (root, &resident) {
                    assert_eq!(lazy, Some(resident.value(x, y, level)), "{x} {y} {level}");
                }
                out.push(lazy);
            }
        }
    }
    out
}

/// Every answer that needs a page lies in the depths of its record. For files without a fault.
fn within_depths(file: &Container) {
    for s in file.structures().filter(|s| s.kind().has_layout()) {
        // Shared pages have no footprint: their groups answer in those of others.
        let pages: Vec<_> = (0..s.record().tree_pages()).map(|i| s.page_record(i).unwrap()).collect();
        let map = Map::new(s).unwrap();
        for (i, r) in pages.iter().enumerate() {
            for (x, y, level) in points(r.log2_x).filter(|p| p.2 <= r.level_coarsest) {
                let (x, y) = (r.origin_x.get() + (x << level), r.origin_y.get() + (y << level));
                let value = map.texel_of(r.root.get().into(), x, y, level).unwrap().value;
                let (min, max) = (r.min_depth.get(), r.max_depth.get());
                assert!((min..=max).contains(&value), "page {i}: {value} at {x} {y} {level}, {min} to {max}");
            }
        }
    }
}

#[test]
fn depths_of_every_page_hold_its_answers() {
    for g in golden::all() {
        within_depths(&open(g.bytes.clone(), Limits::default()).unwrap());
    }
}

#[test]
fn no_flipped_bit_is_accepted_in_silence() {
    for g in golden::all() {
        let expected = answers(&open(g.bytes.clone(), Limits::default()).unwrap());
        let opened = bits(&g.bytes).into_par_iter().filter(|&bit| {
            let at = || format!("{}: byte {} bit {}", g.name, bit / 8, bit % 8);
            let Ok(file) = open(flipped(&g.bytes, bit), Limits::default()) else { return false };
            assert!(faults(&file) > 0, "{}", at());
            for (found, expected) in answers(&file).into_iter().zip(&expected) {
                assert!(found.is_none() || found == *expected, "{}", at());
            }
            true
        });
        // Pages, and index blocks behind the first 16 KiB, are looked at behind opening.
        assert!(opened.count() > 0, "{}", g.name);
    }
}

#[test]
fn no_flipped_bit_with_good_checksums_breaks_a_walk() {
    let mut accepted = 0;
    for g in golden::all() {
        accepted += bits(&g.bytes)
            .into_par_iter()
            .filter(|&bit| {
                let mut bytes = flipped(&g.bytes, bit);
                repair(&mut bytes, Seal::All);
                let Ok(file) = open(bytes, Limits::default()) else { return false };
                let found = answers(&file);
                if faults(&file) > 0 {
                    return false;
                }
                assert!(found.iter().all(Option::is_some), "{}: bit {bit}", g.name);
                within_depths(&file);
                true
            })
            .count();
    }
    // Values, names, statistics: what has more than one right content.
    assert!(accepted > 5000, "{accepted}");
}

#[test]
fn every_cut_is_refused_when_opened() {
    for g in golden::all() {
        (0..g.bytes.len()).into_par_iter().for_each(|n| {
            let error = open(g.bytes[..n].to_vec(), Limits::default()).expect_err("a file that was cut");
            assert!(error.rule().is_some(), "{}: {n} bytes: {error}", g.name);
        });
    }
}
