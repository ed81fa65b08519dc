//! What the baker stores against the exact oracle, texel by texel.

use umbrage::certify::{Oracle, Region};
use umbrage::writer::hierarchy::build::{Options, build};
use umbrage::writer::mesh::Mesh;
use umbrage::writer::solid::{Policy, snap};
use umbrage::writer::{frame, scene};

/// Answers of a tree at level 0, read straight from the draft pages.
fn stored(tree: &umbrage::writer::hierarchy::build::Tree, resolution: u32, x: u32, y: u32) -> u32 {
    use umbrage::format::kind::mh::{Children, Mask, Node, NodeType, child_of};
    let mut page = 0usize;
    let mut mask = tree.pages[0].draft.root_mask;
    let mut start = 2usize;
    let mut level = resolution.ilog2() as u8;
    let mut value = 0;
    loop {
        let words = &tree.pages[page].draft.words;
        let c = if level == resolution.ilog2() as u8 { 0 } else { child_of(x, y, level) };
        let at = start + mask.words_before(c) as usize;
        match mask.child(c) {
            NodeType::None => return value,
            NodeType::Leaf => return words[at],
            NodeType::Inner => value = words[at + 1],
            NodeType::Empty => {}
        }
        if level == 0 {
            return value;
        }
        let node = Node::decode(words[at]);
        match node.children {
            Children::Here(w) => {
                start = usize::from(w);
                mask = Mask(node.mask.0);
            }
            Children::Page(p) => {
                page = tree.pages[page].first_child as usize + usize::from(p);
                start = 2;
                mask = tree.pages[page].draft.root_mask;
            }
        }
        level -= 1;
    }
}

fn check(mesh: &Mesh, direction: [f64; 3], resolution: u32, policy: Policy, exhaustive: bool) {
    let k = frame::log2_resolution(resolution.into()).unwrap();
    let lattice = frame::orthographic(direction, k, &mesh.positions, 0.0).unwrap();
    let snapped = snap(mesh, lattice, policy).unwrap();
    let tree = build(&snapped, Options { exhaustive }, &Default::default()).unwrap();
    let oracle = Oracle::new(&snapped);
    let region = Region { x: 0, y: 0, width: resolution, height: resolution };
    let t = oracle.check(region, |x, y| stored(&tree, resolution, x, y));
    assert_eq!(t.wrong, 0, "{direction:?} {resolution} {policy:?}: {:?}", t.examples);
    assert_eq!(t.edge(), tree.counts.edge_texels, "{direction:?} {resolution} {policy:?}");
    assert_eq!(t.thin, tree.counts.thin_texels, "{direction:?} {resolution} {policy:?}");
}

const LIGHTS: [[f64; 3]; 4] = [[0.4, -0.8, 0.3], [-0.23, -0.71, 0.52], [0.05, -0.99, -0.11], [0.83, -0.31, -0.4]];

#[test]
fn generated_scenes_store_only_right_values() {
    for spec in ["city:1:0.05", "scan:3:0.05", "forest:2:0.05"] {
        let mesh = scene::generated(spec).unwrap().unwrap();
        for (i, d) in LIGHTS.into_iter().enumerate() {
            for resolution in [1, 16, 64, 256, 1024] {
                check(&mesh, d, resolution, Policy::Closed, i == 1 && resolution <= 64);
            }
        }
    }
}
