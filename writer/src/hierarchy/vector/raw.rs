//! Depths for a block of 4 x 4 texels that few entries do not answer: one for each texel, in the fewest bits that the intervals
//! allow.

use crate::interval::Interval;

/// A depth in each of 16 intervals, all of which differ by multiples of a power of two: of all choices one whose numbers of
/// steps take the fewest bits.
pub fn depths(intervals: &[Interval; 16]) -> [u32; 16] {
    let lowest = intervals.iter().map(|i| i.max).min().unwrap_or(0);
    let highest = intervals.iter().map(|i| i.min).max().unwrap_or(0);
    let bits = |n: u32| u32::BITS - n.leading_zeros();
    let mut best = (u32::MAX, intervals.map(|i| i.min));
    for shift in (0..32).rev() {
        // some are at most `lowest`, some at least `highest`, whatever the steps
        if best.0 <= bits(highest.saturating_sub(lowest) >> shift) {
            break;
        }
        // if any steps will do, steps down to the beginning of an interval will
        for depths in intervals.iter().filter_map(|i| congruent(intervals, lowest, i.min, shift)) {
            let (low, high) = (depths.iter().min(), depths.iter().max());
            let width = low.zip(high).map_or(0, |(low, high)| bits((high - low) >> shift));
            if width < best.0 {
                best = (width, depths);
            }
        }
    }
    best.1
}

/// Depths that differ from `like` by multiples of `2^shift`: the largest at most `lowest` where that is right, else the
/// smallest that is.
fn congruent(intervals: &[Interval; 16], lowest: u32, like: u32, shift: u32) -> Option<[u32; 16]> {
    let step = 1u64 << shift;
    let rest = u64::from(like) % step;
    let lowest = u64::from(lowest);
    let base = (lowest + step - rest) / step * step + rest;
    let base = base.checked_sub(step);
    let mut depths = [0; 16];
    for (depth, i) in depths.iter_mut().zip(intervals) {
        let min = u64::from(i.min);
        let v = match base {
            Some(base) if base >= min => base,
            _ => min + (rest + step - min % step) % step,
        };
        *depth = u32::try_from(v).ok().filter(|v| *v <= i.max)?;
    }
    Some(depths)
}

#[cfg(test)]
mod tests {
    use super::*;
    use umbrage_format::kind::vector::Raw;

    /// Every choice of a shift, a rest and depths; bits of the narrowest.
    fn fewest(intervals: &[Interval; 16]) -> u32 {
        let mut best = 32;
        for shift in 0..8 {
            for rest in 0..1u32 << shift {
                // the depths of each texel, as numbers of steps
                let numbers: Vec<(u32, u32)> = intervals
                    .iter()
                    .filter_map(|i| {
                        let all: Vec<u32> = (i.min..=i.max).filter(|v| v % (1 << shift) == rest).collect();
                        Some((*all.first()? >> shift, *all.last()? >> shift))
                    })
                    .collect();
                if numbers.len() == 16 {
                    let (low, high) = (numbers.iter().map(|n| n.1).min(), numbers.iter().map(|n| n.0).max());
                    let span = high.unwrap().saturating_sub(low.unwrap());
                    best = best.min(32 - span.leading_zeros());
                }
            }
        }
        best
    }

    #[test]
    fn depths_take_the_fewest_bits() {
        let mut state = 7u32;
        let mut roll = |n: u32| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) % n
        };
        let mut widths = [0; 9];
        for _ in 0..3000 {
            let (spread, wide) = (1 + roll(200), 1 + roll(40));
            let intervals: [Interval; 16] = std::array::from_fn(|_| {
                let min = 20 + roll(spread);
                Interval { min, max: min + roll(wide) }
            });
            let depths = depths(&intervals);
            assert!(intervals.iter().zip(depths).all(|(i, v)| i.min <= v && v <= i.max), "{intervals:?}: {depths:?}");
            let width = u32::from(Raw::of(&depths).width);
            assert_eq!(width, fewest(&intervals), "{intervals:?}: {depths:?}");
            widths[width as usize] += 1;
        }
        assert!(widths[..8].iter().all(|n| *n > 10), "{widths:?}");
    }

    #[test]
    fn depths_reach_both_ends_of_the_lattice() {
        let mut intervals = [Interval::UNCOVERED; 16];
        intervals[3] = Interval { min: 0, max: 0 };
        intervals[4] = Interval { min: 5, max: 1 << 31 };
        let depths = depths(&intervals);
        assert_eq!((depths[3], depths[15]), (0, u32::MAX));
        assert!((5..=1 << 31).contains(&depths[4]));
    }
}
