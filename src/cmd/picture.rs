//! A view of a scene with the answers of a container: what `render` and `demo` share.

use std::collections::HashMap;

use rayon::prelude::*;
use umbrage::certify::Oracle;
use umbrage::reader::query::Map;
use umbrage::reader::{ReaderError, Structure};
use umbrage::render::{Filter, Footprints, Placement, Surface, View};
use umbrage::writer::bake::policy_of;
use umbrage::writer::mesh::Mesh;
use umbrage::writer::solid::{self, SnappedMesh};

use super::{Failure, INPUT, REFUSED, go_on};

/// The scene as it was when this structure was baked: snapped to its lattice under its policy.
pub fn snapped(mesh: &Mesh, structure: &Structure) -> Result<SnappedMesh, Failure> {
    if structure.record().is_from_layers() {
        return Err(Failure::new(
            INPUT,
            format!(
                "light '{}' was baked from depth layers, which no scene can be held against; `umbrage verify` takes the .exr file",
                structure.name()
            ),
        ));
    }
    let policy = policy_of(structure.record())
        .ok_or_else(|| Failure::new(REFUSED, format!("light '{}': unknown policy", structure.name())))?;
    let triangles = structure.record().triangles.get();
    if triangles != mesh.triangles.len() as u64 {
        return Err(Failure::new(
            INPUT,
            format!(
                "light '{}' was baked from {triangles} triangles, the scene has {}; give the scene it was baked from",
                structure.name(),
                mesh.triangles.len()
            ),
        ));
    }
    solid::snap(mesh, structure.lattice(), policy).map_err(|e| Failure::new(INPUT, e))
}

/// Light or shadow of every pixel, by the map, on the CPU; pixels without a receiver are lit. With `continuous` the map is
/// looked up at the receiver's place in its texel.
pub fn lit_by_map(view: &View, map: &Map, continuous: bool) -> Result<Vec<bool>, Failure> {
    let lattice = map.lattice();
    let answers: Result<Vec<bool>, ReaderError> = view
        .receivers
        .par_iter()
        .map(|r| match r {
            Some(r) if go_on() => {
                let [x, y] = r.texel(&lattice);
                if continuous {
                    return Ok(r.lit(map.continuous(x, y, r.sub(&lattice))?.value));
                }
                map.is_lit(x, y, 0, r.depth.query())
            }
            _ => Ok(true),
        })
        .collect();
    if go_on() { Ok(answers?) } else { Err(Failure::interrupted()) }
}

/// Share of sunlight of every pixel, by the map under a filter, on the CPU; pixels without a receiver are lit.
pub fn filtered_by_map(view: &View, surface: Surface<'_>, map: &Map, filter: Filter) -> Result<Vec<u8>, Failure> {
    let of = Footprints::new(view, surface);
    let coverage: Result<Vec<u8>, ReaderError> = (0..view.receivers.len())
        .into_par_iter()
        .map(|pixel| match of.receiver(pixel) {
            Some(r) if go_on() => {
                let (side, lod) = filter.at(&of, pixel);
                Ok(map.trilinear(&r, side, lod)?.coverage())
            }
            _ => Ok(255),
        })
        .collect();
    if go_on() { Ok(coverage?) } else { Err(Failure::interrupted()) }
}

/// Pixels that no promise covers: their texel is an edge texel, or the light sees their triangle edge-on.
pub fn edges(view: &View, mesh: &SnappedMesh) -> Result<Vec<bool>, Failure> {
    let oracle = Oracle::new(mesh);
    let mut texels: Vec<[u32; 2]> = view.receivers.iter().flatten().map(|r| r.texel(&mesh.lattice)).collect();
    texels.par_sort_unstable();
    texels.dedup();
    let certified: HashMap<[u32; 2], bool> =
        texels.into_par_iter().map(|[x, y]| ([x, y], go_on() && oracle.texel(x, y).certified)).collect();
    if !go_on() {
        return Err(Failure::interrupted());
    }
    let edge = |r: &umbrage::render::Receiver| r.placement != Placement::Exact || !certified[&r.texel(&mesh.lattice)];
    Ok(view.receivers.iter().map(|r| r.as_ref().is_some_and(edge)).collect())
}
