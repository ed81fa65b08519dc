//! The suites, one file each: `run(&Args) -> Result<Report, Failure>`.

pub mod accuracy;
pub mod bake;
pub mod check;
pub mod filter;
pub mod levels;
pub mod merge;
pub mod query;
pub mod size;
pub mod stability;
