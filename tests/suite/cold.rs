//! Cold pages: the words of a bake with `--cold` are those of one without, whatever reads them; any page comes back from
//! its cold form; bytes that are none give an error.

use std::path::Path;
use std::sync::Arc;

use umbrage::format::cold::{Model, decode};
use umbrage::format::{Kind, Rule};
use umbrage::reader::query::Map;
use umbrage::reader::{Container, FileSource, Limits, MapSource, MemorySource};
use umbrage::writer::bake::{BakeOptions, Light, bake};
use umbrage::writer::cold::{Tables, Tally};
use umbrage::writer::scene;
use umbrage::writer::solid::Policy;

use crate::cli::{CITY, Place, SUN, text};
use crate::golden::samples::{Seal, repair};
use crate::golden::{self, open};
use crate::tree::{Dice, Folder};

const KINDS: [Kind; 3] = [Kind::Mh, Kind::Mmh, Kind::Vector];

fn baked(path: &Path, kind: Kind, cold: bool) -> Container {
    let options = BakeOptions {
        lights: vec![Light { name: "sun".to_string(), direction: [0.4, -0.8, 0.3] }],
        resolution: 512,
        policy: Policy::Closed,
        kind,
        exhaustive: false,
        top_down: false,
        mmh: Default::default(),
        memory_bytes: None,
        cold,
    };
    bake(&scene::generated("city:1:0.05").unwrap().unwrap(), &options, path, &Default::default()).unwrap();
    Container::open(Arc::new(FileSource::open(path).unwrap()), Limits::default()).unwrap()
}

fn words(file: &Container) -> Vec<Vec<u32>> {
    let s = file.structure(0).unwrap();
    (0..s.page_count()).map(|o| s.page_bytes(o).unwrap().check_frame().unwrap().words().to_vec()).collect()
}

fn tables(kind: Kind, pages: &[Vec<u32>]) -> Tables {
    let mut tally = Tally::new(kind).unwrap();
    pages.iter().for_each(|page| tally.note(page));
    let mut tables = tally.tables();
    pages.iter().for_each(|page| tables.count(page));
    tables.finish()
}

#[test]
fn a_cold_bake_has_the_words_of_a_hot_one() {
    for kind in KINDS {
        let folder = Folder::new(&format!("cold-{}", kind.name()));
        let [hot_path, path] = ["hot.umb", "cold.umb"].map(|name| folder.0.join(name));
        let (hot, file) = (baked(&hot_path, kind, false), baked(&path, kind, true));
        assert_eq!(words(&hot), words(&file), "{kind:?}");
        let (a, b) = (hot.structure(0).unwrap(), file.structure(0).unwrap());
        let mut cold = 0;
        for ordinal in 0..a.page_count() {
            let (a, b) = (a.page_record(ordinal).unwrap(), b.page_record(ordinal).unwrap());
            assert_eq!((a.content_hash, a.hot_words, a.cold_words.get()), (b.content_hash, b.hot_words, 0));
            assert!(b.cold_words.get() < b.hot_words.get());
            cold += u32::from(b.cold_words.get() != 0);
        }
        // All but the root page and such as are too short to gain.
        assert!(cold * 10 > a.page_count() * 9 && cold < a.page_count(), "{kind:?}: {cold} of {}", a.page_count());
        assert_eq!(b.page_record(0).unwrap().cold_words.get(), 0, "a first look needs no model");
        let bytes = std::fs::read(&path).unwrap();
        assert!((bytes.len() as u64) < std::fs::metadata(&hot_path).unwrap().len());
        let memory = open(bytes, Limits::default()).unwrap();
        // SAFETY: the file is ours and nobody writes to it while it is mapped.
        #[allow(unsafe_code)]
        let mapped = unsafe { MapSource::map(&path) }.unwrap();
        let mapped = Container::open(Arc::new(mapped), Limits::default()).unwrap();
        for file in [&file, &memory, &mapped] {
            assert_eq!(file.verify(|e| panic!("{e}")).faults, 0);
            let maps = [&hot, file].map(|f| Map::new(f.structure(0).unwrap()).unwrap());
            let resident = Map::new(file.structure(0).unwrap()).unwrap().preload().unwrap();
            let mut dice = Dice(5);
            for _ in 0..2000 {
                let (x, y, level) = (dice.roll(512), dice.roll(512), dice.roll(6) as u8);
                let [a, b] = [0, 1].map(|i| maps[i].texel(x, y, level).unwrap().value);
                assert_eq!((a, a), (b, resident.value(x, y, level)));
            }
        }
        // The same bytes again, on one thread.
        let again = folder.0.join("again.umb");
        rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap().install(|| baked(&again, kind, true));
        assert!(std::fs::read(&path).unwrap() == std::fs::read(&again).unwrap());
    }
}

#[test]
fn golden_pages_are_cold_in_every_structure() {
    let file = open(golden::named("cold").bytes.clone(), Limits::default()).unwrap();
    for s in file.structures() {
        let cold = |o: &u32| s.page_record(*o).unwrap().cold_words.get() != 0;
        assert!((0..s.page_count()).filter(cold).count() > 0, "{}", s.name());
    }
}

/// Words that no kind would write are coded one by one; what is not shorter so has no cold form.
#[test]
fn any_words_come_back() {
    let mut dice = Dice(9);
    let mut pages: Vec<Vec<u32>> = Vec::new();
    for i in 0..300u32 {
        let (count, bits) = (2 + dice.roll(900), [1, 6, 17, 32][i as usize % 4]);
        pages.push((0..count).map(|_| dice.roll(u32::MAX) >> (32 - bits)).collect());
    }
    for kind in KINDS {
        let tables = tables(kind, &pages);
        let mut shorter = 0;
        for page in &pages {
            let Some(cold) = tables.encode(page) else { continue };
            shorter += 1;
            assert!(cold.len() < page.len() * 4 && cold.len().is_multiple_of(4));
            assert_eq!(decode(tables.model(), &cold, page.len() as u16).as_ref(), Some(page));
        }
        assert!((100..300).contains(&shorter), "{kind:?}: {shorter}");
    }
}

/// Every cut and every flipped bit of cold pages: an error, or other words of the length asked for.
#[test]
fn hostile_bytes_decode_to_nothing_or_to_words() {
    for kind in KINDS {
        let folder = Folder::new(&format!("cold-hostile-{}", kind.name()));
        let pages = words(&baked(&folder.0.join("hot.umb"), kind, false));
        let tables = tables(kind, &pages);
        let (mut refused, mut taken) = (0, 0);
        for page in pages.iter().skip(1).take(12) {
            let Some(cold) = tables.encode(page) else { continue };
            for bit in 0..cold.len() * 8 {
                let mut other = cold.clone();
                other[bit / 8] ^= 1 << (bit % 8);
                match decode(tables.model(), &other, page.len() as u16) {
                    None => refused += 1,
                    Some(words) => {
                        assert_eq!(words.len(), page.len());
                        taken += 1;
                    }
                }
            }
            // A page is stored in whole words.
            for length in (0..cold.len()).step_by(4) {
                assert_eq!(decode(tables.model(), &cold[..length], page.len() as u16), None);
            }
            for words in [0, 1, 2, page.len() as u16 - 1, page.len() as u16 + 1, 16384] {
                assert_eq!(decode(tables.model(), &cold, words), None);
            }
        }
        // Plain bits mean what they say; a wrong symbol is found at the end at the latest.
        assert!(refused > 1000 && taken > 1000, "{kind:?}: {refused} {taken}");
        for length in 0..tables.section().len() {
            assert!(Model::read(kind, &tables.section()[..length]).is_none());
        }
        assert!(Model::read(kind, &[tables.section(), &[0]].concat()).is_none());
    }
}

/// A page that decodes by its model, but to other words than its record's hash is of.
#[test]
fn another_page_is_found_when_it_is_loaded() {
    let golden = golden::named("cold");
    let file = open(golden.bytes.clone(), Limits::default()).unwrap();
    let s = file.structure(0).unwrap();
    let ordinal = (0..s.page_count()).find(|o| s.page_record(*o).unwrap().cold_words.get() != 0).unwrap();
    let r = s.page_record(ordinal).unwrap();
    let (start, end) = (r.offset.get() as usize, r.end() as usize);
    let mut found = 0;
    for bit in start * 8..end * 8 {
        let mut bytes = golden.bytes.clone();
        bytes[bit / 8] ^= 1 << (bit % 8);
        let hash = bytes.windows(8).position(|w| w == r.content_hash.get().to_le_bytes()).unwrap();
        repair(&mut bytes, Seal::All);
        bytes[hash..hash + 8].copy_from_slice(&r.content_hash.get().to_le_bytes());
        repair(&mut bytes, Seal::Index);
        let file = Container::open(Arc::new(MemorySource::new(bytes, "changed")), Limits::default()).unwrap();
        let error = file.structure(0).unwrap().page(ordinal).unwrap_err();
        assert!(matches!(error.rule(), Some(Rule::PageHash | Rule::PageCold)), "{error}");
        found += u32::from(error.rule() == Some(Rule::PageHash));
    }
    assert!(found > 0);
}

/// What the commands say of a file is the same of its hot twin, and `merge` keeps each structure's form.
#[test]
fn the_commands_say_of_a_cold_file_what_they_say_of_a_hot_one() {
    for kind in KINDS.map(Kind::name) {
        let place = Place::new(&format!("cold-{kind}"));
        let bake = |light: &str, file: &str, cold: &[&str]| {
            let args = ["bake", CITY, "--light", light, "--resolution", "512", "--kind", kind, "-o", file];
            place.fine(&[&args, cold].concat());
        };
        bake(SUN, "hot.umb", &[]);
        bake(SUN, "cold.umb", &["--cold"]);
        bake("noon=dir:0.1,-0.9,0.2", "noon.umb", &[]);
        let mut dice = Dice(3);
        let row = |i: u32| format!("{},{},{}\n", dice.roll(512 >> (i % 4)), dice.roll(512 >> (i % 4)), i % 4);
        let texels: String = (0..500).map(row).collect();
        place.write("texels.csv", format!("x,y,level\n{texels}"));
        let row = |_: u32| format!("{},{},{}\n", dice.roll(90) as i32 - 45, dice.roll(12), dice.roll(90) as i32 - 45);
        let points: String = (0..500).map(row).collect();
        place.write("points.csv", format!("x,y,z\n{points}"));
        let texels = |file| place.fine(&["query", file, "--texels", "texels.csv", "--light", "sun"]);
        let world = |file| place.fine(&["query", file, "--world", "points.csv", "--light", "sun", "--source", CITY]);
        let picture = |file: &str| {
            let camera = ["--camera", "60,40,60,0,0,0", "--size", "160x90", "--light", "sun", "--backend", "cpu"];
            place.fine(&[&["render", CITY, file, "-o", "view.png"], &camera[..]].concat());
            std::fs::read(place.file("view.png")).unwrap()
        };
        let proof = |file| {
            let said = place.fine(&["verify", file, "--source", CITY]);
            said.lines().filter(|l| l.contains("outside")).map(str::to_string).collect::<Vec<_>>()
        };
        assert!(!proof("hot.umb").is_empty());
        assert_eq!(proof("hot.umb"), proof("cold.umb"), "{kind}");
        assert!(texels("hot.umb").lines().collect::<std::collections::HashSet<_>>().len() > 300, "{kind}");
        assert!(picture("hot.umb") == picture("cold.umb"), "{kind}");
        place.fine(&["merge", "noon.umb", "cold.umb", "-o", "both.umb"]);
        place.fine(&["verify", "both.umb"]);
        let both = open(std::fs::read(place.file("both.umb")).unwrap(), Limits::default()).unwrap();
        let forms: Vec<bool> = both.structures().map(|s| s.cold_section().is_some()).collect();
        assert_eq!(forms, [false, true], "{kind}");
        for file in ["cold.umb", "both.umb"] {
            assert_eq!(texels("hot.umb"), texels(file), "{kind}");
            assert_eq!(world("hot.umb"), world(file), "{kind}");
        }
    }
}

/// Damage to a cold page by its rule, and the other pages are read all the same.
#[test]
fn a_damaged_cold_page_is_named_with_its_rule() {
    let place = Place::new("cold-damaged");
    let golden = golden::named("cold");
    let file = open(golden.bytes.clone(), Limits::default()).unwrap();
    let s = file.structure(0).unwrap();
    let ordinal = (0..s.page_count()).find(|o| s.page_record(*o).unwrap().cold_words.get() != 0).unwrap();
    let r = s.page_record(ordinal).unwrap();
    let (start, end) = (r.offset.get() as usize, r.end() as usize);
    let said = |bytes: &[u8]| {
        place.write("bad.umb", bytes);
        let out = place.run(&["verify", "bad.umb"]);
        assert_eq!(out.status.code(), Some(1));
        let file = open(bytes.to_vec(), Limits::default()).unwrap();
        let error = file.structure(0).unwrap().page(ordinal).unwrap_err();
        assert!(file.structure(0).unwrap().page(0).is_ok());
        (text(&out).0, error.rule())
    };
    // As a cut leaves it: the rest is zero.
    let mut cut = golden.bytes.clone();
    cut[(start + end) / 2..end].fill(0);
    let (line, rule) = said(&cut);
    assert_eq!(rule, Some(Rule::PageCrc));
    assert!(line.contains("page.crc"), "{line}");
    // And where all sums are right.
    let hash = cut.windows(8).position(|w| w == r.content_hash.get().to_le_bytes()).unwrap();
    repair(&mut cut, Seal::All);
    cut[hash..hash + 8].copy_from_slice(&r.content_hash.get().to_le_bytes());
    repair(&mut cut, Seal::Index);
    let (line, rule) = said(&cut);
    assert_eq!(rule, Some(Rule::PageCold));
    assert!(line.contains("page.cold"), "{line}");
    // A model that is none.
    let mut bytes = golden.bytes.clone();
    bytes[s.cold_section().unwrap().offset.get() as usize] = 41;
    repair(&mut bytes, Seal::All);
    let (line, rule) = said(&bytes);
    assert_eq!(rule, Some(Rule::ColdModel));
    assert!(line.contains("cold.model"), "{line}");
}
