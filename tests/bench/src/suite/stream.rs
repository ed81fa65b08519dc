//! `stream`: recorded flights over a file, streamed under a byte budget by the residency of the runtime, its CPU twin in the
//! place of the device.
//!
//! The clock is virtual: 60 frames a second, a source of 500 MB/s with a latency, feedback that comes two frames late. Each
//! pixel asks for the level of its footprint. What was read is held against the blocks of 4 KiB that hold nodes which an oracle
//! touched: lookups of all these pixels over the whole file. After the last frame of the flight the camera stands still, and
//! frames are counted until every pixel has the level that it asks for.

mod device;
mod touched;

use std::io::IsTerminal;
use std::path::Path;

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
/// Every so many pixels, across and down, one is asked about unless told otherwise; with `--full` all are.
const STRIDE: u32 = 8;
/// Frames that the camera looks ahead.
const AHEAD: f64 = 20.0;
/// Frames after the camera has stopped.
const STILL: u32 = 30;
/// Frames whose pixels are held in memory at once.
const BATCH: usize = 8;
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
        // A file of kind mh of a million texels a side would be 15 GB.
        let sides = [(Kind::Vector, resolution), (Kind::Mh, resolution.min(1 << 16))];
        // Both kinds have the same lattice where they have the same resolution.
        for same in sides.chunk_by(|a, b| a.1 == b.1) {
            let mut flights = Vec::new();
            let mut last = None;
            for &(kind, resolution) in same {
                let (baked, file) = model.bake_as(kind, LIGHTS[0], resolution, &folder)?;
                flights.push(Flights::new(kind, &file)?);
                last = Some(baked.last);
            }
            if let (Some(baked), Some(first)) = (&last, flights.first()) {
                let view = Views {
                    geometry: &Scene::new(baked),
                    flight: &flight,
                    structure: &first.structure.clone(),
                    stride: args.stride.unwrap_or(if args.full { 1 } else { STRIDE }),
                };
                fly(&view, &mut flights)?;
            }
            for flown in flights {
                told(&mut report, &mut table, name, &flown);
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

/// Where the pixels' questions come from.
struct Views<'a> {
    geometry: &'a Scene<'a>,
    flight: &'a Flight,
    structure: &'a Structure,
    stride: u32,
}

impl Views<'_> {
    /// A camera of the flight, and what its pixels ask for.
    fn seen(&self, frame: u32) -> Result<Seen, Failure> {
        let camera = self.flight.camera(frame).map_err(Failure::input)?;
        Ok((viewpoint(&camera), self.receivers(&camera)))
    }

    /// What the pixels of a picture ask for.
    fn receivers(&self, camera: &Camera) -> Vec<Asked> {
        let [w, h] = PICTURE.map(|n| n / self.stride);
        let Some(view) = self.geometry.view(camera, w, h, &|| true) else { return Vec::new() };
        let of = Footprints::new(&view, self.geometry.surface());
        let lattice = self.structure.lattice();
        // A pixel of the whole picture is narrower than one of this.
        let finer = self.stride.ilog2() << 8;
        let asked = |(i, r): (usize, &Option<umbrage::render::Receiver>)| {
            let r = r.as_ref()?;
            let level = nearest_level(of.level_of_detail(i).saturating_sub(finer));
            Some((r.texel(&lattice), r.depth.query(), level))
        };
        view.receivers.iter().enumerate().filter_map(asked).collect()
    }
}

fn viewpoint(camera: &Camera) -> Viewpoint {
    let [w, h] = PICTURE;
    Viewpoint { eye: camera.eye(), axes: camera.axes(), half: camera.half(w, h), pixels: PICTURE }
}

/// A file's flights under all budgets.
struct Flights {
    kind: Kind,
    structure: Structure,
    file_bytes: u64,
    frames: u32,
    touched: Touched,
    flown: Vec<Flown>,
}

impl Flights {
    fn new(kind: Kind, file: &Path) -> Result<Self, Failure> {
        let structure = scenes::container(file)?.structure(0)?;
        let file_bytes = std::fs::metadata(file).map_or(0, |m| m.len());
        // The parts of a budget that are not pages come on top where all pages shall fit.
        let all = 2 * file_bytes + (8 << 20);
        let flown = [(file_bytes / 10, 0.0), (file_bytes / 10, AHEAD), (all, 0.0), (all, AHEAD)];
        let flown = flown.into_iter().map(|(budget, ahead)| Flown::new(&scenes::container(file)?, budget, ahead));
        let flown = flown.collect::<Result<_, _>>()?;
        Ok(Self { kind, structure, file_bytes, frames: 0, touched: Touched::new(scenes::open(file)?), flown })
    }

    /// The next frame of all.
    fn frame(&mut self, seen: &Seen) -> Result<(), Failure> {
        self.frames += 1;
        let (touched, flown) = (&mut self.touched, &mut self.flown);
        let frame = || flown.par_iter_mut().try_for_each(|f| f.frame(seen));
        let (touched, flown) = rayon::join(|| touched.add(&seen.1), frame);
        touched.and(flown)
    }
}

/// A device on its flight, and what the flight took.
struct Flown {
    device: Device,
    ahead: f64,
    frames: u32,
    most_bytes: u64,
    pixels: u64,
    /// Pixels that an ancestor answered.
    coarse: u64,
    /// Share of them in the worst frame behind the tenth.
    worst: f64,
    holes: u64,
    to_exact: Option<u32>,
    starved: u32,
}

impl Flown {
    fn new(container: &Container, budget: u64, ahead: f64) -> Result<Self, Failure> {
        let device = Device::new(container, budget, RATES)?;
        Ok(Self {
            device,
            ahead,
            frames: 0,
            most_bytes: 0,
            pixels: 0,
            coarse: 0,
            worst: 0.0,
            holes: 0,
            to_exact: None,
            starved: 0,
        })
    }

    fn take(&mut self, (from, asked): &Seen) -> Result<Frame, Failure> {
        let f = self.device.frame(asked, Some((from, self.ahead)))?;
        self.most_bytes = self.most_bytes.max(f.bytes);
        self.holes += f.holes;
        self.starved = self.starved.max(f.starved);
        Ok(f)
    }

    fn frame(&mut self, seen: &Seen) -> Result<(), Failure> {
        let f = self.take(seen)?;
        let pixels = seen.1.len() as u64;
        self.pixels += pixels;
        self.coarse += f.coarse;
        if self.frames >= 10 {
            self.worst = self.worst.max(f.coarse as f64 / pixels.max(1) as f64);
        }
        self.frames += 1;
        Ok(())
    }

    /// The camera has stopped.
    fn stand(&mut self, seen: &Seen) -> Result<(), Failure> {
        for n in 0..STILL {
            if self.take(seen)?.coarse == 0 {
                self.to_exact = Some(n);
                break;
            }
        }
        Ok(())
    }
}

/// All flights, frame by frame: every pixel's question of a whole flight would take gigabytes.
fn fly(views: &Views<'_>, flights: &mut [Flights]) -> Result<(), Failure> {
    let frames: Vec<u32> = (0..views.flight.frames()).collect();
    let mut last = None;
    for (n, batch) in frames.chunks(BATCH).enumerate() {
        progress(n * BATCH, frames.len());
        let seen: Vec<Seen> = batch.par_iter().map(|&n| views.seen(n)).collect::<Result<_, _>>()?;
        for seen in &seen {
            flights.par_iter_mut().try_for_each(|f| f.frame(seen))?;
        }
        last = seen.into_iter().next_back();
    }
    progress(frames.len(), frames.len());
    let Some(last) = last else { return Ok(()) };
    flights.par_iter_mut().try_for_each(|f| f.flown.par_iter_mut().try_for_each(|f| f.stand(&last)))
}

fn progress(done: usize, of: usize) {
    if std::io::stderr().is_terminal() {
        eprint!("\r{}", if done < of { format!("frame {done} of {of}") } else { " ".repeat(30) + "\r" });
    }
}

/// Tells of a file's flights.
fn told(report: &mut Report, table: &mut Table, name: &str, flights: &Flights) {
    let (kind, total) = (flights.kind.name(), flights.file_bytes);
    let resolution = 1u64 << flights.structure.record().log2_resolution;
    let named = format!("{name} {}", side(resolution));
    for f in &flights.flown {
        let (device, ahead) = (&f.device, f.ahead);
        let (read, needed, stats) = (device.bytes_read(), flights.touched.bytes(), device.stats());
        let ratio = read as f64 / needed.max(1) as f64;
        let coarse = f.coarse as f64 / f.pixels.max(1) as f64;
        let exact = f.to_exact.map_or("-".to_string(), |f| f.to_string());
        table.push([
            named.clone(),
            kind.to_string(),
            flights.frames.to_string(),
            bytes(total),
            bytes(device.budget()),
            format!("{ahead}"),
            bytes(read),
            format!("{:.3}", read as f64 / total as f64),
            format!("{ratio:.2}"),
            format!("{} of {}", device.pages_read(), flights.structure.page_count()),
            stats.evicted.to_string(),
            stats.cancelled.to_string(),
            format!("{coarse:.5}"),
            format!("{:.4}", f.worst),
            exact.clone(),
        ]);
        report.rows.push(json!({
            "scene": name, "resolution": resolution, "kind": kind, "frames": flights.frames, "ahead": ahead, "pixels": f.pixels,
            "file_bytes": total, "budget_bytes": device.budget(), "most_bytes": f.most_bytes, "read_bytes": read,
            "touched_bytes": needed, "pages_read": device.pages_read(), "evicted": stats.evicted,
            "cancelled": stats.cancelled, "coarse_share": coarse, "worst_frame_share": f.worst, "holes": f.holes,
            "frames_to_exact": f.to_exact, "starved": f.starved,
        }));
        let what = format!("{named} {kind}, {}, looking {ahead} frames ahead", bytes(device.budget()));
        report.goal(ratio <= 2.0, format!("{what}: at most 2.0 of the touched blocks"), format!("{ratio:.2}"));
        report.goal(f.most_bytes <= device.budget(), format!("{what}: budget kept"), bytes(f.most_bytes));
        report.goal(f.holes == 0, format!("{what}: holes: 0"), f.holes.to_string());
        let asked = format!("{what}: exact 3 frames after the camera stops");
        match f.starved {
            0 => report.goal(f.to_exact.is_some_and(|f| f <= 3), asked, exact),
            starved => report.notes.push(format!("{what}: the view does not fit: {starved} pages found no room")),
        }
    }
}
