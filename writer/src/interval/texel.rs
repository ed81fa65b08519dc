//! The exact answer for one texel (CONVENTIONS, Intervals): its area interval where that is not empty, else the
//! interval of its centre.

use super::cell::Cell;
use super::proof::Prover;
use super::ray::{RayScratch, Rays, Stretch};
use super::triangle::{Cover, Local};
use super::{DEEPEST, Event, Interval};

/// What a texel may store.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Truth {
    /// The allowed values.
    pub interval: Interval,
    /// The interval holds for every receiver in the closed texel square.
    pub certified: bool,
    /// The centre's stretch holds no lattice depth.
    pub thin: bool,
}

/// How texels were settled.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Effort {
    /// By a proof for the whole texel.
    pub proven: u64,
    /// By sample rays that contradict each other.
    pub refuted: u64,
    /// By looking at smaller squares.
    pub divided: u64,
    /// Of those squares, how many needed the exact arrangement.
    pub exact: u64,
}

impl Effort {
    /// Adds another part's counts.
    pub fn add(&mut self, other: &Effort) {
        self.proven += other.proven;
        self.refuted += other.refuted;
        self.divided += other.divided;
        self.exact += other.exact;
    }
}

/// Buffers for one thread.
#[derive(Default)]
pub struct Scratch {
    /// Proofs, for larger squares too.
    pub prover: Prover,
    ray: RayScratch,
    /// How texels were settled so far.
    pub effort: Effort,
}

/// The exact arrangement is asked where no edges are left, where at most this many surfaces are left in an eighth of a
/// texel, or with edges in a sixteenth, and in any case in a sixty-fourth.
const EXACT_LIST: usize = 10;

/// Largest lo and smallest hi seen so far, as ceilings; `open` once a ray met nothing.
struct Bounds {
    lo: i64,
    hi: i64,
    open: bool,
}

impl Bounds {
    /// Takes a ray into account; true once no value can be right for all rays.
    fn add(&mut self, s: Stretch) -> bool {
        match s {
            Stretch::Uncovered => self.open = true,
            Stretch::Covered { lo, hi } => {
                self.lo = self.lo.max(lo);
                self.hi = self.hi.min(hi);
            }
        }
        self.open || self.lo >= self.hi
    }

    /// Takes other rays' bounds into account.
    fn join(&mut self, other: &Bounds) -> bool {
        self.lo = self.lo.max(other.lo);
        self.hi = self.hi.min(other.hi);
        self.open |= other.open;
        self.open || self.lo >= self.hi
    }
}

/// Whether nothing in the list covers any of its square.
pub fn is_open(locals: &[Local], list: &[u32]) -> bool {
    list.iter().all(|i| locals[*i as usize].event == Event::Wall)
}

/// Whether all surfaces cover the square and no two of them cross or touch in it, but for level ones that coincide.
fn layered(rays: &Rays, list: &[u32], p: [i64; 2], size: i64) -> bool {
    let local = |i: &u32| &rays.locals[*i as usize];
    if !list.iter().all(|i| local(i).cover(p[0], p[1], size) == Cover::All) {
        return false;
    }
    let mut order: Vec<&Local> = list.iter().map(local).collect();
    let half = size / 2;
    order.sort_by(|a, b| {
        let at = |l: &Local| l.approximate(p[0] + half, p[1] + half);
        at(a).total_cmp(&at(b))
    });
    order.windows(2).all(|w| {
        // level surfaces may coincide: that is the same all over, and rays put entries first
        let level = |l: &Local| l.zmin == l.zmax;
        if w[0].zmax < w[1].zmin || (level(w[0]) && level(w[1]) && w[0].zmax == w[1].zmin) {
            return true;
        }
        (0..4).all(|c| {
            let q = [p[0] + (c & 1) * size, p[1] + (c >> 1) * size];
            w[0].approximate(q[0], q[1]) + w[0].eps < w[1].approximate(q[0], q[1]) - w[1].eps
        })
    })
}

/// The truth for every texel of the tile-relative square, where level surfaces that cover it begin and end the stretch in front of all
/// others: then it is the same on every ray. `over` says of a surface's place in the list whether it covers the square.
pub fn level(
    rays: &Rays,
    list: &[u32],
    over: impl Fn(usize) -> bool,
    p: [i64; 2],
    size: i64,
    scratch: &mut Scratch,
) -> Option<Truth> {
    let (mut first, mut others) = (i64::MAX, i64::MAX);
    for (k, i) in list.iter().enumerate() {
        let l = &rays.locals[*i as usize];
        let nearest = if l.event != Event::Wall && l.zmin == l.zmax && over(k) { &mut first } else { &mut others };
        *nearest = l.zmin.min(*nearest);
    }
    if first >= others {
        return None;
    }
    let centre = rays.stretch(list, p.map(|c| c + size / 2), [1, 1], &mut scratch.ray);
    match centre {
        Stretch::Covered { lo, hi } if hi < others => {
            let (interval, thin) = centre.interval();
            Some(Truth { interval, certified: lo < hi, thin })
        }
        _ => None,
    }
}

/// The truth for the texel at tile-relative lattice point `p`; `list` holds the surfaces that overlap its open square,
/// sorted by solid. An interval narrower than `wide` is the whole truth; a wider one may be a proven part of it.
pub fn texel(rays: &Rays, list: &[u32], p: [i64; 2], size: i64, wide: u64, scratch: &mut Scratch) -> Truth {
    if is_open(rays.locals, list) {
        return Truth { interval: Interval::UNCOVERED, certified: true, thin: false };
    }
    if let Some(interval) = scratch.prover.prove(rays, list, p, size, rays.second_surface, false)
        && interval.width() >= wide
    {
        scratch.effort.proven += 1;
        return Truth { interval, certified: true, thin: false };
    }
    let half = size / 2;
    let centre = rays.stretch(list, [p[0] + half, p[1] + half], [1, 1], &mut scratch.ray);
    let mut bounds = Bounds { lo: 0, hi: DEEPEST + 1, open: false };
    let area = if bounds.add(centre) || corners(rays, list, p, size, &mut bounds, &mut scratch.ray) {
        scratch.effort.refuted += 1;
        None
    } else if let Some(i) = scratch.prover.prove(rays, list, p, size, rays.second_surface, true) {
        scratch.effort.proven += 1;
        Some(i)
    } else if refute(rays, list, p, size, &mut bounds, &mut scratch.ray) {
        scratch.effort.refuted += 1;
        None
    } else {
        scratch.effort.divided += 1;
        let square = Square { p, size, texel: size };
        match settle(rays, list, square, &mut bounds, false, scratch) {
            Settled::Right(i) => Some(i),
            Settled::Edge => None,
            Settled::Unclear => match settle(rays, list, square, &mut bounds, true, scratch) {
                Settled::Right(_) => Some(Interval { min: bounds.lo as u32, max: (bounds.hi - 1) as u32 }),
                Settled::Edge | Settled::Unclear => None,
            },
        }
    };
    let area = match area {
        Some(proven) if proven.width() < wide => {
            let square = Square { p, size, texel: size };
            match settle(rays, list, square, &mut bounds, true, scratch) {
                Settled::Right(_) => Some(Interval { min: bounds.lo as u32, max: (bounds.hi - 1) as u32 }),
                Settled::Edge | Settled::Unclear => Some(proven),
            }
        }
        area => area,
    };
    match area {
        Some(interval) => Truth { interval, certified: true, thin: false },
        None => {
            let (interval, thin) = centre.interval();
            Truth { interval, certified: false, thin }
        }
    }
}

/// A square within a texel of side `texel`.
#[derive(Clone, Copy)]
struct Square {
    p: [i64; 2],
    size: i64,
    texel: i64,
}

/// What is known about a square.
enum Settled {
    /// All of these are right everywhere in it (when refining: all that the bounds leave open).
    Right(Interval),
    /// Nothing is.
    Edge,
    /// The proven parts have nothing in common, but their proofs may be narrower than the truth.
    Unclear,
}

/// Proves quarters instead of the whole, and asks the exact arrangement where few surfaces are left in a small one.
///
/// A proof may be narrower than the truth. So when the parts have nothing in common, a second run with `refine`
/// accepts a proof only where it allows all that the rays seen so far leave open, looks closer elsewhere, and keeps
/// the exact answers in `bounds`: what is left open in the end is right everywhere.
fn settle(
    rays: &Rays,
    list: &[u32],
    square: Square,
    bounds: &mut Bounds,
    refine: bool,
    scratch: &mut Scratch,
) -> Settled {
    let Square { p, size, texel } = square;
    if is_open(rays.locals, list) {
        // the rest of the texel is covered
        return Settled::Edge;
    }
    let mut own = Bounds { lo: 0, hi: DEEPEST + 1, open: false };
    if corners(rays, list, p, size, &mut own, &mut scratch.ray) || bounds.join(&own) {
        return Settled::Edge;
    }
    if layered(rays, list, p, size) {
        // the same surfaces begin and end the stretch on every ray, so both ends are linear
        return Settled::Right(Interval { min: own.lo as u32, max: (own.hi - 1) as u32 });
    }
    if let Some(i) = scratch.prover.prove(rays, list, p, size, rays.second_surface, true)
        && (!refine || (i64::from(i.min) <= bounds.lo && bounds.hi - 1 <= i64::from(i.max)))
    {
        return Settled::Right(i);
    }
    let faces = || list.iter().map(|i| &rays.locals[*i as usize]).filter(|l| l.event != Event::Wall);
    let edges = faces().filter(|l| l.cover(p[0], p[1], size) != Cover::All).count();
    let small = |part: i64| size * part <= texel;
    let few = (small(8) && faces().count() <= EXACT_LIST) || (small(16) && edges <= EXACT_LIST);
    if edges == 0 || size == 1 || few || small(64) {
        scratch.effort.exact += 1;
        return match Cell::new(rays, list, p, size, bounds.hi).area(0, DEEPEST + 1) {
            Some(i) => {
                bounds.lo = bounds.lo.max(i64::from(i.min));
                bounds.hi = bounds.hi.min(i64::from(i.max) + 1);
                if bounds.lo < bounds.hi { Settled::Right(i) } else { Settled::Edge }
            }
            None => Settled::Edge,
        };
    }
    let half = size / 2;
    let mut all = Some(Interval { min: 0, max: DEEPEST as u32 });
    for c in 0..4 {
        let q = [p[0] + (c & 1) * half, p[1] + (c >> 1) * half];
        let near: Vec<u32> =
            list.iter().copied().filter(|i| rays.locals[*i as usize].cover(q[0], q[1], half) != Cover::None).collect();
        match settle(rays, &near, Square { p: q, size: half, texel }, bounds, refine, scratch) {
            Settled::Right(part) => all = all.and_then(|a| a.intersect(part)),
            Settled::Edge => return Settled::Edge,
            Settled::Unclear => all = None,
        }
    }
    match all {
        Some(i) => Settled::Right(i),
        None if refine => Settled::Right(Interval::UNCOVERED),
        None => Settled::Unclear,
    }
}

/// Adds the rays at the corners; true once they contradict each other.
fn corners(rays: &Rays, list: &[u32], p: [i64; 2], size: i64, bounds: &mut Bounds, scratch: &mut RayScratch) -> bool {
    let far = [p[0] + size, p[1] + size];
    [(p, [1, 1]), ([far[0], p[1]], [-1, 1]), ([p[0], far[1]], [1, -1]), (far, [-1, -1])]
        .into_iter()
        .any(|(q, d)| bounds.add(rays.stretch(list, q, d, scratch)))
}

/// Looks for rays that contradict each other: vertices inside, and both sides of each edge on the border.
fn refute(rays: &Rays, list: &[u32], p: [i64; 2], size: i64, bounds: &mut Bounds, scratch: &mut RayScratch) -> bool {
    let far = [p[0] + size, p[1] + size];
    for &i in list {
        let l = &rays.locals[i as usize];
        let s = &rays.surfaces[l.index as usize];
        for k in 0..3 {
            let v = [i64::from(s.x[k]) - rays.corner[0], i64::from(s.y[k]) - rays.corner[1]];
            if p[0] < v[0] && v[0] < far[0] && p[1] < v[1] && v[1] < far[1] {
                for d in [[1, 1], [-1, 1], [1, -1], [-1, -1]] {
                    if bounds.add(rays.stretch(list, v, d, scratch)) {
                        return true;
                    }
                }
            }
        }
    }
    for &i in list {
        let l = &rays.locals[i as usize];
        for k in 0..3 {
            let e = [l.a[k], l.b[k]];
            for axis in 0..2 {
                let other = 1 - axis;
                if e[other] == 0 {
                    continue;
                }
                for (side, inward) in [(p[axis], 1), (far[axis], -1)] {
                    let n = -(i128::from(l.c[k]) + i128::from(e[axis]) * i128::from(side));
                    let n = if e[other] < 0 { -n } else { n };
                    let at = n.div_euclid(i128::from(e[other].abs()));
                    if at < i128::from(p[other]) || at >= i128::from(far[other]) {
                        continue;
                    }
                    for (t, turn) in [(at as i64, -1), (at as i64, 1), (at as i64 + 1, -1)] {
                        if (t == p[other] && turn < 0) || t > far[other] {
                            continue;
                        }
                        let (mut q, mut d) = ([0; 2], [0; 2]);
                        q[axis] = side;
                        q[other] = t;
                        d[axis] = inward;
                        d[other] = turn;
                        if bounds.add(rays.stretch(list, q, d, scratch)) {
                            return true;
                        }
                    }
                }
            }
        }
    }
    false
}
