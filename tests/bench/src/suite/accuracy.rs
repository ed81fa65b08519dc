//! `accuracy`: wrong receivers against ray casting, without any bias, and those of plain shadow maps at their best.
//!
//! Half of the receivers are pixels of recorded views, half lie on the surface at random. All are exact: a lattice point
//! in the projection of a triangle, with the triangle's depth there as a fraction; those strictly inside a solid are
//! left out, since nothing is promised for them. The truth is decided in integers by shadow rays. *Acne* is lit by rays
//! and dark by the map, a *leak* the other way round. Certified and edge texels are told apart by the oracle.
//!
//! The plain map gets the constant bias that is best for these very receivers, found exactly, and the best pair of
//! constant and slope-scaled bias, exact in the constant and searched in the slope and in a cut-off for steep ones. Bias is
//! added to what is stored; the slope is that of the receiver's plane, |dz/dx| + |dz/dy| per texel, so that 0.5 already
//! covers any plane's own acne.

use std::collections::BTreeMap;
use std::hint::black_box;

use rayon::prelude::*;
use serde_json::json;
use umbrage::certify::Oracle;
use umbrage::reader::query::Resident;
use umbrage::render::{Hit, Placement, Receiver, Scene, ShadowRays};
use umbrage::writer::solid::{Policy, SnappedMesh};

use crate::plot::{Plot, Series};
use crate::random::Random;
use crate::report::{Report, Table, side};
use crate::scenes::{self, Folder, LIGHTS, Model, SCENES};
use crate::timing::Samples;
use crate::{Args, Failure, depth_map};

/// Receivers for each scene, light and resolution.
const COUNT: usize = 100_000;
/// The same with `--full`.
const FULL: usize = 1_000_000;
/// Draws before a random receiver is given up: walls that the light sees edge-on, points inside solids.
const DRAWS: usize = 32;
/// Rounds of timing.
const ROUNDS: usize = 5;
/// Queries of a round, at least.
const TIMED: usize = 2_000_000;
/// Slope-scaled biases that are tried, 0 among them, so that the pair is never worse than the constant alone.
const SLOPES: [f64; 13] = [0.0, 0.125, 0.25, 0.375, 0.5, 0.625, 0.75, 0.875, 1.0, 1.25, 1.5, 2.0, 3.0];

/// Slopes are cut off at these shares of the receivers, by rising slope: engines clamp the bias at grazing angles.
const CUTS: [f64; 5] = [1.0, 0.99, 0.95, 0.85, 0.7];

/// A receiver with its truth.
struct Point {
    texel: [u32; 2],
    /// Depth rounded up: what an integer map is asked with.
    query: u32,
    /// Depth as near as f64 has it.
    depth: f64,
    /// |dz/dx| + |dz/dy| of its triangle, in depth steps per texel.
    slope: f64,
    lit: bool,
    certified: bool,
}

/// Wrong answers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Wrong {
    /// Acne and leaks on certified texels.
    certified: [u64; 2],
    /// Acne and leaks on edge texels.
    edge: [u64; 2],
}

impl Wrong {
    fn count<'a>(points: impl Iterator<Item = (&'a Point, bool)>) -> Self {
        let mut wrong = Wrong::default();
        for (p, lit) in points {
            let place = if p.certified { &mut wrong.certified } else { &mut wrong.edge };
            if lit != p.lit {
                place[usize::from(lit)] += 1;
            }
        }
        wrong
    }

    fn all(&self) -> u64 {
        self.certified.iter().chain(&self.edge).sum()
    }
}

/// Added to what a plain map stores: `constant + slope * min(slope of the receiver, cut)`.
#[derive(Clone, Copy, Debug, Default)]
struct Bias {
    /// In depth steps.
    constant: f64,
    slope: f64,
    /// In depth steps per texel.
    cut: f64,
}

impl Bias {
    /// The part that depends on the receiver.
    fn scaled(&self, p: &Point) -> f64 {
        self.slope * p.slope.min(self.cut)
    }
}

/// What one method did on one set of points.
struct Outcome {
    method: String,
    bias: Bias,
    wrong: Wrong,
    ns: f64,
}

/// Runs the suite.
pub fn run(args: &Args) -> Result<Report, Failure> {
    let mut report = Report::new("accuracy");
    let count = if args.full { FULL } else { COUNT };
    let resolutions = if args.resolutions.is_empty() { vec![4096] } else { args.resolutions.clone() };
    let folder = Folder::new()?;
    let mut table = Table::new(
        "wrong receivers; acne and leaks on certified (c) and on edge (e) texels",
        &[
            "scene", "policy", "open", "side", "light", "method", "points", "edge %", "acne c", "leaks c", "acne e",
            "leaks e", "wrong %", "bias m", "slope", "ns",
        ],
    );
    // By method and resolution: points, wrong, sum of ns, number of rows.
    let mut totals: BTreeMap<(String, u64), (u64, Wrong, f64, u32)> = BTreeMap::new();
    let mut promised = (0, 0);
    for name in scenes::names(&args.scenes, &SCENES) {
        let model = scenes::load(name, args.policy)?;
        for &resolution in &resolutions {
            for light in LIGHTS {
                let (baked, file) = model.bake(light, resolution, &folder)?;
                let mesh = &baked.last;
                let resident = scenes::open(&file)?.preload()?;
                let points = receivers(&model, mesh, count)?;
                let outcomes = compare(&points, &resident, &depth_map::whole(mesh), resolution as usize);
                let edge = points.iter().filter(|p| !p.certified).count();
                let share = edge as f64 / points.len().max(1) as f64;
                let metres = umbrage::writer::frame::depth_step(&mesh.lattice);
                // Sheets without thickness are promised nothing; second-surface is, on the scene's own surfaces.
                if baked.lights[0].components.open == 0 || model.policy == Policy::SecondSurface {
                    promised.0 += points.len() - edge;
                    promised.1 += outcomes[0].wrong.certified.iter().sum::<u64>();
                }
                for o in &outcomes {
                    let wrong = o.wrong.all() as f64 / points.len().max(1) as f64;
                    table.push([
                        name.to_string(),
                        model.policy.to_string(),
                        baked.lights[0].components.open.to_string(),
                        side(resolution),
                        light.map(|c| c.to_string()).join(","),
                        o.method.clone(),
                        points.len().to_string(),
                        format!("{:.2}", share * 100.0),
                        o.wrong.certified[0].to_string(),
                        o.wrong.certified[1].to_string(),
                        o.wrong.edge[0].to_string(),
                        o.wrong.edge[1].to_string(),
                        format!("{:.3}", wrong * 100.0),
                        format!("{:.4}", o.bias.constant * metres),
                        o.bias.slope.to_string(),
                        format!("{:.1}", o.ns),
                    ]);
                    report.rows.push(json!({
                        "scene": name, "policy": model.policy.to_string(), "open_components": baked.lights[0].components.open,
                        "light": light, "resolution": resolution, "method": o.method,
                        "receivers": points.len(), "edge_receivers": edge, "edge_share": share,
                        "acne_certified": o.wrong.certified[0], "leaks_certified": o.wrong.certified[1],
                        "acne_edge": o.wrong.edge[0], "leaks_edge": o.wrong.edge[1], "wrong_share": wrong,
                        "bias_steps": o.bias.constant, "bias_world": o.bias.constant * metres, "slope_bias": o.bias.slope, "slope_cut": o.bias.cut,
                        "ns_per_query": o.ns,
                    }));
                    let t = totals.entry((o.method.clone(), resolution)).or_default();
                    t.0 += points.len() as u64;
                    for k in 0..2 {
                        t.1.certified[k] += o.wrong.certified[k];
                        t.1.edge[k] += o.wrong.edge[k];
                    }
                    (t.2, t.3) = (t.2 + o.ns, t.3 + 1);
                }
            }
        }
    }
    report.tables.push(table);
    let mut sums = Table::new(
        "all scenes and lights",
        &["method", "side", "points", "acne c", "leaks c", "acne e", "leaks e", "wrong %", "ns"],
    );
    let mut series: BTreeMap<String, Vec<[f64; 2]>> = BTreeMap::new();
    for ((method, resolution), (points, wrong, ns, rows)) in &totals {
        let share = wrong.all() as f64 / (*points).max(1) as f64;
        let ns = ns / f64::from(*rows);
        sums.push([
            method.clone(),
            side(*resolution),
            points.to_string(),
            wrong.certified[0].to_string(),
            wrong.certified[1].to_string(),
            wrong.edge[0].to_string(),
            wrong.edge[1].to_string(),
            format!("{:.3}", share * 100.0),
            format!("{ns:.1}"),
        ]);
        series.entry(method.clone()).or_default().push([ns, share]);
    }
    report.tables.push(sums);
    report.goal(
        promised.1 == 0,
        "mh without bias is right for every receiver in a certified texel",
        format!("{} wrong of {}", promised.1, promised.0),
    );
    report.plots.push((
        "time-error".to_string(),
        Plot {
            title: "Time against error, all scenes and lights".to_string(),
            axes: ["ns per query".to_string(), "share of wrong receivers".to_string()],
            series: series.into_iter().map(|(name, points)| Series { name, points }).collect(),
            hull: true,
        },
    ));
    Ok(report)
}

/// Receivers with their truth: pixels of the recorded views, then random points of the surface up to `count`.
fn receivers(model: &Model, mesh: &SnappedMesh, count: usize) -> Result<Vec<Point>, Failure> {
    let scene = Scene::new(mesh);
    let oracle = Oracle::new(mesh);
    let cameras = model.cameras()?;
    let pixels = count as f64 / 2.0 / cameras.len() as f64;
    let height = (pixels * 9.0 / 16.0).sqrt().ceil();
    let pictures = scenes::views(&scene, &cameras, (height * 16.0 / 9.0) as u32, height as u32);
    // Edge-on triangles have no projected area: the ray that reaches their border decides nothing about them.
    let promised = |r: &Receiver| {
        let depth = oracle.surface_depth(r.triangle as usize, r.xy)?;
        (r.placement == Placement::Exact && !oracle.strictly_inside(r.xy, &depth)).then_some(*r)
    };
    let seen: Vec<Receiver> = pictures.iter().flat_map(|v| v.receivers.iter().flatten().copied()).collect();
    let mut found: Vec<Receiver> = seen.par_iter().filter_map(promised).collect();
    drop(pictures);
    let areas = Areas::new(mesh);
    let rest = count.saturating_sub(found.len()) as u64;
    let draw = |lane: u64| {
        let mut random = Random::new(2, lane);
        (0..DRAWS).find_map(|_| promised(&areas.draw(&scene, &mut random)))
    };
    found.par_extend((0..rest).into_par_iter().filter_map(draw));

    let rays = ShadowRays::new(&scene);
    let mut texels: Vec<[u32; 2]> = found.iter().map(|r| r.texel(&mesh.lattice)).collect();
    texels.par_sort_unstable();
    texels.dedup();
    let certified: Vec<bool> = texels.par_iter().map(|[x, y]| oracle.texel(*x, *y).certified).collect();
    let step = (1u64 << mesh.lattice.subtexel_bits) as f64;
    let point = |r: &Receiver| {
        let texel = r.texel(&mesh.lattice);
        let [a, b, c] = mesh.triangles[r.triangle as usize].map(|v| mesh.positions[v as usize]);
        let [u, v] = [b, c].map(|q| [0, 1, 2].map(|k| (q[k] - a[k]) as f64));
        let area = u[0] * v[1] - u[1] * v[0];
        let slope = (u[2] * v[1] - v[2] * u[1]).abs() + (v[2] * u[0] - u[2] * v[0]).abs();
        Point {
            texel,
            query: r.depth.query(),
            depth: r.depth.to_f64(),
            slope: slope / area.abs() * step,
            lit: rays.lit(r.xy, &r.depth),
            certified: texels.binary_search(&texel).is_ok_and(|i| certified[i]),
        }
    };
    Ok(found.par_iter().map(point).collect())
}

/// Random points on the surface, evenly by area in the world.
struct Areas {
    /// Sums of the areas up to each triangle.
    sums: Vec<f64>,
}

impl Areas {
    fn new(mesh: &SnappedMesh) -> Self {
        let rows = mesh.lattice.world_to_lattice;
        let scale = [0, 1, 2].map(|k| (0..3).map(|j| rows[k][j] * rows[k][j]).sum::<f64>().sqrt());
        let mut sum = 0.0;
        let sums = mesh.triangles.iter().map(|t| {
            let [a, b, c] = t.map(|v| mesh.positions[v as usize]);
            let [u, v] = [b, c].map(|q| [0, 1, 2].map(|k| (q[k] - a[k]) as f64 / scale[k]));
            let cross = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
            sum += cross.iter().map(|c| c * c).sum::<f64>().sqrt();
            sum
        });
        Areas { sums: sums.collect() }
    }

    fn draw(&self, scene: &Scene<'_>, random: &mut Random) -> Receiver {
        let surface = scene.surface();
        let at = random.unit() * self.sums.last().copied().unwrap_or(0.0);
        let triangle = self.sums.partition_point(|s| *s <= at).min(self.sums.len() - 1);
        let corners = surface.triangles[triangle].map(|v| surface.positions[v as usize]);
        let (mut v, mut w) = (random.unit(), random.unit());
        if v + w > 1.0 {
            (v, w) = (1.0 - v, 1.0 - w);
        }
        let lattice = [0, 1, 2].map(|k| {
            let [a, b, c] = corners.map(|c| c[k] as f64);
            a + v * (b - a) + w * (c - a)
        });
        Receiver::new(surface, &Hit { triangle: triangle as u32, t: 0.0, lattice })
    }
}

/// All methods on one set of points; the map comes first.
fn compare(points: &[Point], resident: &Resident, plain: &[u32], side: usize) -> Vec<Outcome> {
    let stored = |p: &Point| plain[p.texel[1] as usize * side + p.texel[0] as usize];
    let by_map = |p: &Point| p.query <= resident.value(p.texel[0], p.texel[1], 0);
    // The same work for both: a lookup and a comparison; a bias would be one addition more.
    // Long enough for the clock.
    let passes = TIMED.div_ceil(points.len().max(1));
    let repeat = |lit: &dyn Fn() -> usize| {
        for _ in 0..passes {
            black_box(lit());
        }
    };
    let samples = Samples::take(
        ROUNDS,
        &mut [&mut || repeat(&|| points.iter().filter(|p| by_map(p)).count()), &mut || {
            repeat(&|| points.iter().filter(|p| p.query <= stored(p)).count())
        }],
    );
    let ns = [0, 1].map(|k| samples[k].median() * 1e9 / (passes * points.len().max(1)) as f64);
    let mut outcomes = vec![Outcome {
        method: "mh, no bias".to_string(),
        bias: Bias::default(),
        wrong: Wrong::count(points.iter().map(|p| (p, by_map(p)))),
        ns: ns[0],
    }];
    let mut slopes: Vec<f64> = points.iter().map(|p| p.slope).collect();
    slopes.par_sort_unstable_by(f64::total_cmp);
    let last = slopes.len().saturating_sub(1) as f64;
    let cuts = CUTS.map(|share| slopes.get((share * last) as usize).copied().unwrap_or(0.0));
    for bits in [32u32, 24] {
        let step = f64::from(1u32 << (32 - bits));
        let quantised = |d: f64| (d / step).round() * step;
        let behind: Vec<f64> = points.iter().map(|p| quantised(p.depth) - quantised(f64::from(stored(p)))).collect();
        let outcome = |name: &str, bias: Bias| Outcome {
            method: format!("plain {bits} bit, {name}"),
            bias,
            wrong: Wrong::count(points.iter().zip(&behind).map(|(p, b)| (p, b - bias.scaled(p) <= bias.constant))),
            ns: ns[1],
        };
        let best = |slope: f64, cut: f64| {
            let scaled = Bias { constant: 0.0, slope, cut };
            let (constant, wrong) =
                best_constant(points.iter().zip(&behind).map(|(p, b)| (b - scaled.scaled(p), p.lit)));
            (wrong, Bias { constant, ..scaled })
        };
        let pairs: Vec<(f64, f64)> = SLOPES.iter().flat_map(|&s| cuts.iter().map(move |&c| (s, c))).collect();
        let searched: Vec<(u64, Bias)> = pairs.into_par_iter().map(|(s, c)| best(s, c)).collect();
        let sloped = searched.into_iter().min_by_key(|t| t.0).unwrap_or_default();
        outcomes.extend([
            outcome("no bias", Bias::default()),
            outcome("best constant bias", best(0.0, 0.0).1),
            outcome("best slope bias", sloped.1),
        ]);
    }
    outcomes
}

/// The constant (not below 0) that makes the fewest answers wrong, and how many, for `lit iff behind <= constant`.
fn best_constant(points: impl Iterator<Item = (f64, bool)>) -> (f64, u64) {
    let mut sorted: Vec<(f64, bool)> = points.collect();
    sorted.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    // At first all are dark: every lit one is wrong.
    let mut wrong = sorted.iter().filter(|p| p.1).count() as u64;
    let mut best: Option<(f64, u64)> = None;
    for same in sorted.chunk_by(|a, b| a.0 == b.0) {
        if same[0].0 > 0.0 && best.is_none() {
            best = Some((0.0, wrong));
        }
        for p in same {
            wrong = if p.1 { wrong - 1 } else { wrong + 1 };
        }
        if same[0].0 >= 0.0 && best.is_none_or(|b| wrong < b.1) {
            best = Some((same[0].0, wrong));
        }
    }
    best.unwrap_or((0.0, wrong))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_best_constant_is_the_best() {
        let mut random = Random::new(3, 0);
        for _ in 0..50 {
            let points: Vec<(f64, bool)> =
                (0..40).map(|_| ((random.unit() * 30.0).floor() - 10.0, random.unit() < 0.6)).collect();
            let wrong = |c: f64| points.iter().filter(|p| (p.0 <= c) != p.1).count() as u64;
            let (constant, count) = best_constant(points.iter().copied());
            assert_eq!(wrong(constant), count);
            assert_eq!((0..40).map(|c| wrong(f64::from(c))).min(), Some(count));
        }
    }
}
