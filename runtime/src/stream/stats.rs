//! What a frame was like.

use crate::residency::Stats;

/// One frame in figures. Counts of pages unless they say otherwise.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct FrameStats {
    /// Frames since the start, this one included.
    pub frame: u64,
    /// Wanted and not in the pool: asked for, being read, or without room.
    pub wanted: u32,
    /// In the pool.
    pub resident: u32,
    /// Bytes of these, without what slots leave empty.
    pub resident_bytes: u64,
    /// Came into the pool in this frame.
    pub admitted: u32,
    /// Left it.
    pub evicted: u32,
    /// Went on from a replaced version in their slots.
    pub kept: u32,
    /// Moved within it.
    pub moved: u32,
    /// Found no room.
    pub starved: u32,
    /// Could not be read when they were tried last.
    pub failing: u32,
    /// Being read.
    pub in_flight: u32,
    /// Orders that were taken back.
    pub cancelled: u32,
    /// Bytes of pages that this frame copies to the device.
    pub uploaded_bytes: u64,
    /// Queries that an ancestor answered, in the frame that the device reported last.
    pub by_ancestors: u32,
    /// Worst error on the screen in that frame: levels by which the coarsest answer was above the level asked for. Each
    /// doubles the size of a texel on the screen.
    pub worst_levels: u32,
}

impl FrameStats {
    /// Frame `frame`, between two totals.
    pub(super) fn follow(&mut self, frame: u64, before: &Stats, now: &Stats, in_flight: u64) {
        let count = |b: u64, n: u64| u32::try_from(n - b).unwrap_or(u32::MAX);
        *self = Self {
            frame,
            wanted: now.wanted,
            resident: now.resident,
            resident_bytes: now.resident_words * 4,
            admitted: count(before.admitted, now.admitted),
            evicted: count(before.evicted, now.evicted),
            kept: count(before.kept, now.kept),
            moved: count(before.moved, now.moved),
            starved: now.starved,
            failing: now.failing,
            in_flight: count(0, in_flight),
            cancelled: count(before.cancelled, now.cancelled),
            uploaded_bytes: now.uploaded_bytes - before.uploaded_bytes,
            by_ancestors: self.by_ancestors,
            worst_levels: self.worst_levels,
        };
    }
}
