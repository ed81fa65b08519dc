//! `levels`: what coarse levels answer, held against the intervals of the texels of level 0: kind `vector` against `mh`.
//!
//! For each level, the share of texels whose own interval holds what the level answers for them. Of `vector` twice: the
//! *representative*, the node's entry at the texel's own centre, and the *answer* of a lookup, the entry at the centre of
//! the coarse texel. In `mh` both are the node's value. Texels are drawn at random, the same for all; the oracle tells
//! their intervals.

use rayon::prelude::*;
use serde_json::json;
use umbrage::certify::{Interval, Oracle};
use umbrage::format::Kind;
use umbrage::reader::ReaderError;
use umbrage::reader::query::Map;
use umbrage::reader::query::vector::node_value;

use crate::plot::{Plot, Series};
use crate::random::Random;
use crate::report::{Report, Table, side};
use crate::scenes::{self, Folder, LIGHTS};
use crate::{Args, Failure};

/// Texels of a scene and resolution.
const COUNT: usize = 200_000;
/// The same with `--full`.
const FULL: usize = 2_000_000;
/// What is held against intervals, in the order of `Tally::right`.
const METHODS: [&str; 3] = ["mh", "vector representative", "vector answer"];

/// A texel and what may be stored for it.
struct Asked {
    texel: [u32; 2],
    truth: Interval,
}

/// Texels with a right answer on one level.
#[derive(Clone, Copy, Debug, Default)]
struct Tally {
    right: [u64; 3],
    /// Right by the representative of `vector` and by `mh`.
    both: u64,
}

impl Tally {
    fn plus(mut self, other: Tally) -> Tally {
        for (a, b) in self.right.iter_mut().zip(other.right) {
            *a += b;
        }
        self.both += other.both;
        self
    }
}

/// Answers of one texel on one level, in the order of [`METHODS`].
fn answers(mh: &Map, vector: &Map, [x, y]: [u32; 2], level: u8) -> Result<[u32; 3], ReaderError> {
    let plain = mh.texel(x, y, level)?.value;
    let found = vector.texel(x, y, level)?;
    // The walk has just read the page.
    let own = vector.view(found.page).map_or(found.value, |page| node_value(page, found.word, x, y));
    Ok([plain, own, found.value])
}

fn tally(mh: &Map, vector: &Map, asked: &[Asked], level: u8) -> Result<Tally, ReaderError> {
    let one = |a: &Asked| {
        let right = answers(mh, vector, a.texel, level)?.map(|v| u64::from(a.truth.contains(v)));
        Ok(Tally { right, both: right[0] & right[1] })
    };
    asked.par_iter().map(one).try_reduce(Tally::default, |a, b| Ok(a.plus(b)))
}

/// Runs the suite.
///
/// # Errors
/// A scene can't be loaded or baked, or a file not be read.
pub fn run(args: &Args) -> Result<Report, Failure> {
    let mut report = Report::new("levels");
    let count = if args.full { FULL } else { COUNT };
    let resolutions = if args.resolutions.is_empty() { vec![4096] } else { args.resolutions.clone() };
    let folder = Folder::new()?;
    let mut table = Table::new(
        "% of texels whose interval holds what a level answers",
        &["scene", "side", "level", "mh", "vector representative", "vector answer", "both", "neither"],
    );
    let mut series = Vec::new();
    for name in scenes::names(&args.scenes, &["city:1"]) {
        let model = scenes::load(name, args.policy)?;
        for &resolution in &resolutions {
            let (_, file) = model.bake_as(Kind::Vector, LIGHTS[0], resolution, &folder)?;
            let vector = scenes::open(&file)?;
            let (baked, file) = model.bake(LIGHTS[0], resolution, &folder)?;
            let mh = scenes::open(&file)?;
            let oracle = Oracle::new(&baked.last);
            let (mut random, shift) = (Random::new(2, 0), 64 - resolution.trailing_zeros());
            let texels: Vec<[u32; 2]> = (0..count).map(|_| [0, 1].map(|_| (random.bits() >> shift) as u32)).collect();
            let truth = |&texel: &[u32; 2]| Asked { texel, truth: oracle.texel(texel[0], texel[1]).interval };
            let asked: Vec<Asked> = texels.par_iter().map(truth).collect();
            let mut least: Option<(f64, u8)> = None;
            let mut curves: [Vec<[f64; 2]>; 3] = Default::default();
            for level in 0..=resolution.trailing_zeros() as u8 {
                let t = tally(&mh, &vector, &asked, level)?;
                let share = |n: u64| n as f64 / count as f64;
                let [plain, own, answer] = t.right.map(share);
                let (both, neither) = (share(t.both), 1.0 - plain - own + share(t.both));
                let percent = |v: f64| format!("{:.2}", v * 100.0);
                table.push([
                    name.to_string(),
                    side(resolution),
                    level.to_string(),
                    percent(plain),
                    percent(own),
                    percent(answer),
                    percent(both),
                    percent(neither),
                ]);
                report.rows.push(json!({
                    "scene": name, "light": LIGHTS[0], "resolution": resolution, "level": level, "texels": count,
                    "mh": plain, "vector_representative": own, "vector_answer": answer,
                    "both": both, "neither": neither,
                }));
                for (curve, v) in curves.iter_mut().zip([plain, own, answer]).filter(|c| c.1 > 0.0) {
                    curve.push([(resolution >> level) as f64, v * 100.0]);
                }
                if least.is_none_or(|l| own - plain < l.0) {
                    least = Some((own - plain, level));
                }
            }
            series.extend(
                METHODS
                    .iter()
                    .zip(curves)
                    .map(|(method, points)| Series { name: format!("{name} {} {method}", side(resolution)), points }),
            );
            if let Some((difference, level)) = least {
                report.goal(
                    difference >= 0.0,
                    format!(
                        "{name} at {}: vector's representatives right for as many texels as mh's",
                        side(resolution)
                    ),
                    format!("{:+.2} % of all texels on level {level}", difference * 100.0),
                );
            }
        }
    }
    report.tables.push(table);
    report.notes.push(format!("{count} texels of level 0 drawn at random, the same for all methods and levels"));
    let plot = Plot {
        title: "Texels whose interval holds what a level answers".to_string(),
        axes: ["texels on a side of the level".to_string(), "%".to_string()],
        series,
        hull: false,
    };
    report.plots.push(("share".to_string(), plot));
    Ok(report)
}
