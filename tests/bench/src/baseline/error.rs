//! What is wrong in a method's answers, held against the intervals: every texel at the two depths where the answer must
//! change, and receivers anywhere.
//!
//! A wide interval of the image may be a proven part of the truth. So what seems wrong is asked again of the exact oracle.

use rayon::prelude::*;
use umbrage::certify::Oracle;
use umbrage::writer::interval::Interval;

use super::Baseline;
use super::image::Image;

/// Over all texels.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Errors {
    /// Texels that were asked.
    pub texels: u64,
    /// Of those, texels where the deepest receiver that must be lit is not, or the first that must be dark is lit. Of a
    /// method with a depth per texel: its depth lies outside the interval.
    pub outside: u64,
    /// Largest distance of a depth to its interval, lattice steps; 0 of a method without depths.
    pub largest: u64,
    /// Sum of the squares of all distances.
    squares: f64,
}

impl Errors {
    /// Asks every texel. Without an oracle the image is the truth.
    pub fn of(method: &dyn Baseline, image: &Image, oracle: Option<&Oracle>) -> Errors {
        let (tiles, size) = image.tiles();
        let one = |[x0, y0]: &[usize; 2]| {
            let mut e = Errors::default();
            for (y, x) in (*y0..y0 + size).flat_map(|y| (*x0..x0 + size).map(move |x| (y, x))) {
                e.add(method, image, oracle, [x, y]);
            }
            e
        };
        tiles.par_iter().map(one).reduce(Errors::default, Errors::plus)
    }

    /// Asks some texels, whose truth the oracle says.
    pub fn at(method: &dyn Baseline, oracle: &Oracle, places: &[[u32; 2]]) -> Errors {
        let one = |&[x, y]: &[u32; 2]| {
            let mut e = Errors { texels: 1, ..Errors::default() };
            e.count(method.value(x, y).is_some(), distance(method, [x, y], exact(oracle, x, y)));
            e
        };
        places.par_iter().with_min_len(64).map(one).reduce(Errors::default, Errors::plus)
    }

    fn add(&mut self, method: &dyn Baseline, image: &Image, oracle: Option<&Oracle>, [x, y]: [usize; 2]) {
        let [column, row] = [x, y].map(|v| v as u32);
        self.texels += 1;
        let truth = image.truth(x, y);
        if distance(method, [column, row], truth) == 0 {
            return;
        }
        let oracle = oracle.filter(|_| !image.is_whole(x, y));
        let off = distance(method, [column, row], oracle.map_or(truth, |o| exact(o, column, row)));
        self.count(method.value(column, row).is_some(), off);
    }

    fn count(&mut self, has_depths: bool, off: u64) {
        self.outside += u64::from(off > 0);
        if has_depths {
            self.largest = self.largest.max(off);
            self.squares += (off as f64).powi(2);
        }
    }

    fn plus(self, o: Errors) -> Errors {
        Errors {
            texels: self.texels + o.texels,
            outside: self.outside + o.outside,
            largest: self.largest.max(o.largest),
            squares: self.squares + o.squares,
        }
    }

    /// Share of texels that are outside.
    pub fn share(&self) -> f64 {
        self.outside as f64 / self.texels.max(1) as f64
    }

    /// Root of the mean square of the distances, lattice steps, over all texels.
    pub fn rms(&self) -> f64 {
        (self.squares / self.texels.max(1) as f64).sqrt()
    }
}

/// How far a texel's depth lies outside an interval; of a method without depths whether its answers do.
fn distance(method: &dyn Baseline, [x, y]: [u32; 2], t: Interval) -> u64 {
    match method.value(x, y) {
        Some(v) => u64::from(t.min.saturating_sub(v).max(v.saturating_sub(t.max))),
        None => {
            let dark = t.max.checked_add(1).is_none_or(|d| !method.lit(x, y, d));
            u64::from(!(dark && method.lit(x, y, t.min)))
        }
    }
}

fn exact(oracle: &Oracle, x: u32, y: u32) -> Interval {
    let truth = oracle.texel(x, y).interval;
    Interval { min: truth.min, max: truth.max }
}

/// Share of the receivers (x, y, d) that are answered wrongly, of those whose answer the interval fixes.
pub fn wrong(method: &dyn Baseline, image: &Image, oracle: Option<&Oracle>, receivers: &[[u32; 3]]) -> f64 {
    let one = |&[x, y, d]: &[u32; 3]| {
        let lit = method.lit(x, y, d);
        let held = |t: Interval| held(t, d, lit);
        let oracle = oracle.filter(|_| !image.is_whole(x as usize, y as usize));
        match (held(image.truth(x as usize, y as usize)), oracle) {
            ([_, 1], Some(oracle)) => held(exact(oracle, x, y)),
            (found, _) => found,
        }
    };
    share(receivers, one)
}

/// The same without an image: the oracle says the truth of every receiver.
pub fn wrong_at(method: &dyn Baseline, oracle: &Oracle, receivers: &[[u32; 3]]) -> f64 {
    share(receivers, |&[x, y, d]| held(exact(oracle, x, y), d, method.lit(x, y, d)))
}

/// Whether the answer at depth `d` is fixed, and whether it is wrong.
fn held(t: Interval, d: u32, lit: bool) -> [u64; 2] {
    let fixed = d <= t.min || d > t.max;
    [u64::from(fixed), u64::from(fixed && lit != (d <= t.min))]
}

fn share(receivers: &[[u32; 3]], one: impl Fn(&[u32; 3]) -> [u64; 2] + Sync) -> f64 {
    let [asked, wrong] =
        receivers.par_chunks(1024).map(|part| part.iter().map(&one).fold([0, 0], sum)).reduce(|| [0, 0], sum);
    wrong as f64 / asked.max(1) as f64
}

fn sum(a: [u64; 2], b: [u64; 2]) -> [u64; 2] {
    [a[0] + b[0], a[1] + b[1]]
}

#[cfg(test)]
mod tests {
    use super::super::tests::made;
    use super::super::{Baseline, answers_by_value};
    use super::*;

    struct Constant(u32);

    impl Constant {
        fn value_of(&self, _: u32, _: u32) -> u32 {
            self.0
        }
    }

    impl Baseline for Constant {
        fn name(&self) -> String {
            "constant".to_string()
        }

        fn citation(&self) -> &'static str {
            "none"
        }

        fn bytes(&self) -> u64 {
            4
        }

        answers_by_value!();
    }

    /// The same answers without depths.
    struct Bits(u32);

    impl Baseline for Bits {
        fn name(&self) -> String {
            "bits".to_string()
        }

        fn citation(&self) -> &'static str {
            "none"
        }

        fn bytes(&self) -> u64 {
            4
        }

        fn value(&self, _: u32, _: u32) -> Option<u32> {
            None
        }

        fn lit(&self, _: u32, _: u32, d: u32) -> bool {
            d <= self.0
        }

        fn count(&self, receivers: &[[u32; 3]]) -> usize {
            super::super::count(receivers, |_, _, d| d <= self.0)
        }
    }

    #[test]
    fn distances_and_shares_are_those_counted_by_hand() {
        // Of four texels one holds 10, one lies 5 above it, one 3 below, one is uncovered.
        let image = made(1, |x, y| match (x, y) {
            (0, 0) => [8, 12],
            (1, 0) => [15, 20],
            (0, 1) => [2, 7],
            _ => [u32::MAX, u32::MAX],
        });
        let found = Errors::of(&Constant(10), &image, None);
        let far = u64::from(u32::MAX - 10);
        assert_eq!((found.texels, found.outside, found.largest), (4, 3, far));
        assert!((found.rms() - ((25.0 + 9.0 + (far as f64).powi(2)) / 4.0).sqrt()).abs() < 1e-3);
        assert_eq!(Errors::of(&Bits(10), &image, None).outside, 3);
        // Fixed: all but (0, 0, 10); wrong: (1, 0, 15) and (0, 1, 8).
        let receivers = [[0, 0, 10], [1, 0, 15], [0, 1, 8], [1, 0, 21], [0, 0, 8]];
        assert_eq!(wrong(&Constant(10), &image, None, &receivers), 0.5);
        assert_eq!(Constant(10).count(&receivers), 3);
    }
}
