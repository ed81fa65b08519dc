//! Which pages live in the pool: a state machine without threads, files or GPU.
//!
//! In: what was asked for and used ([`Residency::feedback`], [`Residency::request`]), pages that came
//! ([`Residency::loaded`]) or did not ([`Residency::failed`]). Out: ordinals to load ([`Residency::loads`]), and for
//! each frame copies and table entries ([`Residency::frame`]), which any executor can carry out in order.
//!
//! - A page is admitted only while its parent and its dependencies live, and outlives none of them.
//! - Roots are pinned. Of the others the least recently used goes first; one that was used in the latest round goes
//!   only for a page nearer to the root, which answers more.
//! - Coarse pages come first. What finds no room is parked and counted ([`Stats::starved`]).
//! - A page that fails is tried again after 2, 4, … 256 frames.
//!
//! Rooms: [`budget`] divides the bytes, [`slots`] finds places, `failure` counts tries.

pub mod budget;
mod failure;
mod resident;
pub mod slots;
#[cfg(test)]
mod tests;

use std::collections::{BTreeSet, HashMap};
use std::sync::Arc;

pub use budget::{Budget, BudgetError};

use crate::query::pool::NOT_RESIDENT;
use budget::{BLOCK_BYTES, MAX_DIRTY};
use failure::Failures;
use resident::{Resident, Residents};
use slots::{BLOCK_WORDS, Slots, UNIT_WORDS, class_of};

/// Rounds for which a page is kept that has come and can't have been used yet: feedback is late by that much.
const GRACE: u64 = 3;
/// Rounds after which a page is no longer wanted that nobody asks for.
const PATIENCE: u64 = 6;
/// Frames for which a page is parked that found no room.
const PARKED: u64 = 8;

/// What the state machine must know of a structure and its budget.
#[derive(Debug, Clone, Copy)]
pub struct Config {
    /// Pages of the structure, shared ones included.
    pub pages: u32,
    /// Roots: pages 0 to `roots`.
    pub roots: u32,
    /// Shared pages at the end.
    pub shared: u32,
    /// Blocks of the pool.
    pub blocks: u32,
    /// Bytes of pages that a frame can upload, at least one block.
    pub frame_bytes: u64,
    /// Bytes of pages in host memory, those being loaded counted as the largest page.
    pub host_bytes: u64,
}

/// A page that has been read and checked.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LoadedPage {
    /// Its ordinal.
    pub ordinal: u32,
    /// Ordinal of its first child.
    pub first_child: u32,
    /// Its children.
    pub child_count: u16,
    /// Shared pages it needs.
    pub dependencies: Vec<u32>,
    /// Its words, frame included, in host order; in kind `mmh` the dependencies behind them.
    pub words: Arc<[u32]>,
}

/// One step on the pool's words, to be carried out in order.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Op {
    /// Write a page.
    Upload {
        /// First word.
        at: u32,
        /// The page's words.
        words: Arc<[u32]>,
    },
    /// Copy a page to another place; the places do not overlap.
    Move {
        /// First word now.
        from: u32,
        /// First word after.
        to: u32,
        /// Words of the page.
        words: u32,
    },
}

/// What to do before the queries of a frame.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Frame {
    /// Copies, in order.
    pub ops: Vec<Op>,
    /// Page table: ordinal and its entry, ordinals rising.
    pub table: Vec<(u32, [u32; 2])>,
}

/// Totals since the start, and the state after the last frame.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Stats {
    /// Pages that live in the pool.
    pub resident: u32,
    /// Their words.
    pub resident_words: u64,
    /// Pages that are wanted and not in the pool: asked for, being loaded, parked.
    pub wanted: u32,
    /// Of those, the ones that found no room: the starvation signal.
    pub starved: u32,
    /// Pages whose last try to load failed.
    pub failing: u32,
    /// Pages admitted.
    pub admitted: u64,
    /// Pages evicted.
    pub evicted: u64,
    /// Pages moved within the pool.
    pub moved: u64,
    /// Bytes of pages uploaded.
    pub uploaded_bytes: u64,
}

#[derive(Debug)]
enum State {
    Queued,
    Loading,
    Ready(LoadedPage),
    /// Found no room; to be tried again at this frame.
    Parked(u64),
    /// Read, then dropped until these pages live.
    Waiting(Vec<u32>),
}

#[derive(Debug)]
struct Want {
    depth: u32,
    asked: u64,
    /// Its size, known once it has been read.
    class: Option<u8>,
    state: State,
}

enum Room {
    Found,
    None,
    /// The frame's table entries are used up.
    NotNow,
}

/// The state machine.
#[derive(Debug)]
pub struct Residency {
    config: Config,
    slots: Slots,
    residents: Residents,
    wants: HashMap<u32, Want>,
    queue: BTreeSet<(u32, u32)>,
    ready: BTreeSet<(u32, u32)>,
    loading: u64,
    ready_bytes: u64,
    failures: Failures,
    dirty: BTreeSet<u32>,
    round: u64,
    frames: u64,
    stats: Stats,
}

impl Residency {
    /// Nothing resident, the roots wanted.
    pub fn new(config: Config) -> Self {
        let mut this = Self {
            config,
            slots: Slots::new(config.blocks),
            residents: Residents::default(),
            wants: HashMap::new(),
            queue: BTreeSet::new(),
            ready: BTreeSet::new(),
            loading: 0,
            ready_bytes: 0,
            failures: Failures::default(),
            dirty: BTreeSet::new(),
            round: 0,
            frames: 0,
            stats: Stats::default(),
        };
        for root in 0..config.roots.min(config.pages) {
            this.want(root, 0, 0);
        }
        this
    }

    /// Whether every root lives in the pool.
    pub fn roots_resident(&self) -> bool {
        (0..self.config.roots.min(self.config.pages)).all(|r| self.is_resident(r))
    }

    /// Whether a page lives in the pool.
    pub fn is_resident(&self, ordinal: u32) -> bool {
        self.residents.get(ordinal).is_some()
    }

    /// The table entry of a page.
    pub fn entry(&self, ordinal: u32) -> [u32; 2] {
        self.residents.get(ordinal).map_or([NOT_RESIDENT, 0], |r| [r.at, r.first_child])
    }

    /// Totals and state.
    pub fn stats(&self) -> Stats {
        let starved = self.wants.values().filter(|w| matches!(w.state, State::Parked(_))).count();
        Stats {
            resident: self.residents.len() as u32,
            wanted: self.wants.len() as u32,
            starved: starved as u32,
            failing: self.failures.len() as u32,
            ..self.stats
        }
    }

    /// Asks for a page. Nothing happens where its parent does not live in the pool (the walk never came there), where
    /// it failed a short while ago, or where there is no such page.
    pub fn request(&mut self, ordinal: u32) {
        let shared = ordinal >= self.config.pages.saturating_sub(self.config.shared);
        let depth = match self.residents.parent(ordinal).and_then(|p| self.residents.get(p)) {
            Some(parent) => parent.depth + 1,
            None if ordinal < self.config.roots => 0,
            None if shared => 1,
            None => return,
        };
        self.want(ordinal, depth, self.round);
    }

    fn want(&mut self, ordinal: u32, depth: u32, asked: u64) {
        if ordinal >= self.config.pages || self.is_resident(ordinal) || self.failures.waits(ordinal, self.frames) {
            return;
        }
        let want = self.wants.entry(ordinal).or_insert_with(|| {
            self.queue.insert((depth, ordinal));
            Want { depth, asked, class: None, state: State::Queued }
        });
        want.asked = want.asked.max(asked);
    }

    /// One round of feedback: ordinals that walks missed, and one bit for each unit of the pool that holds a page in
    /// which a walk ended. `overflow`: more were missed than are listed.
    pub fn feedback(&mut self, missed: &[u32], used: &[u32], overflow: bool) {
        self.round += 1;
        for (i, &bits) in (0u32..).zip(used) {
            let mut bits = bits;
            while bits != 0 {
                let unit = i * 32 + bits.trailing_zeros();
                bits &= bits - 1;
                // A page that took the place of the one that was used lives a round longer.
                if let Some(owner) = unit.checked_mul(UNIT_WORDS).and_then(|w| self.slots.owner(w)) {
                    self.residents.touch(owner, self.round);
                }
            }
        }
        for &ordinal in missed {
            self.request(ordinal);
        }
        if overflow {
            self.wants.values_mut().for_each(|w| w.asked = self.round);
        }
    }

    /// Ordinals to load now, coarse pages first; none while host memory is spoken for.
    pub fn loads(&mut self) -> Vec<u32> {
        let mut out = Vec::new();
        while (self.loading + 1) * BLOCK_BYTES + self.ready_bytes <= self.config.host_bytes {
            let Some(&(depth, ordinal)) = self.queue.first() else { break };
            self.queue.pop_first();
            let Some(want) = self.wants.get_mut(&ordinal) else { continue };
            // A page that was never read may be of any size: one at a time is tried.
            let room = match want.class {
                Some(class) => self.slots.has_room(class),
                None if self.loading == 0 && self.ready.is_empty() => self.slots.has_any_room(),
                None => self.slots.has_room(0),
            };
            let hopeless = !room && self.residents.victim(depth, self.round).is_none();
            if hopeless {
                // Reading what can't be kept would only wear the disk.
                want.state = State::Parked(self.frames + PARKED);
                continue;
            }
            want.state = State::Loading;
            self.loading += 1;
            out.push(ordinal);
        }
        out
    }

    /// A page that [`loads`](Self::loads) named has come.
    pub fn loaded(&mut self, page: LoadedPage) {
        self.failures.forget(page.ordinal);
        let Some(want) = self.wants.get_mut(&page.ordinal).filter(|w| matches!(w.state, State::Loading)) else {
            return;
        };
        self.loading -= 1;
        self.ready_bytes += page.words.len() as u64 * 4;
        self.ready.insert((want.depth, page.ordinal));
        want.class = class_of(page.words.len() as u32);
        want.state = State::Ready(page);
    }

    /// A page that [`loads`](Self::loads) named could not be read; `true` the first time, when it is to be reported.
    pub fn failed(&mut self, ordinal: u32) -> bool {
        if self.wants.get(&ordinal).is_some_and(|w| matches!(w.state, State::Loading)) {
            self.loading -= 1;
            self.wants.remove(&ordinal);
        }
        self.failures.note(ordinal, self.frames)
    }

    /// Admits what has come, as far as the frame's bytes reach.
    pub fn frame(&mut self) -> Frame {
        self.frames += 1;
        let mut frame = Frame::default();
        let mut bytes = 0;
        for (depth, ordinal) in self.ready.clone() {
            let Some(Want { state: State::Ready(page), .. }) = self.wants.get(&ordinal) else { continue };
            let page_bytes = page.words.len() as u64 * 4;
            if bytes + page_bytes > self.config.frame_bytes || self.dirty.len() as u64 >= MAX_DIRTY {
                break;
            }
            let root = ordinal < self.config.roots;
            let parent = self.residents.parent(ordinal);
            let orphan = parent.is_none() && !root && ordinal < self.config.pages.saturating_sub(self.config.shared);
            let class = class_of(page.words.len() as u32).filter(|_| !orphan);
            let mut needs = page.dependencies.clone();
            needs.extend(parent);
            let Some(class) = class else {
                self.unready(ordinal, None);
                continue;
            };
            // They must not make room for the page that needs them.
            needs.iter().for_each(|&n| self.residents.touch(n, self.round));
            if needs.iter().any(|&n| !self.is_resident(n)) {
                self.unready(ordinal, Some(State::Waiting(needs)));
                continue;
            }
            match self.make_room(class, depth, &mut frame) {
                Room::Found => {}
                Room::NotNow => break,
                Room::None => {
                    self.unready(ordinal, Some(State::Parked(self.frames + PARKED)));
                    continue;
                }
            }
            let Some(at) = self.slots.alloc(class, ordinal) else { continue };
            let Some(page) = self.unready(ordinal, None) else { continue };
            bytes += page_bytes;
            self.stats.admitted += 1;
            self.stats.uploaded_bytes += page_bytes;
            self.stats.resident_words += page.words.len() as u64;
            self.dirty.insert(ordinal);
            let resident = Resident {
                at,
                words: page.words.len() as u32,
                first_child: page.first_child,
                child_count: page.child_count,
                depth,
                stamp: self.round + GRACE,
                dependents: 0,
                needs,
                pinned: root,
            };
            self.residents.insert(ordinal, resident);
            frame.ops.push(Op::Upload { at, words: page.words });
        }
        self.revise();
        let dirty = std::mem::take(&mut self.dirty);
        frame.table = dirty.into_iter().map(|o| (o, self.entry(o))).collect();
        frame
    }

    /// Takes a page out of the ready ones: to another state, or out of the wanted.
    fn unready(&mut self, ordinal: u32, state: Option<State>) -> Option<LoadedPage> {
        let want = self.wants.get_mut(&ordinal)?;
        let next = state.unwrap_or(State::Queued);
        let gone = matches!(next, State::Queued);
        let depth = want.depth;
        let State::Ready(page) = std::mem::replace(&mut want.state, next) else { return None };
        self.ready.remove(&(depth, ordinal));
        self.ready_bytes -= page.words.len() as u64 * 4;
        if gone {
            self.wants.remove(&ordinal);
        }
        Some(page)
    }

    /// Room for a page of a class; where there is none whoever goes, everybody stays: what was evicted for nothing would
    /// be read again, for ever.
    fn make_room(&mut self, class: u8, depth: u32, frame: &mut Frame) -> Room {
        let mut gone = Vec::new();
        let room = loop {
            if self.slots.has_room(class) {
                break Room::Found;
            }
            // A compaction changes as many entries as a block has slots.
            let dirty = (self.dirty.len() + gone.len()) as u64;
            if dirty + u64::from(BLOCK_WORDS / UNIT_WORDS) + 1 > MAX_DIRTY {
                break Room::NotNow;
            }
            // It frees a block, which is room for any class.
            if let Some(moved) = self.slots.compact() {
                for m in moved {
                    let words = self.residents.relocate(m.owner, m.to);
                    frame.ops.push(Op::Move { from: m.from, to: m.to, words });
                    self.dirty.insert(m.owner);
                    self.stats.moved += 1;
                }
                continue;
            }
            let Some(victim) = self.residents.victim(depth, self.round) else { break Room::None };
            if let Some(page) = self.residents.remove(victim) {
                self.slots.free(page.at);
                gone.push((victim, page));
            }
        };
        if matches!(room, Room::None) {
            // Parents went after their children.
            for (ordinal, page) in gone.into_iter().rev() {
                self.slots.take_back(page.at, ordinal);
                self.residents.insert(ordinal, page);
            }
            return room;
        }
        for (ordinal, page) in gone {
            self.stats.resident_words -= u64::from(page.words);
            self.stats.evicted += 1;
            self.dirty.insert(ordinal);
        }
        room
    }

    /// Forgets what nobody asks for any more; takes up again what was parked or waited.
    fn revise(&mut self) {
        let mut again = Vec::new();
        let mut gone = Vec::new();
        let mut ask = Vec::new();
        for (&ordinal, want) in &self.wants {
            let stale = want.asked + PATIENCE < self.round && ordinal >= self.config.roots;
            match &want.state {
                State::Loading => {}
                _ if stale => gone.push(ordinal),
                State::Queued | State::Ready(_) => {}
                State::Parked(until) if *until > self.frames => {}
                State::Parked(_) => again.push(ordinal),
                State::Waiting(needs) => {
                    ask.extend(needs.iter().map(|&n| (n, want.depth, want.asked)));
                    if needs.iter().all(|&n| self.is_resident(n)) {
                        again.push(ordinal);
                    }
                }
            }
        }
        for ordinal in gone {
            if self.unready(ordinal, None).is_none()
                && let Some(want) = self.wants.remove(&ordinal)
            {
                self.queue.remove(&(want.depth, ordinal));
            }
        }
        for (need, depth, asked) in ask {
            self.residents.touch(need, self.round);
            // Only shared pages: a parent that has gone asks for itself.
            if need >= self.config.pages.saturating_sub(self.config.shared) {
                self.want(need, depth, asked);
            }
        }
        for ordinal in again {
            if let Some(want) = self.wants.get_mut(&ordinal) {
                want.state = State::Queued;
                self.queue.insert((want.depth, ordinal));
            }
        }
    }
}
