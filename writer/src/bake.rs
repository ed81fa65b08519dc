//! The whole way of the writer: a mesh and lights in, a container file out.

use std::path::Path;
use std::sync::atomic::Ordering;
use std::time::Instant;

use umbrage_format::page::FrameHead;
use umbrage_format::projection::Lattice;
use umbrage_format::structure::{EVERYWHERE, ORTHOGRAPHIC, STATIC_SURFACES_ONLY};
use umbrage_format::{FileId, Kind, PageRecord, StructureRecord};
use xxhash_rust::xxh3::Xxh3;

use crate::container::{ContainerOptions, ContainerWriter, PageInput, WriteError, Written};
use crate::frame::{self, FrameError};
use crate::hierarchy::build::{Counts, Options, Progress, Stop, Tree, build, build_whole};
use crate::hierarchy::page::Page;
use crate::hierarchy::spool::Spool;
use crate::hierarchy::{mmh, vector};
use crate::mesh::Mesh;
use crate::solid::{self, Components, Policy, SnappedMesh, SolidError};

/// Changes whenever the same input would give other bytes.
pub(crate) const GENERATOR: u32 = 3;

/// Bytes of pages that a bake without a budget holds in memory before it puts them aside.
const SPOOL: u64 = 64 << 20;
/// The least that it holds.
pub(crate) const SPOOL_LEAST: u64 = 4 << 20;
/// The program itself, its threads' stacks and the lists of the squares they work on.
pub(crate) const PROGRAM: u64 = 32 << 20;
/// Groups of 32 x 32 squares of at most [`crate::hierarchy::page::PAGE_WORDS`], of which the root page keeps some.
pub(crate) const TOP: u64 = 56 << 20;

/// A directional light.
#[derive(Clone, Debug, PartialEq)]
pub struct Light {
    /// Name of the structure: 1 to 64 bytes, unique in the file.
    pub name: String,
    /// Where the light travels, any length but 0.
    pub direction: [f64; 3],
}

/// What to bake.
#[derive(Clone, Debug)]
pub struct BakeOptions {
    /// Lights, at least one.
    pub lights: Vec<Light>,
    /// Texels on a side, a power of two from 1 to 2^24.
    pub resolution: u64,
    /// How depth intervals come from geometry.
    pub policy: Policy,
    /// How texels are encoded: `mh`, `mmh` or `vector`.
    pub kind: Kind,
    /// Ask every texel, also where a whole square is proven. Of kinds `mh` and `mmh`.
    pub exhaustive: bool,
    /// Choose values from above within tiles (algorithm 1 of Scandolo 2019), not from below. Of kinds `mh` and `mmh`.
    pub top_down: bool,
    /// How kind `mmh` merges.
    pub mmh: mmh::Options,
    /// Most bytes that may be held at once, the mesh included; none: no limit.
    pub memory_bytes: Option<u64>,
    /// Store pages in their cold form.
    pub cold: bool,
}

/// Why a bake failed.
#[derive(Debug, thiserror::Error)]
pub enum BakeError {
    /// A light or the resolution.
    #[error(transparent)]
    Frame(#[from] FrameError),
    /// The mesh.
    #[error(transparent)]
    Solid(#[from] SolidError),
    /// The file.
    #[error(transparent)]
    Write(#[from] WriteError),
    /// No light, or a name that can't be.
    #[error("light '{name}': expected a name of 1 to 64 bytes without zero bytes that no other light has; rename it")]
    Name {
        /// The name.
        name: String,
    },
    /// The budget can't hold the work.
    #[error(
        "memory budget of {} MiB: {what} needs {} MiB; give at least --memory {mib}",
        budget >> 20,
        needed.div_ceil(1 << 20)
    )]
    Memory {
        /// What was given, bytes.
        budget: u64,
        /// What was about to be held.
        what: &'static str,
        /// Bytes that it needs.
        needed: u64,
        /// The option that would do so far, MiB.
        mib: u64,
    },
    /// Stopped by the caller.
    #[error("interrupted; nothing was written")]
    Cancelled,
}

/// What became of one light.
#[derive(Clone, Debug)]
pub struct LightReport {
    /// Name of the light.
    pub name: String,
    /// Map and counts.
    pub counts: Counts,
    /// Leaf, inner and empty nodes.
    pub nodes: [u64; 3],
    /// Pages.
    pub pages: u64,
    /// Largest distance that snapping moved a vertex, world units.
    pub displacement: f64,
    /// What the mesh is made of.
    pub components: Components,
    /// What merging did, in kind `mmh`.
    pub merged: Option<mmh::Report>,
}

/// Seconds of each stage, all lights together.
#[derive(Clone, Copy, Debug, Default)]
pub struct Seconds {
    /// Snapping, welding, components.
    pub snap: f64,
    /// Intervals and hierarchy.
    pub build: f64,
    /// Writing the file.
    pub write: f64,
}

/// What was written.
#[derive(Clone, Debug)]
pub struct Baked {
    /// One report for each light.
    pub lights: Vec<LightReport>,
    /// Bytes of the file.
    pub bytes: u64,
    /// Triangles of the scene.
    pub triangles: u64,
    /// Where the time went.
    pub seconds: Seconds,
    /// Geometry of the last light, snapped.
    pub last: SnappedMesh,
}

/// The lattice of a light over a mesh.
pub fn lattice(mesh: &Mesh, light: &Light, resolution: u64, policy: Policy) -> Result<Lattice, FrameError> {
    let behind = if let Policy::Thickness(t) = policy { t } else { 0.0 };
    frame::orthographic(light.direction, frame::log2_resolution(resolution)?, &mesh.positions, behind)
}

/// Bakes a mesh into a container at `target`: a temporary file beside it, renamed at the end. The same mesh and options
/// give the same bytes on any number of threads.
///
/// # Errors
/// Whatever is wrong with mesh, lights, resolution, memory or target; the old target stays.
pub fn bake(mesh: &Mesh, options: &BakeOptions, target: &Path, progress: &Progress) -> Result<Baked, BakeError> {
    solid::check_mesh(mesh)?;
    check_names(&options.lights.iter().map(|l| l.name.as_str()).collect::<Vec<_>>())?;
    let geometry = check_memory(mesh, options)?;
    let file_id = file_id(mesh, options);
    let mut seconds = Seconds::default();
    let mut done: Vec<(StructureRecord, Built, LightReport)> = Vec::new();
    let mut last: Option<SnappedMesh> = None;
    for light in &options.lights {
        // the geometry of the light before is no longer needed
        drop(last.take());
        let start = Instant::now();
        let lattice = lattice(mesh, light, options.resolution, options.policy)?;
        let snapped = solid::snap(mesh, lattice, options.policy)?;
        seconds.snap += start.elapsed().as_secs_f64();
        let start = Instant::now();
        let held = geometry + done.iter().map(|d| d.1.held()).sum::<u64>();
        let left = options.memory_bytes.map(|budget| budget.saturating_sub(held).max(1));
        progress.begin(left.unwrap_or(0));
        let error = transform_error(mesh, &snapped.lattice);
        let how = Options { exhaustive: options.exhaustive, guard: guard(error), top_down: options.top_down };
        let spool = || spool(target, left);
        let built = match options.kind {
            Kind::Vector => vector::build::build(&snapped, how, spool(), progress).map(Built::from),
            Kind::Mmh => build_whole(&snapped, how, progress).and_then(|(forest, root, counts)| {
                mmh::build(forest, root, counts, snapped.lattice.log2_resolution, options.mmh, progress)
                    .map(Built::Whole)
            }),
            _ => build(&snapped, how, spool(), progress).map(Built::from),
        };
        let tree = built.map_err(|stop| match stop {
            Stop::Cancelled => BakeError::Cancelled,
            Stop::Spool(e) => BakeError::Write(e),
            Stop::Budget => {
                let needed = held + progress.held();
                memory_error(options.memory_bytes.unwrap_or(0), "the geometry with the tree so far", needed)
            }
        })?;
        if options.lights.len() > 1 {
            tree.put_aside()?;
        }
        seconds.build += start.elapsed().as_secs_f64();
        let record = structure(mesh, light, options, &snapped, &tree, error)?;
        let report = LightReport {
            name: light.name.clone(),
            counts: tree.counts(),
            nodes: tree.nodes(),
            pages: tree.pages().into(),
            merged: if let Built::Whole(w) = &tree { Some(w.merged.clone()) } else { None },
            displacement: snapped.displacement,
            components: snapped.components,
        };
        done.push((record, tree, report));
        last = Some(snapped);
    }
    let start = Instant::now();
    let (trees, lights): (Vec<_>, Vec<_>) = done.into_iter().map(|(r, t, report)| ((r, t), report)).unzip();
    let written = write(target, container(file_id, options.cold), trees, progress)?;
    seconds.write = start.elapsed().as_secs_f64();
    Ok(Baked {
        lights,
        bytes: written.bytes,
        triangles: mesh.triangles.len() as u64,
        seconds,
        last: last.ok_or(BakeError::Name { name: String::new() })?,
    })
}

/// A finished tree of any kind.
#[derive(Debug)]
pub(crate) enum Built {
    /// Cut into pages while it was built.
    Paged(Tree),
    /// Merged as a whole, then cut.
    Whole(mmh::Tree),
}

impl From<Tree> for Built {
    fn from(tree: Tree) -> Self {
        Built::Paged(tree)
    }
}

impl Built {
    fn counts(&self) -> Counts {
        match self {
            Built::Paged(t) => t.counts,
            Built::Whole(t) => t.counts,
        }
    }

    fn nodes(&self) -> [u64; 3] {
        match self {
            Built::Paged(t) => t.spool.nodes(),
            Built::Whole(t) => t.pages.nodes,
        }
    }

    /// Pages, shared ones included.
    pub(crate) fn pages(&self) -> u32 {
        match self {
            Built::Paged(t) => t.spool.len(),
            Built::Whole(t) => t.pages.pages.len() as u32,
        }
    }

    /// Bytes in memory.
    fn held(&self) -> u64 {
        match self {
            Built::Paged(t) => t.spool.held(),
            Built::Whole(t) => t.pages.held(),
        }
    }

    /// Puts the pages into the spool's file where there is one; those of a whole tree stay.
    fn put_aside(&self) -> Result<(), WriteError> {
        let Built::Paged(tree) = self else { return Ok(()) };
        tree.spool.put_aside();
        tree.spool.failed().map_or(Ok(()), Err)
    }
}

/// Where the pages of one tree wait, within a share of what is left of the budget.
pub(crate) fn spool(target: &Path, left: Option<u64>) -> Spool {
    Spool::beside(target, left.map_or(SPOOL, |l| (l / 4).clamp(SPOOL_LEAST, SPOOL)) as usize)
}

/// Cold pages or not.
pub(crate) fn container(file_id: FileId, cold: bool) -> ContainerOptions {
    if cold { ContainerOptions::cold(file_id) } else { ContainerOptions::new(file_id) }
}

/// Puts finished trees into a container.
pub(crate) fn write(
    target: &Path,
    options: ContainerOptions,
    trees: Vec<(StructureRecord, Built)>,
    progress: &Progress,
) -> Result<Written, BakeError> {
    let records = trees.iter().map(|t| t.0).collect();
    let mut writer = ContainerWriter::create(target, options, records)?;
    for (record, tree) in trees {
        let kind = record.kind().unwrap_or(Kind::Mh);
        let mut push = |page: PageInput| {
            if progress.cancel.load(Ordering::Relaxed) {
                return Err(BakeError::Cancelled);
            }
            Ok(writer.push(&page)?)
        };
        match tree {
            Built::Paged(tree) => tree
                .spool
                .pages(tree.root)
                .enumerate()
                .try_for_each(|(ordinal, page)| push(input(page?, kind, ordinal == 0)))?,
            Built::Whole(whole) => whole.pages.pages.into_iter().try_for_each(push)?,
        }
    }
    Ok(writer.finish()?)
}

pub(crate) fn check_names(names: &[&str]) -> Result<(), BakeError> {
    if names.is_empty() {
        return Err(BakeError::Name { name: String::new() });
    }
    for (i, name) in names.iter().enumerate() {
        let fits = StructureRecord::zeroed().set_name(name);
        if !fits || names[..i].contains(name) {
            return Err(BakeError::Name { name: name.to_string() });
        }
    }
    Ok(())
}

pub(crate) fn memory_error(budget: u64, what: &'static str, needed: u64) -> BakeError {
    BakeError::Memory { budget, what, needed, mib: needed.div_ceil(1 << 20) + 1 }
}

/// Bytes that are taken whatever the tree will be; refuses before the work begins when they outgrow the budget.
fn check_memory(mesh: &Mesh, options: &BakeOptions) -> Result<u64, BakeError> {
    // per vertex: world, lattice, weld table; per triangle: two index lists, edges while components are found, surface
    let geometry = mesh.positions.len() as u64 * (24 + 24 + 64) + mesh.triangles.len() as u64 * (24 + 8 + 48 + 64);
    let needed = geometry + PROGRAM + SPOOL_LEAST;
    // what stays together until the root page is made, at most
    let top = options.resolution.saturating_mul(options.resolution).saturating_mul(16).min(TOP);
    match options.memory_bytes {
        Some(budget) if needed + top > budget => {
            Err(memory_error(budget, "the geometry with the first levels of a tree", needed + top))
        }
        _ => Ok(needed),
    }
}

/// Hash of geometry, options, format and generator version.
fn file_id(mesh: &Mesh, options: &BakeOptions) -> FileId {
    let mut h = Xxh3::new();
    let mut number = |v: u64| h.update(&v.to_le_bytes());
    number(GENERATOR.into());
    number((u64::from(umbrage_format::header::VERSION_MAJOR) << 16) | u64::from(umbrage_format::header::VERSION_MINOR));
    number(options.resolution);
    let (code, parameter) = policy_code(options.policy);
    number(code.into());
    number(parameter.to_bits());
    number(u64::from(options.exhaustive) | u64::from(options.kind.code() - 1) << 1);
    if options.kind == Kind::Mmh {
        number(options.mmh.search.into());
    }
    if options.top_down {
        number(1);
    }
    if options.cold {
        number(2);
    }
    number(options.lights.len() as u64);
    for l in &options.lights {
        number(l.name.len() as u64);
        l.name.bytes().for_each(|b| number(b.into()));
        l.direction.iter().for_each(|c| number(c.to_bits()));
    }
    number(mesh.positions.len() as u64);
    number(mesh.triangles.len() as u64);
    for p in &mesh.positions {
        p.iter().for_each(|c| number(c.to_bits()));
    }
    for t in &mesh.triangles {
        number(u64::from(t[0]) | u64::from(t[1]) << 32);
        number(t[2].into());
    }
    h.digest128().to_le_bytes()
}

fn policy_code(policy: Policy) -> (u32, f64) {
    match policy {
        Policy::Closed => (1, 0.0),
        Policy::OneSided => (2, 0.0),
        Policy::Thickness(t) => (3, t),
        Policy::SecondSurface => (4, 0.0),
        Policy::Auto => (5, 0.0),
    }
}

/// The policy that a structure was baked with.
pub fn policy_of(record: &StructureRecord) -> Option<Policy> {
    match record.policy.get() {
        1 => Some(Policy::Closed),
        2 => Some(Policy::OneSided),
        3 => Some(Policy::Thickness(record.policy_parameter.get())),
        4 => Some(Policy::SecondSurface),
        5 => Some(Policy::Auto),
        _ => None,
    }
}

/// Bound of the error of the world-to-lattice transform in the mesh's bounds, lattice units of depth.
fn transform_error(mesh: &Mesh, lattice: &Lattice) -> f64 {
    let mut bound = [0.0f64; 3];
    for p in &mesh.positions {
        for i in 0..3 {
            bound[i] = bound[i].max(p[i].abs());
        }
    }
    frame::transform_error(lattice, bound)
}

/// The distance that stored values keep from the ends of wide intervals.
pub(crate) fn guard(error: f64) -> u32 {
    error.ceil().min(4294967295.0) as u32
}

fn structure(
    mesh: &Mesh,
    light: &Light,
    options: &BakeOptions,
    snapped: &SnappedMesh,
    tree: &Built,
    error: f64,
) -> Result<StructureRecord, FrameError> {
    // A unit vector for directions of any length.
    let [_, _, direction] = frame::axes(light.direction)?;
    let (policy, parameter) = policy_code(options.policy);
    let mut r = StructureRecord::zeroed();
    r.set_name(&light.name);
    r.set_lattice(&snapped.lattice);
    r.kind = options.kind.code().into();
    r.projection = ORTHOGRAPHIC.into();
    r.light_direction = direction.map(f64::into);
    r.snap_displacement = snapped.displacement.into();
    r.transform_error = error.into();
    r.depth_guard = guard(error).into();
    r.policy = policy.into();
    r.policy_parameter = parameter.into();
    r.guarantee = if snapped.second_surface { STATIC_SURFACES_ONLY } else { EVERYWHERE }.into();
    r.edge_texels = tree.counts().edge_texels.into();
    r.thin_texels = tree.counts().thin_texels.into();
    r.triangles = (mesh.triangles.len() as u64).into();
    r.root_count = 1.into();
    r.page_count = tree.pages().into();
    if let Built::Whole(whole) = tree {
        r.shared_pages = whole.pages.shared.into();
        (r.index_block_log2, r.records_per_block) = whole.pages.blocks();
    }
    Ok(r)
}

/// A finished page as the container takes it; `root` where its root group is the root node of the map.
pub fn input(page: Page, kind: Kind, root: bool) -> PageInput {
    let (min, max) = page.depths();
    let stop = page.stop_error();
    let mut d = page.draft;
    let head = FrameHead {
        tag: kind.tag(),
        root_mask: d.root_mask.0,
        child_refs: d.refs.len() as u16,
        words: d.words.len() as u16,
        root_level: d.root_level,
    };
    d.words[..2].copy_from_slice(&head.encode());
    let mut record = PageRecord::zeroed();
    let side = if root { d.root_level } else { d.root_level + 1 };
    record.origin_x = d.origin[0].into();
    record.origin_y = d.origin[1].into();
    (record.log2_x, record.log2_y) = (side, side);
    (record.level_finest, record.level_coarsest) = (d.finest, d.root_level);
    (record.min_depth, record.max_depth) = (min.into(), max.into());
    record.stop_error = stop.into();
    PageInput { words: d.words, record, dependencies: Vec::new() }
}
