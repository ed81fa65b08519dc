//! The tables by which the cold pages of a structure are coded.
//!
//! ```text
//! byte 0        near: what counts as a value on a known surface, 0 to 40 (kinds mh and mmh; else 0)
//! then          for each table of the kind its frequencies, which sum to 2^10 or are all zero:
//!                   1 to 127       a frequency
//!                   128 + h, l     the frequency 256 h + l, at least 128
//!                   0, n           n frequencies of zero, at least 1
//! then (vector) u16 n, then n slopes of 8 bytes: the bits of gx and shift, the bits of gy
//!               u16 n, then n selectors of 4 bytes: word 1 of a mask
//! ```
//!
//! In: the bytes of a section. Out: a [`Model`] that decodes whatever comes.

use alloc::vec;
use alloc::vec::Vec;

use super::{plain, tree, vector};
use crate::kind::Kind;

/// Frequencies of a table sum to 2 to this power.
pub const PROBABILITY_BITS: u32 = 10;
/// Slots of a table.
pub const SLOTS: usize = 1 << PROBABILITY_BITS;
/// Most slopes, and most selectors.
pub const MAX_SLOPES: usize = 8192;
/// Largest `near`.
pub const MAX_NEAR: u8 = 40;

/// Symbols of each table of a kind; none for kinds without a walk.
pub fn alphabets(kind: Kind) -> Vec<u16> {
    let own: &[(usize, u16)] = match kind {
        Kind::Mh => tree::MH_TABLES,
        Kind::Mmh => tree::MMH_TABLES,
        Kind::Vector => vector::TABLES,
        _ => &[],
    };
    plain::TABLES.iter().chain(own).flat_map(|&(count, symbols)| core::iter::repeat_n(symbols, count)).collect()
}

/// A table. A symbol is found by one byte of its slot, so that what is in use of all tables stays small.
#[derive(Clone, Copy, Debug)]
pub struct Table {
    /// The symbol of each slot.
    symbols: [u8; SLOTS],
    /// Of each symbol, bits 0..16 its frequency, 16..32 its first slot.
    shares: [u32; 256],
}

impl Table {
    pub(super) const NONE: Table = Table { symbols: [0; SLOTS], shares: [0; 256] };

    /// The symbol of a slot, the symbol's frequency, and how many of its slots come before.
    #[inline(always)]
    pub(super) fn find(&self, slot: u32) -> [u32; 3] {
        let slot = slot & ((1 << PROBABILITY_BITS) - 1);
        let symbol = self.symbols.get(slot as usize).copied().unwrap_or(0);
        let share = self.shares.get(usize::from(symbol)).copied().unwrap_or(0);
        [symbol.into(), share & 0xFFFF, slot - (share >> 16)]
    }
}

/// What the cold pages of a structure are decoded with.
#[derive(Clone, Debug)]
pub struct Model {
    kind: Kind,
    near: u8,
    tables: Vec<Table>,
    /// Bits of gx and shift, and of gy, of slopes that planes of several pages have.
    slopes: Vec<[u32; 2]>,
    /// Selectors that several masks have.
    selectors: Vec<u32>,
}

impl Model {
    /// Reads the bytes of a section; `None` where they are not those of a model of this kind.
    pub fn read(kind: Kind, bytes: &[u8]) -> Option<Self> {
        let (&near, mut rest) = bytes.split_first()?;
        if near > if matches!(kind, Kind::Mh | Kind::Mmh) { MAX_NEAR } else { 0 } {
            return None;
        }
        let alphabets = alphabets(kind);
        let mut tables = vec![Table::NONE; alphabets.len()];
        for (symbols, into) in alphabets.into_iter().zip(&mut tables) {
            rest = table(rest, symbols, into)?;
        }
        let (mut slopes, mut selectors) = (Vec::new(), Vec::new());
        if kind == Kind::Vector {
            slopes = list(&mut rest, |[a, b, c, d, e, f, g, h]: [u8; 8]| {
                [u32::from_le_bytes([a, b, c, d]), u32::from_le_bytes([e, f, g, h])]
            })?;
            selectors = list(&mut rest, u32::from_le_bytes)?;
        }
        rest.is_empty().then_some(Self { kind, near, tables, slopes, selectors })
    }

    /// Bytes that a model of a kind takes at most, as a section and in memory together.
    pub fn most_bytes(kind: Kind) -> u64 {
        let section: usize = alphabets(kind).iter().map(|n| 2 * usize::from(*n) + 2).sum();
        (alphabets(kind).len() * size_of::<Table>() + section + 24 * MAX_SLOPES + 16) as u64
    }

    /// The kind whose pages it is for.
    pub fn kind(&self) -> Kind {
        self.kind
    }

    /// How many bits a value may differ by from a surface and yet lie on it, sign included.
    #[inline]
    pub(super) fn near(&self) -> u32 {
        self.near.into()
    }

    /// Slopes of planes, at most [`MAX_SLOPES`].
    pub fn slopes(&self) -> &[[u32; 2]] {
        &self.slopes
    }

    /// Selectors of masks, at most [`MAX_SLOPES`].
    pub fn selectors(&self) -> &[u32] {
        &self.selectors
    }

    pub(super) fn tables(&self) -> &[Table] {
        &self.tables
    }
}

/// Reads a number and as many items.
fn list<const N: usize, T>(bytes: &mut &[u8], item: impl Fn([u8; N]) -> T) -> Option<Vec<T>> {
    let (count, rest) = bytes.split_first_chunk::<2>()?;
    let count = usize::from(u16::from_le_bytes(*count));
    let (items, rest) = rest.split_at_checked(count.checked_mul(N)?)?;
    *bytes = rest;
    let (items, _) = items.as_chunks::<N>();
    (count <= MAX_SLOPES).then(|| items.iter().map(|i| item(*i)).collect())
}

/// Reads one table; returns what is behind it.
fn table<'a>(mut bytes: &'a [u8], symbols: u16, into: &mut Table) -> Option<&'a [u8]> {
    let (mut symbol, mut sum) = (0u16, 0u16);
    while symbol < symbols {
        let (&first, rest) = bytes.split_first()?;
        let mut frequency = u16::from(first);
        bytes = rest;
        if first == 0 || first >= 128 {
            let (&second, rest) = bytes.split_first()?;
            bytes = rest;
            if first == 0 {
                symbol += u16::from(second);
                if second == 0 || symbol > symbols {
                    return None;
                }
                continue;
            }
            frequency = u16::from(first & 127) << 8 | u16::from(second);
            if frequency < 128 {
                return None;
            }
        }
        let start = sum;
        sum = sum.checked_add(frequency)?;
        // No alphabet has more than 256.
        into.symbols.get_mut(start.into()..sum.into())?.fill(u8::try_from(symbol).ok()?);
        *into.shares.get_mut(usize::from(symbol))? = u32::from(start) << 16 | u32::from(frequency);
        symbol += 1;
    }
    match usize::from(sum) {
        SLOTS => Some(bytes),
        // A table that nothing was coded by: its symbol 0 takes no bits.
        0 => {
            *into.shares.first_mut()? = 1 << PROBABILITY_BITS;
            Some(bytes)
        }
        _ => None,
    }
}

/// The bytes of a section: `near`, frequencies of each table in the order of [`alphabets`], slopes and
/// selectors for kind `vector`.
pub fn encode(kind: Kind, near: u8, tables: &[Vec<u16>], slopes: &[[u32; 2]], selectors: &[u32]) -> Vec<u8> {
    let mut out = vec![near];
    for table in tables {
        let mut rest = table.as_slice();
        while let Some((&first, behind)) = rest.split_first() {
            if first != 0 {
                let [low, high] = first.to_le_bytes();
                if first >= 128 {
                    out.push(high | 128);
                }
                out.push(low);
                rest = behind;
                continue;
            }
            let zeros = rest.iter().take(255).take_while(|f| **f == 0).count();
            // At most 255 were taken.
            out.extend([0, u8::try_from(zeros).unwrap_or(u8::MAX)]);
            rest = rest.get(zeros..).unwrap_or_default();
        }
    }
    if kind == Kind::Vector {
        out.extend(u16::try_from(slopes.len()).unwrap_or(u16::MAX).to_le_bytes());
        out.extend(slopes.iter().flatten().flat_map(|w| w.to_le_bytes()));
        out.extend(u16::try_from(selectors.len()).unwrap_or(u16::MAX).to_le_bytes());
        out.extend(selectors.iter().flat_map(|w| w.to_le_bytes()));
    }
    out
}
