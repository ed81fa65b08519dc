//! Lookups on the CPU.
//!
//! - [`Map`]: pages of one structure, loaded when a lookup needs them;
//! - [`Resident`]: all pages in one array, for lookups that can't fail; `pyramid`: its coarsest levels;
//! - [`mh`], [`mmh`], [`vector`]: the walk of each kind, a pure function over pages that are there or not;
//! - [`Bounds`]: what the index says of a page that is not there;
//! - [`filter`]: percentage-closer filtering over all of them;
//! - here: from a point of the world to a texel and a depth, from a stored value to light or shadow.
//!
//! Texels are numbered on the finest level: 0 to `1 << log2_resolution`, minus 1. A lookup at level L answers for the
//! square of `1 << L` texels on a side around the texel.

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing,
    clippy::cast_possible_truncation
)]

mod bounds;
pub mod filter;
pub(crate) mod follow;
mod map;
pub mod mh;
pub mod mmh;
mod pyramid;
mod resident;
pub mod vector;

use umbrage_format::projection::Lattice;

pub use bounds::Bounds;
pub use map::{Answer, Descent, Map, PageView};
pub use resident::Resident;

/// Light or shadow at a point of the world.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Visibility {
    /// Whether light reaches the point. True outside the map.
    pub lit: bool,
    /// Whether the point lies in the map's square; outside, nothing is known.
    pub inside: bool,
    /// The stored value it was held against; [`umbrage_format::projection::UNCOVERED`] outside.
    pub value: u32,
}

impl Visibility {
    /// The answer outside the map.
    pub const OUTSIDE: Self = Self { lit: true, inside: false, value: umbrage_format::projection::UNCOVERED };

    /// The answer for a receiver at real lattice depth `depth` whose texel stores `value`.
    pub fn inside(depth: f64, value: u32) -> Self {
        Self { lit: is_lit(depth, value), inside: true, value }
    }
}

/// Texel and real lattice depth of a world point; `None` outside the map, or where a coordinate is not a number.
pub fn locate(lattice: &Lattice, point: [f64; 3]) -> Option<(u32, u32, f64)> {
    let [x, y, depth] = lattice.to_lattice(point);
    let side = lattice.side() as f64;
    if !(0.0..side).contains(&x) || !(0.0..side).contains(&y) || depth.is_nan() {
        return None;
    }
    let texel = |v: f64| u32::try_from(whole(v) >> lattice.subtexel_bits.min(63)).ok();
    Some((texel(x)?, texel(y)?, depth))
}

/// Whether a receiver at real lattice depth `depth` is lit: `ceil(depth) <= value`, the depth clamped to 32 bits.
/// NaN counts as 0.
pub fn is_lit(depth: f64, value: u32) -> bool {
    whole(depth.clamp(0.0, f64::from(u32::MAX)).ceil()) <= u64::from(value)
}

/// Integer part of a number that is not negative; saturates, NaN is 0.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
fn whole(v: f64) -> u64 {
    // The language defines this cast for every value: truncation toward zero, saturation, NaN to 0.
    v as u64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn depth_is_rounded_up_and_clamped() {
        assert!(is_lit(5.0, 5) && !is_lit(5.000001, 5) && is_lit(4.3, 5));
        assert!(is_lit(-7.0, 0) && is_lit(1e300, u32::MAX) && !is_lit(1e300, u32::MAX - 1));
        assert!(is_lit(f64::NAN, 0));
    }

    #[test]
    fn the_far_edge_is_outside() {
        let world_to_lattice = [[256.0, 0.0, 0.0, 0.0], [0.0, 256.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];
        let lattice = Lattice { world_to_lattice, log2_resolution: 2, subtexel_bits: 8 };
        assert_eq!(locate(&lattice, [0.0, 3.999, 7.5]), Some((0, 3, 7.5)));
        for p in [[4.0, 0.0, 0.0], [0.0, -0.001, 0.0], [f64::NAN, 0.0, 0.0], [0.0, 0.0, f64::NAN]] {
            assert_eq!(locate(&lattice, p), None);
        }
    }
}
