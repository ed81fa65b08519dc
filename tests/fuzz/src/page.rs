//! Arbitrary words as an `mh` page: `check` accepts exactly what a naive walk accepts, with the same counts; and a
//! lookup finds every node that was counted, at its word, with its value.

use std::collections::HashSet;

use umbrage_format::kind::mh::{Children, Mask, Node, NodeType, PageCounts, check, links};
use umbrage_format::page::{FrameHead, PageContext, check_frame};
use umbrage_format::{Kind, PageRecord};
use umbrage_reader::query::mh::{PageView, descend};

use crate::input::Input;
use crate::tree::structure;

/// A node as the naive walk meets it.
struct Found {
    kind: NodeType,
    word: u32,
    level: u8,
    x: u32,
    y: u32,
}

/// What the naive walk found.
#[derive(Default)]
struct Walk {
    nodes: Vec<Found>,
    words: HashSet<u32>,
    refs: HashSet<u16>,
}

impl Walk {
    /// Every node of a group and below; `None` once something is not as it should be.
    fn group(&mut self, page: &[u32], head: &FrameHead, mask: Mask, start: u32, at: [u32; 2], level: u8) -> Option<()> {
        let mut word = start;
        for c in 0..4 {
            let kind = mask.child(c);
            let (x, y) = (at[0] + ((c & 1) << level), at[1] + ((c >> 1) << level));
            for w in word..word + kind.words() {
                ((w as usize) < page.len() && self.words.insert(w)).then_some(())?;
            }
            if kind != NodeType::None {
                self.nodes.push(Found { kind, word, level, x, y });
            }
            if kind.has_children() {
                let code = page[word as usize];
                let node = Node::decode(code);
                (code >> 8 & 0xFF <= 1 && node.mask.0 != 0 && level > 0).then_some(())?;
                match node.children {
                    Children::Page(p) => (p < head.child_refs && self.refs.insert(p)).then_some(())?,
                    Children::Here(first) => {
                        (u32::from(first) > word).then_some(())?;
                        self.group(page, head, node.mask, first.into(), [x, y], level - 1)?;
                    }
                }
            }
            word += kind.words();
        }
        Some(())
    }

    /// Value of a node that has one.
    fn value(page: &[u32], n: &Found) -> u32 {
        page[n.word as usize + usize::from(n.kind == NodeType::Inner)]
    }

    fn counts(&self, page: &[u32], root_level: u8) -> PageCounts {
        let count = |kind| self.nodes.iter().filter(|n| n.kind == kind).count() as u32;
        let values = || self.nodes.iter().filter(|n| n.kind.has_value()).map(|n| Self::value(page, n));
        PageCounts {
            leaves: count(NodeType::Leaf),
            inner: count(NodeType::Inner),
            empty: count(NodeType::Empty),
            min: values().min().unwrap_or(u32::MAX),
            max: values().max().unwrap_or(0),
            level_finest: self.nodes.iter().map(|n| n.level).min().unwrap_or(root_level).min(root_level),
        }
    }
}

/// One input: a byte for the level of the map, one for the page's, then the words, frame included; with bit 6 of the
/// second byte a tree of kind `vector` and changes to one of its pages, with bit 5 a page of kind `mmh`.
pub fn run(data: &[u8]) {
    let mut input = Input(data);
    let (log2, place) = ((input.below(25)) as u8, input.byte());
    if place & 0x40 != 0 {
        return crate::vector_page::run(log2.min(7), place, input);
    }
    if place & 0x20 != 0 {
        return crate::mmh_page::run(log2, place, input);
    }
    let mut page: Vec<u32> = Vec::new();
    while !input.is_empty() && page.len() < 16384 {
        page.push(input.word());
    }
    if page.len() < 2 {
        return;
    }
    // What an honest index would say of the page; the rest of the frame is the input's.
    let root = place & 0x80 == 0;
    let level = if root { log2 } else { place & 31 };
    page[0] = page[0] & !0xFF | u32::from(Kind::Mh.tag());
    page[1] = page.len() as u32 | u32::from(level) << 16;
    let structure = structure("s", Kind::Mh, log2, 2);
    let head = FrameHead::decode(&page).expect("two words");
    let mut record = PageRecord::zeroed();
    (record.hot_words, record.child_count) = (head.words.into(), head.child_refs.into());
    (record.level_coarsest, record.first_child) = (level, 2.into());
    let side = if root { level } else { level + 1 };
    (record.log2_x, record.log2_y) = (side, side);
    record.max_depth = u32::MAX.into();

    let mut walk = Walk::default();
    let mask = Mask(head.root_mask);
    let shape = if root { matches!(mask.0, 1 | 2) } else { mask.0 != 0 && level < log2 };
    let sound = shape
        && walk.group(&page, &head, mask, 2, [0, 0], level).is_some()
        && walk.words.len() + 2 == page.len()
        && walk.refs.len() == usize::from(head.child_refs);
    let expected = walk.counts(&page, level);
    record.level_finest = expected.level_finest;

    let cx = PageContext { structure: 0, ordinal: u32::from(!root), page: &record, record: &structure };
    check_frame(&page, &cx).expect("a frame that was made to fit");
    let counts = check(&page, &head, &cx);
    // Ends on any words, and names no place outside the page.
    let lookup = |x, y, l| {
        let view = PageView { words: &page, first_child: 2, dependencies: &[] };
        // A page that is not the root's is entered in its own right.
        descend(|o| (o == 0).then_some(view), 0, level, x, y, l)
    };
    for (x, y) in [(0, 0), (u32::MAX, u32::MAX), (0x5555_5555, 0xAAAA_AAAA), (log2.into(), place.into())] {
        for l in [0, level / 2, level, 255] {
            lookup(x, y, l);
        }
    }
    let Ok(counts) = counts else {
        assert!(!sound, "refused, and nothing is wrong with it: {:?}", check(&page, &head, &cx));
        return;
    };
    assert!(sound, "accepted, and not sound");
    assert_eq!(counts, expected);
    // Only now: on a page that was not checked the same walk may take 4^25 steps.
    let mut said = HashSet::new();
    links(&page, &head, &cx, None, |child, _| {
        said.insert(child);
    });
    assert_eq!(said, walk.refs);
    for n in &walk.nodes {
        let d = lookup(n.x, n.y, n.level);
        assert!((d.word as usize) < page.len());
        if n.kind.has_value() {
            assert_eq!((d.word, d.level, d.value, d.missing), (n.word, n.level, Walk::value(&page, n), None));
        } else {
            assert!((d.level > n.level || d.word == 0) && d.missing.is_none());
        }
        // Anywhere below the node the answer is its own or a finer one, never one from above it.
        if n.kind.has_value() {
            let last = (1u32 << n.level) - 1;
            for (x, y) in [(n.x, n.y), (n.x + last, n.y + last)] {
                assert!(lookup(x, y, 0).level <= n.level);
            }
        }
    }
}
