//! Cuts a tree into pages and writes their words.
//!
//! A page holds the part of a node's descendants that fits [`PAGE_WORDS`]: whenever a node's groups outgrow that, the
//! largest subtrees among its children become pages of their own. Nodes down to depth [`COARSE_DEPTH`] stay in the
//! root page, so that one read after the head of the file answers a complete level of 64 x 64.

use umbrage_format::kind::mh::{self, Children, NodeType};

use super::mh::{CUT, Group, NONE, Node, Span};
use super::spool::Spool;
use crate::interval::Interval;

/// Most words of an ordinary page (8 KiB); see NOTES.md beside this file.
pub const PAGE_WORDS: u32 = 2048;
/// Most words of the root page (48 KiB): with the first 16 KiB of the file it makes 64 KiB.
pub const ROOT_WORDS: u32 = 12288;
/// Levels below the root node that are complete in the root page.
pub const COARSE_DEPTH: u8 = 6;

/// A page before it has an ordinal.
#[derive(Clone, Debug)]
pub struct Draft {
    /// Its words, frame included.
    pub words: Vec<u32>,
    /// Pages that it refers to, by their reference number.
    pub refs: Vec<DraftRef>,
    /// Types of the root group.
    pub root_mask: mh::Mask,
    /// Level of the root group.
    pub root_level: u8,
    /// Finest level of a node in it.
    pub finest: u8,
    /// First texel of the footprint; the footprint is `2 << root_level` texels on a side (the whole map for a root).
    pub origin: [u32; 2],
    /// Extremes over the footprint.
    pub span: Span,
    /// Leaf, inner and empty nodes.
    pub nodes: [u64; 3],
}

/// A reference to another page.
#[derive(Clone, Copy, Debug)]
pub struct DraftRef {
    /// Which one.
    pub page: u32,
    /// What the node above it in this page answers over its footprint, smallest and largest; none where that node lies
    /// further up.
    pub inherited: Option<[u32; 2]>,
}

/// A part of the tree: groups that are not in pages yet. Pages go to a [`Spool`].
#[derive(Default)]
pub struct Forest {
    /// Groups by number.
    pub groups: Vec<Group>,
    /// Of a forest that is kept whole, for kind `mmh`, the intervals of the groups' values; else none.
    pub intervals: Vec<[Interval; 4]>,
}

/// Where a node lies: its level and the first texel of its square.
#[derive(Clone, Copy, Debug)]
pub struct At {
    /// Level of the node.
    pub level: u8,
    /// First texel, finest level.
    pub origin: [u32; 2],
}

impl At {
    /// Child `c` of the node.
    pub fn child(self, c: usize) -> At {
        let level = self.level - 1;
        let step = |bit: usize| ((c >> bit & 1) as u32) << level;
        At { level, origin: [self.origin[0] + step(0), self.origin[1] + step(1)] }
    }
}

impl Forest {
    /// Takes in another part; returns its node as seen from here.
    pub fn absorb(&mut self, other: Forest, node: Node) -> Node {
        let groups = self.groups.len() as u32;
        let shift = |b: u32| if b & CUT != 0 { b } else { b + groups };
        self.intervals.extend(other.intervals);
        self.groups.extend(other.groups.into_iter().map(|mut g| {
            g.below = g.below.map(shift);
            g
        }));
        Node { below: shift(node.below), ..node }
    }

    /// Bytes held.
    pub fn bytes(&self) -> u64 {
        (size_of::<Group>() * self.groups.capacity() + size_of::<[Interval; 4]>() * self.intervals.capacity()) as u64
    }

    /// Drops groups that no longer hang below `node`; of a forest that is kept whole, none.
    pub fn compact(&mut self, node: Node) -> Node {
        if !self.intervals.is_empty() {
            return node;
        }
        let mut kept = Vec::with_capacity(self.reachable(node.below));
        let below = keep(&self.groups, node.below, &mut kept);
        self.groups = kept;
        Node { below, ..node }
    }

    fn reachable(&self, below: u32) -> usize {
        if below & CUT != 0 {
            return 0;
        }
        1 + self.groups[below as usize].below.iter().map(|b| self.reachable(*b)).sum::<usize>()
    }

    /// Moves the largest subtrees below the node's children into pages until the rest fits [`PAGE_WORDS`].
    pub fn cut(&mut self, node: &mut Node, at: At, children: &mut [Node; 4], spool: &Spool) {
        while node.words > PAGE_WORDS {
            let Some(c) = (0..4).filter(|c| children[*c].words > 0).max_by_key(|c| (children[*c].words, 4 - c)) else {
                return;
            };
            let child = children[c];
            let page = self.draft(child.below, at.child(c), child.finest, child.span, spool);
            let cut = CUT | spool.push(&page);
            self.groups[node.below as usize].below[c] = cut;
            children[c] = Node { below: cut, words: 0, finest: u8::MAX, ..child };
            node.words -= child.words;
            node.finest = children.iter().map(|c| c.finest).min().unwrap_or(u8::MAX).min(at.level - 1);
        }
    }

    /// The page of the group below the node at `at`.
    fn draft(&self, group: u32, at: At, finest: u8, span: Span, spool: &Spool) -> Draft {
        let root = self.groups[group as usize];
        let mut d = Draft {
            words: vec![0; 2],
            refs: Vec::new(),
            root_mask: root.mask,
            root_level: at.level - 1,
            finest,
            origin: at.origin,
            span,
            nodes: [0; 3],
        };
        d.words.resize(2 + root.mask.words() as usize, 0);
        self.write(&mut d, group, 2, None, spool);
        d
    }

    /// Writes a group at word `start` (already reserved) and, behind it, what hangs below.
    fn write(&self, d: &mut Draft, group: u32, start: usize, above: Option<u32>, spool: &Spool) {
        let g = &self.groups[group as usize];
        for c in 0..4u8 {
            let kind = g.mask.child(u32::from(c));
            let word = start + g.mask.words_before(u32::from(c)) as usize;
            let i = usize::from(c);
            let value = if kind.has_value() { Some(g.value[i]) } else { above };
            match kind {
                NodeType::None => continue,
                NodeType::Leaf => {
                    d.words[word] = g.value[i];
                    d.nodes[0] += 1;
                    continue;
                }
                NodeType::Inner => {
                    d.words[word + 1] = g.value[i];
                    d.nodes[1] += 1;
                }
                NodeType::Empty => d.nodes[2] += 1,
            }
            let below = g.below[i];
            let node = if below & CUT != 0 {
                d.refs.push(DraftRef { page: below & !CUT, inherited: value.map(|v| [v, v]) });
                let mask = spool.mask(below & !CUT);
                mh::Node { mask, children: Children::Page((d.refs.len() - 1) as u16) }
            } else {
                let mask = self.groups[below as usize].mask;
                let at = d.words.len();
                d.words.resize(at + mask.words() as usize, 0);
                self.write(d, below, at, value, spool);
                mh::Node { mask, children: Children::Here(at as u16) }
            };
            d.words[word] = node.encode();
        }
    }

    /// Makes the root page; returns its number.
    pub fn finish(mut self, root: Node, log2_resolution: u8, spool: &Spool) -> u32 {
        self.fit_root(root, log2_resolution, spool);
        let value = root.interval.middle();
        let below = root.below;
        let kind = if below == NONE { NodeType::Leaf } else { NodeType::Inner };
        let span = Span { min: root.span.min.min(value), max: root.span.max.max(value), ..root.span };
        let mask = mh::Mask::new([kind, NodeType::None, NodeType::None, NodeType::None]);
        self.groups.push(Group { mask, value: [value, 0, 0, 0], below: [below, NONE, NONE, NONE], span });
        let top = self.groups.len() as u32 - 1;
        let at = At { level: log2_resolution + 1, origin: [0, 0] };
        let mut first = self.draft(top, at, 0, span, spool);
        first.finest = self.finest(top, log2_resolution);
        spool.push(&first)
    }

    /// Cuts subtrees below depth [`COARSE_DEPTH`], the largest first, until the root page fits [`ROOT_WORDS`].
    fn fit_root(&mut self, root: Node, log2_resolution: u8, spool: &Spool) {
        if root.below == NONE {
            return;
        }
        let mut found = Vec::new();
        let at = At { level: log2_resolution, origin: [0, 0] };
        let mut words = root.words + 4;
        self.candidates(root.below, at, log2_resolution, &mut found);
        // largest first; of equal ones the first in the map
        found.sort_by_key(|c: &(u32, u32, usize, At, Span)| std::cmp::Reverse(c.0));
        for (size, group, c, at, span) in found {
            if words <= ROOT_WORDS {
                return;
            }
            let below = self.groups[group as usize].below[c];
            let finest = self.finest(below, at.level - 1);
            let page = self.draft(below, at, finest, span, spool);
            self.groups[group as usize].below[c] = CUT | spool.push(&page);
            words -= size;
        }
    }

    /// Subtrees that may leave the root page: (words, group, child, node, span).
    fn candidates(&self, group: u32, at: At, k: u8, found: &mut Vec<(u32, u32, usize, At, Span)>) {
        let g = &self.groups[group as usize];
        for c in 0..4 {
            if g.below[c] == NONE || g.below[c] & CUT != 0 {
                continue;
            }
            let child = at.child(c);
            if k - child.level >= COARSE_DEPTH {
                let (words, span) = self.measure(g.below[c]);
                found.push((words, group, c, child, span));
            } else {
                self.candidates(g.below[c], child, k, found);
            }
        }
    }

    /// Words below and what is known about the square.
    fn measure(&self, group: u32) -> (u32, Span) {
        let g = &self.groups[group as usize];
        let inline = g.below.iter().filter(|b| **b != NONE && **b & CUT == 0);
        let words = g.mask.words() + inline.map(|b| self.measure(*b).0).sum::<u32>();
        (words, g.span)
    }

    fn finest(&self, group: u32, level: u8) -> u8 {
        let g = &self.groups[group as usize];
        let below = (0..4).filter(|c| g.below[*c] != NONE && g.below[*c] & CUT == 0);
        below.map(|c| self.finest(g.below[c], level - 1)).min().unwrap_or(level)
    }
}

/// Copies the groups reachable from `below`; returns its new number.
fn keep(groups: &[Group], below: u32, kept: &mut Vec<Group>) -> u32 {
    if below == NONE || below & CUT != 0 {
        return below;
    }
    let at = kept.len();
    kept.push(groups[below as usize]);
    for c in 0..4 {
        kept[at].below[c] = keep(groups, groups[below as usize].below[c], kept);
    }
    at as u32
}

/// A page in its final order.
#[derive(Clone, Debug)]
pub struct Page {
    /// Ordinal of the first page that it refers to, or of the next page's first one.
    pub first_child: u32,
    /// What holds above it, smallest and largest over its footprint; none for the root page.
    pub inherited: Option<[u32; 2]>,
    /// Words and what is known.
    pub draft: Draft,
}

impl Page {
    /// Smallest and largest depth that a lookup in the footprint can answer.
    pub fn depths(&self) -> (u32, u32) {
        let mask = self.draft.root_mask;
        let inherits = self.inherited.is_some_and(|_| (0..4).any(|c| !mask.child(c).has_value()));
        match self.inherited {
            Some([a, b]) if inherits => (self.draft.span.min.min(a), self.draft.span.max.max(b)),
            _ => (self.draft.span.min, self.draft.span.max),
        }
    }

    /// Bound of the lattice distance of what is inherited to a texel's interval: the error without this page.
    pub fn stop_error(&self) -> u32 {
        let span = &self.draft.span;
        self.inherited.map_or(u32::MAX, |[a, b]| span.low.saturating_sub(a).max(b.saturating_sub(span.high)))
    }
}
