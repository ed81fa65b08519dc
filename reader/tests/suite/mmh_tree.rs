//! Trees of kind `mmh` for tests: random ones whose groups repeat, their naive lookup, and their pages.

use std::collections::{HashMap, HashSet, VecDeque};
use std::sync::Arc;

use umbrage_format::index::SHARED;
use umbrage_format::kind::mh::{Mask, NodeType};
use umbrage_format::kind::mmh::{Children, ENTRIES, Node, entry_words};
use umbrage_format::page::FrameHead;
use umbrage_format::{Kind, PageRecord, StructureRecord};
use umbrage_writer::container::PageInput;

/// A node: its rise over the value above, and the group of its children.
#[derive(Clone)]
pub enum Piece {
    Leaf(u32),
    Inner(u32, Arc<Group>),
    Empty(Arc<Group>),
}

/// The children of a node. One group may have several parents.
pub type Group = [Option<Piece>; 4];

impl Piece {
    fn kind(&self) -> NodeType {
        match self {
            Piece::Leaf(_) => NodeType::Leaf,
            Piece::Inner(..) => NodeType::Inner,
            Piece::Empty(_) => NodeType::Empty,
        }
    }

    fn rise(&self) -> Option<u32> {
        if let Piece::Leaf(r) | Piece::Inner(r, _) = self { Some(*r) } else { None }
    }

    pub fn below(&self) -> Option<&Arc<Group>> {
        if let Piece::Inner(_, g) | Piece::Empty(g) = self { Some(g) } else { None }
    }

    /// The answer of a lookup in the tree of this root node, level by level.
    pub fn lookup(&self, log2: u8, x: u32, y: u32, level: u8) -> u32 {
        let (mut node, mut at, mut sum) = (self, log2, 0u32);
        loop {
            sum = sum.wrapping_add(node.rise().unwrap_or(0));
            let Some(group) = node.below().filter(|_| at > level) else { return sum };
            at -= 1;
            let c = (x >> at & 1) | (y >> at & 1) << 1;
            let Some(child) = &group[c as usize] else { return sum };
            node = child;
        }
    }
}

/// A random root node of a map of `1 << log2` texels on a side, at most 256; `roll(n)` gives a number below n. Rises go up
/// and down, and stay far from both ends of the depths.
pub fn grow(roll: &mut impl FnMut(u32) -> u32, log2: u8) -> Piece {
    let mut made: Vec<(u8, Arc<Group>)> = Vec::new();
    let group = grow_group(roll, log2 - 1, &mut made);
    Piece::Inner((1 << 30) + roll(u32::MAX) / 4, group)
}

/// A group whose nodes are at `level`; every third one that fits is taken from those made before.
fn grow_group(roll: &mut impl FnMut(u32) -> u32, level: u8, made: &mut Vec<(u8, Arc<Group>)>) -> Arc<Group> {
    let old: Vec<_> = made.iter().filter(|m| m.0 <= level && m.0 + 2 > level).map(|m| m.1.clone()).collect();
    if !old.is_empty() && roll(3) == 0 {
        return old[roll(old.len() as u32) as usize].clone();
    }
    let mut group: Group = [None, None, None, None];
    for child in &mut group {
        let rise = if roll(4) == 0 { (roll(u32::MAX) >> 5).wrapping_sub(1 << 26) } else { roll(1000) };
        *child = match roll(if level == 0 { 3 } else { 7 }) {
            0 => None,
            1 | 2 => Some(Piece::Leaf(rise)),
            3 | 4 => Some(Piece::Inner(rise, grow_group(roll, level - 1, made))),
            _ => Some(Piece::Empty(grow_group(roll, level - 1, made))),
        };
    }
    if group.iter().all(Option::is_none) {
        group[roll(4) as usize] = Some(Piece::Leaf(roll(1000)));
    }
    let group = Arc::new(group);
    made.push((level, group.clone()));
    group
}

type Key = *const Group;

/// A group on the way down: level of its nodes, first texel, the value above, whether it has one place in the map.
type Open<'a> = (&'a Arc<Group>, u8, [u32; 2], u32, bool);

fn key(g: &Arc<Group>) -> Key {
    Arc::as_ptr(g)
}

fn mask(g: &Group) -> Mask {
    Mask::new(std::array::from_fn(|c| g[c].as_ref().map_or(NodeType::None, Piece::kind)))
}

fn below(g: &Group) -> impl Iterator<Item = &Arc<Group>> {
    g.iter().flatten().filter_map(Piece::below)
}

fn height(g: &Group) -> u32 {
    1 + below(g).map(|b| height(b)).max().unwrap_or(0)
}

/// Smallest and largest value that is answered in a group, `above` among them where a child has none of its own.
fn extremes(g: &Group, above: u32, own: bool) -> (u32, u32) {
    let mut all = if own && mask(g).inherits() { (above, above) } else { (u32::MAX, 0) };
    for child in g.iter().flatten() {
        let value = above.wrapping_add(child.rise().unwrap_or(0));
        if child.rise().is_some() {
            all = (all.0.min(value), all.1.max(value));
        }
        if let Some(b) = child.below() {
            let more = extremes(b, value, false);
            all = (all.0.min(more.0), all.1.max(more.1));
        }
    }
    all
}

/// What becomes of groups with several parents.
#[derive(Clone, Copy, PartialEq)]
enum Home {
    /// Each page that needs it has one.
    Page,
    /// A shared page.
    Shared(usize),
}

/// Writes pages: the children of nodes at the levels `cuts` lie in pages of their own, where they have one parent. Of the
/// groups with several parents, every third lies in each page that needs it, the others in two shared pages. Gives the
/// pages and how many are shared.
pub fn pages(root: &Piece, log2: u8, cuts: &[u8]) -> (Vec<PageInput>, u32) {
    let mut parents: HashMap<Key, u32> = HashMap::new();
    let mut order = Vec::new();
    let mut seen = HashSet::new();
    let mut open: VecDeque<&Arc<Group>> = root.below().into_iter().collect();
    while let Some(g) = open.pop_front() {
        *parents.entry(key(g)).or_default() += 1;
        if seen.insert(key(g)) {
            order.push(g);
            open.extend(below(g));
        }
    }
    let several = order.iter().filter(|g| parents[&key(g)] > 1);
    let home: HashMap<Key, Home> =
        several.enumerate().map(|(i, g)| (key(g), if i % 3 == 2 { Home::Page } else { Home::Shared(i % 3) })).collect();
    // Tree pages, each with its root group and the levels and places of its groups with one parent.
    struct Draft<'a> {
        group: Option<&'a Arc<Group>>,
        level: u8,
        origin: [u32; 2],
        inherited: u32,
    }
    let mut queue = VecDeque::from([Draft { group: root.below(), level: log2, origin: [0; 2], inherited: 0 }]);
    let (mut tree, mut shared_entries): (Vec<PageInput>, [Vec<&Arc<Group>>; 2]) =
        (Vec::new(), [Vec::new(), Vec::new()]);
    let mut fixes: Vec<(usize, usize, usize, Key)> = Vec::new();
    while let Some(draft) = queue.pop_front() {
        let is_root = tree.is_empty();
        let mut groups: Vec<&Arc<Group>> = Vec::new();
        let mut open: Vec<Open<'_>> = Vec::new();
        let value = if is_root { root.rise().unwrap() } else { draft.inherited };
        if let Some(g) = draft.group {
            open.push((g, draft.level - u8::from(is_root), draft.origin, value, true));
        }
        let (mut finest, mut children) = (draft.level, Vec::new());
        let mut found = HashSet::new();
        let mut lowest: HashMap<Key, u8> = HashMap::new();
        while let Some((g, level, [x, y], above, alone)) = open.pop() {
            finest = finest.min(level);
            let deeper = lowest.get(&key(g)).is_none_or(|l| level < *l);
            lowest.entry(key(g)).and_modify(|l| *l = level.min(*l)).or_insert(level);
            if found.insert(key(g)) {
                groups.push(g);
            } else if !deeper {
                continue;
            }
            for (c, child) in g.iter().enumerate().filter_map(|(c, p)| Some((c as u32, p.as_ref()?))) {
                let (Some(b), value) = (child.below(), above.wrapping_add(child.rise().unwrap_or(0))) else { continue };
                let at = [x + ((c & 1) << level), y + ((c >> 1) << level)];
                match home.get(&key(b)) {
                    Some(Home::Shared(page)) => {
                        if shared_entries[*page].iter().all(|e| key(e) != key(b)) {
                            shared_entries[*page].push(b);
                        }
                    }
                    Some(Home::Page) => open.push((b, level - 1, at, value, false)),
                    None if alone && cuts.contains(&level) => {
                        children.push(key(b));
                        queue.push_back(Draft { group: Some(b), level: level - 1, origin: at, inherited: value });
                    }
                    None => open.push((b, level - 1, at, value, alone)),
                }
            }
        }
        // Higher ones first: children lie behind their nodes.
        groups.sort_by_key(|g| std::cmp::Reverse(height(g)));
        let start = if is_root { 2 + root.kind().words() } else { 2 };
        let (mut words, places) = lay_out(&groups, start);
        let mut needs: Vec<usize> = Vec::new();
        let page = tree.len();
        let mut children_of =
            |b: &Arc<Group>, at: usize, needs: &mut Vec<usize>| match (home.get(&key(b)), places.get(&key(b))) {
                (Some(Home::Shared(shared)), _) => {
                    let d = needs.iter().position(|n| n == shared).unwrap_or_else(|| {
                        needs.push(*shared);
                        needs.len() - 1
                    });
                    fixes.push((page, at, *shared, key(b)));
                    Children::Shared(d as u8, 0)
                }
                (_, Some(&place)) => Children::Here(place),
                _ => Children::Page(children.iter().position(|k| *k == key(b)).unwrap() as u16),
            };
        if is_root {
            if let Some(b) = root.below() {
                words[2] = Node { mask: mask(b), children: Children::Here(places[&key(b)]) }.encode();
            }
            words[start as usize - 1] = value;
        }
        for g in &groups {
            encode(&mut words, g, places[&key(g)], |b, at| children_of(b, at, &mut needs));
        }
        let (root_mask, extremes) = match draft.group {
            Some(g) if !is_root => (mask(g).0, extremes(g, value, true)),
            Some(g) => {
                let (low, high) = extremes(g, value, true);
                (root.kind() as u8, (low.min(value), high.max(value)))
            }
            None => (root.kind() as u8, (value, value)),
        };
        let head = FrameHead {
            tag: Kind::Mmh.tag(),
            root_mask,
            child_refs: children.len() as u16,
            words: words.len() as u16,
            root_level: draft.level,
        };
        words[..2].copy_from_slice(&head.encode());
        let mut record = PageRecord::zeroed();
        let side = if is_root { draft.level } else { draft.level + 1 };
        (record.origin_x, record.origin_y) = (draft.origin[0].into(), draft.origin[1].into());
        (record.log2_x, record.log2_y) = (side, side);
        (record.level_coarsest, record.level_finest) = (draft.level, finest);
        (record.min_depth, record.max_depth) = (extremes.0.into(), extremes.1.into());
        record.stop_error = u32::MAX.into();
        let dependencies = needs.iter().map(|n| *n as u32).collect();
        tree.push(PageInput { words, record, dependencies });
    }
    // What two shared pages hold, and where; a page that nobody needs is left out.
    let used: Vec<usize> = (0..2).filter(|s| !shared_entries[*s].is_empty()).collect();
    let (first, mut out) = (tree.len() as u32, tree);
    for p in &mut out {
        for d in &mut p.dependencies {
            *d = first + used.iter().position(|u| *u == *d as usize).unwrap() as u32;
        }
    }
    let mut shared = Vec::new();
    for &s in &used {
        let (mut groups, mut found) = (Vec::new(), HashSet::new());
        let mut open = shared_entries[s].clone();
        while let Some(g) = open.pop() {
            if found.insert(key(g)) {
                groups.push(g);
                open.extend(below(g));
            }
        }
        groups.sort_by_key(|g| std::cmp::Reverse(height(g)));
        let inside: HashSet<Key> = groups.iter().flat_map(|g| below(g)).map(key).collect();
        let entries: Vec<u8> = groups.iter().filter(|g| !inside.contains(&key(g))).map(|g| mask(g).0).collect();
        let start = ENTRIES as u32 + entry_words(entries.len() as u32);
        let (mut words, places) = lay_out(&groups, start);
        words[ENTRIES] = entries.len() as u32;
        for (i, m) in entries.iter().enumerate() {
            words[ENTRIES + 1 + i / 4] |= u32::from(*m) << (8 * (i % 4));
        }
        for g in &groups {
            encode(&mut words, g, places[&key(g)], |b, _| Children::Here(places[&key(b)]));
        }
        let words_count = words.len() as u16;
        let head = FrameHead { tag: Kind::Mmh.tag(), root_mask: 0, child_refs: 0, words: words_count, root_level: 0 };
        words[..2].copy_from_slice(&head.encode());
        let mut record = PageRecord::zeroed();
        (record.page_type, record.min_depth) = (SHARED, u32::MAX.into());
        for &(page, at, _, group) in fixes.iter().filter(|f| f.2 == s) {
            out[page].words[at] |= u32::from(places[&group]) << 16;
        }
        shared.push(PageInput { words, record, dependencies: Vec::new() });
    }
    let count = shared.len() as u32;
    out.extend(shared);
    (out, count)
}

fn lay_out(groups: &[&Arc<Group>], start: u32) -> (Vec<u32>, HashMap<Key, u16>) {
    let (mut at, mut places) = (start, HashMap::new());
    for g in groups {
        places.insert(key(g), at as u16);
        at += mask(g).words();
    }
    (vec![0; at as usize], places)
}

fn encode(words: &mut [u32], g: &Group, start: u16, mut children: impl FnMut(&Arc<Group>, usize) -> Children) {
    let mut at = usize::from(start);
    for child in g.iter().flatten() {
        let words_of = child.kind().words() as usize;
        if let Some(b) = child.below() {
            words[at] = Node { mask: mask(b), children: children(b, at) }.encode();
        }
        if let Some(rise) = child.rise() {
            words[at + words_of - 1] = rise;
        }
        at += words_of;
    }
}

/// A structure record for such pages, with room for their dependencies.
pub fn structure(name: &str, log2: u8, pages: &[PageInput], shared: u32) -> StructureRecord {
    let mut record = crate::tree::structure(name, Kind::Mmh, log2, pages.len());
    record.shared_pages = shared.into();
    (record.index_block_log2, record.records_per_block) = (12, 32.into());
    record
}
