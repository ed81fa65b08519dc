//! The exact oracle: what a lossless shadow map of a snapped mesh may hold, from the mesh alone.
//!
//! It shares no code with the rasteriser that bakes, and rounds nowhere: floats only sort out cases that they decide
//! with their error bound to spare, everything else is done in whole numbers. All lengths are lattice steps.
//!
//! # Rays
//! The light travels along +z. A ray stands at lattice (x, y) and means the limit from `(+eps, +eps^2)`: of two
//! triangles that share an edge it meets exactly one. Depths on it are the depths of the triangles' planes at (x, y)
//! itself, as exact rationals.
//!
//! A triangle of a closed solid is an *entry* where its outward normal points against the light and an *exit* where it
//! points along it. A triangle of a sheet is both, whatever its orientation: an entry at z and an exit at z + thickness.
//! A triangle without projected area counts nowhere. A counter per solid takes entries minus exits; the ray is *inside*
//! while any counter is positive, so overlapping solids unite, and a cavity, which bears the number of the solid around
//! it, subtracts.
//!
//! `lo` is the depth of the first event of any kind. `hi` is the first depth from there on at which, after all events at
//! that depth, the ray is not inside: `hi = lo` for what has no thickness, and solids that touch are one. Under the
//! policy second-surface, `hi` is the depth of the second event, where sheets count once. A stretch that never ends has
//! `hi` = infinity.
//!
//! A ray's interval is `E = ceil(lo)` to `X = ceil(hi) - 1`; with `X < E` it is *thin* and `X := E`. No value of a
//! covered ray exceeds 2^32 - 2. A ray without events has the interval `[2^32 - 1, 2^32 - 1]`: lit at any depth.
//!
//! # Texels
//! Inside the open square of a texel, the edges of triangles and the lines where two planes cross bound cells in which
//! the order of events is constant. `LO` is the supremum of lo and `HI` the infimum of hi over the cells, limits at
//! their rims included. A texel that is covered all over and has `ceil(LO) <= ceil(HI) - 1` is *certified*, and these
//! two are its interval: any value between them answers right for every receiver in the texel that is not inside a
//! solid. So is a texel with no covered area. Every other texel is an *edge* texel, and the interval of the ray through
//! its centre holds.
//!
//! # Reading map
//! `facet` is one triangle; `ray` follows one ray; `plot` cuts a texel into convex pieces and `area` finds the
//! area interval with it; `grid` finds triangles; `sweep` passes over many texels, and settles most of them without
//! an exact look; `sample` says where to look when it can't be everywhere. `stop` is about the answers without a page, `place` about those between texel centres. `layers` is about maps that come from depth
//! layers instead: centres only.

mod area;
#[cfg(test)]
mod cases;
mod depth;
mod facet;
mod grid;
pub mod layers;
pub mod place;
mod plot;
mod ray;
pub mod sample;
pub mod stop;
mod sweep;
#[cfg(test)]
mod testing;
#[cfg(test)]
mod tests;

pub use depth::Depth;
pub use sweep::{Region, Tally};

use facet::{Facet, Role};
use grid::Grid;
use umbrage_format::projection::UNCOVERED;
use umbrage_writer::solid::SnappedMesh;

/// Lattice depths `min ..= max`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Interval {
    /// Smallest value that is right.
    pub min: u32,
    /// Largest value that is right.
    pub max: u32,
}

impl Interval {
    /// Whether the value is one of the interval's, and no closer than `guard` to its ends where the interval is at least
    /// four times that wide.
    pub fn guards(&self, value: u32, guard: u32) -> bool {
        let (v, g) = (u64::from(value), u64::from(guard));
        let (min, max) = (u64::from(self.min), u64::from(self.max));
        self.contains(value) && (max - min < 4 * g || self.min == UNCOVERED || (min + g <= v && v + g <= max))
    }

    /// Whether the value is one of the interval's.
    pub fn contains(&self, value: u32) -> bool {
        (self.min..=self.max).contains(&value)
    }
}

/// What a texel may hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TexelTruth {
    /// The area interval of a certified texel, the centre ray's interval of an edge texel.
    pub interval: Interval,
    /// Whether a value in the interval is right for the texel's whole area.
    pub certified: bool,
    /// Whether the centre ray leaves before it reaches a lattice depth; certified texels never are.
    pub thin: bool,
}

/// Answers questions about one snapped mesh.
pub struct Oracle<'a> {
    mesh: &'a SnappedMesh,
    grid: Grid,
    /// Distance that stored values must keep from the ends of wide intervals.
    guard: u32,
    /// Per solid: whether its triangles bound a volume, so that counters cannot change without a surface in between.
    tight: Vec<bool>,
}

impl<'a> Oracle<'a> {
    /// Indexes the mesh.
    pub fn new(mesh: &'a SnappedMesh) -> Self {
        Self { mesh, grid: Grid::new(mesh), guard: 0, tight: sweep::tight_solids(mesh) }
    }

    /// Asks stored values to keep this distance from the ends of wide intervals ([`Interval::guards`]).
    pub fn with_guard(self, guard: u32) -> Self {
        Self { guard, ..self }
    }

    /// The truth about texel (x, y).
    pub fn texel(&self, x: u32, y: u32) -> TexelTruth {
        let (o, side) = (self.origin(x, y), 1 << self.mesh.lattice.subtexel_bits);
        let facets: Vec<Facet> = self.facets_near(o).filter(|f| f.overlaps(o, side)).collect();
        self.texel_of(&facets, o)
    }

    /// Whether `stored` lies in the interval of texel (x, y), and whether that texel is certified.
    pub fn accepts(&self, x: u32, y: u32, stored: u32) -> (bool, bool) {
        let tally = self.check(Region { x, y, width: 1, height: 1 }, |_, _| stored);
        (tally.wrong == 0, tally.certified == 1)
    }

    /// The interval of the ray through a lattice point, and whether it is thin.
    pub fn ray(&self, p: [i64; 2]) -> (Interval, bool) {
        let facets: Vec<Facet> = self.facets_near(p).collect();
        ray::interval(ray::stretch(facets.iter(), p, self.mesh.second_surface).as_ref())
    }

    /// Whether a receiver at depth `d` over lattice point `p` is lit: no triangle whose closed projection holds `p`
    /// lies before it.
    pub fn lit(&self, p: [i64; 2], d: &Depth) -> bool {
        self.facets_near(p).filter(|f| f.touches(p)).all(|f| *d <= f.depth(p))
    }

    /// Depth of a triangle's plane at a lattice point of its closed projection; `None` elsewhere, and for triangles
    /// without projected area.
    pub fn surface_depth(&self, triangle: usize, p: [i64; 2]) -> Option<Depth> {
        let f = Facet::new(self.mesh, triangle);
        f.touches(p).then(|| f.depth(p))
    }

    /// Whether a receiver at depth `d` over lattice point `p` has a whole neighbourhood inside the solids, faces where
    /// they touch included.
    pub fn strictly_inside(&self, p: [i64; 2], d: &Depth) -> bool {
        let facets: Vec<Facet> = self.facets_near(p).filter(|f| f.touches(p)).collect();
        ray::surrounded(&facets, p, d)
    }

    /// The truth about the texel at `o`, from the facets that share area with it.
    fn texel_of(&self, facets: &[Facet], o: [i64; 2]) -> TexelTruth {
        let side = 1 << self.mesh.lattice.subtexel_bits;
        if let Some(interval) = area::area_interval(facets, o, side, self.mesh.second_surface) {
            return TexelTruth { interval, certified: true, thin: false };
        }
        // The ray is a limit from inside the square, so it meets no other facets.
        let centre = o.map(|v| v + side / 2);
        let stretch = ray::stretch(facets.iter(), centre, self.mesh.second_surface);
        let (interval, thin) = ray::interval(stretch.as_ref());
        TexelTruth { interval, certified: false, thin }
    }

    fn origin(&self, x: u32, y: u32) -> [i64; 2] {
        [x, y].map(|v| i64::from(v) << self.mesh.lattice.subtexel_bits)
    }

    /// All facets that share a point with the grid cell of `p`, walls left out.
    fn facets_near(&self, p: [i64; 2]) -> impl Iterator<Item = Facet> {
        let cell = self.grid.cell_of(p);
        let facets = self.grid.triangles(cell).iter().map(|&t| Facet::new(self.mesh, t as usize));
        facets.filter(|f| f.role != Role::Wall)
    }
}
