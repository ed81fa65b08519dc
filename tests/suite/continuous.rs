//! Continuous lookups from the command line: what is proven is held against the scene, faults are found, and the two
//! readers agree.

use std::fmt::Write as _;
use std::sync::Arc;

use serde_json::Value;
use umbrage::format::kind::vector::Layout;
use umbrage::reader::query::{Map, PageView, vector};
use umbrage::reader::{Container, FileSource, Limits, ReaderError};
use umbrage::writer::container::{ContainerOptions, ContainerWriter, PageInput};

use crate::cli::{CITY, Place, SUN};
use crate::python::python;

fn bake(place: &Place, kind: &str) -> Container {
    let args = ["bake", CITY, "--light", SUN, "--kind", kind, "--resolution", "512", "--policy", "closed"];
    place.fine(&[&args[..], &["-o", "city.umb"]].concat());
    Container::open(Arc::new(FileSource::open(&place.file("city.umb")).unwrap()), Limits::default()).unwrap()
}

/// What `verify --source` says of a file, ending with `code`.
fn verified(place: &Place, file: &str, code: i32) -> Value {
    let out = place.run(&["verify", file, "--source", CITY, "--json"]);
    assert_eq!(out.status.code(), Some(code), "{}", String::from_utf8_lossy(&out.stderr));
    serde_json::from_slice(&out.stdout).unwrap()
}

/// Writes the file anew with changed pages.
fn changed(place: &Place, file: &Container, change: impl Fn(&mut Vec<u32>)) {
    let s = file.structure(0).unwrap();
    let options = ContainerOptions::new(*file.file_id());
    let mut writer = ContainerWriter::create(&place.file("changed.umb"), options, vec![*s.record()]).unwrap();
    for ordinal in 0..s.page_count() {
        let mut words = s.page_bytes(ordinal).unwrap().check_frame().unwrap().words().to_vec();
        change(&mut words);
        writer.push(&PageInput { words, record: s.page_record(ordinal).unwrap(), dependencies: Vec::new() }).unwrap();
    }
    writer.finish().unwrap();
}

#[test]
fn proven_places_are_held_against_the_scene() {
    let place = Place::new("continuous");
    bake(&place, "vector");
    let found = verified(&place, "city.umb", 0);
    let spots = &found["lights"][0]["continuous"];
    assert_eq!((&spots["places"], &spots["violations"]), (&(512 * 512).into(), &0.into()), "{found}");
    let share = spots["proven_share"].as_f64().unwrap();
    assert!(spots["proven"].as_u64() > Some(100_000) && (0.5..1.0).contains(&share), "{spots}");
    assert!(place.fine(&["verify", "city.umb", "--source", CITY]).contains("proven between texel centres"));
    let sampled = place.fine(&["verify", "city.umb", "--source", CITY, "--sample", "5000", "--json"]);
    let sampled: Value = serde_json::from_str(&sampled).unwrap();
    assert_eq!(sampled["continuous"]["places"], 5000);
    bake(&place, "mh");
    assert_eq!(verified(&place, "city.umb", 0)["lights"][0]["continuous"], Value::Null);
}

#[test]
fn a_proof_too_many_and_a_line_beside_its_edge_are_found() {
    let place = Place::new("continuous-faults");
    let file = bake(&place, "vector");
    // every entry is called proven
    changed(&place, &file, |words| {
        let (layout, entries) = (Layout::of(words), words[2] >> 16);
        // pages without a proof have no such section
        for i in (0..entries).filter(|_| layout.proofs) {
            words[usize::from(layout.proofs_at) + i as usize / 32] |= 1 << (i % 32);
        }
    });
    let found = verified(&place, "changed.umb", 1);
    assert_eq!((&found["violations"], &found["ok"]), (&0.into(), &false.into()), "{found}");
    assert!(found["continuous"]["violations"].as_u64() > Some(20), "{found}");
    // every line moves by 1/64 texel
    changed(&place, &file, |words| {
        let lines = words[3] >> 16;
        for i in 0..lines as usize {
            let layout = Layout::of(words);
            assert!(layout.short_lines);
            let at = usize::from(layout.lines_at) + 2 * i + 1;
            words[at] = words[at].wrapping_add(1 << 14);
        }
    });
    let found = verified(&place, "changed.umb", 1);
    assert!(found["continuous"]["violations"].as_u64() > Some(20), "{found}");
    assert!(!found["lights"][0]["continuous"]["examples"].as_array().unwrap().is_empty());
}

#[test]
fn both_readers_answer_alike_between_centres() {
    let place = Place::new("continuous-python");
    let file = bake(&place, "vector");
    let map = Map::new(file.structure(0).unwrap()).unwrap();
    let (mut rows, mut expected, mut proofs) = (String::new(), "x,y,fx,fy,value,proven\n".to_string(), [0; 2]);
    for i in 0..4000u32 {
        let [x, y] = [i * 131 % 512, i * 197 % 509];
        let sub = [i * 89 % 256, i * 31 % 256].map(|v| v as u8);
        let answer = map.continuous(x, y, sub).unwrap();
        let page = map.page(answer.page).unwrap();
        let view = PageView {
            words: page.words(),
            first_child: page.record().first_child.get(),
            dependencies: page.dependencies(),
        };
        let proven = vector::is_proven(view, answer.word);
        proofs[usize::from(proven)] += 1;
        writeln!(rows, "{x},{y},{},{}", sub[0], sub[1]).unwrap();
        writeln!(expected, "{x},{y},{},{},{},{}", sub[0], sub[1], answer.value, u8::from(proven)).unwrap();
    }
    assert!(proofs.iter().all(|n| *n > 50), "{proofs:?}");
    let path = place.file("city.umb");
    let args = ["places", path.to_str().unwrap(), "--structure", "sun"];
    let (code, stdout, stderr) = python(&args, &rows);
    assert_eq!((code, stderr.as_str()), (Some(0), ""));
    assert!(stdout == expected);
    let outside = python(&args, "1,2,3,256\n");
    assert_eq!(outside.0, Some(3), "{}", outside.2);
    assert!(matches!(map.continuous(512, 0, [0; 2]), Err(ReaderError::OutOfRange { .. })));
}

#[test]
fn pictures_may_ask_between_centres() {
    let place = Place::new("continuous-render");
    bake(&place, "vector");
    let args = ["render", CITY, "city.umb", "--camera", "60,40,60,0,0,0", "--size", "320x180"];
    place.fine(&[&args[..], &["-o", "near.png"]].concat());
    let text = place.fine(&[&args[..], &["--continuous", "-o", "sharp.png"]].concat());
    assert!(text.contains("between texel centres"), "{text}");
    let [near, sharp] = ["near.png", "sharp.png"].map(|f| std::fs::read(place.file(f)).unwrap());
    assert!(near != sharp);
    place.refused(2, &[&args[..], &["--continuous", "--backend", "gpu", "-o", "no.png"]].concat());
}
