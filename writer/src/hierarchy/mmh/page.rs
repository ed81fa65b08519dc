//! Cuts a merged tree into pages and writes their words (Scandolo 2019, section 2.6.3, in two passes: places, words).
//!
//! **Tree pages** hold groups with one reference, from the root down: each has a place in the map. **Shared pages** hold
//! groups with several, and what hangs below them with one: *units*. A unit whose references all come from one tree page
//! lies in that page. A tree page names the shared pages that it needs as its dependencies. Shared pages need no other
//! page: a unit that another unit refers to is written into each shared page that has need of it, once.
//!
//! Groups stand in a page in preorder; the merge refers to later groups only, so children lie behind their nodes.

use std::collections::{HashMap, VecDeque};

use umbrage_format::index::{FORM_TREE, MAX_PAGE_WORDS, SHARED};
use umbrage_format::kind::mh::{Mask, NodeType, ROOT_GROUP};
use umbrage_format::kind::mmh::{self, Children};
use umbrage_format::page::FrameHead;
use umbrage_format::{BlockHeader, Kind, PageRecord};

use super::merge::Merged;
use crate::container::PageInput;
use crate::hierarchy::mh::{NONE, Node, Span};
use crate::hierarchy::page::{At, COARSE_DEPTH, ROOT_WORDS};

/// Words of a tree page's own groups (16 KiB); see NOTES.md beside this file.
pub const OWN_WORDS: u32 = 4096;
/// Words from which on a shared page is full (55 KiB), its entries included: with the last unit, of at most
/// [`MOST_WORDS`](super::merge::MOST_WORDS), it is still a page.
pub const SHARED_WORDS: u32 = 14000;

/// Not in a page.
const NOWHERE: u32 = u32::MAX;

/// The pages of a tree, in their order.
#[derive(Debug, Default)]
pub struct Pages {
    /// The pages, tree pages first.
    pub pages: Vec<PageInput>,
    /// How many of them are shared.
    pub shared: u32,
    /// Leaf, inner and empty nodes.
    pub nodes: [u64; 3],
    /// Words of all groups, each counted once: what one page without limits would take.
    pub words_unpaged: u64,
}

impl Pages {
    /// Bytes held.
    pub fn held(&self) -> u64 {
        let each = |p: &PageInput| size_of::<PageInput>() + 4 * (p.words.capacity() + p.dependencies.capacity());
        self.pages.iter().map(|p| each(p) as u64).sum()
    }

    /// Size of index blocks, as an exponent, and records in each, so that all lists of dependencies find room.
    pub fn blocks(&self) -> (u8, umbrage_format::le::U16) {
        let lists: Vec<usize> = self.pages.iter().map(|p| p.dependencies.len()).collect();
        let choice = (12..=16).filter_map(|log2: u8| {
            let room = (1usize << log2) - BlockHeader::BYTES;
            let fits =
                |n: &usize| lists.chunks(*n).all(|c| n * PageRecord::BYTES + 4 * c.iter().sum::<usize>() <= room);
            let n = (1..=room / PageRecord::BYTES).rev().find(fits)?;
            Some((lists.len().div_ceil(n) << log2, log2, n as u16))
        });
        // A block of 64 KiB has room for one page with any list.
        choice.min().map_or((16, 1.into()), |(_, log2, n)| (log2, n.into()))
    }
}

/// Which groups stay in the root page, as and where they are: complete levels down to [`COARSE_DEPTH`], and of the
/// subtrees below the smallest that fit [`ROOT_WORDS`]. So the root page needs no other page. Groups straight below them
/// stay where they are, too: they may become pages.
pub fn root_page(m: &Merged) -> (Vec<bool>, Vec<bool>) {
    let mut root = vec![false; m.mask.len()];
    let mut kept = root.clone();
    if m.mask.is_empty() {
        return (root, kept);
    }
    let mut cells = Vec::new();
    coarse(m, 0, 1, &mut root, &mut cells);
    let coarse: u32 = root.iter().zip(&m.mask).filter(|(r, _)| **r).map(|(_, m)| Mask(*m).words()).sum();
    let mut words = coarse + 4;
    // smallest first; of equal ones the first in the map
    cells.sort_by_key(|g| (m.words[*g as usize], *g));
    for g in cells {
        words = words.saturating_add(m.words[g as usize]);
        if words > ROOT_WORDS {
            kept[g as usize] = true;
        } else {
            root[g as usize..(g + m.groups[g as usize]) as usize].fill(true);
        }
    }
    kept.iter_mut().zip(&root).for_each(|(k, r)| *k |= r);
    (root, kept)
}

fn coarse(m: &Merged, g: u32, depth: u8, root: &mut [bool], cells: &mut Vec<u32>) {
    if depth > COARSE_DEPTH {
        cells.push(g);
        return;
    }
    root[g as usize] = true;
    for below in m.below[g as usize].into_iter().filter(|b| *b != NONE) {
        coarse(m, below, depth + 1, root, cells);
    }
}

/// A tree page before it is written.
struct Draft {
    /// Its first group.
    root: u32,
    /// Where the node above that group lies.
    at: At,
    children: Vec<u32>,
    /// Groups in it, rising.
    groups: Vec<u32>,
    /// Shared pages that it needs.
    needs: Vec<u32>,
}

struct Plan<'a> {
    m: &'a Merged,
    /// References to each group that is still there.
    uses: Vec<u32>,
    /// Of groups in units, the first group of the unit.
    unit: Vec<u32>,
    /// Words of units, at their first group.
    unit_words: Vec<u32>,
    /// Where units lie: a tree page, or behind all of those a shared one.
    home: Vec<u32>,
    /// The tree page of each group with one reference.
    page: Vec<u32>,
    drafts: Vec<Draft>,
    /// Groups of each shared page, rising.
    shared: Vec<Vec<u32>>,
    /// Smallest and largest value stored below each group, less what holds above it.
    range: Vec<(i64, i64)>,
}

/// Makes the pages of a tree. `root_groups` are those that stay in the root page ([`root_page`]).
pub fn pages(m: &Merged, root: Node, root_groups: &[bool], log2_resolution: u8) -> Pages {
    // Where copies make a page too long, shorter pages have fewer references, down to a single group each.
    let mut own_words = OWN_WORDS;
    loop {
        let pages = attempt(m, root, root_groups, log2_resolution, own_words);
        let fits = |p: &PageInput| p.words.len() + p.dependencies.len() <= mmh::MAX_WORDS as usize;
        if own_words == 0 || pages.pages.iter().all(fits) {
            return pages;
        }
        own_words /= 4;
    }
}

fn attempt(m: &Merged, root: Node, root_groups: &[bool], log2_resolution: u8, own_words: u32) -> Pages {
    let n = m.mask.len();
    let mut p = Plan {
        m,
        uses: vec![0; n],
        unit: vec![NOWHERE; n],
        unit_words: vec![0; n],
        home: vec![NOWHERE; n],
        page: vec![NOWHERE; n],
        drafts: Vec::new(),
        shared: Vec::new(),
        range: vec![(i64::MAX, i64::MIN); n],
    };
    p.count();
    p.cut(root_groups, log2_resolution, own_words);
    p.settle();
    p.share();
    for page in 0..p.drafts.len() {
        p.fill(page);
    }
    p.write(root, log2_resolution)
}

impl Plan<'_> {
    /// Whether a group is still there.
    fn lives(&self, g: usize) -> bool {
        self.uses[g] > 0
    }

    /// Counts references, finds units, and the ranges of values.
    fn count(&mut self) {
        let m = self.m;
        if let Some(first) = self.uses.first_mut() {
            *first = 1;
        }
        for g in 0..m.mask.len() {
            if !self.lives(g) {
                continue;
            }
            if self.uses[g] > 1 {
                self.unit[g] = g as u32;
            }
            if self.unit[g] != NOWHERE {
                self.unit_words[self.unit[g] as usize] += m.mask(g as u32).words();
            }
            for t in (0..4).filter_map(|c| m.child(g as u32, c)) {
                self.uses[t as usize] += 1;
                // of groups with one reference the last word; others are units of their own
                self.unit[t as usize] = self.unit[g];
            }
        }
        for g in (0..m.mask.len()).rev().filter(|g| self.uses[*g] > 0).collect::<Vec<_>>() {
            let mut range = (i64::MAX, i64::MIN);
            for c in 0..4 {
                let rise = i64::from(m.value[g][c]) - i64::from(m.base[g]);
                let valued = m.mask(g as u32).child(c as u32).has_value();
                if valued {
                    range = (range.0.min(rise), range.1.max(rise));
                }
                if let Some(t) = m.child(g as u32, c) {
                    let (low, high) = self.range[t as usize];
                    let above = if valued { rise } else { 0 };
                    range = (range.0.min(low + above), range.1.max(high + above));
                }
            }
            self.range[g] = range;
        }
    }

    fn is_alone(&self, g: u32) -> bool {
        self.unit[g as usize] == NOWHERE
    }

    /// Cuts the groups with one reference into pages.
    fn cut(&mut self, root_groups: &[bool], log2_resolution: u8, own_words: u32) {
        let m = self.m;
        let mut words = vec![0u32; m.mask.len()];
        let mut cut = vec![false; m.mask.len()];
        for g in (0..m.mask.len()).rev().filter(|g| self.uses[*g] > 0 && self.unit[*g] == NOWHERE).collect::<Vec<_>>() {
            let mut below: Vec<u32> =
                (0..4).filter_map(|c| m.child(g as u32, c)).filter(|t| self.is_alone(*t)).collect();
            if root_groups[g] {
                below.iter().filter(|t| !root_groups[**t as usize]).for_each(|t| cut[*t as usize] = true);
                continue;
            }
            let mut sum = m.mask(g as u32).words() + below.iter().map(|t| words[*t as usize]).sum::<u32>();
            // the largest first; of equal ones the first in the map
            below.sort_by_key(|t| (std::cmp::Reverse(words[*t as usize]), *t));
            for t in below {
                if sum <= own_words {
                    break;
                }
                cut[t as usize] = true;
                sum -= words[t as usize];
            }
            words[g] = sum;
        }
        let top = At { level: log2_resolution, origin: [0, 0] };
        let mut queue = VecDeque::from([(0, top)]);
        let draft = |root, at| Draft { root, at, children: Vec::new(), groups: Vec::new(), needs: Vec::new() };
        while let Some((root, at)) = queue.pop_front() {
            let page = self.drafts.len() as u32;
            self.drafts.push(draft(root, at));
            if m.mask.is_empty() {
                return;
            }
            let mut stack = vec![(root, at)];
            let mut children = Vec::new();
            while let Some((g, at)) = stack.pop() {
                self.page[g as usize] = page;
                for c in 0..4 {
                    let Some(t) = m.child(g, c).filter(|t| self.is_alone(*t)) else { continue };
                    if cut[t as usize] {
                        children.push((t, at.child(c)));
                    } else {
                        stack.push((t, at.child(c)));
                    }
                }
            }
            // In the order of the words that refer to them.
            children.sort_unstable_by_key(|(t, _)| *t);
            self.drafts[page as usize].children = children.iter().map(|(t, _)| *t).collect();
            queue.extend(children);
        }
    }

    /// Finds the units that only one tree page refers to: they lie there.
    fn settle(&mut self) {
        let m = self.m;
        let mut home = vec![None; m.mask.len()];
        for g in 0..m.mask.len() {
            if !self.lives(g) {
                continue;
            }
            let here =
                if self.unit[g] == NOWHERE { self.page[g] } else { home[self.unit[g] as usize].unwrap_or(NOWHERE) };
            for t in (0..4).filter_map(|c| m.child(g as u32, c)).filter(|t| self.unit[*t as usize] == *t) {
                let home = &mut home[t as usize];
                *home = Some(if home.is_none_or(|h| h == here) { here } else { NOWHERE });
            }
        }
        self.home = home.into_iter().map(|h| h.unwrap_or(NOWHERE)).collect();
    }

    /// Adds a unit and what it needs to a list of groups; `has` says which are in it.
    fn take(&self, unit: u32, groups: &mut Vec<u32>, has: &mut impl FnMut(u32) -> bool, stays: &impl Fn(u32) -> bool) {
        let mut stack = vec![unit];
        while let Some(g) = stack.pop() {
            if has(g) {
                continue;
            }
            groups.push(g);
            stack.extend(
                (0..4).filter_map(|c| self.m.child(g, c)).filter(|t| self.unit[*t as usize] != *t || stays(*t)),
            );
        }
    }

    /// Puts units that several pages refer to into shared pages, in preorder.
    fn share(&mut self) {
        let first = self.drafts.len() as u32;
        let mut stamp = vec![NOWHERE; self.m.mask.len()];
        let (mut groups, mut words) = (Vec::new(), 0);
        // Those that tree pages refer to; others are taken along.
        let mut wanted = vec![false; self.m.mask.len()];
        for g in (0..self.m.mask.len()).filter(|g| self.lives(*g)) {
            let in_tree = self.unit[g] == NOWHERE || self.home[self.unit[g] as usize] != NOWHERE;
            for t in (0..4).filter_map(|c| self.m.child(g as u32, c)).filter(|_| in_tree) {
                wanted[t as usize] |= self.unit[t as usize] == t && self.home[t as usize] == NOWHERE;
            }
        }
        for u in (0..self.m.mask.len()).filter(|u| wanted[*u]) {
            let page = self.shared.len() as u32;
            let before = groups.len();
            let mut has = |g: u32| std::mem::replace(&mut stamp[g as usize], page) == page;
            self.take(u as u32, &mut groups, &mut has, &|_| true);
            words += groups[before..].iter().map(|g| self.m.mask(*g).words()).sum::<u32>();
            self.home[u] = first + page;
            if words + groups.len() as u32 / 4 >= SHARED_WORDS {
                self.shared.push(std::mem::take(&mut groups));
                words = 0;
            }
        }
        if !groups.is_empty() {
            self.shared.push(groups);
        }
        self.shared.iter_mut().for_each(|g| g.sort_unstable());
    }

    /// Gathers the groups of a tree page.
    fn fill(&mut self, page: usize) {
        let first = self.drafts.len() as u32;
        if self.m.mask.is_empty() {
            return;
        }
        let d = &self.drafts[page];
        let cut: std::collections::HashSet<u32> = d.children.iter().copied().collect();
        let mut copied = std::collections::HashSet::new();
        loop {
            let mut inside = std::collections::HashSet::new();
            let mut groups = Vec::new();
            // Units in shared pages that are referred to.
            let mut outside: HashMap<u32, Vec<u32>> = HashMap::new();
            let mut stack = vec![d.root];
            while let Some(g) = stack.pop() {
                if !inside.insert(g) {
                    continue;
                }
                groups.push(g);
                for t in (0..4).filter_map(|c| self.m.child(g, c)).filter(|t| !cut.contains(t)) {
                    let home = self.home[t as usize];
                    let is_unit = self.unit[t as usize] == t;
                    if !is_unit || home == page as u32 || home == NOWHERE || copied.contains(&home) {
                        stack.push(t);
                    } else if !outside.entry(home).or_default().contains(&t) {
                        outside.entry(home).or_default().push(t);
                    }
                }
            }
            let words = |units: &[u32]| units.iter().map(|u| self.unit_words[*u as usize]).sum::<u32>();
            // More pages than it may depend on: units of those with the fewest words are copied.
            let mut all: Vec<(u32, u32)> = outside.iter().map(|o| (words(o.1), *o.0)).collect();
            all.sort_unstable();
            let over = all.len().saturating_sub(usize::from(mmh::MAX_DEPENDENCIES));
            if over == 0 {
                groups.sort_unstable();
                let mut needs: Vec<u32> = outside.into_keys().collect();
                needs.sort_unstable();
                debug_assert!(needs.iter().all(|n| *n >= first));
                let d = &mut self.drafts[page];
                (d.groups, d.needs) = (groups, needs);
                return;
            }
            copied.extend(all[..over].iter().map(|a| a.1));
        }
    }

    /// First words of the groups of a page from `start` on, and the page's words so far.
    fn lay_out(&self, groups: &[u32], start: u32, places: &mut [(u32, u16)], page: u32) -> Vec<u32> {
        let mut at = start;
        for &g in groups {
            // Pages that are too long are found when they are whole.
            places[g as usize] = (page, at.min(u16::MAX.into()) as u16);
            at += self.m.mask(g).words();
        }
        vec![0; at as usize]
    }

    /// Writes the nodes of a group; `children` says where the children of one lie.
    fn encode(
        &self,
        words: &mut [u32],
        g: u32,
        at: u16,
        nodes: &mut [u64; 3],
        mut children: impl FnMut(u32) -> Children,
    ) {
        let (mask, base) = (self.m.mask(g), self.m.base[g as usize]);
        for c in 0..4u8 {
            let (kind, i) = (mask.child(c.into()), usize::from(c));
            let word = usize::from(at) + mask.words_before(c.into()) as usize;
            let rise = self.m.value[g as usize][i].wrapping_sub(base);
            let mut node = |words: &mut [u32]| {
                if let Some(t) = self.m.child(g, i) {
                    words[word] = mmh::Node { mask: self.m.mask(t), children: children(t) }.encode();
                }
            };
            match kind {
                NodeType::None => continue,
                NodeType::Leaf => words[word] = rise,
                NodeType::Inner => {
                    node(words);
                    words[word + 1] = rise;
                }
                NodeType::Empty => node(words),
            }
            nodes[kind as usize - 1] += 1;
        }
    }

    /// The second pass: words and records.
    fn write(self, root: Node, log2_resolution: u8) -> Pages {
        let (m, first) = (self.m, self.drafts.len() as u32);
        let mut out = Pages { shared: self.shared.len() as u32, ..Pages::default() };
        let live = (0..m.mask.len()).filter(|g| self.lives(*g));
        out.words_unpaged = live.map(|g| u64::from(m.mask(g as u32).words())).sum();
        // Where groups lie in the page that is being written, and units in theirs.
        let mut places = vec![(NOWHERE, 0u16); m.mask.len()];
        let mut units = vec![0u16; m.mask.len()];
        let mut shared = Vec::with_capacity(self.shared.len());
        for (page, groups) in (first..).zip(&self.shared) {
            let mut inside: std::collections::HashSet<u32> = std::collections::HashSet::new();
            for &g in groups {
                inside.extend((0..4).filter_map(|c| m.child(g, c)));
            }
            let entries: Vec<u8> = groups.iter().filter(|g| !inside.contains(g)).map(|g| m.mask[*g as usize]).collect();
            let start = ROOT_GROUP as u32 + mmh::entry_words(entries.len() as u32);
            let mut words = self.lay_out(groups, start, &mut places, page);
            words[mmh::ENTRIES] = entries.len() as u32;
            for (i, mask) in entries.iter().enumerate() {
                words[mmh::ENTRIES + 1 + i / 4] |= u32::from(*mask) << (8 * (i % 4));
            }
            for &g in groups {
                let at = places[g as usize].1;
                self.encode(&mut words, g, at, &mut out.nodes, |t| Children::Here(places[t as usize].1));
                if self.home[g as usize] == page {
                    units[g as usize] = at;
                }
            }
            let mut record = PageRecord::zeroed();
            (record.page_type, record.min_depth) = (FORM_TREE | SHARED, u32::MAX.into());
            shared.push(page_input(words, FrameHead { root_mask: 0, root_level: 0, ..head() }, record, Vec::new()));
        }
        let mut levels = vec![0u8; m.mask.len()];
        for (page, d) in (0u32..).zip(&self.drafts) {
            let is_root = page == 0;
            let below = if root.below == NONE { NodeType::Leaf } else { NodeType::Inner };
            let root_words = if is_root { below.words() } else { 0 };
            let mut words = self.lay_out(&d.groups, u32::from(ROOT_GROUP) + root_words, &mut places, page);
            let mut finest = d.at.level;
            d.groups.iter().for_each(|g| levels[*g as usize] = u8::MAX);
            if let Some(&top) = d.groups.first() {
                levels[top as usize] = d.at.level - 1;
            }
            for &g in &d.groups {
                let level = levels[g as usize];
                finest = finest.min(level);
                let at = places[g as usize].1;
                self.encode(&mut words, g, at, &mut out.nodes, |t| {
                    if let Ok(child) = d.children.binary_search(&t) {
                        Children::Page(child as u16)
                    } else if places[t as usize].0 == page {
                        // Of several nodes the lowest; places are rising, so all of them come before.
                        levels[t as usize] = levels[t as usize].min(level - 1);
                        Children::Here(places[t as usize].1)
                    } else {
                        let dependency = d.needs.binary_search(&self.home[t as usize]).unwrap_or(usize::MAX);
                        Children::Shared(dependency.min(u8::MAX.into()) as u8, units[t as usize])
                    }
                });
            }
            let mut record = PageRecord::zeroed();
            let (span, base, mask) = match d.groups.first() {
                Some(&g) if !is_root => (Some(m.span[g as usize]), m.base[g as usize], m.mask(g)),
                _ => (None, root.interval.middle(), Mask(below as u8)),
            };
            if is_root {
                let at = usize::from(ROOT_GROUP);
                if let Some(&g) = d.groups.first() {
                    let word = mmh::Node { mask: m.mask(g), children: Children::Here(places[g as usize].1) };
                    words[at] = word.encode();
                }
                words[at + root_words as usize - 1] = base;
                out.nodes[below as usize - 1] += 1;
            }
            let (low, high) = d.groups.first().map_or((i64::MAX, i64::MIN), |g| self.range[*g as usize]);
            let answers = is_root || mask.inherits();
            let depth = |v: i64| (v + i64::from(base)) as u32;
            record.min_depth = depth(if answers { low.min(0) } else { low }).into();
            record.max_depth = depth(if answers { high.max(0) } else { high }).into();
            record.stop_error = span.map_or(u32::MAX, |s: Span| s.stop_error(base)).into();
            (record.origin_x, record.origin_y) = (d.at.origin[0].into(), d.at.origin[1].into());
            (record.log2_x, record.log2_y) = (d.at.level, d.at.level);
            record.level_coarsest = if is_root { log2_resolution } else { d.at.level - 1 };
            record.level_finest = finest.min(record.level_coarsest);
            let head = FrameHead {
                root_mask: mask.0,
                root_level: record.level_coarsest,
                child_refs: d.children.len() as u16,
                ..head()
            };
            out.pages.push(page_input(words, head, record, d.needs.clone()));
        }
        out.pages.append(&mut shared);
        out
    }
}

fn head() -> FrameHead {
    FrameHead { tag: Kind::Mmh.tag(), root_mask: 0, child_refs: 0, words: 0, root_level: 0 }
}

fn page_input(mut words: Vec<u32>, head: FrameHead, record: PageRecord, dependencies: Vec<u32>) -> PageInput {
    let head = FrameHead { words: words.len().min(usize::from(MAX_PAGE_WORDS)) as u16, ..head };
    words[..2].copy_from_slice(&head.encode());
    PageInput { words, record, dependencies }
}
