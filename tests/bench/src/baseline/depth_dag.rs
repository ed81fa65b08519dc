//! Leonardo Scandolo, Elmar Eisemann, *Directed Acyclic Graph Encoding for Compressed Shadow Maps*, High-Performance
//! Graphics 2021: the tree of MH without its depths, equal subtrees stored once; depths apart; bit planes for the lowest
//! levels.
//!
//! | | words of 32 bits | holds |
//! |---|---|---|
//! | node | 1 | 8 bits: which children have a depth of their own, which have nodes below |
//! | | 1 per child with nodes below | where that is |
//! | | 1 per such child after the first | how many depths lie in front of its own, within the node |
//! | block, 8 x 8 texels | 1 | 4 + 16 bits, which nodes of levels 2 and 1 have a depth; whether the next words are there |
//! | | 0 or 2 | 64 bits, which texels have one |
//!
//! Depths stand in the order of a traversal: those of a node's children, then those below each child; in a block level by
//! level, each level by rising Morton code. A lookup sums up what lies in front on its way down, and remembers the
//! place of the last depth that it met: one depth is read, at the end.
//!
//! 64 depths make a group: 12 bytes (smallest depth, first word, bits of a depth, bits left out below) and the depths
//! above the smallest one, in as many bits as the largest takes. All of a group leave out as many low bits as every
//! interval in it allows.
//!
//! Nothing is lost: every depth is within its interval in MH. Of the paper only the abstract was at hand: a DAG of
//! MH's structure, depths compressed and stored separately, bit planes for the lower levels. The width of all fields, how
//! many levels are bit planes (3), the counts beside pointers (as for colours in Dado et al. 2016) and how depths are
//! compressed are ours.

use std::collections::HashMap;

use umbrage::writer::interval::Interval;

use super::image::Image;
use super::tree::{Group, NONE, tree};
use super::{Baseline, answers_by_value};

/// Level of a block of bit planes.
const BLOCK: u32 = 3;
/// Bit of a block's first word: its texels' plane follows.
const FINE: u32 = 1 << 20;
/// Depths in a group.
const GROUP: usize = 64;
/// A map.
pub struct DepthDag {
    log2: u32,
    /// The depth that holds where no node has one.
    top: u32,
    root: u32,
    words: Vec<u32>,
    depths: Depths,
}

/// Topology under construction.
#[derive(Default)]
struct Dag {
    words: Vec<u32>,
    /// Where each node begins, by its words.
    known: HashMap<Vec<u32>, u32>,
    /// Depths in traversal order.
    depths: Vec<Interval>,
}

impl Dag {
    fn place(&mut self, words: Vec<u32>) -> u32 {
        let all = &mut self.words;
        *self.known.entry(words).or_insert_with_key(|words| {
            all.extend_from_slice(words);
            (all.len() - words.len()) as u32
        })
    }

    /// Nodes of the group whose children lie on `level`.
    fn node(&mut self, groups: &[Group], group: u32, level: u32) -> u32 {
        if level < BLOCK {
            return self.block(groups, group);
        }
        let g = &groups[group as usize];
        let start = self.depths.len();
        self.depths.extend((0..4).filter(|c| g.own >> c & 1 != 0).map(|c| g.intervals[c]));
        let mut head = u32::from(g.own);
        let mut words = vec![0];
        for c in (0..4).filter(|c| g.below[*c] != NONE) {
            head |= 16 << c;
            let before = (self.depths.len() - start) as u32;
            if words.len() > 1 {
                words.push(before);
            }
            let below = self.node(groups, g.below[c], level - 1);
            words.push(below);
        }
        words[0] = head;
        self.place(words)
    }

    fn block(&mut self, groups: &[Group], group: u32) -> u32 {
        // By level: which nodes have a depth, and those depths by Morton code.
        let mut planes = [0u64; 3];
        let mut found: [Vec<(u32, Interval)>; 3] = Default::default();
        let mut open = vec![(group, 0u32, 0usize)];
        while let Some((group, code, depth)) = open.pop() {
            let g = &groups[group as usize];
            for c in 0..4 {
                let code = code << 2 | c as u32;
                if g.own >> c & 1 != 0 {
                    planes[depth] |= 1 << code;
                    found[depth].push((code, g.intervals[c]));
                }
                if g.below[c] != NONE {
                    open.push((g.below[c], code, depth + 1));
                }
            }
        }
        for level in &mut found {
            level.sort_unstable_by_key(|f| f.0);
            self.depths.extend(level.iter().map(|f| f.1));
        }
        let head = (planes[0] | planes[1] << 4) as u32;
        let words = match planes[2] {
            0 => vec![head],
            fine => vec![head | FINE, fine as u32, (fine >> 32) as u32],
        };
        self.place(words)
    }
}

impl DepthDag {
    /// Builds MH from the intervals and takes it apart.
    ///
    /// # Panics
    /// Sides below 8.
    pub fn new(image: &Image) -> DepthDag {
        assert!(image.log2 >= BLOCK);
        let (interval, group, groups) = tree(image);
        let mut dag = Dag::default();
        let root = match group {
            NONE => dag.place(vec![0]),
            group => dag.node(&groups, group, image.log2 - 1),
        };
        assert!(dag.words.len() < 1 << 32 && dag.depths.len() < 1 << 32);
        let depths = Depths::of(&dag.depths);
        DepthDag { log2: image.log2, top: interval.middle(), root, words: dag.words, depths }
    }

    #[inline(always)]
    fn value_of(&self, x: u32, y: u32) -> u32 {
        let (mut at, mut level) = (self.root as usize, self.log2);
        // Depths in front of the node; place of the last depth met.
        let (mut front, mut last) = (0u32, NONE);
        let child = |level: u32| (y >> level & 1) << 1 | x >> level & 1;
        while level > BLOCK {
            level -= 1;
            let (head, c) = (self.words[at], child(level));
            let before = (1u32 << c) - 1;
            if head >> c & 1 != 0 {
                last = front + (head & before).count_ones();
            }
            let below = head >> 4;
            if below >> c & 1 == 0 {
                return self.depth(last);
            }
            let i = (below & before).count_ones() as usize;
            front += match i {
                0 => (head & 15).count_ones(),
                _ => self.words[at + 2 * i],
            };
            at = self.words[at + if i == 0 { 1 } else { 1 + 2 * i }] as usize;
        }
        let head = self.words[at];
        let (two, one) = (head & 15, head >> 4 & 0xFFFF);
        let code = child(2);
        if two >> code & 1 != 0 {
            last = front + (two & ((1 << code) - 1)).count_ones();
        }
        front += two.count_ones();
        let code = code << 2 | child(1);
        if one >> code & 1 != 0 {
            last = front + (one & ((1 << code) - 1)).count_ones();
        }
        if head & FINE != 0 {
            front += one.count_ones();
            let fine = u64::from(self.words[at + 1]) | u64::from(self.words[at + 2]) << 32;
            let code = code << 2 | child(0);
            if fine >> code & 1 != 0 {
                last = front + (fine & ((1 << code) - 1)).count_ones();
            }
        }
        self.depth(last)
    }

    #[inline(always)]
    fn depth(&self, place: u32) -> u32 {
        if place == NONE { self.top } else { self.depths.get(place as usize) }
    }
}

impl Baseline for DepthDag {
    fn name(&self) -> String {
        "depth DAG".to_string()
    }

    fn citation(&self) -> &'static str {
        "Scandolo, Eisemann, Directed Acyclic Graph Encoding for Compressed Shadow Maps, High-Performance Graphics 2021"
    }

    fn bytes(&self) -> u64 {
        // The depth at the top and the place of the root, too.
        8 + 4 * self.words.len() as u64 + self.depths.bytes()
    }

    answers_by_value!();
}

/// Depths in groups of [`GROUP`].
struct Depths {
    groups: Vec<Packed>,
    /// One word more than the bits take, so that two can always be read.
    bits: Vec<u32>,
}

/// A group's head: 12 bytes, two of them spare.
#[derive(Clone, Copy)]
struct Packed {
    /// Smallest depth, in units of what is left out.
    base: u32,
    /// Its first word.
    start: u32,
    /// Bits of a depth.
    width: u8,
    /// 5 bits: low bits left out; 1 bit: the largest code stands for uncovered.
    shape: u8,
}

/// Of [`Packed::shape`].
const HAS_OPEN: u8 = 32;

impl Depths {
    fn of(intervals: &[Interval]) -> Depths {
        let mut all = Depths { groups: Vec::new(), bits: Vec::new() };
        for group in intervals.chunks(GROUP) {
            all.push(group);
        }
        all.bits.push(0);
        all
    }

    fn push(&mut self, group: &[Interval]) {
        let is_open = |i: &&Interval| **i == Interval::UNCOVERED;
        let open = group.iter().any(|i| is_open(&i));
        // A multiple of 2^s above the lower end, if it is within.
        let of = |i: &Interval, s: u32| {
            let up = (u64::from(i.min) + (1 << s) - 1) >> s;
            (up << s <= u64::from(i.max)).then_some(up as u32)
        };
        let covered = || group.iter().filter(|i| !is_open(i));
        let shift = (0..32).rev().find(|s| covered().all(|i| of(i, *s).is_some())).unwrap_or(0);
        let codes: Vec<u32> = covered().filter_map(|i| of(i, shift)).collect();
        let base = codes.iter().copied().min().unwrap_or(0);
        let most = codes.iter().map(|c| c - base).max().unwrap_or(0);
        // One code is for uncovered; the depths of covered texels stay below 2^32 - 1, so 32 bits suffice.
        let codes_needed = if codes.is_empty() { 1 } else { u64::from(most) + 1 + u64::from(open) };
        let width = codes_needed.next_power_of_two().trailing_zeros() as u8;
        let shape = shift as u8 | if open { HAS_OPEN } else { 0 };
        self.groups.push(Packed { base, start: self.bits.len() as u32, width, shape });
        let largest = ((1u64 << width) - 1) as u32;
        let (mut word, mut filled) = (0u64, 0);
        let mut next = codes.iter();
        for i in group {
            let code = if is_open(&i) { largest } else { next.next().map_or(0, |c| c - base) };
            word |= u64::from(code) << filled;
            filled += u32::from(width);
            if filled >= 32 {
                self.bits.push(word as u32);
                (word, filled) = (word >> 32, filled - 32);
            }
        }
        if filled > 0 {
            self.bits.push(word as u32);
        }
    }

    #[inline(always)]
    fn get(&self, place: usize) -> u32 {
        let head = self.groups[place / GROUP];
        let width = u32::from(head.width);
        let bit = (place % GROUP) as u32 * width;
        let at = (head.start + (bit >> 5)) as usize;
        let two = if width == 0 { 0 } else { u64::from(self.bits[at]) | u64::from(self.bits[at + 1]) << 32 };
        let largest = (1u64 << width) - 1;
        let code = two >> (bit & 31) & largest;
        if head.shape & HAS_OPEN != 0 && code == largest {
            return u32::MAX;
        }
        (head.base + code as u32) << (head.shape & 31)
    }

    fn bytes(&self) -> u64 {
        (size_of::<Packed>() * self.groups.len() + 4 * self.bits.len()) as u64
    }
}

#[cfg(test)]
mod tests {
    use super::super::error::Errors;
    use super::super::tests::{city, made, of};
    use super::*;
    use crate::random::Random;
    use umbrage::writer::solid::Policy;

    #[test]
    fn words_counted_by_hand() {
        // One interval for all: the top, an empty node, no depths, and the last word of the bits.
        let level = made(3, |_, _| [90, 110]);
        let map = DepthDag::new(&level);
        assert_eq!((map.value_of(7, 7), map.bytes()), (100, 8 + 4 + 4));
        // Four equal quarters of 8 x 8, one texel of each off, depths of their own: one block with texels (3 words), a
        // node (1 + 4 + 3 words); four depths between 1000 and 4000 that leave out 3 bits: 375 codes, 9 bits.
        let spots = made(4, |x, y| match (x % 8, y % 8) {
            (5, 2) => [1000 * (1 + x as u32 / 8 + 2 * (y as u32 / 8)); 2],
            _ => [90, 110],
        });
        let map = DepthDag::new(&spots);
        assert_eq!(map.words.len(), 3 + 8);
        assert_eq!((map.depths.groups[0].width, map.depths.groups[0].shape), (9, 3));
        assert_eq!(map.bytes(), 8 + 4 * 11 + 12 + 4 * (2 + 1));
        assert_eq!([[5, 2], [13, 2], [5, 10], [13, 10]].map(|[x, y]| map.value_of(x, y)), [1000, 2000, 3000, 4000]);
        assert_eq!(Errors::of(&map, &spots, None).outside, 0);
    }

    #[test]
    fn depths_come_back_within_their_intervals() {
        let mut random = Random::new(8, 0);
        for bits in [0, 4, 17, 31] {
            for open in [0.0, 0.1, 1.0] {
                let intervals: Vec<Interval> = (0..1000)
                    .map(|_| {
                        let min = (random.bits() >> 32) as u32 % (u32::MAX - 1);
                        let wide = (random.bits() as u32) & ((1u32 << bits) - 1);
                        let covered = Interval { min, max: min.saturating_add(wide).min(u32::MAX - 1) };
                        if random.unit() < open { Interval::UNCOVERED } else { covered }
                    })
                    .collect();
                let depths = Depths::of(&intervals);
                for (place, i) in intervals.iter().enumerate() {
                    let v = depths.get(place);
                    assert!(i.min <= v && v <= i.max, "{bits} {open}: {v}, {i:?}");
                }
            }
        }
    }

    #[test]
    fn a_city_loses_nothing() {
        for (policy, side) in [(Policy::Closed, 512), (Policy::OneSided, 64)] {
            let (_, image) = of("city:3:0.05", policy, side);
            let map = DepthDag::new(&image);
            assert_eq!(Errors::of(&map, &image, None).outside, 0, "{policy}");
        }
        let (_, image) = city(512);
        assert!(DepthDag::new(&image).bytes() < 4 * 512 * 512 / 4);
    }
}
