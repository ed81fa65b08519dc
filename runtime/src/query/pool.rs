//! What the walks of all kinds share: twin of `shader/query/pool.wgsl` and `shader/query/answer.wgsl`, and the numbers
//! that both sides use.

use umbrage_format::Kind;
use umbrage_format::kind::mh::Mask;
use umbrage_format::page::FrameHead;
use umbrage_format::projection::UNCOVERED;
use umbrage_format::structure::MAX_LOG2_RESOLUTION;
use umbrage_reader::query::Bounds;

use super::vector::Found;
use crate::residency::Entry;
use crate::shader::{MOST_GAP, Rect};

/// First word of a table entry whose page is not in the pool.
pub const NOT_RESIDENT: u32 = u32::MAX;
/// No page, where an ordinal could stand.
pub const NONE: u32 = u32::MAX;
/// Most nodes of a walk: one for each level, and one in reserve.
pub const MAX_STEPS: u32 = MAX_LOG2_RESOLUTION as u32 + 2;
/// Bit of a state: lit.
pub const LIT: u32 = 1;
/// Bit of a state: the nearest resident ancestor answered, a page was missing.
pub const ANCESTOR: u32 = 2;
/// Bit of a state: outside the map, where nothing is known; lit.
pub const OUTSIDE: u32 = 4;
/// Bit of a state: nothing was missing.
pub const EXACT: u32 = 8;
/// Level of the answering node, 5 bits from here.
pub const LEVEL_SHIFT: u32 = 8;
/// Bit of a state: what was baked there was marked as out of date.
pub const STALE: u32 = 32;
/// Bit of a state: a page was missing, but what the index says of it was enough.
pub const SETTLED: u32 = 16;
/// The answering node in its page, 17 bits from here; see [`Answer::word`].
pub const WORD_SHIFT: u32 = 15;

/// Where a walk ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Answer {
    /// The depth; [`UNCOVERED`] where there was no value.
    pub value: u32,
    /// Level of the node that it comes from.
    pub level: u32,
    /// Page of that node.
    pub page: u32,
    /// That node in its page: its word in `mh` and `mmh`, its number `4 * group + c` in `vector`.
    pub word: u32,
    /// The page that the walk needed and did not get, or [`NONE`]. Pages are named by their places in the table.
    pub missing: u32,
}

impl Answer {
    /// Light or shadow for a receiver at lattice depth `depth`, rounded up, with the bits above.
    pub fn state(&self, depth: u32) -> u32 {
        let lit = if depth <= self.value { LIT } else { 0 };
        let whole = if self.missing == NONE { EXACT } else { ANCESTOR };
        self.level << LEVEL_SHIFT | self.word << WORD_SHIFT | lit | whole
    }
}

/// The answer for a receiver.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shadow {
    /// Light or shadow, with the bits above.
    pub state: u32,
    /// The page that was missing and is needed, or [`NONE`].
    pub missing: u32,
    /// Page of the node that answered; [`NONE`] outside the map.
    pub page: u32,
}

impl Shadow {
    /// What a receiver that asked for `level` loses on the screen by a page that is missing: twice as much for each level that
    /// its answer is too coarse.
    pub fn weight(&self, level: u32) -> u32 {
        1 << (self.state >> LEVEL_SHIFT & 31).saturating_sub(level).min(MOST_GAP)
    }
}

/// The device's buffers as words.
#[derive(Clone, Copy, Debug)]
pub struct Pool<'a> {
    /// All slots.
    pub words: &'a [u32],
    /// One for each page.
    pub table: &'a [Entry],
    /// Place of the structure's first page in the table.
    pub base: u32,
    /// Its stale rectangles.
    pub stale: &'a [Rect],
    /// How the structure is encoded.
    pub kind: Kind,
    /// Levels below the root, at most 24.
    pub log2_resolution: u8,
    /// Receivers that the index settles within this error don't need pages; none: all do.
    pub skips: Option<u32>,
}

/// A page in the pool.
#[derive(Clone, Copy)]
pub(super) struct Page<'a> {
    pub(super) words: &'a [u32],
    /// The pool behind them: in kind `mmh` the ordinals that the page depends on come first.
    behind: &'a [u32],
    pub(super) first_child: u32,
}

/// A walk on its way, in a structure of any kind.
#[derive(Clone, Copy)]
pub(super) struct Walk<'a> {
    /// The answer so far; in kind `vector` without its value.
    pub(super) found: Answer,
    pub(super) page: Page<'a>,
    pub(super) ordinal: u32,
    /// The next group, and in `mh` and `mmh` its types, unless a node has been visited that must be opened first.
    pub(super) mask: Mask,
    pub(super) group: u32,
    /// Level of the next group or of that node.
    pub(super) level: u8,
    /// That node: its word, in `vector` the group below it.
    pub(super) node: u32,
    pub(super) opens: bool,
    pub(super) ended: bool,
    /// Rises so far, in `mmh`.
    pub(super) sum: u32,
    /// What gives the value, in `vector`.
    pub(super) entry: Option<Found<'a>>,
}

impl Page<'_> {
    /// A word; 0 outside.
    pub(super) fn word(&self, at: u32) -> u32 {
        self.words.get(at as usize).copied().unwrap_or(0)
    }

    /// Ordinal of a dependency; [`NONE`] outside the pool.
    pub(super) fn dependency(&self, d: u32) -> u32 {
        self.behind.get(d as usize).copied().unwrap_or(NONE)
    }

    /// Both words of the frame.
    pub(super) fn head(&self) -> FrameHead {
        let zero = FrameHead { tag: 0, root_mask: 0, child_refs: 0, words: 0, root_level: 0 };
        FrameHead::decode(&[self.word(0), self.word(1)]).unwrap_or(zero)
    }

    pub(super) fn root_mask(&self) -> Mask {
        Mask(self.head().root_mask)
    }
}

impl<'a> Pool<'a> {
    /// Place of root `root` in the table.
    fn root(&self, root: u32) -> u32 {
        self.base.saturating_add(root)
    }

    /// [`STALE`] where what was baked for a texel is out of date, else 0.
    pub(super) fn stale(&self, x: u32, y: u32) -> u32 {
        if self.stale.iter().any(|r| r.contains([x, y])) { STALE } else { 0 }
    }

    /// A page by its place in the table; whatever table and frame say, its words lie in the pool.
    pub(super) fn page(&self, ordinal: u32) -> Option<Page<'a>> {
        let &[at, first_child, ..] = self.table.get(ordinal as usize)?;
        let room = self.words.get(at as usize..).filter(|r| !r.is_empty())?;
        let words = FrameHead::decode(room).map_or(0, |h| usize::from(h.words));
        let (words, behind) = room.split_at(words.min(room.len()));
        Some(Page { words, behind, first_child })
    }

    /// Level of the root.
    pub(super) fn top(&self) -> u8 {
        self.log2_resolution.min(MAX_LOG2_RESOLUTION)
    }

    /// What a walk from root `root` knows before its first page.
    pub(super) fn nothing(&self, root: u32) -> Answer {
        let page = self.root(root);
        Answer { value: UNCOVERED, level: self.log2_resolution.into(), page, word: 0, missing: NONE }
    }

    /// A walk at the group of root `root`, which is `group` in its page.
    pub(super) fn start(&self, root: u32, group: u32) -> Walk<'a> {
        let first = self.root(root);
        let page = self.page(first);
        let found = Answer { missing: if page.is_none() { first } else { NONE }, ..self.nothing(root) };
        let ended = page.is_none();
        let page = page.unwrap_or(Page { words: &[], behind: &[], first_child: 0 });
        let (mask, level) = (page.root_mask(), self.top());
        Walk { found, page, ordinal: first, mask, group, level, node: 0, opens: false, ended, sum: 0, entry: None }
    }

    /// Walks from root `root` to texel (x, y) at `level`, by the structure's kind; a kind that has no walk answers as
    /// one whose root is missing.
    pub fn texel(&self, root: u32, x: u32, y: u32, level: u32) -> Answer {
        match self.kind {
            Kind::Mh => self.mh(root, x, y, level),
            Kind::Mmh => self.mmh(root, x, y, level),
            Kind::Vector => self.vector(root, x, y, level),
            _ => Answer { missing: self.root(root), ..self.nothing(root) },
        }
    }

    /// What the index says of a page that is missing, and the error that is asked for.
    pub(super) fn bounds(&self, ordinal: u32) -> Option<(Bounds, u32)> {
        let (error, &[at, stop_error, min_depth, max_depth]) = (self.skips?, self.table.get(ordinal as usize)?);
        (at == NOT_RESIDENT).then_some((Bounds { min_depth, max_depth, stop_error }, error))
    }

    /// Light or shadow for a receiver at lattice depth `depth`, rounded up, in texel (x, y) at `level`.
    pub fn shadow(&self, root: u32, [x, y]: [u32; 2], level: u32, depth: u32) -> Shadow {
        if self.outside(x, y) {
            return Shadow { state: LIT | OUTSIDE | EXACT, missing: NONE, page: NONE };
        }
        let d = self.texel(root, x, y, level);
        let (state, page) = (d.state(depth) | self.stale(x, y), d.page);
        match self.bounds(d.missing).and_then(|(bounds, error)| bounds.settle(depth, d.value, error)) {
            Some(lit) => {
                let state = (state & !(LIT | ANCESTOR)) | (u32::from(lit) * LIT) | EXACT | SETTLED;
                Shadow { state, missing: NONE, page }
            }
            None => Shadow { state, missing: d.missing, page },
        }
    }

    /// Answer at a place inside texel (x, y), `sub` 1/256 of a texel from its corner; in kinds `mh` and `mmh` the texel's own.
    pub fn continuous(&self, root: u32, x: u32, y: u32, sub: [u32; 2]) -> Answer {
        match self.kind {
            Kind::Vector => self.vector_continuous(root, x, y, sub),
            _ => self.texel(root, x, y, 0),
        }
    }

    /// Whether a texel lies outside the map.
    pub fn outside(&self, x: u32, y: u32) -> bool {
        x >> self.top() != 0 || y >> self.top() != 0
    }

    /// What the kernel `answer` makes of a query (x, y, level, depth rounded up): value, state, missing, page.
    pub fn answer(&self, root: u32, [x, y, level, depth]: [u32; 4]) -> [u32; 4] {
        if self.outside(x, y) {
            return [UNCOVERED, LIT | OUTSIDE | EXACT, NONE, NONE];
        }
        let d = self.texel(root, x, y, level);
        [d.value, d.state(depth) | self.stale(x, y), d.missing, d.page]
    }
}
