//! Columns of texels in which something happens at a line, found without looking at each.

use std::cmp::Ordering;

use crate::hierarchy::vector::entry::Line;
use crate::interval::ceil;
use crate::interval::proof::HalfPlane;

/// A stored line as a function of columns, in texels from the tile's corner; columns run along the line's axis.
pub(super) struct Band {
    /// The first column.
    first: i64,
    /// Where the line is at its beginning.
    start: f64,
    /// How much further it is from column to column: at most one texel either way.
    step: f64,
    /// Lattice steps of a texel.
    texel: f64,
    /// The line's axis, and the other one.
    axes: [usize; 2],
}

/// What a line's boundary in whole 2^-20 texels may lie off a [`Band`], in texels, with much room for rounding.
pub(super) const ROUNDING: f64 = 16.0 / 1048576.0;
/// No point of a texel that holds a place of the line, or one next to it, lies further from the line across its axis.
const SPREAD: f64 = 2.1;

impl Band {
    /// Of a line from column `first` on, in a tile at texel `corner`.
    pub(super) fn new(line: &Line, corner: [i64; 2], first: i64, subtexel_bits: u8) -> Self {
        let axes = if line.axis { [1, 0] } else { [0, 1] };
        let start = line.boundary((corner[axes[0]] + first) * 256) - (corner[axes[1]] << 20);
        Band {
            first,
            start: start as f64 / 1048576.0,
            step: f64::from(line.m) / 2147483648.0,
            texel: f64::from(1u32 << subtexel_bits),
            axes,
        }
    }

    /// Where the line is at a place along its axis.
    fn at(&self, place: f64) -> f64 {
        self.start + self.step * (place - self.first as f64)
    }

    /// The columns of `from..to` in which a texel at the line may hold something of an open half-plane.
    pub(super) fn may_reach(&self, l: &HalfPlane, from: i64, to: i64) -> (i64, i64) {
        let (low, high) = self.within(l, -SPREAD);
        (from.max((low.floor() as i64).saturating_sub(2)), to.min((high.ceil() as i64).saturating_add(2)))
    }

    /// The columns of `from..to`, or fewer, in which all texels at the line lie in a half-plane.
    pub(super) fn surely_in(&self, l: &HalfPlane, from: i64, to: i64) -> (i64, i64) {
        let (low, high) = self.within(l, SPREAD);
        (from.max((low.ceil() as i64).saturating_add(2)), to.min((high.floor() as i64).saturating_sub(2)))
    }

    /// From where to where the line lies in a half-plane that is moved inward, across the line's axis, by some texels. Rounding
    /// moves the ends by far less than a column, or than [`SPREAD`] has room for: where the half-plane's border is steep against the axis,
    /// or flat.
    fn within(&self, l: &HalfPlane, inward: f64) -> (f64, f64) {
        let [along, across] = if self.axes[0] == 0 { [l.a, l.b] } else { [l.b, l.a] }.map(|v| v as f64 * self.texel);
        let first = along * self.first as f64 + across * self.start + l.c as f64 - across.abs() * inward;
        let rise = along + across * self.step;
        let root = self.first as f64 - first / rise;
        match rise.total_cmp(&0.0) {
            _ if rise == 0.0 || !root.is_finite() => {
                if first >= 0.0 {
                    (f64::NEG_INFINITY, f64::INFINITY)
                } else {
                    (0.0, 0.0)
                }
            }
            Ordering::Greater => (root, f64::INFINITY),
            _ => (f64::NEG_INFINITY, root),
        }
    }

    /// Calls `each` for the columns of `from..to` in whose middle the line is at most `off` texels from a texel's centre, and maybe
    /// for others. None as soon as that says so.
    pub(super) fn near_centres(
        &self,
        from: i64,
        to: i64,
        off: f64,
        mut each: impl FnMut(i64) -> Option<()>,
    ) -> Option<()> {
        let begins = |n: i64| self.at(n as f64 + 0.5) - 0.5 - off;
        strip(from, to - 1, begins, self.step, 2.0 * off, |n, _| each(n))
    }

    /// Calls `each` for the columns of `from..to` at whose beginning or end the line is at most `off` texels from a texel's corner,
    /// each once, and maybe for others. None as soon as that says so.
    pub(super) fn near_corners(
        &self,
        from: i64,
        to: i64,
        off: f64,
        mut each: impl FnMut(i64) -> Option<()>,
    ) -> Option<()> {
        let mut next = from;
        strip(
            from,
            to,
            |n| self.at(n as f64) - off,
            self.step,
            2.0 * off,
            |n, _| {
                for column in (n - 1).max(next)..=n.min(to - 1) {
                    each(column)?;
                    next = column + 1;
                }
                Some(())
            },
        )
    }
}

/// Each integer (row, column) in a strip, by rows from `first` to `last`: it begins where `begins` says in a row, `step` further
/// from row to row, and ends `width` behind. None as soon as `each` says so.
pub(super) fn strip(
    first: i64,
    last: i64,
    begins: impl Fn(i64) -> f64,
    step: f64,
    width: f64,
    mut each: impl FnMut(i64, i64) -> Option<()>,
) -> Option<()> {
    let mut row = first;
    while let Some(next) = next_hit(begins(row), step, width, last - row) {
        row += next;
        // a strip may be wider than a column
        for column in ceil(begins(row))..=-ceil(-begins(row) - width) {
            each(row, column)?;
        }
        row += 1;
    }
    Some(())
}

/// The first row, of those up to `last`, in which an integer lies at most `width` behind where a strip begins: at `begin` in row
/// 0, and `step` further from row to row.
fn next_hit(begin: f64, step: f64, width: f64, last: i64) -> Option<i64> {
    if last < 0 {
        return None;
    }
    // fractions of one in 2^60; what rounding makes over the rows is far below a strip's width
    const ONE: u128 = 1 << 60;
    let fraction = |x: f64| ((x - x.floor()) * ONE as f64) as u128 % ONE;
    // (start + n per row) mod 1 is how far the next integer lies behind the beginning
    let (start, each) = (fraction(-begin), fraction(-step));
    let width = (width * ONE as f64) as u128;
    if start <= width {
        return Some(0);
    }
    let (low, high) = (ONE - start, ONE - start + width);
    let row = if high >= ONE { first_multiple(each, ONE, low, ONE - 1) } else { first_multiple(each, ONE, low, high) };
    row.and_then(|r| i64::try_from(r).ok()).filter(|r| *r <= last)
}

/// The smallest n with `low <= a n mod m <= high`; `0 < low <= high < m` and `a < m < 2^62`.
fn first_multiple(a: u128, m: u128, low: u128, high: u128) -> Option<u128> {
    if a == 0 {
        return None;
    }
    if 2 * a > m {
        return first_multiple(m - a, m, m - high, m - low);
    }
    let n = low.div_ceil(a);
    if n * a <= high {
        return Some(n);
    }
    // no multiple of a lies between: how often m has to be gone around
    let around = first_multiple((a - m % a) % a, a, low % a, high % a)?;
    Some((low + m * around).div_ceil(a))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strips_of_any_width_are_looked_at_whole() {
        let mut state = 3u64;
        let mut dice = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 11) as f64 / (1u64 << 53) as f64
        };
        let mut most = [0; 4];
        for n in 0..2000 {
            let (begin, step, width) = (dice() * 40.0 - 20.0, dice() * 2.0 - 1.0, dice() * f64::from(n % 4 + 1));
            let first = (dice() * 9.0) as i64 - 4;
            let (last, begins) = (first + (dice() * 60.0) as i64 - 2, |row: i64| begin + step * row as f64);
            let mut found = Vec::new();
            let add = |r, c| {
                found.push((r, c));
                Some(())
            };
            assert!(strip(first, last, begins, step, width, add).is_some());
            let all = (first..=last).flat_map(|r| (-120..120).map(move |c| (r, c)));
            let behind = |(r, c): &(i64, i64)| *c as f64 - begins(*r);
            // what rounding may put on either side
            let inside: Vec<_> = all.filter(|p| behind(p) >= 1e-9 && behind(p) <= width - 1e-9).collect();
            assert!(inside.iter().all(|p| found.contains(p)), "{begin} {step} {width} {first} {last}");
            assert!(found.iter().all(|p| behind(p) >= -1e-9 && behind(p) <= width + 1e-9));
            let in_row = |r: i64| inside.iter().filter(|p| p.0 == r).count();
            most[n as usize % 4] = (first..=last).map(in_row).max().unwrap_or(0).max(most[n as usize % 4]);
        }
        assert_eq!(most, [1, 2, 3, 4]);
        let mut looked = 0;
        assert_eq!(
            strip(
                0,
                9,
                |_| 0.5,
                0.0,
                2.0,
                |_, _| {
                    looked += 1;
                    (looked < 5).then_some(())
                }
            ),
            None
        );
        assert_eq!(looked, 5);
    }

    #[test]
    fn rows_with_an_integer_in_the_strip_are_found_as_by_looking_at_each() {
        let mut state = 1u64;
        let mut dice = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 11) as f64 / (1u64 << 53) as f64
        };
        let (mut hits, mut none) = (0, 0);
        for n in 0..4000 {
            let (begin, step) = (dice() * 4000.0 - 2000.0, if n % 7 == 0 { 0.5 } else { dice() * 2.0 - 1.0 });
            let (width, last) = (dice() * dice() * dice() * 0.3, (dice() * 300.0) as i64 - 2);
            let slow = |slack: f64| {
                (0..=last).find(|r| {
                    let from = begin + step * *r as f64 - slack;
                    from.ceil() <= from + width + 2.0 * slack
                })
            };
            let found = next_hit(begin, step, width, last);
            let (wide, narrow) = (slow(1e-9), slow(-1e-9));
            assert!(found == wide || found == narrow, "{begin} {step} {width} {last}: {found:?} {wide:?} {narrow:?}");
            hits += u32::from(found.is_some());
            none += u32::from(found.is_none());
        }
        assert!(hits > 500 && none > 500, "{hits} {none}");
    }
}
