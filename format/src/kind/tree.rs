//! What the quadtree kinds have in common: a page of any of them is checked, announces its child pages and is held
//! against what its parent announced. A container's writer and its reader both go through here.

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing,
    clippy::cast_possible_truncation
)]

use alloc::boxed::Box;

use super::{Kind, mh, mmh, vector};
use crate::error::{FormatError, Rule, Value};
use crate::page::{FrameHead, PageContext};

/// What a page says of a child page, by its kind.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Link {
    /// Of a page of kind `mh`.
    Mh(mh::Link),
    /// Of a page of kind `mmh`.
    Mmh(mmh::Link),
    /// Of a page of kind `vector`; it holds the planes of what is inherited.
    Vector(Box<vector::Link>),
}

/// Checks the words of a page whose frame has been checked, by the rules of its structure's kind; none where the kind
/// [has no layout](Kind::has_layout).
///
/// # Errors
/// A rule of the kind.
pub fn check(page: &[u32], head: &FrameHead, cx: &PageContext<'_>) -> Option<Result<PageCounts, FormatError>> {
    match cx.record.kind()? {
        Kind::Mh => Some(mh::check(page, head, cx)),
        Kind::Mmh => Some(mmh::check(page, head, cx)),
        Kind::Vector => Some(vector::check(page, head, cx)),
        _ => None,
    }
}

/// Calls `visit` with the place among the child pages and the [`Link`] of every child page that a page refers to. `said`
/// is what the page's own parent said of it, none where it is not known or the page is a root's. The page must have
/// passed [`check`]; for a kind without a layout nothing is said.
pub fn links(
    page: &[u32],
    head: &FrameHead,
    cx: &PageContext<'_>,
    said: Option<&Link>,
    mut visit: impl FnMut(u16, Link),
) {
    match cx.record.kind() {
        Some(Kind::Mh) => {
            let above = if let Some(Link::Mh(link)) = said { link.inherited } else { None };
            mh::links(page, head, cx, above, |child, link| visit(child, Link::Mh(link)));
        }
        Some(Kind::Mmh) => {
            mmh::links(page, head, cx, inherited(said, cx), |child, link| visit(child, Link::Mmh(link)));
        }
        Some(Kind::Vector) => {
            let above = if let Some(Link::Vector(link)) = said { link.inherited.as_ref() } else { None };
            vector::links(page, head, cx, above, |child, link| visit(child, Link::Vector(link.into())));
        }
        _ => {}
    }
}

/// The value above a page of kind `mmh`, of which its parent said this; none where it is not known.
pub fn inherited(said: Option<&Link>, cx: &PageContext<'_>) -> Option<u32> {
    match said {
        Some(Link::Mmh(link)) => link.inherited,
        // Above a root node lies 0.
        _ => cx.is_root().then_some(0),
    }
}

/// Holds a checked page against what its parent said of it.
///
/// # Errors
/// The rules of the kind about links, depths and, in `mmh`, values.
pub fn check_link(link: &Link, page: &[u32], head: &FrameHead, cx: &PageContext<'_>) -> Result<(), FormatError> {
    match link {
        Link::Mh(link) => mh::check_link(link, head, cx),
        Link::Mmh(link) => mmh::check_link(link, page, head, cx),
        Link::Vector(link) => vector::check_link(link, head, cx),
    }
}

/// What a page holds, counted by the check of its kind.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PageCounts {
    /// Leaf nodes.
    pub leaves: u32,
    /// Inner nodes.
    pub inner: u32,
    /// Empty nodes.
    pub empty: u32,
    /// Smallest value; `u32::MAX` where there is none. In `vector` the smallest of the bounds of entries.
    pub min: u32,
    /// Largest value, alike; 0 where there is none.
    pub max: u32,
    /// Finest level of a node.
    pub level_finest: u8,
}

impl PageCounts {
    /// Adds a node of a type.
    #[inline]
    pub(super) const fn add(&mut self, kind: mh::NodeType) {
        match kind {
            mh::NodeType::None => {}
            mh::NodeType::Leaf => self.leaves += 1,
            mh::NodeType::Inner => self.inner += 1,
            mh::NodeType::Empty => self.empty += 1,
        }
    }

    /// Holds the values against the page's record.
    pub(super) fn check_values(&self, cx: &PageContext<'_>, rule: Rule) -> Result<(), FormatError> {
        let (min, max) = (cx.page.min_depth.get(), cx.page.max_depth.get());
        let valued = self.leaves + self.inner != 0;
        if valued && (self.min < min || self.max > max) {
            let out = if self.min < min { self.min } else { self.max };
            return Err(cx.fault(rule, 0, Value::Between(min.into(), max.into()), Value::Number(out.into())));
        }
        Ok(())
    }
}

/// What the quadtree kinds ask of a page before they look at its nodes: form, root group, footprint, in this order;
/// `rules` are those of the kind.
pub(super) fn check_place(head: &FrameHead, cx: &PageContext<'_>, rules: [Rule; 3]) -> Result<(), FormatError> {
    let [plain, root, footprint] = rules;
    if cx.page.is_flat() || cx.page.is_shared() || cx.page.dep_count.get() != 0 {
        let found = Value::Text("a flat or shared page, or dependencies");
        return Err(cx.fault(plain, 0, Value::Text("a page of the tree"), found));
    }
    check_root(head, cx, [root, footprint])
}

/// The part of [`check_place`] about root group and footprint.
pub(super) fn check_root(head: &FrameHead, cx: &PageContext<'_>, rules: [Rule; 2]) -> Result<(), FormatError> {
    let [root, footprint] = rules;
    let found = Value::Hex(head.root_mask.into());
    if cx.is_root() {
        let full = head.root_mask == mh::NodeType::Leaf as u8 || head.root_mask == mh::NodeType::Inner as u8;
        if !full || head.root_level != cx.record.log2_resolution {
            return Err(cx.fault(root, 0, Value::Text("one leaf or inner node of the whole map"), found));
        }
    } else if head.root_mask == 0 || head.root_level >= cx.record.log2_resolution {
        return Err(cx.fault(root, 0, Value::Text("a group of nodes below the root"), found));
    }
    // A root group spans twice its nodes' side; the root node is the whole map.
    let side = if cx.is_root() { head.root_level } else { head.root_level.saturating_add(1) };
    if (cx.page.log2_x, cx.page.log2_y, cx.page.log2_l, cx.page.origin_l.get()) != (side, side, 0, 0) {
        let (expected, found) = (Value::Number(side.into()), Value::Number(cx.page.log2_x.into()));
        return Err(cx.fault(footprint, 1, expected, found));
    }
    Ok(())
}

/// Holds a child page against what its parent says: level, first texel, root; then its depths against the parent's, and
/// against the bounds of what it inherits, where a lookup may answer that. `rules` are the kind's for both.
pub(super) fn check_announced(
    pairs: &[(u64, u64)],
    depths: (u32, u32),
    inherited: Option<(u32, u32)>,
    cx: &PageContext<'_>,
    rules: [Rule; 2],
) -> Result<(), FormatError> {
    let [link, within] = rules;
    if let Some((expected, found)) = pairs.iter().find(|(expected, found)| expected != found) {
        return Err(cx.fault(link, 0, Value::Number(*expected), Value::Number(*found)));
    }
    let (min, max) = (cx.page.min_depth.get(), cx.page.max_depth.get());
    let (lowest, highest) = depths;
    if min < lowest || max > highest {
        let (expected, out) = (Value::Between(lowest.into(), highest.into()), if min < lowest { min } else { max });
        return Err(cx.fault(within, 0, expected, Value::Number(out.into())));
    }
    match inherited.filter(|(low, high)| *low < min || *high > max) {
        None => Ok(()),
        Some((low, high)) => {
            let out = if low < min { low } else { high };
            Err(cx.fault(within, 0, Value::Between(min.into(), max.into()), Value::Number(out.into())))
        }
    }
}
