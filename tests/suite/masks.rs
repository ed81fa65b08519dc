//! A card with a hole in its texture over a closed slab, from glTF file to answers.

use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use super::cli::{Place, error, text, wait_for_handler};

/// Pixels on a side of the texture; the hole is columns 1 to 3 and rows 2 to 6.
const PIXELS: u32 = 8;

/// A card at y = 2 over a slab whose top is y = 0; the card spans -2..2 along x and z, a pixel is 0.5 wide.
fn write_scene(place: &Place, name: &str, filter: u32) {
    write_card(place, name, filter, PIXELS, &|k| (1..4).contains(&(k % PIXELS)) && (2..7).contains(&(k / PIXELS)));
}

/// The same with a texture of any size; `hole` says of each pixel whether it is one.
fn write_card(place: &Place, name: &str, filter: u32, side: u32, hole: &dyn Fn(u32) -> bool) {
    let mut png = Vec::new();
    let mut encoder = png::Encoder::new(&mut png, side, side);
    encoder.set_color(png::ColorType::Rgba);
    let pixels: Vec<u8> = (0..side * side).flat_map(|k| [90, 160, 40, if hole(k) { 0 } else { 255 }]).collect();
    encoder.write_header().unwrap().write_image_data(&pixels).unwrap();
    place.write("card.png", png);
    let mut floats: Vec<f32> = Vec::new();
    let corner = |k: u32| [if k & 1 == 0 { -4.0 } else { 4.0 }, (k >> 1 & 1) as f32 - 1.0, (k >> 2) as f32 * 8.0 - 4.0];
    (0..8).for_each(|k| floats.extend(corner(k)));
    for [x, z] in [[-2.0, -2.0], [2.0, -2.0], [2.0, 2.0], [-2.0, 2.0]] {
        floats.extend([x, 2.0, z]);
    }
    for uv in [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]] {
        floats.extend(uv);
    }
    let mut indices: Vec<u16> = Vec::new();
    for [a, b, c, d] in [[0, 2, 3, 1], [4, 5, 7, 6], [0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3]] {
        indices.extend([a, b, c, a, c, d]);
    }
    indices.extend([0, 2, 1, 0, 3, 2]);
    let mut bytes: Vec<u8> = floats.iter().flat_map(|f| f.to_le_bytes()).collect();
    bytes.extend(indices.iter().flat_map(|i| i.to_le_bytes()));
    let length = bytes.len();
    place.write("scene.bin", bytes);
    let gltf = format!(
        r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],"nodes":[{{"mesh":0}}],
        "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}},"indices":3}},
            {{"attributes":{{"POSITION":1,"TEXCOORD_0":2}},"indices":4,"material":0}}]}}],
        "materials":[{{"alphaMode":"MASK","doubleSided":true,"pbrMetallicRoughness":{{"baseColorTexture":{{"index":0}}}}}}],
        "textures":[{{"source":0,"sampler":0}}],"images":[{{"uri":"card.png"}}],"samplers":[{{"magFilter":{filter}}}],
        "accessors":[{{"bufferView":0,"componentType":5126,"count":8,"type":"VEC3"}},
            {{"bufferView":0,"byteOffset":96,"componentType":5126,"count":4,"type":"VEC3"}},
            {{"bufferView":0,"byteOffset":144,"componentType":5126,"count":4,"type":"VEC2"}},
            {{"bufferView":0,"byteOffset":176,"componentType":5123,"count":36,"type":"SCALAR"}},
            {{"bufferView":0,"byteOffset":248,"componentType":5123,"count":6,"type":"SCALAR"}}],
        "bufferViews":[{{"buffer":0,"byteLength":{length}}}],"buffers":[{{"byteLength":{length},"uri":"scene.bin"}}]}}"#
    );
    place.write(name, gltf);
}

/// Runs to success with nothing on stderr but how many triangles were cut.
fn fine(place: &Place, args: &[&str], cut: bool) -> String {
    let out = place.run(args);
    let (stdout, stderr) = text(&out);
    assert_eq!(out.status.code(), Some(0), "{args:?}: {stderr}");
    let said = stderr.contains(": 2 triangles with an alpha mask are cut into ");
    assert!(said == cut && stderr.lines().count() == usize::from(cut), "{args:?}: {stderr}");
    stdout
}

#[test]
fn light_falls_through_the_holes_of_a_mask() {
    let place = Place::new("masks");
    // Under the hole, under the rest of the card, beside it; half a pixel and more from the outline.
    let points = [
        (-0.75, 0.2, true),
        (-1.2, -0.7, true),
        (-0.3, 1.2, true),
        (1.0, 0.0, false),
        (-1.8, 0.0, false),
        (-0.75, -1.4, false),
        (-0.75, 1.8, false),
        (0.3, 1.2, false),
        (3.0, 3.0, true),
    ];
    // The solid parts of the diagonal, where the card's two triangles meet.
    let diagonal =
        (1..60).map(|k| -1.95 + 0.065 * f64::from(k) + 0.0007).filter(|x| *x < -1.3 || (0.3..1.9).contains(x));
    let diagonal: Vec<f64> = diagonal.collect();
    let mut table = String::from("x,y,z\n");
    points.iter().for_each(|(x, z, _)| table.push_str(&format!("{x},0.01,{z}\n")));
    diagonal.iter().for_each(|x| table.push_str(&format!("{x},0.01,{x}\n")));
    place.write("points.csv", table);
    for (filter, name) in [(9728, "nearest.gltf"), (9729, "linear.gltf")] {
        write_scene(&place, name, filter);
        for policy in ["thickness:0.1", "second-surface", "auto"] {
            let light = "sun=dir:0,-1,0";
            let bake = ["bake", name, "--light", light, "--resolution", "256", "--policy", policy, "-o", "card.umb"];
            fine(&place, &bake, true);
            let said = fine(&place, &["verify", "card.umb", "--source", name], true);
            assert!(said.contains(" 0 stored values outside their interval"), "{said}");
            let answers = fine(&place, &["query", "card.umb", "--world", "points.csv", "--source", name], true);
            let rows: Vec<Vec<&str>> = answers.lines().skip(1).map(|l| l.split(',').collect()).collect();
            assert_eq!(rows.len(), points.len() + diagonal.len());
            for (row, (x, z, lit)) in rows.iter().zip(&points) {
                assert_eq!(row[5], if *lit { "1" } else { "0" }, "{name} {policy} {x} {z}");
            }
            for row in &rows[points.len()..] {
                // A crack would make them edge texels; without thickness there is no interval to be certain of.
                let certified = if policy == "auto" { row[6] } else { "1" };
                assert_eq!([row[5], row[6]], ["0", certified], "{name} {policy} {row:?}");
            }
        }
    }
    // The picture is of the same triangles, or the container would be refused.
    let render =
        ["render", "linear.gltf", "card.umb", "--camera", "0,6,5,0,0,0", "--size", "64x64", "--backend", "cpu"];
    fine(&place, &[&render[..], &["-o", "view.png"]].concat(), true);
}

/// A card whose outline is far longer than its texture: every other pixel, at random, is a hole.
fn write_noise(place: &Place, name: &str) {
    write_card(place, name, 9729, 1024, &|k| {
        let mixed = u64::from(k).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        (mixed ^ mixed >> 29).wrapping_mul(0xBF58_476D_1CE4_E5B9) >> 63 == 1
    });
}

#[test]
fn masks_that_would_outgrow_the_budget_are_refused() {
    let place = Place::new("masks-memory");
    write_noise(&place, "noise.gltf");
    let bake = ["bake", "noise.gltf", "--light", "sun=dir:0,-1,0", "--resolution", "64", "-o", "noise.umb"];
    let line = place.refused(5, &[&bake[..], &["--memory", "60"]].concat());
    assert!(line.contains("memory budget of 60 MiB: alpha mask of material 0, triangle 12: "), "{line}");
    let next: u64 = line.rsplit("--memory ").next().unwrap().parse().expect(&line);
    assert!((61..80).contains(&next), "{line}");
}

#[cfg(target_os = "linux")]
#[test]
fn cutting_masks_can_be_interrupted() {
    let place = Place::new("masks-interrupt");
    write_noise(&place, "noise.gltf");
    let before = place.entries();
    let bake = ["bake", "noise.gltf", "--light", "sun=dir:0,-1,0", "--resolution", "64", "-o", "noise.umb"];
    for after in [0, 500] {
        let mut child = place.command(&bake).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        wait_for_handler(&mut child);
        // the image is decoded within milliseconds; both triangles take seconds
        std::thread::sleep(Duration::from_millis(after));
        let start = Instant::now();
        assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
        error(&child.wait_with_output().unwrap(), 130, &bake);
        assert!(start.elapsed() < Duration::from_secs(10), "{:?}", start.elapsed());
        assert_eq!(place.entries(), before, "{after}");
    }
}
