//! Kind `mmh` as a whole: a scene is baked, and no stored value lies outside its interval.

use umbrage::format::Kind;
use umbrage::format::projection::Lattice;
use umbrage::reader::query::Map;
use umbrage::writer::bake::{BakeOptions, Baked, Light, bake};
use umbrage::writer::hierarchy::mmh;
use umbrage::writer::solid::Policy;

use crate::golden::open;
use crate::tree::Folder;

fn baked(folder: &Folder, name: &str, kind: Kind, search: u32, resolution: u64) -> (Baked, Vec<u8>) {
    baked_by(folder, name, (kind, false), search, resolution)
}

/// The same, with values top-down or not.
fn baked_by(
    folder: &Folder,
    name: &str,
    (kind, top_down): (Kind, bool),
    search: u32,
    resolution: u64,
) -> (Baked, Vec<u8>) {
    let mesh = umbrage::writer::scene::generated("city:3:0.05").unwrap().unwrap();
    let options = BakeOptions {
        lights: vec![Light { name: "sun".into(), direction: [0.4, -0.8, 0.3] }],
        resolution,
        policy: Policy::Closed,
        kind,
        exhaustive: false,
        top_down,
        mmh: mmh::Options { search },
        memory_bytes: None,
        cold: false,
    };
    let path = folder.0.join(name);
    let baked = bake(&mesh, &options, &path, &Default::default()).unwrap();
    (baked, std::fs::read(path).unwrap())
}

/// The certificate's oracle, which shares no code with the baker, on every texel; and every stop error.
#[test]
fn no_merge_brings_a_value_out_of_its_interval() {
    let folder = Folder::new("mmh-city");
    // Top-down, as the command line does.
    let (report, bytes) = baked_by(&folder, "city.umb", (Kind::Mmh, true), 1000, 1024);
    let merged = report.lights[0].merged.clone().unwrap();
    let merges: u64 = merged.pairs.iter().map(|p| p.merged).sum();
    assert!(merges > 1000 && merged.shared_pages > 0, "{merged:?}");
    let file = open(bytes, Default::default()).unwrap();
    assert_eq!(file.verify(|e| panic!("{e}")).faults, 0);
    let structure = file.structure(0).unwrap();
    let oracle = umbrage::certify::Oracle::new(&report.last).with_guard(structure.record().depth_guard.get());
    let (tree_pages, lattice): (u32, Lattice) = (structure.record().tree_pages(), structure.lattice());
    let map = Map::new(structure).unwrap();
    let resident = map.preload().unwrap();
    let region = umbrage::certify::Region { x: 0, y: 0, width: lattice.resolution(), height: lattice.resolution() };
    let tally = oracle.check(region, |x, y| resident.value(x, y, 0));
    assert_eq!((tally.texels, tally.wrong), (1 << 20, 0), "{:?}", tally.examples);
    // The oracle sees what merging could break: a value a step beyond a shared leaf's interval is found.
    let shared =
        (0..1 << 20).map(|i| [i % 1024, i / 1024]).find(|[x, y]| map.texel(*x, *y, 0).unwrap().page >= tree_pages);
    let [x, y] = shared.unwrap();
    let max = oracle.texel(x, y).interval.max;
    let off = oracle.check(region, |a, b| if [a, b] == [x, y] { max + 1 } else { resident.value(a, b, 0) });
    assert_eq!(off.wrong, 1);
    // What pages state of the depths of their answers holds for shared groups, which no rule of the format sees.
    for ordinal in 1..tree_pages {
        let r = map.structure().page_record(ordinal).unwrap();
        let (x, y, side) = (r.origin_x.get(), r.origin_y.get(), 1u32 << r.log2_x);
        let answers = (0..side * side).map(|i| resident.value(x + i % side, y + i / side, 0));
        let (low, high) = answers.fold((u32::MAX, 0), |(low, high), v| (low.min(v), high.max(v)));
        assert!(r.min_depth.get() <= low && high <= r.max_depth.get(), "page {ordinal}");
    }
}

/// Merging changes where values lie and which of several right ones is stored, not how many are right.
#[test]
fn the_search_distance_trades_bytes_and_no_search_merges_nothing() {
    let folder = Folder::new("mmh-search");
    let (mh, _) = baked(&folder, "mh.umb", Kind::Mh, 1000, 2048);
    let sizes: Vec<u64> = [0, 1, 10, 1000]
        .map(|s| {
            let (report, _) = baked(&folder, "a.umb", Kind::Mmh, s, 2048);
            let merged = report.lights[0].merged.clone().unwrap();
            assert_eq!(merged.words_merged == merged.words_before, s == 0);
            let nodes: u64 = report.lights[0].nodes.iter().sum();
            assert_eq!(nodes == mh.lights[0].nodes.iter().sum::<u64>(), s == 0);
            report.bytes
        })
        .to_vec();
    assert!(sizes.windows(2).all(|w| w[0] > w[1]), "{sizes:?}");
    assert!(sizes[3] * 10 < mh.bytes * 8, "{sizes:?} of {}", mh.bytes);
}

/// The same bytes on any number of threads.
#[test]
fn threads_change_nothing() {
    let folder = Folder::new("mmh-threads");
    let files = [1, 3].map(|n| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n).build().unwrap();
        pool.install(|| baked(&folder, "a.umb", Kind::Mmh, 100, 512).1)
    });
    assert!(files[0] == files[1]);
}
