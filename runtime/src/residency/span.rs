//! Which entries of the page table belong to which structure.

use std::sync::Arc;

use super::Child;

/// A structure's pages in the table: page `o` of the structure is page `base + o` there.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Span {
    /// Tells it from others that had or will have the same places.
    pub number: u64,
    /// Place of its first page.
    pub base: u32,
    /// Its pages, shared ones included.
    pub pages: u32,
    /// Shared pages at the end.
    pub shared: u32,
    /// What the index says of each root; pages 0 to their number are the roots.
    pub roots: Arc<[Child]>,
}

impl Span {
    /// Place behind its last page.
    pub fn end(&self) -> u32 {
        self.base + self.pages
    }

    /// Whether a place in the table is one of its own.
    pub fn contains(&self, ordinal: u32) -> bool {
        (self.base..self.end()).contains(&ordinal)
    }

    /// Places of its roots.
    pub fn root_places(&self) -> std::ops::Range<u32> {
        self.base..self.base + (self.roots.len() as u32).min(self.pages)
    }

    /// Whether a place is that of a root.
    pub fn is_root(&self, ordinal: u32) -> bool {
        self.root_places().contains(&ordinal)
    }

    /// Whether a place is that of a shared page.
    pub fn is_shared(&self, ordinal: u32) -> bool {
        self.contains(ordinal) && ordinal >= self.end() - self.shared.min(self.pages)
    }
}

/// The page table can't take a structure.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error(
    "the page table has {capacity} entries and no {pages} free ones in a row; detach a structure, or make the streamer with a \
     larger table"
)]
pub struct TableFull {
    /// Pages of the structure.
    pub pages: u32,
    /// Entries of the table.
    pub capacity: u32,
}

/// All spans of a table.
#[derive(Debug)]
pub struct Spans {
    capacity: u32,
    /// Structures so far.
    count: u64,
    /// By rising place.
    live: Vec<Span>,
    /// Detached, while the device may still have entries or a thread a page of them.
    gone: Vec<Span>,
}

impl Spans {
    pub fn new(capacity: u32) -> Self {
        Self { capacity, count: 0, live: Vec::new(), gone: Vec::new() }
    }

    /// The structure that a place belongs to.
    pub fn find(&self, ordinal: u32) -> Option<&Span> {
        let behind = self.live.partition_point(|s| s.base <= ordinal);
        self.live.get(behind.checked_sub(1)?).filter(|s| s.contains(ordinal))
    }

    /// All that are attached.
    pub fn live(&self) -> &[Span] {
        &self.live
    }

    /// Takes the first gap that is long enough.
    pub fn add(&mut self, pages: u32, shared: u32, roots: Arc<[Child]>) -> Result<Span, TableFull> {
        let mut taken: Vec<(u32, u32)> = self.live.iter().chain(&self.gone).map(|s| (s.base, s.end())).collect();
        taken.sort_unstable();
        let mut base = 0;
        for (from, to) in taken {
            if from - base >= pages {
                break;
            }
            base = to;
        }
        let full = TableFull { pages, capacity: self.capacity };
        if self.capacity - base < pages {
            return Err(full);
        }
        self.count += 1;
        let span = Span { number: self.count, base, pages, shared, roots };
        let at = self.live.partition_point(|s| (s.base, s.end()) <= (base, span.end()));
        self.live.insert(at, span.clone());
        Ok(span)
    }

    /// A structure goes; its entries stay taken until [`free`](Self::free).
    pub fn remove(&mut self, base: u32) -> Option<Span> {
        let at = self.live.iter().position(|s| s.base == base)?;
        let span = self.live.remove(at);
        self.gone.push(span.clone());
        Some(span)
    }

    /// Places of one that has gone.
    pub fn gone(&self, base: u32) -> Option<std::ops::Range<u32>> {
        self.gone.iter().find(|s| s.base == base).map(|s| s.base..s.end())
    }

    /// Whether any has gone whose places are not free yet.
    pub fn has_gone(&self) -> bool {
        !self.gone.is_empty()
    }

    /// Frees the entries of those that have gone and of which nothing `is_left`.
    pub fn free(&mut self, is_left: impl Fn(&Span) -> bool) {
        self.gone.retain(is_left);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn structures_take_the_first_gap_and_give_it_back() {
        let mut spans = Spans::new(100);
        let add = |spans: &mut Spans, pages| spans.add(pages, 0, Arc::default()).map(|s| s.base);
        assert_eq!([30, 20, 40].map(|p| add(&mut spans, p)), [Ok(0), Ok(30), Ok(50)]);
        assert_eq!(add(&mut spans, 11), Err(TableFull { pages: 11, capacity: 100 }));
        assert_eq!(spans.find(49).map(|s| s.base), Some(30));
        assert_eq!(spans.find(90), None);
        spans.remove(30).unwrap();
        // Gone, and not free yet.
        assert!(spans.find(49).is_none() && add(&mut spans, 20).is_err());
        spans.free(|_| true);
        assert!(add(&mut spans, 20).is_err());
        spans.free(|_| false);
        assert_eq!([15, 5, 10].map(|p| add(&mut spans, p)), [Ok(30), Ok(45), Ok(90)]);
        assert_eq!(spans.live().iter().map(|s| s.base).collect::<Vec<_>>(), [0, 30, 45, 50, 90]);
        assert!(spans.remove(1).is_none());
    }

    #[test]
    fn pages_are_roots_shared_or_neither() {
        let child = Child::unknown();
        let span = Span { number: 1, base: 10, pages: 8, shared: 3, roots: vec![child; 2].into() };
        let kinds: Vec<_> = (9..19).map(|o| (span.contains(o), span.is_root(o), span.is_shared(o))).collect();
        let [no, root, tree, shared] =
            [(false, false, false), (true, true, false), (true, false, false), (true, false, true)];
        assert_eq!(kinds, [no, root, root, tree, tree, tree, shared, shared, shared, no]);
    }
}
