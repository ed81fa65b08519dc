//! OpenEXR files that nobody promised, as depth layers. What is accepted bakes, or is refused for its depths; what was
//! baked passes the reader's `verify`, holds a value of its interval at every texel and stop errors that are large
//! enough, by the oracle, and says at every texel of the first depth's ray what a comparison of depths says. The same
//! bytes give the same layers. What is refused is refused in one line.

use std::cell::Cell;
use std::path::Path;
use std::sync::{Arc, Once};

use umbrage::certify::Region;
use umbrage::certify::layers::{LayersTally, check};
use umbrage::certify::stop::{StopTally, Stops};
use umbrage_reader::query::Map;
use umbrage_reader::{Container, Limits, MemorySource};
use umbrage_writer::hierarchy::build::Progress;
use umbrage_writer::layers::openexr::{ExrLayers, ExrOptions, Placement, is_decoding};
use umbrage_writer::layers::{
    DepthSource, LatticeLayers, LayersError, LayersOptions, Second, Square, TileBuffer, bake_layers,
};

use crate::input::Input;
use crate::tree::Folder;

/// Most bytes of pixels: 128 x 128 with a second depth.
const PIXELS: u64 = 1 << 17;
/// Larger maps are read and looked at, but not baked.
const MOST_LOG2: u8 = 5;

fn one_line(text: &str) {
    assert!(!text.is_empty() && !text.chars().any(char::is_control), "{text:?}");
}

/// Panics that the loader catches are none here; the fuzzer's own hook would end the process.
fn quiet() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        let hook = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |panic| {
            if !is_decoding() {
                hook(panic);
            }
        }));
    });
}

/// How the file is read, by two bytes.
fn options(input: &mut Input, file: &Path) -> ExrOptions {
    let (how, far) = (input.byte(), input.byte());
    ExrOptions {
        first: file.to_path_buf(),
        second: (how & 1 != 0).then(|| file.to_path_buf()),
        channels: [None, Some(("Z".into(), Some("ZBack".into()))), Some(("Z".into(), None)), None]
            [usize::from(how >> 1 & 3)]
        .clone(),
        meaning: [None, Some(Second::Exit), Some(Second::NextSurface), Some(Second::Absent)][usize::from(how >> 3 & 3)],
        far: [None, Some(f64::from(far)), Some(f64::INFINITY), Some(-f64::from(far))][usize::from(how >> 5 & 3)],
        placement: if how & 0x80 == 0 {
            Placement::Header
        } else {
            Placement::Box { direction: [0.3, -0.9, 0.2], low: [-1.0; 3], high: [2.0; 3] }
        },
        memory_bytes: Some(PIXELS),
    }
}

/// The depths of a source, bit by bit; NaN is not equal to itself.
fn depths(layers: &ExrLayers, square: Square) -> Vec<[u64; 2]> {
    let (mut first, mut second) = (vec![f64::INFINITY; square.texels()], vec![f64::INFINITY; square.texels()]);
    layers.render(square, &mut first, &mut second).expect("pixels that are in memory");
    first.iter().zip(&second).map(|(a, b)| [a.to_bits(), b.to_bits()]).collect()
}

fn bake(layers: &ExrLayers, square: Square, folder: &Folder) {
    let target = folder.0.join("map.umb");
    let budget = LayersOptions::default();
    let on_lattice = match bake_layers(&[layers], &budget, &target, &Progress::default()) {
        Ok(_) => LatticeLayers::new(layers, &|| true).expect("layers that were baked"),
        Err(e @ (LayersError::Depth { .. } | LayersError::Projection { .. } | LayersError::Bake(_))) => {
            assert!(!target.exists(), "nothing is left behind");
            return one_line(&e.to_string());
        }
        Err(e) => panic!("{e}"),
    };
    let bytes = std::fs::read(&target).expect("what was written");
    let file = Container::open(Arc::new(MemorySource::new(bytes, "layers")), Limits::default()).expect("a container");
    file.verify(|e| panic!("{e}"));
    let structure = file.structure(0).expect("one");
    assert_eq!(Second::of(structure.record()), Some(layers.second()));
    let guard = structure.record().depth_guard.get();
    let map = Map::new(structure).expect("a map");
    let stored = |x, y| map.texel(x, y, 0).expect("a page").value;
    let mut tally = LayersTally::default();
    map.preload().expect("pages");
    let stops = Stops::new(map.structure(), &|| true).expect("records");
    let side = map.resolution();
    let (pages, mut stopped) = (stops.over(Region { x: 0, y: 0, width: side, height: side }), StopTally::default());
    let stop = |texel, allowed| {
        for page in pages.iter().filter(|p| p.holds(texel)) {
            stopped.hold(page, texel, stops.answer(page, texel), allowed);
        }
    };
    check(&on_lattice, square, guard, &stored, &mut tally, stop).expect("depths that were baked");
    assert_eq!((tally.texels, tally.wrong), (square.texels() as u64, 0), "{:?}", tally.examples);
    assert_eq!(stopped.wrong, 0, "{:?}", stopped.examples);
    // The first surface itself is lit; where the solid is left or the next surface lies, it is dark.
    let mut buffer = TileBuffer::default();
    let mut seen = 0u64;
    let see = |i: usize, first: f64, second: f64| {
        let [x, y] = square.texel(i);
        let lit = |d: f64| on_lattice.depth(d).ceil() <= f64::from(stored(x, y));
        if first == f64::INFINITY {
            assert_eq!(stored(x, y), u32::MAX, "texel {x} {y}: nothing is there");
        } else {
            assert!(lit(first), "texel {x} {y}: its first surface is dark");
            let thin = on_lattice.depth(second).ceil() <= on_lattice.depth(first).ceil();
            let behind = second < f64::INFINITY && on_lattice.second() != Second::Absent;
            assert!(!behind || thin || !lit(second), "texel {x} {y}: what lies behind is lit");
        }
        seen += 1;
    };
    on_lattice.each(square, &mut buffer, see).expect("depths that were baked");
    assert_eq!(seen, square.texels() as u64);
}

/// One input: two bytes that say how the file is read, then the file.
pub fn run(data: &[u8]) {
    quiet();
    let folder = Folder::new("fuzz-layers");
    let file = folder.0.join("layers.exr");
    let mut input = Input(data);
    let options = options(&mut input, &file);
    std::fs::write(&file, input.0).expect("a folder that can be written");
    let asked = Cell::new(0u32);
    let count = || {
        asked.set(asked.get() + 1);
        true
    };
    let layers = match ExrLayers::read("sun", &options, &count) {
        Ok(layers) => layers,
        Err(e) => return one_line(&e.to_string().replace(&folder.0.display().to_string(), "")),
    };
    layers.notes.iter().for_each(|n| one_line(n));
    assert!(layers.bytes() <= PIXELS, "{} bytes of pixels", layers.bytes());
    // Asked for each block; one that says no ends it.
    let left = Cell::new(asked.get());
    let stop = || left.replace(left.get() - 1) > 1;
    assert!(matches!(ExrLayers::read("sun", &options, &stop), Err(LayersError::Stopped)));
    let log2_side = layers.projection().log2_resolution;
    let square = Square { origin: [0, 0], log2_side };
    let again = ExrLayers::read("sun", &options, &|| true).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!((layers.key(), depths(&layers, square)), (again.key(), depths(&again, square)));
    if log2_side <= MOST_LOG2 {
        bake(&layers, square, &folder);
    }
}
