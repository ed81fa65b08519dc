//! `umbrage demo`: a city from nothing to a picture, and the same picture by ray casting beside it.

use std::path::PathBuf;
use std::time::Instant;

use serde_json::json;
use umbrage::format::Kind;
use umbrage::render::{
    Camera, Look, Scene, Shading, ShadowRays, UpAxis, coverage, difference, shade, write_png, write_text,
};
use umbrage::writer::bake::{BakeError, BakeOptions, Light, bake};
use umbrage::writer::frame;
use umbrage::writer::scene::{self, DEMO_LIGHT};
use umbrage::writer::solid::Policy;

use super::output::{self, line};
use super::shadows::{Backend, How, Shadows, default_budget};
use super::{
    Failure, INPUT, TARGET, Watched, go_on, listen, load_scene, open, parse_resolution, picture, structure, whole,
};

/// Arguments of `demo`.
#[derive(clap::Args)]
pub struct Args {
    /// Folder for the pictures and the container
    #[arg(long, default_value = "demo-out")]
    out: PathBuf,
    /// Texels on a side of the shadow map
    #[arg(long, default_value_t = RESOLUTION, allow_negative_numbers = true, value_parser = parse_resolution)]
    resolution: u64,
    /// What answers the shadows
    #[arg(long, value_enum, default_value_t = Backend::Auto)]
    backend: Backend,
    /// Most memory for the streamer, MiB; half of the file without it
    #[arg(long, value_name = "MIB", allow_negative_numbers = true, value_parser = whole::<u64>(1, 1 << 20))]
    budget: Option<u64>,
    /// One JSON object on stdout
    #[arg(long)]
    json: bool,
}

/// The most that ends in about a minute on two cores.
const RESOLUTION: u64 = 1048576;
const SCENE: &str = "city:1";
const SIZE: [u32; 2] = [1280, 720];

/// Runs the command.
pub fn run(args: Args) -> Result<(), Failure> {
    let mut stages: Vec<(&str, f64)> = Vec::new();
    let begin = Instant::now();
    let mut last = begin;
    let mut stage = |name| {
        let now = Instant::now();
        stages.push((name, now.duration_since(last).as_secs_f64()));
        last = now;
    };
    listen();
    // Before the folder is made: a refusal leaves nothing behind.
    frame::log2_resolution(args.resolution).map_err(BakeError::from)?;
    std::fs::create_dir_all(&args.out).map_err(|e| {
        Failure::new(TARGET, format!("{}: {e}; name a folder that can be written with --out", args.out.display()))
    })?;
    let mesh = load_scene(SCENE)?;
    stage("scene");

    let file = args.out.join("city.umb");
    let options = BakeOptions {
        lights: vec![Light { name: "sun".to_string(), direction: DEMO_LIGHT }],
        resolution: args.resolution,
        policy: Policy::Closed,
        kind: Kind::Vector,
        exhaustive: false,
        top_down: false,
        mmh: Default::default(),
        memory_bytes: None,
        cold: false,
    };
    let watched = Watched::start(args.resolution.saturating_mul(args.resolution));
    let baked = bake(&mesh, &options, &file, &watched.progress)?;
    drop(watched);
    stage("bake");

    let view = match scene::demo_view(SCENE) {
        Some(v) => v.map_err(|e| Failure::new(INPUT, e))?,
        None => return Err(Failure::new(INPUT, format!("scene {SCENE} has no view"))),
    };
    let camera = Camera::new(view.eye, view.target, UpAxis::Y, view.fov_degrees).map_err(|e| Failure::new(INPUT, e))?;
    let snapped = &baked.last;
    let geometry = Scene::new(snapped);
    let view = geometry.view(&camera, SIZE[0], SIZE[1], &go_on).ok_or_else(Failure::interrupted)?;
    stage("primary rays");

    let container = open(&file)?;
    let budget = args.budget.map_or_else(|| default_budget(&container), |m| m << 20);
    let shadows = Shadows::answer(
        &view,
        geometry.surface(),
        &container,
        structure(&container, Some("sun"))?,
        How { backend: args.backend, budget, skips: Some(0) },
        Look::Texel,
    )?;
    let by_map = &shadows.lit();
    let read = container.counters();
    stage("shadows from the file");

    let by_rays = ShadowRays::new(&geometry).view(&view, &go_on).ok_or_else(Failure::interrupted)?;
    stage("shadows by rays");
    let edge = picture::edges(&view, snapped)?;
    stage("edge texels");

    let shading = Shading { components: Some(&snapped.solid), haze: None };
    write_png(&args.out.join("shadow.png"), &shade(&view, &coverage(by_map), shading))?;
    write_png(&args.out.join("reference.png"), &shade(&view, &coverage(&by_rays), shading))?;
    write_png(&args.out.join("difference.png"), &difference(SIZE[0], SIZE[1], by_map, &by_rays, &edge))?;
    stage("pictures");
    let total = begin.elapsed().as_secs_f64();

    let seen = view.receivers.iter().flatten().count();
    let differ = |on_edge: bool| (0..by_map.len()).filter(|&i| by_map[i] != by_rays[i] && edge[i] == on_edge).count();
    let (wrong, differ_edge) = (differ(false), differ(true));
    let edges = edge.iter().filter(|e| **e).count();
    let uncompressed = args.resolution * args.resolution * 4;
    let light = &baked.lights[0];
    let nodes: u64 = light.nodes.iter().sum();
    let report = json!({
        "scene": SCENE,
        "light": DEMO_LIGHT,
        "shadows": shadows.json(),
        "bake": super::bake::report(&baked, &options, stages[0].1, stages[1].1),
        "uncompressed_bytes": uncompressed,
        "pages_read": shadows.pages_read, "pages": light.pages, "reads": read.reads, "bytes_read": read.bytes,
        "pixels_with_receiver": seen,
        "pixels_in_edge_texels": edges,
        "pixels_wrong_on_certified_texels": wrong,
        "pixels_that_differ_in_edge_texels": differ_edge,
        "seconds": stages.iter().map(|(n, s)| (n.to_string(), json!(s))).collect::<serde_json::Map<_, _>>(),
        "total_seconds": total,
    });
    write_text(&args.out.join("report.json"), &format!("{report:#}\n"))?;
    if args.json {
        return line(&report.to_string());
    }
    line(&format!("{SCENE}: {} triangles, shadow map {} x {}", baked.triangles, args.resolution, args.resolution))?;
    line(&format!(
        "  file              {} of {} uncompressed (1 : {:.0}), {nodes} nodes at {:.2} bytes",
        output::bytes(baked.bytes),
        output::bytes(uncompressed),
        uncompressed as f64 / baked.bytes as f64,
        baked.bytes as f64 / nodes as f64
    ))?;
    line(&format!(
        "  pages read        {} of {} ({} read in all)",
        shadows.pages_read,
        light.pages,
        output::bytes(read.bytes)
    ))?;
    for l in shadows.lines() {
        line(&l)?;
    }
    let percent = |n: usize| n as f64 / seen.max(1) as f64 * 100.0;
    line(&format!(
        "  against rays      {wrong} wrong of {seen} pixels on certified texels; {differ_edge} differ in edge texels, which are {:.2} % of the pixels",
        percent(edges)
    ))?;
    for (name, seconds) in &stages {
        line(&format!("  {seconds:6.2} s  {name}"))?;
    }
    line(&format!("  {total:6.2} s  in all"))?;
    line(&args.out.join("shadow.png").display().to_string())
}
