//! Places in the pool: blocks of one size, each cut into slots of one power of two.
//!
//! A page always fits where the free words suffice: a class whose holes add up to a block can be moved together
//! ([`Slots::compact`]), so pages of one size never lock out those of another for good.

use std::collections::BTreeSet;

/// Words of a block, and most words of a page.
pub const BLOCK_WORDS: u32 = umbrage_format::index::MAX_PAGE_WORDS as u32;
/// Words of the smallest slot; slots start at multiples of it.
pub const UNIT_WORDS: u32 = 64;
/// Number of classes: 64, 128, … 16384 words.
pub const CLASSES: usize = (BLOCK_WORDS / UNIT_WORDS).ilog2() as usize + 1;
const _: () = assert!(BLOCK_WORDS == UNIT_WORDS << (CLASSES - 1));

/// Size class of a page of `words` words; `None` above the largest.
pub fn class_of(words: u32) -> Option<u8> {
    (words <= BLOCK_WORDS).then(|| words.max(UNIT_WORDS).div_ceil(UNIT_WORDS).next_power_of_two().ilog2() as u8)
}

/// Slots of a class in a block.
fn per_block(class: u8) -> u32 {
    1 << (CLASSES - 1 - usize::from(class))
}

/// Words of a slot of a class.
pub fn slot_words(class: u8) -> u32 {
    UNIT_WORDS << class
}

#[derive(Debug, Default)]
struct Block {
    class: u8,
    /// Who lives in each slot; empty where the block is free.
    owners: Vec<Option<u32>>,
    used: u32,
}

/// A page that compaction moved.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Moved {
    /// The page.
    pub owner: u32,
    /// First word before.
    pub from: u32,
    /// First word now.
    pub to: u32,
}

/// All blocks of a pool.
#[derive(Debug)]
pub struct Slots {
    blocks: Vec<Block>,
    free: BTreeSet<u32>,
    /// For each class its blocks with holes, by (holes, block): the fullest is filled first.
    holes: [BTreeSet<(u32, u32)>; CLASSES],
    hole_count: [u32; CLASSES],
    /// Blocks from this one on take no page any more.
    limit: u32,
}

impl Slots {
    /// `blocks` free blocks.
    pub fn new(blocks: u32) -> Self {
        Self {
            limit: blocks,
            blocks: (0..blocks).map(|_| Block::default()).collect(),
            free: (0..blocks).collect(),
            holes: Default::default(),
            hole_count: [0; CLASSES],
        }
    }

    /// From now on there are `blocks` blocks; pages in others stay there until they are freed ([`beyond`](Self::beyond)).
    pub fn resize(&mut self, blocks: u32) {
        let known = self.blocks.len().max(blocks as usize);
        self.blocks.resize_with(known, Block::default);
        for number in self.limit.min(blocks)..self.limit.max(blocks) {
            let grows = number < blocks;
            let block = &self.blocks[number as usize];
            let (class, used) = (block.class, block.used);
            if used == 0 {
                if grows {
                    self.free.insert(number)
                } else {
                    self.free.remove(&number)
                };
                continue;
            }
            let (c, holes) = (usize::from(class), per_block(class) - used);
            if grows {
                self.hole_count[c] += holes;
                if holes != 0 {
                    self.holes[c].insert((holes, number));
                }
            } else {
                self.hole_count[c] -= holes;
                self.holes[c].remove(&(holes, number));
            }
        }
        self.limit = blocks;
    }

    /// A page in a block that takes none any more: its first word and its owner.
    pub fn beyond(&self) -> Option<(u32, u32)> {
        let block = (self.limit..self.blocks.len() as u32).rev().find(|b| self.blocks[*b as usize].used != 0)?;
        let Block { class, owners, .. } = &self.blocks[block as usize];
        let (slot, owner) = (0u32..).zip(owners).find_map(|(slot, owner)| Some((slot, (*owner)?)))?;
        Some((block * BLOCK_WORDS + slot * slot_words(*class), owner))
    }

    /// Whether [`alloc`](Self::alloc) of this class would succeed.
    pub fn has_room(&self, class: u8) -> bool {
        !self.free.is_empty() || self.hole_count[usize::from(class)] != 0
    }

    /// Takes a slot; gives its first word.
    pub fn alloc(&mut self, class: u8, owner: u32) -> Option<u32> {
        let c = usize::from(class);
        let (holes, number) = match self.holes[c].first() {
            Some(&(holes, number)) => {
                self.holes[c].remove(&(holes, number));
                (holes, number)
            }
            None => {
                let number = self.free.pop_first()?;
                let holes = per_block(class);
                self.blocks[number as usize] = Block { class, owners: vec![None; holes as usize], used: 0 };
                self.hole_count[c] += holes;
                (holes, number)
            }
        };
        let block = &mut self.blocks[number as usize];
        let slot = block.owners.iter().position(Option::is_none)?;
        block.owners[slot] = Some(owner);
        block.used += 1;
        self.hole_count[c] -= 1;
        if holes > 1 {
            self.holes[c].insert((holes - 1, number));
        }
        Some(number * BLOCK_WORDS + slot as u32 * slot_words(class))
    }

    /// Gives a slot back.
    pub fn free(&mut self, word: u32) {
        let (number, slot) = self.place(word);
        let block = &mut self.blocks[number as usize];
        debug_assert!(block.owners[slot].is_some());
        block.owners[slot] = None;
        block.used -= 1;
        if number >= self.limit {
            return;
        }
        let (c, holes) = (usize::from(block.class), per_block(block.class) - block.used);
        self.hole_count[c] += 1;
        self.holes[c].remove(&(holes - 1, number));
        if block.used == 0 {
            self.release(number);
        } else {
            self.holes[c].insert((holes, number));
        }
    }

    /// Undoes [`free`](Self::free) of a slot in a block that is still in use, where nothing was placed or moved since.
    pub fn take_back(&mut self, word: u32, owner: u32) {
        let (number, slot) = self.place(word);
        let block = &mut self.blocks[number as usize];
        debug_assert!((block.used != 0 || number >= self.limit) && block.owners[slot].is_none());
        block.owners[slot] = Some(owner);
        let (c, holes) = (usize::from(block.class), per_block(block.class) - block.used);
        block.used += 1;
        if number >= self.limit {
            return;
        }
        self.hole_count[c] -= 1;
        self.holes[c].remove(&(holes, number));
        if holes > 1 {
            self.holes[c].insert((holes - 1, number));
        }
    }

    /// A page goes on in the slot of another.
    pub fn hand_over(&mut self, word: u32, owner: u32) {
        let (number, slot) = self.place(word);
        let block = &mut self.blocks[number as usize];
        debug_assert!(block.owners[slot].is_some());
        block.owners[slot] = Some(owner);
    }

    /// An empty block becomes free for every class.
    fn release(&mut self, number: u32) {
        let block = std::mem::take(&mut self.blocks[number as usize]);
        self.hole_count[usize::from(block.class)] -= per_block(block.class);
        self.free.insert(number);
    }

    /// Block and slot of a word.
    fn place(&self, word: u32) -> (u32, usize) {
        let number = word / BLOCK_WORDS;
        (number, (word % BLOCK_WORDS / slot_words(self.blocks[number as usize].class)) as usize)
    }

    /// Words of all holes and free blocks; no class can have more.
    pub fn free_words(&self) -> u64 {
        let holes: u64 = (0u8..).zip(&self.hole_count).map(|(c, &n)| u64::from(n) * u64::from(slot_words(c))).sum();
        self.free.len() as u64 * u64::from(BLOCK_WORDS) + holes
    }

    /// Who lives at a word of the pool.
    pub fn owner(&self, word: u32) -> Option<u32> {
        let block = self.blocks.get((word / BLOCK_WORDS) as usize)?;
        let slot = word % BLOCK_WORDS / slot_words(block.class);
        *block.owners.get(slot as usize)?
    }

    /// Frees one block by moving its pages into holes of others of its class; `None` where no class has enough.
    pub fn compact(&mut self) -> Option<Vec<Moved>> {
        let class = (0u8..).zip(&self.hole_count).find(|&(c, &holes)| holes >= per_block(c)).map(|(c, _)| c)?;
        let c = usize::from(class);
        let &(holes, number) = self.holes[c].last()?;
        // The block's own holes go with it, so that nothing is moved into them.
        self.holes[c].remove(&(holes, number));
        let owners = std::mem::take(&mut self.blocks[number as usize].owners);
        self.hole_count[c] -= holes;
        let mut moved = Vec::new();
        for (slot, owner) in (0u32..).zip(owners) {
            let Some(owner) = owner else { continue };
            let from = number * BLOCK_WORDS + slot * slot_words(class);
            // The holes elsewhere are at least as many as the pages here: both add up to a block.
            let to = self.alloc(class, owner)?;
            moved.push(Moved { owner, from, to });
        }
        self.blocks[number as usize] = Block::default();
        self.free.insert(number);
        Some(moved)
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
            assert!(slot_words(class) >= words);
        }
        assert_eq!(class_of(16385), None);
    }

    #[test]
    fn a_smaller_pool_takes_nothing_beyond_its_end() {
        let mut slots = Slots::new(4);
        let at: Vec<u32> = (0..4).map(|owner| slots.alloc(8, owner).unwrap()).collect();
        slots.free(at[1]);
        let small = slots.alloc(3, 9).unwrap();
        slots.resize(2);
        assert!(small / BLOCK_WORDS < 2 && !slots.has_room(8) && slots.has_room(3));
        assert_eq!(slots.free_words(), u64::from(BLOCK_WORDS - slot_words(3)));
        // Those beyond stay until they are freed or moved.
        assert_eq!(slots.beyond(), Some((at[3], 3)));
        slots.free(at[3]);
        assert_eq!((slots.beyond(), slots.owner(at[2])), (Some((at[2], 2)), Some(2)));
        // Larger again: the page there is where it was.
        slots.resize(5);
        assert_eq!((slots.beyond(), slots.owner(at[2])), (None, Some(2)));
        let more: Vec<u32> = (10..12).map(|owner| slots.alloc(8, owner).unwrap() / BLOCK_WORDS).collect();
        assert_eq!((more, slots.has_room(8)), (vec![3, 4], false));
        for word in [at[0], at[2], small, 3 * BLOCK_WORDS, 4 * BLOCK_WORDS] {
            slots.free(word);
        }
        assert_eq!((slots.free.len(), slots.hole_count), (5, [0; CLASSES]));
        slots.resize(0);
        assert!(slots.beyond().is_none() && !slots.has_room(0));
    }

    #[test]
    fn slots_never_overlap_and_holes_that_add_up_are_usable() {
        let mut slots = Slots::new(6);
        let mut live: HashMap<u32, (u32, u8)> = HashMap::new();
        let mut state = 1u64;
        for step in 0..20_000u32 {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            let roll = (state >> 33) as u32;
            if roll.is_multiple_of(2) {
                let class = (roll / 2 % CLASSES as u32) as u8;
                let free_words = 6 * BLOCK_WORDS - live.values().map(|&(_, c)| slot_words(c)).sum::<u32>();
                if !slots.has_room(class) {
                    while let Some(moved) = slots.compact() {
                        for m in moved {
                            let place = live.get_mut(&m.owner).unwrap();
                            assert_eq!(place.0, m.from);
                            place.0 = m.to;
                        }
                    }
                    // Each class wastes less than a block.
                    assert!(slots.has_room(class) || free_words < CLASSES as u32 * BLOCK_WORDS);
                }
                if let Some(at) = slots.alloc(class, step) {
                    live.insert(step, (at, class));
                }
            } else if let Some(&owner) = live.keys().min_by_key(|&&k| k ^ roll) {
                slots.free(live.remove(&owner).unwrap().0);
            }
            let mut spans: Vec<_> = live.iter().map(|(&o, &(at, c))| (at, at + slot_words(c), o)).collect();
            spans.sort_unstable();
            assert!(spans.windows(2).all(|w| w[0].1 <= w[1].0));
            assert!(spans.iter().all(|&(a, b, o)| slots.owner(a) == Some(o) && slots.owner(b - 1) == Some(o)));
        }
        for (at, _) in live.into_values() {
            slots.free(at);
        }
        assert_eq!(slots.free.len(), 6);
        assert_eq!(slots.hole_count, [0; CLASSES]);
    }
}
