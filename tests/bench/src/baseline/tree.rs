//! MH as a tree in memory, made from the intervals: what [`depth_dag`](super::depth_dag) takes apart and
//! [`unpadded`](super::unpadded) writes down.

use umbrage::writer::hierarchy::mh::representative;
use umbrage::writer::interval::Interval;

use super::image::Image;

/// No group of children.
pub const NONE: u32 = u32::MAX;

/// The children of a node of MH.
pub struct Group {
    /// Which of them have a depth of their own.
    pub own: u8,
    /// What that depth may be.
    pub intervals: [Interval; 4],
    /// The groups below them, or [`NONE`].
    pub below: [u32; 4],
}

/// MH from below: the interval of the whole map, the group under its root or [`NONE`], and all groups, children before
/// parents.
pub fn tree(image: &Image) -> (Interval, u32, Vec<Group>) {
    let mut groups = Vec::new();
    let (interval, group) = square(image, [0, 0], image.log2, &mut groups);
    (interval, group, groups)
}

/// The interval of a square, and the groups under it.
fn square(image: &Image, origin: [usize; 2], level: u32, groups: &mut Vec<Group>) -> (Interval, u32) {
    if level == 0 {
        return (image.allowed(origin[0], origin[1]), NONE);
    }
    let half = 1usize << (level - 1);
    let children = [0, 1, 2, 3]
        .map(|c| square(image, [origin[0] + (c & 1) * half, origin[1] + (c >> 1) * half], level - 1, groups));
    let intervals = children.map(|c| c.0);
    let (interval, inherits) = representative(intervals);
    let below = children.map(|c| c.1);
    if inherits == 15 && below == [NONE; 4] {
        return (interval, NONE);
    }
    groups.push(Group { own: 15 & !inherits, intervals, below });
    (interval, groups.len() as u32 - 1)
}
