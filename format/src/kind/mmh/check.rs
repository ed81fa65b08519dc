//! The check of a page's words: one pass from front to back.

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing,
    clippy::cast_possible_truncation
)]

use super::super::mh::{PageCounts, ROOT_GROUP};
use super::super::tree::check_root;
use super::link::{Visit, out_of_room};
use super::{
    Announced, Children, ENTRIES, MAX_DEPENDENCIES, MAX_WORDS, Mask, Node, Waiting, entry, entry_words, first_group,
    nodes,
};
use crate::error::{FormatError, Rule, Value};
use crate::page::{FrameHead, PageContext};

/// One bit for each child page, or each dependency.
type Marks = [u32; MAX_WORDS as usize / 32];

/// Checks the words of a page whose frame has been checked: every word in exactly one group, children behind their
/// nodes, every child page referred to exactly once and from a group with one place in the map, every dependency used, no
/// children below level 0. Time and memory are linear in the words.
///
/// # Errors
/// `mmh.*`; the offset is that of the node's word.
pub fn check(page: &[u32], head: &FrameHead, cx: &PageContext<'_>) -> Result<PageCounts, FormatError> {
    let number = |v: u32| Value::Number(v.into());
    check_place(page, head, cx)?;
    let shared = cx.page.is_shared();
    let entries = if shared { check_entries(page, cx)? } else { 0 };
    let length = u32::try_from(page.len()).unwrap_or(u32::MAX);
    let mut counts = PageCounts { min: u32::MAX, level_finest: head.root_level, ..PageCounts::default() };
    let (mut children, mut dependencies): (Marks, Marks) = ([0; MAX_WORDS as usize / 32], [0; MAX_WORDS as usize / 32]);
    let (mut pages_reached, mut dependencies_reached) = (0u32, 0u32);
    let mut waiting = Waiting::new();
    let (mut announced, mut visited, mut taken) = (0u32, 0u32, 0u32);
    if !shared {
        let root = Announced { mask: Mask(head.root_mask), level: head.root_level, alone: true };
        announced += u32::from(waiting.announce(ROOT_GROUP.into(), root).unwrap_or(false));
    }
    let mut at = first_group(page, shared);
    while at < length {
        let group = match waiting.get(at) {
            Some(group) => group,
            None if taken < entries => {
                let level = cx.record.log2_resolution;
                let group = Announced { mask: entry(page, taken), level, alone: false };
                (taken, announced) = (taken + 1, announced + 1);
                group
            }
            None => {
                return Err(cx.fault(
                    Rule::MmhHole,
                    at as usize,
                    Value::Text("a group that a node refers to"),
                    number(at),
                ));
            }
        };
        visited += 1;
        let end = at + group.mask.words();
        if end > length {
            return Err(cx.fault(Rule::MmhBounds, at as usize, Value::AtMost(length.into()), number(end)));
        }
        if !shared {
            counts.level_finest = counts.level_finest.min(group.level);
        }
        for (_, kind, word) in nodes(group.mask, at) {
            counts.add(kind);
            if !kind.has_children() {
                continue;
            }
            let i = word as usize;
            let node = Node::decode(page.get(i).copied().unwrap_or(0));
            if node.mask.0 == 0 {
                return Err(cx.fault(Rule::MmhChildless, i, Value::Text("at least one child"), number(0)));
            }
            let Some(level) = group.level.checked_sub(1) else {
                return Err(cx.fault(Rule::MmhDepth, i, Value::Text("a leaf at level 0"), Value::Text("children")));
            };
            match node.children {
                Children::Here(first) if u32::from(first) <= word => {
                    let expected = Value::AtLeast(u64::from(word) + 1);
                    return Err(cx.fault(Rule::MmhOrder, i, expected, Value::Number(first.into())));
                }
                Children::Here(first) if u32::from(first) >= length => {
                    let expected = Value::AtMost(u64::from(length) - 1);
                    return Err(cx.fault(Rule::MmhBounds, i, expected, Value::Number(first.into())));
                }
                Children::Here(first) => {
                    let below = Announced { mask: node.mask, level, alone: group.alone };
                    let Some(fresh) = waiting.announce(first.into(), below) else {
                        let expected = Value::Text("the types that another node gives the group");
                        return Err(cx.fault(Rule::MmhOverlap, i, expected, Value::Hex(node.mask.0.into())));
                    };
                    announced += u32::from(fresh);
                }
                Children::Page(child) => {
                    let allowed = group.alone && child < head.child_refs;
                    if !allowed || !mark(&mut children, child.into()) {
                        let expected = Value::Text("one reference to each child page, from one place in the map");
                        return Err(cx.fault(Rule::MmhReference, i, expected, Value::Number(child.into())));
                    }
                    pages_reached += 1;
                }
                Children::Shared(dependency, _) => {
                    if u16::from(dependency) >= cx.page.dep_count.get() {
                        let expected = Value::Text("a dependency of the page");
                        return Err(cx.fault(Rule::MmhDependency, i, expected, Value::Number(dependency.into())));
                    }
                    dependencies_reached += u32::from(mark(&mut dependencies, dependency.into()));
                }
            }
        }
        at = end;
    }
    if announced != visited {
        return Err(cx.fault(Rule::MmhOverlap, 0, number(announced), number(visited)));
    }
    if taken != entries {
        return Err(cx.fault(Rule::MmhEntries, ENTRIES, number(taken), number(entries)));
    }
    for (rule, expected, found) in [
        (Rule::MmhReference, u32::from(head.child_refs), pages_reached),
        (Rule::MmhDependency, u32::from(cx.page.dep_count.get()), dependencies_reached),
        (Rule::MmhLevels, u32::from(cx.page.level_finest), u32::from(counts.level_finest)),
    ] {
        if expected != found {
            return Err(cx.fault(rule, 0, number(expected), number(found)));
        }
    }
    if cx.is_root() {
        check_values(page, head, cx, 0)?;
    }
    Ok(counts)
}

/// What is asked of a page before its nodes.
fn check_place(page: &[u32], head: &FrameHead, cx: &PageContext<'_>) -> Result<(), FormatError> {
    let (dependencies, shared) = (cx.page.dep_count.get(), cx.page.is_shared());
    let most = if shared { 0 } else { MAX_DEPENDENCIES };
    if cx.page.is_flat() || dependencies > most {
        let expected = Value::Text("a tree page of at most 254 dependencies, a shared one of none");
        return Err(cx.fault(Rule::MmhPlain, 0, expected, Value::Number(dependencies.into())));
    }
    let all = page.len() as u64 + u64::from(dependencies);
    if all > MAX_WORDS.into() {
        return Err(cx.fault(Rule::MmhPlain, 0, Value::AtMost(MAX_WORDS.into()), Value::Number(all)));
    }
    if !shared {
        return check_root(head, cx, [Rule::MmhRoot, Rule::MmhFootprint]);
    }
    if head.root_mask != 0 || head.root_level != 0 {
        let (expected, found) = (Value::Text("no root group"), Value::Hex(head.root_mask.into()));
        return Err(cx.fault(Rule::MmhRoot, 0, expected, found));
    }
    Ok(())
}

/// The table of entries of a shared page; gives their number.
fn check_entries(page: &[u32], cx: &PageContext<'_>) -> Result<u32, FormatError> {
    let entries = page.get(ENTRIES).copied().unwrap_or(0);
    let room = page.len().saturating_sub(ENTRIES);
    let words = entry_words(entries.min(MAX_WORDS)) as usize;
    if entries == 0 || entries > MAX_WORDS || words > room {
        let expected = Value::Text("at least one entry, and room for all");
        return Err(cx.fault(Rule::MmhEntries, ENTRIES, expected, Value::Number(entries.into())));
    }
    let unused = entries..entries.next_multiple_of(4);
    if (0..entries).any(|i| entry(page, i).0 == 0) || unused.clone().any(|i| entry(page, i).0 != 0) {
        let expected = Value::Text("types for every entry, zero bits behind them");
        return Err(cx.fault(Rule::MmhEntries, ENTRIES, expected, Value::Text("others")));
    }
    Ok(entries)
}

/// Marks one bit; `false` where it was marked before or lies outside.
fn mark(map: &mut Marks, bit: u32) -> bool {
    let Some(word) = map.get_mut((bit / 32) as usize) else { return false };
    let fresh = *word >> (bit % 32) & 1 == 0;
    *word |= 1 << (bit % 32);
    fresh
}

/// Holds the values of a page's nodes against its record; `inherited` is the value above the page, 0 for a root's. Rises of
/// groups with several places count as signed, and must do for every way there. Groups in shared pages are left to
/// [`References`](super::References). The page must have passed [`check`].
///
/// # Errors
/// `mmh.values`.
pub fn check_values(page: &[u32], head: &FrameHead, cx: &PageContext<'_>, inherited: u32) -> Result<(), FormatError> {
    let (min, max) = (cx.page.min_depth.get(), cx.page.max_depth.get());
    let mut result = Ok(());
    super::link::walk(page, head, cx, Some(inherited), |visit| match visit {
        Visit::Value(word, value) if !(min..=max).contains(&value) && result.is_ok() => {
            let expected = Value::Between(min.into(), max.into());
            result = Err(cx.fault(Rule::MmhValues, word as usize, expected, Value::Number(value.into())));
        }
        Visit::Rise(word, rise, room) if !room.holds(rise) && result.is_ok() => {
            result = Err(out_of_room(cx, word, rise));
        }
        _ => {}
    });
    result
}
