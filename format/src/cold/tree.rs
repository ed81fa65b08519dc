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

/// The children of an inner or empty node, yet to come.
#[derive(Clone, Copy, Default)]
struct Pending {
    /// Word of the node; 0 for the root group.
    node: u16,
    /// Whether the node is empty, and level of the children.
    empty: u8,
    level: u8,
    /// The first texel, half texels from the page's corner.
    x: i32,
    y: i32,
}

/// A value, yet to come.
#[derive(Clone, Copy, Default)]
struct Value {
    word: u16,
    /// Bits 0..2 the child, bit 2 whether it is inner.
    child: u8,
    level: u8,
    /// Number of the group.
    group: u32,
    /// The square's centre, half texels.
    x: i32,
    y: i32,
}

/// What a mask says of its group.
#[derive(Clone, Copy)]
pub(super) struct Group {
    words: u8,
    /// Nodes with a value, and nodes with children.
    pub(super) values: u8,
    pub(super) nodes: u8,
    /// Bytes, the first in the lowest: bits 0..2 the child, bit 2 whether it is inner (of `nodes`: empty), from bit 4 on
    /// the word. Values by rising child, nodes by falling.
    pub(super) value: u32,
    node: u32,
}

#[allow(clippy::indexing_slicing, clippy::cast_possible_truncation, reason = "runs while this is compiled")]
pub(super) static GROUPS: [Group; 256] = {
    let mut groups = [Group { words: 0, values: 0, nodes: 0, value: 0, node: 0 }; 256];
    let mut mask = 0;
    while mask < 256 {
        let (mut g, mut child) = (Group { words: 0, values: 0, nodes: 0, value: 0, node: 0 }, 0);
        while child < 4 {
            let kind = mask >> (2 * child) & 3;
            if kind == 1 || kind == 2 {
                let inner = kind as u32 >> 1;
                g.value |= (child as u32 | inner << 2 | (g.words as u32 + inner) << 4) << (8 * g.values);
                g.values += 1;
            }
            if kind >= 2 {
                g.node = g.node << 8 | child as u32 | (kind as u32 & 1) << 2 | (g.words as u32) << 4;
                g.nodes += 1;
            }
            g.words += [0, 1, 2, 1][kind];
            child += 1;
        }
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
    let values = types::<C, MERGED>(c, real, out, (root_mask, level), entries, end)?;
    if MERGED { rises(c, real, out, &values) } else { depths(c, model, real, out, &values) }
}

/// Decodes the types of all groups, puts nodes in their places, and says where values lie.
fn types<C: Coder, const MERGED: bool>(
    c: &mut C,
    real: &[u32],
    out: &mut [u32],
    (root, level): (u8, u8),
    mut entries: Vec<u8>,
    mut end: usize,
) -> Option<Vec<Value>> {
    // A value takes a word, and so does a node that waits; each is written with up to 3 more behind it.
    let mut values = vec![Value::default(); out.len() + 4];
    let mut pending = vec![Pending::default(); out.len() + 4];
    *pending.first_mut()? = Pending { level, ..Pending::default() };
    let (mut count, mut found) = (usize::from(root != 0), 0usize);
    let (mut references, mut group) = (0u32, 0u32);
    // Of mmh: masks of groups that wait at their word, and in the high byte their level + 1.
    let mut waiting = vec![0u16; if MERGED { out.len() + 1 } else { 0 }];
    let alone = if MERGED && !real.is_empty() { alone(real) } else { Vec::new() };
    'all: loop {
        let (mask, place) = 'group: {
            if MERGED {
                let [mask, level] = waiting.get(end)?.to_le_bytes();
                if level != 0 {
                    break 'group (mask, Pending { level: level - 1, ..Pending::default() });
                }
            }
            // Entries of a shared page may begin while groups wait for their turn.
            let both = MERGED && count > 0 && !entries.is_empty();
            let entry = both && c.symbol(ENTRIES, || u32::from(alone.get(end) == Some(&0))) != 0;
            let Some(next) = count.checked_sub(1).filter(|_| !entry) else {
                let Some(mask) = entries.pop() else { break 'all };
                break 'group (mask, Pending::default());
            };
            count = next;
            let next = *pending.get(count)?;
            if next.node == 0 {
                break 'group (root, next);
            }
            let at = usize::from(next.node);
            let known = word(real, at);
            let types = c.symbol(MASKS + usize::from(next.empty) * 4 + usize::from(next.level.min(3)), || {
                let here = if MERGED {
                    known >> 8 & 0xFF == 0 && alone.get((known >> 16) as usize) == Some(&1)
                } else {
                    known >> 8 & 1 == 0
                };
                if here { known & 0xFF } else { 0 }
            });
            let node = out.get_mut(at)?;
            if types != 0 {
                *node = types | low(end as u64) << 16;
                break 'group (types.to_le_bytes()[0], next);
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
                        *waiting.get_mut(to as usize)? =
                            u16::from_le_bytes([mask.to_le_bytes()[0], next.level.saturating_add(1)]);
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
        let Pending { level, x, y, .. } = place;
        let start = end;
        end += usize::from(g.words);
        // A group without words would be met here for ever.
        if end > out.len() || g.words == 0 {
            return None;
        }
        group += 1;
        let (half, whole) = (1i32 << level, 2i32 << level);
        let corner = |bits: u32| {
            let child = bits.cast_signed();
            (x + (child & 1) * whole, y + (child >> 1 & 1) * whole)
        };
        // All four are written, whatever there is: what is too many is overwritten.
        let mut bits = g.value;
        for value in values.get_mut(found..found + 4)? {
            let (x, y) = corner(bits);
            let [child, ..] = (bits & 7).to_le_bytes();
            let word = low16(start + (bits >> 4 & 15) as usize);
            *value = Value { word, child, level, group, x: x + half, y: y + half };
            bits >>= 8;
        }
        found += usize::from(g.values);
        let mut bits = g.node;
        for node in pending.get_mut(count..count + 4)? {
            let (x, y) = corner(bits);
            let [empty, ..] = (bits >> 2 & 1).to_le_bytes();
            *node =
                Pending { node: low16(start + (bits >> 4 & 15) as usize), empty, level: level.saturating_sub(1), x, y };
            bits >>= 8;
        }
        count += usize::from(g.nodes);
    }
    values.truncate(found);
    (end == out.len()).then_some(values)
}

/// Low 16 bits.
#[inline]
#[allow(clippy::cast_possible_truncation)]
fn low16(v: usize) -> u16 {
    // Words of a page are at most 16384.
    v as u16
}

/// Of every word, how many nodes refer to it as the first of a group; 2 stands for more.
fn alone(page: &[u32]) -> Vec<u8> {
    let mut uses = vec![0u8; page.len()];
    let (mut masks, mut at) = (vec![0u8; page.len()], 2usize);
    let mut entries = Vec::new();
    let mut root = word(page, 0).to_le_bytes()[1];
    if root == 0 {
        let count = word(page, 2);
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
fn rises<C: Coder>(c: &mut C, real: &[u32], out: &mut [u32], values: &[Value]) -> Option<()> {
    for v in values {
        let at = usize::from(v.word);
        let table = RISES + usize::from(v.child & 4) + usize::from(v.level.min(3));
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
    fn differs(&self, v: &Value, value: u32) -> u64 {
        zigzag(value.wrapping_sub(self.at(v.x, v.y)).cast_signed().into())
    }
}

/// Bits of a symbol that say how long the difference is; the one above says which surface.
const LENGTH: u32 = 0x3F;

/// Values of kind `mh`.
fn depths<C: Coder>(c: &mut C, model: &Model, real: &[u32], out: &mut [u32], values: &[Value]) -> Option<()> {
    let near = model.near();
    let mut surfaces = [Surface::default(); 2];
    // Which of them was last.
    let mut front = 0usize;
    // Value, group and surface of the last with each child number.
    let mut last = [(0u32, 0u32, 0u32); 4];
    let (mut before, mut id) = (0usize, 1u32);
    for v in values {
        let at = usize::from(v.word);
        let known = word(real, at);
        let symbol = c.symbol(VALUES + usize::from(v.child & 4) + before, || {
            let length = |s: usize| u64::BITS - surfaces.get(s & 1).map_or(0, |s| s.differs(v, known)).leading_zeros();
            let [a, b] = [length(front), length(front ^ 1)];
            // Another surface than the last costs about two bits more.
            if a <= b + 2 { a } else { b | (LENGTH + 1) }
        });
        let (other, length) = (usize::from(symbol > LENGTH), symbol & LENGTH);
        let from = *surfaces.get((front ^ other) & 1)?;
        let z = c.rest(length, from.differs(v, known));
        let value = from.at(v.x, v.y).wrapping_add(low(unzigzag(z).cast_unsigned()));
        put(out, at, value)?;
        let miss = usize::from(length > near);
        before = if miss == 1 { 3 } else { (other * 2) | (usize::from(length >= 4) & !other) };
        id = id.wrapping_add(1);
        let own = if miss == 1 { id } else { from.id };
        let child = usize::from(v.child & 3);
        // The sibling beside, where it came before, and on the same surface.
        let slope = |sibling: usize, old: i64| {
            let (depth, group, surface) = last.get(sibling & 3).copied().unwrap_or_default();
            let slope = i64::from(value.wrapping_sub(depth).cast_signed()) << 16 >> (v.level + 1);
            if (group == v.group) & (surface == own) { slope } else { old }
        };
        let (gx, gy) = (slope(child ^ 1, from.gx), slope(child ^ 2, from.gy));
        *last.get_mut(child)? = (value, v.group, own);
        // What lies on the last surface goes on from it; anything else takes the other's place.
        front ^= other | miss;
        *surfaces.get_mut(front & 1)? = Surface { value, x: v.x, y: v.y, gx, gy, id: own };
    }
    Some(())
}
