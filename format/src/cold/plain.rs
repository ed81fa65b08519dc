//! Any words: each as four symbols, its bytes from the low one on.

use super::{Coder, put, word};

/// Tables: of byte 0 to 3 of a word.
pub(super) const TABLES: &[(usize, u16)] = &[(4, 256)];
/// How many these are: tables of a kind come behind.
pub(super) const COUNT: usize = 4;

pub(super) fn walk<C: Coder>(c: &mut C, real: &[u32], out: &mut [u32]) -> Option<()> {
    for at in 0..out.len() {
        let known = word(real, at);
        let mut found = 0;
        for byte in 0..COUNT {
            let shift = 8 * byte;
            found |= c.symbol(byte, || known >> shift & 0xFF) << shift;
        }
        put(out, at, found)?;
    }
    Some(())
}
