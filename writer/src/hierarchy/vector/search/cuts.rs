//! Edges along which a square is cut, and the lines that are stored for them.

use super::strip::{Band, ROUNDING};
use super::{BEND, BLOCK_LEVEL, Cut, MANY_COLUMNS, MOST_CREASES, Search};
use crate::hierarchy::vector::entry::Line;
use crate::hierarchy::vector::segment::clip_segment;
use crate::interval::Event;
use crate::interval::proof::{HalfPlane, Region};

/// An edge along which a region may be cut.
pub(super) struct Candidate {
    /// Depth in the middle of its part in the region.
    z: f64,
    /// That part's ends, and the middle between them, with depths.
    places: [[i64; 3]; 3],
    /// What rounding these makes, in depth.
    slack: f64,
    pub(super) cut: Cut,
}

impl Search<'_> {
    /// Silhouette edges through the region, the one nearest to the light first.
    pub(super) fn candidates(&self, list: &[u32], region: Region<'_>, path: &[(usize, bool)]) -> Vec<Candidate> {
        let mut found: Vec<Candidate> = Vec::new();
        for &i in list {
            let l = &self.rays.locals[i as usize];
            let edges = self.edges[l.index as usize].silhouettes;
            if edges == 0 || l.event != Event::Enter {
                continue;
            }
            for k in 0..3 {
                if edges >> k & 1 == 0 || (l.a[k] == 0 && l.b[k] == 0) {
                    continue;
                }
                let Some(candidate) = self.cut(i, k, &region) else { continue };
                let line = candidate.cut.line;
                if found.iter().any(|f| f.cut.line == line) || path.iter().any(|c| self.cuts[c.0].line == line) {
                    continue;
                }
                found.push(candidate);
            }
        }
        found.sort_by(|a, b| a.z.total_cmp(&b.z));
        found
    }

    /// Whether next to no square of this level with so much in sight is answered by one entry. `edges` are all silhouette
    /// edges through it. Figures: NOTES.md.
    pub(super) fn is_crowded(&self, list: &[u32], edges: &[Candidate], p: [i64; 2], size: i64) -> bool {
        let level = (size >> self.scale.subtexel_bits).trailing_zeros();
        let (mut lines, mut broken) = (0, 0);
        for edge in edges {
            let [from, middle, to] = edge.places.map(|q| self.is_hidden(list, q, edge.slack));
            lines += usize::from(!middle);
            // somewhere in the square it runs into something
            broken += usize::from(from != to);
            if lines > 3 {
                return true;
            }
        }
        if level <= u32::from(BLOCK_LEVEL) {
            return lines > 1 || broken > 0 || (lines > 0 && self.vertices(list, p, size, 1) > 0);
        }
        if broken > 1 || (broken > 0 && lines == 0) {
            return true;
        }
        let most = if level == 3 && lines > 1 { 1 } else { 2 };
        lines > 0 && self.vertices(list, p, size, most) >= most
    }

    /// How many corners of surfaces are in sight inside a square; counted up to `most`.
    fn vertices(&self, list: &[u32], p: [i64; 2], size: i64, most: usize) -> usize {
        let mut seen: Vec<[i64; 3]> = Vec::new();
        for l in list.iter().map(|i| self.local(*i)).filter(|l| l.event != Event::Wall) {
            let s = &self.rays.surfaces[l.index as usize];
            for k in 0..3 {
                let v = [0, 1].map(|i| i64::from(if i == 0 { s.x[k] } else { s.y[k] }) - self.rays.corner[i]);
                let q = [v[0], v[1], i64::from(s.z[k])];
                let inside = (0..2).all(|i| p[i] < v[i] && v[i] < p[i] + size);
                if inside && !seen.contains(&q) && !self.is_hidden(list, q, 4.0 + l.eps) {
                    seen.push(q);
                    if seen.len() >= most {
                        return most;
                    }
                }
            }
        }
        seen.len()
    }

    /// Whether something lies in front of a place by more than `slack`.
    fn is_hidden(&self, list: &[u32], [x, y, z]: [i64; 3], slack: f64) -> bool {
        list.iter().map(|i| self.local(*i)).any(|l| {
            l.event != Event::Wall
                && l.covers(x, y, 1, 1)
                && l.approximate(x, y) + l.eps + slack + 2.0 * (l.sx.abs() + l.sy.abs()) < z as f64
        })
    }

    /// Edge `k` of a surface where it runs through the region, and its depth there.
    pub(super) fn cut(&self, i: u32, k: usize, region: &Region<'_>) -> Option<Candidate> {
        let l = &self.rays.locals[i as usize];
        let inside = HalfPlane { a: l.a[k], b: l.b[k], c: l.c[k] };
        let s = &self.rays.surfaces[l.index as usize];
        let corner =
            |j: usize| [0, 1].map(|a| i64::from(if a == 0 { s.x[j % 3] } else { s.y[j % 3] }) - self.rays.corner[a]);
        let ends = [corner(k), corner(k + 1)];
        let part = clip_segment(ends.map(|e| e.map(|v| v as f64)), region)?;
        let middle = [0, 1].map(|a| (part[0][a] + part[1][a]) / 2.0);
        let z = l.z0 + l.sx * middle[0] + l.sy * middle[1];
        let absolute = ends.map(|e| [e[0] + self.rays.corner[0], e[1] + self.rays.corner[1]]);
        // the same whichever triangle it comes from
        let [a, b] = if absolute[0] < absolute[1] { absolute } else { [absolute[1], absolute[0]] };
        let line = Line::through(a, b, self.scale)?;
        let beyond = if line.axis { inside.a > 0 } else { inside.b > 0 };
        let slack = 2.0 + l.eps + 2.0 * (l.sx.abs() + l.sy.abs());
        let place = |q: [f64; 2]| [q[0].round() as i64, q[1].round() as i64, (l.z0 + l.sx * q[0] + l.sy * q[1]) as i64];
        Some(Candidate {
            z,
            places: [part[0], middle, part[1]].map(place),
            slack,
            cut: Cut { inside, line, beyond, crease: false },
        })
    }

    /// Edges between two faces of the front, or of the end behind it, through the region.
    pub(super) fn creases(&mut self, list: &[u32], region: Region<'_>, path: &[(usize, bool)]) -> Vec<Cut> {
        let Some(sample) = self.prover.sample(&region) else { return Vec::new() };
        let Some(front) = self.front(list, sample) else { return Vec::new() };
        let mut found: Vec<Cut> = Vec::new();
        // their faces may consist of several triangles
        let mut faces: Vec<u32> = [Some(front), self.end(list, sample, front)].into_iter().flatten().collect();
        let mut n = 0;
        while n < faces.len() && found.len() < MOST_CREASES {
            let i = faces[n];
            let l = &self.rays.locals[i as usize];
            n += 1;
            for (k, mate) in self.edges[l.index as usize].across.into_iter().enumerate() {
                if l.a[k] == 0 && l.b[k] == 0 {
                    continue;
                }
                let Some(&other) = list.iter().find(|n| self.local(**n).index == mate) else { continue };
                let m = self.local(other);
                let bend = (m.sx - l.sx).abs() + (m.sy - l.sy).abs();
                if bend < (m.sx.abs() + m.sy.abs() + l.sx.abs() + l.sy.abs()) * BEND {
                    if faces.len() < 6 && !faces.contains(&other) {
                        faces.push(other);
                    }
                    continue;
                }
                let Some(edge) = self.cut(i, k, &region) else { continue };
                let cut = Cut { crease: true, ..edge.cut };
                if !found.iter().any(|f| f.line == cut.line) && !path.iter().any(|c| self.cuts[c.0].line == cut.line) {
                    found.push(cut);
                }
            }
        }
        found.truncate(MOST_CREASES);
        found
    }

    /// Whether the stored line tells the side of every texel centre of the square as the exact one does, with room for
    /// the rounding of pages, but for a texel that may be excepted; the number of texels that it crosses.
    pub(super) fn told(&mut self, cut: usize, p: [i64; 2], size: i64) -> Option<u64> {
        let Cut { inside, line, beyond, .. } = self.cuts[cut];
        let (u, t) = if line.axis { (1, 0) } else { (0, 1) };
        let bits = self.scale.subtexel_bits;
        let texel = 1i64 << bits;
        let corner = self.rays.corner.map(|c| c >> bits);
        let (first, count) = (p.map(|v| v >> bits), size >> bits);
        // the stored line and the exact one lie so close that they can only differ on centres within this
        let off = line.off(&inside, self.rays.corner, p, size, self.scale) / texel as f64 + ROUNDING;
        let mut look = |n: i64| {
            let boundary = line.boundary((corner[u] + n) * 256 + 128) - (corner[t] << 20);
            // the first centre at or beyond the boundary: T = 2^20 t + 2^19
            let at = (boundary - (1 << 19) + (1 << 20) - 1) >> 20;
            for (c, is_beyond) in [(at, true), (at - 1, false)] {
                if c < first[t] || c >= first[t] + count {
                    continue;
                }
                let room = ((c << 20) + (1 << 19) - boundary).abs();
                let mut q = [0; 2];
                q[u] = n * texel + texel / 2;
                q[t] = c * texel + texel / 2;
                let side = inside.at(q);
                let told = room >= 4 && side != 0 && (side > 0) == (is_beyond == beyond);
                if !told && !self.except(q.map(|v| v - texel / 2)) {
                    return None;
                }
            }
            // nothing of the line in this column: the side of any centre must still be right
            if at < first[t] || at > first[t] + count {
                let c = if at < first[t] { first[t] } else { first[t] + count - 1 };
                let mut q = [0; 2];
                q[u] = n * texel + texel / 2;
                q[t] = c * texel + texel / 2;
                let side = inside.at(q);
                if side == 0 || (side > 0) != ((c >= at) == beyond) {
                    return None;
                }
            }
            Some(())
        };
        let (from, to) = (first[u], first[u] + count);
        if count >= MANY_COLUMNS && off < 0.1 {
            Band::new(&line, corner, from, bits).near_centres(from, to, off, look)?;
        } else {
            (from..to).try_for_each(&mut look)?;
        }
        let row = |n: i64| (line.boundary((corner[u] + n) * 256) - (corner[t] << 20)) >> 20;
        Some(crossed(row, (from, to), (first[t], first[t] + count - 1)))
    }

    /// Silhouette edges through the square.
    pub fn silhouettes(&self, list: &[u32], p: [i64; 2], size: i64, most: usize) -> Vec<Line> {
        self.candidates(list, Region::square(p, size), &[]).into_iter().take(most).map(|c| c.cut.line).collect()
    }
}

/// Texels of the rows `low..=high` that a line crosses in the columns `from..to`: it is in `row(n)` at the beginning of column n, and
/// these rows rise or fall all along.
fn crossed(row: impl Fn(i64) -> i64, (from, to): (i64, i64), (low, high): (i64, i64)) -> u64 {
    let ends = [row(from), row(to)].map(|r| r.clamp(low, high));
    // how many columns, of the first ones, are such
    let count = |is_such: &dyn Fn(i64) -> bool| {
        let (mut some, mut all) = (from, to);
        while some < all {
            let n = some + (all - some) / 2;
            (some, all) = if is_such(n) { (n + 1, all) } else { (some, n) };
        }
        some - from
    };
    let columns = if row(from) <= row(to) {
        count(&|n| row(n) <= high) - count(&|n| row(n + 1) < low)
    } else {
        count(&|n| row(n) >= low) - count(&|n| row(n + 1) > high)
    };
    (columns + (ends[1] - ends[0]).abs()) as u64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn crossed_texels_are_counted_as_by_looking_at_each_column() {
        let mut state = 5u64;
        let mut dice = |n: i64| {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 33) as i64 % n
        };
        let mut seen = [0; 3];
        for _ in 0..4000 {
            let (m, c) = (dice(2049) - 1024, dice(80_000) - 40_000);
            let row = |n: i64| (c + m * n) >> 10;
            let from = dice(40) - 20;
            let (to, low) = (from + 1 + dice(40), dice(20) - 10);
            let high = low + dice(30);
            let column = |n: i64| {
                let (a, b) = (row(n).min(row(n + 1)).max(low), row(n).max(row(n + 1)).min(high));
                (b - a + 1).max(0) as u64
            };
            let all: u64 = (from..to).map(column).sum();
            assert_eq!(crossed(row, (from, to), (low, high)), all, "{m} {c} {from}..{to} {low}..={high}");
            seen[usize::from(all > 0) + usize::from(all as i64 > to - from)] += 1;
        }
        assert!(seen.iter().all(|n| *n > 200), "{seen:?}");
    }
}
