//! How a picture looks the map up: a texel, a place in it, or a filter around it.

use umbrage_reader::query::filter::{LOD_BITS, MAX_SIDE, nearest_level};

use super::filter::Footprints;

/// How the map is looked up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Look {
    /// The receiver's texel.
    Texel,
    /// Its place in the texel, where that is proven.
    Place,
    /// Texels around it.
    Filtered(Filter),
}

/// A filter, with the taps on a side of its kernels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Filter {
    /// On level 0.
    Pcf(u32),
    /// On the level of the pixel's footprint.
    Hierarchical(u32),
    /// Between the two levels around it.
    Trilinear(u32),
}

impl Filter {
    /// Taps on a side, and level in 1/256, at a pixel.
    pub fn at(self, of: &Footprints<'_>, pixel: usize) -> (u32, u32) {
        match self {
            Filter::Pcf(side) => (side, 0),
            Filter::Hierarchical(side) => (side, u32::from(nearest_level(of.level_of_detail(pixel))) << LOD_BITS),
            Filter::Trilinear(side) => (side, of.level_of_detail(pixel)),
        }
    }
}

/// Reads `hard`, `pcf:N`, `hpcf[:N]` or `trilinear[:N]`.
///
/// # Errors
/// What was expected, and what was found.
pub fn parse_look(s: &str) -> Result<Look, String> {
    let wrong = || {
        format!(
            "expected hard, pcf:N, hpcf or trilinear (or hpcf:N, trilinear:N), N from 1 to {MAX_SIDE} taps on a side, found '{s}'"
        )
    };
    let (name, side) = match s.split_once(':') {
        Some((name, n)) => (name, Some(n.parse().ok().filter(|n| (1..=MAX_SIDE).contains(n)).ok_or_else(wrong)?)),
        None => (s, None),
    };
    match (name, side) {
        ("hard", None) => Ok(Look::Texel),
        ("pcf", Some(n)) => Ok(Look::Filtered(Filter::Pcf(n))),
        ("hpcf", n) => Ok(Look::Filtered(Filter::Hierarchical(n.unwrap_or(3)))),
        ("trilinear", n) => Ok(Look::Filtered(Filter::Trilinear(n.unwrap_or(3)))),
        _ => Err(wrong()),
    }
}
