//! `bake`: time, work and memory of bakes; the builder with proofs against the exhaustive one.
//!
//! Each bake runs in a child process of its own (the hidden suite `one-bake`), so that peaks of memory don't mix.

use std::process::{Command, Stdio};
use std::time::Instant;

use serde_json::{Value, json};
use umbrage::writer::bake::bake;
use umbrage::writer::hierarchy::build::Progress;

use crate::plot::{Plot, Series};
use crate::report::{Report, Table, bytes, side};
use crate::scenes::{self, Folder, LIGHTS, SCENES};
use crate::{Args, Failure, machine};

/// Most that node counts of the two builders may differ.
const NODES_DIFFER: f64 = 0.01;
/// Where the builders are held against each other.
const COMPARED: [u64; 3] = [1024, 2048, 4096];

/// Bakes once and prints one JSON object.
pub fn one(args: &Args) -> Result<(), Failure> {
    let (Some(name), Some(&resolution)) = (args.scenes.first(), args.resolutions.first()) else {
        return Err(Failure { code: 2, message: "one-bake: give --scene and --resolution".to_string() });
    };
    let start = Instant::now();
    let model = scenes::load(name, args.policy)?;
    let load = start.elapsed().as_secs_f64();
    let folder = Folder::new()?;
    let options = model.options(LIGHTS[0], resolution, args.exhaustive);
    let baked = bake(&model.mesh, &options, &folder.file(), &Progress::default())?;
    let light = &baked.lights[0];
    let row = json!({
        "scene": name, "light": LIGHTS[0], "resolution": resolution,
        "builder": if args.exhaustive { "exhaustive" } else { "proofs" },
        "load_s": load, "snap_s": baked.seconds.snap, "build_s": baked.seconds.build, "write_s": baked.seconds.write,
        "texels_evaluated": light.counts.texels_evaluated,
        "evaluated_share": light.counts.texels_evaluated as f64 / (resolution * resolution) as f64,
        "peak_bytes": machine::peak_memory(), "nodes": light.nodes.iter().sum::<u64>(), "bytes": baked.bytes,
        "triangles": baked.triangles,
    });
    println!("{row}");
    Ok(())
}

fn child(name: &str, resolution: u64, exhaustive: bool) -> Result<Value, Failure> {
    let this = std::env::current_exe().map_err(Failure::target)?;
    let mut command = Command::new(this);
    command.args(["one-bake", "--scene", name, "--resolution", &resolution.to_string()]);
    if exhaustive {
        command.arg("--exhaustive");
    }
    let out = command.stderr(Stdio::inherit()).output().map_err(Failure::target)?;
    let failed = |why: String| Failure::target(format!("bake of {name} at {resolution}: {why}"));
    if !out.status.success() {
        return Err(failed(out.status.to_string()));
    }
    serde_json::from_slice(&out.stdout).map_err(|e| failed(e.to_string()))
}

/// Runs the suite.
pub fn run(args: &Args) -> Result<Report, Failure> {
    let mut report = Report::new("bake");
    let mut growth = Table::new(
        "bakes, one process each",
        &[
            "scene",
            "side",
            "load s",
            "snap s",
            "build s",
            "write s",
            "evaluated",
            "% of texels",
            "peak",
            "nodes",
            "file",
        ],
    );
    let mut builders = Table::new(
        "builder with proofs : exhaustive builder",
        &["scene", "side", "build s", "build s", "speed", "evaluated", "evaluated", "nodes", "nodes", "differ %"],
    );
    let resolutions = match (&args.resolutions[..], args.full) {
        ([], false) => vec![4096, 16384],
        ([], true) => vec![4096, 16384, 65536],
        (given, _) => given.to_vec(),
    };
    let mut time: Vec<Series> = Vec::new();
    let mut memory: Vec<Series> = Vec::new();
    let mut worst = (0.0, String::new());
    for name in scenes::names(&args.scenes, &SCENES) {
        let curve = |name: String| Series { name, points: vec![] };
        let mut fast = curve(name.to_string());
        let mut slow = curve(format!("{name} exhaustive"));
        let mut peak = curve(name.to_string());
        for &resolution in &resolutions {
            let row = child(name, resolution, false)?;
            growth.push(growth_row(&row));
            fast.points.push([resolution as f64, number(&row, "build_s")]);
            peak.points.push([resolution as f64, number(&row, "peak_bytes")]);
            report.rows.push(row);
        }
        for resolution in COMPARED {
            // Taken again, so that both run one after the other.
            let (proofs, all) = (child(name, resolution, false)?, child(name, resolution, true)?);
            let differ = number(&proofs, "nodes") / number(&all, "nodes") - 1.0;
            if differ.abs() > f64::abs(worst.0) {
                worst = (differ, format!("{name} at {}", side(resolution)));
            }
            builders.push([
                name.to_string(),
                side(resolution),
                seconds(&proofs, "build_s"),
                seconds(&all, "build_s"),
                format!("{:.2}", number(&all, "build_s") / number(&proofs, "build_s")),
                whole(&proofs, "texels_evaluated"),
                whole(&all, "texels_evaluated"),
                whole(&proofs, "nodes"),
                whole(&all, "nodes"),
                format!("{:+.3}", differ * 100.0),
            ]);
            slow.points.push([resolution as f64, number(&all, "build_s")]);
            if !resolutions.contains(&resolution) {
                fast.points.push([resolution as f64, number(&proofs, "build_s")]);
                peak.points.push([resolution as f64, number(&proofs, "peak_bytes")]);
            }
            report.rows.extend([proofs, all]);
        }
        time.extend([fast, slow]);
        memory.push(peak);
    }
    report.tables.extend([growth, builders]);
    report.goal(
        worst.0.abs() <= NODES_DIFFER,
        "node counts of both builders equal within 1 %",
        if worst.1.is_empty() {
            "no difference".to_string()
        } else {
            format!("{:+.3} % ({})", worst.0 * 100.0, worst.1)
        },
    );
    let plot = |title: &str, y: &str, series| Plot {
        title: title.to_string(),
        axes: ["texels on a side".to_string(), y.to_string()],
        series,
        hull: false,
    };
    report.plots.push(("time".to_string(), plot("Time to build", "seconds", time)));
    report.plots.push(("memory".to_string(), plot("Peak memory of a bake", "bytes", memory)));
    Ok(report)
}

fn growth_row(row: &Value) -> [String; 11] {
    [
        row["scene"].as_str().unwrap_or_default().to_string(),
        side(row["resolution"].as_u64().unwrap_or(0)),
        seconds(row, "load_s"),
        seconds(row, "snap_s"),
        seconds(row, "build_s"),
        seconds(row, "write_s"),
        whole(row, "texels_evaluated"),
        format!("{:.2}", number(row, "evaluated_share") * 100.0),
        bytes(row["peak_bytes"].as_u64().unwrap_or(0)),
        whole(row, "nodes"),
        bytes(row["bytes"].as_u64().unwrap_or(0)),
    ]
}

fn number(row: &Value, key: &str) -> f64 {
    row[key].as_f64().unwrap_or(f64::NAN)
}

fn whole(row: &Value, key: &str) -> String {
    row[key].as_u64().unwrap_or(0).to_string()
}

fn seconds(row: &Value, key: &str) -> String {
    format!("{:.2}", number(row, key))
}
