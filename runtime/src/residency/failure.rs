//! Pages that could not be loaded: when to try again, and whether somebody has been told.

use std::collections::HashMap;

/// Longest wait between two tries, in frames.
const LONGEST: u64 = 256;

#[derive(Debug, Default, Clone, Copy)]
struct Failure {
    tries: u32,
    again_at: u64,
}

/// Failures by ordinal.
#[derive(Debug, Default)]
pub struct Failures(HashMap<u32, Failure>);

impl Failures {
    /// Notes a failure at a frame; `true` for the first of this page. The wait doubles with each try, up to 256 frames.
    pub fn note(&mut self, ordinal: u32, frame: u64) -> bool {
        let failure = self.0.entry(ordinal).or_default();
        failure.tries = failure.tries.saturating_add(1);
        failure.again_at = frame + LONGEST.min(1 << failure.tries.min(16));
        failure.tries == 1
    }

    /// Whether the page must not be asked for yet.
    pub fn waits(&self, ordinal: u32, frame: u64) -> bool {
        self.0.get(&ordinal).is_some_and(|f| frame < f.again_at)
    }

    /// The page has come.
    pub fn forget(&mut self, ordinal: u32) {
        self.0.remove(&ordinal);
    }

    /// Pages at these places are gone.
    pub fn forget_all(&mut self, places: &std::ops::Range<u32>) {
        self.0.retain(|o, _| !places.contains(o));
    }

    /// Pages whose last try failed.
    pub fn len(&self) -> usize {
        self.0.len()
    }
}
