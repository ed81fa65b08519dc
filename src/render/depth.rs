//! Exact depths: an integer and a proper fraction, and the depth of a triangle over a lattice point.
//!
//! Coordinates are integers of magnitude up to 2^40. Products of two differences then stay below 2^83 and products
//! of three below 2^125, so that everything here fits in 128 bits; only the comparison of two fractions may need more.

use std::cmp::Ordering;

/// A corner of a snapped triangle in lattice steps: x, y, depth.
pub(super) type Corner = [i64; 3];

/// An exact depth in lattice steps along the light: `whole + num / den`, `0 <= num < den`. Not reduced; equal values
/// compare equal.
#[derive(Clone, Copy, Debug)]
pub struct Depth {
    whole: i64,
    num: u128,
    den: u128,
}

impl Depth {
    /// An integer depth.
    pub const fn integer(whole: i64) -> Depth {
        Depth { whole, num: 0, den: 1 }
    }

    /// `base + num / den` for any sign of `num`; `den > 0`.
    fn fraction(base: i64, num: i128, den: i128) -> Depth {
        debug_assert!(den > 0);
        // Depths of small triangles fit into one machine word, where division is several times faster.
        let (quotient, rest) = match (i64::try_from(num), i64::try_from(den)) {
            (Ok(n), Ok(d)) => (n.div_euclid(d), i128::from(n.rem_euclid(d))),
            _ => (num.div_euclid(den) as i64, num.rem_euclid(den)),
        };
        Depth { whole: base + quotient, num: rest.unsigned_abs(), den: den.unsigned_abs() }
    }

    /// The f64 as it is; it must be finite and below 2^52 in magnitude.
    pub(super) fn from_f64(z: f64) -> Depth {
        let whole = z.floor();
        Depth { whole: whole as i64, num: ((z - whole) * (1u64 << 53) as f64) as u128, den: 1 << 53 }
    }

    /// Largest integer that is not above the depth.
    pub const fn floor(&self) -> i64 {
        self.whole
    }

    /// Smallest integer that is not below the depth.
    pub const fn ceil(&self) -> i64 {
        self.whole + (self.num > 0) as i64
    }

    /// What a shadow map is asked with: the ceiling, clamped to 32 bits. Lit iff this is `<=` the stored value.
    pub fn query(&self) -> u32 {
        self.ceil().clamp(0, i64::from(u32::MAX)) as u32
    }

    /// Nearest f64, for pictures and messages.
    pub fn to_f64(&self) -> f64 {
        self.whole as f64 + self.num as f64 / self.den as f64
    }
}

impl Ord for Depth {
    fn cmp(&self, other: &Depth) -> Ordering {
        self.whole.cmp(&other.whole).then_with(|| compare(self.num, self.den, other.num, other.den))
    }
}

impl PartialOrd for Depth {
    fn partial_cmp(&self, other: &Depth) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Depth {
    fn eq(&self, other: &Depth) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Depth {}

/// `a / b` against `c / d`, crosswise, in 256 bits where 128 are too few.
fn compare(a: u128, b: u128, c: u128, d: u128) -> Ordering {
    match (a.checked_mul(d), c.checked_mul(b)) {
        (Some(left), Some(right)) => left.cmp(&right),
        _ => wide_product(a, d).cmp(&wide_product(c, b)),
    }
}

/// `a * b` as (high, low).
fn wide_product(a: u128, b: u128) -> (u128, u128) {
    const HALF: u128 = u64::MAX as u128;
    let (a1, a0, b1, b0) = (a >> 64, a & HALF, b >> 64, b & HALF);
    let low = a0 * b0;
    let middle = a1 * b0 + (low >> 64);
    let cross = a0 * b1 + (middle & HALF);
    (a1 * b1 + (middle >> 64) + (cross >> 64), (cross << 64) | (low & HALF))
}

/// Where a lattice point lies relative to the projection of a triangle with area: `weights[1] + weights[2] <= area`
/// and both `>= 0` iff it is inside or on the border.
pub(super) struct Projected {
    weights: [i128; 2],
    area: i128,
    rise: [i64; 2],
    base: i64,
}

impl Projected {
    /// Nothing if the light sees the triangle edge-on (its projection has no area).
    pub(super) fn new(t: &[Corner; 3], xy: [i64; 2]) -> Option<Projected> {
        let [a, b, c] = t;
        let mul = |p: i64, q: i64| i128::from(p) * i128::from(q);
        let (ux, uy, vx, vy) = (b[0] - a[0], b[1] - a[1], c[0] - a[0], c[1] - a[1]);
        let (px, py) = (xy[0] - a[0], xy[1] - a[1]);
        let area = mul(ux, vy) - mul(uy, vx);
        let weights = [mul(px, vy) - mul(py, vx), mul(ux, py) - mul(uy, px)];
        let rise = [b[2] - a[2], c[2] - a[2]];
        match area.cmp(&0) {
            Ordering::Equal => None,
            Ordering::Greater => Some(Projected { weights, area, rise, base: a[2] }),
            Ordering::Less => Some(Projected { weights: weights.map(|w| -w), area: -area, rise, base: a[2] }),
        }
    }

    /// Whether the closed projection contains the point.
    pub(super) fn contains(&self) -> bool {
        let [v, w] = self.weights;
        v >= 0 && w >= 0 && v + w <= self.area
    }

    /// Depth of the triangle's plane over the point, inside the triangle or not.
    pub(super) fn depth(&self) -> Depth {
        let climb = self.weights[0] * i128::from(self.rise[0]) + self.weights[1] * i128::from(self.rise[1]);
        Depth::fraction(self.base, climb, self.area)
    }
}

/// First depth at which the light ray at `xy` meets the closed triangle; nothing if it misses. A triangle seen
/// edge-on counts: the ray enters it through one of its edges.
pub(super) fn entry(t: &[Corner; 3], xy: [i64; 2]) -> Option<Depth> {
    match Projected::new(t, xy) {
        Some(p) => p.contains().then(|| p.depth()),
        None => (0..3).filter_map(|i| edge_entry(t[i], t[(i + 1) % 3], xy)).min(),
    }
}

/// The same for the segment from `a` to `b`.
fn edge_entry(a: Corner, b: Corner, xy: [i64; 2]) -> Option<Depth> {
    let step = [b[0] - a[0], b[1] - a[1]];
    let to = [xy[0] - a[0], xy[1] - a[1]];
    let mul = |p: i64, q: i64| i128::from(p) * i128::from(q);
    if mul(step[0], to[1]) != mul(step[1], to[0]) {
        return None;
    }
    let k = usize::from(step[0].abs() < step[1].abs());
    match step[k].signum() {
        0 => (to == [0, 0]).then(|| Depth::integer(a[2].min(b[2]))),
        s => {
            let (along, whole) = (s * to[k], s * step[k]);
            (0..=whole).contains(&along).then(|| Depth::fraction(a[2], mul(b[2] - a[2], along), i128::from(whole)))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::Rng;
    use super::*;

    #[test]
    fn fractions_compare_exactly() {
        let f = Depth::fraction;
        assert_eq!(f(3, 1, 2), f(3, 2, 4));
        assert_eq!(f(3, -1, 2), f(2, 5, 10));
        assert_eq!((f(3, -1, 2).floor(), f(3, -1, 2).ceil(), Depth::integer(-4).ceil()), (2, 3, -4));
        // Products beyond 128 bits, values that f64 cannot tell apart.
        let d = (1i128 << 80) - 1;
        assert!(f(7, d - 2, d) < f(7, d - 1, d));
        assert!(f(7, d / 2, d) < f(7, d / 2 + 1, d - 2));
        assert_eq!(f(7, 3 * (d / 3), d), f(8, 0, 1));
        assert_eq!(Depth::from_f64(5.75), f(5, 3, 4));
        assert_eq!(Depth::from_f64(-0.25), f(-1, 3, 4));
        assert_eq!((Depth::integer(-1).query(), Depth::integer(1 << 40).query()), (0, u32::MAX));
    }

    #[test]
    fn wide_products() {
        assert_eq!(wide_product(u128::MAX, u128::MAX), (u128::MAX - 1, 1));
        let mut rng = Rng(1);
        for _ in 0..1000 {
            // (a * 2^64 + b) * c against the sum of its parts.
            let (a, b, c) = (rng.next(), rng.next(), rng.next());
            let (high, low) = wide_product(u128::from(a) << 64 | u128::from(b), u128::from(c));
            let (upper, lower) = (u128::from(a) * u128::from(c), u128::from(b) * u128::from(c));
            let middle = upper + (lower >> 64);
            assert_eq!((high, low), (middle >> 64, middle << 64 | lower & u128::from(u64::MAX)));
        }
    }

    #[test]
    fn plane_through_corners_and_between() {
        let mut rng = Rng(2);
        for _ in 0..2000 {
            let bits = rng.below(40) as u32 + 1;
            let t: [Corner; 3] = std::array::from_fn(|_| std::array::from_fn(|_| rng.below(1 << bits) as i64));
            let Some(p) = Projected::new(&t, [t[0][0], t[0][1]]) else { continue };
            assert!(p.contains() && p.depth() == Depth::integer(t[0][2]));
            for c in t {
                assert_eq!(entry(&t, [c[0], c[1]]), Some(Depth::integer(c[2])));
            }
            // The plane passes through q iff the normal is at right angles to q - t0, in exact arithmetic.
            let q = [rng.below(1 << bits) as i64, rng.below(1 << bits) as i64];
            let p = Projected::new(&t, q).unwrap();
            let d = p.depth();
            assert!(d.num < d.den);
            let e = |i: usize, k: usize| i128::from(t[i][k] - t[0][k]);
            let n = [
                e(1, 1) * e(2, 2) - e(1, 2) * e(2, 1),
                e(1, 2) * e(2, 0) - e(1, 0) * e(2, 2),
                e(1, 0) * e(2, 1) - e(1, 1) * e(2, 0),
            ];
            assert_eq!(d.den, n[2].unsigned_abs());
            let flat = n[0] * i128::from(q[0] - t[0][0]) + n[1] * i128::from(q[1] - t[0][1]);
            let deep = n[2] * i128::from(d.whole - t[0][2]) + n[2].signum() * d.num as i128;
            assert_eq!(flat + deep, 0);
        }
    }

    #[test]
    fn edge_on_triangles_are_entered_through_their_edges() {
        let t = [[0, 0, 9], [8, 4, 1], [4, 2, 9]];
        assert_eq!(entry(&t, [4, 2]), Some(Depth::integer(5)));
        assert_eq!(entry(&t, [6, 3]), Some(Depth::integer(3)));
        assert_eq!(entry(&t, [2, 1]), Some(Depth::integer(7)));
        assert_eq!(entry(&t, [2, 2]), None);
        assert_eq!(entry(&t, [10, 5]), None);
        assert_eq!(entry(&[[3, 3, 5], [3, 3, 2], [3, 3, 8]], [3, 3]), Some(Depth::integer(2)));
        assert_eq!(entry(&[[3, 3, 5], [3, 3, 2], [3, 3, 8]], [3, 4]), None);
        // Upright, longer in y; a third of a step.
        assert_eq!(entry(&[[1, 9, 0], [1, 6, 1], [1, 6, 1]], [1, 8]), Some(Depth::fraction(0, 1, 3)));
    }
}
