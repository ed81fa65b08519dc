//! Pages of one structure, loaded when a lookup needs them.

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing,
    clippy::cast_possible_truncation
)]

use std::sync::OnceLock;

use umbrage_format::projection::Lattice;
use umbrage_format::{FormatError, Kind, Place, Rule, Value};

use super::filter::{Receiver, Rect, Share, Taps, descend, levels_around};
use super::{Bounds, Resident, Visibility, locate, mh, mmh, vector};
use crate::{CheckedPage, ReaderError, Structure};

/// A page as the walk sees it.
#[derive(Clone, Copy, Debug)]
pub struct PageView<'a> {
    /// The words, frame included, in host order.
    pub words: &'a [u32],
    /// Ordinal of its first child page.
    pub first_child: u32,
    /// Ordinals of the shared pages that it depends on.
    pub dependencies: &'a [u32],
}

/// Where a walk ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Descent {
    /// The answer: the value last seen; [`umbrage_format::projection::UNCOVERED`] where there
    /// was none.
    pub value: u32,
    /// Level of the node that holds the value.
    pub level: u8,
    /// Page of that node.
    pub page: u32,
    /// That node in its page. In `mh` and `mmh` its word: the value, or the rise, is in this word for a leaf, in the
    /// next for an inner node. In `vector` its number: `4 * group + c`.
    pub word: u32,
    /// The page that the walk needed and did not get: the answer is then that of the nearest ancestor.
    pub missing: Option<u32>,
}

/// The answer of a lookup.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Answer {
    /// The stored depth; a receiver at lattice depth d is lit iff `ceil(d) <= value`.
    pub value: u32,
    /// Level of the node that holds it: at least the level asked for.
    pub level: u8,
    /// Page of that node.
    pub page: u32,
    /// That node in its page: its word in `mh` and `mmh`, its number `4 * group + c` in `vector`.
    pub word: u32,
}

/// A structure of kind `mh`, `mmh` or `vector` whose pages are loaded and checked when a lookup first needs them, and
/// then kept. May be used from any thread.
#[derive(Debug)]
pub struct Map {
    structure: Structure,
    pages: Box<[OnceLock<CheckedPage>]>,
    /// Pages that the index settles within this error are not read; none: all are.
    skips: Option<u32>,
}

impl Map {
    /// Makes the table of pages; reads nothing.
    ///
    /// # Errors
    /// The structure is of a kind that this version can't query, or the table is above the limits.
    pub fn new(structure: Structure) -> Result<Self, ReaderError> {
        if !structure.kind().has_layout() {
            return Err(ReaderError::UnsupportedKind {
                file: structure.file().clone(),
                structure: structure.name().to_string(),
                kind: structure.kind(),
            });
        }
        let bytes = u64::from(structure.page_count()) * size_of::<OnceLock<CheckedPage>>() as u64;
        let place = Place::Structure(structure.number());
        structure.limits().allocate(place, bytes).map_err(|e| structure.fault(e))?;
        let pages = (0..structure.page_count()).map(|_| OnceLock::new()).collect();
        Ok(Self { structure, pages, skips: Some(0) })
    }

    /// How far [`is_lit`](Self::is_lit), [`pcf`](Self::pcf) and [`trilinear`](Self::trilinear) go without pages. At first they
    /// skip with an error of 0: a page is not read where its index record says that all its answers lie on one side of the
    /// receiver; the result is the same to the bit. With an error of e lattice steps they also stop above pages whose record
    /// promises that what stands above is off by at most e. None: every page on the way is read.
    pub fn skip(&mut self, error: Option<u32>) {
        self.skips = error;
    }

    /// The structure.
    pub fn structure(&self) -> &Structure {
        &self.structure
    }

    /// Texels on a side.
    pub fn resolution(&self) -> u32 {
        1 << self.structure.record().log2_resolution.min(31)
    }

    /// The page of an ordinal, loaded where it is not there yet.
    ///
    /// # Errors
    /// As [`Structure::page`].
    pub fn page(&self, ordinal: u32) -> Result<&CheckedPage, ReaderError> {
        if let Some(page) = self.resident(ordinal) {
            return Ok(page);
        }
        let page = self.structure.page(ordinal)?;
        self.pages.get(ordinal as usize).map(|slot| slot.get_or_init(|| page)).ok_or_else(|| ReaderError::OutOfRange {
            file: self.structure.file().clone(),
            what: format!("page of structure '{}'", self.structure.name()),
            number: ordinal,
            count: self.structure.page_count(),
        })
    }

    /// The page of an ordinal if it is loaded.
    pub fn resident(&self, ordinal: u32) -> Option<&CheckedPage> {
        self.pages.get(ordinal as usize)?.get()
    }

    /// Answer of root 0 from the loaded pages alone; `missing` names the page that would refine it.
    pub fn nearest(&self, x: u32, y: u32, level: u8) -> Descent {
        self.walk(0, x, y, level)
    }

    /// What walks read of a page if it is loaded.
    pub fn view(&self, ordinal: u32) -> Option<PageView<'_>> {
        let page = self.resident(ordinal)?;
        Some(PageView {
            words: page.words(),
            first_child: page.record().first_child.get(),
            dependencies: page.dependencies(),
        })
    }

    fn walk(&self, root: u32, x: u32, y: u32, level: u8) -> Descent {
        let log2 = self.structure.record().log2_resolution;
        match self.structure.kind() {
            Kind::Vector => vector::descend(|o| self.view(o), root, log2, x, y, level),
            Kind::Mmh => mmh::descend(|o| self.view(o), root, log2, x, y, level),
            _ => mh::descend(|o| self.view(o), root, log2, x, y, level),
        }
    }

    /// Answer at texel (x, y) of root 0 and `level`; loads what is missing on the way.
    ///
    /// # Errors
    /// The texel lies outside the map, or a page can't be loaded.
    pub fn texel(&self, x: u32, y: u32, level: u8) -> Result<Answer, ReaderError> {
        self.texel_of(0, x, y, level)
    }

    /// [`texel`](Self::texel) of another root.
    ///
    /// # Errors
    /// As `texel`, or no such root.
    pub fn texel_of(&self, root: u32, x: u32, y: u32, level: u8) -> Result<Answer, ReaderError> {
        self.answer(root, x, y, |map| map.walk(root, x, y, level))
    }

    /// Answer of root 0 at a place inside texel (x, y): `sub` is the place in 1/256 of the texel from its corner of
    /// smallest x and y. Where the entry is not proven there, and in kinds `mh` and `mmh`, the texel's own answer. A proven
    /// one is right on a ray within 2^-12 texel of the place, but for a few steps of depth (spec/vector.md, Proofs).
    ///
    /// # Errors
    /// As [`texel`](Self::texel).
    pub fn continuous(&self, x: u32, y: u32, sub: [u8; 2]) -> Result<Answer, ReaderError> {
        let log2 = self.structure.record().log2_resolution;
        self.answer(0, x, y, |map| match map.structure.kind() {
            Kind::Vector => vector::continuous(|o| map.view(o), 0, log2, x, y, sub),
            _ => map.walk(0, x, y, 0),
        })
    }

    /// Whether a receiver in texel (x, y) of root 0 and `level`, at lattice depth `depth` rounded up, is lit. Loads what is
    /// missing on the way and can't be [skipped](Self::skip).
    ///
    /// # Errors
    /// As [`texel`](Self::texel).
    pub fn is_lit(&self, x: u32, y: u32, level: u8, depth: u32) -> Result<bool, ReaderError> {
        let settled = |d: &Descent| self.bounds(d.missing?)?.0.settle(depth, d.value, self.skips?);
        let answer = self.answer(0, x, y, |map| {
            let d = map.walk(0, x, y, level);
            match settled(&d) {
                // An answer whose value is on the right side.
                Some(lit) => Descent { value: if lit { u32::MAX } else { 0 }, missing: None, ..d },
                None => d,
            }
        })?;
        Ok(answer.value == u32::MAX || depth <= answer.value)
    }

    /// What the index says of a page that is missing; none where pages are not skipped or the index can't be read: then
    /// the page is loaded, and the error comes from there.
    fn bounds(&self, ordinal: u32) -> Option<(Bounds, u32)> {
        let error = self.skips?;
        Some((Bounds::of(&self.structure.page_record(ordinal).ok()?), error))
    }

    /// Percentage-closer filtering: the lit ones of `side` x `side` texels of `level` around a receiver, on root 0; see
    /// [`filter`](super::filter). Sides from 1 to [`MAX_SIDE`](super::filter::MAX_SIDE), levels up to the root's; beyond the
    /// nearest. Loads what is missing on the way. Outside the map: all lit, and flagged.
    ///
    /// # Errors
    /// A page can't be loaded.
    pub fn pcf(&self, r: &Receiver, side: u32, level: u8) -> Result<Share, ReaderError> {
        let log2 = self.structure.record().log2_resolution;
        let Some(taps) = Taps::new(r, side, level, log2) else { return Ok(Taps::outside(side)) };
        loop {
            let (lit, missing) = self.lit(&taps);
            match missing {
                // Each turn loads one page more, and a tap's walk meets at most 25.
                Some(ordinal) => self.page(ordinal).map(drop)?,
                None => return Ok(taps.share(lit)),
            }
        }
    }

    /// [`pcf`](Self::pcf) on the two levels around a [level of detail](super::filter::level_of_detail), blended; on its one
    /// level where it is a whole one or the root's.
    ///
    /// # Errors
    /// As `pcf`.
    pub fn trilinear(&self, r: &Receiver, side: u32, lod: u32) -> Result<Share, ReaderError> {
        let (level, part) = levels_around(lod);
        let finer = self.pcf(r, side, level)?;
        let blends = part != 0 && level < self.structure.record().log2_resolution;
        let coarser = if blends { self.pcf(r, side, level + 1)? } else { finer };
        Ok(finer.blend(&coarser, part))
    }

    /// Lit taps by the loaded pages, and a page that is missing.
    fn lit<'a>(&'a self, taps: &Taps) -> (u32, Option<u32>) {
        let (log2, level) = (self.structure.record().log2_resolution, taps.level);
        let look = |o| self.view(o);
        let (mut lit, mut missing) = (0, None);
        // A part whose page is missing, by the index if that is enough.
        let settle = |page: Option<u32>, part: &Rect, value: &dyn Fn(u32, u32) -> u32| {
            let (bounds, error) = self.bounds(page?)?;
            let (lit, all) = taps.settle(part, &bounds, error, value);
            all.then_some(lit)
        };
        match self.structure.kind() {
            Kind::Vector => {
                let mut walk = |w: vector::Walk<'a>, x, y, level| w.go(look, x, y, level);
                let mut answer = |w: &vector::Walk<'_>, part: &Rect| match settle(w.found.missing, part, &|x, y| {
                    w.value(x, y, level)
                }) {
                    Some(settled) => lit += settled,
                    None => {
                        missing = missing.or(w.found.missing);
                        lit += w.lit(taps, part);
                    }
                };
                descend(vector::Walk::new(look, 0, log2), taps.inside, level, &mut walk, &mut answer);
            }
            Kind::Mmh => {
                let mut walk = |w: mmh::Walk<'a>, x, y, level| w.go(look, x, y, level);
                let mut answer = |w: &mmh::Walk<'_>, part: &Rect| {
                    let settled = settle(w.found.missing, part, &|_, _| w.found.value);
                    missing = missing.or(w.found.missing.filter(|_| settled.is_none()));
                    lit += settled.unwrap_or_else(|| taps.lit(part, w.found.value));
                };
                descend(mmh::Walk::new(look, 0, log2), taps.inside, level, &mut walk, &mut answer);
            }
            _ => {
                let mut walk = |w: mh::Walk<'a>, x, y, level| w.go(look, x, y, level);
                let mut answer = |w: &mh::Walk<'_>, part: &Rect| {
                    let settled = settle(w.found.missing, part, &|_, _| w.found.value);
                    missing = missing.or(w.found.missing.filter(|_| settled.is_none()));
                    lit += settled.unwrap_or_else(|| taps.lit(part, w.found.value));
                };
                descend(mh::Walk::new(look, 0, log2), taps.inside, level, &mut walk, &mut answer);
            }
        }
        (lit, missing)
    }

    /// Walks again and again, each time with one page more.
    fn answer(&self, root: u32, x: u32, y: u32, walk: impl Fn(&Self) -> Descent) -> Result<Answer, ReaderError> {
        let (roots, side) = (self.structure.record().root_count.get(), self.resolution());
        for (what, number, count) in [("root", root, roots), ("texel column", x, side), ("texel row", y, side)] {
            if number >= count {
                let what = format!("{what} of structure '{}'", self.structure.name());
                return Err(ReaderError::OutOfRange { file: self.structure.file().clone(), what, number, count });
            }
        }
        loop {
            let d = walk(self);
            match d.missing {
                // Each turn loads one page more, and a walk meets at most 25.
                Some(ordinal) => self.page(ordinal).map(drop)?,
                None => return Ok(Answer { value: d.value, level: d.level, page: d.page, word: d.word }),
            }
        }
    }

    /// Light or shadow at a world point, on root 0. Outside the map: lit, and flagged.
    ///
    /// # Errors
    /// A page can't be loaded.
    pub fn visibility(&self, point: [f64; 3], level: u8) -> Result<Visibility, ReaderError> {
        let Some((x, y, depth)) = locate(&self.lattice(), point) else { return Ok(Visibility::OUTSIDE) };
        Ok(Visibility::inside(depth, self.texel(x, y, level)?.value))
    }

    /// World to lattice.
    pub fn lattice(&self) -> Lattice {
        self.structure.lattice()
    }

    /// Loads and checks every page, holds each child page against its parent's node, and copies all into one array.
    ///
    /// # Errors
    /// A page can't be loaded, breaks a rule (those about links among them), or all together are above the limits.
    pub fn preload(&self) -> Result<Resident, ReaderError> {
        self.preload_while(&|| true)
    }

    /// [`preload`](Self::preload) that asks before each page whether to go on.
    ///
    /// # Errors
    /// As `preload`; [`ReaderError::Stopped`] where the answer was no.
    pub fn preload_while(&self, go_on: &dyn Fn() -> bool) -> Result<Resident, ReaderError> {
        Resident::load(self, go_on)
    }

    /// Refuses an array of more words than the limits allow or a 32-bit index reaches.
    pub(super) fn allow_words(&self, words: u64) -> Result<(), ReaderError> {
        let place = Place::Structure(self.structure.number());
        let limited = self.structure.limits().allocate(place, words.saturating_mul(4));
        let addressed = if words <= u64::from(u32::MAX) {
            Ok(())
        } else {
            let (expected, found) = (Value::AtMost(u32::MAX.into()), Value::Number(words));
            Err(FormatError::new(Rule::LimitAllocation, place, 0, expected, found))
        };
        limited.and(addressed).map_err(|e| self.structure.fault(e))
    }
}
