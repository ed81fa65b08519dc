//! Kind `vector`: twin of `shader/query/vector.wgsl`. Bits and entries are the format's own; its 64-bit numbers are
//! pairs of words there.

use umbrage_format::kind::mh::child_of;
use umbrage_format::kind::vector::{Child, Layout, value};

use super::pool::{Answer, MAX_STEPS, NONE, Page, Pool};

/// The node whose entry answers.
#[derive(Clone, Copy)]
struct Found<'a> {
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
        let (mut d, found) = self.vector_walk(root, x, y, level);
        if let Some(f) = found {
            let level = level.min(self.top().into());
            // The centre of the texel of the level.
            d.value = f
                .value(&Layout::of(f.page.words), [x, y], |v, _| (v >> level << level << 8).wrapping_add(128 << level));
        }
        d
    }

    /// Answer at a place inside texel (x, y), `sub` 1/256 of a texel from its corner (the low 8 bits count): the
    /// entry's value there where it is proven over its whole square, else that of the texel.
    pub fn vector_continuous(&self, root: u32, x: u32, y: u32, sub: [u32; 2]) -> Answer {
        let (mut d, found) = self.vector_walk(root, x, y, 0);
        if let Some(f) = found {
            let layout = Layout::of(f.page.words);
            let sub = if layout.proven(f.page.words, f.index) { sub.map(|s| s & 0xFF) } else { [128; 2] };
            d.value = f.value(&layout, [x, y], |v, axis| v << 8 | sub[axis]);
        }
        d
    }

    /// The way to the finest node with an entry, which is not evaluated yet.
    fn vector_walk(&self, root: u32, x: u32, y: u32, level: u32) -> (Answer, Option<Found<'a>>) {
        let (mut d, mut found) = (self.nothing(root), None);
        let Some(mut page) = self.page(root) else { return (Answer { missing: root, ..d }, found) };
        let mut ordinal = root;
        let mut group = 0;
        let mut at_level = self.top();
        for _ in 0..MAX_STEPS {
            let c = child_of(x, y, at_level);
            let mut child = Child::of(page.words, group, c);
            if child.mask.0 == 0 && group != 0 {
                let Some(place) = Layout::of(page.words).stub(page.words, group) else { break };
                let next = page.first_child.saturating_add(place.into());
                let Some(there) = self.page(next) else {
                    d.missing = next;
                    break;
                };
                (page, ordinal, group) = (there, next, 0);
                child = Child::of(page.words, 0, c);
            }
            let kind = child.mask.child(c);
            if kind.has_value() {
                found = Some(Found { page, index: child.index });
                d = Answer { level: at_level.into(), page: ordinal, word: 4 * group + c, missing: NONE, ..d };
            }
            if !kind.has_children() || u32::from(at_level) <= level {
                break;
            }
            group = child.below;
            at_level -= 1;
        }
        (d, found)
    }
}
