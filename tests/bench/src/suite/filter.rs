//! `filter`: time of percentage-closer filters on one thread, in lookups of one texel on level 0.
//!
//! Receivers are the pixels of recorded views, in pixel order and shuffled; depths, planes and footprints are made before
//! any clock runs. Naive kernels, which look each tap up by itself, take turns with them and must give the same answers.
//! `acne` holds what coarse levels answer against exact rays.

mod acne;

use std::hint::black_box;

use serde_json::json;
use umbrage::format::Kind;
use umbrage::reader::query::Resident;
use umbrage::reader::query::filter::{Receiver, nearest_level};
use umbrage::render::{Footprints, Scene};

use crate::random::Random;
use crate::report::{Report, Table, side};
use crate::scenes::{self, Folder, LIGHTS};
use crate::timing::Samples;
use crate::{Args, Failure};

/// Pictures of the recorded views.
const PICTURE: [u32; 2] = [1280, 720];
/// Rounds in which all candidates take turns.
const ROUNDS: usize = 9;
/// Receivers in a round.
const RECEIVERS: usize = 1 << 21;
/// Candidate, its most in lookups.
const GOALS: [(&str, f64); 3] = [("pcf 3x3", 2.5), ("pcf 5x5", 4.0), ("hierarchical 3x3", 3.0)];

/// A receiver and its level of detail.
type Asked = (Receiver, u32);

/// Runs the suite.
pub fn run(args: &Args) -> Result<Report, Failure> {
    let mut report = Report::new("filter");
    acne::run(args, &mut report)?;
    let resolution = args.resolutions.first().copied().unwrap_or(16384);
    let folder = Folder::new()?;
    for name in scenes::names(&args.scenes, &["city:1"]) {
        let model = scenes::load(name, args.policy)?;
        for kind in [Kind::Mh, Kind::Mmh, Kind::Vector] {
            if kind == Kind::Mmh && !args.full {
                continue;
            }
            let (baked, file) = model.bake_as(kind, LIGHTS[0], resolution, &folder)?;
            let geometry = Scene::new(&baked.last);
            let mut asked: Vec<Asked> = Vec::new();
            for view in scenes::views(&geometry, &model.cameras()?, PICTURE[0], PICTURE[1]) {
                let of = Footprints::new(&view, &baked.last);
                let all = (0..view.receivers.len()).filter_map(|i| Some((of.receiver(i)?, of.level_of_detail(i))));
                asked.extend(all);
            }
            let resident = scenes::open(&file)?.preload()?;
            asked.truncate(RECEIVERS);
            let mean = asked.iter().map(|a| f64::from(a.1) / 256.0).sum::<f64>() / asked.len().max(1) as f64;
            report.notes.push(format!("{name} {}: mean level of detail {mean:.2}", kind.name()));
            measure(name, kind, resolution, "pixel order", &resident, &asked, &mut report)?;
            let mut random = Random::new(1, 0);
            for i in (1..asked.len()).rev() {
                asked.swap(i, (random.bits() % (i as u64 + 1)) as usize);
            }
            measure(name, kind, resolution, "shuffled", &resident, &asked, &mut report)?;
        }
    }
    report.notes.push("ratio: of medians to one lookup on level 0, behind it over single rounds; own level: to one on the footprint's level".to_string());
    Ok(report)
}

/// Every tap by itself.
fn naive(map: &Resident, r: &Receiver, side: u32, level: u8) -> u32 {
    let (first, cells) = ((side / 2) as i64, i64::from(map.resolution() >> level));
    let mut lit = 0;
    for j in -first..i64::from(side) - first {
        for i in -first..i64::from(side) - first {
            let [x, y] = [i64::from(r.x >> level) + i, i64::from(r.y >> level) + j];
            if x < 0 || y < 0 || x >= cells || y >= cells {
                lit += 1;
                continue;
            }
            let value = map.value((x as u32) << level, (y as u32) << level, level);
            let way = |v: i64, own: u32, gradient: i32| {
                let corner = if gradient < 0 { (1 << level) - 1 } else { 0 };
                i64::from(gradient) * ((v << level) + corner - i64::from(own))
            };
            let rise = way(x, r.x, r.gradient[0]) + way(y, r.y, r.gradient[1]);
            lit += u32::from(value == u32::MAX || i64::from(r.depth) * 16 + rise <= i64::from(value) * 16);
        }
    }
    lit
}

/// Times all candidates on one list of receivers.
fn measure(
    name: &str,
    kind: Kind,
    resolution: u64,
    case: &str,
    map: &Resident,
    asked: &[Asked],
    report: &mut Report,
) -> Result<(), Failure> {
    for (r, lod) in asked.iter().step_by(97) {
        for (side, level) in [(1, 0), (3, 0), (4, 0), (5, 0), (3, nearest_level(*lod)), (5, nearest_level(*lod))] {
            let (found, expected) = (map.pcf(r, side, level).lit, naive(map, r, side, level));
            if found != expected {
                let message = format!("{r:?}, side {side}, level {level}: {found} lit, tap by tap {expected}");
                return Err(Failure { code: 1, message });
            }
        }
    }
    let one = |level: u8| move |a: &Asked| u32::from(a.0.depth <= map.value(a.0.x, a.0.y, level));
    let footprint = |a: &Asked| u32::from(a.0.depth <= map.value(a.0.x, a.0.y, nearest_level(a.1)));
    let kernel = |side: u32| move |a: &Asked| map.pcf(&a.0, side, 0).lit;
    let each = |side: u32| move |a: &Asked| naive(map, &a.0, side, 0);
    let hierarchical = |a: &Asked| map.pcf(&a.0, 3, nearest_level(a.1)).lit;
    let trilinear = |a: &Asked| map.trilinear(&a.0, 3, a.1).lit;
    let methods = [
        "one lookup",
        "one lookup, footprint's level",
        "pcf 3x3",
        "pcf 5x5",
        "hierarchical 3x3",
        "trilinear 3x3",
        "pcf 9x9",
        "naive 3x3",
        "naive 5x5",
    ];
    let samples = Samples::take(
        ROUNDS,
        &mut [
            &mut || sum(asked, one(0)),
            &mut || sum(asked, footprint),
            &mut || sum(asked, kernel(3)),
            &mut || sum(asked, kernel(5)),
            &mut || sum(asked, hierarchical),
            &mut || sum(asked, trilinear),
            &mut || sum(asked, kernel(9)),
            &mut || sum(asked, each(3)),
            &mut || sum(asked, each(5)),
        ],
    );
    let mut table = Table::new(
        &format!(
            "{name} {}, {} a side, {case}: {} receivers, {ROUNDS} rounds",
            kind.name(),
            side(resolution),
            asked.len()
        ),
        &["filter", "ns", "ratio", "min..max", "own level"],
    );
    let base = &samples[0];
    for (method, s) in methods.iter().zip(&samples) {
        let (ns, ratio) = (s.each(asked.len()).median(), s.median() / base.median());
        let [least, most] = s.over(base).spread();
        // What asks the footprint's level, also over one lookup there.
        let coarse = matches!(*method, "hierarchical 3x3" | "trilinear 3x3").then(|| s.median() / samples[1].median());
        let own = coarse.map_or(String::new(), |r| format!("{r:.2}"));
        let spread = format!("{least:.2}..{most:.2}");
        table.push([method.to_string(), format!("{ns:.2}"), format!("{ratio:.2}"), spread, own]);
        report.rows.push(json!({
            "scene": name, "kind": kind.name(), "resolution": resolution, "case": case, "filter": method,
            "receivers": asked.len(), "ns": ns, "ratio": ratio, "ratio_min": least, "ratio_max": most,
            "ratio_own_level": coarse,
        }));
        if let Some((_, goal)) = GOALS.iter().find(|g| g.0 == *method) {
            let what = format!("{name} {}: {method} in {case} at most {goal} x one lookup", kind.name());
            report.goal(ratio <= *goal, what, format!("{ratio:.2} x"));
        }
    }
    report.tables.push(table);
    Ok(())
}

/// One pass; the sum keeps the answers.
#[inline(always)]
fn sum(asked: &[Asked], answer: impl Fn(&Asked) -> u32) {
    let mut total = 0u32;
    for a in black_box(asked) {
        total = total.wrapping_add(answer(a));
    }
    black_box(total);
}
