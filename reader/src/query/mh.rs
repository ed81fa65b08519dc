//! Lookups in kind `mh`.
//!
//! - [`descend`]: the walk, a pure function over pages that are there or not; what is missing is answered by the value
//!   from above and named;
//! - [`MhMap`]: pages of one structure, loaded when a lookup needs them;
//! - [`ResidentMh`]: all pages in one array, for lookups that can't fail.
//!
//! Texels are numbered on the finest level: 0 to `1 << log2_resolution`, minus 1. A lookup at level L answers for the
//! square of `1 << L` texels on a side around the texel.

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing,
    clippy::cast_possible_truncation
)]

pub(crate) mod follow;
mod resident;

use std::sync::OnceLock;

use umbrage_format::kind::mh::{Children, Mask, Node, NodeType, ROOT_GROUP, child_of};
use umbrage_format::projection::{Lattice, UNCOVERED};
use umbrage_format::{FormatError, Kind, Place, Rule, Value};

pub use resident::ResidentMh;

use super::{Visibility, locate};
use crate::{CheckedPage, ReaderError, Structure};

/// A page as the walk sees it.
#[derive(Clone, Copy, Debug)]
pub struct PageView<'a> {
    /// The words, frame included, in host order.
    pub words: &'a [u32],
    /// Ordinal of its first child page.
    pub first_child: u32,
}

/// Where a walk ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Descent {
    /// The answer: the value last seen; [`UNCOVERED`] where there was none.
    pub value: u32,
    /// Level of the node that holds the value.
    pub level: u8,
    /// Page of that node.
    pub page: u32,
    /// Word of that node in its page; its value is in this word for a leaf, in the next for an inner node.
    pub word: u32,
    /// The page that the walk needed and did not get: the answer is then that of the nearest ancestor.
    pub missing: Option<u32>,
}

/// Walks from root `root` to texel (x, y) at `level`. `lookup` gives the page of an ordinal, or `None` where it is not
/// there. Ends after at most 25 nodes on any words; words outside a page read as 0.
pub fn descend<'a>(
    mut lookup: impl FnMut(u32) -> Option<PageView<'a>>,
    root: u32,
    log2_resolution: u8,
    x: u32,
    y: u32,
    level: u8,
) -> Descent {
    let mut d = Descent { value: UNCOVERED, level: log2_resolution, page: root, word: 0, missing: None };
    let mut ordinal = root;
    let Some(mut page) = lookup(root) else {
        d.missing = Some(root);
        return d;
    };
    let (mut mask, mut group) = (root_mask(page.words), u32::from(ROOT_GROUP));
    let mut at_level = log2_resolution.min(31);
    loop {
        let c = child_of(x, y, at_level);
        let kind = mask.child(c);
        if kind == NodeType::None {
            return d;
        }
        let at = group.saturating_add(mask.words_before(c));
        let word = page.words.get(at as usize).copied().unwrap_or(0);
        if kind.has_value() {
            let value = if kind == NodeType::Leaf { word } else { next(page.words, at) };
            d = Descent { value, level: at_level, page: ordinal, word: at, missing: None };
        }
        if kind == NodeType::Leaf || at_level <= level {
            return d;
        }
        let node = Node::decode(word);
        match node.children {
            Children::Here(first) => (mask, group) = (node.mask, first.into()),
            Children::Page(child) => {
                ordinal = page.first_child.saturating_add(child.into());
                let Some(next) = lookup(ordinal) else {
                    d.missing = Some(ordinal);
                    return d;
                };
                page = next;
                (mask, group) = (root_mask(page.words), u32::from(ROOT_GROUP));
            }
        }
        // Not below 0: at level 0 the walk has ended above, whatever level was asked for.
        at_level -= 1;
    }
}

fn next(words: &[u32], at: u32) -> u32 {
    words.get(at as usize + 1).copied().unwrap_or(0)
}

/// Types of a page's root group.
fn root_mask(words: &[u32]) -> Mask {
    let [_, mask, _, _] = words.first().copied().unwrap_or(0).to_le_bytes();
    Mask(mask)
}

/// The answer of a lookup.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Answer {
    /// The stored depth; a receiver at lattice depth d is lit iff `ceil(d) <= value`.
    pub value: u32,
    /// Level of the node that holds it: at least the level asked for.
    pub level: u8,
    /// Page of that node.
    pub page: u32,
    /// Word of that node in its page.
    pub word: u32,
}

/// A structure of kind `mh` whose pages are loaded and checked when a lookup first needs them, and then kept. May be
/// used from any thread.
#[derive(Debug)]
pub struct MhMap {
    structure: Structure,
    pages: Box<[OnceLock<CheckedPage>]>,
}

impl MhMap {
    /// Makes the table of pages; reads nothing.
    ///
    /// # Errors
    /// The structure is of another kind, or the table is above the limits.
    pub fn new(structure: Structure) -> Result<Self, ReaderError> {
        if structure.kind() != Kind::Mh {
            return Err(ReaderError::WrongKind {
                file: structure.file().clone(),
                structure: structure.name().to_string(),
                expected: Kind::Mh,
                found: structure.kind(),
            });
        }
        let bytes = u64::from(structure.page_count()) * size_of::<OnceLock<CheckedPage>>() as u64;
        let place = Place::Structure(structure.number());
        structure.limits().allocate(place, bytes).map_err(|e| structure.fault(e))?;
        let pages = (0..structure.page_count()).map(|_| OnceLock::new()).collect();
        Ok(Self { structure, pages })
    }

    /// The structure.
    pub fn structure(&self) -> &Structure {
        &self.structure
    }

    /// Texels on a side.
    pub fn resolution(&self) -> u32 {
        1 << self.structure.record().log2_resolution.min(31)
    }

    /// The page of an ordinal, loaded where it is not there yet.
    ///
    /// # Errors
    /// As [`Structure::page`].
    pub fn page(&self, ordinal: u32) -> Result<&CheckedPage, ReaderError> {
        if let Some(page) = self.resident(ordinal) {
            return Ok(page);
        }
        let page = self.structure.page(ordinal)?;
        self.pages.get(ordinal as usize).map(|slot| slot.get_or_init(|| page)).ok_or_else(|| ReaderError::OutOfRange {
            file: self.structure.file().clone(),
            what: format!("page of structure '{}'", self.structure.name()),
            number: ordinal,
            count: self.structure.page_count(),
        })
    }

    /// The page of an ordinal if it is loaded.
    pub fn resident(&self, ordinal: u32) -> Option<&CheckedPage> {
        self.pages.get(ordinal as usize)?.get()
    }

    /// Answer of root 0 from the loaded pages alone; `missing` names the page that would refine it.
    pub fn nearest(&self, x: u32, y: u32, level: u8) -> Descent {
        self.walk(0, x, y, level)
    }

    fn walk(&self, root: u32, x: u32, y: u32, level: u8) -> Descent {
        let view =
            |o| self.resident(o).map(|p| PageView { words: p.words(), first_child: p.record().first_child.get() });
        descend(view, root, self.structure.record().log2_resolution, x, y, level)
    }

    /// Answer at texel (x, y) of root 0 and `level`; loads what is missing on the way.
    ///
    /// # Errors
    /// The texel lies outside the map, or a page can't be loaded.
    pub fn texel(&self, x: u32, y: u32, level: u8) -> Result<Answer, ReaderError> {
        self.texel_of(0, x, y, level)
    }

    /// [`texel`](Self::texel) of another root.
    ///
    /// # Errors
    /// As `texel`, or no such root.
    pub fn texel_of(&self, root: u32, x: u32, y: u32, level: u8) -> Result<Answer, ReaderError> {
        let (roots, side) = (self.structure.record().root_count.get(), self.resolution());
        for (what, number, count) in [("root", root, roots), ("texel column", x, side), ("texel row", y, side)] {
            if number >= count {
                let what = format!("{what} of structure '{}'", self.structure.name());
                return Err(ReaderError::OutOfRange { file: self.structure.file().clone(), what, number, count });
            }
        }
        loop {
            let d = self.walk(root, x, y, level);
            match d.missing {
                // Each turn loads one page more, and a walk meets at most 25.
                Some(ordinal) => self.page(ordinal).map(drop)?,
                None => return Ok(Answer { value: d.value, level: d.level, page: d.page, word: d.word }),
            }
        }
    }

    /// Light or shadow at a world point, on root 0. Outside the map: lit, and flagged.
    ///
    /// # Errors
    /// A page can't be loaded.
    pub fn visibility(&self, point: [f64; 3], level: u8) -> Result<Visibility, ReaderError> {
        let Some((x, y, depth)) = locate(&self.lattice(), point) else { return Ok(Visibility::OUTSIDE) };
        Ok(Visibility::inside(depth, self.texel(x, y, level)?.value))
    }

    /// World to lattice.
    pub fn lattice(&self) -> Lattice {
        self.structure.lattice()
    }

    /// Loads and checks every page, holds each child page against its parent's node, and copies all into one array.
    ///
    /// # Errors
    /// A page can't be loaded, breaks a rule (`mh.link` among them), or all together are above the limits.
    pub fn preload(&self) -> Result<ResidentMh, ReaderError> {
        self.preload_while(&|| true)
    }

    /// [`preload`](Self::preload) that asks before each page whether to go on.
    ///
    /// # Errors
    /// As `preload`; [`ReaderError::Stopped`] where the answer was no.
    pub fn preload_while(&self, go_on: &dyn Fn() -> bool) -> Result<ResidentMh, ReaderError> {
        ResidentMh::load(self, go_on)
    }

    /// Refuses an array of more words than the limits allow or a 32-bit index reaches.
    fn allow_words(&self, words: u64) -> Result<(), ReaderError> {
        let place = Place::Structure(self.structure.number());
        let limited = self.structure.limits().allocate(place, words.saturating_mul(4));
        let addressed = if words <= u64::from(u32::MAX) {
            Ok(())
        } else {
            let (expected, found) = (Value::AtMost(u32::MAX.into()), Value::Number(words));
            Err(FormatError::new(Rule::LimitAllocation, place, 0, expected, found))
        };
        limited.and(addressed).map_err(|e| self.structure.fault(e))
    }
}
