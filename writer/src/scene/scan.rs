//! A bumpy ball on a slab: one finely tessellated surface, like a scanned object.
//!
//! The ball is about 1 m in radius and rests, sunk a few centimetres, in a slab 4 m wide. More size means finer triangles.

use super::View;
use super::random::{noise2, noise3};
use super::shape::{Builder, Frame, sphere};
use crate::mesh::Mesh;

const OCTAVES: i32 = 6;

/// Generates the scan; about `size` times 500 000 triangles.
pub(super) fn build(seed: u64, size: f64) -> Mesh {
    let fineness = size.sqrt();
    let mut builder = Builder::default();
    let cells = (110.0 * fineness).round().max(8.0) as u32;
    builder.ground(2.0, cells, -0.25, |x, z| {
        0.02 * noise2(seed ^ 11, [x * 1.5, z * 1.5]) + 0.004 * noise2(seed ^ 12, [x * 9.0, z * 9.0])
    });
    let (mut points, triangles) = sphere((243.0 * fineness).round() as u32);
    for p in &mut points {
        let (mut bump, mut amplitude, mut scale) = (0.0, 0.16, 1.7);
        for octave in 0..OCTAVES {
            bump += amplitude * noise3(seed.wrapping_add(octave as u64), p.map(|c| c * scale));
            // Not quite a power of two, so that lattice planes of the octaves do not line up.
            (amplitude, scale) = (amplitude * 0.52, scale * 2.03);
        }
        *p = p.map(|c| c * (1.0 + bump));
    }
    // The slab's top lies within 0.024 of zero, so the ball always reaches into it.
    let lowest = points.iter().map(|p| p[1]).fold(0.0, f64::min);
    builder.solid(&Frame::WORLD.at([0.0, -lowest - 0.04, 0.0]), &points, &triangles);
    builder.mesh
}

/// A view of ball and shadow.
pub(super) fn view() -> View {
    View { eye: [2.9, 2.3, -2.6], target: [0.1, 0.66, 0.1], fov_degrees: 46.0 }
}

#[cfg(test)]
mod tests {
    use super::super::check::{audit, fingerprint};
    use super::*;

    #[test]
    fn the_scan_is_two_closed_solids() {
        let mesh = build(1, 1.0);
        let report = audit(&mesh);
        assert_eq!((report.solids, report.cavities), (2, 0));
        assert!((480_000..520_000).contains(&report.triangles), "{}", report.triangles);
        assert_eq!(fingerprint(&mesh), 0x7CFC_BA7E_722F_FBAE, "{:#X}", fingerprint(&mesh));
    }

    #[test]
    fn size_and_seed_matter() {
        let small = audit(&build(2, 0.05));
        assert_eq!(small.solids, 2);
        assert!((20_000..32_000).contains(&small.triangles), "{}", small.triangles);
        assert_ne!(fingerprint(&build(2, 0.05)), fingerprint(&build(3, 0.05)));
    }
}
