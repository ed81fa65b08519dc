//! A window in which a camera flies through a scene while its shadows stream.
//!
//! `app` is the window and its events, `panel` what is shown beside the picture. The way of a frame: input moves the camera, the
//! [`Stage`](super::Stage) draws, the panel lies over it; nothing waits for pages.

mod app;
mod panel;

use std::path::PathBuf;

use umbrage_reader::{Container, Structure};
use umbrage_runtime::stream::FrameStats;
use umbrage_writer::solid::SnappedMesh;

use super::{Style, ViewError};
use crate::render::{Camera, Flight};

/// Frames whose times are shown.
const KEPT_TIMES: usize = 240;

/// What the window begins with.
#[derive(Clone, Debug)]
pub struct Options {
    /// Title, and the first line of the panel.
    pub title: String,
    /// Pixels across and down.
    pub size: [u32; 2],
    /// Filter and overlay.
    pub style: Style,
    /// Most bytes that the streamer may hold.
    pub budget: u64,
    /// Error in lattice steps up to which the index settles receivers; none: every page on the way is read.
    pub skips: Option<u32>,
    /// Where the camera begins.
    pub start: Camera,
    /// Its vertical field of view, degrees.
    pub fov: f64,
    /// World units a second; none: a twentieth of the map.
    pub speed: Option<f64>,
    /// A flight that is flown at first.
    pub flight: Option<Flight>,
    /// Folder for pictures and recorded flights.
    pub folder: PathBuf,
    /// Closes by itself after so many seconds.
    pub seconds: Option<f64>,
}

/// What it was like.
#[derive(Clone, Debug)]
pub struct Summary {
    /// Name of the device.
    pub device: String,
    /// Frames.
    pub frames: u64,
    /// From the first frame to the last.
    pub seconds: f64,
    /// Milliseconds from frame to frame: median and worst of the last ones.
    pub frame_ms: [f64; 2],
    /// The last frame.
    pub last: FrameStats,
    /// Pages read.
    pub pages_read: u64,
    /// Files that were written.
    pub files: Vec<PathBuf>,
}

/// Opens the window, and comes back when it is closed, `go_on` says no, or the time is over.
///
/// # Errors
/// There is no display, no device that draws on it, the scene is larger than it takes, or the device was lost.
pub fn run(
    container: &Container,
    structure: &Structure,
    mesh: &SnappedMesh,
    options: &Options,
    go_on: &dyn Fn() -> bool,
) -> Result<Summary, ViewError> {
    app::run(container, structure, mesh, options, go_on)
}
