//! `cargo bench-umbrage SUITE`: every figure about Umbrage comes from here.
//!
//! A suite takes [`Args`], measures, and gives back a [`report::Report`]: tables for people, rows for JSON, plots.
//!
//! | Room | What is in it |
//! |---|---|
//! | `suite` | one file per suite |
//! | `report` | tables, goals, JSON with machine, commit and command |
//! | `plot` | SVG pictures, the hull of time against error |
//! | `scenes` | meshes, lights, recorded cameras, baked files in a folder that goes away |
//! | `baseline` | other people's methods, from the same intervals |
//! | `depth_map` | the baseline: a plain shadow map of texel-centre depths |
//! | `timing` | interleaved repetitions, medians, spread |
//! | `random` | seeded numbers |
//! | `attack` | inputs made to break the bake, shared with the test suite |
//! | `machine` | processor, memory, commit, peak of a process |
#![forbid(unsafe_code)]

#[allow(dead_code, reason = "of the test suite, which uses the rest")]
#[path = "../../suite/stability/attack/mod.rs"]
mod attack;
mod baseline;
mod depth_map;
mod machine;
mod plot;
mod random;
mod report;
mod scenes;
mod suite;
mod timing;

use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Parser, ValueEnum};

/// Measures Umbrage against its baselines.
#[derive(Clone, Debug, Parser)]
#[command(name = "bench-umbrage", version)]
pub struct Args {
    /// What to measure
    #[arg(value_enum)]
    suite: Suite,
    /// One JSON object on stdout; the tables go to stderr
    #[arg(long)]
    json: bool,
    /// Folder for SVG plots and the tables as Markdown
    #[arg(long, value_name = "DIR")]
    report: Option<PathBuf>,
    /// As far as the plan asks; takes long and much memory
    #[arg(long)]
    full: bool,
    /// Scene instead of the suite's own ones, repeatable: city:SEED, forest:SEED, scan:SEED or a mesh file
    #[arg(long = "scene", value_name = "SCENE")]
    scenes: Vec<String>,
    /// Texels on a side instead of the suite's own ones, repeatable
    #[arg(long = "resolution", value_name = "N")]
    resolutions: Vec<u64>,
    /// For `stream`: every so many pixels across and down is asked about, a power of two; 8, with --full 1
    #[arg(long, value_name = "N", value_parser = stride)]
    stride: Option<u32>,
    /// For `query`: a file of kind vector or mmh of the scene, light 0.4,-0.8,0.3, repeatable; the one of the suite's
    /// resolution is another candidate, and several are compared with each other
    #[arg(long = "vector", value_name = "FILE.umb")]
    vectors: Vec<PathBuf>,
    /// How depth intervals come from geometry: closed, one-sided, thickness:T, second-surface or auto; closed for
    /// generated scenes and auto for files without it
    #[arg(long)]
    policy: Option<umbrage::writer::solid::Policy>,
    /// For `size`: direction in which light travels, instead of 0.4,-0.8,0.3
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = direction)]
    light: Option<[f64; 3]>,
    /// For the suite's own child process
    #[arg(long, hide = true)]
    exhaustive: bool,
}

/// Three finite numbers, not all of them 0.
fn direction(text: &str) -> Result<[f64; 3], String> {
    let numbers: Vec<f64> = text.split(',').filter_map(|v| v.trim().parse().ok()).collect();
    let found: [f64; 3] = numbers.try_into().map_err(|_| "three numbers are wanted: X,Y,Z".to_string())?;
    let fine = found.iter().all(|v| v.is_finite()) && found.iter().any(|v| *v != 0.0);
    if fine { Ok(found) } else { Err("a direction is wanted".to_string()) }
}

/// What can be measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Suite {
    /// Bytes of whole files against uncompressed and zstd-compressed depth maps
    Size,
    /// Bytes, lookup time and error of other people's methods, and of the product's kinds on the same intervals
    Baselines,
    /// The same for three scenes, and how the product's kinds stand; `--full` goes to the largest sides
    Report,
    /// Kind mmh against mh: bytes, seconds, pairs of subtrees, search distances
    Merge,
    /// Seconds, texels evaluated and peak memory of bakes; proofs against the exhaustive builder
    Bake,
    /// Nanoseconds per lookup against plain arrays
    Query,
    /// Percentage-closer filters over one lookup
    Filter,
    /// What coarse levels answer, kind vector against mh, held against the intervals of the finest level
    Levels,
    /// Wrong receivers against ray casting, and those of plain shadow maps at their best bias
    Accuracy,
    /// Inputs made to break the bake, both kinds, against the exact oracle and plain rays
    Stability,
    /// Time of CRCs and structure checks, what opening reads and what memory it takes
    Check,
    /// Cold pages: bytes, and decoding against zstd
    Cold,
    /// Pages that views don't read because the index says enough, and the error that this causes
    Skip,
    /// Recorded flights under a budget: bytes read against those that an oracle touches, frames until all is exact
    Stream,
    /// One bake in a process of its own
    #[value(hide = true)]
    OneBake,
    /// One opening in a process of its own
    #[value(hide = true)]
    OneOpen,
}

fn stride(s: &str) -> Result<u32, String> {
    let fits = |n: &u32| n.is_power_of_two() && *n <= 16;
    s.parse().ok().filter(fits).ok_or_else(|| "expected a power of two from 1 to 16".to_string())
}

/// Why a suite ended, and with which exit code.
#[derive(Debug)]
pub struct Failure {
    code: u8,
    message: String,
}

impl Failure {
    /// Input that can't be read or isn't valid.
    fn input(message: impl ToString) -> Self {
        Failure { code: 3, message: message.to_string() }
    }

    /// A target that can't be written, or not enough memory.
    fn target(message: impl ToString) -> Self {
        Failure { code: 5, message: message.to_string() }
    }
}

impl From<umbrage::reader::ReaderError> for Failure {
    fn from(e: umbrage::reader::ReaderError) -> Self {
        Failure { code: 4, message: e.to_string() }
    }
}

impl From<umbrage::writer::bake::BakeError> for Failure {
    fn from(e: umbrage::writer::bake::BakeError) -> Self {
        use umbrage::writer::bake::BakeError;
        let code = match &e {
            BakeError::Frame(umbrage::writer::frame::FrameError::Bounds(..)) | BakeError::Solid(_) => 3,
            BakeError::Frame(_) | BakeError::Name { .. } => 2,
            _ => 5,
        };
        Failure { code, message: e.to_string() }
    }
}

fn run(args: &Args) -> Result<(), Failure> {
    let report = match args.suite {
        Suite::Size => suite::size::run(args)?,
        Suite::Baselines => suite::baselines::run(args)?,
        Suite::Report => suite::report::run(args)?,
        Suite::Merge => suite::merge::run(args)?,
        Suite::Bake => suite::bake::run(args)?,
        Suite::Query => suite::query::run(args)?,
        Suite::Filter => suite::filter::run(args)?,
        Suite::Levels => suite::levels::run(args)?,
        Suite::Accuracy => suite::accuracy::run(args)?,
        Suite::Stability => suite::stability::run(args)?,
        Suite::Check => suite::check::run(args)?,
        Suite::Cold => suite::cold::run(args)?,
        Suite::Skip => suite::skip::run(args)?,
        Suite::Stream => suite::stream::run(args)?,
        Suite::OneBake => return suite::bake::one(args),
        Suite::OneOpen => return suite::check::one(args),
    };
    report.show(args.json);
    match &args.report {
        Some(folder) => report.draw(folder),
        None => Ok(()),
    }
}

fn main() -> ExitCode {
    match run(&Args::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("bench-umbrage: {}", failure.message);
            ExitCode::from(failure.code)
        }
    }
}
