//! Which pages live in the pool: a state machine without threads, files or GPU.
//!
//! In: what was asked for and used ([`Residency::feedback`], [`Residency::request`]), what will be
//! ([`Residency::foresee`]), pages that came ([`Residency::loaded`]) or did not ([`Residency::failed`]). Out: ordinals to load
//! ([`Residency::loads`]), ones that nobody waits for any more ([`Residency::abandoned`]), and for each frame copies and
//! table entries ([`Residency::frame`]), which any executor can carry out in order.
//!
//! - A page is admitted only while its parent and its dependencies live, and outlives none of them.
//! - What weighs most comes first: the weight of a page is the sum over the receivers that miss it of their error on the
//!   screen; its worth is that weight for each of its words. What finds no room is parked and counted ([`Stats::starved`]).
//! - Roots are pinned. Of the others the least recently used goes first, once nobody has used it for some rounds; one that is in
//!   use goes only for a page that is needed now and worth more than twice what it is: what it was when it came, half after
//!   each 12 rounds without use. So what does not fit does not go round in a circle.
//! - A page that fails is tried again after 2, 4, … 256 frames.
//!
//! - Several structures share pool and page table ([`Residency::attach`]): ordinals are places in that table. They come and
//!   go ([`Residency::detach`]) and are replaced by new versions, which keep the slots of unchanged pages
//!   ([`Residency::retire`]).
//!
//! Rooms: [`budget`] divides the bytes, [`slots`] finds places, `failure` counts tries, [`foresee`] looks ahead of a moving
//! camera, `span` divides the table, `structures` attaches and detaches, `heirs` knows the pages of replaced versions.

pub mod budget;
mod exchange;
mod failure;
pub mod foresee;
mod heirs;
mod resident;
pub mod slots;
mod span;
mod structures;
#[cfg(test)]
mod tests;

use std::cmp::Reverse;
use std::collections::{BTreeSet, HashMap, VecDeque};
use std::sync::Arc;

pub use budget::{Budget, BudgetError};
pub use exchange::{ABSENT, Child, Config, Entry, Frame, LoadedPage, Op, Stats};
pub use heirs::Content;
pub use span::{Span, TableFull};

use crate::query::pool::NOT_RESIDENT;
use budget::{BLOCK_BYTES, MAX_DIRTY};
use failure::Failures;
use heirs::Heirs;
use resident::{Resident, Residents};
use slots::{BLOCK_WORDS, Gathered, Moved, Slots, UNIT_WORDS, taken};
use span::Spans;

/// Rounds for which a page is kept that has come and can't have been used yet: feedback is late by that much.
const GRACE: u64 = 3;
/// Words by which weights are measured, so that a weight of 1 is worth something in the largest page.
const WORTH_WORDS: u64 = BLOCK_WORDS as u64;
/// Rounds for which a page that was used keeps its place from pages that are worth no more.
const KEPT: u64 = 32;
/// Rounds without use in which a page's worth halves.
const HALVED: u64 = 12;
/// Rounds after which a page is no longer wanted that nobody asks for.
const PATIENCE: u64 = 6;
/// Frames for which a page is parked that found no room.
const PARKED: u64 = 8;

/// Most frames with feedback in each for which a page waits that others make room for.
pub const LONGEST_WAIT: u64 = KEPT + GRACE + PARKED;

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
    /// Sum over the receivers that missed it of their error on the screen, in the round in which it was asked for last.
    weight: u32,
    /// Whether a receiver missed it in that round; else it was foreseen.
    needed: bool,
    /// Its words in the pool, where the index has been asked or the page been read.
    words: Option<u32>,
    state: State,
}

/// Order of loads and admissions: what is needed now before what is foreseen, then what weighs most, then coarse pages.
type Rank = (Reverse<(bool, u32)>, u32, u32);

impl Want {
    /// Bytes that are kept free for it while it is being read.
    fn bytes(&self) -> u64 {
        self.words.map_or(BLOCK_BYTES, |w| u64::from(w) * 4)
    }

    /// Words that it takes in the pool.
    fn room(&self) -> u64 {
        u64::from(self.words.map_or(BLOCK_WORDS, taken))
    }

    /// Its weight for the room that it takes.
    fn worth(&self) -> u32 {
        let worth = u64::from(self.weight) * WORTH_WORDS / self.room();
        u32::try_from(worth).unwrap_or(u32::MAX)
    }

    fn rank(&self, ordinal: u32) -> Rank {
        (Reverse((self.needed, self.weight)), self.depth, ordinal)
    }
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
    spans: Spans,
    /// First places of structures some of whose roots are not resident.
    unrooted: Vec<u32>,
    heirs: Heirs,
    slots: Slots,
    residents: Residents,
    wants: HashMap<u32, Want>,
    queue: BTreeSet<Rank>,
    ready: BTreeSet<Rank>,
    loading: u64,
    loading_bytes: u64,
    ready_bytes: u64,
    failures: Failures,
    dirty: BTreeSet<u32>,
    /// Versions that have their pages and do not answer yet: until they do nothing moves.
    frozen: u32,
    /// Children of which the device does not know yet what the index says: first ordinal and the one behind the last.
    untold: VecDeque<(u32, u32)>,
    round: u64,
    frames: u64,
    stats: Stats,
}

impl Residency {
    /// No structure attached, nothing resident.
    pub fn new(config: Config) -> Self {
        Self {
            config,
            spans: Spans::new(config.table),
            unrooted: Vec::new(),
            heirs: Heirs::default(),
            slots: Slots::new(config.blocks),
            residents: Residents::default(),
            wants: HashMap::new(),
            queue: BTreeSet::new(),
            ready: BTreeSet::new(),
            loading: 0,
            loading_bytes: 0,
            ready_bytes: 0,
            failures: Failures::default(),
            dirty: BTreeSet::new(),
            frozen: 0,
            untold: VecDeque::new(),
            round: 0,
            frames: 0,
            stats: Stats::default(),
        }
    }

    /// Whether a page lives in the pool.
    pub fn is_resident(&self, ordinal: u32) -> bool {
        self.residents.get(ordinal).is_some()
    }

    /// The table entry of a page.
    pub fn entry(&self, ordinal: u32) -> Entry {
        match self.residents.get(ordinal) {
            Some(r) => [r.at, r.first_child, 0, u32::MAX],
            None => self
                .residents
                .bounds(ordinal)
                .map_or(ABSENT, |b| [NOT_RESIDENT, b.stop_error, b.min_depth, b.max_depth]),
        }
    }

    /// A resident page's children and what the index says of each, as far as that is known.
    pub fn children(&self, ordinal: u32) -> impl Iterator<Item = (u32, Child)> {
        let page = self.residents.get(ordinal);
        (page.map_or(0, |p| p.first_child)..).zip(page.map(|p| &p.children[..]).unwrap_or_default().iter().copied())
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

    /// Asks for a page that receivers miss; `weight` is the sum of their errors on the screen. Nothing happens where its
    /// parent does not live in the pool (the walk never came there), where it failed a short while ago, or where there is
    /// no such page.
    pub fn request(&mut self, ordinal: u32, weight: u32) {
        if let Some(depth) = self.depth(ordinal) {
            self.want(ordinal, depth, self.round, weight, true);
        }
    }

    /// The same for a page that will be needed: it comes after those that are needed now, and takes no place of a page
    /// that is in use.
    pub fn foresee(&mut self, ordinal: u32, weight: u32) {
        if let Some(depth) = self.depth(ordinal) {
            self.want(ordinal, depth, self.round, weight, false);
        }
    }

    /// Pages above a page that may be asked for.
    fn depth(&self, ordinal: u32) -> Option<u32> {
        let span = self.spans.find(ordinal)?;
        match self.residents.parent(ordinal).and_then(|p| self.residents.get(p)) {
            Some(parent) => Some(parent.depth + 1),
            None if span.is_root(ordinal) => Some(0),
            None if span.is_shared(ordinal) => Some(1),
            None => None,
        }
    }

    fn want(&mut self, ordinal: u32, depth: u32, asked: u64, weight: u32, needed: bool) {
        let unknown = self.spans.find(ordinal).is_none();
        if unknown || self.is_resident(ordinal) || self.failures.waits(ordinal, self.frames) {
            return;
        }
        let words = self.told(ordinal).map(|c| c.words);
        let want = self.wants.entry(ordinal).or_insert_with(|| {
            let want = Want { depth, asked, weight, needed, words, state: State::Queued };
            self.queue.insert(want.rank(ordinal));
            want
        });
        let (before, again) = (want.rank(ordinal), want.asked == asked);
        // What was said in this round stays if it is more; what was said in an earlier one is forgotten.
        if !again || (needed, weight) > (want.needed, want.weight) {
            (want.needed, want.weight) = (needed, weight);
        }
        want.asked = want.asked.max(asked);
        let order = match want.state {
            State::Queued => &mut self.queue,
            State::Ready(_) => &mut self.ready,
            _ => return,
        };
        if order.remove(&before) {
            order.insert(want.rank(ordinal));
        }
    }

    /// One round of feedback: pages that walks missed, each with the sum of the receivers' errors on the screen, and one bit
    /// for each unit of the pool that holds a page in which a walk ended. `overflow`: more were missed than are listed.
    pub fn feedback(&mut self, missed: impl IntoIterator<Item = (u32, u32)>, used: &[u32], overflow: bool) {
        self.round += 1;
        self.residents.begin(self.round);
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
        for (ordinal, weight) in missed {
            self.request(ordinal, weight);
        }
        if overflow {
            self.wants.values_mut().for_each(|w| w.asked = self.round);
        }
    }

    /// Pages being loaded that nobody has asked for lately. An executor that has not begun to read one says so
    /// ([`cancelled`](Self::cancelled)).
    pub fn abandoned(&self) -> impl Iterator<Item = u32> {
        let stale = |(ordinal, w): (&u32, &Want)| {
            (matches!(w.state, State::Loading) && self.is_stale(*ordinal, w)).then_some(*ordinal)
        };
        self.wants.iter().filter_map(stale)
    }

    /// A page that [`abandoned`](Self::abandoned) named will not be read.
    pub fn cancelled(&mut self, ordinal: u32) {
        if self.forget_load(ordinal) {
            self.stats.cancelled += 1;
        }
    }

    /// Takes a page that is being read out of the wanted.
    fn forget_load(&mut self, ordinal: u32) -> bool {
        let Some(want) = self.wants.get(&ordinal).filter(|w| matches!(w.state, State::Loading)) else { return false };
        self.loading -= 1;
        self.loading_bytes -= want.bytes();
        self.wants.remove(&ordinal);
        true
    }

    fn is_stale(&self, ordinal: u32, want: &Want) -> bool {
        let span = self.spans.find(ordinal);
        span.is_none_or(|s| want.asked + PATIENCE < self.round && !s.is_root(ordinal))
    }

    /// Ordinals to load now, those that weigh most first; none while host memory is spoken for.
    pub fn loads(&mut self) -> Vec<u32> {
        let mut out = Vec::new();
        if self.queue.is_empty() {
            return out;
        }
        let coming = self.wants.values().filter(|w| matches!(w.state, State::Loading | State::Ready(_)));
        let mut coming: u64 = coming.map(Want::room).sum();
        let (free, past) = (self.slots.free_words(), self.residents.past_words());
        let mut lesser = None;
        while let Some(&(_, _, ordinal)) = self.queue.first() {
            let bytes = self.wants.get(&ordinal).map_or(0, Want::bytes);
            if self.loading_bytes + bytes + self.ready_bytes > self.config.host_bytes {
                break;
            }
            self.queue.pop_first();
            let Some(want) = self.wants.get_mut(&ordinal) else { continue };
            let words = want.room();
            // What would come and find no place would be read again, for ever. Where pages must go with others above them, which
            // are not counted, one at a time is tried.
            let mut room = free + past;
            if coming + words > room && want.needed {
                room += lesser.get_or_insert_with(|| self.residents.lesser()).words(want.worth());
            }
            let hopeless = coming + words > room && (coming != 0 || past == 0);
            if hopeless {
                // Reading what can't be kept would only wear the disk.
                want.state = State::Parked(self.frames + PARKED);
                continue;
            }
            want.state = State::Loading;
            self.loading += 1;
            self.loading_bytes += bytes;
            coming += words;
            out.push(ordinal);
        }
        out
    }

    /// A page that [`loads`](Self::loads) named has come.
    pub fn loaded(&mut self, page: LoadedPage) {
        if self.spans.find(page.ordinal).is_none() {
            // Detached meanwhile.
            self.forget_load(page.ordinal);
            return;
        }
        self.failures.forget(page.ordinal);
        let Some(want) = self.wants.get_mut(&page.ordinal).filter(|w| matches!(w.state, State::Loading)) else {
            return;
        };
        self.loading -= 1;
        self.loading_bytes -= want.bytes();
        self.ready_bytes += page.words.len() as u64 * 4;
        if !page.words.is_empty() {
            want.words = Some(page.words.len() as u32);
        }
        self.ready.insert(want.rank(page.ordinal));
        want.state = State::Ready(page);
    }

    /// What the index says of the children of a page of structure `number` that came without.
    pub fn children_told(&mut self, number: u64, ordinal: u32, children: Arc<[Child]>) {
        if self.spans.find(ordinal).is_none_or(|s| s.number != number) {
            return;
        }
        if let Some(Want { state: State::Ready(page), .. }) = self.wants.get_mut(&ordinal) {
            page.children = children;
        } else if let Some(first) = self.residents.tell(ordinal, &children) {
            self.untold.push_back((first, first.saturating_add(children.len() as u32)));
        }
    }

    /// A page that [`loads`](Self::loads) named could not be read; `true` the first time, when it is to be reported.
    pub fn failed(&mut self, ordinal: u32) -> bool {
        self.forget_load(ordinal);
        self.spans.find(ordinal).is_some() && self.failures.note(ordinal, self.frames)
    }

    /// Admits what has come, as far as the frame's bytes reach.
    pub fn frame(&mut self) -> Frame {
        self.frames += 1;
        self.bury();
        self.want_roots();
        let mut frame = Frame::default();
        self.withdraw(&mut frame);
        let mut bytes = 0;
        let ready = if self.frozen == 0 { self.ready.clone() } else { BTreeSet::new() };
        for (_, depth, ordinal) in ready {
            let Some(want) = self.wants.get(&ordinal) else { continue };
            let State::Ready(page) = &want.state else { continue };
            let (worth, needed) = (want.worth(), want.needed);
            let page_bytes = page.words.len() as u64 * 4;
            if bytes + page_bytes > self.config.frame_bytes || self.dirty.len() as u64 >= MAX_DIRTY {
                break;
            }
            let span = self.spans.find(ordinal);
            let (root, shared) = span.map_or((false, false), |s| (s.is_root(ordinal), s.is_shared(ordinal)));
            let parent = self.residents.parent(ordinal);
            let orphan = parent.is_none() && !root && !shared;
            // Its words may be there already, in a page of the version before.
            let heir = page.hash.filter(|_| page.words.is_empty()).and_then(|_| self.heir(ordinal));
            let lost = page.words.is_empty() && heir.is_none();
            let length = page.words.len() as u32;
            let mut needs = page.dependencies.clone();
            needs.extend(parent);
            if orphan || lost || length > BLOCK_WORDS {
                self.unready(ordinal, None);
                continue;
            }
            // They must not make room for the page that needs them.
            needs.iter().for_each(|&n| self.residents.touch(n, self.round));
            if needs.iter().any(|&n| !self.is_resident(n)) {
                self.unready(ordinal, Some(State::Waiting(needs)));
                continue;
            }
            let place = if let Some(heir) = heir {
                self.inherit(heir, ordinal).map(|p| (p.at, p.words))
            } else {
                match self.make_room(length, (worth, needed, &needs), &mut frame) {
                    Room::Found => {}
                    Room::NotNow => break,
                    Room::None => {
                        self.unready(ordinal, Some(State::Parked(self.frames + PARKED)));
                        continue;
                    }
                }
                self.slots.alloc(length, ordinal).map(|at| (at, length))
            };
            let Some((at, words)) = place else { continue };
            let Some(page) = self.unready(ordinal, None) else { continue };
            bytes += page_bytes;
            self.stats.uploaded_bytes += page_bytes;
            let upload = page.words.clone();
            self.settle(page, [at, words], [depth, worth], needs, root);
            if heir.is_none() {
                frame.ops.push(Op::Upload { at, words: upload });
            }
        }
        self.revise();
        self.tell();
        self.free_spans();
        let mut dirty = std::mem::take(&mut self.dirty);
        if let Some(&next) = dirty.iter().nth(MAX_DIRTY as usize) {
            self.dirty = dirty.split_off(&next);
        }
        frame.table = dirty.into_iter().map(|o| (o, self.entry(o))).collect();
        frame
    }

    /// The budget is another one from now on. Where the pool has become smaller, pages beyond its end move into it or go,
    /// in the next frames, pinned ones last; [`is_within`](Self::is_within) says when none is left there.
    pub fn resize(&mut self, config: Config) {
        self.config = Config { table: self.config.table, ..config };
        self.slots.resize(config.blocks);
    }

    /// Whether all pages lie within the pool as it is now.
    pub fn is_within(&self) -> bool {
        self.slots.beyond().is_none()
    }

    /// Takes pages out of blocks that the pool has no more.
    fn withdraw(&mut self, frame: &mut Frame) {
        if self.frozen != 0 {
            return;
        }
        let mut bytes = 0;
        while let Some((from, ordinal)) = self.slots.beyond() {
            let Some(words) = self.residents.get(ordinal).map(|p| p.words) else { return };
            bytes += u64::from(words) * 4;
            if bytes > self.config.frame_bytes || self.dirty.len() as u64 >= MAX_DIRTY {
                return;
            }
            // Whoever goes, the roots stay.
            match self.make_room(words, (u32::MAX, true, &[]), frame) {
                Room::Found => {}
                // What was used a moment ago goes when it has had its time.
                Room::NotNow | Room::None => return,
            }
            if self.slots.beyond() != Some((from, ordinal)) {
                // It went itself.
                continue;
            }
            let Some(to) = self.slots.alloc(words, ordinal) else { return };
            self.slots.free(from);
            self.residents.relocate(ordinal, to);
            frame.ops.push(Op::Move { from, to, words });
            self.dirty.insert(ordinal);
            self.stats.moved += 1;
        }
    }

    /// A page lives from now on, in words `words` from word `at` on.
    fn settle(
        &mut self,
        page: LoadedPage,
        [at, words]: [u32; 2],
        [depth, worth]: [u32; 2],
        needs: Vec<u32>,
        pinned: bool,
    ) {
        self.stats.admitted += 1;
        self.stats.resident_words += u64::from(words);
        self.dirty.insert(page.ordinal);
        if !page.children.is_empty() {
            self.untold.push_back((page.first_child, page.first_child.saturating_add(page.child_count.into())));
        }
        let resident = Resident {
            at,
            words,
            hash: page.hash,
            first_child: page.first_child,
            child_count: page.child_count,
            children: page.children,
            depth,
            worth,
            stamp: self.round + GRACE,
            dependents: 0,
            needs,
            pinned,
        };
        self.residents.insert(page.ordinal, resident);
    }

    /// Puts what the index says of the children of new pages into the frame's table, as far as it reaches.
    fn tell(&mut self) {
        while let Some((next, end)) = self.untold.pop_front() {
            let room = MAX_DIRTY.saturating_sub(self.dirty.len() as u64);
            let until = next.saturating_add(u32::try_from(room).unwrap_or(u32::MAX)).min(end);
            self.dirty.extend(next..until);
            if until < end {
                self.untold.push_front((until, end));
                return;
            }
        }
    }

    /// Takes a page out of the ready ones: to another state, or out of the wanted.
    fn unready(&mut self, ordinal: u32, state: Option<State>) -> Option<LoadedPage> {
        let want = self.wants.get_mut(&ordinal)?;
        let next = state.unwrap_or(State::Queued);
        let gone = matches!(next, State::Queued);
        let rank = want.rank(ordinal);
        let State::Ready(page) = std::mem::replace(&mut want.state, next) else { return None };
        self.ready.remove(&rank);
        self.ready_bytes -= page.words.len() as u64 * 4;
        if gone {
            self.wants.remove(&ordinal);
        }
        Some(page)
    }

    /// Room for a page of so many words; where there is none whoever goes, everybody stays: what was evicted for nothing would
    /// be read again, for ever.
    fn make_room(&mut self, words: u32, (worth, needed, spare): (u32, bool, &[u32]), frame: &mut Frame) -> Room {
        let mut gone = Vec::new();
        let room = loop {
            if self.slots.has_room(words) {
                break Room::Found;
            }
            // Each page that goes or is moved changes an entry, and the newcomer does.
            let Some(left) = (MAX_DIRTY as usize).checked_sub(self.dirty.len() + gone.len() + 2) else {
                break Room::NotNow;
            };
            match self.slots.gather(words, left) {
                Gathered::Room(moved) => {
                    self.follow(&moved, frame);
                    break Room::Found;
                }
                // What takes more than a whole frame is not waited for.
                Gathered::Later if !self.dirty.is_empty() => break Room::NotNow,
                Gathered::Later | Gathered::None => {}
            }
            let Some(victim) = self.residents.victim(worth, needed, spare) else { break Room::None };
            if let Some(page) = self.residents.remove(victim) {
                self.slots.free(page.at);
                gone.push((victim, page));
            }
        };
        if matches!(room, Room::None) {
            // Parents went after their children.
            for (ordinal, page) in gone.into_iter().rev() {
                self.slots.take_back(page.at, page.words, ordinal);
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

    /// Tells executors of pages that were moved. Steps do not overlap: a page goes in pieces as long as its way, the nearest to
    /// its new place first.
    fn follow(&mut self, moved: &[Moved], frame: &mut Frame) {
        for &Moved { owner, from, to } in moved {
            let words = self.residents.relocate(owner, to);
            let step = from.abs_diff(to).min(words).max(1);
            // Pages of a block move towards its front.
            for at in (0..words).step_by(step as usize) {
                frame.ops.push(Op::Move { from: from + at, to: to + at, words: step.min(words - at) });
            }
            self.dirty.insert(owner);
            self.stats.moved += 1;
        }
    }

    /// Forgets what nobody asks for any more; takes up again what was parked or waited.
    fn revise(&mut self) {
        let mut again = Vec::new();
        let mut gone = Vec::new();
        let mut ask = Vec::new();
        for (&ordinal, want) in &self.wants {
            let stale = self.is_stale(ordinal, want);
            match &want.state {
                State::Loading => {}
                _ if stale => gone.push(ordinal),
                State::Queued | State::Ready(_) => {}
                State::Parked(until) if *until > self.frames => {}
                State::Parked(_) => again.push(ordinal),
                State::Waiting(needs) => {
                    ask.extend(needs.iter().map(|&n| (n, want.depth, want.asked, want.weight, want.needed)));
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
                self.queue.remove(&want.rank(ordinal));
            }
        }
        for (need, depth, asked, weight, needed) in ask {
            self.residents.touch(need, self.round);
            // Only shared pages: a parent that has gone asks for itself.
            if self.spans.find(need).is_some_and(|s| s.is_shared(need)) {
                self.want(need, depth, asked, weight, needed);
            }
        }
        for ordinal in again {
            if let Some(want) = self.wants.get_mut(&ordinal) {
                want.state = State::Queued;
                self.queue.insert(want.rank(ordinal));
            }
        }
    }
}
