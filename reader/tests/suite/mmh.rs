//! Kind `mmh`: what was written is read back and answers as the naive tree does, page by page and all at once.

use umbrage_format::Rule;
use umbrage_reader::query::Map;
use umbrage_writer::container::{ContainerOptions, ContainerWriter, WriteError};

use crate::mmh_tree::{Piece, grow, pages, structure};
use crate::tree::{Dice, Folder, ID, open, write};

/// A tree whose pages are of every sort: child pages and two shared ones.
fn tree(seed: u64, log2: u8, cuts: &[u8]) -> (Piece, Vec<umbrage_writer::container::PageInput>, u32) {
    (seed..)
        .map(|seed| {
            let mut dice = Dice(seed);
            let tree = grow(&mut |n| dice.roll(n), log2);
            let (pages, shared) = pages(&tree, log2, cuts);
            (tree, pages, shared)
        })
        .find(|(_, pages, shared)| *shared == 2 && pages.len() > 4)
        .unwrap()
}

#[test]
fn every_texel_of_every_level_answers_as_the_naive_tree() {
    for seed in 0..12 {
        let log2 = 4 + (seed % 3) as u8;
        let (tree, pages, shared) = tree(seed * 1000, log2, &[log2 - 2, log2 - 3]);
        let record = structure("sun", log2, &pages, shared);
        let bytes = write(&format!("mmh-{seed}"), ContainerOptions::new(ID), &[(record, pages)]);
        let file = open(bytes).unwrap();
        assert_eq!(file.verify(|e| panic!("{e}")).faults, 0);
        let map = Map::new(file.structure(0).unwrap()).unwrap();
        let resident = Map::new(file.structure(0).unwrap()).unwrap().preload().unwrap();
        let (mut from_shared, tree_pages) = (0, map.structure().record().tree_pages());
        for level in 0..=log2 {
            for (x, y) in (0..1 << log2).flat_map(|y| (0..1 << log2).map(move |x| (x, y))) {
                let expected = tree.lookup(log2, x, y, level);
                let answer = map.texel(x, y, level).unwrap();
                assert_eq!(answer.value, expected, "{seed}: {x} {y} {level}");
                assert_eq!(resident.value(x, y, level), expected, "{seed}: {x} {y} {level}, all in one array");
                from_shared += u32::from(answer.page >= tree_pages);
            }
        }
        assert!(from_shared > 0);
    }
}

/// A lookup that needs a shared page names it, and answers from above until it is there.
#[test]
fn a_shared_page_that_is_missing_is_named() {
    let (tree, pages, shared) = tree(5, 5, &[3]);
    let record = structure("sun", 5, &pages, shared);
    let tree_pages = pages.len() as u32 - shared;
    let bytes = write("mmh-missing", ContainerOptions::new(ID), &[(record, pages)]);
    let map = Map::new(open(bytes).unwrap().structure(0).unwrap()).unwrap();
    (0..tree_pages).for_each(|o| map.page(o).map(drop).unwrap());
    let mut missed = 0;
    for (x, y) in (0..32).flat_map(|y| (0..32).map(move |x| (x, y))) {
        let d = map.nearest(x, y, 0);
        match d.missing {
            Some(page) => {
                assert!(page >= tree_pages);
                assert_eq!(d.value, tree.lookup(5, x, y, d.level), "the value of the node on the way");
                missed += 1;
            }
            None => assert_eq!(d.value, tree.lookup(5, x, y, 0)),
        }
    }
    assert!(missed > 0);
}

/// What a writer hands over is held against what nodes said of it before a byte of it is kept.
#[test]
fn a_reference_to_no_group_is_refused() {
    let (_, pages, shared) = tree(5, 5, &[3]);
    let record = structure("sun", 5, &pages, shared);
    let folder = Folder::new("mmh-refused");
    let mut writer = ContainerWriter::create(&folder.0.join("a.umb"), ContainerOptions::new(ID), vec![record]).unwrap();
    let mut rule = None;
    for (i, page) in pages.iter().enumerate() {
        let mut page = page.clone();
        if i == pages.len() - 2 {
            // The shared page's first group moves by a word: its entry is there, the reference is not.
            page.words[2] += 1;
        }
        match writer.push(&page) {
            Ok(()) => {}
            Err(WriteError::Rejected(e)) => {
                rule = Some(e.rule);
                break;
            }
            Err(e) => panic!("{e}"),
        }
    }
    assert!(matches!(rule, Some(Rule::MmhEntries | Rule::MmhHole | Rule::MmhLink)), "{rule:?}");
}
