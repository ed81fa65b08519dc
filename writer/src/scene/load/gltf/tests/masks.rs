use std::f64::consts::FRAC_PI_2;

use super::*;

/// A PNG of 2 x 1 pixels.
fn image(color: png::ColorType, pixels: &[u8]) -> Vec<u8> {
    let mut file = Vec::new();
    let mut encoder = png::Encoder::new(&mut file, 2, 1);
    encoder.set_color(color);
    if color == png::ColorType::Indexed {
        encoder.set_palette(vec![0, 0, 0, 255, 255, 255]);
        encoder.set_trns(vec![255, 3]);
    }
    encoder.write_header().unwrap().write_image_data(pixels).unwrap();
    file
}

/// One triangle with this material, image and further attributes; accessor 4 holds uv, 5 colours.
fn masked(material: &str, image: &str, attributes: &str) -> String {
    let more = r#"{"bufferView":0,"componentType":5126,"count":3,"type":"VEC2"},
        {"bufferView":1,"byteOffset":3,"componentType":5121,"normalized":true,"count":3,"type":"VEC4"}"#;
    let entries = format!(
        r#","materials":[{{}},{{"alphaMode":"MASK",{material}}}],"textures":[{{"source":0,"sampler":0}}],
        "samplers":[{{"wrapS":33071,"wrapT":33648,"magFilter":9728}}],"images":[{image}]"#
    );
    let primitive =
        format!(r#"{{"attributes":{{"POSITION":1}}}},{{"attributes":{{"POSITION":1{attributes}}},"material":1}}"#);
    file(r#"{"mesh":0,"scale":[-1,1,1]}"#, &primitive, more, &entries)
}

const TEXTURED: &str = r#""pbrMetallicRoughness":{"baseColorFactor":[1,1,1,0.5],"baseColorTexture":{"index":0}}"#;
const UV: &str = r#","TEXCOORD_0":4"#;

fn uri(bytes: &[u8]) -> String {
    format!(r#"{{"uri":"{}"}}"#, data_uri(bytes))
}

#[test]
fn a_mask_keeps_its_alpha_and_coordinates() {
    let rgba = image(png::ColorType::Rgba, &[1, 2, 3, 4, 5, 6, 7, 255]);
    let scene = parsed(&masked(TEXTURED, &uri(&rgba), UV));
    // both primitives share their vertices
    assert_eq!((scene.mesh.positions.len(), scene.mesh.triangles.as_slice()), (3, [[0, 2, 1]; 2].as_slice()));
    let [mask] = scene.masks.as_slice() else { panic!("{:?}", scene.masks) };
    assert_eq!(*mask.image, AlphaImage { width: 2, height: 1, alpha: vec![4, 255] });
    assert_eq!((mask.material, mask.cutoff, mask.linear), (1, 0.5, false));
    assert_eq!(mask.wrap, [Wrap::Clamp, Wrap::Mirror]);
    // the mirrored winding turns the coordinates too
    let uv = [[0.0, 0.0], [0.0, 0.0], [0.0, 1.0]];
    assert_eq!(mask.triangles, [MaskedTriangle { triangle: 1, uv, opacity: [0.5; 3] }]);
    for (color, pixels, alpha) in
        [(png::ColorType::GrayscaleAlpha, &[9, 8, 7, 6][..], [8, 6]), (png::ColorType::Indexed, &[1, 0], [3, 255])]
    {
        let scene = parsed(&masked(TEXTURED, &uri(&image(color, pixels)), UV));
        assert_eq!(scene.masks[0].image.alpha, alpha);
    }
}

#[test]
fn images_without_alpha_need_no_mask() {
    let rgb = image(png::ColorType::Rgb, &[0; 6]);
    let opaque = image(png::ColorType::Rgba, &[255; 8]);
    for image in [uri(&rgb), uri(&opaque), uri(b"\xFF\xD8\xFF\xE0")] {
        let scene = parsed(&masked(TEXTURED, &image, UV));
        assert_eq!((scene.mesh.triangles.len(), scene.masks.len()), (2, 0));
    }
    let hidden = r#""alphaCutoff":0.6,"pbrMetallicRoughness":{"baseColorFactor":[1,1,1,0.5]}"#;
    let scene = parsed(&masked(hidden, &uri(&rgb), ""));
    assert_eq!((scene.mesh.triangles.len(), scene.masks.len()), (1, 0));
    assert_eq!(scene.notes, ["1 primitives whose alpha MASK hides all of them are left out"]);
}

#[test]
fn colours_and_transforms_count() {
    let scene = parsed(&masked(r#""alphaCutoff":0.25"#, &uri(&[]), r#","COLOR_0":5"#));
    let mask = &scene.masks[0];
    assert_eq!((mask.image.alpha.as_slice(), mask.cutoff), ([255].as_slice(), 0.25));
    // bytes 6, 10 and 14 of the second view, the last two turned
    assert_eq!(mask.triangles[0].opacity, [0.0, 2.0 / 255.0, 1.0 / 255.0]);
    let transform = format!(
        r#""pbrMetallicRoughness":{{"baseColorTexture":{{"index":0,"texCoord":9,"extensions":
        {{"KHR_texture_transform":{{"offset":[0.5,0.25],"rotation":{FRAC_PI_2},"scale":[3,2],"texCoord":0}}}}}}}}"#
    );
    let scene = parsed(&masked(&transform, &uri(&image(png::ColorType::Rgba, &[0; 8])), UV));
    // (0, 1) scaled to (0, 2), turned to (2, 0)
    let uv = scene.masks[0].triangles[0].uv;
    assert!((uv[2][0] - 2.5).abs() < 1e-6 && (uv[2][1] - 0.25).abs() < 1e-6, "{uv:?}");
}

#[test]
fn faults_name_the_place() {
    let rgba = image(png::ColorType::Rgba, &[0; 8]);
    let mut vast = rgba.clone();
    vast[16..24].copy_from_slice(&[0, 0, 255, 255, 0, 0, 255, 255]);
    let crc = crc(&vast[12..29]);
    vast[29..33].copy_from_slice(&crc.to_be_bytes());
    let place = "node 0, mesh 0, primitive 1";
    for (text, start, found) in [
        (masked(TEXTURED, &uri(&rgba), ""), format!("{place}, TEXCOORD_0: expected texture coordinates"), "none"),
        (
            masked(TEXTURED, &uri(&rgba), r#","TEXCOORD_0":0"#),
            format!("{place}, TEXCOORD_0, accessor 0: expected VEC2"),
            "`VEC3`",
        ),
        (
            masked(TEXTURED, &uri(&rgba), r#","TEXCOORD_0":5"#)
                .replace("VEC4", "VEC2")
                .replace("\"count\":3,\"type\":\"VEC2", "\"count\":2,\"type\":\"VEC2"),
            format!("{place}, TEXCOORD_0, accessor 5: expected 3 elements"),
            "2",
        ),
        (masked(TEXTURED, &uri(b"GIF89a"), UV), "image 0: expected a PNG or JPEG".into(), "`GIF89a`"),
        (masked(TEXTURED, &uri(&rgba[..40]), UV), "image 0: expected a PNG".into(), ""),
        (masked(TEXTURED, &uri(&vast), UV), "image 0: expected 65535 x 65535 pixels".into(), ""),
        (masked(TEXTURED, "{}", UV), "image 0: expected `uri`".into(), "neither"),
        (masked(TEXTURED, r#"{"bufferView":7}"#, UV), "image 0: expected an index into 2 buffer views".into(), "7"),
        (masked(TEXTURED, "", UV), "material 1, texture 0: expected an index into 0 images".into(), "0"),
        (
            masked(TEXTURED, &uri(&rgba), UV).replace("\"source\":0,", ""),
            "material 1, texture 0: expected a PNG".into(),
            "an image that",
        ),
        (masked(TEXTURED, &uri(&rgba), UV).replace("33071", "1"), "material 1: expected a wrap mode".into(), "1;"),
        (
            masked(TEXTURED, &uri(&rgba), UV).replace("\"MASK\"", "\"mask\""),
            "material 1: expected alphaMode".into(),
            "`mask`",
        ),
    ] {
        let message = message(&text);
        assert!(
            message.starts_with(&start) && message.contains(&format!("found {found}")),
            "{message}\nnot {start} {found}"
        );
    }
    for length in 0..rgba.len() {
        let _ = parse(masked(TEXTURED, &uri(&rgba[..length]), UV).as_bytes(), Path::new(""));
    }
}

/// The checksum of a PNG chunk.
fn crc(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0, |crc, b| {
        (0..8).fold(crc ^ u32::from(*b), |c, _| if c & 1 == 1 { c >> 1 ^ 0xEDB8_8320 } else { c >> 1 })
    })
}
