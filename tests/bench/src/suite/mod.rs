//! The suites, one file each: `run(&Args) -> Result<Report, Failure>`.

pub mod accuracy;
pub mod bake;
pub mod baselines;
pub mod check;
pub mod cold;
pub mod filter;
pub mod levels;
pub mod merge;
pub mod query;
pub mod report;
pub mod size;
pub mod skip;
pub mod stability;
pub mod stream;
