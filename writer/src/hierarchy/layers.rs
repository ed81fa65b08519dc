//! Runs over the map of a depth source: tiles of texels are asked for, turned into intervals and merged.
//!
//! In: a [`LatticeLayers`]. Out: the same [`Tree`] as [`build`](super::build) makes of
//! geometry. A square whose texels share an interval becomes one node by the merge alone.

use std::sync::atomic::{AtomicBool, Ordering};

use crate::interval::Interval;
use crate::layers::{LatticeLayers, LayersError, Square, TileBuffer};

use super::build::{Counts, Hold, Part, Progress, TILE_LEVEL, Tree, merge};
use super::mh::Node;
use super::page::{At, Forest};
use super::spool::Spool;
use crate::bake::BakeError;

struct Context<'a> {
    layers: &'a LatticeLayers<'a>,
    resolution_log2: u8,
    guard: u32,
    spool: &'a Spool,
    progress: &'a Progress,
    /// Set when a tile has failed, so that the others end.
    failed: AtomicBool,
}

/// Builds the `mh` tree of a depth source; its pages go to `spool`, and stored values keep `guard` from the ends of wide
/// intervals. The tree does not depend on the number of threads.
///
/// # Errors
/// What the source says, depths that can't be, cancelled or over the budget. Where several tiles fail, which of them is
/// named may differ from run to run.
pub fn build(layers: &LatticeLayers, guard: u32, spool: Spool, progress: &Progress) -> Result<Tree, LayersError> {
    let resolution_log2 = layers.lattice().log2_resolution;
    let cx = Context { layers, resolution_log2, guard, spool: &spool, progress, failed: AtomicBool::new(false) };
    let part = cx.part(At { level: resolution_log2, origin: [0, 0] });
    let made = part.map(|p| (p.forest.finish(p.node, resolution_log2, &spool), p.counts));
    if let Some(e) = spool.failed() {
        return Err(BakeError::Write(e).into());
    }
    let (root, mut counts) = made?;
    // No texel is right beyond its centre as far as anyone knows.
    counts.edge_texels = 1 << (2 * resolution_log2);
    counts.texels_evaluated = counts.edge_texels;
    Ok(Tree { spool, root, counts })
}

impl Context<'_> {
    fn check(&self) -> Result<(), LayersError> {
        let cancelled = self.progress.cancel.load(Ordering::Relaxed) || self.failed.load(Ordering::Relaxed);
        if cancelled || self.progress.over_budget() || self.spool.has_failed() {
            Err(LayersError::Stopped)
        } else {
            Ok(())
        }
    }

    /// The square of the node at `at`, its four quarters in parallel.
    fn part(&self, at: At) -> Result<Part, LayersError> {
        if at.level <= TILE_LEVEL {
            self.check()?;
            let part = self.tile(at).inspect_err(|_| self.failed.store(true, Ordering::Relaxed))?;
            self.progress.hold(&part.forest, self.spool);
            self.progress.texels.fetch_add(1 << (2 * at.level), Ordering::Relaxed);
            self.check()?;
            return Ok(part);
        }
        let quarter = |c: usize| self.part(at.child(c));
        let ((a, b), (c, d)) =
            rayon::join(|| rayon::join(|| quarter(0), || quarter(1)), || rayon::join(|| quarter(2), || quarter(3)));
        let mut parts = [a, b, c, d];
        // The quarter that failed says why, not those that ended because of it.
        if let Some(i) = parts.iter().position(|p| matches!(p, Err(e) if !matches!(e, LayersError::Stopped))) {
            parts.swap(0, i);
        }
        let mut forest = Forest::default();
        let (mut counts, mut released) = (Counts::default(), 0);
        let mut children = [Node::uniform(Interval::UNCOVERED); 4];
        for (child, part) in children.iter_mut().zip(parts) {
            let part = part?;
            counts.add(&part.counts);
            released += part.forest.bytes();
            *child = forest.absorb(part.forest, part.node);
        }
        let node = merge(self.resolution_log2, at, &mut children, &mut forest, Hold::Pages(self.spool));
        // what was cut is garbage now
        let node = forest.compact(node);
        self.progress.hold(&forest, self.spool);
        self.progress.release(released);
        Ok(Part { forest, node, counts })
    }

    fn tile(&self, at: At) -> Result<Part, LayersError> {
        let mut buffer = TileBuffer::default();
        let square = Square { origin: at.origin, log2_side: at.level };
        let (intervals, thin_texels) = self.layers.intervals(square, &mut buffer)?;
        let mut forest = Forest::default();
        let node = self.square(at, square, intervals, &mut forest);
        let node = forest.compact(node);
        Ok(Part { forest, node, counts: Counts { thin_texels, ..Counts::default() } })
    }

    fn square(&self, at: At, tile: Square, intervals: &[Interval], forest: &mut Forest) -> Node {
        if at.level == 0 {
            let [x, y] = [0, 1].map(|i| (at.origin[i] - tile.origin[i]) as usize);
            return Node::guarded(intervals[y << tile.log2_side | x], self.guard);
        }
        let mut children = [0, 1, 2, 3].map(|c| self.square(at.child(c), tile, intervals, forest));
        merge(self.resolution_log2, at, &mut children, forest, Hold::Pages(self.spool))
    }
}
