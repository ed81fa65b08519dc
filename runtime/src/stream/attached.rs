//! The structures of a streamer: how they come, go, are replaced, and what the device must know of each.

use std::sync::Arc;

use umbrage_reader::{ReaderError, Structure};

use super::Streamer;
use super::least::{self, Classes};
use super::loader::{self, Order, What};
use crate::error::RuntimeError;
use crate::residency::foresee::Foresight;
use crate::residency::slots::CLASSES;
use crate::residency::{Budget, Child, LoadedPage, Span};
use crate::shader::{MAPS, Map, Rect, STALE_RECTS};

/// Frames for which pages of a replaced version are kept for the new one.
const KEEP: u64 = 600;

/// Names a structure of a streamer. The name of one that has gone names none, for ever.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct StructureId {
    index: u32,
    attachment: u32,
}

impl StructureId {
    /// Its number for `umb_select` in shaders, below 256. Another structure may have it later.
    pub fn index(self) -> u32 {
        self.index
    }
}

/// A structure, and where it is.
#[derive(Debug)]
pub struct Attached {
    pub(super) structure: Structure,
    pub(super) span: Span,
    pub(super) foresight: Option<Foresight>,
    pub(super) stale: Vec<Rect>,
    attachment: u32,
    needs: Needs,
    /// Whether its roots have come; before that nothing walks it.
    ready: bool,
    skips: Option<u32>,
    /// The version that takes its place once its roots have come.
    next: Option<Next>,
}

#[derive(Debug)]
struct Next {
    structure: Structure,
    span: Span,
    needs: Needs,
    stage: Stage,
}

/// How far a new version has come.
#[derive(Debug)]
enum Stage {
    /// Its roots are being read.
    Roots,
    /// A thread looks for its pages that are unchanged, under this number.
    Survey(u64),
    /// These are.
    Found(Vec<LoadedPage>),
    /// They are its own, and the device is being told.
    Placed,
}

impl Attached {
    /// The one that answers, and the one that will.
    fn versions(&self) -> impl Iterator<Item = (&Structure, &Span)> {
        let next = self.next.as_ref().map(|n| (&n.structure, &n.span));
        std::iter::once((&self.structure, &self.span)).chain(next)
    }
}

/// Room that a structure needs to make progress.
#[derive(Debug, Clone, Copy)]
struct Needs {
    roots: Classes,
    /// Blocks beside the roots.
    way: u32,
}

impl Needs {
    fn of(structure: &Structure, exact: bool) -> Result<Self, ReaderError> {
        Ok(Self { roots: least::roots(structure)?, way: least::way(structure, exact)? })
    }
}

/// Blocks in which several structures can make progress: all roots, and the longest way.
fn enough<'a>(all: impl Iterator<Item = &'a Needs>) -> u32 {
    let (mut roots, mut way) = ([0u32; CLASSES], 0);
    for needs in all {
        roots = std::array::from_fn(|c| roots[c].saturating_add(needs.roots[c]));
        way = way.max(needs.way);
    }
    least::blocks(&roots).saturating_add(way)
}

impl Streamer {
    /// Takes a structure in; its roots are ordered, and it answers once they have come ([`is_ready`](Self::is_ready)). Reads the
    /// index blocks of its roots, and all where the pool is small.
    ///
    /// # Errors
    /// The page table or the list of structures is full, the pool can't hold the roots of all structures and any page with
    /// all above it, or the index can't be read.
    pub fn attach(&mut self, structure: &Structure) -> Result<StructureId, RuntimeError> {
        let free = self.attached.iter().position(Option::is_none);
        let index = free.unwrap_or(self.attached.len());
        if index >= MAPS as usize {
            return Err(RuntimeError::Structures { most: MAPS });
        }
        let (span, needs) = self.take_in(structure)?;
        self.attachments += 1;
        let attached = Attached {
            structure: structure.clone(),
            span,
            foresight: Foresight::new(structure.lattice()),
            stale: Vec::new(),
            attachment: self.attachments,
            needs,
            ready: false,
            skips: self.skips,
            next: None,
        };
        let id = StructureId { index: index as u32, attachment: self.attachments };
        match self.attached.get_mut(index) {
            Some(place) => *place = Some(attached),
            None => self.attached.push(Some(attached)),
        }
        self.changed = true;
        Ok(id)
    }

    /// A place in the table for a structure for which there is room in the pool.
    fn take_in(&mut self, structure: &Structure) -> Result<(Span, Needs), RuntimeError> {
        // The smaller one holds.
        let budget = self.coming.filter(|c| c.blocks < self.budget.blocks).unwrap_or(self.budget);
        let mut needs = Needs::of(structure, false)?;
        if enough(self.needs().iter().chain([&needs])) > budget.blocks {
            self.measure()?;
            needs = Needs::of(structure, true)?;
            let others = self.needs();
            let mut blocks = enough(others.iter().chain([&needs]));
            if others.is_empty() {
                // The way shares blocks with the roots.
                blocks = blocks.min(least::just_enough(structure)?);
            }
            if blocks > budget.blocks {
                Budget::divide(budget.total, self.table, blocks, u64::MAX)?;
                return Err(RuntimeError::Pool { needed: blocks, blocks: budget.blocks });
            }
        }
        let record = structure.record();
        let root = |o| structure.page_record(o).map(|r| loader::told(structure, &r));
        let roots: Result<Vec<Child>, ReaderError> = (0..record.root_count.get()).map(root).collect();
        let roots: Arc<[Child]> = roots?.into();
        let span = self.residency.attach(structure.page_count(), record.shared_pages.get(), roots)?;
        Ok((span, needs))
    }

    /// Of all structures, those included that are to take another's place.
    fn needs(&self) -> Vec<Needs> {
        let of = |a: &'_ Attached| [Some(a.needs), a.next.as_ref().map(|n| n.needs)];
        self.attached.iter().flatten().flat_map(of).flatten().collect()
    }

    /// Looks through the indices for what the structures need at least.
    fn measure(&mut self) -> Result<(), ReaderError> {
        for attached in self.attached.iter_mut().flatten() {
            attached.needs = Needs::of(&attached.structure, true)?;
            if let Some(next) = &mut attached.next {
                next.needs = Needs::of(&next.structure, true)?;
            }
        }
        Ok(())
    }

    /// Blocks that are enough for what is attached; the fewest, which the indices must be read for, where that is asked.
    pub(super) fn enough_blocks(&mut self, fewest: bool) -> Result<u32, ReaderError> {
        if fewest {
            self.measure()?;
        }
        let needs = self.needs();
        let all = if needs.is_empty() { 1 } else { enough(needs.iter()) };
        match self.attached.iter().flatten().next() {
            Some(only) if fewest && needs.len() == 1 => Ok(least::just_enough(&only.structure)?.min(all)),
            _ => Ok(all),
        }
    }

    /// Takes all structures in again, in an empty table.
    pub(super) fn reattach(&mut self) -> Result<(), RuntimeError> {
        let mut out = Ok(());
        for index in 0..self.attached.len() {
            let Some(mut attached) = self.attached.get_mut(index).and_then(Option::take) else { continue };
            let next = attached.next.take().map(|n| n.structure);
            match self.take_in(&attached.structure) {
                Ok((span, needs)) => {
                    (attached.span, attached.needs, attached.ready) = (span, needs, false);
                    let id = StructureId { index: index as u32, attachment: attached.attachment };
                    if let Some(place) = self.attached.get_mut(index) {
                        *place = Some(attached);
                    }
                    // Its table has room: there was for both.
                    if let Some(next) = next {
                        out = out.and(self.swap(id, &next));
                    }
                }
                Err(e) => out = out.and(Err(e)),
            }
        }
        self.changed = true;
        out
    }

    /// A structure goes, with all of its pages. From the next frame on it is lit everywhere, by ancestors that are not
    /// there; shaders must not ask it any more. Its entries in the page table are free some frames later. `false` where it had
    /// gone before.
    pub fn detach(&mut self, id: StructureId) -> bool {
        if self.get(id).is_none() {
            return false;
        }
        if let Some(attached) = self.attached.get_mut(id.index as usize).and_then(Option::take) {
            self.residency.detach(attached.span.base);
            if let Some(next) = attached.next {
                self.residency.detach(next.span.base);
                if matches!(next.stage, Stage::Placed) {
                    self.residency.thaw();
                }
            }
        }
        self.changed = true;
        true
    }

    /// A new version takes a structure's place as soon as its roots have come: from one frame to the next, and under the same
    /// name. Where kind and resolution are the same, pages whose content is unchanged go on in their slots, unless they depend
    /// on others; those of which all above them are unchanged, the root aside, answer from its first frame on.
    /// Regions that were marked as stale are so no more. Errors as [`attach`](Self::attach); the old version answers on then.
    ///
    /// # Errors
    /// Those, or the structure has gone.
    pub fn swap(&mut self, id: StructureId, structure: &Structure) -> Result<(), RuntimeError> {
        if self.get(id).is_none() {
            return Err(RuntimeError::Gone);
        }
        let (span, needs) = self.take_in(structure)?;
        // One whose pages are in their places answers from now on.
        self.switch(id.index as usize, |stage| matches!(stage, Stage::Placed));
        if let Some(attached) = self.get_mut(id) {
            let next = Next { structure: structure.clone(), span, needs, stage: Stage::Roots };
            if let Some(before) = attached.next.replace(next) {
                // It has not begun to answer.
                self.residency.detach(before.span.base);
            }
        }
        Ok(())
    }

    /// Whether a version that is to take a structure's place has not done so yet.
    pub fn is_swapping(&self, id: StructureId) -> bool {
        self.get(id).is_some_and(|a| a.next.is_some())
    }

    /// Whether the roots of any structure, or a new version of one, are still to come.
    pub fn is_settling(&self) -> bool {
        self.attached.iter().flatten().any(|a| !a.ready || a.next.is_some())
    }

    /// Whether the roots of a structure have come.
    pub fn is_ready(&self, id: StructureId) -> bool {
        self.get(id).is_some_and(|a| a.ready)
    }

    /// The structure of this name; none where it has gone.
    pub fn structure(&self, id: StructureId) -> Option<&Structure> {
        self.get(id).map(|a| &a.structure)
    }

    /// Its pages in the page table.
    pub fn span(&self, id: StructureId) -> Option<&Span> {
        self.get(id).map(|a| &a.span)
    }

    /// Names of all structures.
    pub fn structures(&self) -> impl Iterator<Item = StructureId> {
        let name =
            |(index, a): (u32, &Option<Attached>)| a.as_ref().map(|a| StructureId { index, attachment: a.attachment });
        (0..).zip(&self.attached).filter_map(name)
    }

    /// From the next frame on, receivers for which the index is enough ask for no pages, in all structures: at first with an
    /// error of 0, where light and shadow are the same to the bit; with an error in lattice steps also where what stands above
    /// a page is off by at most that. None: every receiver asks for the pages on its way.
    pub fn skip(&mut self, error: Option<u32>) {
        self.skips = error;
        self.attached.iter_mut().flatten().for_each(|a| a.skips = error);
        self.changed = true;
    }

    /// Says that what was baked for a rectangle of texels is out of date: answers there go on as they are and say so, until
    /// a new version takes the structure's place or [`clear_stale`](Self::clear_stale). At most 64 rectangles are kept for all
    /// structures; when they are used up, those of this structure grow together.
    ///
    /// # Errors
    /// The structure has gone, or other structures have all rectangles.
    pub fn mark_stale(&mut self, id: StructureId, rect: Rect) -> Result<(), RuntimeError> {
        let used: usize = self.attached.iter().flatten().map(|a| a.stale.len()).sum();
        let attached = self.get_mut(id).ok_or(RuntimeError::Gone)?;
        if rect.is_empty() || attached.stale.iter().any(|r| r.union(rect) == *r) {
            return Ok(());
        }
        if used < STALE_RECTS as usize {
            attached.stale.push(rect);
        } else {
            let growth = |r: &&mut Rect| r.union(rect).area() - r.area();
            let nearest = attached.stale.iter_mut().min_by_key(growth);
            let nearest = nearest.ok_or(RuntimeError::Stale { most: STALE_RECTS })?;
            *nearest = nearest.union(rect);
        }
        self.changed = true;
        Ok(())
    }

    /// No region of a structure is stale any more.
    pub fn clear_stale(&mut self, id: StructureId) {
        if let Some(attached) = self.get_mut(id) {
            attached.stale.clear();
            self.changed = true;
        }
    }

    /// What the device must know of the structures, if that has changed since the last call: for each number a map, and the
    /// stale rectangles that maps refer to.
    pub fn maps(&mut self) -> Option<(Vec<Map>, Vec<Rect>)> {
        if !std::mem::take(&mut self.changed) {
            return None;
        }
        let (mut maps, mut stale) = (Vec::new(), Vec::new());
        for attached in &self.attached {
            maps.push(match attached {
                Some(a) if a.ready => Map {
                    base: a.span.base,
                    log2_resolution: a.structure.record().log2_resolution.into(),
                    kind: a.structure.kind().code(),
                    skips: a.skips.is_some().into(),
                    error: a.skips.unwrap_or(0),
                    stale_first: stale.len() as u32,
                    stale_count: a.stale.len() as u32,
                    unused: 0,
                },
                _ => Map::NONE,
            });
            stale.extend(attached.iter().flat_map(|a| a.stale.iter().copied()));
        }
        Some((maps, stale))
    }

    /// Structures whose roots have come begin to answer; new versions take the place of old ones.
    pub(super) fn flip(&mut self) {
        for index in 0..self.attached.len() {
            let Some(attached) = self.attached.get_mut(index).and_then(Option::as_mut) else { continue };
            if !attached.ready && self.residency.is_rooted(&attached.span) {
                attached.ready = true;
                self.changed = true;
            }
            let Some(next) = attached.next.as_mut().filter(|n| self.residency.is_rooted(&n.span)) else { continue };
            let of = |s: &Structure| (s.kind(), s.record().log2_resolution);
            let akin = of(&next.structure) == of(&attached.structure);
            match &mut next.stage {
                Stage::Roots if akin => {
                    self.surveys += 1;
                    next.stage = Stage::Survey(self.surveys);
                    let what = What::Survey(self.surveys, self.residency.contents(&attached.span));
                    self.in_flight += 1;
                    let Span { number, base, .. } = next.span;
                    self.loader.order(Order { structure: next.structure.clone(), number, base, what });
                }
                Stage::Roots => {
                    self.residency.detach(attached.span.base);
                    self.switch(index, |_| true);
                }
                Stage::Survey(_) => {}
                Stage::Found(pages) => {
                    let pages = std::mem::take(pages);
                    next.stage = Stage::Placed;
                    self.residency.retire(attached.span.base, KEEP);
                    self.residency.take_over(pages);
                }
                Stage::Placed if self.residency.is_told() => self.switch(index, |_| true),
                Stage::Placed => {}
            }
        }
    }

    /// A thread has looked for unchanged pages of a new version.
    pub(super) fn surveyed(&mut self, number: u64, pages: Vec<LoadedPage>) {
        let mut all = self.attached.iter_mut().flatten().filter_map(|a| a.next.as_mut());
        // Else it has gone meanwhile.
        if let Some(next) = all.find(|n| matches!(n.stage, Stage::Survey(own) if own == number)) {
            next.stage = Stage::Found(pages);
        }
    }

    /// The new version of a structure answers from now on, where its stage is one that counts.
    fn switch(&mut self, index: usize, counts: impl Fn(&Stage) -> bool) {
        let Some(attached) = self.attached.get_mut(index).and_then(Option::as_mut) else { return };
        let Some(next) = attached.next.take_if(|n| counts(&n.stage)) else { return };
        if matches!(next.stage, Stage::Placed) {
            self.residency.thaw();
        }
        attached.foresight = Foresight::new(next.structure.lattice());
        (attached.structure, attached.span, attached.needs) = (next.structure, next.span, next.needs);
        attached.stale.clear();
        attached.ready = true;
        self.changed = true;
    }

    pub(super) fn get(&self, id: StructureId) -> Option<&Attached> {
        self.attached.get(id.index as usize)?.as_ref().filter(|a| a.attachment == id.attachment)
    }

    fn get_mut(&mut self, id: StructureId) -> Option<&mut Attached> {
        self.attached.get_mut(id.index as usize)?.as_mut().filter(|a| a.attachment == id.attachment)
    }

    /// The structure, attached or about to be, that a place in the table belongs to.
    pub(super) fn owner(&self, ordinal: u32) -> Option<(&Structure, &Span)> {
        let mut versions = self.attached.iter().flatten().flat_map(Attached::versions);
        versions.find(|(_, span)| span.contains(ordinal))
    }

    /// Name and first place of that structure.
    pub(super) fn id_of(&self, ordinal: u32) -> Option<(StructureId, u32)> {
        (0..).zip(&self.attached).find_map(|(index, attached)| {
            let a = attached.as_ref()?;
            let (_, span) = a.versions().find(|(_, span)| span.contains(ordinal))?;
            Some((StructureId { index, attachment: a.attachment }, span.base))
        })
    }
}
