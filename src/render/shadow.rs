//! The reference: exact light rays through lattice points against the snapped triangles.
//!
//! Nothing here is rounded. The hierarchy only leaves out triangles whose box the ray misses; boxes are integers and
//! hold their triangles with room to spare.

use rayon::prelude::*;

use super::depth::{Depth, Projected, entry};
use super::scene::{Scene, View};

/// Exact shadow queries against a scene.
#[derive(Clone, Copy)]
pub struct ShadowRays<'a> {
    scene: &'a Scene<'a>,
}

impl<'a> ShadowRays<'a> {
    /// Uses the scene's hierarchy.
    pub const fn new(scene: &'a Scene<'a>) -> ShadowRays<'a> {
        ShadowRays { scene }
    }

    /// Whether light reaches the lattice point `xy` at `depth`: no triangle's closed projection contains `xy` with an
    /// exact depth below `depth`. A triangle seen edge-on counts with the first depth at which the ray touches it.
    pub fn lit(&self, xy: [i64; 2], depth: &Depth) -> bool {
        let surface = self.scene.surface();
        let mut lit = true;
        self.scene.bvh().along_light(xy, depth.ceil() - 1, |triangle, limit| {
            let corners = surface.corners(triangle);
            let [a, b, c] = corners.map(|p| p[2]);
            // Most triangles lie wholly on one side of the receiver: that spares the division.
            if a.min(b).min(c) > limit {
                return limit;
            }
            let before = match Projected::new(&corners, xy) {
                Some(p) => p.contains() && (a.max(b).max(c) < depth.floor() || p.depth() < *depth),
                None => entry(&corners, xy).is_some_and(|d| d < *depth),
            };
            lit &= !before;
            if before { i64::MIN } else { limit }
        });
        lit
    }

    /// The first surface on the light ray at `xy`: its depth and triangle (of several at one depth, the one of lowest
    /// index); nothing where the ray meets none.
    pub fn first(&self, xy: [i64; 2]) -> Option<(Depth, u32)> {
        let surface = self.scene.surface();
        let mut best: Option<(Depth, u32)> = None;
        self.scene.bvh().along_light(xy, i64::MAX, |triangle, limit| {
            let corners = surface.corners(triangle);
            if corners.iter().all(|c| c[2] > limit) {
                return limit;
            }
            match entry(&corners, xy) {
                Some(depth) if best.is_none_or(|b| (depth, triangle) < b) => {
                    best = Some((depth, triangle));
                    // Corners are integers: what is not behind this depth has one at or before its floor.
                    depth.floor()
                }
                _ => limit,
            }
        });
        best
    }

    /// [`ShadowRays::lit`] for every pixel, rows in parallel; the sky is lit. `row_done` as in [`Scene::view`].
    pub fn view(&self, view: &View, row_done: &(dyn Fn() -> bool + Sync)) -> Option<Vec<bool>> {
        let mut lit = vec![true; view.receivers.len()];
        let row = (view.width as usize).max(1);
        lit.par_chunks_mut(row)
            .zip(view.receivers.par_chunks(row))
            .try_for_each(|(lit, receivers)| {
                for (lit, receiver) in lit.iter_mut().zip(receivers) {
                    *lit = receiver.as_ref().is_none_or(|r| self.lit(r.xy, &r.depth));
                }
                row_done().then_some(())
            })
            .map(|()| lit)
    }
}

#[cfg(test)]
mod tests {
    use super::super::camera::{Camera, UpAxis};
    use super::super::scene::Surface;
    use super::super::testing::{Rng, TestMesh, boxes, lattice, soup, sphere};
    use super::*;

    fn brute(surface: Surface<'_>, xy: [i64; 2]) -> Option<(Depth, u32)> {
        let all = 0..surface.triangles.len() as u32;
        all.filter_map(|t| entry(&surface.corners(t), xy).map(|d| (d, t))).min()
    }

    /// Points at random, at corners, on edges and in the middle of triangles, at and around the depths there.
    fn compare(mesh: &TestMesh, rng: &mut Rng, count: usize) -> [usize; 2] {
        let surface = mesh.surface();
        let scene = Scene::new(surface);
        let rays = ShadowRays::new(&scene);
        let side = mesh.lattice.side() as u64;
        let mut answers = [0; 2];
        for i in 0..count {
            let t = surface.corners(rng.below(surface.triangles.len() as u64) as u32);
            let mid = |a: i64, b: i64| (a + b) >> 1;
            let xy = match i % 4 {
                0 => [rng.below(side + 1) as i64, rng.below(side + 1) as i64],
                1 => [t[0][0], t[0][1]],
                2 => [mid(t[0][0], t[1][0]), mid(t[0][1], t[1][1])],
                _ => [mid(t[0][0], mid(t[1][0], t[2][0])), mid(t[0][1], mid(t[1][1], t[2][1]))],
            };
            let first = brute(surface, xy);
            assert_eq!(rays.first(xy), first, "{xy:?}");
            let mut depths = vec![Depth::integer(rng.below(1 << 32) as i64)];
            if let Some((d, _)) = first {
                depths.extend([d, Depth::integer(d.floor()), Depth::integer(d.ceil()), Depth::integer(d.floor() + 1)]);
            }
            depths.extend(entry(&t, xy));
            for d in depths {
                let lit = first.is_none_or(|f| f.0 >= d);
                assert_eq!(rays.lit(xy, &d), lit, "{xy:?} {d:?}");
                answers[usize::from(lit)] += 1;
            }
        }
        answers
    }

    #[test]
    fn equal_to_brute_force() {
        let mut rng = Rng(31);
        for (log2, size) in [(2, 1), (8, 3), (20, 8), (24, 20)] {
            let mesh = soup(&mut rng, log2, 300, size);
            let answers = compare(&mesh, &mut rng, 1500);
            assert!(answers.iter().all(|&n| n > 300), "{answers:?}");
        }
        let mesh = boxes(&mut rng, 10, 30);
        compare(&mesh, &mut rng, 3000);
        compare(&sphere(lattice(5), 16, 0.9), &mut rng, 3000);
    }

    /// Two planes that differ by less than f64 can hold at this depth.
    #[test]
    fn fractions_decide() {
        let big = 1i64 << 31;
        let mesh = TestMesh {
            lattice: lattice(24),
            positions: vec![
                [0, 0, big],
                [big, 1, big],
                [1, big, big + 1],
                [0, 0, big],
                [big, 1, big],
                [1, big - 1, big + 1],
            ],
            triangles: vec![[0, 1, 2], [3, 4, 5]],
        };
        let scene = Scene::new(mesh.surface());
        let rays = ShadowRays::new(&scene);
        let at = [12_345, 1_000_001];
        let [a, b] = [0, 1].map(|t| entry(&mesh.surface().corners(t), at).unwrap());
        assert_eq!(a.to_f64(), b.to_f64());
        assert!(a < b);
        assert!(rays.lit(at, &a) && !rays.lit(at, &b));
        assert_eq!(rays.first(at), Some((a, 0)));
    }

    #[test]
    fn pictures_equal_brute_force() {
        let mesh = boxes(&mut Rng(33), 12, 30);
        let scene = Scene::new(mesh.surface());
        let camera = Camera::new([1.6, 1.4, 2.2], [0.0, -0.4, 0.0], UpAxis::Y, 50.0).unwrap();
        let view = scene.view(&camera, 80, 45, &|| true).unwrap();
        let lit = ShadowRays::new(&scene).view(&view, &|| true).unwrap();
        let mut dark = 0;
        for (lit, r) in lit.iter().zip(&view.receivers) {
            let truth = r.is_none_or(|r| brute(mesh.surface(), r.xy).is_none_or(|f| f.0 >= r.depth));
            assert_eq!(*lit, truth);
            dark += usize::from(!lit);
        }
        assert!(dark > 100 && dark < 2500, "{dark}");
        assert!(ShadowRays::new(&scene).view(&view, &|| false).is_none());
    }
}
