//! Losing nothing: whatever ends a bake or a merge, the target is the old file or the new one, whole.
//!
//! `UMBRAGE_KILLS` says how often each is killed; 10 without it.

use std::fs;
use std::process::Stdio;
use std::time::{Duration, Instant};

use crate::cli::{CITY, Place, SCAN, SUN, text};

fn kills() -> u32 {
    std::env::var("UMBRAGE_KILLS").map_or(10, |n| n.parse().expect("UMBRAGE_KILLS is a number"))
}

/// A fixed sequence of shares of a whole.
struct Shares(u32);

impl Iterator for Shares {
    type Item = f64;

    fn next(&mut self) -> Option<f64> {
        self.0 = self.0.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        Some(f64::from(self.0 >> 8) / f64::from(1 << 24))
    }
}

/// Runs the command to its end once, then kills it again and again at moments spread over that time and a little more.
/// The target must be one of two files each time. Returned: how often it was the new one, and how often a kill came
/// while the file was being written.
fn kill_again_and_again(place: &Place, old: &str, args: &[&str], target: &str, seed: u32) -> [u32; 2] {
    let path = place.0.join(target);
    let before = fs::read(place.0.join(old)).unwrap();
    let start = Instant::now();
    place.fine(args);
    let whole = start.elapsed();
    let after = fs::read(&path).unwrap();
    assert_ne!(before, after);
    let (mut new, mut caught) = (0, 0);
    for share in Shares(seed).take(kills() as usize) {
        fs::write(&path, &before).unwrap();
        let mut child = place.command(args).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
        std::thread::sleep(whole.mul_f64(share * 1.1));
        // SIGKILL
        child.kill().unwrap();
        child.wait().unwrap();
        let found = fs::read(&path).unwrap();
        assert!(found == before || found == after, "{args:?} killed at {share}: neither the old file nor the new one");
        new += u32::from(found == after);
        // what a killed writer leaves is a hidden temporary file of its own, which troubles nobody
        for (name, _) in place.entries() {
            if name.ends_with(".tmp") {
                assert!(name.starts_with(&format!(".{target}.")), "{name}");
                fs::remove_file(place.0.join(name)).unwrap();
                caught += 1;
            }
        }
    }
    place.fine(&["verify", target]);
    [new, caught]
}

#[test]
fn a_killed_bake_leaves_the_old_file_or_the_new_one() {
    let place = Place::baked("kill-bake");
    let args = ["bake", CITY, "--light", SUN, "--resolution", "1024", "-o", "map.umb"];
    let [new, caught] = kill_again_and_again(&place, "scan.umb", &args, "map.umb", 1);
    assert!(new < kills(), "{new} {caught}");
}

#[test]
fn a_killed_merge_leaves_the_old_file_or_the_new_one() {
    let place = Place::baked("kill-merge");
    for (file, light) in [("a.umb", "morning=dir:0.4,-0.8,0.3"), ("b.umb", "noon=dir:0.1,-0.9,0.2")] {
        place.fine(&["bake", CITY, "-o", file, "--light", light, "--resolution", "2048"]);
    }
    let args = ["merge", "a.umb", "b.umb", "-o", "map.umb"];
    // some kills must come while it writes
    let mut rounds = (2..12).map(|seed| kill_again_and_again(&place, "scan.umb", &args, "map.umb", seed));
    assert!(rounds.any(|[_, caught]| caught > 0));
}

#[test]
fn an_interrupted_merge_leaves_the_old_file_and_nothing_else() {
    let place = Place::baked("interrupt-merge");
    for (file, light) in [("a.umb", "morning=dir:0.4,-0.8,0.3"), ("b.umb", "noon=dir:0.1,-0.9,0.2")] {
        place.fine(&["bake", CITY, "-o", file, "--light", light, "--resolution", "1024"]);
    }
    let before = (place.entries(), fs::read(place.0.join("scan.umb")).unwrap());
    let mut stopped = 0;
    // A fast machine has merged within milliseconds, and most signals come too late.
    for share in Shares(3).take(200) {
        if stopped == 4 {
            break;
        }
        let mut child = place
            .command(&["merge", "a.umb", "b.umb", "-o", "scan.umb"])
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        std::thread::sleep(Duration::from_secs_f64(share * 0.01));
        let _ = std::process::Command::new("kill").args(["-INT", &child.id().to_string()]).status();
        let code = child.wait().unwrap().code();
        // 130: told; none: the signal came before anybody listened; 0: done already
        if code != Some(0) {
            assert!(code.is_none() || code == Some(130), "{code:?}");
            let after: Vec<_> =
                place.entries().into_iter().filter(|e| code.is_some() || !e.0.ends_with(".tmp")).collect();
            assert_eq!((after, fs::read(place.0.join("scan.umb")).unwrap()), before, "{code:?}");
            stopped += 1;
        } else {
            fs::write(place.0.join("scan.umb"), &before.1).unwrap();
        }
    }
    assert!(stopped > 0);
}

#[test]
fn two_bakes_to_one_target_leave_one_of_them_whole() {
    let place = Place::new("two");
    let bake = |scene: &'static str, target: &'static str| {
        ["bake", scene, "--light", SUN, "--resolution", "512", "-o", target].map(str::to_string)
    };
    let run = |args: &[String]| {
        let args: Vec<&str> = args.iter().map(String::as_str).collect();
        place.command(&args).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap()
    };
    for (scene, target) in [(CITY, "city.umb"), (SCAN, "scan.umb")] {
        assert!(run(&bake(scene, target)).wait().unwrap().success());
    }
    let [city, scan] = ["city.umb", "scan.umb"].map(|f| fs::read(place.0.join(f)).unwrap());
    for _ in 0..3 {
        let both = [run(&bake(CITY, "one.umb")), run(&bake(SCAN, "one.umb"))];
        for child in both {
            let out = child.wait_with_output().unwrap();
            assert!(out.status.success(), "{:?}", text(&out));
        }
        let one = fs::read(place.0.join("one.umb")).unwrap();
        assert!(one == city || one == scan);
        assert_eq!(
            place.entries().iter().map(|e| e.0.as_str()).collect::<Vec<_>>(),
            ["city.umb", "one.umb", "scan.umb"]
        );
    }
}

/// A link to nothing yet stays a link, and what it names is made; a ring of links is refused.
#[test]
#[cfg(unix)]
fn a_link_to_nothing_is_followed() {
    use std::os::unix::fs::symlink;
    let place = Place::new("dangling");
    fs::create_dir(place.file("maps")).unwrap();
    symlink("maps/sun.umb", place.file("one.umb")).unwrap();
    symlink("one.umb", place.file("two.umb")).unwrap();
    let bake = ["bake", SCAN, "--light", SUN, "--resolution", "64", "-o"];
    place.fine(&[&bake[..], &["two.umb"]].concat());
    assert!(fs::symlink_metadata(place.file("maps/sun.umb")).unwrap().is_file());
    for link in ["one.umb", "two.umb"] {
        assert!(fs::symlink_metadata(place.file(link)).unwrap().is_symlink());
        place.fine(&["verify", link]);
    }
    symlink("nowhere/sun.umb", place.file("astray.umb")).unwrap();
    symlink("ring.umb", place.file("ring.umb")).unwrap();
    for (link, says) in [("astray.umb", "nowhere: the directory does not exist"), ("ring.umb", "too many links")] {
        let line = place.refused(5, &[&bake[..], &[link]].concat());
        assert!(line.contains(says), "{line}");
        assert!(fs::symlink_metadata(place.file(link)).unwrap().is_symlink());
    }
}

/// The temporary file lies beside the target, not beside the program or a link to it: a rename never crosses file
/// systems.
#[test]
#[cfg(target_os = "linux")]
fn a_target_on_another_file_system_is_written_there() {
    use std::os::unix::fs::{MetadataExt, symlink};
    let place = Place::baked("elsewhere");
    let shared = std::path::Path::new("/dev/shm");
    let elsewhere = shared.join(format!("umbrage-{}", std::process::id()));
    fs::create_dir(&elsewhere).expect("a file system in memory");
    assert_ne!(fs::metadata(&elsewhere).unwrap().dev(), fs::metadata(&place.0).unwrap().dev(), "one file system only");
    let target = elsewhere.join("map.umb");
    fs::copy(place.0.join("scan.umb"), &target).unwrap();
    symlink(&target, place.0.join("link.umb")).unwrap();
    for to in [target.to_str().unwrap(), "link.umb"] {
        place.fine(&["bake", CITY, "--light", SUN, "--resolution", "128", "-o", to]);
        assert!(fs::symlink_metadata(place.0.join("link.umb")).unwrap().is_symlink());
        assert_eq!(fs::read_dir(&elsewhere).unwrap().count(), 1);
        assert_eq!(place.entries().len(), 2);
        place.fine(&["verify", "link.umb", "--source", CITY]);
        place.fine(&["bake", SCAN, "--light", SUN, "--resolution", "128", "-o", to]);
        place.fine(&["verify", "link.umb", "--source", SCAN]);
    }
    fs::remove_dir_all(&elsewhere).unwrap();
}
