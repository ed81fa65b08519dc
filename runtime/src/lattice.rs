//! World to lattice on a device without f64: per frame an integer base, and a 3x4 in f32 for what is left.
//!
//! In: the structure's f64 map and the camera. Out: [`FrameLattice`], whose words a shader takes as `UmbLattice`, with
//! a bound of the error for points within a distance of the camera. Twin of `shader/lattice.wgsl`.
//!
//! A point p of the world goes to the device as r = p - camera, in f32. With u = 2^-24 and a row (a, b, c | d) of the
//! 3x4, whose coefficients are rounded to f32 once, the sum `((a x + b y) + c z) + d` takes at most five roundings on
//! each term: its error is at most 5 u / (1 - 5 u) times `|a x| + |b y| + |c z| + |d|`, fused or not. The base is
//! computed in f64; its error is at most 6 * 2^-53 times the same sum over the world's coordinates. Both together are
//! [`FrameLattice::error_bound`]; rounding r itself to f32 is up to the caller and not in it.

use umbrage_format::projection::Lattice;

/// Largest base texel either side of 0: beyond, every point is outside.
const FARTHEST: f64 = (1 << 30) as f64;

/// The transform of one light for one frame.
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct FrameLattice {
    /// Rows of the 3x4: texels in x, texels in y, lattice depth; from camera-relative world units to beyond `base`.
    pub rows: [[f32; 4]; 3],
    /// Base texel in x and y (signed, as their bits), base depth, texels on a side.
    pub base: [u32; 4],
}

/// Where a point falls.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Place {
    /// Texel column; 0 where it would be negative.
    pub x: u32,
    /// Texel row.
    pub y: u32,
    /// Lattice depth rounded up, clamped to 32 bits.
    pub depth: u32,
    /// Whether the texel lies in the map.
    pub inside: bool,
}

impl FrameLattice {
    /// The transform for a camera at `camera`, world units.
    pub fn new(lattice: &Lattice, camera: [f64; 3]) -> Self {
        let rows = texel_rows(lattice);
        let at = rows.map(|r| ((r[0] * camera[0] + r[1] * camera[1]) + r[2] * camera[2]) + r[3]);
        let texel = |v: f64| v.floor().clamp(-FARTHEST, FARTHEST);
        let base = [texel(at[0]), texel(at[1]), at[2].floor().clamp(0.0, f64::from(u32::MAX))];
        let left = [0, 1, 2].map(|i| at[i] - base[i]);
        let single = |i: usize| {
            let [a, b, c, _] = rows[i];
            [a as f32, b as f32, c as f32, left[i] as f32]
        };
        // Casts of whole numbers in range; NaN becomes 0.
        let base = [base[0] as i32 as u32, base[1] as i32 as u32, base[2] as u32, lattice.resolution()];
        Self { rows: [single(0), single(1), single(2)], base }
    }

    /// Largest error of the real texel coordinates and depth that [`locate`](Self::locate) rounds, for points whose
    /// camera-relative coordinates are each at most `reach` (world units): texels, texels, lattice depth.
    pub fn error_bound(&self, lattice: &Lattice, camera: [f64; 3], reach: f64) -> [f64; 3] {
        let u = 2f64.powi(-24);
        let rows = texel_rows(lattice);
        [0, 1, 2].map(|i| {
            let [a, b, c, d] = self.rows[i].map(|v| f64::from(v).abs());
            let single = 5.0 * u / (1.0 - 5.0 * u) * ((a + b + c) * reach + d);
            let world: f64 = (0..3).map(|k| (rows[i][k] * camera[k]).abs() + rows[i][k].abs() * reach).sum();
            // The last term: products below the normal range of f32 may be flushed to 0.
            single + 6.0 * 2f64.powi(-53) * (world + rows[i][3].abs()) + 2f64.powi(-120)
        })
    }

    /// Texel and depth of a camera-relative point, as the shader computes them up to the stated bound.
    pub fn locate(&self, r: [f32; 3]) -> Place {
        let row = |i: usize| {
            let [a, b, c, d] = self.rows[i];
            ((a * r[0] + b * r[1]) + c * r[2]) + d
        };
        let limit = FARTHEST as f32;
        let texel = |i: usize| (self.base[i] as i32).wrapping_add(row(i).floor().clamp(-limit, limit) as i32);
        let (x, y, side) = (texel(0), texel(1), self.base[3] as i32);
        let inside = x >= 0 && y >= 0 && x < side && y < side;
        let d = row(2).ceil().clamp(-4_294_967_040.0, 4_294_967_040.0);
        let size = d.abs() as u32;
        let depth = if d < 0.0 { self.base[2].saturating_sub(size) } else { self.base[2].saturating_add(size) };
        Place { x: x.max(0) as u32, y: y.max(0) as u32, depth, inside }
    }
}

/// Rows of the f64 map with x and y in texels.
fn texel_rows(lattice: &Lattice) -> [[f64; 4]; 3] {
    let step = 2f64.powi(-i32::from(lattice.subtexel_bits));
    let [x, y, depth] = lattice.world_to_lattice;
    [x.map(|v| v * step), y.map(|v| v * step), depth]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn dice(state: &mut u64) -> f64 {
        *state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (*state >> 11) as f64 / (1u64 << 53) as f64
    }

    #[test]
    fn the_error_stays_within_the_bound() {
        let mut s = 3u64;
        let mut worst = 0f64;
        for (log2, extent) in [(10u8, 300.0f64), (20, 5000.0), (24, 40_000.0)] {
            for _ in 0..300 {
                let subtexel_bits = (28 - log2).max(8);
                let steps = 2f64.powi((log2 + subtexel_bits).into()) / extent;
                // Any rows will do, the bound does not ask for a rotation.
                let mut m = [[0.0; 4]; 3];
                for (i, scale) in [steps, steps, 4e9 / extent].into_iter().enumerate() {
                    for v in &mut m[i][..3] {
                        *v = (dice(&mut s) - 0.5) * scale;
                    }
                    m[i][3] = scale * extent * (dice(&mut s) - 0.2);
                }
                let lattice = Lattice { world_to_lattice: m, log2_resolution: log2, subtexel_bits };
                let camera = [0; 3].map(|_| (dice(&mut s) - 0.5) * extent);
                let frame = FrameLattice::new(&lattice, camera);
                let reach = extent * 10f64.powf(-4.0 * dice(&mut s));
                let bound = frame.error_bound(&lattice, camera, reach);
                for _ in 0..50 {
                    let r = [0; 3].map(|_| ((dice(&mut s) - 0.5) * 2.0 * reach) as f32);
                    let p = [0, 1, 2].map(|i| camera[i] + f64::from(r[i]));
                    let exact = lattice.to_lattice(p);
                    let scale = 2f64.powi(-i32::from(subtexel_bits));
                    let exact = [exact[0] * scale, exact[1] * scale, exact[2]];
                    for i in 0..3 {
                        let [a, b, c, d] = frame.rows[i];
                        let rest = ((a * r[0] + b * r[1]) + c * r[2]) + d;
                        let base = if i < 2 { f64::from(frame.base[i] as i32) } else { f64::from(frame.base[2]) };
                        let error = (base + f64::from(rest) - exact[i]).abs();
                        assert!(error <= bound[i], "axis {i}: {error} above {}", bound[i]);
                        worst = worst.max(error / bound[i]);
                    }
                    // What is rounded agrees outside the guard band.
                    let place = frame.locate(r);
                    let clear = |v: f64, e: f64| (v - v.round()).abs() > e;
                    if clear(exact[0], bound[0]) && exact[0] > 0.0 && exact[0] < f64::from(lattice.resolution()) {
                        assert_eq!(f64::from(place.x), exact[0].floor());
                    }
                    let in_range = exact[2] > 0.0 && exact[2] < 4.29e9;
                    if clear(exact[2], bound[2]) && in_range {
                        assert_eq!(f64::from(place.depth), exact[2].ceil());
                    }
                }
            }
        }
        assert!(worst > 0.1, "the bound is too loose to mean anything: {worst}");
    }

    #[test]
    fn what_is_far_away_saturates() {
        let m = [[256.0, 0.0, 0.0, 0.0], [0.0, 256.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];
        let lattice = Lattice { world_to_lattice: m, log2_resolution: 2, subtexel_bits: 8 };
        let frame = FrameLattice::new(&lattice, [1.5, 2.5, 10.0]);
        assert_eq!(frame.locate([0.0, 0.0, 0.5]), Place { x: 1, y: 2, depth: 11, inside: true });
        assert_eq!(frame.locate([-2.0, 0.0, -50.0]), Place { x: 0, y: 2, depth: 0, inside: false });
        assert_eq!(frame.locate([1e30, 0.0, 1e30]).depth, u32::MAX - 255 + 10);
        assert!(!frame.locate([1e30, 0.0, 0.0]).inside && !frame.locate([2.5, 0.0, 0.0]).inside);
        assert!(!FrameLattice::new(&lattice, [1e300, 0.0, 0.0]).locate([0.0; 3]).inside);
    }
}
