//! The independent reader `spec/reader.py` against the Rust reader: the same answers on every golden file and on a
//! baked one, the same rule first on every broken one.

mod filter;

use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use umbrage::format::index::FORM_FLAT;
use umbrage::format::page::{FrameHead, TAG_FLAT};
use umbrage::format::{Kind, PageRecord, Rule};
use umbrage::reader::query::Map;
use umbrage::reader::{Container, Limits};
use umbrage::writer::bake::{BakeOptions, Light, bake};
use umbrage::writer::container::{ContainerOptions, PageInput};
use umbrage::writer::scene;
use umbrage::writer::solid::Policy;

use crate::golden::samples::{self, At, Seal, position, repair, with_section};
use crate::golden::{self, answers, open, workspace};
use crate::tree::{Dice, Folder, ID, structure, write};

/// Runs `spec/reader.py`; its exit code and what it printed.
pub fn python(args: &[&str], input: &str) -> (Option<i32>, String, String) {
    run("spec/reader.py", args, input)
}

/// Runs a program of `spec`.
fn run(program: &str, args: &[&str], input: &str) -> (Option<i32>, String, String) {
    let mut child = Command::new("python3")
        .arg(workspace(program))
        .args(args)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap_or_else(|e| panic!("python3 (3.11 or later) is needed to test {program}: {e}"));
    let mut stdin = child.stdin.take().unwrap();
    let input = input.to_string();
    // A thread of its own: the answers may fill the pipe before all points are written.
    let writer = std::thread::spawn(move || stdin.write_all(input.as_bytes()).is_ok());
    let out = child.wait_with_output().unwrap();
    let _ = writer.join();
    let text = |b: Vec<u8>| String::from_utf8(b).unwrap();
    (out.status.code(), text(out.stdout), text(out.stderr))
}

/// Rules that `spec/reader.py check` finds in each file, in the order found.
fn python_rules(files: &[PathBuf], limit: Option<(&str, u64)>) -> Vec<Vec<String>> {
    let limit = limit.map(|(name, n)| format!("--limit={name}={n}"));
    let mut args = vec!["check"];
    args.extend(limit.as_deref());
    args.extend(files.iter().map(|f| f.to_str().unwrap()));
    let (code, stdout, stderr) = python(&args, "");
    assert!(matches!(code, Some(0 | 1)) && stderr.is_empty(), "{code:?}: {stderr}");
    let rules = |line: &str| {
        let report: serde_json::Value = serde_json::from_str(line).unwrap();
        let rules: Vec<String> = serde_json::from_value(report["rules"].clone()).unwrap();
        assert_eq!(report["ok"], rules.is_empty());
        rules
    };
    let found: Vec<_> = stdout.lines().map(rules).collect();
    assert_eq!(found.len(), files.len());
    found
}

/// Rules that the Rust reader finds, in the order found.
fn rust_rules(bytes: Vec<u8>, limits: Limits) -> Vec<String> {
    let id = |rule: Option<Rule>| rule.map(|r| r.id().to_string()).unwrap();
    match open(bytes, limits) {
        Err(e) => vec![id(e.rule())],
        Ok(file) => {
            let mut found = Vec::new();
            file.verify(|e| found.push(id(e.rule())));
            found
        }
    }
}

/// Holds the answers of all texels of all levels of every structure that has some against each other.
fn same_answers(path: &Path, container: &Container) {
    for s in container.structures().filter(|s| s.kind().has_layout()) {
        let (roots, log2) = (s.record().root_count.get(), s.record().log2_resolution);
        let map = Map::new(s).unwrap();
        let points: Vec<_> = golden::points(log2).collect();
        for root in 0..roots {
            same_points(path, &map, root, &points);
        }
    }
}

/// Holds the answers at some texels against each other.
fn same_points(path: &Path, map: &Map, root: u32, points: &[(u32, u32, u8)]) {
    let rows: String = points.iter().map(|(x, y, level)| format!("{x},{y},{level}\n")).collect();
    let name = map.structure().name();
    let args = ["texels", path.to_str().unwrap(), "--structure", name, "--root", &root.to_string()];
    let (code, stdout, stderr) = python(&args, &rows);
    assert_eq!((code, stderr.as_str()), (Some(0), ""), "{args:?}");
    assert!(stdout == answers(map, root, points.iter().copied()), "{args:?}: answers differ");
}

#[test]
fn golden_files_answer_alike() {
    let mut files = Vec::new();
    for g in golden::all() {
        let path = workspace("tests/golden").join(format!("{}.umb", g.name));
        same_answers(&path, &open(g.bytes.clone(), Limits::default()).unwrap());
        files.push(path);
    }
    assert!(python_rules(&files, None).iter().all(Vec::is_empty));
    for file in &files {
        let (code, stdout, stderr) = python(&["dump", file.to_str().unwrap()], "");
        assert_eq!((code, stderr.as_str()), (Some(0), ""), "{}", file.display());
        assert!(stdout.starts_with("version 1.0, "), "{stdout}");
    }
}

#[test]
fn a_baked_file_answers_alike() {
    let folder = Folder::new("python-baked");
    let path = folder.0.join("city.umb");
    let options = BakeOptions {
        lights: vec![Light { name: "sun".to_string(), direction: [0.4, -0.8, 0.3] }],
        resolution: 1024,
        policy: Policy::Closed,
        kind: umbrage::format::Kind::Mh,
        exhaustive: false,
        top_down: false,
        mmh: Default::default(),
        memory_bytes: None,
        cold: false,
    };
    bake(&scene::generated("city:1:0.05").unwrap().unwrap(), &options, &path, &Default::default()).unwrap();
    let container = open(fs::read(&path).unwrap(), Limits::default()).unwrap();
    let map = Map::new(container.structure(0).unwrap()).unwrap();
    assert!(map.structure().block_count() > 1, "{} pages", map.structure().page_count());
    let mut dice = Dice(8);
    let points: Vec<(u32, u32, u8)> = (0..20_000)
        .map(|_| {
            let level = dice.roll(4) as u8;
            (dice.roll(1024 >> level), dice.roll(1024 >> level), level)
        })
        .collect();
    same_points(&path, &map, 0, &points);
    assert_eq!(python_rules(&[path], None), [Vec::<String>::new()]);
}

/// XXH3 goes another way for each range of lengths: pages of every length up to 1200 words, and of the most.
#[test]
fn content_hashes_of_all_lengths_agree() {
    let lengths: Vec<u16> = (2..1200).chain([4096, 16383, 16384]).collect();
    let mut dice = Dice(4);
    let pages: Vec<PageInput> = lengths
        .iter()
        .enumerate()
        .map(|(i, &words)| {
            let child_refs = if i == 0 { lengths.len() as u16 - 1 } else { 0 };
            let head = FrameHead { tag: TAG_FLAT, root_mask: 0, child_refs, words, root_level: 0 };
            let mut record = PageRecord::zeroed();
            record.page_type = FORM_FLAT;
            let body = (2..words).map(|_| dice.roll(u32::MAX));
            PageInput { words: head.encode().into_iter().chain(body).collect(), record, dependencies: Vec::new() }
        })
        .collect();
    let folder = Folder::new("python-lengths");
    let path = folder.0.join("lengths.umb");
    let record = structure("list", Kind::Quads, 0, pages.len());
    let bytes = write("python-lengths-made", ContainerOptions::new(ID), &[(record, pages)]);
    fs::write(&path, &bytes).unwrap();
    assert_eq!(rust_rules(bytes, Limits::default()), Vec::<String>::new());
    assert_eq!(python_rules(&[path], None), [Vec::<String>::new()]);
}

#[test]
fn a_sample_of_every_rule_is_refused_by_that_rule() {
    let samples = samples::all();
    let folder = Folder::new("python-samples");
    let path = |i: usize| folder.0.join(format!("{i}.umb"));
    for (i, s) in samples.iter().enumerate() {
        fs::write(path(i), &s.bytes).unwrap();
        if s.rule != "limit.page-bytes" {
            assert_eq!(rust_rules(s.bytes.clone(), s.limits()), [s.rule], "{i}: {}", s.at);
        }
    }
    let plain: Vec<usize> = (0..samples.len()).filter(|&i| samples[i].limit.is_none()).collect();
    let files: Vec<PathBuf> = plain.iter().map(|&i| path(i)).collect();
    for (&i, rules) in plain.iter().zip(python_rules(&files, None)) {
        assert_eq!(rules, [samples[i].rule], "{i}: {}", samples[i].at);
    }
    for (i, s) in samples.iter().enumerate().filter(|(_, s)| s.limit.is_some()) {
        let found = python_rules(&[path(i)], s.limit);
        assert_eq!(found[0], rust_rules(s.bytes.clone(), s.limits()), "{}", s.rule);
        assert_eq!(found[0][0], s.rule);
    }
}

#[test]
fn every_rule_has_a_sample() {
    let samples = samples::all();
    for rule in Rule::ALL {
        assert!(samples.iter().any(|s| s.rule == rule.id()), "{}", rule.id());
    }
    for s in samples {
        assert!(Rule::ALL.iter().any(|r| r.id() == s.rule), "{}", s.rule);
    }
}

#[test]
fn an_unknown_optional_section_is_skipped() {
    let folder = Folder::new("python-section");
    let path = folder.0.join("section.umb");
    fs::write(&path, with_section(&golden::named("example").bytes, 0, b"later")).unwrap();
    assert_eq!(rust_rules(fs::read(&path).unwrap(), Limits::default()), Vec::<String>::new());
    assert_eq!(python_rules(&[path], None), [Vec::<String>::new()]);
}

/// Random changes of golden files, most with their checksums made good again: both readers find the same rules in the
/// same order, and give the same answers where they find none.
#[test]
fn random_changes_are_judged_alike() {
    let folder = Folder::new("python-random");
    let mut dice = Dice(20);
    let bases = ["example", "pages", "two", "roots", "later", "vector", "vector", "vector-two", "cold", "cold"]
        .map(|n| &golden::named(n).bytes);
    let (mut files, mut expected) = (Vec::new(), Vec::new());
    let mut accepted = 0;
    for i in 0..2500 {
        let base = bases[dice.roll(bases.len() as u32) as usize];
        let mut bytes = base.clone();
        for _ in 0..=dice.roll(2) {
            let at = place(base, &mut dice);
            match dice.roll(4) {
                0 => bytes[at] ^= 1 << dice.roll(8),
                1 => bytes[at] = dice.roll(256) as u8,
                2 => bytes[at] = bytes[at].wrapping_add(1),
                _ => bytes[at] = dice.roll(4) as u8,
            }
        }
        let seal = [Seal::Nothing, Seal::Head, Seal::Records, Seal::Index, Seal::All, Seal::All, Seal::All, Seal::All];
        repair(&mut bytes, seal[dice.roll(8) as usize]);
        let rules = rust_rules(bytes.clone(), Limits::default());
        let path = folder.0.join(format!("{i}.umb"));
        fs::write(&path, &bytes).unwrap();
        if rules.is_empty() && bytes != *base && accepted < 20 {
            accepted += 1;
            same_answers(&path, &open(bytes, Limits::default()).unwrap());
        }
        files.push(path);
        expected.push(rules);
    }
    for ((path, expected), found) in files.iter().zip(expected).zip(python_rules(&files, None)) {
        if found != expected {
            let kept = std::env::temp_dir().join("umbrage-python-differs.umb");
            fs::copy(path, &kept).unwrap();
            panic!("{}: rust {expected:?}, python {found:?}", kept.display());
        }
    }
    assert_eq!(accepted, 20);
}

/// A byte where something stands: fields and words rather than the unused part of index blocks.
fn place(file: &[u8], dice: &mut Dice) -> usize {
    let mut below = |n: usize| dice.roll(n as u32) as usize;
    match below(14) {
        0 => below(68),
        1 => 128 + below(120),
        2 => position(file, At::Structure(0, "name")) + below(512),
        3 => position(file, At::Block(0, "crc32")) + below(20),
        4..8 => position(file, At::Record(0, 0, "offset")) + below(64 * 3),
        _ => {
            let start = position(file, At::Page(0, 0, 0));
            start + below(file.len() - start)
        }
    }
}

/// Random bytes behind the magic ones, and files that were cut.
#[test]
fn what_is_no_container_is_refused() {
    let folder = Folder::new("python-garbage");
    let mut dice = Dice(5);
    let garbage = [0usize, 1, 7, 8, 127, 128, 4096, 100_000].map(|n| {
        let mut bytes: Vec<u8> = (0..n).map(|_| dice.roll(256) as u8).collect();
        let magic = &umbrage::format::header::MAGIC[..n.min(8)];
        bytes[..magic.len()].copy_from_slice(magic);
        bytes
    });
    let whole = &golden::named("example").bytes;
    let cut = (0..whole.len()).step_by(61).map(|n| whole[..n].to_vec());
    let mut files = Vec::new();
    for (i, bytes) in garbage.into_iter().chain(cut).enumerate() {
        let path = folder.0.join(format!("{i}.umb"));
        fs::write(&path, &bytes).unwrap();
        files.push((path, rust_rules(bytes, Limits::default())));
    }
    let paths: Vec<PathBuf> = files.iter().map(|f| f.0.clone()).collect();
    let expected: Vec<_> = files.into_iter().map(|f| f.1).collect();
    assert_eq!(python_rules(&paths, None), expected);
    for path in &paths[..8] {
        let (code, stdout, stderr) = python(&["dump", path.to_str().unwrap()], "");
        assert_eq!((code, stdout.as_str(), stderr.lines().count()), (Some(4), "", 1), "{stderr}");
    }
}
