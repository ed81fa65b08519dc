//! `umbrage view`: a window in which a camera flies through the scene while its shadows stream.

use std::path::{Path, PathBuf};

use serde_json::json;
use umbrage::render::{Camera, Filter, Look, UpAxis};
use umbrage::view::Style;
use umbrage::view::window::{self, Options};
use umbrage::writer::scene;
use umbrage::writer::solid::SnappedMesh;

use super::output::{self, line};
use super::{Failure, INPUT, USAGE, flight, go_on, listen, look, open};

/// Arguments of `view`.
#[derive(clap::Args)]
pub struct Args {
    /// The scene that the container was baked from
    scene: String,
    /// The container, or its address on a web server
    file: PathBuf,
    #[command(flatten)]
    look: look::Args,
    /// Lay this over the picture at first: residency, level, missing, pages, texels
    #[arg(long, value_name = "WHAT", value_parser = flight::parse_overlay)]
    overlay: Option<umbrage::view::Overlay>,
    /// A recorded flight that is flown at first
    #[arg(long, value_name = "FLIGHT.json", conflicts_with = "camera")]
    flight: Option<PathBuf>,
    /// World units a second; a twentieth of the map without it
    #[arg(long, allow_negative_numbers = true, value_parser = parse_positive)]
    speed: Option<f64>,
    /// Folder for pictures (P) and recorded flights (R)
    #[arg(short, long, value_name = "FOLDER", default_value = ".")]
    output: PathBuf,
    /// Close after so many seconds
    #[arg(long, allow_negative_numbers = true, value_parser = parse_positive)]
    seconds: Option<f64>,
    /// One JSON object on stdout when it is closed
    #[arg(long)]
    json: bool,
}

fn parse_positive(s: &str) -> Result<f64, String> {
    let number = s.parse().ok().filter(|v: &f64| v.is_finite() && *v > 0.0);
    number.ok_or_else(|| format!("expected a number above 0, found '{s}'"))
}

/// Where the camera begins if nobody says: at the view that a generated scene comes with, else above a corner of all.
fn usual(scene: &str, mesh: &SnappedMesh, look: &look::Args) -> Result<(Camera, f64), Failure> {
    let bad = |e: &dyn std::fmt::Display| Failure::new(INPUT, e);
    let [low, high] = umbrage::view::bounds(mesh);
    if let Some(view) = scene::demo_view(scene) {
        let view = view.map_err(|e| bad(&e))?;
        // That of a city is for a whole one: a small one ends before.
        if (0..3).all(|k| (low[k]..=high[k]).contains(&view.target[k])) {
            let fov = look.fov(view.fov_degrees);
            return Ok((Camera::new(view.eye, view.target, look.up(), fov).map_err(|e| bad(&e))?, fov));
        }
    }
    let middle: [f64; 3] = std::array::from_fn(|k| (low[k] + high[k]) / 2.0);
    let size = (0..3).map(|k| (high[k] - low[k]).powi(2)).sum::<f64>().sqrt();
    let way = if look.up() == UpAxis::Y { [0.5, 0.45, 0.6] } else { [0.5, -0.6, 0.45] };
    let eye = std::array::from_fn(|k| middle[k] + way[k] * size);
    let fov = look.fov(look::FOV);
    Ok((Camera::new(eye, middle, look.up(), fov).map_err(|e| bad(&e))?, fov))
}

/// Runs the command.
pub fn run(args: Args) -> Result<(), Failure> {
    listen();
    let asked = args.look.camera()?;
    let flight = args.flight.as_deref().map(look::flight).transpose()?;
    if flight.is_some() {
        args.look.flies()?;
    }
    if !args.output.is_dir() {
        let message = format!("{}: no such folder; name one for pictures with -o", args.output.display());
        return Err(Failure::new(USAGE, message));
    }
    let container = open(&args.file)?;
    let (structure, mesh) = args.look.scene(&container, &args.scene)?;
    let (start, fov) = match (asked, &flight) {
        (Some(camera), _) => (camera, args.look.fov(look::FOV)),
        (None, Some(flight)) => (flight.camera(0).map_err(|e| Failure::new(INPUT, e))?, flight.fov()),
        (None, None) => usual(&args.scene, &mesh, &args.look)?,
    };
    let name = Path::new(&args.scene).file_name().map_or(args.scene.clone(), |n| n.to_string_lossy().into_owned());
    let side = 1u64 << structure.record().log2_resolution;
    let options = Options {
        title: format!("{name}, {}: {side} x {side}, {}", structure.name(), structure.kind().name()),
        size: args.look.size,
        style: Style { look: args.look.look(Look::Filtered(Filter::Hierarchical(3))), overlay: args.overlay },
        budget: args.look.budget(&container),
        skips: args.look.skips(),
        start,
        fov,
        speed: args.speed,
        flight,
        folder: args.output.clone(),
        seconds: args.seconds,
    };
    let summary = window::run(&container, &structure, &mesh, &options, &go_on)?;
    let read = container.counters().bytes;
    let [median, worst] = summary.frame_ms;
    if args.json {
        let files: Vec<_> = summary.files.iter().map(|f| f.display().to_string()).collect();
        let report = json!({
            "by": summary.device, "frames": summary.frames, "seconds": summary.seconds, "median_ms": median,
            "worst_ms": worst, "pages_read": summary.pages_read, "pages": structure.page_count(), "bytes_read": read,
            "resident": summary.last.resident, "by_ancestors": summary.last.by_ancestors, "files": files,
        });
        line(&report.to_string())?;
    } else {
        line(&format!(
            "{} frames in {:.1} s on {}, {median:.1} ms each (median of the last ones); {} of {} pages read ({})",
            summary.frames,
            summary.seconds,
            summary.device,
            summary.pages_read,
            structure.page_count(),
            output::bytes(read)
        ))?;
        for file in &summary.files {
            line(&file.display().to_string())?;
        }
    }
    if go_on() { Ok(()) } else { Err(Failure::interrupted()) }
}
