//! Filtered pictures from the command line.

use crate::cli::{CITY, Place, SUN};

const VIEW: [&str; 7] = ["render", CITY, "city.umb", "--camera", "60,40,60,0,0,0", "--size", "320x180"];

#[test]
fn pictures_may_be_filtered() {
    let place = Place::new("filter-render");
    for kind in ["mh", "vector"] {
        let args = ["bake", CITY, "--light", SUN, "--kind", kind, "--resolution", "512", "--policy", "closed"];
        place.fine(&[&args[..], &["-o", "city.umb"]].concat());
        let picture = |filter: &str| {
            let by = |backend: &str| {
                place.fine(&[&VIEW[..], &["--backend", backend, "--filter", filter, "-o", "view.png"]].concat());
                std::fs::read(place.file("view.png")).unwrap()
            };
            let cpu = by("cpu");
            assert!(cpu == by("gpu"), "{kind}, {filter}");
            cpu
        };
        let [hard, one, three, five] = ["hard", "pcf:1", "pcf:3", "pcf:5"].map(picture);
        // One tap is the lookup itself.
        assert!(hard == one && one != three && three != five, "{kind}");
        let [level, named, wide, between] = ["hpcf", "hpcf:3", "hpcf:7", "trilinear"].map(picture);
        assert!(level == named && level != wide && level != between, "{kind}");
    }
}

#[test]
fn wrong_filters_are_refused() {
    let place = Place::new("filter-refused");
    place.fine(&["bake", CITY, "--light", SUN, "--resolution", "64", "-o", "city.umb"]);
    for wrong in ["", "soft", "pcf", "pcf:0", "pcf:64", "pcf:-3", "pcf:3x3", "hard:3", "hpcf:", "trilinear:1e9"] {
        let line = place.refused(2, &[&VIEW[..], &["--filter", wrong, "-o", "no.png"]].concat());
        assert!(line.contains("pcf:N") && line.contains(&format!("'{wrong}'")), "{line}");
    }
    let both = place.refused(2, &[&VIEW[..], &["--filter", "pcf:3", "--continuous", "-o", "no.png"]].concat());
    assert!(both.contains("--continuous"), "{both}");
}
