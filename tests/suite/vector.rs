//! Kind `vector` from the command line: what is baked is proven, answers alike by every way, and depends on nothing but its
//! input.

use std::fmt::Write as _;
use std::fs;
use std::sync::Arc;

use serde_json::Value;
use umbrage::certify::Oracle;
use umbrage::format::Kind;
use umbrage::reader::query::{Map, Resident};
use umbrage::reader::{Container, FileSource, Limits};
use umbrage::writer::container::{ContainerOptions, ContainerWriter, PageInput};
use umbrage::writer::scene;
use umbrage::writer::solid::{Policy, snap};

use crate::cli::{CITY, Place, SUN};

const SIDE: u32 = 512;

fn bake(place: &Place, file: &str, more: &[&str]) {
    bake_side(place, file, SIDE, more);
}

fn bake_side(place: &Place, file: &str, side: u32, more: &[&str]) {
    let side = side.to_string();
    let args = ["bake", CITY, "--light", SUN, "--kind", "vector", "--resolution", &side, "--policy", "closed"];
    place.fine(&[&args[..], more, &["-o", file]].concat());
}

fn open(place: &Place, file: &str) -> Container {
    Container::open(Arc::new(FileSource::open(&place.file(file)).unwrap()), Limits::default()).unwrap()
}

fn in_memory(file: &Container) -> Resident {
    Map::new(file.structure(0).unwrap()).unwrap().preload().unwrap()
}

/// What a command prints with `--json`, which ends with `code`.
fn json(place: &Place, args: &[&str], code: i32) -> Value {
    let out = place.run(args);
    assert_eq!(out.status.code(), Some(code), "{args:?}: {}", String::from_utf8_lossy(&out.stderr));
    serde_json::from_slice(&out.stdout).unwrap()
}

#[test]
fn every_texel_is_held_against_the_scene() {
    let place = Place::new("vector-verify");
    bake(&place, "city.umb", &[]);
    let found = json(&place, &["verify", "city.umb", "--source", CITY, "--json"], 0);
    assert_eq!(found["ok"], true, "{found}");
    assert_eq!(found["texels_checked"], u64::from(SIDE * SIDE));
    let stops = &found["stop_errors"];
    assert_eq!((&stops["violations"], &stops["passed_over"]), (&0.into(), &0.into()), "{found}");
    // On maps so small all is in one page, which nothing stands in for.
    let pages = open(&place, "city.umb").structure(0).unwrap().page_count();
    assert_eq!(stops["pairs"].as_u64() > Some(0), pages > 1, "{pages} pages: {found}");
    assert!(place.fine(&["dump", "city.umb"]).contains("vector"));
}

#[test]
fn query_answers_as_the_map_in_memory_and_within_intervals() {
    let place = Place::new("vector-query");
    bake(&place, "city.umb", &[]);
    let file = open(&place, "city.umb");
    assert_eq!(file.structure(0).unwrap().kind(), Kind::Vector);
    let map = in_memory(&file);
    let snapped = snap(&scene::generated(CITY).unwrap().unwrap(), file.structure(0).unwrap().lattice(), Policy::Closed);
    let snapped = snapped.unwrap();
    let oracle = Oracle::new(&snapped);
    let mut points = "x,y,level\n".to_string();
    for level in [0, 1, 2, 3, 5, 8, 9] {
        let side = SIDE >> level;
        let step = (side / 37).max(1) as usize;
        for (x, y) in (0..side).step_by(step).flat_map(|y| (0..side).step_by(step).map(move |x| (x, y))) {
            writeln!(points, "{x},{y},{level}").unwrap();
        }
    }
    place.write("points.csv", &points);
    let answers = place.fine(&["query", "city.umb", "--texels", "points.csv"]);
    let (mut seen, mut finest) = (0, 0);
    for (asked, answer) in points.lines().zip(answers.lines()).skip(1) {
        let fields: Vec<u32> = answer.split(',').take(4).map(|v| v.parse().unwrap()).collect();
        let [x, y, level, stored] = fields[..] else { panic!("{answer}") };
        assert_eq!(asked, format!("{x},{y},{level}"));
        assert_eq!(stored, map.value(x << level, y << level, level as u8), "{answer}");
        seen += 1;
        if level == 0 {
            let truth = oracle.texel(x, y).interval;
            assert!((truth.min..=truth.max).contains(&stored), "{answer}: {truth:?}");
            finest += 1;
        }
    }
    assert_eq!(seen, points.lines().count() - 1);
    assert!(finest > 1000, "{finest}");
}

#[test]
fn the_number_of_threads_changes_no_byte_of_a_vector_file() {
    let place = Place::new("vector-threads");
    for threads in ["1", "2"] {
        bake(&place, &format!("{threads}.umb"), &["--light", "low=dir:-0.9,-0.2,0.3", "--threads", threads]);
    }
    let [one, two] = ["1.umb", "2.umb"].map(|f| fs::read(place.file(f)).unwrap());
    assert!(one == two);
}

#[test]
fn lights_of_both_kinds_lie_in_one_file() {
    let place = Place::new("vector-merge");
    bake(&place, "vector.umb", &[]);
    place.fine(&["bake", CITY, "--light", "low=dir:-0.9,-0.2,0.3", "--resolution", "256", "-o", "mh.umb"]);
    place.fine(&["merge", "vector.umb", "mh.umb", "-o", "both.umb"]);
    let both = open(&place, "both.umb");
    let kinds = ["sun", "low"].map(|name| both.structure_named(name).unwrap().kind());
    assert_eq!(kinds, [Kind::Vector, Kind::Mh]);
    let found = json(&place, &["verify", "both.umb", "--source", CITY, "--json"], 0);
    assert_eq!(found["texels_checked"], u64::from(SIDE * SIDE + 256 * 256), "{found}");
    let alone = in_memory(&open(&place, "vector.umb"));
    let merged = Map::new(both.structure_named("sun").unwrap()).unwrap();
    for (x, y) in (0..SIDE).step_by(13).flat_map(|y| (0..SIDE).step_by(11).map(move |x| (x, y))) {
        assert_eq!(merged.texel(x, y, 0).unwrap().value, alone.value(x, y, 0));
    }
}

/// Edge texels of a record are an estimate; it must not tell of more thin texels than the source has.
#[test]
fn counts_of_thin_texels_are_held_against_the_source() {
    let place = Place::new("vector-edges");
    bake(&place, "city.umb", &[]);
    let exact = json(&place, &["verify", "city.umb", "--source", CITY, "--json"], 0)["lights"][0].clone();
    let (edge, thin) = (exact["edge"].as_u64().unwrap(), exact["thin"].as_u64().unwrap());
    assert!(edge > 1000, "{exact}");
    let file = open(&place, "city.umb");
    let s = file.structure(0).unwrap();
    let stored = |edge: u64, thin: u64| {
        let mut record = *s.record();
        (record.edge_texels, record.thin_texels) = (edge.into(), thin.into());
        let options = ContainerOptions::new(*file.file_id());
        let mut writer = ContainerWriter::create(&place.file("other.umb"), options, vec![record]).unwrap();
        for ordinal in 0..s.page_count() {
            let words = s.page_bytes(ordinal).unwrap().check_frame().unwrap().words().to_vec();
            writer
                .push(&PageInput { words, record: s.page_record(ordinal).unwrap(), dependencies: Vec::new() })
                .unwrap();
        }
        writer.finish().unwrap();
        let found = place.run(&["verify", "other.umb", "--source", CITY]);
        found.status.code()
    };
    for (edge, thin, code) in [(edge, 0, 0), (edge + edge / 2, thin, 0), (edge, thin + 1, 1)] {
        assert_eq!(stored(edge, thin), Some(code), "{edge} {thin}");
    }
}

#[test]
fn pictures_of_vector_maps_are_the_same_from_device_and_cpu() {
    let place = Place::new("vector-render");
    bake_side(&place, "city.umb", 4096, &[]);
    let pages = open(&place, "city.umb").structure(0).unwrap().page_count();
    assert!(pages > 4, "{pages}");
    let view = ["render", CITY, "city.umb", "--camera", "100,60,20,30,0,-30", "--size", "320x180"];
    let [device, auto, cpu] = ["gpu", "auto", "cpu"].map(|backend| {
        let picture = format!("{backend}.png");
        let found = json(&place, &[&view[..], &["--backend", backend, "-o", &picture, "--json"]].concat(), 0);
        (fs::read(place.file(&picture)).unwrap(), found["shadows"].clone())
    });
    assert_eq!(cpu.1["by"], "the CPU");
    assert!(cpu.1["stream"].is_null(), "{}", cpu.1);
    for (picture, by) in [device, auto] {
        assert!(by["stream"]["frames_until_exact"].as_u64() > Some(1), "{by}");
        assert!(picture == cpu.0, "{by}");
    }
}

#[test]
fn what_vector_does_not_do_is_refused() {
    let place = Place::new("vector-usage");
    let light = ["--light", "sun=dir:0.4,-0.8,0.3", "--kind", "vector", "-o", "no.umb"];
    for (scene, more, words) in [
        (CITY, &["--builder", "exhaustive"][..], "--builder exhaustive is for --kind mh"),
        (CITY, &["--values", "bottom-up"][..], "--values is for geometry and --kind mh or mmh"),
        ("layers.exr", &[], "--kind vector needs geometry"),
    ] {
        let out = place.run(&[&["bake", scene], &light[..], more].concat());
        let text = String::from_utf8_lossy(&out.stderr);
        assert_eq!(out.status.code(), Some(2), "{text}");
        assert!(text.contains(words), "{text}");
        assert!(!place.file("no.umb").exists());
    }
}

/// Blocks of thin foliage at many depths hold each texel's own.
#[test]
fn raws_are_right_where_few_entries_answer() {
    let place = Place::new("vector-raws");
    let forest = "forest:1:0.05";
    let args = ["bake", forest, "--light", SUN, "--kind", "vector", "--resolution", "1024", "-o", "forest.umb"];
    place.fine(&args);
    let file = open(&place, "forest.umb");
    let found = json(&place, &["dump", "forest.umb", "--json"], 0);
    let raws = found["lights"][0]["palette"]["raws"].as_u64().unwrap();
    assert!(raws > 500, "{found}");
    let found = json(&place, &["verify", "forest.umb", "--source", forest, "--json"], 0);
    assert_eq!((&found["ok"], &found["texels_checked"]), (&true.into(), &(1024u64 * 1024).into()), "{found}");
    let (paged, map) = (Map::new(file.structure(0).unwrap()).unwrap(), in_memory(&file));
    for (x, y) in (0..1024).step_by(3).flat_map(|y| (0..1024).step_by(3).map(move |x| (x, y))) {
        assert_eq!(paged.texel(x, y, 0).unwrap().value, map.value(x, y, 0), "{x}, {y}");
    }
    let view = ["render", forest, "forest.umb", "--camera", "40,25,30,0,0,0", "--size", "160x90", "--backend"];
    let [device, cpu] = ["gpu", "cpu"].map(|backend| {
        let picture = format!("{backend}.png");
        place.fine(&[&view[..], &[backend, "-o", &picture]].concat());
        fs::read(place.file(&picture)).unwrap()
    });
    assert!(device == cpu);
}

#[test]
fn kind_mmh_takes_top_down_values_unless_asked_otherwise() {
    let place = Place::new("mmh-values");
    let args = ["bake", CITY, "--light", SUN, "--kind", "mmh", "--resolution", "256"];
    for (file, more) in
        [("own", &[][..]), ("top-down", &["--values", "top-down"]), ("bottom-up", &["--values", "bottom-up"])]
    {
        place.fine(&[&args[..], more, &["-o", file]].concat());
    }
    let [own, down, up] = ["own", "top-down", "bottom-up"].map(|f| fs::read(place.file(f)).unwrap());
    assert!(own == down && own != up);
}
