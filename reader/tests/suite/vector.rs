//! Kind `vector` through container, reader and walk: what was written answers as the naive tree does, at every texel of
//! every level and inside texels, lazily and resident alike; whatever is missing is answered from above.

use umbrage_format::Kind;
use umbrage_format::kind::vector::{Layout, Line, Plane, bounds, nodes};
use umbrage_format::projection::UNCOVERED;
use umbrage_reader::query::Map;
use umbrage_reader::query::vector::{PageView, continuous, descend};
use umbrage_reader::{Container, ReaderError};
use umbrage_writer::container::{ContainerOptions, ContainerWriter};

use crate::tree::{Dice, Folder, ID, open, structure, write};
use crate::vector_tree::{Entry, Node, entry, grow, pages};

fn rolls(seed: u64) -> impl FnMut(u32) -> u32 {
    let mut dice = Dice(seed);
    move |n| dice.roll(n)
}

fn file(test: &str, tree: &Node, log2: u8) -> Container {
    let pages = pages(tree, log2);
    open(write(test, ContainerOptions::new(ID), &[(structure("sun", Kind::Vector, log2, pages.len()), pages)])).unwrap()
}

#[test]
fn random_trees_answer_as_the_naive_tree() {
    for (seed, log2, bushy) in [(1, 0, 0), (2, 1, 8), (3, 4, 6), (4, 6, 7), (5, 6, 8), (6, 10, 6), (7, 9, 7)] {
        let mut dice = Dice(seed);
        let tree = grow(&mut |n| dice.roll(n), log2, true, bushy);
        let file = file(&format!("vector-{seed}"), &tree, log2);
        let summary = file.verify(|e| panic!("{e}"));
        assert_eq!((summary.faults, summary.unsupported), (0, 0));
        let map = Map::new(file.structure(0).unwrap()).unwrap();
        let resident = map.preload().unwrap();
        for level in 0..=log2 + 1 {
            // Each square once, by a texel that moves through it.
            let coarse = level.min(log2);
            for i in 0..1u32 << (2 * (log2 - coarse)) {
                let (cx, cy) = (i % (1 << (log2 - coarse)), i >> (log2 - coarse));
                let (x, y) =
                    ((cx << coarse) + i % (1 << coarse), (cy << coarse) + (1 << coarse) - 1 - i % (1 << coarse));
                let expected = tree.lookup(log2, x, y, level);
                let answer = map.texel(x, y, level).unwrap();
                assert_eq!(answer.value, expected, "seed {seed}: texel {x} {y} level {level}");
                assert!(answer.level >= coarse);
                assert_eq!(resident.value(x, y, level), expected, "seed {seed}: texel {x} {y} level {level}");
            }
        }
        for _ in 0..3000 {
            let (x, y) = (dice.roll(1 << log2), dice.roll(1 << log2));
            let sub = [dice.roll(256) as u8, dice.roll(256) as u8];
            let expected = tree.continuous(log2, x, y, sub);
            assert_eq!(map.continuous(x, y, sub).unwrap().value, expected, "seed {seed}: {x} {y} {sub:?}");
            assert_eq!(resident.continuous(x, y, sub), expected, "seed {seed}: {x} {y} {sub:?}");
        }
        assert_eq!(
            (resident.value(1 << log2, 0, 0), resident.continuous(0, 1 << log2, [0; 2])),
            (UNCOVERED, UNCOVERED)
        );
        assert!(matches!(map.continuous(1 << log2, 0, [0; 2]), Err(ReaderError::OutOfRange { .. })));
    }
}

/// Any slope, power, offset and line that a file can hold, on maps of every size: products that need more than 64 bits
/// among them.
#[test]
fn the_largest_numbers_answer_as_the_naive_tree() {
    let mut dice = Dice(31);
    let mut any = |bits: u32| {
        let bits = if dice.roll(3) == 0 { dice.roll(bits) + 1 } else { bits };
        (i64::from(dice.roll(u32::MAX)) << 32 | i64::from(dice.roll(u32::MAX))) >> (64 - bits)
    };
    for round in 0..120 {
        let log2 = [3, 14, 20, 24][round % 4];
        let mut plane = || {
            if any(1) == 0 {
                let (gx, gy) = (any(27) as i32, any(27) as i32);
                return Entry::Plane(Plane { offset: any(36), gx, gy, shift: 8 + (any(32) & 31) as u8 });
            }
            let (gx, gy) = (any(25) as i32, any(25) as i32);
            Entry::Plane(Plane { offset: any(39), gx, gy, shift: (any(32) & 63) as u8 })
        };
        let planes: [Entry; 16] = std::array::from_fn(|_| plane());
        let mut planes = planes.into_iter();
        let mut side = || planes.next().unwrap_or(Entry::Constant(1));
        let mut split = |a, b| {
            // Through the middle of the map, or anywhere.
            let (m, axis) = (any(32) as i32, any(1) == 0);
            let middle = (1i64 << (log2 + 19)) - ((i64::from(m) << (log2 + 7)) >> 19);
            let c = if any(2) == 0 { any(48) } else { middle + (any(48) >> 20) };
            let line = Line { m, c, axis };
            // the page's lines short, or of any size
            let c = c.clamp(i32::MIN.into(), i32::MAX.into());
            let line = if round % 8 < 4 { line } else { Line { m: m & !1, c, axis } };
            Entry::Split(line, Box::new([a, b]))
        };
        let deep = split(side(), side());
        let deeper = split(deep, side());
        let kids = [side(), deeper, split(side(), side()), split(side(), side())];
        let mask = Entry::Mask(Box::new([side(), side(), side()]), [0, 1, 2, 0, 1, 2, 0, 1, 2, 0, 1, 2, 0, 1, 2, 1]);
        let mut nodes = kids.map(|e| Some(Node::leaf(e).proven()));
        if round % 3 == 0 {
            nodes[0] = Some(Node::inner(mask, [Some(Node::leaf(side())), None, None, None]).cut());
        }
        let tree = Node::inner(split(side(), side()), nodes);
        let tree = if round % 2 == 0 { tree.cut() } else { tree };
        let map = Map::new(file(&format!("vector-large-{round}"), &tree, log2).structure(0).unwrap()).unwrap();
        let resident = map.preload().unwrap();
        for _ in 0..200 {
            let [x, y] = [(); 2].map(|()| (any(32) as u32) & ((1 << log2) - 1));
            for level in [0, 1, 2, log2 / 2, log2 - 1, log2] {
                let expected = tree.lookup(log2, x, y, level);
                assert_eq!(map.texel(x, y, level).unwrap().value, expected, "round {round}: {x} {y} level {level}");
                assert_eq!(resident.value(x, y, level), expected, "round {round}: {x} {y} level {level}");
            }
            let sub = [any(8) as u8, any(8) as u8];
            assert_eq!(resident.continuous(x, y, sub), tree.continuous(log2, x, y, sub), "round {round}: {x} {y}");
        }
    }
}

/// Of every node the walk names page, level and number.
#[test]
fn lookups_name_the_node() {
    let tree = grow(&mut rolls(12), 5, true, 6);
    let file = file("vector-nodes", &tree, 5);
    let structure = file.structure(0).unwrap();
    let map = Map::new(structure.clone()).unwrap();
    for ordinal in 0..structure.page_count() {
        let (page, r) = (structure.page(ordinal).unwrap(), structure.page_record(ordinal).unwrap());
        let mut found = 0;
        nodes(page.words(), page.head(), |n| {
            found += 1;
            let (x, y) = (r.origin_x.get() + n.x, r.origin_y.get() + n.y);
            let a = map.texel(x, y, n.level).unwrap();
            if n.kind.has_value() {
                assert_eq!((a.page, a.level, a.word), (ordinal, n.level, n.number));
            } else {
                assert!(a.level > n.level);
            }
        });
        let c = page.counts();
        assert_eq!(c.leaves + c.inner + c.empty, found);
    }
}

#[test]
fn what_is_missing_is_answered_from_above_and_named() {
    let tree = grow(&mut rolls(12), 5, true, 7);
    let file = file("vector-missing", &tree, 5);
    let structure = file.structure(0).unwrap();
    let pages: Vec<_> = (0..structure.page_count()).map(|o| structure.page(o).unwrap()).collect();
    let view = |o: u32| {
        let page = pages.get(o as usize)?;
        Some(PageView {
            words: page.words(),
            first_child: page.record().first_child.get(),
            dependencies: page.dependencies(),
        })
    };
    let mut missed = 0;
    for (x, y) in (0..32).flat_map(|y| (0..32).map(move |x| (x, y))) {
        let none = descend(|_| None, 0, 5, x, y, 0);
        assert_eq!((none.value, none.missing), (UNCOVERED, Some(0)));
        let (top, whole) = (descend(|o| view(o).filter(|_| o == 0), 0, 5, x, y, 0), descend(view, 0, 5, x, y, 0));
        assert_eq!(whole.value, tree.lookup(5, x, y, 0));
        assert_eq!(continuous(view, 0, 5, x, y, [128; 2]).value, whole.value);
        match top.missing {
            None => assert_eq!(top, whole),
            Some(page) => {
                missed += 1;
                assert!(page > 0 && top.page == 0 && top.level >= whole.level);
                // A page without this one answers within its depths.
                let r = pages[0].record();
                assert!((r.min_depth.get()..=r.max_depth.get()).contains(&top.value));
            }
        }
    }
    assert!(missed > 0);
}

/// Bounds are never narrower than the values of the texels below a node.
#[test]
fn bounds_hold_every_texel() {
    let mut dice = Dice(8);
    for _ in 0..300 {
        let tree = Node::leaf(entry(&mut |n| dice.roll(n), 3));
        let page = pages(&tree, 3).remove(0);
        let layout = Layout::of(&page.words);
        let number = layout.entry(&page.words, 0);
        let square = umbrage_format::kind::vector::Square::of_texels(0, 0, 3);
        let (low, high) = bounds(&page.words, &layout, number, &square);
        assert_eq!((low, high), (page.record.min_depth.get(), page.record.max_depth.get()));
        for (x, y) in (0..8).flat_map(|y| (0..8).map(move |x| (x, y))) {
            assert!((low..=high).contains(&tree.lookup(3, x, y, 0)));
        }
    }
}

/// The container's writer refuses what the reader would.
#[test]
fn the_writer_checks_vector_pages() {
    let folder = Folder::new("vector-refused");
    let mut page = pages(&Node::leaf(Entry::Constant(7)), 2).remove(0);
    page.record.max_depth = 6.into();
    page.record.min_depth = 6.into();
    let records = vec![structure("sun", Kind::Vector, 2, 1)];
    let path = folder.0.join("m.umb");
    let refused = ContainerWriter::create(&path, ContainerOptions::new(ID), records).unwrap().push(&page);
    assert!(refused.unwrap_err().to_string().contains("vector.values"));
}
