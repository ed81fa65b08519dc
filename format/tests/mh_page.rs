//! One `mh` page written by hand, word by word, and every way to break it.
//!
//! A map of 4 x 4 texels: the root (value 100) has a leaf (50), an inner node (60) with two texels (1, 2), and an empty
//! node whose texels lie in a child page.

use umbrage_format::kind::mh::{Children, Link, Mask, Node, NodeType, PageCounts, check, check_link, links};
use umbrage_format::page::{FrameHead, PageContext, check_frame};
use umbrage_format::{Kind, PageRecord, StructureRecord};

use NodeType::{Empty, Inner, Leaf, None as No};

fn node(types: [NodeType; 4], children: Children) -> u32 {
    Node { mask: Mask::new(types), children }.encode()
}

struct Sample {
    words: Vec<u32>,
    page: PageRecord,
    record: StructureRecord,
}

impl Sample {
    fn new() -> Self {
        let words = vec![
            0x0001_0201, // tag mh, root mask: child 0 inner, 1 child page
            0x0002_000A, // 10 words, root level 2
            node([Leaf, Inner, Empty, No], Children::Here(4)),
            100,
            50,
            node([Leaf, No, No, Leaf], Children::Here(8)),
            60,
            node([Leaf, Leaf, No, No], Children::Page(0)),
            1,
            2,
        ];
        let mut page = PageRecord::zeroed();
        (page.hot_words, page.child_count) = (10.into(), 1.into());
        (page.log2_x, page.log2_y, page.level_coarsest) = (2, 2, 2);
        (page.min_depth, page.max_depth) = (1.into(), 100.into());
        let mut record = StructureRecord::zeroed();
        (record.kind, record.log2_resolution) = (Kind::Mh.code().into(), 2);
        (record.root_count, record.page_count) = (1.into(), 2.into());
        Self { words, page, record }
    }

    fn check(&self) -> Result<PageCounts, &'static str> {
        let cx = PageContext { structure: 0, ordinal: 0, page: &self.page, record: &self.record };
        let checked = check_frame(&self.words, &cx).and_then(|head| check(&self.words, &head, &cx));
        checked.map_err(|e| e.rule.id())
    }
}

#[test]
fn the_words_are_as_the_layout_says() {
    let sample = Sample::new();
    assert_eq!(sample.words[2], 0x0004_0039);
    assert_eq!(sample.words[7], 0x0000_0105);
    let counts = PageCounts { leaves: 3, inner: 2, empty: 1, min: 1, max: 100, level_finest: 0 };
    assert_eq!(sample.check(), Ok(counts));
    let head = FrameHead::decode(&sample.words).unwrap();
    assert_eq!(head.encode(), sample.words[..2]);
    let cx = PageContext { structure: 0, ordinal: 0, page: &sample.page, record: &sample.record };
    let mut seen = Vec::new();
    links(&sample.words, &head, &cx, None, |child, link| seen.push((child, link)));
    let mask = Mask::new([Leaf, Leaf, No, No]);
    // Through the empty node from the root node.
    let inherited = Some(100);
    assert_eq!(seen, [(0, Link { root: 0, depths: (1, 100), inherited, mask, level: 0, x: 0, y: 2 })]);
}

#[test]
fn every_breach_is_named() {
    let word = |at: usize, value: u32| move |s: &mut Sample| s.words[at] = value;
    type Change = Box<dyn Fn(&mut Sample)>;
    let breaches: Vec<(&str, Change)> = vec![
        ("page.tag", Box::new(word(0, 0x0001_0202))),
        ("page.children", Box::new(word(0, 0x0002_0201))),
        ("page.length", Box::new(word(1, 0x0002_000B))),
        ("page.length", Box::new(|s| s.words.truncate(9))),
        ("page.length", Box::new(|s| s.words.clear())),
        ("page.level", Box::new(word(1, 0x0001_000A))),
        ("page.flags", Box::new(word(1, 0x0102_000A))),
        ("mh.plain", Box::new(|s| s.page.page_type = umbrage_format::index::SHARED)),
        ("mh.plain", Box::new(|s| s.page.dep_count = 1.into())),
        ("mh.root", Box::new(word(0, 0x0001_0301))),
        ("mh.root", Box::new(|s| s.record.log2_resolution = 3)),
        ("mh.footprint", Box::new(|s| s.page.log2_x = 1)),
        ("mh.footprint", Box::new(|s| s.page.log2_l = 1)),
        ("mh.footprint", Box::new(|s| s.page.origin_l = 1.into())),
        ("mh.bounds", Box::new(word(5, node([Leaf, No, No, Leaf], Children::Here(9))))),
        ("mh.bounds", Box::new(word(5, node([Leaf, No, No, Leaf], Children::Here(u16::MAX))))),
        ("mh.overlap", Box::new(word(5, node([Leaf, No, No, Leaf], Children::Here(6))))),
        ("mh.place", Box::new(word(7, 0x0000_0205))),
        ("mh.childless", Box::new(word(5, 0x0008_0000))),
        ("mh.order", Box::new(word(5, node([Leaf, No, No, Leaf], Children::Here(5))))),
        ("mh.depth", Box::new(word(5, node([Inner, No, No, No], Children::Here(8))))),
        ("mh.reference", Box::new(word(7, node([Leaf, Leaf, No, No], Children::Page(1))))),
        ("mh.reference", Box::new(word(5, node([Leaf, Leaf, No, No], Children::Page(0))))),
        ("mh.hole", Box::new(word(5, node([Leaf, No, No, No], Children::Here(8))))),
        ("mh.levels", Box::new(|s| s.page.level_finest = 1)),
        ("mh.values", Box::new(|s| s.page.max_depth = 99.into())),
        ("mh.values", Box::new(|s| s.page.min_depth = 2.into())),
    ];
    for (i, (rule, change)) in breaches.iter().enumerate() {
        let mut sample = Sample::new();
        change(&mut sample);
        assert_eq!(sample.check(), Err(*rule), "breach {i}");
    }
}

#[test]
fn a_child_that_no_node_refers_to_is_found() {
    let mut sample = Sample::new();
    sample.words[0] = 0x0002_0201;
    sample.page.child_count = 2.into();
    assert_eq!(sample.check(), Err("mh.reference"));
}

/// The child page that the sample refers to, and every way in which its depths may lie.
#[test]
fn depths_of_a_child_page_hold_what_it_can_answer() {
    let sample = Sample::new();
    let link =
        |types, inherited| Link { root: 0, depths: (1, 100), inherited, mask: Mask::new(types), level: 0, x: 0, y: 2 };
    let rule = |link: Link, min: u32, max: u32| {
        let mut page = sample.page;
        (page.origin_y, page.min_depth, page.max_depth) = (2.into(), min.into(), max.into());
        let root_mask = link.mask.0;
        let head = FrameHead { tag: 1, root_mask, child_refs: 0, words: 4, root_level: 0 };
        let cx = PageContext { structure: 0, ordinal: 1, page: &page, record: &sample.record };
        check_link(&link, &head, &cx).err().map(|e| e.rule.id())
    };
    let full = [Leaf, Leaf, Inner, Leaf];
    for types in [[Leaf, Leaf, No, Leaf], [Empty, Leaf, Inner, Leaf], full] {
        let inherits = if types == full { None } else { Some("mh.depths") };
        assert_eq!(rule(link(types, Some(60)), 1, 100), None);
        assert_eq!(rule(link(types, Some(60)), 60, 60), None);
        assert_eq!(rule(link(types, Some(60)), 61, 100), inherits);
        assert_eq!(rule(link(types, Some(60)), 1, 59), inherits);
        // Where the value is not known, it is not held against the page.
        assert_eq!(rule(link(types, None), 1, 59), None);
        assert_eq!(rule(link(types, Some(60)), 0, 100), Some("mh.depths"));
        assert_eq!(rule(link(types, Some(60)), 1, 101), Some("mh.depths"));
    }
    assert_eq!(rule(Link { root: 1, ..link(full, None) }, 0, 100), Some("mh.link"));
}
