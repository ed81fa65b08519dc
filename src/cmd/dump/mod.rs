//! `umbrage dump`: what is in a container, by the reader's own checks.
//!
//! `summary`: figures, for people and as JSON; `page`: one page; `draw`: pictures; `mmh`: sharing; `vector`: sections of a
//! page.

mod draw;
mod mmh;
mod page;
mod summary;
mod vector;

use std::path::PathBuf;

use umbrage::reader::query::Map;
use umbrage::render::write_png;

use super::output::line;
use super::{Failure, USAGE, listen, open, structure, whole};

pub use draw::Picture;

/// Arguments of `dump`.
#[derive(clap::Args)]
pub struct Args {
    /// The container, or its address on a web server
    file: PathBuf,
    /// Which light; may be left out where there is only one
    #[arg(long)]
    light: Option<String>,
    /// Show one page of the light
    #[arg(long, value_name = "ID", allow_negative_numbers = true, value_parser = whole::<u32>(0, u32::MAX.into()), conflicts_with = "image")]
    page: Option<u32>,
    /// Draw a level
    #[arg(long, value_name = "OUT.png")]
    image: Option<PathBuf>,
    /// What the picture shows: depth (near is light, uncovered is blue), nodes (density, logarithmic: dark few, light
    /// many) or pages (one colour each)
    #[arg(long, value_enum, default_value = "depth", requires = "image")]
    draw: Picture,
    /// Level of the picture; the finest that fits 1024 x 1024 without it
    #[arg(long, allow_negative_numbers = true, value_parser = whole::<u8>(0, 24), requires = "image")]
    level: Option<u8>,
    /// One JSON object on stdout
    #[arg(long, conflicts_with_all = ["page", "image"])]
    json: bool,
}

/// Largest picture: 2 to this power on a side.
const LARGEST: u8 = 14;

/// Runs the command.
pub fn run(args: Args) -> Result<(), Failure> {
    listen();
    let container = open(&args.file)?;
    if let Some(ordinal) = args.page {
        return page::print(&structure(&container, args.light.as_deref())?, ordinal);
    }
    if let Some(path) = &args.image {
        let s = structure(&container, args.light.as_deref())?;
        let finest = s.lattice().log2_resolution;
        let level = args.level.unwrap_or(finest.saturating_sub(10));
        if level > finest || finest - level > LARGEST {
            let message = format!("--level {level}: expected {} to {finest}", finest.saturating_sub(LARGEST));
            return Err(Failure::new(USAGE, message));
        }
        write_png(path, &draw::picture(&Map::new(s)?, level, args.draw)?)?;
        return line(&path.display().to_string());
    }
    if let Some(name) = &args.light {
        container.structure_named(name)?;
    }
    let summary = summary::of(&container, args.light.as_deref())?;
    if args.json { line(&summary.to_string()) } else { summary::print(&summary) }
}
