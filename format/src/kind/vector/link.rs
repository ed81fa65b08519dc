//! What a page says of its child pages, and whether they are so.

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing,
    clippy::cast_possible_truncation
)]

use alloc::boxed::Box;
use alloc::vec::Vec;

use super::eval::{self, Part};
use super::{Child, Group, Header, Layout, Levels, Plane, Square};
use crate::error::{FormatError, Rule};
use crate::kind::mh::Mask;
use crate::kind::tree::check_announced;
use crate::page::{FrameHead, PageContext};

/// An entry that child pages inherit, cut loose from its page: all that its bounds need.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Inherited {
    /// First texel of the footprint of the entry's page; places of the planes count from there.
    origin: (u32, u32),
    /// Range of its constants, or of its raw; the first is above the second where there are none.
    fixed: (u32, u32),
    /// Its planes.
    planes: Box<[Plane]>,
}

impl Inherited {
    /// Entry `number` of a page whose footprint starts at texel `origin` of the finest level.
    pub fn new(page: &[u32], layout: &Layout, number: u32, origin: (u32, u32)) -> Self {
        let mut planes = Vec::new();
        let mut fixed = (u32::MAX, 0);
        eval::parts(page, layout, number, |part| match part {
            Part::Range(low, high) => fixed = (low.min(fixed.0), high.max(fixed.1)),
            Part::Plane(plane) => planes.push(plane),
        });
        Self { origin, fixed, planes: planes.into() }
    }

    /// Bounds over the square of `2^level` texels on a side from texel (x, y) on, which lies in the page's footprint.
    pub fn bounds(&self, x: u32, y: u32, level: u8) -> (u32, u32) {
        let (x, y) = (x.wrapping_sub(self.origin.0), y.wrapping_sub(self.origin.1));
        let square = Square::of_texels(x, y, level);
        self.planes.iter().fold(self.fixed, |(low, high), p| {
            let (least, most) = p.bounds(&square);
            (low.min(least), high.max(most))
        })
    }
}

/// What a page and one of its nodes say about the child page that holds the node's children.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Link {
    /// Root that the page belongs to.
    pub root: u16,
    /// Smallest and largest depth of the page.
    pub depths: (u32, u32),
    /// The entry that holds above the children; none where it is not known.
    pub inherited: Option<Inherited>,
    /// Level of the children.
    pub level: u8,
    /// First texel of the node in x, finest level.
    pub x: u32,
    /// First texel of the node in y.
    pub y: u32,
}

/// Calls `visit` with the place among the child pages and the [`Link`] of every child page that a page refers to, in
/// order; `above` is what holds above the page, none where it is not known or the page is a root's. The page must have
/// passed [`check`](super::check). Time and memory are linear in the words.
pub fn links(
    page: &[u32],
    head: &FrameHead,
    cx: &PageContext<'_>,
    above: Option<&Inherited>,
    mut visit: impl FnMut(u16, Link),
) {
    if head.child_refs == 0 {
        return;
    }
    let (header, layout) = (Header::decode(page), Layout::of(page));
    let origin = (cx.page.origin_x.get(), cx.page.origin_y.get());
    let depths = (cx.page.min_depth.get(), cx.page.max_depth.get());
    let groups = u32::from(header.groups);
    // First texel of each group, and the node whose entry holds above it, in this page.
    let mut above_groups: Vec<(u32, u32, Option<u32>)> = Vec::with_capacity(groups as usize);
    above_groups.push((origin.0, origin.1, None));
    let mut levels = Levels::new(head);
    let mut children = 0;
    let mut stubs = 0u16;
    for number in 0..groups {
        let Some(&(x, y, holds)) = above_groups.get(number as usize) else { return };
        let group = Group::of(page, number);
        let level = levels.of(number, children);
        if group.mask.0 == 0 {
            let own = holds.map(|index| Inherited::new(page, &layout, layout.entry(page, index), origin));
            visit(stubs, Link { root: cx.page.root.get(), depths, inherited: own.or(above.cloned()), level, x, y });
            stubs = stubs.saturating_add(1);
            continue;
        }
        for c in (0..4).filter(|&c| group.mask.child(c).has_children()) {
            children += 1;
            let holds = if group.mask.child(c).has_value() { Some(Child::of(page, number, c).index) } else { holds };
            let x = x.wrapping_add((c & 1) << (level & 31));
            above_groups.push((x, y.wrapping_add((c >> 1) << (level & 31)), holds));
        }
    }
}

/// Checks that a page is the one that its parent's node describes: level, place in the map, root; and that its depths
/// lie within the parent's and hold the bounds of the inherited entry where a lookup in it may answer that.
///
/// With [`check`](super::check) for every page, each answer of a lookup that needs a page lies in the page's depths.
///
/// # Errors
/// `vector.link`, `vector.depths`.
pub fn check_link(link: &Link, head: &FrameHead, cx: &PageContext<'_>) -> Result<(), FormatError> {
    let pairs = [
        (link.level.into(), head.root_level.into()),
        (link.x.into(), cx.page.origin_x.get().into()),
        (link.y.into(), cx.page.origin_y.get().into()),
        (link.root.into(), cx.page.root.get().into()),
    ];
    let inherits = Mask(head.root_mask).inherits();
    let inherited = link.inherited.as_ref().filter(|_| inherits);
    let bounds = inherited.map(|e| e.bounds(link.x, link.y, link.level.saturating_add(1)));
    check_announced(&pairs, link.depths, bounds, cx, [Rule::VectorLink, Rule::VectorDepths])
}
