//! Kind `mmh`: the hierarchy of kind `mh` with equal subtrees stored once (Scandolo 2019, section 2.6).
//!
//! [`topology`] hashes the shapes of subtrees (algorithm 4), [`merge`] matches those of one shape (algorithm 5) and
//! fixes the values, [`page`] cuts what is left into pages and writes their words in two passes (section 2.6.3).

pub mod merge;
pub mod page;
pub mod topology;

use std::sync::atomic::Ordering;
use std::time::Instant;

use self::merge::{Merged, Pairs};
use self::page::Pages;
use super::build::{Counts, Progress, Stop, stopped};
use super::mh::Node;
use super::page::Forest;

/// How to merge.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Options {
    /// Subtrees of the same shape that each one is held against, the nearest first (the paper's search distance).
    pub search: u32,
}

impl Default for Options {
    /// The paper's distance, 1000.
    fn default() -> Self {
        Self { search: 1000 }
    }
}

/// A finished tree.
#[derive(Debug)]
pub struct Tree {
    /// Its pages.
    pub pages: Pages,
    /// What happened while intervals were found.
    pub counts: Counts,
    /// What merging did.
    pub merged: Report,
}

/// What merging did (Scandolo 2019, tables 2.6 to 2.8).
#[derive(Clone, Debug, Default)]
pub struct Report {
    /// Words of the groups before, without frames and index.
    pub words_before: u64,
    /// Words of the groups after, each counted once.
    pub words_merged: u64,
    /// Words of all pages, frames included.
    pub words_paged: u64,
    /// Shared pages.
    pub shared_pages: u32,
    /// Dependencies of all pages, and of the page with most.
    pub dependencies: [u64; 2],
    /// Pairs of subtrees by their height, from 1 on.
    pub pairs: Vec<Pairs>,
    /// Seconds for matching, and for pages.
    pub seconds: [f64; 2],
}

/// Merges a whole tree and cuts it into pages.
///
/// # Errors
/// [`Stop`]: cancelled, or over the budget.
pub fn build(
    forest: Forest,
    root: Node,
    counts: Counts,
    log2_resolution: u8,
    options: Options,
    progress: &Progress,
) -> Result<Tree, Stop> {
    let start = Instant::now();
    let held = forest.bytes();
    let tree = Merged::of(&forest.groups, &forest.intervals, root);
    progress.take(tree.bytes());
    drop(forest);
    progress.release(held);
    if progress.over_budget() {
        return Err(stopped(progress));
    }
    let words_before = tree.words.first().map_or(0, |w| u64::from(*w));
    let (root_groups, kept) = page::root_page(&tree);
    let go_on = || !progress.cancel.load(Ordering::Relaxed);
    let merged = merge::merge(tree, &kept, options.search, &go_on).ok_or_else(|| stopped(progress))?;
    let matching = start.elapsed().as_secs_f64();
    let pages = page::pages(&merged, root, &root_groups, log2_resolution);
    let dependencies = || pages.pages.iter().map(|p| p.dependencies.len() as u64);
    let report = Report {
        words_before,
        words_merged: pages.words_unpaged,
        words_paged: pages.pages.iter().map(|p| p.words.len() as u64).sum(),
        shared_pages: pages.shared,
        dependencies: [dependencies().sum(), dependencies().max().unwrap_or(0)],
        pairs: merged.pairs,
        seconds: [matching, start.elapsed().as_secs_f64() - matching],
    };
    Ok(Tree { pages, counts, merged: report })
}
