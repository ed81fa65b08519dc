//! Leonardo Scandolo, Pablo Bauszat, Elmar Eisemann, *Compressed Multiresolution Hierarchies for High-Quality Precomputed
//! Shadows*, Eurographics 2016, section 3.2: MH without the byte that aligns a node, "if memory footprint is overall more
//! critical than traversal performance".
//!
//! | node | bytes | holds |
//! |---|---|---|
//! | full | 7 | mask of its children (2 bits each), 16-bit offset of their group, depth |
//! | empty | 3 | mask, offset |
//! | leaf | 4 | depth |
//!
//! Subtrees stand close together (depth first). An offset counts from the group of the node, in units of the level's scale
//! (Lefebvre and Hoppe 2007): the smallest with which all offsets of the level fit.

use super::image::Image;
use super::tree::{Group, NONE, tree};
use super::{Baseline, answers_by_value};

/// Bits of a child in a mask.
const OWN: u32 = 1;
const BELOW: u32 = 2;

/// A map.
pub struct Unpadded {
    log2: u32,
    /// The depth that holds where no node has one.
    top: u32,
    /// Mask of the children of the root.
    mask: u8,
    /// Bytes of a unit of the offsets to groups on each level.
    scales: Vec<u32>,
    bytes: Vec<u8>,
}

fn mask_of(group: &Group) -> u8 {
    let child = |c: usize| {
        let own = if group.own >> c & 1 != 0 { OWN } else { 0 };
        let below = if group.below[c] != NONE { BELOW } else { 0 };
        (own | below) << (2 * c)
    };
    (0..4).map(child).sum::<u32>() as u8
}

/// Bytes of the children before those of which `mask` has no bits.
#[inline(always)]
fn bytes_of(mask: u32) -> u32 {
    let (own, below) = (mask & 0x55, mask >> 1 & 0x55);
    4 * own.count_ones() + 3 * below.count_ones()
}

/// Groups laid out level by level, the smallest first.
struct Layout<'a> {
    groups: &'a [Group],
    /// Bytes of each group with all below it.
    sizes: Vec<u64>,
    scales: Vec<u32>,
}

impl Layout<'_> {
    /// Offsets of the groups below a group whose children lie on `level`, and its bytes with them.
    fn offsets(&self, group: &Group, scale: u32) -> ([u64; 4], u64) {
        let mut end = u64::from(bytes_of(mask_of(group).into()));
        let offsets = group.below.map(|below| {
            if below == NONE {
                return 0;
            }
            let start = end.next_multiple_of(scale.into());
            end = start + self.sizes[below as usize];
            start
        });
        (offsets, end)
    }

    /// Chooses the scale of a level: all below are done.
    fn level(&mut self, of: &[u32]) {
        let fits = |scale: u32| {
            let last = |g: &u32| self.offsets(&self.groups[*g as usize], scale).0.into_iter().max();
            of.iter().filter_map(last).max().unwrap_or(0) / u64::from(scale) <= u16::MAX.into()
        };
        let scale = (1..).find(|s| fits(*s)).unwrap_or(1);
        self.scales.push(scale);
        for &g in of {
            self.sizes[g as usize] = self.offsets(&self.groups[g as usize], scale).1;
        }
    }

    fn write(&self, group: u32, level: u32, at: usize, out: &mut [u8]) {
        let g = &self.groups[group as usize];
        let scale = self.scales[level as usize];
        let (offsets, _) = self.offsets(g, scale);
        let mut next = at;
        for (c, offset) in offsets.into_iter().enumerate() {
            if g.below[c] != NONE {
                let units = (offset / u64::from(scale)) as u16;
                out[next] = mask_of(&self.groups[g.below[c] as usize]);
                out[next + 1..next + 3].copy_from_slice(&units.to_le_bytes());
                next += 3;
            }
            if g.own >> c & 1 != 0 {
                out[next..next + 4].copy_from_slice(&g.intervals[c].middle().to_le_bytes());
                next += 4;
            }
            if g.below[c] != NONE {
                self.write(g.below[c], level - 1, at + offset as usize, out);
            }
        }
    }
}

impl Unpadded {
    /// Builds MH from the intervals and writes it down.
    pub fn new(image: &Image) -> Unpadded {
        let (interval, root, groups) = tree(image);
        let top = interval.middle();
        if root == NONE {
            return Unpadded { log2: image.log2, top, mask: 0, scales: Vec::new(), bytes: Vec::new() };
        }
        // Level of each group's children; parents stand behind their children.
        let mut levels = vec![0; groups.len()];
        levels[root as usize] = image.log2 - 1;
        let mut by_level = vec![Vec::new(); image.log2 as usize];
        for (i, group) in groups.iter().enumerate().rev() {
            by_level[levels[i] as usize].push(i as u32);
            for below in group.below.iter().filter(|b| **b != NONE) {
                levels[*below as usize] = levels[i] - 1;
            }
        }
        let mut layout = Layout { groups: &groups, sizes: vec![0; groups.len()], scales: Vec::new() };
        by_level.iter().for_each(|of| layout.level(of));
        let mut bytes = vec![0; layout.sizes[root as usize] as usize];
        layout.write(root, image.log2 - 1, 0, &mut bytes);
        let mask = mask_of(&groups[root as usize]);
        Unpadded { log2: image.log2, top, mask, scales: layout.scales, bytes }
    }

    #[inline(always)]
    fn value_of(&self, x: u32, y: u32) -> u32 {
        let (mut at, mut level) = (0usize, self.log2);
        let (mut mask, mut value) = (u32::from(self.mask), self.top);
        while level > 0 {
            level -= 1;
            let shift = 2 * ((y >> level & 1) << 1 | x >> level & 1);
            let child = mask >> shift & 3;
            let mut place = at + bytes_of(mask & ((1 << shift) - 1)) as usize;
            let below = child & BELOW != 0;
            if below {
                mask = self.bytes[place].into();
                let units = u16::from_le_bytes([self.bytes[place + 1], self.bytes[place + 2]]);
                at += usize::from(units) * self.scales[level as usize] as usize;
                place += 3;
            }
            if child & OWN != 0 {
                value = u32::from_le_bytes([0, 1, 2, 3].map(|k| self.bytes[place + k]));
            }
            if !below {
                break;
            }
        }
        value
    }
}

impl Baseline for Unpadded {
    fn name(&self) -> String {
        "MH, unpadded".to_string()
    }

    fn citation(&self) -> &'static str {
        "Scandolo, Bauszat, Eisemann, Multiresolution Hierarchies, 2016, section 3.2, without padding"
    }

    fn bytes(&self) -> u64 {
        // The depth at the top and the root's mask, too.
        5 + (self.bytes.len() + 4 * self.scales.len()) as u64
    }

    answers_by_value!();
}

#[cfg(test)]
mod tests {
    use super::super::error::Errors;
    use super::super::tests::{city, made};
    use super::*;

    #[test]
    fn nothing_is_lost() {
        let noise = |x: usize, y: usize| [(x * 7919 + y * 104_729) as u32 % 1009; 2];
        for image in [city(512).1, made(8, noise)] {
            let map = Unpadded::new(&image);
            assert_eq!(Errors::of(&map, &image, None).outside, 0);
            // The last of four subtrees of noise begins beyond 16 bits.
            assert!(image.log2 != 8 || map.scales.iter().any(|s| *s > 1), "{:?}", map.scales);
        }
        for side in [0, 3] {
            let flat = made(side, |_, _| [7; 2]);
            assert_eq!((Unpadded::new(&flat).value_of(0, 0), Unpadded::new(&flat).bytes.len()), (7, 0));
        }
    }

    /// By hand: one texel's depth stands for its four, which is that of all others (an empty node above them) or not (a full
    /// one); the three that have a depth of their own are leaves.
    #[test]
    fn nodes_take_seven_three_and_four_bytes() {
        for (first, bytes) in [(1, 7 + 3 * 4), (9, 3 + 3 * 4)] {
            let of = |x, y| [first, 2, 3, 4][x + 2 * y];
            let image = made(2, |x, y| if x < 2 && y < 2 { [of(x, y); 2] } else { [9; 2] });
            let map = Unpadded::new(&image);
            let found = [[0, 0], [1, 0], [0, 1], [1, 1], [3, 3]].map(|[x, y]| map.value_of(x, y));
            assert_eq!((found, map.bytes.len()), ([first, 2, 3, 4, 9], bytes));
        }
    }
}
