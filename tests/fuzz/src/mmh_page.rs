//! Arbitrary words as an `mmh` page, or a sound page with changes: what is accepted has each word in one group, lookups
//! answer as a plain recursion over the groups does, and what is said of child pages and of shared groups is what that
//! recursion meets; sound pages are accepted.

use std::collections::{HashMap, HashSet};

use umbrage_format::index::SHARED;
use umbrage_format::kind::mh::{Mask, NodeType};
use umbrage_format::kind::mmh::{Children, Node, References, check, links, shared_groups};
use umbrage_format::page::{FrameHead, PageContext, check_frame};
use umbrage_format::projection::UNCOVERED;
use umbrage_format::{Kind, PageRecord};
use umbrage_reader::query::mmh::{PageView, descend};

use crate::input::Input;
use crate::mmh_tree::{grow, pages};
use crate::tree::structure;

/// Ordinals of the dependencies: no page has them here.
const FIRST_SHARED: u32 = 100;

/// Where a walk by the text ends: value, word of its node; the page that it misses.
fn naive(page: &[u32], mask: Mask, level: u8, [x, y, to]: [u32; 3]) -> (u32, u32, Option<u32>) {
    let (mut mask, mut at, mut sum, mut value, mut word) = (mask, 2usize, 0u32, UNCOVERED, 0);
    for l in (0..=u32::from(level)).rev() {
        let c = (x >> l & 1) | (y >> l & 1) << 1;
        let before: u32 = (0..c).map(|i| mask.child(i).words()).sum();
        let (kind, node) = (mask.child(c), at + before as usize);
        let read = |i: usize| page.get(i).copied().unwrap_or(0);
        match kind {
            NodeType::None => break,
            NodeType::Leaf | NodeType::Inner => {
                sum = sum.wrapping_add(read(node + usize::from(kind == NodeType::Inner)));
                (value, word) = (sum, node as u32);
            }
            NodeType::Empty => {}
        }
        if kind == NodeType::Leaf || l <= to {
            break;
        }
        let below = Node::decode(read(node));
        match below.children {
            Children::Here(first) => (mask, at) = (below.mask, first.into()),
            Children::Page(child) => return (value, word, Some(2 + u32::from(child))),
            Children::Shared(d, _) => return (value, word, Some(FIRST_SHARED + u32::from(d))),
        }
    }
    (value, word, None)
}

/// Every group that the words lead to from one, by its first word: its mask, and how many nodes lead to it.
fn reach(page: &[u32], start: u32, mask: Mask, groups: &mut HashMap<u32, (Mask, u32)>) {
    let known = groups.entry(start).or_insert((mask, 0));
    assert_eq!(known.0, mask, "one group, two masks");
    known.1 += 1;
    if known.1 > 1 {
        return;
    }
    for c in (0..4).filter(|c| mask.child(*c).has_children()) {
        let node = Node::decode(page[(start + mask.words_before(c)) as usize]);
        if let Children::Here(first) = node.children {
            reach(page, first.into(), node.mask, groups);
        }
    }
}

/// The rest of an input behind the bytes for the map's level and the page's: one byte that says what is made of it, then
/// words, or numbers of a tree with changes of 5 bytes behind them.
pub fn run(log2: u8, place: u8, mut input: Input) {
    let how = input.byte();
    let changes = if how & 1 == 0 { 0 } else { usize::from(how >> 2 & 7).min(input.0.len() / 5) };
    let (mut page, mut record) = (Vec::new(), PageRecord::zeroed());
    if how & 1 == 0 {
        while !input.is_empty() && page.len() < 16384 {
            page.push(input.word());
        }
        if page.len() < 2 {
            return;
        }
        let (shared, root) = (how & 2 != 0, place & 0x80 == 0);
        let level = if shared {
            0
        } else if root {
            log2
        } else {
            place & 31
        };
        let dependencies = if shared { 0 } else { how >> 2 };
        page[0] = page[0] & !0xFF | u32::from(Kind::Mmh.tag());
        page[1] = page.len() as u32 | u32::from(level) << 16;
        (record.level_coarsest, record.dep_count) = (level, u16::from(dependencies).into());
        let side = if root { level } else { level + 1 };
        if shared {
            (record.page_type, record.min_depth) = (SHARED, u32::MAX.into());
            page[0] &= 0xFF;
        } else {
            (record.log2_x, record.log2_y, record.max_depth) = (side, side, u32::MAX.into());
        }
    } else {
        let log2 = log2.clamp(1, 6);
        let mut edits = Input(&input.0[input.0.len() - 5 * changes..]);
        input.0 = &input.0[..input.0.len() - 5 * changes];
        let which = input.byte();
        let tree = grow(&mut |n| input.word() % n, log2);
        let (mut all, _) = pages(&tree, log2, &[log2 / 2]);
        let made = all.swap_remove(usize::from(which) % all.len());
        (page, record) = (made.words, made.record);
        record.dep_count = (made.dependencies.len() as u16).into();
        for _ in 0..changes {
            let (at, kind, bits) = (usize::from(edits.pair()), edits.byte(), edits.pair());
            let count = page.len() - 2;
            if count > 0 {
                let word = &mut page[2 + at % count];
                *word = match kind % 3 {
                    0 => *word ^ 1 << (bits & 31),
                    1 => *word & 0xFFFF | u32::from(bits) << 16,
                    _ => *word & 0xFF | u32::from(bits & 0xFF) << 8 | *word & 0xFFFF_0000,
                };
            }
        }
        if changes > 0 && !record.is_shared() {
            (record.min_depth, record.max_depth) = (0.into(), u32::MAX.into());
        }
        return hold(log2, &page, record, changes == 0);
    }
    hold(log2, &page, record, false);
}

fn hold(log2: u8, page: &[u32], mut record: PageRecord, sound: bool) {
    let head = FrameHead::decode(page).expect("two words");
    (record.hot_words, record.child_count, record.first_child) = (head.words.into(), head.child_refs.into(), 2.into());
    let mut structure = structure("s", Kind::Mmh, log2, 200);
    structure.shared_pages = 100.into();
    let (shared, level) = (record.is_shared(), record.level_coarsest);
    let is_root = !shared && level == log2 && head.root_mask < 3;
    let ordinal = if shared { FIRST_SHARED } else { u32::from(!is_root) };
    let dependencies: Vec<u32> = (0..u32::from(record.dep_count.get())).map(|d| FIRST_SHARED + d).collect();
    let view = PageView { words: page, first_child: 2, dependencies: &dependencies };
    // A page that is not the root's is entered in its own right.
    let lookup = |x, y, l| descend(|o| (o == 0).then_some(view), 0, level, x, y, l);
    for (x, y) in [(0, 0), (u32::MAX, u32::MAX), (0x5555_5555, 0xAAAA_AAAA), (7, 3)] {
        for l in [0, level / 2, level, 255] {
            lookup(x, y, l);
        }
    }
    // The index would have the level that the check asks for: whatever it is, it is one of these.
    let finest = if sound { record.level_finest..=record.level_finest } else { 0..=level };
    let mut counts = None;
    for finest in finest {
        record.level_finest = finest;
        let cx = PageContext { structure: 0, ordinal, page: &record, record: &structure };
        if check_frame(page, &cx).is_err() {
            return;
        }
        let checked = check(page, &head, &cx);
        assert!(!sound || checked.is_ok(), "refused, and nothing is wrong with it: {checked:?}");
        if let Ok(c) = checked {
            assert!(counts.replace(c).is_none(), "one finest level is right");
            break;
        }
    }
    let Some(counts) = counts else { return };
    let cx = PageContext { structure: 0, ordinal, page: &record, record: &structure };
    // What leads to groups: the root group, or every group that a pass over the page finds.
    let mut groups = HashMap::new();
    if shared {
        shared_groups(page, |at, mask, height| {
            assert!((1..=25).contains(&height));
            reach(page, at.into(), mask, &mut groups);
        });
    } else {
        reach(page, 2, Mask(head.root_mask), &mut groups);
    }
    let first = if shared { 3 + page[2].div_ceil(4) } else { 2 };
    let words: HashSet<u32> = groups.iter().flat_map(|(at, (mask, _))| *at..at + mask.words()).collect();
    assert_eq!(words.len(), groups.values().map(|g| g.0.words()).sum::<u32>() as usize, "groups overlap");
    assert_eq!(words.len(), page.len() - first as usize, "words without a group");
    let kinds = |kind| groups.values().map(|g| (0..4).filter(|c| g.0.child(*c) == kind).count() as u32).sum::<u32>();
    let found = [NodeType::Leaf, NodeType::Inner, NodeType::Empty].map(kinds);
    assert_eq!([counts.leaves, counts.inner, counts.empty], found);
    let mut references = References::default();
    if shared {
        assert!(references.check(page, &cx).is_ok(), "nobody said anything of it");
        return;
    }
    let mut said = HashSet::new();
    links(page, &head, &cx, Some(0), |child, link| {
        assert!(said.insert(child) && link.level < level);
        // The way there by texels ends at this page, with this value above it.
        let (value, _, missing) = naive(page, Mask(head.root_mask), level, [link.x, link.y, 0]);
        assert_eq!(missing, Some(2 + u32::from(child)));
        assert!(link.inherited == Some(value) || value == UNCOVERED);
    });
    assert_eq!(said.len(), usize::from(head.child_refs));
    references.note(page, &head, &cx, &dependencies, Some(0));
    for i in 0..64u32 {
        let [x, y] = [i.wrapping_mul(0x9E37_79B9), i.wrapping_mul(0x85EB_CA6B)].map(|v| v >> 7 & ((2 << level) - 1));
        for l in [0, i as u8 % 8] {
            let (value, word, missing) = naive(page, Mask(head.root_mask), level, [x, y, l.into()]);
            let d = lookup(x, y, l);
            assert_eq!((d.value, d.word, d.missing), (value, word, missing), "{x} {y} {l}");
        }
    }
}
