//! Numbers in and out of a cold page: symbols by rANS (Duda 2013), plain bits beside them.
//!
//! ```text
//! 2 bytes            2 * n bytes                      the rest
//! | n, bit 15 plain | state 0 | state 1 | halves ... | bits, from the low ones of the first byte on |
//! ```
//!
//! A state has 32 bits, from 2^16 up. A symbol takes [`PROBABILITY_BITS`] bits of it to look its table up; when the state
//! falls below 2^16, 16 bits follow from the halves. The two states take turns, so that one symbol need not wait for the
//! multiplication of the one before. At the end both are 2^16, all halves are used, and of the bits less than a word
//! is left, all zero.

use super::Model;
use super::model::{PROBABILITY_BITS, Table};

/// States are at least this.
pub const LEAST_STATE: u32 = 1 << 16;

/// Of a table that is not there.
static NO_TABLE: Table = Table::NONE;

/// Takes the numbers of a page in their order.
pub trait Coder {
    /// A symbol of a table; `real` is what it is where numbers are noted.
    fn symbol(&mut self, table: usize, real: impl FnOnce() -> u32) -> u32;
    /// A number of `count` bits, 0 to 32.
    fn bits(&mut self, count: u32, real: impl FnOnce() -> u32) -> u32;

    /// Where numbers are noted, the place of a plane's slopes among the model's.
    fn slopes(&self, _: [u32; 2]) -> Option<u32> {
        None
    }

    /// Where numbers are noted, the place of a mask's selectors among the model's.
    fn selectors(&self, _: u32) -> Option<u32> {
        None
    }

    /// A number by its length: a symbol says how many bits it has, those below the highest follow. Below 2^63.
    #[inline]
    fn number(&mut self, table: usize, real: impl FnOnce() -> u64) -> u64 {
        let mut known = 0;
        let length = self.symbol(table, || {
            known = real();
            u64::BITS - known.leading_zeros()
        });
        self.rest(length, known)
    }

    /// The bits of a number of `length` bits below its highest one.
    #[inline]
    fn rest(&mut self, length: u32, known: u64) -> u64 {
        let below = length.saturating_sub(1).min(62);
        let low = u64::from(self.bits(below.min(32), || super::low(known)));
        let high = if below > 32 { u64::from(self.bits(below - 32, || super::low(known >> 32))) } else { 0 };
        topped(length, low | high << 32)
    }
}

/// A number of `length` bits: its highest one, and those of `bits` below it. Of length 0 no bit is set.
#[inline]
fn topped(length: u32, bits: u64) -> u64 {
    let top = (1u64 << length.min(63)) >> 1;
    top | bits & top.saturating_sub(1)
}

/// Reads the numbers of a cold page.
#[derive(Debug)]
pub struct Decoder<'a> {
    tables: &'a [Table],
    states: [u32; 2],
    halves: &'a [[u8; 2]],
    /// Halves taken; beyond their end zeros are.
    taken: usize,
    bits: &'a [u8],
    /// Bits taken; beyond their end zeros are.
    at: usize,
}

impl<'a> Decoder<'a> {
    /// Behind the first 2 bytes; `halves` is how many there are. `None` where they are more than the bytes, or fewer than
    /// the states take.
    pub fn new(model: &'a Model, bytes: &'a [u8], halves: u16) -> Option<Self> {
        let (halves, bits) = bytes.split_at_checked(2 * usize::from(halves))?;
        let (halves, _) = halves.as_chunks::<2>();
        let (&[a, b, c, d], halves) = halves.split_first_chunk::<4>()?;
        let state = |low: [u8; 2], high: [u8; 2]| u32::from_le_bytes([low[0], low[1], high[0], high[1]]);
        Some(Self { tables: model.tables(), states: [state(a, b), state(c, d)], halves, taken: 0, bits, at: 0 })
    }

    /// Whether all has been read, and nothing but what was written.
    pub fn is_at_end(&self) -> bool {
        let left = (self.bits.len() * 8).checked_sub(self.at);
        self.states == [LEAST_STATE; 2]
            && self.taken == self.halves.len()
            && left.is_some_and(|left| left < 32 && self.peek() & ((1u64 << left) - 1) == 0)
    }

    /// The bits from here on, at least 57; zeros behind the end.
    #[inline]
    fn peek(&self) -> u64 {
        peek(self.bits, self.at)
    }
}

#[inline]
fn peek(bits: &[u8], at: usize) -> u64 {
    let byte = at / 8;
    let word = match bits.get(byte..byte + 8).and_then(|b| b.first_chunk::<8>()) {
        Some(bytes) => u64::from_le_bytes(*bytes),
        None => last(bits, byte),
    };
    word >> (at % 8)
}

/// The last bytes, where fewer than 8 are left. Not of the decoder, which then needs no place in memory.
#[cold]
fn last(bits: &[u8], byte: usize) -> u64 {
    let bytes = bits.get(byte..).unwrap_or_default();
    bytes.iter().take(8).rev().fold(0, |all, b| all << 8 | u64::from(*b))
}

impl Coder for Decoder<'_> {
    #[inline]
    fn symbol(&mut self, table: usize, _: impl FnOnce() -> u32) -> u32 {
        let [state, other] = self.states;
        let [symbol, frequency, before] = self.tables.get(table).unwrap_or(&NO_TABLE).find(state);
        let next = frequency * (state >> PROBABILITY_BITS) + before;
        let half = self.halves.get(self.taken).map_or(0, |h| u32::from(u16::from_le_bytes(*h)));
        let short = next < LEAST_STATE;
        self.taken += usize::from(short);
        self.states = [other, if short { next << 16 | half } else { next }];
        symbol
    }

    #[inline]
    fn bits(&mut self, count: u32, _: impl FnOnce() -> u32) -> u32 {
        let bits = self.peek() & ((1u64 << count.min(32)) - 1);
        self.at += count.min(32) as usize;
        super::low(bits)
    }

    /// At once, where it has no more bits than are at hand.
    #[inline]
    fn rest(&mut self, length: u32, _: u64) -> u64 {
        if length > 57 {
            return long(self, length);
        }
        let top = (1u64 << length) >> 1;
        let low = self.peek() & top.saturating_sub(1);
        self.at += length.saturating_sub(1) as usize;
        top | low
    }
}

/// [`Coder::rest`] of a great length.
#[cold]
fn long(c: &mut Decoder<'_>, length: u32) -> u64 {
    let below = length.saturating_sub(1).min(62);
    let low = u64::from(c.bits(below.min(32), || 0));
    let high = if below > 32 { u64::from(c.bits(below - 32, || 0)) } else { 0 };
    topped(length, low | high << 32)
}
