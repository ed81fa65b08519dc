//! A naive quadtree, its lookup, the simplest pager, and files made of them.

use std::collections::VecDeque;
use std::path::PathBuf;
use std::sync::Arc;

use umbrage_format::kind::mh::{Children, Mask, Node, NodeType};
use umbrage_format::page::FrameHead;
use umbrage_format::projection::{Lattice, UNCOVERED};
use umbrage_format::structure::{EVERYWHERE, ORTHOGRAPHIC};
use umbrage_format::{Kind, PageRecord, StructureRecord};
use umbrage_reader::{Container, Limits, MemorySource};
use umbrage_writer::container::{ContainerOptions, ContainerWriter, PageInput};

/// Identity of every file here.
pub const ID: [u8; 16] = *b"umbrage test id.";

/// A node as a child would draw it.
#[derive(Debug)]
pub enum Naive {
    Leaf(u32),
    Inner(u32, Kids),
    Empty(Kids),
}

pub type Kids = Box<[Option<Naive>; 4]>;

impl Naive {
    fn value(&self) -> Option<u32> {
        match self {
            Naive::Leaf(v) | Naive::Inner(v, _) => Some(*v),
            Naive::Empty(_) => None,
        }
    }

    fn kids(&self) -> Option<&Kids> {
        match self {
            Naive::Leaf(_) => None,
            Naive::Inner(_, k) | Naive::Empty(k) => Some(k),
        }
    }

    fn kind(&self) -> NodeType {
        match self {
            Naive::Leaf(_) => NodeType::Leaf,
            Naive::Inner(..) => NodeType::Inner,
            Naive::Empty(_) => NodeType::Empty,
        }
    }

    /// The lookup by the words of the paper. `self` is a root of `1 << log2` texels.
    pub fn lookup(&self, log2: u8, x: u32, y: u32, level: u8) -> u32 {
        let (mut node, mut at, mut value) = (self, log2, UNCOVERED);
        loop {
            value = node.value().unwrap_or(value);
            if at == level.min(log2) {
                return value;
            }
            let Some(kids) = node.kids() else { return value };
            at -= 1;
            let c = (x >> at & 1) + 2 * (y >> at & 1);
            match &kids[c as usize] {
                Some(kid) => node = kid,
                None => return value,
            }
        }
    }
}

/// A small generator, so that trees are the same everywhere.
pub struct Dice(pub u64);

impl Dice {
    pub fn roll(&mut self, sides: u32) -> u32 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        ((self.0 >> 33) as u32) % sides
    }
}

/// A random tree with nodes of all types; `bushy` of 8 nodes above level 0 have children.
pub fn grow(dice: &mut Dice, level: u8, root: bool, bushy: u32) -> Naive {
    let value = dice.roll(u32::MAX);
    if level == 0 || (!root && dice.roll(8) >= bushy) {
        return Naive::Leaf(value);
    }
    let mut kids: Kids = Box::new([None, None, None, None]);
    for kid in kids.iter_mut() {
        *kid = (dice.roll(5) != 0).then(|| grow(dice, level - 1, false, bushy));
    }
    if kids.iter().all(Option::is_none) {
        kids[dice.roll(4) as usize] = Some(Naive::Leaf(value ^ 1));
    }
    if root || dice.roll(3) != 0 { Naive::Inner(value, kids) } else { Naive::Empty(kids) }
}

/// Group of a page to come: nodes, level, first texel, value from above.
struct Pending<'a> {
    group: [Option<&'a Naive>; 4],
    level: u8,
    x: u32,
    y: u32,
    inherited: Option<u32>,
    /// Place of the parent's page.
    parent: Option<usize>,
}

fn refs(kids: &Kids) -> [Option<&Naive>; 4] {
    std::array::from_fn(|c| kids[c].as_ref())
}

/// Cuts a tree into pages: the children of nodes at the levels `cuts` lie in pages of their own.
pub fn pages(tree: &Naive, log2: u8, cuts: &[u8]) -> Vec<PageInput> {
    let root =
        Pending { group: [Some(tree), None, None, None], level: log2, x: 0, y: 0, inherited: None, parent: None };
    let mut queue = VecDeque::from([root]);
    let (mut out, mut parents) = (Vec::new(), Vec::new());
    while let Some(p) = queue.pop_front() {
        let page = page(&p, cuts, out.len(), &mut queue);
        out.push(page);
        parents.push(p.parent);
    }
    // Children lie behind their parents: what they can answer, the parent can.
    for child in (0..out.len()).rev() {
        let Some(parent) = parents[child] else { continue };
        let (min, max) = (out[child].record.min_depth.get(), out[child].record.max_depth.get());
        let r = &mut out[parent].record;
        (r.min_depth, r.max_depth) = (r.min_depth.get().min(min).into(), r.max_depth.get().max(max).into());
    }
    out
}

fn page<'a>(p: &Pending<'a>, cuts: &[u8], ordinal: usize, queue: &mut VecDeque<Pending<'a>>) -> PageInput {
    let mask = |group: &[Option<&Naive>; 4]| Mask::new(group.map(|n| n.map_or(NodeType::None, Naive::kind)));
    let mut words = vec![0u32; 2];
    let mut record = PageRecord::zeroed();
    let (mut min, mut max) = (p.inherited.unwrap_or(u32::MAX), p.inherited.unwrap_or(0));
    let (mut finest, mut child_refs) = (p.level, 0u16);
    words.resize(2 + mask(&p.group).words() as usize, 0);
    let mut groups = VecDeque::from([(2usize, p.group, p.level, p.x, p.y, p.inherited)]);
    while let Some((mut at, group, level, x, y, inherited)) = groups.pop_front() {
        finest = finest.min(level);
        for (c, node) in group.iter().enumerate() {
            let Some(node) = node else { continue };
            if let Some(v) = node.value() {
                (min, max) = (min.min(v), max.max(v));
                words[at + usize::from(matches!(node, Naive::Inner(..)))] = v;
            }
            if let Some(kids) = node.kids() {
                let inner = refs(kids);
                let (x, y) = (x + ((c as u32 & 1) << level), y + ((c as u32 >> 1) << level));
                let inherited = node.value().or(inherited);
                let children = if cuts.contains(&level) {
                    let parent = Some(ordinal);
                    queue.push_back(Pending { group: inner, level: level - 1, x, y, inherited, parent });
                    child_refs += 1;
                    Children::Page(child_refs - 1)
                } else {
                    let start = words.len();
                    words.resize(start + mask(&inner).words() as usize, 0);
                    groups.push_back((start, inner, level - 1, x, y, inherited));
                    Children::Here(start as u16)
                };
                words[at] = Node { mask: mask(&inner), children }.encode();
            }
            at += node.kind().words() as usize;
        }
    }
    let root_mask = mask(&p.group).0;
    let head = FrameHead { tag: Kind::Mh.tag(), root_mask, child_refs, words: words.len() as u16, root_level: p.level };
    words[..2].copy_from_slice(&head.encode());
    let side = if ordinal == 0 { p.level } else { p.level + 1 };
    (record.origin_x, record.origin_y) = (p.x.into(), p.y.into());
    (record.log2_x, record.log2_y) = (side, side);
    (record.level_coarsest, record.level_finest) = (p.level, finest);
    (record.min_depth, record.max_depth) = (min.into(), max.into());
    record.stop_error = 1000.into();
    PageInput { words, record, dependencies: Vec::new() }
}

/// A structure record of `pages` pages with everything a caller must set.
pub fn structure(name: &str, kind: Kind, log2: u8, pages: usize) -> StructureRecord {
    let mut s = StructureRecord::zeroed();
    assert!(s.set_name(name));
    let steps = f64::from(1u32 << 8);
    let world_to_lattice = [[steps, 0.0, 0.0, 0.0], [0.0, steps, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];
    s.set_lattice(&Lattice { world_to_lattice, log2_resolution: log2, subtexel_bits: 8 });
    (s.kind, s.projection) = (kind.code().into(), ORTHOGRAPHIC.into());
    (s.policy, s.guarantee) = (1.into(), EVERYWHERE.into());
    s.light_direction = [0.0, 0.0, 1.0].map(f64::into);
    (s.root_count, s.page_count) = (1.into(), (pages as u32).into());
    s
}

/// A fresh folder for one test, removed with the value.
pub struct Folder(pub PathBuf);

impl Folder {
    pub fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("umbrage-{name}-{}", std::process::id()));
        std::fs::create_dir_all(&path).unwrap();
        Self(path)
    }

    pub fn entries(&self) -> usize {
        std::fs::read_dir(&self.0).unwrap().count()
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// Writes structures and their pages and gives the bytes of the file.
pub fn write(test: &str, options: ContainerOptions, parts: &[(StructureRecord, Vec<PageInput>)]) -> Vec<u8> {
    let folder = Folder::new(test);
    let path = folder.0.join("map.umb");
    let mut writer = ContainerWriter::create(&path, options, parts.iter().map(|p| p.0).collect()).unwrap();
    for page in parts.iter().flat_map(|p| &p.1) {
        writer.push(page).unwrap();
    }
    let written = writer.finish().unwrap();
    let bytes = std::fs::read(&path).unwrap();
    assert_eq!(written.bytes, bytes.len() as u64);
    assert_eq!(folder.entries(), 1);
    bytes
}

/// The tree of the hostile tests: 8 x 8 texels on 3 levels of pages.
pub fn small(test: &str) -> (Naive, Vec<u8>) {
    let tree = grow(&mut Dice(7), 3, true, 6);
    let pages = pages(&tree, 3, &[3, 2]);
    assert!(pages.len() >= 3);
    let bytes = write(test, ContainerOptions::new(ID), &[(structure("sun", Kind::Mh, 3, pages.len()), pages)]);
    assert!(bytes.len() <= 8 << 10);
    (tree, bytes)
}

/// Opens bytes in memory.
pub fn open(bytes: Vec<u8>) -> Result<Container, umbrage_reader::ReaderError> {
    Container::open(Arc::new(MemorySource::new(bytes, "test.umb")), Limits::default())
}
