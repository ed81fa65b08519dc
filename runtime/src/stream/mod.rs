//! Structure, residency and loader together: what a frame does on the CPU, for any executor.
//!
//! [`Streamer::begin`] takes what the threads finished and what the device reported, and orders new pages;
//! [`Streamer::frame`] says what to copy. Neither waits. The executor for wgpu is [`crate::gpu::GpuStreamer`].

mod least;
pub mod loader;

use std::time::Duration;

use umbrage_reader::{ReaderError, Structure};

use crate::error::RuntimeError;
use crate::residency::foresee::{Foresight, Viewpoint};
use crate::residency::{Budget, Config, Frame, Residency, Stats};
use loader::{Loader, Outcome};

/// A page that failed for the first time.
#[derive(Debug, Clone)]
pub struct PageFailure {
    /// The page.
    pub ordinal: u32,
    /// Why.
    pub error: ReaderError,
}

/// Divides `budget_bytes` for a structure: the parts, and what its state machine must know of them. Reads and errors as
/// [`Streamer::new`].
///
/// # Errors
/// The budget is too small, or the index can't be read.
pub fn divide(structure: &Structure, budget_bytes: u64, most_pool: u64) -> Result<(Budget, Config), RuntimeError> {
    let record = structure.record();
    let (pages, roots) = (structure.page_count(), record.root_count.get());
    // The index of a large file is read only where the budget is so small that the longest way down may not fit.
    let enough = Budget::divide(budget_bytes, pages, least::always_enough(structure)?, most_pool);
    let budget = match enough {
        Ok(budget) => budget,
        Err(_) => Budget::divide(budget_bytes, pages, least::just_enough(structure)?, most_pool)?,
    };
    let config = Config {
        pages,
        roots,
        shared: record.shared_pages.get(),
        blocks: budget.blocks,
        frame_bytes: budget.frame_bytes(),
        host_bytes: budget.host,
    };
    Ok((budget, config))
}

/// Streams one structure.
#[derive(Debug)]
pub struct Streamer {
    structure: Structure,
    budget: Budget,
    residency: Residency,
    foresight: Option<Foresight>,
    loader: Loader,
    failures: Vec<PageFailure>,
    loads: u64,
    in_flight: u64,
}

impl Streamer {
    /// Divides `budget_bytes`, starts `threads` loader threads and orders the roots. Reads the index blocks of the
    /// roots, and all where the pool is small: below about 25 blocks of 64 KiB. `most_pool` is the largest pool that
    /// the device binds, in bytes.
    ///
    /// # Errors
    /// The budget can't hold tables, roots and any page with all pages above it: with fewer bytes than the error tells,
    /// some lookups would be answered by ancestors for ever. Or the index can't be read.
    pub fn new(structure: &Structure, budget_bytes: u64, most_pool: u64, threads: usize) -> Result<Self, RuntimeError> {
        let (budget, config) = divide(structure, budget_bytes, most_pool)?;
        Ok(Self {
            structure: structure.clone(),
            budget,
            residency: Residency::new(config),
            foresight: Foresight::new(structure.lattice()),
            loader: Loader::start(structure, threads),
            failures: Vec::new(),
            loads: 0,
            in_flight: 0,
        })
    }

    /// The structure.
    pub fn structure(&self) -> &Structure {
        &self.structure
    }

    /// How the budget is divided.
    pub fn budget(&self) -> &Budget {
        &self.budget
    }

    /// The state machine, to look at.
    pub fn residency(&self) -> &Residency {
        &self.residency
    }

    /// Its totals and state.
    pub fn stats(&self) -> Stats {
        self.residency.stats()
    }

    /// Pages that the loader has read, those that failed included.
    pub fn loads(&self) -> u64 {
        self.loads
    }

    /// Whether pages are being read.
    pub fn is_loading(&self) -> bool {
        self.in_flight != 0
    }

    /// Asks for a page from the CPU side, as a walk that missed it does; see [`Residency::request`].
    pub fn request(&mut self, ordinal: u32, weight: u32) {
        self.residency.request(ordinal, weight);
    }

    /// Tells where the camera is, once a frame, so that pages are ordered ahead that it will need `frames` frames from now if it
    /// goes on as it came. Reads nothing; gives how many pages it named.
    pub fn look(&mut self, now: &Viewpoint, frames: f64) -> usize {
        let (structure, roots) = (&self.structure, self.structure.record().root_count.get());
        let Some(foresight) = &mut self.foresight else { return 0 };
        // The blocks of children that the residency knows are in memory.
        foresight.look(now, frames, &mut self.residency, roots, |o| structure.page_record(o).ok())
    }

    /// One round of feedback from the device; see [`Residency::feedback`].
    pub fn feedback(&mut self, missed: impl IntoIterator<Item = (u32, u32)>, used: &[u32], overflow: bool) {
        self.residency.feedback(missed, used, overflow);
    }

    /// Takes finished pages and orders new ones.
    pub fn begin(&mut self) {
        while let Some(outcome) = self.loader.take() {
            self.settle(outcome);
        }
        self.order();
    }

    /// As [`begin`](Self::begin), but waits for one page where some are being read; at most `time`. Not for a render
    /// thread.
    pub fn wait(&mut self, time: Duration) {
        if self.is_loading()
            && let Some(outcome) = self.loader.wait(time)
        {
            self.settle(outcome);
        }
        self.begin();
    }

    fn order(&mut self) {
        let abandoned: Vec<u32> = self.residency.abandoned().collect();
        for ordinal in abandoned {
            if self.loader.cancel(ordinal) {
                self.in_flight -= 1;
                self.residency.cancelled(ordinal);
            }
        }
        for ordinal in self.residency.loads() {
            self.in_flight += 1;
            self.loader.order(ordinal);
        }
    }

    fn settle(&mut self, (ordinal, outcome): Outcome) {
        self.loads += 1;
        self.in_flight -= 1;
        match outcome {
            Ok(page) => self.residency.loaded(page),
            Err(error) => {
                if self.residency.failed(ordinal) {
                    self.failures.push(PageFailure { ordinal, error });
                }
            }
        }
    }

    /// What to copy before this frame's queries.
    pub fn frame(&mut self) -> Frame {
        self.residency.frame()
    }

    /// Pages that failed since the last call; each is named once.
    pub fn take_failures(&mut self) -> Vec<PageFailure> {
        std::mem::take(&mut self.failures)
    }
}
