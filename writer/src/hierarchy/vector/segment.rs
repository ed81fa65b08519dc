//! Segments cut to squares, half-planes and surfaces, in tile-relative lattice steps.

use crate::interval::proof::{HalfPlane, Region};
use crate::interval::triangle::Local;

/// The part of a segment in the region, or nothing.
pub fn clip_segment(ends: [[f64; 2]; 2], region: &Region<'_>) -> Option<[[f64; 2]; 2]> {
    let (p, s) = (region.p.map(|v| v as f64), region.size as f64);
    let square = [[1.0, 0.0, -p[0]], [-1.0, 0.0, p[0] + s], [0.0, 1.0, -p[1]], [0.0, -1.0, p[1] + s]];
    let lines = region.lines.iter().map(|l| [l.a as f64, l.b as f64, l.c as f64]);
    clip(ends, square.into_iter().chain(lines), 0.0)
}

/// The part of a segment over a surface, or within a little of it.
pub fn clip_to_surface(ends: [[f64; 2]; 2], l: &Local) -> Option<[[f64; 2]; 2]> {
    clip(ends, (0..3).map(|k| [l.a[k] as f64, l.b[k] as f64, l.c[k] as f64]), AROUND)
}

fn clip(ends: [[f64; 2]; 2], planes: impl Iterator<Item = [f64; 3]>, margin: f64) -> Option<[[f64; 2]; 2]> {
    let (mut from, mut to) = (0.0f64, 1.0f64);
    for [a, b, c] in planes {
        let at = |p: [f64; 2]| a * p[0] + b * p[1] + c + (a.abs() + b.abs()) * margin;
        let (e, f) = (at(ends[0]), at(ends[1]));
        if e < 0.0 && f < 0.0 {
            return None;
        }
        if e < 0.0 {
            from = from.max(e / (e - f));
        } else if f < 0.0 {
            to = to.min(e / (e - f));
        }
    }
    let at = |t: f64| [0, 1].map(|i| ends[0][i] + (ends[1][i] - ends[0][i]) * t);
    (from < to).then(|| [at(from), at(to)])
}

/// What [`border`] reaches beyond a region, in lattice steps, so that rounding makes it no shorter.
pub const AROUND: f64 = 1.0 / 512.0;

/// The part of a line in the region and `margin` lattice steps around it; with a negative one that far inside it.
pub fn border(line: &HalfPlane, region: &Region<'_>, margin: f64) -> Option<[[f64; 2]; 2]> {
    let (a, b, c) = (line.a as f64, line.b as f64, line.c as f64);
    let n = a * a + b * b;
    let s = region.size as f64;
    let middle = [region.p[0] as f64 + s / 2.0, region.p[1] as f64 + s / 2.0];
    let d = (a * middle[0] + b * middle[1] + c) / n;
    let foot = [middle[0] - a * d, middle[1] - b * d];
    let along = [-b / n.sqrt() * 2.0 * s, a / n.sqrt() * 2.0 * s];
    let ends = [[foot[0] - along[0], foot[1] - along[1]], [foot[0] + along[0], foot[1] + along[1]]];
    let p = region.p.map(|v| v as f64);
    let square = [[1.0, 0.0, -p[0]], [-1.0, 0.0, p[0] + s], [0.0, 1.0, -p[1]], [0.0, -1.0, p[1] + s]];
    let lines = region.lines.iter().map(|l| [l.a as f64, l.b as f64, l.c as f64]);
    clip(ends, square.into_iter().chain(lines), margin)
}
