//! `umbrage render`: a view of the scene, shadows by a container.

use std::path::PathBuf;
use std::time::Instant;

use serde_json::json;
use umbrage::reader::query::mh::MhMap;
use umbrage::render::{Camera, Scene, Shading, UpAxis, coverage, shade, write_png};

use super::output::{self, line};
use super::{Failure, USAGE, go_on, listen, load_scene, open, parse_numbers, picture, structure};

/// Arguments of `render`.
#[derive(clap::Args)]
pub struct Args {
    /// The scene that the container was baked from
    scene: String,
    /// The container
    file: PathBuf,
    /// Which light; may be left out where there is only one
    #[arg(long)]
    light: Option<String>,
    /// The picture to write
    #[arg(short, long, value_name = "OUT.png")]
    output: PathBuf,
    /// Eye and target in world units
    #[arg(long, value_name = "EX,EY,EZ,TX,TY,TZ", allow_hyphen_values = true, value_parser = parse_numbers::<6>)]
    camera: [f64; 6],
    /// Which way is up
    #[arg(long, default_value = "y", value_parser = ["y", "z"])]
    up: String,
    /// Vertical field of view, degrees
    #[arg(long, default_value_t = 45.0, allow_negative_numbers = true)]
    fov: f64,
    /// Pixels
    #[arg(long, default_value = "1280x720", value_name = "WxH", value_parser = parse_size)]
    size: [u32; 2],
    /// What answers the shadows
    #[arg(long, default_value = "auto", value_parser = ["auto", "cpu"])]
    backend: String,
    /// One JSON object on stdout
    #[arg(long)]
    json: bool,
}

fn parse_size(s: &str) -> Result<[u32; 2], String> {
    let parts = s.split_once('x').and_then(|(w, h)| Some([w.parse::<u32>().ok()?, h.parse::<u32>().ok()?]));
    parts
        .filter(|s| s.iter().all(|n| (1..=16384).contains(n)))
        .ok_or_else(|| format!("expected WIDTHxHEIGHT, each from 1 to 16384, for example 1280x720, found '{s}'"))
}

/// Runs the command.
pub fn run(args: Args) -> Result<(), Failure> {
    listen();
    let start = Instant::now();
    let [ex, ey, ez, tx, ty, tz] = args.camera;
    let up = if args.up == "y" { UpAxis::Y } else { UpAxis::Z };
    let camera = Camera::new([ex, ey, ez], [tx, ty, tz], up, args.fov).map_err(|e| Failure::new(USAGE, e))?;
    let container = open(&args.file)?;
    let structure = structure(&container, args.light.as_deref())?;
    let mesh = load_scene(&args.scene)?;
    let snapped = picture::snapped(&mesh, &structure)?;
    let map = MhMap::new(structure)?;
    let geometry = Scene::new(&snapped);
    let view = geometry.view(&camera, args.size[0], args.size[1], &go_on).ok_or_else(Failure::interrupted)?;
    let lit = picture::lit_by_map(&view, &map)?;
    let shading = Shading { components: Some(&snapped.solid), haze: None };
    write_png(&args.output, &shade(&view, &coverage(&lit), shading))?;
    let read = container.counters();
    let pages = map.structure().page_count();
    let seconds = start.elapsed().as_secs_f64();
    if args.json {
        let report = json!({
            "backend": "cpu", "pages_read": read.pages, "pages": pages, "bytes_read": read.bytes, "seconds": seconds,
        });
        return line(&report.to_string());
    }
    line(&format!("{} of {pages} pages read ({}), {seconds:.1} s, on the CPU", read.pages, output::bytes(read.bytes)))?;
    line(&args.output.display().to_string())
}
