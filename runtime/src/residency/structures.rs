//! Structures that come, go and are replaced.

use std::collections::HashMap;
use std::ops::Range;
use std::sync::Arc;

use super::heirs::Content;
use super::resident::Resident;
use super::{Child, LoadedPage, Residency, Span, State, TableFull};

impl Residency {
    /// A structure takes a place in the page table, and its roots are wanted; gives where. `shared` of its `pages` are
    /// shared ones, at the end; `roots`: what the index says of each root.
    ///
    /// # Errors
    /// No gap in the table is long enough.
    pub fn attach(&mut self, pages: u32, shared: u32, roots: Arc<[Child]>) -> Result<Span, TableFull> {
        let span = self.spans.add(pages, shared, roots)?;
        self.unrooted.push(span.base);
        self.want_roots();
        Ok(span)
    }

    /// The structure whose first place is `base` goes, with all of its pages; nothing may walk it any more. `false` where
    /// there is none. Its places are free some frames later, when the device knows.
    pub fn detach(&mut self, base: u32) -> bool {
        let Some(places) = self.take_out(base) else { return false };
        self.drop_pages(places);
        true
    }

    /// As [`detach`](Self::detach), but pages that another structure of the same kind and resolution has unchanged go on in
    /// their slots when that one wants them, within so many `frames`; until then they are the first to go.
    pub fn retire(&mut self, base: u32, frames: u64) -> bool {
        let Some(places) = self.take_out(base) else { return false };
        let mut pages: Vec<(Content, u32)> = Vec::new();
        for ordinal in self.residents.within(places) {
            self.residents.cut_off(ordinal);
            if let Some(content) = self.content(ordinal) {
                pages.push((content, ordinal));
            }
        }
        self.heirs.add(base, self.frames + frames, pages.into_iter());
        true
    }

    /// What the pages of a structure hold that live in the pool, and how many hold it.
    pub fn contents(&self, span: &Span) -> HashMap<Content, u32> {
        let mut contents = HashMap::new();
        for ordinal in self.residents.within(span.base..span.end()) {
            if let Some(content) = self.content(ordinal) {
                *contents.entry(content).or_default() += 1;
            }
        }
        contents
    }

    /// Pages of a new version, parents first and without words, take the slots of equal ones of the version that was
    /// [retired](Self::retire) at once. What was walked before can still be walked: until [`thaw`](Self::thaw) nothing comes,
    /// goes or moves, and [`is_told`](Self::is_told) says when the device knows all of them.
    pub fn take_over(&mut self, pages: Vec<LoadedPage>) {
        self.frozen += 1;
        for page in pages {
            let parent = self.residents.parent(page.ordinal);
            let depth = parent.and_then(|p| self.residents.get(p)).map(|p| p.depth + 1);
            let known = self.is_resident(page.ordinal) || self.spans.find(page.ordinal).is_none();
            let (Some(parent), Some(depth), false) = (parent, depth, known) else { continue };
            let place = self.heir(page.ordinal).and_then(|heir| self.inherit(heir, page.ordinal));
            let Some(Resident { at, words, worth, .. }) = place else { continue };
            self.forget(page.ordinal);
            self.settle(page, [at, words], [depth, worth], vec![parent], false);
        }
    }

    /// Whether the device knows of every page where it is.
    pub fn is_told(&self) -> bool {
        self.dirty.is_empty()
    }

    /// The version for which [`take_over`](Self::take_over) was called answers.
    pub fn thaw(&mut self) {
        self.frozen = self.frozen.saturating_sub(1);
    }

    /// Whether a page's words need not be read, because the pool has them from the version before. What is handed to
    /// [`loaded`](Self::loaded) has no words then.
    pub fn is_kept(&self, ordinal: u32) -> bool {
        self.heir(ordinal).is_some()
    }

    /// Whether all roots of a structure live in the pool.
    pub fn is_rooted(&self, span: &Span) -> bool {
        span.root_places().all(|r| self.is_resident(r))
    }

    /// Whether every root of all structures lives in the pool.
    pub fn roots_resident(&self) -> bool {
        self.spans.live().iter().all(|s| self.is_rooted(s))
    }

    /// What the index says of a page, where that is known.
    pub(super) fn told(&self, ordinal: u32) -> Option<&Child> {
        let root = |s: &'_ Span| s.is_root(ordinal).then(|| (ordinal - s.base) as usize);
        match self.spans.find(ordinal).and_then(|s| s.roots.get(root(s)?)) {
            Some(root) => Some(root),
            None => self.residents.told(ordinal),
        }
    }

    /// Of a resident page.
    fn content(&self, ordinal: u32) -> Option<Content> {
        let page = self.residents.get(ordinal)?;
        Some((page.hash?, page.words))
    }

    /// The page of a replaced version that holds what a page holds.
    pub(super) fn heir(&self, ordinal: u32) -> Option<u32> {
        if self.heirs.is_empty() {
            return None;
        }
        let content = self.told(ordinal)?.content()?;
        // Its place may have been another's once.
        self.heirs.find(content, |o| self.spans.find(o).is_none() && self.content(o) == Some(content))
    }

    /// A page takes the place of a page of a replaced version, which is given.
    pub(super) fn inherit(&mut self, heir: u32, ordinal: u32) -> Option<Resident> {
        let page = self.residents.remove(heir)?;
        self.slots.hand_over(page.at, ordinal);
        self.stats.resident_words -= u64::from(page.words);
        self.stats.kept += 1;
        Some(page)
    }

    /// Asks for roots that are not there: also for those that could not be read, when their time has come.
    pub(super) fn want_roots(&mut self) {
        let mut unrooted = std::mem::take(&mut self.unrooted);
        unrooted.retain(|base| {
            let Some(span) = self.spans.find(*base).cloned() else { return false };
            for root in span.root_places() {
                self.want(root, 0, self.round, u32::MAX, true);
            }
            !self.is_rooted(&span)
        });
        self.unrooted = unrooted;
    }

    /// What is left of replaced versions whose time is over.
    pub(super) fn bury(&mut self) {
        while let Some(base) = self.heirs.over(self.frames) {
            if let Some(places) = self.spans.gone(base) {
                self.drop_pages(places);
            }
        }
    }

    /// Frees places of which neither the device nor a thread has anything any more.
    pub(super) fn free_spans(&mut self) {
        if !self.spans.has_gone() {
            return;
        }
        let (untold, wants, heirs) = (&self.untold, &self.wants, &self.heirs);
        self.spans.free(|s| {
            untold.iter().any(|u| u.0 < s.end() && s.base < u.1)
                || wants.keys().any(|o| s.contains(*o))
                || heirs.has(s.base)
        });
    }

    /// A structure is no longer one: nothing of it is asked for.
    fn take_out(&mut self, base: u32) -> Option<Range<u32>> {
        let span = self.spans.remove(base)?;
        let places = span.base..span.end();
        self.failures.forget_all(&places);
        self.untold.retain(|u| !places.contains(&u.0));
        let wanted: Vec<u32> = self.wants.keys().copied().filter(|o| places.contains(o)).collect();
        for ordinal in wanted {
            // What is being read stays until it has come: its place is not free before.
            if !self.wants.get(&ordinal).is_some_and(|w| matches!(w.state, State::Loading)) {
                self.forget(ordinal);
            }
        }
        Some(places)
    }

    /// A page is wanted no more.
    fn forget(&mut self, ordinal: u32) {
        if !self.forget_load(ordinal)
            && self.unready(ordinal, None).is_none()
            && let Some(want) = self.wants.remove(&ordinal)
        {
            self.queue.remove(&want.rank(ordinal));
        }
    }

    /// All pages of places go, and the device is told so.
    fn drop_pages(&mut self, places: Range<u32>) {
        for ordinal in self.residents.within(places.clone()) {
            if let Some(page) = self.residents.remove(ordinal) {
                self.slots.free(page.at);
                self.stats.resident_words -= u64::from(page.words);
                self.stats.evicted += 1;
            }
        }
        if !places.is_empty() {
            self.untold.push_back((places.start, places.end));
        }
    }
}
