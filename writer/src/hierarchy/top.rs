//! Kind `mh`: top-down construction (Scandolo 2019, section 2.3.1, algorithm 1), tile by tile.
//!
//! In: the squares of a tile, each with the interval that answers it. Out: the tile's node and the groups below it, as the
//! bottom-up merge ([`super::mh`]) makes them from the same squares.
//!
//! A node takes the depth that lies in the intervals of most texels below it, found by a sweep over their sorted ends; what
//! that depth does not answer is left to the quadrants. Ends are sorted once for the tile; quadrants take theirs out in
//! order.
//!
//! Departure from the paper: there every node that is made has a value, chosen for the texels that no node above answers.
//! But a lookup takes the value of the finest node on its way, so that value would also hold for texels in the node's
//! square that a node above had answered. Here a node weighs all texels of its square: a new value must answer more of them
//! than the one from above does; else the node stays empty.

use crate::interval::Interval;

use super::build::{Hold, finish};
use super::mh::{self, NONE, Node};
use super::page::{At, Forest};

/// Builds the node at `at` from the squares below it, which cover it without overlap, in any order.
pub(crate) fn build(resolution_log2: u8, at: At, squares: &[(At, Node)], forest: &mut Forest, hold: Hold<'_>) -> Node {
    let mut list = List { starts: (0..squares.len() as u32).collect(), ends: (0..squares.len() as u32).collect() };
    list.starts.sort_by_key(|i| squares[*i as usize].1.interval.min);
    list.ends.sort_by_key(|i| squares[*i as usize].1.interval.max);
    Builder { resolution_log2, squares, forest, hold }.node(at, list, None).0
}

/// Numbers of squares by rising lower end, and by rising upper end.
struct List {
    starts: Vec<u32>,
    ends: Vec<u32>,
}

struct Builder<'a> {
    resolution_log2: u8,
    squares: &'a [(At, Node)],
    forest: &'a mut Forest,
    hold: Hold<'a>,
}

impl Builder<'_> {
    fn interval(&self, i: u32) -> Interval {
        self.squares[i as usize].1.interval
    }

    /// Texels of a square.
    fn texels(&self, i: u32) -> u64 {
        1 << (2 * self.squares[i as usize].0.level)
    }

    /// Texels of a list for which every value of `of` is right.
    fn answered(&self, list: &List, of: Interval) -> u64 {
        let right = |i: &&u32| self.interval(**i).min <= of.min && of.max <= self.interval(**i).max;
        list.starts.iter().filter(right).map(|i| self.texels(*i)).sum()
    }

    /// The common interval of those squares that hold the depth in the intervals of most texels, and how many texels that
    /// are (figure 2.3). Of equally good depths the smallest.
    fn best(&self, list: &List) -> (Interval, u64) {
        let (mut open, mut best, mut depth, mut ended) = (0u64, 0u64, 0u32, 0);
        for &i in &list.starts {
            let start = self.interval(i).min;
            while self.interval(list.ends[ended]).max < start {
                open -= self.texels(list.ends[ended]);
                ended += 1;
            }
            open += self.texels(i);
            if open > best {
                (best, depth) = (open, start);
            }
        }
        // All that hold the depth begin at or before it, so their common part begins there.
        let holds = list.starts.iter().map(|i| self.interval(*i)).filter(|o| o.min <= depth && depth <= o.max);
        (Interval { min: depth, max: holds.map(|o| o.max).min().unwrap_or(depth) }, best)
    }

    /// The squares of child `c` of the node at `at`.
    fn child(&self, at: At, list: &List, c: usize) -> List {
        let below = at.child(c);
        let inside = |i: &&u32| {
            let origin = self.squares[**i as usize].0.origin;
            (0..2).all(|k| origin[k] >> below.level == below.origin[k] >> below.level)
        };
        let of = |all: &[u32]| all.iter().filter(inside).copied().collect();
        List { starts: of(&list.starts), ends: of(&list.ends) }
    }

    /// The node at `at`, and whether it has a value of its own; `above` is what holds above it.
    fn node(&mut self, at: At, list: List, above: Option<Interval>) -> (Node, bool) {
        let first = self.squares[list.starts[0] as usize].1;
        let span = list.starts.iter().fold(first.span, |s, i| s.join(self.squares[*i as usize].1.span));
        let from_above = above.map_or(0, |a| self.answered(&list, a));
        let (best, most) = self.best(&list);
        let (interval, own) = match above {
            Some(above) if from_above >= most => (above, false),
            _ => (best, true),
        };
        let answered = if own { most } else { from_above };
        if answered == 1 << (2 * at.level) {
            return (Node { interval, below: NONE, words: 0, finest: u8::MAX, span }, own);
        }
        let children = [0, 1, 2, 3].map(|c| {
            let below = self.child(at, &list, c);
            self.node(at.child(c), below, Some(interval))
        });
        let (mut nodes, has) = (children.map(|c| c.0), children.map(|c| c.1));
        let node = mh::group(interval, &nodes, has, at.level - 1, &mut self.forest.groups);
        (finish(self.resolution_log2, at, node, &mut nodes, self.forest, self.hold), own)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hierarchy::page::Forest;

    /// Squares of a random quadtree, small and large, whose intervals lie near each other.
    fn squares(next: &mut impl FnMut(u32) -> u32, at: At, out: &mut Vec<(At, Node)>) {
        if at.level == 0 || next(4) == 0 {
            let min = next(40);
            let interval = Interval { min, max: min + next(20) };
            return out.push((at, Node::uniform(interval)));
        }
        (0..4).for_each(|c| squares(next, at.child(c), out));
    }

    fn lookup(forest: &Forest, root: Node, level: u8, x: u32, y: u32) -> u32 {
        let (mut value, mut below, mut l) = (root.interval.middle(), root.below, level);
        while below != NONE {
            let g = &forest.groups[below as usize];
            l -= 1;
            let c = (x >> l & 1 | (y >> l & 1) << 1) as usize;
            let kind = g.mask.child(c as u32);
            if kind.has_value() {
                value = g.value[c];
            }
            below = if kind.has_children() { g.below[c] } else { NONE };
        }
        value
    }

    /// Every texel gets a value in its interval, whatever the root's value is within the root's interval; and where one
    /// depth is right for all, there is one node.
    #[test]
    fn every_texel_is_answered_rightly() {
        let mut seed = 5u64;
        let mut next = |n: u32| {
            seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (seed >> 33) as u32 % n
        };
        let mut nodes = 0;
        for _ in 0..300 {
            let at = At { level: 5, origin: [64, 32] };
            let mut all = Vec::new();
            squares(&mut next, at, &mut all);
            let mut forest = Forest::default();
            let root = build(20, at, &all, &mut forest, Hold::Whole);
            nodes += forest.groups.len();
            assert_eq!(forest.groups.len(), forest.intervals.len());
            for (square, node) in &all {
                let i = node.interval;
                for (dx, dy) in [(0, 0), ((1 << square.level) - 1, (1 << square.level) - 1)] {
                    let (x, y) = (square.origin[0] + dx, square.origin[1] + dy);
                    for value in [root.interval.min, root.interval.max] {
                        let root = Node { interval: Interval { min: value, max: value }, ..root };
                        let v = lookup(&forest, root, 5, x, y);
                        assert!(i.min <= v && v <= i.max, "{v} at {x}, {y}: {i:?}");
                    }
                }
            }
            let common = all.iter().skip(1).try_fold(all[0].1.interval, |a, b| a.intersect(b.1.interval));
            assert_eq!(common.is_some(), root.below == NONE);
        }
        assert!(nodes > 1000);
    }

    /// The sweep finds as many texels as any depth could.
    #[test]
    fn no_depth_answers_more() {
        let at = At { level: 2, origin: [0, 0] };
        let ends = [(3, 9), (5, 5), (0, 2), (9, 12), (5, 30), (31, 32), (9, 9), (2, 4)];
        let all: Vec<(At, Node)> = ends
            .iter()
            .enumerate()
            .map(|(i, (min, max))| {
                let origin = [i as u32 % 4, i as u32 / 4];
                (At { level: 0, origin }, Node::uniform(Interval { min: *min, max: *max }))
            })
            .collect();
        let list = List { starts: vec![2, 7, 0, 1, 4, 3, 6, 5], ends: vec![2, 7, 1, 0, 6, 3, 4, 5] };
        let mut forest = Forest::default();
        let b = Builder { resolution_log2: 9, squares: &all, forest: &mut forest, hold: Hold::Whole };
        let most = (0..40).map(|v| ends.iter().filter(|(a, b)| *a <= v && v <= *b).count()).max().unwrap();
        let (interval, found) = b.best(&list);
        assert_eq!((found, most), (4, 4));
        assert_eq!(interval, Interval { min: 9, max: 9 });
        assert_eq!(b.answered(&list, interval), 4);
        assert_eq!(b.child(at, &list, 1).starts, [2, 7, 3, 6]);
    }
}
