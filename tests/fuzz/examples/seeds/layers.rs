//! OpenEXR files of depth layers: every compression, scan lines and tiles, each type of sample; most of them small and
//! not compressed, where a changed byte is a changed depth.

use exr::prelude::*;

/// First and second depth: stairs, holes, places without a second surface, and thin ones.
fn depths(x: usize, y: usize) -> (f32, f32) {
    if (x + 2 * y).is_multiple_of(7) {
        return (f32::INFINITY, f32::INFINITY);
    }
    let first = (x / 4 * 5 + y) as f32 * 0.5 + 3.0;
    let second = first + (y % 3) as f32 * 0.5;
    (first, if x.is_multiple_of(5) { f32::INFINITY } else { second })
}

fn samples(side: usize, kind: usize, second: bool) -> FlatSamples {
    let all = (0..side * side).map(|i| {
        let (first, behind) = depths(i % side, i / side);
        if second { behind } else { first }
    });
    match kind {
        0 => FlatSamples::F32(all.collect()),
        1 => FlatSamples::F16(all.map(f16::from_f32).collect()),
        _ => FlatSamples::U32(all.map(|d| if d.is_finite() { d as u32 } else { u32::MAX }).collect()),
    }
}

fn file(side: usize, encoding: Encoding, channels: &[(&str, usize, bool)], matrices: bool) -> Vec<u8> {
    let list = channels.iter().map(|(name, kind, second)| AnyChannel::new(*name, samples(side, *kind, *second)));
    let mut attributes = LayerAttributes::default();
    if matrices {
        let identity = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0];
        (attributes.world_to_camera, attributes.world_to_normalized_device) = (Some(identity), Some(identity));
    }
    let layer = Layer::new((side, side), attributes, encoding, AnyChannels::sort(list.collect()));
    let image = Image::from_layers(ImageAttributes::new(IntegerBounds::from_dimensions((side, side))), vec![layer]);
    let mut bytes = std::io::Cursor::new(Vec::new());
    image.write().non_parallel().to_buffered(&mut bytes).expect("a buffer in memory");
    bytes.into_inner()
}

/// Names and inputs of the target `layers`.
pub fn files() -> Vec<(String, Vec<u8>)> {
    use Compression::*;
    let lines = |compression| Encoding { compression, blocks: Blocks::ScanLines, line_order: LineOrder::Increasing };
    let tiles = |compression| Encoding { blocks: Blocks::Tiles(Vec2(4, 4)), ..lines(compression) };
    let pair: &[_] = &[("Z", 0, false), ("ZBack", 0, true)];
    let mut all = Vec::new();
    let mut put = |name: &str, how: [u8; 2], bytes: Vec<u8>| all.push((name.to_string(), [&how[..], &bytes].concat()));
    put("one-pixel", [0, 0], file(1, lines(Uncompressed), &[("Z", 0, false)], false));
    put("alone", [0, 0], file(4, lines(Uncompressed), &[("Z", 0, false)], false));
    put("next-surface", [0, 0], file(4, lines(Uncompressed), &[("first.Z", 0, false), ("second.Z", 0, true)], false));
    put("never-left", [2 << 3, 0], file(4, lines(Uncompressed), &[("Z", 0, false)], false));
    put("closed", [0, 0], file(8, lines(Uncompressed), pair, false));
    put("closed-matrices", [0, 0], file(4, lines(Uncompressed), pair, true));
    put("closed-box", [0x80, 0], file(4, lines(Uncompressed), pair, false));
    put("closed-near", [1 << 5, 5], file(4, lines(Uncompressed), pair, false));
    put("half-and-uint", [0, 0], file(4, lines(Uncompressed), &[("Z", 1, false), ("ZBack", 2, true)], false));
    put("two-files", [1, 0], file(4, lines(Uncompressed), &[("Z", 2, false)], false));
    put("tiles", [0, 0], file(8, tiles(Uncompressed), pair, false));
    for (name, compression) in [("rle", RLE), ("zip", ZIP16), ("piz", PIZ), ("pxr24", PXR24), ("b44", B44)] {
        put(name, [0, 0], file(8, lines(compression), &[("Z", 1, false), ("ZBack", 1, true)], false));
        put(&format!("{name}-tiles"), [0, 0], file(8, tiles(compression), pair, false));
    }
    let whole = file(4, lines(Uncompressed), pair, false);
    put("cut", [0, 0], whole[..whole.len() - 5].to_vec());
    let mut late = whole;
    let end = late.len();
    late[end - 4..].copy_from_slice(&f32::NAN.to_le_bytes());
    put("not-a-number", [0, 0], late);
    all
}
