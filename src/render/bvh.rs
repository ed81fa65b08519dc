//! Bounding volume hierarchy over snapped triangles: binned surface-area heuristic, built in parallel as a binary tree
//! (the same on any number of threads), then folded into nodes of four.
//!
//! Boxes are integers: lattice coordinates, shifted right on each axis so that they fit into 28 bits, and `PAD` such
//! steps wider on every side. That is more than the f32 slab test can be wrong by (see [`Bvh::closest`]), so that no
//! box is missed whose triangle is hit, and light rays are culled by integers alone. [`Bvh::closest`] walks a ray of
//! any direction, [`Bvh::along_light`] a light ray at a lattice point.

use rayon::prelude::*;

use super::scene::Surface;

/// Most bins per axis.
const BINS: usize = 16;
/// Leaves above this size are always split.
const MAX_LEAF: usize = 4;
/// From this size on, halves are built by two threads and passes over the items are shared out.
const PARALLEL: usize = 1 << 14;
/// Below this depth items are halved by count, so that no order of them makes a tree much deeper.
const SAH_DEPTH: u32 = 64;
/// Bits of a box coordinate. With 28 and the padding, sums and differences of two of them stay in an i32.
const BITS: u32 = 28;
/// Steps that a box is wider than its triangles, on every side: 2^-20 of the map.
const PAD: i32 = 256;
/// Children of a node.
const WIDTH: usize = 4;

#[derive(Clone, Copy, Debug)]
struct Bounds {
    low: [i32; 3],
    high: [i32; 3],
}

impl Bounds {
    const EMPTY: Bounds = Bounds { low: [i32::MAX; 3], high: [i32::MIN; 3] };

    #[inline(always)]
    fn join(self, other: Bounds) -> Bounds {
        let low = std::array::from_fn(|k| self.low[k].min(other.low[k]));
        let high = std::array::from_fn(|k| self.high[k].max(other.high[k]));
        Bounds { low, high }
    }

    fn half_area(&self, scale: [f32; 3]) -> f32 {
        let [x, y, z] = std::array::from_fn(|k| (self.high[k] - self.low[k]) as f32 * scale[k]);
        x * y + y * z + z * x
    }

    /// Twice the centre.
    #[inline(always)]
    fn middle(&self) -> [i32; 3] {
        std::array::from_fn(|k| self.low[k] + self.high[k])
    }
}

/// A node of the binary tree. `count == 0`: its children are `first` and `first + 1`. Otherwise a leaf: a stretch of `order`.
#[derive(Clone, Copy, Debug)]
struct Pair {
    bounds: Bounds,
    first: u32,
    count: u32,
}

impl Pair {
    /// The same node where its relatives lie `base` further on.
    fn moved(self, base: u32) -> Pair {
        Pair { first: if self.count == 0 { self.first + base } else { self.first }, ..self }
    }
}

struct Item {
    bounds: Bounds,
    triangle: u32,
}

#[derive(Clone, Copy)]
struct Bin {
    bounds: Bounds,
    count: u32,
}

type Bins = [[Bin; BINS]; 3];

/// Four children side by side, so that the compiler can test them together.
struct Node {
    /// Low and high sides of the children's boxes, by axis. Unused children have their sides the wrong way round.
    sides: [[[i32; WIDTH]; 3]; 2],
    children: [Child; WIDTH],
}

/// `count == 0`: the node `first`. Otherwise a leaf: a stretch of `order`.
#[derive(Clone, Copy)]
struct Child {
    first: u32,
    count: u32,
}

/// The hierarchy. Triangles are named by their index in the surface.
pub(super) struct Bvh {
    nodes: Vec<Node>,
    order: Vec<u32>,
    shift: [u32; 3],
    bounds: Bounds,
}

impl Bvh {
    /// All triangles of `surface`; `scale` is the size of a lattice step along each axis, in one common unit.
    pub(super) fn build(surface: Surface<'_>, scale: [f64; 3]) -> Bvh {
        let magnitudes = surface.positions.par_iter().map(|p| p.map(i64::unsigned_abs));
        let largest = magnitudes.reduce(|| [0; 3], |a, b| std::array::from_fn(|k| a[k].max(b[k])));
        let shift = largest.map(|m| (u64::BITS - m.leading_zeros()).saturating_sub(BITS));
        let mut items: Vec<Item> = (0..surface.triangles.len() as u32)
            .into_par_iter()
            .map(|triangle| {
                let [a, b, c] = surface.corners(triangle);
                let low = std::array::from_fn(|k| (a[k].min(b[k]).min(c[k]) >> shift[k]) as i32 - PAD);
                let high = std::array::from_fn(|k| (a[k].max(b[k]).max(c[k]) >> shift[k]) as i32 + PAD);
                Item { bounds: Bounds { low, high }, triangle }
            })
            .collect();
        let scale: [f64; 3] = std::array::from_fn(|k| scale[k] * (1u64 << shift[k]) as f64);
        let unit = scale.into_iter().fold(0.0, f64::max);
        let scale = scale.map(|s| if unit > 0.0 { (s / unit) as f32 } else { 1.0 });
        let (mut nodes, mut bounds) = (Vec::new(), Bounds::EMPTY);
        if !items.is_empty() {
            let mut pairs = Vec::with_capacity(items.len());
            let root = grow(&mut items, 0, 0, scale, &mut pairs);
            bounds = root.bounds;
            fold(&root, &pairs, scale, &mut nodes);
        }
        Bvh { nodes, order: items.into_iter().map(|i| i.triangle).collect(), shift, bounds }
    }

    /// Calls `visit(triangle, limit)` for triangles whose box the ray meets at or before `limit`, near ones first;
    /// `visit` returns the limit from there on. `origin` and `direction` in lattice steps; the limit is in units of
    /// `direction`.
    ///
    /// Boxes are tested in f32 from a point on or in the box of everything, along a direction whose largest
    /// component is 1. In box steps, a side is then wrong by up to 16, the origin by 16, their difference by 16, and
    /// the distance by two relative roundings (2^-23) of up to 2^29, that is 64; the limit by 64 more. `PAD` is larger
    /// than the sum.
    #[inline]
    pub(super) fn closest(&self, origin: [f64; 3], direction: [f64; 3], mut visit: impl FnMut(u32, f64) -> f64) {
        let unit = self.shift.map(|s| 1.0 / (1u64 << s) as f64);
        let origin: [f64; 3] = std::array::from_fn(|k| origin[k] * unit[k]);
        let direction: [f64; 3] = std::array::from_fn(|k| direction[k] * unit[k]);
        let speed = direction.iter().fold(0.0, |m: f64, d| m.max(d.abs()));
        // Finite inverses: 0 * infinity would be no number.
        let direction = direction.map(|d| d / speed).map(|d| if d.abs() < 1e-20 { 1e-20_f64.copysign(d) } else { d });
        let (mut start, mut end) = (0.0, f64::INFINITY);
        for k in 0..3 {
            let a = (f64::from(self.bounds.low[k]) - origin[k]) / direction[k];
            let b = (f64::from(self.bounds.high[k]) - origin[k]) / direction[k];
            start = a.min(b).max(start);
            end = a.max(b).min(end);
        }
        if start > end {
            return;
        }
        let from: [f32; 3] = std::array::from_fn(|k| (origin[k] + start * direction[k]) as f32);
        let inverse = direction.map(|d| (1.0 / d) as f32);
        let backward = inverse.map(|v| usize::from(v < 0.0));
        let slabs = Slabs { from, inverse, backward };
        let test = |node: &Node, limit: f32| slabs.test(node, limit);
        let mut limit = f64::INFINITY;
        self.walk(f32::INFINITY, test, |triangle, _| {
            limit = visit(triangle, limit);
            (limit * speed - start) as f32
        });
    }

    /// Calls `visit(triangle, limit)` for triangles whose box the light ray at `xy` meets at or before the depth
    /// `limit`, near ones first; `visit` returns the limit from there on. Lattice steps; integers only.
    #[inline]
    pub(super) fn along_light(&self, xy: [i64; 2], mut limit: i64, mut visit: impl FnMut(u32, i64) -> i64) {
        let small = |v: i64, k: usize| (v >> self.shift[k]).clamp(i32::MIN.into(), i32::MAX.into()) as i32;
        let column = Column { x: small(xy[0], 0), y: small(xy[1], 1) };
        let test = |node: &Node, limit: i32| column.test(node, limit);
        self.walk(small(limit, 2), test, |triangle, _| {
            limit = visit(triangle, limit);
            small(limit, 2)
        });
    }

    /// Depth first, near children first. `test` says where a ray enters each child of a node and whether it does so
    /// at or before the limit.
    #[inline(always)]
    fn walk<T: Copy + PartialOrd>(
        &self,
        mut limit: T,
        test: impl Fn(&Node, T) -> ([T; WIDTH], [bool; WIDTH]),
        mut visit: impl FnMut(u32, T) -> T,
    ) {
        if self.nodes.is_empty() {
            return;
        }
        let mut waiting = Vec::with_capacity(64);
        waiting.push((limit, Child { first: 0, count: 0 }));
        while let Some((near, child)) = waiting.pop() {
            if near > limit {
                continue;
            }
            if child.count > 0 {
                for &triangle in &self.order[child.first as usize..][..child.count as usize] {
                    limit = visit(triangle, limit);
                }
                continue;
            }
            let node = &self.nodes[child.first as usize];
            let (near, hit) = test(node, limit);
            let before = waiting.len();
            for i in 0..WIDTH {
                if hit[i] {
                    waiting.push((near[i], node.children[i]));
                    let mut at = waiting.len() - 1;
                    while at > before && waiting[at - 1].0 < waiting[at].0 {
                        waiting.swap(at - 1, at);
                        at -= 1;
                    }
                }
            }
        }
    }
}

/// A ray for the f32 test of boxes.
struct Slabs {
    from: [f32; 3],
    inverse: [f32; 3],
    backward: [usize; 3],
}

impl Slabs {
    /// Apart from the walk, so that the compiler does all four children at once.
    #[inline(never)]
    fn test(&self, node: &Node, limit: f32) -> ([f32; WIDTH], [bool; WIDTH]) {
        let larger = |a: f32, b: f32| if a > b { a } else { b };
        let smaller = |a: f32, b: f32| if a < b { a } else { b };
        let (mut near, mut far) = ([0.0; WIDTH], [limit; WIDTH]);
        for k in 0..3 {
            let (front, back) = (&node.sides[self.backward[k]][k], &node.sides[1 - self.backward[k]][k]);
            for i in 0..WIDTH {
                near[i] = larger((front[i] as f32 - self.from[k]) * self.inverse[k], near[i]);
            }
            for i in 0..WIDTH {
                far[i] = smaller((back[i] as f32 - self.from[k]) * self.inverse[k], far[i]);
            }
        }
        (near, std::array::from_fn(|i| near[i] <= far[i]))
    }
}

/// A light ray for the integer test of boxes.
struct Column {
    x: i32,
    y: i32,
}

impl Column {
    /// Apart from the walk for the same reason.
    #[inline(never)]
    fn test(&self, node: &Node, limit: i32) -> ([i32; WIDTH], [bool; WIDTH]) {
        let [low, high] = &node.sides;
        let inside = std::array::from_fn(|i| {
            (low[0][i] <= self.x)
                & (self.x <= high[0][i])
                & (low[1][i] <= self.y)
                & (self.y <= high[1][i])
                & (low[2][i] <= limit)
        });
        (low[2], inside)
    }
}

/// Folds the binary tree under `root` into nodes of four and returns the index of the first.
fn fold(root: &Pair, pairs: &[Pair], scale: [f32; 3], nodes: &mut Vec<Node>) -> u32 {
    let mut open = [*root; WIDTH];
    let mut count = 1;
    // The largest inner box is opened first: it is the one most rays enter.
    while count < WIDTH {
        let area = |p: &Pair| p.bounds.half_area(scale);
        let inner = (0..count).filter(|&i| open[i].count == 0);
        let Some(i) = inner.max_by(|&a, &b| area(&open[a]).total_cmp(&area(&open[b]))) else { break };
        let first = open[i].first as usize;
        open[i] = pairs[first];
        open[count] = pairs[first + 1];
        count += 1;
    }
    let index = nodes.len();
    let none = Child { first: 0, count: 0 };
    nodes.push(Node { sides: [[[i32::MAX; WIDTH]; 3], [[i32::MIN; WIDTH]; 3]], children: [none; WIDTH] });
    for (i, pair) in open[..count].iter().enumerate() {
        let first = if pair.count > 0 { pair.first } else { fold(pair, pairs, scale, nodes) };
        let node = &mut nodes[index];
        node.children[i] = Child { first, count: pair.count };
        for k in 0..3 {
            node.sides[0][k][i] = pair.bounds.low[k];
            node.sides[1][k][i] = pair.bounds.high[k];
        }
    }
    index as u32
}

/// Builds the tree over `items`, which lie at `first` in the final order; pushes all nodes but the root, which it
/// returns. Indices are relative to the start of `pairs`.
fn grow(items: &mut [Item], first: u32, depth: u32, scale: [f32; 3], pairs: &mut Vec<Pair>) -> Pair {
    let (bounds, middles) = extent(items);
    let Some(half) = divide(items, bounds, middles, depth, scale) else {
        return Pair { bounds, first, count: items.len() as u32 };
    };
    let parallel = items.len() >= PARALLEL;
    let (left, right) = items.split_at_mut(half);
    let right_first = first + half as u32;
    let pair = pairs.len();
    pairs.extend([Pair { bounds, first: 0, count: 0 }; 2]);
    if parallel {
        let apart = |items: &mut [Item], first| {
            let mut own = Vec::with_capacity(items.len());
            (grow(items, first, depth + 1, scale, &mut own), own)
        };
        let halves = rayon::join(|| apart(left, first), || apart(right, right_first));
        for (i, (root, rest)) in <[_; 2]>::from(halves).into_iter().enumerate() {
            let base = pairs.len() as u32;
            pairs[pair + i] = root.moved(base);
            pairs.extend(rest.into_iter().map(|n| n.moved(base)));
        }
    } else {
        pairs[pair] = grow(left, first, depth + 1, scale, pairs);
        pairs[pair + 1] = grow(right, right_first, depth + 1, scale, pairs);
    }
    Pair { bounds, first: pair as u32, count: 0 }
}

/// Bounds of the boxes and of (twice) their centres.
fn extent(items: &[Item]) -> (Bounds, Bounds) {
    let none = (Bounds::EMPTY, Bounds::EMPTY);
    let pass = |items: &[Item]| {
        items.iter().fold(none, |(b, m), i| {
            let middle = i.bounds.middle();
            (b.join(i.bounds), m.join(Bounds { low: middle, high: middle }))
        })
    };
    if items.len() < PARALLEL {
        return pass(items);
    }
    items.par_chunks(PARALLEL / 2).map(pass).reduce(|| none, |a, b| (a.0.join(b.0), a.1.join(b.1)))
}

/// Sorts `items` into two halves and returns the size of the first; nothing if a leaf is better.
#[inline(never)]
fn divide(items: &mut [Item], bounds: Bounds, middles: Bounds, depth: u32, scale: [f32; 3]) -> Option<usize> {
    let n = items.len();
    if n <= 1 {
        return None;
    }
    if depth >= SAH_DEPTH || middles.low == middles.high {
        return (n > MAX_LEAF).then_some(n / 2);
    }
    let bins = BINS.min(4 + n / 8);
    let origin = middles.low;
    let per_step: [f32; 3] = std::array::from_fn(|k| match middles.high[k] - middles.low[k] {
        0 => 0.0,
        wide => bins as f32 / wide as f32,
    });
    let bin_of = |m: i32, k: usize| (((m - origin[k]) as f32 * per_step[k]) as usize).min(bins - 1);
    let empty: Bins = [[Bin { bounds: Bounds::EMPTY, count: 0 }; BINS]; 3];
    let pass = |items: &[Item]| {
        let mut all = empty;
        for item in items {
            let middle = item.bounds.middle();
            for k in 0..3 {
                let bin = &mut all[k][bin_of(middle[k], k)];
                bin.bounds = bin.bounds.join(item.bounds);
                bin.count += 1;
            }
        }
        all
    };
    let all =
        if n < PARALLEL { pass(items) } else { items.par_chunks(PARALLEL / 2).map(pass).reduce(|| empty, merged) };
    let mut best = (f32::INFINITY, 0, 0);
    for k in (0..3).filter(|&k| per_step[k] > 0.0) {
        let mut after = [0.0f32; BINS];
        let (mut b, mut count) = (Bounds::EMPTY, 0);
        for i in (1..bins).rev() {
            b = b.join(all[k][i].bounds);
            count += all[k][i].count;
            after[i] = if count == 0 { f32::INFINITY } else { b.half_area(scale) * count as f32 };
        }
        let (mut b, mut count) = (Bounds::EMPTY, 0);
        for i in 1..bins {
            b = b.join(all[k][i - 1].bounds);
            count += all[k][i - 1].count;
            if count > 0 {
                let cost = b.half_area(scale) * count as f32 + after[i];
                best = if cost < best.0 { (cost, k, i) } else { best };
            }
        }
    }
    let (cost, k, split) = best;
    let area = bounds.half_area(scale);
    if n <= MAX_LEAF && area * n as f32 <= area + cost {
        return None;
    }
    let (mut i, mut j) = (0, n);
    while i < j {
        if bin_of(items[i].bounds.middle()[k], k) < split {
            i += 1;
        } else {
            j -= 1;
            items.swap(i, j);
        }
    }
    // Both ends of the range of centres are taken, so a split always parts them; a cost that is no number does not.
    Some(if i == 0 || i == n { n / 2 } else { i })
}

fn merged(mut a: Bins, b: Bins) -> Bins {
    for (a, b) in a.iter_mut().flatten().zip(b.iter().flatten()) {
        *a = Bin { bounds: a.bounds.join(b.bounds), count: a.count + b.count };
    }
    a
}

#[cfg(test)]
mod tests {
    use super::super::testing::{Rng, TestMesh, boxes, lattice, soup};
    use super::*;

    fn check(bvh: &Bvh, mesh: &TestMesh) {
        let mut seen = bvh.order.clone();
        seen.sort_unstable();
        assert!(seen.iter().copied().eq(0..mesh.triangles.len() as u32), "each triangle once");
        let (mut nodes, mut triangles) = (0, 0);
        let mut stack = vec![(0u32, [[i32::MIN; 3], [i32::MAX; 3]])];
        while let Some((at, outer)) = stack.pop() {
            let node = &bvh.nodes[at as usize];
            nodes += 1;
            for i in (0..WIDTH).filter(|&i| node.sides[0][0][i] < i32::MAX) {
                let [low, high]: [[i32; 3]; 2] = std::array::from_fn(|s| std::array::from_fn(|k| node.sides[s][k][i]));
                assert!((0..3).all(|k| outer[0][k] <= low[k] && high[k] <= outer[1][k]));
                let Child { first, count } = node.children[i];
                if count == 0 {
                    stack.push((first, [low, high]));
                }
                for &t in &bvh.order[first as usize..][..count as usize] {
                    triangles += 1;
                    for corner in mesh.surface().corners(t) {
                        let step = |v: i32, k: usize| i64::from(v) << bvh.shift[k];
                        let inside = |k| step(low[k] + PAD, k) <= corner[k] && corner[k] < step(high[k] - PAD + 1, k);
                        assert!((0..3).all(inside));
                    }
                }
            }
        }
        assert_eq!((nodes, triangles), (bvh.nodes.len(), bvh.order.len()), "all reached, once");
    }

    #[test]
    fn trees_are_sound_and_the_same_on_any_number_of_threads() {
        let mut rng = Rng(5);
        let mut meshes = vec![soup(&mut rng, 20, 40_000, 50), soup(&mut rng, 24, 1, 3), boxes(&mut rng, 12, 50)];
        let mut pile = soup(&mut rng, 16, 1, 2);
        pile.triangles = vec![pile.triangles[0]; 5000];
        meshes.push(pile);
        for mesh in &meshes {
            let bvh = Bvh::build(mesh.surface(), [1.0, 1.0, 0.1]);
            check(&bvh, mesh);
            let single = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
            let again = single.install(|| Bvh::build(mesh.surface(), [1.0, 1.0, 0.1]));
            assert_eq!(bvh.order, again.order);
        }
    }

    #[test]
    fn empty() {
        let mesh = TestMesh { lattice: lattice(4), positions: vec![], triangles: vec![] };
        let bvh = Bvh::build(mesh.surface(), [1.0; 3]);
        bvh.closest([0.0; 3], [0.0, 0.0, 1.0], |_, _| panic!("nothing to visit"));
        bvh.along_light([0; 2], i64::MAX, |_, _| panic!("nothing to visit"));
    }
}
