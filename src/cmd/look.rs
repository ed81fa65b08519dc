//! What `render` and `view` share: which light, which camera, how the map is looked up and streamed.

use std::path::Path;

use umbrage::reader::{Container, Structure};
use umbrage::render::{Camera, Flight, Look, UpAxis, parse_look};
use umbrage::writer::solid::SnappedMesh;

use super::shadows::default_budget;
use super::{Failure, INPUT, USAGE, load_scene, parse_numbers, picture, structure, whole};

/// Vertical field of view where nobody says one, degrees.
pub const FOV: f64 = 45.0;

/// Arguments of both.
// every struct would be a group of this name
#[derive(clap::Args)]
#[group(skip)]
pub struct Args {
    /// Which light; may be left out where there is only one
    #[arg(long)]
    light: Option<String>,
    /// Eye and target in world units
    #[arg(long, value_name = "EX,EY,EZ,TX,TY,TZ", allow_hyphen_values = true, value_parser = parse_numbers::<6>)]
    camera: Option<[f64; 6]>,
    /// Which way is up [default: y; a flight says it itself]
    #[arg(long, value_parser = ["y", "z"])]
    up: Option<String>,
    /// Vertical field of view, degrees [default: 45; a flight says it itself]
    #[arg(long, allow_negative_numbers = true, value_parser = parse_fov)]
    fov: Option<f64>,
    /// Pixels
    #[arg(long, default_value = "1280x720", value_name = "WxH", value_parser = parse_size, allow_hyphen_values = true)]
    pub size: [u32; 2],
    /// Look the map up at the place in the texel where it is proven there (kind vector): edges as sharp as the geometry's
    #[arg(long)]
    continuous: bool,
    /// Soften edges by percentage-closer filtering: hard (none), pcf:N (N x N texels), hpcf (3 x 3 of the level as fine as the
    /// pixel; hpcf:N), trilinear (the same, blended between two levels; trilinear:N) [default: hard; in `view` hpcf]
    #[arg(long, value_name = "FILTER", conflicts_with = "continuous", value_parser = parse_look)]
    filter: Option<Look>,
    /// Lattice steps of depth that shadows may be off by: pages are not read whose index record promises no more
    #[arg(long, value_name = "STEPS", default_value_t = 0, allow_negative_numbers = true, value_parser = whole::<u32>(0, 0xFFFF_FFFE))]
    error: u32,
    /// Read every page on the way, also where the index says that it changes nothing; for comparisons
    #[arg(long, conflicts_with = "error")]
    no_skip: bool,
    /// Most memory for the streamer, MiB; half of the file without it
    #[arg(long, value_name = "MIB", allow_negative_numbers = true, value_parser = whole::<u64>(1, 1 << 20))]
    budget: Option<u64>,
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

impl Args {
    /// The camera that was asked for, if one was.
    pub fn camera(&self) -> Result<Option<Camera>, Failure> {
        let fov = self.fov(FOV);
        let camera = |[ex, ey, ez, tx, ty, tz]: [f64; 6]| Camera::new([ex, ey, ez], [tx, ty, tz], self.up(), fov);
        self.camera.map(camera).transpose().map_err(|e| Failure::new(USAGE, e))
    }

    /// Which way is up.
    pub fn up(&self) -> UpAxis {
        if self.up.as_deref() == Some("z") { UpAxis::Z } else { UpAxis::Y }
    }

    /// Vertical field of view, degrees; `usual` where nothing was said.
    pub fn fov(&self, usual: f64) -> f64 {
        self.fov.unwrap_or(usual)
    }

    /// A flight has its own up and field of view: another one is refused.
    pub fn flies(&self) -> Result<(), Failure> {
        match self.up.is_some() || self.fov.is_some() {
            true => Err(Failure::new(USAGE, "--up and --fov: a flight says both itself; leave them out")),
            false => Ok(()),
        }
    }

    /// How the map is looked up; `usual` where nothing was said.
    pub fn look(&self, usual: Look) -> Look {
        if self.continuous { Look::Place } else { self.filter.unwrap_or(usual) }
    }

    /// What the index may settle.
    pub fn skips(&self) -> Option<u32> {
        (!self.no_skip).then_some(self.error)
    }

    /// Most bytes of the streamer.
    pub fn budget(&self, container: &Container) -> u64 {
        self.budget.map_or_else(|| default_budget(container), |m| m << 20)
    }

    /// The structure that was asked for, and the scene as it was baked.
    pub fn scene(&self, container: &Container, scene: &str) -> Result<(Structure, SnappedMesh), Failure> {
        let structure = structure(container, self.light.as_deref())?;
        let mesh = load_scene(scene)?;
        let snapped = picture::snapped(&mesh, &structure)?;
        Ok((structure, snapped))
    }
}

/// Reads a recorded flight.
pub fn flight(path: &Path) -> Result<Flight, Failure> {
    let failed = |e: &dyn std::fmt::Display| Failure::new(INPUT, format!("{}: {e}", path.display()));
    let text = std::fs::read_to_string(path).map_err(|e| failed(&e))?;
    Flight::parse(&text).map_err(|e| failed(&e))
}
