//! Sound `vector` pages with changes: unchanged ones are accepted; what is accepted has every node that its counts say,
//! a lookup finds each, and answers there as plain arithmetic on the words does, within the bounds that were checked.

use std::collections::HashSet;

use umbrage_format::kind::vector::{Header, check, links, nodes};
use umbrage_format::page::{FrameHead, PageContext, check_frame};
use umbrage_format::projection::UNCOVERED;
use umbrage_format::{Kind, PageRecord};
use umbrage_reader::query::vector::{PageView, continuous, descend};

use crate::input::Input;
use crate::tree::structure;
use crate::vector_tree::{grow, pages};

/// Numbers of `width` bits, by single bits.
fn packed(page: &[u32], at: usize, width: usize, n: usize) -> u64 {
    let bit = |i: usize| u64::from(page[at + i / 32] >> (i % 32) & 1);
    (0..width).map(|i| bit(n * width + i) << i).sum()
}

/// Two's complement of `bits` bits.
fn signed(v: u32, bits: u32) -> i128 {
    let v = i128::from(v) & ((1 << bits) - 1);
    if v >> (bits - 1) == 1 { v - (1 << bits) } else { v }
}

/// First word of each section behind the topology, in the order of the text.
fn sections(page: &[u32], h: &Header) -> [usize; 10] {
    let [groups, entries] = [h.groups, h.entries].map(usize::from);
    let proofs = if h.flags & 1 == 1 { entries.div_ceil(32) } else { 0 };
    let lengths = [
        5 * groups.div_ceil(16),
        (page[0] as usize >> 16).div_ceil(2),
        (entries * usize::from(h.index_bits)).div_ceil(32),
        proofs,
        line_words(h) * usize::from(h.lines),
        usize::from(h.constants),
        3 * usize::from(h.planes),
        usize::from(h.splits),
        2 * usize::from(h.masks),
        2 * usize::from(h.raws),
    ];
    let mut end = 7;
    lengths.map(|l| {
        end += l;
        end
    })
}

fn line_words(h: &Header) -> usize {
    if h.flags & 2 == 2 { 2 } else { 3 }
}

/// Offset, slopes and shift of a plane.
fn plane(w: &[u32]) -> (i128, [i128; 2], u32) {
    let low = i128::from(w[0]);
    if w[1] >> 31 == 0 {
        return ((signed(w[2] >> 25, 7) << 32) + low, [signed(w[1], 25), signed(w[2], 25)], w[1] >> 25);
    }
    // the sign of the slope in x stands with that in y
    let gx = i128::from(w[1] & 0x3FF_FFFF) - (i128::from(w[2] >> 27 & 1) << 26);
    ((signed(w[2] >> 28, 4) << 32) + low, [gx, signed(w[2], 27)], 8 + (w[1] >> 26 & 31))
}

/// Slope, offset and axis of a line.
fn line(page: &[u32], at: usize, size: usize) -> (i128, i128, bool) {
    let w = &page[at..at + size];
    if size == 2 {
        return (2 * signed(w[0], 31), signed(w[1], 32), w[0] >> 31 == 1);
    }
    (signed(w[0], 32), (signed(w[2], 16) << 32) + i128::from(w[1]), w[2] >> 16 & 1 == 1)
}

/// Value of entry `i` at a place, in 128 bits.
fn value(page: &[u32], h: &Header, i: usize, x: i128, y: i128) -> u64 {
    let [_, _, _, lines, constants, planes, splits, masks, raws, _] = sections(page, h);
    let cell = (4 * (y / 256 % 4) + x / 256 % 4) as usize;
    let first = [h.constants, h.planes, h.splits, h.masks].map(usize::from);
    if i < first[0] {
        return page[constants + i].into();
    }
    let mut i = i - first[0];
    if i < first[1] {
        let (offset, [gx, gy], shift) = plane(&page[planes + 3 * i..]);
        return (offset + (gx * x + gy * y).div_euclid(1 << shift)).clamp(0, 0xFFFF_FFFE) as u64;
    }
    i -= first[1];
    if i < first[2] {
        let s = page[splits + i];
        let size = line_words(h);
        let (m, c, axis) = line(page, lines + size * (s & 1023) as usize, size);
        let (u, t) = if axis { (y, x) } else { (x, y) };
        let beyond = t * 4096 >= c + (m * u).div_euclid(1 << 19);
        return value(page, h, (if beyond { s >> 21 } else { s >> 10 & 2047 }) as usize, x, y);
    }
    i -= first[2];
    if i < first[3] {
        let (w0, w1) = (page[masks + 2 * i], page[masks + 2 * i + 1]);
        return value(page, h, (w0 >> (10 * (w1 >> (2 * cell) & 3)) & 1023) as usize, x, y);
    }
    i -= first[3];
    let (base, w1) = (page[raws + 2 * i], page[raws + 2 * i + 1]);
    let number = packed(page, (w1 & 0xFFFF) as usize, (w1 >> 16 & 63) as usize, cell);
    u64::from(base) + (number << (w1 >> 22 & 31))
}

/// The rest of an input: 4 bytes for a tree and which of its pages, then its numbers; the last `place & 7` times 5 bytes
/// are changes: word, kind, bits.
pub fn run(log2: u8, place: u8, mut input: Input) {
    let changes = usize::from(place & 7).min(input.0.len() / 5);
    let mut edits = Input(&input.0[input.0.len() - 5 * changes..]);
    input.0 = &input.0[..input.0.len() - 5 * changes];
    let (bushy, which) = (input.below(9), input.byte());
    let tree = grow(&mut |n| input.word() % n, log2, true, bushy);
    let mut all = pages(&tree, log2);
    let ordinal = usize::from(which) % all.len();
    let page = all.swap_remove(ordinal);
    let (mut words, mut record): (Vec<u32>, PageRecord) = (page.words, page.record);
    for _ in 0..changes {
        let (at, kind, bits) = (usize::from(edits.pair()), edits.byte(), edits.pair());
        let Some(word) = words.get_mut(2 + at % 4096) else { continue };
        match kind % 5 {
            0 => *word ^= 1 << (bits & 31),
            1 => *word = word.wrapping_add(bits.into()),
            2 => *word = u32::from(bits) << (kind >> 3 & 16),
            3 => record.max_depth = u32::MAX.into(),
            _ => record.level_finest = record.level_finest.saturating_sub(1),
        }
    }
    if changes > 3 {
        (record.min_depth, record.max_depth) = (0.into(), u32::MAX.into());
    }
    let head = FrameHead::decode(&words).expect("two words");
    (record.hot_words, record.child_count, record.first_child) = (head.words.into(), head.child_refs.into(), 2.into());
    let structure = structure("s", Kind::Vector, log2, 2);
    let is_root = record.level_coarsest == log2;
    let cx = PageContext { structure: 0, ordinal: u32::from(!is_root), page: &record, record: &structure };
    check_frame(&words, &cx).expect("a frame that was made to fit");
    let counts = check(&words, &head, &cx);
    let view = PageView { words: &words, first_child: 2, dependencies: &[] };
    // A page that is not the root's is entered in its own right.
    let top = record.level_coarsest;
    let lookup = |x, y, l| descend(|o| (o == 0).then_some(view), 0, top, x, y, l);
    // Ends on any words.
    for (x, y) in [(0, 0), (u32::MAX, u32::MAX), (0x5555_5555, 0xAAAA_AAAA), (log2.into(), place.into())] {
        for l in [0, top / 2, top, 255] {
            lookup(x, y, l);
        }
        continuous(|o| (o == 0).then_some(view), 0, top, x, y, [place, which]);
    }
    links(&words, &head, &cx, None, |_, _| {});
    let Ok(counts) = counts else {
        assert!(changes > 0, "refused, and nothing is wrong with it: {counts:?}");
        return;
    };
    let (mut said, mut found) = (HashSet::new(), [0; 4]);
    links(&words, &head, &cx, None, |child, link| {
        assert!(said.insert(child) && link.level < top);
    });
    assert_eq!(said.len(), usize::from(head.child_refs));
    let h = Header::decode(&words);
    let indexes = sections(&words, &h)[1];
    nodes(&words, &head, |n| {
        found[n.kind as usize] += 1;
        let d = lookup(n.x, n.y, n.level);
        if !n.kind.has_value() {
            assert!(d.level > n.level || d.value == UNCOVERED);
            return;
        }
        assert_eq!((d.word, d.level, d.missing), (n.number, n.level, None));
        let entry = packed(&words, indexes, h.index_bits.into(), n.index as usize) as usize;
        let half = 128i128 << n.level;
        let centre = [n.x, n.y].map(|v| 256 * i128::from(v) + half);
        let want = value(&words, &h, entry, centre[0], centre[1]);
        assert_eq!(u64::from(d.value), want, "node {}", n.number);
        assert!((counts.min..=counts.max).contains(&d.value));
        for last in [0, (1u32 << n.level) - 1] {
            let d = lookup(n.x + last, n.y + last, 0);
            assert!(d.level <= n.level && (counts.min..=counts.max).contains(&d.value));
        }
    });
    assert_eq!([counts.leaves, counts.inner, counts.empty], found[1..]);
    assert!(record.min_depth.get() <= counts.min || h.entries == 0);
}
