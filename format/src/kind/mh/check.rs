//! The check of a page's words.
//!
//! Two methods, one answer. [`sweep`] passes over the words once, from front to back, which works because children lie
//! behind their node; it says what is in a good page and nothing about a bad one. [`walk`] goes from node to node as
//! the spec's list of checks has it and names the first rule that is broken; it sees only pages that the sweep turned
//! away. What was tried and what it cost: NOTES.md beside `src`.

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing,
    clippy::cast_possible_truncation
)]

use super::super::tree::check_place;
use super::{Children, Mask, Node, NodeType, PageCounts, ROOT_GROUP, WAITING};
use crate::error::{FormatError, Rule, Value};
use crate::page::{FRAME_WORDS, FrameHead, PageContext};

/// Most words of a page.
const MOST: usize = crate::index::MAX_PAGE_WORDS as usize;

/// Checks the words of a page whose frame has been checked: every word reached exactly once, children behind their
/// node, every child page referred to exactly once, no children below level 0, no node without children, levels and
/// values within the page's record. Time and memory are linear in the words.
///
/// # Errors
/// `mh.*`; the offset is that of the node's word.
pub fn check(page: &[u32], head: &FrameHead, cx: &PageContext<'_>) -> Result<PageCounts, FormatError> {
    let number = |v: u32| Value::Number(v.into());
    check_place(head, cx, [Rule::MhPlain, Rule::MhRoot, Rule::MhFootprint])?;
    // Clearing the largest tables takes longer than checking a small page.
    let swept = match page.len().max(head.child_refs.into()) {
        0..=256 => sweep::<256, 8>(page, head),
        257..=4096 => sweep::<4096, 128>(page, head),
        4097..=MOST => sweep::<MOST, { MOST / 32 }>(page, head),
        _ => None,
    };
    let counts = match swept {
        Some(counts) => counts,
        None => walk(page, head, cx)?,
    };
    if counts.level_finest != cx.page.level_finest {
        let (expected, found) = (number(cx.page.level_finest.into()), number(counts.level_finest.into()));
        return Err(cx.fault(Rule::MhLevels, 0, expected, found));
    }
    counts.check_values(cx, Rule::MhValues)?;
    Ok(counts)
}

/// What the types of a group say of its words.
#[derive(Clone, Copy)]
struct Shape {
    /// Words of the group.
    words: u8,
    /// Nodes with children.
    parents: u8,
    /// Word of each of them in the group, by rising child.
    parent_at: [u8; 4],
    /// Leaves.
    leaves: u8,
    /// Their words.
    leaf_at: [u8; 4],
    /// 1 where the parent of the same place is inner, 0 where it is empty.
    inner: [u8; 4],
    /// How many parents are inner.
    inners: u8,
}

/// The shape of every mask.
static SHAPES: [Shape; 256] = shapes();

const fn shapes() -> [Shape; 256] {
    let none = Shape { words: 0, parents: 0, parent_at: [0; 4], leaves: 0, leaf_at: [0; 4], inner: [0; 4], inners: 0 };
    let mut shapes = [none; 256];
    let mut bits = 0u8;
    loop {
        let mut s = none;
        let mut c = 0;
        while c < 4 {
            let kind = Mask(bits).child(c);
            match kind {
                NodeType::None => {}
                NodeType::Leaf => {
                    put(&mut s.leaf_at, s.leaves, s.words);
                    s.leaves += 1;
                    s.words += 1;
                }
                NodeType::Inner | NodeType::Empty => {
                    let inner = matches!(kind, NodeType::Inner) as u8;
                    put(&mut s.parent_at, s.parents, s.words);
                    put(&mut s.inner, s.parents, inner);
                    s.parents += 1;
                    s.inners += inner;
                    s.words += 1 + inner;
                }
            }
            c += 1;
        }
        if let Some((_, [slot, ..])) = shapes.split_at_mut_checked(bits as usize) {
            *slot = s;
        }
        if bits == u8::MAX {
            return shapes;
        }
        bits += 1;
    }
}

/// `list[at] = value`.
const fn put(list: &mut [u8; 4], at: u8, value: u8) {
    if let Some((_, [slot, ..])) = list.split_at_mut_checked(at as usize) {
        *slot = value;
    }
}

#[inline(always)]
fn shape(mask: u8) -> &'static Shape {
    // 256 of them: there is one for every mask.
    SHAPES.get(usize::from(mask)).unwrap_or(&SHAPES[0])
}

/// A group that a node has announced: bits 0..8 its mask, 8..13 its level, 13..16 its words less 1. Not 0, because the
/// mask is not.
#[inline(always)]
fn entry(mask: u8, level: u8) -> u16 {
    u16::from(mask) | u16::from(level & 31) << 8 | u16::from(shape(mask).words.wrapping_sub(1) & 7) << 13
}

/// Extremes of values.
struct Range {
    min: u32,
    max: u32,
    /// Extremes of values of leaves by their place modulo 4, with the top bit flipped: what SSE2 can compare.
    mins: [i32; 4],
    maxs: [i32; 4],
}

impl Range {
    const NONE: Self = Self { min: u32::MAX, max: 0, mins: [i32::MAX; 4], maxs: [i32::MIN; 4] };

    #[inline(always)]
    fn add(&mut self, value: u32) {
        self.min = self.min.min(value);
        self.max = self.max.max(value);
    }

    /// Adds the value where `counts` is 1, and not where it is 0. Types of nodes are hard to foretell: no branch.
    #[inline(always)]
    fn add_if(&mut self, value: u32, counts: u8) {
        let mask = u32::from(counts).wrapping_neg();
        self.min = self.min.min(value | !mask);
        self.max = self.max.max(value & mask);
    }

    #[inline(always)]
    fn add_4(&mut self, values: &[u32; 4]) {
        for ((min, max), v) in self.mins.iter_mut().zip(&mut self.maxs).zip(values) {
            let v = (v ^ 1 << 31).cast_signed();
            *min = if v < *min { v } else { *min };
            *max = if v > *max { v } else { *max };
        }
    }

    /// Adds leaves that lie one behind the other.
    #[inline(always)]
    fn leaves(&mut self, values: &[u32]) {
        let Some(last) = values.last_chunk::<4>() else {
            values.iter().for_each(|&v| self.add(v));
            return;
        };
        values.as_chunks::<4>().0.iter().for_each(|four| self.add_4(four));
        // What is behind the last whole four, and some again.
        self.add_4(last);
    }

    fn extremes(&self) -> (u32, u32) {
        let back = |v: i32| v.cast_unsigned() ^ 1 << 31;
        let min = self.mins.iter().fold(self.min, |m, &v| m.min(back(v)));
        (min, self.maxs.iter().fold(self.max, |m, &v| m.max(back(v))))
    }
}

/// Counts the nodes of a page of at most `WORDS` words and child pages, `REFS` = `WORDS / 32`; none where a rule is
/// broken, by the words or by the frame.
///
/// Every group is announced by its node before the sweep comes to it, because children lie behind their node. The sweep
/// steps from group to group: each begins where the one before ends, and where none was announced the page is bad. It
/// is also bad where a group was announced and never come to: then the sum of the announced words is too large. What
/// remains covers every word once.
fn sweep<const WORDS: usize, const REFS: usize>(page: &[u32], head: &FrameHead) -> Option<PageCounts> {
    let mut groups = [0u16; WORDS];
    let mut refs = [0u32; REFS];
    let mut refs_reached = 0u16;
    let (mut leaves, mut inner, mut empty) = (0u32, 0u32, 0u32);
    let mut range = Range::NONE;
    let mut finest = head.root_level;
    if head.root_mask == 0 || head.root_level > 31 {
        return None;
    }
    *groups.get_mut(usize::from(ROOT_GROUP))? = entry(head.root_mask, head.root_level);
    let (mut announced, mut straight) = (usize::from(shape(head.root_mask).words), 0);
    let mut at = usize::from(ROOT_GROUP);
    while at < page.len() {
        let group = *groups.get(at)?;
        let [mask, rest] = group.to_le_bytes();
        let words = usize::from(group >> 13) + 1;
        if group == 0 {
            return None;
        }
        if Mask(mask).is_leaves() {
            leaves += u32::from(group >> 13) + 1;
            range.leaves(page.get(at..at + words)?);
            at += words;
            continue;
        }
        let s = shape(mask);
        let below = (rest & 31).checked_sub(1)?;
        let whole = page.get(at..at + words)?;
        for &i in s.leaf_at.iter().take(s.leaves.into()) {
            range.add(*whole.get(usize::from(i))?);
        }
        leaves += u32::from(s.leaves);
        inner += u32::from(s.inners);
        empty += u32::from(s.parents - s.inners);
        // Leaves straight behind need no announcement.
        let behind = at + words;
        let mut end = behind;
        for (&i, &has_value) in s.parent_at.iter().zip(&s.inner).take(s.parents.into()) {
            let word = *whole.get(usize::from(i))?;
            // Of an empty node its own word, which then does not count.
            range.add_if(*whole.get(usize::from(i + has_value))?, has_value);
            let [mask, place, low, high] = word.to_le_bytes();
            let first = u16::from_le_bytes([low, high]);
            let words = shape(mask).words;
            if mask == 0 {
                return None;
            }
            if place == 0 && usize::from(first) == end && Mask(mask).is_leaves() {
                end += usize::from(words);
            } else if place == 0 {
                let slot = groups.get_mut(usize::from(first))?;
                if *slot != 0 || usize::from(first) <= at + usize::from(i) {
                    return None;
                }
                *slot = entry(mask, below);
                announced += usize::from(words);
                finest = finest.min(below);
            } else if place == 1 && first < head.child_refs && mark(&mut refs, first.into()) {
                refs_reached += 1;
            } else {
                return None;
            }
        }
        if end > behind {
            let values = page.get(behind..end)?;
            range.leaves(values);
            straight += values.len();
            finest = finest.min(below);
        }
        at = end;
    }
    leaves += u32::try_from(straight).ok()?;
    let covered = at == page.len() && announced + straight + FRAME_WORDS == page.len();
    let (min, max) = range.extremes();
    let counts = PageCounts { leaves, inner, empty, min, max, level_finest: finest };
    (covered && refs_reached == head.child_refs).then_some(counts)
}

/// Marks one bit; `false` where it was marked before or lies outside.
fn mark(map: &mut [u32], bit: u32) -> bool {
    let Some(word) = map.get_mut((bit / 32) as usize) else { return false };
    let fresh = *word >> (bit % 32) & 1 == 0;
    *word |= 1 << (bit % 32);
    fresh
}

/// [`sweep`] for pages that break a rule, and which.
fn walk(page: &[u32], head: &FrameHead, cx: &PageContext<'_>) -> Result<PageCounts, FormatError> {
    let mask = Mask(head.root_mask);
    let number = |v: u32| Value::Number(v.into());
    let mut counts = PageCounts { min: u32::MAX, level_finest: head.root_level, ..PageCounts::default() };
    let (mut words, mut refs) = ([0u32; MOST / 32], [0u32; MOST / 32]);
    let (mut words_reached, mut refs_reached) = (0u32, 0u16);
    let mut waiting = [(ROOT_GROUP, mask, head.root_level); WAITING];
    let mut count = 1usize;
    while let Some(&(start, mask, level)) = count.checked_sub(1).and_then(|top| waiting.get(top)) {
        count -= 1;
        counts.level_finest = counts.level_finest.min(level);
        for c in 0..4 {
            let kind = mask.child(c);
            if kind == NodeType::None {
                continue;
            }
            let at = u32::from(start) + mask.words_before(c);
            for word in at..at + kind.words() {
                if word as usize >= page.len() {
                    return Err(cx.fault(
                        Rule::MhBounds,
                        at as usize,
                        Value::AtMost(page.len() as u64 - 1),
                        number(word),
                    ));
                }
                if !mark(&mut words, word) {
                    return Err(cx.fault(
                        Rule::MhOverlap,
                        word as usize,
                        Value::Text("a word of one node"),
                        Value::Text("of two"),
                    ));
                }
                words_reached += 1;
            }
            let at = at as usize;
            let word = |i: usize| page.get(i).copied().unwrap_or(0);
            if kind.has_value() {
                let value = word(if kind == NodeType::Inner { at + 1 } else { at });
                counts.min = counts.min.min(value);
                counts.max = counts.max.max(value);
            }
            counts.add(kind);
            if !kind.has_children() {
                continue;
            }
            let node = Node::decode(word(at));
            let place = word(at) >> 8 & 0xFF;
            if place > 1 {
                return Err(cx.fault(Rule::MhPlace, at, Value::AtMost(1), number(place)));
            }
            if node.mask.0 == 0 {
                return Err(cx.fault(Rule::MhChildless, at, Value::Text("at least one child"), Value::Number(0)));
            }
            let Some(below) = level.checked_sub(1) else {
                return Err(cx.fault(Rule::MhDepth, at, Value::Text("a leaf at level 0"), Value::Text("children")));
            };
            match node.children {
                Children::Page(child) => {
                    if child >= head.child_refs {
                        let most = Value::Text("an index below the page's child_refs");
                        return Err(cx.fault(Rule::MhReference, at, most, number(child.into())));
                    }
                    if !mark(&mut refs, child.into()) {
                        return Err(cx.fault(
                            Rule::MhReference,
                            at,
                            Value::Text("one reference to a child"),
                            number(child.into()),
                        ));
                    }
                    refs_reached += 1;
                }
                Children::Here(first) => {
                    if usize::from(first) <= at {
                        return Err(cx.fault(Rule::MhOrder, at, Value::AtLeast(at as u64 + 1), number(first.into())));
                    }
                    // Cannot run out: levels fall by one, so at most 4 groups wait for each level.
                    let Some(slot) = waiting.get_mut(count) else {
                        return Err(cx.fault(
                            Rule::MhDepth,
                            at,
                            Value::AtMost(WAITING as u64),
                            Value::Number(count as u64),
                        ));
                    };
                    *slot = (first, node.mask, below);
                    count += 1;
                }
            }
        }
    }
    let unreached = (page.len() as u64).saturating_sub(u64::from(words_reached) + FRAME_WORDS as u64);
    if unreached != 0 {
        return Err(cx.fault(Rule::MhHole, 0, Value::Text("every word in a node"), Value::Number(unreached)));
    }
    if refs_reached != head.child_refs {
        return Err(cx.fault(Rule::MhReference, 0, number(head.child_refs.into()), number(refs_reached.into())));
    }
    Ok(counts)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, clippy::indexing_slicing, clippy::cast_possible_truncation)]
mod tests {
    use super::*;
    use crate::{PageRecord, StructureRecord};

    struct Numbers(u64);

    impl Numbers {
        fn below(&mut self, n: usize) -> usize {
            self.0 = self.0.wrapping_mul(0x5851_F42D_4C95_7F2D).wrapping_add(0x1405_7B7E_F767_814F);
            (self.0 >> 33) as usize % n
        }
    }

    /// A good page: of the groups that wait, any one is placed next; `ordered` takes the last, as the writer does.
    fn page(r: &mut Numbers, level: u8, ordered: bool) -> Vec<u32> {
        let root = mask_at(r, level);
        let (mut words, mut refs) = (vec![0, 0], 0u16);
        let mut waiting: Vec<(u8, u8, Option<usize>)> = vec![(root, level, None)];
        while !waiting.is_empty() {
            let next = if ordered { waiting.len() - 1 } else { r.below(waiting.len()) };
            let (mask, level, above) = waiting.remove(next);
            let start = words.len();
            if let Some(at) = above {
                words[at] = u32::from(mask) | (start as u32) << 16;
            }
            let mut below = Vec::new();
            for c in 0..4 {
                let kind = Mask(mask).child(c);
                let at = words.len();
                words.extend((0..kind.words()).map(|_| r.below(1 << 31) as u32));
                if kind.has_children() && r.below(8) == 0 {
                    words[at] = 1 | 1 << 8 | u32::from(refs) << 16;
                    refs += 1;
                } else if kind.has_children() {
                    below.push((mask_at(r, level - 1), level - 1, Some(at)));
                }
            }
            waiting.extend(below.into_iter().rev());
        }
        let head =
            FrameHead { tag: 1, root_mask: root, child_refs: refs, words: words.len() as u16, root_level: level };
        words[..2].copy_from_slice(&head.encode());
        words
    }

    fn mask_at(r: &mut Numbers, level: u8) -> u8 {
        loop {
            let mask = r.below(256) as u8 & if level == 0 { 0x55 } else { 0xFF };
            if mask != 0 {
                return mask;
            }
        }
    }

    /// Of good pages and of damaged ones: the sweep takes exactly what the walk takes, and counts the same.
    #[test]
    fn both_methods_agree() {
        let mut r = Numbers(7);
        let (record, structure) = (PageRecord::zeroed(), StructureRecord::zeroed());
        let cx = PageContext { structure: 0, ordinal: 1, page: &record, record: &structure };
        let (mut good, mut bad) = (0, 0);
        for i in 0..4000u32 {
            let mut words = page(&mut r, (i % 5) as u8, i % 3 == 0);
            if words.len() > MOST {
                continue;
            }
            for change in 0..20 {
                if change > 0 {
                    let at = 2 + r.below(words.len() - 2);
                    let kept = words[at];
                    words[at] = match r.below(4) {
                        0 => r.below(1 << 32) as u32,
                        1 => kept ^ 1 << r.below(32),
                        2 => words[2 + r.below(words.len() - 2)],
                        _ => kept & 0xFFFF | (r.below(words.len() + 1) as u32) << 16,
                    };
                }
                let head = FrameHead::decode(&words).unwrap();
                let walked = walk(&words, &head, &cx);
                let swept = sweep::<MOST, { MOST / 32 }>(&words, &head);
                assert_eq!(swept, walked.as_ref().ok().copied(), "{i} {change}: {walked:?}");
                assert!(change > 0 || swept.is_some(), "{i}: {walked:?}");
                if words.len() <= 256 {
                    assert_eq!(sweep::<256, 8>(&words, &head), swept);
                }
                *(if swept.is_some() { &mut good } else { &mut bad }) += 1;
            }
        }
        assert!(good > 5000 && bad > 5000, "{good} {bad}");
    }
}
