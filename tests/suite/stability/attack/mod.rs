//! Inputs made to break a baker, each with what it attacks and why that is hard, and what is held against the bakes.
//!
//! The test suite `stability` and the benchmark of that name both begin here.
//!
//! | Room | What is in it |
//! |---|---|
//! | here, `far` | the attacks |
//! | `refused` | what must be refused, and with which words |
//! | `shapes` | closed shapes, maps of space, random solids |
//! | `probe` | one bake, held against rules, oracle and rays |
//! | `spots` | where to look |
//! | `ray` | a ray that tries every triangle |

mod far;
pub mod probe;
mod ray;
pub mod refused;
pub mod shapes;
mod spots;

use probe::{Case, Found};
use shapes::*;
use umbrage::format::Kind;
use umbrage::writer::bake::BakeError;
use umbrage::writer::mesh::Mesh;
use umbrage::writer::solid::{Policy, SolidError};

/// One attack.
pub struct Attack {
    /// Its name.
    pub name: &'static str,
    /// The thickness that open geometry is given, world units; nothing where all of it is closed.
    pub open: Option<f64>,
    /// The triangles.
    pub mesh: fn() -> Mesh,
}

impl Attack {
    /// The policies that make sense for it.
    pub fn policies(&self) -> [Policy; 2] {
        [self.open.map_or(Policy::Closed, Policy::Thickness), Policy::SecondSurface]
    }

    /// Bakes it under one light with all its policies, in both kinds and several sizes, and adds up.
    pub fn run(&self, light: [f64; 3], sides: &[u64], points: u32, probe: &Probe<'_>) -> Found {
        let mut all = Found::default();
        for kind in KINDS {
            for policy in self.policies() {
                all.add(self.run_as(kind, policy, light, sides, points, probe));
            }
        }
        all
    }

    /// The same in one kind with one policy.
    pub fn run_as(
        &self,
        kind: Kind,
        policy: Policy,
        light: [f64; 3],
        sides: &[u64],
        points: u32,
        probe: &Probe<'_>,
    ) -> Found {
        let mesh = (self.mesh)();
        let mut all = Found::default();
        for &resolution in sides {
            let case = Case { kind, policy, light, resolution, points };
            match probe(&mesh, &case) {
                Ok(found) => all.add(found),
                Err(BakeError::Solid(SolidError::Flat { .. })) if self.name == VANISHING => all.refused += 1,
                Err(e) => all.faults.push(format!("{case:?}: {e}")),
            }
        }
        all.faults.iter_mut().for_each(|f| *f = format!("{}, {f}", self.name));
        all
    }
}

/// What bakes and checks.
pub type Probe<'a> = dyn Fn(&Mesh, &Case) -> Result<Found, BakeError> + 'a;

/// The attack of which nothing is left on the lattice from some sides, which is refused.
const VANISHING: &str = "deep";

/// Both kinds.
pub const KINDS: [Kind; 2] = [Kind::Mh, Kind::Vector];

/// Lights that every attack is baked with: two slanted ones; along axes, from above and from below; along faces; nearly
/// along faces, so that snapping decides on which side of edge-on a face ends up.
pub const LIGHTS: [[f64; 3]; 10] = [
    [0.4, -0.8, 0.3],
    [0.0, -1.0, 0.0],
    [0.6, -0.8, 0.0],
    [1e-9, -1.0, -3e-9],
    [1.0, 0.0, 0.0],
    [-0.83, 0.31, -0.4],
    [1.0, -1.0, 0.0],
    [0.0, 0.0, -1.0],
    [1e-6, 1.0, 2e-6],
    [1.0, -1.0, 1.0],
];

/// All attacks.
pub const ATTACKS: [Attack; 26] = [
    Attack { name: "edge-on", open: None, mesh: edge_on },
    Attack { name: "needles", open: None, mesh: needles },
    Attack { name: "fan of tips", open: None, mesh: fan_of_tips },
    Attack { name: "wedges", open: None, mesh: wedges },
    Attack { name: "filled joints", open: None, mesh: filled_joints },
    Attack { name: "open joints", open: Some(0.1), mesh: open_joints },
    Attack { name: "coplanar", open: None, mesh: coplanar },
    Attack { name: "nearly coplanar", open: None, mesh: nearly_coplanar },
    Attack { name: "coincident", open: None, mesh: coincident },
    Attack { name: "cancelling", open: None, mesh: cancelling },
    Attack { name: "touching", open: None, mesh: touching },
    Attack { name: "nested", open: None, mesh: nested },
    Attack { name: "interpenetrating", open: None, mesh: interpenetrating },
    Attack { name: "crossing itself", open: None, mesh: crossing_itself },
    Attack { name: "mirrored", open: None, mesh: mirrored },
    Attack { name: "on the grid", open: None, mesh: on_the_grid },
    Attack { name: "cracks", open: None, mesh: far::cracks },
    Attack { name: "far away", open: None, mesh: far::far_away },
    Attack { name: "wide", open: None, mesh: far::wide },
    Attack { name: "shallow", open: None, mesh: far::shallow },
    Attack { name: VANISHING, open: None, mesh: far::deep },
    Attack { name: "sheets", open: Some(0.05), mesh: sheets },
    Attack { name: "Moebius", open: Some(0.01), mesh: moebius },
    Attack { name: "one triangle", open: Some(0.2), mesh: one_triangle },
    Attack { name: "debris", open: Some(0.02), mesh: debris },
    Attack { name: "blades", open: None, mesh: blades },
];

/// Upright slabs, ever thinner, one behind the other, over a floor. From above and along their sides all large faces are
/// edge-on: they cover nothing but bound everything, and a hair's turn of the light makes slivers of them that reach
/// through the whole depth.
fn edge_on() -> Mesh {
    let slab = |i: i32| block([f64::from(i) * 0.25, 0.5, 0.0], [0.1 * 0.1f64.powi(i + 3), 0.5, 0.9]);
    union((-3..4).map(slab).chain([block([0.0, -0.1, 0.0], [1.0, 0.05, 1.0])]))
}

/// Tetrahedra of length 2 and thickness down to 1e-8. Their areas are tiny beside their edges' products, so that planes
/// are ill-conditioned; many are thinner than a lattice step, and snapping collapses or turns their sides.
fn needles() -> Mesh {
    let needle = |i: i32| {
        let thin = 10f64.powi(-i);
        let y = 0.2 * f64::from(i);
        let tail = [1.0, y + 0.3, 0.17 * f64::from(i)];
        tetrahedron([
            [-1.0, y, -0.3],
            tail,
            [tail[0], tail[1] + thin, tail[2]],
            [tail[0] - thin, tail[1], tail[2] + thin],
        ])
    };
    union((1..9).map(needle).chain([block([0.0, -0.2, 0.3], [0.9, 0.1, 0.8])]))
}

/// Sixty tetrahedra with one common tip. Around it more edges meet in one texel at any resolution than can be told apart
/// by halving, and no square that holds the tip has a line that parts it.
fn fan_of_tips() -> Mesh {
    let tip = [0.013, 0.4, -0.029];
    let ray = |i: u32| {
        let [x, z] = ring(60, 7, 1.0)[i as usize];
        let y = f64::from(i % 5) * 0.2 - 0.4;
        tetrahedron([tip, [x, y, z], [x * 0.97 - z * 0.03, y, z * 0.97 + x * 0.03], [x * 0.9, y - 0.1, z * 0.9]])
    };
    union((0..60).map(ray))
}

/// Wedges that run out to nothing: roofs whose thickness ends in an edge, pyramids with their tips to and from the light.
/// Near the sharp edge no depth lies between front and back, next to it some do; the interval shrinks to nothing along
/// a line that no edge shows.
fn wedges() -> Mesh {
    let wedge = |i: i32| {
        let [x, z] = [f64::from(i % 3) * 0.7 - 0.7, f64::from(i / 3) * 0.7 - 0.35];
        let t = 0.3 * 0.05f64.powi(i);
        let b =
            [[x, 0.0, z], [x + 0.6, 0.05, z], [x, t, z], [x, 0.0, z + 0.6], [x + 0.6, 0.05, z + 0.6], [x, t, z + 0.6]];
        let triangles = vec![[0, 3, 4], [0, 4, 1], [0, 1, 2], [3, 5, 4], [0, 2, 5], [0, 5, 3], [1, 4, 5], [1, 5, 2]];
        Mesh { positions: b.to_vec(), triangles }
    };
    let spike = |i: i32| {
        let [x, z] = [f64::from(i) * 0.4 - 0.6, 0.9];
        let end = if i % 2 == 0 { 0.9 } else { -0.9 };
        let base = [[x - 0.1, 0.0, z - 0.1], [x + 0.13, 0.0, z - 0.1], [x, 0.0, z + 0.15]];
        tetrahedron([base[0], base[1], base[2], [x + 0.01, end, z]])
    };
    union((0..6).map(wedge).chain((0..4).map(spike)))
}

/// Wedges over half of the map whose two faces rise the same way, one hardly steeper: where they run out, several texels
/// side by side have next to no depth between front and back.
fn blades() -> Mesh {
    let blade = |i: i32| {
        let z = f64::from(i) * 0.25 - 0.9;
        let (rise, more) = (0.9 - 0.3 * f64::from(i % 3), 4e-4 * 0.35f64.powi(i));
        let (x, far) = (-0.7 + 0.013 * f64::from(i), 0.6);
        let (low, high) = (rise * (far - x), (rise + more) * (far - x));
        let b =
            [[x, 0.0, z], [far, low, z], [far, high, z], [x, 0.0, z + 0.2], [far, low, z + 0.2], [far, high, z + 0.2]];
        let triangles = vec![[0, 3, 4], [0, 4, 1], [0, 1, 2], [3, 5, 4], [0, 2, 5], [0, 5, 3], [1, 4, 5], [1, 5, 2]];
        Mesh { positions: b.to_vec(), triangles }
    };
    union((0..7).map(blade))
}

/// A box's triangles with edges cut in the middle on one side only; `filled` closes the gaps with triangles of no area.
fn joints(filled: bool) -> Mesh {
    let jointed = |low: [f64; 3], high: [f64; 3]| {
        let mut mesh = cuboid(low, high);
        // the first two triangles share a diagonal, the third shares the side 0-1 with the first's neighbour
        for cut in [0usize, 4, 8] {
            let [a, b, c] = mesh.triangles[cut];
            let [p, q] = [a, b].map(|i| mesh.positions[i as usize]);
            // not a fraction that floats or the lattice hold: the middle lies a little beside the edge
            let part = 1.0 / 3.0 + 0.1 * cut as f64 / 8.0;
            let middle = mesh.positions.len() as u32;
            mesh.positions.push([0, 1, 2].map(|k| p[k] + (q[k] - p[k]) * part));
            mesh.triangles[cut] = [a, middle, c];
            mesh.triangles.push([middle, b, c]);
            if filled {
                mesh.triangles.push([a, b, middle]);
            }
        }
        mesh
    };
    let leaning = |mesh: Mesh| turned(turned(mesh, 0, 0.21), 2, -0.37);
    union([
        jointed([-1.0, -0.2, -1.0], [-0.2, 0.3, 0.9]),
        leaning(jointed([0.0, -0.5, -0.7], [0.8, 0.6, 0.5])),
        jointed([-0.9, -0.8, -0.9], [0.9, -0.6, 0.95]),
    ])
}

/// T-junctions closed by triangles without area. Snapped, these become slivers as thin as a lattice step, some of them
/// turned over, through which a ray can slip that counts entries and exits carelessly.
fn filled_joints() -> Mesh {
    joints(true)
}

/// T-junctions as they come from modelling programs: a vertex on an edge that its neighbour does not have. The mesh looks
/// closed, but is not; after snapping there are cracks and overlaps of one lattice step along the edge.
fn open_joints() -> Mesh {
    joints(false)
}

/// Boxes whose faces lie in common planes, overlapping in part, cut along different diagonals, some of them level and
/// some slanted. Events at the same depth have to count entries first, and edges cross the common plane anywhere.
fn coplanar() -> Mesh {
    let part = |i: u32| {
        let [x, z] = [f64::from(i % 3) * 0.5 - 0.6, f64::from(i / 3) * 0.45 - 0.5];
        let mut b = cuboid([x, -0.25 * f64::from(i % 2), z], [x + 0.75, 0.5, z + 0.6]);
        if i % 2 == 1 {
            // the other diagonal of the lids
            b.triangles[6] = [2, 6, 3];
            b.triangles[7] = [3, 6, 7];
        }
        b
    };
    let level = union((0..9).map(part));
    // exact in binary fractions: the planes stay common
    let slanted = mapped(moved(scaled(level.clone(), [0.5, 0.5, 0.5]), [0.25, 1.0, 0.125]), |[x, y, z]| {
        [x, y + x * 0.5 - z * 0.25, z]
    });
    union([level, slanted])
}

/// Slanted lids that lie in one plane but for snapping. Their planes cross at angles of a lattice step over the map, so
/// that the line where front and back change places may run anywhere and is known to few digits only.
fn nearly_coplanar() -> Mesh {
    let part = |i: u32| {
        let x = f64::from(i % 3) * 0.31 - 0.7;
        let z = f64::from(i / 3) * 0.27 - 0.6;
        turned(turned(cuboid([x, -0.4, z], [x + 0.53, 0.31, z + 0.47]), 0, 0.173), 2, 0.119)
    };
    union((0..9).map(part))
}

/// The same solids more than once: all alike, cut along other diagonals, and a little copy in the same place of a larger
/// scene's face. Welded, the copies are one component that counts every surface twice.
fn coincident() -> Mesh {
    let own = turned(block([0.0; 3], [0.5, 0.3, 0.7]), 1, 0.31);
    let mut other = own.clone();
    for t in (0..12).step_by(2) {
        let ([a, b, c], d) = (other.triangles[t], other.triangles[t + 1][2]);
        (other.triangles[t], other.triangles[t + 1]) = ([a, b, d], [b, c, d]);
    }
    let star = moved(prism(&ring(7, 1, 0.4), -0.2, 0.2), [0.9, 0.1, 0.0]);
    union([own.clone(), own, other, star.clone(), star])
}

/// Solids and the same ones inside out: what remains when a program subtracts a thing from itself. Every surface is an
/// entry and an exit at once; the volume is 0, so the sign of it says nothing.
fn cancelling() -> Mesh {
    let own = turned(block([0.0; 3], [0.5, 0.3, 0.7]), 2, 0.31);
    let star = moved(prism(&ring(5, 1, 0.4), -0.2, 0.2), [0.9, 0.1, 0.3]);
    union([own.clone(), flipped(own), star.clone(), flipped(star), block([0.3, -0.8, 0.0], [1.0, 0.1, 1.0])])
}

/// Boxes that touch in faces, in parts of faces, along edges, in corners: a chequered stack and a wall of bricks. Welded,
/// four triangles share an edge; the union has no gap between solids that touch, and none may show.
fn touching() -> Mesh {
    let cell = |i: u32| {
        let [x, y, z] = [i % 3, i / 3 % 3, i / 9].map(|v| f64::from(v) * 0.4 - 0.6);
        i.is_multiple_of(2).then(|| cuboid([x, y, z], [x + 0.4, y + 0.4, z + 0.4]))
    };
    let brick = |i: u32| {
        let (row, column) = (i / 4, i % 4);
        let x = f64::from(column) * 0.3 + f64::from(row % 2) * 0.15;
        cuboid([x, f64::from(row) * 0.15, 0.8], [x + 0.3, f64::from(row + 1) * 0.15, 1.0])
    };
    let wall = turned(union((0..16).map(brick)), 0, 0.15);
    union((0..27).filter_map(cell).chain([wall]))
}

/// Boxes in boxes in boxes: cavities in solids in cavities, solids in solids, and shells of 1e-4 around nothing. Which
/// solid a cavity belongs to decides where a stretch ends, and a shell seen along its side is deep, from above thin.
fn nested() -> Mesh {
    let onion = |i: u32| {
        let half = 0.6 - 0.1 * f64::from(i);
        let shell = turned(block([0.0; 3], [half, half * 0.8, half * 0.9]), 1, 0.1 * f64::from(i));
        if i % 2 == 1 { flipped(shell) } else { shell }
    };
    let thin = |i: u32| {
        let half = 0.3 + if i == 0 { 1e-4 } else { 0.0 };
        let shell = moved(turned(block([0.0; 3], [half; 3]), 2, 0.2), [1.1, 0.0, 0.2]);
        if i == 1 { flipped(shell) } else { shell }
    };
    let inner = [0.5, 0.3, 0.1].map(|h| moved(block([0.0; 3], [h; 3]), [-1.2, 0.1 * h, 0.0]));
    union((0..5).map(onion).chain((0..2).map(thin)).chain(inner))
}

/// Boxes and stars turned through each other. Fronts change places along lines that are no edge of any triangle, and the
/// end of a stretch jumps from solid to solid.
fn interpenetrating() -> Mesh {
    let part = |i: u32| {
        let t = f64::from(i) * 0.23 - 0.8;
        let shape = if i.is_multiple_of(2) {
            block([0.0; 3], [0.9, 0.12 + 0.05 * f64::from(i), 0.15])
        } else {
            prism(&ring(3 + i, 1, 0.7), -0.1, 0.15)
        };
        moved(turned(turned(shape, i as usize % 3, t), (i as usize + 1) % 3, 0.37), [0.1 * t, -0.05, 0.2 * t])
    };
    union((0..8).map(part))
}

/// Closed surfaces that cross themselves: a star whose middle counts twice, a bow tie whose one half is inside out. The
/// counter of one solid goes to 2, and to -1 where the first event is an exit.
fn crossing_itself() -> Mesh {
    let star = prism(&ring(7, 3, 0.6), -0.2, 0.3);
    let bow = moved(prism(&[[-0.6, -0.4], [0.6, 0.4], [0.6, -0.4], [-0.6, 0.4]], -0.3, 0.2), [0.7, -0.4, 0.6]);
    union([star, turned(bow, 0, 0.2), turned(prism(&ring(9, 4, 0.4), 0.1, 0.5), 2, 0.4)])
}

/// Solids under mirroring maps that leave the winding as it was, so that they are inside out, also within others and
/// about a cavity that the map turns too; and mirrored twice.
fn mirrored() -> Mesh {
    let own = union([
        turned(prism(&ring(5, 1, 0.35), -0.3, 0.3), 0, 0.3),
        flipped(turned(block([0.0; 3], [0.15, 0.12, 0.1]), 0, 0.3)),
    ]);
    let place = |s: [f64; 3], by: [f64; 3]| moved(scaled(own.clone(), s), by);
    union([
        place([-1.0, 1.0, 1.0], [-0.5, 0.0, -0.5]),
        place([1.0, -1.0, 1.0], [0.5, 0.1, -0.5]),
        place([1.0, 1.0, -2.0], [-0.5, 0.2, 0.7]),
        place([-1.0, -1.0, 1.0], [0.5, 0.0, 0.6]),
        place([-0.3, -0.3, -0.3], [0.5, 0.0, 0.6]),
    ])
}

/// Edges exactly on texels' borders and centres, on those of leaves and pages, on diagonals through corners, and the same
/// one lattice step beside. From above, on maps of 64 texels, 63 world units are 63 texels; on other maps some still
/// meet. Which of two texels an edge belongs to, and the ray through its centre, hang on the rule for limits alone.
fn on_the_grid() -> Mesh {
    // the outermost coordinates make the bounds: 0 and 63 are centres of texels, halves are borders
    let frame = cuboid([0.0, -1.0, 0.0], [63.0, 0.0, 63.0]);
    let step = 64.0 / (1u64 << 28) as f64;
    let beside = |i: u32| f64::from(i % 3) * step - step;
    let part = |i: u32| {
        let [x, z] = [f64::from(i % 4) * 16.0 - 0.5, f64::from(i / 4) * 16.0 - 0.5];
        let (w, y) = (f64::from(1 + i % 5), 1.0 + f64::from(i));
        cuboid([x.max(0.0) + beside(i), y, z.max(0.0)], [x + w * 2.0, y + 3.0, z + w + beside(i / 3)])
    };
    let diamond = |i: u32| {
        let shape = prism(&ring(4, 1, 4.0 + f64::from(i)), 0.0, 5.0);
        let at = f64::from(i) * 12.0 + 15.5 + beside(i);
        // cosines of right angles are not 0 in floats
        mapped(moved(shape, [at, 2.0, 47.5 - 8.0 * f64::from(i)]), |p| p.map(|c| (c * 4096.0).round() / 4096.0))
    };
    union((0..16).map(part).chain((0..3).map(diamond)).chain([frame]))
}

/// Loose rectangles: level, upright, crossing, one upon the other, two in one plane. A sheet without thickness allows no
/// depth at all; with one, its back ends in the air, where no triangle is.
fn sheets() -> Mesh {
    union([
        rectangle([-1.0, 0.0, -1.0], [1.2, 0.0, 0.0], [0.0, 0.0, 1.1]),
        rectangle([-0.5, 0.0, -0.5], [1.2, 0.0, 0.1], [0.0, 0.0, 1.1]),
        rectangle([-0.6, -0.5, 0.1], [1.3, 1.0, 0.0], [0.0, 0.1, 0.7]),
        rectangle([0.3, -0.7, -0.8], [0.0, 1.4, 0.0], [0.0, 0.0, 1.5]),
        rectangle([-0.9, 0.049, -0.7], [0.9, 0.0, 0.0], [0.0, 0.003, 0.9]),
        rectangle([-0.9, 0.049, -0.7], [0.9, 0.0, 0.0], [0.0, 0.003, 0.9]),
    ])
}

/// A band with one side only. It has no outside; two of its triangles run the same way along an edge.
fn moebius() -> Mesh {
    const N: u32 = 24;
    let at = |i: u32| {
        let a = f64::from(i) / f64::from(N) * std::f64::consts::TAU;
        [-0.3, 0.3].map(|w| {
            let r = 1.0 + w * (a / 2.0).cos();
            [r * a.cos(), w * (a / 2.0).sin(), r * a.sin()]
        })
    };
    // the first pair comes again with its ends exchanged
    let positions = (0..N).flat_map(at).collect();
    let pair = |i: u32| if i == N { [1, 0] } else { [2 * i, 2 * i + 1] };
    let quad = |i: u32| {
        let ([a, b], [c, d]) = (pair(i), pair(i + 1));
        [[a, c, b], [b, c, d]]
    };
    Mesh { positions, triangles: (0..N).flat_map(quad).collect() }
}

/// The least scene that there is. All of the map hangs on one plane and three edges, and along one light it has no area.
fn one_triangle() -> Mesh {
    triangles(&[[[-1.0, 0.0, -0.9], [1.0, 0.0, -0.2], [0.3, 0.8, 1.0]]])
}

/// What exports leave behind: triangles of no area, the same triangle twice and turned over, fans that fold back, edges
/// with three triangles, among a box and a few good ones.
fn debris() -> Mesh {
    let good = [[-0.8, 0.3, -0.7], [0.9, 0.2, -0.5], [0.1, 0.5, 0.8]];
    let [a, b, c] = good;
    let middle = [0, 1, 2].map(|k| (a[k] + b[k]) / 2.0);
    let loose = triangles(&[
        good,
        good,
        [a, c, b],
        [a, b, middle],
        [a, a, a],
        [a, b, b],
        [a, b, [0.2, -0.9, 0.1]],
        [a, b, [0.4, 0.9, 0.3]],
        [middle, c, a],
        [[0.5, 0.7, 0.5], [0.5, 0.7, 0.9], [0.5, 0.7, 1.3]],
        [[0.5, 0.7, 0.5], [0.5, -0.7, 0.5], [0.5, 0.1, 0.5]],
    ]);
    union([loose, block([0.0, -0.5, 0.0], [0.5, 0.2, 0.4]), turned(block([0.0; 3], [0.0, 0.4, 0.6]), 1, 0.2)])
}
