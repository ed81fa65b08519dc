//! Exact depths.

use std::cmp::Ordering;

/// An exact rational depth in lattice steps along the light.
///
/// Kept as a whole part and a proper fraction, so that the comparison of two depths needs no product wider than
/// 128 bits: denominators of plane depths are twice projected areas and stay at or below 2^64.
#[derive(Clone, Copy, Debug)]
pub struct Depth {
    floor: i128,
    rem: i128,
    den: i128,
}

impl Depth {
    /// The depth `num / den`, in lattice steps; `den` is not zero.
    ///
    /// # Panics
    /// If `den` is zero.
    pub fn new(num: i128, den: i128) -> Self {
        let (num, den) = if den < 0 { (-num, -den) } else { (num, den) };
        Self { floor: num.div_euclid(den), rem: num.rem_euclid(den), den }
    }

    /// A whole number of lattice steps.
    pub fn whole(steps: impl Into<i128>) -> Self {
        Self { floor: steps.into(), rem: 0, den: 1 }
    }

    /// This depth, `steps` lattice steps farther along the light.
    pub fn plus(self, steps: i128) -> Self {
        Self { floor: self.floor + steps, ..self }
    }

    /// The largest whole number not above the depth.
    pub fn floor(&self) -> i128 {
        self.floor
    }

    /// The smallest whole number not below the depth.
    pub fn ceil(&self) -> i128 {
        self.floor + i128::from(self.rem > 0)
    }
}

/// Compares `a / b` with `c / d`, for `0 <= a < b` and `0 <= c < d`.
fn compare_fractions(a: i128, b: i128, c: i128, d: i128) -> Ordering {
    let [mut a, mut b, mut c, mut d] = [a, b, c, d].map(i128::unsigned_abs);
    let mut flip = false;
    loop {
        if let (Some(l), Some(r)) = (a.checked_mul(d), c.checked_mul(b)) {
            return if flip { r.cmp(&l) } else { l.cmp(&r) };
        }
        // Neither numerator is zero here. Reciprocals reverse the order; then their whole parts decide, or the rests.
        let (p, q) = (b / a, d / c);
        if p != q {
            return if flip { p.cmp(&q) } else { q.cmp(&p) };
        }
        (a, b, c, d) = (b % a, a, d % c, c);
        flip = !flip;
    }
}

impl Ord for Depth {
    fn cmp(&self, o: &Self) -> Ordering {
        self.floor.cmp(&o.floor).then_with(|| compare_fractions(self.rem, self.den, o.rem, o.den))
    }
}

impl PartialOrd for Depth {
    fn partial_cmp(&self, o: &Self) -> Option<Ordering> {
        Some(self.cmp(o))
    }
}

impl PartialEq for Depth {
    fn eq(&self, o: &Self) -> bool {
        self.cmp(o).is_eq()
    }
}

impl Eq for Depth {}

#[cfg(test)]
mod tests {
    use super::*;
    use num_bigint::BigInt;
    use num_rational::Ratio;

    #[test]
    fn rounds_both_ways() {
        assert_eq!(Depth::new(7, 2).ceil(), 4);
        assert_eq!(Depth::new(7, -2).ceil(), -3);
        assert_eq!(Depth::new(-7, 2).floor(), -4);
        assert_eq!(Depth::new(8, 2), Depth::whole(4));
        assert_eq!(Depth::new(8, 2).ceil(), 4);
        assert_eq!(Depth::new(1, 3).plus(2), Depth::new(7, 3));
    }

    #[test]
    fn compares_like_big_rationals() {
        let mut r = super::super::testing::Rng(7);
        for i in 0..20_000 {
            let bits = [8, 40, 64, 100, 126][i % 5];
            let mut n = || (i128::from(r.next()) << 64 | i128::from(r.next())).unsigned_abs() as i128 >> (127 - bits);
            let (a, b, c, d) = (n(), n() + 1, n(), n() + 1);
            // Every third pair is close: mediants differ in the last place only.
            let (c, d) = if i % 3 == 0 { (a / 2, b / 2 + 1) } else { (c, d) };
            let big = |n: i128, d: i128| Ratio::new(BigInt::from(n), BigInt::from(d));
            assert_eq!(Depth::new(a, b).cmp(&Depth::new(c, d)), big(a, b).cmp(&big(c, d)), "{a}/{b} {c}/{d}");
        }
    }
}
