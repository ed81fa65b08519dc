use super::super::load;
use super::super::testing::{Folder, data_uri, floats, gltf_triangle, refusal};
use super::*;

mod masks;

/// Five points of a zigzag, indices 0 1 2 2 1 3 as bytes, then as u16.
fn bytes() -> Vec<u8> {
    let mut bytes = floats(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0, 0.0, 2.0, 0.0]);
    bytes.extend([0, 1, 2, 2, 1, 3, 0, 0]);
    [0u16, 1, 2, 2, 1, 3].iter().for_each(|i| bytes.extend(i.to_le_bytes()));
    bytes
}

/// A file of one mesh with these nodes, primitives and further accessors (from index 4) and entries.
fn file(nodes: &str, primitives: &str, more: &str, entries: &str) -> String {
    let (bytes, uri) = (bytes(), data_uri(&bytes()));
    let comma = if more.is_empty() { "" } else { "," };
    format!(
        r#"{{"asset":{{"version":"2.0"}},"nodes":[{nodes}],"meshes":[{{"primitives":[{primitives}]}}],
        "accessors":[{{"bufferView":0,"componentType":5126,"count":5,"type":"VEC3"}},
        {{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"}},
        {{"bufferView":1,"componentType":5121,"count":6,"type":"SCALAR"}},
        {{"bufferView":1,"byteOffset":8,"componentType":5123,"count":6,"type":"SCALAR"}}{comma}{more}],
        "bufferViews":[{{"buffer":0,"byteLength":60}},{{"buffer":0,"byteOffset":60,"byteLength":20}}],
        "buffers":[{{"byteLength":{},"uri":"{uri}"}}]{entries}}}"#,
        bytes.len()
    )
}

fn parsed(text: &str) -> Loaded {
    parse(text.as_bytes(), Path::new("")).unwrap_or_else(|e| panic!("{e}\n{text}"))
}

fn message(text: &str) -> String {
    parse(text.as_bytes(), Path::new("")).expect_err(text).to_string()
}

fn modes(primitive: &str) -> Vec<[u32; 3]> {
    parsed(&file(r#"{"mesh":0}"#, primitive, "", "")).mesh.triangles
}

#[test]
fn lists_strips_and_fans_with_and_without_indices() {
    assert_eq!(modes(r#"{"attributes":{"POSITION":1}}"#), [[0, 1, 2]]);
    assert_eq!(modes(r#"{"attributes":{"POSITION":0},"indices":2}"#), [[0, 1, 2], [2, 1, 3]]);
    assert_eq!(modes(r#"{"attributes":{"POSITION":0},"indices":3}"#), [[0, 1, 2], [2, 1, 3]]);
    assert_eq!(modes(r#"{"attributes":{"POSITION":0},"mode":5}"#), [[0, 1, 2], [1, 3, 2], [2, 3, 4]]);
    assert_eq!(modes(r#"{"attributes":{"POSITION":0},"mode":6}"#), [[1, 2, 0], [2, 3, 0], [3, 4, 0]]);
    assert_eq!(
        modes(r#"{"attributes":{"POSITION":0},"mode":5,"indices":2}"#),
        [[0, 1, 2], [1, 2, 2], [2, 2, 1], [2, 3, 1]]
    );
    // all triangles of the strip face the way of the first
    let scene = parsed(&file(r#"{"mesh":0}"#, r#"{"attributes":{"POSITION":0},"mode":5}"#, "", ""));
    assert!(scene.mesh.triangles.iter().all(|t| area(&scene.mesh, *t) > 0.0));
}

/// Twice the area of a triangle, positive if it turns counter-clockwise in x and y.
fn area(mesh: &crate::mesh::Mesh, t: [u32; 3]) -> f64 {
    let [a, b, c] = t.map(|i| mesh.positions[i as usize]);
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

#[test]
fn transforms_are_applied_and_mirrors_turn_the_winding() {
    let primitive = r#"{"attributes":{"POSITION":1}}"#;
    // a quarter turn about z, then doubled and moved, from two nodes; numbers that f32 would round
    let nodes = r#"{"children":[1],"translation":[100000.001,0,0],"scale":[2,2,2]},
                   {"mesh":0,"rotation":[0,0,0.70710678,0.70710678]}"#;
    let mesh = parsed(&file(nodes, primitive, "", "")).mesh;
    let expected = [[100000.001, 0.0, 0.0], [100000.001, 2.0, 0.0], [99998.001, 0.0, 0.0]];
    for (p, e) in mesh.positions.iter().flatten().zip(expected.iter().flatten()) {
        assert!((p - e).abs() < 1e-9, "{:?}", mesh.positions);
    }
    assert!(area(&mesh, mesh.triangles[0]) > 3.9);
    // mirrored as a matrix and as a scale: seen from the other side, still the outside
    for node in [
        r#"{"mesh":0,"matrix":[1,0,0,0, 0,1,0,0, 0,0,-1,0, 0,0,5,1]}"#,
        r#"{"mesh":0,"scale":[1,1,-1],"translation":[0,0,5]}"#,
    ] {
        let mesh = parsed(&file(node, primitive, "", "")).mesh;
        assert_eq!((mesh.triangles[0], mesh.positions[0]), ([0, 2, 1], [0.0, 0.0, 5.0]));
    }
    // mirrored twice is not mirrored
    let twice = r#"{"children":[1],"scale":[-1,1,1]},{"mesh":0,"scale":[1,-3,1]}"#;
    assert_eq!(parsed(&file(twice, primitive, "", "")).mesh.triangles, [[0, 1, 2]]);
}

#[test]
fn the_default_scene_is_taken() {
    let nodes = r#"{"mesh":0},{"mesh":0,"translation":[1,0,0]},{"mesh":0,"translation":[2,0,0]}"#;
    let starts = |entries: &str| {
        let mesh = parsed(&file(nodes, r#"{"attributes":{"POSITION":1}}"#, "", entries)).mesh;
        mesh.triangles.iter().map(|t| mesh.positions[t[0] as usize][0]).collect::<Vec<_>>()
    };
    assert_eq!(starts(""), [0.0, 1.0, 2.0]);
    assert_eq!(starts(r#","scene":1,"scenes":[{"nodes":[0]},{"nodes":[2,1]}]"#), [2.0, 1.0]);
    assert_eq!(starts(r#","scenes":[{"nodes":[1]},{"nodes":[0]}]"#), [1.0]);
}

#[test]
fn sparse_and_quantized_accessors() {
    let sparse = |base: &str, place: u8| {
        let more = format!(
            r#"{{{base}"componentType":5126,"count":3,"type":"VEC3","sparse":{{"count":1,
            "indices":{{"bufferView":1,"byteOffset":{place},"componentType":5121}},"values":{{"bufferView":0,"byteOffset":36}}}}}}"#
        );
        file(r#"{"mesh":0}"#, r#"{"attributes":{"POSITION":4}}"#, &more, "")
    };
    let based = parsed(&sparse(r#""bufferView":0,"#, 1)).mesh.positions;
    assert_eq!(based, [[0.0; 3], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]]);
    assert_eq!(parsed(&sparse("", 2)).mesh.positions, [[0.0; 3], [0.0; 3], [1.0, 1.0, 0.0]]);
    let bad = message(&sparse("", 5));
    assert!(
        bad.starts_with("node 0, mesh 0, primitive 0, POSITION, accessor 4, sparse index 0: expected an index into 3"),
        "{bad}"
    );
    let quantized = r#"{"bufferView":1,"byteOffset":8,"componentType":5122,"normalized":true,"count":2,"type":"VEC3"}"#;
    let entries = r#","extensionsRequired":["KHR_mesh_quantization"]"#;
    let scene = parsed(&file(r#"{"mesh":0}"#, r#"{"attributes":{"POSITION":4},"mode":5}"#, quantized, entries));
    assert_eq!(scene.mesh.positions[1], [2.0 / 32767.0, 1.0 / 32767.0, 3.0 / 32767.0]);
}

#[test]
fn what_is_ignored_is_noted() {
    let nodes = r#"{"mesh":0,"skin":0},{"camera":0,"extensions":{"KHR_lights_punctual":{"light":0}}}"#;
    let primitives = r#"{"attributes":{"POSITION":0},"indices":2,"targets":[{"POSITION":0}],"material":0},
        {"attributes":{"POSITION":0},"mode":1},{"attributes":{"NORMAL":0}},{"attributes":{"POSITION":0}}"#;
    let entries = r#","materials":[{"alphaMode":"BLEND"}],"animations":[{"channels":[]}],
        "extensionsUsed":["MSFT_lod","KHR_lights_punctual"],"extensionsRequired":["KHR_materials_unlit"]"#;
    assert_eq!(
        parsed(&file(nodes, primitives, "", entries)).notes,
        [
            "1 skinned meshes are taken as modelled, their skins are ignored",
            "1 primitives with morph targets are taken without them",
            "1 animations are ignored",
            "1 cameras are ignored",
            "1 lights are ignored",
            "1 primitives of points or lines are ignored",
            "1 primitives without positions are ignored",
            "1 lists of triangles end within a triangle, which is ignored",
            "1 primitives with alpha BLEND are taken as solid",
            "extension `MSFT_lod` is ignored",
        ]
    );
}

#[test]
fn faults_name_the_place() {
    let (node, plain) = (r#"{"mesh":0}"#, r#"{"attributes":{"POSITION":0}}"#);
    let more = r#"{"bufferView":0,"componentType":5126,"count":6,"type":"VEC3"},
        {"bufferView":1,"componentType":5126,"count":1,"type":"VEC3"},{"componentType":5126,"count":9999999,"type":"VEC3"},
        {"bufferView":9,"componentType":5126,"count":1,"type":"VEC3"},{"bufferView":0,"componentType":5124,"count":1,"type":"VEC3"},
        {"bufferView":0,"byteOffset":18446744073709551615,"componentType":5126,"count":18446744073709551615,"type":"VEC3"},
        {"bufferView":0,"componentType":5126,"count":268435456,"type":"VEC3"}"#;
    let position = |i: u32| format!(r#"{{"attributes":{{"POSITION":{i}}}}}"#);
    let place = "node 0, mesh 0, primitive 0, POSITION";
    for (text, start, found) in [
        (file(node, &position(4), more, ""), format!("{place}, accessor 4, buffer view 0: expected 72 bytes"), "60;"),
        (file(node, &position(6), more, ""), format!("{place}, accessor 6: expected at most"), "9999999;"),
        (
            file(node, &position(7), more, ""),
            format!("{place}, accessor 7: expected an index into 2 buffer views"),
            "9;",
        ),
        (file(node, &position(8), more, ""), format!("{place}, accessor 8: expected a component type"), "5124;"),
        (file(node, &position(9), more, ""), format!("{place}: expected at most"), ""),
        (file(node, &position(10), more, ""), format!("{place}: expected at most 335"), "268435456;"),
        (file(node, &position(99), more, ""), format!("{place}: expected an index into 11 accessors"), "99;"),
        (file(node, &position(2), "", ""), format!("{place}, accessor 2: expected VEC3"), "`SCALAR`;"),
        (
            file(node, r#"{"attributes":{"POSITION":1},"indices":2}"#, "", ""),
            "node 0, mesh 0, primitive 0, indices, accessor 2, element 5: expected an index into 3 vertices".into(),
            "3;",
        ),
        (
            file(node, r#"{"attributes":{"POSITION":1},"indices":0}"#, "", ""),
            "node 0, mesh 0, primitive 0, indices, accessor 0: expected component type".into(),
            "5126;",
        ),
        (
            file(node, r#"{"attributes":{"POSITION":1},"mode":7}"#, "", ""),
            "node 0, mesh 0, primitive 0: expected a mode".into(),
            "7;",
        ),
        (file(r#"{"mesh":1}"#, plain, "", ""), "node 0: expected an index into 1 meshes".into(), "1;"),
        (file(r#"{"children":[7]}"#, plain, "", ""), "node 0: expected an index into 1 nodes".into(), "7;"),
        (file(node, plain, "", r#","scene":3"#), "scene: expected an index into 0 scenes".into(), "3;"),
        (file(r#"{"children":[1,1]},{}"#, plain, "", ""), "node 0: expected each node once".into(), "node 1 again;"),
        (
            file(r#"{"children":[0]}"#, plain, "", r#","scenes":[{"nodes":[0]}]"#),
            "node 0: expected each node once".into(),
            "node 0 again;",
        ),
        (
            file(r#"{"rotation":[0,0,0,0]}"#, plain, "", ""),
            "node 0, rotation: expected a quaternion".into(),
            "[0.0, 0.0, 0.0, 0.0];",
        ),
        (
            file(r#"{"matrix":[1,0,0,1,0,1,0,0,0,0,1,0,0,0,0,1]}"#, plain, "", ""),
            "node 0, matrix: expected a last row".into(),
            "[1.0,",
        ),
        (
            file(
                r#"{"mesh":0,"translation":[1e308,0,0],"children":[]},{"children":[2],"scale":[1e200,1,1]},{"mesh":0,"scale":[1e200,1,1]}"#,
                plain,
                "",
                "",
            ),
            "node 2, mesh 0, primitive 0, POSITION, accessor 0, vertex 0: expected finite".into(),
            "[0.0, 0.0, 0.0], in the scene [NaN",
        ),
        (
            file(node, plain, "", r#","extensionsRequired":["KHR_draco_mesh_compression"]"#),
            "extensionsRequired: expected none".into(),
            "`KHR_draco_mesh_compression`,",
        ),
        (file(node, plain, "", "").replace("\"2.0\"", "\"1.0\""), "asset: expected version 2.x".into(), "`1.0`,"),
        (
            file(node, plain, "", "").replace("\"byteLength\":80", "\"byteLength\":999"),
            "buffer 0: expected 999 bytes".into(),
            "80;",
        ),
        (
            file(node, plain, "", "").replace("\"byteLength\":60", "\"byteLength\":99"),
            format!("{place}, accessor 0, buffer view 0, buffer 0: expected 99 bytes"),
            "80 bytes",
        ),
        (
            file(node, plain, "", "").replace("\"byteLength\":60", "\"byteStride\":4,\"byteLength\":60"),
            format!("{place}, accessor 0, buffer view 0: expected a stride"),
            "4;",
        ),
        (
            file(node, plain, "", "").replace(";base64,", ","),
            "buffer 0: expected a data URI".into(),
            "`application/octet-stream`;",
        ),
        (file(node, plain, "", "").replace(";base64,", ";base64,?"), "buffer 0: expected a data URI".into(), "Invalid"),
        (
            file(node, plain, "", "").replace("data:", "https:"),
            "buffer 0: expected a data URI or a relative".into(),
            "`https:",
        ),
        (file(node, plain, "", "").replace("\"asset\"", "\"assets\""), "JSON, line ".into(), "missing field `asset`"),
        (file(node, plain, "", "").replace("\"nodes\":[", "\"nodes\":[1,"), "JSON, line 1,".into(), "invalid type"),
        ("{".repeat(9999), "JSON, line 1, column ".into(), ""),
        ("[".repeat(9999), "JSON, line 1, column ".into(), ""),
    ] {
        let message = message(&text);
        assert!(
            message.starts_with(&start) && message.contains(&format!("found {found}")),
            "{message}\nnot {start} {found}"
        );
        assert!(!message.contains('\n'));
    }
}

#[test]
fn repeated_meshes_are_bounded() {
    // a thousand times 90 000 vertices, which only a zeroed accessor names: refused before memory is taken
    let primitives = vec![r#"{"attributes":{"POSITION":4}}"#; 9000].join(",");
    let more = r#"{"componentType":5126,"count":90000,"type":"VEC3"}"#;
    let nodes = vec![r#"{"mesh":0}"#; 1000].join(",");
    let message = message(&file(&nodes, &primitives, more, ""));
    assert!(message.contains(": expected at most 33") && message.contains(" for a file of this size"), "{message}");
    // 100 million primitives without triangles
    let primitives = vec![r#"{"attributes":{},"mode":1}"#; 10000].join(",");
    let nodes = vec![r#"{"mesh":0}"#; 10000].join(",");
    let message = self::message(&file(&nodes, &primitives, "", ""));
    assert!(message.contains(": expected at most 1") && message.contains("elements to read"), "{message}");
}

fn glb(json: &str, binary: &[u8]) -> Vec<u8> {
    let mut json = json.as_bytes().to_vec();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut file = b"glTF\x02\0\0\0".to_vec();
    file.extend((12 + 8 + json.len() as u32 + 8 + binary.len() as u32).to_le_bytes());
    for (name, content) in [(b"JSON", json.as_slice()), (b"BIN\0", binary)] {
        file.extend((content.len() as u32).to_le_bytes());
        file.extend(name);
        file.extend(content);
    }
    file
}

fn triangle_glb() -> Vec<u8> {
    let text = gltf_triangle();
    let (start, end) = (text.find(",\"uri\"").unwrap(), text.rfind("}]}").unwrap());
    glb(&format!("{}{}", &text[..start], &text[end..]), &floats(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]))
}

#[test]
fn binary_files_and_their_faults() {
    let folder = Folder::new();
    let file = triangle_glb();
    let scene = load(&folder.write("a.GLB", &file)).unwrap();
    assert_eq!(scene.mesh.positions, [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
    assert_eq!(load(&folder.write("glb", &file)).unwrap(), scene);
    for length in 1..file.len() {
        let error = refusal(&folder.write("a.glb", &file[..length]));
        let early = length < 4 && matches!(error.fault, Fault::Syntax { .. });
        assert!(early || matches!(error.fault, Fault::Truncated { .. }), "{length}: {error}");
    }
    let changed = |at: usize, to: u8| {
        let mut file = file.clone();
        file[at] = to;
        refusal(&folder.write("a.glb", &file)).to_string()
    };
    assert!(changed(4, 1).contains(": GLB header, byte 4: expected version 2, found version 1"));
    assert!(changed(8, 0).contains("expected "));
    assert!(
        changed(12, 255).contains("a.glb: ")
            && changed(16, b'X').contains("GLB, byte 12: expected a chunk `JSON`, found none")
    );
    // every byte changed: refused or loaded, nothing else
    for at in 0..file.len() {
        for to in [0, b'9', 255] {
            let mut file = file.clone();
            file[at] = to;
            let _ = parse(&file, Path::new(""));
        }
    }
}

#[test]
fn truncated_text_is_refused() {
    let text = gltf_triangle();
    for length in 0..text.len() {
        let fault = parse(&text.as_bytes()[..length], Path::new("")).expect_err("cut short");
        assert!(matches!(fault, Fault::Truncated { .. }), "{length}: {fault}");
    }
}

#[test]
fn buffers_lie_in_other_files() {
    let folder = Folder::new();
    let text = gltf_triangle();
    let (start, end) = (text.find("data:").unwrap(), text.rfind("\"}]}").unwrap());
    let path = folder.write("a.gltf", format!("{}a%20b.bin{}", &text[..start], &text[end..]).as_bytes());
    let error = refusal(&path);
    assert!(matches!(&error.fault, Fault::External { fault, .. } if **fault == Fault::Missing), "{error}");
    assert!(error.to_string().contains("buffer 0: `a b.bin`: expected a scene file"), "{error}");
    folder.write("a b.bin", &[0; 35]);
    assert!(refusal(&path).to_string().contains("buffer 0: expected 36 bytes, found 35; "));
    folder.write("a b.bin", &floats(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]));
    assert_eq!(load(&path).unwrap().mesh.triangles, [[0, 1, 2]]);
}
