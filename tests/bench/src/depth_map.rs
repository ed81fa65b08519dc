//! The baseline: a plain shadow map that holds, for each texel, the depth of the first surface at its centre.
//!
//! In: a snapped mesh, so that both maps are about the same geometry on the same lattice. Out: strips of rows, so that
//! maps of any size can be passed through. Depths are rounded to the nearest lattice step.

use rayon::prelude::*;
use umbrage::format::projection::UNCOVERED;
use umbrage::writer::solid::SnappedMesh;

/// Rows of a strip, and the side of a tile in it.
pub const STRIP: usize = 256;

/// Calls `visit` with every strip's number and texels, row by row, from many threads; the answers by rising number.
pub fn strips<T: Send>(mesh: &SnappedMesh, visit: impl Fn(usize, &[u32]) -> T + Sync) -> Vec<T> {
    let side = mesh.lattice.resolution() as usize;
    let rows = side.min(STRIP);
    let count = side / rows;
    let step = (1u64 << mesh.lattice.subtexel_bits) as f64;
    let mut lists: Vec<Vec<u32>> = vec![Vec::new(); count];
    for (i, t) in (0u32..).zip(&mesh.triangles) {
        let y = t.map(|v| mesh.positions[v as usize][1]);
        let strip = |y: i64| ((y >> mesh.lattice.subtexel_bits) as usize / rows).min(count - 1);
        let [low, high] = [y.iter().min(), y.iter().max()].map(|v| strip(v.copied().unwrap_or(0)));
        lists[low..=high].iter_mut().for_each(|l| l.push(i));
    }
    lists
        .par_iter()
        .enumerate()
        .map_init(Vec::new, |texels, (number, list)| {
            texels.clear();
            texels.resize(rows * side, UNCOVERED);
            for &t in list {
                let corners = mesh.triangles[t as usize].map(|v| mesh.positions[v as usize]);
                fill(corners, step, number * rows, side, texels);
            }
            visit(number, texels)
        })
        .collect()
}

/// The whole map, row by row.
pub fn whole(mesh: &SnappedMesh) -> Vec<u32> {
    strips(mesh, |_, texels| texels.to_vec()).concat()
}

/// Draws one triangle into a strip that begins at row `first`.
fn fill(corners: [[i64; 3]; 3], step: f64, first: usize, side: usize, texels: &mut [u32]) {
    let rows = texels.len() / side;
    // In texels, so that centres stand at + 1/2.
    let p = corners.map(|c| [c[0] as f64 / step, c[1] as f64 / step, c[2] as f64]);
    let [a, b, c] = p;
    let area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
    if area == 0.0 {
        return;
    }
    let gx = ((b[2] - a[2]) * (c[1] - a[1]) - (c[2] - a[2]) * (b[1] - a[1])) / area;
    let gy = ((c[2] - a[2]) * (b[0] - a[0]) - (b[2] - a[2]) * (c[0] - a[0])) / area;
    let extremes = |k: usize| [a[k].min(b[k]).min(c[k]), a[k].max(b[k]).max(c[k])];
    let ([bottom, top], [near, far]) = (extremes(1), extremes(2));
    let begin = ((bottom - 0.5).ceil().max(0.0) as usize).max(first);
    let end = ((top - 0.5).floor() as usize + 1).min(first + rows);
    for row in begin..end {
        let y = row as f64 + 0.5;
        let (mut left, mut right) = (f64::INFINITY, f64::NEG_INFINITY);
        for (p, q) in [(a, b), (b, c), (c, a)] {
            if y < p[1].min(q[1]) || y > p[1].max(q[1]) {
                continue;
            }
            let ends =
                if p[1] == q[1] { [p[0], q[0]] } else { [p[0] + (q[0] - p[0]) * ((y - p[1]) / (q[1] - p[1])); 2] };
            (left, right) = (left.min(ends[0]).min(ends[1]), right.max(ends[0]).max(ends[1]));
        }
        if left > right {
            continue;
        }
        let (from, to) = ((left - 0.5).ceil().max(0.0) as usize, ((right - 0.5).floor() + 1.0).max(0.0) as usize);
        let line = &mut texels[(row - first) * side..][..side];
        for (x, texel) in line.iter_mut().enumerate().take(to.min(side)).skip(from) {
            let depth = a[2] + gx * (x as f64 + 0.5 - a[0]) + gy * (y - a[1]);
            // Needles have slopes beyond what f64 can evaluate: their corners bound them.
            *texel = (*texel).min(depth.clamp(near, far).round() as u32);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use umbrage::render::{Scene, ShadowRays};
    use umbrage::writer::solid::{self, Policy};
    use umbrage::writer::{bake, scene};

    /// Ray casting at the centres finds the same depths, but for centres on the very rim of a surface.
    #[test]
    fn equal_to_rays_at_the_centres() {
        let mesh = scene::generated("city:3:0.05").expect("generated").expect("a scene");
        let light = bake::Light { name: "sun".to_string(), direction: scene::DEMO_LIGHT };
        let lattice = bake::lattice(&mesh, &light, 512, Policy::Closed).expect("a lattice");
        let snapped = solid::snap(&mesh, lattice, Policy::Closed).expect("a solid");
        let map = whole(&snapped);
        let geometry = Scene::new(&snapped);
        let rays = ShadowRays::new(&geometry);
        let step = 1i64 << lattice.subtexel_bits;
        let mut differ = 0;
        for (i, &found) in map.iter().enumerate() {
            let xy = [i % 512, i / 512].map(|v| v as i64 * step + step / 2);
            let exact = rays.first(xy).map_or(f64::from(UNCOVERED), |f| f.0.to_f64());
            differ += usize::from((exact - f64::from(found)).abs() > 64.0);
        }
        assert!(differ <= 2, "{differ} of {}", map.len());
    }
}
