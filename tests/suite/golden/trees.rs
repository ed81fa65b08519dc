//! The trees of the golden files, and files made of them.

use std::sync::OnceLock;

use umbrage::format::index::{FORM_FLAT, SHARED};
use umbrage::format::kind::vector::{Line, Plane};
use umbrage::format::page::{FrameHead, TAG_FLAT};
use umbrage::format::{Kind, PageRecord, StructureRecord};
use umbrage::writer::container::{ContainerOptions, PageInput};

use crate::mmh_tree::{self, Piece};
use crate::tree::{Dice, ID, Kids, Naive, grow, pages, structure, write};
use crate::vector_tree::{self, Entry, Node};
use Naive::{Empty, Inner, Leaf};

/// A golden file and the trees of its structures, one for each root, where the kind has a layout.
pub struct Golden {
    pub name: &'static str,
    pub bytes: Vec<u8>,
    pub trees: Vec<Vec<Tree>>,
}

/// A tree of any kind.
pub enum Tree {
    Mh(Naive),
    Mmh(Piece),
    Vector(Node),
}

impl Tree {
    pub fn lookup(&self, log2: u8, x: u32, y: u32, level: u8) -> u32 {
        match self {
            Tree::Mh(tree) => tree.lookup(log2, x, y, level),
            Tree::Mmh(tree) => tree.lookup(log2, x, y, level),
            Tree::Vector(tree) => tree.lookup(log2, x, y, level),
        }
    }
}

/// All golden files, made once: tests of one process would use the same temporary folders.
pub fn all() -> &'static [Golden] {
    static ALL: OnceLock<Vec<Golden>> = OnceLock::new();
    ALL.get_or_init(make)
}

fn make() -> Vec<Golden> {
    let mut dice = Dice(31);
    let one = |name, tree, log2, cuts: &[u8], alignment| golden(name, alignment, vec![("sun", log2, cuts, vec![tree])]);
    vec![
        one("leaf", Leaf(123_456_789), 4, &[], 6),
        one("uncovered", Leaf(u32::MAX), 0, &[], 6),
        one("example", example(), 2, &[1], 6),
        one("nodes", nodes(), 5, &[], 6),
        one("pages", grow(&mut Dice(7), 4, true, 6), 4, &[3, 2], 8),
        golden(
            "two",
            2,
            vec![
                ("sun", 3, &[2], vec![grow(&mut Dice(2), 3, true, 6)]),
                ("lamp é", 2, &[], vec![grow(&mut Dice(3), 2, true, 8)]),
            ],
        ),
        golden("roots", 6, vec![("faces", 3, &[2], (11..14).map(|seed| grow(&mut Dice(seed), 3, true, 7)).collect())]),
        merged("mmh"),
        vectors("vector", vec![("sun", 4, vector())]),
        vectors(
            "vector-two",
            vec![("sun", 5, vector_tree::grow(&mut |n| dice.roll(n), 5, true, 6)), ("lamp", 0, single())],
        ),
        later(),
        cold(),
    ]
}

/// A golden file by name.
pub fn named(name: &str) -> &'static Golden {
    all().iter().find(|g| g.name == name).unwrap()
}

/// The tree of `spec/example.md`.
fn example() -> Naive {
    let kids = |k: [Option<Naive>; 4]| -> Kids { Box::new(k) };
    let first = Inner(900, kids([Some(Leaf(850)), None, None, Some(Leaf(870))]));
    let last = Empty(kids([Some(Leaf(700)), Some(Leaf(710)), None, Some(Leaf(720))]));
    Inner(1000, kids([Some(first), None, Some(Leaf(950)), Some(last)]))
}

/// Every order of the four types in a group; parents alternate between inner and empty nodes.
fn nodes() -> Naive {
    let mut next = 0;
    let mut value = move || {
        next += 10;
        next
    };
    let mut groups = Vec::new();
    for order in 0..24usize {
        let mut left = vec![0, 1, 2, 3];
        let types = [6, 2, 1, 1].map(|n| left.remove(order / n % left.len()));
        groups.push(types.map(|t| match t {
            0 => None,
            1 => Some(Leaf(value())),
            2 => Some(Inner(value(), Box::new([None, Some(Leaf(value())), None, None]))),
            _ => Some(Empty(Box::new([Some(Leaf(value())), None, None, Some(Leaf(value()))]))),
        }));
    }
    let mut level: Vec<Naive> = groups
        .into_iter()
        .enumerate()
        .map(|(i, g)| if i % 3 == 0 { Empty(Box::new(g)) } else { Inner(value(), Box::new(g)) })
        .collect();
    while level.len() > 1 {
        let mut above = Vec::new();
        let mut rest = level.into_iter();
        while let Some(first) = rest.next() {
            above.push(Inner(value(), Box::new([Some(first), rest.next(), rest.next(), rest.next()])));
        }
        level = above;
    }
    level.remove(0)
}

type Part<'a> = (&'static str, u8, &'a [u8], Vec<Naive>);

fn golden(name: &'static str, alignment_log2: u8, parts: Vec<Part<'_>>) -> Golden {
    let options = ContainerOptions { alignment_log2, ..ContainerOptions::new(ID) };
    let files: Vec<_> = parts
        .iter()
        .map(|(name, log2, cuts, trees)| {
            let pages = ordered(trees, *log2, cuts);
            let mut record = structure(name, Kind::Mh, *log2, pages.len());
            record.root_count = (trees.len() as u32).into();
            (record, pages)
        })
        .collect();
    let bytes = write(&format!("golden-{name}"), options, &files);
    Golden { name, bytes, trees: parts.into_iter().map(|p| p.3.into_iter().map(Tree::Mh).collect()).collect() }
}

/// Pages of several roots in level order, with what their records say of the whole tree.
fn ordered(trees: &[Naive], log2: u8, cuts: &[u8]) -> Vec<PageInput> {
    let roots: Vec<Vec<PageInput>> = trees.iter().map(|t| pages(t, log2, cuts)).collect();
    let first_child = |r: usize, page: usize| {
        1 + roots[r][..page].iter().map(|p| FrameHead::decode(&p.words).unwrap().child_refs as usize).sum::<usize>()
    };
    let mut order: Vec<(usize, usize)> = (0..roots.len()).map(|r| (r, 0)).collect();
    let mut next = 0;
    while let Some(&(r, page)) = order.get(next) {
        let children = FrameHead::decode(&roots[r][page].words).unwrap().child_refs as usize;
        order.extend((0..children).map(|c| (r, first_child(r, page) + c)));
        next += 1;
    }
    let finished = |(r, page): (usize, usize)| {
        let mut page = roots[r][page].clone();
        page.record.root = (r as u16).into();
        describe(&mut page.record, &trees[r], log2);
        page
    };
    order.into_iter().map(finished).collect()
}

/// Depths and stop error of a page. The interval of a texel is taken to be its value alone.
fn describe(r: &mut PageRecord, tree: &Naive, log2: u8) {
    let (x0, y0) = (r.origin_x.get(), r.origin_y.get());
    let values = |level: u8| {
        let side = 1u32 << (r.log2_x - level);
        (0..side * side).map(move |i| tree.lookup(log2, x0 + ((i % side) << level), y0 + ((i / side) << level), level))
    };
    let all: Vec<u32> = (0..=r.level_coarsest).flat_map(values).collect();
    let above = tree.lookup(log2, x0, y0, r.log2_x);
    let stop = values(0).map(|v| v.abs_diff(above)).max().unwrap();
    let is_root = r.level_coarsest == log2;
    (r.min_depth, r.max_depth) = ((*all.iter().min().unwrap()).into(), (*all.iter().max().unwrap()).into());
    r.stop_error = if is_root { u32::MAX } else { stop }.into();
}

/// Cold pages of every kind.
fn cold() -> Golden {
    const LOG2: u8 = 5;
    let tree = grow(&mut Dice(8), LOG2, true, 6);
    let plain = ordered(std::slice::from_ref(&tree), LOG2, &[4]);
    let (merged_tree, merged_record, merged_pages) = merged_parts("merged");
    let mut dice = Dice(33);
    let vector = ("vector", LOG2, vector_tree::grow(&mut |n| dice.roll(n), LOG2, true, 6));
    let (record, pages) = vector_pages(&vector);
    let parts =
        [(structure("plain", Kind::Mh, LOG2, plain.len()), plain), (merged_record, merged_pages), (record, pages)];
    let bytes = write("golden-cold", ContainerOptions::cold(ID), &parts);
    let trees = [Tree::Mh(tree), Tree::Mmh(merged_tree), Tree::Vector(vector.2)];
    Golden { name: "cold", bytes, trees: trees.into_iter().map(|t| vec![t]).collect() }
}

/// A file of kind `mmh`: a random tree that brings every type of node, child pages and two shared pages.
fn merged(name: &'static str) -> Golden {
    let (tree, record, pages) = merged_parts("sun");
    let bytes = write(&format!("golden-{name}"), ContainerOptions::new(ID), &[(record, pages)]);
    Golden { name, bytes, trees: vec![vec![Tree::Mmh(tree)]] }
}

fn merged_parts(name: &str) -> (Piece, StructureRecord, Vec<PageInput>) {
    const LOG2: u8 = 5;
    let (tree, mut pages, shared) = (1..)
        .map(|seed| {
            let mut dice = Dice(seed);
            let tree = mmh_tree::grow(&mut |n| dice.roll(n), LOG2);
            let (pages, shared) = mmh_tree::pages(&tree, LOG2, &[3]);
            (tree, pages, shared)
        })
        .find(|(_, pages, shared)| *shared == 2 && pages.iter().skip(1).any(|p| p.dependencies.len() == 2))
        .unwrap();
    // As if the interval of each texel were its value alone.
    for p in pages.iter_mut().skip(1).filter(|p| !p.record.is_shared()) {
        let r = p.record;
        let [x0, y0] = [r.origin_x.get(), r.origin_y.get()];
        let texels = (0..1u32 << r.log2_x).flat_map(|y| (0..1u32 << r.log2_x).map(move |x| (x0 + x, y0 + y)));
        let above = tree.lookup(LOG2, x0, y0, r.log2_x);
        p.record.stop_error = texels.map(|(x, y)| tree.lookup(LOG2, x, y, 0).abs_diff(above)).max().unwrap_or(0).into();
    }
    let record = mmh_tree::structure(name, LOG2, &pages, shared);
    (tree, record, pages)
}

/// Files of kind `vector`, one root a structure.
fn vectors(name: &'static str, parts: Vec<(&'static str, u8, Node)>) -> Golden {
    let files: Vec<_> = parts.iter().map(vector_pages).collect();
    let bytes = write(&format!("golden-{name}"), ContainerOptions::new(ID), &files);
    Golden { name, bytes, trees: parts.into_iter().map(|p| vec![Tree::Vector(p.2)]).collect() }
}

fn vector_pages((name, log2, tree): &(&'static str, u8, Node)) -> (StructureRecord, Vec<PageInput>) {
    let mut pages = vector_tree::pages(tree, *log2);
    // As if the interval of each texel were its value alone.
    for p in pages.iter_mut().skip(1) {
        let r = p.record;
        let texels = (0..1u32 << r.log2_x).flat_map(|y| (0..1u32 << r.log2_x).map(move |x| (x, y)));
        let away = |(x, y): (u32, u32)| {
            let (x, y) = (r.origin_x.get() + x, r.origin_y.get() + y);
            tree.lookup(*log2, x, y, 0).abs_diff(tree.lookup(*log2, x, y, r.log2_x))
        };
        p.record.stop_error = texels.map(away).max().unwrap_or(0).into();
    }
    (structure(name, Kind::Vector, *log2, pages.len()), pages)
}

/// A map of one texel and one plane.
fn single() -> Node {
    Node::leaf(Entry::Plane(Plane { offset: 77, gx: 1, gy: -1, shift: 0 })).proven()
}

/// Every class of entry, every type of node, child pages on two levels, inherited entries.
fn vector() -> Node {
    let constant = |v: u32| Entry::Constant(v);
    let plane = |offset: i64, gx: i32, gy: i32, shift: u8| Entry::Plane(Plane { offset, gx, gy, shift });
    let split = |m: i32, c: i64, axis: bool, a: &Entry, b: &Entry| {
        Entry::Split(Line { m, c, axis }, Box::new([a.clone(), b.clone()]))
    };
    let (roof, wall, ground) = (plane(2_000, 300, 40, 9), plane(70_000, -5, 1_000, 4), constant(90_000));
    let texel = 1i64 << 20;
    // A corner of a house: two edges, three depths; then an edge more.
    let edge = split(0x2000_0000, 2 * texel, false, &roof, &ground);
    let corner = split(-0x1000_0000, 9 * texel, true, &edge, &wall);
    let deep = split(0x0400_0001, texel / 3, false, &corner, &constant(u32::MAX));
    let mask = |selectors: u32| {
        let list = std::array::from_fn(|i| (selectors >> (2 * i) & 3) as u8);
        Entry::Mask(Box::new([roof.clone(), constant(2_500), ground.clone()]), list)
    };
    let raw = |shift: u32| Entry::Raw(Box::new(std::array::from_fn(|i| 3_000 + (((i as u32 * 7 + 3) % 19) << shift))));
    let uniform = Entry::Raw(Box::new([4_321; 16]));
    let texels = Node::empty([
        Some(Node::leaf(constant(2_600))),
        None,
        Some(Node::inner(plane(2_700, -1, 0, 2), [Some(Node::leaf(constant(2_640))), None, None, None]).proven().cut()),
        Some(Node::leaf(mask(0x0608_1421))),
    ]);
    let first = Node::inner(deep, [Some(Node::leaf(mask(0x1248_2100))), None, Some(Node::leaf(raw(3))), Some(texels)]);
    let finest = Node::inner(constant(2_222), [None, None, None, Some(Node::leaf(constant(2_223)))]);
    let low = Node::inner(roof.clone(), [None, Some(finest), None, None]);
    let second = Node::empty([Some(Node::leaf(edge)), None, Some(low), Some(Node::leaf(uniform))]);
    let third = Node::inner(
        constant(2_100),
        [Some(Node::leaf(raw(0)).proven()), Some(Node::leaf(mask(0x5555_0000))), Some(Node::leaf(wall.clone())), None],
    );
    Node::inner(roof, [Some(Node::leaf(corner).proven()), Some(first.cut()), Some(second.cut()), Some(third)])
}

/// Pages of kinds whose words are not defined yet, by hand: one of each way in which they differ from `mh`.
fn later() -> Golden {
    let page = |tag: u8, root_mask: u8, child_refs: u16, level: u8, body: &[u32]| {
        let head = FrameHead { tag, root_mask, child_refs, words: 2 + body.len() as u16, root_level: level };
        let mut record = PageRecord::zeroed();
        (record.log2_x, record.log2_y, record.level_coarsest) = (level, level, level);
        record.max_depth = u32::MAX.into();
        PageInput { words: [&head.encode()[..], body].concat(), record, dependencies: Vec::new() }
    };
    let shared = |mut p: PageInput| {
        p.record.page_type |= SHARED;
        (p.record.min_depth, p.record.max_depth) = (u32::MAX.into(), 0.into());
        (p.record.log2_x, p.record.log2_y) = (0, 0);
        p
    };
    let adaptive = page(Kind::Stack.tag(), 0, 0, 4, &[1, 0x4000_0000, 2, 0x4100_0000, 0x0010_FFF0]);
    let mut merged_page = page(Kind::MmhStack.tag(), 0, 0, 4, &[0x0000_02E4, 0x1000_0000, 0x0001_0000, 0xFFFF_FFFF]);
    merged_page.dependencies = vec![1, 2];
    let mut first = shared(page(Kind::MmhStack.tag(), 0, 0, 2, &[5, 0xFFFF_FFFB]));
    first.dependencies = vec![2];
    let second = shared(page(Kind::MmhStack.tag(), 0, 0, 0, &[7]));
    let mut stack = page(Kind::MhStack.tag(), 0, 1, 4, &[0x0000_E41B, 0x2000_0000, 1]);
    stack.record.log2_l = 4;
    let mut child = page(Kind::MhStack.tag(), 0, 0, 2, &[0x0000_5555, 1, 2, 3, 4, 5, 6, 7, 8]);
    (child.record.log2_x, child.record.log2_y, child.record.log2_l) = (3, 3, 3);
    (child.record.origin_x, child.record.origin_l) = (8.into(), 8.into());
    let mut quads = page(TAG_FLAT, 0, 0, 0, &[2, 0x3F80_0000, 0x4000_0000, 0, 1, 0x3F00_0000, 0xBF80_0000, 1, 0]);
    quads.record.page_type = FORM_FLAT;
    (quads.record.log2_x, quads.record.log2_y) = (4, 4);
    let record = |name, kind, pages: usize| -> StructureRecord { structure(name, kind, 4, pages) };
    // Room for a list of dependencies behind 2 records; the third lies in a second block.
    let mut merged = record("merged", Kind::MmhStack, 3);
    merged.shared_pages = 2.into();
    (merged.records_per_block, merged.index_block_log2) = (2.into(), 12);
    let parts = [
        (record("adaptive", Kind::Stack, 1), vec![adaptive]),
        (merged, vec![merged_page, first, second]),
        (record("stack", Kind::MhStack, 2), vec![stack, child]),
        (record("quads", Kind::Quads, 1), vec![quads]),
    ];
    let bytes = write("golden-later", ContainerOptions::new(ID), &parts);
    Golden { name: "later", bytes, trees: Vec::new() }
}
