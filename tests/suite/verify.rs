//! The certificate: it catches what it is for, and says so in words and in JSON. Beside it `dump`.

use std::fs;
use std::path::Path;
use std::sync::Arc;

use serde_json::Value;
use umbrage::certify::stop::Stops;
use umbrage::certify::{Oracle, Region};
use umbrage::format::{PageRecord, Rule};
use umbrage::reader::query::Map;
use umbrage::reader::{Container, FileSource, Limits};
use umbrage::writer::container::{ContainerOptions, ContainerWriter, PageInput};
use umbrage::writer::scene;
use umbrage::writer::solid::{Policy, snap};

use crate::cli::{CITY, Place, SCAN, SUN, text};

fn open(path: &Path) -> Container {
    Container::open(Arc::new(FileSource::open(path).unwrap()), Limits::default()).unwrap()
}

/// Writes a container again with one word changed; every checksum is good.
fn rewrite(from: &Path, to: &Path, page: u32, word: u32, value: u32) {
    rewrite_with(from, to, page, |words, _| words[word as usize] = value);
}

/// Writes a container again with one page changed; every checksum is good.
fn rewrite_with(from: &Path, to: &Path, page: u32, change: impl Fn(&mut [u32], &mut PageRecord)) {
    let container = open(from);
    let s = container.structure(0).unwrap();
    let mut writer =
        ContainerWriter::create(to, ContainerOptions::new(*container.file_id()), vec![*s.record()]).unwrap();
    for ordinal in 0..s.page_count() {
        let mut words = s.page_bytes(ordinal).unwrap().check_frame().unwrap().words().to_vec();
        let mut record = s.page_record(ordinal).unwrap();
        if ordinal == page {
            change(&mut words, &mut record);
        }
        writer.push(&PageInput { words, record, dependencies: Vec::new() }).unwrap();
    }
    writer.finish().unwrap();
}

fn json(place: &Place, args: &[&str], code: i32) -> Value {
    let out = place.run(args);
    let (stdout, stderr) = text(&out);
    assert_eq!(out.status.code(), Some(code), "{args:?}: {stdout}{stderr}");
    serde_json::from_str(&stdout).unwrap()
}

/// Mutation: one leaf is stored one step beyond its interval, as if the baker had widened it.
#[test]
fn a_widened_interval_is_caught() {
    let place = Place::new("widened");
    place.fine(&["bake", CITY, "--light", SUN, "--resolution", "256", "--policy", "closed", "-o", "city.umb"]);
    let path = place.0.join("city.umb");
    let map = Map::new(open(&path).structure(0).unwrap()).unwrap();
    let mesh = scene::generated(CITY).unwrap().unwrap();
    let snapped = snap(&mesh, map.lattice(), Policy::Closed).unwrap();
    let oracle = Oracle::new(&snapped);
    let good = json(&place, &["verify", "city.umb", "--source", CITY, "--json"], 0);
    assert_eq!((&good["ok"], &good["violations"]), (&Value::Bool(true), &0.into()));
    assert_eq!(good["texels_checked"], 65536);
    // leaves of single texels, certified or not, moved up or down within the page's own bounds
    let mut tried = [[0; 2]; 2];
    for (x, y) in (0..256u32).flat_map(|y| (0..256).map(move |x| (x, y))) {
        let a = map.texel(x, y, 0).unwrap();
        let truth = oracle.texel(x, y);
        let record = map.structure().page_record(a.page).unwrap();
        for (up, value) in [(0, truth.interval.min.wrapping_sub(1)), (1, truth.interval.max.wrapping_add(1))] {
            let kind = &mut tried[usize::from(truth.certified)][up];
            let fits = (record.min_depth.get()..=record.max_depth.get()).contains(&value);
            if a.level > 0 || !fits || *kind >= 2 || (x * 7 + y) % 5 != 0 {
                continue;
            }
            rewrite(&path, &place.0.join("bad.umb"), a.page, a.word, value);
            place.fine(&["verify", "bad.umb"]);
            let found = json(&place, &["verify", "bad.umb", "--source", CITY, "--json"], 1);
            assert_eq!((&found["ok"], &found["violations"]), (&Value::Bool(false), &1.into()), "{x} {y}: {found}");
            let example = &found["lights"][0]["examples"][0];
            assert_eq!([&example["x"], &example["y"], &example["stored"]], [x, y, value], "{found}");
            assert_eq!(example["certified"], truth.certified);
            *kind += 1;
        }
    }
    assert!(tried.iter().flatten().all(|n| *n > 0), "edge and certified texels, down and up: {tried:?}");
}

/// Mutation: the record of a page promises a smaller error without the page than there is.
#[test]
fn a_lowered_stop_error_is_caught() {
    let place = Place::new("stop");
    place.fine(&["bake", CITY, "--light", SUN, "--resolution", "512", "--policy", "closed", "-o", "city.umb"]);
    let path = place.0.join("city.umb");
    let good = json(&place, &["verify", "city.umb", "--source", CITY, "--json"], 0);
    let stops = &good["stop_errors"];
    assert_eq!((&stops["violations"], &stops["passed_over"]), (&0.into(), &0.into()), "{good}");
    assert!(stops["pairs"].as_u64() > Some(10_000) && stops["held_exactly"].as_u64() > Some(0), "{good}");
    let map = Map::new(open(&path).structure(0).unwrap()).unwrap();
    let s = map.structure();
    let mesh = scene::generated(CITY).unwrap().unwrap();
    let snapped = snap(&mesh, map.lattice(), Policy::Closed).unwrap();
    let oracle = Oracle::new(&snapped);
    let stops = Stops::new(s, &|| true).unwrap();
    // The least that a record may promise; a writer may promise more.
    let least = |page: u32| {
        let stop = *stops.over(Region { x: 0, y: 0, width: 512, height: 512 }).into_iter().find(|s| s.page == page)?;
        let [x, y] = stop.origin;
        let texels = (0..stop.side).flat_map(|j| (0..stop.side).map(move |i| (x + i, y + j)));
        let distance = |(x, y)| {
            let truth = oracle.texel(x, y).interval;
            let answer = stops.answer(&stop, [x, y]);
            truth.min.saturating_sub(answer).max(answer.saturating_sub(truth.max))
        };
        texels.map(distance).max().filter(|d| *d > 0).map(|d| (page, d))
    };
    let found: Vec<(u32, u32)> = (1..s.page_count()).step_by(37).filter_map(least).take(2).collect();
    assert_eq!(found.len(), 2);
    let (page, error) = found[0];
    rewrite_with(&path, &place.0.join("least.umb"), page, |_, record| record.stop_error = error.into());
    place.fine(&["verify", "least.umb", "--source", CITY]);
    for (page, error) in found {
        rewrite_with(&path, &place.0.join("bad.umb"), page, |_, record| record.stop_error = (error - 1).into());
        place.fine(&["verify", "bad.umb"]);
        let found = json(&place, &["verify", "bad.umb", "--source", CITY, "--json"], 1);
        assert_eq!((&found["ok"], &found["violations"]), (&Value::Bool(false), &0.into()), "{page}: {found}");
        assert!(found["stop_errors"]["violations"].as_u64() > Some(0), "{page}: {found}");
        let example = &found["lights"][0]["stop_examples"][0];
        assert_eq!([&example["page"], &example["stop_error"]], [page, error - 1], "{found}");
        let [answer, min, max] = ["answer", "min", "max"].map(|k| example[k].as_i64().unwrap());
        assert_eq!((min - answer).max(answer - max), i64::from(error), "{found}");
        let said = text(&place.run(&["verify", "bad.umb", "--source", CITY])).0;
        assert!(said.contains(&format!("page {page}: texel ")), "{said}");
    }
}

/// What is known is told in JSON also where the command ends with an error.
#[test]
fn json_comes_with_late_errors() {
    let place = Place::new("late");
    place.fine(&["bake", CITY, "--light", SUN, "--resolution", "256", "--policy", "closed", "-o", "city.umb"]);
    for (args, code) in [(["--source", "none.obj"], 3), (["--source", "none.exr"], 3), (["--light", "moon"], 2)] {
        let args = [&["verify", "city.umb", "--json"], args.as_slice()].concat();
        let found = json(&place, &args, code);
        assert_eq!((&found["ok"], &found["error"]["exit_code"]), (&Value::Bool(false), &code.into()), "{found}");
        assert!(found["error"]["message"].as_str().is_some_and(|m| !m.is_empty()), "{found}");
        assert!(found["counts"]["pages"].as_u64() > Some(0), "{found}");
    }
    let fine = json(&place, &["verify", "city.umb", "--json"], 0);
    assert_eq!(fine["error"], Value::Null);
    place.write("cut.umb", [0; 64]);
    let found = json(&place, &["verify", "cut.umb", "--json"], 4);
    assert_eq!(found["error"]["exit_code"], 4);
}

#[test]
fn dump_sums_up_and_draws() {
    let place = Place::new("dump");
    place.fine(&["bake", CITY, "--light", SUN, "--resolution", "1024", "--policy", "closed", "-o", "city.umb"]);
    let found = json(&place, &["dump", "city.umb", "--json"], 0);
    let light = &found["lights"][0];
    let sum = |v: &Value| {
        v.as_object().unwrap().iter().filter(|e| e.0 != "total").map(|e| e.1.as_u64().unwrap()).sum::<u64>()
    };
    assert_eq!(light["bytes"]["total"], sum(&light["bytes"]));
    let (bytes, total) = (found["bytes"].as_u64().unwrap(), light["bytes"]["total"].as_u64().unwrap());
    // the rest is header, tables, and what aligns the sections
    assert!(bytes > total && bytes < total + 1024, "{bytes} {total}");
    let pages: u64 = light["pages_by_level"].as_array().unwrap().iter().map(|p| p["pages"].as_u64().unwrap()).sum();
    assert_eq!(light["pages"], pages);
    let said = place.fine(&["dump", "city.umb"]);
    assert!(
        said.contains("1024 x 1024 texels") && said.contains("policy      closed") && said.lines().count() < 20,
        "{said}"
    );
    // three different pictures of 256 x 256
    let draw = |what| {
        place.fine(&["dump", "city.umb", "--image", "out.png", "--draw", what, "--level", "2"]);
        let decoder = png::Decoder::new(std::io::BufReader::new(fs::File::open(place.0.join("out.png")).unwrap()));
        let mut reader = decoder.read_info().unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        let frame = reader.next_frame(&mut pixels).unwrap();
        assert_eq!((frame.width, frame.height), (256, 256));
        let colours: std::collections::HashSet<_> = pixels.chunks(3).map(<[u8]>::to_vec).collect();
        assert!(colours.len() > 10, "{what}: {} colours", colours.len());
        pixels
    };
    let [depth, nodes, pages] = ["depth", "nodes", "pages"].map(draw);
    assert!(depth != nodes && nodes != pages && pages != depth);
}

#[test]
fn a_sample_looks_at_borders_too() {
    let place = Place::new("sample");
    place.fine(&["bake", CITY, "--light", SUN, "--resolution", "1024", "--policy", "closed", "-o", "city.umb"]);
    let found = json(&place, &["verify", "city.umb", "--source", CITY, "--sample", "50000", "--json"], 0);
    let number = |key: &str| found[key].as_u64().unwrap();
    assert!(number("texels_checked") >= 50000 && number("texels_near_borders") >= 25000, "{found}");
    assert!(number("texels_near_borders") * 2 <= number("texels_checked") + 8192, "{found}");
}

#[test]
fn faults_are_told_with_rule_place_and_values() {
    let place = Place::new("faults");
    place.fine(&["bake", SCAN, "--light", SUN, "--resolution", "2048", "-o", "scan.umb"]);
    let whole = fs::read(place.0.join("scan.umb")).unwrap();
    let ids: Vec<&str> = Rule::ALL.iter().map(|r| r.id()).collect();
    let fault = |found: &Value| {
        let e = &found["errors"][0];
        assert_eq!((&found["ok"], &found["violations"]), (&Value::Bool(false), &0.into()), "{found}");
        assert!(ids.contains(&e["rule"].as_str().unwrap()), "{found}");
        assert!(["section", "expected", "found", "message"].iter().all(|k| e[k].is_string()), "{found}");
        (e["rule"].as_str().unwrap().to_string(), e["offset"].as_u64().unwrap())
    };
    // all pages damaged: all counted, some told
    let file = open(&place.0.join("scan.umb"));
    let s = file.structure(0).unwrap();
    assert!(s.page_count() > 2);
    let mut bytes = whole.clone();
    for p in 0..s.page_count() {
        bytes[s.page_record(p).unwrap().offset.get() as usize + 9] ^= 4;
    }
    place.write("bad.umb", &bytes);
    let found = json(&place, &["verify", "bad.umb", "--json"], 1);
    assert_eq!(fault(&found), ("page.crc".to_string(), s.page_record(0).unwrap().offset.get()));
    assert_eq!(found["counts"]["errors"], s.page_count());
    assert_eq!(found["counts"]["pages"], s.page_count());
    assert_eq!(found["errors"].as_array().unwrap().len(), s.page_count().min(100) as usize);
    // a file that can't even be opened
    place.write("cut.umb", &whole[..whole.len() - 1]);
    let found = json(&place, &["verify", "cut.umb", "--json"], 4);
    assert_eq!(fault(&found).0, "header.length");
    let found = json(&place, &["verify", "scan.umb", "--source", SCAN, "--json"], 0);
    assert_eq!((&found["errors"], &found["counts"]["errors"]), (&Value::Array(Vec::new()), &0.into()));
}
