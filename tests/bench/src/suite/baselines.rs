//! `baselines`: bytes, lookup time and error of other people's methods, and of the product's kinds, on the same scenes and
//! intervals.
//!
//! Lookups answer whether a receiver is lit. Receivers are those of recorded views, in pixel order, and uniform at random
//! in x, y and depth; all candidates take turns. Errors: every texel, and the same receivers, held against the intervals.
//! The intervals lie in memory: sides up to 16,384. On larger maps only the product's kinds are there, and errors are those
//! of a sample.

use std::borrow::Cow;
use std::hint::black_box;
use std::path::Path;
use std::time::Instant;

use serde_json::json;
use umbrage::certify::Oracle;
use umbrage::format::Kind;
use umbrage::render::Scene;
use umbrage::writer::solid::SnappedMesh;

use crate::baseline::Baseline;
use crate::baseline::depth_dag::DepthDag;
use crate::baseline::error::{Errors, wrong, wrong_at};
use crate::baseline::image::Image;
use crate::baseline::plain::{Array, Product, Tiles};
use crate::baseline::plane_tree::PlaneTree;
use crate::baseline::scanline::{Form, Scanlines};
use crate::baseline::unpadded::Unpadded;
use crate::baseline::voxel_dag::VoxelDag;
use crate::plot::{Plot, Series};
use crate::random::Random;
use crate::report::{Report, Table, bytes, side};
use crate::scenes::{self, Folder, LIGHTS, Model};
use crate::timing::Samples;
use crate::{Args, Failure};

/// Pictures of the recorded views.
const PICTURE: [u32; 2] = [1280, 720];
/// Random receivers.
const RANDOM: usize = 1 << 21;
/// Rounds in which all candidates take turns.
const ROUNDS: usize = 5;
/// Seconds of one candidate in a round, at least: the clock moves by ticks of up to 4 ms.
const LEAST: f64 = 0.1;
/// Receivers that a slow method is asked, in pixel order and at random.
const SLOW: [usize; 2] = [1 << 16, 512];
/// Where receivers come from.
const CASES: [&str; 2] = ["pixel order", "random"];
/// Largest side whose intervals fit the memory that such a run may take.
pub const MOST: u64 = 16384;
/// Largest side of the product's kinds that follow the texels, and of all.
const LARGE: [u64; 2] = [1 << 16, 1 << 20];
/// Texels and receivers of each list that are held against the oracle where there are no intervals.
const SAMPLE: usize = 20_000;

/// A method, and the seconds that its data took to make from the intervals (the product's: from the mesh).
type Method = (Box<dyn Baseline>, f64);

/// Runs the suite.
///
/// # Errors
/// A scene can't be loaded or baked, a file not be read, or the side is too large.
pub fn run(args: &Args) -> Result<Report, Failure> {
    let mut report = Report::new("baselines");
    let own: &[u64] = if args.full { &[1024, 4096, 16384] } else { &[1024, 4096] };
    let resolutions = if args.resolutions.is_empty() { own } else { &args.resolutions };
    for name in scenes::names(&args.scenes, &["city:1"]) {
        measure(name, resolutions, args, &mut report)?;
    }
    close(&mut report);
    Ok(report)
}

/// Measures all methods on one scene.
///
/// # Errors
/// As [`run`].
pub fn measure(name: &str, resolutions: &[u64], args: &Args, report: &mut Report) -> Result<(), Failure> {
    if let Some(r) = resolutions.iter().find(|r| **r > LARGE[1] || **r < 8) {
        return Err(Failure { code: 2, message: format!("{r} texels a side: expected 8 to {}", LARGE[1]) });
    }
    let folder = Folder::new()?;
    let model = scenes::load(name, args.policy)?;
    for &resolution in resolutions {
        let bench = Bench::new(&model, args.light.unwrap_or(LIGHTS[0]), resolution, &folder)?;
        let lists = bench.receivers()?;
        let times = [0, 1].map(|case| time(&bench.methods, &lists[case], case));
        bench.show(&lists, &times, report);
    }
    Ok(())
}

/// Notes and plots of what was measured.
pub fn close(report: &mut Report) {
    report.notes.push(
        "outside: texels where the deepest receiver that must be lit is dark, or the first that must be dark is lit; off: \
         distance of a stored depth to its interval, lattice steps, RMS over all texels"
            .to_string(),
    );
    report.notes.push(
        "bytes of vector, mmh, mh: whole files, which answer all levels; MH is the paper's layout (4 bytes a leaf, 4 an \
         empty node, 8 an inner one); of the others only the depth DAG and MH, unpadded, hold coarser levels, and none is \
         asked for them"
            .to_string(),
    );
    plots(report);
}

/// One scene at one resolution.
struct Bench<'a> {
    model: &'a Model,
    light: [f64; 3],
    resolution: u64,
    /// Bytes of MH as the paper lays it out; none where it was not baked.
    paper: Option<u64>,
    mesh: SnappedMesh,
    /// None of a map too large.
    image: Option<Image>,
    methods: Vec<Method>,
}

impl<'a> Bench<'a> {
    /// Bakes the product's kinds, and makes every other method's data from their intervals.
    fn new(model: &'a Model, light: [f64; 3], resolution: u64, folder: &Folder) -> Result<Self, Failure> {
        let mut methods: Vec<Method> = Vec::new();
        let mut geometry = None;
        let mut paper = None;
        let mut guard = 0;
        let kinds = [("vector", Kind::Vector), ("mmh", Kind::Mmh), ("mh", Kind::Mh)];
        // `mh` is there for the paper's bytes, too
        for (name, kind) in kinds.into_iter().filter(|k| k.1 == Kind::Vector || resolution <= LARGE[0]) {
            let start = Instant::now();
            let (baked, file) = model.bake_as(kind, light, resolution, folder)?;
            let seconds = start.elapsed().as_secs_f64();
            let map = scenes::open(&file)?;
            methods.push((Box::new(Product::new(name, baked.bytes, map.preload()?)), seconds));
            guard = map.structure().record().depth_guard.get();
            if kind == Kind::Mh {
                let nodes = baked.lights[0].nodes;
                paper = Some(4 * nodes[0] + 8 * nodes[1] + 4 * nodes[2]);
            }
            geometry = Some(baked.last);
            remove(&file)?;
        }
        let Some(mesh) = geometry else { unreachable!("three kinds were baked") };
        if resolution > MOST {
            return Ok(Bench { model, light, resolution, paper, mesh, image: None, methods });
        }
        let start = Instant::now();
        let image = Image::of(&mesh, guard);
        eprintln!("{} {}: intervals in {:.1} s", model.name, side(resolution), start.elapsed().as_secs_f64());
        let mut make = |build: &dyn Fn() -> Result<Box<dyn Baseline>, Failure>| -> Result<(), Failure> {
            let start = Instant::now();
            let made = build()?;
            let seconds = start.elapsed().as_secs_f64();
            eprintln!("{} {}: {} in {seconds:.1} s", model.name, side(resolution), made.name());
            methods.push((made, seconds));
            Ok(())
        };
        make(&|| Ok(Box::new(Array::new(&image))))?;
        for level in [3, 19] {
            make(&|| Ok(Box::new(Tiles::new(&image, level).map_err(Failure::target)?)))?;
        }
        make(&|| Ok(Box::new(Scanlines::new(&image, Form::Packed))))?;
        make(&|| Ok(Box::new(Scanlines::new(&image, Form::Wide))))?;
        make(&|| Ok(Box::new(PlaneTree::new(&image))))?;
        make(&|| Ok(Box::new(VoxelDag::new(&image))))?;
        make(&|| Ok(Box::new(DepthDag::new(&image))))?;
        make(&|| Ok(Box::new(Unpadded::new(&image))))?;
        Ok(Bench { model, light, resolution, paper, mesh, image: Some(image), methods })
    }

    /// Receivers (x, y, d) of recorded views, and random ones.
    fn receivers(&self) -> Result<[Vec<[u32; 3]>; 2], Failure> {
        let scene = Scene::new(&self.mesh);
        let pictures = scenes::views(&scene, &self.model.cameras()?, PICTURE[0], PICTURE[1]);
        let receivers = pictures.iter().flat_map(|v| v.receivers.iter().flatten());
        let in_views: Vec<[u32; 3]> = receivers
            .map(|r| {
                let [x, y] = r.texel(&self.mesh.lattice);
                [x, y, r.depth.query()]
            })
            .collect();
        drop(pictures);
        let (mut random, shift) = (Random::new(1, 0), 64 - self.resolution.trailing_zeros());
        let at_random: Vec<[u32; 3]> = (0..RANDOM)
            .map(|_| {
                let [x, y] = [0, 1].map(|_| (random.bits() >> shift) as u32);
                [x, y, (random.bits() >> 32) as u32]
            })
            .collect();
        Ok([in_views, at_random])
    }

    /// Asks for the errors, and makes the table, the rows and the goals.
    fn show(&self, lists: &[Vec<[u32; 3]>; 2], times: &[Vec<Samples>; 2], report: &mut Report) {
        let oracle = Oracle::new(&self.mesh);
        let mut table = Table::new(
            &format!(
                "{}, {} a side; {} lookups in pixel order, {} at random; MH {}",
                self.model.name,
                side(self.resolution),
                lists[0].len(),
                lists[1].len(),
                self.paper.map_or("-".to_string(), bytes)
            ),
            &[
                "method",
                "bytes",
                ": MH",
                "pixel ns",
                ": array",
                "random ns",
                ": array",
                "outside %",
                "largest off",
                "RMS off",
                "views wrong %",
                "random wrong %",
                "made in s",
            ],
        );
        let array = self.methods.iter().position(|m| m.0.name().starts_with("array"));
        let places: Vec<[u32; 2]> = lists[1].iter().take(SAMPLE).map(|[x, y, _]| [*x, *y]).collect();
        let mut exact: Vec<(String, u64, [f64; 2])> = Vec::new();
        for (i, (method, seconds)) in self.methods.iter().enumerate() {
            let (errors, share) = match &self.image {
                Some(image) => {
                    // Of a slow method, those that were timed must do.
                    let asked = |case: usize| asked(&**method, &lists[case], case);
                    let share = [0, 1].map(|case| wrong(&**method, image, Some(&oracle), &asked(case)));
                    (Errors::of(&**method, image, Some(&oracle)), share)
                }
                None => {
                    let step = |case: usize| lists[case].len().div_ceil(SAMPLE).max(1);
                    let some = |case: usize| lists[case].iter().step_by(step(case)).copied().collect::<Vec<_>>();
                    (
                        Errors::at(&**method, &oracle, &places),
                        [0, 1].map(|case| wrong_at(&**method, &oracle, &some(case))),
                    )
                }
            };
            let ns = [0, 1].map(|case| times[case][i].median());
            let spread = [0, 1].map(|case| times[case][i].spread());
            let ratio = [0, 1].map(|case| array.map(|array| ns[case] / times[case][array].median()));
            let ratios = ratio.map(|r| r.map_or("-".to_string(), |r| format!("{r:.2}")));
            let has_depths = method.value(0, 0).is_some();
            let off = |v: String| if has_depths { v } else { "-".to_string() };
            let percent = |v: f64| if v == 0.0 { "0".to_string() } else { format!("{:.4}", v * 100.0) };
            let size = method.bytes();
            table.push([
                method.name(),
                bytes(size),
                self.paper.map_or("-".to_string(), |p| format!("{:.3}", size as f64 / p as f64)),
                format!("{:.1}", ns[0]),
                ratios[0].clone(),
                format!("{:.1}", ns[1]),
                ratios[1].clone(),
                percent(errors.share()),
                off(errors.largest.to_string()),
                off(format!("{:.1}", errors.rms())),
                percent(share[0]),
                percent(share[1]),
                format!("{seconds:.1}"),
            ]);
            report.rows.push(json!({
            "scene": self.model.name, "light": self.light, "policy": self.model.policy.to_string(), "resolution": self.resolution,
            "method": method.name(), "citation": method.citation(), "bytes": size, "paper_bytes": self.paper,
            "ratio": self.paper.map(|p| size as f64 / p as f64), "texels_asked": errors.texels,
            "pixel_ns": ns[0], "pixel_ns_min": spread[0][0], "pixel_ns_max": spread[0][1], "pixel_ratio": ratio[0],
            "random_ns": ns[1], "random_ns_min": spread[1][0], "random_ns_max": spread[1][1],
            "random_ratio": ratio[1],
            "outside": errors.share(), "outside_texels": errors.outside,
            "largest_off": has_depths.then_some(errors.largest), "rms_off": has_depths.then(|| errors.rms()),
            "views_wrong": share[0], "random_wrong": share[1], "seconds": seconds,
        }));
            if errors.outside == 0 {
                exact.push((method.name(), size, ns));
            }
        }
        report.tables.push(table);
        let place = format!("{} {}", self.model.name, side(self.resolution));
        let mut goal =
            |what: &str, found: Option<&(String, u64, [f64; 2])>, figure: &dyn Fn(u64, [f64; 2]) -> String| {
                let Some((name, size, ns)) = found else { return };
                let found = format!("{name}, {}", figure(*size, *ns));
                report.goal(name == "vector", format!("{place}: vector {what} of the methods without errors"), found);
            };
        let fastest = |case: usize| {
            exact.iter().filter(|e| !e.0.starts_with("array")).min_by(|a, b| a.2[case].total_cmp(&b.2[case]))
        };
        goal("is the smallest", exact.iter().min_by_key(|e| e.1), &|size, _| bytes(size));
        for case in [0, 1] {
            let what = format!("is the fastest, but for the array, in {}", CASES[case]);
            goal(&what, fastest(case), &|_, ns| format!("{:.1} ns", ns[case]));
        }
    }
}

/// What a method is asked: all receivers, or [`SLOW`] of them in runs that lie evenly among all.
fn asked<'a>(method: &dyn Baseline, receivers: &'a [[u32; 3]], case: usize) -> Cow<'a, [[u32; 3]]> {
    if !method.is_slow() || receivers.len() <= SLOW[case] {
        return Cow::Borrowed(receivers);
    }
    let runs = 16;
    let begin = |i: usize| i * (receivers.len() / runs);
    Cow::Owned((0..runs).flat_map(|i| &receivers[begin(i)..begin(i) + SLOW[case] / runs]).copied().collect())
}

/// Nanoseconds of a lookup of each method, round by round.
fn time(methods: &[Method], receivers: &[[u32; 3]], case: usize) -> Vec<Samples> {
    let parts: Vec<Cow<'_, [[u32; 3]]>> = methods.iter().map(|m| asked(&*m.0, receivers, case)).collect();
    let once = |i: usize| black_box(methods[i].0.count(black_box(&parts[i][..])));
    let passes = |i: usize| {
        let start = Instant::now();
        once(i);
        (LEAST / start.elapsed().as_secs_f64().max(1e-6)).ceil() as usize
    };
    let passes: Vec<usize> = (0..methods.len()).map(passes).collect();
    let mut runs: Vec<Box<dyn FnMut() + '_>> = Vec::new();
    for (i, n) in passes.iter().enumerate() {
        let once = &once;
        runs.push(Box::new(move || {
            for _ in 0..*n {
                once(i);
            }
        }));
    }
    let mut candidates: Vec<&mut dyn FnMut()> = runs.iter_mut().map(|r| &mut **r as &mut dyn FnMut()).collect();
    let samples = Samples::take(ROUNDS, &mut candidates);
    samples.iter().enumerate().map(|(i, s)| s.each(parts[i].len() * passes[i])).collect()
}

/// Bytes by resolution of each scene; time and bytes against error, and time against bytes, of each map.
fn plots(report: &mut Report) {
    let text = |r: &serde_json::Value, key: &str| r[key].as_str().unwrap_or("").to_string();
    let number = |r: &serde_json::Value, key: &str| r[key].as_f64().unwrap_or(0.0);
    let distinct = |mut all: Vec<(String, u64)>| {
        all.dedup();
        all
    };
    let maps = report.rows.iter().map(|r| (text(r, "scene"), r["resolution"].as_u64().unwrap_or(0)));
    let maps = distinct(maps.collect());
    let mut scenes: Vec<String> = maps.iter().map(|m| m.0.clone()).collect();
    scenes.dedup();
    // Of the rows of one map or scene, one series for each method.
    let series = |of: &dyn Fn(&serde_json::Value) -> bool, axes: [&str; 2], percent: bool| {
        let mut all: Vec<Series> = Vec::new();
        for r in report.rows.iter().filter(|r| of(r)) {
            let scale = if percent { 100.0 } else { 1.0 };
            let point = [number(r, axes[0]), number(r, axes[1]) * scale];
            match all.iter_mut().find(|s| s.name == text(r, "method")) {
                Some(s) => s.points.push(point),
                None => all.push(Series { name: text(r, "method"), points: vec![point] }),
            }
        }
        all
    };
    let mut plots = Vec::new();
    let file = |name: &str| name.rsplit(['/', '\\']).next().unwrap_or("").replace([':', '.'], "-");
    for scene in &scenes {
        let plot = Plot {
            title: format!("{scene}: bytes by method"),
            axes: ["texels on a side".to_string(), "bytes".to_string()],
            series: series(&|r| text(r, "scene") == *scene, ["resolution", "bytes"], false),
            hull: false,
        };
        plots.push((format!("{}-bytes", file(scene)), plot));
    }
    for (scene, resolution) in &maps {
        let of = |r: &serde_json::Value| text(r, "scene") == *scene && r["resolution"] == *resolution;
        let pictures = [
            ("time-error", ["pixel_ns", "outside"], ["ns per lookup, pixel order", "% of texels outside"], true),
            ("bytes-error", ["bytes", "outside"], ["bytes", "% of texels outside"], true),
            ("time-bytes", ["pixel_ns", "bytes"], ["ns per lookup, pixel order", "bytes"], false),
        ];
        for (name, axes, labels, percent) in pictures {
            let plot = Plot {
                title: format!("{scene}, {} a side", side(*resolution)),
                axes: labels.map(str::to_string),
                series: series(&of, axes, percent),
                hull: true,
            };
            plots.push((format!("{}-{resolution}-{name}", file(scene)), plot));
        }
    }
    report.plots.extend(plots);
}

fn remove(file: &Path) -> Result<(), Failure> {
    std::fs::remove_file(file).map_err(|e| Failure::target(format!("{}: {e}", file.display())))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// On the lattice and the intervals of real files: who loses nothing does so, the others are known to lose.
    #[test]
    fn every_method_errs_as_it_says() {
        let model = scenes::load("city:3:0.05", None).expect("a scene");
        let folder = Folder::new().expect("a folder");
        let bench = Bench::new(&model, LIGHTS[0], 256, &folder).expect("a bench");
        let oracle = Oracle::new(&bench.mesh);
        let image = bench.image.as_ref().expect("a small map");
        let errors: Vec<(String, u64)> =
            bench.methods.iter().map(|m| (m.0.name(), Errors::of(&*m.0, image, Some(&oracle)).outside)).collect();
        assert_eq!(errors.len(), 12);
        for (name, outside) in &errors {
            let loses = name.starts_with("plane tree") || name.starts_with("voxel DAG");
            assert_eq!(*outside > 0, loses, "{errors:?}");
        }
        let places: Vec<[u32; 2]> =
            (0..256).step_by(2).flat_map(|y| (0..256).step_by(3).map(move |x| [x, y])).collect();
        let lists = bench.receivers().expect("receivers");
        for ((m, _), (name, outside)) in bench.methods.iter().zip(&errors) {
            // Without the image, of a sample: three methods will do, the oracle is slow.
            if *outside > 0 || name == "vector" {
                let found = Errors::at(&**m, &oracle, &places);
                assert_eq!((found.outside > 0, found.texels), (*outside > 0, places.len() as u64), "{name}");
                let few = &lists[0][..2000];
                assert_eq!(wrong_at(&**m, &oracle, few), wrong(&**m, image, Some(&oracle), few), "{name}");
            }
            let some = &lists[1][..200];
            let lit = some.iter().filter(|[x, y, d]| m.lit(*x, *y, *d)).count();
            assert_eq!(m.count(some), lit, "{}", m.name());
        }
    }
}
