//! `stream`: recorded flights over a file, streamed under a byte budget by the residency of the runtime, its CPU twin in the
//! place of the device.
//!
//! The clock is virtual: 60 frames a second, a source of 500 MB/s with a latency, feedback that comes two frames late. Each
//! pixel asks for the level of its footprint. What was read is held against the blocks of 4 KiB that hold nodes which an oracle
//! touched: lookups of all these pixels over the whole file. After the last frame of the flight the camera stands still, and
//! frames are counted until every pixel has the level that it asks for.

mod device;
mod touched;

use rayon::prelude::*;
use serde_json::json;
use umbrage::format::Kind;
use umbrage::reader::query::filter::nearest_level;
use umbrage::reader::{Container, Structure};
use umbrage::render::{Camera, Flight, Footprints, Scene};
use umbrage_runtime::residency::foresee::Viewpoint;

use crate::report::{Report, Table, bytes, side};
use crate::scenes::{self, Folder, LIGHTS};
use crate::{Args, Failure};
use device::{Device, Frame, Rates};
use touched::Touched;

/// Pictures of the flights.
const PICTURE: [u32; 2] = [1280, 720];
/// Every so many pixels, across and down, one is asked about; with `--full` all are.
const STRIDE: u32 = 8;
/// Frames that the camera looks ahead.
const AHEAD: f64 = 20.0;
/// Frames after the camera has stopped.
const STILL: u32 = 30;
/// Scene, resolution, flight.
const PLAN: [(&str, u64, &str); 2] = [
    ("city:1", 1 << 20, include_str!("../../flights/city.json")),
    ("forest:1", 1 << 16, include_str!("../../flights/forest.json")),
];
const RATES: Rates = Rates { frame: 1.0 / 60.0, bytes_per_second: 500e6, latency: 100e-6, feedback_frames: 2 };

/// A receiver of a frame: texel, depth rounded up, level.
pub type Asked = ([u32; 2], u32, u8);

/// A camera, and what its pixels ask for.
type Seen = (Viewpoint, Vec<Asked>);

/// Runs the suite.
///
/// # Errors
/// A scene that can't be read or baked, a file that can't be read, or a budget that does not do.
pub fn run(args: &Args) -> Result<Report, Failure> {
    let mut report = Report::new("stream");
    let folder = Folder::new()?;
    let mut table = Table::new(
        "flights of 1280 x 720 under budgets of a tenth of the file, or the least that works, and of all of it",
        &[
            "scene",
            "kind",
            "frames",
            "file",
            "budget",
            "ahead",
            "read",
            "of the file",
            "of touched",
            "pages",
            "evicted",
            "cancelled",
            "coarse",
            "worst frame",
            "frames to exact",
        ],
    );
    for (name, planned, json) in PLAN {
        if !args.scenes.is_empty() && !args.scenes.iter().any(|s| s == name) {
            continue;
        }
        let own = if args.full { planned } else { 1 << 14 };
        let resolution = args.resolutions.first().copied().unwrap_or(own);
        let flight = Flight::parse(json).map_err(Failure::input)?;
        let model = scenes::load(name, args.policy)?;
        // Both kinds have the same lattice where they have the same resolution.
        let mut seen: Option<(u64, Vec<Seen>)> = None;
        for kind in [Kind::Vector, Kind::Mh] {
            // A file of kind mh of a million texels a side would be 15 GB.
            let resolution = if kind == Kind::Mh { resolution.min(1 << 16) } else { resolution };
            let (baked, file) = model.bake_as(kind, LIGHTS[0], resolution, &folder)?;
            let container = scenes::container(&file)?;
            let structure = container.structure(0)?;
            let geometry = Scene::new(&baked.last);
            let stride = if args.full { 1 } else { STRIDE };
            if seen.as_ref().is_none_or(|s| s.0 != resolution) {
                let frame = |n| {
                    let camera = flight.camera(n).map_err(Failure::input)?;
                    Ok((viewpoint(&camera), receivers(&geometry, &camera, stride, &structure)))
                };
                let frames: Result<_, Failure> = (0..flight.frames()).into_par_iter().map(frame).collect();
                seen = Some((resolution, frames?));
            }
            let frames = seen.as_ref().map_or(&[][..], |s| &s.1);
            let mut touched = Touched::new(scenes::open(&file)?);
            for (_, asked) in frames {
                touched.add(asked)?;
            }
            let total = std::fs::metadata(&file).map_or(0, |m| m.len());
            // The parts of a budget that are not pages come on top where all pages shall fit.
            for (part, ahead) in
                [(total / 10, 0.0), (total / 10, AHEAD), (2 * total + (8 << 20), 0.0), (2 * total + (8 << 20), AHEAD)]
            {
                let row = fly(&scenes::container(&file)?, frames, part, ahead)?;
                let (read, needed) = (row.bytes_read, touched.bytes());
                let ratio = read as f64 / needed.max(1) as f64;
                let exact = row.to_exact.map_or("-".to_string(), |f| f.to_string());
                table.push([
                    format!("{name} {}", side(resolution)),
                    kind.name().to_string(),
                    frames.len().to_string(),
                    bytes(total),
                    bytes(row.budget),
                    format!("{ahead}"),
                    bytes(read),
                    format!("{:.3}", read as f64 / total as f64),
                    format!("{ratio:.2}"),
                    format!("{} of {}", row.pages, structure.page_count()),
                    row.evicted.to_string(),
                    row.cancelled.to_string(),
                    format!("{:.5}", row.coarse),
                    format!("{:.4}", row.worst),
                    exact.clone(),
                ]);
                report.rows.push(json!({
                    "scene": name, "resolution": resolution, "kind": kind.name(), "frames": frames.len(), "ahead": ahead,
                    "file_bytes": total, "budget_bytes": row.budget, "most_bytes": row.most_bytes, "read_bytes": read,
                    "touched_bytes": needed, "pages_read": row.pages, "evicted": row.evicted, "cancelled": row.cancelled,
                    "coarse_share": row.coarse, "worst_frame_share": row.worst, "holes": row.holes,
                    "frames_to_exact": row.to_exact, "starved": row.starved,
                }));
                let what = format!(
                    "{name} {} {}, {}, looking {ahead} frames ahead",
                    side(resolution),
                    kind.name(),
                    bytes(row.budget)
                );
                report.goal(ratio <= 2.0, format!("{what}: at most 2.0 of the touched blocks"), format!("{ratio:.2}"));
                report.goal(row.most_bytes <= row.budget, format!("{what}: budget kept"), bytes(row.most_bytes));
                report.goal(row.holes == 0, format!("{what}: holes: 0"), row.holes.to_string());
                let asked = format!("{what}: exact 3 frames after the camera stops");
                match row.starved {
                    0 => report.goal(row.to_exact.is_some_and(|f| f <= 3), asked, exact),
                    starved => {
                        report.notes.push(format!("{what}: the view does not fit: {starved} pages found no room"))
                    }
                }
            }
        }
    }
    report.tables.push(table);
    report.notes.push(
        "coarse: share of the pixels of all frames that an ancestor answered; worst frame: the same of the worst one, \
         but for the first ten"
            .to_string(),
    );
    Ok(report)
}

/// What the pixels of a picture ask for.
fn receivers(geometry: &Scene<'_>, camera: &Camera, stride: u32, structure: &Structure) -> Vec<Asked> {
    let [w, h] = PICTURE.map(|n| n / stride);
    let Some(view) = geometry.view(camera, w, h, &|| true) else { return Vec::new() };
    let of = Footprints::new(&view, geometry.surface());
    let lattice = structure.lattice();
    // A pixel of the whole picture is narrower than one of this.
    let finer = stride.ilog2() << 8;
    let asked = |(i, r): (usize, &Option<umbrage::render::Receiver>)| {
        let r = r.as_ref()?;
        let level = nearest_level(of.level_of_detail(i).saturating_sub(finer));
        Some((r.texel(&lattice), r.depth.query(), level))
    };
    view.receivers.iter().enumerate().filter_map(asked).collect()
}

fn viewpoint(camera: &Camera) -> Viewpoint {
    let [w, h] = PICTURE;
    Viewpoint { eye: camera.eye(), axes: camera.axes(), half: camera.half(w, h), pixels: PICTURE }
}

/// What a flight took.
#[derive(Debug, Default)]
struct Flown {
    budget: u64,
    most_bytes: u64,
    bytes_read: u64,
    pages: u64,
    evicted: u64,
    cancelled: u64,
    /// Share of the pixels that an ancestor answered, over the flight and in the worst frame behind the tenth.
    coarse: f64,
    worst: f64,
    holes: u64,
    to_exact: Option<u32>,
    starved: u32,
}

fn fly(container: &Container, frames: &[Seen], budget: u64, ahead: f64) -> Result<Flown, Failure> {
    let mut device = Device::new(container, budget, RATES)?;
    let mut flown = Flown { budget: device.budget(), ..Flown::default() };
    let (mut pixels, mut coarse) = (0u64, 0u64);
    let take = |flown: &mut Flown, f: &Frame| {
        flown.most_bytes = flown.most_bytes.max(f.bytes);
        flown.holes += f.holes;
        flown.starved = flown.starved.max(f.starved);
    };
    for (n, (from, asked)) in frames.iter().enumerate() {
        let f = device.frame(asked, Some((from, ahead)))?;
        take(&mut flown, &f);
        pixels += asked.len() as u64;
        coarse += f.coarse;
        if n >= 10 {
            flown.worst = flown.worst.max(f.coarse as f64 / asked.len().max(1) as f64);
        }
    }
    if let Some((from, asked)) = frames.last() {
        for n in 0..STILL {
            let f = device.frame(asked, Some((from, ahead)))?;
            take(&mut flown, &f);
            if f.coarse == 0 {
                flown.to_exact = Some(n);
                break;
            }
        }
    }
    flown.coarse = coarse as f64 / pixels.max(1) as f64;
    let stats = device.stats();
    (flown.evicted, flown.cancelled) = (stats.evicted, stats.cancelled);
    (flown.bytes_read, flown.pages) = (device.bytes_read(), device.pages_read());
    Ok(flown)
}
