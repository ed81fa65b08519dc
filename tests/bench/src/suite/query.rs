//! `query`: time of one lookup on one thread, without a cache of the last leaf, against plain arrays.
//!
//! The arrays hold the map's own values, so that all candidates give the same answers. Texels come from the pixels of
//! recorded views, in pixel order, and uniformly at random; all coordinates are made before any clock runs.
//!
//! - here: one resolution, all ways to look up;
//! - [`across`]: kind `vector` at several resolutions, the same receivers.

mod across;

use std::hint::black_box;

use rayon::prelude::*;
use serde_json::json;
use umbrage::format::Kind;
use umbrage::reader::query::{Map, Resident};
use umbrage::render::{Scene, View};

use crate::plot::{Plot, Series};
use crate::random::Random;
use crate::report::{Report, Table, bytes, side};
use crate::scenes::{self, Folder, LIGHTS, Model};
use crate::timing::Samples;
use crate::{Args, Failure};

/// Pictures of the recorded views.
const PICTURE: [u32; 2] = [1280, 720];
/// Random lookups.
const RANDOM: usize = 1 << 22;
/// Rounds in which all candidates take turns.
const ROUNDS: usize = 9;
/// Lookups of one candidate in a round, at least: the clock moves by ticks of up to 4 ms.
const LOOKUPS: usize = 1 << 23;
/// Where texels come from.
const CASES: [&str; 2] = ["pixel order", "random"];
/// Most that a lookup may take, in lookups of the row-major array, by case.
const GOALS: [f64; 2] = [2.0, 5.0];
/// The same for kind `vector`.
const VECTOR_GOALS: [f64; 2] = [1.3, 2.0];
/// Resolution that `--full` adds for kind `vector`.
const LARGE: u64 = 1 << 20;
/// Side of the square tiles of the tiled array.
const TILE_LOG2: u32 = 3;

/// A texel on the finest level.
type Texel = [u32; 2];

/// Runs the suite.
pub fn run(args: &Args) -> Result<Report, Failure> {
    let mut report = Report::new("query");
    let resolution = args.resolutions.first().copied().unwrap_or(16384);
    let folder = Folder::new()?;
    for name in scenes::names(&args.scenes, &["city:1"]) {
        let model = scenes::load(name, args.policy)?;
        let (baked, file) = model.bake(LIGHTS[0], resolution, &folder)?;
        let geometry = Scene::new(&baked.last);
        let pictures = scenes::views(&geometry, &model.cameras()?, PICTURE[0], PICTURE[1]);
        let receivers = pictures.iter().flat_map(|v| v.receivers.iter().flatten());
        let in_views: Vec<Texel> = receivers.map(|r| r.texel(&baked.last.lattice)).collect();
        let log2 = resolution.trailing_zeros();
        let mut random = Random::new(1, 0);
        let shift = 64 - log2;
        let at_random: Vec<Texel> = (0..RANDOM).map(|_| [0, 1].map(|_| (random.bits() >> shift) as u32)).collect();
        let seen = |v: &View| v.points.iter().zip(&v.receivers).filter(|p| p.1.is_some()).map(|p| *p.0).collect();
        let points: Vec<Vec<[f64; 3]>> = pictures.iter().map(seen).collect();
        drop(pictures);
        let vectors = vectors(args, &model, resolution, &folder)?;
        if vectors.len() > 1 {
            across::measure(name, &vectors, &points.concat(), &mut report)?;
        }
        let map = scenes::open(&file)?;
        let resident = map.preload()?;
        let vector = vectors.into_iter().find(|v| v.resolution() == resolution);
        let bench = Bench { name, resolution, log2, resident, map, vector, arrays: Arrays::default() };
        let bench = bench.with_arrays();
        for (i, texels) in [in_views, at_random].iter().enumerate() {
            bench.measure(CASES[i], texels, [GOALS[i], VECTOR_GOALS[i]], &file, &mut report)?;
        }
        report.notes.push(format!(
            "{name}: file {}, resident {}, each array {}",
            bytes(baked.bytes),
            bytes(bench.resident.bytes() as u64),
            bytes(bench.arrays.rows.len() as u64 * 4)
        ));
        if let Some(v) = &bench.vector {
            let same = v.map.lattice() == bench.map.lattice();
            let place =
                if same { "the same lattice" } else { "another lattice: its texels are elsewhere in the scene" };
            let held = bytes(v.resident.bytes() as u64);
            report.notes.push(format!("{name}: vector file {}, resident {held}, {place}", bytes(v.file_bytes)));
        }
    }
    report
        .notes
        .push("ratio: of medians to the row-major array in the same case; in brackets over single rounds".to_string());
    for case in CASES {
        let exact = report.rows.iter().filter(|r| r["case"] == case && r["level"] == 0 && r["pass"] == "warm");
        let series = exact.map(|r| Series {
            name: format!("{} {}", r["scene"].as_str().unwrap_or(""), r["method"].as_str().unwrap_or("")),
            points: vec![["ns", "bytes_held"].map(|k| r[k].as_f64().unwrap_or(0.0))],
        });
        let plot = Plot {
            title: format!("One exact lookup on one thread, {case}"),
            axes: ["ns".to_string(), "bytes held".to_string()],
            series: series.collect(),
            hull: true,
        };
        report.plots.push((case.replace(' ', "-"), plot));
    }
    Ok(report)
}

/// Plain maps.
#[derive(Default)]
struct Arrays {
    rows: Vec<u32>,
    tiles: Vec<u32>,
}

/// A file of kind `vector` or `mmh`. Its values differ from the arrays', within the same intervals.
struct Vector {
    map: Map,
    resident: Resident,
    file_bytes: u64,
}

impl Vector {
    fn open(file: &std::path::Path) -> Result<Self, Failure> {
        let map = scenes::open(file)?;
        let kind = map.structure().kind();
        if kind == Kind::Mh {
            return Err(Failure::input(format!(
                "{}: kind {}; kind vector or mmh is wanted",
                file.display(),
                kind.name()
            )));
        }
        let resident = map.preload()?;
        Ok(Self { map, resident, file_bytes: std::fs::metadata(file).map_or(0, |m| m.len()) })
    }

    fn resolution(&self) -> u64 {
        self.map.resolution().into()
    }
}

/// The files that were given, or with `--full` two that are baked here, by rising resolution.
fn vectors(args: &Args, model: &Model, resolution: u64, folder: &Folder) -> Result<Vec<Vector>, Failure> {
    let mut vectors = Vec::new();
    for file in &args.vectors {
        vectors.push(Vector::open(file)?);
    }
    if args.full && vectors.is_empty() {
        for resolution in [resolution, LARGE] {
            let (_, file) = model.bake_as(Kind::Vector, LIGHTS[0], resolution, folder)?;
            vectors.push(Vector::open(&file)?);
        }
    }
    vectors.sort_by_key(Vector::resolution);
    Ok(vectors)
}

struct Bench<'a> {
    name: &'a str,
    resolution: u64,
    log2: u32,
    resident: Resident,
    map: Map,
    vector: Option<Vector>,
    arrays: Arrays,
}

impl Bench<'_> {
    fn with_arrays(mut self) -> Self {
        let side = self.resolution as usize;
        let count = side * side;
        let value = |x: usize, y: usize| self.resident.value(x as u32, y as u32, 0);
        let mut rows = vec![0u32; count];
        rows.par_chunks_mut(side).enumerate().for_each(|(y, row)| {
            row.iter_mut().enumerate().for_each(|(x, v)| *v = value(x, y));
        });
        let mut tiles = vec![0u32; count];
        let tile = 1usize << TILE_LOG2;
        tiles.par_chunks_mut(side * tile).enumerate().for_each(|(strip, out)| {
            for (i, v) in out.iter_mut().enumerate() {
                let (column, within) = (i / (tile * tile), i % (tile * tile));
                let (x, y) = (column * tile + within % tile, strip * tile + within / tile);
                *v = rows[y * side + x];
            }
        });
        self.arrays = Arrays { rows, tiles };
        self
    }

    fn row_major(&self, [x, y]: Texel) -> u32 {
        self.arrays.rows[(y as usize) << self.log2 | x as usize]
    }

    fn tiled(&self, [x, y]: Texel) -> u32 {
        let within = (y & 7) << TILE_LOG2 | (x & 7);
        self.arrays.tiles
            [(y as usize >> TILE_LOG2) << (self.log2 + TILE_LOG2) | ((x as usize >> TILE_LOG2) << 6) | within as usize]
    }

    /// Times all candidates on one list of texels.
    fn measure(
        &self,
        case: &str,
        texels: &[Texel],
        goals: [f64; 2],
        file: &std::path::Path,
        report: &mut Report,
    ) -> Result<(), Failure> {
        for &t in texels.iter().step_by(1009) {
            let lazily = self.map.texel(t[0], t[1], 0)?.value;
            let all = [self.resident.value(t[0], t[1], 0), self.row_major(t), self.tiled(t)];
            if all.iter().any(|v| *v != lazily) {
                return Err(Failure { code: 1, message: format!("texel {t:?}: {lazily} lazily, but {all:?}") });
            }
            if let Some(v) = &self.vector {
                let (lazily, all) = (v.map.texel(t[0], t[1], 0)?.value, v.resident.value(t[0], t[1], 0));
                if all != lazily {
                    return Err(Failure {
                        code: 1,
                        message: format!("vector, texel {t:?}: {lazily} lazily, but {all}"),
                    });
                }
            }
        }
        let level = |l: u8| move |t: Texel| self.resident.value(t[0], t[1], l);
        let lazy = |map: &Map, t: Texel| map.texel(t[0], t[1], 0).map_or(0, |a| a.value);
        let mut fresh: Vec<Map> = Vec::new();
        for _ in 0..=ROUNDS {
            fresh.push(scenes::open(file)?);
        }
        let array = self.arrays.rows.len() as u64 * 4;
        let on_disk = std::fs::metadata(file).map_or(0, |m| m.len());
        let resident = self.resident.bytes() as u64;
        // Name, level, pass, bytes held.
        let mut methods = vec![
            ("row-major array", 0, "warm", array),
            ("tiled array", 0, "warm", array),
            ("mh resident", 0, "warm", resident),
            ("mh resident", 3, "warm", resident),
            ("mh resident", 6, "warm", resident),
            ("mh lazy", 0, "warm", on_disk),
            ("mh lazy", 0, "first", on_disk),
        ];
        let (mut rows, mut tiles) = (|| sum(texels, |t| self.row_major(t)), || sum(texels, |t| self.tiled(t)));
        let (mut exact, mut third, mut sixth) =
            (|| sum(texels, level(0)), || sum(texels, level(3)), || sum(texels, level(6)));
        let mut lazily = || sum(texels, |t| lazy(&self.map, t));
        let mut first = || {
            if let Some(map) = fresh.pop() {
                sum_once(texels, |t| lazy(&map, t));
            }
        };
        let mut candidates: Vec<&mut dyn FnMut()> =
            vec![&mut rows, &mut tiles, &mut exact, &mut third, &mut sixth, &mut lazily, &mut first];
        let mut vector_runs: Vec<Box<dyn FnMut() + '_>> = Vec::new();
        if let Some(v) = &self.vector {
            let held = v.resident.bytes() as u64;
            for l in [0, 3, 6] {
                methods.push(("vector resident", l, "warm", held));
                vector_runs.push(Box::new(move || sum(texels, |t| v.resident.value(t[0], t[1], l))));
            }
            methods.push(("vector lazy", 0, "warm", v.file_bytes));
            vector_runs.push(Box::new(move || sum(texels, |t| lazy(&v.map, t))));
        }
        candidates.extend(vector_runs.iter_mut().map(|r| &mut **r as &mut dyn FnMut()));
        let samples = Samples::take(ROUNDS, &mut candidates);
        let once = |pass: &str| if pass == "first" { texels.len() } else { texels.len() * passes(texels) };
        let samples: Vec<Samples> = methods.iter().zip(&samples).map(|(m, s)| s.each(once(m.2))).collect();
        let mut table = Table::new(
            &format!(
                "{}, {} a side, {case}: {} lookups, {ROUNDS} rounds",
                self.name,
                side(self.resolution),
                texels.len()
            ),
            &["method", "level", "pass", "ns", "min..max", "ratio", "min..max"],
        );
        let base = samples[0].clone();
        for ((method, level, pass, held), s) in methods.iter().zip(&samples) {
            let (ns, ratio) = (s.median(), s.median() / base.median());
            let ([low, high], [least, most]) = (s.spread(), s.over(&base).spread());
            table.push([
                method.to_string(),
                level.to_string(),
                pass.to_string(),
                format!("{ns:.2}"),
                format!("{low:.2}..{high:.2}"),
                format!("{ratio:.2}"),
                format!("{least:.2}..{most:.2}"),
            ]);
            report.rows.push(json!({
                "scene": self.name, "resolution": self.resolution, "case": case, "method": method, "level": level,
                "pass": pass, "bytes_held": held,
                "lookups": texels.len(), "ns": ns, "ns_min": low, "ns_max": high,
                "ratio": ratio, "ratio_min": least, "ratio_max": most,
            }));
        }
        for (method, goal) in [("mh resident", goals[0]), ("vector resident", goals[1])] {
            let Some(i) = methods.iter().position(|m| (m.0, m.1) == (method, 0)) else { continue };
            let ratio = samples[i].median() / base.median();
            let what = format!("{}: {method} in {case} at most {goal} x the row-major array", self.name);
            report.goal(ratio <= goal, what, format!("{ratio:.2} x"));
        }
        report.tables.push(table);
        Ok(())
    }
}

/// Passes over a list in one round.
fn passes(texels: &[Texel]) -> usize {
    LOOKUPS.div_ceil(texels.len().max(1))
}

/// As many passes as make [`LOOKUPS`].
#[inline(always)]
fn sum(texels: &[Texel], mut lookup: impl FnMut(Texel) -> u32) {
    for _ in 0..passes(texels) {
        sum_once(texels, &mut lookup);
    }
}

/// One pass; the sum keeps the lookups.
#[inline(always)]
fn sum_once(texels: &[Texel], mut lookup: impl FnMut(Texel) -> u32) {
    let mut total = 0u32;
    for &t in black_box(texels) {
        total = total.wrapping_add(lookup(t));
    }
    black_box(total);
}
