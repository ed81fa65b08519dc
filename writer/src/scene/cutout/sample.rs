//! The alpha of a mask as a function of a position in the image, in pieces that are polynomials.
//!
//! Positions are integers, [`UNIT`] to a pixel. Cell (i, j) is the square from (i, j) to (i + 1, j + 1): a pixel for
//! nearest sampling, the square between four pixel centres for bilinear sampling. Coefficients are whole numbers of
//! 1/255, so that the pieces of neighbouring cells agree to the bit on the side that they share.

use crate::scene::load::{AlphaMask, Wrap};

/// Steps of a pixel.
pub const UNIT: i64 = 1 << 22;

/// The farthest position, in pixels: up to here f64 holds every position.
pub const FARTHEST: i64 = 1 << 30;

/// Within a cell: alpha x 255 at (x, y), both from 0 to 1, is b + bx x + by y + bxy x y.
#[derive(Clone, Copy, Debug)]
pub struct Cell {
    pub b: f64,
    pub bx: f64,
    pub by: f64,
    pub bxy: f64,
}

impl Cell {
    pub fn at(&self, [x, y]: [f64; 2]) -> f64 {
        (self.b + self.by * y) + (self.bx + self.bxy * y) * x
    }
}

/// What a cell is wherever the opacity is within its range.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Class {
    Hole,
    Solid,
    Mixed,
}

/// A mask for triangles whose opacity stays within a range.
pub struct Field<'a> {
    mask: &'a AlphaMask,
    /// Solid where alpha x 255 x opacity reaches this.
    level: f64,
    /// By alpha.
    classes: Vec<Class>,
}

impl<'a> Field<'a> {
    pub fn new(mask: &'a AlphaMask, opacity: [f32; 3]) -> Self {
        // What f32 rounds to the cutoff counts as equal to it.
        let cutoff = f64::from(mask.cutoff);
        let level = 255.0 * (cutoff - cutoff.abs() / 16_777_216.0);
        let classes = (0..=255u8).map(|alpha| {
            let solid = opacity.map(|o| f64::from(alpha) * f64::from(o) >= level);
            match solid {
                [true, true, true] => Class::Solid,
                [false, false, false] => Class::Hole,
                _ => Class::Mixed,
            }
        });
        Field { mask, level, classes: classes.collect() }
    }

    /// Position of texture coordinates; none if it is beyond [`FARTHEST`].
    pub fn place(&self, uv: [f32; 2]) -> Option<[i64; 2]> {
        let size = [self.mask.image.width, self.mask.image.height];
        let shift = if self.mask.linear { 0.5 } else { 0.0 };
        let at = [0, 1].map(|d| {
            let pixels = f64::from(uv[d]) * f64::from(size[d]) - shift;
            (pixels.abs() <= FARTHEST as f64).then(|| (pixels * UNIT as f64).round() as i64)
        });
        Some([at[0]?, at[1]?])
    }

    pub fn linear(&self) -> bool {
        self.mask.linear
    }

    /// Solid where this is not negative.
    pub fn value(&self, alpha: f64, opacity: f64) -> f64 {
        alpha * opacity - self.level
    }

    pub fn level(&self) -> f64 {
        self.level
    }

    fn alpha(&self, [i, j]: [i64; 2]) -> u8 {
        let image = &self.mask.image;
        let [x, y] = [wrapped(i, image.width, self.mask.wrap[0]), wrapped(j, image.height, self.mask.wrap[1])];
        image.alpha[y * image.width as usize + x]
    }

    pub fn cell(&self, [i, j]: [i64; 2]) -> Cell {
        let a = |i, j| f64::from(self.alpha([i, j]));
        if !self.mask.linear {
            return Cell { b: a(i, j), bx: 0.0, by: 0.0, bxy: 0.0 };
        }
        let [b, right, up, far] = [a(i, j), a(i + 1, j), a(i, j + 1), a(i + 1, j + 1)];
        Cell { b, bx: right - b, by: up - b, bxy: far - right - up + b }
    }

    pub fn class(&self, [i, j]: [i64; 2]) -> Class {
        let of = |i, j| self.classes[usize::from(self.alpha([i, j]))];
        let first = of(i, j);
        if self.mask.linear && [of(i + 1, j), of(i, j + 1), of(i + 1, j + 1)] != [first; 3] {
            return Class::Mixed;
        }
        first
    }
}

fn wrapped(i: i64, size: u32, wrap: Wrap) -> usize {
    let n = i64::from(size);
    let i = match wrap {
        _ if (0..n).contains(&i) => i,
        Wrap::Clamp => i.clamp(0, n - 1),
        Wrap::Repeat => i.rem_euclid(n),
        Wrap::Mirror => {
            let i = i.rem_euclid(2 * n);
            i.min(2 * n - 1 - i)
        }
    };
    i as usize
}
