//! What filters on coarse levels answer where nothing but the receiver's own surface decides.
//!
//! The truth of a pixel is the share of exact shadow rays that are lit, 4 x 4 in it. *Open* is a pixel that is wholly lit with
//! all its neighbours as far as a kernel reaches: what a filter darkens there is acne. *Deep* is one in shadow as far: what a
//! filter lights there has leaked. Surfaces that face away from the light are left out: they get none in any case.

use rayon::prelude::*;
use serde_json::json;
use umbrage::format::Kind;
use umbrage::reader::query::Resident;
use umbrage::reader::query::filter::{Receiver, Share, levels_around, nearest_level};
use umbrage::render::{Camera, Footprints, Scene, ShadowRays, UpAxis, View};
use umbrage::writer::mesh::Mesh;
use umbrage::writer::solid::{Policy, SnappedMesh};

use crate::report::{Report, Table, side};
use crate::scenes::{self, Folder, LIGHTS, Model};
use crate::{Args, Failure};

/// Pixels of a picture.
const PICTURE: [u32; 2] = [320, 180];
/// Rays across a pixel and down.
const RAYS: u32 = 4;
/// Pixels around one that must answer alike.
const AROUND: usize = 4;

/// The scene that this file makes.
const SLABS: &str = "slabs";

/// A pixel that is asked for.
struct Pixel {
    receiver: Receiver,
    lod: u32,
    /// Share of exact rays that are lit.
    truth: f64,
    open: bool,
    deep: bool,
}

/// A slab that is tilted about two axes, thinner than texels of coarse levels are deep, above another that lies flat.
fn slabs() -> Model {
    let mut mesh = Mesh::default();
    for (half, thickness, height, tilt) in [(20.0, 0.3, 0.0, 0.0), (12.0, 0.1, 14.0, 0.6)] {
        let first = mesh.positions.len() as u32;
        for k in 0..8u32 {
            let sign = |bit: u32| if k >> bit & 1 == 1 { 1.0 } else { -1.0 };
            let [x, y, z] = [half * sign(0), 0.5 * thickness * sign(1), half * sign(2)];
            let (sin, cos) = f64::sin_cos(tilt);
            let [x, y] = [cos * x - sin * y, sin * x + cos * y];
            let (sin, cos) = f64::sin_cos(0.5 * tilt);
            mesh.positions.push([x, cos * y - sin * z + height, sin * y + cos * z]);
        }
        // Counter-clockwise from outside.
        let faces = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
        for [a, b, c, d] in faces.map(|f| f.map(|i: u32| i + first)) {
            mesh.triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    Model { name: SLABS.to_string(), mesh, policy: Policy::Closed }
}

/// Pixels of a view that face the light, with the truth.
fn pixels(scene: &Scene<'_>, view: &View, mesh: &SnappedMesh) -> Vec<Pixel> {
    let [width, height] = PICTURE;
    let Some(fine) = scene.view(&view.camera, width * RAYS, height * RAYS, &|| true) else { return vec![] };
    let Some(lit) = ShadowRays::new(scene).view(&fine, &|| true) else { return vec![] };
    let rays = |i: usize| {
        let [x, y] = [i as u32 % width, i as u32 / width].map(|v| v * RAYS);
        let lit = &lit;
        (0..RAYS * RAYS).map(move |n| lit[((y + n / RAYS) * width * RAYS + x + n % RAYS) as usize])
    };
    let truth: Vec<f64> =
        (0..view.receivers.len()).map(|i| rays(i).filter(|l| *l).count() as f64 / f64::from(RAYS * RAYS)).collect();
    let of = Footprints::new(view, mesh);
    let around = |i: usize, wanted: f64| {
        let [x, y] = [i % width as usize, i / width as usize];
        let span = |v: usize, side: u32| v.saturating_sub(AROUND)..(v + AROUND + 1).min(side as usize);
        span(y, height).all(|v| span(x, width).all(|u| truth[v * width as usize + u] == wanted))
    };
    let pixel = |i: usize| {
        let facing = view.normals[i].iter().zip(view.light).map(|(n, l)| f64::from(*n) * l).sum::<f64>() < 0.0;
        let receiver = of.receiver(i).filter(|_| facing)?;
        let (open, deep) = (around(i, 1.0), around(i, 0.0));
        Some(Pixel { receiver, lod: of.level_of_detail(i), truth: truth[i], open, deep })
    };
    (0..view.receivers.len()).into_par_iter().filter_map(pixel).collect()
}

/// Where a tap is asked on a coarse level.
#[derive(Clone, Copy)]
enum Asked {
    /// As the product says: where the receiver's plane is nearest to the light.
    Product,
    /// At the receiver's own place in the coarse texel.
    Place,
    /// At the centre of the texel, and this share of the way from there to where the plane is nearest to the light.
    Centre(f64),
}

/// All that is tried, by name.
const WAYS: [(&str, Asked); 4] = [
    ("own place", Asked::Place),
    ("centre", Asked::Centre(0.0)),
    ("half way", Asked::Centre(0.5)),
    ("nearest", Asked::Product),
];

/// A kernel of 3 x 3.
fn kernel(map: &Resident, r: &Receiver, level: u8, asked: Asked) -> Share {
    let share = match asked {
        Asked::Product => return map.pcf(r, 3, level),
        Asked::Place => None,
        Asked::Centre(share) => Some(share),
    };
    let (cells, size) = (i64::from(map.resolution() >> level), f64::from(1u32 << level));
    let [gx, gy] = r.gradient.map(|g| f64::from(g) / 16.0);
    let mut lit = 0;
    for (i, j) in (-1..=1).flat_map(|j| (-1..=1).map(move |i| (i, j))) {
        let [x, y] = [i64::from(r.x >> level) + i, i64::from(r.y >> level) + j];
        if x < 0 || y < 0 || x >= cells || y >= cells {
            lit += 1;
            continue;
        }
        let half = 0.5 * (size - 1.0);
        let way = |v: i64, own: u32| v as f64 * size + half - f64::from(own);
        let rise = match share {
            None => (gx * i as f64 + gy * j as f64) * size,
            Some(share) => gx * way(x, r.x) + gy * way(y, r.y) - share * half * (gx.abs() + gy.abs()),
        };
        let value = map.value((x as u32) << level, (y as u32) << level, level);
        lit += u32::from(value == u32::MAX || f64::from(r.depth) + rise <= f64::from(value));
    }
    Share { lit, taps: 9, inside: true }
}

/// On the level of the pixel's footprint, or blended between the two around it.
fn answer(map: &Resident, p: &Pixel, blended: bool, asked: Asked) -> f64 {
    let share = |s: Share| f64::from(s.lit) / f64::from(s.taps);
    if !blended {
        return share(kernel(map, &p.receiver, nearest_level(p.lod), asked));
    }
    let (level, part) = levels_around(p.lod);
    let finer = kernel(map, &p.receiver, level, asked);
    let blends = part != 0 && map.resolution() >> level > 1;
    let coarser = if blends { kernel(map, &p.receiver, level + 1, asked) } else { finer };
    share(finer.blend(&coarser, part))
}

/// Of errors: how many, the share that is a hundredth or more, the mean, the root of the mean square.
fn figures(errors: impl Iterator<Item = f64>) -> (usize, f64, f64, f64) {
    let e: Vec<f64> = errors.collect();
    let n = e.len().max(1) as f64;
    let wrong = e.iter().filter(|e| **e > 0.01).count() as f64;
    let squares = e.iter().map(|e| e * e).sum::<f64>();
    (e.len(), wrong / n, e.iter().sum::<f64>() / n, (squares / n).sqrt())
}

/// Cameras around a scene.
fn cameras(model: &Model) -> Result<Vec<Camera>, Failure> {
    if model.name != SLABS {
        return model.cameras();
    }
    let eyes = [([50.0, 60.0, 40.0], 50.0), ([-60.0, 90.0, 20.0], 40.0), ([10.0, 70.0, -90.0], 40.0)];
    let camera = |(eye, fov)| Camera::new(eye, [0.0, 6.0, 0.0], UpAxis::Y, fov).map_err(Failure::input);
    eyes.into_iter().map(camera).collect()
}

/// Adds the table to the report of the suite.
pub fn run(args: &Args, report: &mut Report) -> Result<(), Failure> {
    let folder = Folder::new()?;
    let mut table = Table::new(
        "kernels of 3 x 3 on coarse levels against exact rays: open pixels that are darkened, deep ones that are lit, mean \
         error of these, RMS of all",
        &["scene", "kind", "side", "filter", "taps asked at", "acne %", "mean", "leaks %", "mean", "RMS"],
    );
    let resolution = args.resolutions.first().copied().unwrap_or(4096);
    for name in scenes::names(&args.scenes, &[SLABS, "city:1"]) {
        let model = if name == SLABS { slabs() } else { scenes::load(name, args.policy)? };
        for kind in [Kind::Mh, Kind::Vector] {
            let (baked, file) = model.bake_as(kind, LIGHTS[0], resolution, &folder)?;
            let map = scenes::open(&file)?.preload()?;
            let scene = Scene::new(&baked.last);
            let views = scenes::views(&scene, &cameras(&model)?, PICTURE[0], PICTURE[1]);
            let all: Vec<Pixel> = views.iter().flat_map(|view| pixels(&scene, view, &baked.last)).collect();
            for (filter, blended) in [("hierarchical", false), ("trilinear", true)] {
                for (way, asked) in WAYS {
                    let found: Vec<f64> = all.par_iter().map(|p| answer(&map, p, blended, asked)).collect();
                    let errors = |which: fn(&Pixel) -> bool| {
                        let both = all.iter().zip(&found).filter(|(p, _)| which(p));
                        figures(both.map(|(p, f)| (f - p.truth).abs()))
                    };
                    let (open, deep, every) = (errors(|p| p.open), errors(|p| p.deep), errors(|_| true));
                    let head = [name, kind.name(), &side(resolution), filter, way].map(str::to_string);
                    let numbers = [100.0 * open.1, open.2, 100.0 * deep.1, deep.2, every.3];
                    let [a, b, c, d, e] = head;
                    let [f, g, h, i, j] = numbers.map(|v| format!("{v:.4}"));
                    table.push([a, b, c, d, e, f, g, h, i, j]);
                    report.rows.push(json!({
                        "scene": name, "kind": kind.name(), "resolution": resolution, "filter": filter, "asked_at": way,
                        "open": open.0, "acne": open.1, "acne_mean": open.2,
                        "deep": deep.0, "leaks": deep.1, "leaks_mean": deep.2, "rms": every.3,
                    }));
                }
            }
        }
    }
    report.tables.push(table);
    Ok(())
}
