//! `umbrage render`: a view of the scene, shadows by a container; or the frames of a flight.

use std::path::PathBuf;
use std::time::Instant;

use serde_json::json;
use umbrage::render::{Look, Scene, Shading, shade, write_png};

use super::output::{self, line};
use super::shadows::{Backend, How, Shadows};
use super::{Failure, flight, go_on, listen, look, open};

/// Arguments of `render`.
#[derive(clap::Args)]
#[command(group = clap::ArgGroup::new("place").args(["camera", "flight"]).required(true))]
pub struct Args {
    /// The scene that the container was baked from
    pub scene: String,
    /// The container, or its address on a web server
    pub file: PathBuf,
    /// The picture to write; with --flight the folder for the frames
    #[arg(short, long, value_name = "OUT.png|FOLDER")]
    pub output: PathBuf,
    #[command(flatten)]
    pub look: look::Args,
    /// What answers the shadows; frames of a flight are drawn where they are answered
    #[arg(long, value_enum, default_value_t = Backend::Auto)]
    pub backend: Backend,
    #[command(flatten)]
    pub flight: flight::Args,
    /// One JSON object on stdout
    #[arg(long)]
    pub json: bool,
}

/// Runs the command.
pub fn run(args: Args) -> Result<(), Failure> {
    listen();
    let Some(camera) = args.look.camera()? else { return flight::run(&args) };
    args.flight.none()?;
    let start = Instant::now();
    let container = open(&args.file)?;
    let (structure, snapped) = args.look.scene(&container, &args.scene)?;
    let geometry = Scene::new(&snapped);
    let [width, height] = args.look.size;
    let view = geometry.view(&camera, width, height, &go_on).ok_or_else(Failure::interrupted)?;
    let pages = structure.page_count();
    let how = How { backend: args.backend, budget: args.look.budget(&container), skips: args.look.skips() };
    let look = args.look.look(Look::Texel);
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
