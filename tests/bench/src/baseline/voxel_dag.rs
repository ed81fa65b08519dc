//! Erik Sintorn, Viktor Kämpe, Ola Olsson, Ulf Assarsson, *Compact Precomputed Voxelized Shadows*, SIGGRAPH 2014; Viktor
//! Kämpe, Erik Sintorn, Ulf Assarsson, *Fast, Memory-Efficient Construction of Voxelized Shadows*, I3D 2015: an octree of
//! the shadow over the light's x, y and z, N^3 voxels, equal subtrees stored once.
//!
//! | | words of 32 bits | holds |
//! |---|---|---|
//! | node | 1 + 1 per mixed child | 2 bits per child: dark, lit, mixed; where each mixed child lies |
//! | leaf, 4 x 4 x 4 voxels | 2 | one bit per voxel: lit |
//!
//! Depth is cut into N steps, as many as texels on a side. A voxel in which receivers must be lit and none dark is lit,
//! and the other way round; where both must be (the interval is thinner than a voxel), what more of its depths ask for:
//! this is the method's error. Voxels within an interval may be either: such a subtree is taken as its neighbours are if
//! the whole then is uniform; else, in a node or leaf that is mixed anyway, several choices are tried, and one that
//! makes a node that exists already is taken.
//!
//! No voxel is looked at above the leaves that the surface crosses: squares of texels have the least and largest of
//! their columns' ends, level by level.
//!
//! Unlike the papers: intervals of texels (area intervals, not voxelised triangles); no dense grid instead of the top
//! levels (2014) and no leaves made for 9^3 filters; the papers' own rule for undetermined voxels was not at hand.

use std::collections::HashMap;

use rayon::prelude::*;

use super::Baseline;
use super::image::Image;

/// Side of a leaf, log2.
const LEAF_LOG2: u32 = 2;
/// Undetermined children of a mixed node up to which all choices are tried.
const TRIED: u32 = 5;

const DARK: u32 = 0;
const LIT: u32 = 1;
const MIXED: u32 = 2;

/// In voxels: receivers before `lit` must be lit, those from `dark` on dark; `lit <= dark`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Column {
    lit: u32,
    dark: u32,
}

/// What a subtree is.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Found {
    Dark,
    Lit,
    Either,
    At(u32),
}

/// A map.
pub struct VoxelDag {
    log2: u32,
    words: Vec<u32>,
}

/// Ends of the columns of all squares, by level: the largest `lit` and the smallest `dark`.
struct Ends {
    log2: u32,
    levels: Vec<Vec<Column>>,
}

impl Ends {
    fn of(image: &Image) -> Ends {
        let side = image.side();
        let shift = 32 - image.log2;
        let column = |i: usize| {
            let t = image.allowed(i % side, i / side);
            // First voxel that does not lie wholly before or at the deepest lit depth; first that is wholly dark.
            let lit = ((u64::from(t.min) + 1) >> shift) as u32;
            let dark = ((u64::from(t.max) + (1 << shift)) >> shift).min(side as u64) as u32;
            let partly = |c: u32| {
                // The voxel at `c` holds lit depths and others.
                let start = u64::from(c) << shift;
                let lit_depths = (u64::from(t.min) + 1).saturating_sub(start).min(1 << shift);
                let dark_depths = (start + (1 << shift)).saturating_sub(u64::from(t.max) + 1).min(1 << shift);
                [lit_depths, dark_depths]
            };
            let (mut begin, mut end) = (lit, dark);
            if (lit as usize) < side {
                let [l, d] = partly(lit);
                if l > 0 && l >= d {
                    begin = lit + 1;
                }
            }
            if end > begin {
                let [l, d] = partly(end - 1);
                if d > 0 && d > l {
                    end -= 1;
                }
            }
            Column { lit: begin, dark: end.max(begin) }
        };
        let mut levels: Vec<Vec<Column>> = vec![(0..side * side).into_par_iter().map(column).collect()];
        for level in 1..=image.log2 {
            let (finer, across) = (&levels[level as usize - 1], side >> level);
            let join = |i: usize| {
                let first = (i / across * 2) * (2 * across) + i % across * 2;
                let four = [0, 1, 2 * across, 2 * across + 1].map(|o| finer[first + o]);
                Column {
                    lit: four.iter().map(|c| c.lit).fold(0, u32::max),
                    dark: four.iter().map(|c| c.dark).fold(u32::MAX, u32::min),
                }
            };
            let coarser = (0..across * across).into_par_iter().map(join).collect();
            levels.push(coarser);
        }
        Ends { log2: image.log2, levels }
    }

    fn at(&self, level: u32, x: u32, y: u32) -> Column {
        self.levels[level as usize][(y as usize) << (self.log2 - level) | x as usize]
    }
}

/// Nodes by what they hold, so that none is stored twice.
#[derive(Default)]
struct Store {
    words: Vec<u32>,
    leaves: HashMap<u64, u32>,
    nodes: Vec<HashMap<[u32; 9], u32>>,
}

impl Store {
    fn leaf(&mut self, bits: u64) -> u32 {
        let words = &mut self.words;
        *self.leaves.entry(bits).or_insert_with(|| {
            words.extend([bits as u32, (bits >> 32) as u32]);
            words.len() as u32 - 2
        })
    }

    fn node(&mut self, level: u32, key: [u32; 9]) -> u32 {
        let words = &mut self.words;
        *self.nodes[level as usize].entry(key).or_insert_with(|| {
            let mixed = (0..8).filter(|c| key[0] >> (2 * c) & 3 == MIXED).count();
            words.extend_from_slice(&key[..1 + mixed]);
            words.len() as u32 - 1 - mixed as u32
        })
    }
}

impl VoxelDag {
    /// Builds the octree from the intervals. Sides below 8 have no leaf and a node.
    pub fn new(image: &Image) -> VoxelDag {
        assert!(image.log2 > LEAF_LOG2);
        let ends = Ends::of(image);
        let mut store = Store { nodes: vec![HashMap::new(); image.log2 as usize + 1], ..Store::default() };
        let root = build(&ends, &mut store, image.log2, [0; 3]);
        // A lookup begins at a node: one is made of a uniform root.
        let root = match root {
            Found::At(at) => at,
            uniform => {
                let all = if uniform == Found::Dark { DARK } else { LIT };
                store.node(image.log2, [all * 0x5555, 0, 0, 0, 0, 0, 0, 0, 0])
            }
        };
        let mut words = store.words;
        // The root stands last; its place is one word more.
        words.push(root);
        assert!(words.len() < 1 << 32);
        VoxelDag { log2: image.log2, words }
    }

    #[inline(always)]
    fn is_lit(&self, x: u32, y: u32, d: u32) -> bool {
        let z = d >> (32 - self.log2);
        let mut at = self.words[self.words.len() - 1] as usize;
        let mut level = self.log2;
        while level > LEAF_LOG2 {
            level -= 1;
            let head = self.words[at];
            let c = child(x, y, z, level);
            let state = head >> (2 * c) & 3;
            if state != MIXED {
                return state == LIT;
            }
            let mixed = head >> 1 & 0x5555;
            let before = (mixed & ((1 << (2 * c)) - 1)).count_ones();
            at = self.words[at + 1 + before as usize] as usize;
        }
        let bit = (z & 3) << 4 | (y & 3) << 2 | x & 3;
        self.words[at + (bit >> 5) as usize] >> (bit & 31) & 1 != 0
    }
}

/// Which child of a node holds the voxel.
#[inline(always)]
fn child(x: u32, y: u32, z: u32, level: u32) -> u32 {
    (z >> level & 1) << 2 | (y >> level & 1) << 1 | x >> level & 1
}

impl Baseline for VoxelDag {
    fn name(&self) -> String {
        "voxel DAG".to_string()
    }

    fn citation(&self) -> &'static str {
        "Sintorn, Kämpe, Olsson, Assarsson, Compact Precomputed Voxelized Shadows, SIGGRAPH 2014; \
         Kämpe, Sintorn, Assarsson, Fast, Memory-Efficient Construction of Voxelized Shadows, I3D 2015"
    }

    fn bytes(&self) -> u64 {
        4 * self.words.len() as u64
    }

    fn value(&self, _: u32, _: u32) -> Option<u32> {
        None
    }

    fn lit(&self, x: u32, y: u32, d: u32) -> bool {
        self.is_lit(x, y, d)
    }

    fn count(&self, receivers: &[[u32; 3]]) -> usize {
        super::count(receivers, |x, y, d| self.is_lit(x, y, d))
    }
}

/// The cube at `at` (in cubes of its level).
fn build(ends: &Ends, store: &mut Store, level: u32, at: [u32; 3]) -> Found {
    let [x, y, z] = at;
    let (first, last) = (z << level, (z + 1) << level);
    let square = ends.at(level, x, y);
    match (square.dark >= last, square.lit <= first) {
        (true, true) => return Found::Either,
        (true, false) => return Found::Lit,
        (false, true) => return Found::Dark,
        _ => {}
    }
    if level == LEAF_LOG2 {
        return Found::At(leaf(ends, store, at));
    }
    let children: [Found; 8] = std::array::from_fn(|c| {
        let c = c as u32;
        build(ends, store, level - 1, [2 * x + (c & 1), 2 * y + (c >> 1 & 1), 2 * z + (c >> 2)])
    });
    let (mut key, mut mixed, mut open) = ([0u32; 9], 0, 0u32);
    for (c, child) in children.into_iter().enumerate() {
        let state = match child {
            Found::Dark => DARK,
            Found::Lit => LIT,
            Found::Either => {
                open |= 1 << (2 * c);
                DARK
            }
            Found::At(place) => {
                mixed += 1;
                key[mixed] = place;
                MIXED
            }
        };
        key[0] |= state << (2 * c);
    }
    if open.count_ones() <= TRIED {
        // All subsets of the open children lit, none first.
        let mut lit = 0u32;
        loop {
            let mut choice = key;
            choice[0] |= lit;
            if let Some(place) = store.nodes[level as usize].get(&choice) {
                return Found::At(*place);
            }
            lit = lit.wrapping_sub(open) & open;
            if lit == 0 {
                break;
            }
        }
    }
    Found::At(store.node(level, key))
}

/// The voxels of a leaf that the surface crosses.
fn leaf(ends: &Ends, store: &mut Store, [x, y, z]: [u32; 3]) -> u32 {
    let columns: [Column; 16] = std::array::from_fn(|i| {
        let i = i as u32;
        let c = ends.at(0, x << LEAF_LOG2 | i & 3, y << LEAF_LOG2 | i >> 2);
        let within = |v: u32| v.saturating_sub(z << LEAF_LOG2).min(1 << LEAF_LOG2);
        Column { lit: within(c.lit), dark: within(c.dark) }
    });
    // Every column as near to one depth as it may be: a level surface where that is possible.
    let choice = |depth: u32| {
        let mut bits = 0u64;
        for (i, c) in columns.iter().enumerate() {
            let end = depth.clamp(c.lit, c.dark);
            (0..end).for_each(|k| bits |= 1 << (16 * k + i as u32));
        }
        bits
    };
    let choices = [0, 4, 2, 1, 3].map(choice);
    match choices.iter().find_map(|bits| store.leaves.get(bits)) {
        Some(place) => *place,
        None => store.leaf(choices[0]),
    }
}

#[cfg(test)]
mod tests {
    use super::super::error::{Errors, wrong};
    use super::super::tests::{city, made};
    use super::*;
    use crate::random::Random;

    /// Voxels of a side of 8: 2^29 lattice depths.
    const VOXEL: u32 = 1 << 29;

    #[test]
    fn words_counted_by_hand() {
        // The answer changes at a voxel's border, on a border of leaves: a root without children, and its place.
        let level = made(3, |_, _| [4 * VOXEL - 1; 2]);
        let map = VoxelDag::new(&level);
        assert_eq!((map.bytes(), Errors::of(&map, &level, None).outside), (8, 0));
        // One voxel further: the lower four children are one leaf. A root of 5 words, a leaf of 2, the root's place.
        let lower = made(3, |_, _| [5 * VOXEL - 1; 2]);
        let map = VoxelDag::new(&lower);
        assert_eq!((map.bytes(), Errors::of(&map, &lower, None).outside), (4 * 8, 0));
        // Free to lie anywhere in a leaf's height: as the first.
        let free = made(3, |x, _| if x < 4 { [4 * VOXEL - 1, 5 * VOXEL] } else { [3 * VOXEL, 4 * VOXEL - 1] });
        let map = VoxelDag::new(&free);
        assert_eq!((map.bytes(), Errors::of(&map, &free, None).outside), (8, 0));
        // Nothing there: lit all over.
        let empty = made(3, |_, _| [u32::MAX; 2]);
        let map = VoxelDag::new(&empty);
        assert_eq!((map.bytes(), Errors::of(&map, &empty, None).outside), (8, 0));
        assert!(map.lit(3, 3, u32::MAX));
    }

    #[test]
    fn thin_intervals_take_what_more_depths_ask_for() {
        // The surface at a quarter and at three quarters of a voxel, without thickness.
        let image = made(3, |x, _| [2 * VOXEL + if x < 4 { VOXEL / 4 } else { 3 * (VOXEL / 4) }; 2]);
        let map = VoxelDag::new(&image);
        let voxel = 2 * VOXEL + VOXEL / 2;
        assert!(!map.lit(0, 0, voxel) && map.lit(7, 0, voxel));
        assert!(map.lit(0, 0, 2 * VOXEL - 1) && !map.lit(7, 7, 3 * VOXEL));
        assert_eq!(Errors::of(&map, &image, None).outside, 64);
    }

    /// Away from the surface by a voxel, every answer is right; the share that is wrong shrinks with the voxels.
    #[test]
    fn wrong_only_within_a_voxel_of_an_end() {
        let mut shares = Vec::new();
        for side in [64, 256] {
            let (_, image) = city(side);
            let map = VoxelDag::new(&image);
            let voxel = (1u64 << 32) / side;
            let mut random = Random::new(7, 0);
            let mut asked = Vec::new();
            let mut places = 0;
            for _ in 0..200_000 {
                let [x, y] = [0, 1].map(|_| (random.bits() % side) as u32);
                let d = (random.bits() >> 32) as u32;
                let t = image.truth(x as usize, y as usize);
                asked.push([x, y, d]);
                if u64::from(d) + voxel <= u64::from(t.min) {
                    assert!(map.lit(x, y, d));
                    places += 1;
                }
                if u64::from(d) > u64::from(t.max) + voxel {
                    assert!(!map.lit(x, y, d));
                    places += 1;
                }
            }
            assert!(places > 50_000);
            shares.push(wrong(&map, &image, None, &asked));
            assert!(map.bytes() < u64::from(side as u32).pow(2) * 4);
        }
        assert!(shares[0] > 0.0 && shares[1] < shares[0] && shares[0] < 0.05, "{shares:?}");
    }
}
