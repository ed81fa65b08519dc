//! Hand-made scenes with known answers.

use super::testing::{add, add_box, add_hexahedron, add_tetrahedron, empty};
use super::*;
use umbrage_format::projection::UNCOVERED;
use umbrage_writer::solid::SolidKind;

/// Lattice steps of a texel in these scenes: 2^20 steps on maps of 2^8 texels.
const T: i64 = 1 << 20;

fn scene() -> SnappedMesh {
    empty(8, 28)
}

/// A box over texels 0 to 10 in x and y.
fn slab(mesh: &mut SnappedMesh, solid: u32, z: i64, end: i64) {
    add_box(mesh, solid, [0, 0, z], [10 * T, 10 * T, end], false);
}

fn sheet(mesh: &mut SnappedMesh, thickness: u32, z: i64) {
    let solid = mesh.solids.len() as u32;
    let points = [[0, 0, z], [10 * T, 0, z], [10 * T, 10 * T, z], [0, 10 * T, z]];
    add(mesh, solid, SolidKind::Sheet { thickness }, &points, &[[0, 1, 2], [0, 3, 2]]);
}

fn certified(mesh: &SnappedMesh, x: u32, y: u32) -> (u32, u32) {
    let t = Oracle::new(mesh).texel(x, y);
    assert!(t.certified && !t.thin, "{t:?}");
    (t.interval.min, t.interval.max)
}

/// Interval and thinness of an edge texel.
fn edge(mesh: &SnappedMesh, x: u32, y: u32) -> (u32, u32, bool) {
    let t = Oracle::new(mesh).texel(x, y);
    assert!(!t.certified, "{t:?}");
    (t.interval.min, t.interval.max, t.thin)
}

#[test]
fn a_slope_of_one_keeps_one_texel_of_a_thickness_of_two() {
    let mut mesh = scene();
    let corner = |i: i64| {
        let x = (i & 1) * 16 * T;
        [x, (i >> 1 & 1) * 16 * T, 1000 + x + (i >> 2) * 2 * T]
    };
    add_hexahedron(&mut mesh, 0, [0, 1, 2, 3, 4, 5, 6, 7].map(corner), false);
    // lo runs from 1000 + 3 T to 1000 + 4 T over the texel, hi lies 2 T behind.
    assert_eq!(certified(&mesh, 3, 5), (1000 + 4 * T as u32, 1000 + 5 * T as u32 - 1));
    // On the diagonal of the faces as well.
    assert_eq!(certified(&mesh, 3, 3), (1000 + 4 * T as u32, 1000 + 5 * T as u32 - 1));
    assert_eq!(certified(&mesh, 16, 3), (UNCOVERED, UNCOVERED));
}

#[test]
fn thickness_of_one_texel_on_a_slope_of_one_is_too_little() {
    let mut mesh = scene();
    let corner = |i: i64| {
        let x = (i & 1) * 16 * T;
        [x, (i >> 1 & 1) * 16 * T, 1000 + x + (i >> 2) * T]
    };
    add_hexahedron(&mut mesh, 0, [0, 1, 2, 3, 4, 5, 6, 7].map(corner), false);
    let centre = 1000 + 3 * T as u32 + T as u32 / 2;
    assert_eq!(edge(&mesh, 3, 5), (centre, centre + T as u32 - 1, false));
}

#[test]
fn touching_and_overlapping_solids_unite_and_gaps_part() {
    for (z, end) in [(200, 299), (150, 299), (201, 199)] {
        let mut mesh = scene();
        slab(&mut mesh, 0, 100, 200);
        slab(&mut mesh, 1, z, 300);
        assert_eq!(certified(&mesh, 4, 4), (100, end));
    }
}

#[test]
fn cavities_end_the_stretch_unless_another_solid_fills_them() {
    let mut mesh = scene();
    slab(&mut mesh, 0, 100, 1000);
    add_box(&mut mesh, 0, [T, T, 200], [9 * T, 9 * T, 300], true);
    assert_eq!(certified(&mesh, 4, 4), (100, 199));
    assert_eq!(certified(&mesh, 0, 4), (100, 999));
    add_box(&mut mesh, 1, [T, T, 200], [9 * T, 9 * T, 300], false);
    assert_eq!(certified(&mesh, 4, 4), (100, 999));
}

#[test]
fn sheets_have_the_thickness_they_are_given() {
    let mut mesh = scene();
    sheet(&mut mesh, 5, 1000);
    assert_eq!(certified(&mesh, 4, 4), (1000, 1004));
    let mut mesh = scene();
    sheet(&mut mesh, 0, 1000);
    assert_eq!(edge(&mesh, 4, 4), (1000, 1000, true));
    // A sheet without thickness on a solid's face adds nothing to it; before it, it ends at once.
    slab(&mut mesh, 1, 1000, 2000);
    assert_eq!(certified(&mesh, 4, 4), (1000, 1999));
    sheet(&mut mesh, 0, 999);
    assert_eq!(edge(&mesh, 4, 4), (999, 999, true));
    // Depths beyond the lattice are cut off at its last value.
    let mut mesh = scene();
    sheet(&mut mesh, u32::MAX, 1000);
    assert_eq!(certified(&mesh, 4, 4), (1000, u32::MAX - 1));
}

#[test]
fn the_second_surface_ends_the_stretch() {
    let mut mesh = scene();
    mesh.second_surface = true;
    sheet(&mut mesh, 7, 1000);
    assert_eq!(certified(&mesh, 4, 4), (1000, u32::MAX - 1));
    slab(&mut mesh, 1, 5000, 6000);
    assert_eq!(certified(&mesh, 4, 4), (1000, 4999));
    slab(&mut mesh, 2, 500, 800);
    assert_eq!(certified(&mesh, 4, 4), (500, 799));
    slab(&mut mesh, 3, 500, 800);
    assert_eq!(edge(&mesh, 4, 4), (500, 500, true));
}

#[test]
fn centre_rays_are_half_open() {
    let half = T / 2;
    let mut mesh = scene();
    add_box(&mut mesh, 0, [4 * T + half, 0, 100], [10 * T, 10 * T, 200], false);
    assert_eq!(edge(&mesh, 4, 4), (100, 199, false));
    let mut mesh = scene();
    add_box(&mut mesh, 0, [0, 0, 100], [4 * T + half, 10 * T, 200], false);
    assert_eq!(edge(&mesh, 4, 4), (UNCOVERED, UNCOVERED, false));
    let mut mesh = scene();
    add_box(&mut mesh, 0, [0, 4 * T + half, 100], [10 * T, 10 * T, 200], false);
    assert_eq!(edge(&mesh, 4, 4), (100, 199, false));
    // Touching a texel's rim covers none of it.
    let mut mesh = scene();
    add_box(&mut mesh, 0, [0, 0, 100], [4 * T, 10 * T, 200], false);
    assert_eq!(certified(&mesh, 4, 4), (UNCOVERED, UNCOVERED));
    assert_eq!(certified(&mesh, 3, 4), (100, 199));
}

#[test]
fn a_ridge_between_two_solids_is_found_inside_the_texel() {
    // Fronts 1000 + x and 1000 + 9 T - x cross at x = 4.5 T; both backs are flat.
    let mut mesh = scene();
    for (solid, slope) in [(0, 1), (1, -1)] {
        let corner = |i: i64| {
            let x = (i & 1) * 9 * T;
            let front = 1000 + if slope == 1 { x } else { 9 * T - x };
            [x, (i >> 1 & 1) * 9 * T, if i >> 2 == 1 { 20 * T } else { front }]
        };
        add_hexahedron(&mut mesh, solid, [0, 1, 2, 3, 4, 5, 6, 7].map(corner), false);
    }
    assert_eq!(certified(&mesh, 4, 6), (1000 + (4 * T + T / 2) as u32, 20 * T as u32 - 1));
    assert_eq!(certified(&mesh, 3, 6), (1000 + 4 * T as u32, 20 * T as u32 - 1));
}

#[test]
fn a_shard_far_smaller_than_a_texel_makes_an_edge() {
    let mut mesh = scene();
    slab(&mut mesh, 0, 1000, 2000);
    assert_eq!(certified(&mesh, 4, 4), (1000, 1999));
    add_box(&mut mesh, 1, [4 * T + 7, 4 * T + 7, 100], [4 * T + 8, 4 * T + 8, 200], false);
    assert_eq!(edge(&mesh, 4, 4), (1000, 1999, false));
    assert_eq!(certified(&mesh, 5, 4), (1000, 1999));
}

#[test]
fn one_texel_of_32_bits_holds_the_deepest_box() {
    let mut mesh = empty(0, 32);
    add_box(&mut mesh, 0, [0, 0, 1], [1 << 32, 1 << 32, (1 << 32) - 2], false);
    assert_eq!(certified(&mesh, 0, 0), (1, u32::MAX - 2));
}

#[test]
fn receivers_are_lit_up_to_the_first_closed_triangle() {
    let mut mesh = scene();
    let corner = |i: i64| {
        let x = (i & 1) * 3;
        [x, (i >> 1 & 1) * 3, 100 + (i & 1) + (i >> 2) * 50]
    };
    add_hexahedron(&mut mesh, 0, [0, 1, 2, 3, 4, 5, 6, 7].map(corner), false);
    let oracle = Oracle::new(&mesh);
    // The front falls by 1 over 3 steps: at x = 1 it lies at 100 + 1/3.
    assert_eq!(oracle.surface_depth(0, [1, 1]).or(oracle.surface_depth(1, [1, 1])), Some(Depth::new(301, 3)));
    assert!(oracle.lit([1, 1], &Depth::new(301, 3)));
    assert!(!oracle.lit([1, 1], &Depth::new(302, 3)));
    assert!(
        oracle.lit([3, 3], &Depth::whole(101)) && !oracle.lit([3, 3], &Depth::new(203, 2)),
        "the rim belongs to it"
    );
    assert!(oracle.lit([4, 3], &Depth::whole(1000)));
    assert_eq!(oracle.surface_depth(0, [4, 3]), None);
}

#[test]
fn strictly_inside_needs_a_whole_neighbourhood() {
    let mut mesh = scene();
    slab(&mut mesh, 0, 100, 200);
    slab(&mut mesh, 1, 200, 300);
    add_box(&mut mesh, 2, [10 * T, 0, 100], [20 * T, 10 * T, 300], false);
    let oracle = Oracle::new(&mesh);
    let inside = |x: i64, y: i64, z: i64| oracle.strictly_inside([x, y], &Depth::whole(z));
    assert!(inside(5 * T, 5 * T, 150), "on the faces' diagonals");
    assert!(inside(5 * T, 4 * T, 200), "on a shared face");
    assert!(inside(10 * T, 4 * T, 150), "on a shared wall");
    assert!(inside(10 * T, 4 * T, 200), "where three solids meet");
    assert!(!inside(5 * T, 4 * T, 100) && !inside(5 * T, 4 * T, 300), "on the outer faces");
    assert!(!inside(5 * T, 4 * T, 99) && !inside(5 * T, 4 * T, 301), "outside");
    assert!(!inside(0, 4 * T, 150) && !inside(20 * T, 4 * T, 150), "on an outer wall");
    assert!(!inside(10 * T, 0, 200) && !inside(10 * T, 4 * T, 100), "on the rim of a shared wall");
    assert!(!inside(21 * T, 4 * T, 150));
}

#[test]
fn what_crosses_at_the_receiver_is_told_apart_by_sectors() {
    // Two slanted slabs cross like an X; in the middle of the X each covers the other's faces only on one side.
    let mut mesh = scene();
    for (solid, slope) in [(0, 1), (1, -1)] {
        let corner = |i: i64| {
            let x = (i & 1) * 8 * T;
            [x, (i >> 1 & 1) * 8 * T, 10 * T + slope * (x - 4 * T) + (i >> 2) * T]
        };
        add_hexahedron(&mut mesh, solid, [0, 1, 2, 3, 4, 5, 6, 7].map(corner), false);
    }
    let oracle = Oracle::new(&mesh);
    let inside = |x: i64, z: i64| oracle.strictly_inside([x, 3 * T], &Depth::whole(z));
    assert!(!inside(4 * T, 10 * T) && !inside(4 * T, 11 * T), "both fronts, both backs");
    assert!(inside(4 * T, 10 * T + 1));
    // Front of one, back of the other: at x = 4.5 T they meet at depth 10.5 T, with outside to the right of it.
    assert!(!inside(4 * T + T / 2, 10 * T + T / 2));
    assert!(inside(4 * T + T / 2, 10 * T + T / 2 + 1));
    // The back of one inside the other.
    assert!(inside(4 * T + T / 4, 11 * T - T / 4));
}

#[test]
fn a_texel_may_hold_thousands_of_triangles() {
    // A closed slab of 2 * 32 * 32 quads over one texel, its front a paraboloid.
    let mut mesh = empty(0, 32);
    let n = 32u32;
    let row = n + 1;
    let front = |i: u32, j: u32| 1_000_000 + 1000 * i64::from(i * i + j * j);
    let mut points = Vec::new();
    for back in [0, 1_000_000_000] {
        for k in 0..row * row {
            let (i, j) = (k % row, k / row);
            points.push([i64::from(i) << 27, i64::from(j) << 27, front(i, j) + back]);
        }
    }
    let mut triangles = Vec::new();
    for k in (0..n * n).map(|k| k / n * row + k % n) {
        let [a, b, c, d] = [k, k + 1, k + 1 + row, k + row];
        let lift = row * row;
        triangles.extend([[a, c, b], [a, d, c], [a + lift, b + lift, c + lift], [a + lift, c + lift, d + lift]]);
    }
    add(&mut mesh, 0, SolidKind::Closed, &points, &triangles);
    assert_eq!(certified(&mesh, 0, 0), (front(n, n) as u32, 1_000_999_999));
}

#[test]
fn many_coincident_edges_cost_little() {
    // A stack of plates, all with the same slanted walls, before a slab: nothing tells their edges apart.
    let mut mesh = empty(0, 32);
    let side = 1i64 << 32;
    add_box(&mut mesh, 0, [0, 0, 100_000], [side, side, 200_000], false);
    for plate in 0..60 {
        let corner = |i: i64| {
            let (x, y) = (i & 1, i >> 1 & 1);
            [if y == 1 { x * side } else { x * (side - 12345) }, y * side, 100_000 + 10 * plate + 10 * (i >> 2)]
        };
        add_hexahedron(&mut mesh, plate as u32 + 1, [0, 1, 2, 3, 4, 5, 6, 7].map(corner), false);
    }
    assert_eq!(certified(&mesh, 0, 0), (100_000, 199_999));
}

#[test]
fn a_ray_on_a_diagonal_goes_to_the_right_of_it() {
    for (corner, expected) in [([10 * T, 0], (100, 100, true)), ([0, 10 * T], (UNCOVERED, UNCOVERED, false))] {
        let mut mesh = scene();
        let [x, y] = corner;
        add_tetrahedron(&mut mesh, 0, [[0, 0, 100], [10 * T, 10 * T, 100], [x, y, 100], [x, y, 200]]);
        assert_eq!(edge(&mesh, 4, 4), expected);
    }
}

#[test]
fn a_thin_wedge_outside_is_found_between_three_planes() {
    // Solid up to depth M and again from two planes that meet it at p; in between is a wedge around direction (3, 1).
    const M: i64 = 100 * T;
    let p = [5 * T, 4 * T];
    let slanted = |mesh: &mut SnappedMesh, solid: u32, slope: [i64; 2]| {
        let corner = |i: i64| {
            let (x, y) = ((i & 1) * 10 * T, (i >> 1 & 1) * 10 * T);
            [x, y, if i >> 2 == 1 { 300 * T } else { M + slope[0] * (x - p[0]) + slope[1] * (y - p[1]) }]
        };
        add_hexahedron(mesh, solid, [0, 1, 2, 3, 4, 5, 6, 7].map(corner), false);
    };
    let mut mesh = scene();
    slab(&mut mesh, 0, T, M);
    slanted(&mut mesh, 1, [1, -2]);
    slanted(&mut mesh, 2, [-1, 5]);
    assert!(!Oracle::new(&mesh).strictly_inside(p, &Depth::whole(M)));
    slanted(&mut mesh, 3, [-1, 2]);
    assert!(Oracle::new(&mesh).strictly_inside(p, &Depth::whole(M)));
}

#[test]
fn only_solids_with_matching_edges_are_tight() {
    let mut mesh = scene();
    for solid in 0..3 {
        slab(&mut mesh, solid, 100, 200);
    }
    sheet(&mut mesh, 5, 300);
    mesh.triangles[12 + 4].swap(0, 1);
    mesh.triangles.remove(24 + 7);
    mesh.solid.remove(24 + 7);
    assert_eq!(Oracle::new(&mesh).tight, [true, false, false, false]);
}

#[test]
fn between_centres_a_value_is_right_within_a_16th_of_a_step() {
    // 2^20 and 2^8 lattice steps a texel: in the second, 2^-12 texel is less than a step
    for bits in [28, 16] {
        let mut mesh = empty(8, bits);
        let t = 1i64 << (bits - 8);
        add_box(&mut mesh, 0, [t, t, 100], [10 * t, 10 * t, 1000], false);
        let oracle = Oracle::new(&mesh).with_guard(5);
        let accepts = |x: u64, value: u32| oracle.accepts_at([x, 4 * 256 + 77], value);
        let side = 10 * 256;
        for x in [256, 300, side - 1] {
            assert!([100, 500, 999, 87, 1012].into_iter().all(|v| accepts(x, v)), "{bits}: {x}");
            assert!(![86, 1013].into_iter().any(|v| accepts(x, v)), "{bits}: {x}");
        }
        // on the silhouette both sides are right, a step away only one
        assert!(accepts(side, 500) && accepts(side, UNCOVERED), "{bits}");
        assert!(!accepts(side + 1, 500) && accepts(side + 1, UNCOVERED), "{bits}");
        assert!(accepts(side - 1, 500) && !accepts(side - 1, UNCOVERED), "{bits}");
        assert!(accepts(0, UNCOVERED) && !accepts(0, 500), "{bits}");
    }
}
