//! Meshes, lights and recorded cameras, the same on every machine, and baked files.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

use umbrage::format::Kind;
use umbrage::reader::query::Map;
use umbrage::reader::{Container, FileSource, Limits};
use umbrage::render::{Camera, Scene, UpAxis, View};
use umbrage::writer::bake::{BakeOptions, Baked, Light, bake};
use umbrage::writer::hierarchy::build::Progress;
use umbrage::writer::mesh::Mesh;
use umbrage::writer::scene;
use umbrage::writer::solid::Policy;

use crate::Failure;

/// The scenes of a suite unless others are named.
pub const SCENES: [&str; 3] = ["city:1", "forest:1", "scan:1"];
/// Directions in which light travels: the demo's, a high one, a low one, one from the other side. None is aligned with
/// an axis or a diagonal of the scenes.
pub const LIGHTS: [[f64; 3]; 4] =
    [scene::DEMO_LIGHT, [0.21, -0.93, -0.17], [-0.83, -0.34, 0.27], [-0.37, -0.61, -0.53]];

/// A mesh by its name.
pub struct Model {
    /// As given.
    pub name: String,
    /// The triangles.
    pub mesh: Mesh,
    /// Closed for generated scenes, auto for files.
    pub policy: Policy,
}

/// The named scenes, or the suite's own.
pub fn names<'a>(given: &'a [String], own: &[&'a str]) -> Vec<&'a str> {
    if given.is_empty() { own.to_vec() } else { given.iter().map(String::as_str).collect() }
}

/// Makes or loads a scene; `policy` instead of its usual one.
pub fn load(name: &str, policy: Option<Policy>) -> Result<Model, Failure> {
    let model = |mesh, usual| Model { name: name.to_string(), mesh, policy: policy.unwrap_or(usual) };
    if let Some(mesh) = scene::generated(name) {
        return Ok(model(mesh.map_err(Failure::input)?, Policy::Closed));
    }
    let loaded = scene::load::load(Path::new(name)).map_err(Failure::input)?;
    loaded.notes.iter().for_each(|note| eprintln!("{name}: {note}"));
    Ok(model(loaded.mesh, Policy::Auto))
}

impl Model {
    /// Four recorded cameras: the demo's where there is one, and others around the scene from its bounds.
    pub fn cameras(&self) -> Result<Vec<Camera>, Failure> {
        let mut low = [f64::INFINITY; 3];
        let mut high = [f64::NEG_INFINITY; 3];
        for p in &self.mesh.positions {
            for k in 0..3 {
                (low[k], high[k]) = (low[k].min(p[k]), high[k].max(p[k]));
            }
        }
        let centre: [f64; 3] = std::array::from_fn(|k| 0.5 * (low[k] + high[k]));
        let radius = (0..3).map(|k| (0.5 * (high[k] - low[k])).powi(2)).sum::<f64>().sqrt();
        let around = [[0.62, 0.5, 0.47], [0.04, 1.3, 0.07], [-0.95, 0.21, 0.33], [0.3, 0.4, -0.8]];
        let mut views: Vec<([f64; 3], [f64; 3], f64)> = Vec::new();
        if let Some(v) = scene::demo_view(&self.name) {
            let v = v.map_err(Failure::input)?;
            views.push((v.eye, v.target, v.fov_degrees));
        }
        for direction in around {
            views.push((std::array::from_fn(|k| centre[k] + radius * direction[k]), centre, 50.0));
        }
        views.truncate(4);
        let camera = |(eye, target, fov)| Camera::new(eye, target, UpAxis::Y, fov).map_err(Failure::input);
        views.into_iter().map(camera).collect()
    }

    /// What to bake.
    pub fn options(&self, direction: [f64; 3], resolution: u64, exhaustive: bool) -> BakeOptions {
        BakeOptions {
            lights: vec![Light { name: "sun".to_string(), direction }],
            resolution,
            policy: self.policy,
            kind: Kind::Mh,
            exhaustive,
            top_down: false,
            mmh: Default::default(),
            memory_bytes: None,
            cold: false,
        }
    }

    /// Bakes one light into a file of the folder, kind `mh`.
    pub fn bake(&self, light: [f64; 3], resolution: u64, folder: &Folder) -> Result<(Baked, PathBuf), Failure> {
        self.bake_as(Kind::Mh, light, resolution, folder)
    }

    /// Bakes one light into a file of the folder.
    pub fn bake_as(
        &self,
        kind: Kind,
        light: [f64; 3],
        resolution: u64,
        folder: &Folder,
    ) -> Result<(Baked, PathBuf), Failure> {
        let file = folder.file();
        let options = BakeOptions { kind, top_down: kind == Kind::Mmh, ..self.options(light, resolution, false) };
        Ok((bake(&self.mesh, &options, &file, &Progress::default())?, file))
    }
}

/// Views of all cameras.
pub fn views(scene: &Scene<'_>, cameras: &[Camera], width: u32, height: u32) -> Vec<View> {
    cameras.iter().filter_map(|c| scene.view(c, width, height, &|| true)).collect()
}

/// Opens the only structure of a file.
pub fn open(file: &Path) -> Result<Map, Failure> {
    Ok(Map::new(container(file)?.structure(0)?)?)
}

/// Opens a file.
pub fn container(file: &Path) -> Result<Container, Failure> {
    Ok(Container::open(Arc::new(FileSource::open(file)?), Limits::default())?)
}

/// A folder that goes away with its files.
pub struct Folder {
    path: PathBuf,
    next: AtomicU32,
}

impl Folder {
    /// Makes one among the system's temporary files.
    pub fn new() -> Result<Self, Failure> {
        let path = std::env::temp_dir().join(format!("umbrage-bench-{}", std::process::id()));
        std::fs::create_dir_all(&path).map_err(|e| Failure::target(format!("{}: {e}", path.display())))?;
        Ok(Folder { path, next: AtomicU32::new(0) })
    }

    /// A name that is free.
    pub fn file(&self) -> PathBuf {
        self.path.join(format!("{}.umb", self.next.fetch_add(1, Ordering::Relaxed)))
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        // What can't be removed is the system's to clean up.
        let _ = std::fs::remove_dir_all(&self.path);
    }
}
