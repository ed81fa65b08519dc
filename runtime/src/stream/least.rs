//! Blocks that a pool needs so that every page of a structure can be in it.

use std::collections::BTreeSet;

use umbrage_format::structure::MAX_LOG2_RESOLUTION;
use umbrage_format::{Kind, PageRecord};
use umbrage_reader::{ReaderError, Structure};

use crate::residency::slots::{BLOCK_WORDS, CLASSES, class_of, slot_words};

/// Most pages on the way from below a root to a leaf: each begins at least a level deeper.
const LONGEST_WAY: u32 = MAX_LOG2_RESOLUTION as u32;

/// Pages of each class.
pub type Classes = [u32; CLASSES];

/// Blocks that hold pages of these classes: a block has slots of one class.
pub fn blocks(pages: &Classes) -> u32 {
    let words = |(class, &count): (u8, &u32)| u64::from(count) * u64::from(slot_words(class));
    let blocks: u64 = (0..).zip(pages).map(|c| words(c).div_ceil(BLOCK_WORDS.into())).sum();
    u32::try_from(blocks).unwrap_or(u32::MAX)
}

/// Class of a page in the pool, none where it fits no slot.
fn class(structure: &Structure, record: &PageRecord) -> Option<u8> {
    // In kind mmh the list of dependencies lies behind the words.
    let list = if structure.kind() == Kind::Mmh { record.dep_count.get() } else { 0 };
    class_of(u32::from(record.hot_words.get()) + u32::from(list))
}

/// The roots, which never leave.
pub fn roots(structure: &Structure) -> Result<Classes, ReaderError> {
    let mut pages = [0; CLASSES];
    for root in 0..structure.record().root_count.get() {
        if let Some(class) = class(structure, &structure.page_record(root)?) {
            pages[usize::from(class)] += 1;
        }
    }
    Ok(pages)
}

/// Blocks that are enough for any structure with these roots. Reads the index blocks of the roots; where pages depend on
/// shared ones, the whole index.
///
/// # Errors
/// The index can't be read.
pub fn always_enough(structure: &Structure) -> Result<u32, ReaderError> {
    if structure.record().shared_pages.get() != 0 {
        return just_enough(structure);
    }
    Ok(blocks(&roots(structure)?).saturating_add(LONGEST_WAY))
}

/// Blocks that are enough beside the roots for every page with all pages above it. Reads the index only where pages depend
/// on shared ones, or where `exact` asks for the fewest.
///
/// # Errors
/// As [`just_enough`].
pub fn way(structure: &Structure, exact: bool) -> Result<u32, ReaderError> {
    if !exact && structure.record().shared_pages.get() == 0 {
        return Ok(LONGEST_WAY);
    }
    longest(structure, &[0; CLASSES])
}

/// Fewest blocks in which every page finds room beside the roots, all pages above it, and the shared pages that any of
/// these depends on. Reads the whole index; a page whose record or list of dependencies can't be read is left out,
/// as it can't be streamed either.
///
/// # Errors
/// The index blocks of the roots can't be read.
pub fn just_enough(structure: &Structure) -> Result<u32, ReaderError> {
    longest(structure, &roots(structure)?)
}

/// Blocks for the longest way beside pages of these classes.
fn longest(structure: &Structure, roots: &Classes) -> Result<u32, ReaderError> {
    let count = structure.page_count() as usize;
    let records: Vec<Option<PageRecord>> = (0..structure.page_count()).map(|o| structure.page_record(o).ok()).collect();
    let class = |o: u32| class(structure, records.get(o as usize)?.as_ref()?);
    // What stands above each page, the roots aside; parents come before their children.
    let mut above = vec![[0u8; CLASSES]; count];
    let mut parents = vec![None; count];
    let mut most = blocks(roots);
    for (ordinal, record) in (0..structure.record().tree_pages()).zip(&records) {
        let Some(record) = record else { continue };
        let mut way = above[ordinal as usize];
        if ordinal >= structure.record().root_count.get()
            && let Some(class) = class(ordinal)
        {
            way[usize::from(class)] = way[usize::from(class)].saturating_add(1);
        }
        let mut all: Classes = std::array::from_fn(|c| roots[c] + u32::from(way[c]));
        for shared in dependencies(structure, &records, &parents, ordinal) {
            if let Some(class) = class(shared) {
                all[usize::from(class)] += 1;
            }
        }
        most = most.max(blocks(&all));
        let children = record.first_child.get() as usize..record.children_end() as usize;
        if let (Some(above), Some(parents)) = (above.get_mut(children.clone()), parents.get_mut(children)) {
            above.fill(way);
            parents.fill(Some(ordinal));
        }
    }
    Ok(most)
}

/// The shared pages that a page and those above it depend on, and on which these depend.
fn dependencies(
    structure: &Structure,
    records: &[Option<PageRecord>],
    parents: &[Option<u32>],
    ordinal: u32,
) -> BTreeSet<u32> {
    let mut found = BTreeSet::new();
    let mut open: Vec<u32> = std::iter::successors(Some(ordinal), |o| parents[*o as usize]).collect();
    while let Some(page) = open.pop() {
        let has = records.get(page as usize).and_then(Option::as_ref).is_some_and(|r| r.dep_count.get() != 0);
        if has {
            // A page whose list can't be read can't be streamed. Ordinals of dependencies rise, so this ends.
            let list = structure.dependencies(page).unwrap_or_default();
            open.extend(list.into_iter().filter(|d| found.insert(*d)));
        }
    }
    found
}
