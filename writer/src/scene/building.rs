//! Buildings: each function raises one on a [`Lot`], of several closed solids.
//!
//! Solids of a building touch (a roof lies exactly on its walls, machines stand exactly on a roof), nest (a core inside
//! the walls, a hollow with furniture in it) and interpenetrate (floor plates and fins run right through the walls, so
//! that each makes its share of balconies, cornices and niches with few triangles). Floor plates, fins and roofs all
//! differ in size by continuous random amounts: no two solids share a corner and no two buildings are congruent.

use super::random::Random;
use super::shape::{Builder, Frame};

/// Where a building stands: its frame (origin on the ground in the middle, y up) and what room it has.
pub(super) struct Lot {
    pub(super) frame: Frame,
    /// Half the width (x) and half the depth (z) in metres.
    pub(super) half: [f64; 2],
    /// The height that the place calls for, in metres.
    pub(super) height: f64,
}

impl Lot {
    /// Draws how deep the walls reach: four in five sink 0.5 to 2 m, the others stand exactly on the ground.
    fn foot(&self, random: &Random) -> f64 {
        if random.chance(0.2) { 0.0 } else { -random.range(0.5, 2.0) }
    }
}

/// A high-rise: stacked tiers with floor plates and fins, machines and a mast on top.
pub(super) fn tower(builder: &mut Builder, random: &Random, lot: &Lot) {
    let frame = &lot.frame;
    let tiers = random.count(2, 4);
    let mut half = lot.half.map(|h| h * random.range(0.82, 0.96));
    let mut low = lot.foot(random);
    let mut top = 0.0;
    for tier in 0..tiers {
        top += lot.height / f64::from(tiers) * random.range(0.8, 1.2);
        core(builder, random, frame, half, [low, top]);
        let step = random.range(3.1, 4.6).max((top - low) / 5.0);
        plates(builder, random, frame, half, [low.max(0.0), top], step);
        fins(builder, random, frame, half, [low, top]);
        builder.rim(frame, half.map(|h| h - random.range(0.02, 0.12)), random.range(0.25, 0.5), [top, top + 1.1]);
        // Odd tiers stand exactly on the roof below, even ones reach into it.
        low = if tier % 2 == 0 { top } else { top - random.range(0.4, 1.5) };
        half = half.map(|h| h * random.range(0.66, 0.88));
    }
    machines(builder, random, frame, half, top);
    if random.chance(0.7) {
        mast(builder, random, &frame.at([half[0] * random.range(-0.4, 0.4), top, half[1] * 0.2]), lot.height * 0.22);
    }
}

/// A high-rise of 5 to 8 sides, tapering, with a collar at each setback.
pub(super) fn rotunda(builder: &mut Builder, random: &Random, lot: &Lot) {
    let frame = &lot.frame.yawed(random.range(-0.4, 0.4));
    let sides = random.count(5, 8);
    let mut r = lot.half[0].min(lot.half[1]) * random.range(0.75, 0.92);
    let mut y = lot.foot(random);
    let mut top = 0.0;
    for _ in 0..random.count(2, 4) {
        top += lot.height * random.range(0.22, 0.4);
        builder.pole(frame, sides, [r, r * random.range(0.93, 0.99)], [y, top]);
        let step = random.range(3.4, 5.0).max((top - y) / 5.0);
        let mut ring = y.max(0.0) + step;
        while ring < top - 0.5 {
            builder.pole(frame, sides, [r + random.range(0.3, 0.9); 2], [ring, ring + random.range(0.3, 0.6)]);
            ring += step;
        }
        builder.pole(frame, sides, [r + 0.2, r + random.range(0.5, 0.9)], [top - random.range(0.6, 0.9), top + 0.3]);
        y = top - random.range(0.1, 0.4);
        r *= random.range(0.7, 0.86);
    }
    builder.spindle(frame, sides, [r, r], [top - 1.0, top + 0.35, top + r * random.range(0.8, 2.0)]);
    mast(builder, random, &frame.at([0.0, top + 0.2, 0.0]), r * 3.0);
}

/// A slab of flats with a grid of balconies on both long sides and machines on its flat roof.
pub(super) fn flats(builder: &mut Builder, random: &Random, lot: &Lot) {
    let frame = &lot.frame;
    let half = [lot.half[0] * random.range(0.85, 0.97), lot.half[1] * random.range(0.5, 0.7)];
    let top = lot.height.clamp(12.0, 36.0) * random.range(0.85, 1.15);
    let low = lot.foot(random);
    core(builder, random, frame, half, [low, top]);
    let storey = random.range(2.8, 3.4) * if random.chance(0.12) { 1.0 } else { 2.0 };
    let columns = (half[0] / random.range(2.6, 3.6)).floor().max(2.0);
    let pitch = 2.0 * half[0] / columns;
    for side in [0, 2] {
        let wall = frame.quarter(side).at([0.0, 0.0, half[1]]);
        let mut y = storey;
        while y < top - 1.5 {
            // A row is either one long gallery or a balcony to each flat.
            if random.chance(0.96) {
                let out = random.range(0.8, 1.6);
                let ends = [random.range(0.2, 0.9), random.range(0.2, 0.9)];
                builder.cuboid(&wall, [ends[0] - half[0], y, -0.4], [half[0] - ends[1], y + 0.25, out]);
                if random.chance(0.25) {
                    let rail = [ends[1] - half[0], y + 0.9, out - 0.1];
                    builder.cuboid(&wall, rail, [half[0] - ends[0], y + 1.1, out + 0.05]);
                }
            } else {
                for column in 0..columns as u32 {
                    let x = (f64::from(column) + 0.5 + random.range(-0.1, 0.1)) * pitch - half[0];
                    let (w, out) = (pitch * random.range(0.28, 0.4), random.range(0.8, 1.5));
                    builder.cuboid(&wall, [x - w, y, -0.3], [x + w, y + random.range(0.2, 1.1), out]);
                }
            }
            y += storey;
        }
        doorway(builder, random, &wall, half[0]);
    }
    fins(builder, random, frame, half, [low, top]);
    builder.cuboid(
        frame,
        [-half[0] - random.range(0.3, 0.8), top, -half[1] - random.range(0.3, 0.8)],
        [half[0] + random.range(0.3, 0.8), top + random.range(0.3, 0.6), half[1] + random.range(0.3, 0.8)],
    );
    // The slab's own top differs from building to building, so the machines sink into it instead.
    machines(builder, random, frame, half, top + 0.2);
}

/// A house with a pitched roof, chimney, dormers, a porch, and a fence around its garden.
pub(super) fn house(builder: &mut Builder, random: &Random, lot: &Lot) {
    let half = [lot.half[0] * random.range(0.45, 0.62), lot.half[1] * random.range(0.38, 0.52)];
    let frame = &lot.frame.at([lot.half[0] * random.range(-0.2, 0.2), 0.0, lot.half[1] * random.range(-0.2, 0.1)]);
    let top = random.range(3.2, 7.5);
    let low = lot.foot(random);
    core(builder, random, frame, half, [low, top]);
    pitched(builder, random, frame, half, top);
    for side in 0..4 {
        let reach = if side % 2 == 0 { half } else { [half[1], half[0]] };
        let wall = frame.quarter(side).at([0.0, 0.0, reach[1]]);
        if side == 0 {
            doorway(builder, random, &wall, reach[0]);
        } else if random.chance(0.2) {
            bay(builder, random, &wall, reach[0], [0.9, top.min(3.0) - 0.3]);
        }
    }
    // A wing at right angles, its roof running into the main one.
    if random.chance(0.5) {
        let wing = frame.at([half[0] * random.range(-0.3, 0.3), 0.0, half[1] * random.range(0.7, 0.9)]).quarter(1);
        let size = [half[1] * random.range(0.6, 0.9), half[0] * random.range(0.3, 0.45)];
        let eave = top * random.range(0.7, 0.95);
        core(builder, random, &wing, size, [lot.foot(random), eave]);
        pitched(builder, random, &wing, size, eave);
    }
    if random.chance(0.5) {
        fence(builder, random, &lot.frame, lot.half.map(|h| h - random.range(0.3, 0.9)));
    }
}

/// Houses wall to wall along x: neighbours share a plane exactly and nothing else.
pub(super) fn row(builder: &mut Builder, random: &Random, lot: &Lot) {
    let low = lot.foot(random);
    let mut x = -lot.half[0];
    while x < lot.half[0] - 5.0 {
        let next = (x + random.range(9.0, 19.0)).min(lot.half[0]);
        let z = [random.range(-1.0, -0.75) * lot.half[1], random.range(0.55, 0.8) * lot.half[1]];
        let top = lot.height.clamp(8.0, 18.0) * random.range(0.75, 1.2);
        let sink = low - random.range(0.0, 0.4);
        builder.cuboid(&lot.frame, [x, if low < 0.0 { sink } else { 0.0 }, z[0]], [next, top, z[1]]);
        let eave = [random.range(0.3, 0.6), random.range(0.3, 0.6)];
        let inset = [random.range(0.02, 0.1), random.range(0.02, 0.1)];
        let roof = [[x + inset[0], z[0] - eave[0]], [next - inset[1], z[1] + eave[1]]];
        let ridge = top + (z[1] - z[0]) * random.range(0.2, 0.42);
        builder.roof(&lot.frame, roof, [top, ridge], 0.0, random.range(0.4, 0.6));
        // The chimney stands on the party wall and pierces both roofs.
        let c = [x + random.range(-0.2, 0.4), (z[0] + z[1]) / 2.0 + random.range(-2.0, 2.0)];
        let (w, d) = (random.range(0.4, 0.7), random.range(0.5, 1.1));
        builder.cuboid(&lot.frame, [c[0], top - 1.0, c[1] - d], [c[0] + w, ridge + random.range(0.5, 1.3), c[1] + d]);
        let wall = lot.frame.at([(x + next) / 2.0, 0.0, z[1]]);
        let reach = (next - x) / 2.0;
        let mut y = random.range(3.0, 3.6);
        while y < top - 2.0 {
            if random.chance(0.12) {
                bay(builder, random, &wall, reach, [y, y + random.range(1.5, 2.0)]);
            } else if random.chance(0.7) {
                let sill = [-reach * random.range(0.6, 0.95), y, -0.3];
                builder.cuboid(&wall, sill, [reach * random.range(0.6, 0.95), y + 0.3, random.range(0.3, 1.2)]);
            }
            y += random.range(3.0, 3.5);
        }
        let back = wall.at([0.0, 0.0, z[0] - z[1]]).quarter(2);
        builder.cuboid(&back, [-reach * 0.8, 2.6, -0.2], [reach * random.range(0.2, 0.8), 2.8, random.range(1.0, 2.5)]);
        if random.chance(0.3) {
            doorway(builder, random, &wall, reach);
        }
        x = next;
    }
}

/// Four wings around a court, crossing at the corners.
pub(super) fn court(builder: &mut Builder, random: &Random, lot: &Lot) {
    for side in 0..4 {
        let reach = if side % 2 == 0 { lot.half } else { [lot.half[1], lot.half[0]] };
        let deep = random.range(4.5, 6.0).min(reach[1] * 0.35);
        let wing = lot.frame.quarter(side).at([random.range(-0.2, 0.2), 0.0, reach[1] - deep - random.range(0.2, 1.0)]);
        let half = [reach[0] - random.range(0.4, 1.4), deep];
        let top = lot.height.clamp(10.0, 24.0) * random.range(0.85, 1.15);
        let low = lot.foot(random);
        core(builder, random, &wing, half, [low, top]);
        plates(builder, random, &wing, half, [0.0, top], random.range(3.6, 6.2));
        fins(builder, random, &wing, half, [low, top]);
        pitched(builder, random, &wing, half.map(|h| h + 0.4), top);
        if random.chance(0.35) {
            doorway(builder, random, &wing.at([0.0, 0.0, half[1]]), half[0]);
        }
    }
}

/// A hall with a saw-tooth roof, vents and a loading ramp.
pub(super) fn works(builder: &mut Builder, random: &Random, lot: &Lot) {
    let frame = &lot.frame;
    let half = lot.half.map(|h| h * random.range(0.78, 0.93));
    let top = random.range(6.0, 11.0);
    let low = lot.foot(random);
    core(builder, random, frame, half, [low, top]);
    let teeth = (half[1] / random.range(3.5, 5.5)).floor().max(2.0) as u32;
    let pitch = 2.0 * half[1] / f64::from(teeth);
    for tooth in 0..teeth {
        let z = f64::from(tooth) * pitch - half[1];
        let x = [random.range(0.05, 0.3), random.range(0.05, 0.3)];
        let rect =
            [[x[0] - half[0], z + random.range(0.02, 0.1)], [half[0] - x[1], z + pitch - random.range(0.02, 0.1)]];
        builder.roof(frame, rect, [top, top + pitch * random.range(0.35, 0.5)], 0.0, 1.0);
        if random.chance(0.3) {
            let vent = frame.at([half[0] * random.range(-0.8, 0.8), top, z + pitch * 0.5]);
            builder.pole(&vent, 6, [random.range(0.3, 0.6), random.range(0.25, 0.4)], [-0.5, pitch * 0.6 + 1.0]);
        }
    }
    let wall = frame.at([0.0, 0.0, half[1]]);
    doorway(builder, random, &wall, half[0]);
    let ramp = wall.at([half[0] * 0.4, 0.0, 0.0]);
    builder.roof(&ramp, [[-3.0, -0.5], [random.range(2.0, 4.0), random.range(3.0, 6.0)]], [-0.3, 1.2], 0.0, 0.0);
    if random.chance(0.6) {
        let chimney = frame.at([half[0] * 0.7, 0.0, -half[1] * random.range(0.2, 0.8)]);
        let tall = top + random.range(10.0, 22.0);
        builder.pole(&chimney, 8, [random.range(1.3, 1.8), random.range(0.8, 1.1)], [0.0, tall]);
        builder.pole(&chimney, 8, [random.range(1.2, 1.4); 2], [tall - 1.5, tall - random.range(0.6, 1.0)]);
    }
    fence(builder, random, &lot.frame, lot.half.map(|h| h - random.range(0.2, 0.6)));
}

/// A nave with buttresses, a tower and a spire.
pub(super) fn church(builder: &mut Builder, random: &Random, lot: &Lot) {
    let frame = &lot.frame;
    let half = [lot.half[0] * random.range(0.7, 0.8), lot.half[1] * random.range(0.35, 0.45)];
    let top = random.range(9.0, 14.0);
    let low = lot.foot(random);
    core(builder, random, frame, half, [low, top]);
    pitched(builder, random, frame, half, top);
    for bay in 0..6 {
        let x = (f64::from(bay) + 0.5 + random.range(-0.05, 0.05)) / 3.0 * half[0] - half[0];
        let (w, out) = (random.range(0.35, 0.6), half[1] + random.range(1.0, 2.2));
        builder.cuboid(frame, [x - w, low, -out], [x + w, top * random.range(0.6, 0.8), out]);
    }
    let tower = frame.at([-half[0], 0.0, 0.0]);
    let (w, tall) = (half[1] * random.range(0.55, 0.7), top * random.range(1.7, 2.3));
    core(builder, random, &tower, [w, w * random.range(0.95, 1.05)], [lot.foot(random), tall]);
    plates(builder, random, &tower, [w, w], [0.0, tall], tall / 4.3);
    builder.spindle(&tower.yawed(0.2), 8, [w * 1.2, w * 1.2], [tall - 2.0, tall + 0.2, tall * random.range(1.5, 1.9)]);
    doorway(builder, random, &tower.quarter(3).at([0.0, 0.0, w * 1.03]), w);
}

/// The walls of a building, often with something inside: a core, or a hollow, with or without furniture.
fn core(builder: &mut Builder, random: &Random, frame: &Frame, half: [f64; 2], [low, top]: [f64; 2]) {
    builder.cuboid(frame, [-half[0], low, -half[1]], [half[0], top, half[1]]);
    let (inside, floor, ceiling) = (random.unit(), low + 0.6, top - random.range(0.4, 0.9));
    let wall = half.map(|h| h - random.range(0.3, 0.6));
    if inside < 0.12 {
        builder.cavity(frame, [-wall[0], floor, -wall[1]], [wall[0], ceiling, wall[1]]);
        if inside < 0.06 {
            builder.cuboid(
                frame,
                [-wall[0] * 0.3, floor + 0.1, -wall[1] * 0.5],
                [wall[0] * 0.4, floor + 1.1, wall[1] * 0.2],
            );
        }
    } else if inside < 0.3 {
        builder.cuboid(frame, [-wall[0] * 0.5, floor, -wall[1] * 0.4], [wall[0] * 0.2, ceiling, wall[1] * 0.6]);
    }
}

/// Floor plates that jut out all around.
fn plates(builder: &mut Builder, random: &Random, frame: &Frame, half: [f64; 2], [low, top]: [f64; 2], step: f64) {
    let jut = random.range(0.35, 1.1);
    let mut y = low + step;
    while y < top - 0.4 {
        let out = [0, 1, 2, 3].map(|k| half[k % 2] + jut * random.range(0.85, 1.15));
        builder.cuboid(frame, [-out[0], y, -out[1]], [out[2], y + random.range(0.25, 0.5), out[3]]);
        y += step;
    }
}

/// Upright fins that run right through and stick out at both sides.
fn fins(builder: &mut Builder, random: &Random, frame: &Frame, half: [f64; 2], [low, top]: [f64; 2]) {
    for (axis, across) in [(0, 1), (1, 0)] {
        let turned = frame.quarter(axis as u32);
        let number = (half[axis] / random.range(6.0, 12.0)).floor().clamp(1.0, 3.0);
        let (jut, width) = (random.range(0.25, 0.8), random.range(0.12, 0.3));
        for i in 0..number as u32 {
            let x = ((f64::from(i) + 0.5 + random.range(-0.12, 0.12)) / number * 2.0 - 1.0) * half[axis];
            let out = [half[across] + jut * random.range(0.8, 1.2), half[across] + jut * random.range(0.8, 1.2)];
            let high = top + random.range(-0.5, 0.9);
            builder.cuboid(
                &turned,
                [x - width, low.max(0.0) + random.range(0.0, 3.0), -out[0]],
                [x + width, high, out[1]],
            );
        }
    }
}

/// A gable or hip roof lying exactly on the walls, with a chimney and dormers.
fn pitched(builder: &mut Builder, random: &Random, frame: &Frame, half: [f64; 2], top: f64) {
    let eave = [0, 1, 2, 3].map(|k| half[k % 2] + random.range(0.2, 0.8));
    let rise = (eave[1] + eave[3]) * random.range(0.22, 0.48);
    let hip = if random.chance(0.45) { half[0] * random.range(0.2, 0.8) } else { 0.0 };
    builder.roof(frame, [[-eave[0], -eave[1]], [eave[2], eave[3]]], [top, top + rise], hip, random.range(0.45, 0.55));
    let chimney = [half[0] * random.range(-0.6, 0.6), half[1] * random.range(-0.3, 0.3)];
    let (w, d) = (random.range(0.3, 0.6), random.range(0.25, 0.5));
    let high = top + rise + random.range(0.3, 1.2);
    builder.cuboid(frame, [chimney[0] - w, top - 0.7, chimney[1] - d], [chimney[0] + w, high, chimney[1] + d]);
    let pot = frame.at([chimney[0], high, chimney[1]]);
    builder.pole(&pot, 4, [d * 0.6, d * 0.5], [0.0, random.range(0.3, 0.6)]);
    let ridge = 2.0 * (half[0] - hip);
    for i in 0..(ridge / 16.0).clamp(0.0, 2.0) as u32 {
        let x = (f64::from(i) + random.range(0.3, 0.7)) / 3.0 * ridge - ridge / 2.0;
        let side = if random.chance(0.5) { 0 } else { 2 };
        let dormer = frame.quarter(side).at([x, top, half[1] * 0.75]).quarter(3);
        let (w, tall) = (random.range(0.6, 0.9), rise * random.range(0.25, 0.4) + 0.5);
        builder.cuboid(&dormer, [-half[1] * 0.5, -0.3, -w], [random.range(0.0, 0.3), tall, w]);
        let over = [w + random.range(0.08, 0.2), w + random.range(0.08, 0.2)];
        let lid = [[-half[1] * 0.6, -over[0]], [random.range(0.35, 0.6), over[1]]];
        builder.roof(&dormer, lid, [tall, tall + w * random.range(0.6, 1.0)], 0.0, 0.5);
    }
}

/// A row of windows: recesses in a panel that stands out of the wall. `wall` faces +z.
fn bay(builder: &mut Builder, random: &Random, wall: &Frame, reach: f64, [low, high]: [f64; 2]) {
    let span = [-reach * random.range(0.6, 0.85), reach * random.range(0.6, 0.85)];
    let out = random.range(0.1, 0.3);
    let windows = ((span[1] - span[0]) / 2.6).clamp(1.0, 3.0) as u32;
    let frame = [random.range(0.15, 0.4), random.range(0.12, 0.25), out + random.range(0.05, 0.25)];
    builder.niched(wall, [[span[0], low, -0.6], [span[1], high, out]], windows, frame);
    // The sill.
    builder.cuboid(
        wall,
        [span[0] - 0.1, low - 0.12, -0.2],
        [span[1] + 0.15, low + 0.05, out + random.range(0.15, 0.4)],
    );
}

/// A portal with a recessed door, a step and a canopy. `wall` faces +z.
fn doorway(builder: &mut Builder, random: &Random, wall: &Frame, reach: f64) {
    let at = wall.at([reach * random.range(-0.4, 0.4), 0.0, 0.0]);
    let (w, tall, out) = (random.range(0.7, 1.3), random.range(2.2, 2.9), random.range(0.25, 0.7));
    let sizes = [random.range(0.12, 0.25), 0.15, out + random.range(0.05, 0.2)];
    builder.niched(&at, [[-w, -0.1, -0.8], [w, tall, out]], 1, sizes);
    builder.cuboid(&at, [-w - 0.2, -0.3, -0.3], [w + 0.3, random.range(0.12, 0.3), out + random.range(0.6, 1.2)]);
    let hood = out + random.range(0.5, 1.3);
    builder.cuboid(&at, [-w - 0.3, tall - 0.05, -0.35], [w + random.range(0.2, 0.5), tall + 0.15, hood]);
}

/// Boxes, ducts and an open tank on a flat roof at height `top`.
fn machines(builder: &mut Builder, random: &Random, frame: &Frame, half: [f64; 2], top: f64) {
    for _ in 0..random.count(1, 3) {
        let size = [0, 1].map(|k| (half[k] * random.range(0.06, 0.2)).max(0.4));
        let place = [0, 1].map(|k| (half[k] * 0.9 - size[k]) * random.range(-1.0, 1.0));
        let at = frame.at([place[0], top, place[1]]).yawed(random.range(-0.15, 0.15));
        let high = random.range(0.8, 2.6);
        if random.chance(0.7) {
            builder.cuboid(&at, [-size[0], 0.0, -size[1]], [size[0], high, size[1]]);
        } else {
            // Seen from above this is a niche: a tank without a lid.
            let low = [-size[0], -size[1], -0.1];
            builder.niched(&at.tipped(), [low, [size[0], size[1], high]], 1, [0.12, 0.12, high * 0.8]);
        }
    }
}

/// A thin mast in two stretches with cross-pieces.
fn mast(builder: &mut Builder, random: &Random, foot: &Frame, tall: f64) {
    let sides = random.count(5, 8);
    let r = random.range(0.1, 0.25);
    builder.pole(foot, sides, [r, r * 0.8], [-0.5, tall * 0.6]);
    builder.pole(foot, sides, [r * 0.6, r * 0.3], [tall * 0.55, tall]);
    for _ in 0..random.count(1, 3) {
        let y = tall * random.range(0.4, 0.95);
        let arm = random.range(0.5, 1.6);
        builder.cuboid(&foot.yawed(random.range(-0.9, 0.9)), [-arm, y, -0.06], [arm, y + 0.12, 0.07]);
    }
}

/// Posts and two rails around a rectangle, with a gap for a gate.
fn fence(builder: &mut Builder, random: &Random, frame: &Frame, half: [f64; 2]) {
    let tall = random.range(1.0, 1.8);
    for side in 0..4 {
        let reach = if side % 2 == 0 { half } else { [half[1], half[0]] };
        let line = frame.quarter(side).at([0.0, 0.0, reach[1]]);
        let start = if side == 0 { -reach[0] * random.range(0.3, 0.6) } else { -reach[0] };
        for rail in [0.35, 0.85] {
            let y = tall * rail * random.range(0.95, 1.05);
            builder.cuboid(
                &line,
                [start - random.range(0.1, 0.3), y, -0.05],
                [reach[0] + random.range(0.05, 0.1), y + 0.12, 0.04],
            );
        }
        let posts = ((reach[0] - start) / random.range(16.0, 26.0)).floor().max(2.0);
        for post in 0..posts as u32 {
            let x = start + (reach[0] - start) * (f64::from(post) + random.range(0.3, 0.6)) / posts;
            let w = random.range(0.07, 0.12);
            builder.cuboid(&line, [x - w, -0.4, -w], [x + w, tall + random.range(0.0, 0.15), w * 1.1]);
        }
    }
}
