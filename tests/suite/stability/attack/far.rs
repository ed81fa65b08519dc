//! Attacks on the lattice: coordinates, depths and gaps near what it can hold.

use super::shapes::*;
use umbrage::writer::mesh::Mesh;

/// Steps of the lattice across a map of at most 2^20 texels on a side.
const ACROSS: f64 = (1u64 << 28) as f64;
/// Steps of depth.
const DEPTH: f64 = (1u64 << 32) as f64;

/// Boxes side by side with gaps of half a lattice step, one, two and three, and floors below each other with gaps of that
/// many steps of depth. A crack is open or shut as snapping has it; where it is open, light falls through all of the scene,
/// and the interval between two floors is a handful of numbers.
pub fn cracks() -> Mesh {
    let gap = |i: u32| [0.0, 0.5, 1.0, 2.0, 3.0][i as usize % 5];
    let mut parts = vec![cuboid([-1.0, -1.0, -1.0], [1.0, -0.9, 1.0])];
    let mut x = -1.0;
    for i in 0..10 {
        parts.push(cuboid([x, 0.0, -0.9], [x + 0.1, 0.2 + 0.05 * f64::from(i % 3), 0.9]));
        x += 0.1 + gap(i) * 2.0 / ACROSS;
    }
    let mut y = 0.4;
    for i in 0..10 {
        parts.push(cuboid([x, y, -0.8 + 0.1 * f64::from(i)], [x + 0.6, y + 0.01, 0.9]));
        y += 0.01 + gap(i) * 2.0 / DEPTH;
    }
    // a slope cut into strips that nearly touch
    let strip = |i: u32| {
        let at = f64::from(i) * (0.05 + gap(i) * 2.0 / ACROSS);
        mapped(cuboid([-0.5 + at, 1.0, -0.5], [-0.45 + at, 1.1, 0.5]), |[x, y, z]| [x, y + 0.3 * x, z])
    };
    union(parts.into_iter().chain((0..10).map(strip)))
}

/// A town of 1 unit with features of 1e-3, 1e7 from the origin. The matrix cancels seven digits: its error is many
/// lattice steps of depth, for which the stored values must keep a guard.
pub fn far_away() -> Mesh {
    let house = |i: u32| {
        let [x, z] = [f64::from(i % 4) * 0.25, f64::from(i / 4) * 0.25];
        let size = [0.2, 0.05, 0.01, 0.001][i as usize % 4];
        turned(cuboid([x, 0.0, z], [x + size, 0.1 + 0.01 * f64::from(i), z + size]), 1, 0.01 * f64::from(i))
    };
    let town = union((0..16).map(house).chain([cuboid([-0.2, -0.05, -0.1], [1.1, 0.0, 1.1])]));
    moved(town, [1e7, -1.3e7, 0.7e7])
}

/// Ground of 1e7 units with features of 1e-3 on it, and some between. The small ones are smaller than a lattice step:
/// they collapse to a point, a line or a flat thing, which may be left of no component or of an edge-on one.
pub fn wide() -> Mesh {
    let thing = |i: i32| {
        let size = 10f64.powi(i - 3);
        let at = 4e6 * (f64::from(i) * 2.1).sin();
        turned(block([at, 2.0 * size, 0.7 * at], [size, 2.0 * size, size * 0.7]), 1, 0.2)
    };
    union((0..10).map(thing).chain([cuboid([-5e6, -1e3, -5e6], [5e6, 0.0, 5e6])]))
}

/// A relief of 1e-6 units in height and 1 across, 3 units above the origin: terraces of 1e-7, slopes, a ball's segment.
/// From above all depths lie within 1e-6 and fill the lattice; from the side the scene is a line.
pub fn shallow() -> Mesh {
    let terrace = |i: u32| {
        let low = 0.05 * f64::from(i);
        cuboid([low, 0.0, low], [1.0 - low, f64::from(i + 1), 1.0 - low])
    };
    let slope = mapped(cuboid([0.1, 0.0, 1.05], [0.9, 5.0, 1.3]), |[x, y, z]| [x, y * (x + 0.1), z]);
    let relief = union((0..8).map(terrace).chain([slope]));
    moved(scaled(relief, [1.0, 1e-7, 1.0]), [0.0, 3.0, 0.0])
}

/// Shafts and plates of 1 unit across, spread over 1e12 units of depth. From above one depth step is 233 units, and every
/// plate is thin; from elsewhere the shafts are lines and the plates nothing.
pub fn deep() -> Mesh {
    let plate = |i: i32| {
        let y = -10f64.powi(i);
        let x = 0.09 * f64::from(i) - 0.5;
        cuboid([x, y - 0.3 * 10f64.powi(i), -0.5], [x + 0.2, y, 0.4])
    };
    let shaft = mapped(cuboid([-0.6, -1e12, 0.3], [0.7, 0.0, 0.5]), |[x, y, z]| [x + y * 2e-13, y, z]);
    union((0..12).map(plate).chain([shaft]))
}
