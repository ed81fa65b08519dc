//! Structures, residency and loader together: what a frame does on the CPU, for any executor.
//!
//! [`Streamer::begin`] takes what the threads finished and what the device reported, and orders new pages;
//! [`Streamer::frame`] says what to copy. Neither waits. The executor for wgpu is [`crate::gpu::GpuStreamer`].
//!
//! Several structures (lights, levels of a game) share one budget, one pool and one page table. A structure is attached,
//! detached and replaced while frames go on ([`attached`]); which of their answers an engine can trust says
//! [`Streamer::coverage`].

pub mod attached;
mod coverage;
mod least;
pub mod loader;
mod stats;

use std::time::Duration;

use umbrage_reader::{ReaderError, Structure};

pub use attached::StructureId;
pub use coverage::Coverage;
pub use stats::FrameStats;

use crate::error::RuntimeError;
use crate::residency::budget::BLOCK_BYTES;
use crate::residency::foresee::{Looks, MOST_BOXES, Viewpoint, Way};
use crate::residency::{Budget, Config, Frame, Residency, Stats};
use attached::Attached;
use loader::{Loader, Order, Outcome, What};

/// Frames for which [`Streamer::begin`] looks ahead of moving cameras, until told otherwise.
const AHEAD: f64 = 12.0;

/// Most failures that wait to be taken; nobody may ever take them.
const MOST_FAILURES: usize = 1024;

/// A page that failed for the first time.
#[derive(Debug, Clone)]
pub struct PageFailure {
    /// Of which structure.
    pub structure: StructureId,
    /// The page, as the structure counts.
    pub ordinal: u32,
    /// Why.
    pub error: ReaderError,
}

/// Divides `budget_bytes` for one structure: the parts, and what the state machine must know of them. Reads and errors as
/// [`Streamer::new`].
///
/// # Errors
/// The budget or `most_pool` is too small, or the index can't be read.
pub fn divide(structure: &Structure, budget_bytes: u64, most_pool: u64) -> Result<(Budget, Config), RuntimeError> {
    let pages = structure.page_count();
    // The index of a large file is read only where the budget is so small that the longest way down may not fit.
    let enough = Budget::divide(budget_bytes, pages, least::always_enough(structure)?, most_pool);
    let budget = match enough {
        Ok(budget) => budget,
        Err(_) => divide_least(budget_bytes, pages, least::just_enough(structure)?, most_pool)?,
    };
    Ok((budget, config(&budget, pages)))
}

/// Divides for a pool of at least so many blocks; where the device doesn't bind so many no budget does.
fn divide_least(budget_bytes: u64, pages: u32, blocks: u32, most_pool: u64) -> Result<Budget, RuntimeError> {
    let needed = u64::from(blocks) * BLOCK_BYTES;
    if needed > most_pool {
        return Err(RuntimeError::Binding { what: "the pool", needed, most: most_pool });
    }
    Ok(Budget::divide(budget_bytes, pages, blocks, most_pool)?)
}

fn config(budget: &Budget, table: u32) -> Config {
    Config { table, blocks: budget.blocks, frame_bytes: budget.frame_bytes(), host_bytes: budget.host }
}

/// Streams structures.
#[derive(Debug)]
pub struct Streamer {
    budget: Budget,
    /// The budget that holds once all pages lie within it.
    coming: Option<Budget>,
    most_pool: u64,
    threads: usize,
    table: u32,
    residency: Residency,
    loader: Loader,
    /// By number; none where one has gone.
    attached: Vec<Option<Attached>>,
    /// Times that a structure was attached.
    attachments: u32,
    /// Surveys that were ordered.
    surveys: u64,
    failures: Vec<PageFailure>,
    loads: u64,
    in_flight: u64,
    /// Frames to look ahead; the cameras of the frame before.
    ahead: f64,
    views: Vec<Viewpoint>,
    looks: Looks,
    skips: Option<u32>,
    /// Whether an executor must tell the device of structures.
    changed: bool,
    last: Stats,
    frames: u64,
    frame_stats: FrameStats,
}

impl Streamer {
    /// Divides `budget_bytes`, starts `threads` loader threads and orders the roots. Reads the index blocks of the
    /// roots, and all where the pool is small: below about 25 blocks of 64 KiB. `most_pool` is the largest pool that
    /// the device binds, in bytes. The page table has room for this structure alone.
    ///
    /// # Errors
    /// The budget can't hold tables, roots and any page with all pages above it: with fewer bytes than the error tells,
    /// some lookups would be answered by ancestors for ever; or `most_pool` can't. Or the index can't be read.
    pub fn new(structure: &Structure, budget_bytes: u64, most_pool: u64, threads: usize) -> Result<Self, RuntimeError> {
        let (budget, _) = divide(structure, budget_bytes, most_pool)?;
        let mut this = Self::over(budget, structure.page_count(), most_pool, threads);
        this.attach(structure)?;
        Ok(this)
    }

    /// Without a structure; the page table has `table` entries, 16 bytes of the budget each: room for the pages of all
    /// structures that are attached at a time, one that replaces another counted beside it.
    ///
    /// # Errors
    /// The budget is too small for the table and a pool of one block.
    pub fn with_table(budget_bytes: u64, table: u32, most_pool: u64, threads: usize) -> Result<Self, RuntimeError> {
        Ok(Self::over(Budget::divide(budget_bytes, table, 1, most_pool)?, table, most_pool, threads))
    }

    fn over(budget: Budget, table: u32, most_pool: u64, threads: usize) -> Self {
        Self {
            budget,
            coming: None,
            most_pool,
            threads,
            table,
            residency: Residency::new(config(&budget, table)),
            loader: Loader::start(threads),
            attached: Vec::new(),
            attachments: 0,
            surveys: 0,
            failures: Vec::new(),
            loads: 0,
            in_flight: 0,
            ahead: AHEAD,
            views: Vec::new(),
            looks: Looks::default(),
            skips: Some(0),
            changed: true,
            last: Stats::default(),
            frames: 0,
            frame_stats: FrameStats::default(),
        }
    }

    /// How the budget is divided.
    pub fn budget(&self) -> &Budget {
        &self.budget
    }

    /// Another budget, while frames go on. A smaller one holds once pages have moved together and others have gone, which takes
    /// some frames: then [`exchange`](Self::exchange) says so. What was given last counts. Reads the indices where the pool
    /// becomes small.
    ///
    /// # Errors
    /// It, or the largest pool, can't hold the roots of all structures and any page with all above it; the old one holds on.
    pub fn set_budget(&mut self, budget_bytes: u64) -> Result<(), RuntimeError> {
        let enough = Budget::divide(budget_bytes, self.table, self.enough_blocks(false)?, self.most_pool);
        let budget = match enough {
            Ok(budget) => budget,
            Err(_) => divide_least(budget_bytes, self.table, self.enough_blocks(true)?, self.most_pool)?,
        };
        self.residency.resize(config(&budget, self.table));
        self.coming = Some(budget);
        Ok(())
    }

    /// A new division, once: before it carries out the next [`frame`](Self::frame) an executor makes buffers of its sizes, and
    /// the words of the pool stay as far as both pools reach. To be asked before every frame.
    pub fn exchange(&mut self) -> Option<Budget> {
        let budget = self.coming.take_if(|_| self.residency.is_within())?;
        self.budget = budget;
        Some(budget)
    }

    /// The device's buffers are lost, with all pages: everything is read anew, and structures answer again once their
    /// roots have come. Names stay. Feedback of frames before counts no more.
    ///
    /// # Errors
    /// An index can't be read any more: that structure has gone.
    pub fn restart(&mut self) -> Result<(), RuntimeError> {
        let budget = self.coming.take().unwrap_or(self.budget);
        self.budget = budget;
        self.residency = Residency::new(config(&budget, self.table));
        // What the old threads still read comes to nobody.
        self.loader = Loader::start(self.threads);
        (self.in_flight, self.last) = (0, Stats::default());
        self.reattach()
    }

    /// Later budgets take a pool of at most so many bytes: another device may bind less.
    pub fn set_most_pool(&mut self, bytes: u64) {
        self.most_pool = bytes;
    }

    /// Entries of the page table.
    pub fn table(&self) -> u32 {
        self.table
    }

    /// The state machine, to look at.
    pub fn residency(&self) -> &Residency {
        &self.residency
    }

    /// Its totals and state.
    pub fn stats(&self) -> Stats {
        self.residency.stats()
    }

    /// What the last frame was like.
    pub fn frame_stats(&self) -> FrameStats {
        self.frame_stats
    }

    /// Pages that the loader has read, those that failed included, and those that were in the pool and whose words were not
    /// read.
    pub fn loads(&self) -> u64 {
        self.loads
    }

    /// Whether pages are being read.
    pub fn is_loading(&self) -> bool {
        self.in_flight != 0
    }

    /// Asks for a page by its place in the page table, as a walk that missed it does; see [`Residency::request`].
    pub fn request(&mut self, ordinal: u32, weight: u32) {
        self.residency.request(ordinal, weight);
    }

    /// From now on [`begin`](Self::begin) looks so many frames ahead of its cameras; at first 12. 0: not at all.
    pub fn look_ahead(&mut self, frames: f64) {
        self.ahead = frames;
    }

    /// Tells where the cameras are, once a frame, always in the same order, so that pages are ordered ahead that they will
    /// need `frames` frames from now if they go on as they came. Reads nothing; gives how many pages were named.
    pub fn look(&mut self, views: &[Viewpoint], frames: f64) -> usize {
        let mut named = 0;
        let each = MOST_BOXES / (self.attached.len() * views.len()).max(1);
        for attached in self.attached.iter_mut().flatten() {
            let Some(foresight) = &attached.foresight else { continue };
            let structure = &attached.structure;
            for (before, now) in self.views.iter().zip(views) {
                // The blocks of children that the residency knows are in memory.
                let record = |o| structure.page_record(o).ok();
                let way = Way { before, now, frames };
                named += foresight.look(&way, &mut self.residency, &attached.span, &mut self.looks, each, record);
            }
        }
        self.views.clear();
        self.views.extend_from_slice(views);
        named
    }

    /// One round of feedback from the device; see [`Residency::feedback`].
    pub fn feedback(&mut self, missed: impl IntoIterator<Item = (u32, u32)>, used: &[u32], overflow: bool) {
        self.residency.feedback(missed, used, overflow);
    }

    /// What the device said of a frame beside its pages: queries that an ancestor answered, and how many levels the
    /// coarsest of these answers was above the level that was asked for.
    pub fn answered(&mut self, by_ancestors: u32, worst_levels: u32) {
        (self.frame_stats.by_ancestors, self.frame_stats.worst_levels) = (by_ancestors, worst_levels);
    }

    /// Takes finished pages and orders new ones, also such as the cameras will need.
    pub fn begin(&mut self, views: &[Viewpoint]) {
        while let Some(outcome) = self.loader.take() {
            self.settle(outcome);
        }
        self.flip();
        if self.ahead > 0.0 && !views.is_empty() {
            self.look(views, self.ahead);
        }
        self.order();
    }

    /// As [`begin`](Self::begin) without cameras, but waits for one page where some are being read; at most `time`. Not for
    /// a render thread.
    pub fn wait(&mut self, time: Duration) {
        if self.is_loading()
            && let Some(outcome) = self.loader.wait(time)
        {
            self.settle(outcome);
        }
        self.begin(&[]);
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
            let Some((structure, span)) = self.owner(ordinal) else { continue };
            let (number, base) = (span.number, span.base);
            let what = if self.residency.is_kept(ordinal) { What::Kept(ordinal) } else { What::Page(ordinal) };
            let order = Order { structure: structure.clone(), number, base, what };
            self.in_flight += 1;
            self.loader.order(order);
        }
    }

    fn settle(&mut self, outcome: Outcome) {
        if let Outcome::First(page) = outcome {
            self.loads += 1;
            self.residency.loaded(page);
            return;
        }
        self.in_flight -= 1;
        let (ordinal, page) = match outcome {
            Outcome::First(_) => return,
            Outcome::Page(ordinal, page) => (ordinal, page),
            Outcome::Children(number, ordinal, children) => {
                return self.residency.children_told(number, ordinal, children);
            }
            Outcome::Survey(number, pages) => return self.surveyed(number, pages),
        };
        self.loads += 1;
        match page {
            Ok(page) => self.residency.loaded(page),
            Err(error) => {
                if self.residency.failed(ordinal)
                    && self.failures.len() < MOST_FAILURES
                    && let Some((structure, base)) = self.id_of(ordinal)
                {
                    self.failures.push(PageFailure { structure, ordinal: ordinal - base, error });
                }
            }
        }
    }

    /// What to copy before this frame's queries. Nothing while buffers that have grown wait for their
    /// [`exchange`](Self::exchange).
    pub fn frame(&mut self) -> Frame {
        if self.coming.is_some_and(|c| c.blocks > self.budget.blocks || c.staging > self.budget.staging) {
            return Frame::default();
        }
        let frame = self.residency.frame();
        let now = self.residency.stats();
        self.frames += 1;
        self.frame_stats.follow(self.frames, &self.last, &now, self.in_flight);
        self.last = now;
        frame
    }

    /// Pages that failed since the last call, the first 1,024 of them; each is named once.
    pub fn take_failures(&mut self) -> Vec<PageFailure> {
        std::mem::take(&mut self.failures)
    }
}
