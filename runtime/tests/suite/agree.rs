//! One comparison for the tests and the fuzz target: the device's answers against the twin's on the device's own bytes,
//! and against the reader's walk over the pages that are resident.

use umbrage_format::Kind;
use umbrage_reader::query::{PageView, mh, mmh, vector};
use umbrage_reader::{CheckedPage, Structure};
use umbrage_runtime::GpuStreamer;
use umbrage_runtime::query::pool::{ANCESTOR, EXACT, LEVEL_SHIFT, LIT, NONE, Pool, WORD_SHIFT};
use umbrage_runtime::residency::Entry;

/// What the device says and holds.
pub struct Answered {
    pub answers: Vec<[u32; 4]>,
    pub words: Vec<u32>,
    pub table: Vec<Entry>,
}

/// Asks the device, then reads its bytes back.
pub fn ask(gpu: &mut GpuStreamer, root: u32, queries: &[[u32; 4]]) -> Answered {
    let answers = gpu.answer(root, queries).expect("answers");
    let (words, table) = gpu.read_back().expect("bytes");
    Answered { answers, words, table }
}

/// Holds every answer against twin and reader: how many were exact, by an ancestor, and outside.
pub fn compare(answered: &Answered, structure: &Structure, root: u32, queries: &[[u32; 4]]) -> [usize; 3] {
    let Answered { answers, words, table } = answered;
    let log2 = structure.record().log2_resolution;
    let pool = Pool { words, table, base: 0, stale: &[], kind: structure.kind(), log2_resolution: log2, skips: None };
    let pages: Vec<Option<CheckedPage>> =
        (0u32..).zip(table).map(|(o, e)| (e[0] != NONE).then(|| structure.page(o).expect("it was uploaded"))).collect();
    for ((page, entry), ordinal) in pages.iter().zip(table).zip(0u32..) {
        let Some(page) = page else { continue };
        let at = entry[0] as usize;
        assert_eq!(&words[at..at + page.words().len()], page.words(), "page {ordinal}");
        assert_eq!(entry[1], page.record().first_child.get());
    }
    let lookup = |o: u32| {
        let page = pages.get(o as usize)?.as_ref()?;
        Some(PageView {
            words: page.words(),
            first_child: page.record().first_child.get(),
            dependencies: page.dependencies(),
        })
    };
    let mut seen = [0; 3];
    for (query, answer) in queries.iter().zip(answers) {
        assert_eq!(*answer, pool.answer(root, *query), "twin, query {query:?}");
        let [x, y, level, depth] = *query;
        if pool.outside(x, y) {
            seen[2] += 1;
            continue;
        }
        let level = level.min(255) as u8;
        let d = match structure.kind() {
            Kind::Vector => vector::descend(lookup, root, log2, x, y, level),
            Kind::Mmh => mmh::descend(lookup, root, log2, x, y, level),
            _ => mh::descend(lookup, root, log2, x, y, level),
        };
        let whole = if d.missing.is_none() { EXACT } else { ANCESTOR };
        let lit = if depth <= d.value { LIT } else { 0 };
        let state = u32::from(d.level) << LEVEL_SHIFT | d.word << WORD_SHIFT | lit | whole;
        assert_eq!(*answer, [d.value, state, d.missing.unwrap_or(NONE), d.page], "reader, query {query:?}");
        seen[usize::from(d.missing.is_some())] += 1;
    }
    seen
}
