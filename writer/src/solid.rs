//! Snapping to the light-space lattice, welding, components, and which of them are solids.
//!
//! In: a [`Mesh`] and a [`Lattice`]. Out: a [`SnappedMesh`], the only geometry that any promise is about.

use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};

use umbrage_format::projection::Lattice;

use crate::frame;
use crate::mesh::Mesh;

/// How depth intervals come from geometry (CONVENTIONS, Intervals).
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Policy {
    /// Every component is a closed solid; an open one is an error.
    Closed,
    /// Every triangle is a sheet without thickness.
    OneSided,
    /// Closed components are solids; open ones get this thickness behind them, world units along the light.
    Thickness(f64),
    /// hi = the next surface; right for receivers on static surfaces only.
    SecondSurface,
    /// Closed components are solids, open ones sheets without thickness.
    Auto,
}

impl std::str::FromStr for Policy {
    type Err = String;

    /// `closed`, `one-sided`, `second-surface`, `auto` or `thickness:T`.
    fn from_str(s: &str) -> Result<Self, String> {
        match (s, s.strip_prefix("thickness:").map(str::parse::<f64>)) {
            ("closed", _) => Ok(Policy::Closed),
            ("one-sided", _) => Ok(Policy::OneSided),
            ("second-surface", _) => Ok(Policy::SecondSurface),
            ("auto", _) => Ok(Policy::Auto),
            (_, Some(Ok(t))) if t.is_finite() && t > 0.0 => Ok(Policy::Thickness(t)),
            _ => {
                Err("expected closed, one-sided, thickness:T (world units, above 0), second-surface or auto"
                    .to_string())
            }
        }
    }
}

impl std::fmt::Display for Policy {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Policy::Closed => f.write_str("closed"),
            Policy::OneSided => f.write_str("one-sided"),
            Policy::Thickness(t) => write!(f, "thickness:{t}"),
            Policy::SecondSurface => f.write_str("second-surface"),
            Policy::Auto => f.write_str("auto"),
        }
    }
}

/// What a solid id stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SolidKind {
    /// A closed, outward-oriented component with its cavities.
    Closed,
    /// Open geometry: each triangle is entered where it is met and left `thickness` lattice depths later.
    Sheet {
        /// Lattice depth steps, 0 for none.
        thickness: u32,
    },
}

/// What was found about the components of a mesh.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Components {
    /// Components whose directed edges all cancel.
    pub closed: usize,
    /// The others.
    pub open: usize,
    /// Edges of open components that do not cancel.
    pub boundary_edges: usize,
    /// Closed components that were inside out and were turned.
    pub flipped: usize,
    /// Closed components that are inside out within another one.
    pub cavities: usize,
    /// Triangles dropped because two of their corners fell together.
    pub collapsed: usize,
}

/// Geometry snapped to the lattice of one light, oriented, with a solid id for each triangle.
#[derive(Clone, Debug)]
pub struct SnappedMesh {
    /// The light's lattice.
    pub lattice: Lattice,
    /// Lattice positions: x, y in `0..=lattice.side()`, z in `1..=u32::MAX - 1`.
    pub positions: Vec<[i64; 3]>,
    /// Counter-clockwise seen from outside in right-handed (x, y, z).
    pub triangles: Vec<[u32; 3]>,
    /// Solid id of each triangle.
    pub solid: Vec<u32>,
    /// Kind of each solid id.
    pub solids: Vec<SolidKind>,
    /// Policy second-surface: hi is the second surface, whatever it belongs to.
    pub second_surface: bool,
    /// Largest distance, in world units, that snapping moved a vertex.
    pub displacement: f64,
    /// What was found.
    pub components: Components,
}

/// Why a mesh can't be used.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SolidError {
    /// No triangles.
    #[error("the scene has no triangles; give one that has surfaces")]
    Empty,
    /// No triangle has an area.
    #[error(
        "the scene has no surface: none of its {triangles} triangles has an area on the lattice; check the export, or \
         raise --resolution"
    )]
    Flat {
        /// Triangles of the mesh.
        triangles: usize,
    },
    /// A vertex is not a number.
    #[error("vertex {index}: expected finite coordinates, found {found:?}; repair the mesh")]
    Vertex {
        /// Index in the mesh.
        index: usize,
        /// The vertex.
        found: [f64; 3],
    },
    /// An index points past the vertices.
    #[error("triangle {triangle}: expected vertex indices below {vertices}, found {found:?}; repair the mesh")]
    Index {
        /// Index of the triangle.
        triangle: usize,
        /// How many vertices there are.
        vertices: usize,
        /// The triangle.
        found: [u32; 3],
    },
    /// Policy closed on open geometry.
    #[error(
        "policy closed: expected every component to be closed, found {open} open ones with {edges} boundary edges; use --policy second-surface, auto or thickness:T"
    )]
    Open {
        /// Open components.
        open: usize,
        /// Their boundary edges.
        edges: usize,
    },
}

/// Checks indices and coordinates of a mesh.
pub fn check_mesh(mesh: &Mesh) -> Result<(), SolidError> {
    if mesh.triangles.is_empty() {
        return Err(SolidError::Empty);
    }
    if let Some((index, p)) = mesh.positions.iter().enumerate().find(|(_, p)| !p.iter().all(|c| c.is_finite())) {
        return Err(SolidError::Vertex { index, found: *p });
    }
    let vertices = mesh.positions.len();
    for (triangle, t) in mesh.triangles.iter().enumerate() {
        if t.iter().any(|i| *i as usize >= vertices) {
            return Err(SolidError::Index { triangle, vertices, found: *t });
        }
    }
    Ok(())
}

/// Snaps, welds, finds components and decides what each is.
pub fn snap(mesh: &Mesh, lattice: Lattice, policy: Policy) -> Result<SnappedMesh, SolidError> {
    check_mesh(mesh)?;
    let mut displacement = 0.0f64;
    let (positions, welded) = weld(mesh, &lattice, &mut displacement);
    let mut triangles = Vec::with_capacity(mesh.triangles.len());
    for t in &mesh.triangles {
        let w = t.map(|i| welded[i as usize]);
        if w[0] != w[1] && w[1] != w[2] && w[2] != w[0] {
            triangles.push(w);
        }
    }
    if !triangles.iter().any(|t| has_area(t.map(|k| positions[k as usize]))) {
        return Err(SolidError::Flat { triangles: mesh.triangles.len() });
    }
    let mut found = Components { collapsed: mesh.triangles.len() - triangles.len(), ..Default::default() };
    let (component, boundary) = components(&triangles);
    let count = boundary.len();
    for edges in &boundary {
        if *edges == 0 {
            found.closed += 1;
        } else {
            found.open += 1;
            found.boundary_edges += edges;
        }
    }
    if policy == Policy::Closed && found.open > 0 {
        return Err(SolidError::Open { open: found.open, edges: found.boundary_edges });
    }
    let thickness = match policy {
        Policy::Thickness(t) => (t / frame::depth_step(&lattice)).ceil().clamp(0.0, 4294901760.0) as u32,
        _ => 0,
    };
    let all_sheets = policy == Policy::OneSided;
    let solids: Vec<SolidKind> = boundary
        .iter()
        .map(|b| if *b > 0 || all_sheets { SolidKind::Sheet { thickness } } else { SolidKind::Closed })
        .collect();
    let mut solid = component.clone();
    if !all_sheets {
        orient(&positions, &mut triangles, &component, count, &solids, &mut solid, &mut found);
    }
    Ok(SnappedMesh {
        lattice,
        positions,
        triangles,
        solid,
        solids,
        second_surface: policy == Policy::SecondSurface,
        displacement,
        components: found,
    })
}

/// Whether the corners are not in one line.
fn has_area(v: [[i64; 3]; 3]) -> bool {
    let [a, b] = [1, 2].map(|k| [0, 1, 2].map(|i| i128::from(v[k][i] - v[0][i])));
    (0..3).any(|i| a[i] * b[(i + 1) % 3] != a[(i + 1) % 3] * b[i])
}

/// Rounds to the lattice and gives equal positions one index.
fn weld(mesh: &Mesh, lattice: &Lattice, displacement: &mut f64) -> (Vec<[i64; 3]>, Vec<u32>) {
    let side = lattice.side();
    let high = [side, side, i64::from(u32::MAX) - 1];
    let low = [0, 0, 1];
    let step: [f64; 3] = lattice.world_to_lattice.map(|r| {
        let l = frame::dot([r[0], r[1], r[2]], [r[0], r[1], r[2]]).sqrt();
        1.0 / l
    });
    let mut positions: Vec<[i64; 3]> = Vec::new();
    let mut at: HashMap<[i64; 3], u32, BuildHasherDefault<Mix>> = HashMap::default();
    let mut welded = Vec::with_capacity(mesh.positions.len());
    for p in &mesh.positions {
        let q = lattice.to_lattice(*p);
        let mut s = [0i64; 3];
        let mut moved = 0.0;
        for i in 0..3 {
            // floor(q + 1/2): the same on every machine, and ties go one way
            s[i] = ((q[i] + 0.5).floor() as i64).clamp(low[i], high[i]);
            let d = (s[i] as f64 - q[i]) * step[i];
            moved += d * d;
        }
        *displacement = displacement.max(moved.sqrt());
        let next = positions.len() as u32;
        let index = *at.entry(s).or_insert(next);
        if index == next {
            positions.push(s);
        }
        welded.push(index);
    }
    (positions, welded)
}

/// Multiply-xor hash: welding millions of vertices with SipHash costs more than the bake of a small map.
#[derive(Default)]
struct Mix(u64);

impl Hasher for Mix {
    fn finish(&self) -> u64 {
        self.0 ^ (self.0 >> 29)
    }
    fn write(&mut self, bytes: &[u8]) {
        for b in bytes {
            self.write_u64(u64::from(*b));
        }
    }
    fn write_u64(&mut self, v: u64) {
        self.0 = (self.0.rotate_left(23) ^ v).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    }
    fn write_i64(&mut self, v: i64) {
        self.write_u64(v as u64);
    }
    fn write_usize(&mut self, v: usize) {
        self.write_u64(v as u64);
    }
}

/// Component of each triangle (joined across shared edges) and, for each, how many edges do not cancel.
fn components(triangles: &[[u32; 3]]) -> (Vec<u32>, Vec<usize>) {
    let mut edges: Vec<(u64, u32)> = Vec::with_capacity(triangles.len() * 3);
    for (i, t) in triangles.iter().enumerate() {
        for k in 0..3 {
            let (a, b) = (t[k], t[(k + 1) % 3]);
            let key = (u64::from(a.min(b)) << 32) | u64::from(a.max(b));
            edges.push((key, (i as u32) << 1 | u32::from(a > b)));
        }
    }
    rayon::slice::ParallelSliceMut::par_sort_unstable(&mut edges[..]);
    let mut parent: Vec<u32> = (0..triangles.len() as u32).collect();
    fn root(parent: &mut [u32], mut i: u32) -> u32 {
        while parent[i as usize] != i {
            parent[i as usize] = parent[parent[i as usize] as usize];
            i = parent[i as usize];
        }
        i
    }
    for run in edges.chunk_by(|a, b| a.0 == b.0) {
        let mut a = root(&mut parent, run[0].1 >> 1);
        for e in &run[1..] {
            let b = root(&mut parent, e.1 >> 1);
            let (low, high) = (a.min(b), a.max(b));
            parent[high as usize] = low;
            a = low;
        }
    }
    let mut id = vec![u32::MAX; triangles.len()];
    let mut count = 0u32;
    let mut component = Vec::with_capacity(triangles.len());
    for i in 0..triangles.len() as u32 {
        let r = root(&mut parent, i) as usize;
        if id[r] == u32::MAX {
            id[r] = count;
            count += 1;
        }
        component.push(id[r]);
    }
    let mut boundary = vec![0usize; count as usize];
    for run in edges.chunk_by(|a, b| a.0 == b.0) {
        let sum: i64 = run.iter().map(|e| if e.1 & 1 == 0 { 1 } else { -1 }).sum();
        if sum != 0 {
            boundary[component[(run[0].1 >> 1) as usize] as usize] += sum.unsigned_abs() as usize;
        }
    }
    (component, boundary)
}

/// Turns inside-out solids, unless they lie inside another: then they are cavities of the innermost such one.
fn orient(
    positions: &[[i64; 3]],
    triangles: &mut [[u32; 3]],
    component: &[u32],
    count: usize,
    solids: &[SolidKind],
    solid: &mut [u32],
    found: &mut Components,
) {
    let mut first = vec![u32::MAX; count];
    let mut volume = vec![0i128; count];
    let mut low = vec![[i64::MAX; 3]; count];
    let mut high = vec![[i64::MIN; 3]; count];
    for (i, t) in triangles.iter().enumerate() {
        let c = component[i] as usize;
        if first[c] == u32::MAX {
            first[c] = t[0];
        }
        let o = positions[first[c] as usize];
        let v = t.map(|k| {
            let p = positions[k as usize];
            for a in 0..3 {
                low[c][a] = low[c][a].min(p[a]);
                high[c][a] = high[c][a].max(p[a]);
            }
            [i128::from(p[0] - o[0]), i128::from(p[1] - o[1]), i128::from(p[2] - o[2])]
        });
        volume[c] += v[0][0] * (v[1][1] * v[2][2] - v[1][2] * v[2][1])
            + v[0][1] * (v[1][2] * v[2][0] - v[1][0] * v[2][2])
            + v[0][2] * (v[1][0] * v[2][1] - v[1][1] * v[2][0]);
    }
    let inside_out: Vec<usize> = (0..count).filter(|c| solids[*c] == SolidKind::Closed && volume[*c] < 0).collect();
    if inside_out.is_empty() {
        return;
    }
    let mut by_component: Vec<Vec<u32>> = vec![Vec::new(); count];
    for (i, c) in component.iter().enumerate() {
        by_component[*c as usize].push(i as u32);
    }
    let mut turn = vec![false; count];
    let mut owner: Vec<u32> = (0..count as u32).collect();
    for &c in &inside_out {
        let p = positions[first[c] as usize];
        let around = (0..count)
            .filter(|&d| {
                d != c
                    && solids[d] == SolidKind::Closed
                    && (0..3).all(|a| low[d][a] <= p[a] && p[a] <= high[d][a])
                    && winding(positions, triangles, &by_component[d], p) != 0
            })
            .min_by_key(|&d| (volume[d].unsigned_abs(), d));
        match around {
            Some(d) => {
                owner[c] = d as u32;
                found.cavities += 1;
            }
            None => {
                turn[c] = true;
                found.flipped += 1;
            }
        }
    }
    for (i, t) in triangles.iter_mut().enumerate() {
        let c = component[i] as usize;
        if turn[c] {
            t.swap(1, 2);
        }
        let mut o = owner[c];
        // a cavity inside an inside-out component that is itself a cavity: follow up, at most `count` steps
        for _ in 0..count {
            if owner[o as usize] == o {
                break;
            }
            o = owner[o as usize];
        }
        solid[i] = o;
    }
}

/// Winding number of some triangles around `p`: signed crossings in front of it on its light ray, half-open edges.
fn winding(positions: &[[i64; 3]], triangles: &[[u32; 3]], which: &[u32], p: [i64; 3]) -> i32 {
    let mut w = 0;
    for &i in which {
        let mut v = triangles[i as usize].map(|k| {
            let q = positions[k as usize];
            [i128::from(q[0] - p[0]), i128::from(q[1] - p[1]), i128::from(q[2] - p[2])]
        });
        let area =
            |v: &[[i128; 3]; 3]| (v[1][0] - v[0][0]) * (v[2][1] - v[0][1]) - (v[2][0] - v[0][0]) * (v[1][1] - v[0][1]);
        let mut sign = -1;
        let mut d = area(&v);
        if d == 0 {
            continue;
        }
        if d < 0 {
            v.swap(1, 2);
            d = -d;
            sign = 1;
        }
        let covers = (0..3).all(|k| {
            let (a, b) = (v[k], v[(k + 1) % 3]);
            let (ex, ey) = (a[1] - b[1], b[0] - a[0]);
            let e = -(ex * a[0] + ey * a[1]);
            e > 0 || (e == 0 && (ex > 0 || (ex == 0 && ey > 0)))
        });
        // depth at p relative to p: barycentric sum over the doubled area
        if covers {
            let weight = |k: usize| {
                let (a, b) = (v[(k + 1) % 3], v[(k + 2) % 3]);
                a[0] * b[1] - a[1] * b[0]
            };
            let z = weight(0) * v[0][2] + weight(1) * v[1][2] + weight(2) * v[2][2];
            if z < 0 {
                w += sign;
            }
        }
    }
    w
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cube(c: [f64; 3], r: f64, inside_out: bool) -> Mesh {
        let mut positions = Vec::new();
        for i in 0..8 {
            positions.push([0, 1, 2].map(|a| c[a] + if i >> a & 1 == 1 { r } else { -r }));
        }
        let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let mut triangles = Vec::new();
        for q in quads {
            for t in [[q[0], q[1], q[2]], [q[0], q[2], q[3]]] {
                triangles.push(if inside_out { [t[0], t[2], t[1]] } else { t });
            }
        }
        Mesh { positions, triangles }
    }

    fn snapped(meshes: &[Mesh], policy: Policy) -> Result<SnappedMesh, SolidError> {
        let mut mesh = Mesh::default();
        for m in meshes {
            mesh.append(m);
        }
        let l = frame::orthographic([0.3, -0.9, 0.2], 6, &mesh.positions, 0.0).unwrap();
        snap(&mesh, l, policy)
    }

    #[test]
    fn an_inside_out_cube_is_turned_and_a_cavity_is_kept() {
        let outer = cube([0.0; 3], 2.0, false);
        let plain = snapped(std::slice::from_ref(&outer), Policy::Closed).unwrap();
        let turned = snapped(&[cube([0.0; 3], 2.0, true)], Policy::Closed).unwrap();
        assert_eq!(turned.components.flipped, 1);
        let mut a: Vec<_> = plain.triangles.iter().map(|t| t.map(|i| plain.positions[i as usize])).collect();
        let mut b: Vec<_> = turned.triangles.iter().map(|t| t.map(|i| turned.positions[i as usize])).collect();
        let rotate = |t: &mut [[i64; 3]; 3]| {
            while t[0] != *t.iter().min().unwrap() {
                t.rotate_left(1)
            }
        };
        a.iter_mut().for_each(rotate);
        b.iter_mut().for_each(rotate);
        a.sort();
        b.sort();
        assert_eq!(a, b);
        let hollow = snapped(&[outer.clone(), cube([0.1; 3], 1.0, true)], Policy::Closed).unwrap();
        assert_eq!((hollow.components.cavities, hollow.components.flipped), (1, 0));
        assert!(hollow.solid.iter().all(|s| *s == 0));
        let nested = snapped(&[outer, cube([0.1; 3], 1.0, false)], Policy::Closed).unwrap();
        assert_eq!(nested.components.cavities, 0);
        assert_eq!(nested.solid[12], 1);
    }

    #[test]
    fn open_geometry_is_found_and_refused_only_by_closed() {
        let mut m = cube([0.0; 3], 1.0, false);
        m.triangles.pop();
        let e = snapped(std::slice::from_ref(&m), Policy::Closed).unwrap_err();
        assert_eq!(e, SolidError::Open { open: 1, edges: 3 });
        let auto = snapped(&[m, cube([5.0, 0.0, 0.0], 1.0, false)], Policy::Auto).unwrap();
        assert_eq!(auto.solids, [SolidKind::Sheet { thickness: 0 }, SolidKind::Closed]);
    }

    #[test]
    fn broken_meshes_are_refused() {
        assert_eq!(snapped(&[], Policy::Auto).unwrap_err(), SolidError::Empty);
        let mut line = cube([0.0; 3], 1.0, false);
        line.positions = vec![[0.0; 3], [1.0; 3], [2.0; 3]];
        for triangles in [vec![[0, 1, 2]; 5], vec![[0, 1, 1], [2, 2, 2]]] {
            let count = triangles.len();
            line.triangles = triangles;
            let found = snapped(std::slice::from_ref(&line), Policy::Auto).unwrap_err();
            assert_eq!(found, SolidError::Flat { triangles: count });
        }
        let mut m = cube([0.0; 3], 1.0, false);
        m.triangles[3][1] = 99;
        assert!(matches!(check_mesh(&m), Err(SolidError::Index { triangle: 3, .. })));
        m.positions[2][1] = f64::NAN;
        assert!(matches!(check_mesh(&m), Err(SolidError::Vertex { index: 2, .. })));
    }
}
