//! Holds the stop errors of page records against the truth: how far the answer that a reader gives without a page lies
//! from the intervals of the texels in the page's footprint.
//!
//! That answer is what the page inherits from above: in `mh` and `mmh` one value, in `vector` an entry, evaluated at the texel.
//! Most texels need no exact look: where the stored value, which lies in the texel's interval, is within the stop error
//! of the inherited one, so is the interval.

use umbrage_format::Kind;
use umbrage_format::projection::UNCOVERED;
use umbrage_reader::query::{Map, PageView, mh, mmh, vector};
use umbrage_reader::{ReaderError, Structure};

use super::{Interval, Region};

/// What lookups answer without a page.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Inherited {
    /// The same everywhere.
    Value(u32),
    /// The entry of a node of a page above, in kind `vector`.
    Entry { page: u32, node: u32 },
}

/// What the record of one page promises.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stop {
    /// Ordinal.
    pub page: u32,
    /// First texel of the footprint.
    pub origin: [u32; 2],
    /// Texels on a side of the footprint.
    pub side: u32,
    /// The stop error of the record.
    pub error: u32,
    inherited: Inherited,
    first_child: u32,
    children: u32,
}

impl Stop {
    /// Whether texel (x, y) lies in the footprint.
    pub fn holds(&self, [x, y]: [u32; 2]) -> bool {
        x.wrapping_sub(self.origin[0]) < self.side && y.wrapping_sub(self.origin[1]) < self.side
    }

    /// The part of a region in the footprint.
    fn part(&self, r: &Region) -> Option<Region> {
        let [x, y] = [r.x.max(self.origin[0]), r.y.max(self.origin[1])];
        let end = |from: u32, length: u32| u64::from(from) + u64::from(length);
        let across = end(r.x, r.width).min(end(self.origin[0], self.side)).checked_sub(x.into())?;
        let down = end(r.y, r.height).min(end(self.origin[1], self.side)).checked_sub(y.into())?;
        let part = Region { x, y, width: across as u32, height: down as u32 };
        (across > 0 && down > 0).then_some(part)
    }
}

/// A stop error that is too small.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StopFault {
    /// What the record promises.
    pub stop: Stop,
    /// A texel that is further off.
    pub texel: [u32; 2],
    /// The answer there without the page.
    pub answer: u32,
    /// The texel's interval.
    pub allowed: Interval,
}

/// What was found.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct StopTally {
    /// Pairs of a texel and a page on the way to it.
    pub pairs: u64,
    /// Pairs that needed the texel's interval and were held against it.
    pub exact: u64,
    /// Pairs that would have needed it and were passed over.
    pub passed: u64,
    /// Pairs that are further off than the page's record says.
    pub wrong: u64,
    /// Some of them: at most [`Tally::EXAMPLES`](super::Tally::EXAMPLES), of different pages.
    pub examples: Vec<StopFault>,
}

impl StopTally {
    /// The counts of both.
    pub fn merge(mut self, other: Self) -> Self {
        self.pairs += other.pairs;
        self.exact += other.exact;
        self.passed += other.passed;
        self.wrong += other.wrong;
        other.examples.into_iter().for_each(|e| self.example(e));
        self
    }

    fn example(&mut self, e: StopFault) {
        if self.examples.len() < super::Tally::EXAMPLES && self.examples.iter().all(|k| k.stop.page != e.stop.page) {
            self.examples.push(e);
        }
    }

    /// Counts one pair whose answer and interval are known.
    pub fn hold(&mut self, stop: &Stop, texel: [u32; 2], answer: u32, allowed: Interval) {
        self.exact += 1;
        let distance = allowed.min.saturating_sub(answer).max(answer.saturating_sub(allowed.max));
        if distance > stop.error {
            self.wrong += 1;
            self.example(StopFault { stop: *stop, texel, answer, allowed });
        }
    }
}

/// The promises of all pages of root 0.
pub struct Stops {
    /// The pages whose entries answer; in kinds `mh` and `mmh` none, as the values are known.
    map: Option<Map>,
    stops: Vec<Stop>,
    roots: u32,
}

/// A page that the map has loaded.
fn view(map: &Map, ordinal: u32) -> Option<PageView<'_>> {
    map.view(ordinal)
}

impl Stops {
    /// Loads every page and walks to it as if it were missing; asks before each page whether to go on. Pages of kind
    /// `vector` are kept.
    ///
    /// # Errors
    /// A page can't be loaded; [`ReaderError::Stopped`] where the answer was no.
    pub fn new(structure: &Structure, go_on: &dyn Fn() -> bool) -> Result<Self, ReaderError> {
        let map = Map::new(structure.clone())?;
        let r = structure.record();
        let (log2, roots) = (r.log2_resolution, r.root_count.get());
        let stop = |page: u32| {
            if !go_on() {
                return Err(ReaderError::Stopped { file: structure.file().clone() });
            }
            // Those that the walk comes through lie before it and are loaded already.
            let record = *map.page(page)?.record();
            let origin = [record.origin_x.get(), record.origin_y.get()];
            let there = |o: u32| if o == page { None } else { view(&map, o) };
            let (root, [x, y]) = (record.root.get().into(), origin);
            let inherited = match structure.kind() {
                Kind::Vector => match vector::descend(there, root, log2, x, y, 0) {
                    // Nothing answers in place of a root page.
                    d if d.missing == Some(root) => Inherited::Value(d.value),
                    d => Inherited::Entry { page: d.page, node: d.word },
                },
                // On the way to a page lie no shared ones.
                Kind::Mmh => Inherited::Value(mmh::descend(there, root, log2, x, y, 0).value),
                _ => Inherited::Value(mh::descend(there, root, log2, x, y, 0).value),
            };
            Ok(Stop {
                page,
                origin,
                side: 1 << record.log2_x.min(31),
                inherited,
                error: record.stop_error.get(),
                first_child: record.first_child.get(),
                children: record.child_count.get().into(),
            })
        };
        let stops = (0..structure.record().tree_pages()).map(stop).collect::<Result<_, _>>()?;
        Ok(Self { map: (structure.kind() == Kind::Vector).then_some(map), stops, roots })
    }

    /// The answer at a texel of a page's footprint without the page.
    pub fn answer(&self, stop: &Stop, [x, y]: [u32; 2]) -> u32 {
        match stop.inherited {
            Inherited::Value(value) => value,
            // The page is there: the walk came through it.
            Inherited::Entry { page, node } => self
                .map
                .as_ref()
                .and_then(|map| view(map, page))
                .map_or(UNCOVERED, |page| vector::node_value(page, node, x, y)),
        }
    }

    /// The pages below root 0, the root page left out, whose footprint shares texels with a region.
    pub fn over(&self, region: Region) -> Vec<&Stop> {
        let mut found = Vec::new();
        let mut waiting = vec![0u32];
        while let Some(page) = waiting.pop() {
            let Some(stop) = self.stops.get(page as usize).filter(|s| s.part(&region).is_some()) else { continue };
            waiting.extend(stop.first_child..stop.first_child.saturating_add(stop.children));
            // Nothing answers in place of a root page.
            if page >= self.roots {
                found.push(stop);
            }
        }
        found
    }

    /// Holds the pages over a region against its texels. `stored` is the value stored for a texel, which lies in its
    /// interval; `truth` tells the interval and is asked for one in `every` of the texels that need it.
    pub fn check(
        &self,
        region: Region,
        every: u64,
        stored: impl Fn(u32, u32) -> u32,
        truth: impl Fn(u32, u32) -> Interval,
    ) -> StopTally {
        let mut tally = StopTally::default();
        let mut open: Vec<([u32; 2], u32, &Stop)> = Vec::new();
        let values: Vec<u32> = (0..region.height)
            .flat_map(|y| (0..region.width).map(move |x| (region.x + x, region.y + y)))
            .map(|(x, y)| stored(x, y))
            .collect();
        for stop in self.over(region) {
            let Some(part) = stop.part(&region) else { continue };
            tally.pairs += u64::from(part.width) * u64::from(part.height);
            for y in part.y..part.y + part.height {
                let row = (y - region.y) as usize * region.width as usize + (part.x - region.x) as usize;
                for (x, &value) in (part.x..).zip(&values[row..row + part.width as usize]) {
                    let answer = self.answer(stop, [x, y]);
                    if value.abs_diff(answer) <= stop.error {
                        continue;
                    }
                    let place = (u64::from(x) << 32 | u64::from(y)).wrapping_mul(0x9E37_79B9_7F4A_7C15);
                    if (place >> 32).is_multiple_of(every) {
                        open.push(([x, y], answer, stop));
                    } else {
                        tally.passed += 1;
                    }
                }
            }
        }
        open.sort_unstable_by_key(|(texel, ..)| *texel);
        for same in open.chunk_by(|a, b| a.0 == b.0) {
            let [x, y] = same[0].0;
            let allowed = truth(x, y);
            same.iter().for_each(|(texel, answer, stop)| tally.hold(stop, *texel, *answer, allowed));
        }
        tally
    }
}
