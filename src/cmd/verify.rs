//! `umbrage verify`: every rule of the format, and with the source every stored value.

use std::path::PathBuf;

use serde_json::json;
use umbrage::certify::{Oracle, Region, Tally};
use umbrage::reader::query::mh::MhMap;

use super::output::line;
use super::{Failure, INPUT, USAGE, go_on, layers, listen, load_scene, open, picture};

/// Arguments of `verify`.
#[derive(clap::Args)]
pub struct Args {
    /// The container
    file: PathBuf,
    /// Only this light
    #[arg(long)]
    light: Option<String>,
    /// The scene or the .exr file it was baked from: proves that every stored value is right
    #[arg(long, value_name = "SCENE")]
    source: Option<String>,
    /// Check this many texels, in random squares of 64 x 64, instead of all
    #[arg(long, value_name = "N", requires = "source", allow_negative_numbers = true)]
    sample: Option<u64>,
    #[command(flatten)]
    layers: layers::LayerArgs,
    /// One JSON object on stdout
    #[arg(long)]
    json: bool,
}

/// Exit code: faults were found.
const FAULTS: u8 = 1;

/// Runs the command.
pub fn run(args: Args) -> Result<(), Failure> {
    listen();
    let container = open(&args.file)?;
    let mut errors = Vec::new();
    let summary = container.verify(|fault| {
        if errors.len() < 100 {
            errors.push(fault.to_string());
        }
    });
    let (mut texels, mut violations) = (0, 0);
    let mut lights = Vec::new();
    let chosen = || container.structures().filter(|s| args.light.as_deref().is_none_or(|n| n == s.name()));
    if let (Some(source), true) = (args.source.as_ref().filter(|s| layers::are(s)), errors.is_empty()) {
        for s in chosen() {
            let name = s.name().to_string();
            let t = layers::verify(source, &args.layers, s, args.sample)?;
            texels += t.texels;
            violations += t.wrong;
            lights.push(json!({
                "name": name, "texels": t.texels, "violations": t.wrong, "certified": 0,
                "edge": t.texels, "thin": t.thin,
                "examples": t.examples.iter().map(|e| format!("{e:?}")).collect::<Vec<_>>(),
            }));
        }
    } else if let Some(option) = args.layers.given() {
        return Err(Failure::new(USAGE, format!("{option} is for depth layers; give their .exr file with --source")));
    } else if let (Some(source), true) = (&args.source, errors.is_empty()) {
        if let Some(s) = chosen().find(|s| s.record().is_from_layers()) {
            let message =
                format!("light '{}' was baked from depth layers; give their .exr file with --source", s.name());
            return Err(Failure::new(INPUT, message));
        }
        let mesh = load_scene(source)?;
        for s in chosen() {
            let name = s.name().to_string();
            let snapped = picture::snapped(&mesh, &s)?;
            let edge = s.record().edge_texels.get();
            let map = MhMap::new(s)?.preload()?;
            let oracle = Oracle::new(&snapped);
            let t = certify(&oracle, map.resolution(), args.sample, &|x, y| map.value(x, y, 0))?;
            texels += t.texels;
            violations += t.wrong;
            if args.sample.is_none() && t.edge() != edge {
                errors.push(format!("light '{name}': the file counts {edge} edge texels, the source has {}", t.edge()));
            }
            lights.push(json!({
                "name": name, "texels": t.texels, "violations": t.wrong, "certified": t.certified,
                "edge": t.edge(), "thin": t.thin,
                "examples": t.examples.iter().map(|e| format!("{e:?}")).collect::<Vec<_>>(),
            }));
        }
    }
    let ok = errors.is_empty() && violations == 0;
    let promises: Vec<(String, &str)> =
        chosen().map(|s| (s.name().to_string(), s.record().guarantee_words())).collect();
    if args.json {
        line(
            &json!({
                "ok": ok, "errors": errors, "pages": summary.pages, "texels_checked": texels,
                "violations": violations, "lights": lights,
                "promises": promises.iter().map(|(n, p)| (n.clone(), json!(p))).collect::<serde_json::Map<_, _>>(),
            })
            .to_string(),
        )?;
    } else {
        for e in &errors {
            line(e)?;
        }
        line(&format!("{} pages hold every rule of the format: {}", summary.pages, errors.is_empty()))?;
        for (name, promise) in &promises {
            line(&format!("light {name:?} promises to be right for {promise}"))?;
        }
        for l in &lights {
            line(&format!(
                "light {}: {} texels held against the source, {} stored values outside their interval, {} edge texels",
                l["name"], l["texels"], l["violations"], l["edge"]
            ))?;
        }
    }
    if ok { Ok(()) } else { Err(Failure::new(FAULTS, format!("{}: faults found", args.file.display()))) }
}

/// All texels in bands, or `sample` of them in squares.
fn certify(
    oracle: &Oracle,
    resolution: u32,
    sample: Option<u64>,
    stored: &(dyn Fn(u32, u32) -> u32 + Sync),
) -> Result<Tally, Failure> {
    let mut tally = Tally::default();
    let mut add = |region| {
        tally = std::mem::take(&mut tally).merge(oracle.check(region, stored));
        if go_on() { Ok(()) } else { Err(Failure::interrupted()) }
    };
    match sample {
        None => {
            let band = resolution.min(512);
            for y in (0..resolution).step_by(band as usize) {
                add(Region { x: 0, y, width: resolution, height: band })?;
            }
        }
        Some(n) => {
            let side = resolution.min(64);
            let mut seed = 0x9E37_79B9_7F4A_7C15u64;
            let mut next = || {
                // splitmix64: any fixed sequence will do
                seed = seed.wrapping_add(0x9E37_79B9_7F4A_7C15);
                let z = (seed ^ (seed >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
                let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
                ((z ^ (z >> 31)) % u64::from(resolution / side)) as u32 * side
            };
            for _ in 0..n.div_ceil(u64::from(side) * u64::from(side)) {
                add(Region { x: next(), y: next(), width: side, height: side })?;
            }
        }
    }
    Ok(tally)
}
