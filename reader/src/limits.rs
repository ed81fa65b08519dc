//! What a caller lets a file ask for.

use umbrage_format::{FormatError, Place, Rule, Value};

/// Upper bounds; a file that asks for more is refused by a rule `limit.*`. All memory that the reader allocates is
/// bounded by them and by the true length of the file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Records in the section table.
    pub sections: u32,
    /// Structures.
    pub structures: u32,
    /// Pages of one structure.
    pub pages: u32,
    /// Bytes of one page, stored or hot.
    pub page_bytes: u32,
    /// Bytes of one table: section table, structure records, page table of a map, all pages of a preloaded one.
    pub allocation: u64,
}

impl Default for Limits {
    /// Room for every file that the writer makes of the scenes in the plan: 16 M pages, 8 GiB in one table.
    fn default() -> Self {
        Self { sections: 1 << 16, structures: 1 << 14, pages: 1 << 24, page_bytes: 1 << 16, allocation: 8 << 30 }
    }
}

impl Limits {
    /// Refuses `found` above `most` by `rule`.
    ///
    /// # Errors
    /// `rule`, one of `limit.*`.
    pub(crate) fn hold(rule: Rule, place: Place, most: u64, found: u64) -> Result<(), FormatError> {
        if found <= most {
            return Ok(());
        }
        Err(FormatError::new(rule, place, 0, Value::AtMost(most), Value::Number(found)))
    }

    /// Refuses a table of more bytes than the caller allows.
    pub(crate) fn allocate(&self, place: Place, bytes: u64) -> Result<(), FormatError> {
        Self::hold(Rule::LimitAllocation, place, self.allocation.min(isize::MAX as u64), bytes)
    }
}
