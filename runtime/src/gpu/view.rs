//! A whole view: the same receivers frame after frame, until every one is exact.

use std::ops::Range;
use std::time::Duration;

use super::kernel::{Entry, Kernels, Queries};
use super::streamer::GpuStreamer;
use crate::error::RuntimeError;
use crate::query::filter::FilterQuery;
use crate::query::pool::{ANCESTOR, EXACT, LEVEL_SHIFT, LIT, OUTSIDE, SETTLED, WORD_SHIFT};
use crate::residency::Stats;

/// Receivers on the device at once.
const CHUNK: usize = 1 << 22;
/// Frames without a page that came before a view counts as stuck; longer than a page is parked.
const STUCK: u32 = 12;

/// A point whose shadow is asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Receiver {
    /// Texel column, finest level. Outside the map: lit, and flagged.
    pub x: u32,
    /// Texel row.
    pub y: u32,
    /// Lattice depth, rounded up.
    pub depth: u32,
    /// Level that is asked for: 0, or as coarse as the receiver's footprint allows.
    pub level: u8,
}

/// The answer for one receiver.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pixel {
    /// Whether light reaches it.
    pub lit: bool,
    /// Whether the nearest resident ancestor answered because a page was missing.
    pub ancestor: bool,
    /// Whether it lies outside the map.
    pub outside: bool,
    /// Whether what the index says of a page was enough.
    pub settled: bool,
    /// Level of the node that answered, or that stands above the page that was not needed.
    pub level: u8,
}

/// How long to go on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ViewOptions {
    /// Root to ask.
    pub root: u32,
    /// Most frames; what is not exact by then keeps its ancestor's answer.
    pub max_frames: u32,
    /// Where the budget can't hold all pages of the view at once: go through it in parts until all is exact. Else stop
    /// there, with the answers of ancestors.
    pub in_parts: bool,
}

impl Default for ViewOptions {
    fn default() -> Self {
        Self { root: 0, max_frames: 10_000, in_parts: true }
    }
}

/// What it took.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ViewStats {
    /// Frames. Each waits for the pages that it ordered, so that the number does not depend on the disk.
    pub frames: u32,
    /// Whether every answer is exact.
    pub exact: bool,
    /// Pages read during the view, those that failed included.
    pub pages_read: u64,
    /// Pages of the structure.
    pub pages: u32,
    /// Bytes that the runtime was given.
    pub budget_bytes: u64,
    /// Bytes of its pool.
    pub pool_bytes: u64,
    /// Bytes of pages uploaded during the view.
    pub uploaded_bytes: u64,
    /// Pages evicted during the view.
    pub evicted: u64,
    /// Most pages that were wanted and found no room, in any frame.
    pub starved: u32,
    /// Pages that could not be read during the view.
    pub failed: u32,
}

/// Answers and figures.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ViewAnswer {
    /// One for each receiver, in order.
    pub pixels: Vec<Pixel>,
    /// What it took.
    pub stats: ViewStats,
}

impl Pixel {
    fn from_state(state: u32) -> Self {
        let bit = |b| state & b != 0;
        // A pixel that no frame reached has no bits at all.
        let (ancestor, outside) = (bit(ANCESTOR) || !bit(EXACT), bit(OUTSIDE));
        let settled = bit(SETTLED);
        Self { lit: bit(LIT), ancestor, outside, settled, level: (state >> LEVEL_SHIFT & 31) as u8 }
    }
}

impl GpuStreamer {
    /// Answers receivers, frame after frame: dispatch, read what was missed, upload, until all are
    /// exact or the options say stop. For tools and tests: it waits for device and loader.
    ///
    /// # Errors
    /// A kind without kernels, or the device was lost. Pages that can't be read are no error: their pixels keep an
    /// ancestor's answer, and [`crate::stream::Streamer::take_failures`] names them.
    pub fn answer_view(&mut self, receivers: &[Receiver], options: &ViewOptions) -> Result<ViewAnswer, RuntimeError> {
        let words: Vec<_> = receivers.iter().map(|r| [r.x, r.y, r.depth, u32::from(r.level) << WORD_SHIFT]).collect();
        let (states, stats) = self.states(&words, Entry::Pixels, options)?;
        Ok(ViewAnswer { pixels: states.into_iter().map(Pixel::from_state).collect(), stats })
    }

    /// The same for filters: a state for each query, see [`Pool::filter`](crate::query::Pool::filter); of one that no frame
    /// reached 0.
    ///
    /// # Errors
    /// As [`answer_view`](Self::answer_view).
    pub fn filter_view(
        &mut self,
        queries: &[FilterQuery],
        options: &ViewOptions,
    ) -> Result<(Vec<u32>, ViewStats), RuntimeError> {
        let words: Vec<_> = queries.iter().flat_map(FilterQuery::encode).collect();
        self.states(&words, Entry::Filtered, options)
    }

    /// The last states of queries that the entry point takes, frame after frame.
    fn states(
        &mut self,
        words: &[[u32; 4]],
        entry: Entry,
        options: &ViewOptions,
    ) -> Result<(Vec<u32>, ViewStats), RuntimeError> {
        let (before, loads) = (self.streamer.stats(), self.streamer.loads());
        let mut stats = ViewStats { exact: true, ..ViewStats::default() };
        let each = entry.words();
        let mut states = Vec::with_capacity(words.len() / each);
        self.with_kernels(|this, kernels| {
            let bound = (this.device.limits().max_storage_buffer_binding_size / 16) as usize;
            let chunk = CHUNK.min(bound / each).max(1) * each;
            for words in words.chunks(chunk) {
                let queries = kernels.queries(&this.device, words)?;
                this.go_on(kernels, entry, &queries, (words.len() / each) as u32, options, &mut stats)?;
                let words = this.read(&queries.buffer, 0, words.len() as u64 * 16)?;
                states.extend(words.chunks_exact(4 * each).map(|q| q[3]));
            }
            Ok(())
        })?;
        let after = self.streamer.stats();
        stats.exact = states.iter().all(|s| !Pixel::from_state(*s).ancestor);
        stats.pages_read = self.streamer.loads() - loads;
        stats.pages = self.selected()?.0.page_count();
        stats.budget_bytes = self.streamer.budget().total;
        stats.pool_bytes = self.streamer.budget().pool();
        stats.uploaded_bytes = after.uploaded_bytes - before.uploaded_bytes;
        stats.evicted = after.evicted - before.evicted;
        stats.failed = after.failing;
        Ok((states, stats))
    }

    fn go_on(
        &mut self,
        kernels: &Kernels,
        entry: Entry,
        queries: &Queries,
        count: u32,
        options: &ViewOptions,
        stats: &mut ViewStats,
    ) -> Result<(), RuntimeError> {
        let (_, number) = self.selected()?;
        let mut part: Range<u32> = 0..count;
        let (mut admitted, mut idle) = (self.streamer.stats().admitted, 0);
        while part.start < count && stats.frames < options.max_frames {
            stats.frames += 1;
            self.submit(|this, encoder| {
                let group = this.bind_group();
                kernels.dispatch(&this.queue, encoder, group, entry, queries, [options.root, number], part.clone());
            })?;
            // The feedback of this very frame is there, as the device is done.
            self.begin(&[]);
            while self.streamer.is_loading() {
                self.streamer.wait(Duration::from_millis(50));
            }
            let now: Stats = self.streamer.stats();
            stats.starved = stats.starved.max(now.starved);
            idle = if now.admitted == admitted { idle + 1 } else { 0 };
            admitted = now.admitted;
            if self.report().approximate == 0 {
                let size = part.len() as u32;
                part = part.end..part.end.saturating_add(size).min(count);
                idle = 0;
                continue;
            }
            if idle < STUCK {
                continue;
            }
            idle = 0;
            if now.starved == 0 {
                // What is missing can't be read: the ancestors' answers stay.
                part = part.end..part.end.saturating_add(part.len() as u32).min(count);
            } else if options.in_parts && part.len() > 1 {
                part.end = part.start + part.len() as u32 / 2;
            } else if options.in_parts {
                part = part.end..(part.end + 1).min(count);
            } else {
                return Ok(());
            }
        }
        Ok(())
    }
}
