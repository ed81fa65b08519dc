//! Chords joined to fewer, longer ones.

use std::collections::HashMap;

use super::DEVIATION;
use super::piece::Chord;
use super::sample::UNIT;

/// The farthest that a joined chord may be from the chords that it stands for, in pixels; for bilinear sampling.
pub const JOINT: f64 = DEVIATION * 5.0 / 8.0;

/// The most chords that become one.
const MOST: usize = 64;

const NONE: u32 = u32::MAX;

/// Joins chords that follow each other in a line; every chord that goes keeps within `tolerance` (pixels) of the one that
/// stands for it. Points that `fixed` names stay.
pub fn simplify(chords: &[Chord], tolerance: f64, fixed: impl Fn([i64; 2]) -> bool) -> Vec<Chord> {
    let mut points: Vec<[i64; 2]> = chords.iter().flatten().copied().collect();
    points.sort_unstable();
    points.dedup();
    let place: HashMap<[i64; 2], u32> = points.iter().enumerate().map(|(i, p)| (*p, i as u32)).collect();
    let mut links: Vec<[u32; 2]> = chords.iter().map(|c| c.map(|p| place[&p])).collect();
    links.sort_unstable();
    let (mut next, mut degree) = (vec![NONE; points.len()], vec![[0u32; 2]; points.len()]);
    for [a, b] in &links {
        next[*a as usize] = *b;
        degree[*a as usize][0] += 1;
        degree[*b as usize][1] += 1;
    }
    let stays: Vec<bool> = (0..points.len()).map(|i| degree[i] != [1, 1] || fixed(points[i])).collect();
    let mut met = vec![false; points.len()];
    let mut joined = Vec::new();
    let mut chain = Vec::new();
    for [a, b] in &links {
        if !stays[*a as usize] {
            continue;
        }
        chain.clear();
        chain.push(*a);
        let mut at = *b;
        while !stays[at as usize] {
            met[at as usize] = true;
            chain.push(at);
            at = next[at as usize];
        }
        chain.push(at);
        join(&points, &chain, tolerance, &mut joined);
    }
    for start in 0..points.len() as u32 {
        if stays[start as usize] || met[start as usize] {
            continue;
        }
        chain.clear();
        let mut at = start;
        while !std::mem::replace(&mut met[at as usize], true) {
            chain.push(at);
            at = next[at as usize];
        }
        chain.push(start);
        join(&points, &chain, tolerance, &mut joined);
    }
    joined
}

fn join(points: &[[i64; 2]], chain: &[u32], tolerance: f64, joined: &mut Vec<Chord>) {
    let at = |i: usize| points[chain[i] as usize];
    let mut from = 0;
    while from + 1 < chain.len() {
        let mut to = from + 1;
        while to + 1 < chain.len()
            && to + 1 - from <= MOST
            && (from + 1..=to).all(|k| near(at(from), at(to + 1), at(k), tolerance))
        {
            to += 1;
        }
        joined.push([at(from), at(to)]);
        from = to;
    }
}

/// Whether `p` is within `tolerance` of the line from `a` to `b`.
fn near(a: [i64; 2], b: [i64; 2], p: [i64; 2], tolerance: f64) -> bool {
    let v = |q: [i64; 2]| [0, 1].map(|k| (q[k] - a[k]) as f64 / UNIT as f64);
    let (d, r) = (v(b), v(p));
    let (length, along) = (d[0] * d[0] + d[1] * d[1], d[0] * r[0] + d[1] * r[1]);
    if along < 0.0 || along > length || length == 0.0 {
        return false;
    }
    let across = d[0] * r[1] - d[1] * r[0];
    across * across <= tolerance * tolerance * length
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn straight_chains_become_one_chord() {
        let at = |x: i64, y: i64| [x * UNIT, y * UNIT];
        let square = [at(0, 0), at(1, 0), at(2, 0), at(2, 1), at(2, 2), at(1, 2), at(0, 2), at(0, 1)];
        let ring: Vec<Chord> = (0..8).map(|k| [square[k], square[(k + 1) % 8]]).collect();
        let corners = [[at(0, 0), at(2, 0)], [at(2, 0), at(2, 2)], [at(2, 2), at(0, 2)], [at(0, 2), at(0, 0)]];
        assert_eq!(simplify(&ring, 0.0, |_| false), corners);
        assert_eq!(simplify(&ring, 0.0, |p| p == at(1, 2)).len(), 5);
        // a bend of a hundredth of a pixel
        let bent = [[at(0, 0), [UNIT, UNIT / 100]], [[UNIT, UNIT / 100], at(2, 0)]];
        assert_eq!(simplify(&bent, 0.009, |_| false).len(), 2);
        assert_eq!(simplify(&bent, 0.011, |_| false), [[at(0, 0), at(2, 0)]]);
        // a turn back is none
        let back = [[at(0, 0), at(2, 0)], [at(2, 0), at(1, 0)]];
        assert_eq!(simplify(&back, 0.1, |_| false).len(), 2);
    }
}
