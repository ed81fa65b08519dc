//! Triangles between chords: a constrained Delaunay triangulation of the whole triangle, of which the solid faces stay.
//!
//! Positions are barycentric, in whole steps, along axes scaled by powers of two: points on an edge lie on it exactly, so
//! that no crack can open there, and distances are about those in the image, so that few edges are in a chord's way.

use std::collections::HashMap;

use spade::handles::{FixedDirectedEdgeHandle, FixedVertexHandle};
use spade::{ConstrainedDelaunayTriangulation, HasPosition, Point2, Triangulation};

use super::bounds::{Halt, Work};
use super::edge::{Edge, STEPS};

/// Where a point of a cut triangle is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Place {
    /// At a corner.
    Corner(usize),
    /// So far from `from` to `to`, corners.
    Edge { from: usize, to: usize, t: f64 },
    /// Within, by the weights of the corners.
    Inside([f64; 3]),
}

/// The solid part of a triangle.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Pieces {
    pub points: Vec<Place>,
    /// They face as the whole triangle.
    pub triangles: Vec<[u32; 3]>,
}

struct Point {
    position: Point2<f64>,
    place: Place,
}

impl HasPosition for Point {
    type Scalar = f64;

    fn position(&self) -> Point2<f64> {
        self.position
    }
}

/// Points as they are met.
pub struct Points {
    list: Vec<Point>,
    of: HashMap<[u64; 2], u32>,
    scale: [f64; 2],
}

impl Points {
    /// For a triangle whose edges at the first corner are about so long, in any unit.
    pub fn new(lengths: [f64; 2]) -> Self {
        // To a power of two.
        let scale = lengths.map(|l| f64::from_bits(l.max(1.0).to_bits() >> 52 << 52));
        Points { list: Vec::new(), of: HashMap::new(), scale }
    }

    fn add(&mut self, place: Place, x: f64, y: f64) -> u32 {
        let list = &mut self.list;
        let [x, y] = [x * self.scale[0], y * self.scale[1]];
        *self.of.entry([x, y].map(f64::to_bits)).or_insert_with(|| {
            list.push(Point { position: Point2::new(x, y), place });
            list.len() as u32 - 1
        })
    }

    /// The corners: always the first three.
    pub fn corner(&mut self, k: usize) -> u32 {
        let [x, y] = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]][k];
        self.add(Place::Corner(k), x, y)
    }

    /// A mark of the edge after corner `k`.
    pub fn mark(&mut self, k: usize, edge: &Edge, t: f64) -> u32 {
        let (from, to) = if edge.turned { ((k + 1) % 3, k) } else { (k, (k + 1) % 3) };
        let s = if edge.turned { 1.0 - t } else { t };
        let [x, y] = [[s, 0.0], [1.0 - s, s], [0.0, 1.0 - s]][k];
        self.add(Place::Edge { from, to, t }, x, y)
    }

    /// A point within.
    pub fn inside(&mut self, weights: [f64; 2]) -> u32 {
        let step = |w: f64| (w * STEPS).round().clamp(1.0, STEPS - 2.0);
        let x = step(weights[0]);
        let y = step(weights[1]).min(STEPS - 1.0 - x);
        let at = [x / STEPS, y / STEPS];
        self.add(Place::Inside(weighted(at)), at[0], at[1])
    }
}

/// With the weight of the first corner.
fn weighted([second, third]: [f64; 2]) -> [f64; 3] {
    [1.0 - second - third, second, third]
}

/// The solid part: `rim` is the way around the triangle, each point with whether it is solid from there to the next;
/// `chords` have solid on their left.
/// None where the library refuses a coordinate.
///
/// # Errors
/// Stopped.
pub fn triangulate(
    points: Points,
    rim: &[(u32, bool)],
    chords: &[[u32; 2]],
    work: &mut Work,
) -> Result<Option<Pieces>, Halt> {
    let vertex = |i: u32| FixedVertexHandle::from_index(i as usize);
    // Every coordinate is 0 or between 2^-44 and 2^64, and no two points are alike: nothing should be refused.
    let scale = points.scale;
    let made = ConstrainedDelaunayTriangulation::<Point>::bulk_load_cdt(points.list, Vec::new());
    let Ok(mut mesh) = made else { return Ok(None) };
    let whole = mesh.num_vertices();
    type Parts = Vec<Vec<FixedDirectedEdgeHandle>>;
    let mut all = |mesh: &mut _| -> Result<Parts, Halt> {
        let one = |c: &[u32; 2]| work.step().map(|()| constrain(mesh, *c, scale));
        chords.iter().map(one).collect()
    };
    let mut parts = all(&mut mesh)?;
    if mesh.num_vertices() > whole {
        // What was split later is found again.
        parts = all(&mut mesh)?;
    }
    // How often an edge is a chord in its direction; chords there and back are none.
    let mut count = vec![0i32; mesh.num_directed_edges()];
    parts.iter().flatten().for_each(|e| count[e.index()] += 1);
    let net = |e: FixedDirectedEdgeHandle| count[e.index()] - count[e.rev().index()];
    let rim = rim.iter().zip(rim.iter().cycle().skip(1)).filter_map(|((a, solid), (b, _))| {
        let edge = mesh.get_edge_from_neighbors(vertex(*a), vertex(*b))?;
        Some((edge.fix(), if *solid { 1 } else { -1 }))
    });
    // Chords and rim say what is solid beside them, in proportion to their lengths.
    let mut votes = vec![0.0; mesh.num_all_faces()];
    let chords = mesh.directed_edges().map(|e| (e.fix(), net(e.fix()))).filter(|(_, net)| *net > 0);
    for (edge, solid) in chords.chain(rim) {
        let edge = mesh.directed_edge(edge);
        let weight = edge.length_2().sqrt() * f64::from(solid);
        votes[edge.face().fix().index()] += weight;
        votes[edge.rev().face().fix().index()] -= weight;
    }
    let solid = regions(&mesh, net, &votes);
    let mut pieces = Pieces::default();
    let mut number = vec![u32::MAX; mesh.num_vertices()];
    for face in mesh.inner_faces().filter(|f| solid[f.fix().index()]) {
        let triangle = face.vertices().map(|v| {
            let n = &mut number[v.fix().index()];
            if *n == u32::MAX {
                *n = pieces.points.len() as u32;
                pieces.points.push(v.data().place);
            }
            *n
        });
        pieces.triangles.push(triangle);
    }
    Ok(Some(pieces))
}

/// Edges along a chord. Chords that cross, as rounding and joining may bring about, get a point there.
fn constrain(
    mesh: &mut ConstrainedDelaunayTriangulation<Point>,
    chord: [u32; 2],
    scale: [f64; 2],
) -> Vec<FixedDirectedEdgeHandle> {
    let [from, to] = chord.map(|i| FixedVertexHandle::from_index(i as usize));
    if from == to {
        return Vec::new();
    }
    let edges = mesh.try_add_constraint(from, to);
    if !edges.is_empty() {
        return edges;
    }
    mesh.add_constraint_and_split(from, to, |position| Point {
        place: Place::Inside(weighted([position.x / scale[0], position.y / scale[1]])),
        position,
    })
}

/// Which faces are solid: those connected without a chord between them vote together.
fn regions(
    mesh: &ConstrainedDelaunayTriangulation<Point>,
    net: impl Fn(FixedDirectedEdgeHandle) -> i32,
    votes: &[f64],
) -> Vec<bool> {
    let mut solid = vec![false; mesh.num_all_faces()];
    let mut met = vec![false; mesh.num_all_faces()];
    let mut region = Vec::new();
    for first in mesh.inner_faces() {
        if std::mem::replace(&mut met[first.fix().index()], true) {
            continue;
        }
        region.clear();
        region.push(first);
        let (mut k, mut sum) = (0, 0.0);
        while let Some(face) = region.get(k).copied() {
            k += 1;
            sum += votes[face.fix().index()];
            for edge in face.adjacent_edges() {
                let Some(next) = edge.rev().face().as_inner() else { continue };
                if net(edge.fix()) == 0 && !std::mem::replace(&mut met[next.fix().index()], true) {
                    region.push(next);
                }
            }
        }
        region.iter().for_each(|f| solid[f.fix().index()] = sum > 0.0);
    }
    solid
}
