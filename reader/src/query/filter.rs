//! Percentage-closer filtering in integers (Scandolo et al. 2016, section 3.3): how many texels around a receiver's are
//! lit, at any level. CPU and GPU agree to the bit. `spec/filter.md` is the definition; in short:
//!
//! - A kernel of side N at level L has N x N taps: the texels of L from `X - N / 2` to `X - N / 2 + N - 1`, alike in y, X being
//!   the receiver's texel of L. With an even N it reaches one texel further towards smaller coordinates.
//! - A tap is lit iff `D + (gx * i + gy * j) / 16 <= v`: D is the receiver's depth, rounded up, (gx, gy) its
//!   [gradient](Receiver::gradient), v what the texel stores, and (i, j) the way from the receiver's texel of level 0 to that
//!   texel of level 0 under the tap where the receiver's plane is nearest to the light: a corner. On level 0 it is the tap
//!   itself. Nothing is rounded. Where v is [`UNCOVERED`](umbrage_format::projection::UNCOVERED) the tap is lit, as is one
//!   outside the map.
//! - So a surface doesn't shadow itself on any level: what a coarse texel stores is right for one of its texels at least, which
//!   may be any. The price is that a caster less far from the plane than it falls over the texel is lost.
//! - All taps are lookups of texels; none asks between texel centres.
//!
//! Taps descend together: [`descend`] walks to their lowest common node (figure 5), splits their rectangle there, and goes
//! on with each part. Where a walk ends above the texels, one node answers its whole part, without a walk for each.

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing,
    clippy::cast_possible_truncation
)]

use umbrage_format::structure::MAX_LOG2_RESOLUTION;

use super::Bounds;

/// Most texels on a side of a kernel. Drivers may end a shader's loops early (Mesa's software driver after 65,535 turns of
/// all of them); two levels of so many taps stay below on any tree.
pub const MAX_SIDE: u32 = 21;
/// Bits of a gradient below one step of depth.
pub const GRADIENT_BITS: u32 = 4;
/// Bits of a [level of detail](level_of_detail) below one level.
pub const LOD_BITS: u32 = 8;

/// A point whose shadow is asked for, on the lattice.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Receiver {
    /// Column of its texel on level 0.
    pub x: u32,
    /// Row of its texel on level 0.
    pub y: u32,
    /// Lattice depth, rounded up.
    pub depth: u32,
    /// How much its plane's depth rises from a texel of level 0 to the next along x and y, in 1/16 lattice step; see
    /// [`gradient`].
    pub gradient: [i32; 2],
}

/// How many taps are lit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Share {
    /// Lit taps, at most `taps`.
    pub lit: u32,
    /// All taps; of a blend of two levels 256 for each tap of a kernel.
    pub taps: u32,
    /// Whether the receiver lies in the map; outside all taps are lit.
    pub inside: bool,
}

impl Share {
    /// Between 0 (shadow) and 255 (light), rounded to the nearest.
    pub fn coverage(&self) -> u8 {
        let taps = u64::from(self.taps.max(1));
        u8::try_from((u64::from(self.lit) * 510 + taps) / (2 * taps)).unwrap_or(u8::MAX)
    }

    /// The blend of two levels that `part`/256 of the way from `self` lies; both have the same taps.
    pub fn blend(&self, coarser: &Share, part: u32) -> Share {
        let part = part.min(1 << LOD_BITS);
        let lit = self.lit * ((1 << LOD_BITS) - part) + coarser.lit * part;
        Share { lit, taps: self.taps << LOD_BITS, inside: self.inside }
    }
}

/// Gradient of a plane whose depth rises by `rise` lattice steps from a texel of level 0 to the next: in 1/16 step, rounded
/// to the nearest, between `-most` and `most` steps and within 32 bits. 0 where it is not a number.
#[allow(clippy::cast_possible_truncation)]
pub fn gradient(rise: [f64; 2], most: f64) -> [i32; 2] {
    let most = most.abs();
    // The cast is defined for every value: toward zero, saturation, NaN to 0.
    rise.map(|v| if most.is_nan() { 0 } else { (v.clamp(-most, most) * f64::from(1 << GRADIENT_BITS)).round() as i32 })
}

/// Level whose texels are as large as a pixel's footprint, in 1/256 level: the binary logarithm of the larger of both
/// derivatives (texels of level 0 for one pixel, along both axes of the picture), from 0 to `log2_resolution`.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
pub fn level_of_detail(derivatives: [[f64; 2]; 2], log2_resolution: u8) -> u32 {
    let larger = derivatives.iter().map(|[x, y]| x.hypot(*y)).fold(0.0, f64::max);
    let lod = larger.log2().clamp(0.0, f64::from(log2_resolution)) * f64::from(1 << LOD_BITS);
    // As above; not negative.
    lod.round() as u32
}

/// The level nearest to a [level of detail](level_of_detail): of hierarchical PCF.
pub fn nearest_level(lod: u32) -> u8 {
    let level = lod.saturating_add(1 << (LOD_BITS - 1)) >> LOD_BITS;
    u8::try_from(level).unwrap_or(u8::MAX)
}

/// The level below a [level of detail](level_of_detail), and how far the level above weighs, in 1/256.
pub fn levels_around(lod: u32) -> (u8, u32) {
    (u8::try_from(lod >> LOD_BITS).unwrap_or(u8::MAX), lod & ((1 << LOD_BITS) - 1))
}

/// Texels of one level: columns and rows from the first to the last, both included.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rect {
    /// Columns.
    pub x: [u32; 2],
    /// Rows.
    pub y: [u32; 2],
}

impl Rect {
    /// Levels from these texels up to their lowest common node, by the bits in which they differ (figure 5).
    #[inline]
    fn common(&self) -> u32 {
        let ([x, u], [y, v]) = (self.x, self.y);
        32 - ((x ^ u) | (y ^ v)).leading_zeros()
    }

    /// Whether all lie in one cell of `1 << shift` texels on a side.
    #[inline]
    pub(super) fn is_in_cell(&self, shift: u32) -> bool {
        let ([x, u], [y, v]) = (self.x, self.y);
        ((x ^ u) | (y ^ v)) >> (shift & 31) == 0
    }

    /// Texels.
    #[inline]
    pub fn count(&self) -> u32 {
        let ([x, u], [y, v]) = (self.x, self.y);
        (u - x + 1) * (v - y + 1)
    }

    /// Calls `part` with each of the cells of `1 << shift` texels on a side, aligned to their side: its column and row,
    /// and what of these texels lies there.
    #[inline]
    pub(super) fn cells(&self, shift: u32, mut part: impl FnMut(u32, u32, Rect)) {
        let ([x, u], [y, v]) = (self.x, self.y);
        let last = (1u32 << (shift & 31)) - 1;
        let shift = shift & 31;
        for row in y >> shift..=v >> shift {
            let rows = [y.max(row << shift), v.min(row << shift | last)];
            for column in x >> shift..=u >> shift {
                let columns = [x.max(column << shift), u.min(column << shift | last)];
                part(column, row, Rect { x: columns, y: rows });
            }
        }
    }
}

/// The taps of a kernel.
#[derive(Clone, Copy, Debug)]
pub struct Taps {
    /// Their level.
    pub level: u8,
    /// Those that lie in the map, as texels of the level.
    pub inside: Rect,
    /// All of them.
    pub count: u32,
    /// Depth of the tap in `inside`'s first corner, and its rise to the next column and row, in 1/16 step.
    depth: i64,
    rise: [i64; 2],
}

impl Taps {
    /// Taps of side `side` (clamped to 1 to [`MAX_SIDE`]) on `level` (clamped to the map's) in a map of
    /// `1 << log2_resolution` texels; `None` where the receiver lies outside.
    pub fn new(r: &Receiver, side: u32, level: u8, log2_resolution: u8) -> Option<Self> {
        // Beyond what a file may have nothing is promised but an answer.
        let log2 = log2_resolution.min(MAX_LOG2_RESOLUTION);
        if (r.x | r.y) >> log2 != 0 {
            return None;
        }
        let (side, level) = (side.clamp(1, MAX_SIDE), level.min(log2));
        let last = (1u32 << (log2 - level)) - 1;
        let [own_x, own_y] = [r.x >> level, r.y >> level];
        let range = |v: u32| [v.saturating_sub(side / 2), v.saturating_add(side - 1 - side / 2).min(last)];
        let inside = Rect { x: range(own_x), y: range(own_y) };
        let rise = r.gradient.map(|g| i64::from(g) << level);
        // To the texel's first or last column or row, where the plane is nearest to the light.
        let way = |first: u32, own: u32, gradient: i32| {
            let corner = if gradient < 0 { (1i64 << level) - 1 } else { 0 };
            i64::from(gradient) * ((i64::from(first) << level) + corner - i64::from(own))
        };
        let ([x, _], [y, _], [gx, gy]) = (inside.x, inside.y, r.gradient);
        let depth = (i64::from(r.depth) << GRADIENT_BITS) + way(x, r.x, gx) + way(y, r.y, gy);
        Some(Self { level, inside, count: side * side, depth, rise })
    }

    /// The answer, `lit` of the taps in the map being so.
    pub fn share(&self, lit: u32) -> Share {
        Share { lit: lit + (self.count - self.inside.count()), taps: self.count, inside: true }
    }

    /// The answer outside the map.
    pub fn outside(side: u32) -> Share {
        let side = side.clamp(1, MAX_SIDE);
        Share { lit: side * side, taps: side * side, inside: false }
    }

    /// Depth of the tap at a texel, in 1/16 step.
    #[inline]
    fn at(&self, x: u32, y: u32) -> i64 {
        let ([x0, _], [y0, _]) = (self.inside.x, self.inside.y);
        let [along_x, along_y] = self.rise;
        self.depth + along_x * i64::from(x - x0) + along_y * i64::from(y - y0)
    }

    /// Least and most depth of the taps of a part, in 1/16 step: planes are extreme at corners.
    #[inline]
    fn depths(&self, part: &Rect) -> [i64; 2] {
        let ([x, u], [y, v]) = (part.x, part.y);
        let at = self.at(x, y);
        let [along_x, along_y] = self.rise;
        let (across, down) = (along_x * i64::from(u - x), along_y * i64::from(v - y));
        [at + across.min(0) + down.min(0), at + across.max(0) + down.max(0)]
    }

    /// Lit taps of a part that one value answers.
    #[inline]
    pub fn lit(&self, part: &Rect, value: u32) -> u32 {
        let (limit, [least, most]) = (limit(value), self.depths(part));
        if most <= limit {
            return part.count();
        }
        if least > limit {
            return 0;
        }
        self.lit_each(part, |_, _| value)
    }

    /// Lit taps of a part where a plane's values at its corners, rows one behind the other, decide for all: a plane
    /// that is rounded down to whole steps and nowhere clamped is off by less than a step between them.
    #[inline]
    pub(super) fn lit_by_corners(&self, part: &Rect, values: [u32; 4]) -> Option<u32> {
        let ([x, u], [y, v]) = (part.x, part.y);
        let [along_x, along_y] = self.rise;
        let (at, across, down) = (self.at(x, y), along_x * i64::from(u - x), along_y * i64::from(v - y));
        let [a, b, c, d] = values.map(|v| i64::from(v) << GRADIENT_BITS);
        let above = [a - at, b - (at + across), c - (at + down), d - (at + across + down)];
        let step = 1 << GRADIENT_BITS;
        if above.iter().all(|v| *v >= step) {
            return Some(part.count());
        }
        if above.iter().all(|v| *v <= -step) { Some(0) } else { None }
    }

    /// Lit taps of a part, each held against its own value.
    #[inline]
    pub fn lit_each(&self, part: &Rect, value: impl Fn(u32, u32) -> u32) -> u32 {
        let ([x, u], [y, v]) = (part.x, part.y);
        (y..=v).map(|row| self.lit_row(x, row, (x..=u).map(|column| value(column, row)))).sum()
    }

    /// Lit taps of a row from (x, y) on, each held against its own value.
    #[inline]
    pub(super) fn lit_row(&self, x: u32, y: u32, values: impl Iterator<Item = u32>) -> u32 {
        let ([along_x, _], mut depth) = (self.rise, self.at(x, y));
        let tap = |value| {
            let lit = depth <= limit(value);
            depth += along_x;
            u32::from(lit)
        };
        values.map(tap).sum()
    }

    /// Whether a tap is lit.
    #[inline]
    pub(super) fn is_lit(&self, x: u32, y: u32, value: u32) -> bool {
        self.at(x, y) <= limit(value)
    }

    /// Taps of a part whose page is missing, by what its index record says, each held against the value that stands above
    /// the page: the lit ones, and whether all of them are [settled](Bounds::settle) for `error`.
    pub fn settle(&self, part: &Rect, bounds: &Bounds, error: u32, value: impl Fn(u32, u32) -> u32) -> (u32, bool) {
        let (near, far) = (limit(bounds.min_depth), limit(bounds.max_depth));
        let [least, most] = self.depths(part);
        if most <= near {
            return (part.count(), true);
        }
        if least > far {
            return (0, true);
        }
        let suffices = bounds.suffices(error);
        let (mut lit, mut all) = (0, true);
        for y in part.y[0]..=part.y[1] {
            for x in part.x[0]..=part.x[1] {
                let depth = self.at(x, y);
                lit += u32::from(depth <= near || depth <= far && depth <= limit(value(x, y)));
                all &= suffices || depth <= near || depth > far;
            }
        }
        (lit, all)
    }
}

/// Most depth of a tap that `value` lights, in 1/16 step.
#[inline]
fn limit(value: u32) -> i64 {
    if value == u32::MAX { i64::MAX } else { i64::from(value) << GRADIENT_BITS }
}

/// Descends with all texels of `part` together. `walk` goes on with a walk towards a texel of level 0 until it has visited a
/// level, which may be behind it already, and says whether it has ended; `answer` is called once for each part that one
/// node answers. Parts nest at most as deep as levels do.
#[inline]
pub fn descend<W: Copy>(
    from: W,
    part: Rect,
    level: u8,
    walk: &mut impl FnMut(W, u32, u32, u8) -> (W, bool),
    answer: &mut impl FnMut(&W, &Rect),
) {
    let ([x, _], [y, _]) = (part.x, part.y);
    let common = part.common();
    // At most 32 levels in all.
    let stop = level.saturating_add(u8::try_from(common).unwrap_or(32));
    let (found, ended) = walk(from, x << (level & 31), y << (level & 31), stop);
    if ended || common == 0 {
        answer(&found, &part);
        return;
    }
    part.cells(common - 1, |_, _, part| again(found, part, level, walk, answer));
}

/// [`descend`], where it calls itself.
fn again<W: Copy>(
    from: W,
    part: Rect,
    level: u8,
    walk: &mut impl FnMut(W, u32, u32, u8) -> (W, bool),
    answer: &mut impl FnMut(&W, &Rect),
) {
    descend(from, part, level, walk, answer);
}
