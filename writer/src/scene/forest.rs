//! A forest: uneven ground and trees of thin leaves, every one of them a closed solid.
//!
//! A tree is a bent trunk, straight branches that start inside it, and leaves (flat spindles a few millimetres thick)
//! near the branches. Trees stand on a jittered grid, so the forest has no rows and trunks never meet.

use super::View;
use super::random::{Random, noise2};
use super::shape::{Builder, Frame, polygon};
use crate::mesh::Mesh;

/// Side of the square of ground that a tree has to itself, in metres.
const PITCH: f64 = 8.6;

/// Generates the forest; about `size` times 300 m x 300 m, 1150 trees and 2 000 000 triangles.
pub(super) fn build(seed: u64, size: f64) -> Mesh {
    let half = 150.0 * size.sqrt();
    let mut builder = Builder::default();
    builder.ground(half, (2.0 * half).round() as u32, -12.0, |x, z| height(seed, x, z));
    let trees = (2.0 * half / PITCH).floor() as i64;
    for (i, k) in (0..trees).flat_map(|k| (0..trees).map(move |i| (i, k))) {
        let random = Random::new(seed, [i, k]);
        let place = |c: i64, jitter: f64| ((c as f64 + 0.5) - trees as f64 / 2.0 + jitter) * PITCH;
        let (x, z) = (place(i, random.range(-0.38, 0.38)), place(k, random.range(-0.38, 0.38)));
        // Here and there a clearing.
        let clearing = noise2(seed ^ 77, [x / 45.0, z / 45.0]) > 0.62;
        if !clearing {
            tree(&mut builder, &random, &Frame::WORLD.at([x, height(seed, x, z), z]));
        }
    }
    builder.mesh
}

/// Height of the ground in metres, within 8 of zero.
fn height(seed: u64, x: f64, z: f64) -> f64 {
    let octave = |lane: u64, length: f64| noise2(seed ^ (lane << 32), [x / length, z / length]);
    5.0 * octave(1, 90.0) + 1.2 * octave(2, 23.0) + 0.25 * octave(3, 5.0) + 0.08 * octave(4, 1.7)
}

/// One tree with its foot at the frame's origin.
fn tree(builder: &mut Builder, random: &Random, foot: &Frame) {
    let tall = random.range(3.5, 7.5);
    let conifer = random.chance(0.35);
    let radius = tall * random.range(0.013, 0.018);
    let sides = random.count(6, 8);
    // The trunk bends in three stretches and starts below the ground.
    let outline = polygon(sides);
    let mut spine = vec![[0.0, -0.6, 0.0]];
    let mut rings = Vec::new();
    for step in 0..4 {
        if step > 0 {
            let [x, _, z] = spine[step - 1];
            let sway = if conifer { 0.01 } else { 0.035 } * tall;
            let lean = [random.range(-sway, sway), random.range(-sway, sway)];
            spine.push([x + lean[0], tall * step as f64 / 3.0, z + lean[1]]);
        }
        let [x, y, z] = spine[step];
        let r = radius * [1.5, 0.9, 0.6, 0.2][step];
        rings.push(outline.iter().map(|p| [x + p[0] * r, y, z + p[1] * r]).collect::<Vec<_>>());
    }
    let turn = random.range(-0.9, 0.9);
    let trunk = foot.yawed(turn);
    builder.loft(&trunk, &rings);
    let on_trunk = |share: f64| {
        let along = (share * 3.0).clamp(0.0, 2.999);
        let (step, f) = (along as usize, along - along.floor());
        [0, 1, 2].map(|k| spine[step][k] + (spine[step + 1][k] - spine[step][k]) * f)
    };

    let branches = random.count(9, 13);
    let leaves = random.count(195, 310) / branches;
    for branch in 0..branches {
        let share = (f64::from(branch) + random.unit()) / f64::from(branches);
        let start = if conifer { 0.15 + 0.8 * share } else { 0.3 + 0.68 * share };
        // Conifers narrow to the top; other crowns are widest in their middle.
        let reach = if conifer { 1.05 - share } else { 0.4 + 1.9 * share * (1.0 - share) };
        let length = (tall * 0.3 * reach * random.range(0.75, 1.2)).max(0.5);
        let rise = if conifer { random.range(-0.25, 0.15) } else { random.range(0.1, 0.9) };
        // A quarter turn from branch to branch, and a random rest: all sides get their share.
        let out = trunk.at(on_trunk(start)).quarter(branch).yawed(random.range(-0.41, 0.41));
        let thick = radius * (1.1 - start) * 0.45;
        limb(builder, random, &out, length, rise, thick);
        for _ in 0..leaves {
            let along = length * random.range(0.3, 1.06);
            let spread = 0.12 + 0.16 * along;
            let p = [0, 1, 2].map(|_| random.range(-1.0, 1.0) * spread);
            let at = out.at([along + p[0], rise * along + p[1] * 0.7, p[2]]);
            leaf(builder, random, &at, conifer);
        }
    }
}

/// A branch from the origin along +x that rises by `rise` a metre.
fn limb(builder: &mut Builder, random: &Random, frame: &Frame, length: f64, rise: f64, thick: f64) {
    let outline = polygon(random.count(4, 5));
    let end = thick * random.range(0.2, 0.4);
    // Rings stand across x, from z towards y, which is the loft's order along +x.
    let ring = |x: f64, r: f64| outline.iter().map(|p| [x, rise * x + p[0] * r, p[1] * r]).rev().collect::<Vec<_>>();
    builder.loft(frame, &[ring(0.0, thick), ring(length, end)]);
}

/// One leaf: a kite or a triangle, raised on both sides by a few millimetres.
fn leaf(builder: &mut Builder, random: &Random, at: &Frame, narrow: bool) {
    let quaternion = [1.0, random.range(-0.5, 0.5), random.range(-3.0, 3.0), random.range(-0.5, 0.5)];
    let length = random.range(0.18, 0.36);
    let width = length * if narrow { random.range(0.3, 0.45) } else { random.range(0.55, 0.85) };
    let thick = random.range(0.0015, 0.005);
    let frame = at.spun(quaternion);
    let sides = if random.chance(0.4) { 4 } else { 3 };
    builder.spindle(&frame, sides, [length * 0.5, width * 0.5], [-thick, 0.0, thick]);
}

/// A view over the trees to the ground between them.
pub(super) fn view(seed: u64, size: f64) -> View {
    let half = 150.0 * size.sqrt();
    let away = half.min(60.0);
    let [x, z] = [-away * 0.6, away * 0.5];
    let ground = height(seed, 0.0, 0.0);
    // Above the trees both here and there.
    let eye = [x, ground.max(height(seed, x, z)) + 14.0, z];
    View { eye, target: [0.0, ground + 2.0, 0.0], fov_degrees: 42.0 }
}

#[cfg(test)]
mod tests {
    use super::super::check::{audit, fingerprint};
    use super::*;

    #[test]
    fn every_leaf_is_a_closed_solid() {
        let mesh = build(1, 1.0);
        let report = audit(&mesh);
        assert_eq!(report.cavities, 0);
        assert!((1_900_000..2_100_000).contains(&report.triangles), "{}", report.triangles);
        assert!(report.solids > 200_000, "{}", report.solids);
        assert_eq!(fingerprint(&mesh), 0x39D1_6445_0C7D_2FDE, "{:#X}", fingerprint(&mesh));
    }

    #[test]
    fn size_and_seed_matter() {
        let small = audit(&build(2, 0.05));
        assert!((70_000..130_000).contains(&small.triangles), "{}", small.triangles);
        assert_ne!(fingerprint(&build(2, 0.05)), fingerprint(&build(3, 0.05)));
    }
}
