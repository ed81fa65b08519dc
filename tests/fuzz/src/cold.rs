//! Cold pages: any bytes decode to nothing or to as many words as are asked for, by models that were made of pages and by
//! any that is read; and words of any kind come back from their cold form.
//!
//! Byte 0: bits 0..2 the kind, bits 2..4 what the rest is: the bytes of a page; a model and, where it is one, a page behind
//! it; words; changes to a cold page of a tree.

use std::sync::OnceLock;

use umbrage_format::Kind;
use umbrage_format::cold::{Model, decode};
use umbrage_writer::cold::{Tables, Tally};

use crate::input::Input;
use crate::tree::Dice;
use crate::{mmh_tree, tree, vector_tree};

const KINDS: [Kind; 4] = [Kind::Mh, Kind::Mmh, Kind::Vector, Kind::Mh];

/// Pages of random trees, and the tables made of them.
struct Made {
    pages: Vec<Vec<u32>>,
    tables: Tables,
}

fn tables(kind: Kind, pages: &[Vec<u32>]) -> Tables {
    let mut tally = Tally::new(kind).expect("a kind with a layout");
    pages.iter().for_each(|page| tally.note(page));
    let mut tables = tally.tables();
    pages.iter().for_each(|page| tables.count(page));
    tables.finish()
}

fn made(kind: Kind) -> &'static Made {
    static MADE: [OnceLock<Made>; 3] = [const { OnceLock::new() }; 3];
    let slot = usize::from(kind.tag()) - 1;
    MADE[slot].get_or_init(|| {
        let mut pages = Vec::new();
        for seed in 1..12 {
            let mut dice = Dice(seed);
            let own = match kind {
                Kind::Mh => tree::pages(&tree::grow(&mut dice, 5, true, 6), 5, &[3]),
                Kind::Mmh => mmh_tree::pages(&mmh_tree::grow(&mut |n| dice.roll(n), 5), 5, &[3]).0,
                _ => vector_tree::pages(&vector_tree::grow(&mut |n| dice.roll(n), 5, true, 6), 5),
            };
            pages.extend(own.into_iter().map(|p| p.words));
        }
        let tables = tables(kind, &pages);
        Made { pages, tables }
    })
}

/// Inputs with a page that is decoded to its end: one by the tables made of random trees, two by tables of its own, of
/// which one page has children in other pages where there is such a page. Not longer than `most` bytes.
pub fn seeds(kind: Kind, most: usize) -> Vec<(&'static str, Vec<u8>)> {
    let [tag, ..] = (u16::from(kind.tag()) - 1).to_le_bytes();
    let Made { pages, tables: common } = made(kind);
    let page = |page: &Vec<u32>| {
        let cold = common.encode(page)?;
        Some([&[tag][..], &(page.len() as u16).to_le_bytes(), &cold].concat())
    };
    let model = |page: &Vec<u32>| {
        let own = tables(kind, std::slice::from_ref(page));
        let (section, cold) = (own.section(), own.encode(page)?);
        let lengths = [page.len() as u16, section.len() as u16].map(u16::to_le_bytes).concat();
        Some([&[tag | 1 << 2][..], &lengths, section, &cold].concat())
    };
    // The one with the most words is the one that reaches most.
    let longest = |of: &dyn Fn(&Vec<u32>) -> Option<Vec<u8>>, is: &dyn Fn(&Vec<u32>) -> bool| {
        let fits = |p: &Vec<u32>| of(p).filter(|bytes| bytes.len() <= most).map(|bytes| (p.len(), bytes));
        pages.iter().filter(|p| is(p)).filter_map(fits).max_by_key(|(words, _)| *words).map(|(_, bytes)| bytes)
    };
    let all = [
        ("page", longest(&page, &|_| true)),
        ("model", longest(&model, &|p| p[0] >> 16 == 0 && p[0] >> 8 & 0xFF != 0)),
        ("model-refs", longest(&model, &|p| p[0] >> 16 != 0)),
        ("model-shared", longest(&model, &|p| kind == Kind::Mmh && p[0] >> 8 & 0xFF == 0)),
    ];
    all.into_iter().filter_map(|(name, bytes)| Some((name, bytes?))).collect()
}

fn hold(model: &Model, cold: &[u8], words: u16) -> bool {
    let found = decode(model, cold, words);
    assert!(found.as_ref().is_none_or(|found| found.len() == usize::from(words)));
    found.is_some()
}

/// One input.
pub fn run(data: &[u8]) {
    decodes(data);
}

/// The same; returns whether bytes of the input are a page that is decoded.
pub fn decodes(data: &[u8]) -> bool {
    let mut input = Input(data);
    let how = input.byte();
    let kind = KINDS[usize::from(how & 3)];
    match how >> 2 & 3 {
        0 => {
            let words = input.pair() % 16385;
            hold(made(kind).tables.model(), input.0, words)
        }
        1 => {
            let words = input.pair() % 16385;
            let length = usize::from(input.pair()).min(input.0.len());
            let (section, cold) = input.0.split_at(length);
            Model::read(kind, section).is_some_and(|model| hold(&model, cold, words))
        }
        2 => {
            let mut pages = Vec::new();
            while !input.is_empty() && pages.len() < 4 {
                let mut page = Vec::new();
                for _ in 0..2 + u16::from(input.byte()) {
                    page.push(input.word());
                }
                pages.push(page);
            }
            let tables = tables(kind, &pages);
            for page in &pages {
                if let Some(cold) = tables.encode(page) {
                    assert!(cold.len() < page.len() * 4);
                    assert_eq!(decode(tables.model(), &cold, page.len() as u16).as_ref(), Some(page));
                }
            }
            false
        }
        _ => {
            let Made { pages, tables } = made(kind);
            let page = &pages[usize::from(input.pair()) % pages.len()];
            let Some(mut cold) = tables.encode(page) else { return false };
            assert_eq!(decode(tables.model(), &cold, page.len() as u16).as_ref(), Some(page));
            while !input.is_empty() {
                let at = usize::from(input.pair()) % cold.len();
                cold[at] = input.byte();
            }
            hold(tables.model(), &cold, page.len() as u16)
        }
    }
}
