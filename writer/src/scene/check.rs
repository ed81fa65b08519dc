//! What the tests ask of every generated mesh: closed, outward, no slivers, and the same bytes everywhere.

use std::collections::HashMap;

use crate::mesh::Mesh;

/// What [`audit`] counted.
pub(super) struct Report {
    /// Triangles of the mesh.
    pub(super) triangles: usize,
    /// Components of positive volume.
    pub(super) solids: usize,
    /// Components of negative volume; each lies within the bounds of a solid.
    pub(super) cavities: usize,
}

fn root(parents: &mut [u32], mut i: u32) -> u32 {
    while parents[i as usize] != i {
        parents[i as usize] = parents[parents[i as usize] as usize];
        i = parents[i as usize];
    }
    i
}

struct Component {
    origin: [f64; 3],
    volume: f64,
    low: [f64; 3],
    high: [f64; 3],
}

/// Welds by exact position and panics unless every component is closed, edge-manifold and of non-zero volume.
pub(super) fn audit(mesh: &Mesh) -> Report {
    let mut names = HashMap::with_capacity(mesh.positions.len());
    let welded: Vec<u32> = mesh
        .positions
        .iter()
        .map(|p| {
            assert!(p.iter().all(|c| c.is_finite()));
            let next = names.len() as u32;
            // Adding zero makes -0 and 0 one position.
            *names.entry(p.map(|c| (c + 0.0).to_bits())).or_insert(next)
        })
        .collect();
    let count = names.len();
    drop(names);
    let mut parents: Vec<u32> = (0..count as u32).collect();
    let mut edges = Vec::with_capacity(mesh.triangles.len() * 3);
    for triangle in &mesh.triangles {
        let [a, b, c] = triangle.map(|i| welded[i as usize]);
        edges.extend([[a, b], [b, c], [c, a]]);
        for (x, y) in [(a, b), (b, c)] {
            let (x, y) = (root(&mut parents, x), root(&mut parents, y));
            parents[x as usize] = y;
        }
    }
    edges.sort_unstable();
    assert!(edges.windows(2).all(|w| w[0] != w[1]), "a directed edge occurs twice");
    assert!(edges.iter().all(|&[a, b]| a != b && edges.binary_search(&[b, a]).is_ok()), "an edge has no opposite");
    let mut components = HashMap::<u32, Component>::new();
    let mut used = vec![false; mesh.positions.len()];
    for triangle in &mesh.triangles {
        let first = root(&mut parents, welded[triangle[0] as usize]);
        let [a, b, c] = triangle.map(|i| mesh.positions[i as usize]);
        let component = components.entry(first).or_insert(Component { origin: a, volume: 0.0, low: a, high: a });
        // Relative to a point of the component, lest small solids far away drown in rounding.
        let o = component.origin;
        let [u, v, w] = [a, b, c].map(|p| [p[0] - o[0], p[1] - o[1], p[2] - o[2]]);
        let n = cross(v, w);
        component.volume += (u[0] * n[0] + u[1] * n[1] + u[2] * n[2]) / 6.0;
        let edge = |p: [f64; 3], q: [f64; 3]| [p[0] - q[0], p[1] - q[1], p[2] - q[2]];
        assert!(cross(edge(b, a), edge(c, a)).iter().map(|c| c * c).sum::<f64>() > 1e-18, "a triangle has no area");
        for (p, i) in [a, b, c].into_iter().zip(triangle) {
            used[*i as usize] = true;
            component.low = [0, 1, 2].map(|k| component.low[k].min(p[k]));
            component.high = [0, 1, 2].map(|k| component.high[k].max(p[k]));
        }
    }
    assert!(used.iter().all(|&u| u), "a vertex belongs to no triangle");
    let (solids, cavities): (Vec<_>, Vec<_>) = components.values().partition(|c| c.volume > 0.0);
    for cavity in &cavities {
        assert!(cavity.volume < 0.0, "a component has no volume");
        let inside = |s: &&Component| (0..3).all(|k| s.low[k] < cavity.low[k] && cavity.high[k] < s.high[k]);
        assert!(solids.iter().any(inside), "an inside-out component lies in nothing");
    }
    Report { triangles: mesh.triangles.len(), solids: solids.len(), cavities: cavities.len() }
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// FNV-1a (64 bits) of all positions, then all indices, little-endian.
pub(super) fn fingerprint(mesh: &Mesh) -> u64 {
    let positions = mesh.positions.iter().flatten().flat_map(|c| c.to_bits().to_le_bytes());
    let triangles = mesh.triangles.iter().flatten().flat_map(|i| i.to_le_bytes());
    positions.chain(triangles).fold(0xCBF2_9CE4_8422_2325, |h, b| (h ^ u64::from(b)).wrapping_mul(0x0100_0000_01B3))
}
