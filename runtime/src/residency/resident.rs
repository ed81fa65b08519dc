//! The pages that live in the pool, who needs whom, and who goes first.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::sync::Arc;

use umbrage_reader::query::Bounds;

/// A page in the pool.
#[derive(Debug, Clone)]
pub struct Resident {
    /// First word.
    pub at: u32,
    /// Words of the page.
    pub words: u32,
    /// Ordinal of its first child.
    pub first_child: u32,
    /// Its children.
    pub child_count: u16,
    /// What the index says of each, in order; empty where that is not known.
    pub children: Arc<[Bounds]>,
    /// Pages above it; for a shared page those above the first that asked for it.
    pub depth: u32,
    /// Round of its last use.
    pub stamp: u64,
    /// Resident pages that need it.
    pub dependents: u32,
    /// Parent and dependencies, all resident.
    pub needs: Vec<u32>,
    /// Never evicted.
    pub pinned: bool,
}

impl Resident {
    fn may_go(&self) -> bool {
        self.dependents == 0 && !self.pinned
    }
}

/// All of them, with the orders in which they go.
#[derive(Debug, Default)]
pub struct Residents {
    pages: HashMap<u32, Resident>,
    /// First child to (end of children, parent).
    children: BTreeMap<u32, (u32, u32)>,
    /// Those that nobody needs, by last use.
    by_stamp: BTreeSet<(u64, u32)>,
    /// The same, by depth.
    by_depth: BTreeSet<(u32, u32)>,
}

impl Residents {
    pub fn get(&self, ordinal: u32) -> Option<&Resident> {
        self.pages.get(&ordinal)
    }

    pub fn len(&self) -> usize {
        self.pages.len()
    }

    #[cfg(test)]
    pub fn iter(&self) -> impl Iterator<Item = (u32, &Resident)> {
        self.pages.iter().map(|(&o, r)| (o, r))
    }

    /// The resident page of which `ordinal` is a child.
    pub fn parent(&self, ordinal: u32) -> Option<u32> {
        let (_, &(end, parent)) = self.children.range(..=ordinal).next_back()?;
        (ordinal < end).then_some(parent)
    }

    /// What the index says of a page whose parent is resident.
    pub fn bounds(&self, ordinal: u32) -> Option<Bounds> {
        let parent = self.get(self.parent(ordinal)?)?;
        parent.children.get(ordinal.checked_sub(parent.first_child)? as usize).copied()
    }

    /// Applies a change to a page and keeps the orders right.
    fn change<T>(&mut self, ordinal: u32, f: impl FnOnce(&mut Resident) -> T) -> Option<T> {
        let page = self.pages.get_mut(&ordinal)?;
        if page.may_go() {
            self.by_stamp.remove(&(page.stamp, ordinal));
            self.by_depth.remove(&(page.depth, ordinal));
        }
        let out = f(page);
        if page.may_go() {
            self.by_stamp.insert((page.stamp, ordinal));
            self.by_depth.insert((page.depth, ordinal));
        }
        Some(out)
    }

    pub fn insert(&mut self, ordinal: u32, page: Resident) {
        for &need in &page.needs {
            self.change(need, |p| p.dependents += 1);
        }
        if page.child_count != 0 {
            let end = page.first_child.saturating_add(page.child_count.into());
            self.children.insert(page.first_child, (end, ordinal));
        }
        self.pages.insert(ordinal, page);
        self.change(ordinal, |_| ());
    }

    pub fn remove(&mut self, ordinal: u32) -> Option<Resident> {
        // Out of the orders first, then out of the table.
        let pinned = self.change(ordinal, |p| std::mem::replace(&mut p.pinned, true))?;
        let page = Resident { pinned, ..self.pages.remove(&ordinal)? };
        if page.child_count != 0 {
            self.children.remove(&page.first_child);
        }
        for &need in &page.needs {
            self.change(need, |p| p.dependents -= 1);
        }
        Some(page)
    }

    /// Notes a use of a page and of all that it needs.
    pub fn touch(&mut self, ordinal: u32, round: u64) {
        let mut open = vec![ordinal];
        while let Some(next) = open.pop() {
            let fresh = self.change(next, |p| {
                let fresh = p.stamp < round;
                p.stamp = p.stamp.max(round);
                fresh
            });
            // A page in its grace was admitted beside pages that were in use.
            if fresh == Some(true)
                && let Some(page) = self.pages.get(&next)
            {
                open.extend(&page.needs);
            }
        }
    }

    /// New place of a page; gives its words.
    pub fn relocate(&mut self, ordinal: u32, to: u32) -> u32 {
        self.pages.get_mut(&ordinal).map_or(0, |p| {
            p.at = to;
            p.words
        })
    }

    /// Who goes for a page of `depth`: the least recently used if it was not used in this round, else, for a page that
    /// somebody needs now, one that is deeper than the newcomer and past its grace.
    pub fn victim(&self, depth: u32, round: u64, needed: bool) -> Option<u32> {
        let &(stamp, oldest) = self.by_stamp.first()?;
        if stamp < round {
            return Some(oldest);
        }
        if !needed {
            return None;
        }
        let &(deepest, ordinal) = self.by_depth.last()?;
        (deepest > depth && self.pages.get(&ordinal).is_some_and(|p| p.stamp <= round)).then_some(ordinal)
    }
}
