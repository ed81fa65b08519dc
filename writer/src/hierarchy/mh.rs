//! Kind `mh`: bottom-up construction (Scandolo et al. 2016, section 3.1, algorithm 2), one merge at a time. Top-down:
//! [`super::top`].

use umbrage_format::kind::mh::{Mask, NodeType};

use crate::interval::Interval;

/// No children.
pub const NONE: u32 = u32::MAX;
/// In [`Node::below`] and [`Group::below`]: the children lie in a page of their own, whose number are the other bits.
pub const CUT: u32 = 1 << 31;

/// The four children of a node, as far as they exist.
#[derive(Clone, Copy, Debug)]
pub struct Group {
    /// Their types.
    pub mask: Mask,
    /// Values of leaf and inner children.
    pub value: [u32; 4],
    /// Groups below inner and empty children, or [`CUT`] and a page.
    pub below: [u32; 4],
    /// What is known about their square as a whole.
    pub span: Span,
}

/// A node whose value is still open: its parent may take it over.
#[derive(Clone, Copy, Debug)]
pub struct Node {
    /// Every value that may stand here.
    pub interval: Interval,
    /// Group of its children, [`NONE`], or [`CUT`] and a page.
    pub below: u32,
    /// Words of all groups below that are not in pages of their own.
    pub words: u32,
    /// Finest level of a node below, of those not in pages of their own.
    pub finest: u8,
    /// What is known about the square as a whole.
    pub span: Span,
}

/// Extremes over a node's square.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Span {
    /// Largest lower end of a texel's interval.
    pub low: u32,
    /// Smallest upper end of a texel's interval.
    pub high: u32,
    /// Smallest value stored below.
    pub min: u32,
    /// Largest value stored below.
    pub max: u32,
}

impl Span {
    /// Bound of the lattice distance of `value` to a texel's interval.
    pub fn stop_error(&self, value: u32) -> u32 {
        self.low.saturating_sub(value).max(value.saturating_sub(self.high))
    }

    /// Of two squares together.
    pub fn join(self, o: Span) -> Span {
        Span {
            low: self.low.max(o.low),
            high: self.high.min(o.high),
            min: self.min.min(o.min),
            max: self.max.max(o.max),
        }
    }
}

impl Node {
    /// A square that one interval answers, whose value shall keep `guard` from wide ends.
    pub fn guarded(interval: Interval, guard: u32) -> Node {
        Node { interval: interval.guarded(guard), ..Node::uniform(interval) }
    }

    /// A square that one interval answers.
    pub fn uniform(interval: Interval) -> Node {
        let span = Span { low: interval.min, high: interval.max, min: u32::MAX, max: 0 };
        Node { interval, below: NONE, words: 0, finest: u8::MAX, span }
    }
}

/// The interval that most of the four contain, and which of them contain it (one bit each).
///
/// The best depth is the lower end of one of them (section 3.1, figure 3); of equally good ones the widest common
/// interval is taken, then the first.
pub fn representative(children: [Interval; 4]) -> (Interval, u8) {
    let mut best = (0u32, 0u32, Interval::UNCOVERED, 0u8);
    for c in children {
        let v = c.min;
        let (mut count, mut max, mut which) = (0, u32::MAX, 0u8);
        for (i, o) in children.iter().enumerate() {
            if o.min <= v && v <= o.max {
                count += 1;
                max = max.min(o.max);
                which |= 1 << i;
            }
        }
        // all that contain v begin at or before it, so their common part is [v, max]
        if count > best.0 || (count == best.0 && max - v > best.1) {
            best = (count, max - v, Interval { min: v, max }, which);
        }
    }
    (best.2, best.3)
}

/// Merges four children; a new group is added where any of them stays. `level` is the level of the children.
pub fn merge(children: [Node; 4], level: u8, groups: &mut Vec<Group>) -> Node {
    let (interval, which) = representative(children.map(|c| c.interval));
    group(interval, &children, [0, 1, 2, 3].map(|i| which >> i & 1 == 0), level, groups)
}

/// A node of four children, of which those that `keep` their value stay; a new group is added where any child is left.
/// `interval` is the node's own, and holds for all children that do not keep theirs. `level` is the level of the children.
pub fn group(interval: Interval, children: &[Node; 4], keep: [bool; 4], level: u8, groups: &mut Vec<Group>) -> Node {
    let mut types = [NodeType::None; 4];
    let mut group = Group { mask: Mask(0), value: [0; 4], below: [NONE; 4], span: children[0].span };
    let (mut words, mut finest) = (0, u8::MAX);
    let mut span = children.iter().skip(1).fold(children[0].span, |s, c| s.join(c.span));
    for (i, c) in children.iter().enumerate() {
        let inherits = !keep[i];
        types[i] = match (inherits, c.below == NONE) {
            (true, true) => NodeType::None,
            (true, false) => NodeType::Empty,
            (false, true) => NodeType::Leaf,
            (false, false) => NodeType::Inner,
        };
        if !inherits {
            let v = c.interval.middle();
            group.value[i] = v;
            span.min = span.min.min(v);
            span.max = span.max.max(v);
        }
        group.below[i] = c.below;
        words += c.words;
        finest = finest.min(c.finest);
    }
    group.mask = Mask::new(types);
    group.span = span;
    if group.mask.0 == 0 {
        return Node { interval, below: NONE, words: 0, finest: u8::MAX, span };
    }
    let below = groups.len() as u32;
    groups.push(group);
    Node { interval, below, words: words + group.mask.words(), finest: finest.min(level), span }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn iv(min: u32, max: u32) -> Interval {
        Interval { min, max }
    }

    /// Brute force over all depths of a small range.
    fn most(children: [Interval; 4]) -> usize {
        (0..64).map(|v| children.iter().filter(|c| c.min <= v && v <= c.max).count()).max().unwrap()
    }

    #[test]
    fn the_representative_covers_as_many_as_any_depth_could() {
        let mut seed = 7u64;
        for _ in 0..20000 {
            let mut next = || {
                seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
                (seed >> 58) as u32
            };
            let c = [0; 4].map(|_| {
                let (a, b) = (next(), next());
                iv(a.min(b), a.max(b))
            });
            let (i, which) = representative(c);
            assert_eq!(which.count_ones() as usize, most(c), "{c:?}");
            for (k, o) in c.iter().enumerate() {
                if which >> k & 1 == 1 {
                    assert!(o.min <= i.min && i.max <= o.max, "{c:?} {i:?}");
                }
            }
        }
    }

    #[test]
    fn figure_4_of_the_paper() {
        // three agree, one differs: the parent takes the three, the fourth stays as a leaf
        let n = |a, b| Node::uniform(iv(a, b));
        let mut groups = Vec::new();
        let p = merge([n(0, 5), n(3, 9), n(20, 30), n(4, 6)], 0, &mut groups);
        assert_eq!(p.interval, iv(4, 5));
        assert_eq!(groups[0].mask, Mask::new([NodeType::None, NodeType::None, NodeType::Leaf, NodeType::None]));
        assert_eq!((groups[0].value[2], p.words, p.finest), (25, 1, 0));
        // one level up the node's own value is taken over by its parent, which leaves an empty node behind
        let q = merge([p, n(4, 4), n(5, 5), n(0, 9)], 1, &mut groups);
        assert_eq!(groups[1].mask.child(0), NodeType::Empty);
        assert_eq!(q.words, 1 + groups[1].mask.words());
    }
}
