//! Depth layers instead of geometry: an engine that renders first and second depth itself, or OpenEXR files of them.
//!
//! In: a [`DepthSource`]. Out: a container, by [`bake_layers`]. [`projection`] says how points of the world lie in the
//! layers and fixes the lattice; [`LatticeLayers`] turns two depths of a texel into its interval; [`openexr`] is the
//! source that reads files; [`crate::hierarchy::layers`] builds the tree.
//!
//! A source is asked at texel centres and nowhere else, so what is promised is about the rays through the centres:
//! a receiver on such a ray that is not inside the solid (under [`Second::NextSurface`]: that lies on a surface of the
//! scene) gets the right answer without bias. Between centres nothing is known; every texel counts as an edge texel.

pub mod bake;
pub mod openexr;
pub mod projection;

use umbrage_format::projection::Lattice;
use umbrage_format::structure::{
    CENTRES, LAYERS_CLOSED, LAYERS_ONE_SIDED, LAYERS_SECOND_SURFACE, STATIC_CENTRES, StructureRecord,
};

use crate::bake::BakeError;
use crate::interval::{DEEPEST, Interval};

pub use bake::{BakedLayers, LayersOptions, bake_layers};
pub use projection::{DepthScale, Projection};

/// Whatever an engine calls an error.
pub type SourceError = Box<dyn std::error::Error + Send + Sync>;

/// A square of texels, aligned to its side.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Square {
    /// First texel: column and row.
    pub origin: [u32; 2],
    /// It has `1 << log2_side` texels on a side, at most 256 and at most the whole map.
    pub log2_side: u8,
}

impl Square {
    /// Texels in it.
    pub fn texels(self) -> usize {
        1 << (2 * self.log2_side)
    }

    /// Column and row in the map of the texel of this index in the buffers.
    pub fn texel(self, index: usize) -> [u32; 2] {
        let side = 1 << self.log2_side;
        [self.origin[0] + (index % side) as u32, self.origin[1] + (index / side) as u32]
    }
}

/// What the second depth of a source is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Second {
    /// Where the light leaves the solid that it entered at the first depth; infinite where it never does.
    Exit,
    /// The next surface of any kind (depth peeling); infinite where there is none. Right for receivers on surfaces of
    /// the scene only.
    NextSurface,
    /// There is none; the second buffer is not looked at. The stored value is the first depth.
    Absent,
}

impl Second {
    /// Policy and guarantee of the structure record.
    pub fn codes(self) -> (u32, u32) {
        match self {
            Second::Exit => (LAYERS_CLOSED, CENTRES),
            Second::NextSurface => (LAYERS_SECOND_SURFACE, STATIC_CENTRES),
            Second::Absent => (LAYERS_ONE_SIDED, CENTRES),
        }
    }

    /// What a structure was baked with; none where it does not come from layers.
    pub fn of(record: &StructureRecord) -> Option<Second> {
        [Second::Exit, Second::NextSurface, Second::Absent].into_iter().find(|s| s.codes().0 == record.policy.get())
    }
}

/// Something that renders the depth of a scene as one light sees it.
///
/// Depths grow along the light, in units of the source's own; positive infinity means that there is nothing. Both
/// buffers are row-major: the texel in column `i` and row `j` of the square stands at `j * side + i`.
pub trait DepthSource: Sync {
    /// Name of the light: 1 to 64 bytes without zero bytes, unique in the file.
    fn name(&self) -> &str;

    /// How points of the world lie in the layers, and how many texels there are.
    fn projection(&self) -> Projection;

    /// What the second depths are.
    fn second(&self) -> Second;

    /// Bytes that name the content: equal keys must mean equal depths. With name, projection, options, format and
    /// generator version they make the file id.
    fn key(&self) -> Vec<u8>;

    /// Renders one square at texel centres. Both buffers hold [`Square::texels`] values and positive infinity.
    ///
    /// Called from several threads at once, in any order, and twice for each square under [`DepthScale::Found`]; the
    /// same square must give the same depths. A source that can't do that takes a lock inside.
    ///
    /// # Errors
    /// The source's own; the bake ends with it and leaves nothing behind.
    fn render(&self, square: Square, first: &mut [f64], second: &mut [f64]) -> Result<(), SourceError>;

    /// Bytes that the source holds, counted against the memory budget.
    fn bytes(&self) -> u64 {
        0
    }
}

/// Why layers can't be baked.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LayersError {
    /// As for geometry: names, memory, target, cancelled.
    #[error(transparent)]
    Bake(#[from] BakeError),
    /// A file of layers.
    #[error(transparent)]
    File(#[from] openexr::ExrError),
    /// The projection of a source.
    #[error("light '{name}': {what}")]
    Projection {
        /// Name of the light.
        name: String,
        /// What is wrong with it, and what to do.
        what: String,
    },
    /// The source gave up.
    #[error("light '{name}': {square:?}: {source}")]
    Source {
        /// Name of the light.
        name: String,
        /// The square that was asked for.
        square: Square,
        /// What the source says.
        source: SourceError,
    },
    /// A depth that can't be.
    #[error("light '{name}': texel ({}, {}): first depth {first}, second depth {second}: {what}", texel[0], texel[1])]
    Depth {
        /// Name of the light.
        name: String,
        /// Column and row.
        texel: [u32; 2],
        /// First depth.
        first: f64,
        /// Second depth.
        second: f64,
        /// What was expected.
        what: &'static str,
    },
    /// Cancelled, or over the budget: the caller knows which.
    #[error("stopped")]
    Stopped,
}

/// Buffers of one tile, for use over and over.
#[derive(Default)]
pub struct TileBuffer {
    first: Vec<f64>,
    second: Vec<f64>,
    intervals: Vec<Interval>,
}

impl TileBuffer {
    /// Bytes of a tile of 256 x 256.
    pub const BYTES: u64 = 65536 * (8 + 8 + size_of::<Interval>() as u64);
}

/// A source whose depths are on a lattice.
pub struct LatticeLayers<'a> {
    source: &'a dyn DepthSource,
    second: Second,
    lattice: Lattice,
    scale: f64,
    offset: f64,
}

impl<'a> LatticeLayers<'a> {
    /// Fixes the lattice; under [`DepthScale::Found`] every square is rendered once for it, and `keep_on` is asked
    /// before each.
    ///
    /// # Errors
    /// The projection, the source, its depths, or stopped.
    pub fn new(source: &'a dyn DepthSource, keep_on: &(dyn Fn() -> bool + Sync)) -> Result<Self, LayersError> {
        let projection = source.projection();
        let fault = |what| LayersError::Projection { name: source.name().to_string(), what };
        projection.check().map_err(fault)?;
        let mut layers =
            LatticeLayers { source, second: source.second(), lattice: projection.frame(), scale: 1.0, offset: 0.0 };
        let (scale, offset) = match projection.depth {
            DepthScale::LatticeSteps => (1.0, 0.0),
            DepthScale::Between(near, far) => projection::scale(near, far).map_err(fault)?,
            DepthScale::Found => {
                let [near, far] = layers.range(keep_on)?;
                projection::scale(near, far).map_err(fault)?
            }
        };
        (layers.scale, layers.offset) = (scale, offset);
        layers.lattice = projection.lattice(scale, offset);
        Ok(layers)
    }

    /// The map's lattice.
    pub fn lattice(&self) -> Lattice {
        self.lattice
    }

    /// What the second depths are.
    pub fn second(&self) -> Second {
        self.second
    }

    /// A depth of the source in lattice units: one product and one sum. This real number is what all promises are
    /// about.
    pub fn depth(&self, depth: f64) -> f64 {
        self.scale * depth + self.offset
    }

    /// Renders a square and checks every texel of it; `see` gets first and second depth, the latter infinite where
    /// there is no second layer.
    ///
    /// # Errors
    /// The source, or a depth that can't be.
    pub fn each(
        &self,
        square: Square,
        buffer: &mut TileBuffer,
        mut see: impl FnMut(usize, f64, f64),
    ) -> Result<(), LayersError> {
        let texels = square.texels();
        for b in [&mut buffer.first, &mut buffer.second] {
            b.clear();
            b.resize(texels, f64::INFINITY);
        }
        self.source.render(square, &mut buffer.first, &mut buffer.second).map_err(|source| LayersError::Source {
            name: self.source.name().to_string(),
            square,
            source,
        })?;
        for (i, (&first, &second)) in buffer.first.iter().zip(&buffer.second).enumerate() {
            let second = if self.second == Second::Absent { f64::INFINITY } else { second };
            if let Err(what) = possible(first, second) {
                return Err(self.impossible(square.texel(i), first, second, what));
            }
            see(i, first, second);
        }
        Ok(())
    }

    fn impossible(&self, texel: [u32; 2], first: f64, second: f64, what: &'static str) -> LayersError {
        LayersError::Depth { name: self.source.name().to_string(), texel, first, second, what }
    }

    /// The interval of each texel, row by row, and how many are thin.
    ///
    /// # Errors
    /// The source, or a depth that can't be.
    pub fn intervals<'b>(
        &self,
        square: Square,
        buffer: &'b mut TileBuffer,
    ) -> Result<(&'b [Interval], u64), LayersError> {
        let mut intervals = std::mem::take(&mut buffer.intervals);
        intervals.clear();
        intervals.resize(square.texels(), Interval::UNCOVERED);
        let (mut thin_texels, mut outside) = (0, None);
        self.each(square, buffer, |i, first, second| {
            if first == f64::INFINITY {
                return;
            }
            let exit = match self.second {
                Second::Absent => Some(first),
                _ => (second < f64::INFINITY).then_some(second),
            };
            match interval(self.depth(first), exit.map(|d| self.depth(d))) {
                Some((interval, thin)) => {
                    intervals[i] = interval;
                    thin_texels += u64::from(thin);
                }
                None => outside = outside.or(Some((i, first, second))),
            }
        })?;
        buffer.intervals = intervals;
        match outside {
            Some((i, first, second)) => {
                let what = "expected depths in the range that the projection states; state a wider one";
                Err(self.impossible(square.texel(i), first, second, what))
            }
            None => Ok((&buffer.intervals, thin_texels)),
        }
    }

    /// Smallest and largest finite depth; 0 to 1 where there is none.
    fn range(&self, keep_on: &(dyn Fn() -> bool + Sync)) -> Result<[f64; 2], LayersError> {
        use rayon::prelude::*;
        let side = self.lattice.log2_resolution;
        let tile = side.min(crate::hierarchy::build::TILE_LEVEL);
        let across = 1u64 << (side - tile);
        let square = |i: u64| Square { origin: [i % across, i / across].map(|v| (v << tile) as u32), log2_side: tile };
        let none = [f64::INFINITY, f64::NEG_INFINITY];
        let join = |a: [f64; 2], b: [f64; 2]| Ok([a[0].min(b[0]), a[1].max(b[1])]);
        let found = (0..across * across)
            .into_par_iter()
            .map_init(TileBuffer::default, |buffer, i| {
                if !keep_on() {
                    return Err(LayersError::Stopped);
                }
                let mut range = none;
                self.each(square(i), buffer, |_, first, second| {
                    for d in [first, second] {
                        if d < f64::INFINITY {
                            range = [range[0].min(d), range[1].max(d)];
                        }
                    }
                })?;
                Ok(range)
            })
            .try_reduce(|| none, join)?;
        Ok(if found[0] > found[1] { [0.0, 1.0] } else { found })
    }
}

/// Whether one texel can have these two depths.
fn possible(first: f64, second: f64) -> Result<(), &'static str> {
    if first.is_nan() || second.is_nan() {
        return Err("expected numbers; positive infinity says that there is nothing");
    }
    if first == f64::NEG_INFINITY {
        return Err("expected a depth or positive infinity");
    }
    if second < first {
        let what = if first == f64::INFINITY {
            "expected no second surface where there is no first one"
        } else {
            "expected the second depth not to lie before the first"
        };
        return Err(what);
    }
    Ok(())
}

/// The interval of a centre ray that meets the scene at lattice depth `entry` and leaves at `exit`, never where that is
/// none: E = ceil(entry), X = ceil(exit) - 1; where X < E, X := E and the texel is thin (CONVENTIONS). None where a
/// depth leaves the lattice.
fn interval(entry: f64, exit: Option<f64>) -> Option<(Interval, bool)> {
    let on_lattice = |d: f64| (0.0..=DEEPEST as f64).contains(&d);
    if !on_lattice(entry) || exit.is_some_and(|d| !on_lattice(d)) {
        return None;
    }
    let min = entry.ceil() as u32;
    let max = exit.map_or(DEEPEST, |d| d.ceil() as i64 - 1);
    let thin = max < i64::from(min);
    Some((Interval { min, max: if thin { min } else { max as u32 } }, thin))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn intervals_are_those_of_the_conventions() {
        let of = |entry, exit| interval(entry, exit).map(|(i, thin)| (i.min, i.max, thin));
        assert_eq!(of(10.0, Some(20.0)), Some((10, 19, false)));
        assert_eq!(of(10.25, Some(20.25)), Some((11, 20, false)));
        assert_eq!(of(10.25, Some(10.75)), Some((11, 11, true)), "no lattice depth in between");
        assert_eq!(of(10.0, Some(10.0)), Some((10, 10, true)));
        assert_eq!(of(10.0, Some(10.5)), Some((10, 10, false)));
        assert_eq!(of(0.0, Some(0.0)), Some((0, 0, true)));
        assert_eq!(of(7.0, None), Some((7, u32::MAX - 1, false)), "never left");
        let deepest = f64::from(u32::MAX - 1);
        assert_eq!(of(deepest, Some(deepest)), Some((u32::MAX - 1, u32::MAX - 1, true)));
        for bad in [-0.5, deepest + 0.5, f64::INFINITY, f64::NAN] {
            assert_eq!(of(bad, None), None, "{bad}");
            assert_eq!(of(1.0, Some(bad)), None, "{bad}");
        }
    }

    #[test]
    fn impossible_depths_are_found() {
        let (inf, nan) = (f64::INFINITY, f64::NAN);
        for (first, second) in [(1.0, 1.0), (1.0, 2.0), (-3.0, inf), (inf, inf)] {
            assert!(possible(first, second).is_ok(), "{first} {second}");
        }
        for (first, second) in [(nan, 1.0), (1.0, nan), (2.0, 1.0), (inf, 1.0), (-inf, 1.0), (0.0, -inf), (inf, nan)] {
            assert!(possible(first, second).is_err(), "{first} {second}");
        }
    }
}
