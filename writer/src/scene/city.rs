//! A city: blocks on an irregular grid of streets, each turned its own way, over gently rolling ground.
//!
//! The ground is one slab. Every block has a level plate sunk into it, on which its buildings stand; lamps and trees
//! line the streets. What is built where follows the distance to the centre: towers, then courts, flats and rows, then
//! houses and works. Each block draws from its own stream of random numbers.

use super::View;
use super::building::{self, Lot};
use super::random::{Random, noise2};
use super::shape::{Builder, Frame, rational, sphere};
use crate::mesh::Mesh;

/// The eye of the demo view; buildings near it are kept lower than it.
const EYE: [f64; 3] = [165.0, 72.0, -190.0];

/// Generates the city; `size` times 2 km x 2 km.
pub(super) fn build(seed: u64, size: f64) -> Mesh {
    let half = 1000.0 * size.sqrt();
    let mut city = City { seed, half, builder: Builder::default() };
    let cells = (half / 30.0).round() as u32;
    city.builder.ground(half, cells, -14.0, |x, z| height(seed, x, z));
    let (columns, rows) = (cuts(seed, half, 1), cuts(seed, half, 2));
    for (k, z) in rows.iter().enumerate() {
        for (i, x) in columns.iter().enumerate() {
            city.block(&Random::new(seed, [i as i64, k as i64]), *x, *z);
        }
    }
    city.builder.mesh
}

/// Where blocks lie along one axis: begin and end of each, with streets between.
fn cuts(seed: u64, half: f64, axis: i64) -> Vec<[f64; 2]> {
    let random = Random::new(seed, [-1, axis]);
    let mut blocks = Vec::new();
    let mut at = random.range(8.0, 16.0) - half;
    loop {
        let end = at + random.range(145.0, 225.0);
        if end > half - 8.0 {
            return blocks;
        }
        blocks.push([at, end]);
        at = end + random.range(13.0, 24.0);
    }
}

/// Height of the ground in metres, within 5 of zero.
fn height(seed: u64, x: f64, z: f64) -> f64 {
    3.5 * noise2(seed ^ 0xA1, [x / 420.0, z / 420.0]) + 1.2 * noise2(seed ^ 0xA2, [x / 150.0, z / 150.0])
}

struct City {
    seed: u64,
    half: f64,
    builder: Builder,
}

impl City {
    /// One block: plate, buildings, lamps and trees.
    fn block(&mut self, random: &Random, x: [f64; 2], z: [f64; 2]) {
        let middle = [(x[0] + x[1]) / 2.0, (z[0] + z[1]) / 2.0];
        let room = [(x[1] - x[0]) / 2.0, (z[1] - z[0]) / 2.0];
        // One block in four keeps to the axes; there, planes are shared exactly.
        let turn = if random.chance(0.25) { 0.0 } else { random.range(-0.2, 0.2) };
        let half = inscribed(room, turn);
        let mut top = f64::NEG_INFINITY;
        for (i, k) in (0..7).flat_map(|k| (0..7).map(move |i| (f64::from(i) / 3.0 - 1.0, f64::from(k) / 3.0 - 1.0))) {
            top = height(self.seed, middle[0] + i * room[0], middle[1] + k * room[1]).max(top);
        }
        // Above all of the ground that it covers.
        let frame = Frame::WORLD.at([middle[0], top + random.range(0.2, 0.35), middle[1]]).yawed(turn);
        self.plate(random, &frame, half);
        self.kerb(random, &frame, half);

        let inner = half.map(|h| h - 4.0);
        let centre = (middle[0] * middle[0] + middle[1] * middle[1]).sqrt() / self.half;
        let urban = 1.0 - centre + random.range(-0.25, 0.25);
        let kind = random.unit();
        if kind < 0.07 {
            self.park(random, &frame, inner);
        } else if urban < 0.55 && kind < 0.2 {
            self.lots(random, &frame, inner, 75.0, building::works);
        } else if urban > 0.25 && kind < 0.32 {
            let wide = inner[1] * random.range(0.26, 0.36);
            for side in [0, 2] {
                let lot = frame.quarter(side).at([0.0, 0.0, inner[1] - wide]);
                let tall = self.height_at(random, &lot, urban);
                building::row(&mut self.builder, random, &Lot { frame: lot, half: [inner[0], wide], height: tall });
            }
            self.park(random, &frame, [inner[0] * 0.9, inner[1] * 0.3]);
        } else if urban > 0.3 && kind < 0.47 {
            self.lots(random, &frame, inner, 95.0, building::court);
        } else if urban < 0.35 && kind < 0.8 {
            self.lots(random, &frame, inner, 66.0, building::house);
        } else {
            self.mixed(random, &frame, inner, urban);
        }
    }

    /// The level plate of a block: its corners cut, its top at the frame's y = 0.
    fn plate(&mut self, random: &Random, frame: &Frame, half: [f64; 2]) {
        let mut outline = Vec::new();
        for [x, z] in [[1.0, -1.0], [1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0]] {
            let cut = [random.range(2.0, 5.0), random.range(2.0, 5.0)];
            let mut corner = [[x * half[0], z * (half[1] - cut[1])], [x * (half[0] - cut[0]), z * half[1]]];
            if x * z > 0.0 {
                outline.extend(corner);
            } else {
                corner.reverse();
                outline.extend(corner);
            }
        }
        self.builder.extrude(frame, &outline, [-6.0, 0.0]);
    }

    /// Lamps and trees along the edge of a plate.
    fn kerb(&mut self, random: &Random, frame: &Frame, half: [f64; 2]) {
        for side in 0..4 {
            let reach = if side % 2 == 0 { half } else { [half[1], half[0]] };
            let line = frame.quarter(side).at([0.0, 0.0, reach[1] - 1.2]);
            let places = (reach[0] / 23.0).floor();
            for i in 0..places as u32 {
                let x = ((f64::from(i) + random.range(0.35, 0.65)) / places * 2.0 - 1.0) * (reach[0] - 5.0);
                let at = line.at([x, 0.0, random.range(-0.3, 0.3)]);
                match random.count(0, 3) {
                    0 => self.lamp(random, &at),
                    1 | 2 => self.tree(random, &at),
                    _ => {}
                }
            }
        }
    }

    fn lamp(&mut self, random: &Random, foot: &Frame) {
        let tall = random.range(5.0, 8.0);
        let reach = random.range(1.0, 2.2);
        self.builder.pole(foot, random.count(5, 6), [0.11, 0.07], [-0.6, tall]);
        self.builder.cuboid(foot, [-0.12, tall - 0.2, -0.2], [0.13, tall - 0.05, reach + random.range(0.1, 0.3)]);
    }

    /// A tree: a trunk and one to three crowns that cut into each other.
    fn tree(&mut self, random: &Random, foot: &Frame) {
        let tall = random.range(4.0, 11.0);
        let foot = foot.yawed(random.range(-0.9, 0.9));
        self.builder.pole(&foot, random.count(3, 5), [tall * 0.03, tall * 0.02], [-0.5, tall * 0.6]);
        if random.chance(0.3) {
            for level in 0..2 {
                let (y, r) = (tall * (0.25 + 0.3 * f64::from(level)), tall * (0.24 - 0.08 * f64::from(level)));
                let radii = [r * random.range(0.9, 1.1), r * random.range(0.9, 1.1)];
                let layer = foot.yawed(random.range(-0.5, 0.5));
                self.builder.spindle(&layer, 6, radii, [y - 0.05 * tall, y, y + tall * 0.42]);
            }
            return;
        }
        for _ in 0..random.count(1, 2) {
            let r = [0, 1, 2].map(|_| tall * random.range(0.18, 0.3));
            let at = [0, 1, 2].map(|k| tall * (random.range(-0.1, 0.1) + if k == 1 { 0.7 } else { 0.0 }));
            let (points, triangles) = sphere(if random.chance(0.2) { 2 } else { 1 });
            let points: Vec<_> = points.iter().map(|p| [p[0] * r[0], p[1] * r[1], p[2] * r[2]]).collect();
            self.builder.solid(&foot.at(at).yawed(random.range(-0.5, 0.5)), &points, &triangles);
        }
    }

    /// Trees and benches, a pavilion on poles.
    fn park(&mut self, random: &Random, frame: &Frame, half: [f64; 2]) {
        let area = 4.0 * half[0] * half[1];
        for _ in 0..(area / 330.0) as u32 {
            let at = [half[0] * random.range(-1.0, 1.0), 0.0, half[1] * random.range(-1.0, 1.0)];
            self.tree(random, &frame.at(at));
        }
        for _ in 0..(area / 1500.0) as u32 {
            let at = [half[0] * random.range(-1.0, 1.0), 0.0, half[1] * random.range(-1.0, 1.0)];
            let bench = frame.at(at).yawed(random.range(-1.0, 1.0));
            let wide = random.range(0.7, 1.2);
            self.builder.cuboid(&bench, [-wide, 0.4, -0.25], [wide, 0.48, 0.25]);
            self.builder.cuboid(&bench, [-wide * 0.8, -0.1, -0.2], [0.12 - wide * 0.8, 0.45, 0.2]);
            self.builder.cuboid(&bench, [wide * 0.8 - 0.12, -0.1, -0.2], [wide * 0.8, 0.45, 0.2]);
        }
        if area < 2000.0 {
            return;
        }
        let r = random.range(4.0, 8.0);
        for k in 0..6 {
            let (c, s) = rational([-1.6, -0.6, -0.1, 0.4, 1.1, 4.0][k]);
            let post = frame.at([c * r * 0.85, 0.0, s * r * 0.85]);
            self.builder.pole(&post, 6, [0.18, random.range(0.13, 0.17)], [0.0, 4.0]);
        }
        self.builder.spindle(frame, 8, [r, r * random.range(0.9, 1.0)], [3.2, 3.7, random.range(5.0, 7.5)]);
    }

    /// Divides a rectangle into lots about `pitch` wide and raises the same kind of building on each.
    fn lots(
        &mut self,
        random: &Random,
        frame: &Frame,
        half: [f64; 2],
        pitch: f64,
        raise: fn(&mut Builder, &Random, &Lot),
    ) {
        for lot in divide(random, frame, half, pitch) {
            let height = self.height_at(random, &lot.frame, 0.35);
            raise(&mut self.builder, random, &Lot { height, ..lot });
        }
    }

    /// Lots of an inner block, each with a building of its own kind.
    fn mixed(&mut self, random: &Random, frame: &Frame, half: [f64; 2], urban: f64) {
        for lot in divide(random, frame, half, 66.0) {
            let height = self.height_at(random, &lot.frame, urban);
            let lot = Lot { height, ..lot };
            let raise = match random.unit() {
                _ if height < 14.0 => building::flats,
                kind if kind < 0.44 && height > 22.0 => building::tower,
                kind if kind < 0.58 && height > 22.0 => building::rotunda,
                kind if kind < 0.62 => building::church,
                kind if kind < 0.9 => building::flats,
                _ => building::court,
            };
            raise(&mut self.builder, random, &lot);
        }
    }

    /// How high to build: higher towards the centre, and nowhere in the way of the demo view.
    fn height_at(&self, random: &Random, frame: &Frame, urban: f64) -> f64 {
        let u = urban.clamp(0.0, 1.0);
        let wanted = random.range(10.0, 24.0) + 75.0 * u * u * random.range(0.3, 1.0);
        let [x, _, z] = frame.point([0.0; 3]);
        // Along the view, from the eye to the ground under its target.
        let away = [x - EYE[0], z - EYE[2]];
        let along = -(away[0] * EYE[0] + away[1] * EYE[2]) / (EYE[0] * EYE[0] + EYE[2] * EYE[2]);
        let along = along.clamp(0.0, 0.75);
        let off = [away[0] + along * EYE[0], away[1] + along * EYE[2]];
        let distance = (off[0] * off[0] + off[1] * off[1]).sqrt();
        let limit = EYE[1] * (0.3 - 0.15 * along) + 0.45 * (distance - 20.0).max(0.0);
        wanted.min(limit)
    }
}

/// The half sizes of the largest rectangle of the same shape that fits in `room` when turned.
fn inscribed(room: [f64; 2], turn: f64) -> [f64; 2] {
    let (c, s) = rational(turn);
    let s = s.abs();
    let fit = (room[0] / (c * room[0] + s * room[1])).min(room[1] / (s * room[0] + c * room[1]));
    room.map(|h| h * fit)
}

/// Lots of a rectangle, with alleys between and some turned a little of their own.
fn divide(random: &Random, frame: &Frame, half: [f64; 2], pitch: f64) -> Vec<Lot> {
    let number = half.map(|h| (2.0 * h / pitch).round().max(1.0) as u32);
    let mut edges = [Vec::new(), Vec::new()];
    for k in 0..2 {
        let step = 2.0 * half[k] / f64::from(number[k]);
        for i in 0..=number[k] {
            let jitter = if i == 0 || i == number[k] { 0.0 } else { random.range(-0.15, 0.15) };
            edges[k].push((f64::from(i) + jitter) * step - half[k]);
        }
    }
    let mut lots = Vec::new();
    for z in edges[1].windows(2) {
        for x in edges[0].windows(2) {
            let room = [(x[1] - x[0]) / 2.0 - 1.2, (z[1] - z[0]) / 2.0 - 1.2];
            let turn = if random.chance(0.5) { random.range(-0.12, 0.12) } else { 0.0 };
            let frame = frame.at([(x[0] + x[1]) / 2.0, 0.0, (z[0] + z[1]) / 2.0]).yawed(turn);
            // Fronts face the nearer street.
            let back = if z[0] + z[1] < 0.0 { 2 } else { 0 };
            lots.push(Lot { frame: frame.quarter(back), half: inscribed(room, turn), height: 0.0 });
        }
    }
    lots
}

/// A view over the roofs down into the streets and a park, across the direction of the demo light.
pub(super) fn view() -> View {
    View { eye: EYE, target: [330.0, 6.0, -380.0], fov_degrees: 45.0 }
}

#[cfg(test)]
mod tests {
    use super::super::check::{audit, fingerprint};
    use super::*;

    #[test]
    fn the_city_is_made_of_many_closed_solids() {
        let mesh = build(1, 1.0);
        let report = audit(&mesh);
        assert!((110_000..240_000).contains(&report.triangles), "{}", report.triangles);
        assert!(report.solids >= 8_700, "{}", report.solids);
        assert!(report.cavities > 50, "{}", report.cavities);
        assert_eq!(fingerprint(&mesh), 0xF7C0_7931_A153_46C1, "{:#X}", fingerprint(&mesh));
    }

    #[test]
    fn size_and_seed_matter() {
        let small = build(2, 0.05);
        let report = audit(&small);
        assert!(report.solids > 300, "{}", report.solids);
        assert!(report.triangles * 8 < build(2, 1.0).triangles.len());
        assert_ne!(fingerprint(&small), fingerprint(&build(3, 0.05)));
    }

    #[test]
    fn nothing_stands_about_the_eye_of_the_demo() {
        for seed in 1..8 {
            let mesh = build(seed, 0.1);
            let near = |p: &&[f64; 3]| (p[0] - EYE[0]).abs() < 25.0 && (p[2] - EYE[2]).abs() < 25.0;
            let highest = mesh.positions.iter().filter(near).map(|p| p[1]).fold(f64::NEG_INFINITY, f64::max);
            assert!(highest < EYE[1] - 4.0, "seed {seed}: {highest}");
        }
    }

    #[test]
    fn several_seeds_and_sizes_are_closed() {
        for (seed, size) in [(3, 0.3), (u64::MAX, 0.5), (0, 2.0)] {
            audit(&build(seed, size));
        }
    }
}
