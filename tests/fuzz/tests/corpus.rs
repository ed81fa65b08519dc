//! Every kept input through its target: what a fuzzer once found stays found, on any compiler.

use std::path::Path;

#[test]
fn kept_inputs_hold_their_claims() {
    type Target = fn(&[u8]);
    let targets: [(&str, Target); 8] = [
        ("open", umbrage_fuzz::open::run),
        ("page", umbrage_fuzz::page::run),
        ("cold", umbrage_fuzz::cold::run),
        ("roundtrip", umbrage_fuzz::roundtrip::run),
        ("query_agrees", umbrage_fuzz::query_agrees::run),
        ("scene", umbrage_fuzz::scene::run),
        ("layers", umbrage_fuzz::layers::run),
        ("intervals", umbrage_fuzz::intervals::run),
    ];
    for (name, run) in targets {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus").join(name);
        let files: Vec<_> = std::fs::read_dir(&folder).unwrap().map(|e| e.unwrap().path()).collect();
        assert!(files.len() >= 3, "{}", folder.display());
        for file in files {
            println!("{}", file.display());
            run(&std::fs::read(&file).unwrap());
        }
    }
}

/// Seeds of cold pages reach the end of decoding: of each kind one by the common tables, and those with a model.
#[test]
fn kept_cold_pages_are_decoded() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus/cold");
    for (kind, least) in [("mh", 3), ("mmh", 3), ("vector", 3)] {
        let mut found = 0;
        for file in std::fs::read_dir(&folder).unwrap().map(|e| e.unwrap().path()) {
            let name = file.file_name().unwrap().to_str().unwrap();
            if name == format!("{kind}-page") || name.starts_with(&format!("{kind}-model")) {
                assert!(umbrage_fuzz::cold::decodes(&std::fs::read(&file).unwrap()), "{name}: make the seeds again");
                found += 1;
            }
        }
        assert!(found >= least, "{kind}: {found}");
    }
}
