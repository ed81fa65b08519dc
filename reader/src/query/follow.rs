//! Holds the pages of a structure, taken in ordinal order, against what their parents' nodes say of them.

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing,
    clippy::cast_possible_truncation
)]

use std::collections::VecDeque;

use umbrage_format::Kind;
use umbrage_format::kind::mmh::References;
use umbrage_format::kind::tree::{Link, check_link, inherited, links};

use crate::page::context;
use crate::{CheckedPage, ReaderError, Structure};

/// What parents said of the pages to come. Level order makes this a queue: children are numbered as their parents come.
#[derive(Debug, Default)]
pub(crate) struct Follow {
    /// None where the parent could not be read.
    announced: VecDeque<Option<Link>>,
    /// What nodes of tree pages said of groups in shared pages.
    references: References,
}

impl Follow {
    /// Checks the next page and notes what it says of its children.
    ///
    /// # Errors
    /// The rules of the kind about links and depths.
    pub(crate) fn page(&mut self, structure: &Structure, page: &CheckedPage) -> Result<(), ReaderError> {
        let cx = context(structure, page.ordinal(), page.record());
        if page.record().is_shared() {
            if structure.kind() == Kind::Mmh {
                return self.references.check(page.words(), &cx).map_err(|e| structure.fault(e));
            }
            return Ok(());
        }
        let said = if cx.is_root() { None } else { self.announced.pop_front().flatten() };
        if structure.kind() == Kind::Mmh {
            let above = inherited(said.as_ref(), &cx);
            self.references.note(page.words(), page.head(), &cx, page.dependencies(), above);
        }
        let first = self.announced.len();
        self.announced.resize(first + usize::from(page.head().child_refs), None);
        links(page.words(), page.head(), &cx, said.as_ref(), |child, link| {
            if let Some(slot) = self.announced.get_mut(first + usize::from(child)) {
                *slot = Some(link);
            }
        });
        match said {
            Some(link) => check_link(&link, page.words(), page.head(), &cx).map_err(|e| structure.fault(e)),
            None => Ok(()),
        }
    }

    /// Passes over the next page, which could not be read; `children` is its number of child pages.
    pub(crate) fn skip(&mut self, is_root: bool, children: u16) {
        if !is_root {
            self.announced.pop_front();
        }
        self.announced.resize(self.announced.len() + usize::from(children), None);
    }
}
