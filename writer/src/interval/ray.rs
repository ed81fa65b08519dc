//! The interval on one light ray.

use std::cmp::Ordering;

use super::triangle::{Local, Surface};
use super::{DEEPEST, Event, Interval, ceil};

/// A ray's first surface and the end of the stretch behind it, as ceilings of their exact depths.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stretch {
    /// The ray meets nothing.
    Uncovered,
    /// ceil(lo) and ceil(hi); hi may be past every depth (`i64::MAX`) under second-surface.
    Covered {
        /// ceil(lo)
        lo: i64,
        /// ceil(hi)
        hi: i64,
    },
}

impl Stretch {
    /// The ray's interval and whether it is thin (CONVENTIONS: if X < E then X := E).
    pub fn interval(self) -> (Interval, bool) {
        match self {
            Stretch::Uncovered => (Interval::UNCOVERED, false),
            Stretch::Covered { lo, hi } => {
                let thin = hi - 1 < lo;
                let max = if thin { lo } else { (hi - 1).min(DEEPEST) };
                (Interval { min: lo.clamp(0, DEEPEST) as u32, max: max.clamp(0, DEEPEST) as u32 }, thin)
            }
        }
    }
}

#[derive(Clone, Copy)]
struct Hit {
    z: f64,
    eps: f64,
    at: u32,
    event: Event,
    solid: u32,
}

/// Buffers that rays reuse.
#[derive(Default)]
pub struct RayScratch {
    hits: Vec<Hit>,
    inside: Vec<(u32, i32)>,
}

/// A ray's own view of the surfaces of its square.
pub struct Rays<'a> {
    /// All surfaces, for exact depths.
    pub surfaces: &'a [Surface],
    /// The tile's surfaces.
    pub locals: &'a [Local],
    /// The tile's corner in the lattice.
    pub corner: [i64; 2],
    /// hi is the second surface.
    pub second_surface: bool,
}

impl Rays<'_> {
    /// The stretch on the ray at the tile-relative lattice point, taken as the limit from (dx eps, dy eps^2).
    pub fn stretch(&self, list: &[u32], p: [i64; 2], d: [i64; 2], scratch: &mut RayScratch) -> Stretch {
        self.stretch_among(&[], list, p, d, scratch)
    }

    /// Like [`Self::stretch`]; the ray is known to meet the surfaces of `met`.
    pub fn stretch_among(
        &self,
        met: &[u32],
        list: &[u32],
        p: [i64; 2],
        d: [i64; 2],
        scratch: &mut RayScratch,
    ) -> Stretch {
        let hits = &mut scratch.hits;
        hits.clear();
        let mut hit = |l: &Local| {
            let z = l.approximate(p[0], p[1]);
            hits.push(Hit { z, eps: l.eps, at: l.index, event: l.event, solid: l.solid });
        };
        for &i in met {
            hit(&self.locals[i as usize]);
        }
        for &i in list {
            let l = &self.locals[i as usize];
            if l.covers(p[0], p[1], d[0], d[1]) {
                hit(l);
            }
        }
        if hits.is_empty() {
            return Stretch::Uncovered;
        }
        let exact = |h: &Hit| self.surfaces[h.at as usize].depth(self.corner[0] + p[0], self.corner[1] + p[1]);
        let depth_order = |a: &Hit, b: &Hit| {
            if a.z + a.eps < b.z - b.eps {
                Ordering::Less
            } else if a.z - a.eps > b.z + b.eps {
                Ordering::Greater
            } else {
                exact(a).order(&exact(b))
            }
        };
        // puts what comes at place `i` there: rays leave after a few of their hits
        let bring = |hits: &mut [Hit], i: usize| {
            let mut least = i;
            for k in i + 1..hits.len() {
                if depth_order(&hits[k], &hits[least]).then(hits[k].event.cmp(&hits[least].event)).is_lt() {
                    least = k;
                }
            }
            hits.swap(i, least);
        };
        let ceil = |h: &Hit| {
            let (low, high) = (ceil(h.z - h.eps), ceil(h.z + h.eps));
            if low == high { low } else { exact(h).ceil() }
        };
        bring(hits, 0);
        let lo = ceil(&hits[0]);
        if self.second_surface {
            if hits.len() > 1 {
                bring(hits, 1);
            }
            return Stretch::Covered { lo, hi: hits.get(1).map_or(i64::MAX, ceil) };
        }
        let inside = &mut scratch.inside;
        inside.clear();
        let mut solids_inside = 0;
        let mut i = 0;
        while i < hits.len() {
            // all events at this depth; entries come first by the order above
            let mut j = i;
            while j < hits.len() && (j == i || depth_order(&hits[i], &hits[j]) == Ordering::Equal) {
                let h = &hits[j];
                let enters = h.event == Event::Enter;
                let step = if enters { 1 } else { -1 };
                let w = match inside.iter_mut().find(|(s, _)| *s == h.solid) {
                    Some((_, w)) => w,
                    None => {
                        inside.push((h.solid, 0));
                        let last = inside.len() - 1;
                        &mut inside[last].1
                    }
                };
                let before = *w > 0;
                *w += step;
                solids_inside += i32::from(*w > 0) - i32::from(before);
                // only exits follow at this depth
                if solids_inside == 0 && !enters {
                    return Stretch::Covered { lo, hi: ceil(&hits[i]) };
                }
                j += 1;
                if j < hits.len() {
                    bring(hits, j);
                }
            }
            if solids_inside == 0 {
                return Stretch::Covered { lo, hi: ceil(&hits[i]) };
            }
            i = j;
        }
        // never left: only a solid whose far side was cut away by the depth clamp
        Stretch::Covered { lo, hi: i64::MAX }
    }
}
