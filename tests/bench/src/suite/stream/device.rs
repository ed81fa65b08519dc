//! A device and a disk in memory, on a virtual clock: they carry out what the residency decides, and say what its kernels would.

use std::collections::{HashMap, VecDeque};

use umbrage::reader::{Container, Structure};
use umbrage_runtime::query::Pool;
use umbrage_runtime::query::pool::{ANCESTOR, NONE};
use umbrage_runtime::residency::foresee::{Foresight, Looks, MOST_BOXES, Viewpoint, Way};
use umbrage_runtime::residency::slots::UNIT_WORDS;
use umbrage_runtime::residency::{ABSENT, Budget, Child, Entry, LoadedPage, Op, Residency, Span, Stats};
use umbrage_runtime::stream::{self, loader};

use super::Asked;
use crate::Failure;

/// How fast things are.
#[derive(Clone, Copy, Debug)]
pub struct Rates {
    /// Seconds of a frame.
    pub frame: f64,
    /// Of the source.
    pub bytes_per_second: f64,
    /// Seconds before each read.
    pub latency: f64,
    /// Frames until the device's feedback comes.
    pub feedback_frames: usize,
}

/// What one frame was like.
#[derive(Clone, Copy, Debug, Default)]
pub struct Frame {
    /// Receivers that an ancestor answered.
    pub coarse: u64,
    /// Receivers that nothing answered.
    pub holes: u64,
    /// Bytes of pages and tables, those in flight included.
    pub bytes: u64,
    /// Pages that found no room.
    pub starved: u32,
}

/// Missed pages with their weights, and the used bits.
type Feedback = (HashMap<u32, u32>, Vec<u32>);

/// A page that is being read: when the disk begins, when it has come, and the page.
struct Read {
    begins: f64,
    comes: f64,
    bytes: u64,
    page: LoadedPage,
}

/// Pool, table, disk and clock.
pub struct Device {
    container: Container,
    structure: Structure,
    budget: Budget,
    rates: Rates,
    residency: Residency,
    span: Span,
    foresight: Option<Foresight>,
    before: Option<Viewpoint>,
    looks: Looks,
    words: Vec<u32>,
    table: Vec<Entry>,
    feedback: VecDeque<Feedback>,
    reads: Vec<Read>,
    now: f64,
    idle_at: f64,
    bytes_read: u64,
    pages_read: u64,
    blocks_before: u64,
}

impl Device {
    /// Nothing resident; `bytes` or, where they don't do, the fewest that work.
    pub fn new(container: &Container, bytes: u64, rates: Rates) -> Result<Self, Failure> {
        let structure = &container.structure(0)?;
        let (budget, config) = stream::divide(structure, bytes, 1 << 40)
            .or_else(|e| match e {
                umbrage_runtime::RuntimeError::Budget(b) => stream::divide(structure, b.needed, 1 << 40),
                e => Err(e),
            })
            .map_err(Failure::target)?;
        let record = structure.record();
        let told = |o| structure.page_record(o).map(|r| loader::told(structure, &r));
        let roots: Vec<Child> = (0..record.root_count.get()).map(told).collect::<Result<_, _>>()?;
        let mut residency = Residency::new(config);
        let shared = record.shared_pages.get();
        let span = residency.attach(structure.page_count(), shared, roots.into()).map_err(Failure::target)?;
        let mut this = Self {
            container: container.clone(),
            structure: structure.clone(),
            budget,
            rates,
            residency,
            span,
            foresight: Foresight::new(structure.lattice()),
            before: None,
            looks: Looks::default(),
            words: vec![0; (budget.pool() / 4) as usize],
            table: vec![ABSENT; structure.page_count() as usize],
            feedback: VecDeque::new(),
            reads: Vec::new(),
            now: 0.0,
            idle_at: 0.0,
            bytes_read: 0,
            pages_read: 0,
            blocks_before: container.counters().blocks,
        };
        // As the runtime does before its first frame.
        while !this.residency.roots_resident() {
            this.frame(&[], None)?;
        }
        Ok(this)
    }

    /// Bytes that it may hold.
    pub fn budget(&self) -> u64 {
        self.budget.total
    }

    /// Bytes of pages and of blocks of the index read from the source.
    pub fn bytes_read(&self) -> u64 {
        let blocks = self.container.counters().blocks - self.blocks_before;
        self.bytes_read + blocks * self.structure.record().block_bytes()
    }

    /// Pages read.
    pub fn pages_read(&self) -> u64 {
        self.pages_read
    }

    /// Of the residency.
    pub fn stats(&self) -> Stats {
        self.residency.stats()
    }

    /// One frame that asks for these receivers.
    pub fn frame(&mut self, asked: &[Asked], from: Option<(&Viewpoint, f64)>) -> Result<Frame, Failure> {
        self.now += self.rates.frame;
        if self.feedback.len() >= self.rates.feedback_frames
            && let Some((missed, used)) = self.feedback.pop_front()
        {
            let mut missed: Vec<(u32, u32)> = missed.into_iter().collect();
            missed.sort_unstable();
            self.residency.feedback(missed, &used, false);
        }
        if let (Some((from, ahead)), Some(foresight)) = (from, &mut self.foresight)
            && ahead > 0.0
        {
            let (structure, before) = (&self.structure, self.before.replace(*from).unwrap_or(*from));
            let record = |o| structure.page_record(o).ok();
            let way = Way { before: &before, now: from, frames: ahead };
            foresight.look(&way, &mut self.residency, &self.span, &mut self.looks, MOST_BOXES, record);
        }
        self.read()?;
        let frame = self.residency.frame();
        for op in frame.ops {
            match op {
                Op::Upload { at, words } => self.words[at as usize..][..words.len()].copy_from_slice(&words),
                Op::Move { from, to, words } => {
                    self.words.copy_within(from as usize..(from + words) as usize, to as usize);
                }
            }
        }
        for (ordinal, entry) in frame.table {
            self.table[ordinal as usize] = entry;
        }
        Ok(self.ask(asked))
    }

    /// Takes back what nobody wants, orders what is wanted, hands over what has come.
    fn read(&mut self) -> Result<(), Failure> {
        let abandoned: Vec<u32> = self.residency.abandoned().collect();
        for ordinal in abandoned {
            if let Some(at) = self.reads.iter().position(|r| r.page.ordinal == ordinal && r.begins > self.now) {
                self.reads.remove(at);
                self.residency.cancelled(ordinal);
            }
        }
        for ordinal in self.residency.loads() {
            let bytes = self.structure.page_record(ordinal)?.stored_bytes();
            let page = loader::load(&self.structure, 0, ordinal)?;
            let begins = self.idle_at.max(self.now);
            let comes = begins + self.rates.latency + bytes as f64 / self.rates.bytes_per_second;
            self.idle_at = comes;
            self.reads.push(Read { begins, comes, bytes, page });
        }
        // What comes within this frame is there at the next.
        let (done, open): (Vec<Read>, Vec<Read>) = self.reads.drain(..).partition(|r| r.comes <= self.now);
        self.reads = open;
        for read in done {
            self.bytes_read += read.bytes;
            self.pages_read += 1;
            self.residency.loaded(read.page);
        }
        Ok(())
    }

    fn ask(&mut self, asked: &[Asked]) -> Frame {
        let pool = Pool {
            words: &self.words,
            table: &self.table,
            base: 0,
            stale: &[],
            kind: self.structure.kind(),
            log2_resolution: self.structure.record().log2_resolution,
            skips: Some(0),
        };
        let mut frame = Frame::default();
        let mut missed: HashMap<u32, u32> = HashMap::new();
        let mut used = vec![0u32; self.words.len() / (UNIT_WORDS as usize * 32) + 1];
        let roots = self.structure.record().root_count.get();
        for &([x, y], depth, level) in asked {
            let shadow = pool.shadow(0, [x, y], level.into(), depth);
            frame.coarse += u64::from(shadow.state & ANCESTOR != 0);
            // Not even the root was there.
            frame.holes += u64::from(shadow.missing < roots);
            if shadow.missing != NONE {
                let weight = missed.entry(shadow.missing).or_default();
                *weight = weight.saturating_add(shadow.weight(level.into()));
            }
            if let Some(&[at, ..]) = self.table.get(shadow.page as usize)
                && let Some(bits) = used.get_mut((at / UNIT_WORDS / 32) as usize)
            {
                *bits |= 1 << (at / UNIT_WORDS % 32);
            }
        }
        let stats = self.residency.stats();
        let flight: u64 = self.reads.iter().map(|r| r.page.words.len() as u64 * 4).sum();
        // All but the pool and what is on the way is taken whole.
        let fixed = self.budget.used() - self.budget.pool() - self.budget.host;
        frame.bytes = fixed + self.budget.pool() + flight;
        frame.starved = stats.starved;
        self.feedback.push_back((missed, used));
        frame
    }
}
