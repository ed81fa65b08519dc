//! Cold pages: pages in an entropy-coded form, decoded word for word when they are loaded. `spec/cold.md` is the
//! definition.
//!
//! A page names its numbers one after the other to a [`Coder`], which either takes them from the bytes of a cold page
//! ([`Decoder`]) or notes those of a page that is there (the writer's). So both directions are one walk over the page:
//!
//! - [`coder`]: symbols by tables of frequencies (rANS, two states by turns), and plain bits beside them;
//! - [`model`]: the tables, one set for each structure, stored once;
//! - `tree`: the walk of kinds `mh` and `mmh`; `vector`: that of kind `vector`; `plain`: any words.
//!
//! In: the stored bytes of a page, the [`Model`] of its structure, the length that the index says. Out: the words as they
//! are queried, or nothing. Time is linear in both lengths, memory in that of the words, whatever the bytes are.

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing,
    clippy::cast_possible_truncation
)]

pub mod coder;
pub mod model;
mod plain;
mod tree;
mod vector;

use alloc::vec;
use alloc::vec::Vec;

pub use coder::{Coder, Decoder};
pub use model::Model;

use crate::kind::Kind;

/// Bit 15 of a cold page's first 16 bits: its words are coded as such, not by its kind.
pub const PLAIN: u16 = 0x8000;

/// Decodes a page of `words` words; `None` where the bytes are not those of one.
pub fn decode(model: &Model, cold: &[u8], words: u16) -> Option<Vec<u32>> {
    let (first, rest) = cold.split_first_chunk::<2>()?;
    let first = u16::from_le_bytes(*first);
    let mut c = Decoder::new(model, rest, first & !PLAIN)?;
    let mut out = vec![0; words.into()];
    walk(&mut c, model, first & PLAIN != 0, &[], &mut out)?;
    c.is_at_end().then_some(out)
}

/// Names every number of a page to a coder and puts the words that they make into `out`, which is as long as the page
/// and zero. `real` is the page where the coder notes numbers, empty where it reads them. `None` where the numbers make no
/// page of this length.
pub fn walk<C: Coder>(c: &mut C, model: &Model, plain: bool, real: &[u32], out: &mut [u32]) -> Option<()> {
    match model.kind() {
        _ if plain => plain::walk(c, real, out),
        Kind::Mh => tree::walk::<C, false>(c, model, real, out),
        Kind::Mmh => tree::walk::<C, true>(c, model, real, out),
        Kind::Vector => vector::walk(c, model, real, out),
        _ => None,
    }
}

/// Word `at`; 0 outside.
#[inline]
fn word(words: &[u32], at: usize) -> u32 {
    words.get(at).copied().unwrap_or(0)
}

/// Puts a word in its place; `None` outside.
#[inline]
fn put(out: &mut [u32], at: usize, word: u32) -> Option<()> {
    *out.get_mut(at)? = word;
    Some(())
}

/// Sign into the lowest bit: 0, -1, 1, -2 become 0, 1, 2, 3.
#[inline]
fn zigzag(d: i64) -> u64 {
    (d << 1 ^ d >> 63).cast_unsigned()
}

/// Back from [`zigzag`].
#[inline]
fn unzigzag(z: u64) -> i64 {
    (z >> 1 ^ (z & 1).wrapping_neg()).cast_signed()
}

/// Low 32 bits.
#[inline]
#[allow(clippy::cast_possible_truncation)]
fn low(v: u64) -> u32 {
    // The cut is what is asked for.
    v as u32
}

/// Frame of a page of a kind: words 0 and 1. Returns them.
#[inline]
fn frame<C: Coder>(c: &mut C, kind: Kind, real: &[u32], out: &mut [u32]) -> Option<(u32, u32)> {
    let [w0, w1] = [word(real, 0), word(real, 1)];
    let head = c.bits(16, || w0 >> 8 & 0xFF | w1 >> 8 & 0xFF00);
    let refs = if c.bits(1, || u32::from(w0 >> 16 != 0)) == 0 { 0 } else { c.bits(16, || w0 >> 16) };
    let length = u32::try_from(out.len()).ok()?;
    let words = (u32::from(kind.tag()) | (head & 0xFF) << 8 | refs << 16, length | (head >> 8) << 16);
    put(out, 0, words.0)?;
    put(out, 1, words.1)?;
    Some(words)
}
