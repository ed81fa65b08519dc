//! `umbrage render`: a view of the scene, shadows by a container.

use std::path::PathBuf;
use std::time::Instant;

use serde_json::json;
use umbrage::render::{Camera, Scene, Shading, UpAxis, shade, write_png};

use super::output::{self, line};
use super::shadows::{Backend, How, Look, Shadows, default_budget, parse_filter};
use super::{Failure, USAGE, go_on, listen, load_scene, open, parse_numbers, picture, structure, whole};

/// Arguments of `render`.
#[derive(clap::Args)]
pub struct Args {
    /// The scene that the container was baked from
    scene: String,
    /// The container, or its address on a web server
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
    #[arg(long, default_value_t = 45.0, allow_negative_numbers = true, value_parser = parse_fov)]
    fov: f64,
    /// Pixels
    #[arg(long, default_value = "1280x720", value_name = "WxH", value_parser = parse_size, allow_hyphen_values = true)]
    size: [u32; 2],
    /// What answers the shadows
    #[arg(long, value_enum, default_value_t = Backend::Auto)]
    backend: Backend,
    /// Look the map up at the place in the texel where it is proven there (kind vector): edges as sharp as the geometry's
    #[arg(long)]
    continuous: bool,
    /// Soften edges by percentage-closer filtering: hard (none), pcf:N (N x N texels), hpcf (3 x 3 of the level as fine as the
    /// pixel; hpcf:N), trilinear (the same, blended between two levels; trilinear:N)
    #[arg(long, value_name = "FILTER", default_value = "hard", conflicts_with = "continuous", value_parser = parse_filter)]
    filter: Look,
    /// Lattice steps of depth that shadows may be off by: pages are not read whose index record promises no more
    #[arg(long, value_name = "STEPS", default_value_t = 0, allow_negative_numbers = true, value_parser = whole::<u32>(0, 0xFFFF_FFFE))]
    error: u32,
    /// Read every page on the way, also where the index says that it changes nothing; for comparisons
    #[arg(long, conflicts_with = "error")]
    no_skip: bool,
    /// Most memory for the streamer, MiB; half of the file without it
    #[arg(long, value_name = "MIB", allow_negative_numbers = true, value_parser = whole::<u64>(1, 1 << 20))]
    budget: Option<u64>,
    /// One JSON object on stdout
    #[arg(long)]
    json: bool,
}

fn parse_fov(s: &str) -> Result<f64, String> {
    s.parse().map_err(|_| format!("expected degrees above 0 and below 180, found '{s}'"))
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
    let geometry = Scene::new(&snapped);
    let view = geometry.view(&camera, args.size[0], args.size[1], &go_on).ok_or_else(Failure::interrupted)?;
    let pages = structure.page_count();
    let budget = args.budget.map_or_else(|| default_budget(&container), |m| m << 20);
    let look = if args.continuous { Look::Place } else { args.filter };
    let how = How { backend: args.backend, budget, skips: (!args.no_skip).then_some(args.error) };
    let shadows = Shadows::answer(&view, geometry.surface(), &container, structure, how, look)?;
    let shading = Shading { components: Some(&snapped.solid), haze: None };
    write_png(&args.output, &shade(&view, &shadows.coverage, shading))?;
    let read = container.counters();
    let seconds = start.elapsed().as_secs_f64();
    if args.json {
        let report = json!({
            "shadows": shadows.json(), "pages": pages, "bytes_read": read.bytes, "seconds": seconds,
        });
        return line(&report.to_string());
    }
    let bytes = output::bytes(read.bytes);
    line(&format!("{} of {pages} pages read ({bytes}), {seconds:.1} s", shadows.pages_read))?;
    for l in shadows.lines() {
        line(&l)?;
    }
    line(&args.output.display().to_string())
}
