#![allow(clippy::unwrap_used, clippy::panic, clippy::indexing_slicing, clippy::cast_possible_truncation)]
//! Entries against arithmetic in 128 bits, and random pages through `assemble` and `check`.

use std::vec::Vec;

use super::*;
use crate::kind::Kind;
use crate::kind::mh::NodeType;
use crate::kind::tree::PageCounts;
use crate::page::{PageContext, check_frame};
use crate::{PageRecord, StructureRecord};

struct Dice(u64);

impl Dice {
    fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        self.0 ^ self.0 >> 29
    }

    fn roll(&mut self, sides: u32) -> u32 {
        ((self.bits() >> 24) % u64::from(sides)) as u32
    }

    /// A number with sign of so many bits; often one of the extremes.
    fn signed(&mut self, bits: u32) -> i64 {
        let half = 1i64 << (bits - 1);
        match self.roll(6) {
            0 => -half,
            1 => half - 1,
            2 => 0,
            _ => (self.bits().cast_signed()) >> (64 - bits),
        }
    }

    fn place(&mut self) -> i64 {
        match self.roll(4) {
            0 => 1 << 32,
            1 => 0,
            _ => i64::from(self.bits() as u32),
        }
    }

    fn plane(&mut self) -> Plane {
        if self.roll(2) == 0 {
            let (gx, gy) = (self.signed(25) as i32, self.signed(25) as i32);
            return Plane { offset: self.signed(39), gx, gy, shift: self.roll(64) as u8 };
        }
        // its slopes may be those of any plane
        let (gx, gy) = (self.signed(27) as i32, self.signed(27) as i32);
        Plane { offset: self.signed(36), gx, gy, shift: 8 + self.roll(32) as u8 }
    }

    fn line(&mut self) -> Line {
        if self.roll(2) == 0 {
            return self.short_line();
        }
        Line { m: self.signed(32) as i32, c: self.signed(48), axis: self.roll(2) == 1 }
    }

    fn short_line(&mut self) -> Line {
        Line { m: 2 * self.signed(31) as i32, c: self.signed(32), axis: self.roll(2) == 1 }
    }
}

/// `floor(a / 2^n)`.
fn floor(a: i128, n: u32) -> i128 {
    a.div_euclid(1 << n)
}

#[test]
fn planes_and_lines_are_exact_at_every_extreme() {
    let (mut dice, mut shorts) = (Dice(1), [0; 2]);
    for _ in 0..20_000 {
        let (p, l, x, y) = (dice.plane(), dice.line(), dice.place(), dice.place());
        assert!(p.fits() && l.fits());
        assert_eq!((Plane::decode(p.encode()), Line::decode(l.encode())), (p, l));
        let short = Line::decode_short(l.encode_short());
        assert_eq!(short == l, l.is_short(), "{l:?}");
        shorts[usize::from(l.is_short())] += 1;
        let rise = i128::from(p.gx) * i128::from(x) + i128::from(p.gy) * i128::from(y);
        let exact = (i128::from(p.offset) + floor(rise, p.shift.into())).clamp(0, 0xFFFF_FFFE);
        assert_eq!(i128::from(p.at(x, y)), exact, "{p:?} {x} {y}");
        let (u, t) = if l.axis { (y, x) } else { (x, y) };
        let beyond = i128::from(t) * 4096 >= i128::from(l.c) + floor(i128::from(l.m) * i128::from(u), 19);
        assert_eq!(l.beyond(x, y), beyond, "{l:?} {x} {y}");
        let (x1, y1) = (x.max(dice.place()), y.max(dice.place()));
        let corners = [p.at(x, y), p.at(x1, y), p.at(x, y1), p.at(x1, y1)];
        let found = p.bounds(&Square { x0: x, y0: y, x1, y1 });
        assert_eq!(found, (*corners.iter().min().unwrap(), *corners.iter().max().unwrap()));
    }
    assert!(shorts.iter().all(|n| *n > 5000), "{shorts:?}");
    let fine = Plane { gx: 1 << 24, shift: 8, ..Plane::default() };
    assert!(fine.fits() && Plane { gx: 1 - (1 << 26), gy: -1 << 26, shift: 39, ..fine }.fits());
    assert!(!Plane { shift: 7, ..fine }.fits() && !Plane { shift: 40, ..fine }.fits());
    assert!(!Plane { offset: 1 << 35, ..fine }.fits() && !Plane { gy: 1 << 26, ..fine }.fits());
    assert!(!Plane { shift: 64, ..Plane::default() }.fits());
    assert!(Plane { gx: (1 << 24) - 1, gy: -1 << 24, ..Plane::default() }.encode()[1] >> 31 == 0);
    assert!(!Plane { offset: 1 << 38, ..Plane::default() }.fits() && !Line { c: 1 << 47, ..Line::default() }.fits());
}

#[test]
fn the_rest_of_the_palette_keeps_its_bits() {
    let split = Split { line: 1023, a: 2047, b: 1 };
    assert_eq!((split.encode(), Split::decode(split.encode())), (0x003F_FFFF, split));
    let mask = Mask4 { entries: [1, 1023, 2], selectors: 0x9000_0004 };
    assert_eq!((mask.encode()[0], Mask4::decode(mask.encode())), (0x002F_FC01, mask));
    assert_eq!((mask.entry(0), mask.entry(1), mask.entry(15)), (1, 1023, 2));
    assert!(!mask.has_unknown() && Mask4 { selectors: 0xC000, ..mask }.has_unknown());
    assert_eq!(Mask4 { selectors: 0x5555_5555, ..mask }.named(), [false, true, false]);
    let raw = Raw { base: 7, at: 16383, width: 32, shift: 31 };
    assert_eq!((raw.encode()[1], Raw::decode(raw.encode())), (0x07E0_3FFF, raw));
    let header = Header { groups: 3, index_bits: 5, flags: 1, lines: 9, raws: 65535, ..Header::default() };
    let page = [&[0, 0][..], &header.encode()].concat();
    assert_eq!(Header::decode(&page), header);
    let bits = [0, 1, 2, 3, 4, 5, 1024, 1025].map(|n| Header { constants: n, ..Header::default() }.needed_bits());
    assert_eq!(bits, [0, 0, 1, 2, 2, 3, 10, 11]);
}

#[test]
fn raws_are_packed_with_the_smallest_width() {
    let mut dice = Dice(3);
    for _ in 0..500 {
        let (wide, step) = (dice.roll(33), dice.roll(8));
        let base = dice.roll(1000);
        let values: [u32; 16] = core::array::from_fn(|_| {
            base + (((dice.bits() >> 32) as u32).checked_shr(32 - wide).unwrap_or(0) >> 10 << step)
        });
        let raw = Raw::of(&values);
        let parts = Parts { groups: &[1], indexes: &[0], raws: &[values], ..Parts::default() };
        let page = assemble(&parts);
        let l = Layout::of(&page);
        for n in 0..16 {
            let (x, y) = (i64::from(n % 4) << 8 | 255, i64::from(n / 4) << 8);
            assert_eq!(value(&page, &l, 0, x, y), values[n as usize]);
        }
        let top = values.iter().map(|v| (v - raw.base) >> raw.shift).max().unwrap();
        assert_eq!(u32::from(raw.width), 32 - top.leading_zeros());
    }
}

/// A random page of any tree, its root group at `level`.
struct Random {
    groups: Vec<u8>,
    indexes: Vec<u32>,
    proofs: Vec<bool>,
    lines: Vec<Line>,
    constants: Vec<u32>,
    planes: Vec<Plane>,
    splits: Vec<Split>,
    masks: Vec<Mask4>,
    raws: Vec<[u32; 16]>,
    level: u8,
}

impl Random {
    fn new(dice: &mut Dice, level: u8, root: bool) -> Self {
        let mut groups = Vec::new();
        let mut levels = vec![level];
        let mut entries = 0u32;
        let bushy = 1 + dice.roll(4);
        while groups.len() < levels.len() {
            let (number, at) = (groups.len(), levels[groups.len()]);
            let types: [NodeType; 4] = core::array::from_fn(|c| {
                let children = at > 0 && levels.len() < 300 && dice.roll(4) < bushy;
                match (number, root) {
                    (0, true) if c > 0 => NodeType::None,
                    (0, true) => {
                        if children {
                            NodeType::Inner
                        } else {
                            NodeType::Leaf
                        }
                    }
                    _ => [[NodeType::None, NodeType::Leaf], [NodeType::Inner, NodeType::Empty]][usize::from(children)]
                        [dice.roll(2) as usize],
                }
            });
            let mask = Mask::new(types).0;
            let stub = number > 0 && dice.roll(5) == 0;
            groups.push(if stub || (mask == 0 && number > 0) { 0 } else { mask.max(u8::from(number == 0)) });
            for c in 0..4 {
                let kind = Mask(groups[number]).child(c);
                entries += u32::from(kind.has_value());
                if kind.has_children() {
                    levels.push(at - 1);
                }
            }
        }
        let constants: Vec<u32> = (0..1 + dice.roll(4)).map(|_| dice.bits() as u32).collect();
        let planes: Vec<Plane> = (0..dice.roll(5)).map(|_| dice.plane()).collect();
        let short = dice.roll(2) == 0;
        let line = |dice: &mut Dice| if short { dice.short_line() } else { dice.line() };
        let lines: Vec<Line> = (0..1 + dice.roll(3)).map(|_| line(dice)).collect();
        let simple = (constants.len() + planes.len()) as u32;
        let mut depths = Vec::new();
        let splits: Vec<Split> = (0..dice.roll(6))
            .map(|i| {
                let (a, b) = loop {
                    let (a, b) = (dice.roll(simple + i), dice.roll(simple + i));
                    let depth = |e: u32| e.checked_sub(simple).map_or(0, |i| depths[i as usize]);
                    let own = 1 + depth(a).max(depth(b));
                    if own <= MAX_DEPTH {
                        depths.push(own);
                        break (a, b);
                    }
                };
                Split { line: dice.roll(lines.len() as u32) as u16, a: a as u16, b: b as u16 }
            })
            .collect();
        let masks: Vec<Mask4> = (0..dice.roll(3))
            .map(|_| {
                let selectors = (0..16).fold(0, |s, i| s | dice.roll(3) << (2 * i));
                Mask4 { entries: [0; 3].map(|_| dice.roll(simple) as u16), selectors }
            })
            .collect();
        let raws: Vec<[u32; 16]> = (0..dice.roll(3))
            .map(|_| {
                let width = dice.roll(32);
                [0; 16].map(|_| dice.bits() as u32 >> width)
            })
            .collect();
        let palette = simple + (splits.len() + masks.len() + raws.len()) as u32;
        let indexes = (0..entries).map(|_| dice.roll(palette)).collect();
        let proofs = (0..entries).map(|_| dice.roll(2) == 1).collect();
        Self { groups, indexes, proofs, lines, constants, planes, splits, masks, raws, level }
    }

    fn parts(&self, proofs: bool) -> Parts<'_> {
        Parts {
            root_level: self.level,
            groups: &self.groups,
            indexes: &self.indexes,
            proofs: proofs.then_some(&self.proofs[..]),
            lines: &self.lines,
            constants: &self.constants,
            planes: &self.planes,
            splits: &self.splits,
            masks: &self.masks,
            raws: &self.raws,
        }
    }

    /// The value by the words of the text, without any packing.
    fn value(&self, entry: u32, x: i64, y: i64) -> u32 {
        let cell = ((y >> 8 & 3) * 4 + (x >> 8 & 3)) as usize;
        let mut i = entry as usize;
        if i < self.constants.len() {
            return self.constants[i];
        }
        i -= self.constants.len();
        if i < self.planes.len() {
            return self.planes[i].at(x, y);
        }
        i -= self.planes.len();
        if i < self.splits.len() {
            let s = self.splits[i];
            return self.value(if self.lines[s.line as usize].beyond(x, y) { s.b } else { s.a }.into(), x, y);
        }
        i -= self.splits.len();
        if i < self.masks.len() {
            let m = self.masks[i];
            return self.value(m.entries[(m.selectors >> (2 * cell) & 3) as usize].into(), x, y);
        }
        self.raws[i - self.masks.len()][cell]
    }
}

fn records(page: &[u32], level: u8, log2: u8, root: bool) -> (PageRecord, StructureRecord) {
    let head = FrameHead::decode(page).unwrap();
    let mut r = PageRecord::zeroed();
    (r.hot_words, r.child_count, r.level_coarsest) = (head.words.into(), head.child_refs.into(), level);
    let side = if root { level } else { level + 1 };
    (r.log2_x, r.log2_y, r.max_depth) = (side, side, u32::MAX.into());
    let mut s = StructureRecord::zeroed();
    (s.kind, s.log2_resolution, s.root_count) = (Kind::Vector.code().into(), log2, 1.into());
    (r, s)
}

#[test]
fn random_pages_pass_their_check_and_keep_their_parts() {
    let mut dice = Dice(9);
    for round in 0..600 {
        let (level, root) = (dice.roll(7) as u8, dice.roll(2) == 0);
        let (tree, proofs) = (Random::new(&mut dice, level, root), round % 3 == 0);
        let parts = tree.parts(proofs);
        let page = assemble(&parts);
        assert_eq!(page.len(), parts.words());
        let (mut record, structure) = records(&page, level, if root { level } else { 8 }, root);
        fn cx<'a>(root: bool, page: &'a PageRecord, record: &'a StructureRecord) -> PageContext<'a> {
            PageContext { structure: 0, ordinal: u32::from(!root), page, record }
        }
        // The finest level is told by the rule that misses it.
        let head = check_frame(&page, &cx(root, &record, &structure)).unwrap();
        let counts: PageCounts = loop {
            match check(&page, &head, &cx(root, &record, &structure)) {
                Ok(counts) => break counts,
                Err(e) if e.rule == crate::Rule::VectorLevels && record.level_finest < level => {
                    record.level_finest += 1
                }
                Err(e) => panic!("round {round}: {e}"),
            }
        };
        let l = Layout::of(&page);
        let (mut children, mut index, mut nodes, mut stubs) = (0, 0, [0u32; 4], 0);
        for (number, &mask) in (0u32..).zip(&tree.groups) {
            let group = Group::of(&page, number);
            assert_eq!(group, Group { mask: Mask(mask), children, entries: index });
            assert_eq!(l.stub(&page, number).is_some(), mask == 0);
            if mask == 0 {
                assert_eq!(l.stub(&page, number), Some(stubs));
                stubs += 1;
            }
            for c in 0..4 {
                let kind = Mask(mask).child(c);
                assert_eq!(Child::of(&page, number, c).mask, Mask(mask));
                nodes[kind as usize] += 1;
                if kind.has_children() {
                    children += 1;
                    assert_eq!(Child::of(&page, number, c).below, children);
                }
                if kind.has_value() {
                    assert_eq!(Child::of(&page, number, c).index, index);
                    assert_eq!(l.entry(&page, index), tree.indexes[index as usize]);
                    assert_eq!(l.proven(&page, index), proofs && tree.proofs[index as usize]);
                    index += 1;
                }
            }
        }
        assert_eq!([counts.leaves, counts.inner, counts.empty], [nodes[1], nodes[2], nodes[3]]);
        for entry in 0..Header::decode(&page).palette() {
            let (low, high) = bounds(&page, &l, entry, &Square::of_texels(0, 0, 8));
            for _ in 0..20 {
                let (x, y) = (i64::from(dice.roll(1 << 16)), i64::from(dice.roll(1 << 16)));
                let found = value(&page, &l, entry, x, y);
                assert_eq!(found, tree.value(entry, x, y), "round {round} entry {entry}");
                assert!(low <= found && found <= high);
            }
        }
        let mut seen = [0u32; 4];
        super::nodes(&page, &head, |n| {
            seen[n.kind as usize] += 1;
            let mask = Group::of(&page, n.number / 4).mask;
            assert_eq!(
                (mask.child(n.number % 4), n.index),
                (n.kind, Child::of(&page, n.number / 4, n.number % 4).index)
            );
            assert!(n.x + (1 << n.level) <= 1 << record.log2_x && n.y + (1 << n.level) <= 1 << record.log2_y);
        });
        assert_eq!(seen[1..], nodes[1..]);
        let mut told = 0;
        links(&page, &head, &cx(root, &record, &structure), None, |child, link| {
            assert_eq!(child, told);
            assert!(link.level < level && link.x < 1 << record.log2_x && link.y < 1 << record.log2_y);
            told += 1;
        });
        assert_eq!(told, head.child_refs);
    }
}

#[test]
fn a_page_has_one_form_of_lines() {
    let lines = [Line { m: 2, c: -5, axis: true }];
    let splits = [Split { line: 0, a: 0, b: 1 }];
    let parts =
        Parts { groups: &[1], indexes: &[2], constants: &[7, 9], lines: &lines, splits: &splits, ..Parts::default() };
    let found = |page: &[u32]| {
        let (record, structure) = records(page, 0, 0, true);
        let cx = PageContext { structure: 0, ordinal: 0, page: &record, record: &structure };
        check(page, &FrameHead::decode(page).unwrap(), &cx).map_err(|e| e.rule)
    };
    let page = assemble(&parts);
    assert!(Layout::of(&page).short_lines && found(&page).is_ok());
    // the same in 3 words
    let at = usize::from(Layout::of(&page).lines_at);
    let mut long = page.clone();
    long.splice(at..at + 2, lines[0].encode());
    long[1] += 1;
    long[3] &= !(u32::from(Header::SHORT_LINES) << 8);
    assert_eq!(FrameHead::decode(&long).unwrap().words as usize, long.len());
    assert_eq!(value(&long, &Layout::of(&long), 2, 0, 0), value(&page, &Layout::of(&page), 2, 0, 0));
    assert_eq!(found(&long).unwrap_err(), crate::Rule::VectorLine);
    // one that needs them
    let odd = assemble(&Parts { lines: &[Line { m: 3, ..lines[0] }], ..parts });
    assert!(!Layout::of(&odd).short_lines && found(&odd).is_ok());
    // no lines, but short ones
    let mut none = assemble(&Parts { groups: &[1], indexes: &[0], constants: &[7], ..Parts::default() });
    assert!(found(&none).is_ok());
    none[3] |= u32::from(Header::SHORT_LINES) << 8;
    assert_eq!(found(&none).unwrap_err(), crate::Rule::VectorHeader);
}

/// Words changed at random: no panic, and what is accepted answers within its bounds.
#[test]
fn changed_pages_are_refused_or_safe() {
    let mut dice = Dice(4);
    let mut accepted = 0;
    for _ in 0..4000 {
        let level = dice.roll(5) as u8;
        let tree = Random::new(&mut dice, level, true);
        let mut page = assemble(&tree.parts(dice.roll(2) == 0));
        let (mut record, structure) = records(&page, level, level, true);
        for _ in 0..=dice.roll(2) {
            let at = 2 + dice.roll(page.len() as u32 - 2) as usize;
            page[at] ^= 1 << dice.roll(32);
        }
        record.level_finest = dice.roll(u32::from(level) + 1) as u8;
        let cx = PageContext { structure: 0, ordinal: 0, page: &record, record: &structure };
        let head = FrameHead::decode(&page).unwrap();
        let ok = check(&page, &head, &cx).is_ok();
        accepted += u32::from(ok);
        let (l, h) = (Layout::of(&page), Header::decode(&page));
        for entry in [0, 1, 2, 3, 5, 8, 13, 21, 0xFFFF_FFFF] {
            let (x, y) = (dice.place(), dice.place());
            let found = value(&page, &l, entry, x, y);
            if ok && entry < h.palette() {
                let (low, high) = bounds(&page, &l, entry, &Square { x0: x, y0: y, x1: x, y1: y });
                assert!(low <= found && found <= high);
            }
        }
        links(&page, &head, &cx, None, |_, _| {});
    }
    assert!(accepted > 300, "{accepted}");
}
