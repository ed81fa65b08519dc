//! Runs over the map: recursion with shrinking lists of surfaces, proofs for whole squares, exact texels at the end.
//!
//! A square that one proven interval answers is never looked into. Its texels would merge to the same interval or a
//! wider one, because proofs are conservative; that costs up to 0.5 % more nodes on the generated scenes. With [`Options::exhaustive`] every covered texel is asked, which is the baseline that tests hold the
//! early end against.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use crate::interval::proof::Prover;
use crate::interval::ray::Rays;
use crate::interval::texel::{Effort, Scratch, Truth, is_open, level, texel};
use crate::interval::triangle::{Cover, Local, Surface, surfaces};
use crate::interval::{Interval, wide};
use crate::solid::SnappedMesh;

use super::mh::{self, Node};
use super::page::{At, Forest};
use super::spool::Spool;
use super::top;
use crate::container::WriteError;

/// Level of the squares that one thread works through alone.
pub(crate) const TILE_LEVEL: u8 = 8;
/// Longest list of surfaces for which a proof is tried above a single texel.
const PROOF_LIST: usize = 48;

/// How to build.
#[derive(Clone, Copy, Debug, Default)]
pub struct Options {
    /// Ask every texel, also where a whole square is proven.
    pub exhaustive: bool,
    /// Distance that stored values keep from the ends of wide intervals ([`Interval::guarded`]).
    pub guard: u32,
    /// Choose values from above within tiles of 256 x 256 texels ([`top`]), not from below.
    pub top_down: bool,
}

/// What happened.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Texels that no interval is right for everywhere.
    pub edge_texels: u64,
    /// Of those, texels whose centre's stretch holds no lattice depth.
    pub thin_texels: u64,
    /// Texels that were looked at one by one.
    pub texels_evaluated: u64,
    /// How.
    pub effort: Effort,
}

impl Counts {
    /// Counts texels of which this is true.
    pub(crate) fn found(&mut self, truth: &Truth, texels: u64) {
        self.edge_texels += if truth.certified { 0 } else { texels };
        self.thin_texels += if truth.thin { texels } else { 0 };
    }

    pub(crate) fn add(&mut self, o: &Counts) {
        self.edge_texels += o.edge_texels;
        self.thin_texels += o.thin_texels;
        self.texels_evaluated += o.texels_evaluated;
        self.effort.add(&o.effort);
    }
}

/// Seen from other threads while building: how far it is, and whether to stop.
#[derive(Default)]
pub struct Progress {
    /// Texels done, of `resolution^2`.
    pub texels: AtomicU64,
    /// Set to end early.
    pub cancel: AtomicBool,
    /// Most bytes that groups and pages may take; 0: no limit.
    pub budget: AtomicU64,
    groups: AtomicU64,
    pages: AtomicU64,
}

impl Progress {
    /// Bytes that the groups of finished parts and the pages in memory take.
    pub fn held(&self) -> u64 {
        self.groups.load(Ordering::Relaxed) + self.pages.load(Ordering::Relaxed)
    }

    /// Starts the count again, for the next tree; what is held now stays counted in `budget`.
    pub(crate) fn begin(&self, budget: u64) {
        self.budget.store(budget, Ordering::Relaxed);
        self.groups.store(0, Ordering::Relaxed);
        self.pages.store(0, Ordering::Relaxed);
    }

    /// Counts what a finished part holds.
    pub(crate) fn hold(&self, forest: &Forest, spool: &Spool) {
        self.hold_bytes(forest.bytes(), spool);
    }

    /// Counts bytes that a finished part holds, and the pages.
    pub(crate) fn hold_bytes(&self, bytes: u64, spool: &Spool) {
        self.take(bytes);
        self.pages.store(spool.held(), Ordering::Relaxed);
    }

    /// Counts bytes in use.
    pub(crate) fn take(&self, bytes: u64) {
        self.groups.fetch_add(bytes, Ordering::Relaxed);
    }

    /// Takes back what parts held that went into another.
    pub(crate) fn release(&self, bytes: u64) {
        self.groups.fetch_sub(bytes, Ordering::Relaxed);
    }

    pub(crate) fn over_budget(&self) -> bool {
        let budget = self.budget.load(Ordering::Relaxed);
        budget != 0 && self.held() > budget
    }
}

/// A finished tree.
#[derive(Debug)]
pub struct Tree {
    /// Its pages.
    pub spool: Spool,
    /// Number of the root page.
    pub root: u32,
    /// What happened.
    pub counts: Counts,
}

/// Why there is no tree.
#[derive(Debug)]
pub enum Stop {
    /// [`Progress::cancel`] was set.
    Cancelled,
    /// [`Progress::budget`] does not suffice.
    Budget,
    /// Pages could not be put aside.
    Spool(WriteError),
}

struct Context<'a> {
    surfaces: &'a [Surface],
    subtexel_bits: u8,
    resolution_log2: u8,
    second_surface: bool,
    exhaustive: bool,
    guard: u32,
    top_down: bool,
    hold: Hold<'a>,
    progress: &'a Progress,
}

/// What becomes of groups while a tree is built.
#[derive(Clone, Copy)]
pub(crate) enum Hold<'a> {
    /// They are cut into pages as soon as there are enough of them.
    Pages(&'a Spool),
    /// They stay, with the intervals of their values.
    Whole,
}

impl Hold<'_> {
    fn failed(self) -> bool {
        matches!(self, Hold::Pages(spool) if spool.has_failed())
    }

    /// Counts what a finished part holds.
    fn count(self, forest: &Forest, progress: &Progress) {
        match self {
            Hold::Pages(spool) => progress.hold(forest, spool),
            Hold::Whole => progress.take(forest.bytes()),
        }
    }
}

pub(crate) struct Part {
    pub(crate) forest: Forest,
    pub(crate) node: Node,
    pub(crate) counts: Counts,
}

/// Builds the `mh` tree of a mesh; its pages go to `spool`. The answer does not depend on the number of threads.
///
/// # Errors
/// [`Stop`]: cancelled, over the budget, or the spool failed.
pub fn build(mesh: &SnappedMesh, options: Options, spool: Spool, progress: &Progress) -> Result<Tree, Stop> {
    let part = run(mesh, options, Hold::Pages(&spool), progress);
    let part = part.map(|p| (p.forest.finish(p.node, mesh.lattice.log2_resolution, &spool), p.counts));
    match (spool.failed(), part) {
        (Some(e), _) => Err(Stop::Spool(e)),
        (None, Some((root, counts))) => Ok(Tree { spool, root, counts }),
        (None, None) => Err(stopped(progress)),
    }
}

/// Builds the `mh` tree of a mesh and holds all of it, with the intervals of its values, and its root node.
///
/// # Errors
/// [`Stop`]: cancelled or over the budget.
pub fn build_whole(mesh: &SnappedMesh, options: Options, progress: &Progress) -> Result<(Forest, Node, Counts), Stop> {
    let part = run(mesh, options, Hold::Whole, progress).ok_or_else(|| stopped(progress))?;
    Ok((part.forest, part.node, part.counts))
}

/// Why a build ended early.
pub(crate) fn stopped(progress: &Progress) -> Stop {
    if progress.cancel.load(Ordering::Relaxed) { Stop::Cancelled } else { Stop::Budget }
}

fn run(mesh: &SnappedMesh, options: Options, hold: Hold<'_>, progress: &Progress) -> Option<Part> {
    let surfaces = surfaces(mesh);
    let cx = Context {
        surfaces: &surfaces,
        subtexel_bits: mesh.lattice.subtexel_bits,
        resolution_log2: mesh.lattice.log2_resolution,
        second_surface: mesh.second_surface,
        exhaustive: options.exhaustive,
        guard: options.guard,
        top_down: options.top_down,
        hold,
        progress,
    };
    let all: Vec<u32> = (0..surfaces.len() as u32).collect();
    cx.part(At { level: cx.resolution_log2, origin: [0, 0] }, &all)
}

impl Context<'_> {
    fn cancelled(&self) -> bool {
        self.progress.cancel.load(Ordering::Relaxed) || self.progress.over_budget()
    }

    fn done(&self, level: u8) {
        self.progress.texels.fetch_add(1 << (2 * level), Ordering::Relaxed);
    }

    /// The square of the node at `at`, its four quarters in parallel.
    fn part(&self, at: At, list: &[u32]) -> Option<Part> {
        if self.cancelled() {
            return None;
        }
        if list.is_empty() {
            self.done(at.level);
            let node = Node::uniform(Interval::UNCOVERED);
            return Some(Part { forest: Forest::default(), node, counts: Counts::default() });
        }
        if at.level <= TILE_LEVEL {
            let part = self.tile(at, list);
            if self.cancelled() {
                return None;
            }
            self.hold.count(&part.forest, self.progress);
            if self.hold.failed() {
                return None;
            }
            self.done(at.level);
            return Some(part);
        }
        let quarter = |c: usize| {
            let child = at.child(c);
            let [x, y] = child.origin.map(|o| i64::from(o) << self.subtexel_bits);
            let size = 1i64 << (child.level + self.subtexel_bits);
            let near: Vec<u32> =
                list.iter().copied().filter(|i| self.surfaces[*i as usize].overlaps(x, y, size)).collect();
            self.part(child, &near)
        };
        let ((a, b), (c, d)) =
            rayon::join(|| rayon::join(|| quarter(0), || quarter(1)), || rayon::join(|| quarter(2), || quarter(3)));
        let mut forest = Forest::default();
        let mut counts = Counts::default();
        let mut released = 0;
        let mut take = |p: Part| {
            counts.add(&p.counts);
            released += p.forest.bytes();
            forest.absorb(p.forest, p.node)
        };
        let mut children = [take(a?), take(b?), take(c?), take(d?)];
        let node = self.merge(at, &mut children, &mut forest);
        // what was cut is garbage now
        let node = forest.compact(node);
        self.hold.count(&forest, self.progress);
        self.progress.release(released);
        Some(Part { forest, node, counts })
    }

    fn merge(&self, at: At, children: &mut [Node; 4], forest: &mut Forest) -> Node {
        merge(self.resolution_log2, at, children, forest, self.hold)
    }

    fn tile(&self, at: At, list: &[u32]) -> Part {
        let corner = at.origin.map(|o| i64::from(o) << self.subtexel_bits);
        let size = 1i64 << (at.level + self.subtexel_bits);
        let locals: Vec<Local> =
            list.iter().map(|i| self.surfaces[*i as usize].local(*i, corner[0], corner[1], size)).collect();
        let held = (size_of::<Local>() * locals.capacity()) as u64;
        self.progress.groups.fetch_add(held, Ordering::Relaxed);
        let rays = Rays { surfaces: self.surfaces, locals: &locals, corner, second_surface: self.second_surface };
        let mut tile = Tile {
            cx: self,
            rays,
            forest: Forest::default(),
            stack: (0..locals.len() as u32).collect(),
            scratch: Scratch::default(),
            prover: Prover::default(),
            counts: Counts::default(),
            squares: Vec::new(),
        };
        let node = tile.square(at, 0);
        let node = match self.top_down {
            true => top::build(self.resolution_log2, at, &tile.squares, &mut tile.forest, self.hold),
            false => node,
        };
        let node = tile.forest.compact(node);
        let mut counts = tile.counts;
        counts.effort = tile.scratch.effort;
        self.progress.release(held);
        Part { forest: tile.forest, node, counts }
    }
}

/// Merges and cuts, except near the root, where the complete coarse levels stay together.
pub(crate) fn merge(
    resolution_log2: u8,
    at: At,
    children: &mut [Node; 4],
    forest: &mut Forest,
    hold: Hold<'_>,
) -> Node {
    let node = mh::merge(*children, at.level - 1, &mut forest.groups);
    finish(resolution_log2, at, node, children, forest, hold)
}

/// Cuts below a new node, or keeps the intervals of its children.
pub(crate) fn finish(
    resolution_log2: u8,
    at: At,
    mut node: Node,
    children: &mut [Node; 4],
    forest: &mut Forest,
    hold: Hold<'_>,
) -> Node {
    let depth = resolution_log2 - at.level;
    match hold {
        Hold::Pages(spool) if depth + 1 >= super::page::COARSE_DEPTH => forest.cut(&mut node, at, children, spool),
        Hold::Whole if node.below != mh::NONE => forest.intervals.push(children.map(|c| c.interval)),
        _ => {}
    }
    node
}

struct Tile<'a> {
    cx: &'a Context<'a>,
    rays: Rays<'a>,
    forest: Forest,
    /// Lists of the squares on the way down, one behind the other.
    stack: Vec<u32>,
    scratch: Scratch,
    prover: Prover,
    counts: Counts,
    /// Of a tile that is built from above, the squares that one interval answers.
    squares: Vec<(At, Node)>,
}

impl Tile<'_> {
    /// The square of the node at `at`, whose surfaces stand in the stack from `start`.
    fn square(&mut self, at: At, start: usize) -> Node {
        let bits = self.cx.subtexel_bits;
        let corner = self.rays.corner;
        let p = [0, 1].map(|i| (i64::from(at.origin[i]) << bits) - corner[i]);
        let size = 1i64 << (at.level + bits);
        let list = &self.stack[start..];
        // a cancelled tile is thrown away, so any answer will do
        if is_open(self.rays.locals, list) || self.cx.cancelled() {
            return self.leaf(at, Node::uniform(Interval::UNCOVERED));
        }
        if at.level == 0 {
            self.counts.texels_evaluated += 1;
            let truth = texel(&self.rays, list, p, size, wide(self.cx.guard), &mut self.scratch);
            self.counts.found(&truth, 1);
            return self.leaf(at, Node::guarded(truth.interval, self.cx.guard));
        }
        if !self.cx.exhaustive {
            let few = list.len() <= PROOF_LIST;
            let prove = || self.prover.prove(&self.rays, list, p, size, self.cx.second_surface, false);
            // a narrow proof may be part of a wide interval, whose value keeps the guard
            if let Some(interval) = few.then(prove).flatten().filter(|i| i.width() >= wide(self.cx.guard)) {
                return self.leaf(at, Node::guarded(interval, self.cx.guard));
            }
            let locals = self.rays.locals;
            let over = |k: usize| locals[list[k] as usize].cover(p[0], p[1], size) == Cover::All;
            if let Some(truth) = level(&self.rays, list, over, p, size, &mut self.scratch) {
                self.counts.found(&truth, 1 << (2 * at.level));
                return self.leaf(at, Node::guarded(truth.interval, self.cx.guard));
            }
        }
        let end = self.stack.len();
        let mut children = [Node::uniform(Interval::UNCOVERED); 4];
        for (c, node) in children.iter_mut().enumerate() {
            let child = at.child(c);
            let q = [0, 1].map(|i| (i64::from(child.origin[i]) << bits) - corner[i]);
            for k in start..end {
                let i = self.stack[k];
                if self.rays.locals[i as usize].cover(q[0], q[1], size / 2) != Cover::None {
                    self.stack.push(i);
                }
            }
            *node = self.square(child, end);
            self.stack.truncate(end);
        }
        match self.cx.top_down {
            // All squares below are needed before the first value is chosen.
            true => children[0],
            false => self.cx.merge(at, &mut children, &mut self.forest),
        }
    }

    /// A square that one interval answers.
    fn leaf(&mut self, at: At, node: Node) -> Node {
        if self.cx.top_down {
            self.squares.push((at, node));
        }
        node
    }
}
