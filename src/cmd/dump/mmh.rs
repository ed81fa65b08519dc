//! What sharing does in kind `mmh`: nodes as they are met, not as they are stored.

use std::collections::HashMap;

use umbrage::format::kind::mh::{Mask, ROOT_GROUP};
use umbrage::format::kind::mmh::{Children, Node};
use umbrage::reader::query::Map;

use super::super::Failure;

/// Counts nodes below groups, each group once.
pub struct Walker<'a> {
    map: &'a Map,
    /// Nodes in and below a group, by its page and its first word; child pages left out.
    below: HashMap<(u32, u16), u64>,
    /// References to groups of the same page, and of shared pages, from groups that were met.
    pub references: [u64; 2],
}

impl<'a> Walker<'a> {
    /// Nothing met yet.
    pub fn new(map: &'a Map) -> Self {
        Self { map, below: HashMap::new(), references: [0; 2] }
    }

    /// Nodes in the root group of a tree page and below it, each as often as lookups meet it in another place; child
    /// pages left out.
    ///
    /// # Errors
    /// A page can't be read.
    pub fn page(&mut self, ordinal: u32) -> Result<u64, Failure> {
        let head = *self.map.page(ordinal)?.head();
        self.group(ordinal, ROOT_GROUP, Mask(head.root_mask), head.root_level)
    }

    /// Nodes in a group at `level` and below.
    fn group(&mut self, page: u32, at: u16, mask: Mask, level: u8) -> Result<u64, Failure> {
        if let Some(known) = self.below.get(&(page, at)) {
            return Ok(*known);
        }
        let mut sum = 0u64;
        for c in (0..4).filter(|c| mask.child(*c).words() > 0) {
            sum = sum.saturating_add(1);
            if let Some((page, at, mask)) = self.child(page, at, mask, c)?.filter(|_| level > 0) {
                sum = sum.saturating_add(self.group(page, at, mask, level - 1)?);
            }
        }
        self.below.insert((page, at), sum);
        Ok(sum)
    }

    /// The group below child `c`, where it is not in a child page.
    fn child(&mut self, page: u32, at: u16, mask: Mask, c: u32) -> Result<Option<(u32, u16, Mask)>, Failure> {
        if !mask.child(c).has_children() {
            return Ok(None);
        }
        let p = self.map.page(page)?;
        let word = p.words().get(usize::from(at) + mask.words_before(c) as usize).copied().unwrap_or(0);
        let node = Node::decode(word);
        Ok(match node.children {
            Children::Here(first) => {
                self.references[0] += 1;
                Some((page, first, node.mask))
            }
            Children::Page(_) => None,
            Children::Shared(d, first) => {
                self.references[1] += 1;
                p.dependencies().get(usize::from(d)).map(|o| (*o, first, node.mask))
            }
        })
    }

    /// Calls `count` with the first texel of each square of `level` that nodes of a tree page lie in, and how many.
    ///
    /// # Errors
    /// A page can't be read.
    pub fn squares(&mut self, ordinal: u32, level: u8, count: &mut impl FnMut(u32, u32, u64)) -> Result<(), Failure> {
        let page = self.map.page(ordinal)?;
        let (head, r) = (*page.head(), *page.record());
        let origin = [r.origin_x.get(), r.origin_y.get()];
        self.square((ordinal, ROOT_GROUP, Mask(head.root_mask)), head.root_level, origin, level, count)
    }

    fn square(
        &mut self,
        (page, at, mask): (u32, u16, Mask),
        group_level: u8,
        origin: [u32; 2],
        level: u8,
        count: &mut impl FnMut(u32, u32, u64),
    ) -> Result<(), Failure> {
        if group_level < level {
            count(origin[0], origin[1], self.group(page, at, mask, group_level)?);
            return Ok(());
        }
        for c in (0..4).filter(|c| mask.child(*c).words() > 0) {
            let [x, y] = [origin[0] + ((c & 1) << group_level), origin[1] + ((c >> 1) << group_level)];
            if group_level == level {
                count(x, y, 1);
            }
            if let Some(below) = self.child(page, at, mask, c)?.filter(|_| group_level > 0) {
                self.square(below, group_level - 1, [x, y], level, count)?;
            }
        }
        Ok(())
    }
}
