//! `size`: bytes of whole files, with all levels, against an uncompressed depth map and one compressed tile by tile; kind
//! `vector` against `mh` by the bytes that Scandolo et al. 2016 give its nodes.

use std::path::{Path, PathBuf};
use std::time::Instant;

use serde_json::json;
use umbrage::format::Kind;
use umbrage::writer::bake::Baked;

use crate::plot::{Plot, Series};
use crate::report::{Report, Table, bytes, side};
use crate::scenes::{self, Folder, LIGHTS, Model, SCENES};
use crate::{Args, Failure, depth_map};

/// zstd's level.
const LEVEL: i32 = 3;
/// Side of a compressed tile.
const TILE: usize = depth_map::STRIP;

/// Runs the suite.
pub fn run(args: &Args) -> Result<Report, Failure> {
    let mut report = Report::new("size");
    let mut table = Table::new(
        "whole files, one light, kind mh",
        &[
            "scene",
            "side",
            "file",
            "leaf",
            "inner",
            "empty",
            "B/node",
            "bit/texel",
            "pages",
            "edge %",
            "f32",
            "f32 : file",
            "zstd",
            "zstd : file",
        ],
    );
    let mut kinds = Table::new(
        "kind vector against mh (leaf and empty nodes 4 bytes, inner ones 8)",
        &["scene", "side", "vector file", "entries", "pages", "mh", "vector : mh", "vector s", "mh s"],
    );
    let resolutions = match (&args.resolutions[..], args.full) {
        ([], false) => vec![4096, 16384],
        ([], true) => vec![4096, 16384, 65536],
        (given, _) => given.to_vec(),
    };
    let light = args.light.unwrap_or(LIGHTS[0]);
    let folder = Folder::new()?;
    let mut series: Vec<Series> = Vec::new();
    for name in scenes::names(&args.scenes, &SCENES) {
        let model = scenes::load(name, args.policy)?;
        let mut curves = ["mh", "f32", "zstd", "vector"]
            .map(|k| Series { name: if k == "f32" { k.to_string() } else { format!("{name} {k}") }, points: vec![] });
        for &resolution in &resolutions {
            let (vector, file, took) = timed(&model, Kind::Vector, light, resolution, &folder)?;
            remove(&file)?;
            let (baked, file, mh_took) = timed(&model, Kind::Mh, light, resolution, &folder)?;
            let found = &baked.lights[0];
            let paper = 4 * found.nodes[0] + 8 * found.nodes[1] + 4 * found.nodes[2];
            let dense = vector.bytes as f64 / paper as f64;
            kinds.push([
                name.to_string(),
                side(resolution),
                bytes(vector.bytes),
                (vector.lights[0].nodes[0] + vector.lights[0].nodes[1]).to_string(),
                vector.lights[0].pages.to_string(),
                bytes(paper),
                format!("{dense:.4}"),
                format!("{took:.1}"),
                format!("{mh_took:.1}"),
            ]);
            let nodes: u64 = found.nodes.iter().sum();
            let raw = 4 * resolution * resolution;
            let zstd = compressed(&baked.last)?;
            let texels = (resolution * resolution) as f64;
            let edge = found.counts.edge_texels as f64 / texels;
            let ratio = |n: u64| n as f64 / baked.bytes as f64;
            table.push([
                name.to_string(),
                side(resolution),
                bytes(baked.bytes),
                found.nodes[0].to_string(),
                found.nodes[1].to_string(),
                found.nodes[2].to_string(),
                format!("{:.2}", baked.bytes as f64 / nodes as f64),
                format!("{:.3}", baked.bytes as f64 * 8.0 / texels),
                found.pages.to_string(),
                format!("{:.3}", edge * 100.0),
                bytes(raw),
                format!("{:.1}", ratio(raw)),
                bytes(zstd),
                format!("{:.2}", ratio(zstd)),
            ]);
            report.rows.push(json!({
                "scene": name, "light": light, "policy": model.policy.to_string(), "resolution": resolution, "bytes": baked.bytes,
                "leaf": found.nodes[0], "inner": found.nodes[1], "empty": found.nodes[2],
                "bytes_per_node": baked.bytes as f64 / nodes as f64, "pages": found.pages, "edge_share": edge,
                "thin_texels": found.counts.thin_texels, "triangles": baked.triangles,
                "f32_bytes": raw, "f32_ratio": ratio(raw), "zstd_bytes": zstd, "zstd_ratio": ratio(zstd),
                "vector_bytes": vector.bytes, "paper_bytes": paper, "vector_ratio": dense, "vector_s": took, "mh_s": mh_took,
            }));
            for (curve, v) in curves.iter_mut().zip([baked.bytes, raw, zstd, vector.bytes]) {
                curve.points.push([resolution as f64, v as f64]);
            }
            // A file of the next resolution needs the room.
            remove(&file)?;
        }
        // An uncompressed map has no scene: one curve is enough.
        let again = !series.is_empty();
        series.extend(curves.into_iter().enumerate().filter(|(k, _)| !(again && *k == 1)).map(|(_, c)| c));
    }
    report.tables.push(table);
    report.tables.push(kinds);
    report.notes.push(format!(
        "zstd: level {LEVEL}, tiles of {TILE} x {TILE} u32 depths of texel centres, each compressed alone"
    ));
    report.plots.push((
        "resolution".to_string(),
        Plot {
            title: "Size of one light's map".to_string(),
            axes: ["texels on a side".to_string(), "bytes".to_string()],
            series,
            hull: false,
        },
    ));
    Ok(report)
}

/// A bake and its seconds.
fn timed(
    model: &Model,
    kind: Kind,
    light: [f64; 3],
    resolution: u64,
    folder: &Folder,
) -> Result<(Baked, PathBuf, f64), Failure> {
    let start = Instant::now();
    let (baked, file) = model.bake_as(kind, light, resolution, folder)?;
    Ok((baked, file, start.elapsed().as_secs_f64()))
}

fn remove(file: &Path) -> Result<(), Failure> {
    std::fs::remove_file(file).map_err(|e| Failure::target(format!("{}: {e}", file.display())))
}

/// Bytes of a plain depth map whose tiles are compressed one by one; holds a strip per thread.
fn compressed(mesh: &umbrage::writer::solid::SnappedMesh) -> Result<u64, Failure> {
    let width = mesh.lattice.resolution() as usize;
    let tile = width.min(TILE);
    let strip = |_, texels: &[u32]| -> std::io::Result<u64> {
        let mut compressor = zstd::bulk::Compressor::new(LEVEL)?;
        let mut raw = Vec::with_capacity(tile * tile * 4);
        let mut sum = 0;
        for column in (0..width).step_by(tile) {
            raw.clear();
            for row in texels.chunks(width) {
                row[column..column + tile].iter().for_each(|v| raw.extend_from_slice(&v.to_le_bytes()));
            }
            sum += compressor.compress(&raw)?.len() as u64;
        }
        Ok(sum)
    };
    depth_map::strips(mesh, strip).into_iter().sum::<std::io::Result<u64>>().map_err(Failure::target)
}
