//! Pictures whose pages the index spares, from the command line.

use serde_json::Value;

use crate::cli::{CITY, Place, SUN};

/// A street: most of the map is out of sight.
const VIEW: [&str; 8] = ["render", CITY, "city.umb", "--camera", "60,40,60,0,0,0", "--size", "320x180", "--json"];

#[test]
fn skipping_changes_no_pixel_and_reads_no_more() {
    let place = Place::new("skip-render");
    for kind in ["mh", "mmh", "vector"] {
        let args = ["bake", CITY, "--light", SUN, "--kind", kind, "--resolution", "1024", "--policy", "closed"];
        place.fine(&[&args[..], &["-o", "city.umb"]].concat());
        for (backend, filter) in [("cpu", "hard"), ("gpu", "hard"), ("cpu", "pcf:3"), ("gpu", "hpcf")] {
            let render = |more: &[&str]| {
                let own = ["--backend", backend, "--filter", filter, "-o", "view.png"];
                let said = place.fine(&[&VIEW[..], &own, more].concat());
                let said: Value = serde_json::from_str(&said).unwrap();
                (std::fs::read(place.file("view.png")).unwrap(), said["shadows"]["pages_read"].as_u64().unwrap())
            };
            let (all, skipped, coarse) = (render(&["--no-skip"]), render(&[]), render(&["--error", "4000000000"]));
            assert!(all.0 == skipped.0, "{kind}, {backend}, {filter}");
            assert!(skipped.1 <= all.1 && coarse.1 <= skipped.1, "{kind}, {backend}, {filter}");
            // With any error allowed nothing is read but what is pinned or looked at first.
            assert!(coarse.1 < all.1 && coarse.0 != all.0, "{kind}, {backend}, {filter}: {} of {}", coarse.1, all.1);
        }
    }
}

#[test]
fn wrong_errors_are_refused() {
    let place = Place::new("skip-refused");
    place.fine(&["bake", CITY, "--light", SUN, "--resolution", "64", "-o", "city.umb"]);
    for wrong in ["-1", "1.5", "4294967295", "far"] {
        let line = place.refused(2, &[&VIEW[..], &["--error", wrong, "-o", "no.png"]].concat());
        assert!(line.contains("whole number from 0 to 4294967294") && line.contains(&format!("'{wrong}'")), "{line}");
    }
    let both = place.refused(2, &[&VIEW[..], &["--error", "5", "--no-skip", "-o", "no.png"]].concat());
    assert!(both.contains("--no-skip"), "{both}");
}
