//! `report`: every method on every scene from 1,024 texels a side to the largest that it can reach, and in a few words how
//! the product's kinds stand. `REPORT.md` beside this folder holds the figures of a whole run.

use serde_json::Value;

use super::baselines;
use crate::report::{Report, Table, bytes, side};
use crate::scenes;
use crate::{Args, Failure};

/// Scenes and resolutions of a whole report.
const PLAN: [(&str, &[u64]); 3] = [
    ("city:1", &[1 << 10, 1 << 12, 1 << 14, 1 << 16, 1 << 18, 1 << 20]),
    ("forest:1", &[1 << 10, 1 << 12, 1 << 14]),
    ("scan:1", &[1 << 10, 1 << 12, 1 << 14, 1 << 16, 1 << 18, 1 << 20]),
];
/// Resolutions of a short one, and of named scenes.
const SHORT: &[u64] = &[1 << 10, 1 << 12];

/// Runs the suite.
///
/// # Errors
/// As [`baselines::run`].
pub fn run(args: &Args) -> Result<Report, Failure> {
    let mut report = Report::new("report");
    let whole = args.full && args.scenes.is_empty();
    for name in scenes::names(&args.scenes, &PLAN.map(|p| p.0)) {
        let planned = PLAN.iter().find(|p| p.0 == name && whole).map(|p| p.1);
        let own = planned.unwrap_or(if args.full { &[1 << 10, 1 << 12, 1 << 14] } else { SHORT });
        let resolutions = if args.resolutions.is_empty() { own } else { &args.resolutions };
        baselines::measure(name, resolutions, args, &mut report)?;
    }
    let table = standing(&report.rows);
    report.tables.insert(0, table);
    baselines::close(&mut report);
    Ok(report)
}

/// `vector` and the best of the other methods that lose nothing, by scene and resolution.
fn standing(rows: &[Value]) -> Table {
    let mut table = Table::new(
        "vector, and the best of the other methods that lose nothing (times: but for the array)",
        &["map", "vector", "smallest other", "pixel ns", "fastest other", "random ns", "fastest other"],
    );
    let mut maps: Vec<(&str, u64)> = Vec::new();
    let of = |r: &Value| r["resolution"].as_u64().unwrap_or(0);
    for r in rows {
        let map = (r["scene"].as_str().unwrap_or(""), of(r));
        if !maps.contains(&map) {
            maps.push(map);
        }
    }
    for (scene, resolution) in maps {
        let here = |r: &&Value| r["scene"] == scene && of(r) == resolution && r["outside_texels"] == 0;
        let (own, others): (Vec<&Value>, Vec<&Value>) = rows.iter().filter(here).partition(|r| r["method"] == "vector");
        let number = |r: &Value, key: &str| r[key].as_f64().unwrap_or(f64::INFINITY);
        let best = |key: &str, array: bool| {
            let some = others.iter().filter(|r| array || !r["method"].as_str().is_some_and(|m| m.starts_with("array")));
            some.min_by(|a, b| number(a, key).total_cmp(&number(b, key)))
        };
        let show = |key: &str, r: &Value| match key {
            "bytes" => bytes(r[key].as_u64().unwrap_or(0)),
            _ => format!("{:.1}", number(r, key)),
        };
        let mut cells = vec![format!("{scene} {}", side(resolution))];
        for key in ["bytes", "pixel_ns", "random_ns"] {
            cells.push(own.first().map_or("not without loss".to_string(), |r| show(key, r)));
            let other = best(key, key == "bytes");
            cells.push(
                other.map_or("-".to_string(), |r| format!("{} {}", r["method"].as_str().unwrap_or(""), show(key, r))),
            );
        }
        let cells: [String; 7] = std::array::from_fn(|i| cells[i].clone());
        table.push(cells);
    }
    table
}
