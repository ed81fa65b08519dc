//! From a hit in f64 to a point of the lattice with an exact depth, so that shadow tests are exact.

use umbrage_format::projection::Lattice;

use super::depth::{Depth, Projected};
use super::scene::{Hit, Surface};

/// How far from the hit a lattice point is looked for, in steps.
const REACH: i64 = 2;

/// How exact a receiver is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Placement {
    /// The point lies in the closed projection of the triangle and the depth is the triangle's, exactly.
    Exact,
    /// The light sees the triangle edge-on: the lattice point nearest to the hit, the hit's depth rounded up. The
    /// point may lie beside the surface, or inside the solid: no promise of a map is about it.
    EdgeOn,
    /// No lattice point near the hit lies in the triangle's projection: the nearest one, with the hit's depth in f64.
    /// No promise either.
    Unsnapped,
}

/// A point whose shadow is asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Receiver {
    /// Index of the triangle it lies on.
    pub triangle: u32,
    /// Lattice point.
    pub xy: [i64; 2],
    /// Depth there.
    pub depth: Depth,
    /// How exact they are.
    pub placement: Placement,
}

impl Receiver {
    /// Moves a hit to a lattice point of its triangle, a nearest one of those within reach.
    pub fn new(surface: Surface<'_>, hit: &Hit) -> Receiver {
        let corners = surface.corners(hit.triangle);
        let [x, y, z] = hit.lattice;
        let nearest = [x.round() as i64, y.round() as i64];
        let receiver = |xy, depth, placement| Receiver { triangle: hit.triangle, xy, depth, placement };
        let Some(at_nearest) = Projected::new(&corners, nearest) else {
            return receiver(nearest, Depth::integer(z.ceil() as i64), Placement::EdgeOn);
        };
        if at_nearest.contains() {
            return receiver(nearest, at_nearest.depth(), Placement::Exact);
        }
        let away = |p: [i64; 2]| (p[0] as f64 - x).powi(2) + (p[1] as f64 - y).powi(2);
        let around = |reach: i64| {
            let square = (-reach..=reach).flat_map(move |j| (-reach..=reach).map(move |i| [i, j]));
            square
                .map(|[i, j]| [nearest[0] + i, nearest[1] + j])
                .filter_map(|p| Projected::new(&corners, p).filter(Projected::contains).map(|at| (away(p), p, at)))
                .min_by(|a, b| a.0.total_cmp(&b.0))
        };
        match around(1).or_else(|| around(REACH)) {
            Some((_, xy, at)) => receiver(xy, at.depth(), Placement::Exact),
            None => receiver(nearest, Depth::from_f64(z), Placement::Unsnapped),
        }
    }

    /// The texel it falls into: column, row. A point on a border between texels belongs to the one of larger
    /// coordinates; the far border of the map and what is beyond belong to the last texel, what is before 0 to the
    /// first.
    pub fn texel(&self, lattice: &Lattice) -> [u32; 2] {
        let last = i64::from(lattice.resolution()) - 1;
        self.xy.map(|v| (v >> lattice.subtexel_bits).clamp(0, last) as u32)
    }

    /// Where in that texel, in 1/256 texel from its corner of smallest coordinates, rounded down.
    pub fn sub(&self, lattice: &Lattice) -> [u8; 2] {
        let side = lattice.side();
        self.xy.map(|v| (v.clamp(0, side - 1) >> (lattice.subtexel_bits - 8)) as u8)
    }

    /// Whether a map that stores `value` for [`Receiver::texel`] says lit.
    pub fn lit(&self, value: u32) -> bool {
        self.depth.query() <= value
    }
}

#[cfg(test)]
mod tests {
    use super::super::depth::entry;
    use super::super::scene::Scene;
    use super::super::testing::{Rng, TestMesh, lattice, soup};
    use super::*;

    #[test]
    fn exact_receivers_lie_on_their_triangles() {
        let mut rng = Rng(21);
        let mut kinds = [0; 3];
        for (log2, size) in [(10, 4), (20, 10), (4, 200)] {
            let mesh = soup(&mut rng, log2, 300, size);
            let scene = Scene::new(mesh.surface());
            for _ in 0..4000 {
                let origin = [(); 3].map(|()| rng.signed() * 1.5);
                let Some(hit) = scene.hit(origin, [(); 3].map(|()| rng.signed())) else { continue };
                let r = Receiver::new(mesh.surface(), &hit);
                let corners = mesh.surface().corners(r.triangle);
                let flat = Projected::new(&corners, r.xy).is_none();
                kinds[r.placement as usize] += 1;
                let away = (0..2).map(|k| (r.xy[k] as f64 - hit.lattice[k]).abs()).fold(0.0, f64::max);
                match r.placement {
                    Placement::Exact => {
                        assert!(!flat && away <= REACH as f64 + 0.5);
                        assert_eq!(entry(&corners, r.xy), Some(r.depth));
                    }
                    Placement::EdgeOn => {
                        assert!(flat && away <= 0.5);
                        assert!(r.depth.to_f64() >= hit.lattice[2] && r.depth.to_f64() < hit.lattice[2] + 1.0);
                    }
                    Placement::Unsnapped => {
                        assert!(!flat && away <= 0.5 && entry(&corners, r.xy).is_none());
                        assert_eq!(r.depth.to_f64(), hit.lattice[2]);
                    }
                }
            }
        }
        assert!(kinds[..2].iter().all(|&k| k > 50), "{kinds:?}");
    }

    #[test]
    fn the_nearest_point_is_taken() {
        let mesh = TestMesh {
            lattice: lattice(4),
            positions: vec![
                [0, 0, 0],
                [1000, 0, 2000],
                [0, 1000, 0],
                [7, 0, 0],
                [7, 9, 0],
                [8, 4, 0],
                [1001, 1, 0],
                [2003, 2, 0],
            ],
            triangles: vec![[0, 1, 2], [3, 4, 5], [0, 6, 7]],
        };
        let at = |triangle, x, y| {
            let hit = Hit { triangle, t: 1.0, lattice: [x, y, 2.0 * x] };
            let r = Receiver::new(mesh.surface(), &hit);
            (r.xy, r.depth.to_f64(), r.placement)
        };
        assert_eq!(at(0, 10.2, 20.6), ([10, 21], 20.0, Placement::Exact));
        assert_eq!(at(1, 7.55, 3.9).0, [8, 4]);
        // Rounding leaves the triangle; the closest of the others is taken.
        assert_eq!(at(1, 7.55, 6.1).0, [7, 6]);
        // A sliver without a lattice point but its corners.
        assert_eq!(at(2, 500.0, 0.4996), ([500, 0], 1000.0, Placement::Unsnapped));
        assert_eq!(at(2, 2001.4, 1.998), ([2003, 2], 0.0, Placement::Exact));
    }

    #[test]
    fn borders_belong_to_the_last_texel() {
        let lattice = lattice(4);
        let texel =
            |xy| Receiver { triangle: 0, xy, depth: Depth::integer(0), placement: Placement::Exact }.texel(&lattice);
        assert_eq!(texel([255, 256]), [0, 1]);
        assert_eq!(texel([4096, 4095]), [15, 15]);
        assert_eq!(texel([-1, 5000]), [0, 15]);
    }

    #[test]
    fn lit_up_to_the_stored_value() {
        let r = |depth| Receiver { triangle: 0, xy: [0, 0], depth, placement: Placement::Exact };
        assert!(r(Depth::integer(7)).lit(7) && !r(Depth::integer(8)).lit(7));
        assert!(!r(Depth::from_f64(7.001)).lit(7) && r(Depth::from_f64(6.999)).lit(7));
    }
}
