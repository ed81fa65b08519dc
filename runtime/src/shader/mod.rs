//! The WGSL of the queries: modules without entry points, behind constants made from the format's own.
//!
//! [`module`] is what an engine puts in front of its own shader: the constants, the bindings in a group of the
//! caller's choice, and the walks. It takes 3 storage buffers and a uniform, which leaves the caller one of the four
//! that every device has. [`kernels`] adds the entry points that this crate dispatches itself.
//!
//! | binding | buffer |
//! |---|---|
//! | 0 | `umb_pool`: the words of the pages, each page from its entry's word |
//! | 1 | `umb_table`: for each page its first word in the pool, or not resident; and its first child's ordinal |
//! | 2 | `umb_feedback`: what walks missed and used, see [`FEEDBACK_LIST`] |
//! | 3 | `umb_view`: sizes, the uniform [`View`] |

use std::fmt::Write;

use umbrage_format::kind::mh::{Children, Mask, Node, NodeType, ROOT_GROUP};
use umbrage_format::page::FrameHead;
use umbrage_format::projection::UNCOVERED;
use umbrage_format::structure::MAX_LOG2_RESOLUTION;

use crate::query::mh::{ANCESTOR, EXACT, LEVEL_SHIFT, LIT, MAX_STEPS, NONE, NOT_RESIDENT, OUTSIDE, WORD_SHIFT};
use crate::residency::slots::UNIT_WORDS;

/// Words of a page table entry: first word in the pool, first child.
pub const TABLE_ENTRY_WORDS: u32 = 2;
/// Words before the list of the feedback: how many distinct pages were missed, how many queries an ancestor answered.
pub const FEEDBACK_HEAD: u32 = 4;
/// Most ordinals in the list.
pub const FEEDBACK_CAPACITY: u32 = 4096;
/// Words of head and list; behind them one bit for each unit of the pool that was used, then one for each page that
/// is in the list already.
pub const FEEDBACK_LIST: u32 = FEEDBACK_HEAD + FEEDBACK_CAPACITY;
/// Invocations of a workgroup in [`kernels`].
pub const WORKGROUP: u32 = 64;

/// Declares a uniform of words once, for both languages.
macro_rules! uniform {
    ($(#[doc = $doc:literal])+ $name:ident { $($(#[doc = $fdoc:literal])+ $field:ident,)+ }) => {
        $(#[doc = $doc])+
        #[derive(Clone, Copy, Debug, PartialEq, Eq, bytemuck::Pod, bytemuck::Zeroable)]
        #[repr(C)]
        pub struct $name {
            $($(#[doc = $fdoc])+ pub $field: u32,)+
        }

        impl $name {
            /// The struct in WGSL.
            fn wgsl() -> String {
                concat!("struct Umb", stringify!($name), " {\n", $("    ", stringify!($field), ": u32,\n",)+ "}\n").into()
            }
        }
    };
}

uniform! {
    /// Sizes of the other buffers.
    View {
        /// Words of the pool.
        pool_words,
        /// Pages of the structure: entries of the table.
        pages,
        /// Levels below the root.
        log2_resolution,
        /// Words of the feedback's used bits.
        used_words,
    }
}

const MH: &str = include_str!("query/mh.wgsl");
const LATTICE: &str = include_str!("lattice.wgsl");
const KERNELS: &str = include_str!("kernel.wgsl");

/// Word and shift of a field, found by encoding it.
fn field<const N: usize>(one: [u32; N]) -> (usize, u32) {
    one.iter().enumerate().find(|(_, w)| **w != 0).map_or((0, 0), |(i, w)| (i, w.trailing_zeros()))
}

/// The constants that the WGSL shares with the format and with this crate.
pub fn prelude() -> String {
    let zero = FrameHead { tag: 0, root_mask: 0, child_refs: 0, words: 0, root_level: 0 };
    let (mask_word, mask_shift) = field(FrameHead { root_mask: 1, ..zero }.encode());
    let (words_word, words_shift) = field(FrameHead { words: 1, ..zero }.encode());
    let node = |mask, children| field([Node { mask: Mask(mask), children }.encode()]).1;
    let words_of = |t: NodeType| t.words();
    let constants: &[(&str, u32)] = &[
        ("FRAME_MASK_WORD", mask_word as u32),
        ("FRAME_MASK_SHIFT", mask_shift),
        ("FRAME_WORDS_WORD", words_word as u32),
        ("FRAME_WORDS_SHIFT", words_shift),
        ("ROOT_GROUP", ROOT_GROUP.into()),
        ("NODE_NONE", NodeType::None as u32),
        ("NODE_LEAF", NodeType::Leaf as u32),
        ("NODE_INNER", NodeType::Inner as u32),
        ("NODE_EMPTY", NodeType::Empty as u32),
        ("WORDS_LEAF", words_of(NodeType::Leaf)),
        ("WORDS_INNER", words_of(NodeType::Inner)),
        ("WORDS_EMPTY", words_of(NodeType::Empty)),
        ("NODE_MASK_SHIFT", node(1, Children::Here(0))),
        ("NODE_PAGE_SHIFT", node(0, Children::Page(0))),
        ("NODE_AT_SHIFT", node(0, Children::Here(1))),
        ("UNCOVERED", UNCOVERED),
        ("MAX_LOG2", MAX_LOG2_RESOLUTION.into()),
        ("MAX_STEPS", MAX_STEPS),
        ("NOT_RESIDENT", NOT_RESIDENT),
        ("NO_PAGE", NONE),
        ("UNIT_WORDS", UNIT_WORDS),
        ("FEEDBACK_HEAD", FEEDBACK_HEAD),
        ("FEEDBACK_CAPACITY", FEEDBACK_CAPACITY),
        ("FEEDBACK_LIST", FEEDBACK_LIST),
        ("LIT", LIT),
        ("ANCESTOR", ANCESTOR),
        ("OUTSIDE", OUTSIDE),
        ("EXACT", EXACT),
        ("LEVEL_SHIFT", LEVEL_SHIFT),
        ("WORD_SHIFT", WORD_SHIFT),
        ("WORKGROUP", WORKGROUP),
    ];
    let mut out = String::new();
    for (name, value) in constants {
        // Writing to a string can't fail.
        let _ = writeln!(out, "const UMB_{name}: u32 = {value}u;");
    }
    out
}

/// Bindings of the module in bind group `group`.
fn bindings(group: u32) -> String {
    let declare = |binding, what| format!("@group({group}) @binding({binding}) {what};\n");
    [
        View::wgsl(),
        declare(0, "var<storage, read> umb_pool: array<u32>"),
        declare(1, "var<storage, read> umb_table: array<vec2<u32>>"),
        declare(2, "var<storage, read_write> umb_feedback: array<atomic<u32>>"),
        declare(3, "var<uniform> umb_view: UmbView"),
    ]
    .concat()
}

/// Source of the queries for the caller's shader: constants, bindings in group `group`, functions.
pub fn module(group: u32) -> String {
    [&prelude(), &bindings(group), MH, LATTICE].concat()
}

/// [`module`] in group 0 with the entry points `answer` and `pixels`, whose buffers are in group 1.
pub fn kernels() -> String {
    [&module(0), KERNELS].concat()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn constant(name: &str) -> u32 {
        let text = prelude();
        let line = text.lines().find(|l| l.starts_with(&format!("const UMB_{name}:"))).expect(name);
        line.split(" = ").nth(1).unwrap().trim_end_matches("u;").parse().unwrap()
    }

    /// Reads words with the generated constants as the shader does, and holds the result against the format.
    #[test]
    fn the_constants_read_what_the_format_writes() {
        for (root_mask, words) in [(0x1B, 2), (0xFF, 0xFFFF), (1, 777)] {
            let head = FrameHead { tag: 0xFF, root_mask, child_refs: 0xABCD, words, root_level: 0xFF };
            let page = head.encode();
            let read = |w: &str, s: &str| page[constant(w) as usize] >> constant(s);
            assert_eq!(read("FRAME_MASK_WORD", "FRAME_MASK_SHIFT") & 0xFF, u32::from(root_mask));
            assert_eq!(read("FRAME_WORDS_WORD", "FRAME_WORDS_SHIFT") & 0xFFFF, u32::from(words));
        }
        for mask in 0..=255u8 {
            for children in [Children::Here(0x1234), Children::Page(0xFFFF), Children::Here(2)] {
                let word = Node { mask: Mask(mask), children }.encode();
                assert_eq!(word >> constant("NODE_MASK_SHIFT") & 0xFF, u32::from(mask));
                let at = word >> constant("NODE_AT_SHIFT") & 0xFFFF;
                let page = word >> constant("NODE_PAGE_SHIFT") & 1 != 0;
                assert_eq!(children, if page { Children::Page(at as u16) } else { Children::Here(at as u16) });
            }
        }
    }

    /// Engines of other APIs take the module through naga: it is valid WGSL, and both HLSL and SPIR-V come out.
    #[test]
    fn the_kernels_translate_to_hlsl_and_spir_v() {
        let module = naga::front::wgsl::parse_str(&kernels()).unwrap();
        let flags = naga::valid::ValidationFlags::all();
        let info = naga::valid::Validator::new(flags, naga::valid::Capabilities::empty()).validate(&module).unwrap();
        let mut text = String::new();
        let options = naga::back::hlsl::Options::default();
        let pipeline = naga::back::hlsl::PipelineOptions::default();
        naga::back::hlsl::Writer::new(&mut text, &options, &pipeline).write(&module, &info, None).unwrap();
        assert!(text.contains("umb_mh(") && text.contains("InterlockedOr"));
        let words = naga::back::spv::write_vec(&module, &info, &naga::back::spv::Options::default(), None).unwrap();
        assert!(words.len() > 500);
        let storage =
            module.global_variables.iter().filter(|(_, v)| matches!(v.space, naga::AddressSpace::Storage { .. }));
        assert_eq!(storage.count(), 4);
    }

    /// The walk's source has no entry point, so that a caller can join it with any shader.
    #[test]
    fn the_module_has_no_entry_point() {
        assert!(!module(2).contains("@compute") && module(2).contains("@group(2) @binding(0)"));
        assert_eq!(kernels().matches("@compute").count(), 2);
    }
}
