//! Texels that cells of a cut square share.

use super::strip::{Band, ROUNDING};
use super::{Cell, Cut, DOUBTS, MANY_COLUMNS, MOST_INTERVALS, Search};
use crate::hierarchy::vector::entry::{Entry, EntryId, Palette};
use crate::hierarchy::vector::segment::{AROUND, border, clip_segment, clip_to_surface};
use crate::hierarchy::vector::texels::allows;
use crate::interval::proof::{HalfPlane, Region, clearance};
use crate::interval::texel::texel;
use crate::interval::triangle::Cover;
use crate::interval::{DEEPEST, Event, Interval, wide};
use umbrage_format::projection::UNCOVERED;

/// Of so many doubtful texels one is looked at before all others.
const SPREAD: usize = 16;

/// How many times as far as [`Search::far`] from the line where a tip's front and end meet is tried.
const FARS: [f64; 2] = [1.0, 8.0];

/// What is known of the texels that two cells share.
enum Border {
    /// Each cell's entry is right in the other one, too, as far as such texels reach.
    Right,
    /// Those inside which a part of this segment lies have an empty area interval.
    Empty(Option<[[f64; 2]; 2]>),
    /// Nothing.
    Unknown,
}

impl Search<'_> {
    /// Whether all cells fit together, and every centre is told to be in the right one, but for a texel that may be excepted.
    pub(super) fn sound(&mut self, palette: &Palette, id: EntryId, p: [i64; 2], size: i64) -> bool {
        self.doubtful.clear();
        let most = DOUBTS * (size >> self.scale.subtexel_bits) as usize + 8;
        for i in 0..self.cells.len() {
            for j in i + 1..self.cells.len() {
                // a tip's plane is right for texels that lie inside its cell, and for centres of edge texels
                let (a, b) = (&self.cells[i], &self.cells[j]);
                let same = a.entry == b.entry && a.tip.is_none() && b.tip.is_none();
                if same {
                    continue;
                }
                let few = match self.border(i, j, p, size) {
                    Border::Right => continue,
                    Border::Empty(part) => self.shared(i, j, p, size, None, part, most),
                    Border::Unknown => {
                        let far = self.meet_far(i, j, p, size);
                        self.shared(i, j, p, size, far.as_deref(), None, most)
                    }
                };
                if few.is_none() {
                    return false;
                }
            }
        }
        let mut edges = 0;
        for n in 0..self.cuts.len() {
            match self.told(n, p, size) {
                // at an edge between two faces the stretch goes on
                Some(texels) => edges += if self.cuts[n].crease { 0 } else { texels },
                None => return false,
            }
        }
        let mut doubtful = std::mem::take(&mut self.doubtful);
        doubtful.sort_unstable();
        doubtful.dedup();
        // wrong ones lie side by side: some from everywhere first
        let mut spread = (0..SPREAD).flat_map(|n| doubtful.iter().skip(n).step_by(SPREAD));
        let right =
            spread.all(|q| self.stored(palette, id, *q).is_some_and(|entry| self.keeps(entry, *q)) || self.except(*q));
        self.doubtful = doubtful;
        if right {
            self.edge_texels += edges;
        }
        right
    }

    /// Half-planes in which each of two cells' entries is right in the other cell, too, as far as a texel on their border
    /// reaches: the far parts of tips; nothing where it is not.
    fn meet_far(&mut self, i: usize, j: usize, p: [i64; 2], size: i64) -> Option<Vec<HalfPlane>> {
        let tips: Vec<_> = [i, j].into_iter().filter_map(|n| self.cells[n].tip).collect();
        // without tips it has been tried
        if tips.is_empty() {
            return None;
        }
        let square = Region::square(p, size);
        let (a, b) = (&self.cells[i], &self.cells[j]);
        let at = a.path.iter().zip(&b.path).position(|(x, y)| x != y)?;
        let cut = a.path[at].0;
        // beside a steeper face a tip's plane has room further away
        FARS.into_iter().find_map(|times| {
            let far = tips.iter().map(|t| self.far_side(&square, *t, times * self.far(*t, t.bend)));
            let far: Vec<HalfPlane> = far.collect::<Option<_>>()?;
            self.meets(i, j, cut, &far, p, size).then_some(far)
        })
    }

    /// Puts the texels that both cells may share on the list of those that are looked at one by one, but for those that lie
    /// in all `far` half-planes, and those inside which the segment `empty` has a part. None once there are more than `most`.
    #[expect(clippy::too_many_arguments, reason = "two cells, the square, and what is known of the texels")]
    fn shared(
        &mut self,
        i: usize,
        j: usize,
        p: [i64; 2],
        size: i64,
        far: Option<&[HalfPlane]>,
        empty: Option<[[f64; 2]; 2]>,
        most: usize,
    ) -> Option<()> {
        let (a, b) = (&self.cells[i], &self.cells[j]);
        let Some(at) = a.path.iter().zip(&b.path).position(|(x, y)| x != y) else { return Some(()) };
        let cut = a.path[at].0;
        let Cut { line, inside, .. } = self.cuts[cut];
        let mut lines = self.half_planes(&a.path);
        lines.extend(self.half_planes(&b.path));
        let (u, t) = if line.axis { (1, 0) } else { (0, 1) };
        let bits = self.scale.subtexel_bits;
        let texel = 1i64 << bits;
        let corner = self.rays.corner.map(|c| c >> bits);
        let (first, count) = (p.map(|v| v >> bits), size >> bits);
        let doubtful = &mut self.doubtful;
        let mut look = |n: i64| {
            let place = (corner[u] + n) * 256;
            let ends = [place, place + 256].map(|u| line.boundary(u) - (corner[t] << 20));
            let (low, high) = (ends[0].min(ends[1]) - 8, ends[0].max(ends[1]) + 8);
            for m in (low >> 20).max(first[t])..=(high >> 20).min(first[t] + count - 1) {
                let mut q = [0; 2];
                (q[u], q[t]) = (n * texel, m * texel);
                let out = |l: &HalfPlane| l.at(q) + (l.a.max(0) + l.b.max(0)) * texel <= 0;
                let inside = |l: &HalfPlane| l.at(q) + (l.a.min(0) + l.b.min(0)) * texel >= 0;
                if lines.iter().any(out) || far.is_some_and(|far| far.iter().all(inside)) {
                    continue;
                }
                let square = Region { p: q.map(|v| v + 1), size: texel - 2, lines: &[], shear: [0.0; 2] };
                if empty.is_none_or(|e| clip_segment(e, &square).is_none()) {
                    doubtful.push(q);
                }
            }
            (doubtful.len() <= most).then_some(())
        };
        let (mut from, mut to) = (first[u], first[u] + count);
        if count < MANY_COLUMNS {
            return (from..to).try_for_each(look);
        }
        let band = Band::new(&line, corner, first[u], bits);
        for l in &lines {
            (from, to) = band.may_reach(l, from, to);
        }
        // columns whose texels are not put on the list, but for those that the line hardly touches
        let mut left_out = (to, to);
        // three lattice steps: a part of the line that long lies in the texel where it runs through it at all
        let mut corners = 0.0;
        if let Some(far) = far {
            left_out = far.iter().fold((from, to), |(from, to), l| band.surely_in(l, from, to));
        } else if let Some(ends) = empty {
            let [low, high] = [ends[0][u].min(ends[1][u]), ends[0][u].max(ends[1][u])].map(|v| v / texel as f64);
            let off = line.off(&inside, self.rays.corner, p, size, self.scale);
            corners = (3.0 + off) / texel as f64 + ROUNDING;
            left_out = (from.max(low.ceil() as i64 + 2), to.min(high.floor() as i64 - 2));
        }
        if left_out.0 >= left_out.1 || corners > 0.1 {
            return (from..to).try_for_each(look);
        }
        (from..left_out.0).try_for_each(&mut look)?;
        if corners > 0.0 {
            band.near_corners(left_out.0, left_out.1, corners, &mut look)?;
        }
        (left_out.1..to).try_for_each(look)
    }

    /// Constant or plane that is stored for the texel at `q`; none where pages may tell its side of a line apart.
    fn stored(&self, palette: &Palette, mut id: EntryId, q: [i64; 2]) -> Option<Entry> {
        let texel = self.texel_at(q);
        while let Entry::Split { line, near, beyond } = palette.get(id) {
            let tells = palette.lines[line as usize].tells(texel.map(|v| i64::from(v) * 256 + 128))?;
            id = if tells { beyond } else { near };
        }
        Some(palette.get(id))
    }

    pub(super) fn texel_at(&self, q: [i64; 2]) -> [u32; 2] {
        [0, 1].map(|i| ((q[i] + self.rays.corner[i]) >> self.scale.subtexel_bits) as u32)
    }

    /// Whether a constant or plane lies in the exact interval of the texel at `q` of the square.
    pub(super) fn keeps(&mut self, entry: Entry, q: [i64; 2]) -> bool {
        allows(entry, self.interval(q), self.texel_at(q), 0, self.scale)
    }

    /// The exact interval, less the guard, of the texel at `q` of the square.
    pub(super) fn interval(&mut self, q: [i64; 2]) -> Interval {
        if let Some(known) = self.intervals.get(&q) {
            return *known;
        }
        let size = 1i64 << self.scale.subtexel_bits;
        self.near.clear();
        let over = |i: &&u32| self.rays.locals[**i as usize].cover(q[0], q[1], size) != Cover::None;
        self.near.extend(self.list.iter().filter(over));
        self.looked += 1;
        let truth = texel(&self.rays, &self.near, q, size, wide(self.guard), &mut self.scratch);
        let interval = truth.interval.guarded(self.guard);
        if self.intervals.len() >= MOST_INTERVALS {
            self.intervals.clear();
        }
        self.intervals.insert(q, interval);
        interval
    }

    /// What is known of the texels that both cells share.
    fn border(&mut self, i: usize, j: usize, p: [i64; 2], size: i64) -> Border {
        let (a, b) = (&self.cells[i], &self.cells[j]);
        let Some(at) = a.path.iter().zip(&b.path).position(|(x, y)| x != y) else { return Border::Unknown };
        let (cut, _) = a.path[at];
        let mut lines = Vec::new();
        for cell in [a, b] {
            let others: Vec<(usize, bool)> = cell.path.iter().copied().filter(|x| x.0 != cut).collect();
            lines.extend(self.half_planes(&others));
        }
        let region = Region { p, size, lines: &lines, shear: [0.0; 2] };
        let line = self.cuts[cut].inside;
        // Where a third cell lies between them, a texel may be wider than that one.
        let Some(around) = border(&line, &region, AROUND) else { return Border::Empty(None) };
        let ends_before = |tip: &Cell, other: &Cell| {
            let Some(t) = tip.tip else { return false };
            let e = &self.rays.locals[t.end as usize];
            let f = &self.rays.locals[t.front as usize];
            let apart = |q: &[f64; 2]| (e.z0 - f.z0) + (e.sx - f.sx) * q[0] + (e.sy - f.sy) * q[1];
            // further away the stretch may go on behind the end
            if around.iter().any(|q| apart(q) > t.far) {
                return false;
            }
            let ends = [e, &self.rays.locals[t.mate as usize]];
            other.list.iter().all(|n| {
                ends.iter().all(|e| {
                    let l = &self.rays.locals[*n as usize];
                    if l.event == Event::Wall || l.zmin > e.zmax {
                        return true;
                    }
                    let Some(part) = clip_to_surface(around, l) else { return true };
                    let slack = 2.0 * (l.eps + e.eps) + 0.01 + ((l.sx - e.sx).abs() + (l.sy - e.sy).abs()) * 0.01;
                    part.iter().all(|q| {
                        let d = (l.z0 - e.z0) + (l.sx - e.sx) * q[0] + (l.sy - e.sy) * q[1];
                        d >= slack
                    })
                })
            })
        };
        if ends_before(a, b) || ends_before(b, a) {
            return Border::Empty(border(&line, &region, -AROUND));
        }
        if self.meets(i, j, cut, &[], p, size) { Border::Right } else { Border::Unknown }
    }

    /// Whether each of two cells' entries is right in the other cell, too, as far as a texel on their border reaches, within
    /// some half-planes.
    fn meets(&mut self, i: usize, j: usize, cut: usize, within: &[HalfPlane], p: [i64; 2], size: i64) -> bool {
        let HalfPlane { a, b, c } = self.cuts[cut].inside;
        let far = (a.abs() + b.abs()) << self.scale.subtexel_bits;
        [(i, j), (j, i)].into_iter().all(|(own, other)| {
            let cell = &self.cells[own];
            let inside = cell.path.contains(&(cut, true));
            let strip = if inside { HalfPlane { a: -a, b: -b, c: far - c } } else { HalfPlane { a, b, c: c + far } };
            let mut lines = self.half_planes(&cell.path);
            lines.push(strip);
            lines.extend(within);
            let list: Vec<u32> = cell.list.iter().copied().filter(|n| self.reaches(*n, strip)).collect();
            let region = Region { p, size, lines: &lines, shear: [0.0; 2] };
            self.polygon.region(&region);
            if self.polygon.extent(0).is_none() {
                return true;
            }
            if let Some(tip) = self.cells[own].tip.filter(|_| within.is_empty()) {
                // nearer its own plane is right for whole texels inside, no parts of them
                let (f, e) = (self.local(tip.front), self.local(tip.end));
                let near = [f.sx - e.sx, f.sy - e.sy, tip.far - (e.z0 - f.z0)];
                self.polygon.keep_plane(near[0], near[1], near[2]);
                if self.polygon.extent(0).is_some() {
                    return false;
                }
            }
            let entry = self.cells[other].value;
            self.holds(entry, &list, region, false) || self.holds_across(entry, cut, &list, region)
        })
    }

    /// Whether an entry is right on the rays in a region beside a cut, for all texels whose centres lie on the cut's other
    /// side.
    ///
    /// Argument. An entering surface F covers the region, and nothing is left before the entry's values there. So on a ray at
    /// r the stretch begins at F at the latest and goes on behind a value v >= F(r). The way from a texel's centre c to r
    /// crosses the cut at a place m, and F as well as the entry's plane P are linear: F(r) - P(c) is
    /// (F(m) - P(m)) + F's rise from m to r + P's rise from c to m, at most F(m) - P(m) and the larger one of what F and P
    /// rise within half a texel. F(m) - P(m) is largest at an end of the part of the cut that texels of the region reach.
    fn holds_across(&mut self, entry: Entry, cut: usize, list: &[u32], region: Region<'_>) -> bool {
        if self.rays.second_surface {
            return false;
        }
        let (z, [gx, gy], reach) = match entry {
            Entry::Constant(v) if v != UNCOVERED => (f64::from(v), [0.0; 2], 0.0),
            Entry::Plane(plane) => {
                let (whole, part) = plane.at(self.rays.corner, self.scale);
                (whole as f64 + part, plane.gradient(self.scale), plane.reach(self.scale))
            }
            _ => return false,
        };
        // pages store less than two below the plane; and what is computed here rounds
        let margin = f64::from(self.guard) + 2.1 + (gx.abs() + gy.abs()) * 1e-6;
        self.polygon.region(&region);
        let (locals, polygon, spare) = (self.rays.locals, &self.polygon, &mut self.part);
        let mut left = list.iter().filter(|i| locals[**i as usize].event == Event::Leave);
        let behind = left.all(|i| {
            let l = (&locals[*i as usize], self.covers[*i as usize]);
            clearance(l, (z, gx, gy), polygon, spare) >= reach + margin
        });
        if !behind {
            return false;
        }
        let HalfPlane { a, b, c } = self.cuts[cut].inside;
        let [a, b, c] = [a, b, c].map(|v| v as f64);
        let (u, along, across) = if a.abs() > b.abs() { (1, b, a) } else { (0, a, b) };
        let Some((from, to)) = self.polygon.extent(u) else { return true };
        let texel = self.scale.half() * 2.0;
        let ends = [from - texel, to + texel].map(|at| {
            let mut m = [at; 2];
            m[1 - u] = -(c + along * at) / across;
            m
        });
        let value = ends.map(|m| z + gx * m[0] + gy * m[1]);
        if value.iter().any(|v| *v + reach + margin > DEEPEST as f64) {
            return false;
        }
        list.iter().any(|i| {
            let l = self.local(*i);
            let rise = (l.sx.abs() + l.sy.abs()) * self.scale.half();
            let margin = margin + rise.max(reach) + 2.0 * l.eps + (l.sx.abs() + l.sy.abs()) * 1e-6;
            let room = [0, 1].map(|k| value[k] - (l.z0 + l.sx * ends[k][0] + l.sy * ends[k][1]) - margin);
            let room = room[0].min(room[1]);
            l.event == Event::Enter && room >= 0.0 && {
                let covers = self.covers(list, &region, *i);
                covers.is_some_and(|(n, bend)| self.local(n).event == Event::Enter && bend <= room)
            }
        })
    }
}
