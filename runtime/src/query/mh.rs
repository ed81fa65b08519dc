//! Kind `mh`: twin of `shader/query/mh.wgsl`, and the numbers that both sides use.

use umbrage_format::kind::mh::{Children, Mask, Node, NodeType, ROOT_GROUP, child_of};
use umbrage_format::page::FrameHead;
use umbrage_format::projection::UNCOVERED;
use umbrage_format::structure::MAX_LOG2_RESOLUTION;

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
/// Word of the answering node in its page, 17 bits from here.
pub const WORD_SHIFT: u32 = 15;

/// Where a walk ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Answer {
    /// The stored depth; [`UNCOVERED`] where there was no value.
    pub value: u32,
    /// Level of the node that holds it.
    pub level: u32,
    /// Page of that node.
    pub page: u32,
    /// Word of that node in its page.
    pub word: u32,
    /// The page that the walk needed and did not get, or [`NONE`].
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

/// The device's buffers as words.
#[derive(Clone, Copy, Debug)]
pub struct Pool<'a> {
    /// All slots.
    pub words: &'a [u32],
    /// For each page its first word, or [`NOT_RESIDENT`], and its first child.
    pub table: &'a [[u32; 2]],
    /// Levels below the root, at most 24.
    pub log2_resolution: u8,
}

struct Page<'a> {
    words: &'a [u32],
    first_child: u32,
}

impl Page<'_> {
    fn word(&self, at: u32) -> u32 {
        self.words.get(at as usize).copied().unwrap_or(0)
    }

    fn root_mask(&self) -> Mask {
        let head = FrameHead::decode(&[self.word(0), self.word(1)]);
        Mask(head.map_or(0, |h| h.root_mask))
    }
}

impl<'a> Pool<'a> {
    /// A page by its ordinal; whatever table and frame say, its words lie in the pool.
    fn page(&self, ordinal: u32) -> Option<Page<'a>> {
        let &[at, first_child] = self.table.get(ordinal as usize)?;
        let room = self.words.get(at as usize..).filter(|r| !r.is_empty())?;
        let words = FrameHead::decode(room).map_or(0, |h| usize::from(h.words));
        Some(Page { words: &room[..words.min(room.len())], first_child })
    }

    /// Walks from root `root` to texel (x, y) at `level`.
    pub fn mh(&self, root: u32, x: u32, y: u32, level: u32) -> Answer {
        let log2 = u32::from(self.log2_resolution);
        let mut d = Answer { value: UNCOVERED, level: log2, page: root, word: 0, missing: NONE };
        let Some(mut page) = self.page(root) else { return Answer { missing: root, ..d } };
        let mut ordinal = root;
        let (mut mask, mut group) = (page.root_mask(), u32::from(ROOT_GROUP));
        let mut at_level = self.log2_resolution.min(MAX_LOG2_RESOLUTION);
        for _ in 0..MAX_STEPS {
            let c = child_of(x, y, at_level);
            let kind = mask.child(c);
            if kind == NodeType::None {
                break;
            }
            let at = group + mask.words_before(c);
            let word = page.word(at);
            let answer = |value| Answer { value, level: at_level.into(), page: ordinal, word: at, missing: NONE };
            if kind == NodeType::Leaf {
                d = answer(word);
                break;
            }
            if kind == NodeType::Inner {
                d = answer(page.word(at + 1));
            }
            if u32::from(at_level) <= level {
                break;
            }
            let node = Node::decode(word);
            match node.children {
                Children::Here(first) => (mask, group) = (node.mask, first.into()),
                Children::Page(place) => {
                    let child = page.first_child.saturating_add(place.into());
                    let Some(next) = self.page(child) else {
                        d.missing = child;
                        break;
                    };
                    (page, ordinal) = (next, child);
                    (mask, group) = (page.root_mask(), u32::from(ROOT_GROUP));
                }
            }
            at_level -= 1;
        }
        d
    }

    /// Whether a texel lies outside the map.
    pub fn outside(&self, x: u32, y: u32) -> bool {
        let log2 = self.log2_resolution.min(MAX_LOG2_RESOLUTION);
        x >> log2 != 0 || y >> log2 != 0
    }

    /// What the kernel `answer` makes of a query (x, y, level, depth rounded up): value, state, missing, page.
    pub fn answer(&self, root: u32, [x, y, level, depth]: [u32; 4]) -> [u32; 4] {
        if self.outside(x, y) {
            return [UNCOVERED, LIT | OUTSIDE | EXACT, NONE, NONE];
        }
        let d = self.mh(root, x, y, level);
        [d.value, d.state(depth), d.missing, d.page]
    }
}
