//! The pages that live in the pool, who needs whom, and who goes first.
//!
//! Pages that may go stand in a list each, linked through the pages themselves: those that were used last in the same round and are
//! worth about the same. So a frame in which pages are only used moves links and allocates nothing.

use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

use umbrage_reader::query::Bounds;

use super::slots::taken;
use super::{Child, GRACE, HALVED, KEPT};

/// No place.
const NIL: u32 = u32::MAX;
/// The rounds in which a page can have been used last that are not past: this one, those for which it is kept, and those of its
/// grace.
const RECENT: usize = (KEPT + GRACE) as usize + 1;
/// Lists by worth: two for each doubling.
const WORTHS: usize = 64;
/// As many lists lie between a page that is in use and one that takes its place: it is worth more than twice as much.
const APART: usize = 3;

/// The list of pages of this worth.
fn list_of(worth: u32) -> usize {
    let top = worth.max(1).ilog2();
    (2 * top + (worth >> top.saturating_sub(1) & u32::from(top != 0))) as usize
}

/// The list of what is worth that little when it was not used for so many rounds: half after each [`HALVED`].
fn aged(list: usize, rounds: u64) -> usize {
    list.saturating_sub(2 * (rounds / HALVED) as usize)
}

/// Lists of what goes for a page of this worth.
fn lesser(worth: u32) -> usize {
    list_of(worth).saturating_sub(APART - 1)
}

/// A page in the pool.
#[derive(Debug, Clone)]
pub struct Resident {
    /// First word.
    pub at: u32,
    /// Words of the page.
    pub words: u32,
    /// Hash of its content; none of a page that depends on others.
    pub hash: Option<u64>,
    /// Ordinal of its first child.
    pub first_child: u32,
    /// Its children.
    pub child_count: u16,
    /// What the index says of each, in order; empty where that is not known.
    pub children: Arc<[Child]>,
    /// Pages above it; for a shared page those above the first that asked for it.
    pub depth: u32,
    /// What it weighed for its size when it was admitted; see [`Want`](super::Want).
    pub worth: u32,
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
    /// Words that it takes.
    fn slot(&self) -> u64 {
        taken(self.words).into()
    }

    fn may_go(&self) -> bool {
        self.dependents == 0 && !self.pinned
    }
}

/// Both ends of a list.
#[derive(Debug, Clone, Copy)]
struct List {
    head: u32,
    tail: u32,
}

const EMPTY: List = List { head: NIL, tail: NIL };

#[derive(Debug)]
struct Cell {
    ordinal: u32,
    page: Resident,
    /// Before and behind it.
    links: [u32; 2],
}

/// Something for each list of the rounds that are not past.
type Recent<T> = Box<[[T; WORTHS]; RECENT]>;

/// All of them, with the orders in which they go.
#[derive(Debug)]
pub struct Residents {
    cells: Vec<Option<Cell>>,
    free: Vec<u32>,
    places: HashMap<u32, u32>,
    /// First child to (end of children, parent).
    children: BTreeMap<u32, (u32, u32)>,
    /// Last used so long ago that they are kept no more, those that were used least lately first.
    past: List,
    past_words: u64,
    /// Last used in round r, at r modulo their number.
    recent: Recent<List>,
    /// Words of each.
    recent_words: Recent<u64>,
    round: u64,
    /// Pages whose needs are still to be touched.
    open: Vec<u32>,
}

impl Default for Residents {
    fn default() -> Self {
        Self {
            cells: Vec::new(),
            free: Vec::new(),
            places: HashMap::new(),
            children: BTreeMap::new(),
            past: EMPTY,
            past_words: 0,
            recent: Box::new([[EMPTY; WORTHS]; RECENT]),
            recent_words: Box::new([[0; WORTHS]; RECENT]),
            round: 0,
            open: Vec::new(),
        }
    }
}

impl Residents {
    pub fn get(&self, ordinal: u32) -> Option<&Resident> {
        self.cell(*self.places.get(&ordinal)?).map(|c| &c.page)
    }

    pub fn len(&self) -> usize {
        self.places.len()
    }

    #[cfg(test)]
    pub fn iter(&self) -> impl Iterator<Item = (u32, &Resident)> {
        self.cells.iter().flatten().map(|c| (c.ordinal, &c.page))
    }

    /// What the index says of a page's children, where they are as many and nothing has been said before; gives the first.
    pub fn tell(&mut self, ordinal: u32, children: &Arc<[Child]>) -> Option<u32> {
        let place = *self.places.get(&ordinal)?;
        let page = &mut self.cells.get_mut(place as usize)?.as_mut()?.page;
        let fits = page.children.is_empty() && usize::from(page.child_count) == children.len() && !children.is_empty();
        fits.then(|| {
            page.children = children.clone();
            page.first_child
        })
    }

    /// The resident page of which `ordinal` is a child.
    pub fn parent(&self, ordinal: u32) -> Option<u32> {
        let (_, &(end, parent)) = self.children.range(..=ordinal).next_back()?;
        (ordinal < end).then_some(parent)
    }

    /// What the index says of a page whose parent is resident.
    pub fn told(&self, ordinal: u32) -> Option<&Child> {
        let parent = self.get(self.parent(ordinal)?)?;
        parent.children.get(ordinal.checked_sub(parent.first_child)? as usize)
    }

    /// Of that, the bounds of its answers.
    pub fn bounds(&self, ordinal: u32) -> Option<Bounds> {
        self.told(ordinal).map(|c| c.bounds)
    }

    /// A new round begins: what was used too long ago is past.
    pub fn begin(&mut self, round: u64) {
        while self.round < round {
            let over = self.round.checked_sub(KEPT);
            self.round += 1;
            let Some(over) = over.map(|o| o as usize % RECENT) else { continue };
            self.past_words += self.recent_words[over].iter().sum::<u64>();
            self.recent_words[over] = [0; WORTHS];
            for worth in 0..WORTHS {
                let done = std::mem::replace(&mut self.recent[over][worth], EMPTY);
                if done.head == NIL {
                    continue;
                }
                // Behind all that were used earlier.
                match self.past.tail {
                    NIL => self.past.head = done.head,
                    tail => self.link(tail, done.head),
                }
                self.past.tail = done.tail;
            }
        }
    }

    fn cell(&self, place: u32) -> Option<&Cell> {
        self.cells.get(place as usize)?.as_ref()
    }

    fn links(&mut self, place: u32) -> Option<&mut [u32; 2]> {
        self.cells.get_mut(place as usize)?.as_mut().map(|c| &mut c.links)
    }

    /// Makes two places neighbours; either may be none.
    fn link(&mut self, before: u32, behind: u32) {
        if let Some(links) = self.links(before) {
            links[1] = behind;
        }
        if let Some(links) = self.links(behind) {
            links[0] = before;
        }
    }

    fn is_past(&self, stamp: u64) -> bool {
        stamp + KEPT < self.round
    }

    /// The list that a page stands in, and the words of the pages of that.
    fn list(&mut self, (stamp, worth): (u64, u32)) -> (&mut List, &mut u64) {
        if self.is_past(stamp) {
            return (&mut self.past, &mut self.past_words);
        }
        let (round, worth) = (stamp as usize % RECENT, list_of(worth));
        (&mut self.recent[round][worth], &mut self.recent_words[round][worth])
    }

    /// Takes a page out of its list.
    fn leave(&mut self, place: u32) {
        let Some(cell) = self.cell(place) else { return };
        let (page, [before, behind], slot) = ((cell.page.stamp, cell.page.worth), cell.links, cell.page.slot());
        self.link(before, behind);
        let (list, words) = self.list(page);
        *words -= slot;
        if list.head == place {
            list.head = behind;
        }
        if list.tail == place {
            list.tail = before;
        }
    }

    /// Puts a page into its list.
    fn join(&mut self, place: u32) {
        let Some(cell) = self.cell(place) else { return };
        let (page, slot) = ((cell.page.stamp, cell.page.worth), cell.page.slot());
        // Behind all that were used no later: of the past, where needs become free long after their last use, from the front.
        let mut behind = NIL;
        if self.is_past(page.0) {
            behind = self.past.head;
            while let Some(cell) = self.cell(behind).filter(|c| c.page.stamp <= page.0) {
                behind = cell.links[1];
            }
        }
        let tail = self.list(page).0.tail;
        let before = self.cell(behind).map_or(tail, |c| c.links[0]);
        if let Some(links) = self.links(place) {
            *links = [before, behind];
        }
        self.link(before, place);
        self.link(place, behind);
        let (list, words) = self.list(page);
        *words += slot;
        if before == NIL {
            list.head = place;
        }
        if behind == NIL {
            list.tail = place;
        }
    }

    /// Applies a change to a page and keeps the orders right.
    fn change<T>(&mut self, ordinal: u32, f: impl FnOnce(&mut Resident) -> T) -> Option<T> {
        let place = *self.places.get(&ordinal)?;
        if self.cell(place)?.page.may_go() {
            self.leave(place);
        }
        let out = f(&mut self.cells.get_mut(place as usize)?.as_mut()?.page);
        if self.cell(place)?.page.may_go() {
            self.join(place);
        }
        Some(out)
    }

    pub fn insert(&mut self, ordinal: u32, page: Resident) {
        for i in 0..page.needs.len() {
            self.change(page.needs[i], |p| p.dependents += 1);
        }
        if page.child_count != 0 {
            let end = page.first_child.saturating_add(page.child_count.into());
            self.children.insert(page.first_child, (end, ordinal));
        }
        let cell = Some(Cell { ordinal, page, links: [NIL; 2] });
        let place = match self.free.pop() {
            Some(place) => {
                self.cells[place as usize] = cell;
                place
            }
            None => {
                self.cells.push(cell);
                self.cells.len() as u32 - 1
            }
        };
        self.places.insert(ordinal, place);
        if self.cell(place).is_some_and(|c| c.page.may_go()) {
            self.join(place);
        }
    }

    pub fn remove(&mut self, ordinal: u32) -> Option<Resident> {
        let place = self.places.remove(&ordinal)?;
        if self.cell(place)?.page.may_go() {
            self.leave(place);
        }
        let page = self.cells.get_mut(place as usize)?.take()?.page;
        self.free.push(place);
        if page.child_count != 0 {
            self.children.remove(&page.first_child);
        }
        for &need in &page.needs {
            self.change(need, |p| p.dependents -= 1);
        }
        Some(page)
    }

    /// Pages at places of the table.
    pub fn within(&self, places: std::ops::Range<u32>) -> Vec<u32> {
        self.cells.iter().flatten().map(|c| c.ordinal).filter(|o| places.contains(o)).collect()
    }

    /// A page stands for itself from now on: it needs none, none needs it, it has no children and may go.
    pub fn cut_off(&mut self, ordinal: u32) {
        let first_child = self.change(ordinal, |p| {
            p.needs.clear();
            (p.dependents, p.pinned, p.children) = (0, false, Arc::default());
            (p.child_count != 0).then(|| {
                p.child_count = 0;
                p.first_child
            })
        });
        if let Some(first_child) = first_child.flatten() {
            self.children.remove(&first_child);
        }
    }

    /// Notes a use of a page and of all that it needs; the round is one that has [begun](Self::begin).
    pub fn touch(&mut self, ordinal: u32, round: u64) {
        let mut open = std::mem::take(&mut self.open);
        open.push(ordinal);
        while let Some(next) = open.pop() {
            // A page in its grace was admitted beside pages that were in use.
            let fresh = self.get(next).is_some_and(|p| p.stamp < round);
            if fresh {
                self.change(next, |p| p.stamp = round);
                open.extend(self.get(next).map(|p| &p.needs[..]).unwrap_or_default());
            }
        }
        self.open = open;
    }

    /// New place of a page; gives its words.
    pub fn relocate(&mut self, ordinal: u32, to: u32) -> u32 {
        let page = self.places.get(&ordinal).and_then(|&p| self.cells.get_mut(p as usize)?.as_mut());
        page.map_or(0, |c| {
            c.page.at = to;
            c.page.words
        })
    }

    /// Words of the pages that go for any other: those that are kept no more.
    pub fn past_words(&self) -> u64 {
        self.past_words
    }

    /// Words of the pages in use that go for one which somebody needs now.
    pub fn lesser(&self) -> Lesser {
        let mut words = [0; WORTHS + 1];
        for (rounds, lists) in self.in_use(&self.recent_words) {
            for (list, w) in lists.iter().enumerate() {
                words[aged(list, rounds) + 1] += w;
            }
        }
        for list in 0..WORTHS {
            words[list + 1] += words[list];
        }
        Lesser(words)
    }

    /// Something of the rounds for which pages are kept and past their grace, the earliest first: rounds since then, and its lists.
    fn in_use<'a, T>(&self, of: &'a Recent<T>) -> impl Iterator<Item = (u64, &'a [T; WORTHS])> {
        let now = self.round;
        (now.saturating_sub(KEPT)..=now).map(move |r| (now - r, &of[r as usize % RECENT]))
    }

    /// Who goes for a page of this worth: the least recently used if it is kept no more, else, for a page that somebody needs
    /// now, the one that by now is worth least of those that are worth less than half and past their grace; none of those to `spare`,
    /// which were just used.
    pub fn victim(&self, worth: u32, needed: bool, spare: &[u32]) -> Option<u32> {
        if let Some(oldest) = self.cell(self.past.head) {
            return Some(oldest.ordinal);
        }
        if !needed {
            return None;
        }
        let mut least: Option<(usize, u32)> = None;
        for (rounds, lists) in self.in_use(&self.recent) {
            for (list, from) in lists.iter().enumerate() {
                let worth_now = aged(list, rounds);
                if worth_now >= least.map_or(lesser(worth), |l| l.0) {
                    break;
                }
                if let Some(cell) = self.along(from.head).find(|c| !spare.contains(&c.ordinal)) {
                    least = Some((worth_now, cell.ordinal));
                    break;
                }
            }
        }
        least.map(|l| l.1)
    }

    /// The pages of a list, from one on.
    fn along(&self, place: u32) -> impl Iterator<Item = &Cell> {
        std::iter::successors(self.cell(place), |c| self.cell(c.links[1]))
    }
}

/// Words of pages by what they are worth by now: those of all lists before each.
pub struct Lesser([u64; WORTHS + 1]);

impl Lesser {
    /// Words of the pages that go for one of this worth.
    pub fn words(&self, worth: u32) -> u64 {
        self.0[lesser(worth)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What a page is worth in classes, two for each doubling, counted instead of computed.
    fn class(worth: u64, rounds: u64) -> i64 {
        let bounds = (0..32).flat_map(|k| [1u64 << k, (1 << k) + (1 << k) / 2]).skip(2);
        let own = bounds.filter(|b| *b <= worth.max(1)).count() as i64 + i64::from(worth > 1);
        (own - 2 * (rounds / HALVED) as i64).max(0)
    }

    /// Everything by looking at all pages.
    fn naive(pages: &[(u32, u64, u32, u32)], round: u64, worth: u32) -> (u64, Option<i64>, bool) {
        let kept = |stamp: u64| stamp + KEPT >= round;
        let past = pages.iter().any(|p| !kept(p.1));
        let mut words = 0;
        let mut least: Option<i64> = None;
        for &(_, stamp, own, length) in pages.iter().filter(|p| kept(p.1) && p.1 <= round) {
            let now = class(own.into(), round - stamp);
            if now + 3 <= class(worth.into(), 0) {
                words += u64::from(taken(length));
                least = Some(least.map_or(now, |l| l.min(now)));
            }
        }
        (words, least, past)
    }

    #[test]
    fn who_goes_is_whom_looking_at_all_pages_finds() {
        let mut state = 12345u64;
        let mut dice = move |n: u64| {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 33) % n
        };
        let mut residents = Residents::default();
        let mut pages: Vec<(u32, u64, u32, u32)> = Vec::new();
        let (mut round, mut next, mut aged_ones, mut past_ones) = (0, 0, 0, 0);
        for _ in 0..20_000 {
            match dice(8) {
                0 => {
                    round += 1;
                    residents.begin(round);
                }
                3 | 4 if pages.len() < 40 => {
                    let (worth, words, stamp) = (1 << dice(20), 1 + dice(3000) as u32, round + GRACE);
                    let worth = worth + dice(worth.into()) as u32;
                    let page = Resident {
                        at: 0,
                        words,
                        hash: None,
                        first_child: 0,
                        child_count: 0,
                        children: Arc::default(),
                        depth: 0,
                        worth,
                        stamp,
                        dependents: 0,
                        needs: Vec::new(),
                        pinned: false,
                    };
                    residents.insert(next, page);
                    pages.push((next, stamp, worth, words));
                    next += 1;
                }
                1 | 2 | 5 | 6 if !pages.is_empty() => {
                    let i = dice(pages.len() as u64) as usize;
                    residents.touch(pages[i].0, round);
                    pages[i].1 = pages[i].1.max(round);
                }
                7 if pages.len() > 30 => {
                    let gone = pages.swap_remove(dice(pages.len() as u64) as usize);
                    residents.remove(gone.0);
                }
                _ => {}
            }
            let worth = (1u32 << dice(20)) + dice(1000) as u32;
            let (words, least, past) = naive(&pages, round, worth);
            assert_eq!(residents.lesser().words(worth), words);
            let own = |o: u32| *pages.iter().find(|p| p.0 == o).unwrap();
            match residents.victim(worth, true, &[]) {
                Some(o) if past => {
                    past_ones += 1;
                    assert_eq!(Some(own(o).1), pages.iter().map(|p| p.1).min());
                    residents.remove(o);
                    pages.retain(|p| p.0 != o);
                }
                found => {
                    assert!(!past);
                    let now = found.map(own).map(|p| class(p.2.into(), round - p.1));
                    assert_eq!(now, least);
                    aged_ones += u32::from(found.is_some_and(|o| round - own(o).1 >= HALVED));
                }
            }
        }
        assert!(aged_ones > 1000 && past_ones > 100, "{aged_ones} {past_ones}");
    }
}
