//! What cutting may take: how much memory, and whether it goes on.
//!
//! Lists are counted by their lengths and the sizes of their elements; what triangles in work take is counted by
//! [`EDGE`], [`FOUND`] and [`JOINED`], a little above what was measured on noise (peak of the process, 1024 x 1024 pixels:
//! 235, 125 and 390).

use std::sync::atomic::{AtomicU64, Ordering};

use super::super::load::Bounds;

/// Bytes for each pixel along the edges of a triangle in work.
const EDGE: u64 = 256;

/// Bytes for each chord that has been found, while they are joined.
const FOUND: u64 = 160;

/// Bytes for each chord that is left, while they are triangulated.
const JOINED: u64 = 400;

/// Steps before the caller is asked again whether to go on: milliseconds.
const STEPS: u32 = 4096;

/// Why a triangle is not cut.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Halt {
    /// Texture coordinates too far away.
    Far,
    /// More lines along its outline than this.
    Lines(usize),
    /// So many bytes would be held, at least.
    Memory(u64),
    /// The caller has had enough.
    Stopped,
}

/// All that is held, by all threads.
pub struct Account<'a> {
    bounds: &'a Bounds<'a>,
    held: AtomicU64,
}

impl<'a> Account<'a> {
    /// Nothing is held yet.
    pub fn new(bounds: &'a Bounds<'a>) -> Self {
        Account { bounds, held: AtomicU64::new(0) }
    }

    /// The budget; only asked once it is passed.
    pub fn budget(&self) -> u64 {
        self.bounds.memory_bytes.unwrap_or(u64::MAX)
    }

    /// Whether the caller still wants the outcome.
    pub fn go_on(&self) -> Result<(), Halt> {
        if (self.bounds.keep_on)() { Ok(()) } else { Err(Halt::Stopped) }
    }

    /// Counts bytes that are about to be held, until the outcome is dropped.
    pub fn take(&self, bytes: u64) -> Result<Share<'_>, Halt> {
        let mut share = Share { account: self, bytes: 0 };
        share.grow(bytes)?;
        Ok(share)
    }
}

/// Bytes that one part of the work holds.
pub struct Share<'a> {
    account: &'a Account<'a>,
    bytes: u64,
}

impl Share<'_> {
    /// Counts up to so many bytes in all; fewer than before change nothing.
    pub fn grow(&mut self, bytes: u64) -> Result<(), Halt> {
        let more = bytes.saturating_sub(self.bytes);
        let held = self.account.held.fetch_add(more, Ordering::Relaxed).saturating_add(more);
        self.bytes += more;
        if held > self.account.budget() { Err(Halt::Memory(held)) } else { Ok(()) }
    }

    /// Stays counted.
    pub fn keep(mut self) {
        self.bytes = 0;
    }
}

impl Drop for Share<'_> {
    fn drop(&mut self) {
        self.account.held.fetch_sub(self.bytes, Ordering::Relaxed);
    }
}

/// One triangle in work.
pub struct Work<'a> {
    share: Share<'a>,
    around: u64,
    /// Steps since the caller was last asked.
    steps: u32,
}

impl<'a> Work<'a> {
    /// For a triangle with so many pixels along its edges.
    pub fn begin(account: &'a Account<'a>, around: u64) -> Result<Self, Halt> {
        account.go_on()?;
        Ok(Work { share: account.take(around * EDGE)?, around, steps: 0 })
    }

    /// So many chords have been found.
    pub fn found(&mut self, chords: usize) -> Result<(), Halt> {
        self.share.grow(self.around * EDGE + chords as u64 * FOUND)
    }

    /// So many are left of them, which are about to be triangulated.
    pub fn joined(&mut self, chords: usize) -> Result<(), Halt> {
        self.step_now()?;
        self.share.grow(self.around * EDGE + chords as u64 * JOINED)
    }

    fn step_now(&mut self) -> Result<(), Halt> {
        self.steps = 0;
        self.share.account.go_on()
    }

    /// One of many steps of less than a microsecond or few.
    pub fn step(&mut self) -> Result<(), Halt> {
        self.steps += 1;
        if self.steps < STEPS {
            return Ok(());
        }
        self.step_now()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_dropped_is_free_again() {
        let bounds = Bounds { memory_bytes: Some(100), ..Bounds::default() };
        let account = Account::new(&bounds);
        account.take(40).unwrap().keep();
        let mut share = account.take(50).unwrap();
        share.grow(20).unwrap();
        share.grow(60).unwrap();
        assert_eq!(account.take(1).err(), Some(Halt::Memory(101)));
        assert_eq!(share.grow(61).err(), Some(Halt::Memory(101)));
        drop(share);
        assert!(account.take(60).is_ok() && account.take(61).is_err());
    }
}
