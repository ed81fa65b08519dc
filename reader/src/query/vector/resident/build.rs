//! From checked pages to groups that point at their children, from these to grid and bricks.

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing,
    clippy::cast_possible_truncation
)]

use umbrage_format::kind::mh::child_of;
use umbrage_format::kind::vector::{Group, Header};
use umbrage_format::projection::UNCOVERED;

use super::entries::{Entries, Palette, bytes_held, count};
use super::{Brick, GRID_LEVELS, LEAF, PROVEN, Tree};
use crate::query::pyramid::Pyramid;

/// A page in the array of all.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::query) struct Page {
    /// First word.
    pub first: u32,
    /// First child page.
    pub first_child: u32,
    /// First texel of its footprint.
    pub origin: (u32, u32),
}

/// Where something hangs: the node whose children it is, and what answers there from above.
#[derive(Clone, Copy, Debug)]
struct Link {
    /// Place in `nodes`; [`NOWHERE`] for the root's group.
    node: u32,
    holds: u32,
    /// Level of the children.
    level: u8,
}

/// A page, and how far its groups have been added.
#[derive(Debug)]
struct Visit<'a> {
    place: Page,
    palette: Palette<'a>,
    /// Of each group that has been met.
    links: Vec<Link>,
    /// Next group, next node with an entry, next stub.
    number: u32,
    index: u32,
    stubs: u32,
}

/// The nodes of a brick.
const CELLS: [u32; 16] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15];
/// No place.
const NOWHERE: u32 = u32::MAX;

/// Words that the tree takes for a page, at most, also while it is built.
pub(in crate::query) fn words_held(page: &[u32]) -> u64 {
    let h = Header::decode(page);
    let (visit, link) = (size_of::<Visit<'_>>().div_ceil(4) as u64, size_of::<Link>() as u64 / 4);
    // Nodes and what holds, a brick and what holds in it, a grid with no more cells than there are nodes, twice while it
    // is made, a third of it above, and a link.
    let group = 5 + 21 + 8 + 2 + link;
    visit + u64::from(h.groups) * group + u64::from(h.palette()) * 2 + bytes_held(&h).div_ceil(4)
}

/// The groups of all pages; the first has the root alone, at c = 0.
#[derive(Debug)]
struct Groups {
    /// The children of each group, four and four: [`LEAF`] with what answers, or the group of its own children.
    nodes: Vec<u32>,
    /// For each group what answers in its parent's square on the parent's level.
    holds: Vec<u32>,
    entries: Entries,
}

impl Tree {
    /// From the pages, those of other roots than the first being left out. Links are checked: each page hangs at one
    /// node, in a page before it.
    pub(in crate::query) fn new(words: &[u32], pages: &[Page], log2_resolution: u8) -> Self {
        let mut entries = Entries::default();
        // What a walk finds that finds nothing: reference 0.
        entries.put_constant(UNCOVERED);
        let mut groups = Groups { nodes: Vec::new(), holds: Vec::new(), entries };
        let mut visits: Vec<Option<Box<Visit<'_>>>> = pages.iter().map(|_| None).collect();
        let visit = |page: &Page, link| {
            let own = words.get(page.first as usize..).unwrap_or_default();
            let palette = Palette::new(own, page.origin);
            Box::new(Visit { place: *page, palette, links: vec![link], number: 0, index: 0, stubs: 0 })
        };
        if let (Some(first), Some(page)) = (visits.first_mut(), pages.first()) {
            *first = Some(visit(page, Link { node: NOWHERE, holds: 0, level: log2_resolution }));
        }
        // Level by level through all pages: what answers most of the map then lies side by side.
        for level in (0..=log2_resolution).rev() {
            for ordinal in 0..visits.len() {
                let Some(mut v) = visits.get_mut(ordinal).and_then(Option::take) else { continue };
                let goes_on = groups.add(&mut v, level, |child, link| {
                    if let (Some(slot), Some(page)) = (visits.get_mut(child), pages.get(child)) {
                        *slot = Some(visit(page, link));
                    }
                });
                if let (true, Some(slot)) = (goes_on, visits.get_mut(ordinal)) {
                    *slot = Some(v);
                }
            }
        }
        let mut tree = groups.finish(log2_resolution);
        tree.build();
        tree
    }
}

impl Groups {
    /// Adds the groups of a page whose nodes are of a level; calls `stub` with every child page and where it hangs.
    /// False where there are no more.
    fn add(&mut self, v: &mut Visit<'_>, level: u8, mut stub: impl FnMut(usize, Link)) -> bool {
        let page = v.palette.page;
        while let Some(&link) = v.links.get(v.number as usize) {
            if link.level < level {
                return true;
            }
            let mask = Group::of(page, v.number).mask;
            v.number += 1;
            if mask.0 == 0 && v.number != 1 {
                stub(v.place.first_child.wrapping_add(v.stubs) as usize, link);
                v.stubs += 1;
                continue;
            }
            let group = count(&self.holds);
            if let Some(node) = self.nodes.get_mut(link.node as usize) {
                *node = group;
            }
            self.holds.push(link.holds);
            for c in 0..4 {
                let kind = mask.child(c);
                let mut holds = link.holds;
                if kind.has_value() {
                    let proven = if v.palette.layout.proven(page, v.index) { PROVEN } else { 0 };
                    let entry = v.palette.layout.entry(page, v.index);
                    holds = self.entries.add(&mut v.palette, entry) | proven;
                    v.index += 1;
                }
                if kind.has_children() {
                    v.links.push(Link { node: count(&self.nodes), holds, level: link.level.saturating_sub(1) });
                }
                self.nodes.push(LEAF | holds);
            }
        }
        false
    }

    /// Child c of a node; a leaf is its own.
    fn child(&self, node: u32, c: u32) -> u32 {
        if node & LEAF != 0 { node } else { self.nodes.get((4 * node + c) as usize).copied().unwrap_or(LEAF) }
    }

    /// What answers in a node's square on its level.
    fn answer(&self, node: u32) -> u32 {
        if node & LEAF != 0 { node & !LEAF } else { self.holds.get(node as usize).copied().unwrap_or(0) }
    }

    /// The grid on the finest level that is even and has no more nodes than all groups; bricks below.
    fn finish(mut self, log2_resolution: u8) -> Tree {
        self.entries.finish();
        let even = |levels: &u8| (log2_resolution - levels).is_multiple_of(2);
        let fits = |levels: &u8| self.nodes.len() >> (2 * levels) != 0;
        let finest = GRID_LEVELS.min(log2_resolution);
        let levels = (0..=finest).rev().filter(even).find(fits).unwrap_or(log2_resolution & 1);
        let (mut grid, mut above) = (vec![self.child(0, 0)], Vec::new());
        for width in 1..=levels {
            above.extend(grid.iter().map(|n| self.answer(*n)));
            let side = 1u32 << width;
            let cells = (0..side).flat_map(|y| (0..side).map(move |x| (x, y)));
            let parent =
                |x: u32, y: u32| grid.get(((y >> 1) << (width - 1) | x >> 1) as usize).copied().unwrap_or(LEAF);
            let finer = cells.map(|(x, y)| self.child(parent(x, y), child_of(x, y, 0))).collect();
            grid = finer;
        }
        let mut below = Vec::new();
        for node in &mut grid {
            if *node & LEAF == 0 {
                below.push(std::mem::replace(node, count(&below)));
            }
        }
        let (mut bricks, mut holds) = (Vec::new(), Vec::new());
        while let Some(&group) = below.get(bricks.len()) {
            let between = [0, 1, 2, 3].map(|c| self.child(group, c));
            let mut nodes = CELLS.map(|i| {
                let (x, y) = (i & 3, i >> 2);
                let [a, b, c, d] = between;
                let above = [[a, b], [c, d]].map(|row| if x < 2 { row[0] } else { row[1] });
                self.child(if y < 2 { above[0] } else { above[1] }, child_of(x, y, 0))
            });
            for node in &mut nodes {
                if *node & LEAF == 0 {
                    below.push(std::mem::replace(node, count(&below)));
                }
            }
            let [a, b, c, d] = between.map(|n| self.answer(n));
            bricks.push(Brick(nodes));
            holds.push([self.answer(group), a, b, c, d]);
        }
        Tree {
            bricks,
            holds,
            grid,
            above,
            grid_level: log2_resolution - levels,
            log2_resolution,
            entries: self.entries,
            pyramid: Pyramid::default(),
        }
    }
}
