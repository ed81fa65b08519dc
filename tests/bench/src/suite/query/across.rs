//! Resident lookups of kind `vector` at several resolutions, in one run, at the same points of the scene: those that the
//! recorded views see, in pixel order, and at random the same shares of the map's side.

use serde_json::json;
use umbrage::reader::query::locate;

use super::{CASES, RANDOM, ROUNDS, Texel, Vector, passes, sum};
use crate::Failure;
use crate::random::Random;
use crate::report::{Report, Table, bytes, side};
use crate::timing::Samples;

/// Most that a lookup on the largest map may take, in lookups on the smallest one.
const GOAL: f64 = 1.3;

/// Times level 0 of all files, the smallest first, and notes the goal for the largest.
///
/// # Errors
/// A texel that answers otherwise lazily.
pub fn measure(name: &str, files: &[Vector], points: &[[f64; 3]], report: &mut Report) -> Result<(), Failure> {
    let in_views = |v: &Vector| -> Vec<Texel> {
        let lattice = v.map.lattice();
        points.iter().filter_map(|p| locate(&lattice, *p)).map(|(x, y, _)| [x, y]).collect()
    };
    let at_random = |v: &Vector| -> Vec<Texel> {
        let (mut random, shift) = (Random::new(1, 0), 64 - v.map.resolution().trailing_zeros());
        (0..RANDOM).map(|_| [0, 1].map(|_| (random.bits() >> shift) as u32)).collect()
    };
    let texels: [Vec<Vec<Texel>>; 2] = [files.iter().map(in_views).collect(), files.iter().map(at_random).collect()];
    let mut table = Table::new(
        &format!("{name}, kind vector, resident, level 0, the same points: {ROUNDS} rounds, ratios to the first side"),
        &["case", "side", "file", "held", "lookups", "ns", "min..max", "ratio", "min..max"],
    );
    for (case, lists) in CASES.iter().zip(&texels) {
        for (v, list) in files.iter().zip(lists) {
            check(v, list)?;
        }
        let mut runs: Vec<Box<dyn FnMut() + '_>> = Vec::new();
        for (v, list) in files.iter().zip(lists) {
            runs.push(Box::new(move || sum(list, |t| v.resident.value(t[0], t[1], 0))));
        }
        let mut candidates: Vec<&mut dyn FnMut()> = runs.iter_mut().map(|r| &mut **r as &mut dyn FnMut()).collect();
        let samples = Samples::take(ROUNDS, &mut candidates);
        let samples: Vec<Samples> =
            samples.iter().zip(lists).map(|(s, list)| s.each(list.len() * passes(list))).collect();
        let first = samples[0].clone();
        for ((v, list), s) in files.iter().zip(lists).zip(&samples) {
            let ratio = s.median() / first.median();
            let ([low, high], [least, most]) = (s.spread(), s.over(&first).spread());
            table.push([
                case.to_string(),
                side(v.resolution()),
                bytes(v.file_bytes),
                bytes(v.resident.bytes() as u64),
                list.len().to_string(),
                format!("{:.2}", s.median()),
                format!("{low:.2}..{high:.2}"),
                format!("{ratio:.2}"),
                format!("{least:.2}..{most:.2}"),
            ]);
            report.rows.push(json!({
                "scene": name, "resolution": v.resolution(), "case": case, "method": "vector resident, same points",
                "level": 0, "pass": "across", "bytes_held": v.resident.bytes(), "file_bytes": v.file_bytes,
                "lookups": list.len(), "ns": s.median(), "ns_min": low, "ns_max": high,
                "ratio": ratio, "ratio_min": least, "ratio_max": most,
            }));
        }
        let (Some(small), Some(large), Some(s)) = (files.first(), files.last(), samples.last()) else { continue };
        let ratio = s.median() / first.median();
        let [small, large] = [small, large].map(|v| side(v.resolution()));
        let what = format!("{name}: vector resident in {case} at {large} at most {GOAL} x that at {small}");
        report.goal(ratio <= GOAL, what, format!("{ratio:.2} x"));
    }
    report.tables.push(table);
    Ok(())
}

/// Holds some resident lookups against lazy ones.
fn check(v: &Vector, texels: &[Texel]) -> Result<(), Failure> {
    for &[x, y] in texels.iter().step_by(1009) {
        let (lazily, found) = (v.map.texel(x, y, 0)?.value, v.resident.value(x, y, 0));
        if lazily != found {
            let message = format!("vector at {}, texel {x}, {y}: {lazily} lazily, but {found}", v.resolution());
            return Err(Failure { code: 1, message });
        }
    }
    Ok(())
}
