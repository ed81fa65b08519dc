use super::*;

const HEADER: &str = "comment made by hand\r
obj_info none\r
element odd 2\r
property list ushort float numbers\r
property short other\r
element vertex 4\r
property uchar red\r
property double x\r
property float y\r
property list uchar uchar tags\r
property short z\r
element face 2\r
property list uchar uint vertex_indices\r
property float quality\r
element empty 9223372036854775807\r
end_header\r
";

fn ascii() -> Vec<u8> {
    let body = "2 0.5 1 -7\r\n0 3\r\n9 0 0 0 0\n9 0.1 0 1 5 0\n9 1 1 0\n0\n255 0 1 2 6 7 0\n4 0 1 2 3 0\n3 0 1 2 nan\n";
    format!("ply\r\nformat ascii 1.0\r\n{HEADER}{body}").into_bytes()
}

fn binary(big: bool) -> Vec<u8> {
    let name = if big { "binary_big_endian" } else { "binary_little_endian" };
    let mut file = format!("ply\r\nformat {name} 1.0\r\n{HEADER}").into_bytes();
    let mut put = |bytes: &[u8]| {
        if big { file.extend(bytes.iter().rev()) } else { file.extend(bytes) }
    };
    put(&2u16.to_le_bytes());
    put(&0.5f32.to_le_bytes());
    put(&1f32.to_le_bytes());
    put(&(-7i16).to_le_bytes());
    put(&0u16.to_le_bytes());
    put(&3i16.to_le_bytes());
    for (x, y, z, tags) in [(0.0, 0.0, 0, 0), (0.1, 0.0, 0, 1), (1.0, 1.0, 0, 0), (0.0, 1.0, 0, 2)] {
        put(&[9]);
        put(&f64::to_le_bytes(x));
        put(&f32::to_le_bytes(y));
        put(&[tags]);
        (0..tags).for_each(|t| put(&[t]));
        put(&i16::to_le_bytes(z));
    }
    for corners in [4u32, 3] {
        put(&[corners as u8]);
        (0..corners).for_each(|c| put(&c.to_le_bytes()));
        put(&0f32.to_le_bytes());
    }
    file
}

#[test]
fn all_encodings_give_the_same() {
    let files = [ascii(), binary(false), binary(true)];
    for file in &files {
        let scene = parse(file).unwrap();
        assert_eq!(scene.mesh.positions[1], [0.1, 0.0, 0.0]);
        assert_eq!(scene.mesh.triangles, [[0, 1, 2], [0, 2, 3], [0, 1, 2]]);
        assert_eq!(
            scene.notes,
            ["element `odd` is skipped (2 of them)", "element `empty` is skipped (9223372036854775807 of them)"]
        );
    }
    assert_eq!(parse(&ascii()).unwrap().mesh.positions[3], [0.0, 1.0, 0.0]);
}

#[test]
fn every_truncation_is_refused_and_none_panics() {
    for file in [ascii(), binary(false), binary(true)] {
        // An ascii file that loses its last bytes may still hold a number.
        let end = if file.starts_with(b"ply\r\nformat a") { file.len() - 4 } else { file.len() };
        for length in 0..end {
            let fault = parse(&file[..length]).expect_err("cut short");
            let right = matches!(fault, Fault::Truncated { .. });
            assert!(right, "{length}: {fault}");
        }
    }
    let message = parse(&binary(false)[..binary(false).len() - 1]).unwrap_err().to_string();
    assert!(message.starts_with("element `face`, index 1 of 2, property `quality`, byte "), "{message}");
    assert!(message.contains(": expected 4 bytes, found 3; the file is cut short"), "{message}");
}

/// Three vertices and one face with this header and body.
fn small(encoding: &str, faces: &str, body: &[u8]) -> Vec<u8> {
    let mut file = format!(
        "ply\nformat {encoding} 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n{faces}end_header\n"
    )
    .into_bytes();
    file.extend(body);
    file
}

#[test]
fn faults_name_the_place() {
    let face = "element face 1\nproperty list int int vertex_index\n";
    for (faces, body, start, found) in [
        (
            face,
            "0 0 0 0 0 0 0 0 1e39x 3 0 1 2",
            "element `vertex`, index 2 of 3, property `z`: expected a number",
            "`1e39x`",
        ),
        (face, "0 0 0 inf 0 0 0 0 0", "element `vertex`, index 1 of 3, property `x`: expected finite", "inf"),
        (
            face,
            "0 0 0 0 0 0 0 0 0 3 0 1 3",
            "element `face`, index 0 of 1, property `vertex_index`: expected an index into 3",
            "3",
        ),
        (
            face,
            "0 0 0 0 0 0 0 0 0 3 0 1 -1",
            "element `face`, index 0 of 1, property `vertex_index`: expected an index",
            "-1",
        ),
        (
            face,
            "0 0 0 0 0 0 0 0 0 -3 0 1 1",
            "element `face`, index 0 of 1, property `vertex_index`: expected a number of",
            "-3",
        ),
        (
            face,
            "0 0 0 0 0 0 0 0 0 2147483648",
            "element `face`, index 0 of 1, property `vertex_index`: expected a whole",
            "`2147483648`",
        ),
        (
            "element face 1\nproperty int vertex_index\n",
            "0 0 0 0 0 0 0 0 0",
            "header: expected a property `list",
            "none",
        ),
        (
            "element face 1\nproperty list int float vertex_index\n",
            "0 0 0 0 0 0 0 0 0",
            "header: expected a property `list",
            "none",
        ),
        ("element face 1\nproperty list float int vertex_index\n", "", "header line 8: expected a whole type", ""),
        ("element face x\n", "", "header line 7: expected a whole number", "`element face x`"),
        ("element face -1\n", "", "header line 7: expected a whole number", "`element face -1`"),
        ("element vertex 1\n", "", "header line 7: expected each element once", "`element vertex 1`"),
        ("property quad x\n", "", "header line 7: expected a type", "`property quad x`"),
        ("property list\n", "", "header line 7: expected `property TYPE", "`property list`"),
        ("banana\n", "", "header line 7: expected `format`", "`banana`"),
        ("format ascii 2.0\n", "", "header line 7: expected version 1.0", "`format ascii 2.0`"),
        ("format morse 1.0\n", "", "header line 7: expected `ascii`", "`format morse 1.0`"),
    ] {
        let message = parse(&small("ascii", faces, body.as_bytes())).expect_err(body).to_string();
        assert!(message.starts_with(start) && message.contains(&format!("found {found}")), "{message}");
        assert!(!message.contains('\n'));
    }
    for (file, start) in [
        ("ply\nelement vertex 0\nend_header\n", "header: expected a line `format`"),
        ("ply\nformat ascii 1.0\nproperty int x\n", "header line 3: expected an element before"),
        (
            "ply\nformat ascii 1.0\nelement vertex 1\nproperty list int int x\nend_header\n",
            "header: expected a scalar property `x`",
        ),
        (
            "ply\nformat ascii 1.0\nelement vertex 268435457\nend_header\n",
            "header: expected at most 268435456 vertices",
        ),
        ("plywood\n", "header line 1: expected `ply`"),
    ] {
        let message = parse(file.as_bytes()).expect_err(file).to_string();
        assert!(message.starts_with(start), "{message}");
    }
    let many: String = (0..300).map(|i| format!("element e{i} 0\n")).collect();
    let message = parse(format!("ply\n{many}").as_bytes()).unwrap_err().to_string();
    assert!(
        message.starts_with("header line 258: expected at most 256 elements, found `element e256 0`;"),
        "{message}"
    );
    assert!(matches!(parse(&[b'x'; 5000]), Err(Fault::Syntax { .. })));
}

#[test]
fn counts_beyond_the_file_are_refused_at_once() {
    let huge =
        "element face 18446744073709551615\nproperty list uint int vertex_index\nproperty list uint double more\n";
    let mut body = vec![0; 36];
    assert!(matches!(parse(&small("binary_little_endian", huge, &body)), Err(Fault::Truncated { .. })));
    body.extend([0, 0, 0, 0, 255, 255, 255, 255]);
    let message = parse(&small("binary_little_endian", huge, &body)).unwrap_err().to_string();
    assert!(
        message.contains("property `more`") && message.contains("expected 34359738360 bytes, found 0"),
        "{message}"
    );
    assert!(matches!(parse(&small("ascii", huge, b"0 0 0 0 0 0 0 0 0 4294967295 1")), Err(Fault::Truncated { .. })));
}

#[test]
fn lone_carriage_returns_end_header_lines() {
    let faces = "element face 1\nproperty list uchar uchar vertex_index\n";
    let mut body = [0.0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0].map(f32::to_le_bytes).concat();
    body[0] = b'\n';
    body.extend([3, 0, 1, 2]);
    let text = small("binary_little_endian", faces, &[]).iter().map(|b| if *b == b'\n' { b'\r' } else { *b }).collect();
    let scene = parse(&[text, body].concat()).unwrap();
    assert_eq!(scene.mesh.triangles, [[0, 1, 2]]);
}
