//! Interleaved repetitions: all candidates take turns, so that whatever slows the machine meets all of them.

use std::time::Instant;

/// Seconds of one candidate's repetitions, in the order they were taken.
#[derive(Clone, Debug)]
pub struct Samples(pub Vec<f64>);

impl Samples {
    /// Runs every candidate once per round, after one round that warms up and does not count.
    pub fn take(rounds: usize, candidates: &mut [&mut dyn FnMut()]) -> Vec<Samples> {
        let mut samples = vec![Samples(Vec::with_capacity(rounds)); candidates.len()];
        for round in 0..=rounds {
            for (candidate, samples) in candidates.iter_mut().zip(&mut samples) {
                let start = Instant::now();
                candidate();
                if round > 0 {
                    samples.0.push(start.elapsed().as_secs_f64());
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

    /// Ratios to another candidate, round by round.
    pub fn over(&self, other: &Samples) -> Samples {
        Samples(self.0.iter().zip(&other.0).map(|(a, b)| a / b).collect())
    }
}
