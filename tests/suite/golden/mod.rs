//! Golden files: small containers that the writer makes from trees given here, kept with their answers in
//! `tests/golden`; its README explains each.
//!
//! A test makes them again and compares the bytes. With `UMBRAGE_BLESS=1` it writes them instead.

pub mod samples;
mod trees;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use umbrage::reader::query::Map;
use umbrage::reader::{Container, Limits, MemorySource};

pub use trees::{all, named};

/// Whether generated files are to be written instead of compared.
pub fn bless() -> bool {
    std::env::var_os("UMBRAGE_BLESS").is_some_and(|v| v == "1")
}

/// A path below the root of the workspace.
pub fn workspace(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(path)
}

/// Holds a kept file against what it should be, or writes it.
pub fn hold(path: &Path, expected: &[u8]) {
    if bless() {
        std::fs::write(path, expected).unwrap();
        return;
    }
    let found = std::fs::read(path).unwrap_or_default();
    assert!(found == expected, "{} is not what the code makes; UMBRAGE_BLESS=1 writes it anew", path.display());
}

/// Opens bytes in memory.
pub fn open(bytes: Vec<u8>, limits: Limits) -> Result<Container, umbrage::reader::ReaderError> {
    Container::open(Arc::new(MemorySource::new(bytes, "test.umb")), limits)
}

/// Rows of every texel of every level of one root.
pub fn points(log2: u8) -> impl Iterator<Item = (u32, u32, u8)> {
    (0..=log2).flat_map(move |level| {
        let side = 1u32 << (log2 - level);
        (0..side).flat_map(move |y| (0..side).map(move |x| (x, y, level)))
    })
}

/// The answers of the Rust reader as `spec/reader.py texels` prints them.
pub fn answers(map: &Map, root: u32, points: impl Iterator<Item = (u32, u32, u8)>) -> String {
    let mut out = String::from("x,y,level,value,node_level,page,word\n");
    for (x, y, level) in points {
        let a = map.texel_of(root, x << level, y << level, level).unwrap();
        out += &format!("{x},{y},{level},{},{},{},{}\n", a.value, a.level, a.page, a.word);
    }
    out
}

/// Name of the answers of one root beside a golden file.
pub fn answers_name(file: &str, structure: u32, root: u32, roots: u32) -> String {
    if roots == 1 { format!("{file}.{structure}.csv") } else { format!("{file}.{structure}.{root}.csv") }
}

#[test]
fn golden_files_are_what_the_writer_makes() {
    let readme = std::fs::read_to_string(workspace("tests/golden/README.md")).unwrap();
    let mut names = vec!["README.md".to_string()];
    for golden in all() {
        let name = golden.name;
        let keep = |file: String, bytes: &[u8], names: &mut Vec<String>| {
            hold(&workspace("tests/golden").join(&file), bytes);
            names.push(file);
        };
        assert!(readme.contains(&format!("## {name}.umb")), "tests/golden/README.md does not explain {name}.umb");
        keep(format!("{name}.umb"), &golden.bytes, &mut names);
        let container = open(golden.bytes.clone(), Limits::default()).unwrap();
        assert_eq!(container.verify(|e| panic!("{name}: {e}")).faults, 0);
        for s in container.structures().filter(|s| s.kind().has_layout()) {
            let (number, roots, log2) = (s.number(), s.record().root_count.get(), s.record().log2_resolution);
            let structure = s.name().to_string();
            let map = Map::new(s).unwrap();
            for root in 0..roots {
                let tree = &golden.trees[number as usize][root as usize];
                for (x, y, level) in points(log2) {
                    let (x, y) = (x << level, y << level);
                    let found = map.texel_of(root, x, y, level).unwrap().value;
                    assert_eq!(found, tree.lookup(log2, x, y, level), "{name} {structure} {root}: {x} {y} {level}");
                }
                let csv = answers(&map, root, points(log2));
                keep(answers_name(name, number, root, roots), csv.as_bytes(), &mut names);
            }
        }
    }
    let mut found: Vec<String> = std::fs::read_dir(workspace("tests/golden"))
        .unwrap()
        .map(|e| e.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    found.sort();
    assert_eq!(found, names, "tests/golden holds a file that nothing makes");
}
