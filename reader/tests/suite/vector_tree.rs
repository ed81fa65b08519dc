//! A naive tree of kind `vector`: its lookup by the words of the text, without palettes and bits, and the simplest
//! pager.

use std::collections::VecDeque;

use umbrage_format::PageRecord;
use umbrage_format::kind::mh::{Mask, NodeType};
use umbrage_format::kind::vector::{Line, Mask4, Parts, Plane, Split, Square, assemble};
use umbrage_format::page::FrameHead;
use umbrage_format::projection::UNCOVERED;
use umbrage_writer::container::PageInput;

/// An entry, whole. Places count from the corner of the page that its node lies in.
#[derive(Clone, Debug, PartialEq)]
pub enum Entry {
    Constant(u32),
    Plane(Plane),
    Split(Line, Box<[Entry; 2]>),
    /// Constants or planes, and 16 selectors.
    Mask(Box<[Entry; 3]>, [u8; 16]),
    Raw(Box<[u32; 16]>),
}

/// A node: at least one of entry and children.
#[derive(Debug, Default)]
pub struct Node {
    pub entry: Option<Entry>,
    pub proven: bool,
    pub kids: Option<Kids>,
    /// Its children lie in a page of their own.
    pub cut: bool,
}

pub type Kids = Box<[Option<Node>; 4]>;

impl Entry {
    pub fn at(&self, x: i64, y: i64) -> u32 {
        let cell = ((y / 256 % 4) * 4 + x / 256 % 4) as usize;
        match self {
            Entry::Constant(v) => *v,
            Entry::Plane(p) => {
                let rise = i128::from(p.gx) * i128::from(x) + i128::from(p.gy) * i128::from(y);
                (i128::from(p.offset) + rise.div_euclid(1 << p.shift)).clamp(0, 0xFFFF_FFFE) as u32
            }
            Entry::Split(l, sides) => {
                let (u, t) = if l.axis { (y, x) } else { (x, y) };
                let beyond = t * 4096 >= l.c + (i64::from(l.m) * u).div_euclid(1 << 19);
                sides[usize::from(beyond)].at(x, y)
            }
            Entry::Mask(entries, selectors) => entries[usize::from(selectors[cell])].at(x, y),
            Entry::Raw(values) => values[cell],
        }
    }

    /// Smallest and largest value over a closed square, as the text has it.
    fn bounds(&self, s: Square) -> (u32, u32) {
        let over = |all: &mut dyn Iterator<Item = (u32, u32)>| {
            all.fold((u32::MAX, 0), |(low, high), (a, b)| (low.min(a), high.max(b)))
        };
        match self {
            Entry::Constant(v) => (*v, *v),
            Entry::Plane(_) => {
                let corners = [(s.x0, s.y0), (s.x1, s.y0), (s.x0, s.y1), (s.x1, s.y1)];
                over(&mut corners.into_iter().map(|(x, y)| (self.at(x, y), self.at(x, y))))
            }
            Entry::Split(_, sides) => over(&mut sides.iter().map(|e| e.bounds(s))),
            Entry::Mask(entries, selectors) => over(&mut selectors.iter().map(|i| entries[usize::from(*i)].bounds(s))),
            Entry::Raw(values) => over(&mut values.iter().map(|v| (*v, *v))),
        }
    }
}

impl Node {
    pub fn leaf(entry: Entry) -> Self {
        Self { entry: Some(entry), ..Self::default() }
    }

    pub fn inner(entry: Entry, kids: [Option<Node>; 4]) -> Self {
        Self { entry: Some(entry), kids: Some(Box::new(kids)), ..Self::default() }
    }

    pub fn empty(kids: [Option<Node>; 4]) -> Self {
        Self { kids: Some(Box::new(kids)), ..Self::default() }
    }

    pub fn cut(self) -> Self {
        Self { cut: true, ..self }
    }

    pub fn proven(self) -> Self {
        Self { proven: true, ..self }
    }

    fn kind(&self) -> NodeType {
        match (&self.entry, &self.kids) {
            (Some(_), None) => NodeType::Leaf,
            (Some(_), Some(_)) => NodeType::Inner,
            _ => NodeType::Empty,
        }
    }

    /// The finest node with an entry on the way to a texel, and the log2 of the side of its page.
    fn find(&self, log2: u8, x: u32, y: u32, level: u8) -> Option<(&Node, u8)> {
        let (mut node, mut at, mut side, mut found) = (self, log2, log2, None);
        loop {
            if node.entry.is_some() {
                found = Some((node, side));
            }
            if at == level.min(log2) {
                return found;
            }
            let Some(kids) = &node.kids else { return found };
            if node.cut {
                side = at;
            }
            at -= 1;
            let Some(kid) = &kids[((x >> at & 1) + 2 * (y >> at & 1)) as usize] else { return found };
            node = kid;
        }
    }

    /// Value at texel (x, y) of level 0, asked at `level`; `self` is a root of `1 << log2` texels.
    pub fn lookup(&self, log2: u8, x: u32, y: u32, level: u8) -> u32 {
        let Some((node, side)) = self.find(log2, x, y, level) else { return UNCOVERED };
        let texel = 1i64 << level.min(log2);
        let place = |v: u32| i64::from(v % (1 << side)) / texel * texel * 256 + 128 * texel;
        node.entry.as_ref().map_or(UNCOVERED, |e| e.at(place(x), place(y)))
    }

    /// Value at a place inside a texel.
    pub fn continuous(&self, log2: u8, x: u32, y: u32, sub: [u8; 2]) -> u32 {
        let Some((node, side)) = self.find(log2, x, y, 0) else { return UNCOVERED };
        let place = |v: u32, f: u8| 256 * i64::from(v % (1 << side)) + i64::from(if node.proven { f } else { 128 });
        node.entry.as_ref().map_or(UNCOVERED, |e| e.at(place(x, sub[0]), place(y, sub[1])))
    }
}

/// Numbers below what is asked for: dice, or the bytes of a fuzzer.
pub type Roll<'a> = &'a mut dyn FnMut(u32) -> u32;

/// A random entry of any class; `depth` is how many splits may stand one in the other.
pub fn entry(roll: Roll<'_>, depth: u32) -> Entry {
    let simple = |roll: Roll<'_>| match roll(3) {
        0 => {
            let most = if roll(8) == 0 { u32::MAX } else { 50 };
            Entry::Constant(roll(most))
        }
        _ => {
            let slope = |roll: Roll<'_>| roll(1 << 12) as i32 - (1 << 11);
            let (gx, gy, shift) = (slope(roll), slope(roll), roll(12) as u8);
            Entry::Plane(Plane { offset: i64::from(roll(1 << 30)) - (1 << 24), gx, gy, shift })
        }
    };
    match roll(6) {
        0 if depth > 0 => {
            let (m, c) = (roll(u32::MAX), i64::from(roll(1 << 26)) - (1 << 24));
            // most are short, so that many pages are
            let m = if m % 8 == 1 { m } else { m & !1 };
            let line = Line { m: m.cast_signed(), c, axis: roll(2) == 1 };
            Entry::Split(line, Box::new([0; 2].map(|_| half(roll, depth - 1))))
        }
        1 => Entry::Mask(Box::new([0; 3].map(|_| simple(roll))), [0; 16].map(|_| roll(3) as u8)),
        2 => {
            let (base, width) = (roll(1 << 20), roll(20));
            Entry::Raw(Box::new([0; 16].map(|_| base + (roll(1 << 20) >> width << 3))))
        }
        _ => simple(roll),
    }
}

/// A side of a split: no mask, no raw.
fn half(roll: Roll<'_>, depth: u32) -> Entry {
    loop {
        match entry(roll, depth) {
            Entry::Mask(..) | Entry::Raw(_) => {}
            other => return other,
        }
    }
}

/// A random tree; `bushy` of 8 nodes above level 0 have children, of those 2 of 5 in a page of their own.
pub fn grow(roll: Roll<'_>, level: u8, root: bool, bushy: u32) -> Node {
    let (own, proven) = (entry(roll, 3), roll(2) == 1);
    if level == 0 || (!root && roll(8) >= bushy) {
        return Node { entry: Some(own), proven, ..Node::default() };
    }
    let mut kids: [Option<Node>; 4] =
        std::array::from_fn(|_| (roll(5) != 0).then(|| grow(roll, level - 1, false, bushy)));
    if kids.iter().all(Option::is_none) {
        kids[roll(4) as usize] = Some(Node::leaf(entry(roll, 1)));
    }
    let entry = (root || roll(3) != 0).then_some(own);
    Node { entry, proven, kids: Some(Box::new(kids)), cut: roll(5) < 2 }
}

type Group<'a> = [Option<&'a Node>; 4];
/// An entry that holds above, and the first texel of the page that it lies in.
type Above<'a> = Option<(&'a Entry, [u32; 2])>;

/// A group: nodes, level, first texel, what holds above.
#[derive(Clone, Copy)]
struct Pending<'a> {
    group: Group<'a>,
    level: u8,
    at: [u32; 2],
    above: Above<'a>,
    cut: bool,
}

/// Pages of a tree in level order.
pub fn pages(tree: &Node, log2: u8) -> Vec<PageInput> {
    let root = Pending { group: [Some(tree), None, None, None], level: log2, at: [0, 0], above: None, cut: false };
    let mut queue = VecDeque::from([(root, None)]);
    let (mut out, mut parents) = (Vec::<PageInput>::new(), Vec::new());
    while let Some((first, parent)) = queue.pop_front() {
        let ordinal = out.len();
        let mut children = Vec::new();
        out.push(page(first, ordinal == 0, &mut children));
        queue.extend(children.into_iter().map(|p| (p, Some(ordinal))));
        parents.push(parent);
    }
    // Children lie behind their parents: what they can answer, the parent can.
    for child in (0..out.len()).rev() {
        let Some(parent) = parents[child] else { continue };
        let parent: usize = parent;
        let (min, max) = (out[child].record.min_depth.get(), out[child].record.max_depth.get());
        let r = &mut out[parent].record;
        (r.min_depth, r.max_depth) = (r.min_depth.get().min(min).into(), r.max_depth.get().max(max).into());
    }
    out
}

fn page<'a>(first: Pending<'a>, is_root: bool, children: &mut Vec<Pending<'a>>) -> PageInput {
    let side = if is_root { first.level } else { first.level + 1 };
    let local = |[x, y]: [u32; 2], [ox, oy]: [u32; 2], level: u8| Square::of_texels(x - ox, y - oy, level);
    let (mut low, mut high) = first.above.map_or((u32::MAX, 0), |(e, o)| e.bounds(local(first.at, o, side)));
    let (mut groups, mut entries, mut proofs, mut finest) = (Vec::new(), Vec::new(), Vec::new(), first.level);
    let mut queue = VecDeque::from([first]);
    while let Some(p) = queue.pop_front() {
        if p.cut {
            groups.push(0);
            children.push(Pending { cut: false, ..p });
            continue;
        }
        finest = finest.min(p.level);
        groups.push(Mask::new(p.group.map(|n| n.map_or(NodeType::None, Node::kind))).0);
        for (c, node) in (0u32..).zip(p.group) {
            let Some(node) = node else { continue };
            let at = [p.at[0] + ((c & 1) << p.level), p.at[1] + ((c >> 1) << p.level)];
            if let Some(e) = &node.entry {
                let (a, b) = e.bounds(local(at, first.at, p.level));
                (low, high) = (low.min(a), high.max(b));
                entries.push(e);
                proofs.push(node.proven);
            }
            if let Some(kids) = &node.kids {
                let above = node.entry.as_ref().map(|e| (e, first.at)).or(p.above);
                let group = std::array::from_fn(|c| kids[c].as_ref());
                queue.push_back(Pending { group, level: p.level - 1, at, above, cut: node.cut });
            }
        }
    }
    let palette = Palette::of(&entries);
    let indexes: Vec<u32> = entries.iter().map(|e| palette.number(e)).collect();
    let words = assemble(&Parts {
        root_level: first.level,
        groups: &groups,
        indexes: &indexes,
        proofs: proofs.contains(&true).then_some(&proofs),
        lines: &palette.lines,
        constants: &palette.constants,
        planes: &palette.planes,
        splits: &palette.splits,
        masks: &palette.masks,
        raws: &palette.raws,
    });
    let mut record = PageRecord::zeroed();
    (record.origin_x, record.origin_y) = (first.at[0].into(), first.at[1].into());
    (record.log2_x, record.log2_y) = (side, side);
    (record.level_coarsest, record.level_finest) = (first.level, finest);
    (record.min_depth, record.max_depth) = (low.into(), high.into());
    record.stop_error = if is_root { u32::MAX } else { 1000 }.into();
    assert_eq!(usize::from(FrameHead::decode(&words).unwrap().child_refs), children.len());
    PageInput { words, record, dependencies: Vec::new() }
}

#[derive(Default)]
struct Palette {
    lines: Vec<Line>,
    constants: Vec<u32>,
    planes: Vec<Plane>,
    splits: Vec<Split>,
    masks: Vec<Mask4>,
    raws: Vec<[u32; 16]>,
}

/// Place of a thing in a list, where it is put if it is not there yet.
fn place<T: PartialEq>(list: &mut Vec<T>, thing: T) -> usize {
    list.iter().position(|t| *t == thing).unwrap_or_else(|| {
        list.push(thing);
        list.len() - 1
    })
}

impl Palette {
    /// Class by class: the numbers of a class follow from those before.
    fn of(entries: &[&Entry]) -> Self {
        let mut p = Self::default();
        entries.iter().for_each(|e| p.simple(e));
        entries.iter().for_each(|e| {
            if let Entry::Split(..) = e {
                p.split(e);
            }
        });
        for e in entries {
            match e {
                Entry::Mask(..) => {
                    let mask = p.mask(e);
                    place(&mut p.masks, mask);
                }
                Entry::Raw(values) => {
                    place(&mut p.raws, **values);
                }
                _ => {}
            }
        }
        p
    }

    /// Lines, constants and planes.
    fn simple(&mut self, e: &Entry) {
        match e {
            Entry::Constant(v) => {
                place(&mut self.constants, *v);
            }
            Entry::Plane(p) => {
                place(&mut self.planes, *p);
            }
            Entry::Split(l, sides) => {
                place(&mut self.lines, *l);
                sides.iter().for_each(|e| self.simple(e));
            }
            Entry::Mask(entries, _) => entries.iter().for_each(|e| self.simple(e)),
            Entry::Raw(_) => {}
        }
    }

    /// The sides before the split.
    fn split(&mut self, e: &Entry) -> u32 {
        let Entry::Split(l, sides) = e else { return self.number(e) };
        let [a, b] = [&sides[0], &sides[1]].map(|e| self.split(e) as u16);
        let line = place(&mut self.lines, *l) as u16;
        let first = (self.constants.len() + self.planes.len()) as u32;
        first + place(&mut self.splits, Split { line, a, b }) as u32
    }

    fn mask(&self, e: &Entry) -> Mask4 {
        let Entry::Mask(entries, selectors) = e else { panic!("{e:?}") };
        let selectors = selectors.iter().rev().fold(0, |s, n| s << 2 | u32::from(*n));
        Mask4 { entries: [0, 1, 2].map(|i| self.number(&entries[i]) as u16), selectors }
    }

    fn number(&self, e: &Entry) -> u32 {
        let (constants, planes, splits) = (self.constants.len(), self.planes.len(), self.splits.len());
        let found = match e {
            Entry::Constant(v) => self.constants.iter().position(|c| c == v),
            Entry::Plane(p) => self.planes.iter().position(|q| q == p).map(|i| constants + i),
            Entry::Split(l, sides) => {
                let [a, b] = [&sides[0], &sides[1]].map(|e| self.number(e) as u16);
                let line = self.lines.iter().position(|m| m == l).unwrap() as u16;
                self.splits.iter().position(|s| *s == Split { line, a, b }).map(|i| constants + planes + i)
            }
            Entry::Mask(..) => {
                let mask = self.mask(e);
                self.masks.iter().position(|m| *m == mask).map(|i| constants + planes + splits + i)
            }
            Entry::Raw(values) => {
                let before = constants + planes + splits + self.masks.len();
                self.raws.iter().position(|r| *r == **values).map(|i| before + i)
            }
        };
        found.unwrap() as u32
    }
}
