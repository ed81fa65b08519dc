//! What a map that was baked from depth layers may hold: the intervals of the rays through texel centres.
//!
//! In: the layers' two depths of a texel, in lattice units. A receiver on the centre's ray at real depth d is lit iff
//! ceil(d) <= v. Receivers up to the first depth must be lit, receivers from the second on dark; where no v does both,
//! the first depth decides and the texel is thin.

use umbrage_writer::layers::{LatticeLayers, LayersError, Second, Square, TileBuffer};

use super::Interval;

/// Largest value that a covered texel may hold.
const DEEPEST: f64 = (u32::MAX - 1) as f64;

/// A stored value that is wrong.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fault {
    /// Column and row.
    pub texel: [u32; 2],
    /// What is stored.
    pub stored: u32,
    /// What may be stored.
    pub allowed: Interval,
}

/// What was found.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LayersTally {
    /// Texels looked at.
    pub texels: u64,
    /// Stored values outside their interval.
    pub wrong: u64,
    /// Thin texels.
    pub thin: u64,
    /// The first few wrong values.
    pub examples: Vec<Fault>,
}

/// Holds the stored values of a square against the layers; in wide intervals they must keep `guard` from the ends.
/// `each` is told the interval of every texel.
///
/// # Errors
/// The source's, or depths that can't be.
pub fn check(
    layers: &LatticeLayers,
    square: Square,
    guard: u32,
    stored: &dyn Fn(u32, u32) -> u32,
    tally: &mut LayersTally,
    mut each: impl FnMut([u32; 2], Interval),
) -> Result<(), LayersError> {
    let mut buffer = TileBuffer::default();
    layers.each(square, &mut buffer, |index, first, second| {
        let texel = square.texel(index);
        let second = if layers.second() == Second::Absent { first } else { second };
        let real = |d: f64| if d == f64::INFINITY { d } else { layers.depth(d) };
        let (allowed, thin) = allowed(real(first), real(second));
        let stored = stored(texel[0], texel[1]);
        tally.texels += 1;
        tally.thin += u64::from(thin);
        each(texel, allowed);
        if !allowed.guards(stored, guard) {
            tally.wrong += 1;
            if tally.examples.len() < 8 {
                tally.examples.push(Fault { texel, stored, allowed });
            }
        }
    })
}

/// Values that are right for a ray, and whether it is thin.
fn allowed(first: f64, second: f64) -> (Interval, bool) {
    if first == f64::INFINITY {
        return (Interval { min: u32::MAX, max: u32::MAX }, false);
    }
    let min = first.ceil();
    // the largest whole number below a real depth
    let below = second.ceil() - 1.0;
    let thin = below < min;
    let max = if thin { min } else { below.min(DEEPEST) };
    (Interval { min: min as u32, max: max as u32 }, thin)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By the meaning of the words: which values answer right for receivers at the ends of the stretch?
    #[test]
    fn the_interval_holds_what_answers_right_and_nothing_else() {
        for i in 0..40 {
            for j in i..40 {
                let (first, second) = (f64::from(i) / 4.0 + 1.0, f64::from(j) / 4.0 + 1.0);
                let (found, thin) = allowed(first, second);
                let lit = |d: f64, v: u32| d.ceil() <= f64::from(v);
                let right: Vec<u32> = (0..16).filter(|v| lit(first, *v) && !lit(second, *v)).collect();
                assert_eq!(thin, right.is_empty(), "{first} {second}");
                let wanted = if thin { vec![first.ceil() as u32] } else { right };
                assert_eq!((0..16).filter(|v| found.contains(*v)).collect::<Vec<_>>(), wanted, "{first} {second}");
            }
        }
        assert_eq!(allowed(3.0, f64::INFINITY).0, Interval { min: 3, max: u32::MAX - 1 });
        assert_eq!(allowed(f64::INFINITY, f64::INFINITY).0, Interval { min: u32::MAX, max: u32::MAX });
    }
}
