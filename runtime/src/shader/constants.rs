//! The numbers that the WGSL shares with the format and with this crate. Places of fields are found by encoding them.

use std::fmt::Write;

use umbrage_format::Kind;
use umbrage_format::kind::mh::{Children, Mask, Node, NodeType, ROOT_GROUP};
use umbrage_format::kind::mmh;
use umbrage_format::kind::vector::entry::{FINE_SHIFT, FINE_SLOPE_BITS, PLANE_MAX};
use umbrage_format::kind::vector::{
    BLOCK_GROUPS, BLOCK_WORDS, Header, Line, MAX_DEPTH, Mask4, Plane, Raw, Split, TOPOLOGY,
};
use umbrage_format::page::{FRAME_WORDS, FrameHead};
use umbrage_format::projection::UNCOVERED;
use umbrage_format::structure::MAX_LOG2_RESOLUTION;
use umbrage_reader::query::filter::{GRADIENT_BITS, LOD_BITS, MAX_SIDE};

use super::{
    FEEDBACK_HEAD, FEEDBACK_LOG2, FEEDBACK_PROBES, FEEDBACK_SLOTS, FEEDBACK_USED, MAPS, MOST_GAP, MOST_WEIGHT,
    STALE_RECTS, WORKGROUP,
};
use crate::query::filter::SHARE_SHIFT;
use crate::query::pool::{
    ANCESTOR, EXACT, LEVEL_SHIFT, LIT, MAX_STEPS, NONE, NOT_RESIDENT, OUTSIDE, SETTLED, STALE, WORD_SHIFT,
};
use crate::residency::slots::UNIT_WORDS;

/// Word, shift and width of a field, found by encoding it with all its bits set and all others zero.
fn field(all_ones: &[u32]) -> [u32; 3] {
    let found = (0..).zip(all_ones).find(|(_, w)| **w != 0);
    found.map_or([0; 3], |(word, bits)| [word, bits.trailing_zeros(), bits.count_ones()])
}

/// Fields by name.
fn fields() -> Vec<(&'static str, [u32; 3])> {
    let head = FrameHead { tag: 0, root_mask: 0, child_refs: 0, words: 0, root_level: 0 };
    let header = Header::default();
    let (plane, line, split) = (Plane::default(), Line::default(), Split::default());
    let (mask, raw) = (Mask4::default(), Raw::default());
    let node = |mask, children| field(&[Node { mask: Mask(mask), children }.encode()]);
    // Half of a number that stands in two words.
    let high = -1 << 32;
    vec![
        ("FRAME_MASK", field(&FrameHead { root_mask: 0xFF, ..head }.encode())),
        ("FRAME_WORDS", field(&FrameHead { words: 0xFFFF, ..head }.encode())),
        ("FRAME_REFS", field(&FrameHead { child_refs: 0xFFFF, ..head }.encode())),
        ("FRAME_LEVEL", field(&FrameHead { root_level: 0xFF, ..head }.encode())),
        ("NODE_MASK", node(0xFF, Children::Here(0))),
        ("NODE_PAGE", node(0, Children::Page(0))),
        ("NODE_AT", node(0, Children::Here(0xFFFF))),
        ("GROUPS", field(&Header { groups: 0xFFFF, ..header }.encode())),
        ("ENTRIES", field(&Header { entries: 0xFFFF, ..header }.encode())),
        ("INDEX_BITS", field(&Header { index_bits: 0xFF, ..header }.encode())),
        ("FLAGS", field(&Header { flags: 0xFF, ..header }.encode())),
        ("LINES", field(&Header { lines: 0xFFFF, ..header }.encode())),
        ("CONSTANTS", field(&Header { constants: 0xFFFF, ..header }.encode())),
        ("PLANES", field(&Header { planes: 0xFFFF, ..header }.encode())),
        ("SPLITS", field(&Header { splits: 0xFFFF, ..header }.encode())),
        ("MASKS", field(&Header { masks: 0xFFFF, ..header }.encode())),
        ("PLANE_LOW", field(&Plane { offset: 0xFFFF_FFFF, ..plane }.encode())),
        ("PLANE_HIGH", field(&Plane { offset: high, ..plane }.encode())),
        ("PLANE_X", field(&Plane { gx: -1, ..plane }.encode())),
        ("PLANE_Y", field(&Plane { gy: -1, ..plane }.encode())),
        ("PLANE_SHIFT", field(&Plane { shift: 0xFF, ..plane }.encode())),
        ("LINE_M", field(&Line { m: -1, ..line }.encode())),
        ("LINE_LOW", field(&Line { c: 0xFFFF_FFFF, ..line }.encode())),
        ("LINE_HIGH", field(&Line { c: high, ..line }.encode())),
        ("LINE_AXIS", field(&Line { axis: true, ..line }.encode())),
        ("SPLIT_LINE", field(&[Split { line: 0xFFFF, ..split }.encode()])),
        ("SPLIT_A", field(&[Split { a: 0xFFFF, ..split }.encode()])),
        ("SPLIT_B", field(&[Split { b: 0xFFFF, ..split }.encode()])),
        ("MASK_A", field(&Mask4 { entries: [0xFFFF, 0, 0], ..mask }.encode())),
        ("MASK_SELECTORS", field(&Mask4 { selectors: u32::MAX, ..mask }.encode())),
        ("RAW_BASE", field(&Raw { base: u32::MAX, ..raw }.encode())),
        ("RAW_AT", field(&Raw { at: 0xFFFF, ..raw }.encode())),
        ("RAW_WIDTH", field(&Raw { width: 0xFF, ..raw }.encode())),
        ("RAW_SHIFT", field(&Raw { shift: 0xFF, ..raw }.encode())),
    ]
}

/// Numbers by name.
fn numbers() -> Vec<(&'static str, u32)> {
    let words_of = |t: NodeType| t.words();
    let length = |words: &[u32]| words.len() as u32;
    // Of kind mmh: the bits that say where children lie, and what they say.
    let rise = |children| mmh::Node { mask: Mask(0), children }.encode();
    let places = (0..mmh::MAX_DEPENDENCIES as u8).fold(0, |all, d| all | rise(mmh::Children::Shared(d, 0)));
    let place = |children| rise(children) >> places.trailing_zeros();
    vec![
        ("KIND_MH", Kind::Mh.code()),
        ("KIND_MMH", Kind::Mmh.code()),
        ("KIND_VECTOR", Kind::Vector.code()),
        ("RISE_PLACE_SHIFT", places.trailing_zeros()),
        ("RISE_PLACE_MASK", places >> places.trailing_zeros()),
        ("RISE_HERE", place(mmh::Children::Here(0))),
        ("RISE_PAGE", place(mmh::Children::Page(0))),
        ("RISE_SHARED", place(mmh::Children::Shared(0, 0))),
        ("ROOT_GROUP", ROOT_GROUP.into()),
        ("NODE_NONE", NodeType::None as u32),
        ("NODE_LEAF", NodeType::Leaf as u32),
        ("NODE_INNER", NodeType::Inner as u32),
        ("NODE_EMPTY", NodeType::Empty as u32),
        ("WORDS_LEAF", words_of(NodeType::Leaf)),
        ("WORDS_INNER", words_of(NodeType::Inner)),
        ("WORDS_EMPTY", words_of(NodeType::Empty)),
        ("HEADER_AT", FRAME_WORDS as u32),
        ("HEADER_WORDS", length(&Header::default().encode())),
        ("FLAG_PROOFS", Header::PROOFS.into()),
        ("FLAG_SHORT_LINES", Header::SHORT_LINES.into()),
        ("TOPOLOGY", TOPOLOGY),
        ("BLOCK_GROUPS", BLOCK_GROUPS),
        ("BLOCK_WORDS", BLOCK_WORDS),
        ("LINE_WORDS", length(&Line::default().encode())),
        ("SHORT_LINE_WORDS", length(&Line::default().encode_short())),
        ("PLANE_WORDS", length(&Plane::default().encode())),
        ("SPLIT_WORDS", 1),
        ("MASK_WORDS", length(&Mask4::default().encode())),
        ("RAW_WORDS", length(&Raw::default().encode())),
        ("FINE_SLOPE_BITS", FINE_SLOPE_BITS),
        ("FINE_SHIFT", FINE_SHIFT.into()),
        ("PLANE_MAX", u32::try_from(PLANE_MAX).unwrap_or(u32::MAX)),
        ("MAX_DEPTH", MAX_DEPTH),
        ("UNCOVERED", UNCOVERED),
        ("MAX_LOG2", MAX_LOG2_RESOLUTION.into()),
        ("MAX_STEPS", MAX_STEPS),
        ("NOT_RESIDENT", NOT_RESIDENT),
        ("NO_PAGE", NONE),
        ("UNIT_WORDS", UNIT_WORDS),
        ("FEEDBACK_HEAD", FEEDBACK_HEAD),
        ("FEEDBACK_LOG2", FEEDBACK_LOG2),
        ("FEEDBACK_SLOTS", FEEDBACK_SLOTS),
        ("FEEDBACK_PROBES", FEEDBACK_PROBES),
        ("FEEDBACK_USED", FEEDBACK_USED),
        ("MOST_GAP", MOST_GAP),
        ("MOST_WEIGHT", MOST_WEIGHT),
        ("MAX_SIDE", MAX_SIDE),
        ("GRADIENT_BITS", GRADIENT_BITS),
        ("LOD_BITS", LOD_BITS),
        ("SHARE_SHIFT", SHARE_SHIFT),
        ("LIT", LIT),
        ("ANCESTOR", ANCESTOR),
        ("OUTSIDE", OUTSIDE),
        ("EXACT", EXACT),
        ("SETTLED", SETTLED),
        ("STALE", STALE),
        ("MAPS", MAPS),
        ("STALE_RECTS", STALE_RECTS),
        ("LEVEL_SHIFT", LEVEL_SHIFT),
        ("WORD_SHIFT", WORD_SHIFT),
        ("WORKGROUP", WORKGROUP),
    ]
}

/// The constants that the WGSL shares with the format and with this crate: of fields the word, counted in the thing that
/// holds them, the shift and the number of bits.
pub fn prelude() -> String {
    let mut out = String::new();
    let places = fields().into_iter().flat_map(|(name, place)| {
        ["_WORD", "_SHIFT", "_BITS"].into_iter().zip(place).map(move |(part, value)| (name, part, value))
    });
    for (name, part, value) in places.chain(numbers().into_iter().map(|(name, value)| (name, "", value))) {
        // Writing to a string can't fail.
        let _ = writeln!(out, "const UMB_{name}{part}: u32 = {value}u;");
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn constant(name: &str) -> u32 {
        let text = prelude();
        let line = text.lines().find(|l| l.starts_with(&format!("const UMB_{name}:"))).expect(name);
        line.split(" = ").nth(1).unwrap().trim_end_matches("u;").parse().unwrap()
    }

    /// Reads a field with the generated constants as the shader does.
    fn read(words: &[u32], name: &str) -> u32 {
        let [word, shift, bits] = ["WORD", "SHIFT", "BITS"].map(|part| constant(&format!("{name}_{part}")));
        words[word as usize] >> shift & (u32::MAX >> (32 - bits))
    }

    /// The same with sign.
    fn signed(words: &[u32], name: &str) -> i32 {
        let unused = 32 - constant(&format!("{name}_BITS"));
        (read(words, name) << unused).cast_signed() >> unused
    }

    #[test]
    fn the_constants_read_what_the_format_writes() {
        for (root_mask, words) in [(0x1B, 2), (0xFF, 0xFFFF), (1, 777)] {
            let head = FrameHead { tag: 0xFF, root_mask, child_refs: 0xABCD, words, root_level: 0x17 };
            let page = head.encode();
            let found = ["FRAME_MASK", "FRAME_WORDS", "FRAME_REFS", "FRAME_LEVEL"].map(|n| read(&page, n));
            assert_eq!(found, [root_mask.into(), words.into(), 0xABCD, 0x17]);
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

    #[test]
    fn the_constants_read_vector_pages() {
        let h = Header {
            groups: 0x8001,
            entries: 0x7002,
            index_bits: 0x83,
            flags: 0x45,
            lines: 0x8104,
            constants: 0x9205,
            planes: 0xA306,
            splits: 0xB407,
            masks: 0xC508,
            raws: 0xD609,
            unused: 0xE70A,
        };
        let names = ["GROUPS", "ENTRIES", "INDEX_BITS", "FLAGS", "LINES", "CONSTANTS", "PLANES", "SPLITS", "MASKS"];
        let found = names.map(|n| read(&h.encode(), n));
        assert_eq!(found, [0x8001, 0x7002, 0x83, 0x45, 0x8104, 0x9205, 0xA306, 0xB407, 0xC508]);
        for sign in [1, -1] {
            let p = Plane { offset: sign * 0x25_1234_5678, gx: 0x12_3456 * sign as i32, gy: -0x65_4321, shift: 53 };
            let (words, high) = (p.encode(), signed(&p.encode(), "PLANE_HIGH"));
            assert_eq!(i64::from(high) << 32 | i64::from(read(&words, "PLANE_LOW")), p.offset);
            assert_eq!([signed(&words, "PLANE_X"), signed(&words, "PLANE_Y")], [p.gx, p.gy]);
            assert_eq!(read(&words, "PLANE_SHIFT"), 53);
            let l = Line { m: i32::MIN + 5, c: sign * 0x7123_89AB_CDEF, axis: sign == 1 };
            let (words, high) = (l.encode(), signed(&l.encode(), "LINE_HIGH"));
            assert_eq!(i64::from(high) << 32 | i64::from(read(&words, "LINE_LOW")), l.c);
            assert_eq!((signed(&words, "LINE_M"), read(&words, "LINE_AXIS")), (l.m, u32::from(l.axis)));
        }
        // The shader reads these from the words that it has at hand.
        assert_eq!(constant("PLANE_SHIFT_WORD"), constant("PLANE_X_WORD"));
        assert_eq!(constant("PLANE_HIGH_WORD"), constant("PLANE_Y_WORD"));
        assert_eq!(constant("PLANE_HIGH_SHIFT") + constant("PLANE_HIGH_BITS"), 32);
        assert_eq!(constant("LINE_AXIS_WORD"), constant("LINE_HIGH_WORD"));
        let s = [Split { line: 0x3A5, a: 0x5A3, b: 0x7C1 }.encode()];
        assert_eq!(["SPLIT_LINE", "SPLIT_A", "SPLIT_B"].map(|n| read(&s, n)), [0x3A5, 0x5A3, 0x7C1]);
        let m = Mask4 { entries: [0x2A5, 0x15A, 0x3C3], selectors: 0x1234_5678 };
        let (words, width) = (m.encode(), constant("MASK_A_BITS"));
        for (n, entry) in (0..3).zip(m.entries) {
            // The shader reads all three by the first.
            let found = words[constant("MASK_A_WORD") as usize] >> (constant("MASK_A_SHIFT") + n * width);
            assert_eq!(found & ((1 << width) - 1), u32::from(entry));
        }
        assert_eq!(read(&words, "MASK_SELECTORS"), m.selectors);
        let r = Raw { base: 0x8765_4321, at: 0xFEDC, width: 0x2A, shift: 0x15 };
        let found = ["RAW_BASE", "RAW_AT", "RAW_WIDTH", "RAW_SHIFT"].map(|n| read(&r.encode(), n));
        assert_eq!(found, [0x8765_4321, 0xFEDC, 0x2A, 0x15]);
    }
}
