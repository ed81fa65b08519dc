//! Pages -> cold pages: the encoder of `umbrage_format::cold`.
//!
//! A [`Tally`] counts the numbers of all pages of a structure and makes the [`Tables`] of them; [`Tables::encode`] turns a
//! page into its cold form, where that is shorter. What comes out depends on the pages and their order alone.

use rustc_hash::FxHashMap as HashMap;

use umbrage_format::Kind;
use umbrage_format::cold::coder::LEAST_STATE;
use umbrage_format::cold::model::{self, MAX_SLOPES, PROBABILITY_BITS, SLOTS, alphabets};
use umbrage_format::cold::{Coder, Model, PLAIN, walk};
use umbrage_format::kind::vector::{Layout, Plane};

/// Slopes, and selectors, that are counted at once; beyond, those met once are forgotten.
const MOST_COUNTED: usize = 1 << 18;
/// Planes that have slopes of the model, at least, and masks that have its selectors: what a place in it takes must come
/// back.
const LEAST_USES: u32 = 3;
/// Pages of kind `mh` on which [`Tables`] tries what counts as near.
const TRIED: usize = 48;
/// What it tries, bits.
const NEAR: [u8; 8] = [14, 17, 19, 21, 23, 25, 27, 30];

/// Where things stand in the model.
#[derive(Debug)]
struct Places {
    slopes: HashMap<[u32; 2], u32>,
    selectors: HashMap<u32, u32>,
}

/// Adds one to a count; where there are too many, rare ones go.
fn count<K: Eq + std::hash::Hash>(counts: &mut HashMap<K, u32>, key: K) {
    *counts.entry(key).or_default() += 1;
    if counts.len() > MOST_COUNTED {
        counts.retain(|_, uses| *uses > 1);
    }
    if counts.len() > MOST_COUNTED {
        counts.clear();
    }
}

/// What was met often enough, the most frequent first: small numbers take fewer bits.
fn frequent<K: Ord + Copy>(counts: HashMap<K, u32>) -> Vec<K> {
    let mut all: Vec<(K, u32)> = counts.into_iter().filter(|s| s.1 >= LEAST_USES).collect();
    all.sort_unstable_by_key(|(key, uses)| (std::cmp::Reverse(*uses), *key));
    all.truncate(MAX_SLOPES);
    all.into_iter().map(|s| s.0).collect()
}

/// The numbers of a page.
#[derive(Default)]
struct Recorder<'a> {
    /// Table and symbol.
    symbols: Vec<(u16, u16)>,
    bits: Vec<u8>,
    /// Bits that are less than a byte.
    waiting: u64,
    waits: u32,
    places: Option<&'a Places>,
}

impl Coder for Recorder<'_> {
    fn symbol(&mut self, table: usize, real: impl FnOnce() -> u32) -> u32 {
        let symbol = real();
        // Tables are few, and a symbol of none is found when it is counted.
        self.symbols.push((table as u16, symbol.min(u16::MAX.into()) as u16));
        symbol
    }

    fn bits(&mut self, count: u32, real: impl FnOnce() -> u32) -> u32 {
        let bits = u64::from(real()) & ((1 << count) - 1);
        self.waiting |= bits << self.waits;
        self.waits += count;
        while self.waits >= 8 {
            self.bits.push(self.waiting as u8);
            (self.waiting, self.waits) = (self.waiting >> 8, self.waits - 8);
        }
        bits as u32
    }

    fn slopes(&self, slopes: [u32; 2]) -> Option<u32> {
        self.places?.slopes.get(&slopes).copied()
    }

    fn selectors(&self, selectors: u32) -> Option<u32> {
        self.places?.selectors.get(&selectors).copied()
    }
}

impl Recorder<'_> {
    /// Notes a page by its kind, or where that does not give the page back, word by word. `None`: not even that.
    fn page<'a>(model: &Model, sizes: &[u16], places: &'a Places, words: &[u32]) -> Option<(Recorder<'a>, bool)> {
        [false, true].into_iter().find_map(|plain| {
            let mut recorder = Recorder { places: Some(places), ..Recorder::default() };
            let mut out = vec![0; words.len()];
            walk(&mut recorder, model, plain, words, &mut out)?;
            let fits = |&(t, s): &(u16, u16)| sizes.get(usize::from(t)).is_some_and(|n| s < *n);
            let whole = out == words && recorder.symbols.iter().all(fits);
            whole.then_some((recorder, plain))
        })
    }
}

/// Counts of the numbers of a structure's pages.
#[derive(Debug)]
pub struct Tally {
    kind: Kind,
    /// How many planes have which slopes.
    slopes: HashMap<[u32; 2], u32>,
    /// And how many masks which selectors.
    selectors: HashMap<u32, u32>,
    /// The first pages of kind `mh`.
    tried: Vec<Vec<u32>>,
}

impl Tally {
    /// Of a structure of this kind; `None` where its pages have no cold form.
    pub fn new(kind: Kind) -> Option<Self> {
        let empty = || Self { kind, slopes: HashMap::default(), selectors: HashMap::default(), tried: Vec::new() };
        kind.has_layout().then(empty)
    }

    /// First round: notes what the model holds beside its tables.
    pub fn note(&mut self, words: &[u32]) {
        if self.kind == Kind::Mh && self.tried.len() < TRIED {
            self.tried.push(words.to_vec());
        }
        if self.kind != Kind::Vector {
            return;
        }
        let layout = Layout::of(words);
        let planes = words.get(layout.planes_at.into()..layout.splits_at.into()).unwrap_or_default();
        for plane in planes.chunks_exact(3) {
            count(&mut self.slopes, Plane::slopes(plane[1], plane[2]));
        }
        let masks = words.get(layout.masks_at.into()..layout.raws_at.into()).unwrap_or_default();
        masks.chunks_exact(2).for_each(|mask| count(&mut self.selectors, mask[1]));
    }

    /// Ends the first round.
    pub fn tables(self) -> Tables {
        let (slopes, selectors) = (frequent(self.slopes), frequent(self.selectors));
        if self.kind != Kind::Mh {
            return Tables::new(self.kind, 0, slopes, selectors);
        }
        let bytes = |near: u8| {
            let mut tables = Tables::new(self.kind, near, Vec::new(), Vec::new());
            self.tried.iter().for_each(|page| tables.count(page));
            let tables = tables.finish();
            self.tried.iter().map(|page| tables.encode(page).map_or(page.len() * 4, |cold| cold.len())).sum::<usize>()
        };
        let near = NEAR.into_iter().min_by_key(|near| bytes(*near)).unwrap_or(0);
        Tables::new(self.kind, near, slopes, selectors)
    }
}

/// Counts of the second round; when it is finished, what pages are encoded with.
#[derive(Debug)]
pub struct Tables {
    model: Model,
    near: u8,
    sizes: Vec<u16>,
    counts: Vec<Vec<u32>>,
    /// First slot and number of slots of each symbol.
    shares: Vec<Vec<(u32, u32)>>,
    places: Places,
    section: Vec<u8>,
}

impl Tables {
    fn new(kind: Kind, near: u8, slopes: Vec<[u32; 2]>, selectors: Vec<u32>) -> Self {
        let sizes = alphabets(kind);
        let empty: Vec<Vec<u16>> = sizes.iter().map(|n| vec![0; (*n).into()]).collect();
        let section = model::encode(kind, near, &empty, &slopes, &selectors);
        Self {
            model: Model::read(kind, &section).expect("made by its rules"),
            near,
            counts: sizes.iter().map(|n| vec![0; (*n).into()]).collect(),
            sizes,
            shares: Vec::new(),
            places: Places {
                slopes: slopes.into_iter().zip(0..).collect(),
                selectors: selectors.into_iter().zip(0..).collect(),
            },
            section,
        }
    }

    /// Second round: counts the numbers of a page.
    pub fn count(&mut self, words: &[u32]) {
        if let Some((page, _)) = Recorder::page(&self.model, &self.sizes, &self.places, words) {
            for (table, symbol) in page.symbols {
                let count = &mut self.counts[usize::from(table)][usize::from(symbol)];
                *count = count.saturating_add(1);
            }
        }
    }

    /// Ends the second round: frequencies from counts.
    pub fn finish(mut self) -> Self {
        let frequencies: Vec<Vec<u16>> = self.counts.iter().map(|counts| frequencies(counts)).collect();
        let (kind, slopes, selectors) = (self.model.kind(), self.model.slopes(), self.model.selectors());
        self.section = model::encode(kind, self.near, &frequencies, slopes, selectors);
        self.model = Model::read(self.model.kind(), &self.section).expect("made by its rules");
        let shares = |table: &Vec<u16>| {
            let mut start = 0;
            let share = |f: &u16| {
                let first = start;
                start += u32::from(*f);
                (first, u32::from(*f))
            };
            table.iter().map(share).collect()
        };
        self.shares = frequencies.iter().map(shares).collect();
        self
    }

    /// The bytes of the model's section.
    pub fn section(&self) -> &[u8] {
        &self.section
    }

    /// The cold form of a page that was counted, whole words; `None` where it is not shorter than the page.
    pub fn encode(&self, words: &[u32]) -> Option<Vec<u8>> {
        let (page, plain) = Recorder::page(&self.model, &self.sizes, &self.places, words)?;
        let mut states = [LEAST_STATE; 2];
        let mut halves = Vec::new();
        for (i, &(table, symbol)) in page.symbols.iter().enumerate().rev() {
            let (start, share) = match self.shares[usize::from(table)][usize::from(symbol)] {
                (_, 0) if symbol == 0 && self.counts[usize::from(table)].iter().all(|c| *c == 0) => (0, SLOTS as u32),
                (_, 0) => return None,
                share => share,
            };
            let state = &mut states[i % 2];
            if u64::from(*state) >= u64::from(share) << (48 - 16 - PROBABILITY_BITS) {
                halves.push(*state as u16);
                *state >>= 16;
            }
            *state = ((*state / share) << PROBABILITY_BITS) + *state % share + start;
        }
        let first = u16::try_from(halves.len() + 4).ok().filter(|n| *n < PLAIN)?;
        let mut out = Vec::with_capacity(words.len() * 4);
        out.extend((first | if plain { PLAIN } else { 0 }).to_le_bytes());
        states.iter().for_each(|s| out.extend(s.to_le_bytes()));
        halves.iter().rev().for_each(|h| out.extend(h.to_le_bytes()));
        out.extend(&page.bits);
        if page.waits > 0 {
            out.push(page.waiting as u8);
        }
        out.resize(out.len().next_multiple_of(4), 0);
        (out.len() < words.len() * 4).then_some(out)
    }

    /// The model that decodes what [`encode`](Self::encode) gives.
    pub fn model(&self) -> &Model {
        &self.model
    }
}

/// Frequencies that sum to [`SLOTS`], at least 1 for each symbol that occurs; all 0 where none does.
fn frequencies(counts: &[u32]) -> Vec<u16> {
    let total: u64 = counts.iter().map(|c| u64::from(*c)).sum();
    if total == 0 {
        return vec![0; counts.len()];
    }
    let share = |c: &u32| if *c == 0 { 0 } else { (u64::from(*c) * SLOTS as u64 / total).max(1) as u16 };
    let mut found: Vec<u16> = counts.iter().map(share).collect();
    let mut sum: usize = found.iter().map(|f| usize::from(*f)).sum();
    // What rounding left goes where it saves the most, and comes from where it costs the least: to or from the symbol with
    // the most occurrences for each of its slots, or the fewest.
    while sum != SLOTS {
        let often = |i: &usize| (u128::from(counts[*i]) << 32) / u128::from(found[*i]);
        let used = (0..counts.len()).filter(|i| found[*i] > 0);
        if sum < SLOTS {
            let i = used.max_by_key(|i| (often(i), std::cmp::Reverse(*i))).unwrap_or(0);
            found[i] += 1;
            sum += 1;
        } else {
            let i = used.filter(|i| found[*i] > 1).min_by_key(|i| (often(i), *i)).unwrap_or(0);
            found[i] -= 1;
            sum -= 1;
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frequencies_sum_up_and_leave_none_out() {
        let many: Vec<u32> = (0..256).map(|i| if i == 7 { 1_000_000 } else { 1 }).collect();
        for counts in [vec![5], vec![0, 3, 0], vec![1, 1, 1], vec![u32::MAX; 200], many] {
            let found = frequencies(&counts);
            assert_eq!(found.iter().map(|f| usize::from(*f)).sum::<usize>(), SLOTS, "{counts:?}");
            assert!(found.iter().zip(&counts).all(|(f, c)| (*f == 0) == (*c == 0)), "{counts:?}");
        }
        assert_eq!(frequencies(&[0, 0]), [0, 0]);
    }
}
