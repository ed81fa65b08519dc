//! OpenEXR files as depth layers: the same tree as from a callback with the same numbers, whatever type, compression and
//! names; hostile files end in an error; the command line says what is wrong in one line.

use std::fs;
use std::path::Path;

use exr::prelude::*;
use umbrage::writer::bake::BakeError;
use umbrage::writer::hierarchy::build::Progress;
use umbrage::writer::hierarchy::layers::build;
use umbrage::writer::hierarchy::spool::Spool;
use umbrage::writer::layers::openexr::{ExrError, ExrLayers, ExrOptions, Placement, is_decoding};
use umbrage::writer::layers::{DepthSource, LatticeLayers, LayersError, LayersOptions, Second, Square, bake_layers};

use crate::cli::Place;
use crate::layers::{Closure, Folder, hills, map, open};

const ZIP: Encoding =
    Encoding { compression: Compression::ZIP16, blocks: Blocks::ScanLines, line_order: LineOrder::Increasing };

/// Channels of one part of a file.
fn part(
    size: (usize, usize),
    name: Option<&str>,
    encoding: Encoding,
    channels: Vec<(&str, FlatSamples)>,
) -> Layer<AnyChannels<FlatSamples>> {
    let list = channels.into_iter().map(|(name, samples)| AnyChannel::new(name, samples)).collect();
    let attributes = name.map_or(LayerAttributes::default(), LayerAttributes::named);
    Layer::new(size, attributes, encoding, AnyChannels::sort(list))
}

fn write(path: &Path, parts: Vec<Layer<AnyChannels<FlatSamples>>>) {
    let window = IntegerBounds::from_dimensions(parts[0].size);
    Image::from_layers(ImageAttributes::new(window), parts).write().non_parallel().to_file(path).unwrap();
}

/// The depths of a function, row by row.
fn plane(side: u32, second: bool, f: impl Fn(u32, u32) -> (f64, f64)) -> Vec<f64> {
    let at = |x, y| if second { f(x, y).1 } else { f(x, y).0 };
    (0..side).flat_map(|y| (0..side).map(move |x| (x, y))).map(|(x, y)| at(x, y)).collect()
}

fn floats(v: &[f64]) -> FlatSamples {
    FlatSamples::F32(v.iter().map(|d| *d as f32).collect())
}

fn halves(v: &[f64]) -> FlatSamples {
    FlatSamples::F16(v.iter().map(|d| f16::from_f64(*d)).collect())
}

fn uints(v: &[f64]) -> FlatSamples {
    FlatSamples::U32(v.iter().map(|d| if d.is_finite() { *d as u32 } else { u32::MAX }).collect())
}

fn options(first: &Path) -> ExrOptions {
    ExrOptions { first: first.to_path_buf(), ..ExrOptions::default() }
}

fn read(options: &ExrOptions) -> std::result::Result<ExrLayers, LayersError> {
    ExrLayers::read("sun", options, &|| true)
}

/// Lattice and words of every page.
fn tree(source: &dyn DepthSource, target: &Path) -> Vec<Vec<u32>> {
    bake_layers(&[source], &LayersOptions::default(), target, &Progress::default()).unwrap();
    let file = open(target);
    let s = file.structure(0).unwrap();
    let lattice = s
        .lattice()
        .world_to_lattice
        .iter()
        .flatten()
        .flat_map(|v| [v.to_bits() as u32, (v.to_bits() >> 32) as u32])
        .collect();
    let pages = (0..s.page_count()).map(|i| s.page(i).unwrap().words().to_vec());
    std::iter::once(lattice).chain(pages).collect()
}

#[test]
fn files_give_the_tree_of_a_callback_with_the_same_numbers() {
    let folder = Folder::new("exr-tree");
    let (exr, umb) = (folder.file("layers.exr"), folder.file("map.umb"));
    const SIDE: u32 = 128;
    // exact in half, float and, rounded, in uint
    let whole = |x: u32, y: u32| {
        let (a, b) = hills(x, y);
        (a.floor(), b.floor())
    };
    let wanted = tree(&Closure::new(SIDE.into(), Second::Exit, hills), &umb);
    let wanted_whole = tree(&Closure::new(SIDE.into(), Second::Exit, whole), &umb);
    assert!(wanted[1].len() > 1000 && wanted != wanted_whole);
    use Compression::*;
    let tiles = Blocks::Tiles(Vec2(32, 48));
    let mut keys = Vec::new();
    for compression in [Uncompressed, RLE, ZIP1, ZIP16, PIZ, PXR24, B44, B44A] {
        for blocks in [Blocks::ScanLines, tiles] {
            type Samples = fn(&[f64]) -> FlatSamples;
            let types: [(Samples, bool, bool); 3] = [
                (floats, false, compression != PXR24),
                (halves, false, !matches!(compression, B44 | B44A)),
                (uints, true, true),
            ];
            for (samples, rounded, lossless) in types {
                if !lossless {
                    continue;
                }
                let encoding = Encoding { compression, blocks, line_order: LineOrder::Increasing };
                let f = if rounded { whole } else { hills as fn(u32, u32) -> (f64, f64) };
                let channels = vec![
                    ("A", halves(&vec![1.0; (SIDE * SIDE) as usize])),
                    ("Z", samples(&plane(SIDE, false, f))),
                    ("ZBack", samples(&plane(SIDE, true, f))),
                ];
                write(&exr, vec![part((128, 128), None, encoding, channels)]);
                let layers = read(&options(&exr)).unwrap_or_else(|e| panic!("{compression:?} {blocks:?}: {e}"));
                assert_eq!(layers.second(), Second::Exit);
                let wanted = if rounded { &wanted_whole } else { &wanted };
                assert!(tree(&layers, &umb) == *wanted, "{compression:?} {blocks:?}");
                keys.push((rounded, layers.key()));
            }
        }
    }
    // the key is of the numbers, not of their encoding
    keys.sort();
    keys.dedup();
    assert_eq!(keys.len(), 2);
}

#[test]
fn lossy_compression_changes_depths_by_little() {
    let folder = Folder::new("exr-lossy");
    let exr = folder.file("layers.exr");
    let exact = plane(64, false, hills);
    // PXR24 keeps 15 bits behind the point of a float.
    let most = 2.0f64.powi(-15);
    let encoding = Encoding { compression: Compression::PXR24, ..ZIP };
    write(&exr, vec![part((64, 64), None, encoding, vec![("Z", floats(&exact))])]);
    let layers = read(&options(&exr)).unwrap();
    let square = Square { origin: [0, 0], log2_side: 6 };
    let [mut first, mut second] = [(); 2].map(|()| vec![f64::INFINITY; square.texels()]);
    layers.render(square, &mut first, &mut second).unwrap();
    for (found, exact) in first.iter().zip(&exact) {
        assert!(found == exact || (found - exact).abs() <= most * exact, "{found} {exact}");
    }
    assert!(second.iter().all(|d| *d == f64::INFINITY));
}

#[test]
fn channels_are_found_by_the_usual_names() {
    let folder = Folder::new("exr-names");
    let (exr, other, umb) = (folder.file("layers.exr"), folder.file("second.exr"), folder.file("map.umb"));
    let (first, second) = (|| floats(&plane(16, false, hills)), || floats(&plane(16, true, hills)));
    let size = (16, 16);
    let peeled = tree(&Closure::new(16, Second::NextSurface, hills), &umb);
    let single = tree(&Closure::new(16, Second::Absent, hills), &umb);
    let nothing_behind = tree(&Closure::new(16, Second::NextSurface, |x, y| (hills(x, y).0, f64::INFINITY)), &umb);
    assert!(peeled != single && single != nothing_behind);
    let same = |o: &ExrOptions, meaning, wanted: &Vec<Vec<u32>>| {
        let layers = read(o).unwrap();
        assert_eq!(layers.second(), meaning);
        assert!(tree(&layers, &umb) == *wanted, "{o:?}");
    };
    let next = Second::NextSurface;
    // one part, and a part for each
    write(&exr, vec![part(size, None, ZIP, vec![("first.Z", first()), ("second.Z", second())])]);
    same(&options(&exr), next, &peeled);
    write(
        &exr,
        vec![
            part(size, Some("first"), ZIP, vec![("Z", first())]),
            part(size, Some("second"), ZIP, vec![("Z", second())]),
        ],
    );
    same(&options(&exr), next, &peeled);
    // a file for each, with the names that a renderer gives
    write(&exr, vec![part(size, None, ZIP, vec![("R", second()), ("View Layer.Depth.Z", first())])]);
    write(&other, vec![part(size, None, ZIP, vec![("Z", second())])]);
    same(&ExrOptions { second: Some(other.clone()), ..options(&exr) }, next, &peeled);
    same(&options(&exr), Second::Absent, &single);
    same(&ExrOptions { meaning: Some(next), ..options(&exr) }, next, &nothing_behind);
    let absent = Some(Second::Absent);
    same(&ExrOptions { second: Some(other.clone()), meaning: absent, ..options(&exr) }, Second::Absent, &single);
    // by any name, when told
    write(&exr, vec![part(size, None, ZIP, vec![("near", first()), ("far", second()), ("Z", second())])]);
    let told = Some(("near".to_string(), Some("far".to_string())));
    same(&ExrOptions { channels: told.clone(), ..options(&exr) }, next, &peeled);
    same(&ExrOptions { channels: Some(("near".to_string(), None)), ..options(&exr) }, Second::Absent, &single);
    assert!(read(&ExrOptions { channels: told, second: Some(other), ..options(&exr) }).is_err());
    // from where on there is nothing
    let far = plane(16, false, |x, y| (if x == y { 65504.0 } else { hills(x, y).0.min(1e10) }, 0.0));
    write(&exr, vec![part(size, None, ZIP, vec![("Z", floats(&far))])]);
    let mut depths = Vec::new();
    for far in [None, Some(65504.0)] {
        let layers = read(&ExrOptions { far, ..options(&exr) }).unwrap();
        bake_layers(&[&layers], &LayersOptions::default(), &umb, &Progress::default()).unwrap();
        depths.push(map(&umb).value(3, 3, 0));
    }
    assert!(depths[0] < u32::MAX && depths[1] == u32::MAX, "{depths:?}");
}

#[test]
fn the_headers_matrices_place_the_layers_in_the_world() {
    let folder = Folder::new("exr-place");
    let (exr, umb) = (folder.file("layers.exr"), folder.file("map.umb"));
    let mut p = part((16, 16), None, ZIP, vec![("Z", floats(&plane(16, false, hills)))]);
    // A display window of 32 x 32 at (-8, 0) whose data begin at (0, 8); the camera looks along -y from y = 100.
    p.attributes.layer_position = Vec2(0, 8);
    // x right = world x, up = -world z, so rows go down along +z; ndc = 0.5 + x / 64, 0.5 + z / 64: 64 units across
    #[rustfmt::skip]
    let ndc = [
        1.0 / 64.0, 0.0, 0.0, 0.0,
        0.0, 0.0, 0.0, 0.0,
        0.0, 1.0 / 64.0, 0.0, 0.0,
        0.5, 0.5, 0.0, 1.0,
    ];
    #[rustfmt::skip]
    let camera = [
        1.0, 0.0, 0.0, 0.0,
        0.0, 0.0, -1.0, 0.0,
        0.0, -1.0, 0.0, 0.0,
        0.0, 0.0, 100.0, 1.0,
    ];
    p.attributes.world_to_normalized_device = Some(ndc);
    p.attributes.world_to_camera = Some(camera);
    let write = |p: &Layer<AnyChannels<FlatSamples>>| {
        let window = IntegerBounds::new((-8, 0), (32, 32));
        Image::from_layers(ImageAttributes::new(window), vec![p.clone()]).write().non_parallel().to_file(&exr).unwrap();
    };
    write(&p);
    let layers = read(&options(&exr)).unwrap();
    // The world's origin is the middle of the display window: pixel (8, 16), which is texel (8, 8).
    assert_eq!(
        layers.projection().world_to_layers,
        [[0.5, 0.0, 0.0, 8.0], [0.0, 0.0, 0.5, 8.0], [0.0, -1.0, 0.0, 100.0]]
    );
    bake_layers(&[&layers], &LayersOptions::default(), &umb, &Progress::default()).unwrap();
    let file = open(&umb);
    let map = umbrage::reader::query::Map::new(file.structure(0).unwrap()).unwrap();
    assert_eq!(map.structure().record().light_direction.map(|c| c.get()), [0.0, -1.0, 0.0]);
    for (x, y) in (0..16).flat_map(|y| (0..16).map(move |x| (x, y))) {
        let first = hills(x, y).0;
        let depth = first.min(50.0);
        for (d, lit) in [(depth - 1e-3, true), (depth + 1e-3, false)] {
            let p = [f64::from(x) * 2.0 - 15.0, 100.0 - d, f64::from(y) * 2.0 - 15.0];
            let answer = map.visibility(p, 0).unwrap();
            assert_eq!((answer.inside, answer.lit), (true, lit || first.is_infinite()), "{x} {y}");
        }
    }
    // Image space on demand, and where one matrix is missing.
    let image = read(&ExrOptions { placement: Placement::Image, ..options(&exr) }).unwrap();
    assert_eq!(image.projection().world_to_layers[0], [1.0, 0.0, 0.0, 0.0]);
    assert!(image.key() == layers.key());
    let boxed = Placement::Box { direction: [0.0, -1.0, 0.0], low: [-1.0; 3], high: [1.0; 3] };
    let boxed = read(&ExrOptions { placement: boxed, ..options(&exr) }).unwrap();
    assert_eq!(boxed.projection().direction().unwrap(), [0.0, -1.0, 0.0]);
    p.attributes.world_to_camera = None;
    write(&p);
    let image = read(&options(&exr)).unwrap();
    assert!(image.projection().world_to_layers[0][0] == 1.0 && image.notes.iter().any(|n| n.contains("worldToCamera")));
    // A perspective view is none of ours.
    let mut perspective = camera;
    perspective[11] = 1.0;
    p.attributes.world_to_camera = Some(perspective);
    write(&p);
    let e = read(&options(&exr)).err().unwrap().to_string();
    assert!(e.contains("orthographic") && e.contains("--image-space"), "{e}");
}

#[test]
fn cut_and_damaged_files_are_errors() {
    let folder = Folder::new("exr-hostile");
    let exr = folder.file("layers.exr");
    for (compression, blocks) in [
        (Compression::Uncompressed, Blocks::ScanLines),
        (Compression::ZIP16, Blocks::Tiles(Vec2(8, 8))),
        (Compression::PIZ, Blocks::ScanLines),
        (Compression::RLE, Blocks::ScanLines),
        (Compression::PXR24, Blocks::ScanLines),
        (Compression::B44, Blocks::ScanLines),
    ] {
        let encoding = Encoding { compression, blocks, line_order: LineOrder::Increasing };
        let channels = vec![("Z", floats(&plane(16, false, hills))), ("ZBack", halves(&plane(16, true, hills)))];
        write(&exr, vec![part((16, 16), None, encoding, channels)]);
        let whole = fs::read(&exr).unwrap();
        read(&options(&exr)).unwrap();
        for n in (0..whole.len()).filter(|n| *n < 64 || n % 7 == 0 || n + 64 > whole.len()) {
            fs::write(&exr, &whole[..n]).unwrap();
            let e = read(&options(&exr)).err().unwrap_or_else(|| panic!("{compression:?}: {n} bytes are accepted"));
            assert!(matches!(e, LayersError::File(_)), "{n}: {e}");
            assert!(!e.to_string().contains('\n'), "{e:?}");
        }
        // What is still accepted must be safe to bake.
        for at in 0..whole.len() {
            let mut bytes = whole.clone();
            bytes[at] ^= [0x01, 0x80, 0xFF][at % 3];
            fs::write(&exr, &bytes).unwrap();
            if let Ok(layers) = read(&options(&exr))
                && let Ok(layers) = LatticeLayers::new(&layers, &|| true)
            {
                let _ = build(&layers, 0, Spool::in_memory(), &Progress::default());
            }
        }
    }
}

/// The decoder breaks off over some damaged B44 pixels: for callers that is an error like others. What the process does
/// about panics elsewhere stays as it was.
#[test]
fn panics_of_the_decoder_are_errors_and_nothing_else_is_silenced() {
    let place = Place::new("exr-panics");
    let encoding = Encoding { compression: Compression::B44, ..ZIP };
    write(&place.file("a.exr"), vec![part((64, 64), None, encoding, vec![("Z", halves(&plane(64, false, hills)))])]);
    let whole = fs::read(place.file("a.exr")).unwrap();
    let broken = (whole.len() / 2..whole.len()).flat_map(|at| [0x00, 0xFF].map(|b| (at, b))).find(|(at, byte)| {
        let mut bytes = whole.clone();
        bytes[*at..].fill(*byte);
        fs::write(place.file("a.exr"), &bytes).unwrap();
        let e = read(&options(&place.file("a.exr"))).err();
        assert!(!is_decoding());
        e.is_some_and(|e| e.to_string().contains("its pixels can't be decoded"))
    });
    if broken.is_some() {
        let line = place.refused(3, &["bake", "a.exr", "--light", "sun", "-o", "new.umb"]);
        assert!(line.contains("its pixels can't be decoded"), "{line}");
    }
    assert!(broken.is_some(), "the decoder no longer panics: `guarded` may go");
}

/// Overwrites the data window in a header.
fn declare(bytes: &mut [u8], last: [i32; 2]) {
    let name = b"dataWindow\0box2i\0";
    let at = bytes.windows(name.len()).position(|w| w == name).unwrap() + name.len() + 4;
    for (i, v) in [0, 0, last[0], last[1]].into_iter().enumerate() {
        bytes[at + 4 * i..][..4].copy_from_slice(&v.to_le_bytes());
    }
}

#[test]
fn sizes_that_the_file_cannot_hold_are_refused_before_allocation() {
    let folder = Folder::new("exr-huge");
    let exr = folder.file("layers.exr");
    for blocks in [Blocks::ScanLines, Blocks::Tiles(Vec2(8, 8))] {
        write(
            &exr,
            vec![part((16, 16), None, Encoding { blocks, ..ZIP }, vec![("Z", floats(&plane(16, false, hills)))])],
        );
        let mut bytes = fs::read(&exr).unwrap();
        // Without the count of chunks, which would contradict.
        let count = bytes.windows(11).position(|w| w == b"chunkCount\0").unwrap();
        bytes[count] = b'C';
        for (last, says) in [
            ([(1 << 24) - 1; 2], "declare"),
            ([(1 << 16) - 1; 2], "declare"),
            ([(1 << 25) - 1; 2], "power of two"),
            ([i32::MAX; 2], ""),
            ([16, 15], "17 x 16"),
            ([14, 14], "15 x 15"),
            ([-1, -1], ""),
        ] {
            declare(&mut bytes, last);
            fs::write(&exr, &bytes).unwrap();
            let e = read(&options(&exr)).err().unwrap_or_else(|| panic!("{last:?}")).to_string();
            assert!(e.contains(says) && e.contains("layers.exr"), "{last:?}: {e}");
        }
        // Few bytes may become many pixels, but never without the budget's leave.
        declare(&mut bytes, [4095; 2]);
        fs::write(&exr, &bytes).unwrap();
        let e = read(&ExrOptions { memory_bytes: Some(1 << 20), ..options(&exr) }).err().unwrap();
        assert!(matches!(e, LayersError::Bake(BakeError::Memory { needed, .. }) if needed == 1 << 26), "{e}");
        let e = read(&options(&exr)).err().unwrap();
        assert!(matches!(e, LayersError::File(ExrError::Content { .. })), "{e}");
    }
}

#[test]
fn the_command_line_bakes_verifies_and_shows_layers() {
    let place = Place::new("exr-cli");
    let at = |name: &str| place.file(name);
    let (first, second) = (|| floats(&plane(64, false, hills)), || floats(&plane(64, true, hills)));
    write(&at("layers.exr"), vec![part((64, 64), None, ZIP, vec![("first.Z", first()), ("second.Z", second())])]);
    write(&at("first.exr"), vec![part((64, 64), None, ZIP, vec![("Z", first())])]);
    write(&at("back.exr"), vec![part((64, 64), None, ZIP, vec![("ZBack", second())])]);
    let said = place.fine(&["bake", "layers.exr", "-o", "a.umb", "--light", "sun"]);
    assert!(
        said.contains("next surface second.Z") && said.contains("image space") && said.contains("64 x 64"),
        "{said}"
    );
    place.fine(&["bake", "first.exr", "--second", "back.exr", "-o", "b.umb", "--light", "moon", "--threads", "1"]);
    let json = place.fine(&["bake", "first.exr", "--policy", "one-sided", "-o", "c.umb", "--light", "sun", "--json"]);
    assert!(json.starts_with('{') && json.contains("\"edge_texels\":4096"), "{json}");
    let box_of = ["--bounds", "-1,-1,-1,1,1,1", "--light", "sun=dir:0,-1,0"];
    place.fine(&[&["bake", "layers.exr", "-o", "d.umb"], &box_of[..]].concat());
    // dump, verify and query say what is promised
    for (file, policy, statics) in
        [("a.umb", "next surface", true), ("b.umb", "is left", false), ("c.umb", "alone", false)]
    {
        let dump = place.fine(&["dump", file]);
        assert!(dump.contains(policy) && dump.contains("rays through texel centres only"), "{dump}");
        assert_eq!(dump.contains("surfaces of the baked scene only"), statics, "{dump}");
        let verify = place.fine(&["verify", file]);
        assert!(verify.contains("promises to be right for receivers on rays through texel centres only"), "{verify}");
    }
    place.write("texels.csv", "x,y\n1,2\n");
    let out = place.run(&["query", "a.umb", "--texels", "texels.csv"]);
    let (stdout, stderr) = crate::cli::text(&out);
    assert!(
        out.status.success() && stderr.contains("texel centres only") && stdout.ends_with(",0\n"),
        "{stdout}{stderr}"
    );
    place.fine(&["dump", "a.umb", "--image", "a.png"]);
    // the certificate
    let all: [&[&str]; 4] = [
        &["a.umb", "--source", "layers.exr"],
        &["b.umb", "--source", "first.exr", "--second", "back.exr"],
        &["c.umb", "--source", "first.exr"],
        &["d.umb", "--source", "layers.exr", "--sample", "100"],
    ];
    for args in all {
        let said = place.fine(&[&["verify"], args].concat());
        // a sample is two squares here, one of them near borders
        let texels = if args.contains(&"--sample") { "4352" } else { "4096" };
        let held = format!(" {texels} texels held against");
        assert!(said.contains(&held) && said.contains(" 0 stored values outside"), "{said}");
    }
    let out = place.run(&["verify", "b.umb", "--source", "first.exr", "--second", "first.exr"]);
    assert_eq!(out.status.code(), Some(1), "{out:?}");
    // layers of two lights in one file
    place.fine(&["merge", "a.umb", "b.umb", "-o", "both.umb"]);
    place.fine(&["verify", "both.umb", "--source", "layers.exr", "--light", "sun"]);
    place.refused(3, &["verify", "a.umb", "--source", "scan:1:0.05"]);
    place.refused(3, &["query", "a.umb", "--texels", "texels.csv", "--source", "layers.exr"]);
    place.refused(3, &["render", "scan:1:0.05", "a.umb", "--camera", "1,2,3,0,0,0", "-o", "new.png"]);
}

#[test]
fn the_command_line_refuses_what_is_no_layers() {
    let place = Place::new("exr-errors");
    let at = |name: &str| place.file(name);
    let of = |side: usize| floats(&vec![1.0; side * side]);
    let one = |name: &str, size: (usize, usize), channels| write(&at(name), vec![part(size, None, ZIP, channels)]);
    one("fine.exr", (16, 16), vec![("Z", of(16))]);
    one("small.exr", (8, 8), vec![("Z", of(8))]);
    one("colour.exr", (4, 4), vec![("R", of(4)), ("G", of(4))]);
    one("flat.exr", (8, 2), vec![("Z", of(4))]);
    one("odd.exr", (12, 12), vec![("Z", of(12))]);
    one("two.exr", (4, 4), vec![("a.Z", of(4)), ("b.Z", of(4))]);
    let nan =
        |x: u32, y: u32| (if (x, y) == (5, 9) { f64::NAN } else { 1.0 }, if (x, y) == (3, 2) { 0.5 } else { 2.0 });
    one("nan.exr", (16, 16), vec![("Z", floats(&plane(16, false, nan)))]);
    one("order.exr", (16, 16), vec![("Z", of(16)), ("ZBack", floats(&plane(16, true, nan)))]);
    let whole = fs::read(at("fine.exr")).unwrap();
    place.write("cut.exr", &whole[..whole.len() - 3]);
    place.write("head.exr", &whole[..40]);
    place.write("text.exr", "not pixels");
    place.write("empty.exr", "");
    fs::create_dir(at("folder.exr")).unwrap();
    for (args, says) in [
        (&["missing.exr"][..], "give an OpenEXR file"),
        (&["folder.exr"], "folder.exr"),
        (&["text.exr"], "not an OpenEXR file"),
        (&["empty.exr"], "not an OpenEXR file"),
        (&["cut.exr"], "cut or damaged"),
        (&["head.exr"], "cut or damaged"),
        (&["colour.exr"], "found the channels G, R"),
        (&["two.exr"], "a.Z, b.Z"),
        (&["fine.exr", "--channels", "depth"], "'depth'; found the channels Z"),
        (&["fine.exr", "--policy", "closed"], "a second depth"),
        (&["flat.exr"], "8 x 2 pixels"),
        (&["odd.exr"], "12 x 12 pixels"),
        (&["fine.exr", "--second", "small.exr"], "8 x 8 pixels"),
        (&["fine.exr", "--second", "missing.exr"], "missing.exr"),
        (&["nan.exr"], "texel (5, 9)"),
        (&["order.exr"], "texel (3, 2)"),
    ] {
        let line = place.refused(3, &[&["bake", "--light", "sun", "-o", "new.umb"], args].concat());
        assert!(line.contains(says), "{args:?}: {line}");
    }
    let usage: [&[&str]; 11] = [
        &["fine.exr", "--light", "sun", "--resolution", "32"],
        &["fine.exr", "--light", "sun", "--policy", "thickness:1"],
        &["fine.exr", "--light", "sun=dir:0,-1,0"],
        &["fine.exr", "--light", "sun", "--bounds", "0,0,0,1,1,1"],
        &["fine.exr", "--light", "sun=dir:0,-1,0", "--bounds", "0,0,0,1,1,-1"],
        &["fine.exr", "--light", "sun=dir:0,-1,0", "--bounds", "0,0,0,1,1,1", "--image-space"],
        &["fine.exr", "--light", "sun", "--light", "moon"],
        &["fine.exr", "--light", "sun", "--far", "x"],
        &["fine.exr"],
        &["scan:1:0.05", "--light", "sun=dir:0,-1,0", "--far", "3"],
        &["scan:1:0.05", "--light", "sun"],
    ];
    for args in usage {
        place.refused(2, &[&["bake", "-o", "new.umb"], args].concat());
    }
    let target = ["bake", "fine.exr", "--light", "sun", "-o", "folder.exr"];
    place.refused(5, &target);
    one("large.exr", (1024, 1024), vec![("Z", of(1024))]);
    let line = place.refused(5, &["bake", "large.exr", "--light", "sun", "-o", "new.umb", "--memory", "3"]);
    assert!(line.contains("--memory"), "{line}");
    place.fine(&["bake", "fine.exr", "--light", "sun", "--resolution", "16", "-o", "new.umb"]);
    place.fine(&["bake", "scan:1:0.05", "--light", "sun=dir:0,-1,0", "--resolution", "16", "-o", "mesh.umb"]);
    assert!(place.refused(3, &["verify", "mesh.umb", "--source", "fine.exr"]).contains("from a scene"));
    assert!(place.refused(3, &["verify", "new.umb", "--source", "small.exr"]).contains("8"));
    place.refused(2, &["verify", "new.umb", "--far", "3"]);
}
