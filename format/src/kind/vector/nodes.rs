//! Every node of a page, in the order of the topology.

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing,
    clippy::cast_possible_truncation
)]

use alloc::vec::Vec;

use super::{Group, Header, Levels};
use crate::kind::mh::NodeType;
use crate::page::FrameHead;

/// A node and its square.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Node {
    /// `4 * group + c`.
    pub number: u32,
    /// Its type, not none.
    pub kind: NodeType,
    /// Its index, where it has an entry.
    pub index: u32,
    /// Its level.
    pub level: u8,
    /// First texel in x, counted in the page's footprint.
    pub x: u32,
    /// First texel in y.
    pub y: u32,
}

/// Calls `visit` with every node of a page that has passed [`check`](super::check), by rising number. Time and memory are
/// linear in the words, on any words.
pub fn nodes(page: &[u32], head: &FrameHead, mut visit: impl FnMut(Node)) {
    let groups = u32::from(Header::decode(page).groups);
    let mut squares: Vec<(u32, u32)> = Vec::with_capacity(groups as usize);
    squares.push((0, 0));
    let mut levels = Levels::new(head);
    let (mut children, mut index) = (0u32, 0u32);
    for number in 0..groups {
        let Some(&(x, y)) = squares.get(number as usize) else { return };
        let (mask, level) = (Group::of(page, number).mask, levels.of(number, children));
        for c in (0..4).filter(|&c| mask.child(c) != NodeType::None) {
            let (x, y) = (x.wrapping_add((c & 1) << (level & 31)), y.wrapping_add((c >> 1) << (level & 31)));
            let kind = mask.child(c);
            visit(Node { number: 4 * number + c, kind, index, level, x, y });
            index += u32::from(kind.has_value());
            if kind.has_children() {
                children += 1;
                squares.push((x, y));
            }
        }
    }
}
