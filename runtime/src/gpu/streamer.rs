//! The buffers and the steps of a frame.

use std::sync::Arc;
use std::time::Duration;

use umbrage_reader::Structure;

use super::kernel::{Entry, Kernels};
use super::pool::{Pieces, Pool};
use super::transfer::{Readback, Staging};
use crate::error::RuntimeError;
use crate::query::filter::FilterQuery;
use crate::residency::budget::{BLOCK_BYTES, READBACK_BUFFERS, STAGING_BUFFERS};
use crate::residency::foresee::Viewpoint;
use crate::residency::{ABSENT, Budget, Entry as TableEntry, Frame, LONGEST_WAIT, Op};
use crate::shader::{self, FEEDBACK_HEAD, FEEDBACK_USED, View};
use crate::stream::{FrameStats, Streamer, StructureId};

/// Threads that load pages.
const LOADERS: usize = 2;
/// Frames without a new page after which the roots count as stuck: longer than a page keeps its place and another is parked.
const ROOTS_IDLE: u32 = 64;
const _: () = assert!(ROOTS_IDLE as u64 > LONGEST_WAIT + 8);

/// What the device said about a frame, some frames later.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Report {
    /// Frames reported so far.
    pub number: u64,
    /// Distinct pages that receivers missed.
    pub missed: u32,
    /// Queries of the runtime's own kernels that an ancestor answered.
    pub approximate: u32,
    /// Levels by which the coarsest answer of an ancestor was above the level asked for.
    pub worst_levels: u32,
}

/// Structures on a device of the caller's: one budget, one group of bindings.
///
/// They are attached, detached, replaced and marked as stale through [`streamer_mut`](Self::streamer_mut), between frames.
/// Shaders choose one by `umb_select(id.index())`.
///
/// A frame is [`begin`](Self::begin), [`record`](Self::record), the caller's passes, [`end`](Self::end), and the
/// caller's submission of the encoder; none of them waits. An encoder that went through `record` or `end` must be
/// submitted, else the buffers it holds never come back.
#[derive(Debug)]
pub struct GpuStreamer {
    pub(super) device: wgpu::Device,
    pub(super) queue: wgpu::Queue,
    pub(super) streamer: Streamer,
    table: wgpu::Buffer,
    uniform: wgpu::Buffer,
    view: Box<View>,
    selected: Option<StructureId>,
    scratch: wgpu::Buffer,
    pieces: Pieces,
    parts: Parts,
    layout: wgpu::BindGroupLayout,
    kernels: Option<Arc<Kernels>>,
    report: Report,
}

/// What another budget has in other sizes.
#[derive(Debug)]
struct Parts {
    pool: Pool,
    feedback: wgpu::Buffer,
    staging: Staging,
    readback: Readback,
    group: wgpu::BindGroup,
    /// Times that they were made anew.
    number: u64,
}

impl Parts {
    fn new(
        device: &wgpu::Device,
        layout: &wgpu::BindGroupLayout,
        budget: &Budget,
        pieces: &Pieces,
        [table, uniform]: [&wgpu::Buffer; 2],
    ) -> Result<Self, RuntimeError> {
        fits(device, "the feedback", budget.feedback)?;
        let pool = Pool::new(device, budget.pool(), pieces)?;
        let feedback = filled(device, "umbrage feedback", budget.feedback, wgpu::BufferUsages::STORAGE, &[])?;
        let own = (1..).zip([table, &feedback, uniform]);
        let entries: Vec<_> = (0..pieces.count)
            .map(|i| (shader::pool_binding(i), pool.bound(i)))
            .chain(own)
            .map(|(binding, b)| wgpu::BindGroupEntry { binding, resource: b.as_entire_binding() })
            .collect();
        let group =
            device.create_bind_group(&wgpu::BindGroupDescriptor { label: Some("umbrage"), layout, entries: &entries });
        Ok(Self {
            pool,
            feedback,
            staging: Staging::new(device, STAGING_BUFFERS, budget.staging),
            readback: Readback::new(device, READBACK_BUFFERS, budget.feedback),
            group,
            number: 0,
        })
    }
}

/// A binding that shaders of both stages may use.
pub(super) fn entry(binding: u32, ty: wgpu::BufferBindingType) -> wgpu::BindGroupLayoutEntry {
    wgpu::BindGroupLayoutEntry {
        binding,
        visibility: wgpu::ShaderStages::COMPUTE | wgpu::ShaderStages::FRAGMENT,
        ty: wgpu::BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None },
        count: None,
    }
}

/// Refuses a storage buffer that the device can't make or bind.
pub(super) fn fits(device: &wgpu::Device, what: &'static str, needed: u64) -> Result<(), RuntimeError> {
    let most = largest(device);
    if needed <= most { Ok(()) } else { Err(RuntimeError::Binding { what, needed, most }) }
}

pub(super) fn largest(device: &wgpu::Device) -> u64 {
    let limits = device.limits();
    limits.max_storage_buffer_binding_size.min(limits.max_buffer_size)
}

/// A buffer that starts with `bytes`, zero behind them; both ends of copies.
pub(super) fn filled(
    device: &wgpu::Device,
    label: &'static str,
    size: u64,
    usage: wgpu::BufferUsages,
    bytes: &[u8],
) -> Result<wgpu::Buffer, RuntimeError> {
    let usage = usage | wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC;
    let mapped_at_creation = !bytes.is_empty();
    let buffer = device.create_buffer(&wgpu::BufferDescriptor { label: Some(label), size, usage, mapped_at_creation });
    if mapped_at_creation {
        {
            let mut view = buffer
                .get_mapped_range_mut(..)
                .map_err(|e| RuntimeError::Device { reason: format!("{label}: {e}") })?;
            view.slice(..bytes.len()).copy_from_slice(bytes);
        }
        buffer.unmap();
    }
    Ok(buffer)
}

impl GpuStreamer {
    /// For one structure that stays: makes the buffers, all of them within `budget_bytes`, and brings in the roots. This
    /// call waits for reads and for the device. A pool beyond what the device binds in one buffer (128 MiB on many) lies in
    /// several, [`pools`](Self::pools); a budget beyond what the device binds in all of them is used up to that. Of the storage buffers
    /// that the device allows a stage two are left to the caller: who needs more asks the device for more.
    ///
    /// # Errors
    /// The budget is too small, a buffer larger than the device binds, or a root can't be read.
    pub fn new(
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        structure: &Structure,
        budget_bytes: u64,
    ) -> Result<Self, RuntimeError> {
        let streamer = Streamer::new(structure, budget_bytes, Pieces::largest_pool(device), LOADERS)?;
        let mut this = Self::over(device, queue, streamer)?;
        this.wait_ready()?;
        Ok(this)
    }

    /// For structures that come and go: makes the buffers, all of them within `budget_bytes`, with a page table of `table`
    /// entries; see [`Streamer::with_table`]. The pool's buffers are those of [`new`](Self::new).
    ///
    /// # Errors
    /// The budget is too small, or a buffer larger than the device binds.
    pub fn with_table(
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        budget_bytes: u64,
        table: u32,
    ) -> Result<Self, RuntimeError> {
        let streamer = Streamer::with_table(budget_bytes, table, Pieces::largest_pool(device), LOADERS)?;
        Self::over(device, queue, streamer)
    }

    fn over(device: &wgpu::Device, queue: &wgpu::Queue, mut streamer: Streamer) -> Result<Self, RuntimeError> {
        let pieces = Pieces::new(device, streamer.budget().pool());
        // Layouts stay: later budgets have as many buffers.
        streamer.set_most_pool(pieces.most());
        let read_only = wgpu::BufferBindingType::Storage { read_only: true };
        let own = [
            entry(1, read_only),
            entry(2, wgpu::BufferBindingType::Storage { read_only: false }),
            entry(3, wgpu::BufferBindingType::Uniform),
        ];
        let entries: Vec<_> = (0..pieces.count).map(|i| entry(shader::pool_binding(i), read_only)).chain(own).collect();
        let layout = device
            .create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: Some("umbrage"), entries: &entries });
        let absent = vec![ABSENT; streamer.table().max(1) as usize];
        let budget = *streamer.budget();
        fits(device, "the page table", budget.table)?;
        let storage = wgpu::BufferUsages::STORAGE;
        let table = filled(device, "umbrage table", budget.table, storage, bytemuck::cast_slice(&absent))?;
        let piece_log2 = pieces.words_log2();
        let view: Box<View> = Box::new(View { pages: streamer.table(), piece_log2, ..bytemuck::Zeroable::zeroed() });
        let bytes = bytemuck::bytes_of(&*view);
        let uniform = filled(device, "umbrage view", bytes.len() as u64, wgpu::BufferUsages::UNIFORM, bytes)?;
        let scratch = filled(device, "umbrage scratch", BLOCK_BYTES, wgpu::BufferUsages::empty(), &[])?;
        let parts = Parts::new(device, &layout, &budget, &pieces, [&table, &uniform])?;
        let mut this = Self {
            device: device.clone(),
            queue: queue.clone(),
            streamer,
            table,
            uniform,
            view,
            selected: None,
            scratch,
            pieces,
            parts,
            layout,
            kernels: None,
            report: Report::default(),
        };
        this.measure();
        Ok(this)
    }

    /// Tells the device how large the buffers are.
    fn measure(&mut self) {
        let budget = self.streamer.budget();
        self.view.pool_words = (budget.pool() / 4) as u32;
        self.view.used_words = (budget.feedback / 4 - u64::from(FEEDBACK_USED)) as u32;
        self.queue.write_buffer(&self.uniform, 0, bytemuck::bytes_of(&*self.view));
    }

    /// Another budget, while frames go on; see [`Streamer::set_budget`]. The pool stays in as many buffers as it was made for, and
    /// grows no further than they do. When it holds, [`bind_group`](Self::bind_group) and
    /// [`buffers`](Self::buffers) are others, and [`exchanges`](Self::exchanges) has grown; for one frame the old and the new pool
    /// exist both.
    ///
    /// # Errors
    /// As there.
    pub fn set_budget(&mut self, budget_bytes: u64) -> Result<(), RuntimeError> {
        self.streamer.set_budget(budget_bytes)
    }

    /// How often the buffers were exchanged for others: groups that a caller made of them must be made anew then.
    pub fn exchanges(&self) -> u64 {
        self.parts.number
    }

    /// Whether the device was lost, as far as this streamer has noticed: nothing comes any more, and answers are what they were.
    /// [`recover`](Self::recover) goes on with another device.
    pub fn is_lost(&self) -> bool {
        self.parts.staging.is_lost() || self.parts.readback.is_lost()
    }

    /// Goes on with another device: the same structures under the same names, with new buffers and without pages, which are
    /// read anew; pipelines and groups are the caller's to make anew.
    ///
    /// # Errors
    /// A buffer is larger than the device binds, or an index can't be read any more.
    pub fn recover(self, device: &wgpu::Device, queue: &wgpu::Queue) -> Result<Self, RuntimeError> {
        let Self { mut streamer, selected, .. } = self;
        streamer.restart()?;
        Ok(Self { selected, ..Self::over(device, queue, streamer)? })
    }

    /// Waits until the roots of all structures have come, those of versions that are to take another's place included. For
    /// loading screens and tests.
    ///
    /// # Errors
    /// A root can't be read, or finds no room.
    pub fn wait_ready(&mut self) -> Result<(), RuntimeError> {
        let (mut admitted, mut idle) = (0, 0);
        // What the index says of the roots' children, too.
        while self.streamer.is_settling() || self.streamer.is_loading() {
            self.streamer.wait(Duration::from_millis(100));
            if let Some(failure) = self.streamer.take_failures().into_iter().next() {
                return Err(failure.error.into());
            }
            self.submit(|_, _| ())?;
            let now = self.streamer.stats();
            idle = if now.admitted == admitted && !self.streamer.is_loading() { idle + 1 } else { 0 };
            admitted = now.admitted;
            if idle == ROOTS_IDLE && !self.streamer.residency().roots_resident() {
                return Err(RuntimeError::Roots { resident: now.resident, budget: self.streamer.budget().total });
            }
        }
        Ok(())
    }

    /// Layout of [`bind_group`](Self::bind_group), for the caller's pipelines.
    pub fn bind_group_layout(&self) -> &wgpu::BindGroupLayout {
        &self.layout
    }

    /// Pool, table, feedback and view, for the group that was given to [`shader::module`].
    pub fn bind_group(&self) -> &wgpu::BindGroup {
        &self.parts.group
    }

    /// The buffers of that group by rising binding, for a caller who makes the group from a layout of its own: pool, table,
    /// feedback, view, and what else there is of the pool.
    pub fn buffers(&self) -> Vec<&wgpu::Buffer> {
        let first = [self.parts.pool.bound(0), &self.table, &self.parts.feedback, &self.uniform];
        first.into_iter().chain((1..self.pieces.count).map(|i| self.parts.pool.bound(i))).collect()
    }

    /// Buffers that the pool is bound in.
    pub fn pools(&self) -> u32 {
        self.pieces.count
    }

    /// Source of the queries, to be put in front of the caller's shader; see [`shader::module_over`].
    pub fn module(&self, group: u32) -> String {
        shader::module_over(group, self.pieces.count)
    }

    /// The CPU side.
    pub fn streamer(&self) -> &Streamer {
        &self.streamer
    }

    /// The CPU side: to attach, detach and replace structures, to mark them as stale, to take failures.
    pub fn streamer_mut(&mut self) -> &mut Streamer {
        &mut self.streamer
    }

    /// From the next frame on, receivers for which the index is enough ask for no pages; see [`Streamer::skip`].
    pub fn skip(&mut self, error: Option<u32>) {
        self.streamer.skip(error);
    }

    /// Which structure [`answer`](Self::answer), [`filter`](Self::filter) and the views ask from now on; before, the first one.
    pub fn select(&mut self, id: StructureId) {
        self.selected = Some(id);
    }

    /// The structure that was selected, and its number.
    pub(super) fn selected(&self) -> Result<(&Structure, u32), RuntimeError> {
        let id = self.selected.or_else(|| self.streamer.structures().next()).ok_or(RuntimeError::Gone)?;
        Ok((self.streamer.structure(id).ok_or(RuntimeError::Gone)?, id.index()))
    }

    /// What the last frame was like.
    pub fn frame_stats(&self) -> FrameStats {
        self.streamer.frame_stats()
    }

    /// What the device said last.
    pub fn report(&self) -> Report {
        self.report
    }

    /// First step: takes the feedback that has come back and the pages that have been read; orders others, also such as
    /// the cameras will need if they go on as they came: they stand in `views`, always in the same order.
    pub fn begin(&mut self, views: &[Viewpoint]) {
        let _span = tracing::trace_span!("umbrage.begin").entered();
        // Runs the callbacks of finished work; an error means that nothing is finished.
        let _ = self.device.poll(wgpu::PollType::Poll);
        let (streamer, report) = (&mut self.streamer, &mut self.report);
        while self.parts.readback.take(|words| {
            let [missed, approximate, unlisted, worst] =
                [0, 1, 2, 3].map(|i: usize| words.get(i).copied().unwrap_or(0));
            let slots = words.get(FEEDBACK_HEAD as usize..FEEDBACK_USED as usize).unwrap_or_default();
            let listed = slots.chunks_exact(2).filter(|s| s[0] != 0).map(|s| (s[0] - 1, s[1]));
            let used = words.get(FEEDBACK_USED as usize..).unwrap_or_default();
            streamer.feedback(listed, used, unlisted != 0);
            streamer.answered(approximate, worst);
            *report = Report { number: report.number + 1, missed, approximate, worst_levels: worst };
        }) {}
        self.streamer.begin(views);
        if let Some((maps, stale)) = self.streamer.maps() {
            self.view.tell(&maps, &stale);
            self.queue.write_buffer(&self.uniform, 0, bytemuck::bytes_of(&*self.view));
        }
    }

    /// Second step, before the caller's passes: copies pages and table entries, clears the feedback.
    pub fn record(&mut self, encoder: &mut wgpu::CommandEncoder) {
        let _span = tracing::trace_span!("umbrage.record").entered();
        self.exchange(encoder);
        encoder.clear_buffer(&self.parts.feedback, 0, None);
        if !self.parts.staging.is_free() {
            // The device is behind; what is ready stays ready.
            return;
        }
        let Frame { ops, table } = self.streamer.frame();
        let s = self.streamer.frame_stats();
        tracing::trace!(
            s.frame,
            s.wanted,
            s.resident,
            s.admitted,
            s.evicted,
            s.starved,
            s.failing,
            s.uploaded_bytes,
            s.by_ancestors,
            s.worst_levels,
            "umbrage.frame"
        );
        if ops.is_empty() && table.is_empty() {
            return;
        }
        let mut parts: Vec<&[u8]> = Vec::new();
        for op in &ops {
            if let Op::Upload { words, .. } = op {
                parts.push(bytemuck::cast_slice(words));
            }
        }
        let entries: Vec<TableEntry> = table.iter().map(|t| t.1).collect();
        parts.push(bytemuck::cast_slice(&entries));
        let recorded = self.parts.staging.pass(encoder, &parts, |encoder, staging, offsets| {
            let mut offsets = offsets.iter().copied();
            for op in &ops {
                match op {
                    Op::Upload { at, words } => {
                        let (from, bytes) = (offsets.next().unwrap_or(0), words.len() as u64 * 4);
                        let (to, at) = self.parts.pool.place(*at);
                        encoder.copy_buffer_to_buffer(staging, from, to, at, bytes);
                    }
                    Op::Move { from, to, words } => {
                        let bytes = u64::from(*words) * 4;
                        let [(source, from), (target, to)] = [*from, *to].map(|at| self.parts.pool.place(at));
                        encoder.copy_buffer_to_buffer(source, from, &self.scratch, 0, bytes);
                        encoder.copy_buffer_to_buffer(&self.scratch, 0, target, to, bytes);
                    }
                }
            }
            let mut from = offsets.next().unwrap_or(0);
            for run in table.chunk_by(|a, b| a.0 + 1 == b.0) {
                let each = size_of::<TableEntry>() as u64;
                let (to, bytes) = (u64::from(run[0].0) * each, run.len() as u64 * each);
                encoder.copy_buffer_to_buffer(staging, from, &self.table, to, bytes);
                from += bytes;
            }
        });
        debug_assert!(recorded, "a frame is never larger than a staging buffer");
    }

    /// Makes the buffers of a new budget and copies the pool.
    fn exchange(&mut self, encoder: &mut wgpu::CommandEncoder) {
        let Some(budget) = self.streamer.exchange() else { return };
        let parts = Parts::new(&self.device, &self.layout, &budget, &self.pieces, [&self.table, &self.uniform]);
        // No larger than the device binds: the budget was divided for it.
        let Ok(parts) = parts else { return };
        self.parts.pool.copy_to(&parts.pool, encoder);
        self.parts = Parts { number: self.parts.number + 1, ..parts };
        self.measure();
    }

    /// Last step, behind the caller's passes: sends the feedback on its way.
    pub fn end(&mut self, encoder: &mut wgpu::CommandEncoder) {
        let _span = tracing::trace_span!("umbrage.end").entered();
        self.parts.readback.record(encoder, &self.parts.feedback);
    }

    /// One frame from `begin` to the end of the device's work. For tools and tests: it waits.
    pub(super) fn submit(&mut self, passes: impl FnOnce(&Self, &mut wgpu::CommandEncoder)) -> Result<(), RuntimeError> {
        self.begin(&[]);
        let mut encoder = self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        self.record(&mut encoder);
        passes(self, &mut encoder);
        self.end(&mut encoder);
        self.queue.submit([encoder.finish()]);
        self.wait()
    }

    fn wait(&self) -> Result<(), RuntimeError> {
        let done = self.device.poll(wgpu::PollType::wait_indefinitely());
        done.map(drop).map_err(|e| RuntimeError::Device { reason: e.to_string() })
    }

    /// The runtime's own pipelines, compiled at the first call.
    ///
    /// # Errors
    /// The structure is of a kind without kernels.
    pub fn kernels(&mut self) -> Result<Arc<Kernels>, RuntimeError> {
        let kind = self.selected()?.0.kind();
        if !kind.has_layout() {
            return Err(RuntimeError::UnsupportedKind(kind));
        }
        let kernels =
            self.kernels.get_or_insert_with(|| Arc::new(Kernels::new(&self.device, &self.layout, self.pieces.count)));
        Ok(kernels.clone())
    }

    /// Uses the pipelines of another streamer on the same device, so that several lights compile them once; its own where that
    /// one's pool lies in another number of buffers.
    pub fn use_kernels(&mut self, kernels: Arc<Kernels>) {
        self.kernels = Some(kernels).filter(|k| k.pools() == self.pieces.count);
    }

    /// Answers queries (x, y, level, depth rounded up) from what is resident, in one frame: value, state, missing
    /// page, page of the answer; see [`crate::query::pool`] for the bits. Waits for the device, not for pages.
    ///
    /// # Errors
    /// More queries than the device binds, a kind without kernels, or the device was lost.
    pub fn answer(&mut self, root: u32, queries: &[[u32; 4]]) -> Result<Vec<[u32; 4]>, RuntimeError> {
        let count = u32::try_from(queries.len()).unwrap_or(u32::MAX);
        let (_, number) = self.selected()?;
        let words = self.with_kernels(|this, kernels| {
            let array = kernels.queries(&this.device, queries)?;
            this.submit(|this, encoder| {
                kernels.dispatch(
                    &this.queue,
                    encoder,
                    &this.parts.group,
                    Entry::Answer,
                    &array,
                    [root, number],
                    0..count,
                );
            })?;
            this.read(&array.buffer, 0, queries.len() as u64 * 16)
        })?;
        Ok(bytemuck::cast_slice(&words).to_vec())
    }

    /// Filters queries by what is resident, in one frame: a state for each, see
    /// [`Pool::filter`](crate::query::Pool::filter). Waits for the device, not for pages.
    ///
    /// # Errors
    /// As [`answer`](Self::answer).
    pub fn filter(&mut self, root: u32, queries: &[FilterQuery]) -> Result<Vec<u32>, RuntimeError> {
        let count = u32::try_from(queries.len()).unwrap_or(u32::MAX);
        let words: Vec<[u32; 4]> = queries.iter().flat_map(FilterQuery::encode).collect();
        let (_, number) = self.selected()?;
        let words = self.with_kernels(|this, kernels| {
            let array = kernels.queries(&this.device, &words)?;
            this.submit(|this, encoder| {
                kernels.dispatch(
                    &this.queue,
                    encoder,
                    &this.parts.group,
                    Entry::Filtered,
                    &array,
                    [root, number],
                    0..count,
                );
            })?;
            this.read(&array.buffer, 0, queries.len() as u64 * 32)
        })?;
        Ok(words.chunks_exact(8).map(|q| q[3]).collect())
    }

    /// The pool's words and the page table as the device has them. For tools and tests: it waits.
    ///
    /// # Errors
    /// The device was lost.
    pub fn read_back(&self) -> Result<(Vec<u32>, Vec<TableEntry>), RuntimeError> {
        let mut pool = Vec::new();
        for piece in self.parts.pool.pieces() {
            pool.extend(self.read(piece, 0, piece.size())?);
        }
        let table = self.read(&self.table, 0, self.table.size())?;
        Ok((pool, bytemuck::cast_slice(&table).to_vec()))
    }

    /// Bytes of a buffer as words; waits.
    pub(super) fn read(&self, source: &wgpu::Buffer, offset: u64, bytes: u64) -> Result<Vec<u32>, RuntimeError> {
        let lost = |e: String| RuntimeError::Device { reason: e };
        let buffer = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("umbrage read back"),
            size: bytes.max(4),
            usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let mut encoder = self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        encoder.copy_buffer_to_buffer(source, offset, &buffer, 0, bytes);
        self.queue.submit([encoder.finish()]);
        let (send, receive) = std::sync::mpsc::channel();
        buffer.map_async(wgpu::MapMode::Read, .., move |result| {
            // The receiver lives until it has come.
            let _ = send.send(result);
        });
        self.wait()?;
        receive.recv().map_err(|e| lost(e.to_string()))?.map_err(|e| lost(e.to_string()))?;
        let view = buffer.get_mapped_range(..).map_err(|e| lost(e.to_string()))?;
        let words = view.chunks_exact(4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]));
        Ok(words.take((bytes / 4) as usize).collect())
    }

    pub(super) fn with_kernels<T>(
        &mut self,
        f: impl FnOnce(&mut Self, &Kernels) -> Result<T, RuntimeError>,
    ) -> Result<T, RuntimeError> {
        let kernels = self.kernels()?;
        f(self, &kernels)
    }
}
