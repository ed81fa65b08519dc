//! `umbrage verify`: every rule of the format, and with the source every stored value and the pages' stop errors.

use std::path::PathBuf;
use std::sync::atomic::Ordering;

use rayon::prelude::*;
use serde_json::{Value, json};
use umbrage::certify::place::{self, SpotTally};
use umbrage::certify::sample::{self, Borders};
use umbrage::certify::stop::{StopFault, StopTally, Stops};
use umbrage::certify::{Oracle, Region, Tally};
use umbrage::format::Kind;
use umbrage::reader::query::{Map, Resident};
use umbrage::reader::{ReaderError, Structure, VerifySummary};
use umbrage::writer::mesh::Mesh;

use super::output::line;
use super::{Failure, INPUT, USAGE, Watched, go_on, layers, listen, load_scene, open, picture};

/// Arguments of `verify`.
#[derive(clap::Args)]
pub struct Args {
    /// The container, or its address on a web server
    file: PathBuf,
    /// Only this light
    #[arg(long)]
    light: Option<String>,
    /// The scene or the .exr file it was baked from: proves that every stored value is right, and holds the errors that
    /// pages promise for answers without them
    #[arg(long, value_name = "SCENE")]
    source: Option<String>,
    /// Check this many texels instead of all: half in random squares, half near edges of triangles and borders of leaves
    /// and pages
    #[arg(long, value_name = "N", requires = "source", allow_negative_numbers = true,
          value_parser = clap::value_parser!(u64).range(1..))]
    sample: Option<u64>,
    #[command(flatten)]
    layers: layers::LayerArgs,
    /// One JSON object on stdout
    #[arg(long)]
    json: bool,
}

/// Exit code: faults were found.
const FAULTS: u8 = 1;
/// Faults told one by one; all are counted.
const TOLD: usize = 100;

/// What was found.
#[derive(Default)]
struct Findings {
    /// The first faults, for people and for programs.
    told: Vec<(String, Value)>,
    faults: u64,
    summary: VerifySummary,
    structures: u32,
    /// The source was given and not looked at, because the file itself has faults.
    source_skipped: bool,
    promises: Vec<(String, &'static str)>,
    texels: u64,
    near: u64,
    violations: u64,
    stops: StopTally,
    spots: SpotTally,
    lights: Vec<Value>,
    /// What ended the command early.
    error: Option<Value>,
}

impl Findings {
    fn fault(&mut self, text: String, record: Value) {
        self.faults += 1;
        if self.told.len() < TOLD {
            self.told.push((text, record));
        }
    }

    fn broken(&mut self, e: &ReaderError) {
        self.fault(e.to_string(), record(e));
    }

    /// Holds what a light's record counts, edge and thin texels, against the source. In kind `vector` the number of edge
    /// texels is an estimate, and thin ones are counted where texels are looked at one by one.
    fn counts(&mut self, name: &str, kind: Kind, edge: [u64; 2], thin: [u64; 2]) {
        let (edges, thins) = (edge[1], thin[1]);
        let (edges, thins) = match kind {
            Kind::Vector => (0..=u64::MAX, 0..=thins),
            _ => (edges..=edges, thins..=thins),
        };
        for (what, [stored, found], allowed) in [("edge", edge, edges), ("thin", thin, thins)] {
            if allowed.contains(&stored) {
                continue;
            }
            let text = format!("light '{name}': the file counts {stored} {what} texels, the source has {found}");
            let record = json!({
                "rule": null, "section": name, "offset": null, "expected": found, "found": stored, "message": text,
            });
            self.fault(text, record);
        }
    }

    fn ok(&self) -> bool {
        self.faults == 0
            && self.violations == 0
            && self.stops.wrong == 0
            && self.spots.wrong == 0
            && self.error.is_none()
    }

    fn json(&self) -> Value {
        let s = &self.summary;
        json!({
            "ok": self.ok(),
            "errors": self.told.iter().map(|t| &t.1).collect::<Vec<_>>(),
            "counts": {
                "errors": self.faults, "structures": self.structures, "index_blocks": s.blocks, "pages": s.pages,
                "pages_of_unsupported_kinds": s.unsupported,
            },
            "source_skipped": self.source_skipped,
            "texels_checked": self.texels,
            "texels_near_borders": self.near,
            "violations": self.violations,
            "stop_errors": stop_counts(&self.stops),
            "continuous": { "places": self.spots.places, "proven": self.spots.proven, "violations": self.spots.wrong },
            "promises": self.promises.iter().map(|(n, p)| (n.clone(), json!(p))).collect::<serde_json::Map<_, _>>(),
            "lights": self.lights,
            "error": self.error,
        })
    }
}

/// Stop errors for programs; a pair is a texel and a page on the way to it.
fn stop_counts(t: &StopTally) -> Value {
    json!({ "pairs": t.pairs, "held_exactly": t.exact, "passed_over": t.passed, "violations": t.wrong })
}

/// Continuous lookups of one light, for programs; nothing where its kind has none.
fn spot_counts(t: &SpotTally, kind: Kind) -> Value {
    if kind != Kind::Vector {
        return Value::Null;
    }
    let example = |e: &place::SpotFault| {
        let [x, y] = e.spot.at.map(|v| v as f64 / 256.0);
        json!({ "x": x, "y": y, "answer": e.answer })
    };
    json!({
        "places": t.places, "proven": t.proven, "violations": t.wrong, "proven_share": t.share(),
        "examples": t.examples.iter().map(example).collect::<Vec<_>>(),
    })
}

/// A stop error that is too small, for programs.
fn stop_example(e: &StopFault) -> Value {
    json!({
        "page": e.stop.page, "x": e.texel[0], "y": e.texel[1], "answer": e.answer, "stop_error": e.stop.error,
        "min": e.allowed.min, "max": e.allowed.max,
    })
}

/// A fault for programs: which rule, where, what was expected and found.
fn record(e: &ReaderError) -> Value {
    match e {
        ReaderError::Format { error, .. } => json!({
            "rule": error.rule.id(), "section": error.place.to_string(), "offset": error.offset,
            "expected": error.expected.to_string(), "found": error.found.to_string(), "message": e.to_string(),
        }),
        e => json!({
            "rule": null, "section": null, "offset": null, "expected": null, "found": null, "message": e.to_string(),
        }),
    }
}

/// Runs the command.
pub fn run(args: Args) -> Result<(), Failure> {
    listen();
    let mut f = Findings::default();
    let looked = look(&args, &mut f);
    if args.json {
        // a program that asked for JSON gets what is known also where something failed later
        f.error = looked.as_ref().err().map(|e| json!({ "exit_code": e.code, "message": e.message }));
        line(&f.json().to_string())?;
    }
    looked?;
    if !args.json {
        tell(&f)?;
    }
    if f.ok() { Ok(()) } else { Err(Failure::new(FAULTS, format!("{}: faults found", args.file.display()))) }
}

fn look(args: &Args, f: &mut Findings) -> Result<(), Failure> {
    let container = open(&args.file).inspect_err(|e| f.broken(e))?;
    f.structures = container.structure_count();
    f.promises = container.structures().map(|s| (s.name().to_string(), s.record().guarantee_words())).collect();
    let watched = Watched::start(container.structures().map(|s| u64::from(s.page_count())).sum());
    let summary = container.verify_while(
        |fault| f.broken(&fault),
        |pages| {
            watched.progress.texels.store(pages, Ordering::Relaxed);
            go_on()
        },
    );
    f.summary = summary;
    drop(watched);
    if !go_on() {
        return Err(Failure::interrupted());
    }
    if let Some(name) = &args.light {
        container.structure_named(name)?;
    }
    let from_layers = args.source.as_deref().is_some_and(layers::are);
    if let (Some(option), false) = (args.layers.given(), from_layers) {
        return Err(Failure::new(USAGE, format!("{option} is for depth layers; give their .exr file with --source")));
    }
    f.source_skipped = args.source.is_some() && f.faults > 0;
    let (Some(source), 0) = (&args.source, f.faults) else { return Ok(()) };
    let chosen = || container.structures().filter(|s| args.light.as_deref().is_none_or(|n| n == s.name()));
    if from_layers && chosen().count() > 1 {
        let message = "depth layers are of one light; say with --light which one they are";
        return Err(Failure::new(USAGE, message));
    }
    if from_layers {
        return chosen().try_for_each(|s| certify_layers(s, source, args, f));
    }
    if let Some(s) = chosen().find(|s| s.record().is_from_layers()) {
        let message = format!("light '{}' was baked from depth layers; give their .exr file with --source", s.name());
        return Err(Failure::new(INPUT, message));
    }
    let mesh = load_scene(source)?;
    chosen().try_for_each(|s| certify(s, &mesh, args.sample, f))
}

fn tell(f: &Findings) -> Result<(), Failure> {
    for (text, _) in &f.told {
        line(text)?;
    }
    if f.faults > f.told.len() as u64 {
        line(&format!("... and {} more", f.faults - f.told.len() as u64))?;
    }
    line(&format!("{} pages hold every rule of the format: {}", f.summary.pages, f.summary.faults == 0))?;
    if f.source_skipped {
        line("the source was not looked at, because the file itself has faults")?;
    }
    if f.summary.unsupported > 0 {
        line(&format!(
            "{} pages are of kinds that this version checks no further than the frame",
            f.summary.unsupported
        ))?;
    }
    for (name, promise) in &f.promises {
        line(&format!("light {name:?} promises to be right for {promise}"))?;
    }
    for l in &f.lights {
        line(&format!(
            "light {}: {} texels held against the source, {} stored values outside their interval, {} edge texels",
            l["name"], l["texels"], l["violations"], l["edge"]
        ))?;
        for e in l["examples"].as_array().into_iter().flatten() {
            line(&format!(
                "  texel {}, {}: stored {}, right are {} to {}{}",
                e["x"],
                e["y"],
                e["stored"],
                e["min"],
                e["max"],
                if e["certified"] == true { "" } else { " (edge texel)" }
            ))?;
        }
        let stops = &l["stop_errors"];
        line(&format!(
            "light {}: {} stop errors held against texels, {} too small",
            l["name"], stops["pairs"], stops["violations"]
        ))?;
        for e in l["stop_examples"].as_array().into_iter().flatten() {
            line(&format!(
                "  page {}: texel {}, {} is answered {} without it, right are {} to {}; its stop error is {}",
                e["page"], e["x"], e["y"], e["answer"], e["min"], e["max"], e["stop_error"]
            ))?;
        }
        let spots = &l["continuous"];
        if let Some(share) = spots["proven_share"].as_f64() {
            line(&format!(
                "light {}: {:.1} % of the map proven between texel centres; {} of {} places lie there and were held against the source, {} wrong",
                l["name"],
                100.0 * share,
                spots["proven"],
                spots["places"],
                spots["violations"]
            ))?;
        }
        for e in spots["examples"].as_array().into_iter().flatten() {
            line(&format!("  place {}, {}: answered {}, wrong within 2^-12 texel", e["x"], e["y"], e["answer"]))?;
        }
    }
    Ok(())
}

/// Holds the stored values of one light against the exact oracle.
fn certify(s: Structure, mesh: &Mesh, sample: Option<u64>, f: &mut Findings) -> Result<(), Failure> {
    let name = s.name().to_string();
    let snapped = picture::snapped(mesh, &s)?;
    let (edge, thin) = (s.record().edge_texels.get(), s.record().thin_texels.get());
    let map = Map::new(s)?;
    let stops = Stops::new(map.structure(), &go_on)?;
    let resident = map.preload_while(&go_on)?;
    let oracle = Oracle::new(&snapped).with_guard(map.structure().record().depth_guard.get());
    let side = map.resolution();
    let whole = u64::from(side) * u64::from(side);
    let sample = sample.filter(|n| *n < whole);
    let page = |p| map.structure().page_record(p).ok().map(|r| ([r.origin_x.get(), r.origin_y.get()], r.log2_x));
    let leaf = |x, y| map.texel(x, y, 0).ok().map(|a| a.level);
    let borders = Borders { pages: map.structure().page_count(), page: &page, leaf: &leaf };
    let (regions, near) = match sample {
        None => {
            let height = side.min(512);
            let bands = (0..side).step_by(height as usize).map(|y| Region { x: 0, y, width: side, height });
            (bands.collect(), 0)
        }
        Some(n) => sample::regions(Some(&snapped), side, n, &borders),
    };
    let (t, stopped) = check(&oracle, &regions, &resident, &stops)?;
    let kind = map.structure().kind();
    let spots = match kind {
        Kind::Vector => sample::spots(&snapped, sample.unwrap_or(whole).min(SPOTS), &borders),
        _ => Vec::new(),
    };
    let one = |s: &sample::Spot| match go_on() {
        true => place::check(&oracle, |o| map.page(o).ok().and(map.view(o)), map.lattice().log2_resolution, *s),
        false => SpotTally::default(),
    };
    let spots = spots.par_iter().map(one).reduce(SpotTally::default, SpotTally::merge);
    if !go_on() {
        return Err(Failure::interrupted());
    }
    f.texels += t.texels;
    f.near += near;
    f.violations += t.wrong;
    if sample.is_none() {
        f.counts(&name, kind, [edge, t.edge()], [thin, t.thin]);
    }
    let example = |[x, y]: [u32; 2]| {
        let truth = oracle.texel(x, y);
        json!({
            "x": x, "y": y, "stored": resident.value(x, y, 0), "min": truth.interval.min, "max": truth.interval.max,
            "certified": truth.certified,
        })
    };
    let mut examples = t.examples.clone();
    examples.sort_unstable();
    f.lights.push(json!({
        "name": name, "texels": t.texels, "near_borders": near, "violations": t.wrong, "certified": t.certified,
        "edge": t.edge(), "thin": t.thin, "examples": examples.into_iter().map(example).collect::<Vec<_>>(),
        "stop_errors": stop_counts(&stopped),
        "stop_examples": stopped.examples.iter().map(stop_example).collect::<Vec<_>>(),
        "continuous": spot_counts(&spots, kind),
    }));
    f.stops = std::mem::take(&mut f.stops).merge(stopped);
    f.spots = std::mem::take(&mut f.spots).merge(spots);
    Ok(())
}

/// Most places between texel centres that are looked at.
const SPOTS: u64 = 1 << 20;

/// Holds the stored values of one light against the depth layers it was baked from.
fn certify_layers(s: Structure, source: &str, args: &Args, f: &mut Findings) -> Result<(), Failure> {
    let (name, kind, r) = (s.name().to_string(), s.kind(), *s.record());
    let (t, stopped, near) = layers::verify(source, &args.layers, s, args.sample)?;
    let whole = 1u64 << (2 * r.log2_resolution);
    if near == 0 {
        f.counts(&name, kind, [r.edge_texels.get(), whole], [r.thin_texels.get(), t.thin]);
    }
    f.near += near;
    f.texels += t.texels;
    f.violations += t.wrong;
    let example = |e: &umbrage::certify::layers::Fault| {
        json!({
            "x": e.texel[0], "y": e.texel[1], "stored": e.stored, "min": e.allowed.min, "max": e.allowed.max,
            "certified": false,
        })
    };
    f.lights.push(json!({
        "name": name, "texels": t.texels, "near_borders": near, "violations": t.wrong, "certified": 0,
        "edge": t.texels, "thin": t.thin, "examples": t.examples.iter().map(example).collect::<Vec<_>>(),
        "stop_errors": stop_counts(&stopped),
        "stop_examples": stopped.examples.iter().map(stop_example).collect::<Vec<_>>(),
    }));
    f.stops = std::mem::take(&mut f.stops).merge(stopped);
    Ok(())
}

/// Texels whose intervals are worked out for stop errors, about: up to a map of 4096 x 4096 every one that it needs.
const EXACT: u64 = 1 << 24;

fn check(oracle: &Oracle, regions: &[Region], stored: &Resident, stops: &Stops) -> Result<(Tally, StopTally), Failure> {
    let texels = |r: &Region| u64::from(r.width) * u64::from(r.height);
    let whole = regions.iter().map(texels).sum::<u64>();
    let watched = Watched::start(whole);
    let every = (whole / EXACT).max(1);
    let value = |x, y| stored.value(x, y, 0);
    let one = |r: &Region| {
        if !go_on() {
            return Default::default();
        }
        let tally = oracle.check(*r, value);
        let stopped = stops.check(*r, every, value, |x, y| oracle.texel(x, y).interval);
        watched.progress.texels.fetch_add(texels(r), Ordering::Relaxed);
        (tally, stopped)
    };
    let merge = |a: (Tally, StopTally), b: (Tally, StopTally)| (a.0.merge(b.0), a.1.merge(b.1));
    let tally = regions.par_iter().map(one).reduce(Default::default, merge);
    if go_on() { Ok(tally) } else { Err(Failure::interrupted()) }
}
