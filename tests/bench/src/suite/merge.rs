//! `merge`: kind `mmh` against `mh`: Scandolo 2019, tables 2.6 (bytes), 2.7 (seconds) and 2.8 (what became of pairs), and
//! figure 2.16 (bytes against seconds by the search distance). Goals of the project stand in the tables' last columns.

use std::path::Path;
use std::time::Instant;

use serde_json::json;
use umbrage::format::Kind;
use umbrage::writer::bake::{BakeOptions, Baked, bake};
use umbrage::writer::hierarchy::mmh::{Options, Report as Merged};

use crate::plot::{Plot, Series};
use crate::report::{Report, Table, bytes, side};
use crate::scenes::{self, Folder, LIGHTS, Model, SCENES};
use crate::{Args, Failure};

/// Search distances of figure 2.16; the paper's choice is 1000.
const DISTANCES: [u32; 6] = [10, 100, 500, 1000, 2000, 10_000];

/// Runs the suite.
pub fn run(args: &Args) -> Result<Report, Failure> {
    let mut report = Report::new("merge");
    let mut sizes = Table::new(
        "whole files, one light, search 1000; paged is over the merged groups alone, pages without frames and copies",
        &[
            "scene",
            "side",
            "mh",
            "mmh",
            "mmh : mh",
            "paged : merged",
            "shared pages",
            "dependencies",
            "most",
            "mh s",
            "mmh s",
            "match s",
        ],
    );
    let mut pairs = Table::new(
        "pairs of subtrees",
        &["scene", "side", "held against each other", "interval mismatch %", "full test %", "merged %"],
    );
    let mut figure = Table::new("by the search distance", &["scene", "side", "search", "mmh", "mmh : mh", "match s"]);
    let resolutions = match (&args.resolutions[..], args.full) {
        ([], false) => vec![4096, 16384],
        ([], true) => vec![4096, 16384, 65536],
        (given, _) => given.to_vec(),
    };
    let folder = Folder::new()?;
    let mut series: Vec<Series> = Vec::new();
    for name in scenes::names(&args.scenes, &SCENES) {
        let model = scenes::load(name, args.policy)?;
        for &resolution in &resolutions {
            let (mh, mh_took) = timed(&model, Kind::Mh, resolution, Options::default(), &folder)?;
            let mut curve = Series { name: format!("{name} {}", side(resolution)), points: vec![] };
            for search in DISTANCES {
                let (mmh, took) = timed(&model, Kind::Mmh, resolution, Options { search }, &folder)?;
                let Some(merged) = &mmh.lights[0].merged else { continue };
                let ratio = mmh.bytes as f64 / mh.bytes as f64;
                let paged = merged.words_paged as f64 / merged.words_merged.max(1) as f64;
                figure.push([
                    name.to_string(),
                    side(resolution),
                    search.to_string(),
                    bytes(mmh.bytes),
                    format!("{ratio:.4}"),
                    format!("{:.2}", merged.seconds[0]),
                ]);
                curve.points.push([merged.seconds[0].max(1e-3), mmh.bytes as f64]);
                report.rows.push(json!({
                    "scene": name, "light": LIGHTS[0], "resolution": resolution, "search": search, "mh_bytes": mh.bytes,
                    "bytes": mmh.bytes, "ratio": ratio, "paged_over_merged": paged, "mh_s": mh_took, "mmh_s": took,
                    "match_s": merged.seconds[0], "pages_s": merged.seconds[1], "shared_pages": merged.shared_pages,
                    "dependencies": merged.dependencies[0], "most_dependencies": merged.dependencies[1],
                    "pairs": counts(merged),
                }));
                if search != Options::default().search {
                    continue;
                }
                sizes.push([
                    name.to_string(),
                    side(resolution),
                    bytes(mh.bytes),
                    bytes(mmh.bytes),
                    format!("{ratio:.4}"),
                    format!("{paged:.3}"),
                    merged.shared_pages.to_string(),
                    merged.dependencies[0].to_string(),
                    merged.dependencies[1].to_string(),
                    format!("{mh_took:.1}"),
                    format!("{took:.1}"),
                    format!("{:.2}", merged.seconds[0]),
                ]);
                let [all, shares @ ..] = counts(merged);
                let share = |n: u64| format!("{:.2}", n as f64 / all.max(1) as f64 * 100.0);
                let [intervals, nodes, joined] = shares.map(share);
                pairs.push([name.to_string(), side(resolution), all.to_string(), intervals, nodes, joined]);
            }
            series.push(curve);
        }
    }
    report.tables.extend([sizes, pairs, figure]);
    report.plots.push((
        "search".to_string(),
        Plot {
            title: "Kind mmh by the search distance, 10 to 10 000".to_string(),
            axes: ["seconds of matching".to_string(), "bytes of the file".to_string()],
            series,
            hull: true,
        },
    ));
    Ok(report)
}

/// Pairs of all heights: all, refused by their intervals, refused by the full test, merged.
fn counts(m: &Merged) -> [u64; 4] {
    let sum = |f: fn(&umbrage::writer::hierarchy::mmh::merge::Pairs) -> u64| m.pairs.iter().map(f).sum::<u64>();
    let [intervals, nodes, merged] = [sum(|p| p.intervals), sum(|p| p.nodes), sum(|p| p.merged)];
    [intervals + nodes + merged, intervals, nodes, merged]
}

/// A bake and its seconds; the file is removed.
fn timed(model: &Model, kind: Kind, resolution: u64, mmh: Options, folder: &Folder) -> Result<(Baked, f64), Failure> {
    let (file, start) = (folder.file(), Instant::now());
    let options = BakeOptions { kind, mmh, top_down: kind == Kind::Mmh, ..model.options(LIGHTS[0], resolution, false) };
    let baked = bake(&model.mesh, &options, &file, &Default::default())?;
    let took = start.elapsed().as_secs_f64();
    remove(&file)?;
    Ok((baked, took))
}

fn remove(file: &Path) -> Result<(), Failure> {
    std::fs::remove_file(file).map_err(|e| Failure::target(format!("{}: {e}", file.display())))
}
