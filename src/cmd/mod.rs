//! The subcommands, and what they share: failures with exit codes, scenes, files, interruption, progress.

mod bake;
mod demo;
mod dump;
mod flight;
mod layers;
mod look;
mod merge;
mod output;
mod picture;
mod query;
mod render;
mod shadows;
mod verify;
#[cfg(feature = "viewer")]
mod view;

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
#[cfg(feature = "remote")]
use umbrage::reader::source::{HttpSource, Patience};
use umbrage::reader::{Container, FileSource, Limits, ReaderError, Source, Structure};
use umbrage::writer::bake::BakeError;
use umbrage::writer::container::WriteError;
use umbrage::writer::hierarchy::build::Progress;
use umbrage::writer::layers::LayersError;
use umbrage::writer::mesh::Mesh;
use umbrage::writer::scene;
use umbrage::writer::scene::load::{Bounds, Fault, LoadError};

/// Exit code: the arguments are wrong.
pub const USAGE: u8 = 2;
/// Exit code: input not readable or not valid.
pub const INPUT: u8 = 3;
/// Exit code: container refused.
pub const REFUSED: u8 = 4;
/// Exit code: target not writable, or not enough memory, disk or device.
pub const TARGET: u8 = 5;
/// Exit code: interrupted.
pub const INTERRUPTED: u8 = 130;

/// What to do.
#[derive(clap::Subcommand)]
pub enum Command {
    /// Bake the shadows of a scene into a container
    Bake(bake::Args),
    /// Look points or texels up
    Query(query::Args),
    /// Draw a view of the scene with the shadows of a container, or the frames of a flight
    Render(render::Args),
    /// Fly through the scene in a window while its shadows stream
    #[cfg(feature = "viewer")]
    View(view::Args),
    /// Put the lights of several containers into one
    Merge(merge::Args),
    /// Show what is in a container
    Dump(dump::Args),
    /// Check every rule of the format and, with the source, every stored value
    Verify(verify::Args),
    /// Bake a city, look at it, and hold the picture against ray casting
    Demo(demo::Args),
}

impl Command {
    /// Runs the subcommand.
    pub fn run(self) -> Result<(), Failure> {
        match self {
            Command::Bake(a) => bake::run(a),
            Command::Query(a) => query::run(a),
            Command::Render(a) => render::run(a),
            #[cfg(feature = "viewer")]
            Command::View(a) => view::run(a),
            Command::Merge(a) => merge::run(a),
            Command::Dump(a) => dump::run(a),
            Command::Verify(a) => verify::run(a),
            Command::Demo(a) => demo::run(a),
        }
    }
}

/// Why the program ends, in one line, and with which code.
#[derive(Debug)]
pub struct Failure {
    /// Exit code.
    pub code: u8,
    /// What happened, where, and what to do.
    pub message: String,
}

impl Failure {
    /// A failure with its exit code.
    pub fn new(code: u8, message: impl ToString) -> Self {
        Failure { code, message: message.to_string() }
    }

    /// Stopped by a signal.
    pub fn interrupted() -> Self {
        Failure::new(INTERRUPTED, "interrupted; no unfinished file was left behind")
    }
}

impl From<BakeError> for Failure {
    fn from(e: BakeError) -> Self {
        if let BakeError::Write(e) = e {
            return e.into();
        }
        let code = match &e {
            BakeError::Frame(umbrage::writer::frame::FrameError::Bounds(..)) | BakeError::Solid(_) => INPUT,
            BakeError::Frame(_) | BakeError::Name { .. } => USAGE,
            BakeError::Write(_) | BakeError::Memory { .. } => TARGET,
            BakeError::Cancelled => INTERRUPTED,
        };
        Failure::new(code, e)
    }
}

impl From<WriteError> for Failure {
    fn from(e: WriteError) -> Self {
        match e {
            WriteError::NameTwice { name } => {
                Failure::new(USAGE, format!("two lights are named '{name}'; give each a name of its own"))
            }
            e => Failure::new(TARGET, e),
        }
    }
}

impl From<LoadError> for Failure {
    fn from(e: LoadError) -> Self {
        match e.fault {
            Fault::Stopped => Failure::interrupted(),
            Fault::Memory { .. } => Failure::new(TARGET, e),
            _ => Failure::new(INPUT, e),
        }
    }
}

impl From<LayersError> for Failure {
    fn from(e: LayersError) -> Self {
        match e {
            LayersError::Bake(e) => e.into(),
            LayersError::Stopped => Failure::interrupted(),
            e => Failure::new(INPUT, e),
        }
    }
}

impl From<ReaderError> for Failure {
    fn from(e: ReaderError) -> Self {
        let code = match &e {
            ReaderError::UnknownStructure { file, name, names } => {
                let message = format!("{file}: no light is named '{name}'; it has {}", names.join(", "));
                return Failure::new(USAGE, message);
            }
            ReaderError::Io { .. } => INPUT,
            ReaderError::Stopped { .. } => return Failure::interrupted(),
            ReaderError::OutOfRange { .. } => USAGE,
            _ => REFUSED,
        };
        Failure::new(code, e)
    }
}

impl From<umbrage::render::ImageError> for Failure {
    fn from(e: umbrage::render::ImageError) -> Self {
        Failure::new(TARGET, e)
    }
}

/// A scene: `city:SEED[:SIZE]`, `forest:...`, `scan:...`, or a mesh file. What a file has that is ignored or
/// changed is said on stderr.
pub fn load_scene(spec: &str) -> Result<Mesh, Failure> {
    load_scene_within(spec, None)
}

/// As [`load_scene`], within a memory budget in bytes.
pub fn load_scene_within(spec: &str, memory_bytes: Option<u64>) -> Result<Mesh, Failure> {
    if let Some(mesh) = scene::generated(spec) {
        return mesh.map_err(|e| Failure::new(INPUT, e));
    }
    let bounds = Bounds { memory_bytes, keep_on: &go_on };
    let loaded = scene::load::load_within(Path::new(spec), &bounds)?;
    for note in &loaded.notes {
        eprintln!("{spec}: {note}");
    }
    Ok(loaded.mesh)
}

/// Opens a container with positioned reads, or by ranges where the path is the address of one on a web server.
pub fn open(path: &Path) -> Result<Container, ReaderError> {
    let url = path.to_str().filter(|p| p.starts_with("http://") || p.starts_with("https://"));
    Container::open(url.map_or_else(|| file(path), remote)?, Limits::default())
}

fn file(path: &Path) -> Result<Arc<dyn Source>, ReaderError> {
    Ok(Arc::new(FileSource::open(path)?))
}

#[cfg(feature = "remote")]
fn remote(url: &str) -> Result<Arc<dyn Source>, ReaderError> {
    Ok(Arc::new(HttpSource::open(url, Patience::default())?))
}

#[cfg(not(feature = "remote"))]
fn remote(url: &str) -> Result<Arc<dyn Source>, ReaderError> {
    let text = "built without the feature remote; build with it, or fetch the file";
    let source = Arc::new(std::io::Error::new(std::io::ErrorKind::Unsupported, text));
    Err(ReaderError::Io { file: url.into(), action: "open", source })
}

/// The named structure, or the only one.
pub fn structure(container: &Container, name: Option<&str>) -> Result<Structure, Failure> {
    match name {
        Some(name) => Ok(container.structure_named(name)?),
        None if container.structure_count() == 1 => Ok(container.structure(0)?),
        None => {
            let names: Vec<String> = container.structures().map(|s| s.name().to_string()).collect();
            Err(Failure::new(
                USAGE,
                format!("{} has several lights ({}); name one with --light", container.file(), names.join(", ")),
            ))
        }
    }
}

/// Comma-separated finite numbers.
pub fn parse_numbers<const N: usize>(s: &str) -> Result<[f64; N], String> {
    let parts: Vec<&str> = s.split(',').collect();
    let numbers: Vec<f64> =
        parts.iter().filter_map(|p| p.trim().parse().ok()).filter(|v: &f64| v.is_finite()).collect();
    match (parts.len() == N, <[f64; N]>::try_from(numbers)) {
        (true, Ok(n)) => Ok(n),
        _ => Err(format!("expected {N} numbers separated by commas, found '{s}'")),
    }
}

/// A parser of whole numbers in a range.
pub fn whole<T: TryFrom<u64>>(least: u64, most: u64) -> impl Fn(&str) -> Result<T, String> + Clone + Send + Sync {
    move |s| {
        let number = s.parse().ok().filter(|n| (least..=most).contains(n)).and_then(|n| T::try_from(n).ok());
        number.ok_or_else(|| format!("expected a whole number from {least} to {most}, found '{s}'"))
    }
}

/// Texels on a side. Which numbers can be is said where the map is made.
pub fn parse_resolution(s: &str) -> Result<u64, String> {
    s.parse().map_err(|_| format!("expected a power of two from 1 to 16777216, found '{s}'"))
}

/// Set once a signal has come.
static STOP: AtomicBool = AtomicBool::new(false);

/// Whether to go on; for loops that can end early.
pub fn go_on() -> bool {
    !STOP.load(Ordering::Relaxed)
}

/// Work that shows how far it is (on a terminal) and ends early when a signal comes.
pub struct Watched {
    /// What the builder reports to.
    pub progress: Arc<Progress>,
    done: Arc<AtomicBool>,
    thread: Option<std::thread::JoinHandle<()>>,
}

impl Watched {
    /// Starts to watch; `texels` is the whole.
    pub fn start(texels: u64) -> Self {
        listen();
        let progress = Arc::new(Progress::default());
        let done = Arc::new(AtomicBool::new(false));
        let (p, d) = (progress.clone(), done.clone());
        let thread = std::thread::spawn(move || {
            // indicatif draws nothing where stderr is not a terminal
            let bar = ProgressBar::with_draw_target(Some(texels), ProgressDrawTarget::stderr());
            if let Ok(style) = ProgressStyle::with_template("{elapsed_precise} {wide_bar} {percent} % {eta}") {
                bar.set_style(style);
            }
            while !d.load(Ordering::Relaxed) {
                if !go_on() {
                    p.cancel.store(true, Ordering::Relaxed);
                }
                bar.set_position(p.texels.load(Ordering::Relaxed));
                std::thread::park_timeout(Duration::from_millis(100));
            }
            bar.finish_and_clear();
        });
        Watched { progress, done, thread: Some(thread) }
    }
}

impl Drop for Watched {
    fn drop(&mut self) {
        self.done.store(true, Ordering::Relaxed);
        if let Some(t) = self.thread.take() {
            t.thread().unpark();
            let _ = t.join();
        }
    }
}

/// Turns signals into [`go_on`] saying no; a second one ends the program at once.
pub fn listen() {
    // fails only when a handler is set already: that one is ours
    let _ = ctrlc::set_handler(|| {
        if STOP.swap(true, Ordering::Relaxed) {
            std::process::exit(INTERRUPTED.into());
        }
    });
}
