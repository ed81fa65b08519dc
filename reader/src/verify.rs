//! Checks of a whole file: everything that opening and lookups check on first touch, and what only the whole shows:
//! padding, content hashes, links between pages, counts of nodes, sections that this version does not know.

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing,
    clippy::cast_possible_truncation
)]

use umbrage_format::checksum::SectionCrc;
use umbrage_format::header::Header;
use umbrage_format::{FormatError, Place, Rule, StructureRecord, Value};

use crate::container::{Shared, check_padding};
use crate::query::follow::Follow;
use crate::{Container, FrameChecked, ReaderError, Structure};

/// Bytes that are read at once where only a sum is taken.
const CHUNK: usize = 1 << 16;

/// Offset of the counts of nodes in a structure record.
const LEAF_NODES_AT: u64 = core::mem::offset_of!(StructureRecord, leaf_nodes) as u64;

/// What [`Container::verify`] looked at.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct VerifySummary {
    /// Pages.
    pub pages: u64,
    /// Index blocks.
    pub blocks: u64,
    /// Pages of kinds that this version can't check beyond the frame.
    pub unsupported: u64,
    /// Faults reported.
    pub faults: u64,
}

impl Container {
    /// Checks every byte of the file; each fault is handed to `report` and the check goes on where it can.
    pub fn verify(&self, report: impl FnMut(ReaderError)) -> VerifySummary {
        self.verify_while(report, |_| true)
    }

    /// [`verify`](Self::verify), told before each page how many pages it has come to and ended where it says `false`: then
    /// what is behind has not been checked.
    pub fn verify_while(
        &self,
        mut report: impl FnMut(ReaderError),
        mut go_on: impl FnMut(u64) -> bool,
    ) -> VerifySummary {
        let mut summary = VerifySummary::default();
        let mut faults = 0;
        let mut keep = |result: Result<(), ReaderError>| {
            if let Err(e) = result {
                faults += 1;
                report(e);
            }
        };
        let shared = self.shared();
        let mut end = Header::BYTES as u64 + self.header().table_bytes();
        for (i, s) in (0u32..).zip(self.sections()) {
            let place = Place::Section(i);
            keep(padding(shared, end, s.offset.get(), Rule::SectionPadding, place));
            if !s.is_known() {
                keep(unknown(shared, s.offset.get(), s.length.get(), s.crc32.get(), place));
            }
            end = s.end();
        }
        for structure in self.structures() {
            // Where the model is broken its cold pages are passed over: one fault, not one for each.
            keep(structure.cold_model().map(drop));
            if !verify_structure(&structure, &mut summary, &mut keep, &mut go_on) {
                break;
            }
        }
        summary.faults = faults;
        summary
    }
}

/// Says whether to go on.
fn verify_structure(
    s: &Structure,
    summary: &mut VerifySummary,
    keep: &mut impl FnMut(Result<(), ReaderError>),
    go_on: &mut impl FnMut(u64) -> bool,
) -> bool {
    // None once a block is lost: then nobody knows which pages are whose children.
    let mut follow = Some(Follow::default());
    let mut end = None;
    let per_block = u32::from(s.record().records_per_block.get()).max(1);
    let mut whole = true;
    // None once a page is lost.
    let mut nodes = s.kind().has_layout().then_some([0u64; 3]);
    for ordinal in 0..s.page_count() {
        if !go_on(summary.pages) {
            return false;
        }
        // A block that fails is reported once, not for each of its records.
        if ordinal % per_block == 0 {
            let touched = s.touch_block(ordinal);
            summary.blocks += 1;
            whole = touched.is_ok();
            keep(touched);
        }
        let Some(record) = whole.then(|| s.page_record(ordinal).ok()).flatten() else {
            (end, follow, nodes) = (None, None, None);
            continue;
        };
        let place = Place::Page { structure: s.number(), ordinal };
        if let Some(end) = end {
            keep(padding(s.shared(), end, record.offset.get(), Rule::PagePadding, place));
        }
        end = Some(record.end());
        summary.pages += 1;
        if record.cold_words.get() != 0 && s.cold_section().is_some() && s.cold_model().is_err() {
            if let Some(follow) = &mut follow {
                follow.skip(ordinal < s.record().root_count.get(), record.child_count.get());
            }
            nodes = None;
            continue;
        }
        let page = s.page_bytes(ordinal).and_then(|b| b.check_hash().and_then(|()| b.check_frame()));
        let page = page.and_then(FrameChecked::check_kind);
        nodes = nodes.zip(page.as_ref().ok()).map(|(sums, page)| {
            let c = page.counts();
            let [leaves, inner, empty] = sums;
            [leaves + u64::from(c.leaves), inner + u64::from(c.inner), empty + u64::from(c.empty)]
        });
        match (page, &mut follow) {
            (Ok(page), Some(follow)) => keep(follow.page(s, &page)),
            (Ok(_), None) => {}
            (Err(e), follow) => {
                if let Some(follow) = follow {
                    follow.skip(ordinal < s.record().root_count.get(), record.child_count.get());
                }
                match e {
                    ReaderError::UnsupportedKind { .. } => summary.unsupported += 1,
                    e => keep(Err(e)),
                }
            }
        }
    }
    if let Some(nodes) = nodes {
        keep(node_counts(s, nodes));
    }
    true
}

/// Holds the structure's counts of leaf, inner and empty nodes against those of its pages.
fn node_counts(s: &Structure, found: [u64; 3]) -> Result<(), ReaderError> {
    let r = s.record();
    let stated = [r.leaf_nodes, r.inner_nodes, r.empty_nodes].map(|n| n.get());
    let Some((i, (stated, found))) = (0u64..).zip(stated.into_iter().zip(found)).find(|(_, (a, b))| a != b) else {
        return Ok(());
    };
    let first = s.shared().sections.first().map_or(0, |section| section.offset.get());
    let at = first + u64::from(s.number()) * StructureRecord::BYTES as u64 + LEAF_NODES_AT + 8 * i;
    let place = Place::Structure(s.number());
    let error = FormatError::new(Rule::StructureNodes, place, at, Value::Number(found), Value::Number(stated));
    Err(s.fault(error))
}

fn padding(shared: &Shared, from: u64, to: u64, rule: Rule, place: Place) -> Result<(), ReaderError> {
    chunks(shared, from, to, |bytes, at| check_padding(bytes, at, rule, place))
}

fn unknown(shared: &Shared, offset: u64, length: u64, stored: u32, place: Place) -> Result<(), ReaderError> {
    let mut crc = SectionCrc::default();
    chunks(shared, offset, offset.saturating_add(length), |bytes, _| {
        crc.update(bytes);
        Ok(())
    })?;
    FormatError::crc(Rule::SectionCrc, place, offset, crc.finish(), stored).map_err(ReaderError::format(&shared.file))
}

/// Reads a range piece by piece.
fn chunks(
    shared: &Shared,
    from: u64,
    to: u64,
    mut each: impl FnMut(&[u8], u64) -> Result<(), FormatError>,
) -> Result<(), ReaderError> {
    let mut at = from;
    let mut buffer = vec![0; usize::try_from(to.saturating_sub(from)).map_or(CHUNK, |n| n.min(CHUNK))];
    while at < to {
        let n = usize::try_from(to - at).map_or(CHUNK, |n| n.min(CHUNK));
        let piece = buffer.get_mut(..n).unwrap_or_default();
        shared.read(at, piece)?;
        each(piece, at).map_err(ReaderError::format(&shared.file))?;
        at += n as u64;
    }
    Ok(())
}
