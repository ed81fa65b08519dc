//! Random numbers and noise from integers alone, so that every machine draws the same scene to the bit.
//!
//! [`Random`] is splitmix64. [`noise2`] and [`noise3`] interpolate hashed lattice values with a polynomial.

use std::cell::Cell;

/// A stream of numbers that depends on nothing but its seed (splitmix64).
///
/// Draws go through a shared reference, so that they can stand among the arguments of a call that draws too.
pub(super) struct Random(Cell<u64>);

impl Random {
    /// A stream for `seed`; `lane` tells apart streams that share a seed.
    pub(super) fn new(seed: u64, lane: [i64; 2]) -> Self {
        Self(Cell::new(hash(seed, [lane[0], lane[1], 0])))
    }

    fn bits(&self) -> u64 {
        let state = self.0.get().wrapping_add(0x9E37_79B9_7F4A_7C15);
        self.0.set(state);
        mix(state)
    }

    /// A real number from 0 (included) to 1 (excluded), a multiple of 2^-53.
    pub(super) fn unit(&self) -> f64 {
        fraction(self.bits())
    }

    /// A real number from `low` to `high`.
    pub(super) fn range(&self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// A whole number from `low` to `high`, both included.
    pub(super) fn count(&self, low: u32, high: u32) -> u32 {
        low + (self.bits() >> 32) as u32 % (high - low + 1)
    }

    /// True with probability `share`.
    pub(super) fn chance(&self, share: f64) -> bool {
        self.unit() < share
    }
}

fn mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

fn fraction(bits: u64) -> f64 {
    // 53 bits and a power of two: exact.
    (bits >> 11) as f64 / (1_u64 << 53) as f64
}

fn hash(seed: u64, at: [i64; 3]) -> u64 {
    at.iter().fold(mix(seed ^ 0x5DEE_CE66_D1CE_4E5B), |h, &c| {
        mix(h.wrapping_add(0x9E37_79B9_7F4A_7C15).wrapping_add((c as u64).wrapping_mul(0xD6E8_FEB8_6659_FD93)))
    })
}

/// A hashed value from -1 to 1 for a lattice point.
fn lattice(seed: u64, at: [i64; 3]) -> f64 {
    2.0 * fraction(hash(seed, at)) - 1.0
}

/// Splits a coordinate into its lattice cell and a smoothed place within it.
fn cell(x: f64) -> (i64, f64) {
    let low = x.floor();
    let f = x - low;
    // The quintic has no slope and no curvature at the ends: no creases at cell borders.
    (low as i64, f * f * f * (f * (f * 6.0 - 15.0) + 10.0))
}

fn blend(a: f64, b: f64, f: f64) -> f64 {
    a + (b - a) * f
}

/// Smooth noise in the plane, from -1 to 1, one bump per unit of length.
pub(super) fn noise2(seed: u64, p: [f64; 2]) -> f64 {
    let [(x, fx), (z, fz)] = p.map(cell);
    let at = |i, k| lattice(seed, [x + i, 0, z + k]);
    blend(blend(at(0, 0), at(1, 0), fx), blend(at(0, 1), at(1, 1), fx), fz)
}

/// Smooth noise in space, from -1 to 1, one bump per unit of length.
pub(super) fn noise3(seed: u64, p: [f64; 3]) -> f64 {
    let [(x, fx), (y, fy), (z, fz)] = p.map(cell);
    let at = |i, j, k| lattice(seed, [x + i, y + j, z + k]);
    let row = |j, k| blend(at(0, j, k), at(1, j, k), fx);
    let sheet = |k| blend(row(0, k), row(1, k), fy);
    blend(sheet(0), sheet(1), fz)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn streams_are_fixed_and_told_apart() {
        let draw = |seed, lane| Random::new(seed, lane).unit();
        assert_eq!(draw(1, [2, 3]), draw(1, [2, 3]));
        assert_ne!(draw(1, [2, 3]), draw(1, [3, 2]));
        assert_ne!(draw(1, [2, 3]), draw(2, [2, 3]));
    }

    #[test]
    fn draws_stay_in_range() {
        let random = Random::new(7, [0, 0]);
        let mut seen = [false; 4];
        for _ in 0..1000 {
            assert!((-2.0..3.0).contains(&random.range(-2.0, 3.0)));
            seen[random.count(2, 5) as usize - 2] = true;
        }
        assert_eq!(seen, [true; 4]);
    }

    #[test]
    fn noise_is_bounded_and_continuous() {
        for step in 0..4000 {
            let x = f64::from(step) * 0.005 - 10.0;
            let (a, b) = (noise2(3, [x, 0.3]), noise2(3, [x + 1e-6, 0.3]));
            assert!(a.abs() <= 1.0 && (a - b).abs() < 1e-5);
            let (a, b) = (noise3(3, [x, 0.3, -x]), noise3(3, [x + 1e-6, 0.3, -x]));
            assert!(a.abs() <= 1.0 && (a - b).abs() < 1e-5);
        }
    }
}
