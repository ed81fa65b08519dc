//! Polygons cut into fans.

use crate::mesh::Mesh;

/// How many other corners are tried for a polygon whose first does not see all of it; more would let a file take long.
const TRIED: usize = 16;

/// Collects triangles of polygons; remembers those with more than three corners until all vertices are known.
#[derive(Default)]
pub struct Fans {
    /// First triangle of each polygon, how many, and where it stands in the file.
    polygons: Vec<(u32, u32, u32)>,
}

impl Fans {
    /// Adds a polygon as the fan of its first corner. `place` is its line or index.
    pub fn add(&mut self, triangles: &mut Vec<[u32; 3]>, corners: &[u32], place: usize) {
        let first = triangles.len();
        triangles.extend(corners.windows(2).skip(1).map(|w| [corners[0], w[0], w[1]]));
        if corners.len() > 3 {
            // Beyond u32 the scene is refused as too large anyway.
            self.polygons.push((first as u32, corners.len() as u32 - 2, u32::try_from(place).unwrap_or(u32::MAX)));
        }
    }

    /// Gives concave polygons a fan that does not fold over; says how many have none and where (`what`) the first is.
    pub fn finish(&self, mesh: &mut Mesh, what: &str) -> Option<String> {
        let (mut folded, mut first) = (0, 0);
        for (start, count, place) in &self.polygons {
            let fan = &mut mesh.triangles[*start as usize..][..*count as usize];
            if !folds(&mesh.positions, fan) {
                continue;
            }
            let corners: Vec<u32> =
                [fan[0][0], fan[0][1]].into_iter().chain(fan.iter().map(|t: &[u32; 3]| t[2])).collect();
            let n = corners.len();
            let turned = (1..n.min(TRIED + 1)).find_map(|k| {
                let at = |i: usize| corners[(k + i) % n];
                let fan: Vec<[u32; 3]> = (1..n - 1).map(|i| [at(0), at(i), at(i + 1)]).collect();
                (!folds(&mesh.positions, &fan)).then_some(fan)
            });
            match turned {
                Some(turned) => fan.copy_from_slice(&turned),
                None => {
                    if folded == 0 {
                        first = *place;
                    }
                    folded += 1;
                }
            }
        }
        (folded > 0).then(|| {
            format!("{folded} concave polygons have no fan that fits, first at {what} {first}; triangulate the mesh")
        })
    }
}

/// Whether a triangle of the fan faces against the whole polygon.
fn folds(positions: &[[f64; 3]], fan: &[[u32; 3]]) -> bool {
    let cross = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|i| positions[i as usize]);
        let (u, v) = ([b[0] - a[0], b[1] - a[1], b[2] - a[2]], [c[0] - a[0], c[1] - a[1], c[2] - a[2]]);
        [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]
    };
    let sum = fan.iter().map(cross).fold([0.0; 3], |s, n| [s[0] + n[0], s[1] + n[1], s[2] + n[2]]);
    let size = |n: [f64; 3]| n[0] * n[0] + n[1] * n[1] + n[2] * n[2];
    fan.iter().map(cross).any(|n| {
        let along = n[0] * sum[0] + n[1] * sum[1] + n[2] * sum[2];
        // Rounding alone turns slivers; those are left as they are.
        along < 0.0 && size(n) > size(sum) * 1e-24
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cut(points: &[[f64; 2]]) -> (Mesh, Option<String>) {
        let mut mesh = Mesh { positions: points.iter().map(|p| [p[0], p[1], 0.0]).collect(), triangles: Vec::new() };
        let mut fans = Fans::default();
        fans.add(&mut mesh.triangles, &(0..points.len() as u32).collect::<Vec<_>>(), 7);
        let note = fans.finish(&mut mesh, "line");
        (mesh, note)
    }

    #[test]
    fn polygons_become_fans() {
        let (mesh, note) = cut(&[[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [1.0, 2.0], [0.0, 1.0]]);
        assert_eq!((mesh.triangles, note), (vec![[0, 1, 2], [0, 2, 3], [0, 3, 4]], None));
    }

    #[test]
    fn a_concave_polygon_gets_the_fan_that_fits() {
        let (mesh, note) = cut(&[[0.0, 0.0], [1.0, 0.2], [2.0, 0.0], [1.0, 2.0]]);
        assert_eq!((mesh.triangles, note), (vec![[1, 2, 3], [1, 3, 0]], None));
    }

    #[test]
    fn a_polygon_without_a_fan_is_noted() {
        // a comb: no corner sees all three teeth
        let [bottom, middle, top] = [0.0, 1.0, 5.0];
        let mut comb = vec![[0.0, bottom], [10.0, bottom]];
        for [right, left] in [[10.0, 9.0], [6.0, 5.0], [1.0, 0.0]] {
            comb.extend([[right, top], [left, top], [left, middle], [left - 3.0, middle]]);
        }
        comb.truncate(12);
        let (mesh, note) = cut(&comb);
        assert_eq!(mesh.triangles.len(), 10);
        assert_eq!(note.unwrap(), "1 concave polygons have no fan that fits, first at line 7; triangulate the mesh");
    }
}
