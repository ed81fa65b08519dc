//! All pages of a map in one array: the fast lookup.

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing,
    clippy::cast_possible_truncation
)]

use umbrage_format::Kind;
use umbrage_format::projection::{Lattice, UNCOVERED};

use super::filter::{Receiver, Share, Taps, levels_around};
use super::follow::Follow;
use super::pyramid::Pyramid;
use super::{Map, Visibility, locate, mh, mmh, vector};
use crate::ReaderError;

/// Levels that the grid of walks spans at most: 256 x 256 cells of 20 bytes.
pub(super) const GRID_LEVELS: u8 = 8;

/// A map whose pages are all in memory, checked and linked. Lookups can't fail.
#[derive(Debug)]
pub struct Resident {
    tree: Tree,
    log2_resolution: u8,
    lattice: Lattice,
}

/// The pages, with what the walk of their kind needs.
#[derive(Debug)]
enum Tree {
    Mh(mh::resident::Tree),
    Mmh(mmh::resident::Tree),
    Vector(vector::resident::Tree),
}

impl Resident {
    pub(super) fn load(map: &Map, go_on: &dyn Fn() -> bool) -> Result<Self, ReaderError> {
        let structure = map.structure();
        let count = structure.page_count();
        let mut total = 0u64;
        for ordinal in 0..count {
            // Block by block, so that each is held against the one before.
            structure.touch_block(ordinal)?;
            total += u64::from(structure.page_record(ordinal)?.hot_words.get());
        }
        map.allow_words(total)?;
        let mut words = Vec::with_capacity(usize::try_from(total).unwrap_or(0));
        let mut pages = Vec::with_capacity(count as usize);
        let (mut held, mut dependencies, mut lists) = (0, Vec::new(), Vec::new());
        let mut follow = Follow::default();
        for ordinal in 0..count {
            if !go_on() {
                return Err(ReaderError::Stopped { file: structure.file().clone() });
            }
            // Pages that are not kept by the map need not be kept by it now.
            let page = map.resident(ordinal).cloned().map_or_else(|| structure.page(ordinal), Ok)?;
            follow.page(structure, &page)?;
            // Fits: `allow_words` has seen the sum.
            let (first, record) = (u32::try_from(words.len()).unwrap_or(u32::MAX), page.record());
            let origin = (record.origin_x.get(), record.origin_y.get());
            lists.push(u32::try_from(dependencies.len()).unwrap_or(u32::MAX));
            dependencies.extend_from_slice(page.dependencies());
            pages.push(vector::resident::Page { first, first_child: record.first_child.get(), origin });
            words.extend_from_slice(page.words());
            if structure.kind() == Kind::Vector {
                held += vector::resident::words_held(page.words());
            }
        }
        let log2_resolution = structure.record().log2_resolution.min(31);
        map.allow_words(total + Pyramid::words_held(log2_resolution, total))?;
        let tree = match structure.kind() {
            Kind::Vector => {
                map.allow_words(held + Pyramid::words_held(log2_resolution, held))?;
                Tree::Vector(vector::resident::Tree::new(&words, &pages, log2_resolution))
            }
            Kind::Mmh => {
                map.allow_words(total + dependencies.len() as u64 + Pyramid::words_held(log2_resolution, total))?;
                let page = |(p, dependencies): (&vector::resident::Page, u32)| mmh::resident::Page {
                    first: p.first,
                    first_child: p.first_child,
                    dependencies,
                };
                let pages = pages.iter().zip(lists).map(page).collect();
                Tree::Mmh(mmh::resident::Tree::new(words, pages, &dependencies, log2_resolution))
            }
            _ => {
                let pages = pages.iter().map(|p| (p.first, p.first_child)).collect();
                Tree::Mh(mh::resident::Tree::new(words, pages, log2_resolution))
            }
        };
        Ok(Self { tree, log2_resolution, lattice: structure.lattice() })
    }

    /// Whether a texel lies outside the map.
    #[inline]
    fn is_outside(&self, x: u32, y: u32) -> bool {
        (x | y) >> self.log2_resolution != 0
    }

    /// Stored depth at texel (x, y) of root 0 and `level`; [`UNCOVERED`] outside the map.
    #[inline]
    pub fn value(&self, x: u32, y: u32, level: u8) -> u32 {
        if self.is_outside(x, y) {
            return UNCOVERED;
        }
        match &self.tree {
            Tree::Mh(tree) => tree.value(x, y, level),
            Tree::Mmh(tree) => tree.value(x, y, level),
            Tree::Vector(tree) => tree.value(x, y, level),
        }
    }

    /// Depth of root 0 at a place inside texel (x, y); see [`Map::continuous`]. [`UNCOVERED`] outside the map.
    #[inline]
    pub fn continuous(&self, x: u32, y: u32, sub: [u8; 2]) -> u32 {
        if self.is_outside(x, y) {
            return UNCOVERED;
        }
        match &self.tree {
            Tree::Mh(tree) => tree.value(x, y, 0),
            Tree::Mmh(tree) => tree.value(x, y, 0),
            Tree::Vector(tree) => tree.continuous(x, y, sub),
        }
    }

    /// Percentage-closer filtering: the lit ones of `side` x `side` texels of `level` around a receiver, on root 0; see
    /// [`filter`](super::filter). Sides from 1 to [`MAX_SIDE`](super::filter::MAX_SIDE), levels up to the root's; beyond the
    /// nearest.
    pub fn pcf(&self, r: &Receiver, side: u32, level: u8) -> Share {
        let Some(taps) = Taps::new(r, side, level, self.log2_resolution) else { return Taps::outside(side) };
        taps.share(match &self.tree {
            Tree::Mh(tree) => tree.lit(&taps),
            Tree::Mmh(tree) => tree.lit(&taps),
            Tree::Vector(tree) => tree.lit(&taps),
        })
    }

    /// [`pcf`](Self::pcf) on the two levels around a [level of detail](super::filter::level_of_detail), blended; on its one
    /// level where it is a whole one or the root's.
    pub fn trilinear(&self, r: &Receiver, side: u32, lod: u32) -> Share {
        let (level, part) = levels_around(lod);
        let finer = self.pcf(r, side, level);
        let blends = part != 0 && level < self.log2_resolution;
        let coarser = if blends { self.pcf(r, side, level + 1) } else { finer };
        finer.blend(&coarser, part)
    }

    /// Light or shadow at a world point. Outside the map: lit, and flagged.
    pub fn visibility(&self, point: [f64; 3], level: u8) -> Visibility {
        match locate(&self.lattice, point) {
            Some((x, y, depth)) => Visibility::inside(depth, self.value(x, y, level)),
            None => Visibility::OUTSIDE,
        }
    }

    /// Texels on a side.
    pub fn resolution(&self) -> u32 {
        1 << self.log2_resolution
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        match &self.tree {
            Tree::Mh(tree) => tree.bytes(),
            Tree::Mmh(tree) => tree.bytes(),
            Tree::Vector(tree) => tree.bytes(),
        }
    }
}
