//! How points of the world lie in depth layers.
//!
//! In: an affine map from the world to texels and to the source's depth. Out: the [`Lattice`] of the structure record.

use umbrage_format::projection::Lattice;

use crate::frame::{self, FrameError};

/// How depths of a source become lattice depths.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum DepthScale {
    /// The range of the depths is found by rendering everything once before the bake.
    Found,
    /// All finite depths lie from the first to the second, which is larger.
    Between(f64, f64),
    /// Depths are lattice depths, 0 to 2^32 - 2, already.
    LatticeSteps,
}

/// An orthographic light's view of the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Projection {
    /// Rows of the affine map of (x, y, z, 1) in world units: column and row in texels, where texel (i, j) is the square
    /// from (i, j) to (i + 1, j + 1), and depth in the source's units.
    pub world_to_layers: [[f64; 4]; 3],
    /// The map has `1 << log2_resolution` texels on a side, 0 to 24.
    pub log2_resolution: u8,
    /// From the source's depth to the lattice.
    pub depth: DepthScale,
}

impl Projection {
    /// The view that [`bake`](crate::bake::bake) has of a scene in the box from `low` to `high` (world units): the same
    /// rows of the lattice in x and y. Depth is the distance along the light, in world units, from the plane through the
    /// world's origin; its range is that of the box.
    ///
    /// # Errors
    /// The direction, the resolution, or a box too large or too small.
    pub fn orthographic(
        direction: [f64; 3],
        low: [f64; 3],
        high: [f64; 3],
        resolution: u64,
    ) -> Result<Self, FrameError> {
        let log2_resolution = frame::log2_resolution(resolution)?;
        let corners: Vec<[f64; 3]> =
            (0..8).map(|i| [0, 1, 2].map(|k| if i >> k & 1 == 1 { high[k] } else { low[k] })).collect();
        if !(0..3).all(|k| low[k] <= high[k]) {
            return Err(FrameError::Bounds(low, high));
        }
        let lattice = frame::orthographic(direction, log2_resolution, &corners, 0.0)?;
        let z = frame::axes(direction)?[2];
        let depths = corners.iter().map(|c| frame::dot(z, *c));
        let (near, far) = depths.fold((f64::INFINITY, f64::NEG_INFINITY), |r, d| (r.0.min(d), r.1.max(d)));
        let [x, y, _] = lattice.world_to_lattice;
        let texel = |r: [f64; 4]| r.map(|v| v / (1u64 << lattice.subtexel_bits) as f64);
        Ok(Projection {
            world_to_layers: [texel(x), texel(y), [z[0], z[1], z[2], 0.0]],
            log2_resolution,
            depth: if near < far { DepthScale::Between(near, far) } else { DepthScale::Between(near, near + 1.0) },
        })
    }

    /// No world: x and y are texels, z is the source's depth.
    ///
    /// # Errors
    /// The resolution.
    pub fn image(resolution: u64) -> Result<Self, FrameError> {
        let row = |i| std::array::from_fn(|j| if i == j { 1.0 } else { 0.0 });
        let log2_resolution = frame::log2_resolution(resolution)?;
        Ok(Projection { world_to_layers: [row(0), row(1), row(2)], log2_resolution, depth: DepthScale::Found })
    }

    /// A lattice as it is; depths are lattice depths.
    pub fn of_lattice(lattice: &Lattice) -> Self {
        let [x, y, z] = lattice.world_to_lattice;
        let texel = |r: [f64; 4]| r.map(|v| v / (1u64 << lattice.subtexel_bits) as f64);
        Projection {
            world_to_layers: [texel(x), texel(y), z],
            log2_resolution: lattice.log2_resolution,
            depth: DepthScale::LatticeSteps,
        }
    }

    /// Where the light travels, as a unit vector of the world: along it texels stay and depth grows.
    ///
    /// # Errors
    /// No such direction: the map has no inverse.
    pub fn direction(&self) -> Result<[f64; 3], String> {
        let inverse = inverse(&self.world_to_layers).ok_or_else(singular)?;
        let along = inverse.map(|r| r[2]);
        let length = frame::dot(along, along).sqrt();
        let unit = along.map(|c| c / length);
        if unit.iter().all(|c| c.is_finite()) { Ok(unit) } else { Err(singular()) }
    }

    pub(super) fn check(&self) -> Result<(), String> {
        if self.log2_resolution > 24 {
            return Err(format!("log2_resolution {}: expected 0 to 24", self.log2_resolution));
        }
        if !self.world_to_layers.iter().flatten().all(|v| v.is_finite()) {
            return Err("the projection has entries that are not finite; give an affine map of the world".to_string());
        }
        self.direction().map(drop)
    }

    /// The lattice with depths as the source has them.
    pub(super) fn frame(&self) -> Lattice {
        self.lattice(1.0, 0.0)
    }

    /// The lattice with depth scaled by `scale`, then moved by `offset`.
    pub(super) fn lattice(&self, scale: f64, offset: f64) -> Lattice {
        let subtexel_bits = (28 - i32::from(self.log2_resolution)).max(8) as u8;
        let [x, y, z] = self.world_to_layers;
        let steps = |r: [f64; 4]| r.map(|v| v * (1u64 << subtexel_bits) as f64);
        let mut z = z.map(|v| v * scale);
        z[3] += offset;
        Lattice { world_to_lattice: [steps(x), steps(y), z], log2_resolution: self.log2_resolution, subtexel_bits }
    }
}

fn singular() -> String {
    "the projection maps different points of the world to one; give an affine map that has an inverse".to_string()
}

/// Scale and offset that spread a range of depths over the lattice, with the same margin as for geometry.
pub(super) fn scale(near: f64, far: f64) -> Result<(f64, f64), String> {
    let far = if near == far { near + near.abs().max(1.0) } else { far };
    let size = far - near;
    let (low, high) = (near.abs().max(far.abs()), size);
    if !(near < far && (1e-30..=1e30).contains(&high) && low <= 1e30) {
        return Err(format!(
            "depths from {near} to {far}: expected a range from smaller to larger, 1e-30 to 1e30 long"
        ));
    }
    let scale = (4294967296.0 - 2.0 * frame::DEPTH_MARGIN) / size;
    Ok((scale, frame::DEPTH_MARGIN - near * scale))
}

/// Bounds of |x|, |y|, |z| over the part of the world that the map covers.
pub(super) fn bound(lattice: &Lattice) -> [f64; 3] {
    let Some(inverse) = inverse(&lattice.world_to_lattice) else { return [0.0; 3] };
    let side = lattice.side() as f64;
    let mut bound = [0.0f64; 3];
    for i in 0..8 {
        let corner = [side, side, 4294967296.0];
        let p: [f64; 3] =
            std::array::from_fn(|k| (if i >> k & 1 == 1 { corner[k] } else { 0.0 }) - lattice.world_to_lattice[k][3]);
        for k in 0..3 {
            bound[k] = bound[k].max(frame::dot(inverse[k], p).abs());
        }
    }
    bound
}

/// Inverse of the linear part; none where it has none.
fn inverse(m: &[[f64; 4]; 3]) -> Option<[[f64; 3]; 3]> {
    let rows = m.map(|r| [r[0], r[1], r[2]]);
    // rows are scaled to about 1, so that neither tiny nor huge units overflow
    let size = rows.map(|r| r.iter().fold(0.0f64, |m, v| m.max(v.abs())));
    let unit: [[f64; 3]; 3] = std::array::from_fn(|i| rows[i].map(|v| v / size[i]));
    let [a, b, c] = unit;
    let columns = [frame::cross(b, c), frame::cross(c, a), frame::cross(a, b)];
    let determinant = frame::dot(a, columns[0]);
    let entry = |i: usize, j: usize| columns[j][i] / determinant / size[j];
    (determinant.abs() > 1e-12).then(|| std::array::from_fn(|i| std::array::from_fn(|j| entry(i, j))))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_box_of_a_scene_gives_the_lattice_of_its_bake() {
        let (low, high) = ([-3.0, 0.0, 5.0], [7.0, 2.0, 9.0]);
        let direction = [0.4, -0.8, 0.3];
        let p = Projection::orthographic(direction, low, high, 1024).unwrap();
        let corners: Vec<[f64; 3]> =
            (0..8).map(|i| [0, 1, 2].map(|k| if i >> k & 1 == 1 { high[k] } else { low[k] })).collect();
        let wanted = frame::orthographic(direction, 10, &corners, 0.0).unwrap();
        let DepthScale::Between(near, far) = p.depth else { panic!("{p:?}") };
        let (scale, offset) = scale(near, far).unwrap();
        let found = p.lattice(scale, offset);
        assert_eq!(found.world_to_lattice[..2], wanted.world_to_lattice[..2]);
        for c in &corners {
            assert!((found.to_lattice(*c)[2] - wanted.to_lattice(*c)[2]).abs() < 1e-3);
        }
        let unit = p.direction().unwrap();
        let z = frame::axes(direction).unwrap()[2];
        assert!((0..3).all(|k| (unit[k] - z[k]).abs() < 1e-12), "{unit:?}");
        assert_eq!(Projection::of_lattice(&wanted).lattice(1.0, 0.0), wanted);
        assert!((bound(&wanted)[2] - 9.0).abs() < 30.0);
    }

    #[test]
    fn maps_without_an_inverse_and_empty_ranges_are_refused() {
        let mut p = Projection::image(4).unwrap();
        assert_eq!(p.direction(), Ok([0.0, 0.0, 1.0]));
        p.world_to_layers[2] = p.world_to_layers[0];
        assert!(p.check().is_err());
        p.world_to_layers[2] = [0.0; 4];
        assert!(p.check().is_err());
        p.world_to_layers[2] = [0.0, 0.0, f64::NAN, 0.0];
        assert!(p.check().is_err());
        // units far from 1 are no reason
        p.world_to_layers = [[1e-20, 0.0, 0.0, 0.0], [0.0, 1e-20, 0.0, 0.0], [0.0, 0.0, 1e20, 0.0]];
        assert_eq!(p.direction(), Ok([0.0, 0.0, 1.0]));
        assert!(scale(1.0, 0.0).is_err() && scale(0.0, f64::INFINITY).is_err() && scale(f64::NAN, 1.0).is_err());
        assert!(scale(5.0, 5.0).is_ok() && scale(-1.0, 1e9).is_ok());
        assert!(Projection::image(3).is_err());
        assert!(Projection::orthographic([0.0; 3], [0.0; 3], [1.0; 3], 4).is_err());
        assert!(Projection::orthographic([1.0; 3], [2.0; 3], [1.0; 3], 4).is_err());
    }
}
