//! How a budget in bytes is divided before anything is allocated.

use super::slots::{BLOCK_WORDS, UNIT_WORDS};
use crate::shader::{FEEDBACK_USED, TABLE_ENTRY_WORDS};

/// Bytes of a block: the largest page.
pub const BLOCK_BYTES: u64 = BLOCK_WORDS as u64 * 4;
/// Staging buffers in flight.
pub const STAGING_BUFFERS: u64 = 2;
/// Readback buffers in flight.
pub const READBACK_BUFFERS: u64 = 2;
/// Most table entries that change in a frame.
pub const MAX_DIRTY: u64 = 1024;
/// Uniforms and what the driver rounds up.
const FIXED: u64 = 16384;
const _: () = assert!(size_of::<crate::shader::View>() as u64 + 4096 <= FIXED);
/// Bytes of one table entry.
const ENTRY: u64 = TABLE_ENTRY_WORDS as u64 * 4;
/// Share of the budget for one staging buffer; pages in host memory have twice that, as a page that is being read
/// counts as the largest.
const SHARE: u64 = 16;
/// Staging buffers that the pages in host memory may weigh.
const HOST_SHARES: u64 = 2;
/// Most bytes of a staging buffer.
const MOST_SHARE: u64 = 4 << 20;

/// A budget that can't work.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("budget of {budget} bytes: {pages} pages need at least {needed}; raise the budget")]
pub struct BudgetError {
    /// Bytes that were given.
    pub budget: u64,
    /// Fewest bytes that work.
    pub needed: u64,
    /// Pages of the structure.
    pub pages: u32,
}

/// The parts of a budget. All figures are bytes unless they say otherwise; their sum never exceeds `total`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Budget {
    /// What the caller gave.
    pub total: u64,
    /// Page table.
    pub table: u64,
    /// Feedback buffer on the device, and each buffer that it is read back into: pages that were missed, used bits.
    pub feedback: u64,
    /// One staging buffer, table entries included.
    pub staging: u64,
    /// Pages in host memory between loader and staging.
    pub host: u64,
    /// Blocks of the pool.
    pub blocks: u32,
}

impl Budget {
    /// Divides `total` bytes for `pages` pages; the pool takes what is left, at most `most_pool` bytes, and must have
    /// at least `least_blocks` blocks.
    ///
    /// # Errors
    /// The fewest bytes that would do.
    pub fn divide(total: u64, pages: u32, least_blocks: u32, most_pool: u64) -> Result<Self, BudgetError> {
        let least_share = BLOCK_BYTES + MAX_DIRTY * ENTRY;
        let share_of = |total: u64| (total / SHARE).clamp(least_share, MOST_SHARE) & !63;
        let share = share_of(total);
        let table = u64::from(pages.max(1)) * ENTRY;
        let used = |blocks: u64| blocks * u64::from(BLOCK_WORDS / UNIT_WORDS / 32) * 4;
        let list = u64::from(FEEDBACK_USED) * 4;
        // Everything but the blocks, and what a block costs beside itself.
        let rest = |share: u64| {
            FIXED + table + list * (1 + READBACK_BUFFERS) + share * (STAGING_BUFFERS + HOST_SHARES) + BLOCK_BYTES
        };
        let each = BLOCK_BYTES + used(1) * (1 + READBACK_BUFFERS);
        let blocks = total.saturating_sub(rest(share)) / each;
        let blocks = blocks.min(most_pool / BLOCK_BYTES).min(u64::from(u32::MAX / BLOCK_WORDS));
        if blocks < u64::from(least_blocks) {
            // The shares grow with the budget, by less than it grows: this settles.
            let mut needed = 0;
            for _ in 0..64 {
                needed = rest(share_of(needed)) + each * u64::from(least_blocks);
            }
            let needed = needed.max(total + 1);
            return Err(BudgetError { budget: total, needed, pages });
        }
        let feedback = list + used(blocks);
        let blocks = u32::try_from(blocks).unwrap_or(u32::MAX / BLOCK_WORDS);
        Ok(Self { total, table, feedback, staging: share, host: share * HOST_SHARES, blocks })
    }

    /// Bytes of the pool.
    pub fn pool(&self) -> u64 {
        u64::from(self.blocks) * BLOCK_BYTES
    }

    /// Bytes of pages that one frame can upload.
    pub fn frame_bytes(&self) -> u64 {
        self.staging - MAX_DIRTY * ENTRY
    }

    /// Sum of all parts, those in flight counted as often as they exist.
    pub fn used(&self) -> u64 {
        let flight = self.staging * STAGING_BUFFERS + self.feedback * READBACK_BUFFERS;
        FIXED + self.table + self.feedback + flight + self.host + BLOCK_BYTES + self.pool()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_never_exceed_the_whole() {
        for total in (0..400).map(|i| i * 77_777).chain([1 << 30, 7 << 30]) {
            for pages in [0, 1, 31, 5000, 1 << 20] {
                match Budget::divide(total, pages, 2, 1 << 27) {
                    Ok(b) => {
                        assert!(b.used() <= total && b.pool() <= 1 << 27 && b.blocks >= 2, "{b:?}");
                        assert!(b.frame_bytes() >= BLOCK_BYTES && b.host >= BLOCK_BYTES);
                    }
                    Err(e) => {
                        assert!(e.needed > total);
                        assert!(Budget::divide(e.needed, pages, 2, 1 << 27).is_ok(), "{e}");
                    }
                }
            }
        }
    }
}
