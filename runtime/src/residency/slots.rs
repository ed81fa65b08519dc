//! Places in the pool: blocks of one size, each filled with pages of any length.
//!
//! Slots of powers of two left a quarter of the pool empty, and a block for each of them more. So a page takes the units that
//! it has, anywhere in a block. Where no hole is long enough [`Slots::gather`] moves pages: those of one block together, and
//! where no block has so much free, small ones of a block to others.

use std::collections::{BTreeMap, BTreeSet};

/// Words of a block, and most words of a page.
pub const BLOCK_WORDS: u32 = umbrage_format::index::MAX_PAGE_WORDS as u32;
/// Words of the smallest place; places start at multiples of it.
pub const UNIT_WORDS: u32 = 64;
/// Number of classes: 64, 128, … 16384 words.
pub const CLASSES: usize = (BLOCK_WORDS / UNIT_WORDS).ilog2() as usize + 1;
const _: () = assert!(BLOCK_WORDS == UNIT_WORDS << (CLASSES - 1));
/// Units of a block.
const UNITS: u32 = BLOCK_WORDS / UNIT_WORDS;
/// Blocks that are looked at for one from which small pages can go, those with most room first.
const LOOKS: usize = 16;

/// Rooms that are looked for to make one.
const TRIES: u32 = 64;

/// Size class of a page of `words` words, by which room for the longest way is counted; `None` above the largest.
pub fn class_of(words: u32) -> Option<u8> {
    (words <= BLOCK_WORDS).then(|| words.max(UNIT_WORDS).div_ceil(UNIT_WORDS).next_power_of_two().ilog2() as u8)
}

/// Words of a class: pages whose classes fill blocks fit into these.
pub fn slot_words(class: u8) -> u32 {
    UNIT_WORDS << class
}

/// Words that a page of `words` words takes in the pool.
pub fn taken(words: u32) -> u32 {
    units(words) * UNIT_WORDS
}

fn units(words: u32) -> u32 {
    words.max(1).div_ceil(UNIT_WORDS)
}

/// A page in a block.
#[derive(Debug, Clone, Copy)]
struct Placed {
    start: u32,
    units: u32,
    owner: u32,
}

impl Placed {
    fn end(&self) -> u32 {
        self.start + self.units
    }
}

#[derive(Debug, Default, Clone)]
struct Block {
    /// By rising start.
    pages: Vec<Placed>,
    used: u32,
}

impl Block {
    fn free(&self) -> u32 {
        UNITS - self.used
    }

    /// Its holes: start and units of each; the page behind hole `i` is page `i`.
    fn holes(&self) -> impl Iterator<Item = (u32, u32)> {
        let ends = std::iter::once(0).chain(self.pages.iter().map(Placed::end));
        let starts = self.pages.iter().map(|p| p.start).chain([UNITS]);
        ends.zip(starts).map(|(from, to)| (from, to - from))
    }

    fn longest(&self) -> u32 {
        self.holes().map(|h| h.1).max().unwrap_or(0)
    }

    /// Start of the shortest hole of at least so many units.
    fn hole(&self, units: u32) -> Option<u32> {
        self.holes().filter(|h| h.1 >= units).min_by_key(|h| h.1).map(|h| h.0)
    }

    fn put(&mut self, page: Placed) {
        let at = self.pages.partition_point(|p| p.start < page.start);
        self.pages.insert(at, page);
        self.used += page.units;
    }

    fn find(&self, unit: u32) -> Option<usize> {
        let at = self.pages.partition_point(|p| p.start <= unit).checked_sub(1)?;
        (unit < self.pages[at].end()).then_some(at)
    }

    fn take(&mut self, start: u32) -> Option<Placed> {
        let at = self.find(start)?;
        self.used -= self.pages[at].units;
        Some(self.pages.remove(at))
    }

    /// Moves pages together until a hole has so many units, as few as possible; the block has as much free.
    fn slide(&mut self, number: u32, units: u32, moves: &mut Vec<Moved>) {
        let holes: Vec<u32> = self.holes().map(|h| h.1).collect();
        let (mut first, mut free, mut moved) = (0, 0, 0);
        let mut best: Option<(u32, usize, usize)> = None;
        for (last, hole) in holes.iter().enumerate() {
            free += hole;
            moved += last.checked_sub(1).filter(|i| *i >= first).map_or(0, |i| self.pages[i].units);
            while free >= units {
                if best.is_none_or(|b| moved < b.0) {
                    best = Some((moved, first, last));
                }
                free -= holes[first];
                moved -= if first < last { self.pages[first].units } else { 0 };
                first += 1;
            }
        }
        let Some((_, first, last)) = best else { return };
        let mut to = first.checked_sub(1).map_or(0, |i| self.pages[i].end());
        for page in &mut self.pages[first..last] {
            if page.start != to {
                moves.push(Moved { owner: page.owner, from: word(number, page.start), to: word(number, to) });
                page.start = to;
            }
            to = page.end();
        }
    }
}

/// A page that was moved. Its places before and after may overlap.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Moved {
    /// The page.
    pub owner: u32,
    /// First word before.
    pub from: u32,
    /// First word now.
    pub to: u32,
}

/// What came of gathering room.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Gathered {
    /// There is room now; these pages were moved, in this order.
    Room(Vec<Moved>),
    /// More pages would have to be moved than may be; none was.
    Later,
    /// No way was found; none was moved.
    None,
}

/// All blocks of a pool.
#[derive(Debug)]
pub struct Slots {
    blocks: Vec<Block>,
    /// Blocks below the limit by (longest hole, block) and by (free units, block).
    by_hole: BTreeSet<(u32, u32)>,
    by_free: BTreeSet<(u32, u32)>,
    free_units: u64,
    /// Blocks from this one on take no page any more.
    limit: u32,
}

impl Slots {
    /// `blocks` free blocks.
    pub fn new(blocks: u32) -> Self {
        let (by_hole, by_free) = (BTreeSet::new(), BTreeSet::new());
        let mut this = Self { blocks: Vec::new(), by_hole, by_free, free_units: 0, limit: 0 };
        this.resize(blocks);
        this
    }

    /// From now on there are `blocks` blocks; pages in others stay there until they are freed ([`beyond`](Self::beyond)).
    pub fn resize(&mut self, blocks: u32) {
        let known = self.blocks.len().max(blocks as usize);
        self.blocks.resize_with(known, Block::default);
        while self.limit > blocks {
            self.unlist(self.limit - 1);
            self.limit -= 1;
        }
        while self.limit < blocks {
            self.limit += 1;
            self.list(self.limit - 1);
        }
    }

    /// A page in a block that takes none any more: its first word and its owner.
    pub fn beyond(&self) -> Option<(u32, u32)> {
        let block = (self.limit..self.blocks.len() as u32).rev().find(|b| self.blocks[*b as usize].used != 0)?;
        let page = self.blocks[block as usize].pages.first()?;
        Some((word(block, page.start), page.owner))
    }

    /// Whether [`alloc`](Self::alloc) of so many words would succeed.
    pub fn has_room(&self, words: u32) -> bool {
        self.by_hole.last().is_some_and(|b| b.0 >= units(words))
    }

    /// Takes a place for a page; gives its first word.
    pub fn alloc(&mut self, words: u32, owner: u32) -> Option<u32> {
        let units = units(words);
        let &(_, number) = self.by_hole.range((units, 0)..).next()?;
        let start = self.blocks[number as usize].hole(units)?;
        self.change(number, |b| b.put(Placed { start, units, owner }));
        Some(word(number, start))
    }

    /// Gives a place back.
    pub fn free(&mut self, word: u32) {
        let (number, unit) = place(word);
        let page = self.change(number, |b| b.take(unit));
        debug_assert!(page.is_some());
    }

    /// Undoes [`free`](Self::free) of a page of so many words, where nothing was placed or moved since.
    pub fn take_back(&mut self, word: u32, words: u32, owner: u32) {
        let (number, start) = place(word);
        self.change(number, |b| b.put(Placed { start, units: units(words), owner }));
    }

    /// A page goes on in the place of another.
    pub fn hand_over(&mut self, word: u32, owner: u32) {
        let (number, unit) = place(word);
        let block = &mut self.blocks[number as usize];
        if let Some(at) = block.find(unit) {
            block.pages[at].owner = owner;
        }
    }

    /// Words of all holes.
    pub fn free_words(&self) -> u64 {
        self.free_units * u64::from(UNIT_WORDS)
    }

    /// Who lives at a word of the pool.
    pub fn owner(&self, word: u32) -> Option<u32> {
        let (number, unit) = place(word);
        let block = self.blocks.get(number as usize)?;
        Some(block.pages[block.find(unit)?].owner)
    }

    /// Makes a hole for a page of so many words by moving others, at most `most` moves.
    ///
    /// Where pages of each class and the newcomer have blocks enough of their own, room is found.
    pub fn gather(&mut self, words: u32, most: usize) -> Gathered {
        let units = units(words);
        if self.free_units < u64::from(units) {
            return Gathered::None;
        }
        let (changed, moves, promised) = Default::default();
        let mut plan = Plan { slots: self, changed, moves, promised, tries: TRIES };
        if plan.clear(units).is_none() {
            return Gathered::None;
        }
        let Plan { changed, moves, .. } = plan;
        if moves.len() > most {
            return Gathered::Later;
        }
        for (number, block) in changed {
            self.change(number, |b| *b = block);
        }
        Gathered::Room(moves)
    }

    fn change<T>(&mut self, number: u32, f: impl FnOnce(&mut Block) -> T) -> T {
        if number < self.limit {
            self.unlist(number);
        }
        let out = f(&mut self.blocks[number as usize]);
        if number < self.limit {
            self.list(number);
        }
        out
    }

    fn list(&mut self, number: u32) {
        let block = &self.blocks[number as usize];
        self.by_hole.insert((block.longest(), number));
        self.by_free.insert((block.free(), number));
        self.free_units += u64::from(block.free());
    }

    fn unlist(&mut self, number: u32) {
        let block = &self.blocks[number as usize];
        self.by_hole.remove(&(block.longest(), number));
        self.by_free.remove(&(block.free(), number));
        self.free_units -= u64::from(block.free());
    }
}

fn round(units: u32) -> u32 {
    units.next_power_of_two()
}

/// Word of a unit of a block.
fn word(block: u32, unit: u32) -> u32 {
    block * BLOCK_WORDS + unit * UNIT_WORDS
}

/// Block and unit of a word.
fn place(word: u32) -> (u32, u32) {
    (word / BLOCK_WORDS, word % BLOCK_WORDS / UNIT_WORDS)
}

/// Moves that are tried before any is made.
struct Plan<'a> {
    slots: &'a Slots,
    changed: BTreeMap<u32, Block>,
    moves: Vec<Moved>,
    /// Blocks that are being cleared.
    promised: Vec<u32>,
    /// Rooms that may still be looked for.
    tries: u32,
}

impl Plan<'_> {
    fn block(&self, number: u32) -> &Block {
        self.changed.get(&number).unwrap_or(&self.slots.blocks[number as usize])
    }

    fn change(&mut self, number: u32) -> &mut Block {
        self.changed.entry(number).or_insert_with(|| self.slots.blocks[number as usize].clone())
    }

    fn is_promised(&self, number: u32) -> bool {
        self.promised.contains(&number)
    }

    /// The block with least room that has as much.
    fn roomy(&self, units: u32) -> Option<u32> {
        let fits = |&number: &u32| !self.is_promised(number) && self.block(number).free() >= units;
        let changed = self.changed.keys().copied().filter(fits).map(|n| (self.block(n).free(), n));
        let others = self.slots.by_free.range((units, 0)..).find(|b| !self.changed.contains_key(&b.1) && fits(&b.1));
        changed.chain(others.copied()).min().map(|b| b.1)
    }

    /// A block with a hole of so many units.
    fn clear(&mut self, units: u32) -> Option<u32> {
        self.tries = self.tries.checked_sub(1)?;
        if let Some(number) = self.roomy(units) {
            self.slide(number, units);
            return Some(number);
        }
        // Pages of its class and above stay where they are, where what is left beside them is enough.
        let stays = |b: &Block| b.pages.iter().map(|p| round(p.units)).filter(|r| *r >= round(units)).sum::<u32>();
        let blocks = self.slots.by_free.iter().rev().take(LOOKS).map(|b| b.1);
        let fits = |n: &u32| !self.is_promised(*n) && stays(self.block(*n)) + round(units) <= UNITS;
        let mut blocks: Vec<u32> = blocks.filter(fits).collect();
        blocks.sort_by_key(|n| std::cmp::Reverse(self.block(*n).free()));
        for number in blocks {
            let (changed, moves, promised) = (self.changed.clone(), self.moves.len(), self.promised.len());
            if self.vacate(number, units).is_some() {
                self.slide(number, units);
                return Some(number);
            }
            self.changed = changed;
            self.moves.truncate(moves);
            self.promised.truncate(promised);
        }
        None
    }

    /// Moves small pages of a block to others, until it has so many units free.
    fn vacate(&mut self, number: u32, units: u32) -> Option<()> {
        self.promised.push(number);
        while let Some(lack) = units.checked_sub(self.block(number).free()).filter(|l| *l != 0) {
            let pages = || self.block(number).pages.iter().filter(|p| round(p.units) < round(units));
            let enough = pages().filter(|p| p.units >= lack).min_by_key(|p| p.units);
            let page = *enough.or_else(|| pages().max_by_key(|p| p.units))?;
            let to = self.clear(page.units)?;
            let start = self.block(to).hole(page.units)?;
            self.change(number).take(page.start);
            self.change(to).put(Placed { start, ..page });
            self.moves.push(Moved { owner: page.owner, from: word(number, page.start), to: word(to, start) });
        }
        self.promised.pop();
        Some(())
    }

    fn slide(&mut self, number: u32, units: u32) {
        let mut moves = std::mem::take(&mut self.moves);
        self.change(number).slide(number, units, &mut moves);
        self.moves = moves;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashMap;

    #[test]
    fn classes() {
        for (words, class) in [(0, 0), (2, 0), (64, 0), (65, 1), (128, 1), (129, 2), (2048, 5), (8193, 8), (16384, 8)] {
            assert_eq!(class_of(words), Some(class), "{words}");
            assert!(slot_words(class) >= taken(words) && taken(words) >= words);
        }
        assert_eq!(class_of(16385), None);
    }

    #[test]
    fn a_smaller_pool_takes_nothing_beyond_its_end() {
        let mut slots = Slots::new(4);
        let at: Vec<u32> = (0..4).map(|owner| slots.alloc(BLOCK_WORDS, owner).unwrap()).collect();
        slots.free(at[1]);
        let small = slots.alloc(slot_words(3), 9).unwrap();
        slots.resize(2);
        assert!(small / BLOCK_WORDS < 2 && !slots.has_room(BLOCK_WORDS) && slots.has_room(slot_words(3)));
        assert_eq!(slots.free_words(), u64::from(BLOCK_WORDS - slot_words(3)));
        // Those beyond stay until they are freed or moved.
        assert_eq!(slots.beyond(), Some((at[3], 3)));
        slots.free(at[3]);
        assert_eq!((slots.beyond(), slots.owner(at[2])), (Some((at[2], 2)), Some(2)));
        // Larger again: the page there is where it was.
        slots.resize(5);
        assert_eq!((slots.beyond(), slots.owner(at[2])), (None, Some(2)));
        let more: Vec<u32> = (10..12).map(|owner| slots.alloc(BLOCK_WORDS, owner).unwrap() / BLOCK_WORDS).collect();
        assert_eq!((more, slots.has_room(BLOCK_WORDS)), (vec![3, 4], false));
        for word in [at[0], at[2], small, 3 * BLOCK_WORDS, 4 * BLOCK_WORDS] {
            slots.free(word);
        }
        assert_eq!((slots.free_words(), slots.by_free.len()), (5 * u64::from(BLOCK_WORDS), 5));
        slots.resize(0);
        assert!(slots.beyond().is_none() && !slots.has_room(64));
    }

    #[test]
    fn places_never_overlap_and_what_fits_by_classes_fits() {
        let mut slots = Slots::new(6);
        let mut live: HashMap<u32, (u32, u32)> = HashMap::new();
        let mut state = 1u64;
        let (mut gathered, mut full, mut tight) = (0, 0, 0);
        for step in 0..20_000u32 {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            let roll = (state >> 33) as u32;
            if roll % 8 < 5 {
                let words = (slot_words((roll / 8 % CLASSES as u32) as u8) - roll / 128 % 64).max(1)
                    * (1 + roll / 2048 % 2)
                    / 2;
                if !slots.has_room(words) {
                    let mut classes = [0; CLASSES];
                    for words in live.values().map(|p| p.1).chain([words]) {
                        let class = class_of(words).unwrap();
                        classes[usize::from(class)] += slot_words(class);
                    }
                    let apart: u32 = classes.iter().map(|w| w.div_ceil(BLOCK_WORDS)).sum();
                    let together: u32 = classes.iter().sum();
                    match slots.gather(words, 1000) {
                        Gathered::Room(moved) => {
                            gathered += 1;
                            for m in moved {
                                let place = live.get_mut(&m.owner).unwrap();
                                assert_eq!(place.0, m.from);
                                place.0 = m.to;
                            }
                            assert!(slots.has_room(words));
                        }
                        Gathered::Later => panic!("more moves than pages"),
                        Gathered::None => {
                            full += 1;
                            tight += u32::from(together <= 6 * BLOCK_WORDS);
                            assert!(apart > 6, "what fits with a block for each class fits: {classes:?}");
                        }
                    }
                }
                if let Some(at) = slots.alloc(words, step) {
                    live.insert(step, (at, words));
                }
            } else if let Some(&owner) = live.keys().min_by_key(|&&k| k ^ roll) {
                slots.free(live.remove(&owner).unwrap().0);
            }
            let mut spans: Vec<_> = live.iter().map(|(&o, &(at, w))| (at, at + taken(w), o)).collect();
            spans.sort_unstable();
            assert!(spans.windows(2).all(|w| w[0].1 <= w[1].0));
            assert!(spans.iter().all(|&(a, b, o)| slots.owner(a) == Some(o) && slots.owner(b - 1) == Some(o)));
            assert!(spans.iter().all(|&(a, b, _)| a / BLOCK_WORDS == (b - 1) / BLOCK_WORDS));
            let taken: u32 = spans.iter().map(|s| s.1 - s.0).sum();
            assert_eq!(slots.free_words(), u64::from(6 * BLOCK_WORDS - taken));
        }
        assert!(gathered > 100 && full > 100 && tight < gathered / 10, "{gathered} {full} {tight}");
        for (at, _) in live.into_values() {
            slots.free(at);
        }
        assert_eq!((slots.free_words(), slots.by_hole.len()), (6 * u64::from(BLOCK_WORDS), 6));
    }
}
