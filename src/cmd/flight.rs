//! `umbrage render --flight`: the frames of a recorded flight as pictures, with what each took in a table beside them.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::time::Instant;

use serde_json::json;
use umbrage::reader::query::Map;
use umbrage::reader::{Container, Structure};
use umbrage::render::{Camera, Look, RgbImage, Scene, Shading, coverage, shade, write_png, write_text};
use umbrage::writer::solid::SnappedMesh;

use super::output::{self, line};
use super::shadows::Backend;
use super::{Failure, INPUT, INTERRUPTED, TARGET, USAGE, Watched, go_on, look, open, picture, render};

/// Arguments of a flight.
// every struct would be a group of this name
#[derive(clap::Args)]
#[group(skip)]
pub struct Args {
    /// A recorded flight instead of a camera: `view` records one, README tells its form
    #[arg(long, value_name = "FLIGHT.json")]
    flight: Option<PathBuf>,
    /// Draw each frame of the flight once with what has come, as a game would, instead of waiting for its pages
    #[arg(long)]
    once: bool,
    /// Frames of the flight from FIRST to LAST, from 0, the last one included
    #[arg(long, value_name = "FIRST..LAST", value_parser = parse_frames, allow_hyphen_values = true)]
    frames: Option<[u32; 2]>,
    /// Lay this over the frames of the flight: residency, level, missing, pages, texels
    #[arg(long, value_name = "WHAT", value_parser = parse_overlay)]
    overlay: Option<Overlay>,
}

impl Args {
    /// Refuses what says something of a flight where there is none. The parser can't: it asks for nothing that a camera excludes.
    pub fn none(&self) -> Result<(), Failure> {
        match self.once || self.frames.is_some() || self.overlay.is_some() {
            true => Err(Failure::new(USAGE, "--once, --frames and --overlay are for flights; give one with --flight")),
            false => Ok(()),
        }
    }
}

#[cfg(feature = "gpu")]
type Overlay = umbrage::view::Overlay;
#[cfg(not(feature = "gpu"))]
type Overlay = std::convert::Infallible;

/// Reads the value of `--overlay`.
pub fn parse_overlay(s: &str) -> Result<Overlay, String> {
    #[cfg(feature = "gpu")]
    if let Some(overlay) = Overlay::named(s) {
        return Ok(overlay);
    }
    Err(format!("expected residency, level, missing, pages or texels (drawn on a device), found '{s}'"))
}

fn parse_frames(s: &str) -> Result<[u32; 2], String> {
    let wrong = || format!("expected FIRST..LAST, whole numbers that rise, for example 0..59, found '{s}'");
    let (first, last) = s.split_once("..").ok_or_else(wrong)?;
    let frames = [first, last].map(|n| n.parse::<u32>().ok());
    match frames {
        [Some(first), Some(last)] if first <= last => Ok([first, last]),
        _ => Err(wrong()),
    }
}

/// What a frame took.
#[derive(Clone, Copy, Debug, Default)]
struct Took {
    drawn: u32,
    by_ancestors: u32,
    worst_levels: u32,
    wanted: u32,
    resident: u32,
    resident_bytes: u64,
    admitted: u64,
    evicted: u64,
    starved: u32,
    pages_read: u64,
    uploaded_bytes: u64,
}

/// Who draws.
enum Artist<'a> {
    #[cfg(feature = "gpu")]
    Device(Box<umbrage::view::Stage>, umbrage::view::Style, umbrage::view::Patience),
    Cpu {
        geometry: Box<Scene<'a>>,
        mesh: &'a SnappedMesh,
        map: Box<Map>,
        look: Look,
        container: &'a Container,
    },
}

impl<'a> Artist<'a> {
    /// A device if there is one, else the CPU; and its name.
    fn new(
        args: &render::Args,
        container: &'a Container,
        structure: &Structure,
        mesh: &'a SnappedMesh,
    ) -> Result<(Self, String), Failure> {
        let look = args.look.look(Look::Texel);
        #[cfg(feature = "gpu")]
        let why = {
            let device = if args.backend == Backend::Cpu { None } else { Some(umbrage::runtime::Headless::new()) };
            match device {
                Some(Ok(device)) => {
                    let budget = args.look.budget(container);
                    let stage = umbrage::view::Stage::headless(&device, structure, mesh, budget, args.look.size);
                    let mut stage = Box::new(stage?);
                    stage.shadows_mut().skip(args.look.skips());
                    let style = umbrage::view::Style { look, overlay: args.flight.overlay };
                    let patience = match args.flight.once {
                        true => umbrage::view::Patience::None,
                        false => umbrage::view::Patience::Exact,
                    };
                    return Ok((Artist::Device(stage, style, patience), device.name));
                }
                Some(Err(e)) => Some(e.to_string()),
                None => None,
            }
        };
        #[cfg(not(feature = "gpu"))]
        let why = Some("built without the feature gpu; build with it or use --backend cpu".to_string());
        if args.backend == Backend::Gpu {
            return Err(Failure::new(TARGET, why.unwrap_or_default()));
        }
        if args.flight.overlay.is_some() {
            let code = if why.is_some() { TARGET } else { USAGE };
            let why = why.unwrap_or_else(|| "--backend cpu".into());
            return Err(Failure::new(code, format!("overlays are drawn on a device, and there is none ({why})")));
        }
        let mut map = Map::new(structure.clone())?;
        map.skip(args.look.skips());
        let name = why.map_or_else(|| "the CPU".into(), |why| format!("the CPU ({why})"));
        let geometry = Box::new(Scene::new(mesh));
        Ok((Artist::Cpu { geometry, mesh, map: Box::new(map), look, container }, name))
    }

    fn draw(&mut self, camera: &Camera, [width, height]: [u32; 2]) -> Result<(RgbImage, Took), Failure> {
        match self {
            #[cfg(feature = "gpu")]
            Artist::Device(stage, style, patience) => {
                let of = |stage: &umbrage::view::Stage| {
                    let streamer = stage.shadows().streamer();
                    (streamer.stats(), streamer.loads())
                };
                let (before, loads) = of(stage);
                let still = stage.still(camera, style, *patience, &go_on)?;
                let (now, all) = of(stage);
                let took = Took {
                    drawn: still.drawn,
                    by_ancestors: still.by_ancestors,
                    worst_levels: still.worst_levels,
                    wanted: now.wanted,
                    resident: now.resident,
                    resident_bytes: now.resident_words * 4,
                    admitted: now.admitted - before.admitted,
                    evicted: now.evicted - before.evicted,
                    starved: now.starved,
                    pages_read: all - loads,
                    uploaded_bytes: now.uploaded_bytes - before.uploaded_bytes,
                };
                Ok((still.image, took))
            }
            Artist::Cpu { geometry, mesh, map, look, container } => {
                let before = container.counters().pages;
                let view = geometry.view(camera, width, height, &go_on).ok_or_else(Failure::interrupted)?;
                let lit = match *look {
                    Look::Texel => coverage(&picture::lit_by_map(&view, map, false)?),
                    Look::Place => coverage(&picture::lit_by_map(&view, map, true)?),
                    Look::Filtered(filter) => picture::filtered_by_map(&view, geometry.surface(), map, filter)?,
                };
                let image = shade(&view, &lit, Shading { components: Some(&mesh.solid), haze: None });
                Ok((image, Took { drawn: 1, pages_read: container.counters().pages - before, ..Took::default() }))
            }
        }
    }
}

#[cfg(feature = "gpu")]
impl From<umbrage::view::ViewError> for Failure {
    fn from(e: umbrage::view::ViewError) -> Self {
        use umbrage::runtime::RuntimeError;
        match e {
            umbrage::view::ViewError::Runtime(RuntimeError::Reader(e)) => e.into(),
            umbrage::view::ViewError::Runtime(e @ RuntimeError::UnsupportedKind(_)) => Failure::new(super::REFUSED, e),
            umbrage::view::ViewError::Camera(e) => Failure::new(USAGE, e),
            e @ umbrage::view::ViewError::Size { .. } => Failure::new(USAGE, e),
            e => Failure::new(TARGET, e),
        }
    }
}

/// The frames that were asked for.
fn range(asked: Option<[u32; 2]>, frames: u32) -> Result<Range<u32>, Failure> {
    match asked {
        None => Ok(0..frames),
        Some([_, last]) if last >= frames => {
            let message = format!("--frames: the flight has frames 0..{}, found {last}", frames - 1);
            Err(Failure::new(USAGE, message))
        }
        Some([first, last]) => Ok(first..last + 1),
    }
}

/// Columns of the table.
const COLUMNS: &str = "frame,seconds,drawn,by_ancestors,worst_levels,wanted,resident,resident_bytes,admitted,evicted,starved,pages_read,uploaded_bytes,ms";

/// Writes the rows of frames; those of other frames that are there stay.
fn write_table(path: &Path, mut rows: BTreeMap<u32, String>) -> Result<(), Failure> {
    let before = std::fs::read_to_string(path).unwrap_or_default();
    if let Some(kept) = before.strip_prefix(COLUMNS) {
        for row in kept.lines() {
            if let Some(frame) = row.split(',').next().and_then(|n| n.parse().ok()) {
                rows.entry(frame).or_insert_with(|| row.to_string());
            }
        }
    }
    let rows: String = rows.into_values().map(|row| row + "\n").collect();
    Ok(write_text(path, &format!("{COLUMNS}\n{rows}"))?)
}

/// Draws a flight.
pub fn run(args: &render::Args) -> Result<(), Failure> {
    let start = Instant::now();
    let path = args.flight.flight.as_deref().ok_or_else(|| Failure::new(USAGE, "neither --camera nor --flight"))?;
    args.look.flies()?;
    let flight = look::flight(path)?;
    let range = range(args.flight.frames, flight.frames())?;
    let container = open(&args.file)?;
    let (structure, mesh) = args.look.scene(&container, &args.scene)?;
    let (mut artist, by) = Artist::new(args, &container, &structure, &mesh)?;
    let folder = &args.output;
    std::fs::create_dir_all(folder).map_err(|e| {
        Failure::new(TARGET, format!("{}: {e}; name a folder that can be written with -o", folder.display()))
    })?;
    let watched = Watched::start((range.end - range.start).into());
    let mut rows = BTreeMap::new();
    let (mut all, mut times, mut inexact, mut most_bytes) = (Took::default(), Vec::new(), 0u32, 0);
    let mut done = range.start;
    let mut failed = None;
    for frame in range.clone() {
        let begun = Instant::now();
        let camera = flight.camera(frame).map_err(|e| Failure::new(INPUT, e))?;
        let drawn = match go_on() {
            true => artist.draw(&camera, args.look.size).and_then(|(image, took)| {
                // A frame that a signal cut short is not what it seems.
                if !go_on() {
                    return Err(Failure::interrupted());
                }
                write_png(&folder.join(format!("{frame:05}.png")), &image)?;
                Ok(took)
            }),
            false => Err(Failure::interrupted()),
        };
        let took = match drawn {
            Ok(took) => took,
            Err(failure) => {
                failed = Some(failure);
                break;
            }
        };
        let ms = begun.elapsed().as_secs_f64() * 1e3;
        let row = format!(
            "{frame},{:.4},{},{},{},{},{},{},{},{},{},{},{},{ms:.1}",
            f64::from(frame) / flight.frames_per_second(),
            took.drawn,
            took.by_ancestors,
            took.worst_levels,
            took.wanted,
            took.resident,
            took.resident_bytes,
            took.admitted,
            took.evicted,
            took.starved,
            took.pages_read,
            took.uploaded_bytes,
        );
        rows.insert(frame, row);
        all.drawn += took.drawn;
        all.pages_read += took.pages_read;
        all.uploaded_bytes += took.uploaded_bytes;
        all.evicted += took.evicted;
        all.worst_levels = all.worst_levels.max(took.worst_levels);
        most_bytes = most_bytes.max(took.resident_bytes);
        inexact += u32::from(took.by_ancestors != 0);
        times.push(ms);
        done = frame + 1;
        watched.progress.texels.store((done - range.start).into(), Ordering::Relaxed);
    }
    drop(watched);
    // What is finished stays, and its table with it.
    let written = if rows.is_empty() { Ok(()) } else { write_table(&folder.join("frames.csv"), rows) };
    if let Some(mut failure) = failed {
        if failure.code == INTERRUPTED {
            failure.message = format!(
                "interrupted; {} frames are in {}; --frames {done}..{} goes on from there",
                done - range.start,
                folder.display(),
                range.end - 1
            );
        }
        return Err(failure);
    }
    written?;
    times.sort_by(f64::total_cmp);
    let median = times[times.len() / 2];
    let read = container.counters().bytes;
    let frames = times.len();
    if args.json {
        let report = json!({
            "by": by, "frames": frames, "drawn": all.drawn, "frames_with_ancestors": inexact,
            "worst_levels": all.worst_levels, "pages": structure.page_count(), "pages_read": all.pages_read,
            "bytes_read": read, "uploaded_bytes": all.uploaded_bytes, "evicted": all.evicted,
            "most_resident_bytes": most_bytes, "budget_bytes": args.look.budget(&container),
            "median_ms": median, "seconds": start.elapsed().as_secs_f64(),
        });
        return line(&report.to_string());
    }
    line(&format!(
        "{frames} frame{} by {by}, {median:.0} ms each (median); {} of {} pages read ({} of the file)",
        if frames == 1 { "" } else { "s" },
        all.pages_read,
        structure.page_count(),
        output::bytes(read)
    ))?;
    if all.drawn as usize > frames || inexact > 0 {
        line(&format!(
            "  drawn {} times; ancestors answered in {inexact} of the frames, {} levels too coarse at worst",
            all.drawn, all.worst_levels
        ))?;
    }
    if most_bytes > 0 {
        let [sent, most] = [all.uploaded_bytes, most_bytes].map(output::mib);
        line(&format!("  {sent} to the device, at most {most} there"))?;
    }
    line(&folder.join(format!("{:05}.png", range.end - 1)).display().to_string())
}
