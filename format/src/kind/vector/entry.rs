//! The entries of the palette and the lines that splits refer to: bits in, numbers out, and back.
//!
//! Each type has `encode` and `decode` side by side. `encode` drops bits that do not fit their field; where numbers come
//! from a computation, `fits` says beforehand whether all would be kept.

/// Bits of a plane's slopes, sign included.
const SLOPE_BITS: u32 = 25;
/// Bits of a plane's offset, sign included.
const OFFSET_BITS: u32 = 39;
/// Bits of a fine plane's slopes, sign included.
pub const FINE_SLOPE_BITS: u32 = 27;
/// Bits of a fine plane's offset, sign included.
const FINE_OFFSET_BITS: u32 = 36;
/// Smallest power of a fine plane.
pub const FINE_SHIFT: u8 = 8;
/// Powers of fine planes.
const FINE_SHIFTS: u8 = 32;
/// Bits of a line's constant, sign included.
const C_BITS: u32 = 48;

/// Largest depth that a plane answers; the one above means uncovered.
pub const PLANE_MAX: i64 = 0xFFFF_FFFE;

/// Whether a number with sign fits so many bits, 1 to 63.
const fn fits(v: i64, bits: u32) -> bool {
    let half = 1i64 << (bits - 1);
    -half <= v && v < half
}

/// Low 32 bits.
#[allow(clippy::cast_possible_truncation)]
#[inline]
const fn low(v: i64) -> u32 {
    // The cut is what is asked for.
    v as u32
}

/// A depth that grows linearly with the place: `offset + floor((gx X + gy Y) / 2^shift)`, clamped to 0..=0xFFFFFFFE.
///
/// A *fine* plane has slopes of 27 bits with sign, an offset of 36 and a power of 8 to 39; it is written where 25 bits do not
/// hold the slopes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Plane {
    /// Depth at the corner of the page's footprint; 39 bits with sign.
    pub offset: i64,
    /// Slope in x, depths by place times `2^shift`; 25 bits with sign, or 27.
    pub gx: i32,
    /// Slope in y, as `gx`.
    pub gy: i32,
    /// 0 to 63.
    pub shift: u8,
}

impl Plane {
    /// Whether every number fits its field.
    pub const fn fits(&self) -> bool {
        if !self.is_fine() {
            return fits(self.offset, OFFSET_BITS) && self.shift < 64;
        }
        let slopes = fits(self.gx as i64, FINE_SLOPE_BITS) && fits(self.gy as i64, FINE_SLOPE_BITS);
        let shift = FINE_SHIFT <= self.shift && self.shift < FINE_SHIFT + FINE_SHIFTS;
        slopes && shift && fits(self.offset, FINE_OFFSET_BITS)
    }

    /// Whether its slopes need the bits of a fine plane.
    pub const fn is_fine(&self) -> bool {
        !fits(self.gx as i64, SLOPE_BITS) || !fits(self.gy as i64, SLOPE_BITS)
    }

    /// Bits of the third word below those of the offset, as the second says.
    pub const fn slope_bits(word: u32) -> u32 {
        if word >> 31 == 0 { SLOPE_BITS } else { FINE_SLOPE_BITS + 1 }
    }

    /// The bits of slopes and shift: the second word, and the third without those of the offset.
    pub const fn slopes(w1: u32, w2: u32) -> [u32; 2] {
        [w1, w2 & ((1 << Self::slope_bits(w1)) - 1)]
    }

    /// The 3 words.
    pub const fn encode(&self) -> [u32; 3] {
        if self.is_fine() {
            let low_bits = FINE_SLOPE_BITS - 1;
            let x = self.gx.cast_unsigned();
            let shift = self.shift.wrapping_sub(FINE_SHIFT) as u32 & 31;
            let y = self.gy.cast_unsigned() & ((1 << FINE_SLOPE_BITS) - 1);
            return [
                low(self.offset),
                x & ((1 << low_bits) - 1) | shift << low_bits | 1 << 31,
                y | (x >> low_bits & 1) << FINE_SLOPE_BITS | low(self.offset >> 32) << (FINE_SLOPE_BITS + 1),
            ];
        }
        let mask = (1 << SLOPE_BITS) - 1;
        [
            low(self.offset),
            self.gx.cast_unsigned() & mask | (self.shift as u32 & 63) << SLOPE_BITS,
            self.gy.cast_unsigned() & mask | low(self.offset >> 32) << SLOPE_BITS,
        ]
    }

    /// Reads the 3 words. Of a plane that is fine without need, [`check`](super::check) refuses them.
    #[inline]
    pub const fn decode(words: [u32; 3]) -> Self {
        let [w0, w1, w2] = words;
        if w1 >> 31 == 1 {
            let unused = 32 - FINE_SLOPE_BITS;
            let x = w1 << (unused + 1) >> 1 | w2 << (unused - 1) & 1 << 31;
            let [shift, ..] = (w1 >> (FINE_SLOPE_BITS - 1) & 31).to_le_bytes();
            return Self {
                offset: ((w2.cast_signed() >> (FINE_SLOPE_BITS + 1)) as i64) << 32 | w0 as i64,
                gx: x.cast_signed() >> unused,
                gy: (w2 << unused).cast_signed() >> unused,
                shift: shift + FINE_SHIFT,
            };
        }
        let [_, _, _, top] = (w1 >> 1).to_le_bytes();
        Self {
            offset: ((w2.cast_signed() >> SLOPE_BITS) as i64) << 32 | w0 as i64,
            gx: (w1 << (32 - SLOPE_BITS)).cast_signed() >> (32 - SLOPE_BITS),
            gy: (w2 << (32 - SLOPE_BITS)).cast_signed() >> (32 - SLOPE_BITS),
            shift: top & 63,
        }
    }

    /// Depth at a place; each of `x` and `y` from 0 to 2^32. Anywhere else the result is any number.
    #[inline]
    pub const fn at(&self, x: i64, y: i64) -> u32 {
        // At most 2 * 2^26 * 2^32, so nothing wraps on places of the map.
        let rise = (self.gx as i64).wrapping_mul(x).wrapping_add((self.gy as i64).wrapping_mul(y));
        let v = self.offset.wrapping_add(rise >> (self.shift & 63));
        // `clamp` of `Ord` is not const.
        let v = if v < 0 { 0 } else { v };
        low(if v > PLANE_MAX { PLANE_MAX } else { v })
    }

    /// Smallest and largest depth over a closed square of places: those at the corners that the slopes point from and to.
    #[inline]
    pub const fn bounds(&self, square: &Square) -> (u32, u32) {
        let Square { x0, y0, x1, y1 } = *square;
        let (left, right) = if self.gx < 0 { (x1, x0) } else { (x0, x1) };
        let (near, far) = if self.gy < 0 { (y1, y0) } else { (y0, y1) };
        (self.at(left, near), self.at(right, far))
    }
}

/// A line in the map: a place is beyond it where `T * 2^12 >= c + floor(m U / 2^19)`.
///
/// It takes 3 words, or 2 in a page whose lines are all *short*.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Line {
    /// Slope of T over U in 2^-31, from -1 to 1.
    pub m: i32,
    /// T where U is 0, in 2^-20 of a texel; 48 bits with sign.
    pub c: i64,
    /// (U, T) is (X, Y) where false, (Y, X) where true.
    pub axis: bool,
}

impl Line {
    /// Whether every number fits its field.
    pub const fn fits(&self) -> bool {
        fits(self.c, C_BITS)
    }

    /// The 3 words.
    pub const fn encode(&self) -> [u32; 3] {
        [self.m.cast_unsigned(), low(self.c), low(self.c >> 32) & 0xFFFF | (self.axis as u32) << 16]
    }

    /// Reads the 3 words; bits 17..32 of the third do not count.
    #[inline]
    pub const fn decode(words: [u32; 3]) -> Self {
        let [w0, w1, w2] = words;
        let high = (w2 << 16).cast_signed() >> 16;
        Self { m: w0.cast_signed(), c: (high as i64) << 32 | w1 as i64, axis: w2 >> 16 & 1 == 1 }
    }

    /// Whether it keeps all its bits in 2 words: its slope is even, and `c` has at most 32 bits with sign.
    pub const fn is_short(&self) -> bool {
        self.m & 1 == 0 && fits(self.c, u32::BITS)
    }

    /// The 2 words of a short line.
    pub const fn encode_short(&self) -> [u32; 2] {
        [self.m.cast_unsigned() >> 1 | (self.axis as u32) << 31, low(self.c)]
    }

    /// Reads the 2 words of a short line.
    #[inline]
    pub const fn decode_short(words: [u32; 2]) -> Self {
        let [w0, w1] = words;
        Self { m: (w0 << 1).cast_signed(), c: w1.cast_signed() as i64, axis: w0 >> 31 == 1 }
    }

    /// Whether a place lies beyond the line; each of `x` and `y` from 0 to 2^32.
    #[inline]
    pub const fn beyond(&self, x: i64, y: i64) -> bool {
        let (u, t) = if self.axis { (y, x) } else { (x, y) };
        // At most 2^31 * 2^32 below zero and less above.
        t << 12 >= self.c + ((self.m as i64).wrapping_mul(u) >> 19)
    }
}

/// Two entries on the sides of a line.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Split {
    /// Number of the line, below 1024.
    pub line: u16,
    /// Number of the entry on this side of the line, below 2048.
    pub a: u16,
    /// Number of the entry beyond it, below 2048.
    pub b: u16,
}

impl Split {
    /// Whether every number fits its field.
    pub const fn fits(&self) -> bool {
        self.line < 1 << 10 && self.a < 1 << 11 && self.b < 1 << 11
    }

    /// The word.
    pub const fn encode(&self) -> u32 {
        self.line as u32 & 0x3FF | (self.a as u32 & 0x7FF) << 10 | (self.b as u32) << 21
    }

    /// Reads the word.
    #[inline]
    pub const fn decode(word: u32) -> Self {
        Self { line: field(word, 0, 10), a: field(word, 10, 11), b: field(word, 21, 11) }
    }
}

/// Up to three constants or planes, chosen by a pattern of 4 x 4 texels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Mask4 {
    /// Numbers of the entries, each below 1024.
    pub entries: [u16; 3],
    /// 16 selectors of 2 bits, row by row: 0, 1 or 2.
    pub selectors: u32,
}

impl Mask4 {
    /// Whether every number fits its field.
    pub const fn fits(&self) -> bool {
        let [a, b, c] = self.entries;
        a | b | c < 1 << 10
    }

    /// The 2 words.
    pub const fn encode(&self) -> [u32; 2] {
        let [a, b, c] = self.entries;
        [a as u32 & 0x3FF | (b as u32 & 0x3FF) << 10 | (c as u32 & 0x3FF) << 20, self.selectors]
    }

    /// Reads the 2 words; bits 30..32 of the first do not count.
    #[inline]
    pub const fn decode(words: [u32; 2]) -> Self {
        let [w0, selectors] = words;
        Self { entries: [field(w0, 0, 10), field(w0, 10, 10), field(w0, 20, 10)], selectors }
    }

    /// The entry of texel number `n` of 16; entry c where the selector is 3.
    #[inline]
    pub const fn entry(&self, n: u32) -> u16 {
        let [a, b, c] = self.entries;
        match self.selectors >> (2 * (n & 15)) & 3 {
            0 => a,
            1 => b,
            _ => c,
        }
    }

    /// Whether some selector is 3.
    pub const fn has_unknown(&self) -> bool {
        self.selectors & self.selectors >> 1 & 0x5555_5555 != 0
    }

    /// Which of the three entries a selector names.
    pub const fn named(&self) -> [bool; 3] {
        let (low, high) = (self.selectors & 0x5555_5555, self.selectors >> 1 & 0x5555_5555);
        [(low | high) != 0x5555_5555, low != 0, high != 0]
    }
}

/// 4 x 4 depths: `base + number * 2^shift`, the numbers packed in the heap.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Raw {
    /// What is added to every number.
    pub base: u32,
    /// First word of the numbers, counted in the page.
    pub at: u16,
    /// Bits of a number, 0 to 32.
    pub width: u8,
    /// 0 to 31.
    pub shift: u8,
}

impl Raw {
    /// The 2 words.
    pub const fn encode(&self) -> [u32; 2] {
        [self.base, self.at as u32 | (self.width as u32 & 63) << 16 | (self.shift as u32 & 31) << 22]
    }

    /// Reads the 2 words; bits 27..32 of the second do not count.
    #[inline]
    pub const fn decode(words: [u32; 2]) -> Self {
        let [base, w1] = words;
        let [at0, at1, _, _] = w1.to_le_bytes();
        let ([width, _, _, _], [shift, _, _, _]) = ((w1 >> 16 & 63).to_le_bytes(), (w1 >> 22 & 31).to_le_bytes());
        Self { base, at: u16::from_le_bytes([at0, at1]), width, shift }
    }

    /// Words of the heap that the 16 numbers take, 0 to 16 for a width of at most 32.
    pub const fn heap_words(&self) -> u32 {
        (self.width as u32).div_ceil(2)
    }

    /// Value of number `n` of 16, not yet held to 32 bits; words outside `page` read as 0.
    #[inline]
    pub fn value(&self, page: &[u32], n: u32) -> u64 {
        let width = u32::from(self.width).min(32);
        let number = super::packed(page, self.at.into(), width, n & 15);
        u64::from(self.base) + (u64::from(number) << (self.shift & 31))
    }
}

/// Places of a square, both ends included; 1/256 of a texel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Square {
    /// Smallest x.
    pub x0: i64,
    /// Smallest y.
    pub y0: i64,
    /// Largest x.
    pub x1: i64,
    /// Largest y.
    pub y1: i64,
}

impl Square {
    /// The square of `2^level` texels on a side whose first texel is (x, y), counted from the corner that places count
    /// from.
    #[inline]
    pub const fn of_texels(x: u32, y: u32, level: u8) -> Self {
        let (x0, y0, side) = ((x as i64) << 8, (y as i64) << 8, 256i64 << (level & 31));
        Self { x0, y0, x1: x0 + side, y1: y0 + side }
    }
}

/// Bits `from..from + bits` of a word, at most 16.
#[inline]
const fn field(word: u32, from: u32, bits: u32) -> u16 {
    let [a, b, _, _] = (word >> from & ((1 << bits) - 1)).to_le_bytes();
    u16::from_le_bytes([a, b])
}
