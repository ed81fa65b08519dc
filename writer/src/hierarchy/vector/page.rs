//! Cuts a tree into pages and writes their words.
//!
//! As for `mh`: whenever a node's groups outgrow [`PAGE_WORDS`], the largest subtrees among its children become pages of
//! their own; the complete coarse levels stay in the root page.

use rayon::prelude::*;
use rustc_hash::{FxHashMap as HashMap, FxHashSet as HashSet};

use umbrage_format::kind::mh::{Mask, NodeType};
use umbrage_format::kind::vector::{self, Layout, Mask4, Parts, Split, Square, assemble};

use super::entry::{Entry, EntryId, Line, Mark, Palette, Plane, Scale, raw_words};
use crate::hierarchy::mh::{CUT, NONE, Span};
use crate::hierarchy::page::{At, COARSE_DEPTH, Draft, DraftRef, PAGE_WORDS, ROOT_WORDS};
use crate::hierarchy::spool::Spool;

/// What a group costs in a page, 1/16 word: its mask and its share of the ranks.
pub const GROUP_COST: u32 = 5;
/// What an index costs, 1/16 word.
pub const INDEX_COST: u32 = 5;
/// Entries that splits and masks can refer to, and lines that splits can.
const MOST_PARTS: u32 = 1024;

/// The four children of a node.
#[derive(Clone, Copy, Debug)]
pub struct Group {
    /// Their types.
    pub mask: Mask,
    /// Their entries, also of those that take over the one from above.
    pub entry: [EntryId; 4],
    /// Groups below inner and empty children, or [`CUT`] and a page.
    pub below: [u32; 4],
    /// Bit c: child c's own entry is proven.
    pub proven: u8,
}

/// A node whose entry is still open: its parent may take it over.
#[derive(Clone, Copy, Debug)]
pub struct Node {
    /// What answers it.
    pub entry: EntryId,
    /// Group of its children, [`NONE`], or [`CUT`] and a page.
    pub below: u32,
    /// What all groups below cost that are not in pages of their own, 1/16 word; not less than it will be.
    pub cost: u32,
    /// Entries that answer the most of it, and which share of its area.
    pub share: [(EntryId, f32); SHARES],
    /// Number of its exact intervals in the tile, or `u32::MAX`.
    pub exact: u32,
    /// Whether the entry is proven between texel centres, where it is not another one's place; nothing where it is nowhere.
    pub proven: Option<bool>,
}

/// Entries whose share of a node's area is kept.
pub const SHARES: usize = 4;

impl Node {
    /// A square that one entry answers, unproven between texel centres.
    pub fn leaf(entry: EntryId) -> Node {
        let mut share = [(entry, 0.0); SHARES];
        share[0].1 = 1.0;
        Node { entry, below: NONE, cost: 0, share, exact: u32::MAX, proven: Some(false) }
    }
}

/// A part of the tree: groups that are not in pages yet, and their entries.
#[derive(Default)]
pub struct Forest {
    /// Groups by number.
    pub groups: Vec<Group>,
    /// Entries.
    pub palette: Palette,
}

impl Forest {
    /// What an entry costs at a node, 1/16 word, if nothing is shared.
    pub fn price(&self, id: EntryId) -> u32 {
        INDEX_COST + self.palette_price(id)
    }

    fn palette_price(&self, id: EntryId) -> u32 {
        let own = match self.palette.get(id) {
            // twice what it takes, so that a page whose price fits has no more entries than parts can refer to
            Entry::Constant(_) => 32,
            Entry::Plane(_) => 48,
            Entry::Split { .. } => 16 + 48,
            Entry::Mask { .. } => 32,
            Entry::Raw(n) => 16 * raw_words(&self.palette.raws[n as usize]),
        };
        own + self.palette.parts(id).into_iter().flatten().map(|p| self.palette_price(p)).sum::<u32>()
    }

    /// What the groups from number `first` on take in a page that has what was there at the mark, 1/16 word, with the
    /// entry of the node above them.
    pub fn takes(&self, node: &Node, first: usize, mark: Mark) -> u32 {
        let groups = &self.groups[first..];
        let own =
            groups.iter().flat_map(|g| (0..4).filter(|c| g.mask.child(*c).has_value()).map(|c| g.entry[c as usize]));
        let mut entries: Vec<EntryId> = own.collect();
        let indexes = entries.len() as u32;
        entries.push(node.entry);
        entries.sort_unstable();
        entries.dedup();
        let words: u32 = entries.into_iter().map(|e| self.palette.price(e, mark)).sum();
        GROUP_COST * groups.len() as u32 + INDEX_COST * indexes + 16 * words
    }

    /// Bytes held.
    pub fn bytes(&self) -> u64 {
        let entry = size_of::<Entry>() * 2 + 16;
        let line = size_of::<Line>() * 2 + 16;
        let raw = size_of::<[u32; 16]>() * 2 + 8;
        (size_of::<Group>() * self.groups.capacity()
            + self.palette.raws.len() * raw
            + self.palette.entries.len() * entry
            + self.palette.lines.len() * line) as u64
    }

    /// Takes in another part; returns its node as seen from here.
    pub fn absorb(&mut self, other: Forest, node: Node) -> Node {
        let mut used = vec![false; other.palette.entries.len()];
        used[node.entry as usize] = true;
        node.share.iter().for_each(|(e, _)| used[*e as usize] = true);
        other.groups.iter().flat_map(|g| g.entry).for_each(|e| used[e as usize] = true);
        other.palette.close(&mut used);
        let map = self.palette.absorb(&other.palette, &used);
        let first = self.groups.len() as u32;
        let shift = |b: u32| if b & CUT != 0 { b } else { b + first };
        self.groups.extend(other.groups.into_iter().map(|g| Group {
            mask: g.mask,
            entry: g.entry.map(|e| map[e as usize]),
            below: g.below.map(shift),
            proven: g.proven,
        }));
        let at = |e: EntryId| map[e as usize];
        Node { entry: at(node.entry), below: shift(node.below), share: node.share.map(|(e, s)| (at(e), s)), ..node }
    }

    /// Drops groups that no longer hang below `node`, and entries that nothing names.
    pub fn compact(&mut self, node: Node) -> Node {
        let mut kept = Vec::new();
        let below = keep(&self.groups, node.below, &mut kept);
        let old = std::mem::take(self);
        self.absorb(Forest { groups: kept, palette: old.palette }, Node { below, ..node })
    }

    /// Moves the largest subtrees below the node's children into pages until the rest fits [`PAGE_WORDS`].
    pub fn cut(&mut self, node: &mut Node, at: At, children: &mut [Node; 4], spool: &Spool) {
        while node.cost > PAGE_WORDS * 16 {
            node.cost = Sheet::gather(self, node.below, at).cost();
            if node.cost <= PAGE_WORDS * 16 {
                return;
            }
            let largest = (0..4).filter(|c| children[*c].below & CUT == 0).max_by_key(|c| (children[*c].cost, 4 - c));
            let Some(c) = largest else { return };
            let page = self.draft(children[c].below, at.child(c), spool);
            let cut = CUT | spool.push(&page);
            self.groups[node.below as usize].below[c] = cut;
            children[c] = Node { below: cut, cost: 0, ..children[c] };
        }
    }

    /// The page of the group below the node at `at`, or of the whole map.
    fn draft(&self, group: u32, at: At, spool: &Spool) -> Draft {
        Sheet::gather(self, group, at).draft(spool)
    }

    /// Makes the root page; returns its number.
    pub fn finish(mut self, root: Node, scale: Scale, spool: &Spool) -> u32 {
        let kind = if root.below == NONE { NodeType::Leaf } else { NodeType::Inner };
        let mask = Mask::new([kind, NodeType::None, NodeType::None, NodeType::None]);
        let entry = [root.entry, root.entry, root.entry, root.entry];
        let proven = u8::from(root.proven == Some(true));
        self.groups.push(Group { mask, entry, below: [root.below, NONE, NONE, NONE], proven });
        let top = self.groups.len() as u32 - 1;
        let at = At { level: scale.log2_resolution + 1, origin: [0, 0] };
        loop {
            let sheet = Sheet::gather(&self, top, at);
            if sheet.cost() <= ROOT_WORDS * 16 {
                return spool.push(&sheet.draft(spool));
            }
            let mut found = Vec::new();
            if root.below != NONE {
                let at = At { level: scale.log2_resolution, origin: [0, 0] };
                self.candidates(root.below, at, scale, &mut found);
            }
            if found.is_empty() {
                return spool.push(&sheet.draft(spool));
            }
            // the largest first: nearly all that is far too much at once, then a share of the rest at a time
            found.sort_by_key(|c: &(u32, u32, usize, At)| std::cmp::Reverse(c.0));
            let (cost, most) = (sheet.cost(), ROOT_WORDS * 16);
            let mut much = match cost {
                c if c > 4 * most => c - 3 * most,
                c if sheet.fits() => c - most,
                c => c / 8,
            };
            let count = 1 + found
                .iter()
                .position(|c| {
                    let enough = much <= c.0;
                    much = much.saturating_sub(c.0);
                    enough
                })
                .unwrap_or(found.len() - 1);
            let draft = |&(_, group, c, at): &(u32, u32, usize, At)| {
                self.draft(self.groups[group as usize].below[c], at, spool)
            };
            let drafts: Vec<Draft> = found[..count].par_iter().map(draft).collect();
            for ((_, group, c, _), page) in found.into_iter().zip(drafts) {
                self.groups[group as usize].below[c] = CUT | spool.push(&page);
            }
        }
    }

    /// Subtrees that may leave the root page: (cost, group, child, node).
    fn candidates(&self, group: u32, at: At, scale: Scale, found: &mut Vec<(u32, u32, usize, At)>) {
        let g = &self.groups[group as usize];
        for c in 0..4 {
            if g.below[c] & CUT != 0 {
                continue;
            }
            let child = at.child(c);
            if scale.log2_resolution - child.level >= COARSE_DEPTH {
                found.push((self.measure(g.below[c]), group, c, child));
            } else {
                self.candidates(g.below[c], child, scale, found);
            }
        }
    }

    fn measure(&self, group: u32) -> u32 {
        let g = &self.groups[group as usize];
        let own: u32 = (0..4).filter(|c| g.mask.child(*c).has_value()).map(|c| self.price(g.entry[c as usize])).sum();
        let below: u32 = g.below.iter().filter(|b| **b & CUT == 0).map(|b| self.measure(*b)).sum();
        GROUP_COST + own + below
    }
}

/// Copies the groups reachable from `below`; returns its new number. [`NONE`] has the bit of [`CUT`].
fn keep(groups: &[Group], below: u32, kept: &mut Vec<Group>) -> u32 {
    if below & CUT != 0 {
        return below;
    }
    let at = kept.len();
    kept.push(groups[below as usize]);
    for c in 0..4 {
        kept[at].below[c] = keep(groups, groups[below as usize].below[c], kept);
    }
    at as u32
}

/// A node with an entry of its own.
struct Own {
    entry: EntryId,
    proven: bool,
    level: u8,
    x: u32,
    y: u32,
}

/// A page to be: groups in level order, and the entries that they name.
struct Sheet<'a> {
    palette: &'a Palette,
    origin: [u32; 2],
    root_level: u8,
    masks: Vec<u8>,
    own: Vec<Own>,
    refs: Vec<(u32, Option<EntryId>, Own)>,
    finest: u8,
    nodes: [u64; 3],
    /// Entries by class, in the order of the palette.
    used: [Vec<EntryId>; 5],
    lines: Vec<u32>,
    /// Number in the page.
    number: HashMap<EntryId, u32>,
}

impl<'a> Sheet<'a> {
    fn gather(forest: &'a Forest, group: u32, at: At) -> Self {
        let mut sheet = Sheet {
            palette: &forest.palette,
            origin: at.origin,
            root_level: at.level - 1,
            masks: Vec::new(),
            own: Vec::new(),
            refs: Vec::new(),
            finest: at.level - 1,
            nodes: [0; 3],
            used: Default::default(),
            lines: Vec::new(),
            number: HashMap::default(),
        };
        // (group or page, level of its nodes, first texel, entry from above)
        let mut queue = std::collections::VecDeque::from([(group, at.level - 1, 0u32, 0u32, None)]);
        while let Some((group, level, x, y, above)) = queue.pop_front() {
            if group & CUT != 0 {
                sheet.masks.push(0);
                sheet.refs.push((group & !CUT, above, Own { entry: 0, proven: false, level: level + 1, x, y }));
                continue;
            }
            let g = &forest.groups[group as usize];
            sheet.masks.push(g.mask.0);
            sheet.finest = sheet.finest.min(level);
            for c in 0..4u32 {
                let kind = g.mask.child(c);
                let i = c as usize;
                let (x, y) = (x + ((c & 1) << level), y + ((c >> 1) << level));
                match kind {
                    NodeType::None => continue,
                    NodeType::Leaf => sheet.nodes[0] += 1,
                    NodeType::Inner => sheet.nodes[1] += 1,
                    NodeType::Empty => sheet.nodes[2] += 1,
                }
                if kind.has_value() {
                    sheet.own.push(Own { entry: g.entry[i], proven: g.proven >> i & 1 == 1, level, x, y });
                }
                if kind.has_children() {
                    let entry = if kind.has_value() { Some(g.entry[i]) } else { above };
                    queue.push_back((g.below[i], level.wrapping_sub(1), x, y, entry));
                }
            }
        }
        sheet.order();
        sheet
    }

    /// Finds the entries in use and gives them numbers.
    fn order(&mut self) {
        let palette = self.palette;
        let mut all: Vec<EntryId> = Vec::new();
        let mut seen = HashSet::default();
        let mut waiting: Vec<EntryId> = self.own.iter().map(|o| o.entry).collect();
        let mut parts = HashSet::default();
        while let Some(id) = waiting.pop() {
            if seen.insert(id) {
                all.push(id);
                for p in palette.parts(id).into_iter().flatten() {
                    parts.insert(p);
                    waiting.push(p);
                }
            }
        }
        // entries refer to lower numbers, and what others refer to comes first
        let (mut first, mut rest): (Vec<_>, Vec<_>) = all.into_iter().partition(|id| parts.contains(id));
        first.sort_unstable();
        rest.sort_unstable();
        let mut lines = HashSet::default();
        for id in first.into_iter().chain(rest) {
            let class = match palette.get(id) {
                Entry::Constant(_) => 0,
                Entry::Plane(_) => 1,
                Entry::Split { line, .. } => {
                    if lines.insert(line) {
                        self.lines.push(line);
                    }
                    2
                }
                Entry::Mask { .. } => 3,
                Entry::Raw(_) => 4,
            };
            self.used[class].push(id);
        }
        self.used[2].sort_unstable();
        self.number.reserve(seen.len());
        self.number.extend(self.used.iter().flatten().zip(0..).map(|(id, n)| (*id, n)));
    }

    /// What the page takes, 1/16 word; very much where a number does not fit its field.
    fn cost(&self) -> u32 {
        let [constants, planes, splits, masks, raws] = [0, 1, 2, 3, 4].map(|i| self.used[i].len() as u32);
        let palette = constants + planes + splits + masks + raws;
        let bits = 32 - palette.saturating_sub(1).leading_zeros();
        let line_words = if self.lines.iter().all(|l| self.line(*l).is_short()) { 2 } else { 3 };
        let words = 7
            + 5 * (self.masks.len() as u32).div_ceil(16)
            + (self.refs.len() as u32).div_ceil(2)
            + (self.own.len() as u32 * bits).div_ceil(32)
            + if self.is_proven() { (self.own.len() as u32).div_ceil(32) } else { 0 }
            + line_words * self.lines.len() as u32
            + constants
            + 3 * planes
            + splits
            + 2 * masks
            + self.used[4].iter().map(|id| self.raw(*id)).map(raw_words).sum::<u32>();
        if self.fits() { words * 16 } else { (words * 16).max(ROOT_WORDS * 16 + 16) }
    }

    /// A line as seen from the page's corner.
    fn line(&self, number: u32) -> vector::Line {
        let l = self.palette.lines[number as usize];
        let shift = self.origin.map(|o| i64::from(o) << 8);
        let (u, t) = if l.axis { (shift[1], shift[0]) } else { (shift[0], shift[1]) };
        vector::Line { m: l.m, c: l.boundary(u) - (t << 12), axis: l.axis }
    }

    fn raw(&self, id: EntryId) -> &[u32; 16] {
        match self.palette.get(id) {
            Entry::Raw(n) => &self.palette.raws[n as usize],
            _ => &[0; 16],
        }
    }

    /// Whether the page says of some node that its entry is proven.
    fn is_proven(&self) -> bool {
        self.own.iter().any(|o| o.proven)
    }

    /// Whether every number has room in its field.
    fn fits(&self) -> bool {
        let parts = |id: &EntryId| self.palette.parts(*id).into_iter().flatten().map(|p| self.number[&p]).max();
        let highest = self.used[2].iter().chain(&self.used[3]).filter_map(parts).max().unwrap_or(0);
        highest < MOST_PARTS && (self.lines.len() as u32) <= MOST_PARTS && self.masks.len() < 32767
    }

    fn draft(&self, spool: &Spool) -> Draft {
        let shift = self.origin.map(|o| i64::from(o) << 8);
        let plane = |p: Plane| {
            let n = i128::from(p.gx) * i128::from(shift[0]) + i128::from(p.gy) * i128::from(shift[1]);
            vector::Plane { offset: p.offset + (n >> p.shift) as i64, gx: p.gx, gy: p.gy, shift: p.shift }
        };
        let at = |id: EntryId| self.number[&id] as u16;
        let line_at: HashMap<u32, u16> = self.lines.iter().copied().zip(0..).collect();
        let (mut constants, mut planes, mut splits, mut masks) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        let mut raws = Vec::new();
        for &id in self.used.iter().flatten() {
            match self.palette.get(id) {
                Entry::Constant(v) => constants.push(v),
                Entry::Plane(p) => planes.push(plane(p)),
                Entry::Split { line, near, beyond } => {
                    splits.push(Split { line: line_at[&line], a: at(near), b: at(beyond) });
                }
                Entry::Mask { entries, selectors } => masks.push(Mask4 { entries: entries.map(at), selectors }),
                Entry::Raw(n) => raws.push(self.palette.raws[n as usize]),
            }
        }
        let lines: Vec<vector::Line> = self.lines.iter().map(|l| self.line(*l)).collect();
        let indexes: Vec<u32> = self.own.iter().map(|o| self.number[&o.entry]).collect();
        let proofs: Vec<bool> = self.own.iter().map(|o| o.proven).collect();
        let words = assemble(&Parts {
            root_level: self.root_level,
            groups: &self.masks,
            indexes: &indexes,
            proofs: self.is_proven().then_some(&proofs),
            lines: &lines,
            constants: &constants,
            planes: &planes,
            splits: &splits,
            masks: &masks,
            raws: &raws,
        });
        let layout = Layout::of(&words);
        let bounds = |id: EntryId, o: &Own| -> (u32, u32) {
            vector::bounds(&words, &layout, self.number[&id], &Square::of_texels(o.x, o.y, o.level))
        };
        let (mut min, mut max) = (u32::MAX, 0);
        let mut join = |(a, b): (u32, u32)| (min, max) = (min.min(a), max.max(b));
        for o in &self.own {
            join(bounds(o.entry, o));
        }
        let mut refs = Vec::new();
        for (page, above, node) in &self.refs {
            let inherited = above.map(|id| bounds(id, node));
            if let Some(range) = inherited {
                join(range);
            }
            let span = spool.span(*page);
            join((span[0], span[1]));
            refs.push(DraftRef { page: *page, inherited: inherited.map(|(a, b)| [a, b]) });
        }
        Draft {
            words,
            refs,
            root_mask: Mask(self.masks[0]),
            root_level: self.root_level,
            finest: self.finest,
            origin: self.origin,
            // the error of the entry from above is at most its distance to what is stored here
            span: Span { low: max, high: min, min, max },
            nodes: self.nodes,
        }
    }
}
