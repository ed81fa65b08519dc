//! Interval images and trees through writer, file and reader: every texel of every level answers as a naive evaluation
//! does, from memory and from the file; what is stored lies inside the texel's interval; and the index says of each
//! page exactly what lookups find there.

use std::path::Path;
use std::sync::Arc;

use umbrage_format::Kind;
use umbrage_reader::query::Map;
use umbrage_reader::{Container, FileSource, Limits, MemorySource};
use umbrage_writer::bake;
use umbrage_writer::container::{ContainerOptions, ContainerWriter, PageInput};
use umbrage_writer::hierarchy::mh::{Node, merge, representative};
use umbrage_writer::hierarchy::page::{At, COARSE_DEPTH, Forest, Page};
use umbrage_writer::hierarchy::spool::Spool;
use umbrage_writer::interval::Interval;

use crate::input::Input;
use crate::tree::{Folder, ID, Kids, Naive, pages, structure};
use crate::vector_tree;

/// Intervals of a map, row by row, as a pattern of few bytes repeats them.
struct Image {
    log2: u8,
    texels: Vec<Interval>,
}

impl Image {
    fn read(input: &mut Input) -> Self {
        // Most maps small; large ones are cut into many pages.
        let log2 = [0, 1, 2, 3, 4, 4, 5, 5, 6, 6, 6, 7, 7, 7, 8, 8][(input.byte() & 15) as usize];
        let (spread, noise, grain) = (input.byte() % 33, input.byte(), input.byte() & 3);
        let pattern = if input.is_empty() { &[0][..] } else { input.0 };
        let side = 1u32 << log2;
        let texel = |(x, y): (u32, u32)| {
            // Neighbours in a square are neighbours in the pattern.
            let morton = (0..8)
                .fold(0usize, |m, b| m | ((x >> b & 1) as usize) << (2 * b) | ((y >> b & 1) as usize) << (2 * b + 1));
            let at = morton >> (2 * grain);
            let byte = u32::from(pattern[at % pattern.len()]);
            let hash = (morton as u32).wrapping_mul(0x9E37_79B9).rotate_left(13).wrapping_mul(0x85EB_CA6B);
            let beside = if noise > 0 && hash >> 24 < u32::from(noise) { hash >> 8 & 0xFF } else { 0 };
            match byte.wrapping_add(beside) & 0xFF {
                255 => Interval::UNCOVERED,
                b => {
                    let min = (u64::from(b >> 3) << spread).min(u64::from(u32::MAX) - 1) as u32;
                    let wide = (u64::from(b & 7) << spread).min(u64::from(u32::MAX)) as u32;
                    Interval { min, max: min.saturating_add(wide).min(u32::MAX - 1) }
                }
            }
        };
        Self { log2, texels: (0..side).flat_map(|y| (0..side).map(move |x| (x, y))).map(texel).collect() }
    }

    fn at(&self, x: u32, y: u32) -> Interval {
        self.texels[((y << self.log2) + x) as usize]
    }

    /// Values of every level, finest first: the paper's bottom-up intervals and top-down values without any tree.
    fn values(&self) -> Vec<Vec<u32>> {
        let mut intervals = vec![self.texels.clone()];
        let mut inherit = Vec::new();
        for level in 1..=self.log2 {
            let (side, below) = (1usize << (self.log2 - level), intervals.last().expect("level 0"));
            let four = |i: usize| {
                let (x, y) = (i % side * 2, i / side * 2);
                [0, 1, 2, 3].map(|c| below[(y + (c >> 1)) * side * 2 + x + (c & 1)])
            };
            let (next, which): (Vec<_>, Vec<_>) = (0..side * side).map(|i| representative(four(i))).unzip();
            intervals.push(next);
            inherit.push(which);
        }
        let mut values = vec![vec![intervals[usize::from(self.log2)][0].middle()]];
        for level in (0..self.log2).rev() {
            let side = 1usize << (self.log2 - level);
            let (own, which, above) = (&intervals[usize::from(level)], &inherit[usize::from(level)], &values[0]);
            let value = |i: usize| {
                let (x, y) = (i % side, i / side);
                let parent = y / 2 * (side / 2) + x / 2;
                let inherits = which[parent] >> ((x & 1) | (y & 1) << 1) & 1 == 1;
                if inherits { above[parent] } else { own[i].middle() }
            };
            let next = (0..side * side).map(value).collect();
            values.insert(0, next);
        }
        values
    }

    /// The tree as the builder makes it, with whole squares where the texels are all equal and `whole` says so.
    fn build(&self, at: At, whole: bool, forest: &mut Forest, spool: &Spool) -> Node {
        let [x, y] = at.origin;
        let first = self.at(x, y);
        let side = 1u32 << at.level;
        let equal = || (y..y + side).all(|y| (x..x + side).all(|x| self.at(x, y) == first));
        if at.level == 0 || (whole && equal()) {
            return Node::uniform(first);
        }
        let mut children = [0, 1, 2, 3].map(|c| self.build(at.child(c), whole, forest, spool));
        let mut node = merge(children, at.level - 1, &mut forest.groups);
        if self.log2 - at.level + 1 >= COARSE_DEPTH {
            forest.cut(&mut node, at, &mut children, spool);
        }
        node
    }
}

/// Writes the pages.
fn written(path: &Path, options: ContainerOptions, kind: Kind, log2: u8, pages: &[PageInput]) {
    let records = vec![structure("sun", kind, log2, pages.len())];
    let mut writer = ContainerWriter::create(path, options, records).expect("a new file");
    for page in pages {
        writer.push(page).expect("a page of the tree");
    }
    writer.finish().expect("a whole file");
}

/// Writes the pages, reads them back from memory, from the file and from a file of cold pages, and asks everything.
fn compare(kind: Kind, log2: u8, pages: &[PageInput], expected: impl Fn(u32, u32, u8) -> u32) -> Map {
    let folder = Folder::new("fuzz-roundtrip");
    let [path, cold] = ["map.umb", "cold.umb"].map(|name| folder.0.join(name));
    written(&path, ContainerOptions::new(ID), kind, log2, pages);
    written(&cold, ContainerOptions::cold(ID), kind, log2, pages);
    let bytes = std::fs::read(&path).expect("the file");
    let open = |source| Container::open(source, Limits::default()).expect("what the writer wrote");
    let map = |file: &Container| Map::new(file.structure(0).expect("one")).expect("a map");
    let memory = open(Arc::new(MemorySource::new(bytes, "memory")));
    let file = open(Arc::new(FileSource::open(&path).expect("the file")));
    let cold = open(Arc::new(FileSource::open(&cold).expect("the file")));
    memory.verify(|e| panic!("{e}"));
    cold.verify(|e| panic!("{e}"));
    let cold = map(&cold);
    let (lazy, resident, on_disk) = (map(&memory), map(&memory).preload().expect("pages"), map(&file));
    for level in 0..=log2 {
        // Each square of the level once, by a texel that moves through it.
        for i in 0..1u32 << (2 * (log2 - level)) {
            let (cx, cy) = (i % (1 << (log2 - level)), i >> (log2 - level));
            let inside = i % (1 << level);
            let (x, y) = ((cx << level) + inside, (cy << level) + (1 << level) - 1 - inside);
            let want = expected(x, y, level);
            assert_eq!(lazy.texel(x, y, level).expect("a page").value, want, "texel {x} {y} level {level}");
            assert_eq!(resident.value(x, y, level), want, "texel {x} {y} level {level}, preloaded");
            assert_eq!(on_disk.texel(x, y, level).expect("a page").value, want, "texel {x} {y} level {level}, file");
            assert_eq!(cold.texel(x, y, level).expect("a page").value, want, "texel {x} {y} level {level}, cold");
        }
    }
    assert_eq!(lazy.texel(0, 0, 255).expect("the root").value, expected(0, 0, log2));
    lazy
}

/// Holds the records of the pages against the answers, by brute force.
fn records(image: &Image, values: &[Vec<u32>], map: &Map, pages: &[Page]) {
    let value = |x: u32, y: u32, level: u8| {
        values[usize::from(level)][((y >> level << (image.log2 - level)) + (x >> level)) as usize]
    };
    for (ordinal, page) in (0..).zip(pages) {
        let r = *map.page(ordinal).expect("loaded").record();
        let (x0, y0) = (r.origin_x.get(), r.origin_y.get());
        let square = |log2: u8| (0..1u32 << log2).flat_map(move |y| (0..1u32 << log2).map(move |x| (x0 + x, y0 + y)));
        let answers = (0..=r.level_coarsest).flat_map(|l| square(r.log2_x - l).map(move |p| (p, l)));
        let (min, max) = answers.fold((u32::MAX, 0), |(min, max), ((x, y), l)| {
            let v = value(x0 + ((x - x0) << l), y0 + ((y - y0) << l), l);
            (min.min(v), max.max(v))
        });
        assert_eq!((r.min_depth.get(), r.max_depth.get()), (min, max), "depths of page {ordinal}");
        let Some([above, highest]) = page.inherited else {
            assert_eq!((ordinal, r.stop_error.get()), (0, u32::MAX));
            continue;
        };
        assert_eq!([above, highest], [value(x0, y0, r.log2_x); 2], "value above page {ordinal}");
        let away = |i: Interval| i.min.saturating_sub(above).max(above.saturating_sub(i.max));
        let worst = square(r.log2_x).map(|(x, y)| away(image.at(x, y))).max();
        assert_eq!(Some(r.stop_error.get()), worst, "error without page {ordinal}");
    }
}

/// A tree as the bytes draw it; a node takes a byte for its kind, a value two.
fn grow(input: &mut Input, level: u8, root: bool) -> Naive {
    let kind = input.byte();
    let value = u32::from(input.pair()) << (kind & 16);
    if level == 0 || kind & 3 == 0 || (input.is_empty() && !root) {
        return Naive::Leaf(value);
    }
    let there = input.byte();
    let mut kids: Kids = Box::new([None, None, None, None]);
    for (c, kid) in kids.iter_mut().enumerate() {
        *kid = (there >> c & 1 == 1).then(|| grow(input, level - 1, false));
    }
    if kids.iter().all(Option::is_none) {
        kids[usize::from(there >> 4 & 3)] = Some(Naive::Leaf(value ^ 1));
    }
    if root || kind & 3 != 1 { Naive::Inner(value, kids) } else { Naive::Empty(kids) }
}

/// One input: a byte that says tree, `vector` tree or image, then its description.
pub fn run(data: &[u8]) {
    let mut input = Input(data);
    let mode = input.byte();
    if mode & 0x81 == 0x80 {
        let (log2, bushy) = (mode >> 1 & 7, input.below(9));
        let tree = vector_tree::grow(&mut |n| input.word() % n, log2, true, bushy);
        let pages = vector_tree::pages(&tree, log2);
        let map = compare(Kind::Vector, log2, &pages, |x, y, l| tree.lookup(log2, x, y, l));
        let resident = map.preload().expect("pages");
        for i in 0..256u32 {
            let (x, y) = (i * 37 % (1 << log2), i * 101 % (1 << log2));
            let sub = [i as u8, (i * 59) as u8];
            let want = tree.continuous(log2, x, y, sub);
            assert_eq!(map.continuous(x, y, sub).expect("a page").value, want, "{x} {y} {sub:?}");
            assert_eq!(resident.continuous(x, y, sub), want, "{x} {y} {sub:?}, preloaded");
        }
        return;
    }
    if mode & 1 == 0 {
        let (log2, cuts) = (mode >> 1 & 7, input.byte());
        let cuts: Vec<u8> = (1..8).filter(|l| cuts >> l & 1 == 1 && *l <= log2).collect();
        let tree = grow(&mut input, log2, true);
        compare(Kind::Mh, log2, &pages(&tree, log2, &cuts), |x, y, l| tree.lookup(log2, x, y, l));
        return;
    }
    let image = Image::read(&mut input);
    let (log2, values) = (image.log2, image.values());
    let mut forest = Forest::default();
    // pages in memory, in a file, or both
    let folder = Folder::new("fuzz-spool");
    let spool = match mode >> 2 & 3 {
        0 => Spool::in_memory(),
        most => Spool::beside(&folder.0.join("map.umb"), [0, 100, 4096][usize::from(most) - 1]),
    };
    let node = image.build(At { level: log2, origin: [0, 0] }, mode & 2 == 0, &mut forest, &spool);
    let root = forest.finish(node, log2, &spool);
    let pages: Vec<Page> = spool.pages(root).map(|p| p.expect("what was put aside")).collect();
    let inputs: Vec<_> = pages.iter().enumerate().map(|(i, p)| bake::input(p.clone(), Kind::Mh, i == 0)).collect();
    let expected = |x: u32, y: u32, l: u8| values[usize::from(l)][((y >> l << (log2 - l)) + (x >> l)) as usize];
    let map = compare(Kind::Mh, log2, &inputs, expected);
    for (i, (want, stored)) in image.texels.iter().zip(&values[0]).enumerate() {
        assert!((want.min..=want.max).contains(stored), "texel {i}: {stored} is not in {want:?}");
    }
    records(&image, &values, &map, &pages);
}
