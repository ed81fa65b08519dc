//! From depth sources to a container: the way of [`crate::bake::bake`], without geometry.

use std::path::Path;
use std::sync::atomic::Ordering;
use std::time::Instant;

use umbrage_format::header::{VERSION_MAJOR, VERSION_MINOR};
use umbrage_format::projection::Lattice;
use umbrage_format::structure::ORTHOGRAPHIC;
use umbrage_format::{FileId, Kind, StructureRecord};
use xxhash_rust::xxh3::Xxh3;

use super::{DepthScale, DepthSource, LatticeLayers, LayersError, Second, TileBuffer, projection};
use crate::bake::{
    BakeError, GENERATOR, PROGRAM, SPOOL_LEAST, Seconds, TOP, check_names, container, guard, memory_error, spool, write,
};
use crate::frame;
use crate::hierarchy::build::{Counts, Progress, Tree};
use crate::hierarchy::layers::build;

/// How to bake.
#[derive(Clone, Copy, Debug, Default)]
pub struct LayersOptions {
    /// Most bytes that may be held at once; none: no limit.
    pub memory_bytes: Option<u64>,
    /// Store pages in their cold form.
    pub cold: bool,
}

/// What became of one source.
#[derive(Clone, Debug)]
pub struct LayersReport {
    /// Name of the light.
    pub name: String,
    /// What the second depths are.
    pub second: Second,
    /// World to lattice.
    pub lattice: Lattice,
    /// Map and counts; every texel is an edge texel.
    pub counts: Counts,
    /// Leaf, inner and empty nodes.
    pub nodes: [u64; 3],
    /// Pages.
    pub pages: u64,
}

/// What was written.
#[derive(Clone, Debug)]
pub struct BakedLayers {
    /// One report for each source.
    pub lights: Vec<LayersReport>,
    /// Bytes of the file.
    pub bytes: u64,
    /// Its id.
    pub file_id: FileId,
    /// Where the time went; `snap` is the search for the depth range.
    pub seconds: Seconds,
}

/// Bakes depth layers into a container at `target`: a temporary file beside it, renamed at the end. The same keys,
/// depths and options give the same bytes on any number of threads. `progress.texels` counts to the sum of all maps.
///
/// # Errors
/// Whatever is wrong with sources, depths, memory or target; the old target stays.
pub fn bake_layers(
    sources: &[&dyn DepthSource],
    options: &LayersOptions,
    target: &Path,
    progress: &Progress,
) -> Result<BakedLayers, LayersError> {
    check_names(&sources.iter().map(|s| s.name()).collect::<Vec<_>>())?;
    let held = check_memory(sources, options)?;
    let stopped = |e, held: u64| match (e, options.memory_bytes, progress.cancel.load(Ordering::Relaxed)) {
        (LayersError::Stopped, Some(budget), false) => {
            memory_error(budget, "the layers with the tree so far", held + progress.held()).into()
        }
        (LayersError::Stopped, ..) => BakeError::Cancelled.into(),
        (e, ..) => e,
    };
    let file_id = file_id(sources, options.cold);
    let mut seconds = Seconds::default();
    let mut done: Vec<(StructureRecord, Tree, LayersReport)> = Vec::new();
    for &source in sources {
        let start = Instant::now();
        let keep_on = || !progress.cancel.load(Ordering::Relaxed);
        let layers = LatticeLayers::new(source, &keep_on).map_err(|e| stopped(e, held))?;
        seconds.snap += start.elapsed().as_secs_f64();
        let start = Instant::now();
        let held = held + done.iter().map(|d| d.1.spool.held()).sum::<u64>();
        let left = options.memory_bytes.map(|budget| budget.saturating_sub(held).max(1));
        progress.begin(left.unwrap_or(0));
        let lattice = layers.lattice();
        let error = frame::transform_error(&lattice, projection::bound(&lattice));
        let tree = build(&layers, guard(error), spool(target, left), progress).map_err(|e| stopped(e, held))?;
        if sources.len() > 1 {
            tree.spool.put_aside();
            if let Some(e) = tree.spool.failed() {
                return Err(BakeError::from(e).into());
            }
        }
        seconds.build += start.elapsed().as_secs_f64();
        let report = LayersReport {
            name: source.name().to_string(),
            second: layers.second(),
            lattice,
            counts: tree.counts,
            nodes: tree.spool.nodes(),
            pages: tree.spool.len().into(),
        };
        done.push((structure(source, &layers, &tree, error)?, tree, report));
    }
    let start = Instant::now();
    let (trees, lights): (Vec<_>, Vec<_>) = done.into_iter().map(|(r, t, report)| ((r, t.into()), report)).unzip();
    let written = write(target, container(file_id, options.cold), trees, progress)?;
    seconds.write = start.elapsed().as_secs_f64();
    Ok(BakedLayers { lights, bytes: written.bytes, file_id, seconds })
}

/// Bytes that the sources and the tiles in work take; refuses before the work begins when they outgrow the budget.
fn check_memory(sources: &[&dyn DepthSource], options: &LayersOptions) -> Result<u64, LayersError> {
    let tiles = rayon::current_num_threads() as u64 * TileBuffer::BYTES;
    let needed = sources.iter().fold(tiles + PROGRAM + SPOOL_LEAST, |sum, s| sum.saturating_add(s.bytes()));
    let texels = sources.iter().map(|s| 1u64 << (2 * s.projection().log2_resolution.min(24))).max().unwrap_or(0);
    let top = texels.saturating_mul(16).min(TOP);
    match options.memory_bytes {
        Some(budget) if needed.saturating_add(top) > budget => {
            Err(memory_error(budget, "the layers with the first levels of a tree", needed.saturating_add(top)).into())
        }
        _ => Ok(needed),
    }
}

/// Hash of the callers' keys, the options, format and generator version.
fn file_id(sources: &[&dyn DepthSource], cold: bool) -> FileId {
    let mut h = Xxh3::new();
    let number = |h: &mut Xxh3, v: u64| h.update(&v.to_le_bytes());
    let text = |h: &mut Xxh3, bytes: &[u8]| {
        number(h, bytes.len() as u64);
        h.update(bytes);
    };
    // Geometry begins with a number; a text that no number equals keeps the two apart.
    text(&mut h, b"umbrage depth layers");
    number(&mut h, GENERATOR.into());
    number(&mut h, u64::from(VERSION_MAJOR) << 16 | u64::from(VERSION_MINOR));
    number(&mut h, sources.len() as u64);
    for s in sources {
        text(&mut h, s.name().as_bytes());
        number(&mut h, s.second().codes().0.into());
        let p = s.projection();
        p.world_to_layers.iter().flatten().for_each(|v| number(&mut h, v.to_bits()));
        number(&mut h, p.log2_resolution.into());
        let (kind, near, far) = match p.depth {
            DepthScale::Found => (0, 0.0, 0.0),
            DepthScale::Between(near, far) => (1, near, far),
            DepthScale::LatticeSteps => (2, 0.0, 0.0),
        };
        [kind, f64::to_bits(near), f64::to_bits(far)].iter().for_each(|v| number(&mut h, *v));
        text(&mut h, &s.key());
    }
    if cold {
        number(&mut h, 2);
    }
    h.digest128().to_le_bytes()
}

fn structure(
    source: &dyn DepthSource,
    layers: &LatticeLayers,
    tree: &Tree,
    error: f64,
) -> Result<StructureRecord, LayersError> {
    let lattice = layers.lattice();
    let fault = |what| LayersError::Projection { name: source.name().to_string(), what };
    let direction = source.projection().direction().map_err(fault)?;
    let (policy, guarantee) = layers.second().codes();
    let mut r = StructureRecord::zeroed();
    r.set_name(source.name());
    r.set_lattice(&lattice);
    r.kind = (Kind::Mh as u32).into();
    r.projection = ORTHOGRAPHIC.into();
    r.light_direction = direction.map(Into::into);
    r.transform_error = error.into();
    r.depth_guard = guard(error).into();
    (r.policy, r.guarantee) = (policy.into(), guarantee.into());
    r.edge_texels = tree.counts.edge_texels.into();
    r.thin_texels = tree.counts.thin_texels.into();
    r.root_count = 1.into();
    r.page_count = tree.spool.len().into();
    Ok(r)
}
