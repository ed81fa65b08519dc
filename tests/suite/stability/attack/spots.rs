//! Where to look: half of the points anywhere, half near what goes wrong first.

use super::shapes::Dice;
use umbrage::reader::query::Map;
use umbrage::writer::solid::SnappedMesh;

/// Lattice points within the map, `count` of them: every second one anywhere, the others in turn near the projection of a
/// triangle's edge, the border of a leaf, the border of a page, and the tip of a wedge (a vertex, or the place where two
/// projected edges cross).
pub fn spots(mesh: &SnappedMesh, map: &Map, count: u32, seed: u64) -> Vec<[i64; 2]> {
    let mut d = Dice::new(seed);
    let side = mesh.lattice.side();
    let anywhere = |d: &mut Dice| [0; 2].map(|_| d.below(side as u64) as i64);
    let spot = |i: u32, d: &mut Dice| {
        let near = match i % 8 {
            1 => edge_point(mesh, d),
            3 => {
                let [x, y] = anywhere(d).map(|v| (v >> mesh.lattice.subtexel_bits) as u32);
                map.texel(x, y, 0)
                    .ok()
                    .map(|a| border(mesh, [x >> a.level << a.level, y >> a.level << a.level], a.level, d))
            }
            5 => {
                let page = d.below(map.structure().page_count().into()) as u32;
                let record = map.structure().page_record(page).ok();
                record.map(|r| border(mesh, [r.origin_x.get(), r.origin_y.get()], r.log2_x, d))
            }
            7 => tip(mesh, d),
            _ => None,
        };
        let p = match near {
            Some(p) => shaken(mesh, p, d),
            None => anywhere(d),
        };
        p.map(|v| v.clamp(0, side - 1))
    };
    (0..count).map(|i| spot(i, &mut d)).collect()
}

/// Off by nothing, by a few lattice steps, or by up to two texels.
fn shaken(mesh: &SnappedMesh, p: [i64; 2], d: &mut Dice) -> [i64; 2] {
    let reach = match d.below(4) {
        0 => 0,
        1 => 2,
        2 => 1i64 << (mesh.lattice.subtexel_bits / 2),
        _ => 2i64 << mesh.lattice.subtexel_bits,
    };
    p.map(|v| v + d.below(2 * reach as u64 + 1) as i64 - reach)
}

/// A point on the border of a square of `2^log2` texels.
fn border(mesh: &SnappedMesh, origin: [u32; 2], log2: u8, d: &mut Dice) -> [i64; 2] {
    let bits = mesh.lattice.subtexel_bits;
    let size = 1i64 << (log2 + bits);
    let (along, far) = (d.below(size as u64) as i64, d.below(2) as i64 * size);
    let step = if d.below(2) == 0 { [along, far] } else { [far, along] };
    [0, 1].map(|k| (i64::from(origin[k]) << bits) + step[k])
}

fn any_edge(mesh: &SnappedMesh, d: &mut Dice) -> Option<[[i64; 2]; 2]> {
    let t = mesh.triangles.get(d.below(mesh.triangles.len() as u64) as usize)?;
    let k = d.below(3) as usize;
    Some([t[k], t[(k + 1) % 3]].map(|i| mesh.positions[i as usize]).map(|p| [p[0], p[1]]))
}

fn between([a, b]: [[i64; 2]; 2], part: f64) -> [i64; 2] {
    [0, 1].map(|k| a[k] + ((b[k] - a[k]) as f64 * part) as i64)
}

fn edge_point(mesh: &SnappedMesh, d: &mut Dice) -> Option<[i64; 2]> {
    Some(between(any_edge(mesh, d)?, d.below(1 << 20) as f64 / (1 << 20) as f64))
}

/// Where two edges cross, if a few draws find such two; else a vertex.
fn tip(mesh: &SnappedMesh, d: &mut Dice) -> Option<[i64; 2]> {
    let first = any_edge(mesh, d)?;
    for _ in 0..4 {
        let [p, q] = any_edge(mesh, d)?;
        let cross = |a: [i64; 2], b: [i64; 2]| a[0] as f64 * b[1] as f64 - a[1] as f64 * b[0] as f64;
        let minus = |a: [i64; 2], b: [i64; 2]| [a[0] - b[0], a[1] - b[1]];
        let (u, v, w) = (minus(first[1], first[0]), minus(q, p), minus(p, first[0]));
        let (s, t) = (cross(w, v) / cross(u, v), cross(w, u) / cross(u, v));
        if [s, t].iter().all(|x| (0.0..=1.0).contains(x)) {
            return Some(between(first, s));
        }
    }
    Some(first[0])
}
