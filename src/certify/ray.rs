//! Single rays, and receivers at lattice points.

use super::facet::{Facet, Role};
use super::{Depth, Interval};
use num_bigint::BigInt;
use num_traits::{Signed, Zero};
use std::cmp::Ordering;
use umbrage_format::projection::UNCOVERED;

/// Entries minus exits, per solid.
#[derive(Default)]
pub(super) struct Windings(Vec<(u32, i32)>);

impl Windings {
    pub(super) fn add(&mut self, solid: u32, step: i32) {
        match self.0.iter_mut().find(|w| w.0 == solid) {
            Some(w) => w.1 += step,
            None => self.0.push((solid, step)),
        }
    }

    pub(super) fn inside(&self) -> bool {
        self.0.iter().any(|w| w.1 > 0)
    }
}

/// An event on a ray: a step of a solid's counter.
pub(super) struct Event {
    pub(super) offset: u32,
    pub(super) step: i32,
}

impl Role {
    /// The events of a facet; under second-surface a sheet counts once.
    pub(super) fn events(self, second_surface: bool) -> impl Iterator<Item = Event> {
        let (first, second) = match self {
            Role::Wall => (None, None),
            Role::Entry => (Some((0, 1)), None),
            Role::Exit => (Some((0, -1)), None),
            Role::Sheet(_) if second_surface => (Some((0, 1)), None),
            Role::Sheet(t) => (Some((0, 1)), Some((t, -1))),
        };
        first.into_iter().chain(second).map(|(offset, step)| Event { offset, step })
    }
}

/// First depth and end of the stretch behind it; `None` for "never ends".
pub(super) struct Stretch {
    pub(super) lo: Depth,
    pub(super) hi: Option<Depth>,
}

/// The stretch on the ray through `p`; `None` when the ray meets nothing.
pub(super) fn stretch<'a>(
    facets: impl Iterator<Item = &'a Facet>,
    p: [i64; 2],
    second_surface: bool,
) -> Option<Stretch> {
    let mut events: Vec<(Depth, u32, i32)> = Vec::new();
    for f in facets.filter(|f| f.meets(p)) {
        let z = f.depth(p);
        events.extend(f.role.events(second_surface).map(|e| (z.plus(e.offset.into()), f.solid, e.step)));
    }
    events.sort_by_key(|e| e.0);
    let lo = events.first()?.0;
    if second_surface {
        return Some(Stretch { lo, hi: events.get(1).map(|e| e.0) });
    }
    let mut windings = Windings::default();
    for group in events.chunk_by(|a, b| a.0 == b.0) {
        for e in group {
            windings.add(e.1, e.2);
        }
        if !windings.inside() {
            return Some(Stretch { lo, hi: Some(group[0].0) });
        }
    }
    Some(Stretch { lo, hi: None })
}

/// The largest stored depth of a texel that something covers.
pub(super) const DEEPEST: u32 = UNCOVERED - 1;

/// Lattice interval of a ray, and whether it is thin.
pub(super) fn interval(stretch: Option<&Stretch>) -> (Interval, bool) {
    let Some(Stretch { lo, hi }) = stretch else {
        return (Interval { min: UNCOVERED, max: UNCOVERED }, false);
    };
    let deepest = i128::from(DEEPEST);
    let min = lo.ceil().clamp(0, deepest);
    let max = hi.map_or(deepest, |h| (h.ceil() - 1).min(deepest));
    (Interval { min: min as u32, max: max.max(min) as u32 }, max < min)
}

/// Turns from the positive x axis, counter-clockwise.
fn compare_angles(a: &[BigInt; 2], b: &[BigInt; 2]) -> Ordering {
    let lower = |v: &[BigInt; 2]| v[1].is_negative() || (v[1].is_zero() && v[0].is_negative());
    lower(a).cmp(&lower(b)).then_with(|| (&b[0] * &a[1]).cmp(&(&a[0] * &b[1])))
}

/// Whether a whole neighbourhood of the point at depth `d` over `p` lies inside the solids (their touching faces
/// included). `facets` are those whose closed projection holds `p`.
pub(super) fn surrounded(facets: &[Facet], p: [i64; 2], d: &Depth) -> bool {
    /// A surface near the receiver's ray.
    struct Sheet<'a> {
        facet: &'a Facet,
        step: i32,
        at: Ordering,
    }
    let sheets: Vec<Sheet> = facets
        .iter()
        .flat_map(|f| {
            let z = f.depth(p);
            f.role.events(false).map(move |e| (f, e.step, z.plus(e.offset.into())))
        })
        .map(|(facet, step, z)| Sheet { facet, step, at: z.cmp(d) })
        .collect();

    // The neighbourhood falls into sectors, bounded by the edges through p and by the lines through p where two of
    // the surfaces through the point itself cross. In each sector one ray close to p stands for all.
    let both = |v: [BigInt; 2]| [[-&v[0], -&v[1]], v];
    let mut bounds: Vec<[BigInt; 2]> = Vec::new();
    for axis in [[1, 0], [0, 1]] {
        bounds.extend(both(axis.map(BigInt::from)));
    }
    for f in facets {
        for [a, b, c] in (0..3).map(|k| f.edge(k, p)) {
            if c == 0 {
                bounds.extend(both([BigInt::from(b), BigInt::from(-a)]));
            }
        }
    }
    let here: Vec<&Sheet> = sheets.iter().filter(|s| s.at.is_eq()).collect();
    for (i, s) in here.iter().enumerate() {
        for t in &here[..i] {
            let [a, b] = [0, 1]
                .map(|k| BigInt::from(s.facet.slope[k]) * t.facet.area - BigInt::from(t.facet.slope[k]) * s.facet.area);
            if !(a.is_zero() && b.is_zero()) {
                bounds.extend(both([b, -a]));
            }
        }
    }
    bounds.sort_by(compare_angles);
    bounds.dedup_by(|a, b| compare_angles(a, b).is_eq());

    let sectors = bounds.len();
    (0..sectors).all(|i| {
        let (v, w) = (&bounds[i], &bounds[(i + 1) % sectors]);
        let way = [&v[0] + &w[0], &v[1] + &w[1]];
        let along = |a: i128, b: i128| &way[0] * a + &way[1] * b;
        let covers = |f: &Facet| {
            (0..3).all(|k| {
                let [a, b, c] = f.edge(k, p);
                c > 0 || along(a, b).is_positive()
            })
        };
        let mut windings = Windings::default();
        let mut near: Vec<(BigInt, &Sheet)> = Vec::new();
        for s in sheets.iter().filter(|s| covers(s.facet)) {
            match s.at {
                Ordering::Less => windings.add(s.facet.solid, s.step),
                Ordering::Equal => near.push((along(s.facet.slope[0], s.facet.slope[1]), s)),
                Ordering::Greater => {}
            }
        }
        // Rates of descent along `way`, as fractions over the facets' areas.
        let order = |a: &(BigInt, &Sheet), b: &(BigInt, &Sheet)| (&a.0 * b.1.facet.area).cmp(&(&b.0 * a.1.facet.area));
        near.sort_by(order);
        windings.inside()
            && near.chunk_by(|a, b| order(a, b).is_eq()).all(|group| {
                for (_, s) in group {
                    windings.add(s.facet.solid, s.step);
                }
                windings.inside()
            })
    })
}
