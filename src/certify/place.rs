//! Holds continuous lookups against the truth: values between texel centres (spec/vector.md, Continuous lookups).
//!
//! What is accepted at a place p: a value in the interval of the ray through p; else one with `lo <= value + slack` and
//! `value - slack < hi` on rays of the open square of 2^-12 texel around p in x and in y, or that of uncovered rays where the
//! square has some. The slack is the guard and [`SLACK`] steps of depth. That is decided exactly: the square is cut into
//! pieces like a texel, on a lattice that is finer where 2^-12 texel is no whole number of steps.

use umbrage_reader::query::{PageView, vector};

use super::facet::Facet;
use super::sample::Spot;
use super::{Oracle, area};

/// Steps of depth that a value may lie beyond a ray's interval, besides the guard.
pub const SLACK: u32 = 8;

/// A value that is wrong where it is proven.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SpotFault {
    /// The place.
    pub spot: Spot,
    /// What the lookup answers.
    pub answer: u32,
}

/// What was found.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SpotTally {
    /// Places looked up.
    pub places: u64,
    /// Those with a proven entry, each held against the scene.
    pub proven: u64,
    /// Places spread over the whole map, and those among them with a proven entry.
    pub spread: [u64; 2],
    /// Proven places with a wrong value.
    pub wrong: u64,
    /// Some of them: at most [`Tally::EXAMPLES`](super::Tally::EXAMPLES).
    pub examples: Vec<SpotFault>,
}

impl SpotTally {
    /// The counts of both.
    pub fn merge(mut self, other: Self) -> Self {
        self.places += other.places;
        self.proven += other.proven;
        self.wrong += other.wrong;
        self.spread = [0, 1].map(|i| self.spread[i] + other.spread[i]);
        self.examples.extend(other.examples);
        self.examples.truncate(super::Tally::EXAMPLES);
        self
    }

    /// The share of the map's area that is proven, as the spread places tell.
    pub fn share(&self) -> f64 {
        self.spread[1] as f64 / self.spread[0].max(1) as f64
    }
}

/// Looks up root 0 of a map of kind `vector` at one place and holds the answer against the scene where it is proven.
/// `page` tells the pages.
pub fn check<'a>(
    oracle: &Oracle,
    page: impl Fn(u32) -> Option<PageView<'a>>,
    log2_resolution: u8,
    spot: Spot,
) -> SpotTally {
    let [x, y] = spot.texel();
    let mut tally = SpotTally { places: 1, ..Default::default() };
    tally.spread[0] = spot.spread.into();
    let d = vector::continuous(&page, 0, log2_resolution, x, y, spot.sub());
    if page(d.page).is_some_and(|page| vector::is_proven(page, d.word)) {
        tally.proven = 1;
        tally.spread[1] = spot.spread.into();
        if !oracle.accepts_at(spot.at, d.value) {
            tally.wrong = 1;
            tally.examples.push(SpotFault { spot, answer: d.value });
        }
    }
    tally
}

impl Oracle<'_> {
    /// Whether a value is right at a place, in 1/256 texel from the map's corner: on the ray there, or on others within
    /// 2^-12 texel.
    pub fn accepts_at(&self, place: [u64; 2], value: u32) -> bool {
        let bits = u32::from(self.mesh.lattice.subtexel_bits);
        let p = place.map(|v| (v as i64) << (bits - 8));
        if self.ray(p).0.contains(value) {
            return true;
        }
        let finer = 12u32.saturating_sub(bits);
        let reach = 1i64 << (bits + finer - 12);
        // whole steps around the square, for the grid
        let wide = (reach >> finer).max(1);
        let corner = |x: i64, y: i64| self.grid.cell_of([p[0] + x, p[1] + y]);
        let mut cells = [corner(-wide, -wide), corner(wide, -wide), corner(-wide, wide), corner(wide, wide)];
        cells.sort_unstable();
        let mut near: Vec<u32> = Vec::new();
        for (i, cell) in cells.iter().enumerate() {
            if i == 0 || cells[i - 1] != *cell {
                near.extend(self.grid.triangles(*cell));
            }
        }
        near.sort_unstable();
        near.dedup();
        let o = p.map(|v| (v << finer) - reach);
        let facets = near.iter().map(|t| Facet::new(self.mesh, *t as usize).finer(finer));
        let facets: Vec<Facet> = facets.filter(|f| f.overlaps(o, 2 * reach)).collect();
        let slack = self.guard.saturating_add(SLACK);
        area::right_somewhere(&facets, o, 2 * reach, self.mesh.second_surface, value, slack)
    }
}
