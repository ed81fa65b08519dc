//! The built program, as a user meets it: exit codes, one line for each error, nothing left behind.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

pub const SUN: &str = "sun=dir:0.4,-0.8,0.3";
pub const SCAN: &str = "scan:1:0.05";
pub const CITY: &str = "city:1:0.05";

/// A folder of one test, where the program runs.
pub struct Place(pub PathBuf);

impl Place {
    pub fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("umbrage-cli-{name}-{}", std::process::id()));
        let _ = fs::remove_dir_all(&path);
        fs::create_dir_all(&path).unwrap();
        Place(path)
    }

    /// With `scan.umb`, 256 x 256.
    pub fn baked(name: &str) -> Self {
        let place = Place::new(name);
        place.fine(&["bake", SCAN, "--light", SUN, "--resolution", "256", "-o", "scan.umb"]);
        place
    }

    pub fn command(&self, args: &[&str]) -> Command {
        let mut c = Command::new(env!("CARGO_BIN_EXE_umbrage"));
        // Without it, display libraries below the GPU's driver print lines of their own.
        c.current_dir(&self.0).args(args).stdin(Stdio::null()).env("XDG_RUNTIME_DIR", &self.0);
        c
    }

    pub fn run(&self, args: &[&str]) -> Output {
        self.command(args).output().unwrap()
    }

    /// Runs to success; what it printed.
    pub fn fine(&self, args: &[&str]) -> String {
        let out = self.run(args);
        let (stdout, stderr) = text(&out);
        assert_eq!((out.status.code(), stderr.as_str()), (Some(0), ""), "{args:?}");
        stdout
    }

    /// Runs into an error of this exit code; its one line. The folder is as it was.
    pub fn refused(&self, code: i32, args: &[&str]) -> String {
        let before = self.entries();
        let out = self.run(args);
        let line = error(&out, code, args);
        assert_eq!(self.entries(), before, "{args:?}");
        line
    }

    pub fn write(&self, name: &str, bytes: impl AsRef<[u8]>) {
        fs::write(self.0.join(name), bytes).unwrap();
    }

    /// A file in the folder.
    pub fn file(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }

    /// Names and lengths of everything in the folder.
    pub fn entries(&self) -> Vec<(String, u64)> {
        entries(&self.0)
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

pub fn entries(folder: &Path) -> Vec<(String, u64)> {
    let entry = |e: fs::DirEntry| (e.file_name().into_string().unwrap(), e.metadata().unwrap().len());
    let mut all: Vec<_> = fs::read_dir(folder).unwrap().map(|e| entry(e.unwrap())).collect();
    all.sort();
    all
}

pub fn text(out: &Output) -> (String, String) {
    let text = |bytes: &[u8]| String::from_utf8(bytes.to_vec()).unwrap();
    (text(&out.stdout), text(&out.stderr))
}

/// The error of a run: one line, nothing on stdout, no trace of a panic. What the argument parser says of wrong
/// arguments is one line too, with the usage below it.
pub fn error(out: &Output, code: i32, args: &[&str]) -> String {
    let (stdout, stderr) = text(out);
    assert_eq!((out.status.code(), stdout.as_str()), (Some(code), ""), "{args:?}: {stderr}");
    assert!(!stderr.contains("panicked") && !stderr.contains("RUST_BACKTRACE"), "{args:?}: {stderr}");
    let lines: Vec<&str> = stderr.lines().collect();
    let parser = code == 2 && stderr.starts_with("error: ");
    assert!(stderr.ends_with('\n') && (parser || lines.len() == 1), "{args:?}: {stderr}");
    assert!(parser || lines[0].starts_with("umbrage: "), "{args:?}: {stderr}");
    lines[0].to_string()
}

#[test]
fn what_is_no_container_is_refused() {
    let place = Place::baked("container");
    fs::create_dir(place.0.join("folder")).unwrap();
    place.write("empty.umb", "");
    place.write("text.umb", "x,y,z\n1,2,3\n".repeat(100));
    place.write("points.csv", "x,y\n1,2\n");
    for (file, code) in [("missing.umb", 3), ("folder", 3), ("empty.umb", 4), ("text.umb", 4)] {
        let runs: [&[&str]; 4] = [
            &["dump", file],
            &["query", file, "--texels", "points.csv"],
            &["verify", file],
            &["render", SCAN, file, "--camera", "1,2,3,0,0,0", "-o", "out.png"],
        ];
        for args in runs {
            assert!(place.refused(code, args).contains(file), "{args:?}");
        }
    }
}

#[test]
fn a_container_that_was_cut_is_refused() {
    let place = Place::baked("cut");
    let whole = fs::read(place.0.join("scan.umb")).unwrap();
    for n in (0..whole.len()).step_by(97).chain([whole.len() - 1]) {
        place.write("cut.umb", &whole[..n]);
        let line = place.refused(4, &["dump", "cut.umb"]);
        assert!(line.contains("cut.umb: header."), "{n}: {line}");
    }
    place.write("cut.umb", [&whole[..], b"\n"].concat());
    place.refused(4, &["dump", "cut.umb"]);
}

#[test]
fn a_container_that_was_damaged_fails_verification() {
    let place = Place::baked("damaged");
    let said = place.fine(&["verify", "scan.umb", "--source", SCAN]);
    assert!(said.contains(" 0 stored values outside their interval"), "{said}");
    let mut bytes = fs::read(place.0.join("scan.umb")).unwrap();
    *bytes.last_mut().unwrap() ^= 1;
    place.write("bad.umb", bytes);
    let out = place.run(&["verify", "bad.umb"]);
    let (stdout, stderr) = text(&out);
    assert_eq!(out.status.code(), Some(1), "{stderr}");
    assert!(stdout.contains("page.crc") && stderr.lines().count() == 1, "{stdout}{stderr}");
    // The wrong scene is wrong input, not a fault of the file.
    place.refused(3, &["verify", "scan.umb", "--source", CITY]);
}

#[test]
fn tables_of_points_are_checked_row_by_row() {
    let place = Place::baked("tables");
    let world = [
        ("", "line 1"),
        ("\n\n", "line 1"),
        ("a,b,c\n1,2,3\n", "found 'a,b,c'"),
        ("x,y\n1,2\n", "found 'x,y'"),
        ("x,y,z,w\n1,2,3,4\n", "found 'x,y,z,w'"),
        ("x,y,z\n1,2\n", "line 2"),
        ("x,y,z\n1,2,3\n\n1,2,3,4\n", "line 4"),
        ("x,y,z\n1,NaN,3\n", "'NaN'"),
        ("x,y,z\n1,inf,3\n", "'inf'"),
        ("x,y,z\n1,-1e999,3\n", "'-1e999'"),
        ("x,y,z\n1,,3\n", "''"),
        ("x,y,z\n1,two,3\n", "'two'"),
        ("x,y,z\n1;2;3\n", "line 2"),
    ];
    for (table, says) in world {
        place.write("points.csv", table);
        let line = place.refused(3, &["query", "scan.umb", "--world", "points.csv"]);
        assert!(line.contains("points.csv") && line.contains(says), "{table:?}: {line}");
    }
    for (table, says) in [
        ("x,y,level\n0,0,9\n", "from 0 to 8"),
        ("x,y,level\n1,0,8\n", "from 0 to 0"),
        ("x,y\n256,0\n", "from 0 to 255"),
        ("x,y\n-1,0\n", "'-1'"),
        ("x,y\n0.5,0\n", "'0.5'"),
        ("x,y\n99999999999999999999,0\n", "from 0 to 255"),
        ("x\n1\n", "found 'x'"),
    ] {
        place.write("texels.csv", table);
        let line = place.refused(3, &["query", "scan.umb", "--texels", "texels.csv"]);
        assert!(line.contains("texels.csv") && line.contains(says), "{table:?}: {line}");
    }
    place.write("bytes.csv", [b'x', 0xFF, 0, b'\n']);
    place.refused(3, &["query", "scan.umb", "--world", "bytes.csv"]);
    place.refused(3, &["query", "scan.umb", "--world", "missing.csv"]);
    place.refused(2, &["query", "scan.umb"]);
    place.refused(2, &["query", "scan.umb", "--world", "bytes.csv", "--texels", "bytes.csv"]);
    // No points are no error.
    place.write("none.csv", "x,y,z\n");
    assert_eq!(place.fine(&["query", "scan.umb", "--world", "none.csv"]), "x,y,z,depth,stored,lit,certified\n");
}

#[test]
fn query_answers_in_the_columns_of_its_help() {
    let place = Place::baked("columns");
    place.write("points.csv", "x,y,z\r\n 0, 2 ,0\r\n-1,-2,0.5\n1e6,0,0\n");
    place.write("texels.csv", "x,y,level\n128,128,0\n64,64,1\n0,0,8\n0,0,0\n");
    let rows = |args: &[&str]| -> Vec<Vec<String>> {
        let out = place.fine(args);
        out.lines().map(|l| l.split(',').map(str::to_string).collect()).collect()
    };
    let world = rows(&["query", "scan.umb", "--world", "points.csv", "--light", "sun", "--source", SCAN]);
    assert_eq!(world[0].join(","), "x,y,z,depth,stored,lit,certified");
    assert_eq!(world.len(), 4);
    assert_eq!(world[3], ["1e6", "0", "0", "", "", "1", ""], "outside the map");
    for r in &world[1..3] {
        let (depth, stored): (f64, u32) = (r[3].parse().unwrap(), r[4].parse().unwrap());
        assert_eq!(r[5], if depth.ceil() <= f64::from(stored) { "1" } else { "0" }, "{r:?}");
        assert!(["0", "1"].contains(&r[6].as_str()), "{r:?}");
    }
    // Above the ball there is light; below the slab there is none.
    assert_eq!((world[1][5].as_str(), world[2][5].as_str()), ("1", "0"), "{world:?}");
    let texels = rows(&["query", "scan.umb", "--texels", "texels.csv"]);
    assert_eq!(texels[0].join(","), "x,y,level,stored,certified");
    assert_eq!(texels.len(), 5);
    for r in &texels[1..] {
        assert_eq!((r.len(), r[4].as_str()), (5, ""), "{r:?}");
        r[3].parse::<u32>().unwrap();
    }
    assert_eq!(texels[4][3], u32::MAX.to_string(), "a corner that nothing covers");
    let certified = rows(&["query", "scan.umb", "--texels", "texels.csv", "--source", SCAN]);
    assert!(certified[1..].iter().zip(&texels[1..]).all(|(a, b)| a[..4] == b[..4]));
    assert_eq!([&certified[2][4], &certified[3][4]], ["", ""], "only texels of level 0 are certified");
    assert_eq!(certified[4][4], "1");
    assert!(place.refused(2, &["query", "scan.umb", "--texels", "texels.csv", "--light", "moon"]).contains("sun"));
}

#[test]
fn arguments_out_of_range_are_a_wrong_use() {
    let place = Place::baked("usage");
    for resolution in ["0", "3", "2147483648", "16777217", "-4", "1e3", "18446744073709551616", ""] {
        let bake = ["bake", SCAN, "--light", SUN, "--resolution", resolution, "-o", "new.umb"];
        assert!(place.refused(2, &bake).contains(resolution));
        place.refused(2, &["demo", "--resolution", resolution, "--out", "new"]);
    }
    let lights = [
        "sun",
        "sun=",
        "sun=dir",
        "sun=dir:",
        "sun=dir:1,2",
        "sun=dir:1,2,3,4",
        "sun=dir:1,x,3",
        "sun=dir:1,NaN,3",
        "sun=dir:1,inf,3",
        "sun=dir:0,0,0",
        "sun=dir:0,-0,0",
        "=dir:0,-1,0",
        "sun=pos:0,1,0",
        "sun=dir:0;-1;0",
        "",
    ];
    for light in lights {
        place.refused(2, &["bake", SCAN, "--light", light, "--resolution", "64", "-o", "new.umb"]);
    }
    let long = format!("{}=dir:0,-1,0", "n".repeat(65));
    place.refused(2, &["bake", SCAN, "--light", &long, "--resolution", "64", "-o", "new.umb"]);
    place.refused(2, &["bake", SCAN, "--light", SUN, "--light", SUN, "--resolution", "64", "-o", "new.umb"]);
    place.refused(2, &["bake", SCAN, "--resolution", "64", "-o", "new.umb"]);
    place.refused(2, &["bake", SCAN, "--light", SUN, "--resolution", "64"]);
    place.refused(2, &["bake"]);
    // Nothing at all gets the help.
    let out = place.run(&[]);
    assert!(out.status.code() == Some(2) && text(&out).1.contains("Usage: umbrage"), "{out:?}");
    place.refused(2, &["make"]);
    for policy in ["thickness", "thickness:0", "thickness:-1", "thickness:NaN", "thickness:inf", "open", ""] {
        place.refused(2, &["bake", SCAN, "--light", SUN, "--policy", policy, "--resolution", "64", "-o", "new.umb"]);
    }
    for scene in
        ["city:", "city:-1", "city:1:0", "city:1:17", "city:1:-1", "city:1:NaN", "town:1", "folder/scene.obj", ""]
    {
        place.refused(3, &["bake", scene, "--light", SUN, "--resolution", "64", "-o", "new.umb"]);
    }
    // A negative number is the option's value, and the option says what it wants instead.
    let bake = ["bake", SCAN, "--light", SUN, "-o", "new.umb"];
    let render = ["render", SCAN, "scan.umb", "--camera", "-3,4,-5,0,0,0", "-o", "new.png"];
    let runs: [(&[&str], &str); 9] = [
        (&bake, "--resolution"),
        (&bake, "--memory"),
        (&bake, "--threads"),
        (&["dump", "scan.umb"], "--page"),
        (&["dump", "scan.umb", "--image", "new.png"], "--level"),
        (&["verify", "scan.umb", "--source", SCAN], "--sample"),
        (&["demo", "--out", "new"], "--resolution"),
        (&render, "--fov"),
        (&render, "--size"),
    ];
    for (args, option) in runs {
        let line = place.refused(2, &[args, &[option, "-7"]].concat());
        assert!(line.contains("-7") && !line.contains("unexpected"), "{line}");
    }
    // What is no number at all: what was expected, and what was found.
    for (args, option, expected) in [
        (&bake[..], "--resolution", "expected a power of two from 1 to 16777216"),
        (&bake, "--memory", "expected a whole number from 0 to "),
        (&bake, "--threads", "expected 1 to 1024"),
        (&["dump", "scan.umb"], "--page", "expected a whole number from 0 to 4294967295"),
        (&["dump", "scan.umb", "--image", "new.png"], "--level", "expected a whole number from 0 to 24"),
        (&["demo", "--out", "new"], "--budget", "expected a whole number from 1 to 1048576"),
        (&render, "--budget", "expected a whole number from 1 to 1048576"),
        (&render, "--fov", "expected degrees above 0 and below 180"),
    ] {
        let line = place.refused(2, &[args, &[option, "1o"]].concat());
        assert!(line.contains(expected) && line.contains("found '1o'"), "{line}");
    }
    // Users know lights.
    place.write("points.csv", "x,y,z\n0,0,0\n");
    let line = place.refused(2, &["query", "scan.umb", "--light", "moon", "--world", "points.csv"]);
    assert!(line.ends_with("no light is named 'moon'; it has sun"), "{line}");
    let line = place.refused(2, &["merge", "scan.umb", "scan.umb", "-o", "new.umb"]);
    assert!(line.contains("two lights are named 'sun'"), "{line}");
    place.refused(2, &[&bake[..], &["--light", "-7"]].concat());
    for camera in ["1,2,3", "1,2,3,1,2,3", "1,2,3,4,5,NaN", "-1,-2,-3,-4,-5", ""] {
        place.refused(2, &["render", SCAN, "scan.umb", "--camera", camera, "-o", "new.png"]);
    }
    for (option, value) in [("--fov", "0"), ("--fov", "180"), ("--fov", "NaN"), ("--size", "0x1"), ("--size", "9")] {
        place.refused(2, &[&render[..], &[option, value]].concat());
    }
    place.refused(2, &["dump", "scan.umb", "--page", "999999"]);
    place.refused(2, &["dump", "scan.umb", "--image", "new.png", "--level", "9"]);
    place.fine(&[&render[..], &["--size", "32x18"]].concat());
    place.fine(&["bake", SCAN, "--light", "low=dir:-0.4,-0.8,-0.3", "--resolution", "64", "-o", "low.umb"]);
}

#[test]
fn targets_that_cannot_be_written_are_said_so_and_stay_as_they_are() {
    let place = Place::baked("target");
    fs::create_dir(place.0.join("folder")).unwrap();
    let old = fs::read(place.0.join("scan.umb")).unwrap();
    for target in ["folder", "missing/new.umb", "/dev/null", "/proc/new.umb", "scan.umb/new.umb"] {
        // A scene that takes long to bake: the target is looked at first.
        let bake = ["bake", "city:1:2", "--light", SUN, "--resolution", "16777216", "-o", target];
        assert!(place.refused(5, &bake).contains(target.split('/').next().unwrap()), "{target}");
        let camera = ["--camera", "-3,4,-5,0,0,0", "--size", "16x9", "-o", target];
        if target != "/dev/null" {
            place.refused(5, &[&["render", SCAN, "scan.umb"], &camera[..]].concat());
            place.refused(5, &["dump", "scan.umb", "--image", target]);
        }
    }
    place.refused(5, &["demo", "--resolution", "64", "--out", "scan.umb"]);
    place.refused(5, &["demo", "--resolution", "64", "--out", "/proc/new"]);
    assert_eq!(fs::read(place.0.join("scan.umb")).unwrap(), old);
}

/// Runs a line of the shell in the folder, `$U` being the program.
#[cfg(unix)]
fn shell(place: &Place, script: &str) -> Output {
    Command::new("sh")
        .current_dir(&place.0)
        .env("U", env!("CARGO_BIN_EXE_umbrage"))
        .args(["-c", script])
        .output()
        .unwrap()
}

#[cfg(unix)]
#[test]
fn a_full_disk_leaves_the_old_target_and_nothing_else() {
    let place = Place::baked("full");
    let before = (place.entries(), fs::read(place.0.join("scan.umb")).unwrap());
    let bake = format!("$U bake {CITY} --light {SUN} --resolution 256 -o");
    // A limit on the length of files, in blocks of 512 bytes or 1 KiB.
    let out = shell(&place, &format!("trap '' XFSZ; ulimit -f 8; {bake} scan.umb"));
    assert!(error(&out, 5, &["ulimit"]).contains("scan.umb: no space left"));
    assert_eq!((place.entries(), fs::read(place.0.join("scan.umb")).unwrap()), before);
    // A file system of its own, where the system lets us: 32 KiB do not hold the file.
    fs::create_dir(place.0.join("disk")).unwrap();
    let script = format!(
        "mount -t tmpfs -o size=32k none disk || exit 77; echo old > disk/map.umb; {bake} disk/map.umb; code=$?; \
         [ \"$(ls -A disk)\" = map.umb ] && [ \"$(cat disk/map.umb)\" = old ] || exit 78; exit $code"
    );
    let mut own = Command::new("unshare");
    own.args(["-rm", "sh", "-c", &script]).current_dir(&place.0).env("U", env!("CARGO_BIN_EXE_umbrage"));
    match own.output() {
        Ok(out) if out.status.code() == Some(5) => {
            assert!(error(&out, 5, &["tmpfs"]).contains("disk/map.umb: no space left"));
        }
        Ok(out) => assert!(matches!(out.status.code(), Some(1 | 77)), "{out:?}"),
        Err(_) => {}
    }
    // Where even the output has no room.
    let out = shell(&place, "$U dump scan.umb > /dev/full");
    assert!(error(&out, 5, &["/dev/full"]).contains("stdout"));
    // A reader of the pipe that has had enough is no error.
    let out = shell(&place, "{ $U dump scan.umb --page 0; echo $? > code; } | head -n 1");
    let (stdout, stderr) = text(&out);
    assert_eq!((stdout.lines().count(), stderr.as_str()), (1, ""));
    assert_eq!(fs::read_to_string(place.0.join("code")).unwrap().trim(), "0");
}

#[test]
fn memory_that_does_not_suffice_is_refused_with_the_figure() {
    let place = Place::new("memory");
    let mut memory = 0;
    for step in 0.. {
        let with = memory.to_string();
        let args =
            ["bake", CITY, "--light", SUN, "--resolution", "2048", "-o", "city.umb", "--memory", &with, "--json"];
        let out = place.run(&args);
        if out.status.success() {
            let report: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
            let peak = report["peak_memory_bytes"].as_u64().unwrap();
            assert!(step > 0 && memory < 256 && peak <= memory << 20, "{memory} MiB after {step} steps, held {peak}");
            break;
        }
        let line = place.refused(5, &args);
        let next: u64 = line.rsplit("--memory ").next().unwrap().parse().expect(&line);
        assert!(next > memory && step < 8, "{line}");
        memory = next;
    }
    assert_eq!(place.entries().len(), 1);
    place.fine(&["bake", CITY, "--light", SUN, "--resolution", "2048", "-o", "free.umb"]);
    let [tight, free] = ["city.umb", "free.umb"].map(|f| fs::read(place.0.join(f)).unwrap());
    assert!(tight == free, "the budget changes no byte");
}

#[test]
fn the_number_of_threads_changes_no_byte() {
    let place = Place::new("threads");
    for threads in ["1", "2"] {
        let file = format!("{threads}.umb");
        let args = ["bake", CITY, "--light", SUN, "--light", "low=dir:-0.9,-0.2,0.3", "--resolution", "512"];
        place.fine(&[&args[..], &["--threads", threads, "-o", &file]].concat());
    }
    let [one, two] = ["1.umb", "2.umb"].map(|f| fs::read(place.0.join(f)).unwrap());
    assert!(one == two && one.len() > 16384);
    // The same again over the old file: the same.
    let json = place.fine(&["bake", SCAN, "--light", SUN, "--resolution", "64", "-o", "1.umb", "--json"]);
    assert_eq!((json.lines().count(), json.starts_with('{'), json.contains("\"edge_texels\":")), (1, true, true));
    assert_eq!(place.entries().len(), 2);
}

/// Waits until the program handles the signal itself.
#[cfg(target_os = "linux")]
pub fn wait_for_handler(child: &mut Child) {
    let start = Instant::now();
    let caught = |status: String| {
        let mask = status.lines().find_map(|l| l.strip_prefix("SigCgt:").map(|m| m.trim().to_string()))?;
        Some(u64::from_str_radix(&mask, 16).ok()? & (1 << 1 | 1 << 14) == (1 << 1 | 1 << 14))
    };
    let path = format!("/proc/{}/status", child.id());
    while !fs::read_to_string(&path).ok().and_then(caught).unwrap_or(false) {
        assert!(child.try_wait().unwrap().is_none(), "ended before it was interrupted");
        assert!(start.elapsed() < Duration::from_secs(20), "no handler");
        std::thread::sleep(Duration::from_millis(1));
    }
}

#[cfg(target_os = "linux")]
#[test]
fn an_interrupted_bake_leaves_the_old_target_and_nothing_else() {
    let place = Place::baked("interrupt");
    let before = (place.entries(), fs::read(place.0.join("scan.umb")).unwrap());
    let args = ["bake", CITY, "--light", SUN, "--builder", "exhaustive", "--resolution", "16384", "-o", "scan.umb"];
    for (signal, after) in [("-INT", 0), ("-TERM", 0), ("-INT", 300), ("-TERM", 300)] {
        let mut child = place.command(&args).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        wait_for_handler(&mut child);
        std::thread::sleep(Duration::from_millis(after));
        let start = Instant::now();
        assert!(Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap().success());
        let out = child.wait_with_output().unwrap();
        error(&out, 130, &[signal]);
        assert!(start.elapsed() < Duration::from_secs(10), "{:?}", start.elapsed());
        assert_eq!((place.entries(), fs::read(place.0.join("scan.umb")).unwrap()), before, "{signal} {after}");
    }
}

#[cfg(target_os = "linux")]
#[test]
fn an_interrupted_verify_ends_with_130() {
    let place = Place::new("interrupted-verify");
    place.fine(&["bake", CITY, "--light", SUN, "--resolution", "4096", "--policy", "closed", "-o", "city.umb"]);
    for after in [0, 300] {
        let args = ["verify", "city.umb", "--source", CITY, "--json"];
        let mut child = place.command(&args).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        wait_for_handler(&mut child);
        std::thread::sleep(Duration::from_millis(after));
        let start = Instant::now();
        assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
        let out = child.wait_with_output().unwrap();
        assert_eq!(out.status.code(), Some(130), "{}", text(&out).1);
        let found: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
        assert_eq!((&found["ok"], &found["error"]["exit_code"]), (&false.into(), &130.into()), "{found}");
        assert!(start.elapsed() < Duration::from_secs(10), "{:?}", start.elapsed());
    }
}

#[test]
fn the_demo_writes_its_files_and_has_no_wrong_pixel() {
    let place = Place::new("demo");
    let said = place.fine(&["demo", "--resolution", "256", "--out", "out"]);
    assert!(said.contains(" 0 wrong of "), "{said}");
    let files = entries(&place.0.join("out"));
    let names: Vec<&str> = files.iter().map(|f| f.0.as_str()).collect();
    assert_eq!(names, ["city.umb", "difference.png", "reference.png", "report.json", "shadow.png"]);
    assert!(files.iter().all(|f| f.1 > 500), "{files:?}");
    let report = fs::read_to_string(place.0.join("out/report.json")).unwrap();
    let report: serde_json::Value = serde_json::from_str(&report).unwrap();
    assert_eq!(report["pixels_wrong_on_certified_texels"], 0);
    assert_eq!(report["bake"]["resolution"], 256);
    assert_eq!(report["bake"]["bytes"], files[0].1);
    let seen = report["pixels_with_receiver"].as_u64().unwrap();
    let edge = report["pixels_in_edge_texels"].as_u64().unwrap();
    assert!(seen > 100_000 && edge < seen, "{seen} {edge}");
}

#[test]
fn merge_keeps_every_light_and_refuses_equal_names() {
    let place = Place::new("merge");
    for (file, light) in [("a.umb", "morning=dir:0.4,-0.8,0.3"), ("b.umb", "noon=dir:0.1,-0.9,0.2")] {
        place.fine(&["bake", SCAN, "-o", file, "--light", light, "--resolution", "64"]);
    }
    place.fine(&["merge", "a.umb", "b.umb", "-o", "c.umb"]);
    let proof = place.fine(&["verify", "c.umb", "--source", SCAN]);
    assert!(proof.contains("morning") && proof.contains("noon"), "{proof}");
    assert!(place.refused(2, &["merge", "a.umb", "a.umb", "-o", "d.umb"]).contains("morning"));
}

/// A file of kind `vector` through the commands that read containers.
#[test]
fn vector_files_are_dumped_drawn_queried_and_verified() {
    let place = Place::new("vector");
    place.write("v.umb", &crate::golden::named("vector").bytes);
    let summary: serde_json::Value = serde_json::from_str(&place.fine(&["dump", "v.umb", "--json"])).unwrap();
    let light = &summary["lights"][0];
    assert_eq!(light["kind"], "vector");
    // Every byte of the pages has a purpose.
    let parts = light["bytes"].as_object().unwrap();
    let sum: u64 = parts.iter().filter(|(name, _)| *name != "total").map(|(_, n)| n.as_u64().unwrap()).sum();
    assert_eq!(parts["total"], sum);
    assert!(light["palette"]["splits"].as_u64() > Some(0) && light["palette"]["raws"].as_u64() > Some(0));
    let text = place.fine(&["dump", "v.umb"]);
    assert!(text.contains("palette") && text.contains("topology"), "{text}");
    let page = place.fine(&["dump", "v.umb", "--page", "1"]);
    assert!(page.contains("2 masks") && page.contains("heap"), "{page}");
    for what in ["depth", "nodes", "pages"] {
        place.fine(&["dump", "v.umb", "--image", "v.png", "--draw", what, "--level", "0"]);
    }
    place.write("points.csv", "x,y,level\n3,4,0\n12,2,0\n1,0,3\n");
    let answers = place.fine(&["query", "v.umb", "--texels", "points.csv"]);
    let tree = &crate::golden::named("vector").trees[0][0];
    let rows: Vec<u32> = answers.lines().skip(1).map(|l| l.split(',').nth(3).unwrap().parse().unwrap()).collect();
    assert_eq!(rows, [tree.lookup(4, 3, 4, 0), tree.lookup(4, 12, 2, 0), tree.lookup(4, 8, 0, 3)]);
    place.fine(&["verify", "v.umb"]);
}
