//! The walk of kinds `mh` and `mmh`: first all types, from the root group down, which say where every node and every
//! value lies; then the values.
//!
//! Groups stand in preorder, so the place of a node's children is where the groups before them end. In kind `mmh` a group
//! that several nodes refer to is told by its place.
//!
//! Values of `mh` lie on few surfaces at a time. Of two, each a depth somewhere and its slopes, a value says which it is
//! told from and by how much it differs; the surface goes on from there. Slopes are those between the children of one
//! group that lie on one surface. Rises of `mmh` are told as they are.

use alloc::vec;
use alloc::vec::Vec;
use core::hint::select_unpredictable;

use super::{Coder, Model, frame, low, plain, put, unzigzag, word, zigzag};
use crate::kind::Kind;
use crate::kind::mh::Mask;
use crate::structure::MAX_LOG2_RESOLUTION;

/// Types of groups by their node: 8 tables.
const MASKS: usize = plain::COUNT;
/// Values of `mh` by what the one before was: 4 tables for leaves, 4 for inner nodes.
const VALUES: usize = MASKS + 8;
/// Rises of `mmh`: 4 tables by level for leaves, 4 for inner nodes.
const RISES: usize = MASKS + 8;
/// Where groups of `mmh` lie that are not told by their order.
const PLACES: usize = RISES + 8;
/// Which dependency.
const DEPENDENCIES: usize = PLACES + 1;
/// Whether an entry's group comes before those that wait.
const ENTRIES: usize = DEPENDENCIES + 1;

/// Tables of `mh` behind the plain ones.
pub(super) const MH_TABLES: &[(usize, u16)] = &[(8, 256), (8, 128)];
/// Tables of `mmh`.
pub(super) const MMH_TABLES: &[(usize, u16)] = &[(8, 256), (8, 40), (1, 3), (1, 10), (1, 2)];

/// A group that has been met.
#[derive(Clone, Copy, Default)]
struct Met {
    /// Its first texel, half texels from the page's corner; y in the high half. Of kind `mh` alone.
    corner: u64,
    /// First word.
    start: u16,
    /// Level of its nodes.
    level: u8,
}

/// A node of a group: bits 0..3 its word there, 3..5 which child it is, 5..7 a level, at most 3, 7 what [`Group`] says,
/// 16..32 number of the group.
#[derive(Clone, Copy, Default)]
struct Node(u32);

impl Node {
    #[inline]
    fn group(self) -> usize {
        (self.0 >> 16) as usize
    }

    #[inline]
    fn word(self, met: &Met) -> usize {
        usize::from(met.start) + (self.0 & 7) as usize
    }

    #[inline]
    fn child(self) -> usize {
        (self.0 >> 3 & 3) as usize
    }

    /// Bits 5 to 7, by which a table is chosen.
    #[inline]
    fn table(self) -> usize {
        (self.0 >> 5 & 7) as usize
    }
}

/// Corner of each child of a group of level 0, half texels.
const CORNERS: [u64; 4] = [0, 2, 2 << 32, 2 << 32 | 2];
/// From the corner to the centre of a node of level 0.
const CENTRE: u64 = 1 << 32 | 1;

/// What a mask says of its group.
#[derive(Clone, Copy)]
pub(super) struct Group {
    words: u8,
    /// Nodes with a value, and nodes with children.
    pub(super) values: u8,
    pub(super) nodes: u8,
    /// Of each node with children, by rising child, bit 0 of a byte: whether it is empty.
    pub(super) empty: u32,
    /// Its values by rising child, as [`Node`]; bit 7: whether it is of an inner node.
    value: [u32; 4],
    /// Its nodes with children, by falling child; bit 7: whether it is empty.
    node: [u32; 4],
    /// The last of them.
    first: u32,
    /// Of each value, by rising child: bit 0 whether it is of an inner node, above it how many come before.
    pub(super) order: [u32; 4],
}

#[allow(clippy::indexing_slicing, clippy::cast_possible_truncation, reason = "runs while this is compiled")]
pub(super) static GROUPS: [Group; 256] = {
    let none = Group { words: 0, values: 0, nodes: 0, empty: 0, value: [0; 4], node: [0; 4], first: 0, order: [0; 4] };
    let mut groups = [none; 256];
    let mut mask = 0;
    while mask < 256 {
        let (mut g, mut child, mut nodes) = (none, 0, [0; 4]);
        while child < 4 {
            let kind = mask >> (2 * child) & 3;
            let own = g.words as u32 | (child as u32) << 3;
            if kind == 1 || kind == 2 {
                let inner = kind as u32 >> 1;
                g.value[g.values as usize] = (own + inner) | inner << 7;
                g.order[g.values as usize] = 2 * g.values as u32 + inner;
                g.values += 1;
            }
            if kind >= 2 {
                nodes[g.nodes as usize] = own | (kind as u32 & 1) << 7;
                g.empty |= (kind as u32 & 1) << (8 * g.nodes);
                g.nodes += 1;
            }
            g.words += [0, 1, 2, 1][kind];
            child += 1;
        }
        let mut i = 0;
        while i < g.nodes as usize {
            g.node[i] = nodes[g.nodes as usize - 1 - i];
            i += 1;
        }
        g.first = nodes[0];
        groups[mask] = g;
        mask += 1;
    }
    groups
};

pub(super) fn walk<C: Coder, const MERGED: bool>(
    c: &mut C,
    model: &Model,
    real: &[u32],
    out: &mut [u32],
) -> Option<()> {
    let (w0, w1) = frame(c, if MERGED { Kind::Mmh } else { Kind::Mh }, real, out)?;
    let ([_, root_mask, ..], [_, _, level, _]) = (w0.to_le_bytes(), w1.to_le_bytes());
    if level > MAX_LOG2_RESOLUTION {
        return None;
    }
    let mut end = 2;
    let mut entries = Vec::new();
    if MERGED && root_mask == 0 {
        let count = c.bits(15, || word(real, 2));
        end = 3 + count.div_ceil(4) as usize;
        put(out, 2, count)?;
        out.get_mut(3..end)?;
        for i in 0..count {
            let (at, shift) = (3 + i as usize / 4, 8 * (i % 4));
            let mask = c.symbol(MASKS, || word(real, at) >> shift & 0xFF);
            *out.get_mut(at)? |= mask << shift;
            let [mask, ..] = mask.to_le_bytes();
            entries.push(mask);
        }
        entries.reverse();
    }
    let (met, values) = types::<C, MERGED>(c, real, out, (root_mask, level), entries, end)?;
    if MERGED { rises(c, real, out, &met, &values) } else { depths(c, model, real, out, &met, &values) }
}

/// Decodes the types of all groups, puts nodes in their places, and says where values lie: group 0 is above the root.
fn types<C: Coder, const MERGED: bool>(
    c: &mut C,
    real: &[u32],
    out: &mut [u32],
    (root, level): (u8, u8),
    mut entries: Vec<u8>,
    mut end: usize,
) -> Option<(Vec<Met>, Vec<Node>)> {
    // A value takes a word, and so does a node that waits; each is written with up to 3 more behind it.
    let mut values = vec![Node::default(); out.len() + 4];
    let mut pending = vec![Node::default(); out.len() + 4];
    let mut met = Vec::with_capacity(out.len() / 2 + 1);
    met.push(Met { level: level + 1, ..Met::default() });
    // The top of those that wait is at hand: what comes next hangs on it.
    let (mut count, mut top) = (usize::from(root != 0), Node::default());
    let mut found = 0usize;
    let mut references = 0u32;
    // Of mmh: masks of groups that wait at their word, and in the high byte their level + 1.
    let mut waiting = vec![0u16; if MERGED { out.len() + 1 } else { 0 }];
    let alone = if MERGED && !real.is_empty() { alone(real) } else { Vec::new() };
    'all: loop {
        // A word of a page has 16 bits.
        let start = u16::try_from(end).ok()?;
        let (mask, group) = 'group: {
            if MERGED {
                let [mask, level] = waiting.get(end)?.to_le_bytes();
                if level != 0 {
                    break 'group (mask, Met { start, level: level - 1, corner: 0 });
                }
            }
            // Entries of a shared page may begin while groups wait for their turn.
            let both = MERGED && count > 0 && !entries.is_empty();
            let entry = both && c.symbol(ENTRIES, || u32::from(alone.get(end) == Some(&0))) != 0;
            let Some(next) = count.checked_sub(1).filter(|_| !entry) else {
                let Some(mask) = entries.pop() else { break 'all };
                break 'group (mask, Met { start, ..Met::default() });
            };
            let next = core::mem::replace(&mut top, under(&pending, next));
            count -= 1;
            let above = met.get(next.group())?;
            let at = next.word(above);
            let level = above.level.saturating_sub(1);
            let corner = if MERGED { 0 } else { above.corner + (CORNERS.get(next.child())? << above.level) };
            let group = Met { start, level, corner };
            if at == 0 {
                break 'group (root, Met { corner: 0, ..group });
            }
            let known = word(real, at);
            let types = c.symbol(MASKS + next.table(), || {
                let here = if MERGED {
                    known >> 8 & 0xFF == 0 && alone.get((known >> 16) as usize) == Some(&1)
                } else {
                    known >> 8 & 1 == 0
                };
                if here { known & 0xFF } else { 0 }
            });
            let node = out.get_mut(at)?;
            if types != 0 {
                *node = types | u32::from(start) << 16;
                break 'group (types.to_le_bytes()[0], group);
            }
            let place = if MERGED { c.symbol(PLACES, || (known >> 8 & 0xFF).min(2)) } else { 1 };
            let mask = c.bits(8, || known & 0xFF);
            *node = mask
                | match place {
                    1 => {
                        references += 1;
                        1 << 8 | (references - 1) << 16
                    }
                    0 => {
                        let to = c.bits(14, || known >> 16);
                        let [mask, ..] = mask.to_le_bytes();
                        *waiting.get_mut(to as usize)? = u16::from_le_bytes([mask, level + 1]);
                        to << 16
                    }
                    _ => {
                        let real = || u64::from((known >> 8 & 0xFF).saturating_sub(2));
                        let dependency = low(c.number(DEPENDENCIES, real));
                        ((dependency + 2) & 0xFF) << 8 | c.bits(14, || known >> 16) << 16
                    }
                };
            continue 'all;
        };
        let g = GROUPS.get(usize::from(mask))?;
        end += usize::from(g.words);
        // A group without words would be met here for ever.
        if end > out.len() || g.words == 0 {
            return None;
        }
        let [number, level] = [low(met.len() as u64) << 16, group.level.into()];
        met.push(group);
        // All four are written, whatever they are: what is too many is overwritten.
        let own = number | level.min(3) << 5;
        *values.get_mut(found..)?.first_chunk_mut()? = g.value.map(|v| Node(v | own));
        found += usize::from(g.values);
        let own = number | level.saturating_sub(1).min(3) << 5;
        *pending.get_mut(count..)?.first_chunk_mut()? = g.node.map(|n| Node(n | own));
        top = Node(select_unpredictable(g.nodes == 0, top.0, g.first | own));
        count += usize::from(g.nodes);
    }
    values.truncate(found);
    (end == out.len()).then_some((met, values))
}

/// What waits below number `count`.
#[inline]
fn under(pending: &[Node], count: usize) -> Node {
    pending.get(count.wrapping_sub(1)).copied().unwrap_or_default()
}

/// Of every word, how many nodes refer to it as the first of a group; 2 stands for more.
fn alone(page: &[u32]) -> Vec<u8> {
    let mut uses = vec![0u8; page.len()];
    let (mut masks, mut at) = (vec![0u8; page.len()], 2usize);
    let mut entries = Vec::new();
    let mut root = word(page, 0).to_le_bytes()[1];
    if root == 0 {
        // As many bits as the walk names: any other word here makes no page, and must not ask for memory.
        let count = word(page, 2) & 0x7FFF;
        at = 3 + count.div_ceil(4) as usize;
        entries.extend(
            (0..count)
                .rev()
                .map(|i| word(page, 3 + i as usize / 4).to_le_bytes().get(i as usize % 4).copied().unwrap_or(0)),
        );
    }
    while at < page.len() {
        let waiting = masks.get(at).copied().unwrap_or(0);
        let mask = match (waiting, root) {
            (0, 0) => entries.pop().unwrap_or(0),
            (0, root) => root,
            (waiting, _) => waiting,
        };
        root = 0;
        for c in (0..4).filter(|c| Mask(mask).child(*c).has_children()) {
            let node = word(page, at + Mask(mask).words_before(c) as usize);
            let [types, place, ..] = node.to_le_bytes();
            let to = (node >> 16) as usize;
            if let (0, Some(uses), Some(mask)) = (place, uses.get_mut(to), masks.get_mut(to)) {
                (*uses, *mask) = ((*uses + 1).min(2), types);
            }
        }
        at += (Mask(mask).words() as usize).max(1);
    }
    uses
}

/// Rises of kind `mmh`.
fn rises<C: Coder>(c: &mut C, real: &[u32], out: &mut [u32], met: &[Met], values: &[Node]) -> Option<()> {
    for v in values {
        let group = met.get(v.group())?;
        let at = v.word(group);
        let table = RISES + v.table();
        let rise = c.number(table, || zigzag(word(real, at).cast_signed().into()));
        put(out, at, low(unzigzag(rise).cast_unsigned()))?;
    }
    Some(())
}

/// A surface that values lie on.
#[derive(Clone, Copy, Default)]
struct Surface {
    /// The last value on it, and where.
    value: u32,
    x: i32,
    y: i32,
    /// Depth for each half texel, 16 bits behind the point.
    gx: i64,
    gy: i64,
    /// Its number.
    id: u32,
}

impl Surface {
    #[inline]
    fn at(&self, x: i32, y: i32) -> u32 {
        let [dx, dy] = [x.wrapping_sub(self.x), y.wrapping_sub(self.y)].map(i64::from);
        let rise = self.gx.wrapping_mul(dx).wrapping_add(self.gy.wrapping_mul(dy)) >> 16;
        self.value.wrapping_add(low(rise.cast_unsigned()))
    }

    #[inline]
    fn differs(&self, (x, y): (i32, i32), value: u32) -> u64 {
        zigzag(value.wrapping_sub(self.at(x, y)).cast_signed().into())
    }
}

/// Bits of a symbol that say how long the difference is; the one above says which surface.
const LENGTH: u32 = 0x3F;

/// Values of kind `mh`.
fn depths<C: Coder>(
    c: &mut C,
    model: &Model,
    real: &[u32],
    out: &mut [u32],
    met: &[Met],
    values: &[Node],
) -> Option<()> {
    let near = model.near();
    let mut surfaces = [Surface::default(); 2];
    // Which of them was last.
    let mut front = 0usize;
    // Value of the last with each child number; its group above the surface.
    let mut last = [(0u32, 0u64); 4];
    let (mut before, mut id) = (0usize, 1u32);
    for v in values {
        let group = met.get(v.group())?;
        let (at, child) = (v.word(group), v.child());
        let centre = group.corner + ((CORNERS.get(child)? + CENTRE) << group.level);
        let [x, y] = [centre, centre >> 32].map(|x| low(x).cast_signed());
        let known = word(real, at);
        let symbol = c.symbol(VALUES + (v.table() & 4) + before, || {
            let length =
                |s: usize| u64::BITS - surfaces.get(s & 1).map_or(0, |s| s.differs((x, y), known)).leading_zeros();
            let [a, b] = [length(front), length(front ^ 1)];
            // Another surface than the last costs about two bits more.
            if a <= b + 2 { a } else { b | (LENGTH + 1) }
        });
        let (other, length) = (usize::from(symbol > LENGTH), symbol & LENGTH);
        let from = *surfaces.get((front ^ other) & 1)?;
        let z = c.rest(length, from.differs((x, y), known));
        let value = from.at(x, y).wrapping_add(low(unzigzag(z).cast_unsigned()));
        put(out, at, value)?;
        let is_miss = length > near;
        before = select_unpredictable(is_miss, 3, (other * 2) | (usize::from(length >= 4) & !other));
        id = id.wrapping_add(1);
        let own = select_unpredictable(is_miss, id, from.id);
        let key = u64::from(v.0 >> 16) << 32 | u64::from(own);
        // The sibling beside, where it came before, and on the same surface.
        let slope = |sibling: usize, old: i64| {
            let (depth, surface) = last.get(sibling & 3).copied().unwrap_or_default();
            let slope = i64::from(value.wrapping_sub(depth).cast_signed()) << 16 >> (group.level + 1);
            select_unpredictable(surface == key, slope, old)
        };
        let (gx, gy) = (slope(child ^ 1, from.gx), slope(child ^ 2, from.gy));
        *last.get_mut(child)? = (value, key);
        // What lies on the last surface goes on from it; anything else takes the other's place.
        front ^= other | usize::from(is_miss);
        *surfaces.get_mut(front & 1)? = Surface { value, x, y, gx, gy, id: own };
    }
    Some(())
}
