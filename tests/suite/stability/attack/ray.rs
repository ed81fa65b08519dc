//! The plainest ray there is: every triangle, whole numbers, nothing skipped. The third opinion beside the baker and the
//! oracle, of which it shares the number type alone.

use umbrage::certify::Depth;
use umbrage::writer::solid::{SnappedMesh, SolidKind};

/// What a ray meets.
struct Event {
    depth: Depth,
    solid: u32,
    step: i32,
    /// Whether a surface of the scene lies there; not so behind a sheet, where its thickness ends.
    surface: bool,
}

/// A ray along the light that runs through the inside of every projected triangle that it meets.
pub struct Ray {
    events: Vec<Event>,
}

/// A receiver on a ray and its truth.
pub struct Receiver {
    /// Its depth rounded up: what is held against the stored value.
    pub depth: u32,
    /// Whether nothing lies before it.
    pub lit: bool,
}

impl Ray {
    /// The ray at a lattice point, or nothing where it runs along the border of a triangle: there the sides differ and a
    /// ray decides nothing.
    pub fn new(mesh: &SnappedMesh, p: [i64; 2]) -> Option<Self> {
        let mut events = Vec::new();
        for (t, &solid) in mesh.triangles.iter().zip(&mesh.solid) {
            let corners = t.map(|i| mesh.positions[i as usize]);
            let cross = |a: [i64; 3], b: [i64; 3], c: [i64; 2]| {
                let [ux, uy, vx, vy] = [b[0] - a[0], b[1] - a[1], c[0] - a[0], c[1] - a[1]].map(i128::from);
                ux * vy - uy * vx
            };
            let [a, b, c] = corners;
            let area = cross(a, b, [c[0], c[1]]);
            let outside = (0..2).any(|k| corners.iter().all(|q| q[k] < p[k]) || corners.iter().all(|q| q[k] > p[k]));
            if outside {
                continue;
            }
            // each weighs the corner that its edge does not have
            let weights = [cross(b, c, p), cross(c, a, p), cross(a, b, p)].map(|w| w * area.signum());
            if area == 0 {
                // an edge-on one is a segment
                if cross(a, b, p) == 0 && cross(b, c, p) == 0 && cross(c, a, p) == 0 {
                    return None;
                }
                continue;
            }
            if weights.iter().any(|w| *w < 0) {
                continue;
            }
            if weights.contains(&0) {
                return None;
            }
            let sum: i128 = (0..3).map(|k| weights[k] * i128::from(corners[k][2])).sum();
            let depth = Depth::new(sum, area.abs());
            match mesh.solids[solid as usize] {
                // counter-clockwise from outside: a positive area faces along the light
                SolidKind::Closed => events.push(Event { depth, solid, step: -area.signum() as i32, surface: true }),
                SolidKind::Sheet { thickness } => {
                    events.push(Event { depth, solid, step: 1, surface: true });
                    events.push(Event { depth: depth.plus(thickness.into()), solid, step: -1, surface: false });
                }
            }
        }
        Some(Ray { events })
    }

    /// Whether a receiver has solid right before and right behind it.
    fn inside(&self, d: &Depth) -> bool {
        let within = |counts: &dyn Fn(&Event) -> bool| {
            self.events.iter().any(|own| {
                let same = self.events.iter().filter(|e| e.solid == own.solid && counts(e));
                same.map(|e| e.step).sum::<i32>() > 0
            })
        };
        within(&|e| e.depth < *d) && within(&|e| e.depth <= *d)
    }

    /// Receivers that a stored value has to answer for: on all surfaces, and, unless `surfaces_alone`, at whole depths
    /// around and between them; those inside a solid are left out.
    pub fn receivers(&self, surfaces_alone: bool) -> Vec<Receiver> {
        let surfaces = || self.events.iter().filter(|e| e.surface).map(|e| e.depth);
        let mut depths: Vec<Depth> = surfaces().collect();
        if !surfaces_alone {
            let mut whole = vec![1i128, i128::from(u32::MAX) - 1];
            for e in &self.events {
                whole.extend((-1..=2).map(|n| e.depth.floor() + n));
            }
            whole.sort_unstable();
            let between: Vec<i128> = whole.windows(2).map(|w| (w[0] + w[1]) / 2).collect();
            let fits = |d: &i128| (0..i128::from(u32::MAX)).contains(d);
            depths.extend(whole.into_iter().chain(between).filter(fits).map(Depth::whole));
            depths.retain(|d| !self.inside(d));
        }
        let lit = |d: &Depth| surfaces().all(|s| *d <= s);
        depths.iter().map(|d| Receiver { depth: d.ceil() as u32, lit: lit(d) }).collect()
    }
}
