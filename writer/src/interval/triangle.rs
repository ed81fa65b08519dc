//! A triangle as the light sees it: projected edges in exact integers, depth as an exact fraction and as an
//! f64 with a proven error.
//!
//! Points are given in lattice steps relative to a tile's corner, so that edge functions fit 64 bits.

use std::cmp::Ordering;

use super::{Event, ceil};
use crate::solid::{SnappedMesh, SolidKind};

/// One surface that light rays cross, entered or left, or the wall of a closed solid seen edge-on.
///
/// A sheet with thickness is two of these, the second one shifted along the light.
#[derive(Clone, Copy, Debug)]
pub struct Surface {
    /// Lattice x of the corners, counter-clockwise in (x, y).
    pub x: [u32; 3],
    /// Lattice y of the corners.
    pub y: [u32; 3],
    /// Lattice depth of the corners.
    pub z: [u32; 3],
    /// Which solid it bounds.
    pub solid: u32,
    /// What happens to the ray there.
    pub event: Event,
    /// The outside of the triangle looks toward the light (counter-clockwise seen from there, as the mesh has it).
    pub facing: bool,
}

/// All surfaces of a mesh, sorted by solid, then by their order in the mesh, rims last.
pub fn surfaces(mesh: &SnappedMesh) -> Vec<Surface> {
    let mut order: Vec<u32> = (0..mesh.triangles.len() as u32).collect();
    order.sort_by_key(|i| mesh.solid[*i as usize]);
    let mut out = Vec::with_capacity(order.len());
    for i in order {
        let v = mesh.triangles[i as usize].map(|k| mesh.positions[k as usize]);
        let area = (i128::from(v[1][0]) - i128::from(v[0][0])) * (i128::from(v[2][1]) - i128::from(v[0][1]))
            - (i128::from(v[2][0]) - i128::from(v[0][0])) * (i128::from(v[1][1]) - i128::from(v[0][1]));
        if area == 0 && v.iter().all(|p| p[..2] == v[0][..2]) {
            // a point seen from the light separates nothing
            continue;
        }
        let v = if area > 0 { v } else { [v[0], v[2], v[1]] };
        let solid = mesh.solid[i as usize];
        // lattice coordinates end half a texel before the far border, so they fit 32 bits at any resolution
        let surface = |event, shift: u32| Surface {
            x: v.map(|p| p[0].clamp(0, i64::from(u32::MAX)) as u32),
            y: v.map(|p| p[1].clamp(0, i64::from(u32::MAX)) as u32),
            z: v.map(|p| (p[2].clamp(1, i64::from(u32::MAX) - 1) as u32).saturating_add(shift).min(u32::MAX - 1)),
            solid,
            event,
            facing: area < 0,
        };
        match mesh.solids[solid as usize] {
            // counter-clockwise from outside and seen counter-clockwise along +z means the normal points along +z
            _ if area == 0 => out.push(surface(Event::Wall, 0)),
            SolidKind::Closed => out.push(surface(if area < 0 { Event::Enter } else { Event::Leave }, 0)),
            SolidKind::Sheet { thickness } => {
                out.push(surface(Event::Enter, 0));
                if !mesh.second_surface {
                    out.push(surface(Event::Leave, thickness));
                }
            }
        }
    }
    rims(mesh, &mut out);
    // stable: the order within a solid stays
    out.sort_by_key(|s| s.solid);
    out
}

/// Adds the rims of open geometry: edges whose directions do not cancel, as walls that reach to the end of depth,
/// because a ray's count differs on their two sides from there on.
fn rims(mesh: &SnappedMesh, out: &mut Vec<Surface>) {
    let mut edges: Vec<(u32, u32, u32, bool)> = Vec::new();
    for (t, &solid) in mesh.triangles.iter().zip(&mesh.solid) {
        if mesh.solids[solid as usize] != SolidKind::Closed {
            for k in 0..3 {
                let (a, b) = (t[k], t[(k + 1) % 3]);
                edges.push((solid, a.min(b), a.max(b), a < b));
            }
        }
    }
    edges.sort_unstable();
    for run in edges.chunk_by(|a, b| (a.0, a.1, a.2) == (b.0, b.1, b.2)) {
        let up = run.iter().filter(|e| e.3).count();
        let (a, b) = (mesh.positions[run[0].1 as usize], mesh.positions[run[0].2 as usize]);
        if 2 * up == run.len() || a[..2] == b[..2] {
            continue;
        }
        let corner = |i: usize| [a[i], b[i], b[i]].map(|c| c.clamp(0, i64::from(u32::MAX)) as u32);
        let [za, zb, _] = corner(2);
        let (x, y, z) = (corner(0), corner(1), [za, zb, u32::MAX]);
        out.push(Surface { x, y, z, solid: run[0].0, event: Event::Wall, facing: false });
    }
}

/// An exact depth: `floor + rem / den`, `0 <= rem < den`.
#[derive(Clone, Copy, Debug)]
pub struct Depth {
    /// Integer part.
    pub floor: i128,
    /// Remainder.
    pub rem: u128,
    /// Twice the projected area of the triangle.
    pub den: u128,
}

impl Depth {
    /// Smallest lattice depth that is not less.
    pub fn ceil(&self) -> i64 {
        (self.floor + i128::from(self.rem > 0)).clamp(i128::from(i64::MIN), i128::from(i64::MAX)) as i64
    }

    /// Exact order, without wider integers: compares continued fractions of the fractional parts.
    pub fn order(&self, other: &Depth) -> Ordering {
        self.floor.cmp(&other.floor).then_with(|| {
            let (mut a, mut b, mut c, mut d) = (self.rem, self.den, other.rem, other.den);
            let mut flip = false;
            loop {
                // a/b against c/d, both below 1 at first
                let (p, q) = (a / b, c / d);
                if p != q {
                    return if flip { q.cmp(&p) } else { p.cmp(&q) };
                }
                (a, c) = (a % b, c % d);
                match (a == 0, c == 0) {
                    (true, true) => return Ordering::Equal,
                    (true, false) => return if flip { Ordering::Greater } else { Ordering::Less },
                    (false, true) => return if flip { Ordering::Less } else { Ordering::Greater },
                    (false, false) => {}
                }
                // a/b < c/d iff b/a > d/c
                (a, b, c, d) = (b, a, d, c);
                flip = !flip;
            }
        })
    }
}

/// A surface prepared for one tile.
#[derive(Clone, Debug)]
pub struct Local {
    /// Edge functions `a x + b y + c >= 0` inside, tile-relative. An edge that the whole tile lies inside of is
    /// (0, 0, 1).
    pub a: [i64; 3],
    /// See `a`.
    pub b: [i64; 3],
    /// See `a`.
    pub c: [i64; 3],
    /// Tile-relative bounds in lattice steps.
    pub low: [i64; 2],
    /// See `low`.
    pub high: [i64; 2],
    /// Extremes of the corners' depths.
    pub zmin: i64,
    /// See `zmin`.
    pub zmax: i64,
    /// Depth is `z0 + sx x + sy y` within `eps` anywhere in the tile.
    pub z0: f64,
    /// See `z0`.
    pub sx: f64,
    /// See `z0`.
    pub sy: f64,
    /// See `z0`.
    pub eps: f64,
    /// Which solid it bounds.
    pub solid: u32,
    /// What happens to the ray there.
    pub event: Event,
    /// See [`Surface::facing`].
    pub facing: bool,
    /// Index among all surfaces, for exact depths.
    pub index: u32,
}

impl Surface {
    /// Doubled projected area, positive; 0 for walls.
    pub fn area(&self) -> i128 {
        let d = |a: u32, b: u32| i128::from(a) - i128::from(b);
        d(self.x[1], self.x[0]) * d(self.y[2], self.y[0]) - d(self.x[2], self.x[0]) * d(self.y[1], self.y[0])
    }

    /// Gradient of the depth times [`Self::area`].
    pub fn slope(&self) -> (i128, i128) {
        let d = |a: u32, b: u32| i128::from(a) - i128::from(b);
        let (x1, y1, z1) = (d(self.x[1], self.x[0]), d(self.y[1], self.y[0]), d(self.z[1], self.z[0]));
        let (x2, y2, z2) = (d(self.x[2], self.x[0]), d(self.y[2], self.y[0]), d(self.z[2], self.z[0]));
        (z1 * y2 - z2 * y1, z2 * x1 - z1 * x2)
    }

    /// Exact depth of the plane at an absolute lattice point.
    pub fn depth(&self, x: i64, y: i64) -> Depth {
        let (gx, gy) = self.slope();
        let den = self.area();
        let n = gx * (i128::from(x) - i128::from(self.x[0])) + gy * (i128::from(y) - i128::from(self.y[0]));
        Depth { floor: i128::from(self.z[0]) + n.div_euclid(den), rem: n.rem_euclid(den) as u128, den: den as u128 }
    }

    /// Edge `k` as `a x + b y + c >= 0` inside, absolute.
    pub fn edge(&self, k: usize) -> (i64, i64, i128) {
        let j = (k + 1) % 3;
        let a = i64::from(self.y[k]) - i64::from(self.y[j]);
        let b = i64::from(self.x[j]) - i64::from(self.x[k]);
        let c = -(i128::from(a) * i128::from(self.x[k]) + i128::from(b) * i128::from(self.y[k]));
        (a, b, c)
    }

    /// Whether the projection overlaps the open square at (x, y) of this size: exact separating-axis test.
    pub fn overlaps(&self, x: i64, y: i64, size: i64) -> bool {
        let min = |v: &[u32; 3]| i64::from(v[0].min(v[1]).min(v[2]));
        let max = |v: &[u32; 3]| i64::from(v[0].max(v[1]).max(v[2]));
        if min(&self.x) >= x + size || max(&self.x) <= x || min(&self.y) >= y + size || max(&self.y) <= y {
            return false;
        }
        (0..3).all(|k| {
            let (a, b, c) = self.edge(k);
            if a == 0 && b == 0 {
                return true;
            }
            let px = if a > 0 { x + size } else { x };
            let py = if b > 0 { y + size } else { y };
            i128::from(a) * i128::from(px) + i128::from(b) * i128::from(py) + c > 0
        })
    }

    /// Prepares for the tile at (x, y) of this size (at most 2^26 lattice steps).
    pub fn local(&self, index: u32, x: i64, y: i64, size: i64) -> Local {
        let (mut la, mut lb, mut lc) = ([0i64; 3], [0i64; 3], [1i64; 3]);
        for k in 0..3 {
            let (a, b, c) = self.edge(k);
            if a == 0 && b == 0 {
                // an edge of a wall that runs along the light bounds nothing
                continue;
            }
            let at = i128::from(a) * i128::from(x) + i128::from(b) * i128::from(y) + c;
            let least = at + i128::from(a.min(0)) * i128::from(size) + i128::from(b.min(0)) * i128::from(size);
            if least < 0 {
                // the edge crosses the tile (or the tile is outside and never asked), so |at| <= (|a| + |b|) size
                la[k] = a;
                lb[k] = b;
                lc[k] = at.clamp(-(1 << 62), 1 << 62) as i64;
            } else if least == 0 {
                la[k] = a;
                lb[k] = b;
                lc[k] = at as i64;
            }
        }
        // a wall has no plane over (x, y); only its corners' depths are used
        let (gx, gy) = if self.event == Event::Wall { (0, 0) } else { self.slope() };
        let den = if self.event == Event::Wall { 1.0 } else { self.area() as f64 };
        let (sx, sy) = (gx as f64 / den, gy as f64 / den);
        let rel = |v: &[u32; 3], o: i64| v.map(|c| i64::from(c) - o);
        let (rx, ry) = (rel(&self.x, x), rel(&self.y, y));
        let z0 = f64::from(self.z[0]) - sx * rx[0] as f64 - sy * ry[0] as f64;
        let reach = |r: i64| (r.abs().max((size - r).abs())) as f64;
        // conversions, quotients, three products and sums: below 16 roundings of at most these magnitudes
        let eps = (sx.abs() * (reach(rx[0]) + size as f64)
            + sy.abs() * (reach(ry[0]) + size as f64)
            + z0.abs()
            + 4294967296.0)
            * (f64::EPSILON * 8.0);
        let z = self.z.map(i64::from);
        Local {
            a: la,
            b: lb,
            c: lc,
            low: [rx[0].min(rx[1]).min(rx[2]), ry[0].min(ry[1]).min(ry[2])],
            high: [rx[0].max(rx[1]).max(rx[2]), ry[0].max(ry[1]).max(ry[2])],
            zmin: z[0].min(z[1]).min(z[2]),
            zmax: z[0].max(z[1]).max(z[2]),
            z0,
            sx,
            sy,
            eps,
            solid: self.solid,
            event: self.event,
            facing: self.facing,
            index,
        }
    }
}

/// How a surface lies over a square.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cover {
    /// It does not overlap the open square.
    None,
    /// It overlaps some of it.
    Part,
    /// It covers the closed square.
    All,
}

impl Local {
    /// How the projection lies over the tile-relative square at (x, y).
    #[inline]
    pub fn cover(&self, x: i64, y: i64, size: i64) -> Cover {
        if self.low[0] >= x + size || self.high[0] <= x || self.low[1] >= y + size || self.high[1] <= y {
            return Cover::None;
        }
        let mut all = true;
        for k in 0..3 {
            let (a, b) = (self.a[k], self.b[k]);
            let e = a * x + b * y + self.c[k];
            if e + a.max(0) * size + b.max(0) * size <= 0 {
                return Cover::None;
            }
            all &= e + a.min(0) * size + b.min(0) * size >= 0;
        }
        if all { Cover::All } else { Cover::Part }
    }

    /// Bounds of ceil(depth) over the part of the surface in the square: `lowest <= ceil(z) <= highest`.
    #[inline]
    pub fn ceil_range(&self, x: i64, y: i64, size: i64) -> (i64, i64) {
        if self.event == Event::Wall {
            return (self.zmin, self.zmax);
        }
        let z = self.z0 + self.sx * x as f64 + self.sy * y as f64;
        let (dx, dy) = (self.sx * size as f64, self.sy * size as f64);
        let low = z + dx.min(0.0) + dy.min(0.0) - self.eps;
        let high = z + dx.max(0.0) + dy.max(0.0) + self.eps;
        // `as` saturates, so infinities and not-a-number fall back on the corners' depths
        (ceil(low).max(self.zmin), ceil(high).min(self.zmax))
    }

    /// Depth at the tile-relative point, within `eps`.
    #[inline]
    pub fn approximate(&self, x: i64, y: i64) -> f64 {
        self.z0 + self.sx * x as f64 + self.sy * y as f64
    }

    /// Whether a ray at the tile-relative point meets the surface; on its border the ray is the limit from
    /// `(dx eps, dy eps^2)`.
    #[inline]
    pub fn covers(&self, x: i64, y: i64, dx: i64, dy: i64) -> bool {
        for k in 0..3 {
            let e = self.a[k] * x + self.b[k] * y + self.c[k];
            if e < 0 {
                return false;
            }
            if e == 0 {
                let s = if self.a[k] != 0 { self.a[k] * dx } else { self.b[k] * dy };
                if s < 0 {
                    return false;
                }
            }
        }
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fractions_compare_exactly() {
        let d = |floor, rem, den| Depth { floor, rem, den };
        let big = (1u128 << 66) - 3;
        let cases = [
            (d(5, 1, 3), d(5, 2, 6), Ordering::Equal),
            (d(5, 0, 7), d(5, 0, 9), Ordering::Equal),
            (d(5, 0, 7), d(5, 1, big), Ordering::Less),
            (d(4, big - 1, big), d(5, 0, 1), Ordering::Less),
            (d(5, big - 1, big), d(5, big - 2, big - 1), Ordering::Greater),
            (d(5, big / 2, big), d(5, 1, 2), Ordering::Less),
        ];
        for (a, b, want) in cases {
            assert_eq!(a.order(&b), want, "{a:?} {b:?}");
            assert_eq!(b.order(&a), want.reverse(), "{a:?} {b:?}");
        }
    }
}
