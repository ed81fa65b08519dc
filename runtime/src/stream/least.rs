//! Blocks that a pool needs so that every page of a structure can be in it.

use umbrage_format::structure::MAX_LOG2_RESOLUTION;
use umbrage_reader::{ReaderError, Structure};

use crate::residency::slots::{BLOCK_WORDS, CLASSES, class_of, slot_words};

/// Most pages on the way from below a root to a leaf: each begins at least a level deeper.
const LONGEST_WAY: u32 = MAX_LOG2_RESOLUTION as u32;

/// Pages of each class.
type Classes = [u32; CLASSES];

/// Blocks that hold pages of these classes: a block has slots of one class.
fn blocks(pages: &Classes) -> u32 {
    let words = |(class, &count): (u8, &u32)| u64::from(count) * u64::from(slot_words(class));
    let blocks: u64 = (0..).zip(pages).map(|c| words(c).div_ceil(BLOCK_WORDS.into())).sum();
    u32::try_from(blocks).unwrap_or(u32::MAX)
}

/// The roots, which never leave.
fn roots(structure: &Structure) -> Result<Classes, ReaderError> {
    let mut pages = [0; CLASSES];
    for root in 0..structure.record().root_count.get() {
        if let Some(class) = class_of(structure.page_record(root)?.hot_words.get().into()) {
            pages[usize::from(class)] += 1;
        }
    }
    Ok(pages)
}

/// Blocks that are enough for any structure with these roots. Reads the index blocks of the roots.
///
/// # Errors
/// The index can't be read.
pub fn always_enough(structure: &Structure) -> Result<u32, ReaderError> {
    Ok(blocks(&roots(structure)?).saturating_add(LONGEST_WAY))
}

/// Fewest blocks in which every page finds room beside the roots and all pages above it. Reads the whole index; a page
/// whose record can't be read is left out, as it can't be streamed either.
///
/// # Errors
/// The index blocks of the roots can't be read.
pub fn just_enough(structure: &Structure) -> Result<u32, ReaderError> {
    let roots = roots(structure)?;
    let count = structure.page_count() as usize;
    // What stands above each page, the roots aside; parents come before their children.
    let mut above = vec![[0u8; CLASSES]; count];
    let mut most = blocks(&roots);
    for ordinal in 0..structure.page_count() {
        let Ok(record) = structure.page_record(ordinal) else { continue };
        let mut way = above[ordinal as usize];
        if ordinal >= structure.record().root_count.get()
            && let Some(class) = class_of(record.hot_words.get().into())
        {
            way[usize::from(class)] = way[usize::from(class)].saturating_add(1);
            let all = std::array::from_fn(|c| roots[c] + u32::from(way[c]));
            most = most.max(blocks(&all));
        }
        let children = record.first_child.get() as usize..record.children_end() as usize;
        if let Some(children) = above.get_mut(children) {
            children.fill(way);
        }
    }
    Ok(most)
}
