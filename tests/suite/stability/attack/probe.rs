//! One bake through the public interface, and everything that can be held against it.

use std::path::Path;
use std::sync::Arc;

use super::ray::Ray;
use super::spots::spots;
use umbrage::certify::stop::Stops;
use umbrage::certify::{Oracle, Region};
use umbrage::format::Kind;
use umbrage::reader::query::Map;
use umbrage::reader::{Container, FileSource, Limits};
use umbrage::writer::bake::{BakeError, BakeOptions, Light, bake};
use umbrage::writer::mesh::Mesh;
use umbrage::writer::solid::{Policy, snap};

/// Maps of more texels on a side are looked at around points only.
const WHOLE: u32 = 1024;
/// Side of the square of texels around a point.
const AROUND: u32 = 4;
/// Faults that are told in words.
const TOLD: usize = 8;

/// What is baked.
#[derive(Clone, Copy, Debug)]
pub struct Case {
    /// How texels are encoded.
    pub kind: Kind,
    /// What lies behind a surface.
    pub policy: Policy,
    /// Where the light travels.
    pub light: [f64; 3],
    /// Texels on a side.
    pub resolution: u64,
    /// Points that are looked at with rays.
    pub points: u32,
}

/// What was found.
#[derive(Clone, Debug, Default)]
pub struct Found {
    /// Texels whose stored value was held against its interval.
    pub texels: u64,
    /// Those outside of it: none, if all is right.
    pub outside: u64,
    /// Texels without an area interval, and those of them whose centre ray is thin.
    pub edge: u64,
    /// See `edge`.
    pub thin: u64,
    /// Receivers that a ray decided.
    pub receivers: u64,
    /// Wrong answers on certified texels: none, if all is right.
    pub wrong: u64,
    /// Wrong answers on edge texels, where nothing is promised.
    pub wrong_on_edge: u64,
    /// Bytes of the files.
    pub bytes: u64,
    /// Bakes that were refused, as they should.
    pub refused: u64,
    /// All that is wrong, in words, the first few.
    pub faults: Vec<String>,
}

impl Found {
    fn fault(&mut self, case: &Case, what: impl std::fmt::Display) {
        if self.faults.len() < TOLD {
            self.faults.push(format!("{case:?}: {what}"));
        }
    }

    /// Texels that are right for every receiver.
    pub fn certified(&self) -> u64 {
        self.texels - self.edge
    }

    /// Adds another bake's.
    pub fn add(&mut self, other: Found) {
        self.texels += other.texels;
        self.outside += other.outside;
        self.edge += other.edge;
        self.thin += other.thin;
        self.receivers += other.receivers;
        self.wrong += other.wrong;
        self.wrong_on_edge += other.wrong_on_edge;
        self.bytes += other.bytes;
        self.refused += other.refused;
        self.faults.extend(other.faults);
        self.faults.truncate(TOLD);
    }
}

/// Bakes to `target` and holds the file against the mesh. The file is removed.
///
/// # Errors
/// What the bake refuses.
pub fn probe(mesh: &Mesh, case: &Case, target: &Path) -> Result<Found, BakeError> {
    let bytes = bake_to(mesh, case, target)?;
    let found = Found { bytes, ..hold(mesh, case, target) };
    // A file that is still there is in the way of nothing.
    let _ = std::fs::remove_file(target);
    Ok(found)
}

/// Bakes through the public interface; bytes of the file.
///
/// # Errors
/// What the bake refuses.
pub fn bake_to(mesh: &Mesh, case: &Case, target: &Path) -> Result<u64, BakeError> {
    let options = BakeOptions {
        lights: vec![Light { name: "sun".to_string(), direction: case.light }],
        resolution: case.resolution,
        policy: case.policy,
        kind: case.kind,
        exhaustive: false,
        top_down: false,
        mmh: Default::default(),
        memory_bytes: None,
        cold: false,
    };
    Ok(bake(mesh, &options, target, &Default::default())?.bytes)
}

/// Reads a file back and holds it against the format's rules and, with the oracle and plain rays, against a mesh.
pub fn hold(mesh: &Mesh, case: &Case, target: &Path) -> Found {
    let mut found = Found::default();
    if let Err(e) = look(mesh, case, target, &mut found) {
        found.fault(case, e);
    }
    found
}

fn look(mesh: &Mesh, case: &Case, target: &Path, found: &mut Found) -> Result<(), Box<dyn std::error::Error>> {
    let file = Container::open(Arc::new(FileSource::open(target)?), Limits::default())?;
    file.verify(|e| found.fault(case, e));
    let map = Map::new(file.structure(0)?)?;
    let record = *map.structure().record();
    let snapped = snap(mesh, map.lattice(), case.policy)?;
    let resident = map.preload()?;
    let oracle = Oracle::new(&snapped).with_guard(record.depth_guard.get());
    let stops = Stops::new(map.structure(), &|| true)?;
    let side = map.resolution();
    let value = |x, y| resident.value(x, y, 0);
    let bits = snapped.lattice.subtexel_bits;
    let texel_of = |p: [i64; 2]| p.map(|v| (v >> bits) as u32);
    let points = spots(&snapped, &map, case.points, case.resolution);

    let regions: Vec<Region> = if side <= WHOLE {
        vec![Region { x: 0, y: 0, width: side, height: side }]
    } else {
        let near = |v: u32| v.saturating_sub(AROUND / 2).min(side - AROUND);
        let region = |p: &[i64; 2]| texel_of(*p).map(near);
        points.iter().map(region).map(|[x, y]| Region { x, y, width: AROUND, height: AROUND }).collect()
    };
    for region in regions {
        let tally = oracle.check(region, value);
        found.texels += tally.texels;
        found.outside += tally.wrong;
        found.edge += tally.edge();
        found.thin += tally.thin;
        for [x, y] in tally.examples {
            found.fault(case, format!("texel {x}, {y}: stored {}, right is {:?}", value(x, y), oracle.texel(x, y)));
        }
        let stopped = stops.check(region, 1, value, |x, y| oracle.texel(x, y).interval);
        stopped.examples.iter().for_each(|e| found.fault(case, format!("{e:?}")));
    }
    if side <= WHOLE {
        let (edge, thin) = (record.edge_texels.get(), record.thin_texels.get());
        if thin > found.thin || (case.kind == Kind::Mh && (edge, thin) != (found.edge, found.thin)) {
            let right = (found.edge, found.thin);
            found.fault(case, format!("counts of edge and thin texels {:?}, right is {right:?}", (edge, thin)));
        }
    }

    let everywhere = !snapped.second_surface;
    for p in points {
        let [x, y] = texel_of(p);
        let stored = value(x, y);
        let certified = oracle.texel(x, y).certified;
        let (interval, thin) = oracle.ray(p);
        if certified && (thin || !interval.contains(stored)) {
            found.wrong += 1;
            found.fault(
                case,
                format!("point {p:?} of texel {x}, {y}: stored {stored}, right on the ray is {interval:?}"),
            );
        }
        for receiver in Ray::new(&snapped, p).iter().flat_map(|r| r.receivers(!everywhere)) {
            found.receivers += 1;
            if (receiver.depth <= stored) == receiver.lit {
                continue;
            }
            if certified {
                found.wrong += 1;
                let (depth, lit) = (receiver.depth, receiver.lit);
                found.fault(case, format!("receiver {p:?} at {depth}: lit {lit}, texel {x}, {y} stores {stored}"));
            } else {
                found.wrong_on_edge += 1;
            }
        }
    }
    Ok(())
}
