//! Numbers that depend on nothing but a seed (splitmix64).

/// A stream of numbers.
pub struct Random(u64);

impl Random {
    /// The stream of a seed; `lane` tells apart streams that share one, such as those of parallel parts.
    pub fn new(seed: u64, lane: u64) -> Self {
        let mut mixed = Random(seed ^ 0x5DEE_CE66_D1CE_4E5B);
        Random(mixed.bits() ^ lane.wrapping_mul(0xD6E8_FEB8_6659_FD93))
    }

    /// 64 bits.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// A real number from 0 (included) to 1 (excluded).
    pub fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }
}
