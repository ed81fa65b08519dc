//! Scenes through the whole of writer, file and reader: what is in the file is what the oracle allows, what the records
//! say of their pages is what lookups find, and the early ends of the builder cost next to nothing.

use std::path::PathBuf;
use std::sync::Arc;

use rayon::prelude::*;
use umbrage::certify::{Oracle, Region};
use umbrage::format::Kind;
use umbrage::reader::query::{Map, Resident};
use umbrage::reader::{Container, FileSource, Limits, MemorySource};
use umbrage::writer::bake::{BakeOptions, Baked, Light, bake};
use umbrage::writer::scene;
use umbrage::writer::solid::Policy;

/// A baked file in a folder of its own.
struct File {
    folder: PathBuf,
    baked: Baked,
}

impl File {
    fn bake(name: &str, spec: &str, resolution: u64, policy: Policy, exhaustive: bool) -> Self {
        let folder = std::env::temp_dir().join(format!("umbrage-round-trip-{name}-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let mesh = scene::generated(spec).unwrap().unwrap();
        let options = BakeOptions {
            lights: vec![Light { name: "sun".to_string(), direction: [0.4, -0.8, 0.3] }],
            resolution,
            policy,
            kind: Kind::Mh,
            exhaustive,
            top_down: false,
            mmh: Default::default(),
            memory_bytes: None,
            cold: false,
        };
        let baked = bake(&mesh, &options, &folder.join("map.umb"), &Default::default()).unwrap();
        File { folder, baked }
    }

    fn on_disk(&self) -> Map {
        let source = FileSource::open(&self.folder.join("map.umb")).unwrap();
        map(&Container::open(Arc::new(source), Limits::default()).unwrap())
    }

    fn in_memory(&self) -> Resident {
        let bytes = std::fs::read(self.folder.join("map.umb")).unwrap();
        assert_eq!(bytes.len() as u64, self.baked.bytes);
        let file = Container::open(Arc::new(MemorySource::new(bytes, "memory")), Limits::default()).unwrap();
        assert_eq!(file.verify(|e| panic!("{e}")).faults, 0);
        map(&file).preload().unwrap()
    }

    fn nodes(&self) -> u64 {
        self.baked.lights[0].nodes.iter().sum()
    }
}

impl Drop for File {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.folder);
    }
}

fn map(file: &Container) -> Map {
    Map::new(file.structure_named("sun").unwrap()).unwrap()
}

#[test]
fn every_level_answers_and_level_0_is_what_the_oracle_allows() {
    for (name, spec, resolution, policy) in [
        ("one", "scan:1:0.05", 1, Policy::Closed),
        ("city", "city:1:0.05", 512, Policy::Closed),
        ("scan", "scan:1:0.05", 512, Policy::Auto),
        ("forest", "forest:2:0.05", 128, Policy::Closed),
        ("sheets", "scan:2:0.05", 64, Policy::OneSided),
        ("second", "scan:2:0.05", 128, Policy::SecondSurface),
    ] {
        let file = File::bake(name, spec, resolution, policy, false);
        let (disk, memory) = (file.on_disk(), file.in_memory());
        let side = disk.resolution();
        for level in 0..=side.ilog2() as u8 {
            for (x, y) in (0..side >> level).flat_map(|y| (0..side >> level).map(move |x| (x, y))) {
                let (x, y) = (x << level, y << level);
                assert_eq!(disk.texel(x, y, level).unwrap().value, memory.value(x, y, level), "{name} {x} {y} {level}");
            }
        }
        let region = Region { x: 0, y: 0, width: side, height: side };
        let truth = Oracle::new(&file.baked.last).check(region, |x, y| memory.value(x, y, 0));
        assert_eq!(truth.wrong, 0, "{name}: {:?}", truth.examples);
        let record = disk.structure().record();
        assert_eq!((record.edge_texels.get(), record.thin_texels.get()), (truth.edge(), truth.thin), "{name}");
        let nodes = record.leaf_nodes.get() + record.inner_nodes.get() + record.empty_nodes.get();
        assert_eq!((nodes, u64::from(record.page_count.get())), (file.nodes(), file.baked.lights[0].pages), "{name}");
    }
}

#[test]
fn ending_early_costs_at_most_one_node_in_a_hundred() {
    for resolution in [512, 1024] {
        let early = File::bake("proofs", "city:1:0.05", resolution, Policy::Closed, false);
        let all = File::bake("exhaustive", "city:1:0.05", resolution, Policy::Closed, true);
        let (nodes, least) = (early.nodes(), all.nodes());
        assert!(nodes * 100 <= least * 101 && least * 100 <= nodes * 101, "{resolution}: {nodes} against {least}");
        let [a, b] = [&early, &all].map(|f| f.baked.lights[0].counts);
        assert_eq!((a.edge_texels, a.thin_texels), (b.edge_texels, b.thin_texels));
        assert!(a.texels_evaluated < b.texels_evaluated);
    }
}

/// Squares of its components would be 0 or infinite.
#[test]
fn a_direction_of_any_length_becomes_a_unit_vector() {
    let directions = [1e-200, 1.0, 1e200].map(|length| [0.4, -0.8, 0.3].map(|c| c * length));
    for (i, direction) in directions.into_iter().enumerate() {
        let folder = crate::tree::Folder::new(&format!("direction-{i}"));
        let options = BakeOptions {
            lights: vec![Light { name: "sun".to_string(), direction }],
            resolution: 16,
            policy: Policy::Thickness(0.5),
            kind: umbrage::format::Kind::Mh,
            exhaustive: false,
            top_down: false,
            mmh: Default::default(),
            memory_bytes: None,
            cold: false,
        };
        let path = folder.0.join("map.umb");
        bake(&scene::generated("city:1:0.05").unwrap().unwrap(), &options, &path, &Default::default()).unwrap();
        let source = FileSource::open(&path).unwrap();
        let file = Container::open(Arc::new(source), Limits::default()).unwrap();
        assert_eq!(file.verify(|e| panic!("{e}")).faults, 0);
        let d = file.structure(0).unwrap().record().light_direction.map(|c| c.get());
        let squared: f64 = d.iter().map(|c| c * c).sum();
        assert!((squared - 1.0).abs() < 1e-15, "{d:?}");
    }
}

#[test]
fn records_say_what_lookups_in_their_page_find() {
    let file = File::bake("records", "city:1:0.05", 512, Policy::Closed, false);
    let (disk, memory, oracle) = (file.on_disk(), file.in_memory(), Oracle::new(&file.baked.last));
    let pages = disk.structure().page_count();
    assert!(pages > 3, "{pages}");
    let mut exact = 0;
    for ordinal in 0..pages {
        let r = disk.structure().page_record(ordinal).unwrap();
        let (x0, y0) = (r.origin_x.get(), r.origin_y.get());
        let square = |level: u8| {
            let side = 1u32 << (r.log2_x - level);
            (0..side * side).into_par_iter().map(move |i| (x0 + ((i % side) << level), y0 + ((i / side) << level)))
        };
        let value = |x, y, level| memory.value(x, y, level);
        let answers = |level| square(level).map(move |(x, y)| value(x, y, level)).map(|v| (v, v));
        let join = |a: (u32, u32), b: (u32, u32)| (a.0.min(b.0), a.1.max(b.1));
        let range = (0..=r.level_coarsest).map(|l| answers(l).reduce(|| (u32::MAX, 0), join));
        let found = range.fold((u32::MAX, 0), join);
        assert_eq!((r.min_depth.get(), r.max_depth.get()), found, "depths of page {ordinal}");
        if ordinal == 0 {
            assert_eq!(r.stop_error.get(), u32::MAX, "nothing answers in place of the root");
            continue;
        }
        let above = memory.value(x0, y0, r.log2_x);
        let away = |(x, y)| {
            let i = oracle.texel(x, y).interval;
            i.min.saturating_sub(above).max(above.saturating_sub(i.max))
        };
        let worst = square(0).map(away).max().unwrap();
        // The builder's intervals may be narrower than the truth, so it may state more, never less.
        assert!(r.stop_error.get() >= worst, "page {ordinal}: {} for {worst}", r.stop_error.get());
        exact += u32::from(r.stop_error.get() == worst);
    }
    assert!(exact * 2 > pages - 1, "{exact} of {pages} errors are exact");
}
