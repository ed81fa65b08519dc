//! Many texels at once.
//!
//! A block of texels is settled as a whole if all triangles over it lie clearly on this or that side of the depths
//! stored there, and one of two arguments shows that every ray is inside its stretch in between. Blocks that resist are
//! quartered; texels that resist get the exact answer.

use super::facet::{Facet, Role};
use super::plot::ROUNDING;
use super::ray::DEEPEST;
use super::{Oracle, TexelTruth};
use rayon::prelude::*;
use umbrage_format::projection::UNCOVERED;
use umbrage_writer::solid::{SnappedMesh, SolidKind};

/// A rectangle of texels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Region {
    /// Lowest column.
    pub x: u32,
    /// Lowest row.
    pub y: u32,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
}

/// How many texels of a region are what.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    /// Texels looked at.
    pub texels: u64,
    /// Texels whose stored value lies outside their interval.
    pub wrong: u64,
    /// Texels with an area interval; all others are edge texels.
    pub certified: u64,
    /// Edge texels whose centre ray is thin.
    pub thin: u64,
    /// Texels that took the exact method.
    pub exact: u64,
    /// Some of the wrong texels, in no particular order: at most [`Tally::EXAMPLES`].
    pub examples: Vec<[u32; 2]>,
}

impl Tally {
    /// The most examples kept.
    pub const EXAMPLES: usize = 16;

    /// Texels without an area interval.
    pub fn edge(&self) -> u64 {
        self.texels - self.certified
    }

    /// The counts of both.
    pub fn merge(mut self, other: Self) -> Self {
        self.texels += other.texels;
        self.wrong += other.wrong;
        self.certified += other.certified;
        self.thin += other.thin;
        self.exact += other.exact;
        self.examples.extend(other.examples);
        self.examples.truncate(Self::EXAMPLES);
        self
    }

    fn fault(&mut self, x: u32, y: u32) {
        self.wrong += 1;
        if self.examples.len() < Self::EXAMPLES {
            self.examples.push([x, y]);
        }
    }

    fn record(&mut self, x: u32, y: u32, stored: u32, guard: u32, truth: &TexelTruth) {
        self.exact += 1;
        self.texels += 1;
        self.certified += u64::from(truth.certified);
        self.thin += u64::from(truth.thin);
        if !truth.interval.guards(stored, guard) {
            self.fault(x, y);
        }
    }
}

/// Which closed solids are bounded by their triangles: each directed edge has its reverse as often as itself.
pub(super) fn tight_solids(mesh: &SnappedMesh) -> Vec<bool> {
    let mut edges: Vec<(u32, u32, u32, bool)> = Vec::with_capacity(3 * mesh.triangles.len());
    for (t, &solid) in mesh.triangles.iter().zip(&mesh.solid) {
        for k in 0..3 {
            let (a, b) = (t[k], t[(k + 1) % 3]);
            edges.push((solid, a.min(b), a.max(b), a < b));
        }
    }
    edges.par_sort_unstable();
    let mut tight: Vec<bool> = mesh.solids.iter().map(|s| matches!(s, SolidKind::Closed)).collect();
    for same in edges.chunk_by(|a, b| (a.0, a.1, a.2) == (b.0, b.1, b.2)) {
        if same[0].1 != same[0].2 && same.iter().filter(|e| e.3).count() * 2 != same.len() {
            tight[same[0].0 as usize] = false;
        }
    }
    tight
}

/// A facet in floats, x and y counted from the tile's lowest corner.
struct Rough {
    facet: Facet,
    tight: bool,
    low: [f64; 2],
    high: [f64; 2],
    edges: [[f64; 3]; 3],
    /// Error bound of an edge function anywhere in the tile.
    edge_err: f64,
    /// Depth and its slopes: a x + b y + c, off by `plane_err` at most.
    plane: [f64; 3],
    plane_err: f64,
    /// Depths of the corners: extremes of the facet.
    depths: [f64; 2],
}

impl Rough {
    fn new(facet: Facet, tight: bool, o: [i64; 2], tile: f64) -> Self {
        let p = facet.corners;
        let fold = |axis: usize, f: fn(i64, i64) -> i64| f(f(p[0][axis], p[1][axis]), p[2][axis]);
        let edges = [0, 1, 2].map(|k| facet.edge(k, o).map(|v| v as f64));
        let reach = |[a, b, c]: [f64; 3]| ROUNDING * ((a.abs() + b.abs()) * tile + c.abs());
        let plane = facet.plane(o).map(|v| v as f64 / facet.area as f64);
        Self {
            tight,
            low: [0, 1].map(|a| (fold(a, i64::min) - o[a]) as f64),
            high: [0, 1].map(|a| (fold(a, i64::max) - o[a]) as f64),
            edge_err: edges.map(reach).into_iter().fold(0.0, f64::max),
            edges,
            plane_err: reach(plane),
            plane,
            depths: [fold(2, i64::min) as f64, fold(2, i64::max) as f64],
            facet,
        }
    }

    /// Whether the facet may share area with the box, and whether it surely covers it.
    fn over(&self, low: [f64; 2], high: [f64; 2]) -> (bool, bool) {
        if (0..2).any(|k| self.high[k] <= low[k] || self.low[k] >= high[k]) && self.facet.role != Role::Wall {
            return (false, false);
        }
        if (0..2).any(|k| self.high[k] < low[k] || self.low[k] > high[k]) {
            return (false, false);
        }
        let mut full = self.facet.role != Role::Wall;
        for [a, b, c] in self.edges {
            let [x0, x1] = if a > 0.0 { [low[0], high[0]] } else { [high[0], low[0]] };
            let [y0, y1] = if b > 0.0 { [low[1], high[1]] } else { [high[1], low[1]] };
            if a * x1 + b * y1 + c < -self.edge_err {
                return (false, false);
            }
            full &= a * x0 + b * y0 + c > self.edge_err;
        }
        (true, full)
    }

    /// Bounds of the facet's depth over the box.
    fn depths(&self, low: [f64; 2], high: [f64; 2]) -> [f64; 2] {
        if self.facet.role == Role::Wall {
            return self.depths;
        }
        let [a, b, c] = self.plane;
        let [x0, x1] = if a > 0.0 { [low[0], high[0]] } else { [high[0], low[0]] };
        let [y0, y1] = if b > 0.0 { [low[1], high[1]] } else { [high[1], low[1]] };
        let nearest = a * x0 + b * y0 + c - self.plane_err;
        let farthest = a * x1 + b * y1 + c + self.plane_err;
        [nearest.max(self.depths[0]), farthest.min(self.depths[1])]
    }
}

/// One cell of the grid, with what is over it.
struct Tile<'a> {
    oracle: &'a Oracle<'a>,
    /// Lowest texel.
    first: [u32; 2],
    size: [u32; 2],
    stored: Vec<u32>,
    rough: Vec<Rough>,
    tally: Tally,
}

impl Oracle<'_> {
    /// Compares a region with the values stored for it; `stored(x, y)` is called once per texel, from many threads.
    pub fn check(&self, region: Region, stored: impl Fn(u32, u32) -> u32 + Sync) -> Tally {
        let resolution = self.mesh.lattice.resolution();
        let step = resolution / self.grid.cells();
        let cells = |first: u32, count: u32| first / step..(first + count).div_ceil(step);
        let columns = cells(region.x, region.width);
        cells(region.y, region.height)
            .into_par_iter()
            .map(|row| {
                columns.clone().fold(Tally::default(), |tally, column| {
                    let x = (column * step).max(region.x)..((column + 1) * step).min(region.x + region.width);
                    let y = (row * step).max(region.y)..((row + 1) * step).min(region.y + region.height);
                    let cell = (row * self.grid.cells() + column) as usize;
                    tally.merge(self.check_tile(cell, x, y, &stored))
                })
            })
            .reduce(Tally::default, Tally::merge)
    }

    fn check_tile(
        &self,
        cell: usize,
        x: std::ops::Range<u32>,
        y: std::ops::Range<u32>,
        stored: &(impl Fn(u32, u32) -> u32 + Sync),
    ) -> Tally {
        let first = [x.start, y.start];
        let size = [x.len() as u32, y.len() as u32];
        let o = self.origin(x.start, y.start);
        let across = (i64::from(size[0].max(size[1])) << self.mesh.lattice.subtexel_bits) as f64;
        let mut rough = Vec::new();
        for &t in self.grid.triangles(cell) {
            let facet = Facet::new(self.mesh, t as usize);
            let tight = self.tight[facet.solid as usize];
            rough.push(Rough::new(facet, tight, o, across));
        }
        let stored = y.flat_map(|y| x.clone().map(move |x| stored(x, y))).collect();
        let mut list: Vec<(u32, bool)> = (0..rough.len() as u32).map(|i| (i, false)).collect();
        let mut tile = Tile { oracle: self, first, size, stored, rough, tally: Tally::default() };
        tile.check([0, 0], size, &mut list, 0);
        tile.tally
    }
}

/// What floats can tell about a block.
enum Verdict {
    /// Every value is in the area interval of its texel.
    Right,
    Uncovered,
    Open,
}

impl Tile<'_> {
    /// Checks the block of `size` texels at `at`; `list[from..]` holds what may lie over it, and whether it surely
    /// covers it all. The list is left as it was.
    fn check(&mut self, at: [u32; 2], size: [u32; 2], list: &mut Vec<(u32, bool)>, from: usize) {
        if size[0] == 0 || size[1] == 0 {
            return;
        }
        let bits = self.oracle.mesh.lattice.subtexel_bits;
        let low = at.map(|v| (u64::from(v) << bits) as f64);
        let high = [0, 1].map(|k| (u64::from(at[k] + size[k]) << bits) as f64);
        let mine = list.len();
        for i in from..mine {
            let (facet, full) = list[i];
            let (over, covers) = if full { (true, true) } else { self.rough[facet as usize].over(low, high) };
            if over {
                list.push((facet, covers));
            }
        }
        match self.verdict(at, size, &list[mine..]) {
            Verdict::Right => {
                let texels = u64::from(size[0]) * u64::from(size[1]);
                self.tally.texels += texels;
                self.tally.certified += texels;
            }
            Verdict::Uncovered => {
                for (x, y, stored) in self.texels(at, size).collect::<Vec<_>>() {
                    self.tally.texels += 1;
                    self.tally.certified += 1;
                    if stored != UNCOVERED {
                        self.tally.fault(x, y);
                    }
                }
            }
            Verdict::Open if size == [1, 1] => {
                let [x, y] = [self.first[0] + at[0], self.first[1] + at[1]];
                let o = self.oracle.origin(x, y);
                let facets = list[mine..].iter().map(|&(i, _)| &self.rough[i as usize].facet);
                let facets: Vec<Facet> = facets.filter(|f| f.overlaps(o, 1 << bits)).cloned().collect();
                let truth = self.oracle.texel_of(&facets, o);
                let stored = self.stored[(at[1] * self.size[0] + at[0]) as usize];
                self.tally.record(x, y, stored, self.oracle.guard, &truth);
            }
            Verdict::Open => {
                let half = size.map(|s| s / 2);
                let parts = |k: usize| [(at[k], half[k]), (at[k] + half[k], size[k] - half[k])];
                for (y, h) in parts(1) {
                    for (x, w) in parts(0) {
                        self.check([x, y], [w, h], list, mine);
                    }
                }
            }
        }
        list.truncate(mine);
    }

    /// The block's texels, with what is stored.
    fn texels(&self, at: [u32; 2], size: [u32; 2]) -> impl Iterator<Item = (u32, u32, u32)> {
        (at[1]..at[1] + size[1]).flat_map(move |y| {
            let row = (y * self.size[0]) as usize;
            (at[0]..at[0] + size[0]).map(move |x| (self.first[0] + x, self.first[1] + y, self.stored[row + x as usize]))
        })
    }

    fn verdict(&self, at: [u32; 2], size: [u32; 2], list: &[(u32, bool)]) -> Verdict {
        let facets = || list.iter().map(|&(i, _)| &self.rough[i as usize]);
        if facets().all(|f| f.facet.role == Role::Wall) {
            return Verdict::Uncovered;
        }
        // A block of many facets rarely passes: save the look at its values.
        if list.len() > 64 && size != [1, 1] {
            return Verdict::Open;
        }
        let (mut least, mut most) = (u32::MAX, 0);
        for (_, _, stored) in self.texels(at, size) {
            least = least.min(stored);
            most = most.max(stored);
        }
        // what is closer than the guard must be right too; where that isn't so, the exact look decides
        let guard = self.oracle.guard;
        let (least, most) = (least.saturating_sub(guard), most.saturating_add(guard));
        if most > DEEPEST {
            return Verdict::Open;
        }
        let [least, most] = [least, most].map(f64::from);
        let bits = self.oracle.mesh.lattice.subtexel_bits;
        let low = at.map(|v| (u64::from(v) << bits) as f64);
        let high = [0, 1].map(|k| (u64::from(at[k] + size[k]) << bits) as f64);
        let second = self.oracle.mesh.second_surface;

        // Up to the stored depths there may be entries only, and behind them nothing that ends before them.
        let (mut near, mut near_full, mut near_tight) = (0, false, true);
        for (f, &(_, full)) in facets().zip(list) {
            let [nearest, farthest] = f.depths(low, high);
            if nearest > most {
                continue;
            }
            if farthest > least {
                return Verdict::Open;
            }
            match f.facet.role {
                Role::Wall => continue,
                Role::Exit => return Verdict::Open,
                Role::Sheet(t) if !second && nearest + f64::from(t) <= most => return Verdict::Open,
                Role::Sheet(_) | Role::Entry => {}
            }
            near += 1;
            near_full |= full;
            near_tight &= f.tight;
        }
        // One entry covers the block: every ray is inside from there on.
        if near_full && (!second || near == 1) {
            return Verdict::Right;
        }
        // The block, as a flat patch at the stored depths, meets no surface of a tight solid, walls included: the
        // counter of such a solid is the same on the whole patch, and one ray tells it.
        if near == 0 || (second && !near_tight) {
            return Verdict::Open;
        }
        let o = self.oracle.origin(self.first[0] + at[0], self.first[1] + at[1]);
        let centre = [0, 1].map(|k| o[k] + (i64::from(size[k]) << bits) / 2);
        let entries = facets().filter(|f| match f.facet.role {
            Role::Entry | Role::Exit => f.tight && f.depths(low, high)[1] <= least && f.facet.meets(centre),
            _ => false,
        });
        match entries.count() {
            0 => Verdict::Open,
            1 => Verdict::Right,
            _ if !second => Verdict::Right,
            _ => Verdict::Open,
        }
    }
}
