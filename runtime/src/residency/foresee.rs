//! Which pages a moving camera will need, from the index alone.
//!
//! A page matters to the receivers in its box: its footprint, and the depths between the smallest and the largest that
//! lookups in it can answer; all others are settled without it. So a page is foreseen where its box comes into the picture that
//! the camera will see some frames on, near enough that a pixel there asks for a level that the page has. Only pages are named
//! that the present picture does not ask for by the same measure: what it lacks the device reports, and knows better.

use umbrage_format::PageRecord;
use umbrage_format::projection::{Lattice, UNCOVERED};
use umbrage_reader::query::Bounds;
use umbrage_reader::query::filter::{LOD_BITS, level_of_detail, nearest_level};

use super::{Residency, Span};

/// Most boxes that are worth a look in a frame.
pub const MOST_BOXES: usize = 4096;
/// Most pages that are foreseen in a frame.
const MOST_PAGES: usize = 64;

type V3 = [f64; 3];

/// A camera: where it is and what it sees, in world units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Viewpoint {
    /// Where it is.
    pub eye: V3,
    /// Unit vectors: to the right, up, and into the picture, at right angles to each other.
    pub axes: [V3; 3],
    /// Tangents of half the field of view, across and up.
    pub half: [f64; 2],
    /// Pixels of the picture, across and down.
    pub pixels: [u32; 2],
}

impl Viewpoint {
    /// Where it will be if it goes on as it came from `before`: `steps` times as far, in place and direction.
    pub fn ahead(&self, before: &Self, steps: f64) -> Self {
        let on = |now: V3, then: V3| -> V3 { std::array::from_fn(|k| now[k] + steps * (now[k] - then[k])) };
        let forward = unit(on(self.axes[2], before.axes[2])).unwrap_or(self.axes[2]);
        let up = on(self.axes[1], before.axes[1]);
        // Right-handed, as it was: right, up and the way back.
        let right = unit(cross(forward, up)).unwrap_or(self.axes[0]);
        Self { eye: on(self.eye, before.eye), axes: [right, cross(right, forward), forward], ..*self }
    }

    /// A world point as this camera has it: to the right, up, away.
    fn local(&self, p: V3) -> V3 {
        let way: V3 = std::array::from_fn(|k| p[k] - self.eye[k]);
        self.axes.map(|a| dot(a, way))
    }
}

/// What is known of a light for one structure, once.
#[derive(Clone, Debug)]
pub struct Foresight {
    lattice: Lattice,
    /// Columns of the inverse: a step of the lattice in the world.
    steps: [V3; 3],
    origin: V3,
}

/// A camera in the frame before and now, and how many frames to look ahead.
#[derive(Clone, Copy, Debug)]
pub struct Way<'a> {
    /// In the frame before.
    pub before: &'a Viewpoint,
    /// Now.
    pub now: &'a Viewpoint,
    /// Frames from now.
    pub frames: f64,
}

/// Lists that a look needs, so that one frame takes them over from another: pages to look at, and those that were found.
#[derive(Clone, Debug)]
pub struct Looks {
    open: Vec<u32>,
    found: Vec<(u32, u32)>,
}

impl Default for Looks {
    fn default() -> Self {
        Self { open: Vec::with_capacity(MOST_BOXES + 256), found: Vec::with_capacity(MOST_BOXES) }
    }
}

/// A box of the lattice, ends included.
type Area = [[f64; 2]; 3];

impl Foresight {
    /// For the light of a structure. None where its map can't be inverted, which no checked file has.
    pub fn new(lattice: Lattice) -> Option<Self> {
        let rows = lattice.world_to_lattice.map(|r| [r[0], r[1], r[2]]);
        let [a, b, c] = rows;
        let volume = dot(a, cross(b, c));
        if volume == 0.0 || !volume.is_finite() {
            return None;
        }
        let steps = [cross(b, c), cross(c, a), cross(a, b)].map(|v| v.map(|x| x / volume));
        let [x, y, z] = lattice.world_to_lattice.map(|r| r[3]);
        let origin = std::array::from_fn(|k| -(steps[0][k] * x + steps[1][k] * y + steps[2][k] * z));
        Some(Self { lattice, steps, origin })
    }

    /// Foresees what a camera will need some frames from now if it goes on as it came; `record` gives the record of a page of
    /// the structure where that costs no read. Looks at no more than `most` boxes, at most [`MOST_BOXES`]; gives how many
    /// pages were named.
    pub fn look(
        &self,
        way: &Way<'_>,
        residency: &mut Residency,
        span: &Span,
        Looks { open, found }: &mut Looks,
        most: usize,
        record: impl Fn(u32) -> Option<PageRecord>,
    ) -> usize {
        if way.before == way.now {
            return 0;
        }
        let (now, then) = (way.now, way.now.ahead(way.before, way.frames));
        open.extend(span.root_places());
        let mut looked = 0;
        while let Some(page) = open.pop() {
            for (child, told) in residency.children(page) {
                looked += 1;
                if looked > most {
                    open.clear();
                    break;
                }
                let Some(record) = child.checked_sub(span.base).and_then(&record) else { continue };
                let Some(area) = self.span(&record, &told.bounds) else { continue };
                let Some(weight) = self.weight(&then, &area, record.level_coarsest) else { continue };
                if residency.is_resident(child) {
                    open.push(child);
                } else if self.weight(now, &area, record.level_coarsest).is_none() {
                    found.push((child, weight));
                }
            }
        }
        found.sort_unstable_by_key(|&(page, weight)| (std::cmp::Reverse(weight), page));
        found.truncate(MOST_PAGES);
        found.iter().for_each(|&(page, weight)| residency.foresee(page, weight));
        let count = found.len();
        found.clear();
        count
    }

    /// The box of the receivers that a page matters to; none where there are none.
    fn span(&self, record: &PageRecord, bounds: &Bounds) -> Option<Area> {
        if bounds.min_depth >= bounds.max_depth {
            return None;
        }
        let texel = f64::from(self.lattice.subtexel_bits).exp2();
        let side = |origin: u32, log2: u8| {
            let from = f64::from(origin);
            [from * texel, (from + f64::from(log2).exp2()) * texel]
        };
        let far = if bounds.max_depth == UNCOVERED { UNCOVERED - 1 } else { bounds.max_depth };
        let (x, y) = (record.origin_x.get(), record.origin_y.get());
        Some([side(x, record.log2_x), side(y, record.log2_y), [bounds.min_depth.into(), far.into()]])
    }

    fn to_world(&self, p: V3) -> V3 {
        let [x, y, z] = self.steps;
        std::array::from_fn(|k| self.origin[k] + x[k] * p[0] + y[k] * p[1] + z[k] * p[2])
    }

    /// What a box weighs in a picture: its pixels there, for each level that the answers without its page are too coarse. None
    /// where it lies outside, or where no pixel asks for a level at or below `level`.
    fn weight(&self, from: &Viewpoint, span: &Area, level: u8) -> Option<u32> {
        let eye = self.lattice.to_lattice(from.eye);
        let nearest = std::array::from_fn(|k| eye[k].clamp(span[k][0], span[k][1]));
        let way: V3 = std::array::from_fn(|k| self.to_world(nearest)[k] - from.eye[k]);
        let distance = dot(way, way).sqrt();
        let pixel = distance * 2.0 * from.half[1] / f64::from(from.pixels[1].max(1));
        let texel = f64::from(self.lattice.subtexel_bits).exp2();
        let [x, y] = [0, 1].map(|i: usize| {
            let [a, b, c, _] = self.lattice.world_to_lattice[i];
            dot([a, b, c], [a, b, c]).sqrt() * pixel / texel
        });
        let asked = nearest_level(level_of_detail([[x, 0.0], [0.0, y]], self.lattice.log2_resolution));
        let gap = level.checked_sub(asked)?;
        let corner = |i: usize| {
            let at = |k: usize| span[k][i >> k & 1];
            from.local(self.to_world([at(0), at(1), at(2)]))
        };
        let corners: [V3; 8] = std::array::from_fn(corner);
        let [across, up] = from.half;
        let beyond = |f: &dyn Fn(&V3) -> bool| corners.iter().all(f);
        if beyond(&|c| c[2] <= 0.0)
            || beyond(&|c| c[0] > across * c[2])
            || beyond(&|c| -c[0] > across * c[2])
            || beyond(&|c| c[1] > up * c[2])
            || beyond(&|c| -c[1] > up * c[2])
        {
            return None;
        }
        let mut share = 1.0;
        if corners.iter().all(|c| c[2] > 0.0) {
            for (k, half) in [(0, across), (1, up)] {
                let at = corners.map(|c| (c[k] / (c[2] * half)).clamp(-1.0, 1.0));
                share *=
                    (at.iter().fold(-1.0, |m: f64, v| m.max(*v)) - at.iter().fold(1.0, |m: f64, v| m.min(*v))) / 2.0;
            }
        }
        let pixels = share * f64::from(from.pixels[0]) * f64::from(from.pixels[1]);
        // Saturates.
        Some((pixels * f64::from(gap.min(LOD_BITS as u8)).exp2()) as u32)
    }
}

fn dot(a: V3, b: V3) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: V3, b: V3) -> V3 {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn unit(v: V3) -> Option<V3> {
    let length = dot(v, v).sqrt();
    (length > 0.0 && length.is_finite()).then(|| v.map(|x| x / length))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Light along -y: lattice x is world x, lattice y world z, depth grows downward; 256 steps for a texel of one unit.
    fn light() -> Lattice {
        let world_to_lattice = [[256.0, 0.0, 0.0, 2048.0], [0.0, 0.0, 256.0, 2048.0], [0.0, -256.0, 0.0, 1_000_000.0]];
        Lattice { world_to_lattice, log2_resolution: 4, subtexel_bits: 8 }
    }

    fn record(x: u32, y: u32, log2: u8, level: u8) -> PageRecord {
        let mut r = PageRecord::zeroed();
        (r.origin_x, r.origin_y, r.log2_x, r.log2_y, r.level_coarsest) = (x.into(), y.into(), log2, log2, level);
        r
    }

    /// At a place, looking along +x.
    fn at(eye: V3) -> Viewpoint {
        let axes = [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]];
        Viewpoint { eye, axes, half: [1.0, 1.0], pixels: [100, 100] }
    }

    #[test]
    fn boxes_are_where_the_world_has_them() {
        let f = Foresight::new(light()).unwrap();
        let bounds = Bounds { min_depth: 1_000_000 - 512, max_depth: 1_000_000, stop_error: 9 };
        let span = f.span(&record(8, 4, 2, 2), &bounds).unwrap();
        let near = |a: V3, b: V3| (0..3).all(|k| (a[k] - b[k]).abs() < 1e-9);
        assert!(near(f.to_world([span[0][0], span[1][0], span[2][0]]), [0.0, 2.0, -4.0]));
        assert!(near(f.to_world([span[0][1], span[1][1], span[2][1]]), [4.0, 0.0, 0.0]));
        for flat in [Bounds { max_depth: 5, min_depth: 5, stop_error: 9 }, Bounds { max_depth: 0, ..bounds }] {
            assert_eq!(f.span(&record(8, 4, 2, 2), &flat), None, "all answers on one side of every receiver");
        }
    }

    #[test]
    fn what_is_seen_near_enough_weighs() {
        let f = Foresight::new(light()).unwrap();
        let bounds = Bounds { min_depth: 1_000_000 - 512, max_depth: 1_000_000, stop_error: 9 };
        let span = f.span(&record(8, 4, 2, 2), &bounds).unwrap();
        // The box is 4 units long in x from 0, 2 high from 0, 4 wide in z up to 0.
        let weight = |eye, level| f.weight(&at(eye), &span, level);
        assert!(weight([-3.0, 1.0, -2.0], 2).is_some());
        assert!(weight([-3.0, 1.0, -2.0], 2) > weight([-30.0, 1.0, -2.0], 2), "it is larger from near");
        for outside in [[5.0, 1.0, -2.0], [-3.0, 1.0, 9.0], [-3.0, 30.0, -2.0], [-3.0, 1.0, -20.0]] {
            assert_eq!(weight(outside, 2), None, "{outside:?}");
        }
        // 100 pixels over 90 degrees: at 100 units a pixel is 2 units, 2 texels.
        assert_eq!((weight([-100.0, 1.0, -2.0], 0), weight([-100.0, 1.0, -2.0], 1).is_some()), (None, true));
        assert!(weight([1.0, 1.0, -2.0], 2).is_some(), "from inside");
    }

    #[test]
    fn a_camera_goes_on_as_it_came() {
        let (then, now) = (at([0.0; 3]), at([1.0, 0.0, 0.0]));
        assert_eq!(now.ahead(&then, 3.0).eye, [4.0, 0.0, 0.0]);
        assert_eq!(now.ahead(&then, 3.0).axes, now.axes);
        let angle = 0.1f64;
        let (s, c) = angle.sin_cos();
        let turned = Viewpoint { axes: [[-s, 0.0, c], [0.0, 1.0, 0.0], [c, 0.0, s]], ..then };
        let ahead = turned.ahead(&then, 1.0);
        let further = (2.0 * angle).sin_cos();
        assert!((ahead.axes[2][0] - further.1).abs() < 0.01 && (ahead.axes[2][2] - further.0).abs() < 0.01);
        for (i, a) in ahead.axes.iter().enumerate() {
            let others =
                ahead.axes.iter().enumerate().map(|(j, b)| if i == j { dot(*a, *b) - 1.0 } else { dot(*a, *b) });
            assert!(others.into_iter().all(|v| v.abs() < 1e-12));
        }
    }
}
