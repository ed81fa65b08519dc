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
    /// A node with one place in the map and a value: its word, and that value.
    Value(u32, u32),
    /// A node with several places: its word, its rise, and the rises that are within bounds.
    Rise(u32, i64, Room),
    /// A child page and what is said of it.
    Page(u16, Link),
    /// A group in a shared page: the dependency, its first word, its types, its nodes' level, and the rises that are
    /// within bounds, where they are known.
    Shared(u8, u16, Mask, u8, Option<Room>),
}

/// What the sums of rises in a group may be, from the value above it on, so that every value on every way there lies in
/// the depths of the pages it belongs to. Rises of groups with several places count as signed numbers here.
#[derive(Clone, Copy, Debug)]
pub(super) struct Room {
    least: i64,
    most: i64,
}

impl Room {
    /// Room above a value in these depths.
    fn around(value: u32, (min, max): (u32, u32)) -> Self {
        let value = i64::from(value);
        Self { least: i64::from(min) - value, most: i64::from(max) - value }
    }

    /// What is left behind a rise. At most 25 rises of 32 bits follow each other: nothing saturates.
    fn behind(self, rise: i64) -> Self {
        Self { least: self.least.saturating_sub(rise), most: self.most.saturating_sub(rise) }
    }

    fn and(self, o: Self) -> Self {
        Self { least: self.least.max(o.least), most: self.most.min(o.most) }
    }

    pub(super) fn holds(self, rise: i64) -> bool {
        (self.least..=self.most).contains(&rise)
    }
}

/// The rise of a node that has one.
fn rise(page: &[u32], kind: NodeType, word: u32) -> Option<u32> {
    let at = word as usize + usize::from(kind == NodeType::Inner);
    kind.has_value().then(|| page.get(at).copied().unwrap_or(0))
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
    // Where the groups lie that are alone, and the room of all.
    let mut places = BTreeMap::from([(u32::from(ROOT_GROUP), top)]);
    let mut rooms: BTreeMap<u32, Option<Room>> = BTreeMap::new();
    waiting.announce(ROOT_GROUP.into(), Announced { mask: top.mask, level: top.level, alone: true });
    let length = u32::try_from(page.len()).unwrap_or(u32::MAX);
    let mut at = u32::from(ROOT_GROUP);
    while at < length {
        let Some(group) = waiting.get(at).filter(|g| g.mask.0 != 0) else { return };
        let place = places.remove(&at).filter(|_| group.alone);
        let room = rooms.remove(&at).flatten();
        for (c, kind, word) in nodes(group.mask, at) {
            let first = page.get(word as usize).copied().unwrap_or(0);
            let above = place.and_then(|p| p.inherited);
            let own = rise(page, kind, word);
            let value = above.zip(own).map(|(above, rise)| above.wrapping_add(rise));
            let signed = own.map_or(0, |rise| i64::from(rise.cast_signed()));
            match (place, value, room) {
                (Some(_), Some(value), _) => visit(Visit::Value(word, value)),
                (None, _, Some(room)) if own.is_some() => visit(Visit::Rise(word, signed, room)),
                _ => {}
            }
            let below_room = match place {
                Some(_) => value.or(above).map(|value| Room::around(value, top.depths)),
                None => room.map(|room| room.behind(signed)),
            };
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
                    rooms
                        .entry(to.into())
                        .and_modify(|r| *r = r.zip(below_room).map(|(a, b)| a.and(b)))
                        .or_insert(below_room);
                    match (waiting.announce(to.into(), below), link) {
                        (Some(true), Some(link)) => places.insert(to.into(), link),
                        _ => places.remove(&to.into()),
                    };
                }
                (Children::Page(child), Some(link)) => visit(Visit::Page(child, link)),
                (Children::Page(_), None) => {}
                (Children::Shared(dependency, to), _) => {
                    visit(Visit::Shared(dependency, to, node.mask, level, below_room));
                }
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

/// What nodes say of a group in a shared page: its types, the lowest level of its nodes, and the room for its rises as far
/// as it is known.
#[derive(Clone, Copy, Debug)]
struct Said {
    mask: Mask,
    level: u8,
    room: Option<Room>,
}

/// What tree pages say of groups in shared pages, until those pages come.
#[derive(Clone, Debug, Default)]
pub struct References {
    /// By ordinal and first word.
    groups: BTreeMap<(u32, u16), Said>,
    /// References to one group that give it different types: the first such, by the group.
    torn: BTreeMap<(u32, u16), Mask>,
}

impl References {
    /// Notes what a checked tree page refers to; `dependencies` are its ordinals, `inherited` is the value above the page,
    /// none where it is not known.
    pub fn note(
        &mut self,
        page: &[u32],
        head: &FrameHead,
        cx: &PageContext<'_>,
        dependencies: &[u32],
        inherited: Option<u32>,
    ) {
        if cx.page.is_shared() || dependencies.is_empty() {
            return;
        }
        walk(page, head, cx, inherited, |v| {
            let Visit::Shared(dependency, at, mask, level, room) = v else { return };
            let Some(&ordinal) = dependencies.get(usize::from(dependency)) else { return };
            let known = self.groups.entry((ordinal, at)).or_insert(Said { mask, level, room });
            known.level = known.level.min(level);
            // What one page does not know does not free the others.
            known.room = match (known.room, room) {
                (Some(a), Some(b)) => Some(a.and(b)),
                (a, b) => a.or(b),
            };
            if known.mask != mask {
                self.torn.entry((ordinal, at)).or_insert(mask);
            }
        });
    }

    /// Holds a checked shared page against all that was noted of it, and forgets that.
    ///
    /// # Errors
    /// `mmh.link`: a node refers to a word where no group of its types begins; or to one with more levels than there are
    /// below the node. `mmh.values`: on some way a value leaves the depths of the pages there.
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
        let mut rooms = BTreeMap::new();
        shared_groups(page, |at, mask, height| {
            let Some(said) = here.remove(&(cx.ordinal, at)) else { return };
            if let Some(room) = said.room {
                rooms.insert(u32::from(at), room);
            }
            // A group at level l has room for l + 1 levels.
            if (said.mask != mask || height > said.level.saturating_add(1)) && result.is_ok() {
                let expected = Value::Text("the group that a node refers to, with levels for all that is below it");
                result = Err(cx.fault(Rule::MmhLink, at.into(), expected, Value::Hex(said.mask.0.into())));
            }
        });
        result?;
        match here.keys().next() {
            None => check_rises(page, cx, rooms),
            Some(&(_, at)) => {
                let expected = Value::Text("a group where a node refers to one");
                Err(cx.fault(Rule::MmhLink, at.into(), expected, Value::Number(at.into())))
            }
        }
    }
}

/// Holds the rises of a checked shared page against the room that nodes elsewhere leave to its groups.
fn check_rises(page: &[u32], cx: &PageContext<'_>, mut rooms: BTreeMap<u32, Room>) -> Result<(), FormatError> {
    let mut groups = alloc::vec::Vec::new();
    shared_groups(page, |at, mask, _| groups.push((at, mask)));
    // They come from the back; nodes lie before the groups they refer to.
    for (at, mask) in groups.into_iter().rev() {
        let Some(room) = rooms.remove(&u32::from(at)) else { continue };
        for (_, kind, word) in nodes(mask, at.into()) {
            let signed = rise(page, kind, word).map(|r| i64::from(r.cast_signed()));
            if let Some(rise) = signed.filter(|r| !room.holds(*r)) {
                return Err(out_of_room(cx, word, rise));
            }
            let first = page.get(word as usize).copied().unwrap_or(0);
            if let (true, Children::Here(to)) = (kind.has_children(), Node::decode(first).children) {
                let below = room.behind(signed.unwrap_or(0));
                rooms.entry(to.into()).and_modify(|r| *r = r.and(below)).or_insert(below);
            }
        }
    }
    Ok(())
}

/// A rise that leads out of the depths of a page on some way to it.
pub(super) fn out_of_room(cx: &PageContext<'_>, word: u32, rise: i64) -> FormatError {
    let expected = Value::Text("a rise that stays in the depths of every page that leads to it");
    let found = Value::Hex(rise.cast_unsigned() & 0xFFFF_FFFF);
    cx.fault(Rule::MmhValues, word as usize, expected, found)
}
