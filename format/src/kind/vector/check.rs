//! The rules of a page, in the order of `spec/vector.md`, Checks of a page.

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing,
    clippy::cast_possible_truncation
)]

use alloc::vec::Vec;

use super::{
    BLOCK_GROUPS, BLOCK_WORDS, Header, Layout, Levels, MAX_DEPTH, MAX_GROUPS, Plane, Square, TOPOLOGY, bounds, eval,
    word,
};
use crate::error::{FormatError, Rule, Value};
use crate::kind::mh::Mask;
use crate::kind::tree::{PageCounts, check_place};
use crate::page::{FrameHead, PageContext};

/// Checks the words of a page whose frame has been checked. Time and memory are linear in the words.
///
/// # Errors
/// `vector.*`; the offset is that of the word at fault.
pub fn check(page: &[u32], head: &FrameHead, cx: &PageContext<'_>) -> Result<PageCounts, FormatError> {
    check_place(head, cx, [Rule::VectorPlain, Rule::VectorRoot, Rule::VectorFootprint])?;
    let header = check_header(page, head, cx)?;
    let layout = Layout::new(&header, head.child_refs);
    let checker = Checker { page, head, cx, header, layout };
    let (mut counts, squares) = checker.topology()?;
    if counts.level_finest != cx.page.level_finest {
        let (expected, found) = (Value::Number(cx.page.level_finest.into()), Value::Number(counts.level_finest.into()));
        return Err(cx.fault(Rule::VectorLevels, 0, expected, found));
    }
    checker.lines_and_planes()?;
    checker.splits()?;
    checker.masks()?;
    let raws = checker.raws()?;
    checker.indexes(&squares, &raws, &mut counts)?;
    checker.padding()?;
    Ok(counts)
}

/// Words 2 to 6, and the room that their sections take.
fn check_header(page: &[u32], head: &FrameHead, cx: &PageContext<'_>) -> Result<Header, FormatError> {
    let number = |v: u32| Value::Number(v.into());
    let length = page.len() as u64;
    if length < TOPOLOGY.into() {
        return Err(cx.fault(Rule::VectorLength, 1, Value::AtLeast(TOPOLOGY.into()), Value::Number(length)));
    }
    let h = Header::decode(page);
    let fault = |word, expected, found| Err(cx.fault(Rule::VectorHeader, word, expected, found));
    if h.groups == 0 || h.groups > MAX_GROUPS {
        return fault(2, Value::Between(1, MAX_GROUPS.into()), number(h.groups.into()));
    }
    let most = if h.lines == 0 { Header::PROOFS } else { Header::PROOFS | Header::SHORT_LINES };
    if h.flags > most {
        return fault(3, Value::AtMost(most.into()), number(h.flags.into()));
    }
    if h.unused != 0 {
        return fault(6, Value::Number(0), number(h.unused.into()));
    }
    if u32::from(h.index_bits) != h.needed_bits() {
        return fault(3, number(h.needed_bits()), number(h.index_bits.into()));
    }
    let least = u64::from(TOPOLOGY + h.section_words(head.child_refs).iter().sum::<u32>());
    if least > length {
        return Err(cx.fault(Rule::VectorLength, 1, Value::AtLeast(least), Value::Number(length)));
    }
    Ok(h)
}

struct Checker<'a> {
    page: &'a [u32],
    head: &'a FrameHead,
    cx: &'a PageContext<'a>,
    header: Header,
    /// Exact: the sections lie inside the page, so every number fits.
    layout: Layout,
}

impl Checker<'_> {
    fn fault<T>(&self, rule: Rule, at: u32, expected: Value, found: u32) -> Result<T, FormatError> {
        Err(self.cx.fault(rule, at as usize, expected, Value::Number(found.into())))
    }

    fn word(&self, at: u32) -> u32 {
        word(self.page, at)
    }

    /// Counts and levels of the groups, and the first texel of each in the footprint.
    fn topology(&self) -> Result<(PageCounts, Vec<(u32, u32)>), FormatError> {
        let mut counts = PageCounts { min: u32::MAX, level_finest: self.head.root_level, ..PageCounts::default() };
        let groups = u32::from(self.header.groups);
        let mut squares = Vec::with_capacity(groups as usize);
        squares.push((0u32, 0u32));
        let mut levels = Levels::new(self.head);
        let (mut children, mut entries, mut stubs) = (0u32, 0u32, 0u16);
        for block in 0..groups.div_ceil(BLOCK_GROUPS) {
            let at = TOPOLOGY + BLOCK_WORDS * block;
            // Both are below 2^17; ranks that do not fit 16 bits can't be written.
            let ranks = u64::from(children) | u64::from(entries) << 16;
            let first = block * BLOCK_GROUPS;
            if children > 0xFFFF || u64::from(self.word(at)) != ranks {
                return self.fault(Rule::VectorRanks, at, Value::Hex(ranks), self.word(at));
            }
            for number in first..groups.min(first + BLOCK_GROUPS) {
                let place = at + 1 + (number - first) / 4;
                let [mask, ..] = (self.word(place) >> (8 * (number % 4))).to_le_bytes();
                if number == 0 && mask != self.head.root_mask {
                    return self.fault(Rule::VectorRoot, place, Value::Hex(self.head.root_mask.into()), mask.into());
                }
                if children < number {
                    return self.fault(Rule::VectorOrder, place, Value::AtLeast(number.into()), children);
                }
                let level = levels.of(number, children);
                if mask == 0 {
                    let listed = self.stub(stubs);
                    if listed != Some(number) {
                        let found = Value::Number(listed.unwrap_or(0).into());
                        let at = usize::from(self.layout.stubs_at) + usize::from(stubs / 2);
                        return Err(self.cx.fault(Rule::VectorStubs, at, Value::Number(number.into()), found));
                    }
                    stubs += 1;
                    continue;
                }
                counts.level_finest = counts.level_finest.min(level);
                let mask = Mask(mask);
                let (x, y) = squares.get(number as usize).copied().unwrap_or((0, 0));
                for c in 0..4 {
                    let kind = mask.child(c);
                    counts.add(kind);
                    entries += u32::from(kind.has_value());
                    if !kind.has_children() {
                        continue;
                    }
                    if level == 0 {
                        let expected = Value::Text("no children at level 0");
                        return self.fault(Rule::VectorDepth, place, expected, kind as u32);
                    }
                    children += 1;
                    // More children than groups are a fault that is told when all are counted.
                    if children < groups {
                        squares.push((x + ((c & 1) << (level & 31)), y + ((c >> 1) << (level & 31))));
                    }
                }
            }
            if first + BLOCK_GROUPS > groups {
                self.behind_last_group(at, groups - first)?;
            }
        }
        if children != groups - 1 {
            return self.fault(Rule::VectorOrder, 2, Value::Number((groups - 1).into()), children);
        }
        if entries != u32::from(self.header.entries) {
            return self.fault(Rule::VectorHeader, 2, Value::Number(entries.into()), self.header.entries.into());
        }
        let unused = self.layout.indexes_at.saturating_sub(1);
        let half = if stubs % 2 == 1 { self.word(unused.into()) >> 16 } else { 0 };
        if stubs != self.head.child_refs || half != 0 {
            let found = if half != 0 { half } else { stubs.into() };
            let expected = Value::Number(if half != 0 { 0 } else { self.head.child_refs.into() });
            return self.fault(Rule::VectorStubs, unused.into(), expected, found);
        }
        Ok((counts, squares))
    }

    /// Number of the i-th stub as listed.
    fn stub(&self, i: u16) -> Option<u32> {
        let at = u32::from(self.layout.stubs_at) + u32::from(i / 2);
        (i < self.head.child_refs).then(|| self.word(at) >> (16 * u32::from(i % 2)) & 0xFFFF)
    }

    /// Bytes of the last block that belong to no group.
    fn behind_last_group(&self, block: u32, groups: u32) -> Result<(), FormatError> {
        for i in 0..BLOCK_WORDS - 1 {
            let used = groups.saturating_sub(4 * i).min(4);
            self.unused(block + 1 + i, 8 * used)?;
        }
        Ok(())
    }

    /// Bits of a word from `bits` on are zero.
    fn unused(&self, at: u32, bits: u32) -> Result<(), FormatError> {
        let rest = self.word(at).checked_shr(bits).unwrap_or(0);
        if rest == 0 { Ok(()) } else { self.fault(Rule::VectorPadding, at, Value::Number(0), rest) }
    }

    fn lines_and_planes(&self) -> Result<(), FormatError> {
        if !self.layout.short_lines && self.header.lines > 0 {
            let mut short = true;
            for i in 0..self.header.lines {
                let at = u32::from(self.layout.lines_at) + 3 * u32::from(i) + 2;
                if self.word(at) >> 17 != 0 {
                    return self.fault(Rule::VectorLine, at, Value::Number(0), self.word(at) >> 17);
                }
                short &= eval::line(self.page, &self.layout, i).is_short();
            }
            if short {
                let expected = Value::Text("short lines, bit 1 of the flags");
                return self.fault(Rule::VectorLine, 3, expected, self.header.flags.into());
            }
        }
        for i in 0..u32::from(self.header.planes) {
            let at = u32::from(self.layout.planes_at) + 3 * i;
            let words = [0, 1, 2].map(|k| self.word(at + k));
            if words[1] >> 31 == 1 && !Plane::decode(words).is_fine() {
                return self.fault(Rule::VectorPlane, at + 1, Value::Number(0), 1);
            }
        }
        Ok(())
    }

    fn splits(&self) -> Result<(), FormatError> {
        let first = self.layout.first_split;
        let mut depths: Vec<u8> = Vec::with_capacity(self.header.splits.into());
        for i in 0..self.header.splits {
            let at = u32::from(self.layout.splits_at) + u32::from(i);
            let s = eval::split(self.page, &self.layout, u32::from(first) + u32::from(i));
            if s.line >= self.header.lines {
                return self.fault(Rule::VectorSplit, at, Value::Text("a line of the page"), s.line.into());
            }
            let mut depth = 1;
            for side in [s.a, s.b] {
                // Plain entries have depth 0, splits behind this one have none yet.
                let below = match side.checked_sub(first) {
                    None => Some(0),
                    Some(i) => depths.get(usize::from(i)).copied(),
                };
                let Some(below) = below else {
                    return self.fault(Rule::VectorSplit, at, Value::Text("an entry before the split"), side.into());
                };
                depth = depth.max(below + 1);
            }
            if u32::from(depth) > MAX_DEPTH {
                return self.fault(Rule::VectorSplit, at, Value::AtMost(MAX_DEPTH.into()), depth.into());
            }
            depths.push(depth);
        }
        Ok(())
    }

    fn masks(&self) -> Result<(), FormatError> {
        for i in 0..u32::from(self.header.masks) {
            let at = u32::from(self.layout.masks_at) + 2 * i;
            let m = eval::mask(self.page, &self.layout, u32::from(self.layout.first_mask) + i);
            if self.word(at) >> 30 != 0 {
                return self.fault(Rule::VectorMask, at, Value::Number(0), self.word(at) >> 30);
            }
            if m.has_unknown() {
                return self.fault(Rule::VectorMask, at + 1, Value::Text("selectors 0, 1 and 2"), m.selectors);
            }
            if let Some(e) = m.entries.into_iter().find(|e| *e >= self.layout.first_split) {
                return self.fault(Rule::VectorMask, at, Value::Text("a constant or a plane"), e.into());
            }
        }
        Ok(())
    }

    /// Bounds of each raw.
    fn raws(&self) -> Result<Vec<(u32, u32)>, FormatError> {
        let mut heap = u32::from(self.layout.heap_at);
        let length = u32::try_from(self.page.len()).unwrap_or(u32::MAX);
        let mut all = Vec::with_capacity(self.header.raws.into());
        for i in 0..u32::from(self.header.raws) {
            let at = u32::from(self.layout.raws_at) + 2 * i + 1;
            let raw = eval::raw(self.page, &self.layout, u32::from(self.layout.first_raw) + i);
            if self.word(at) >> 27 != 0 {
                return self.fault(Rule::VectorRaw, at, Value::Number(0), self.word(at) >> 27);
            }
            if raw.width > 32 {
                return self.fault(Rule::VectorRaw, at, Value::AtMost(32), raw.width.into());
            }
            if u32::from(raw.at) != heap {
                return self.fault(Rule::VectorRaw, at, Value::Number(heap.into()), raw.at.into());
            }
            heap += raw.heap_words();
            if heap > length {
                return self.fault(Rule::VectorLength, at, Value::AtLeast(heap.into()), length);
            }
            let mut range = (u32::MAX, 0);
            for n in 0..16 {
                let value = raw.value(self.page, n);
                let Ok(v) = u32::try_from(value) else {
                    let found = Value::Number(value);
                    let expected = Value::AtMost(u32::MAX.into());
                    return Err(self.cx.fault(Rule::VectorRaw, usize::from(raw.at), expected, found));
                };
                range = (v.min(range.0), v.max(range.1));
            }
            if raw.width % 2 == 1 {
                self.unused(heap - 1, 16)?;
            }
            all.push(range);
        }
        if heap != length {
            return self.fault(Rule::VectorLength, 1, Value::Number(heap.into()), length);
        }
        Ok(all)
    }

    /// Every node's entry, and its bounds over the node's square.
    fn indexes(&self, squares: &[(u32, u32)], raws: &[(u32, u32)], counts: &mut PageCounts) -> Result<(), FormatError> {
        let (page, l, palette) = (self.page, &self.layout, self.header.palette());
        let (min, max) = (self.cx.page.min_depth.get(), self.cx.page.max_depth.get());
        let mut levels = Levels::new(self.head);
        let (mut children, mut index) = (0u32, 0u32);
        for (number, &(x, y)) in (0u32..).zip(squares) {
            let at = TOPOLOGY + BLOCK_WORDS * (number / BLOCK_GROUPS) + 1 + number % BLOCK_GROUPS / 4;
            let [mask, ..] = (self.word(at) >> (8 * (number % 4))).to_le_bytes();
            let (mask, level) = (Mask(mask), levels.of(number, children));
            for c in 0..4 {
                let kind = mask.child(c);
                children += u32::from(kind.has_children());
                if !kind.has_value() {
                    continue;
                }
                let (entry, at) =
                    (l.entry(page, index), u32::from(l.indexes_at) + index * u32::from(l.index_bits) / 32);
                index += 1;
                if entry >= palette {
                    let expected = Value::Text("a number of the palette");
                    return self.fault(Rule::VectorIndex, at, expected, entry);
                }
                let (low, high) = match entry.checked_sub(l.first_raw.into()) {
                    Some(i) => raws.get(i as usize).copied().unwrap_or((0, u32::MAX)),
                    None => {
                        let (x, y) = (x + ((c & 1) << (level & 31)), y + ((c >> 1) << (level & 31)));
                        bounds(page, l, entry, &Square::of_texels(x, y, level))
                    }
                };
                if low < min || high > max {
                    let expected = Value::Between(min.into(), max.into());
                    return self.fault(Rule::VectorValues, at, expected, if low < min { low } else { high });
                }
                (counts.min, counts.max) = (counts.min.min(low), counts.max.max(high));
            }
        }
        Ok(())
    }

    /// Bits behind the last index and behind the last proof.
    fn padding(&self) -> Result<(), FormatError> {
        let entries = u32::from(self.header.entries);
        let bits = entries * u32::from(self.header.index_bits);
        if !bits.is_multiple_of(32) {
            self.unused(u32::from(self.layout.indexes_at) + bits / 32, bits % 32)?;
        }
        if self.layout.proofs && !entries.is_multiple_of(32) {
            self.unused(u32::from(self.layout.proofs_at) + entries / 32, entries % 32)?;
        }
        Ok(())
    }
}
