//! Pictures drawn on a device while pages come, held against those of the CPU and against rays; flights and the window from the
//! command line.

use std::fs;
use std::io::BufRead;
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::time::{Duration, Instant};

use serde_json::Value;
use umbrage::format::Kind;
use umbrage::reader::query::Map;
use umbrage::reader::{Container, FileSource, Limits};
use umbrage::render::{
    Camera, Filter, Footprints, Look, RgbImage, Scene, Shading, ShadowRays, UpAxis, coverage, shade,
};
use umbrage::runtime::Headless;
use umbrage::view::{Overlay, Patience, Stage, Style};
use umbrage::writer::bake::{BakeOptions, Light, bake};
use umbrage::writer::mesh::Mesh;
use umbrage::writer::scene;
use umbrage::writer::solid::{Policy, SnappedMesh};

use crate::cli::{CITY, Place, SUN, error};

const SIZE: [u32; 2] = [320, 180];

/// A small city in a file, and the mesh as it was baked.
struct City {
    container: Container,
    mesh: SnappedMesh,
}

impl City {
    fn baked(place: &Place, kind: Kind, resolution: u64) -> Self {
        Self::of(place, &scene::generated(CITY).unwrap().unwrap(), kind, resolution)
    }

    fn of(place: &Place, mesh: &Mesh, kind: Kind, resolution: u64) -> Self {
        let options = BakeOptions {
            lights: vec![Light { name: "sun".into(), direction: [0.4, -0.8, 0.3] }],
            resolution,
            policy: Policy::Closed,
            kind,
            exhaustive: false,
            top_down: false,
            mmh: Default::default(),
            memory_bytes: None,
            cold: false,
        };
        let file = place.file("city.umb");
        let mesh = bake(mesh, &options, &file, &Default::default()).unwrap().last;
        let container = Container::open(Arc::new(FileSource::open(&file).unwrap()), Limits::default()).unwrap();
        Self { container, mesh }
    }

    fn stage(&self, budget: u64) -> Stage {
        let structure = self.container.structure(0).unwrap();
        Stage::headless(&Headless::new().unwrap(), &structure, &self.mesh, budget, SIZE).unwrap()
    }

    /// The picture of the CPU.
    fn picture(&self, camera: &Camera, look: Look) -> RgbImage {
        let map = Map::new(self.container.structure(0).unwrap()).unwrap();
        let geometry = Scene::new(&self.mesh);
        let view = geometry.view(camera, SIZE[0], SIZE[1], &|| true).unwrap();
        let of = Footprints::new(&view, geometry.surface());
        let lattice = map.lattice();
        let lit = |pixel: usize| {
            let Some(r) = &view.receivers[pixel] else { return 255 };
            let [x, y] = r.texel(&lattice);
            let hard = match look {
                Look::Texel => map.is_lit(x, y, 0, r.depth.query()).unwrap(),
                Look::Place => r.lit(map.continuous(x, y, r.sub(&lattice)).unwrap().value),
                Look::Filtered(filter) => {
                    let (side, lod) = filter.at(&of, pixel);
                    return map.trilinear(&of.receiver(pixel).unwrap(), side, lod).unwrap().coverage();
                }
            };
            if hard { 255 } else { 0 }
        };
        let lit: Vec<u8> = (0..view.receivers.len()).map(lit).collect();
        shade(&view, &lit, Shading { components: Some(&self.mesh.solid), haze: None })
    }
}

fn camera(eye: [f64; 3], target: [f64; 3]) -> Camera {
    Camera::new(eye, target, UpAxis::Y, 45.0).unwrap()
}

fn cameras() -> [Camera; 3] {
    [
        camera([60.0, 40.0, 60.0], [0.0; 3]),
        camera([-80.0, 25.0, 10.0], [20.0, 5.0, 0.0]),
        // straight down, close
        camera([10.0, 60.0, 5.0], [10.0, 0.0, 5.0]),
    ]
}

/// Pixels that two pictures have apart by more than `least` of 255.
fn apart(a: &RgbImage, b: &RgbImage, least: u8) -> usize {
    assert_eq!((a.width, a.height), (b.width, b.height));
    let differ = |(a, b): (&[u8; 3], &[u8; 3])| (0..3).any(|k| a[k].abs_diff(b[k]) > least);
    a.pixels.iter().zip(&b.pixels).filter(|p| differ(*p)).count()
}

fn style(look: Look) -> Style {
    Style { look, overlay: None }
}

const LOOKS: [Look; 5] = [
    Look::Texel,
    Look::Place,
    Look::Filtered(Filter::Pcf(5)),
    Look::Filtered(Filter::Hierarchical(3)),
    Look::Filtered(Filter::Trilinear(3)),
];

#[test]
fn pictures_of_the_device_are_those_of_the_cpu() {
    let place = Place::new("view-cpu");
    for (kind, resolution) in [(Kind::Vector, 2048), (Kind::Mh, 512)] {
        let city = City::baked(&place, kind, resolution);
        let mut stage = city.stage(64 << 20);
        for camera in cameras() {
            let mut all: Vec<RgbImage> = Vec::new();
            for look in LOOKS {
                let still = stage.still(&camera, &style(look), Patience::Exact, &|| true).unwrap();
                assert_eq!(still.by_ancestors, 0, "{kind:?} {look:?}");
                let cpu = city.picture(&camera, look);
                // Where edges cross a pixel's centre one ray may see the other side, and shadows' edges are a pixel off.
                let count = still.image.pixels.len();
                let off = apart(&still.image, &cpu, 3);
                assert!(off * 200 < count, "{kind:?} {look:?}: {off} of {count} pixels");
                all.push(still.image);
            }
            // The pictures are of something, and filters do something.
            assert!(apart(&all[0], &all[2], 8) > 300 && apart(&all[2], &all[4], 3) > 30, "{kind:?}");
        }
    }
}

/// Rays decide; the device's receivers are in f32, on maps fine enough that it would show.
#[test]
fn pictures_of_the_device_agree_with_rays() {
    let place = Place::new("view-rays");
    let city = City::baked(&place, Kind::Vector, 1 << 18);
    let geometry = Scene::new(&city.mesh);
    let mut stage = city.stage(64 << 20);
    for camera in cameras() {
        let view = geometry.view(&camera, SIZE[0], SIZE[1], &|| true).unwrap();
        let lit = coverage(&ShadowRays::new(&geometry).view(&view, &|| true).unwrap());
        let right = shade(&view, &lit, Shading { components: Some(&city.mesh.solid), haze: None });
        let still = stage.still(&camera, &style(Look::Texel), Patience::Exact, &|| true).unwrap();
        let (off, count) = (apart(&still.image, &right, 3), right.pixels.len());
        assert!(off * 500 < count, "{off} of {count} pixels");
        let dark = shade(&view, &vec![0; lit.len()], Shading { components: Some(&city.mesh.solid), haze: None });
        assert!(apart(&dark, &right, 8) * 5 > count, "hardly anything is lit");
    }
}

/// An eye far from the origin, and one within a hand's breadth of a wall: neither acne nor jitter.
#[test]
fn far_and_near_eyes_see_no_acne() {
    let place = Place::new("view-far");
    let mut mesh = scene::generated(CITY).unwrap().unwrap();
    let off = [2.5e5, -1e4, 7e5];
    mesh.positions.iter_mut().for_each(|p| (0..3).for_each(|k| p[k] += off[k]));
    let city = City::of(&place, &mesh, Kind::Vector, 1 << 16);
    let mut stage = city.stage(64 << 20);
    let geometry = Scene::new(&city.mesh);
    let there = |p: [f64; 3]| -> [f64; 3] { std::array::from_fn(|k| p[k] + off[k]) };
    for (eye, target) in
        [([60.0, 40.0, 60.0], [0.0; 3]), ([900.0, 900.0, 900.0], [0.0; 3]), ([3.0, 60.0, 2.0], [3.2, 0.0, 2.1])]
    {
        let camera = camera(there(eye), there(target));
        let view = geometry.view(&camera, SIZE[0], SIZE[1], &|| true).unwrap();
        let lit = coverage(&ShadowRays::new(&geometry).view(&view, &|| true).unwrap());
        let right = shade(&view, &lit, Shading { components: Some(&city.mesh.solid), haze: None });
        let still = stage.still(&camera, &style(Look::Texel), Patience::Exact, &|| true).unwrap();
        let (off, count) = (apart(&still.image, &right, 3), right.pixels.len());
        assert!(off * 200 < count, "{eye:?}: {off} of {count} pixels");
    }
}

/// Bars of 60 m that are a few centimetres thick: the normals of their triangles have few digits in f32.
#[test]
fn thin_triangles_throw_no_shadow_on_themselves() {
    let place = Place::new("view-thin");
    let mut mesh = Mesh { positions: Vec::new(), triangles: Vec::new() };
    let mut bar = |from: [f64; 3], size: [f64; 3], lean: f64| {
        let first = mesh.positions.len() as u32;
        for i in 0..8u32 {
            let [x, y, z] = [0, 1, 2].map(|k| size[k] * f64::from(i >> k & 1));
            mesh.positions.push([from[0] + x, from[1] + y + lean * x, from[2] + z + 0.3 * lean * x]);
        }
        #[rustfmt::skip]
        let sides = [
            [0, 2, 1], [1, 2, 3], [4, 5, 6], [5, 7, 6], [0, 1, 4], [1, 5, 4],
            [2, 6, 3], [3, 6, 7], [0, 4, 2], [2, 4, 6], [1, 3, 5], [3, 7, 5],
        ];
        mesh.triangles.extend(sides.map(|t| t.map(|c| first + c)));
    };
    bar([-40.0, -1.0, -40.0], [80.0, 1.0, 80.0], 0.0);
    for i in 0..12 {
        let thin = 0.03 * f64::from(1 + i % 4);
        bar([-30.0, 1.0 + f64::from(i % 3), f64::from(i) * 0.8], [60.0, thin, 2.0 * thin], 0.03 * f64::from(i % 5));
    }
    let city = City::of(&place, &mesh, Kind::Vector, 1 << 15);
    let mut stage = city.stage(64 << 20);
    let geometry = Scene::new(&city.mesh);
    for (eye, target) in [([5.0, 6.0, 14.0], [0.0, 1.0, 5.0]), ([31.0, 4.0, 4.0], [-30.0, 2.0, 4.5])] {
        let camera = camera(eye, target);
        let view = geometry.view(&camera, SIZE[0], SIZE[1], &|| true).unwrap();
        let lit = coverage(&ShadowRays::new(&geometry).view(&view, &|| true).unwrap());
        let right = shade(&view, &lit, Shading { components: Some(&city.mesh.solid), haze: None });
        let still = stage.still(&camera, &style(Look::Texel), Patience::Exact, &|| true).unwrap();
        let (off, count) = (apart(&still.image, &right, 3), right.pixels.len());
        assert!(off * 200 < count, "{eye:?}: {off} of {count} pixels");
    }
}

#[test]
fn a_frame_that_does_not_wait_is_answered_by_ancestors_and_gets_exact() {
    let place = Place::new("view-coarse");
    let city = City::baked(&place, Kind::Mh, 4096);
    let mut stage = city.stage(64 << 20);
    let [camera, ..] = cameras();
    let once = |stage: &mut Stage| stage.still(&camera, &style(Look::Texel), Patience::None, &|| true).unwrap();
    let first = once(&mut stage);
    let took = (first.drawn, first.by_ancestors, first.worst_levels);
    assert!(took.0 == 1 && took.1 > 5000 && took.2 > 2, "{took:?}");
    let exact = stage.still(&camera, &style(Look::Texel), Patience::Exact, &|| true).unwrap();
    assert!(exact.by_ancestors == 0 && apart(&first.image, &exact.image, 8) > 100, "{}", exact.drawn);
    let again = once(&mut stage);
    assert!(again.by_ancestors == 0 && again.image == exact.image);
    // Where nobody wants to wait, the drawing at hand is the picture.
    let mut stage = city.stage(64 << 20);
    let stopped = stage.still(&camera, &style(Look::Texel), Patience::Exact, &|| false).unwrap();
    assert_eq!(stopped.drawn, 1);
}

#[test]
fn the_pool_keeps_its_budget_while_a_camera_flies() {
    let place = Place::new("view-budget");
    let city = City::baked(&place, Kind::Mh, 8192);
    let file = city.container.header().total_bytes.get();
    let mut stage = city.stage((file / 4).max(1 << 20));
    let (mut evicted, mut worst) = (0, 0);
    for i in 0..40 {
        let a = f64::from(i) * 0.15;
        let camera =
            camera([90.0 * a.cos(), 12.0, 90.0 * a.sin()], [60.0 * (a + 0.5).cos(), 0.0, 60.0 * (a + 0.5).sin()]);
        stage.still(&camera, &style(Look::Texel), Patience::None, &|| true).unwrap();
        while stage.shadows().streamer().is_loading() {
            stage.shadows_mut().streamer_mut().wait(Duration::from_millis(20));
        }
        let now = stage.shadows().streamer().stats();
        let pool = stage.shadows().streamer().budget().pool();
        assert!(now.resident_words * 4 <= pool, "{now:?}");
        (evicted, worst) = (now.evicted, worst.max(now.resident_words * 4 * 100 / pool));
    }
    assert!(evicted > 0 && worst > 50, "the flight needs more than the budget: {evicted} {worst}");
}

#[test]
fn overlays_show_what_they_say() {
    let place = Place::new("view-overlays");
    let city = City::baked(&place, Kind::Vector, 2048);
    let mut stage = city.stage(64 << 20);
    let [camera, ..] = cameras();
    let look = Look::Filtered(Filter::Hierarchical(3));
    let mut draw =
        |overlay, patience| stage.still(&camera, &Style { look, overlay }, patience, &|| true).unwrap().image;
    // Palette and light leave no other pixel so red.
    let red = |image: &RgbImage| image.pixels.iter().filter(|p| p[0] > 170 && p[1] < 130 && p[2] < 130).count();
    let coarse = draw(Some(Overlay::Residency), Patience::None);
    let exact = draw(Some(Overlay::Residency), Patience::Exact);
    assert!(red(&coarse) > 2000 && red(&exact) == 0, "{} {}", red(&coarse), red(&exact));
    let black = |image: &RgbImage| image.pixels.iter().filter(|p| p.iter().all(|v| *v < 140)).count();
    let missing = draw(Some(Overlay::Missing), Patience::Exact);
    assert!(black(&missing) * 2 > missing.pixels.len(), "{}", black(&missing));
    let plain = draw(None, Patience::Exact);
    let all: Vec<RgbImage> = Overlay::ALL.map(|o| draw(Some(o), Patience::Exact)).into();
    for (i, image) in all.iter().enumerate() {
        assert!(apart(image, &plain, 8) > 5000, "{i}");
        assert!(all[..i].iter().all(|other| apart(image, other, 8) > 2000), "{i}");
    }
}

#[test]
fn what_does_not_fit_the_device_is_refused() {
    let place = Place::new("view-refused");
    let city = City::baked(&place, Kind::Mh, 64);
    let structure = city.container.structure(0).unwrap();
    let device = Headless::new().unwrap();
    let made = |size, budget| Stage::headless(&device, &structure, &city.mesh, budget, size).map(|_| ()).unwrap_err();
    assert!(made([0, 5], 1 << 24).to_string().contains("0 x 5 pixels"));
    assert!(made([1 << 20, 5], 1 << 24).to_string().contains("1048576 x 5 pixels"));
    assert!(made(SIZE, 1000).to_string().contains("budget"));
}

/// Windows have their channels in another order.
#[test]
fn a_picture_is_the_same_in_every_format() {
    let place = Place::new("view-formats");
    let city = City::baked(&place, Kind::Vector, 256);
    let structure = city.container.structure(0).unwrap();
    let Headless { device, queue, .. } = Headless::new().unwrap();
    let [camera, ..] = cameras();
    let pictures = [wgpu::TextureFormat::Rgba8Unorm, wgpu::TextureFormat::Bgra8Unorm].map(|format| {
        let mut stage = Stage::new(&device, &queue, &structure, &city.mesh, 16 << 20, format, [64, 64]).unwrap();
        stage.resize(SIZE).unwrap();
        stage.still(&camera, &style(Look::Texel), Patience::Exact, &|| true).unwrap().image
    });
    assert!(pictures[0] == pictures[1] && pictures[0].pixels.len() == (SIZE[0] * SIZE[1]) as usize);
    assert!(apart(&pictures[0], &city.picture(&camera, Look::Texel), 3) < 300);
}

const FLIGHT: &str = r#"{"fov": 45, "frames_per_second": 10, "keys": [
    {"seconds": 0, "eye": [60, 40, 60], "target": [0, 0, 0]},
    {"seconds": 0.4, "eye": [40, 40, 60], "target": [0, 0, 0]}]}"#;

fn flown(place: &Place, more: &[&str]) -> String {
    let args = ["render", CITY, "city.umb", "--flight", "flight.json", "--size", "320x180", "-o", "out"];
    place.fine(&[&args[..], more].concat())
}

fn ready(name: &str) -> Place {
    let place = Place::new(name);
    place.fine(&["bake", CITY, "--light", SUN, "--kind", "vector", "--resolution", "2048", "-o", "city.umb"]);
    place.write("flight.json", FLIGHT);
    place
}

fn image(place: &Place, name: &str) -> RgbImage {
    let file = std::io::BufReader::new(fs::File::open(place.file(name)).unwrap());
    let mut reader = png::Decoder::new(file).read_info().unwrap();
    let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut bytes).unwrap();
    let pixels = bytes[..info.buffer_size()].chunks_exact(3).map(|p| [p[0], p[1], p[2]]).collect();
    RgbImage { width: info.width, height: info.height, pixels }
}

#[test]
fn a_flight_leaves_a_picture_of_each_frame_and_a_table() {
    let place = ready("flight");
    let said: Value = serde_json::from_str(&flown(&place, &["--json"])).unwrap();
    assert_eq!((&said["frames"], &said["frames_with_ancestors"]), (&5.into(), &0.into()), "{said}");
    assert!(said["most_resident_bytes"].as_u64() <= said["budget_bytes"].as_u64());
    let names: Vec<String> = place.entries().into_iter().map(|e| e.0).collect();
    assert_eq!(names, ["city.umb", "flight.json", "out"]);
    let table = fs::read_to_string(place.file("out/frames.csv")).unwrap();
    let rows: Vec<Vec<&str>> = table.lines().map(|l| l.split(',').collect()).collect();
    assert_eq!((rows.len(), rows[0][0], rows[5][0], rows[5][1]), (6, "frame", "4", "0.4000"));
    assert!(rows.iter().all(|r| r.len() == rows[0].len()) && rows[1..].iter().all(|r| r[3] == "0"), "{table}");
    // Each is the picture that a camera there gets, on a device and on the CPU.
    let single = ["render", CITY, "city.umb", "--size", "320x180", "-o", "one.png", "--camera", "60,40,60,0,0,0"];
    place.fine(&single);
    let (first, last) = (image(&place, "out/00000.png"), image(&place, "out/00004.png"));
    assert!(apart(&first, &image(&place, "one.png"), 3) < 300 && apart(&first, &last, 8) > 3000);
    let by_cpu = flown(&place, &["--backend", "cpu", "--filter", "pcf:3", "--frames", "3..4"]);
    assert!(by_cpu.starts_with("2 frames by the CPU"), "{by_cpu}");
    let cpu = image(&place, "out/00004.png");
    flown(&place, &["--filter", "pcf:3", "--frames", "4..4"]);
    let device = image(&place, "out/00004.png");
    assert!(apart(&device, &cpu, 3) < 300 && apart(&device, &last, 3) > 100);
    // Rows of frames that were not drawn again stay.
    let table = fs::read_to_string(place.file("out/frames.csv")).unwrap();
    let frames: Vec<&str> = table.lines().map(|l| l.split(',').next().unwrap()).collect();
    assert_eq!(frames, ["frame", "0", "1", "2", "3", "4"]);
    // A game's frames, and an overlay.
    let once: Value = serde_json::from_str(&flown(&place, &["--once", "--json"])).unwrap();
    assert!(once["drawn"] == 5 && once["frames_with_ancestors"].as_u64() > Some(0), "{once}");
    flown(&place, &["--overlay", "pages"]);
    assert!(apart(&image(&place, "out/00004.png"), &device, 8) > 5000);
}

#[test]
fn wrong_flights_are_refused() {
    let place = ready("flight-refused");
    place.write("bad.json", FLIGHT.replace("0.4", "-1"));
    place.write("file", "");
    let all = |flight: &str, more: &[&str]| -> Vec<String> {
        let args = ["render", CITY, "city.umb", "--flight", flight, "--size", "32x18"];
        args.iter().chain(more).map(|s| s.to_string()).collect()
    };
    for (code, flight, more, says) in [
        (3, "missing.json", &["-o", "out"][..], "missing.json"),
        (3, "bad.json", &["-o", "out"], "keys[1].seconds"),
        (5, "flight.json", &["-o", "file"], "file"),
        (2, "flight.json", &["-o", "out", "--frames", "3..5"], "the flight has frames 0..4"),
        (2, "flight.json", &["-o", "out", "--frames", "3..2"], "'3..2'"),
        (2, "flight.json", &["-o", "out", "--frames", "-1..2"], "'-1..2'"),
        (2, "flight.json", &["-o", "out", "--overlay", "heat"], "'heat'"),
        (2, "flight.json", &["-o", "out", "--overlay", "pages", "--backend", "cpu"], "overlays are drawn on a device"),
        (2, "flight.json", &["-o", "out", "--camera", "1,2,3,4,5,6"], "--camera"),
        (2, "flight.json", &["-o", "out", "--up", "z"], "a flight says both itself"),
        (2, "flight.json", &["-o", "out", "--fov", "20"], "a flight says both itself"),
    ] {
        let args = all(flight, more);
        let args: Vec<&str> = args.iter().map(String::as_str).collect();
        assert!(place.refused(code, &args).contains(says), "{args:?}");
    }
    let neither = place.refused(2, &["render", CITY, "city.umb", "-o", "out"]);
    assert!(neither.contains("required"), "{neither}");
    let alone = place.refused(2, &["render", CITY, "city.umb", "--camera", "1,2,3,4,5,6", "--once", "-o", "out.png"]);
    assert!(alone.contains("--flight") || alone.contains("--once"), "{alone}");
}

#[test]
fn an_interrupted_flight_keeps_its_frames_and_says_how_to_go_on() {
    let place = ready("flight-interrupted");
    place.write("long.json", FLIGHT.replace("0.4", "400"));
    let args = ["render", CITY, "city.umb", "--flight", "long.json", "--size", "64x36", "-o", "out"];
    let child = place.command(&args).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let start = Instant::now();
    while !place.file("out/00003.png").exists() {
        assert!(start.elapsed() < Duration::from_secs(120), "no frame came");
        std::thread::sleep(Duration::from_millis(20));
    }
    assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
    let line = error(&child.wait_with_output().unwrap(), 130, &args);
    let frames = fs::read_dir(place.file("out")).unwrap().count() - 1;
    assert!(
        line.contains(&format!("{frames} frames are in out; --frames {frames}..4000 goes on from there")),
        "{line}"
    );
    let table = fs::read_to_string(place.file("out/frames.csv")).unwrap();
    assert_eq!(table.lines().count(), frames + 1, "a row for each");
}

/// A display without a screen.
struct Display(Child, String);

impl Display {
    fn new() -> Self {
        // It takes a number that is free and says which, once it listens.
        let mut child = Command::new("Xvfb")
            .args(["-displayfd", "1", "-screen", "0", "800x600x24", "-nolisten", "tcp"])
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .expect("Xvfb, from Debian's package xvfb");
        let mut number = String::new();
        std::io::BufReader::new(child.stdout.take().unwrap()).read_line(&mut number).unwrap();
        assert!(number.trim().parse::<u32>().is_ok(), "the display did not start: {number}");
        Display(child, format!(":{}", number.trim()))
    }
}

impl Drop for Display {
    fn drop(&mut self) {
        // It takes its socket away.
        let _ = Command::new("kill").arg(self.0.id().to_string()).status();
        let _ = self.0.wait();
    }
}

#[test]
fn the_window_opens_flies_and_closes_by_itself() {
    let place = ready("window");
    let display = Display::new();
    let args = ["view", CITY, "city.umb", "--size", "400x300", "--seconds", "12", "--flight", "flight.json", "--json"];
    let out = place.command(&args).env("DISPLAY", &display.1).env_remove("WAYLAND_DISPLAY").output().unwrap();
    let (stdout, stderr) = crate::cli::text(&out);
    assert_eq!(out.status.code(), Some(0), "{stderr}");
    let said: Value = serde_json::from_str(&stdout).unwrap();
    assert!(said["frames"].as_u64() > Some(2) && said["pages_read"].as_u64() > Some(3), "{said}");
    assert!(said["resident"].as_u64() > Some(3) && said["seconds"].as_f64() > Some(12.0), "{said}");
}

#[test]
fn without_a_display_the_window_says_so() {
    let place = ready("no-window");
    let before = place.entries();
    let args = ["view", CITY, "city.umb"];
    let out = place.command(&args).env_remove("DISPLAY").env_remove("WAYLAND_DISPLAY").output().unwrap();
    let line = error(&out, 5, &args);
    assert!(line.contains("no window: no display") && line.contains("--flight") && !line.contains(".rs"), "{line}");
    let out = place.command(&args).env("DISPLAY", ":89").env_remove("WAYLAND_DISPLAY").output().unwrap();
    assert!(error(&out, 5, &args).contains("no window"));
    assert_eq!(place.entries(), before);
    for (more, says) in
        [(&["--speed", "0"][..], "above 0"), (&["-o", "nowhere"], "nowhere"), (&["--overlay", "x"], "residency")]
    {
        assert!(place.refused(2, &[&args[..], more].concat()).contains(says), "{more:?}");
    }
}
