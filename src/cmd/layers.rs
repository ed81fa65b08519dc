//! Depth layers on the command line: `umbrage bake LAYERS.exr` and `umbrage verify --source LAYERS.exr`.

use std::path::{Path, PathBuf};
use std::sync::Once;
use std::sync::atomic::Ordering;
use std::time::Instant;

use serde_json::json;
use umbrage::certify::Region;
use umbrage::certify::layers::{LayersTally, check};
use umbrage::certify::sample::{Borders, regions};
use umbrage::certify::stop::{StopTally, Stops};
use umbrage::reader::Structure;
use umbrage::reader::query::Map;
use umbrage::writer::bake::BakeError;
use umbrage::writer::container::Target;
use umbrage::writer::layers::openexr::{ExrLayers, ExrOptions, Placement, is_decoding};
use umbrage::writer::layers::{BakedLayers, DepthSource, LatticeLayers, LayersOptions, Second, Square, bake_layers};
use umbrage::writer::solid::Policy;

use super::bake::{LightArg, pool};
use super::output::{self, line};
use super::{Failure, INPUT, USAGE, Watched, go_on, parse_numbers};

/// How the files are read.
#[derive(clap::Args)]
pub struct LayerArgs {
    /// Depth layers: the file of second depth, where that is a file of its own
    #[arg(long, value_name = "SECOND.exr")]
    second: Option<PathBuf>,
    /// Depth layers: channels of first and second depth; first.Z or Z, and second.Z or ZBack, without it
    #[arg(long, value_name = "FIRST[,SECOND]")]
    channels: Option<String>,
    /// Depth layers: depths from here on mean that there is nothing; 1e10 without it
    #[arg(long, value_name = "DEPTH", value_parser = parse_far, allow_negative_numbers = true)]
    far: Option<f64>,
}

/// Where the layers lie in the world.
#[derive(clap::Args)]
pub struct PlacementArgs {
    /// Depth layers: box of the scene in the world, lowest and highest corner; goes with --light NAME=dir:X,Y,Z
    #[arg(long, value_name = "X,Y,Z,X,Y,Z", value_parser = parse_bounds, allow_hyphen_values = true)]
    bounds: Option<[f64; 6]>,
    /// Depth layers: x and y in pixels, whatever matrices the file has
    #[arg(long, conflicts_with = "bounds")]
    image_space: bool,
}

fn parse_far(s: &str) -> Result<f64, String> {
    s.parse().ok().filter(|v: &f64| !v.is_nan()).ok_or_else(|| format!("expected a number, found '{s}'"))
}

fn parse_bounds(s: &str) -> Result<[f64; 6], String> {
    let b = parse_numbers::<6>(s)?;
    if (0..3).all(|k| b[k] <= b[k + 3]) { Ok(b) } else { Err("expected the lowest corner first".to_string()) }
}

impl LayerArgs {
    /// An option that was given.
    pub fn given(&self) -> Option<&'static str> {
        let second = self.second.is_some().then_some("--second");
        second.or(self.channels.is_some().then_some("--channels")).or(self.far.is_some().then_some("--far"))
    }

    fn options(&self, first: &Path) -> ExrOptions {
        let split = |s: &String| match s.split_once(',') {
            Some((a, b)) => (a.to_string(), Some(b.to_string())),
            None => (s.clone(), None),
        };
        ExrOptions {
            first: first.to_path_buf(),
            second: self.second.clone(),
            channels: self.channels.as_ref().map(split),
            far: self.far,
            ..ExrOptions::default()
        }
    }
}

impl PlacementArgs {
    /// An option that was given.
    pub fn given(&self) -> Option<&'static str> {
        self.bounds.is_some().then_some("--bounds").or(self.image_space.then_some("--image-space"))
    }
}

/// Whether a source is depth layers.
pub fn are(source: &str) -> bool {
    Path::new(source).extension().is_some_and(|e| e.eq_ignore_ascii_case("exr"))
}

/// What `bake` was told.
pub struct Bake {
    /// The file of first depth.
    pub first: PathBuf,
    /// The container.
    pub output: PathBuf,
    /// The light.
    pub light: LightArg,
    /// Pixels on a side, if stated.
    pub resolution: Option<u64>,
    /// What the second depth is; auto: as its channel says.
    pub policy: Policy,
    /// The budget.
    pub memory_bytes: Option<u64>,
    /// Threads.
    pub threads: Option<usize>,
    /// One JSON object on stdout.
    pub json: bool,
    /// Whether pages are stored in their cold form.
    pub cold: bool,
}

/// The light of the layers; more than one make no sense.
pub fn one_light(lights: &[LightArg]) -> Result<LightArg, Failure> {
    match lights {
        [light] => Ok(light.clone()),
        _ => Err(Failure::new(USAGE, "depth layers are of one light; bake each and put them together with merge")),
    }
}

fn meaning(policy: Policy) -> Result<Option<Second>, Failure> {
    match policy {
        Policy::Auto => Ok(None),
        Policy::Closed => Ok(Some(Second::Exit)),
        Policy::SecondSurface => Ok(Some(Second::NextSurface)),
        Policy::OneSided => Ok(Some(Second::Absent)),
        Policy::Thickness(_) => Err(Failure::new(
            USAGE,
            "--policy thickness:T needs geometry; depth layers take closed, second-surface, one-sided or auto",
        )),
    }
}

fn placement(light: &LightArg, args: &PlacementArgs) -> Result<Placement, Failure> {
    match (light.direction, args.bounds) {
        (Some(direction), Some([x, y, z, u, v, w])) => {
            Ok(Placement::Box { direction, low: [x, y, z], high: [u, v, w] })
        }
        (None, Some(_)) => Err(Failure::new(USAGE, "--bounds needs the light's direction: --light NAME=dir:X,Y,Z")),
        (Some(_), None) => Err(Failure::new(
            USAGE,
            format!(
                "light '{}': a direction needs --bounds; --light {} alone takes what the file says",
                light.name, light.name
            ),
        )),
        (None, None) if args.image_space => Ok(Placement::Image),
        (None, None) => Ok(Placement::Header),
    }
}

/// Reads the files. A decoder that breaks off over damaged pixels is an error of one line, without its own; any other
/// panic, of this thread or another, is told as ever.
fn read(name: &str, options: &ExrOptions) -> Result<ExrLayers, Failure> {
    static QUIET: Once = Once::new();
    QUIET.call_once(|| {
        let hook = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |panic| {
            if !is_decoding() {
                hook(panic);
            }
        }));
    });
    Ok(ExrLayers::read(name, options, &go_on)?)
}

/// Bakes depth layers.
pub fn run(bake: Bake, args: LayerArgs, place: PlacementArgs) -> Result<(), Failure> {
    let start = Instant::now();
    let options = ExrOptions {
        meaning: meaning(bake.policy)?,
        placement: placement(&bake.light, &place)?,
        memory_bytes: bake.memory_bytes,
        ..args.options(&bake.first)
    };
    // Made and removed: a target that can't be written is found before the work, not after it.
    drop(Target::create(&bake.output).map_err(BakeError::from)?);
    let layers = read(&bake.light.name, &options)?;
    let side = 1u64 << layers.projection().log2_resolution;
    if let Some(r) = bake.resolution.filter(|r| *r != side) {
        let message = format!("--resolution {r}: the layers have {side} x {side} pixels; leave it out");
        return Err(Failure::new(USAGE, message));
    }
    let load = start.elapsed().as_secs_f64();
    let watched = Watched::start(side * side);
    let to_bake = LayersOptions { memory_bytes: bake.memory_bytes, cold: bake.cold };
    let baked = pool(bake.threads)?.install(|| bake_layers(&[&layers], &to_bake, &bake.output, &watched.progress))?;
    drop(watched);
    report(&bake, &layers, &baked, side, load, start.elapsed().as_secs_f64())
}

fn report(bake: &Bake, layers: &ExrLayers, b: &BakedLayers, side: u64, load: f64, total: f64) -> Result<(), Failure> {
    let (l, s) = (&b.lights[0], &b.seconds);
    if bake.json {
        let report = json!({
            "resolution": side,
            "layers": layers.notes,
            "nodes": l.nodes.iter().sum::<u64>(), "pages": l.pages, "bytes": b.bytes,
            "edge_texels": l.counts.edge_texels, "thin_texels": l.counts.thin_texels,
            "peak_memory_bytes": output::peak_memory(),
            "seconds": {"load": load, "range": s.snap, "build": s.build, "write": s.write, "total": total},
        });
        return line(&report.to_string());
    }
    for note in &layers.notes {
        line(&format!("layers: {note}"))?;
    }
    line(&format!(
        "light {}: {side} x {side} texels, {} nodes in {} pages, {} thin texels; right at texel centres only",
        l.name,
        l.nodes.iter().sum::<u64>(),
        l.pages,
        l.counts.thin_texels
    ))?;
    line(&format!(
        "{} in {total:.1} s (load {load:.1}, range {:.1}, build {:.1}, write {:.1}), peak memory {}",
        output::bytes(b.bytes),
        s.snap,
        s.build,
        s.write,
        output::mib(output::peak_memory())
    ))?;
    line(&bake.output.display().to_string())
}

/// Holds every stored value of a structure, or about `sample` of them, against the layers.
pub fn verify(
    source: &str,
    args: &LayerArgs,
    structure: Structure,
    sample: Option<u64>,
) -> Result<(LayersTally, StopTally, u64), Failure> {
    let name = structure.name().to_string();
    let meaning = Second::of(structure.record()).ok_or_else(|| {
        Failure::new(INPUT, format!("light '{name}' was baked from a scene; give that scene with --source"))
    })?;
    let options = ExrOptions { meaning: Some(meaning), placement: Placement::Image, ..args.options(Path::new(source)) };
    let layers = read(&name, &options)?;
    let k = structure.lattice().log2_resolution;
    let found = layers.projection().log2_resolution;
    if found != k {
        let message = format!(
            "light '{name}' has {} texels on a side, {source} has {}; give the layers it was baked from",
            1u64 << k,
            1u64 << found
        );
        return Err(Failure::new(INPUT, message));
    }
    let layers = LatticeLayers::new(&layers, &go_on)?;
    let guard = structure.record().depth_guard.get();
    let map = Map::new(structure)?;
    let side = map.resolution();
    let whole = u64::from(side) * u64::from(side);
    let (squares, near): (Vec<Square>, u64) = match sample.filter(|n| *n < whole) {
        None => {
            let log2_side = k.min(6);
            let across = 0..side >> log2_side;
            let square = |x: u32, y: u32| Square { origin: [x << log2_side, y << log2_side], log2_side };
            (across.clone().flat_map(|y| across.clone().map(move |x| square(x, y))).collect(), 0)
        }
        Some(n) => {
            let page =
                |p| map.structure().page_record(p).ok().map(|r| ([r.origin_x.get(), r.origin_y.get()], r.log2_x));
            let leaf = |x, y| map.texel(x, y, 0).ok().map(|a| a.level);
            let pages = map.structure().page_count();
            let (regions, near) = regions(None, side, n, &Borders { pages, page: &page, leaf: &leaf });
            // squares are aligned: the one that the region begins in
            let square = |r: Region| {
                let log2_side = r.width.ilog2() as u8;
                Square { origin: [r.x, r.y].map(|v| v >> log2_side << log2_side), log2_side }
            };
            (regions.into_iter().map(square).collect(), near)
        }
    };
    let stops = Stops::new(map.structure(), &go_on)?;
    let resident = map.preload_while(&go_on)?;
    let (mut tally, mut stopped) = (LayersTally::default(), StopTally::default());
    let watched = Watched::start(squares.iter().map(|s| 1u64 << (2 * s.log2_side)).sum());
    for square in squares {
        if !go_on() {
            return Err(Failure::interrupted());
        }
        let length = 1 << square.log2_side;
        let pages = stops.over(Region { x: square.origin[0], y: square.origin[1], width: length, height: length });
        let stop = |texel, allowed| {
            for page in pages.iter().filter(|p| p.holds(texel)) {
                stopped.pairs += 1;
                stopped.hold(page, texel, stops.answer(page, texel), allowed);
            }
        };
        check(&layers, square, guard, &|x, y| resident.value(x, y, 0), &mut tally, stop)?;
        watched.progress.texels.fetch_add(1 << (2 * square.log2_side), Ordering::Relaxed);
    }
    Ok((tally, stopped, near))
}
