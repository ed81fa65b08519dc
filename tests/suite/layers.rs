//! Depth sources through writer, file and reader: every stored value is right on the centre's ray, bytes and ids depend
//! on what they should, and a bake that ends early leaves nothing behind.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use umbrage::certify::Oracle;
use umbrage::certify::layers::{LayersTally, check};
use umbrage::reader::query::{Map, Resident};
use umbrage::reader::{Container, FileSource, Limits};
use umbrage::writer::bake::BakeError;
use umbrage::writer::hierarchy::build::Progress;
use umbrage::writer::layers::{
    DepthScale, DepthSource, LatticeLayers, LayersError, LayersOptions, Projection, Second, SourceError, Square,
    bake_layers,
};
use umbrage::writer::solid::{Policy, SnappedMesh, snap};
use umbrage::writer::{frame, scene};

/// A folder of one test.
pub struct Folder(PathBuf);

impl Folder {
    pub fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("umbrage-layers-{name}-{}", std::process::id()));
        let _ = fs::remove_dir_all(&path);
        fs::create_dir_all(&path).unwrap();
        Folder(path)
    }

    pub fn file(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }

    fn names(&self) -> Vec<String> {
        let mut all: Vec<String> =
            fs::read_dir(&self.0).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        all.sort();
        all
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

pub fn open(path: &Path) -> Container {
    Container::open(Arc::new(FileSource::open(path).unwrap()), Limits::default()).unwrap()
}

pub fn map(path: &Path) -> Resident {
    let file = open(path);
    assert_eq!(file.verify(|e| panic!("{e}")).faults, 0);
    Map::new(file.structure(0).unwrap()).unwrap().preload().unwrap()
}

/// Depths from a closure over texels; what is asked is counted.
pub struct Closure<F> {
    pub projection: Projection,
    pub second: Second,
    pub key: &'static [u8],
    pub depths: F,
    pub asked: AtomicUsize,
}

impl<F: Fn(u32, u32) -> (f64, f64) + Sync> Closure<F> {
    pub fn new(resolution: u64, second: Second, depths: F) -> Self {
        let projection = Projection::image(resolution).unwrap();
        Closure { projection, second, key: b"closure", depths, asked: AtomicUsize::new(0) }
    }
}

impl<F: Fn(u32, u32) -> (f64, f64) + Sync> DepthSource for Closure<F> {
    fn name(&self) -> &str {
        "sun"
    }

    fn projection(&self) -> Projection {
        self.projection
    }

    fn second(&self) -> Second {
        self.second
    }

    fn key(&self) -> Vec<u8> {
        self.key.to_vec()
    }

    fn render(&self, square: Square, first: &mut [f64], second: &mut [f64]) -> Result<(), SourceError> {
        assert!(square.log2_side <= 8 && first.len() == square.texels() && second.len() == square.texels());
        self.asked.fetch_add(square.texels(), Ordering::Relaxed);
        for i in 0..square.texels() {
            let [x, y] = square.texel(i);
            (first[i], second[i]) = (self.depths)(x, y);
        }
        Ok(())
    }
}

/// Hills that rise in steps and slopes, with holes, some of them thin.
pub fn hills(x: u32, y: u32) -> (f64, f64) {
    if (x / 9 + y / 7).is_multiple_of(5) {
        return (f64::INFINITY, f64::INFINITY);
    }
    let first = f64::from(x / 16 * 5) + f64::from(y) * 0.125 + 3.0;
    let second = if (x + y).is_multiple_of(11) { first } else { first + f64::from((x / 8) % 4) + 0.5 };
    (first, if y.is_multiple_of(13) { f64::INFINITY } else { second })
}

/// The centre rays of a scene, by the exact oracle: an engine that renders without rounding.
struct Rays<'a> {
    oracle: Oracle<'a>,
    mesh: &'a SnappedMesh,
}

impl Rays<'_> {
    fn centre(&self, x: u32, y: u32) -> (umbrage::certify::Interval, bool) {
        let bits = self.mesh.lattice.subtexel_bits;
        self.oracle.ray([x, y].map(|v| (i64::from(v) << bits) + (1 << (bits - 1))))
    }
}

#[test]
fn stored_values_lie_in_the_centre_interval_of_a_scene() {
    let folder = Folder::new("centres");
    for (spec, resolution, policy) in [
        ("city:1:0.05", 512u64, Policy::Closed),
        ("scan:3:0.05", 256, Policy::Closed),
        ("forest:2:0.05", 64, Policy::Closed),
        ("scan:2:0.05", 128, Policy::SecondSurface),
        ("scan:2:0.05", 1, Policy::OneSided),
    ] {
        let mesh = scene::generated(spec).unwrap().unwrap();
        let k = frame::log2_resolution(resolution).unwrap();
        let lattice = frame::orthographic([0.4, -0.8, 0.3], k, &mesh.positions, 0.0).unwrap();
        let snapped = snap(&mesh, lattice, policy).unwrap();
        let rays = Rays { oracle: Oracle::new(&snapped), mesh: &snapped };
        let depths = |x, y| {
            let (i, thin) = rays.centre(x, y);
            if i.min == u32::MAX {
                return (f64::INFINITY, f64::INFINITY);
            }
            let end = u64::from(i.max) + u64::from(!thin);
            (f64::from(i.min), if end >= u64::from(u32::MAX) { f64::INFINITY } else { end as f64 })
        };
        let second = match policy {
            Policy::SecondSurface => Second::NextSurface,
            Policy::OneSided => Second::Absent,
            _ => Second::Exit,
        };
        let mut source = Closure::new(resolution, second, depths);
        source.projection = Projection::of_lattice(&lattice);
        let target = folder.file("map.umb");
        let baked = bake_layers(&[&source], &LayersOptions::default(), &target, &Progress::default()).unwrap();
        assert_eq!(source.asked.into_inner() as u64, resolution * resolution, "once for each texel");
        let map = map(&target);
        let (mut thin, mut covered) = (0, 0);
        for (x, y) in (0..resolution as u32).flat_map(|y| (0..resolution as u32).map(move |x| (x, y))) {
            let (interval, is_thin) = rays.centre(x, y);
            assert!(interval.contains(map.value(x, y, 0)), "{spec} {x} {y}: {interval:?}");
            thin += u64::from(is_thin);
            covered += u64::from(interval.min < u32::MAX);
        }
        assert!(covered > 0, "{spec}");
        let file = open(&target);
        let structure = file.structure(0).unwrap();
        let r = structure.record();
        assert_eq!(
            (r.edge_texels.get(), baked.lights[0].counts.thin_texels),
            (resolution * resolution, r.thin_texels.get())
        );
        if second != Second::Absent {
            assert_eq!(r.thin_texels.get(), thin, "{spec}");
        }
        assert_eq!(structure.lattice(), lattice);
        assert!(r.is_from_layers() && r.guarantee_words().contains("texel centres"), "{}", r.guarantee_words());
        assert_eq!(r.guarantee_words().contains("surfaces of the baked scene"), second == Second::NextSurface);
    }
}

/// A ball of radius 1 over a plate, by the light's own axes: an engine that computes depth analytically.
#[test]
fn receivers_on_centre_rays_are_answered_without_bias() {
    let folder = Folder::new("ball");
    let direction = [0.3, -0.9, 0.2];
    let projection = Projection::orthographic(direction, [-2.0; 3], [2.0; 3], 256).unwrap();
    let [_, _, z] = frame::axes(direction).unwrap();
    let dot = |a: [f64; 3], b: [f64; 3]| (0..3).map(|i| a[i] * b[i]).sum::<f64>();
    let world = |column: f64, row: f64, depth: f64| {
        // rows of the projection are orthogonal: solve by projecting back
        let [x, y, _] = projection.world_to_layers;
        let unit = |r: [f64; 4]| [0, 1, 2].map(|i| r[i] / dot([r[0], r[1], r[2]], [r[0], r[1], r[2]]));
        let (ux, uy) = (unit(x), unit(y));
        [0, 1, 2].map(|i| ux[i] * (column - x[3]) + uy[i] * (row - y[3]) + z[i] * depth)
    };
    // the plate fills -1.5 <= y <= -1.2
    let stretches = |x: u32, y: u32| {
        let o = world(f64::from(x) + 0.5, f64::from(y) + 0.5, 0.0);
        let (top, bottom) = ((-1.2 - o[1]) / z[1], (-1.5 - o[1]) / z[1]);
        let d = dot(o, z);
        let disc = d * d - dot(o, o) + 1.0;
        let ball = (disc > 0.0).then(|| (-d - disc.sqrt(), -d + disc.sqrt()));
        (ball, (top, bottom))
    };
    let depths = |x: u32, y: u32| match stretches(x, y) {
        (Some((a, b)), (top, bottom)) => {
            if top <= b {
                (a, bottom.max(b))
            } else {
                (a, b)
            }
        }
        (None, plate) => plate,
    };
    let mut source = Closure::new(256, Second::Exit, depths);
    source.projection = Projection { depth: DepthScale::Between(-8.0, 8.0), ..projection };
    let target = folder.file("ball.umb");
    bake_layers(&[&source], &LayersOptions::default(), &target, &Progress::default()).unwrap();
    let map = Map::new(open(&target).structure_named("sun").unwrap()).unwrap();
    // far above the steps of the depth lattice and the error of the transform, far below any bias
    let little = 1e-7;
    let mut seen = [0; 2];
    for (x, y) in (0..256).flat_map(|y| (0..256).map(move |x| (x, y))) {
        let (first, second) = depths(x, y);
        for (depth, lit) in
            [(first - little, true), (first - 1.0, true), (second + little, false), (second + 2.0, false)]
        {
            let answer = map.visibility(world(f64::from(x) + 0.5, f64::from(y) + 0.5, depth), 0).unwrap();
            assert_eq!((answer.inside, answer.lit), (true, lit), "{x} {y} {depth}");
            seen[usize::from(lit)] += 1;
        }
    }
    assert_eq!(seen, [131072; 2]);
}

#[test]
fn the_certificate_catches_a_wrong_value() {
    let folder = Folder::new("certificate");
    let target = folder.file("map.umb");
    for second in [Second::Exit, Second::NextSurface, Second::Absent] {
        let source = Closure::new(64, second, hills);
        bake_layers(&[&source], &LayersOptions::default(), &target, &Progress::default()).unwrap();
        let map = map(&target);
        let layers = LatticeLayers::new(&source, &|| true).unwrap();
        let square = Square { origin: [0, 0], log2_side: 6 };
        let wrong = |stored: &dyn Fn(u32, u32) -> u32| {
            let mut tally = LayersTally::default();
            check(&layers, square, 0, stored, &mut tally, |_, _| {}).unwrap();
            tally.wrong
        };
        assert_eq!(wrong(&|x, y| map.value(x, y, 0)), 0, "{second:?}");
        // a value one step before the first surface, and one step behind the stretch
        for (x, y) in (0..64).flat_map(|y| (0..64).map(move |x| (x, y))).filter(|(x, y)| hills(*x, *y).0.is_finite()) {
            let (first, back) = hills(x, y);
            let entry = layers.depth(first).ceil() as u32;
            let other = |v: u32| move |i: u32, j: u32, real: u32| if (i, j) == (x, y) { v } else { real };
            let early = other(entry - 1);
            assert_eq!(wrong(&|i, j| early(i, j, map.value(i, j, 0))), 1);
            if second == Second::Absent || back.is_finite() {
                let end = if second == Second::Absent { first } else { back };
                let late = other((layers.depth(end).ceil() as u32).max(entry + 1));
                assert_eq!(wrong(&|i, j| late(i, j, map.value(i, j, 0))), 1);
            }
        }
    }
}

#[test]
fn bytes_do_not_depend_on_threads_and_ids_depend_on_key_and_options() {
    let folder = Folder::new("ids");
    let bake = |name: &str, threads: usize, key: &'static [u8], second: Second, resolution: u64| {
        let source = Closure { key, ..Closure::new(resolution, second, hills) };
        let target = folder.file(name);
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let run = || bake_layers(&[&source], &LayersOptions::default(), &target, &Progress::default()).unwrap();
        let id = pool.install(run).file_id;
        (id, fs::read(target).unwrap())
    };
    let one = bake("one.umb", 1, b"a", Second::Exit, 1024);
    assert!(one.1.len() > 65536, "{}", one.1.len());
    for threads in [2, 3] {
        assert!(bake("two.umb", threads, b"a", Second::Exit, 1024) == one, "{threads} threads");
    }
    let mut ids = vec![one.0];
    ids.push(bake("key.umb", 2, b"b", Second::Exit, 1024).0);
    ids.push(bake("empty.umb", 2, b"", Second::Exit, 1024).0);
    ids.push(bake("meaning.umb", 2, b"a", Second::NextSurface, 1024).0);
    ids.push(bake("resolution.umb", 2, b"a", Second::Exit, 512).0);
    assert_eq!(*open(&folder.file("key.umb")).file_id(), ids[1]);
    ids.sort();
    ids.dedup();
    assert_eq!(ids.len(), 5);
}

#[test]
fn a_bake_that_ends_early_leaves_the_old_target_and_nothing_else() {
    let folder = Folder::new("early");
    let target = folder.file("map.umb");
    fs::write(&target, "old").unwrap();
    let unharmed =
        || assert_eq!((folder.names(), fs::read(&target).unwrap()), (vec!["map.umb".to_string()], b"old".to_vec()));
    // cancelled before, while the range is sought, and while tiles are rendered
    for after in [0, 300_000, 1_500_000] {
        for depth in [DepthScale::Found, DepthScale::Between(0.0, 400.0)] {
            let progress = Progress::default();
            let asked = AtomicUsize::new(0);
            let depths = |x, y| {
                if asked.fetch_add(1, Ordering::Relaxed) >= after {
                    progress.cancel.store(true, Ordering::Relaxed);
                }
                hills(x % 256, y % 256)
            };
            let mut source = Closure::new(2048, Second::Exit, depths);
            source.projection.depth = depth;
            let e = bake_layers(&[&source], &LayersOptions::default(), &target, &progress).unwrap_err();
            assert!(matches!(e, LayersError::Bake(BakeError::Cancelled)), "{e}");
            assert!(source.asked.into_inner() < after + 8 * 65536);
            unharmed();
        }
    }
    // the source gives up
    struct Lost(Projection);
    impl DepthSource for Lost {
        fn name(&self) -> &str {
            "sun"
        }
        fn projection(&self) -> Projection {
            self.0
        }
        fn second(&self) -> Second {
            Second::Exit
        }
        fn key(&self) -> Vec<u8> {
            Vec::new()
        }
        fn render(&self, square: Square, first: &mut [f64], _: &mut [f64]) -> Result<(), SourceError> {
            first.fill(1.0);
            if square.origin == [512, 256] { Err("device lost".into()) } else { Ok(()) }
        }
        fn bytes(&self) -> u64 {
            1 << 40
        }
    }
    for depth in [DepthScale::Found, DepthScale::Between(0.0, 2.0)] {
        let lost = Lost(Projection { depth, ..Projection::image(1024).unwrap() });
        let e = bake_layers(&[&lost], &LayersOptions::default(), &target, &Progress::default()).unwrap_err();
        assert!(e.to_string().contains("device lost") && e.to_string().contains("512, 256"), "{e}");
        unharmed();
        let budget = LayersOptions { memory_bytes: Some(1 << 30), ..LayersOptions::default() };
        let e = bake_layers(&[&lost], &budget, &target, &Progress::default()).unwrap_err();
        assert!(matches!(e, LayersError::Bake(BakeError::Memory { needed, .. }) if needed > 1 << 40), "{e}");
        unharmed();
    }
    // two of one name, none at all
    let a = Closure::new(4, Second::Exit, hills);
    for sources in [&[&a as &dyn DepthSource, &a][..], &[]] {
        let e = bake_layers(sources, &LayersOptions::default(), &target, &Progress::default()).unwrap_err();
        assert!(matches!(e, LayersError::Bake(BakeError::Name { .. })), "{e}");
        unharmed();
    }
}

#[test]
fn impossible_depths_are_named_with_their_texel() {
    let folder = Folder::new("impossible");
    let target = folder.file("map.umb");
    let (inf, nan) = (f64::INFINITY, f64::NAN);
    let cases = [
        ((nan, 1.0), "expected numbers"),
        ((1.0, nan), "expected numbers"),
        ((-inf, 1.0), "expected a depth"),
        ((2.0, 1.0), "not to lie before the first"),
        ((inf, 1.0), "no second surface where there is no first"),
        ((2.5, 3.0), "state a wider one"),
        ((1.0, 2.5), "state a wider one"),
        ((-0.5, 2.0), "state a wider one"),
    ];
    for ((first, second), says) in cases {
        for depth in [DepthScale::Found, DepthScale::Between(0.0, 2.0)] {
            let depths = |x, y| if (x, y) == (300, 17) { (first, second) } else { (0.5, 1.5) };
            let mut source = Closure::new(512, Second::Exit, depths);
            source.projection.depth = depth;
            let done = bake_layers(&[&source], &LayersOptions::default(), &target, &Progress::default());
            if depth == DepthScale::Found && says.contains("wider") {
                done.unwrap();
                fs::remove_file(&target).unwrap();
                continue;
            }
            let e = done.unwrap_err().to_string();
            assert!(e.contains("texel (300, 17)") && e.contains(says), "{e}");
            assert!(!target.exists());
        }
    }
    let mut source = Closure::new(4, Second::Exit, |_, _| (1.0, 2.0));
    source.projection.world_to_layers[1] = [0.0; 4];
    let e = bake_layers(&[&source], &LayersOptions::default(), &target, &Progress::default()).unwrap_err();
    assert!(matches!(e, LayersError::Projection { .. }), "{e}");
}
