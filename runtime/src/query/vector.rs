//! Kind `vector`: twin of `shader/query/vector.wgsl`. Bits and entries are the format's own; its 64-bit numbers are
//! pairs of words there.

use umbrage_format::kind::mh::child_of;
use umbrage_format::kind::vector::{Child, Layout, value};

use super::pool::{Answer, NONE, Page, Pool, Walk};

/// The node whose entry answers.
#[derive(Clone, Copy)]
pub(super) struct Found<'a> {
    page: Page<'a>,
    /// Its index, as the page counts nodes with an entry.
    index: u32,
}

impl Found<'_> {
    /// Value of the entry at a place of texel (x, y): `place` makes it of a coordinate within the footprint, of x or y
    /// by the second argument.
    fn value(&self, layout: &Layout, [x, y]: [u32; 2], place: impl Fn(u32, usize) -> u32) -> u32 {
        // A footprint has twice the side of its root group's nodes; the root page's is the map, and the bit above it 0.
        let mask = (2u32 << (self.page.head().root_level & 31)).wrapping_sub(1);
        let entry = layout.entry(self.page.words, self.index);
        value(self.page.words, layout, entry, place(x & mask, 0).into(), place(y & mask, 1).into())
    }
}

impl<'a> Pool<'a> {
    /// Walks from root `root` to texel (x, y) at `level`, in a structure of kind `vector`.
    pub fn vector(&self, root: u32, x: u32, y: u32, level: u32) -> Answer {
        let w = self.go_vector(self.start(root, 0), x, y, level);
        Answer { value: self.vector_value(&w, x, y, level), ..w.found }
    }

    /// Value at the centre of the texel of `level` around (x, y) by the entry that a walk has found.
    pub(super) fn vector_value(&self, w: &Walk<'a>, x: u32, y: u32, level: u32) -> u32 {
        let Some(f) = w.entry else { return w.found.value };
        let level = level.min(self.top().into());
        f.value(&Layout::of(f.page.words), [x, y], |v, _| (v >> level << level << 8).wrapping_add(128 << level))
    }

    /// Answer at a place inside texel (x, y), `sub` 1/256 of a texel from its corner (the low 8 bits count): the
    /// entry's value there where it is proven over its whole square, else that of the texel.
    pub fn vector_continuous(&self, root: u32, x: u32, y: u32, sub: [u32; 2]) -> Answer {
        let mut w = self.go_vector(self.start(root, 0), x, y, 0);
        if let Some(f) = w.entry {
            let layout = Layout::of(f.page.words);
            let sub = if layout.proven(f.page.words, f.index) { sub.map(|s| s & 0xFF) } else { [128; 2] };
            w.found.value = f.value(&layout, [x, y], |v, axis| v << 8 | sub[axis]);
        }
        w.found
    }

    /// Goes on towards texel (x, y) until a node of `level` or above has been visited or the walk has ended. The entry
    /// found is not evaluated yet.
    pub(super) fn go_vector(&self, mut w: Walk<'a>, x: u32, y: u32, level: u32) -> Walk<'a> {
        while !w.ended {
            if w.opens {
                if u32::from(w.level) <= level {
                    break;
                }
                (w.group, w.opens, w.level) = (w.node, false, w.level - 1);
            }
            let c = child_of(x, y, w.level);
            let mut child = Child::of(w.page.words, w.group, c);
            if child.mask.0 == 0 && w.group != 0 {
                let Some(place) = Layout::of(w.page.words).stub(w.page.words, w.group) else {
                    w.ended = true;
                    break;
                };
                let next = w.page.first_child.saturating_add(place.into());
                let Some(there) = self.page(next) else {
                    (w.found.missing, w.ended) = (next, true);
                    break;
                };
                (w.page, w.ordinal, w.group) = (there, next, 0);
                child = Child::of(there.words, 0, c);
            }
            let kind = child.mask.child(c);
            if kind.has_value() {
                w.entry = Some(Found { page: w.page, index: child.index });
                let (level, word) = (w.level.into(), 4 * w.group + c);
                w.found = Answer { level, page: w.ordinal, word, missing: NONE, ..w.found };
            }
            (w.node, w.opens, w.ended) = (child.below, true, !kind.has_children());
        }
        w
    }
}
