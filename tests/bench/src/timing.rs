//! Interleaved repetitions: all candidates take turns, so that whatever slows the machine meets all of them.
//!
//! Candidates run on one thread. Where the system says how long that thread was on a processor (Linux), this is what is
//! measured: other people's work on a shared machine then counts only as far as it takes cache and memory.

use std::time::{Duration, Instant};

/// Time of this thread on a processor, or on the wall.
#[derive(Clone, Copy)]
struct Clock {
    wall: Instant,
    thread: Option<Duration>,
}

impl Clock {
    fn start() -> Self {
        Clock { thread: on_processor(), wall: Instant::now() }
    }

    fn seconds(&self) -> f64 {
        let wall = self.wall.elapsed();
        match (self.thread, on_processor()) {
            (Some(start), Some(end)) => end.saturating_sub(start),
            _ => wall,
        }
        .as_secs_f64()
    }
}

/// The kernel brings the figure up to date at every tick only (1 to 4 ms): candidates should take 100 ms or more.
fn on_processor() -> Option<Duration> {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").ok()?;
    let ns = text.split_whitespace().next()?.parse().ok()?;
    (ns > 0).then(|| Duration::from_nanos(ns))
}

/// Seconds of one candidate's repetitions, in the order they were taken.
#[derive(Clone, Debug)]
pub struct Samples(pub Vec<f64>);

impl Samples {
    /// Runs every candidate once per round, after one round that warms up and does not count.
    pub fn take(rounds: usize, candidates: &mut [&mut dyn FnMut()]) -> Vec<Samples> {
        let mut samples = vec![Samples(Vec::with_capacity(rounds)); candidates.len()];
        for round in 0..=rounds {
            for (candidate, samples) in candidates.iter_mut().zip(&mut samples) {
                let clock = Clock::start();
                candidate();
                if round > 0 {
                    samples.0.push(clock.seconds());
                }
            }
        }
        samples
    }

    /// The middle one.
    pub fn median(&self) -> f64 {
        let mut sorted = self.0.clone();
        sorted.sort_by(f64::total_cmp);
        match sorted.len() {
            0 => f64::NAN,
            n => 0.5 * (sorted[(n - 1) / 2] + sorted[n / 2]),
        }
    }

    /// Smallest and largest.
    pub fn spread(&self) -> [f64; 2] {
        [self.0.iter().copied().fold(f64::INFINITY, f64::min), self.0.iter().copied().fold(0.0, f64::max)]
    }

    /// Nanoseconds of each of `count` things that a repetition did.
    pub fn each(&self, count: usize) -> Samples {
        Samples(self.0.iter().map(|v| v * 1e9 / count as f64).collect())
    }

    /// Ratios to another candidate, round by round.
    pub fn over(&self, other: &Samples) -> Samples {
        Samples(self.0.iter().zip(&other.0).map(|(a, b)| a / b).collect())
    }
}
