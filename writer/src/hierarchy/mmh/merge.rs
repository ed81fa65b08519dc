//! Matches subtrees of one shape and merges them (Scandolo 2019, section 2.6.2, algorithm 5).
//!
//! In: the groups of a whole `mh` tree with the interval of every value. Out: a [`Merged`]: for each group the one that
//! stands in its place, and the value of each node, which lies in the node's interval in every place where it answers.
//!
//! **Frames.** Intervals stay absolute, in the frame of the place where the group was built. A subtree's *base* is the
//! value that holds above it there. Two subtrees match where, less their bases, the intervals of each pair of nodes meet.
//! The survivor keeps the common parts, in its own frame. So a value v of it stands for `v - base + base'` in a place
//! with base', and that lies in the interval of the node it stands for.
//!
//! **Departure from the paper.** It makes intervals relative to the middle of the parent's interval before it merges;
//! that middle moves when the parent itself is merged, and then the child's interval is no longer true. Here a subtree is
//! relative to the value above the *subtree*, and that value is fixed before: heights are worked through from tall to
//! short, and when one is done, the values of its groups are final.

use rayon::prelude::*;

use umbrage_format::kind::mh::Mask;

use super::topology;
use crate::hierarchy::mh::{Group, NONE, Node, Span};
use crate::interval::Interval;

/// Words of the largest subtree that may be shared: it must fit an ordinary page.
pub const MOST_WORDS: u32 = 2048;

/// Farthest that a value of a shared subtree may lie from the value above it: so every rise in it is a signed number of 32
/// bits, and the sums of all ways can be bounded from the file alone (spec/mmh.md, Values).
const FARTHEST: i64 = (1 << 30) - 1;

/// What became of the pairs that were held against each other (Scandolo 2019, table 2.8).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Pairs {
    /// Refused because of the extremes of their intervals.
    pub intervals: u64,
    /// Refused by the test of every node.
    pub nodes: u64,
    /// Merged.
    pub merged: u64,
}

impl Pairs {
    fn add(&mut self, o: Pairs) {
        self.intervals += o.intervals;
        self.nodes += o.nodes;
        self.merged += o.merged;
    }
}

/// A tree some of whose groups stand for others. Groups are numbered in preorder, so a subtree is a range.
#[derive(Debug, Default)]
pub struct Merged {
    /// Types of each group.
    pub mask: Vec<u8>,
    /// Groups below its children, [`NONE`] where there is none; before merging.
    pub below: Vec<[u32; 4]>,
    /// Final values of leaf and inner children, in the group's frame.
    pub value: Vec<[u32; 4]>,
    /// What holds above the group, in its frame.
    pub base: Vec<u32>,
    /// What is known about the squares of groups where they were built.
    pub span: Vec<Span>,
    /// Groups of the subtree, itself included.
    pub groups: Vec<u32>,
    /// Words of the subtree before merging.
    pub words: Vec<u32>,
    /// The group that stands in its place: always one that comes later; itself where it survived.
    pub into: Vec<u32>,
    /// Pairs by the height of their subtrees: at least 1, at most 24.
    pub pairs: Vec<Pairs>,
    /// Ends of the intervals of values.
    interval: Vec<[Interval; 4]>,
    /// Levels of groups below it, itself included.
    height: Vec<u8>,
    hash: Vec<u64>,
}

impl Merged {
    /// Bytes held while subtrees are matched.
    pub fn bytes(&self) -> u64 {
        const EACH: usize = 1 + 16 + 16 + 4 + size_of::<Span>() + 3 * 4 + 32 + 1 + 8;
        // Of the ranges of a list there are as many again, at most.
        (self.mask.len() * (EACH + 64)) as u64
    }

    /// Types of group `g`.
    pub fn mask(&self, g: u32) -> Mask {
        Mask(self.mask[g as usize])
    }

    /// The group below child `c` of group `g`, after merging.
    pub fn child(&self, g: u32, c: usize) -> Option<u32> {
        let below = self.below[g as usize][c];
        (below != NONE).then(|| self.into[below as usize])
    }

    /// What holds above the groups below child `c` of group `g`, in the frame of `g`.
    fn base_below(&self, g: usize, c: usize) -> u32 {
        if Mask(self.mask[g]).child(c as u32).has_value() { self.value[g][c] } else { self.base[g] }
    }

    /// The tree below `root`, nothing merged yet; `intervals` are those of the groups' values.
    pub fn of(groups: &[Group], intervals: &[[Interval; 4]], root: Node) -> Self {
        let mut m = Merged::default();
        if root.below != NONE {
            m.gather(groups, intervals, root.below);
            m.base[0] = root.interval.middle();
        }
        m
    }

    /// Takes the groups from `from` down in preorder.
    fn gather(&mut self, groups: &[Group], intervals: &[[Interval; 4]], from: u32) -> (u32, u8) {
        let at = self.mask.len();
        let g = &groups[from as usize];
        self.mask.push(g.mask.0);
        self.below.push([NONE; 4]);
        self.value.push(g.value);
        self.base.push(0);
        self.span.push(g.span);
        self.interval.push(intervals[from as usize]);
        for list in [&mut self.groups, &mut self.words, &mut self.into] {
            list.push(0);
        }
        self.height.push(0);
        self.hash.push(0);
        let (mut words, mut height) = (g.mask.words(), 1);
        let mut known = [None; 4];
        for (c, known) in known.iter_mut().enumerate() {
            if g.below[c] != NONE {
                let (below, h) = self.gather(groups, intervals, g.below[c]);
                self.below[at][c] = below;
                *known = Some((self.words[below as usize], self.hash[below as usize]));
                words += self.words[below as usize];
                height = height.max(h + 1);
            }
        }
        self.into[at] = at as u32;
        self.groups[at] = (self.mask.len() - at) as u32;
        self.words[at] = words;
        self.hash[at] = topology::hash(g.mask.0, &known);
        self.height[at] = height;
        (at as u32, height)
    }
}

/// Merges subtrees, each with one of the `search` nearest of its shape where it matches one. Groups that are `kept` stay
/// as and where they are, though what is below them may go. `go_on` is asked between steps; none where it says no. The
/// answer does not depend on the number of threads.
pub fn merge(mut m: Merged, kept: &[bool], search: u32, go_on: &(impl Fn() -> bool + Sync)) -> Option<Merged> {
    let tallest = m.height.first().copied().unwrap_or(0);
    m.pairs = vec![Pairs::default(); usize::from(tallest) + 1];
    let mut by_height: Vec<Vec<u32>> = vec![Vec::new(); usize::from(tallest) + 1];
    for g in 0..m.mask.len() {
        by_height[usize::from(m.height[g])].push(g as u32);
    }
    // Groups inside a subtree that another stands for.
    let mut gone = vec![false; m.mask.len()];
    for height in (1..=usize::from(tallest)).rev() {
        let live = by_height[height].iter().copied().filter(|g| !gone[*g as usize]);
        let free = live.clone().filter(|g| !kept[*g as usize] && m.words[*g as usize] <= MOST_WORDS);
        let lists = shapes(&m, free.collect());
        let done: Option<Vec<_>> =
            lists.par_iter().map(|list| if go_on() { Some(pairs(&m, list, search)) } else { None }).collect();
        let live: Vec<u32> = live.collect();
        for found in done? {
            m.pairs[height].add(found.pairs);
            for (from, to) in found.merges {
                m.into[from as usize] = to;
                let range = from as usize..(from + m.groups[from as usize]) as usize;
                gone[range].fill(true);
            }
            for (g, narrowed) in found.narrowed {
                let at = g as usize;
                for (to, i) in m.interval[at..].iter_mut().zip(narrowed) {
                    *to = i;
                }
            }
        }
        for g in live {
            if m.into[g as usize] == g {
                fix(&mut m, g as usize);
            }
        }
    }
    // A survivor may have been merged in turn: of one shape and height, later ones are settled first, so one step does.
    debug_assert!(m.into.iter().all(|g| m.into[*g as usize] == *g));
    (m.interval, m.hash, m.height) = (Vec::new(), Vec::new(), Vec::new());
    Some(m)
}

/// Fixes the values of a group, and with them the bases of those below.
fn fix(m: &mut Merged, g: usize) {
    for c in 0..4 {
        if Mask(m.mask[g]).child(c as u32).has_value() {
            // What others rise from lies at the far end: that brings more of them together (NOTES.md beside this
            // file). The guard is in the interval.
            let below = m.below[g][c] != NONE;
            m.value[g][c] = if below { m.interval[g][c].max } else { m.interval[g][c].middle() };
        }
        let below = m.below[g][c];
        if below != NONE {
            m.base[below as usize] = m.base_below(g, c);
        }
    }
}

/// Lists of groups of one shape, each in preorder, by hash.
fn shapes(m: &Merged, mut free: Vec<u32>) -> Vec<Vec<u32>> {
    // A stable order: by hash, then by place.
    free.par_sort_unstable_by_key(|g| (m.hash[*g as usize], *g));
    let types = |g: u32| &m.mask[g as usize..][..m.groups[g as usize] as usize];
    let mut lists: Vec<Vec<u32>> = Vec::new();
    for run in free.chunk_by(|a, b| m.hash[*a as usize] == m.hash[*b as usize]) {
        let mut rest = run.to_vec();
        while let Some(&first) = rest.first() {
            let (one, others) = rest.into_iter().partition(|g| topology::same(types(*g), types(first)));
            lists.push(one);
            rest = others;
        }
    }
    lists.retain(|l| l.len() > 1);
    lists
}

/// What was found in one list.
#[derive(Default)]
struct Found {
    pairs: Pairs,
    /// Groups and the later ones that stand in their place.
    merges: Vec<(u32, u32)>,
    /// Groups that took others' places and the intervals of their subtrees.
    narrowed: Vec<(u32, Vec<[Interval; 4]>)>,
}

/// A range of depths less the base.
#[derive(Clone, Copy)]
struct Range {
    min: i64,
    max: i64,
}

/// Extremes of the ranges of a subtree: of both ends the smallest and the largest.
#[derive(Clone, Copy)]
struct Extremes {
    min: Range,
    max: Range,
}

impl Extremes {
    fn of(ranges: &[Range]) -> Self {
        let none = Range { min: i64::MAX, max: i64::MIN };
        let wider = |r: Range, v: i64| Range { min: r.min.min(v), max: r.max.max(v) };
        ranges
            .iter()
            .fold(Self { min: none, max: none }, |e, r| Self { min: wider(e.min, r.min), max: wider(e.max, r.max) })
    }

    /// Whether a node of one meets none of the other's, so that the two cannot match.
    fn refuse(&self, o: &Self) -> bool {
        self.max.min < o.min.min || o.max.min < self.min.min || self.min.max > o.max.max || o.min.max > self.max.max
    }
}

/// A subtree that others may be merged into.
struct Survivor {
    group: u32,
    extremes: Extremes,
    /// Where its ranges begin.
    at: usize,
    merged: bool,
}

/// Goes through a list from its end and merges each subtree into the nearest later one that it matches.
fn pairs(m: &Merged, list: &[u32], search: u32) -> Found {
    let first = list[0] as usize;
    let length = m.groups[first] as usize;
    let slots: Vec<(usize, usize)> = (0..length)
        .flat_map(|k| (0..4).map(move |c| (k, c)))
        .filter(|&(k, c)| Mask(m.mask[first + k]).child(c as u32).has_value())
        .collect();
    let mut found = Found::default();
    let mut ranges: Vec<Range> = Vec::new();
    let mut survivors: Vec<Survivor> = Vec::new();
    for &g in list.iter().rev() {
        let (start, base) = (g as usize, i64::from(m.base[g as usize]));
        let at = ranges.len();
        ranges.extend(slots.iter().map(|&(k, c)| {
            let i = m.interval[start + k][c];
            Range { min: (i64::from(i.min) - base).max(-FARTHEST), max: (i64::from(i.max) - base).min(FARTHEST) }
        }));
        if ranges[at..].iter().any(|r| r.min > r.max) {
            ranges.truncate(at);
            continue;
        }
        let extremes = Extremes::of(&ranges[at..]);
        let (before, own) = ranges.split_at_mut(at);
        let near = survivors.iter_mut().rev().take(search as usize);
        let into = near.into_iter().find(|s| {
            if s.extremes.refuse(&extremes) {
                found.pairs.intervals += 1;
                return false;
            }
            let theirs = &before[s.at..s.at + own.len()];
            let meets = own.iter().zip(theirs).all(|(a, b)| a.min.max(b.min) <= a.max.min(b.max));
            found.pairs.nodes += u64::from(!meets);
            meets
        });
        match into {
            Some(s) => {
                let theirs = &mut before[s.at..s.at + own.len()];
                for (t, o) in theirs.iter_mut().zip(own) {
                    *t = Range { min: t.min.max(o.min), max: t.max.min(o.max) };
                }
                s.extremes = Extremes::of(theirs);
                s.merged = true;
                found.pairs.merged += 1;
                found.merges.push((g, s.group));
                ranges.truncate(at);
            }
            None => survivors.push(Survivor { group: g, extremes, at, merged: false }),
        }
    }
    for s in survivors.iter().filter(|s| s.merged) {
        let (start, base) = (s.group as usize, i64::from(m.base[s.group as usize]));
        let mut intervals = m.interval[start..start + length].to_vec();
        for (&(k, c), r) in slots.iter().zip(&ranges[s.at..]) {
            // Parts of what was there before, hence 32 bits.
            intervals[k][c] = Interval { min: (r.min + base) as u32, max: (r.max + base) as u32 };
        }
        found.narrowed.push((s.group, intervals));
    }
    found
}
