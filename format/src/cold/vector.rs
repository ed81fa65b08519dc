//! The walk of kind `vector`: counts, the topology, then the entries of the nodes from the root group down, then the
//! palette. Ranks, stubs and widths follow from these and are not stored.
//!
//! A builder makes entries as it goes over the map, so nodes in preorder name new ones nearly in the palette's order: an
//! index is one of the last 32, or is told from the one that was new in its class before. Parts of splits and masks are
//! told in the same way.

use alloc::vec;
use alloc::vec::Vec;
use core::hint::select_unpredictable;

use super::tree::GROUPS;
use super::{Coder, Model, frame, low, plain, put, unzigzag, word, zigzag};
use crate::kind::Kind;
use crate::kind::vector::{BLOCK_GROUPS, BLOCK_WORDS, Header, Line, MAX_GROUPS, Plane, TOPOLOGY, packed};
use crate::structure::MAX_LOG2_RESOLUTION;

const COUNTS: usize = plain::COUNT;
/// Types of groups by their node.
const TYPES: usize = COUNTS + 6;
/// Indexes by the one before and by whether the node is inner.
const INDEXES: usize = TYPES + 8;
const CONSTANTS: usize = INDEXES + 14;
const SLOPES: usize = CONSTANTS + 1;
const KNOWN_SLOPES: usize = SLOPES + 1;
/// Offsets of planes: of new slopes, and of those that a plane before has.
const OFFSETS: usize = KNOWN_SLOPES + 1;
const LINES: usize = OFFSETS + 2;
const LINE_SLOPES: usize = LINES + 1;
const LINE_OFFSETS: usize = LINE_SLOPES + 1;
const SPLIT_LINES: usize = LINE_OFFSETS + 2;
/// Parts of splits: a by how the line was told, b by how a was.
const SPLIT_PARTS: usize = SPLIT_LINES + 2;
/// Places of selectors in the model.
const SELECTORS: usize = SPLIT_PARTS + 6;
/// Parts of masks: the first, the second, the third where a selector names it, and where none does.
const MASK_PARTS: usize = SELECTORS + 1;

/// Tables behind the plain ones.
pub(super) const TABLES: &[(usize, u16)] = &[
    (6, 17),
    (8, 256),
    (14, 224),
    (1, 34),
    (1, 10),
    (1, 14),
    (2, 50),
    (1, 34),
    (1, 34),
    (2, 50),
    (2, 24),
    (6, 68),
    (1, 16),
    (4, 68),
];

/// Indexes that are told by how long ago they were.
const RECENT: usize = 32;
/// Lengths that the distance of a new index may have, and 0.
const LENGTHS: usize = 16;
/// Lines that are told by how long ago a split had them.
const RECENT_LINES: usize = 8;
/// Planes and lines whose slopes are told by how long ago they were.
const RECENT_PLANES: usize = 8;
const RECENT_SLOPES: u32 = 16;

/// A page as its words have it; of no words, where numbers are read, all zero.
struct Real<'a> {
    words: &'a [u32],
    header: Header,
    starts: [u32; 10],
}

impl<'a> Real<'a> {
    fn new(words: &'a [u32]) -> Self {
        let header = Header::decode(words);
        Self { words, header, starts: starts(&header, word(words, 0) >> 16) }
    }

    fn first(&self, section: usize) -> usize {
        self.starts.get(section).map_or(usize::MAX, |s| *s as usize)
    }

    fn at(&self, section: usize, i: usize) -> u32 {
        word(self.words, self.first(section).saturating_add(i))
    }

    fn bits(&self, section: usize, width: u32, i: u32) -> u32 {
        packed(self.words, self.starts.get(section).copied().unwrap_or(u32::MAX), width, i)
    }
}

/// First word of each section.
fn starts(h: &Header, refs: u32) -> [u32; 10] {
    let mut end = TOPOLOGY;
    h.section_words(u16::try_from(refs).unwrap_or(u16::MAX)).map(|length| {
        let start = end;
        end += length;
        start
    })
}

/// A group of the topology.
#[derive(Clone, Copy)]
struct Group {
    mask: u8,
    /// Of its nodes how many have children, and how many an entry.
    nodes: u8,
    values: u8,
    /// Group below its first child that has children.
    below: u32,
    /// Index of its first node with an entry.
    entries: u32,
}

pub(super) fn walk<C: Coder>(c: &mut C, model: &Model, words: &[u32], out: &mut [u32]) -> Option<()> {
    let (w0, w1) = frame(c, Kind::Vector, words, out)?;
    let real = Real::new(words);
    let h = real.header;
    let flags = c.bits(2, || u32::from(h.flags));
    let mut count = |i: usize, known: u16| u16::try_from(c.number(COUNTS + i, || known.into())).ok();
    let (lines, constants, planes) = (count(0, h.lines)?, count(1, h.constants)?, count(2, h.planes)?);
    let (splits, masks, raws) = (count(3, h.splits)?, count(4, h.masks)?, count(5, h.raws)?);
    let ([_, root_mask, ..], [_, _, level, _]) = (w0.to_le_bytes(), w1.to_le_bytes());
    if level > MAX_LOG2_RESOLUTION {
        return None;
    }
    let (groups, entries) = topology(c, words, out, root_mask, level)?;
    let mut header = Header {
        groups: u16::try_from(groups.len()).ok()?,
        entries: u16::try_from(entries).ok()?,
        flags: flags.to_le_bytes()[0],
        lines,
        constants,
        planes,
        splits,
        masks,
        raws,
        ..Header::default()
    };
    [header.index_bits, ..] = header.needed_bits().to_le_bytes();
    for (i, word) in (2..).zip(header.encode()) {
        put(out, i, word)?;
    }
    let at = starts(&header, w0 >> 16);
    let heap = at.last()? + 2 * u32::from(raws);
    if heap as usize > out.len() || (raws == 0 && heap as usize != out.len()) {
        return None;
    }
    let [_, stubs_at, indexes_at, proofs_at, lines_at, constants_at, planes_at, splits_at, masks_at, raws_at] =
        at.map(|a| a as usize);
    stubs(&groups, out, stubs_at, w0 >> 16)?;
    let mut sum = 0u32;
    let [c0, c1, c2, c3, c4] = [0, constants, planes, splits, masks].map(|n| {
        sum += u32::from(n);
        sum
    });
    let base = [c0, c1, c2, c3, c4, 0, 0, 0];
    indexes(c, &real, out, &groups, &header, base, [indexes_at, proofs_at])?;
    // Half the side of the page's square, in places.
    let centre = 128i64 << (level + 1);
    each_line(c, &real, out, lines_at, &header, centre)?;
    let mut before = 0u32;
    for i in 0..usize::from(constants) {
        let d = c.number(CONSTANTS, || zigzag(real.at(5, i).wrapping_sub(before).cast_signed().into()));
        before = before.wrapping_add(low(unzigzag(d).cast_unsigned()));
        put(out, constants_at + i, before)?;
    }
    each_plane(c, &real, model, out, planes_at, planes, centre)?;
    each_split(c, &real, out, splits_at, splits, base)?;
    each_mask(c, &real, model, out, masks_at, masks, base)?;
    // No baker writes raws yet.
    for i in raws_at..out.len() {
        let found = c.bits(32, || word(words, i));
        put(out, i, found)?;
    }
    Some(())
}

/// Types of all groups, level by level, with their ranks; returns the groups and the number of nodes with an entry.
fn topology<C: Coder>(c: &mut C, words: &[u32], out: &mut [u32], root: u8, level: u8) -> Option<(Vec<Group>, u32)> {
    let most = (out.len() / BLOCK_WORDS as usize * BLOCK_GROUPS as usize).min(MAX_GROUPS.into());
    let mut groups: Vec<Group> = Vec::with_capacity(most.min(out.len()));
    // Table of each group to come; of the root group, whose types the frame has, none.
    let (mut tables, mut count) = (vec![0u8; most + 4], 1usize);
    let (mut entries, mut level, mut next) = (0u32, level, 1usize);
    let mut number = 0usize;
    while number < count {
        let table = *tables.get(number)?;
        if number == next {
            (level, next) = (level.saturating_sub(1), count);
        }
        let block = TOPOLOGY as usize + number / BLOCK_GROUPS as usize * BLOCK_WORDS as usize;
        let below = u32::try_from(count).ok()?;
        if number.is_multiple_of(BLOCK_GROUPS as usize) {
            put(out, block, (below - 1) & 0xFFFF | entries << 16)?;
        }
        let (place, shift) = (block + 1 + number % 16 / 4, 8 * (number % 4));
        let mask = if number == 0 {
            root
        } else {
            c.symbol(TYPES + usize::from(table), || word(words, place) >> shift & 0xFF).to_le_bytes()[0]
        };
        *out.get_mut(place)? |= u32::from(mask) << shift;
        let own = GROUPS.get(usize::from(mask))?;
        groups.push(Group { mask, nodes: own.nodes, values: own.values, below, entries });
        entries += u32::from(own.values);
        // Four at a time: what is too many is overwritten.
        let context = u32::from(level.saturating_sub(1).min(3)) * 0x0101_0101;
        *tables.get_mut(count..)?.first_chunk_mut::<4>()? = (own.empty * 4 + context).to_le_bytes();
        count += usize::from(own.nodes);
        if count > most {
            return None;
        }
        number += 1;
    }
    Some((groups, entries))
}

/// Numbers of the groups without nodes.
fn stubs(groups: &[Group], out: &mut [u32], at: usize, refs: u32) -> Option<()> {
    let mut count = 0usize;
    for (number, _) in (0u32..).zip(groups).skip(1).filter(|(_, g)| g.mask == 0) {
        if count >= refs as usize {
            return None;
        }
        *out.get_mut(at + count / 2)? |= number << (16 * (count % 2));
        count += 1;
    }
    (count == refs as usize).then_some(())
}

/// Puts a number of `width` bits behind `n` others; `None` outside.
#[inline]
fn pack(out: &mut [u32], at: usize, width: u32, n: u32, number: u32) -> Option<()> {
    let bit = n * width;
    let first = at + (bit / 32) as usize;
    let bits = u64::from(number) << (bit % 32);
    *out.get_mut(first)? |= low(bits);
    // Whether bits are left can't be foreseen; words behind mostly are there.
    let high = low(bits >> 32);
    match out.get_mut(first + 1) {
        Some(word) => *word |= high,
        None if high != 0 => return None,
        None => {}
    }
    Some(())
}

/// Numbers of the palette at which its classes start: constants, planes, splits, masks, raws; the rest is 0, so that three
/// bits are a place.
type Starts = [u32; 8];

/// Class of a number of the palette.
fn class(starts: &Starts, index: u32) -> usize {
    starts.iter().take(5).skip(1).filter(|start| index >= **start).count()
}

fn of(starts: &Starts, class: usize) -> u32 {
    starts.get(class).copied().unwrap_or(0)
}

/// Bits of a number.
fn length(n: u64) -> u32 {
    u64::BITS - n.leading_zeros()
}

/// How far a number is from where one of its class is expected.
fn ahead(number: u32, expected: u32) -> u64 {
    zigzag(i64::from(number) - i64::from(expected))
}

/// Back from [`ahead`].
fn from(expected: u32, ahead: u64) -> u32 {
    expected.wrapping_add(low(unzigzag(ahead).cast_unsigned()))
}

fn indexes<C: Coder>(
    c: &mut C,
    real: &Real<'_>,
    out: &mut [u32],
    groups: &[Group],
    header: &Header,
    starts: Starts,
    [at, proofs_at]: [usize; 2],
) -> Option<()> {
    let count = usize::from(header.entries);
    // Nodes with an entry in preorder of their groups: bit 0 whether it is inner, above it its number. Each time four are
    // written, whatever there is: what is too many is overwritten.
    let mut order = vec![0u32; count + 4];
    let mut pending = vec![0u32; groups.len() + 4];
    let (mut waits, mut met, mut top) = (1usize, 0usize, 0u32);
    while let Some(left) = waits.checked_sub(1) {
        let g = *groups.get(top as usize)?;
        let own = GROUPS.get(usize::from(g.mask))?;
        let first = 2 * g.entries;
        *order.get_mut(met..)?.first_chunk_mut()? = own.order.map(|o| first.wrapping_add(o));
        met += usize::from(g.values);
        let nodes = u32::from(g.nodes);
        // The group that comes next is at hand, the others wait.
        let under = pending.get(left.wrapping_sub(1)).copied().unwrap_or(0);
        top = select_unpredictable(nodes == 0, under, g.below);
        let last = g.below.wrapping_add(nodes).wrapping_sub(1);
        *pending.get_mut(left..)?.first_chunk_mut()? = [0, 1, 2, 3].map(|back| last.wrapping_sub(back));
        waits = left + nodes as usize;
    }
    order.truncate(met);
    let (proofs, width) = (header.flags != 0, u32::from(header.index_bits));
    let mut next = starts;
    let mut recent = [0u32; RECENT];
    let (mut before, mut all) = (0usize, 0u32);
    for (i, node) in order.into_iter().enumerate() {
        let (inner, node) = (node & 1, node >> 1);
        let ago = |recent: &[u32; RECENT], ago: usize| at_turn(recent, i.wrapping_sub(1).wrapping_sub(ago));
        let known = real.bits(2, width, node);
        let symbol = c.symbol(INDEXES + before * 2 + inner as usize, || {
            let proven = u32::from(proofs) & real.bits(3, 1, node);
            let told = (0..RECENT.min(i)).find(|a| ago(&recent, *a) == known).unwrap_or_else(|| {
                let class = class(&starts, known);
                RECENT + class * LENGTHS + length(ahead(known, of(&next, class))) as usize
            });
            u32::try_from(told).unwrap_or(0) << 1 | proven
        });
        let told = (symbol >> 1) as usize;
        // Both ways at once: which one it is can't be foreseen.
        let (is_new, new) = (told >= RECENT, told.saturating_sub(RECENT));
        let expected = next.get_mut((new / LENGTHS) & 7)?;
        let d = c.rest(low((new % LENGTHS) as u64), ahead(known, *expected));
        let fresh = from(*expected, d);
        *expected = select_unpredictable(is_new & (d & 1 == 0), fresh.wrapping_add(1), *expected);
        let index = select_unpredictable(is_new, fresh, ago(&recent, told));
        before = select_unpredictable(is_new, 2 + new / LENGTHS, usize::from(told != 0));
        all |= index;
        *recent.get_mut(i % RECENT)? = index;
        pack(out, at, width, node, index)?;
        if proofs {
            *out.get_mut(proofs_at + (node / 32) as usize)? |= (symbol & 1) << (node % 32);
        }
    }
    // One that has more bits has spoilt its neighbours.
    (u64::from(all) >> width == 0).then_some(())
}

/// The item whose turn it was at `turn`, of as many as a power of two that take turns.
#[inline]
fn at_turn<const N: usize>(items: &[u32; N], turn: usize) -> u32 {
    items.get(turn % N).copied().unwrap_or(0)
}

/// How much a line rises from the page's edge to its centre.
fn to_centre(m: i32, centre: i64) -> i64 {
    i64::from(m).wrapping_mul(centre) >> 19
}

fn each_line<C: Coder>(
    c: &mut C,
    real: &Real<'_>,
    out: &mut [u32],
    at: usize,
    header: &Header,
    centre: i64,
) -> Option<()> {
    let (short, size) = (header.flags & Header::SHORT_LINES != 0, header.line_words() as usize);
    let line = |words: &[u32], first: usize| {
        let words = words.get(first..)?;
        Some(if short { Line::decode_short(*words.first_chunk()?) } else { Line::decode(*words.first_chunk()?) })
    };
    // Of a short line's slope the lowest bit is zero.
    let unit = u32::from(short);
    for i in 0..usize::from(header.lines) {
        let own = line(real.words, real.first(4).saturating_add(size * i)).unwrap_or_default();
        let before = |ago: usize| line(out, at.checked_add(size * i.checked_sub(ago)?)?);
        let symbol = c.symbol(LINES, || {
            let same = |ago: &u32| before(*ago as usize).is_some_and(|l| l.m == own.m && l.axis == own.axis);
            (1..=RECENT_SLOPES).find(same).unwrap_or(0) << 1 | u32::from(own.axis)
        });
        let (axis, ago) = (symbol & 1 == 1, symbol >> 1);
        let (m, beside) = if ago == 0 {
            let slope = unzigzag(c.number(LINE_SLOPES, || zigzag((own.m >> unit).into())));
            ((low(slope.cast_unsigned()) << unit).cast_signed(), 0)
        } else {
            let l = before(ago as usize)?;
            (l.m, l.c)
        };
        let rise = if ago == 0 { to_centre(m, centre) - (centre << 12) } else { 0 };
        let table = LINE_OFFSETS + usize::from(ago != 0);
        let d = c.number(table, || zigzag(own.c.wrapping_add(rise).wrapping_sub(beside)));
        let found = Line { m, c: unzigzag(d).wrapping_sub(rise).wrapping_add(beside), axis };
        let (two, three) = (found.encode_short(), found.encode());
        let words = if short { &two[..] } else { &three[..] };
        for (k, word) in words.iter().enumerate() {
            put(out, at + size * i + k, *word)?;
        }
    }
    Some(())
}

/// How much a plane rises from the page's corner to its centre.
fn plane_rise([a, b]: [u32; 2], centre: i64) -> i64 {
    let Plane { gx, gy, shift, .. } = Plane::decode([0, a, b]);
    (i64::from(gx) + i64::from(gy)).wrapping_mul(centre) >> (shift & 63)
}

fn each_plane<C: Coder>(
    c: &mut C,
    real: &Real<'_>,
    model: &Model,
    out: &mut [u32],
    at: usize,
    count: u16,
    centre: i64,
) -> Option<()> {
    let mut depth = 0i64;
    for i in 0..usize::from(count) {
        let [w0, w1, w2] = [0, 1, 2].map(|k| real.at(6, 3 * i + k));
        let before = |ago: usize| {
            let first = at.checked_add(3 * i.checked_sub(ago)?)?;
            Some(Plane::slopes(out.get(first + 1).copied()?, out.get(first + 2).copied()?))
        };
        // The place among the model's slopes, where it is there.
        let place = c.slopes(Plane::slopes(w1, w2));
        let symbol = c.symbol(SLOPES, || {
            let ago = (1..=RECENT_PLANES).find(|ago| before(*ago) == Some(Plane::slopes(w1, w2)));
            ago.map_or(if place.is_some() { 9 } else { 0 }, |ago| u32::try_from(ago).unwrap_or(0))
        });
        let [a, b] = match symbol {
            0 => {
                let a = c.bits(32, || w1);
                [a, c.bits(Plane::slope_bits(a), || Plane::slopes(w1, w2)[1])]
            }
            9 => *model.slopes().get(usize::try_from(c.number(KNOWN_SLOPES, || place.unwrap_or(0).into())).ok()?)?,
            ago => before(ago as usize)?,
        };
        let rise = plane_rise([a, b], centre);
        let table = OFFSETS + usize::from((1..9).contains(&symbol));
        let d = c.number(table, || zigzag(Plane::decode([w0, w1, w2]).offset.wrapping_add(rise).wrapping_sub(depth)));
        depth = depth.wrapping_add(unzigzag(d));
        let offset = depth.wrapping_sub(rise).cast_unsigned();
        let first = at + 3 * i;
        put(out, first, low(offset))?;
        put(out, first + 1, a)?;
        put(out, first + 2, Plane::slopes(a, b)[1] | low(offset >> 32) << Plane::slope_bits(a))?;
    }
    Some(())
}

/// Symbols of a part: told by another one, then classes by [`LENGTHS`].
const TOLD: usize = 4;

/// A part of a split or mask: a number of the palette, told as one of four others or by how far it is from where the next
/// of its class is expected.
#[inline(always)]
fn part<C: Coder>(
    c: &mut C,
    table: usize,
    known: u32,
    others: [u32; TOLD],
    next: &mut Starts,
    starts: &Starts,
) -> Option<(u32, u32)> {
    let symbol = c.symbol(table, || {
        let told = others.iter().position(|o| *o == known).unwrap_or_else(|| {
            let class = class(starts, known).min(3);
            TOLD + class * LENGTHS + length(ahead(known, of(next, class))) as usize
        });
        u32::try_from(told).unwrap_or(0)
    });
    let symbol = symbol as usize;
    let (is_new, new) = (symbol >= TOLD, symbol.saturating_sub(TOLD));
    let expected = next.get_mut((new / LENGTHS) & 7)?;
    let d = c.rest(low((new % LENGTHS) as u64), ahead(known, *expected));
    let fresh = from(*expected, d);
    *expected = select_unpredictable(is_new, fresh.wrapping_add(1), *expected);
    let old = at_turn(&others, symbol);
    Some((select_unpredictable(is_new, fresh, old), 2 * u32::from(is_new)))
}

fn each_split<C: Coder>(
    c: &mut C,
    real: &Real<'_>,
    out: &mut [u32],
    at: usize,
    count: u16,
    starts: Starts,
) -> Option<()> {
    let mut next = starts;
    let mut lines = [0u32; RECENT_LINES];
    let (mut line_next, mut told, mut last) = (0u32, 0usize, [0u32; 2]);
    for i in 0..usize::from(count) {
        let known = real.at(7, i);
        let ago = |lines: &[u32; RECENT_LINES], ago: usize| at_turn(lines, i.wrapping_sub(1).wrapping_sub(ago));
        let symbol = c.symbol(SPLIT_LINES + told, || {
            let line = known & 0x3FF;
            let ago = (0..RECENT_LINES).find(|a| ago(&lines, *a) == line);
            u32::try_from(ago.unwrap_or_else(|| RECENT_LINES + length(ahead(line, line_next)) as usize)).unwrap_or(0)
        });
        // Both ways at once here, too.
        let fresh = from(line_next, c.rest(symbol.saturating_sub(8), ahead(known & 0x3FF, line_next)));
        let is_told = symbol < 8;
        let line = select_unpredictable(is_told, ago(&lines, symbol as usize), fresh);
        line_next = select_unpredictable(is_told, line_next, fresh.wrapping_add(1));
        told = usize::from(is_told);
        *lines.get_mut(i % RECENT_LINES)? = line;
        // A split that is a part is likely one of the last ones.
        *next.get_mut(2)? = starts.get(2)? + low(i as u64);
        let (a, how) = part(
            c,
            SPLIT_PARTS + told,
            known >> 10 & 0x7FF,
            [last[0], last[1], u32::MAX, u32::MAX],
            &mut next,
            &starts,
        )?;
        *next.get_mut(2)? = starts.get(2)? + low(i as u64);
        let table = SPLIT_PARTS + 2 + how as usize + told;
        let (b, _) = part(c, table, known >> 21, [last[1], last[0], u32::MAX, u32::MAX], &mut next, &starts)?;
        last = [a, b];
        put(out, at + i, line & 0x3FF | (a & 0x7FF) << 10 | b << 21)?;
    }
    Some(())
}

/// Selectors that the model does not have.
const UNKNOWN: u32 = 15;

fn each_mask<C: Coder>(
    c: &mut C,
    real: &Real<'_>,
    model: &Model,
    out: &mut [u32],
    at: usize,
    count: u16,
    starts: Starts,
) -> Option<()> {
    let mut next = starts;
    let mut last = [0u32; 3];
    for i in 0..usize::from(count) {
        let [w0, w1] = [real.at(8, 2 * i), real.at(8, 2 * i + 1)];
        let place = c.selectors(w1);
        let symbol = c.symbol(SELECTORS, || place.map_or(UNKNOWN, |place| length(place.into())));
        let rows = if symbol == UNKNOWN {
            c.bits(32, || w1)
        } else {
            *model.selectors().get(usize::try_from(c.rest(symbol, place.unwrap_or(0).into())).ok()?)?
        };
        // Whether some selector is 2.
        let third = usize::from(rows & 0xAAAA_AAAA != 0);
        let [la, lb, lc] = last;
        let (a, _) = part(c, MASK_PARTS, w0 & 0x3FF, [la, lb, lc, u32::MAX], &mut next, &starts)?;
        let (b, _) = part(c, MASK_PARTS + 1, w0 >> 10 & 0x3FF, [lb, la, lc, u32::MAX], &mut next, &starts)?;
        let (d, _) = part(c, MASK_PARTS + 3 - third, w0 >> 20 & 0x3FF, [a, lc, lb, la], &mut next, &starts)?;
        last = [a, b, d];
        put(out, at + 2 * i, a & 0x3FF | (b & 0x3FF) << 10 | (d & 0x3FF) << 20)?;
        put(out, at + 2 * i + 1, rows)?;
    }
    Some(())
}
