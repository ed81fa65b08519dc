//! The exact area interval of one texel, from the arrangement of everything in it, in big integers.
//!
//! Lines: the sides of the square, the edges of the projected surfaces, and where two surfaces' planes cross. Inside
//! an open cell of this arrangement the order of depths along the light never changes, so lo and hi are linear there
//! and take their extremes, as limits, at the cell's corners. At a corner q where lines with directions d and e meet,
//! the cells are those seen from q in the directions +-d + eps (+-e): exact signs at q decide, then along d, then e.
//! Slow and rare: [`super::texel`] settles almost every texel before.

use std::cmp::Ordering;

use num_bigint::{BigInt, Sign};
use num_traits::{Signed, Zero};

use super::ray::Rays;
use super::triangle::Surface;
use super::{DEEPEST, Event, Interval};

/// `a x + b y + c = 0`, texel-relative.
struct Line {
    a: BigInt,
    b: BigInt,
    c: BigInt,
}

struct Face<'a> {
    surface: &'a Surface,
    /// Bounds of the rounded-up depth over the texel.
    range: (i64, i64),
    /// Depth is `(n + gx x + gy y) / den`, texel-relative.
    n: BigInt,
    gx: BigInt,
    gy: BigInt,
    den: BigInt,
    edges: [Line; 3],
}

/// One texel's arrangement.
pub struct Cell<'a> {
    faces: Vec<Face<'a>>,
    lines: Vec<Line>,
    size: BigInt,
    second_surface: bool,
}

/// Sign along (first, then second) direction of something that vanishes at the corner.
fn along(gx: &BigInt, gy: &BigInt, d: &[BigInt; 2], e: &[BigInt; 2]) -> Sign {
    let s = gx * &d[0] + gy * &d[1];
    if s.is_zero() { (gx * &e[0] + gy * &e[1]).sign() } else { s.sign() }
}

fn order(s: Sign) -> Ordering {
    match s {
        Sign::Minus => Ordering::Less,
        Sign::NoSign => Ordering::Equal,
        Sign::Plus => Ordering::Greater,
    }
}

fn ceil_div(n: &BigInt, d: &BigInt) -> i64 {
    let q = n / d;
    let up = !(n - &q * d).is_zero() && n.is_positive();
    let q = if up { q + 1 } else { q };
    i64::try_from(q).unwrap_or(if n.is_negative() { i64::MIN } else { i64::MAX })
}

impl<'a> Cell<'a> {
    /// The texel at tile-relative `p`. Surfaces that begin at or behind `hi` (a bound on the answer) are left out.
    pub fn new(rays: &Rays<'a>, list: &[u32], p: [i64; 2], size: i64, hi: i64) -> Self {
        let corner = [rays.corner[0] + p[0], rays.corner[1] + p[1]];
        let mut faces = Vec::new();
        for &i in list {
            let l = &rays.locals[i as usize];
            if l.event == Event::Wall || l.ceil_range(p[0], p[1], size).0 > hi {
                continue;
            }
            let s = &rays.surfaces[l.index as usize];
            let (gx, gy) = s.slope();
            let den = BigInt::from(s.area());
            let n = BigInt::from(s.z[0]) * &den
                + BigInt::from(gx) * (corner[0] - i64::from(s.x[0]))
                + BigInt::from(gy) * (corner[1] - i64::from(s.y[0]));
            let edges = [0, 1, 2].map(|k| {
                let (a, b, c) = s.edge(k);
                let at = i128::from(a) * i128::from(corner[0]) + i128::from(b) * i128::from(corner[1]) + c;
                Line { a: a.into(), b: b.into(), c: at.into() }
            });
            faces.push(Face {
                surface: s,
                range: l.ceil_range(p[0], p[1], size),
                n,
                gx: gx.into(),
                gy: gy.into(),
                den,
                edges,
            });
        }
        let size = BigInt::from(size);
        let one = || BigInt::from(1);
        let mut lines = vec![
            Line { a: one(), b: BigInt::ZERO, c: BigInt::ZERO },
            Line { a: BigInt::ZERO, b: one(), c: BigInt::ZERO },
            Line { a: one(), b: BigInt::ZERO, c: -&size },
            Line { a: BigInt::ZERO, b: one(), c: -&size },
        ];
        let mut push = |a: &BigInt, b: &BigInt, c: &BigInt| {
            let values = [c.clone(), a * &size + c, b * &size + c, (a + b) * &size + c];
            let crosses = values.iter().any(|v| !v.is_negative()) && values.iter().any(|v| !v.is_positive());
            // the same line from both triangles of an edge is kept once
            let same = |l: &Line| (&l.a * b == a * &l.b) && (&l.a * c == a * &l.c) && (&l.b * c == b * &l.c);
            if crosses && !(a.is_zero() && b.is_zero()) && !lines.iter().any(same) {
                lines.push(Line { a: a.clone(), b: b.clone(), c: c.clone() });
            }
        };
        for f in &faces {
            for e in &f.edges {
                push(&e.a, &e.b, &e.c);
            }
        }
        for (i, f) in faces.iter().enumerate() {
            for g in &faces[i + 1..] {
                if f.range.1 < g.range.0 || g.range.1 < f.range.0 {
                    // one lies in front of the other all over
                    continue;
                }
                let a = &f.gx * &g.den - &g.gx * &f.den;
                let b = &f.gy * &g.den - &g.gy * &f.den;
                let c = &f.n * &g.den - &g.n * &f.den;
                push(&a, &b, &c);
            }
        }
        Cell { faces, lines, size, second_surface: rays.second_surface }
    }

    /// The area interval, given that it lies within `ceil(LO) >= lo` and `ceil(HI) <= hi`; nothing for an edge texel.
    pub fn area(&self, mut lo: i64, mut hi: i64) -> Option<Interval> {
        for (i, l) in self.lines.iter().enumerate() {
            for m in &self.lines[i + 1..] {
                let mut w = &l.a * &m.b - &m.a * &l.b;
                if w.is_zero() {
                    continue;
                }
                let mut x = &l.b * &m.c - &m.b * &l.c;
                let mut y = &m.a * &l.c - &l.a * &m.c;
                if w.is_negative() {
                    (x, y, w) = (-x, -y, -w);
                }
                let far = &self.size * &w;
                if x.is_negative() || y.is_negative() || x > far || y > far {
                    continue;
                }
                let d = [l.b.clone(), -&l.a];
                let e = [m.b.clone(), -&m.a];
                self.corner(&[x, y, w], &d, &e, &mut lo, &mut hi)?;
                if lo >= hi {
                    return None;
                }
            }
        }
        let max = (hi - 1).min(DEEPEST);
        (lo <= max).then_some(Interval { min: lo as u32, max: max as u32 })
    }

    /// All cells around the corner q = (x, y) / w next to its two lines; nothing once a cell is uncovered.
    fn corner(&self, q: &[BigInt; 3], d: &[BigInt; 2], e: &[BigInt; 2], lo: &mut i64, hi: &mut i64) -> Option<()> {
        let [x, y, w] = q;
        let at = |l: &Line| &l.a * x + &l.b * y + &l.c * w;
        let sides = [x.clone(), y.clone(), &self.size * w - x, &self.size * w - y];
        let normals = [[1, 0], [0, 1], [-1, 0], [0, -1]].map(|n: [i32; 2]| n.map(BigInt::from));
        let signs: Vec<[Sign; 3]> = self.faces.iter().map(|f| [0, 1, 2].map(|k| at(&f.edges[k]).sign())).collect();
        let candidates: Vec<usize> =
            (0..self.faces.len()).filter(|i| signs[*i].iter().all(|s| *s != Sign::Minus)).collect();
        let depth: Vec<BigInt> = candidates
            .iter()
            .map(|i| {
                let f = &self.faces[*i];
                &f.n * w + &f.gx * x + &f.gy * y
            })
            .collect();
        let negate = |v: &[BigInt; 2]| [-&v[0], -&v[1]];
        for (first, second) in [(d, e), (e, d)] {
            for quadrant in 0..4 {
                let first = if quadrant & 1 == 0 { first.clone() } else { negate(first) };
                let second = if quadrant & 2 == 0 { second.clone() } else { negate(second) };
                let within = (0..4).all(|k| {
                    sides[k].is_positive() || along(&normals[k][0], &normals[k][1], &first, &second) == Sign::Plus
                });
                if !within {
                    continue;
                }
                let mut hits: Vec<usize> = (0..candidates.len())
                    .filter(|c| {
                        let f = &self.faces[candidates[*c]];
                        (0..3).all(|k| {
                            signs[candidates[*c]][k] == Sign::Plus
                                || along(&f.edges[k].a, &f.edges[k].b, &first, &second) == Sign::Plus
                        })
                    })
                    .collect();
                if hits.is_empty() {
                    return None;
                }
                let compare = |a: usize, b: usize| {
                    let (f, g) = (&self.faces[candidates[a]], &self.faces[candidates[b]]);
                    let at_q = (&depth[a] * &g.den).cmp(&(&depth[b] * &f.den));
                    at_q.then_with(|| {
                        let gx = &f.gx * &g.den - &g.gx * &f.den;
                        let gy = &f.gy * &g.den - &g.gy * &f.den;
                        order(along(&gx, &gy, &first, &second))
                    })
                };
                let event = |c: usize| self.faces[candidates[c]].surface.event;
                hits.sort_by(|a, b| compare(*a, *b).then(event(*a).cmp(&event(*b))));
                let ceil = |c: usize| ceil_div(&depth[c], &(&self.faces[candidates[c]].den * w));
                *lo = (*lo).max(ceil(hits[0]));
                if let Some(end) = self.end(&hits, &candidates, &compare) {
                    *hi = (*hi).min(ceil(end));
                }
            }
        }
        Some(())
    }

    /// The hit that ends the first stretch.
    fn end(&self, hits: &[usize], candidates: &[usize], compare: &dyn Fn(usize, usize) -> Ordering) -> Option<usize> {
        if self.second_surface {
            return hits.get(1).copied();
        }
        let mut inside: Vec<(u32, i32)> = Vec::new();
        let mut i = 0;
        while i < hits.len() {
            let mut j = i;
            while j < hits.len() && (j == i || compare(hits[i], hits[j]) == Ordering::Equal) {
                let s = self.faces[candidates[hits[j]]].surface;
                let step = if s.event == Event::Enter { 1 } else { -1 };
                match inside.iter_mut().find(|(solid, _)| *solid == s.solid) {
                    Some((_, n)) => *n += step,
                    None => inside.push((s.solid, step)),
                }
                j += 1;
            }
            if inside.iter().all(|(_, n)| *n <= 0) {
                return Some(hits[i]);
            }
            i = j;
        }
        None
    }
}
