//! What pages say of each other: of child pages, and of groups in shared pages.

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing,
    clippy::cast_possible_truncation
)]

use alloc::collections::BTreeMap;

use super::super::mh::{NodeType, ROOT_GROUP};
use super::super::tree::check_announced;
use super::check::check_values;
use super::{Announced, Children, Mask, Node, Waiting, entry, first_group, nodes};
use crate::error::{FormatError, Rule, Value};
use crate::page::{FrameHead, PageContext};

pub use super::super::mh::Link;

/// What a walk over the groups with one place in the map meets.
pub(super) enum Visit {
    /// A node with a value, its word, and that value.
    Value(NodeType, u32, u32),
    /// A child page and what is said of it.
    Page(u16, Link),
    /// A group in a shared page: the dependency, its first word, its types and its nodes' level.
    Shared(u8, u16, Mask, u8),
}

/// Walks over a page from front to back. Values and child pages come from groups with one place in the map; groups in
/// shared pages from all. `inherited` is the value above the page, none where it is not known: then no values come. The
/// page must have passed [`check`](super::check).
pub(super) fn walk(
    page: &[u32],
    head: &FrameHead,
    cx: &PageContext<'_>,
    inherited: Option<u32>,
    mut visit: impl FnMut(Visit),
) {
    let top = Link {
        root: cx.page.root.get(),
        depths: (cx.page.min_depth.get(), cx.page.max_depth.get()),
        inherited,
        mask: Mask(head.root_mask),
        level: head.root_level,
        x: cx.page.origin_x.get(),
        y: cx.page.origin_y.get(),
    };
    let mut waiting = Waiting::new();
    // Where the groups lie that are alone.
    let mut places = BTreeMap::from([(u32::from(ROOT_GROUP), top)]);
    waiting.announce(ROOT_GROUP.into(), Announced { mask: top.mask, level: top.level, alone: true });
    let length = u32::try_from(page.len()).unwrap_or(u32::MAX);
    let mut at = u32::from(ROOT_GROUP);
    while at < length {
        let Some(group) = waiting.get(at).filter(|g| g.mask.0 != 0) else { return };
        let place = places.remove(&at).filter(|_| group.alone);
        for (c, kind, word) in nodes(group.mask, at) {
            let first = page.get(word as usize).copied().unwrap_or(0);
            let above = place.and_then(|p| p.inherited);
            let value = above.filter(|_| kind.has_value()).map(|above| {
                let rise =
                    if kind == NodeType::Leaf { first } else { page.get(word as usize + 1).copied().unwrap_or(0) };
                above.wrapping_add(rise)
            });
            if let Some(value) = value {
                visit(Visit::Value(kind, word, value));
            }
            let Some(level) = group.level.checked_sub(1).filter(|_| kind.has_children()) else { continue };
            let node = Node::decode(first);
            let link = place.map(|p| Link {
                inherited: if kind.has_value() { value } else { p.inherited },
                mask: node.mask,
                level,
                x: p.x.wrapping_add((c & 1) << (p.level & 31)),
                y: p.y.wrapping_add((c >> 1) << (p.level & 31)),
                ..p
            });
            match (node.children, link) {
                (Children::Here(to), link) => {
                    let below = Announced { mask: node.mask, level, alone: link.is_some() };
                    match (waiting.announce(to.into(), below), link) {
                        (Some(true), Some(link)) => places.insert(to.into(), link),
                        _ => places.remove(&to.into()),
                    };
                }
                (Children::Page(child), Some(link)) => visit(Visit::Page(child, link)),
                (Children::Page(_), None) => {}
                (Children::Shared(dependency, to), _) => visit(Visit::Shared(dependency, to, node.mask, level)),
            }
        }
        at = at.saturating_add(group.mask.words());
    }
}

/// Calls `visit` with the index and the [`Link`] of every child page that a page refers to; `inherited` is the value
/// that holds above the page, 0 above a root's, none where it is not known. The page must have passed
/// [`check`](super::check).
pub fn links(
    page: &[u32],
    head: &FrameHead,
    cx: &PageContext<'_>,
    inherited: Option<u32>,
    mut visit: impl FnMut(u16, Link),
) {
    if cx.page.is_shared() {
        return;
    }
    walk(page, head, cx, inherited, |v| {
        if let Visit::Page(child, link) = v {
            visit(child, link);
        }
    });
}

/// Checks that a page is the one that its parent's node describes: types, level, place in the map, root; that its depths
/// lie within the parent's and hold the inherited value where a lookup in it may answer that; and that values of nodes
/// with one place in the map lie in them.
///
/// # Errors
/// `mmh.link`, `mmh.depths`, `mmh.values`.
pub fn check_link(link: &Link, page: &[u32], head: &FrameHead, cx: &PageContext<'_>) -> Result<(), FormatError> {
    let pairs = [
        (u64::from(link.mask.0), u64::from(head.root_mask)),
        (link.level.into(), head.root_level.into()),
        (link.x.into(), cx.page.origin_x.get().into()),
        (link.y.into(), cx.page.origin_y.get().into()),
        (link.root.into(), cx.page.root.get().into()),
    ];
    let inherited = link.inherited.filter(|_| link.mask.inherits()).map(|v| (v, v));
    check_announced(&pairs, link.depths, inherited, cx, [Rule::MmhLink, Rule::MmhDepths])?;
    link.inherited.map_or(Ok(()), |v| check_values(page, head, cx, v))
}

/// Calls `visit` for every group of a shared page with its first word, its types and its height: how many levels of
/// groups it has, itself included. The page must have passed [`check`](super::check).
pub fn shared_groups(page: &[u32], mut visit: impl FnMut(u16, Mask, u8)) {
    let length = u32::try_from(page.len()).unwrap_or(u32::MAX);
    let mut waiting = Waiting::new();
    let mut starts = alloc::vec::Vec::new();
    let (mut at, mut taken) = (first_group(page, true), 0);
    while at < length {
        let mask = match waiting.get(at) {
            Some(group) => group.mask,
            None => {
                taken += 1;
                entry(page, taken - 1)
            }
        };
        if mask.0 == 0 {
            return;
        }
        starts.push((at, mask));
        for (_, kind, word) in nodes(mask, at).filter(|n| n.1.has_children()) {
            let node = Node::decode(page.get(word as usize).copied().unwrap_or(0));
            if let (Children::Here(to), true) = (node.children, kind.has_children()) {
                waiting.announce(to.into(), Announced { mask: node.mask, level: 0, alone: false });
            }
        }
        at = at.saturating_add(mask.words());
    }
    // Children lie behind their nodes, so from the back their heights are known.
    let mut heights = BTreeMap::new();
    for (at, mask) in starts.into_iter().rev() {
        let below = nodes(mask, at).filter(|n| n.1.has_children()).map(|(_, _, word)| {
            match Node::decode(page.get(word as usize).copied().unwrap_or(0)).children {
                Children::Here(to) => heights.get(&u32::from(to)).copied().unwrap_or(0u8),
                _ => 0,
            }
        });
        let height = below.max().unwrap_or(0).saturating_add(1);
        heights.insert(at, height);
        visit(u16::try_from(at).unwrap_or(u16::MAX), mask, height);
    }
}

/// What tree pages say of groups in shared pages, until those pages come.
#[derive(Clone, Debug, Default)]
pub struct References {
    /// By ordinal and first word: types, and the lowest level of the group's nodes.
    groups: BTreeMap<(u32, u16), (Mask, u8)>,
    /// References to one group that give it different types: the first such, by the group.
    torn: BTreeMap<(u32, u16), Mask>,
}

impl References {
    /// Notes what a checked tree page refers to; `dependencies` are its ordinals.
    pub fn note(&mut self, page: &[u32], head: &FrameHead, cx: &PageContext<'_>, dependencies: &[u32]) {
        if cx.page.is_shared() || dependencies.is_empty() {
            return;
        }
        walk(page, head, cx, None, |v| {
            let Visit::Shared(dependency, at, mask, level) = v else { return };
            let Some(&ordinal) = dependencies.get(usize::from(dependency)) else { return };
            let known = self.groups.entry((ordinal, at)).or_insert((mask, level));
            known.1 = known.1.min(level);
            if known.0 != mask {
                self.torn.entry((ordinal, at)).or_insert(mask);
            }
        });
    }

    /// Holds a checked shared page against all that was noted of it, and forgets that.
    ///
    /// # Errors
    /// `mmh.link`: a node refers to a word where no group of its types begins; or to one with more levels than there are
    /// below the node.
    pub fn check(&mut self, page: &[u32], cx: &PageContext<'_>) -> Result<(), FormatError> {
        let first = (cx.ordinal, 0);
        let later = self.groups.split_off(&(cx.ordinal.saturating_add(1), 0));
        let mut here = core::mem::replace(&mut self.groups, later);
        let mut here = here.split_off(&first);
        let torn = self.torn.range((cx.ordinal, 0)..=(cx.ordinal, u16::MAX)).next().map(|t| (*t.0, *t.1));
        if let Some(((_, at), mask)) = torn {
            let expected = Value::Text("the types that another node gives the group");
            return Err(cx.fault(Rule::MmhLink, at.into(), expected, Value::Hex(mask.0.into())));
        }
        let mut result = Ok(());
        shared_groups(page, |at, mask, height| {
            let Some((said, level)) = here.remove(&(cx.ordinal, at)) else { return };
            // A group at level l has room for l + 1 levels.
            if (said != mask || height > level.saturating_add(1)) && result.is_ok() {
                let expected = Value::Text("the group that a node refers to, with levels for all that is below it");
                result = Err(cx.fault(Rule::MmhLink, at.into(), expected, Value::Hex(said.0.into())));
            }
        });
        result?;
        match here.keys().next() {
            None => Ok(()),
            Some(&(_, at)) => {
                let expected = Value::Text("a group where a node refers to one");
                Err(cx.fault(Rule::MmhLink, at.into(), expected, Value::Number(at.into())))
            }
        }
    }
}
