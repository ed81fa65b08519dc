//! From checked pages to nodes that point at their children and entries that are decoded.

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing,
    clippy::cast_possible_truncation
)]

use umbrage_format::kind::vector::entry::PLANE_MAX;
use umbrage_format::kind::vector::{Group, Header, Layout, eval};
use umbrage_format::projection::UNCOVERED;

use super::{Entry, LEAF, PROVEN, Tree};

/// A page in the array of all.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::query) struct Page {
    /// First word.
    pub first: u32,
    /// First child page.
    pub first_child: u32,
    /// First texel of its footprint.
    pub origin: (u32, u32),
}

/// Where something hangs: the node whose children it is, and what answers there from above.
#[derive(Clone, Copy, Debug)]
struct Link {
    /// Place in `nodes`; [`NOWHERE`] for the root's group.
    node: u32,
    holds: u32,
}

/// No place.
const NOWHERE: u32 = u32::MAX;

/// Words that the tree takes for a page.
pub(in crate::query) fn words_held(page: &[u32]) -> u64 {
    let h = Header::decode(page);
    // The grid's finest level has at most as many as the groups have children, those above a third of that.
    u64::from(h.groups) * 11 + u64::from(h.palette()) * (size_of::<Entry>() / 4) as u64 + u64::from(h.raws) * 16
}

/// A length as a number; all arrays are held to 32 bits by their words.
fn count<T>(list: &[T]) -> u32 {
    u32::try_from(list.len()).unwrap_or(u32::MAX)
}

impl Tree {
    /// From the pages, those of other roots than the first being left out. Links are checked: each page hangs at one
    /// node, in a page before it.
    pub(in crate::query) fn new(words: &[u32], pages: &[Page], log2_resolution: u8) -> Self {
        let mut tree = Self {
            nodes: Vec::new(),
            holds: Vec::new(),
            grid: Vec::new(),
            grid_level: log2_resolution,
            log2_resolution,
            // What a walk finds that finds nothing.
            entries: vec![Entry::constant(UNCOVERED)],
            raws: Vec::new(),
        };
        let mut links: Vec<Option<Link>> = vec![None; pages.len()];
        if let Some(root) = links.first_mut() {
            *root = Some(Link { node: NOWHERE, holds: 0 });
        }
        for (ordinal, page) in pages.iter().enumerate() {
            let Some(link) = links.get(ordinal).copied().flatten() else { continue };
            let own = words.get(page.first as usize..).unwrap_or_default();
            tree.add(own, page, link, |place, link| {
                let child = page.first_child.wrapping_add(place) as usize;
                if let Some(slot) = links.get_mut(child) {
                    *slot = Some(link);
                }
            });
        }
        tree.build_grid();
        tree
    }

    /// Adds a page; calls `stub` with every child page's place and where it hangs.
    fn add(&mut self, page: &[u32], place: &Page, above: Link, mut stub: impl FnMut(u32, Link)) {
        let (header, layout) = (Header::decode(page), Layout::of(page));
        let base = count(&self.entries);
        self.add_entries(page, &header, &layout, base, place.origin);
        let mut links = vec![above];
        let (mut index, mut stubs) = (0, 0);
        for number in 0..u32::from(header.groups) {
            let Some(&link) = links.get(number as usize) else { return };
            let mask = Group::of(page, number).mask;
            if mask.0 == 0 && number != 0 {
                stub(stubs, link);
                stubs += 1;
                continue;
            }
            let group = count(&self.holds);
            if let Some(node) = self.nodes.get_mut(link.node as usize) {
                *node = group;
            }
            self.holds.push(link.holds);
            for c in 0..4 {
                let kind = mask.child(c);
                let mut holds = link.holds;
                if kind.has_value() {
                    let proven = if layout.proven(page, index) { PROVEN } else { 0 };
                    holds = base.wrapping_add(layout.entry(page, index)) | proven;
                    index += 1;
                }
                if kind.has_children() {
                    links.push(Link { node: count(&self.nodes), holds });
                }
                self.nodes.push(LEAF | holds);
            }
        }
    }

    /// Decodes the palette of a page; its first entry gets number `base`.
    fn add_entries(&mut self, page: &[u32], header: &Header, layout: &Layout, base: u32, origin: (u32, u32)) {
        let (x, y) = (i64::from(origin.0) << 8, i64::from(origin.1) << 8);
        let low = |v: u32| v.to_le_bytes()[0] & 3;
        let from = (low(origin.0), low(origin.1));
        let most = u32::try_from(PLANE_MAX).unwrap_or(UNCOVERED);
        for number in 0..header.palette() {
            let entry = if number < layout.first_plane.into() {
                // A constant is the same everywhere.
                Entry::constant(eval::value(page, layout, number, 0, 0))
            } else if number < layout.first_split.into() {
                let p = eval::plane(page, layout, number);
                let k = i64::from(p.gx).wrapping_mul(x).wrapping_add(i64::from(p.gy).wrapping_mul(y));
                Entry::Plane { offset: p.offset, k, gx: p.gx, gy: p.gy, most, shift: p.shift }
            } else if number < layout.first_mask.into() {
                let s = eval::split(page, layout, number);
                let l = eval::line(page, layout, s.line);
                let (u, t) = if l.axis { (y, x) } else { (x, y) };
                let (c, k) = (l.c.wrapping_add(t << 12), i64::from(l.m).wrapping_mul(u));
                let sides = [s.a, s.b].map(|n| base.wrapping_add(n.into()));
                Entry::Split { c, k, m: l.m, axis: l.axis, sides }
            } else if number < layout.first_raw.into() {
                let m = eval::mask(page, layout, number);
                let entries = m.entries.map(|n| base.wrapping_add(n.into()));
                Entry::Mask { entries, selectors: m.selectors, from }
            } else {
                let raw = count(&self.raws);
                let cell = |n: i64| eval::value(page, layout, number, (n & 3) << 8, (n >> 2) << 8);
                self.raws.push(std::array::from_fn(|n| cell(i64::try_from(n).unwrap_or(0))));
                Entry::Raw { raw, from }
            };
            self.entries.push(entry);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The limits count on it.
    #[test]
    fn an_entry_takes_half_a_line_of_cache() {
        assert_eq!(size_of::<Entry>(), 32);
    }
}
