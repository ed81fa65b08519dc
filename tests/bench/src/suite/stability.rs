//! `stability`: attacks on the bake's numbers, in both kinds and with every policy that makes sense, each under ten lights.
//!
//! Every texel of maps up to 1024 x 1024, and squares around points of larger ones, is held against the exact oracle; at
//! points, half of them near edges, borders of leaves and pages, and tips of wedges, receivers are held against rays that
//! try every triangle. Promised are values within the texels' intervals, and right answers on certified texels. On edge
//! texels nothing is promised but the centre: wrong answers there are shown beside their share. `tests/suite/stability`
//! tells what each attack is and why it is hard.

use rayon::prelude::*;
use serde_json::json;
use umbrage::format::Kind;
use umbrage::writer::solid::Policy;

use crate::attack::probe::{Case, Found, probe};
use crate::attack::refused::refused;
use crate::attack::{ATTACKS, Attack, KINDS, LIGHTS};
use crate::report::{Report, Table, bytes};
use crate::scenes::Folder;
use crate::{Args, Failure};

/// Points of each bake.
const POINTS: u32 = 200;
/// The same with `--full`.
const FULL: u32 = 2000;

/// Runs the suite.
pub fn run(args: &Args) -> Result<Report, Failure> {
    let mut report = Report::new("stability");
    let sides = match (&args.resolutions[..], args.full) {
        ([], false) => vec![1, 8, 64, 256],
        ([], true) => (0..=10).map(|log2| 1 << log2).chain([1 << 16]).collect(),
        (given, _) => given.to_vec(),
    };
    let points = if args.full { FULL } else { POINTS };
    let folder = Folder::new()?;
    let rows: Vec<(&Attack, Policy, Kind)> =
        ATTACKS.iter().flat_map(|a| a.policies().map(|p| KINDS.map(|k| (a, p, k)))).flatten().collect();
    let one = |(attack, policy, kind): &(&Attack, Policy, Kind)| {
        let mut all = Found::default();
        for light in LIGHTS {
            let bake = |mesh: &_, case: &Case| probe(mesh, case, &folder.file());
            all.add(attack.run_as(*kind, *policy, light, &sides, points, &bake));
        }
        all
    };
    let found: Vec<Found> = rows.par_iter().map(one).collect();

    let heads = [
        "attack, policy, kind",
        "triangles",
        "texels",
        "outside",
        "receivers",
        "wrong",
        "edge %",
        "thin %",
        "wrong on edge",
        "refused",
        "bytes",
        "vector : mh",
    ];
    let mut table = Table::new("all lights and resolutions together", &heads);
    let mut mh = 0;
    for ((attack, policy, kind), f) in rows.iter().zip(&found) {
        let triangles = (attack.mesh)().triangles.len();
        let share = |n: u64| 100.0 * n as f64 / f.texels.max(1) as f64;
        // of each pair, the first is of kind mh
        let ratio = if *kind == Kind::Mh {
            mh = f.bytes;
            None
        } else {
            Some(f.bytes as f64 / mh.max(1) as f64)
        };
        table.push([
            format!("{}, {policy}, {}", attack.name, kind.name()),
            triangles.to_string(),
            f.texels.to_string(),
            f.outside.to_string(),
            f.receivers.to_string(),
            f.wrong.to_string(),
            format!("{:.2}", share(f.edge)),
            format!("{:.2}", share(f.thin)),
            f.wrong_on_edge.to_string(),
            f.refused.to_string(),
            bytes(f.bytes),
            ratio.map_or_else(String::new, |r| format!("{r:.2}")),
        ]);
        report.rows.push(json!({
            "attack": attack.name, "policy": policy.to_string(), "kind": kind.name(), "triangles": triangles,
            "resolutions": sides, "lights": LIGHTS, "texels": f.texels, "outside": f.outside, "receivers": f.receivers,
            "wrong": f.wrong, "edge_texels": f.edge, "thin_texels": f.thin, "wrong_on_edge": f.wrong_on_edge,
            "refused": f.refused, "bytes": f.bytes, "vector_to_mh": ratio, "faults": f.faults,
        }));
    }
    report.tables.push(table);
    let sum = |of: &dyn Fn(&Found) -> u64| found.iter().map(of).sum::<u64>();
    let (texels, outside) = (sum(&|f| f.texels), sum(&|f| f.outside));
    report.goal(outside == 0, "no stored value outside its interval", format!("{outside} of {texels} texels"));
    let (receivers, wrong) = (sum(&|f| f.receivers), sum(&|f| f.wrong));
    report.goal(wrong == 0, "no wrong answer on a certified texel", format!("{wrong} of {receivers} receivers"));
    let told: Vec<&String> = found.iter().flat_map(|f| &f.faults).collect();
    report.goal(
        told.is_empty(),
        "every file holds the format's rules, no bake fails",
        format!("{} faults", told.len()),
    );
    report.notes.extend(told.into_iter().take(20).cloned());
    refusals(&mut report, &folder);
    Ok(report)
}

/// What must be refused, and the message.
fn refusals(report: &mut Report, folder: &Folder) {
    let mut table = Table::new("refused", &["input: message"]);
    let (mut right, all) = (0, refused());
    for r in &all {
        let said = KINDS.map(|kind| match r.bake(kind, &folder.file()) {
            Ok(_) => "was baked".to_string(),
            Err(e) => e.to_string(),
        });
        right += usize::from(said.iter().all(|s| s.contains(r.words)));
        report.rows.push(json!({ "refused": r.name, "message": said[1], "expected": r.words }));
        table.push([format!("{}: {}", r.name, said[1])]);
    }
    report.tables.push(table);
    report.goal(right == all.len(), "what no lattice holds is refused", format!("{right} of {}", all.len()));
}
