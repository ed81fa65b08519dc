//! Primary visibility: camera rays in lattice space against the snapped triangles.
//!
//! The map from the world to the lattice is affine, so a world ray is a straight lattice ray with the same parameter.
//! The triangle test is that of Woop, Benthin and Wald ("Watertight Ray/Triangle Intersection", JCGT 2013) in f64: two
//! triangles that share an edge compute the same edge function up to its sign, so that no ray slips between them.

use rayon::prelude::*;
use umbrage_format::projection::Lattice;
use umbrage_writer::solid::SnappedMesh;

use super::bvh::Bvh;
use super::camera::{Camera, cross, dot, normalised};
use super::depth::Corner;
use super::receiver::Receiver;

/// The snapped triangles that pictures and shadow rays are about, borrowed.
#[derive(Clone, Copy, Debug)]
pub struct Surface<'a> {
    /// World to lattice.
    pub lattice: &'a Lattice,
    /// Corners in lattice steps, of magnitude up to 2^40: x, y across the map, z along the light.
    pub positions: &'a [[i64; 3]],
    /// Indices into `positions`; all must be in range. Fewer than 2^32 triangles.
    pub triangles: &'a [[u32; 3]],
}

impl<'a> From<&'a SnappedMesh> for Surface<'a> {
    fn from(mesh: &'a SnappedMesh) -> Surface<'a> {
        Surface { lattice: &mesh.lattice, positions: &mesh.positions, triangles: &mesh.triangles }
    }
}

impl Surface<'_> {
    /// Corners of a triangle.
    #[inline(always)]
    pub(super) fn corners(&self, triangle: u32) -> [Corner; 3] {
        let [a, b, c] = self.triangles[triangle as usize];
        [self.positions[a as usize], self.positions[b as usize], self.positions[c as usize]]
    }
}

impl Surface<'_> {
    /// How much a triangle's depth rises with one step along x and y; `None` where the light sees it edge-on.
    pub fn slope(&self, triangle: u32) -> Option<[f64; 2]> {
        let [a, b, c] = self.corners(triangle);
        let edge = |p: Corner| std::array::from_fn(|k| (p[k] - a[k]) as f64);
        let [x, y, z] = cross(edge(b), edge(c));
        (z != 0.0).then_some([-x / z, -y / z])
    }
}

/// Snapped triangles and the hierarchy over them.
pub struct Scene<'a> {
    surface: Surface<'a>,
    bvh: Bvh,
    light: [f64; 3],
    handedness: f64,
}

/// Where a camera ray first meets the snapped mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Index of the triangle; of several at one distance, the first.
    pub triangle: u32,
    /// Distance along the world ray, in multiples of its direction.
    pub t: f64,
    /// The point in lattice steps, from the triangle's corners.
    pub lattice: [f64; 3],
}

/// What a camera sees, row by row from the upper left pixel; all vectors hold `width * height` entries.
/// About 120 bytes per pixel.
pub struct View {
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// The camera.
    pub camera: Camera,
    /// Unit vector of the world in which light travels.
    pub light: [f64; 3],
    /// What the pixel's centre sees; nothing where it sees the sky.
    pub receivers: Vec<Option<Receiver>>,
    /// Distance from the eye in world units; infinite for the sky.
    pub distances: Vec<f64>,
    /// Point of the world; the direction of view for the sky.
    pub points: Vec<[f64; 3]>,
    /// Unit normal of the snapped triangle in the world, turned towards the eye; zero for the sky.
    pub normals: Vec<[f32; 3]>,
}

impl<'a> Scene<'a> {
    /// Builds the hierarchy, in parallel.
    ///
    /// # Panics
    /// If an index of a triangle is out of range.
    pub fn new(surface: impl Into<Surface<'a>>) -> Scene<'a> {
        let surface = surface.into();
        let rows = surface.lattice.world_to_lattice.map(|r| [r[0], r[1], r[2]]);
        let length = |r: [f64; 3]| dot(r, r).sqrt();
        // The size of one lattice step along each axis, in world units.
        let steps = rows.map(|r| if length(r) > 0.0 { 1.0 / length(r) } else { 0.0 });
        let handedness = if dot(cross(rows[0], rows[1]), rows[2]) < 0.0 { -1.0 } else { 1.0 };
        // Along the light, x and y of the lattice stay and z grows.
        let light = normalised(cross(rows[0], rows[1]).map(|v| v * handedness)).unwrap_or([0.0; 3]);
        Scene { surface, bvh: Bvh::build(surface, steps), light, handedness }
    }

    /// The triangles.
    pub const fn surface(&self) -> Surface<'a> {
        self.surface
    }

    /// Unit vector of the world in which light travels.
    pub const fn light(&self) -> [f64; 3] {
        self.light
    }

    pub(super) const fn bvh(&self) -> &Bvh {
        &self.bvh
    }

    /// First triangle along a world ray, in front of its origin.
    pub fn hit(&self, origin: [f64; 3], direction: [f64; 3]) -> Option<Hit> {
        let lattice = self.surface.lattice;
        let ray = LatticeRay::new(
            lattice.to_lattice(origin),
            lattice.world_to_lattice.map(|r| (r[0] * direction[0] + r[1] * direction[1]) + r[2] * direction[2]),
        );
        let mut best: Option<(f64, u32)> = None;
        self.bvh.closest(ray.origin, ray.direction, |triangle, limit| {
            match ray.meet(&self.surface.corners(triangle)) {
                Some((t, _)) if best.is_none_or(|b| (t, triangle) < b) => {
                    best = Some((t, triangle));
                    t
                }
                _ => limit,
            }
        });
        let (t, triangle) = best?;
        let corners = self.surface.corners(triangle);
        let (_, weights) = ray.meet(&corners)?;
        let lattice = std::array::from_fn(|k| (0..3).map(|i| weights[i] * corners[i][k] as f64).sum());
        Some(Hit { triangle, t, lattice })
    }

    /// Unit normal of a triangle in the world, on the side from which it is counter-clockwise; zero without area.
    pub fn normal(&self, triangle: u32) -> [f64; 3] {
        let [a, b, c] = self.surface.corners(triangle);
        let edge = |p: Corner| std::array::from_fn(|k| (p[k] - a[k]) as f64);
        let n = cross(edge(b), edge(c));
        // A normal is a covector: it goes back to the world by the transposed matrix.
        let m = &self.surface.lattice.world_to_lattice;
        let world = std::array::from_fn(|k| m[0][k] * n[0] + m[1][k] * n[1] + m[2][k] * n[2]);
        normalised(world).map_or([0.0; 3], |v| v.map(|v| v * self.handedness))
    }

    /// Casts one ray through the centre of each pixel, rows in parallel. `row_done` is called after each row from any
    /// thread; once it returns false the remaining rows are left out and the answer is `None`.
    pub fn view(&self, camera: &Camera, width: u32, height: u32, row_done: &(dyn Fn() -> bool + Sync)) -> Option<View> {
        let count = width as usize * height as usize;
        let mut view = View {
            width,
            height,
            camera: *camera,
            light: self.light,
            receivers: vec![None; count],
            distances: vec![f64::INFINITY; count],
            points: vec![[0.0; 3]; count],
            normals: vec![[0.0; 3]; count],
        };
        let row = (width as usize).max(1);
        let rows = view
            .receivers
            .par_chunks_mut(row)
            .zip(view.distances.par_chunks_mut(row))
            .zip(view.points.par_chunks_mut(row).zip(view.normals.par_chunks_mut(row)))
            .enumerate();
        let done = rows.try_for_each(|(y, ((receivers, distances), (points, normals)))| {
            for x in 0..receivers.len() {
                let direction = camera.ray(x as f64 + 0.5, y as f64 + 0.5, width, height);
                let Some(hit) = self.hit(camera.eye(), direction) else {
                    points[x] = direction;
                    continue;
                };
                receivers[x] = Some(Receiver::new(self.surface, &hit));
                distances[x] = hit.t;
                points[x] = std::array::from_fn(|k| camera.eye()[k] + hit.t * direction[k]);
                let normal = self.normal(hit.triangle);
                let side = if dot(normal, direction) > 0.0 { -1.0 } else { 1.0 };
                normals[x] = normal.map(|v| (v * side) as f32);
            }
            row_done().then_some(())
        });
        done.map(|()| view)
    }
}

/// A lattice ray, and the shear that makes it run along one axis.
struct LatticeRay {
    origin: [f64; 3],
    direction: [f64; 3],
    /// Two coordinates across the ray (each with a coefficient 0, so that no dynamic axis is looked up per corner)
    /// and the distance along it.
    rows: [[f64; 3]; 3],
}

impl LatticeRay {
    fn new(origin: [f64; 3], direction: [f64; 3]) -> LatticeRay {
        let z = (0..3).max_by(|&a, &b| direction[a].abs().total_cmp(&direction[b].abs())).unwrap_or(2);
        let mut rows = [[0.0; 3]; 3];
        for (row, axis) in [(z + 1) % 3, (z + 2) % 3].into_iter().enumerate() {
            rows[row][axis] = 1.0;
            rows[row][z] = -direction[axis] / direction[z];
        }
        rows[2][z] = 1.0 / direction[z];
        LatticeRay { origin, direction, rows }
    }

    /// Distance (> 0) and weights of the corners; edges and corners belong to the triangle.
    #[inline(always)]
    fn meet(&self, corners: &[Corner; 3]) -> Option<(f64, [f64; 3])> {
        let [a, b, c] = [self.shear(&corners[0]), self.shear(&corners[1]), self.shear(&corners[2])];
        let u = c[0] * b[1] - c[1] * b[0];
        let v = a[0] * c[1] - a[1] * c[0];
        let w = b[0] * a[1] - b[1] * a[0];
        if (u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0) {
            return None;
        }
        let sum = u + v + w;
        if sum == 0.0 {
            return None;
        }
        let weights = [u / sum, v / sum, w / sum];
        let t = weights[0] * a[2] + weights[1] * b[2] + weights[2] * c[2];
        (t > 0.0).then_some((t, weights))
    }

    #[inline(always)]
    fn shear(&self, p: &Corner) -> [f64; 3] {
        let (o, r) = (&self.origin, &self.rows);
        let d = [p[0] as f64 - o[0], p[1] as f64 - o[1], p[2] as f64 - o[2]];
        let row = |r: &[f64; 3]| (r[0] * d[0] + r[1] * d[1]) + r[2] * d[2];
        [row(&r[0]), row(&r[1]), row(&r[2])]
    }
}

#[cfg(test)]
mod tests {
    use super::super::camera::UpAxis;
    use super::super::testing::{Rng, TestMesh, boxes, lattice, snap, soup, sphere};
    use super::*;

    fn brute(scene: &Scene<'_>, origin: [f64; 3], direction: [f64; 3]) -> Option<(f64, u32)> {
        let m = &scene.surface.lattice.world_to_lattice;
        let linear = m.map(|r| (r[0] * direction[0] + r[1] * direction[1]) + r[2] * direction[2]);
        let ray = LatticeRay::new(scene.surface.lattice.to_lattice(origin), linear);
        (0..scene.surface.triangles.len() as u32)
            .filter_map(|t| ray.meet(&scene.surface.corners(t)).map(|(d, _)| (d, t)))
            .min_by(|a, b| a.partial_cmp(b).unwrap())
    }

    fn compare(mesh: &TestMesh, rng: &mut Rng, rays: usize) -> usize {
        let scene = Scene::new(mesh.surface());
        let mut hits = 0;
        for i in 0..rays {
            let mut origin = [(); 3].map(|()| rng.signed() * 2.0);
            let mut direction = [(); 3].map(|()| rng.signed());
            match i % 4 {
                // Along an axis, with zeros of both signs.
                0 => {
                    direction =
                        std::array::from_fn(|k| if k == i / 4 % 3 { -origin[k].signum() } else { -0.0 * origin[k] })
                }
                // Through a corner of the mesh.
                1 => {
                    let p = mesh.positions[rng.below(mesh.positions.len() as u64) as usize];
                    let m = mesh.lattice.world_to_lattice;
                    let world = [
                        (p[0] as f64 - m[0][3]) / m[0][0],
                        (p[2] as f64 - m[2][3]) / m[2][1],
                        (p[1] as f64 - m[1][3]) / m[1][2],
                    ];
                    direction = std::array::from_fn(|k| world[k] - origin[k]);
                }
                2 => origin = origin.map(|v| v * 0.2),
                _ => {}
            }
            let found = scene.hit(origin, direction);
            assert_eq!(found.map(|h| (h.t, h.triangle)), brute(&scene, origin, direction), "{origin:?} {direction:?}");
            hits += usize::from(found.is_some());
        }
        hits
    }

    #[test]
    fn hits_equal_brute_force() {
        let mut rng = Rng(11);
        for (log2, size) in [(8, 2), (20, 6), (24, 20)] {
            let mesh = soup(&mut rng, log2, 400, size);
            let hits = compare(&mesh, &mut rng, 1200);
            assert!(hits > 150, "{hits}");
        }
        let mesh = boxes(&mut rng, 20, 60);
        assert!(compare(&mesh, &mut rng, 4000) > 1000);
    }

    /// From inside a closed sphere every ray hits; those aimed at corners and at points of edges are the hard ones.
    #[test]
    fn watertight() {
        let mut rng = Rng(12);
        for log2 in [6, 20, 24] {
            let mesh = sphere(lattice(log2), 24, 0.9);
            let scene = Scene::new(mesh.surface());
            let m = mesh.lattice.world_to_lattice;
            let world =
                |p: [f64; 3]| [(p[0] - m[0][3]) / m[0][0], (p[2] - m[2][3]) / m[2][1], (p[1] - m[1][3]) / m[1][2]];
            for t in 0..mesh.triangles.len() as u32 {
                let c = mesh.surface().corners(t).map(|p| p.map(|v| v as f64));
                for i in 0..3 {
                    let origin = [(); 3].map(|()| rng.signed() * 0.4);
                    for s in [0.0, 0.5, (rng.signed() + 1.0) * 0.5] {
                        let at = world(std::array::from_fn(|k| c[i][k] + s * (c[(i + 1) % 3][k] - c[i][k])));
                        let d = std::array::from_fn(|k| at[k] - origin[k]);
                        let hit = scene.hit(origin, d).expect("no holes");
                        assert!((hit.t - 1.0).abs() < 0.1, "at the near side of the shell: {}", hit.t);
                    }
                }
            }
        }
    }

    /// Along the light, through corners of the mesh: every edge function of the triangles around is exactly zero.
    #[test]
    fn corners_and_edges_belong_to_their_triangles() {
        let mesh = sphere(lattice(6), 24, 0.9);
        let scene = Scene::new(mesh.surface());
        let half = mesh.lattice.side() as f64 * 0.5;
        for p in &mesh.positions {
            let world = [(p[0] as f64 - half) / half, 2.0, (p[1] as f64 - half) / half];
            let hit = scene.hit(world, [0.0, -1.0, 0.0]).expect("a corner is part of the surface");
            assert!((0..2).all(|k| (hit.lattice[k] - p[k] as f64).abs() < 1e-6));
            assert!(hit.lattice[2] < p[2] as f64 + 1e-3, "the near side: {hit:?} {p:?}");
        }
    }

    #[test]
    fn hits_lie_on_the_ray_and_normals_face_the_eye() {
        let mesh = boxes(&mut Rng(13), 20, 20);
        let scene = Scene::new(mesh.surface());
        let camera = Camera::new([2.0, 1.5, 2.5], [0.0, -0.5, 0.0], UpAxis::Y, 45.0).unwrap();
        let view = scene.view(&camera, 64, 48, &|| true).unwrap();
        let seen = view.receivers.iter().flatten().count();
        assert!(seen > 700 && seen < 64 * 48, "{seen}");
        for i in 0..view.receivers.len() {
            let Some(r) = &view.receivers[i] else {
                assert!(view.distances[i].is_infinite() && (dot(view.points[i], view.points[i]) - 1.0).abs() < 1e-12);
                continue;
            };
            let p = mesh.lattice.to_lattice(view.points[i]);
            for k in 0..2 {
                assert!((p[k] - r.xy[k] as f64).abs() < 3.0, "{p:?} {r:?}");
            }
            let n = view.normals[i].map(f64::from);
            let back: [f64; 3] = std::array::from_fn(|k| camera.eye()[k] - view.points[i][k]);
            assert!(dot(n, back) >= -1e-6);
            // Boxes: each normal is along an axis.
            assert!(n.iter().any(|v| (v.abs() - 1.0).abs() < 1e-5), "{n:?}");
        }
        // The upper side of the floor, from above.
        let down = scene.hit([0.985, 0.9, 0.985], [0.0, -1.0, 0.0]).unwrap();
        assert!((down.t - 1.8).abs() < 1e-6);
        assert!((scene.normal(down.triangle)[1] - 1.0).abs() < 1e-9, "counter-clockwise outside");
        assert!(scene.view(&camera, 64, 48, &|| false).is_none());
    }

    #[test]
    fn the_direction_of_light_comes_from_the_lattice() {
        let mesh = boxes(&mut Rng(14), 12, 1);
        assert_eq!(Scene::new(mesh.surface()).light(), [0.0, -1.0, 0.0]);
        let mut mirrored = lattice(12);
        mirrored.world_to_lattice[0] = mirrored.world_to_lattice[0].map(|v| -v);
        let mesh = snap(mirrored, &[[0.0; 3], [0.5, 0.0, 0.0], [0.0, 0.0, 0.5]], vec![[0, 2, 1]]);
        let scene = Scene::new(mesh.surface());
        assert_eq!(scene.light(), [0.0, -1.0, 0.0]);
        assert_eq!(scene.normal(0), [0.0, 1.0, 0.0]);
    }
}
