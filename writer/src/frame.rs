//! The light frame: from a direction and the scene's bounds to the [`Lattice`].

use umbrage_format::projection::Lattice;

/// Depth lattice steps that stay free before the first and behind the last depth of the scene.
pub(crate) const DEPTH_MARGIN: f64 = 65536.0;

/// What can be wrong with a light or a resolution.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum FrameError {
    /// The direction has no length or is not finite.
    #[error("light direction {0:?}: expected three finite numbers that are not all 0; give the way the light travels")]
    Direction([f64; 3]),
    /// The resolution is not a power of two in range.
    #[error("resolution {0}: expected a power of two from 1 to 16777216; the next smaller one is {1}")]
    Resolution(u64, u64),
    /// The scene is too large or too small for f64 arithmetic.
    #[error("scene bounds {0:?} to {1:?}: expected an extent between 1e-30 and 1e30; scale the scene")]
    Bounds([f64; 3], [f64; 3]),
}

/// Checks a map side and returns its base-2 logarithm (0 to 24).
pub fn log2_resolution(resolution: u64) -> Result<u8, FrameError> {
    if resolution.is_power_of_two() && resolution <= 1 << 24 {
        return Ok(resolution.trailing_zeros() as u8);
    }
    let smaller = if resolution == 0 { 1 } else { 1u64 << resolution.ilog2().min(24) };
    Err(FrameError::Resolution(resolution, smaller))
}

/// Right-handed orthonormal rows x, y, z of a light that travels along `direction`.
///
/// Roll rule: `a` is the scene axis along which the direction is smallest in magnitude (the first one when equal);
/// x = normalise(a cross z), y = z cross x. Only + - * / and sqrt, so equal on every machine.
pub fn axes(direction: [f64; 3]) -> Result<[[f64; 3]; 3], FrameError> {
    let largest = direction.iter().fold(0.0f64, |m, c| m.max(c.abs()));
    if !(largest > 0.0 && largest.is_finite() && direction.iter().all(|c| c.is_finite())) {
        return Err(FrameError::Direction(direction));
    }
    let z = normalise(direction.map(|c| c / largest));
    let mut axis = 0;
    for i in 1..3 {
        if z[i].abs() < z[axis].abs() {
            axis = i;
        }
    }
    let mut a = [0.0; 3];
    a[axis] = 1.0;
    let x = normalise(cross(a, z));
    Ok([x, cross(z, x), z])
}

/// The orthographic lattice of a light over points of the world: the square fit of their bounds in the light's
/// frame plus one texel (half on each side); depth from `DEPTH_MARGIN` to the last depth plus `depth_behind`
/// (world units, for geometry that is given a thickness) and the same margin.
pub fn orthographic(
    direction: [f64; 3],
    log2_resolution: u8,
    points: &[[f64; 3]],
    depth_behind: f64,
) -> Result<Lattice, FrameError> {
    let rows = axes(direction)?;
    let mut low = [f64::INFINITY; 3];
    let mut high = [f64::NEG_INFINITY; 3];
    for p in points {
        for i in 0..3 {
            let c = dot(rows[i], *p);
            low[i] = low[i].min(c);
            high[i] = high[i].max(c);
        }
    }
    if points.is_empty() {
        (low, high) = ([0.0; 3], [0.0; 3]);
    }
    high[2] += depth_behind;
    let fits = |e: f64| e == 0.0 || (1e-30..=1e30).contains(&e);
    let size = [high[0] - low[0], high[1] - low[1], high[2] - low[2]];
    if !size.iter().all(|e| fits(*e)) || !low.iter().chain(&high).all(|c| c.abs() <= 1e30) {
        return Err(FrameError::Bounds(low, high));
    }
    let mut extent = size[0].max(size[1]);
    if extent == 0.0 {
        extent = if size[2] > 0.0 { size[2] } else { 1.0 };
    }
    let depth = if size[2] > 0.0 { size[2] } else { extent };
    let subtexel_bits = (28 - i32::from(log2_resolution)).max(8) as u8;
    let resolution = (1u64 << log2_resolution) as f64;
    let side = if resolution > 1.0 { extent * (resolution / (resolution - 1.0)) } else { extent * 2.0 };
    let steps = (1u64 << (log2_resolution + subtexel_bits)) as f64;
    let scale_xy = steps / side;
    let scale_z = (4294967296.0 - 2.0 * DEPTH_MARGIN) / depth;
    let mut m = [[0.0; 4]; 3];
    for i in 0..3 {
        let scale = if i < 2 { scale_xy } else { scale_z };
        for j in 0..3 {
            m[i][j] = rows[i][j] * scale;
        }
        m[i][3] = if i < 2 { steps / 2.0 - (low[i] + high[i]) / 2.0 * scale } else { DEPTH_MARGIN - low[2] * scale };
    }
    Ok(Lattice { world_to_lattice: m, log2_resolution, subtexel_bits })
}

/// Largest error, in lattice steps, of [`Lattice::to_lattice`] in f64 over points with `|p| <= bound` on each axis:
/// three products and three sums, each within half an ulp, so at most 4 u times the sum of magnitudes.
pub fn transform_error(lattice: &Lattice, bound: [f64; 3]) -> f64 {
    let mut worst = 0.0f64;
    for r in lattice.world_to_lattice {
        let sum = (0..3).map(|i| (r[i] * bound[i]).abs()).sum::<f64>() + r[3].abs();
        worst = worst.max(sum * 4.0 * (f64::EPSILON / 2.0));
    }
    worst
}

/// World length of one lattice step in depth.
pub fn depth_step(lattice: &Lattice) -> f64 {
    let r = lattice.world_to_lattice[2];
    1.0 / dot([r[0], r[1], r[2]], [r[0], r[1], r[2]]).sqrt()
}

pub(crate) fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    (a[0] * b[0] + a[1] * b[1]) + a[2] * b[2]
}

pub(crate) fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn normalise(a: [f64; 3]) -> [f64; 3] {
    let l = dot(a, a).sqrt();
    a.map(|c| c / l)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_are_right_handed_and_orthonormal() {
        for d in [[0.4, -0.8, 0.3], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [-1e-9, 3.0, 1e9], [1.0, 1.0, 1.0]] {
            let [x, y, z] = axes(d).unwrap();
            for (a, b, want) in [(x, y, 0.0), (y, z, 0.0), (z, x, 0.0), (x, x, 1.0), (y, y, 1.0), (z, z, 1.0)] {
                assert!((dot(a, b) - want).abs() < 1e-14, "{d:?}");
            }
            let c = cross(x, y);
            assert!((dot(c, z) - 1.0).abs() < 1e-14 && dot(z, d) > 0.0, "{d:?}");
        }
        assert!(axes([0.0; 3]).is_err() && axes([f64::NAN, 0.0, 1.0]).is_err());
    }

    #[test]
    fn scene_fits_with_half_a_texel_around() {
        for k in [0u8, 1, 4, 14, 20, 24] {
            let points = [[-3.0, 0.0, 5.0], [7.0, 2.0, 9.0], [0.0, -4.0, 100.0]];
            let l = orthographic([0.4, -0.8, 0.3], k, &points, 0.0).unwrap();
            let half = (1i64 << l.subtexel_bits) as f64 / if k == 0 { 4.0 } else { 2.0 } - 1e-3;
            for p in points {
                let q = l.to_lattice(p);
                for c in [q[0], q[1]] {
                    assert!(c >= half && c <= l.side() as f64 - half, "{k} {q:?}");
                }
                assert!(q[2] >= 65535.0 && q[2] <= 4294967296.0 - 65535.0);
            }
            assert!(l.subtexel_bits >= 8 && l.log2_resolution + l.subtexel_bits >= 28);
        }
    }

    #[test]
    fn resolutions_outside_the_rule_are_refused() {
        assert_eq!(log2_resolution(16384), Ok(14));
        for bad in [0, 3, 1 << 31, 100, 1 << 25] {
            assert!(log2_resolution(bad).is_err());
        }
    }
}
