//! In the manner of Kevin Myers, *Sparse Shadow Tree*, SIGGRAPH 2016 Talks (Activision): a quadtree whose leaves hold
//! planes.
//!
//! | | bytes | holds |
//! |---|---|---|
//! | inner node | 8 | 4 bits: which children are leaves; 28 bits: its first inner child; 32 bits: its first leaf |
//! | leaf | 6 | depth at the middle, change along x and along y over the whole leaf: 16 bits each |
//!
//! All three count in steps of 2^16 lattice depths; depth 65535 stands for uncovered. Depth at a texel: to the next
//! lattice step, at least 0. A square becomes a leaf where one plane comes within one step (2^16 lattice depths, 1/65536
//! of the depth range) of every texel's interval: that is the stated error; it is measured. A texel alone always has such
//! a plane.
//!
//! Slopes are tried as least squares give them for the first depths, the middles and the last depths; the best offset of
//! each is exact. A square is tried only where its four quarters are leaves.
//!
//! The talk's one page was not at hand: that leaves hold depth, ddx and ddy of 16 bits is from this project's notes;
//! steps, fitting, tolerance and nodes are ours.

use umbrage::writer::interval::Interval;

use super::image::Image;
use super::{Baseline, answers_by_value};

/// Lattice depths in a step, log2.
const STEP_LOG2: u32 = 16;
/// How far a leaf may be off an interval, lattice depths.
pub const TOLERANCE: i64 = 1 << STEP_LOG2;
/// Depth of a leaf without geometry.
const OPEN: u16 = u16::MAX;

/// Depth, change along x, change along y.
type Plane = [u16; 3];

/// Depth of the plane at a texel of its square.
#[inline]
fn at(plane: Plane, dx: u32, dy: u32, log2: u32) -> u32 {
    if plane[0] == OPEN {
        return u32::MAX;
    }
    // Twice the place from the middle in texels: odd, and even for a single texel.
    let twice = |d: u32| 2 * i64::from(d) + 1 - (1i64 << log2);
    let across = i64::from(plane[1] as i16) * twice(dx) + i64::from(plane[2] as i16) * twice(dy);
    let depth = (i64::from(plane[0]) << STEP_LOG2) + ((across << STEP_LOG2) >> (log2 + 1));
    depth.clamp(0, i64::from(u32::MAX - 1)) as u32
}

/// A part of the tree under construction.
enum Node {
    Leaf(Plane),
    Inner(Box<[Node; 4]>),
}

/// A map.
pub struct PlaneTree {
    log2: u32,
    /// Kinds of children and first inner child; first leaf.
    inner: Vec<[u32; 2]>,
    leaves: Vec<Plane>,
}

impl PlaneTree {
    /// Fits planes to the intervals.
    pub fn new(image: &Image) -> PlaneTree {
        let root = build(image, [0, 0], image.log2);
        let mut map = PlaneTree { log2: image.log2, inner: Vec::new(), leaves: Vec::new() };
        match root {
            Node::Leaf(plane) => map.leaves.push(plane),
            Node::Inner(children) => {
                map.inner.push([0, 0]);
                map.write(0, *children);
            }
        }
        map
    }

    /// Writes the children of inner node `place` side by side, then what is below them.
    fn write(&mut self, place: usize, children: [Node; 4]) {
        let mut head = [self.inner.len() as u32, self.leaves.len() as u32];
        assert!(head[0] < 1 << 28, "more than 28 bits of inner nodes");
        let mut below = Vec::new();
        for (c, child) in children.into_iter().enumerate() {
            match child {
                Node::Leaf(plane) => {
                    head[0] |= 1 << (28 + c);
                    self.leaves.push(plane);
                }
                Node::Inner(children) => {
                    below.push((self.inner.len(), children));
                    self.inner.push([0, 0]);
                }
            }
        }
        self.inner[place] = head;
        below.into_iter().for_each(|(place, children)| self.write(place, *children));
    }

    #[inline(always)]
    fn value_of(&self, x: u32, y: u32) -> u32 {
        let (mut node, mut level) = (0usize, self.log2);
        if self.inner.is_empty() {
            return at(self.leaves[0], x, y, level);
        }
        loop {
            let [head, first] = self.inner[node];
            level -= 1;
            let c = (y >> level & 1) << 1 | x >> level & 1;
            let leaves = head >> 28;
            let before = (leaves & ((1 << c) - 1)).count_ones();
            if leaves >> c & 1 != 0 {
                let mask = (1 << level) - 1;
                return at(self.leaves[(first + before) as usize], x & mask, y & mask, level);
            }
            node = ((head & 0xFFF_FFFF) + c - before) as usize;
        }
    }
}

impl Baseline for PlaneTree {
    fn name(&self) -> String {
        "plane tree, 16 bit".to_string()
    }

    fn citation(&self) -> &'static str {
        "in the manner of Myers, Sparse Shadow Tree, SIGGRAPH 2016 Talks"
    }

    fn bytes(&self) -> u64 {
        (8 * self.inner.len() + 6 * self.leaves.len()) as u64
    }

    answers_by_value!();
}

fn build(image: &Image, origin: [usize; 2], level: u32) -> Node {
    if level == 0 {
        return Node::Leaf(texel(image.allowed(origin[0], origin[1])));
    }
    let half = 1usize << (level - 1);
    let child = |c: usize| build(image, [origin[0] + (c & 1) * half, origin[1] + (c >> 1) * half], level - 1);
    let children: [Node; 4] = if level > 6 {
        let ((a, b), (c, d)) =
            rayon::join(|| rayon::join(|| child(0), || child(1)), || rayon::join(|| child(2), || child(3)));
        [a, b, c, d]
    } else {
        [0, 1, 2, 3].map(child)
    };
    let leaves = children.iter().filter_map(|n| if let Node::Leaf(p) = n { Some(*p) } else { None });
    let leaves: Vec<Plane> = leaves.collect();
    if leaves.len() == 4 {
        // Uncovered texels suit no plane and nothing else suits them.
        let open = leaves.iter().filter(|p| p[0] == OPEN).count();
        let plane = match open {
            4 => Some([OPEN, 0, 0]),
            0 => fit(image, origin, level),
            _ => None,
        };
        if let Some(plane) = plane {
            return Node::Leaf(plane);
        }
    }
    Node::Inner(Box::new(children))
}

/// A plane for one texel: the step nearest to the middle of its interval.
fn texel(interval: Interval) -> Plane {
    if interval == Interval::UNCOVERED {
        return [OPEN, 0, 0];
    }
    [rounded(f64::from(interval.middle()) / f64::from(1u32 << STEP_LOG2)), 0, 0]
}

fn rounded(depth: f64) -> u16 {
    depth.round().clamp(0.0, f64::from(OPEN - 1)) as u16
}

/// A plane for the square, if one of those tried comes within the tolerance everywhere.
fn fit(image: &Image, origin: [usize; 2], level: u32) -> Option<Plane> {
    let size = 1usize << level;
    let texels = || (0..size * size).map(move |i| [i & (size - 1), i >> level]);
    let interval = |[dx, dy]: [usize; 2]| image.allowed(origin[0] + dx, origin[1] + dy);
    let twice = |d: usize| 2.0 * d as f64 + 1.0 - size as f64;
    // Places are even about the middle, so that the sums separate.
    let mut moments = [[0.0f64; 2]; 3];
    let mut square = 0.0;
    for t in texels() {
        let i = interval(t);
        let (u, v) = (twice(t[0]), twice(t[1]));
        square += u * u;
        for (m, z) in moments.iter_mut().zip([i.min, i.middle(), i.max].map(f64::from)) {
            m[0] += u * z;
            m[1] += v * z;
        }
    }
    let step = f64::from(1u32 << STEP_LOG2);
    // Per step of `twice`, so `2 size` of them make the change over the square.
    let slopes = moments.map(|m| m.map(|s| (s / square * 2.0 * size as f64 / step).round().clamp(-32768.0, 32767.0)));
    // A level plane, which thick objects allow, too.
    slopes.into_iter().chain([[0.0, 0.0]]).find_map(|[sx, sy]| {
        let (mut low, mut high) = (f64::NEG_INFINITY, f64::INFINITY);
        for t in texels() {
            let i = interval(t);
            let off = (sx * twice(t[0]) + sy * twice(t[1])) / (2.0 * size as f64) * step;
            low = low.max(f64::from(i.min) - off);
            high = high.min(f64::from(i.max) - off);
            if low > high + 2.0 * TOLERANCE as f64 {
                return None;
            }
        }
        let plane = [rounded(0.5 * (low + high) / step), sx as i16 as u16, sy as i16 as u16];
        let near = |t: [usize; 2]| {
            let (i, v) = (interval(t), i64::from(at(plane, t[0] as u32, t[1] as u32, level)));
            i64::from(i.min) - TOLERANCE <= v && v <= i64::from(i.max) + TOLERANCE
        };
        texels().all(near).then_some(plane)
    })
}

#[cfg(test)]
mod tests {
    use super::super::error::Errors;
    use super::super::tests::{city, made};
    use super::*;

    const STEP: u32 = 1 << STEP_LOG2;

    #[test]
    fn nodes_counted_by_hand() {
        // One leaf: a ramp.
        let ramp = made(3, |x, y| [100 * STEP + 7 * STEP * x as u32 + 3 * STEP * y as u32; 2]);
        let map = PlaneTree::new(&ramp);
        assert_eq!((map.bytes(), map.inner.len()), (6, 0));
        assert!(Errors::of(&map, &ramp, None).largest <= u64::from(STEP));
        // A root, one quarter with one texel that differs: 3 leaves + (3 leaves + 4 texels), 3 inner nodes.
        let spot = made(3, |x, y| [if (x, y) == (5, 0) { 900 * STEP } else { 100 * STEP }; 2]);
        let map = PlaneTree::new(&spot);
        assert_eq!((map.inner.len(), map.leaves.len()), (3, 10));
        assert_eq!(map.bytes(), 3 * 8 + 10 * 6);
        assert_eq!((map.value_of(5, 0), map.value_of(4, 0), map.value_of(7, 7)), (900 * STEP, 100 * STEP, 100 * STEP));
        // Uncovered and covered texels don't mix.
        let half = made(1, |x, _| if x == 0 { [u32::MAX; 2] } else { [5 * STEP; 2] });
        let map = PlaneTree::new(&half);
        assert_eq!((map.value_of(0, 1), map.value_of(1, 1), map.bytes()), (u32::MAX, 5 * STEP, 8 + 24));
    }

    #[test]
    fn the_error_is_the_stated_one() {
        let (_, image) = city(512);
        let map = PlaneTree::new(&image);
        let found = Errors::of(&map, &image, None);
        // Guarded intervals lie within the true ones.
        assert!(found.largest <= TOLERANCE as u64, "{found:?}");
        assert!(found.outside > 0 && found.share() < 0.5, "{found:?}");
        assert!(map.leaves.iter().any(|p| p[0] != OPEN && (p[1], p[2]) != (0, 0)), "some leaf has a slope");
        assert!(map.bytes() < 4 * 512 * 512 / 4);
    }
}
