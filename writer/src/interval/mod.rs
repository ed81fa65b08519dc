//! Depth intervals: what may be stored for a texel so that every receiver gets the right answer.
//!
//! Read in this order: [`triangle`] (a surface as the light sees it), [`ray`] (the interval on one ray),
//! [`proof`] (one interval for a whole square, proven in a few comparisons, or nothing), [`texel`] (the exact
//! answer for one texel: proof, then refutation by sample rays, then smaller squares, then [`cell`], the exact
//! arrangement in big integers).
//!
//! Depths are compared through their ceilings: a receiver at real depth d is lit iff ceil(d) <= v, so `v` is right on
//! a ray iff ceil(lo) <= v < ceil(hi) (CONVENTIONS, Depth is an integer). Solids are united: a ray is inside while
//! any solid's counter is above 0, and at equal depth entries count before exits.

pub mod cell;
pub mod proof;
pub mod ray;
pub mod texel;
pub mod triangle;

use umbrage_format::projection::UNCOVERED;

/// What a ray does at a surface.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Event {
    /// It enters the solid.
    Enter,
    /// It leaves the solid.
    Leave,
    /// Nothing: a wall of a closed solid seen edge-on, or the rim of open geometry. It covers no open cell, but a
    /// solid's counter may differ on its two sides.
    Wall,
}

/// A closed range of lattice depths.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Interval {
    /// Smallest right value.
    pub min: u32,
    /// Largest right value.
    pub max: u32,
}

impl Interval {
    /// What an uncovered texel must store.
    pub const UNCOVERED: Interval = Interval { min: UNCOVERED, max: UNCOVERED };

    /// The common part, if there is one.
    #[inline]
    pub fn intersect(self, other: Interval) -> Option<Interval> {
        let (min, max) = (self.min.max(other.min), self.max.min(other.max));
        (min <= max).then_some(Interval { min, max })
    }

    /// Distance of the ends.
    #[inline]
    pub fn width(self) -> u64 {
        u64::from(self.max - self.min)
    }

    /// Without what lies closer than `guard` to an end, where it is at least four times that wide; so rounding of a
    /// receiver's depth by less than `guard` changes no answer.
    #[inline]
    pub fn guarded(self, guard: u32) -> Interval {
        if self == Interval::UNCOVERED || self.width() < wide(guard) {
            return self;
        }
        Interval { min: self.min + guard, max: self.max - guard }
    }

    /// The value that is stored: as far as possible from both ends.
    #[inline]
    pub fn middle(self) -> u32 {
        self.min + (self.max - self.min) / 2
    }
}

/// The least width of an interval whose value keeps the guard.
#[inline]
pub fn wide(guard: u32) -> u64 {
    4 * u64::from(guard)
}

/// Largest depth that a scene's surfaces may answer.
pub(crate) const DEEPEST: i64 = UNCOVERED as i64 - 1;

/// `x.ceil() as i64`, without a call where the processor's rounding isn't known to be there.
#[inline]
pub(crate) fn ceil(x: f64) -> i64 {
    let whole = x as i64;
    whole.saturating_add(i64::from((whole as f64) < x))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wide_intervals_keep_a_guard_and_narrow_ones_stay() {
        let i = |min, max| Interval { min, max };
        assert_eq!(i(10, 18).guarded(2), i(12, 16));
        assert_eq!(i(10, 17).guarded(2), i(10, 17));
        assert_eq!(i(10, 10).guarded(0), i(10, 10));
        assert_eq!(i(0, u32::MAX - 1).guarded(u32::MAX), i(0, u32::MAX - 1));
        assert_eq!(Interval::UNCOVERED.guarded(0), Interval::UNCOVERED);
    }

    #[test]
    fn rounding_up_is_that_of_the_library() {
        let far = [f64::INFINITY, f64::NEG_INFINITY, f64::NAN, 1e300, -1e300, 2f64.powi(63), -2f64.powi(63)];
        let near = (-2000..2000).map(|n| f64::from(n) / 8.0);
        for x in near.chain(far).chain([4294967295.0, 4294967295.5, 2f64.powi(53) + 2.0, 1e-300, -1e-300, -0.0]) {
            assert_eq!(ceil(x), x.ceil() as i64, "{x}");
        }
    }
}
