//! Jukka Arvo, Mika Hirvikorpi, *Compressed Shadow Maps*, The Visual Computer 21 (3), 2005: each scan line is covered by
//! line segments that stay between the first surface and where its object ends.
//!
//! A segment holds where it begins, its depth there, and its slope; it ends where the next one begins:
//!
//! | | first x | depth | slope, lattice steps per texel |
//! |---|---|---|---|
//! | 12 bytes | 32 bits | 32 bits | f32 |
//! | 8 bytes | 16 bits | 32 bits | 16 bits: sign, 5 bits e, 10 bits m: m 2^(e - 8) |
//!
//! Apart from these, 4 bytes a row say where its segments begin. A lookup searches its row by bisection and evaluates one
//! line. Depth at x: depth + floor(slope (x - first)).
//!
//! Each segment is as long as any line allows (the stabbing line of O'Rourke 1981, kept up to date with two convex
//! hulls); then its slope is rounded to what is stored, and it ends before the first texel that no depth suits any more.
//! So both forms are strictly within the intervals; what rounding costs is more segments.
//!
//! Unlike the paper, which cuts triangles and has segments end at any real x, lines are fitted to the intervals of
//! texels, as Scandolo et al. 2016 did for their comparison. The paper's text was not at hand: the widths are from this
//! project's plan (12 bytes at full precision, 8 bytes packed).

use rayon::prelude::*;

use super::image::Image;
use super::{Baseline, answers_by_value};
use umbrage::writer::interval::Interval;

/// How a segment is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    /// 12 bytes.
    Wide,
    /// 8 bytes.
    Packed,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Line {
    first: u32,
    depth: u32,
    slope: Slope,
}

/// A slope as stored, widened.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Slope(f32);

impl Slope {
    /// The nearest one that the form can hold.
    fn nearest(slope: f64, form: Form) -> Slope {
        match form {
            Form::Wide => Slope(slope as f32),
            Form::Packed => Slope::of_bits(Slope::to_bits(slope)),
        }
    }

    fn to_bits(slope: f64) -> u16 {
        let size = slope.abs() * 256.0;
        let e = (0..31).find(|e| size / f64::from(1u32 << e) < 1023.5).unwrap_or(31);
        let m = (size / 2f64.powi(e)).round().min(1023.0) as u16;
        u16::from(slope < 0.0) << 15 | (e as u16) << 10 | m
    }

    #[inline]
    fn of_bits(bits: u16) -> Slope {
        let e = i32::from(bits >> 10 & 31) - 8;
        // Built from its exponent: exact, and no call.
        let power = f32::from_bits(((e + 127) as u32) << 23);
        let size = f32::from(bits & 1023) * power;
        Slope(if bits >> 15 != 0 { -size } else { size })
    }

    /// How far the line has come after `dx` texels: exact up to the rounding to a whole step, since 24 bits of a slope
    /// times 24 bits fit an f64.
    #[inline]
    fn after(self, dx: u32) -> i64 {
        let off = f64::from(self.0) * f64::from(dx);
        let whole = off as i64;
        whole - i64::from(off < whole as f64)
    }
}

/// A map.
pub struct Scanlines {
    form: Form,
    /// First segment of each row, and the end.
    rows: Vec<u32>,
    wide: Vec<(u32, u32, f32)>,
    /// First x in the upper 16 bits, slope in the lower; the depth.
    packed: Vec<(u32, u32)>,
}

impl Scanlines {
    /// Covers every row.
    ///
    /// # Panics
    /// Form [`Form::Packed`] and more than 65,536 texels on a side.
    pub fn new(image: &Image, form: Form) -> Scanlines {
        assert!(form == Form::Wide || image.log2 <= 16);
        let side = image.side();
        let lines: Vec<Vec<Line>> = (0..side)
            .into_par_iter()
            .map(|y| {
                let row: Vec<Interval> = (0..side).map(|x| image.allowed(x, y)).collect();
                cover(&row, form)
            })
            .collect();
        let mut map = Scanlines { form, rows: vec![0], wide: Vec::new(), packed: Vec::new() };
        for line in lines {
            for l in line {
                match form {
                    Form::Wide => map.wide.push((l.first, l.depth, l.slope.0)),
                    Form::Packed => {
                        let bits = Slope::to_bits(f64::from(l.slope.0));
                        map.packed.push((l.first << 16 | u32::from(bits), l.depth));
                    }
                }
            }
            map.rows.push((map.wide.len() + map.packed.len()) as u32);
        }
        map
    }

    #[inline(always)]
    fn value_of(&self, x: u32, y: u32) -> u32 {
        let [from, to] = [y as usize, y as usize + 1].map(|i| self.rows[i] as usize);
        let line = match self.form {
            Form::Wide => {
                let row = &self.wide[from..to];
                let (first, depth, slope) = row[row.partition_point(|s| s.0 <= x) - 1];
                Line { first, depth, slope: Slope(slope) }
            }
            Form::Packed => {
                let row = &self.packed[from..to];
                let (head, depth) = row[row.partition_point(|s| s.0 >> 16 <= x) - 1];
                Line { first: head >> 16, depth, slope: Slope::of_bits(head as u16) }
            }
        };
        (i64::from(line.depth) + line.slope.after(x - line.first)) as u32
    }
}

impl Baseline for Scanlines {
    fn name(&self) -> String {
        match self.form {
            Form::Wide => "scan lines, 12 B".to_string(),
            Form::Packed => "scan lines, 8 B".to_string(),
        }
    }

    fn citation(&self) -> &'static str {
        "Arvo, Hirvikorpi, Compressed Shadow Maps, The Visual Computer 21 (3), 2005"
    }

    fn bytes(&self) -> u64 {
        (4 * self.rows.len() + 12 * self.wide.len() + 8 * self.packed.len()) as u64
    }

    answers_by_value!();
}

/// Segments of one row, each as long as rounding leaves it.
fn cover(row: &[Interval], form: Form) -> Vec<Line> {
    let mut lines = Vec::new();
    let mut stab = Stab::default();
    let mut start = 0;
    while start < row.len() {
        stab.begin();
        let mut end = start;
        while end < row.len() && stab.add((end - start) as i64, row[end]) {
            end += 1;
        }
        // Uncovered texels have one right value: most of their rows are level, which no rounding spoils.
        let level = (row[start..end].iter().map(|i| i.min).max(), row[start..end].iter().map(|i| i.max).min());
        let slope = if level.0 <= level.1 { 0.0 } else { stab.slope() };
        let slope = Slope::nearest(slope, form);
        let (mut low, mut high, mut length) = (i64::from(row[start].min), i64::from(row[start].max), 1);
        for (dx, i) in (1u32..).zip(&row[start + 1..end]) {
            let off = slope.after(dx);
            let (l, h) = (low.max(i64::from(i.min) - off), high.min(i64::from(i.max) - off));
            if l > h {
                break;
            }
            (low, high, length) = (l, h, dx as usize + 1);
        }
        lines.push(Line { first: start as u32, depth: (low + (high - low) / 2) as u32, slope });
        start += length;
    }
    lines
}

type Point = (i64, i64);

/// All lines through the intervals so far, told by the steepest and the flattest of them.
#[derive(Default)]
struct Stab {
    /// Upper hull of the lower ends, lower hull of the upper ends, and where tangents begin on them.
    lower: Vec<Point>,
    upper: Vec<Point>,
    from: [usize; 2],
    /// A point early and a point late on the line of the largest slope, and of the smallest.
    steep: [Point; 2],
    flat: [Point; 2],
    count: usize,
}

/// Sign of the turn from `a` over `b` to `c`: above 0 to the left.
fn turn(a: Point, b: Point, c: Point) -> i64 {
    (b.0 - a.0) * (c.1 - a.1) - (b.1 - a.1) * (c.0 - a.0)
}

impl Stab {
    fn begin(&mut self) {
        self.lower.clear();
        self.upper.clear();
        (self.from, self.count) = ([0, 0], 0);
    }

    /// Takes the next interval in; false, and nothing changed, where no line is left.
    fn add(&mut self, x: i64, interval: Interval) -> bool {
        let (low, high) = ((x, i64::from(interval.min)), (x, i64::from(interval.max)));
        match self.count {
            0 => {}
            1 => {
                self.steep = [self.lower[0], high];
                self.flat = [self.upper[0], low];
            }
            _ => {
                if turn(self.steep[0], self.steep[1], low) > 0 || turn(self.flat[0], self.flat[1], high) < 0 {
                    return false;
                }
                if turn(self.steep[0], self.steep[1], high) < 0 {
                    let hull = &self.lower;
                    let mut i = self.from[0];
                    // The tangent from `high`: the next point of the hull lies above the line to this one.
                    while i + 1 < hull.len() && turn(hull[i], high, hull[i + 1]) >= 0 {
                        i += 1;
                    }
                    (self.from[0], self.steep) = (i, [hull[i], high]);
                }
                if turn(self.flat[0], self.flat[1], low) > 0 {
                    let hull = &self.upper;
                    let mut i = self.from[1];
                    while i + 1 < hull.len() && turn(hull[i], low, hull[i + 1]) <= 0 {
                        i += 1;
                    }
                    (self.from[1], self.flat) = (i, [hull[i], low]);
                }
            }
        }
        // Points before a tangent's are of no use any more: a hull is not popped beyond them.
        while self.lower.len() >= self.from[0] + 2
            && turn(self.lower[self.lower.len() - 2], self.lower[self.lower.len() - 1], low) >= 0
        {
            self.lower.pop();
        }
        while self.upper.len() >= self.from[1] + 2
            && turn(self.upper[self.upper.len() - 2], self.upper[self.upper.len() - 1], high) <= 0
        {
            self.upper.pop();
        }
        self.lower.push(low);
        self.upper.push(high);
        self.count += 1;
        true
    }

    /// A slope that a line may have: between the extremes.
    fn slope(&self) -> f64 {
        let slope = |[a, b]: [Point; 2]| (b.1 - a.1) as f64 / (b.0 - a.0) as f64;
        if self.count < 2 { 0.0 } else { 0.5 * (slope(self.steep) + slope(self.flat)) }
    }
}

#[cfg(test)]
mod tests {
    use super::super::error::Errors;
    use super::super::tests::{city, made, of};
    use super::*;
    use crate::random::Random;
    use umbrage::writer::solid::Policy;

    #[test]
    fn rows_counted_by_hand() {
        // A level row, a ramp of slope 3, a step.
        let image = made(2, |x, y| match y {
            0 => [50, 60],
            1 => [100 + 3 * x as u32; 2],
            2 => [if x < 2 { 7 } else { 1000 }; 2],
            _ => [u32::MAX; 2],
        });
        for (form, bytes) in [(Form::Wide, 12), (Form::Packed, 8)] {
            let map = Scanlines::new(&image, form);
            assert_eq!(map.bytes(), 4 * 5 + 5 * bytes, "{form:?}");
            assert_eq!([0, 1, 2, 3].map(|x| map.value_of(x, 0)), [55; 4]);
            assert_eq!([0, 1, 2, 3].map(|x| map.value_of(x, 1)), [100, 103, 106, 109]);
            assert_eq!([0, 1, 2, 3].map(|x| map.value_of(x, 2)), [7, 7, 1000, 1000]);
            assert_eq!(Errors::of(&map, &image, None).outside, 0);
        }
    }

    #[test]
    fn packed_slopes_are_within_a_thousandth_and_their_bits_come_back() {
        for bits in 0..=u16::MAX {
            let value = f64::from(Slope::of_bits(bits).0);
            assert_eq!(f64::from(Slope::of_bits(Slope::to_bits(value)).0), value);
        }
        let mut random = Random::new(5, 0);
        for _ in 0..100_000 {
            let slope = (random.unit() - 0.5) * 2f64.powf(32.0 * random.unit());
            let stored = f64::from(Slope::nearest(slope, Form::Packed).0);
            assert!((stored - slope).abs() <= (slope.abs() / 1023.0).max(1.0 / 512.0), "{slope} {stored}");
        }
    }

    /// The greedy segment ends where no line is left: checked against all pairs of points.
    #[test]
    fn a_line_is_found_wherever_there_is_one() {
        let mut random = Random::new(6, 0);
        let (mut ended, mut whole) = (0, 0);
        for case in 0..3000u64 {
            let slope = (random.unit() - 0.5) * 40.0;
            let row: Vec<Interval> = (0..12)
                .map(|x| {
                    let middle = 1000.0 + slope * f64::from(x) + 6.0 * (random.unit() - 0.5);
                    let half = 8.0 * random.unit() + 1.0;
                    Interval {
                        min: (middle - half).ceil() as u32,
                        max: (middle + half).floor().max(middle.ceil()) as u32,
                    }
                })
                .map(|i| Interval { min: i.min, max: i.max.max(i.min) })
                .collect();
            // A line exists iff, of some pair of points, the one through them or a level one suits all.
            let exists = |n: usize| {
                let points: Vec<Point> = (0..n)
                    .flat_map(|x| [(x as i64, i64::from(row[x].min)), (x as i64, i64::from(row[x].max))])
                    .collect();
                let suits = |a: Point, b: Point| {
                    (0..n).all(|x| {
                        let [l, h] = [row[x].min, row[x].max].map(|v| turn(a, b, (x as i64, i64::from(v))));
                        l <= 0 && h >= 0
                    })
                };
                n < 2 || points.iter().any(|a| points.iter().any(|b| a.0 < b.0 && suits(*a, *b)))
            };
            let mut stab = Stab::default();
            stab.begin();
            let n = (0..12).take_while(|x| stab.add(*x as i64, row[*x])).count();
            assert!(exists(n), "case {case}");
            assert!(n == 12 || !exists(n + 1), "case {case}: {n}");
            ended += usize::from(n < 12);
            whole += usize::from(n == 12);
        }
        assert!(ended > 100 && whole > 100, "{ended} ended, {whole} whole");
    }

    #[test]
    fn a_city_keeps_within_its_intervals() {
        for (policy, most) in [(Policy::Closed, 0.6), (Policy::OneSided, 9.0)] {
            let (_, image) = of("city:3:0.05", policy, 256);
            let [wide, packed] = [Form::Wide, Form::Packed].map(|f| Scanlines::new(&image, f));
            assert_eq!(Errors::of(&wide, &image, None).outside, 0);
            assert_eq!(Errors::of(&packed, &image, None).outside, 0);
            let plain = 4 * 256 * 256;
            assert!((wide.bytes() as f64) < most * f64::from(plain), "{policy}: {} of {plain}", wide.bytes());
        }
        let (_, image) = city(256);
        assert!(Scanlines::new(&image, Form::Wide).wide.iter().any(|s| s.2 != 0.0), "some line has a slope");
    }
}
