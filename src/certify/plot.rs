//! Convex pieces of a texel with exact corners.
//!
//! Everything is counted in lattice steps from the texel's lowest corner. A corner is the meeting point of two lines
//! with whole coefficients, so its description does not grow however often a piece is cut. Signs come from floats
//! with an error bound where that decides, from whole numbers otherwise.

use num_bigint::{BigInt, Sign};
use num_traits::ToPrimitive;
use std::cell::OnceCell;
use std::cmp::Ordering;

/// Relative error allowed for a few rounded operations in a row; 2^-53 is one.
pub(super) const ROUNDING: f64 = 1.0 / (1u64 << 49) as f64;

/// Three whole numbers: 128 bits where they fit.
#[derive(Clone, Debug)]
pub(super) enum Triple {
    Small([i128; 3]),
    Big(Box<[BigInt; 3]>),
}

impl Triple {
    pub(super) fn big(&self) -> [BigInt; 3] {
        match self {
            Triple::Small(t) => t.map(BigInt::from),
            Triple::Big(t) => (**t).clone(),
        }
    }

    pub(super) fn from_big(t: [BigInt; 3]) -> Self {
        match [t[0].to_i128(), t[1].to_i128(), t[2].to_i128()] {
            [Some(a), Some(b), Some(c)] => Triple::Small([a, b, c]),
            _ => Triple::Big(Box::new(t)),
        }
    }

    fn cross(&self, o: &Self) -> Self {
        if let (Triple::Small(l), Triple::Small(r)) = (self, o) {
            let minor = |i: usize, j: usize| l[i].checked_mul(r[j])?.checked_sub(l[j].checked_mul(r[i])?);
            if let (Some(x), Some(y), Some(w)) = (minor(1, 2), minor(2, 0), minor(0, 1)) {
                return Triple::Small([x, y, w]);
            }
        }
        let (l, r) = (self.big(), o.big());
        let minor = |i: usize, j: usize| &l[i] * &r[j] - &l[j] * &r[i];
        Self::from_big([minor(1, 2), minor(2, 0), minor(0, 1)])
    }

    fn negated(self) -> Self {
        match self {
            // the smallest number has no negative
            Triple::Small(t) if !t.contains(&i128::MIN) => Triple::Small(t.map(|v| -v)),
            t => Self::from_big(t.big().map(|v| -v)),
        }
    }

    fn sign_of_last(&self) -> Ordering {
        match self {
            Triple::Small(t) => t[2].cmp(&0),
            Triple::Big(t) => sign(&t[2]),
        }
    }

    /// The scalar product; `None` where 128 bits do not hold it.
    pub(super) fn small_dot(&self, o: &[i128; 3]) -> Option<i128> {
        let Triple::Small(t) = self else { return None };
        let [a, b, c] = [t[0].checked_mul(o[0])?, t[1].checked_mul(o[1])?, t[2].checked_mul(o[2])?];
        a.checked_add(b)?.checked_add(c)
    }

    /// The scalar product.
    pub(super) fn dot(&self, o: &[BigInt; 3]) -> BigInt {
        match self {
            Triple::Small(t) => &o[0] * t[0] + &o[1] * t[1] + &o[2] * t[2],
            Triple::Big(t) => &o[0] * &t[0] + &o[1] * &t[1] + &o[2] * &t[2],
        }
    }

    fn floats(&self) -> [f64; 3] {
        match self {
            Triple::Small(t) => t.map(|v| v as f64),
            Triple::Big(t) => [0, 1, 2].map(|i: usize| t[i].to_f64().unwrap_or(f64::NAN)),
        }
    }
}

pub(super) fn sign(v: &BigInt) -> Ordering {
    match v.sign() {
        Sign::Minus => Ordering::Less,
        Sign::NoSign => Ordering::Equal,
        Sign::Plus => Ordering::Greater,
    }
}

/// The line `a u + b v + c = 0`.
struct Line {
    exact: Triple,
    float: [f64; 3],
}

/// The meeting point of two lines.
pub(super) struct Corner {
    lines: [u32; 2],
    /// Position, each coordinate off by at most `err`.
    pub(super) at: [f64; 2],
    pub(super) err: f64,
    exact: OnceCell<Triple>,
}

/// A convex polygon, counter-clockwise: each corner, and the line of the side that starts there.
pub(super) type Piece = Vec<(u32, u32)>;

/// The lines and corners made so far in one texel.
pub(super) struct Plot {
    lines: Vec<Line>,
    pub(super) corners: Vec<Corner>,
}

impl Plot {
    /// A plot of an open square with `side` steps to a side, and that square.
    pub(super) fn new(side: i64) -> (Self, Piece) {
        let mut plot = Self { lines: Vec::new(), corners: Vec::new() };
        let s = i128::from(side);
        for line in [[0, 1, 0], [-1, 0, s], [0, -1, s], [1, 0, 0]] {
            plot.line(Triple::Small(line));
        }
        for (i, at) in [[0, 0], [s, 0], [s, s], [0, s]].into_iter().enumerate() {
            let exact = OnceCell::from(Triple::Small([at[0], at[1], 1]));
            let lines = [(i as u32 + 3) % 4, i as u32];
            plot.corners.push(Corner { lines, at: at.map(|v| v as f64), err: 0.0, exact });
        }
        (plot, (0..4).map(|i| (i, i)).collect())
    }

    /// Adds a line and returns its number.
    pub(super) fn line(&mut self, exact: Triple) -> u32 {
        let float = exact.floats();
        self.lines.push(Line { exact, float });
        self.lines.len() as u32 - 1
    }

    /// Bounds of the piece, a little wide: lowest and highest corner.
    pub(super) fn bounds(&self, piece: &Piece) -> [[f64; 2]; 2] {
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for c in piece.iter().map(|&(c, _)| &self.corners[c as usize]) {
            low = [0, 1].map(|k| low[k].min(c.at[k] - c.err));
            high = [0, 1].map(|k| high[k].max(c.at[k] + c.err));
        }
        [low, high]
    }

    /// The corner as `[x, y, w]` with `w > 0`; it lies at `(x / w, y / w)`.
    pub(super) fn exact(&self, corner: u32) -> &Triple {
        let c = &self.corners[corner as usize];
        c.exact.get_or_init(|| {
            let [l, r] = c.lines.map(|l| &self.lines[l as usize].exact);
            let t = l.cross(r);
            if t.sign_of_last().is_lt() { t.negated() } else { t }
        })
    }

    /// On which side of the line the corner lies.
    pub(super) fn side(&self, line: u32, corner: u32) -> Ordering {
        let c = &self.corners[corner as usize];
        if c.lines.contains(&line) {
            return Ordering::Equal;
        }
        let Line { exact, float: [a, b, k] } = &self.lines[line as usize];
        let [p, q] = [a * c.at[0], b * c.at[1]];
        let (sum, err) = (p + q + k, ROUNDING * (p.abs() + q.abs() + k.abs()) + c.err * (a.abs() + b.abs()));
        if sum.abs() > err {
            return if sum > 0.0 { Ordering::Greater } else { Ordering::Less };
        }
        let at = self.exact(corner);
        if let Triple::Small(l) = exact
            && let Some(v) = at.small_dot(l)
        {
            return v.cmp(&0);
        }
        sign(&at.dot(&exact.big()))
    }

    /// Whether corners of the piece lie strictly behind and strictly before the line.
    pub(super) fn sides(&self, piece: &Piece, line: u32) -> (bool, bool) {
        let (mut behind, mut before) = (false, false);
        for &(c, _) in piece {
            match self.side(line, c) {
                Ordering::Less => behind = true,
                Ordering::Equal => {}
                Ordering::Greater => before = true,
            }
        }
        (behind, before)
    }

    fn meet(&mut self, l: u32, r: u32) -> u32 {
        let [[a, b, c], [d, e, f]] = [l, r].map(|l| self.lines[l as usize].float);
        let minor = |p: f64, q: f64| (p - q, ROUNDING * (p.abs() + q.abs()));
        let ((x, ex), (y, ey), (w, ew)) = (minor(b * f, c * e), minor(c * d, a * f), minor(a * e, b * d));
        let at = [x / w, y / w];
        // For |ew| <= |w| / 2: |x / w - x' / w'| <= 2 (ex + |x / w| ew) / |w|, and rounding.
        let worst = ex.max(ey) + at[0].abs().max(at[1].abs()) * (ew + w.abs() * ROUNDING);
        let err = 2.0 * worst / w.abs();
        let number = self.corners.len() as u32;
        self.corners.push(Corner { lines: [l, r], at, err, exact: OnceCell::new() });
        let small = 1.0 / 1024.0;
        if !(ew * 2.0 <= w.abs() && err < small) {
            let at = self.exact(number);
            let [x, y, w] = at.floats();
            let at = [x / w, y / w];
            let err = ROUNDING * at[0].abs().max(at[1].abs());
            let c = &mut self.corners[number as usize];
            (c.at, c.err) = (at, err);
        }
        number
    }

    /// The parts of the piece behind and before a line that crosses it.
    pub(super) fn cut(&mut self, piece: &Piece, line: u32) -> [Piece; 2] {
        let sides: Vec<Ordering> = piece.iter().map(|&(c, _)| self.side(line, c)).collect();
        let mut parts = [Piece::new(), Piece::new()];
        for (i, &(corner, along)) in piece.iter().enumerate() {
            let (here, next) = (sides[i], sides[(i + 1) % piece.len()]);
            for (part, keep) in parts.iter_mut().zip([Ordering::Less, Ordering::Greater]) {
                if here == keep {
                    part.push((corner, along));
                } else if here.is_eq() {
                    // The part goes on along the cutting line unless the next corner is its own.
                    part.push((corner, if next == keep { along } else { line }));
                }
            }
            if here.is_ne() && next.is_ne() && here != next {
                let c = self.meet(along, line);
                for (part, keep) in parts.iter_mut().zip([Ordering::Less, Ordering::Greater]) {
                    part.push((c, if here == keep { line } else { along }));
                }
            }
        }
        parts
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_smallest_number_is_negated() {
        let t = Triple::Small([i128::MIN, 3, i128::MIN]).negated();
        assert_eq!(t.big(), [-BigInt::from(i128::MIN), BigInt::from(-3), -BigInt::from(i128::MIN)]);
        assert_eq!((t.sign_of_last(), t.negated().sign_of_last()), (Ordering::Greater, Ordering::Less));
    }
}
