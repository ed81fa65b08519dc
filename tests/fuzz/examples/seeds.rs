//! Makes the kept seeds of every target: `cargo run --manifest-path tests/fuzz/Cargo.toml --example seeds`.

#[path = "seeds/layers.rs"]
mod layers;

use std::path::Path;

use umbrage_format::Kind;

const KINDS: [Kind; 3] = [Kind::Mh, Kind::Mmh, Kind::Vector];
/// Most bytes of an input with a cold page: short ones are changed and run faster.
const COLD_BYTES: usize = 400;

fn main() -> std::io::Result<()> {
    let corpus = Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus");
    let put = |target: &str, name: &str, bytes: &[u8]| {
        let folder = corpus.join(target);
        std::fs::create_dir_all(&folder)?;
        std::fs::write(folder.join(name), bytes)
    };
    // A corner of a coordinate is its place on the grid of 32; 64 is one step beside it.
    let (touching, nested, coplanar): (&[u8], &[u8], &[u8]) = (
        &[0, 4, 4, 2, 12, 12, 8, 0, 12, 4, 2, 20, 12, 8, 0, 12, 12, 8, 24, 24, 12],
        &[0, 2, 2, 2, 28, 28, 20, 8, 6, 6, 6, 20, 20, 12, 0, 8, 8, 7, 10, 10, 9],
        &[0, 4, 4, 4, 16, 16, 10, 0, 8, 8, 4, 24, 24, 10, 2, 4, 4, 10, 28, 4, 10, 4, 28, 10, 4, 4, 20],
    );
    // The policies in their order: closed, one-sided, thickness, second-surface, auto.
    let policies = [&[0u8][..], &[1], &[2, 3], &[3], &[4]];
    let names = ["closed", "one-sided", "thickness", "second-surface", "auto"];
    for ((setup, policy), name) in [2u8, 3, 1, 0b1001_1010, 6].into_iter().zip(policies).zip(names) {
        for (shapes, what) in [(touching, "touching"), (nested, "nested"), (coplanar, "coplanar")] {
            if name == "closed" || what == "coplanar" {
                put("intervals", &format!("{name}-{what}"), &[&[setup, 2], policy, shapes].concat())?;
            }
        }
    }
    put(
        "intervals",
        "sheets-with-thickness",
        &[&[2u8, 2, 2, 2][..], &[5, 1, 1, 4, 30, 2, 8, 3, 29, 12, 6, 4, 4, 9, 20, 4, 3, 20, 20, 9, 4, 20, 15]].concat(),
    )?;
    put(
        "intervals",
        "slabs-beside-the-grid",
        &[&[3u8, 0x0E, 4][..], &[4, 66, 130, 3, 92, 5, 9, 7, 200, 60, 2, 7, 1, 1, 7, 0, 2]].concat(),
    )?;

    let words = |words: &[u32]| words.iter().flat_map(|w| w.to_le_bytes()).collect::<Vec<u8>>();
    let page = |log2: u8, place: u8, w: &[u32]| [&[log2, place][..], &words(w)].concat();
    put("page", "root-leaf", &page(0, 0, &[0x0100, 0, 7]))?;
    // an inner root with four leaves, and one with an empty child and a child in another page
    put("page", "root-inner", &page(1, 0, &[0x0200, 0, 0x0004_0055, 9, 1, 2, 3, 4]))?;
    put("page", "root-mixed", &page(3, 0, &[0x0001_0200, 0, 0x0004_002D, 9, 5, 0x0008_0001, 0x0000_0155, 8, 6]))?;
    put("page", "group", &page(5, 0x80 | 2, &[0x0000_8D00, 0, 5, 0x0006_0005, 0x0008_0044, 8, 1, 2, 3, 4]))?;

    // Of kind `mmh`: a shared page of two entries, words of a root page, then trees and changes to their pages.
    let merged = |place: u8, how: u8, rest: &[u8]| [&[5, 0x20 | place, how][..], rest].concat();
    put("page", "mmh-shared", &merged(0, 2, &words(&[0, 0, 2, 0x0000_0501, 7, 8, 9])))?;
    put("page", "mmh-root", &merged(0, 0, &words(&[0x0200, 0, 0x0004_000A, 9, 0x0008_0005, 1, 0x0008_0005, 2, 3, 4])))?;
    put("page", "mmh-dependency", &merged(0, 4, &words(&[0x0200, 0, 0x0004_0055, 9, 1, 2, 3, 4])))?;

    // Numbers of a tree of kind `vector`: bushy, which page, then four bytes each; the last bytes are changes.
    let numbers = |seed: u32, n: u32| -> Vec<u8> {
        let number = |i: u32| (i + 1).wrapping_mul(0x9E37_79B9 ^ seed).rotate_left(11).wrapping_mul(0x85EB_CA6B);
        (0..n).flat_map(|i| number(i).to_le_bytes()).collect()
    };
    let tree = |seed: u32, bushy: u8, which: u8, n: u32| [&[bushy, which][..], &numbers(seed, n)].concat();
    let merged_tree = |how: u8, which: u8, seed: u32| merged(0, how, &[&[which][..], &numbers(seed, 3000)].concat());
    for (which, seed) in [(0, 1), (1, 2), (3, 3), (250, 4)] {
        put("page", &format!("mmh-tree-{which}"), &merged_tree(1, which, seed))?;
        put("page", &format!("mmh-changed-{which}"), &merged_tree(1 | 2 << 2, which, seed))?;
    }
    put("page", "vector-leaf", &[&[3, 0x40][..], &tree(1, 0, 0, 40)].concat())?;
    put("page", "vector-tree", &[&[6, 0x40][..], &tree(2, 7, 0, 1500)].concat())?;
    put("page", "vector-group", &[&[6, 0x40][..], &tree(3, 7, 2, 1500)].concat())?;
    // A stub's number, a plane's bits, a value's bounds, an index.
    for (name, change) in [
        ("vector-topology", [5, 0, 0, 9, 0]),
        ("vector-header", [1, 0, 1, 1, 0]),
        ("vector-index", [12, 0, 0, 3, 0]),
        ("vector-palette", [40, 0, 2, 0xFF, 0xFF]),
    ] {
        put("page", name, &[&[4, 0x41][..], &tree(4, 6, 0, 800), &change].concat())?;
    }
    let four = [&[60u8, 0, 0, 4, 0][..], &[61, 0, 0, 7, 0], &[62, 0, 1, 9, 0], &[63, 0, 0, 1, 0]].concat();
    put("page", "vector-accepted", &[&[4, 0x44][..], &tree(5, 6, 0, 800), &four].concat())?;

    // Bytes of a page, a model, words, changes; of each kind.
    for (kind, name) in [(0u8, "mh"), (1, "mmh"), (2, "vector")] {
        for (what, bytes) in umbrage_fuzz::cold::seeds(KINDS[usize::from(kind)], COLD_BYTES) {
            put("cold", &format!("{name}-{what}"), &bytes)?;
        }
        put("cold", &format!("{name}-words"), &[&[kind | 2 << 2, 200][..], &[7, 0, 0, 0].repeat(150)].concat())?;
        for which in [1u8, 9, 30] {
            put("cold", &format!("{name}-same-{which}"), &[kind | 3 << 2, which, 0])?;
            put("cold", &format!("{name}-changed-{which}"), &[kind | 3 << 2, which, 0, 20, 0, 5, 33, 0, 77])?;
        }
    }

    put("open", "leaf", &[3])?;
    put("open", "tree", &[3 | 1 << 2])?;
    put("open", "two", &[3 | 2 << 2])?;
    // a value, a mask and a count changed, checksums good again; a bit flipped, checksums not repaired
    put("open", "values", &[3 | 1 << 2, 4 | 4 << 3, 12, 0, 9, 9, 0, 0])?;
    put("open", "masks", &[3 | 1 << 2, 4, 8, 0, 0x99, 0, 0, 0, 2 | 2 << 3, 20, 1, 1, 0, 0, 0])?;
    // the same of trees of kind `vector`
    for target in ["open", "query_agrees"] {
        put(target, "vector", &[3 | 3 << 2])?;
        put(target, "vector-two", &[3 | 4 << 2])?;
        put(target, "vector-values", &[3 | 3 << 2, 4 | 1 << 3, 60, 0, 3, 0, 0, 0, 4 | 1 << 3, 90, 0, 5, 0, 0, 0])?;
        put(target, "vector-header", &[3 | 3 << 2, 4 | 2 << 3, 12, 0, 1, 0, 0, 0])?;
    }
    put("open", "flip", &[1 | 1 << 2, 3 | 1 << 3, 40, 0, 3, 0, 0, 0])?;
    put("open", "garbage", b"\0\xD5UMB\r\n\x1A\n\x01\0\0\0\x80\0\0\0")?;

    let cube = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nv 0 0 1\nv 1 0 1\nv 0 1 1\nv 1 1 1\n\
                f 1 3 4 2\nf 5 6 8 7\nf 1 2 6 5\nf 3 7 8 4\nf 1 5 7 3\nf 2 4 8 6\n";
    let ply = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
               element face 1\nproperty list uchar int vertex_index\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";
    let binary = "ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\nproperty float y\n\
                  property float z\nelement face 1\nproperty list uchar int vertex_index\nend_header\n";
    let corners: Vec<u8> =
        [0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0].iter().flat_map(|f| f.to_le_bytes()).collect();
    let face = [3u8, 0, 0, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0];
    // one triangle, its corners in a data URI
    let gltf = r#"{"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0,"scale":[2,2,2]}],
"meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],
"accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"}],
"bufferViews":[{"buffer":0,"byteLength":36}],
"buffers":[{"byteLength":36,"uri":"data:application/octet-stream;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA"}]}"#;
    put("scene", "obj", &[&[0][..], cube.as_bytes()].concat())?;
    put("scene", "ply", &[&[1][..], ply.as_bytes()].concat())?;
    put("scene", "ply-binary", &[&[1][..], binary.as_bytes(), &corners, &face].concat())?;
    put("scene", "gltf", &[&[2][..], gltf.as_bytes()].concat())?;
    let json = format!("{gltf:<length$}", length = gltf.len().next_multiple_of(4));
    let words = [0x4654_6C67u32, 2, 20 + json.len() as u32, json.len() as u32, 0x4E4F_534A];
    let head: Vec<u8> = words.iter().flat_map(|w| w.to_le_bytes()).collect();
    put("scene", "glb", &[&[3][..], &head, json.as_bytes()].concat())?;
    put("scene", "by-content", &[&[4][..], cube.as_bytes()].concat())?;

    for (name, bytes) in layers::files() {
        put("layers", &name, &bytes)?;
    }

    put("roundtrip", "tree-flat", &[0])?;
    put("roundtrip", "tree-cut", &[3 << 1, 0x0C, 2, 1, 0, 15, 0, 3, 0, 1, 1, 0, 7, 0, 9, 9, 2, 8, 8, 5, 0, 1, 1])?;
    put("roundtrip", "vector-leaf", &[0x80])?;
    put("roundtrip", "vector-tree", &[&[0x80 | 4 << 1, 6][..], &numbers(7, 2000)].concat())?;
    put("roundtrip", "vector-large", &[&[0x80 | 7 << 1, 7][..], &numbers(8, 4000)].concat())?;
    put("roundtrip", "image-small", &[1, 4, 3, 0, 0, 0x12, 0x34, 0x13, 0xFF, 0x12])?;
    put("roundtrip", "image-many-pages", &[1, 15, 20, 200, 0, 0x12, 0x34, 0x13, 0xFF, 0x80, 0x7F, 3])?;
    put("roundtrip", "image-whole-squares", &[1, 12, 30, 9, 3, 1, 2, 3, 0xFF, 5, 6, 7, 0x88])?;
    Ok(())
}
