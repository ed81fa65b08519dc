//! A block of 4 x 4 texels, each with its exact interval: the fewest entries that answer all of them.

use super::entry::{Entry, EntryId, Line, OPEN, Palette, Plane, Scale};
use super::search::known;
use crate::interval::Interval;
use umbrage_format::projection::UNCOVERED;

/// Most entries of a mask.
const MOST: usize = 3;

/// What answers a block of 4 x 4 texels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Block {
    /// One entry.
    One(EntryId),
    /// An entry for each texel, by rows, too many for a mask.
    Many([EntryId; 16]),
}

/// Chooses entries for 16 texels; texel (0, 0) of the block is texel `origin` of the map. `ready` are entries to be tried
/// first, `planes` such as are made where they help, and so are `lines`; without them there is no mask either.
pub fn block(
    palette: &mut Palette,
    intervals: &[Interval; 16],
    origin: [u32; 2],
    ready: &[EntryId],
    planes: &[Plane],
    lines: Option<&Vec<Line>>,
    scale: Scale,
) -> Block {
    let mut left = 0xFFFFu32;
    let mut chosen: Vec<(Entry, u32)> = Vec::new();
    let right = |entry: Entry| {
        (0..16u32).filter(|n| allows(entry, intervals[*n as usize], origin, *n, scale)).fold(0u32, |m, n| m | 1 << n)
    };
    let mut options: Vec<(Entry, u32, bool)> = Vec::new();
    for &id in ready {
        let entry = palette.get(id);
        options.push((entry, right(entry), true));
    }
    let uncovered = Entry::Constant(UNCOVERED);
    options.push((uncovered, right(uncovered), true));
    for plane in planes {
        let entry = Entry::Plane(*plane);
        if !options.iter().any(|o| o.0 == entry) {
            options.push((entry, right(entry), false));
        }
    }
    if let Some(id) = split(palette, &options, intervals, origin, lines.map_or(&[], Vec::as_slice)) {
        return Block::One(id);
    }
    while left != 0 {
        let new = |o: &(Entry, u32, bool)| (o.1 & left).count_ones();
        let best = options.iter().enumerate().max_by_key(|(i, o)| (new(o), o.2, usize::MAX - i)).map(|(_, o)| *o);
        let stab = stab(palette, intervals, left);
        let stabbed = (Entry::Constant(stab.0), right(Entry::Constant(stab.0)));
        let made = best.is_some_and(|b| b.2);
        match best.filter(|b| {
            let (plane, constant) = (new(b), (stabbed.1 & left).count_ones());
            plane > 0 && (plane > constant || (plane == constant && made))
        }) {
            Some(b) => {
                chosen.push((b.0, b.1));
                left &= !b.1;
            }
            None => {
                chosen.push(stabbed);
                left &= !stabbed.1;
            }
        }
    }
    let ids: Vec<EntryId> = chosen.iter().map(|c| palette.entry(c.0)).collect();
    let of = |n: u32| chosen.iter().position(|c| c.1 >> n & 1 == 1).unwrap_or(0);
    if ids.len() == 1 {
        return Block::One(ids[0]);
    }
    if ids.len() <= MOST && lines.is_some() {
        let at = |i: usize| ids.get(i).copied().unwrap_or(ids[0]);
        let mut selectors = 0u32;
        for n in 0..16 {
            selectors |= (of(n) as u32) << (2 * n);
        }
        return Block::One(palette.entry(Entry::Mask { entries: [at(0), at(1), at(2)], selectors }));
    }
    let mut all = [OPEN; 16];
    for n in 0..16u32 {
        all[n as usize] = ids[of(n)];
    }
    Block::Many(all)
}

/// One entry, or two on the sides of a line, the cheapest that is right for all 16.
fn split(
    palette: &mut Palette,
    options: &[(Entry, u32, bool)],
    intervals: &[Interval; 16],
    origin: [u32; 2],
    lines: &[Line],
) -> Option<EntryId> {
    // entries that exist cost nothing, the others what they take in a page
    let price = |o: &(Entry, u32, bool)| if o.2 { 0 } else { 3 };
    let whole = options.iter().filter(|o| o.1 == 0xFFFF).min_by_key(|o| price(o));
    if let Some(o) = whole {
        return Some(palette.entry(o.0));
    }
    let (value, count) = stab(palette, intervals, 0xFFFF);
    if count == 16 {
        return Some(palette.entry(Entry::Constant(value)));
    }
    let cheapest = |need: u32| -> Option<(Entry, u32)> {
        let ready = options.iter().filter(|o| o.1 & need == need).min_by_key(|o| price(o)).map(|o| (o.0, price(o)));
        if ready.is_some_and(|r| r.1 == 0) {
            return ready;
        }
        let (value, count) = stab(palette, intervals, need);
        if count == need.count_ones() { Some((Entry::Constant(value), 1)) } else { ready }
    };
    let mut best: Option<(u32, Line, Entry, Entry)> = None;
    for &line in lines {
        let Some(beyond) = beyond(&line, origin) else { continue };
        if beyond == 0 || beyond == 0xFFFF {
            continue;
        }
        let (Some(near), Some(far)) = (cheapest(!beyond & 0xFFFF), cheapest(beyond)) else { continue };
        let price = near.1 + far.1;
        if best.is_none_or(|b| price < b.0) {
            best = Some((price, line, near.0, far.0));
        }
    }
    let (_, line, near, far) = best?;
    let (line, near, beyond) = (palette.line(line), palette.entry(near), palette.entry(far));
    Some(palette.entry(Entry::Split { line, near, beyond }))
}

/// Which texels' centres lie beyond the line, whatever page tells; nothing where one is too close.
fn beyond(line: &Line, origin: [u32; 2]) -> Option<u32> {
    (0..16u32).try_fold(0u32, |m, n| {
        let centre = [origin[0] + n % 4, origin[1] + n / 4].map(|v| i64::from(v) * 256 + 128);
        line.tells(centre).map(|b| m | u32::from(b) << n)
    })
}

/// Whether an entry of any kind is right for all 16 texels.
pub fn answers(palette: &Palette, id: EntryId, intervals: &[Interval; 16], origin: [u32; 2], scale: Scale) -> bool {
    (0..16u32).all(|n| {
        let texel = [origin[0] + n % 4, origin[1] + n / 4];
        let mut id = id;
        while let Entry::Split { line, near, beyond } = palette.get(id) {
            match palette.lines[line as usize].tells(texel.map(|v| i64::from(v) * 256 + 128)) {
                Some(b) => id = if b { beyond } else { near },
                None => return false,
            }
        }
        if let Entry::Raw(raw) = palette.get(id) {
            let v = palette.raws[raw as usize][(texel[1] % 4 * 4 + texel[0] % 4) as usize];
            return allows(Entry::Constant(v), intervals[n as usize], origin, n, scale);
        }
        if let Entry::Mask { entries, selectors } = palette.get(id) {
            id = entries[(selectors >> (2 * (texel[1] % 4 * 4 + texel[0] % 4)) & 3) as usize % 3];
        }
        allows(palette.get(id), intervals[n as usize], origin, n, scale)
    })
}

/// Whether what any page stores for the entry is right at texel number `n` of the block.
pub fn allows(entry: Entry, interval: Interval, origin: [u32; 2], n: u32, scale: Scale) -> bool {
    match entry {
        Entry::Constant(v) => interval.min <= v && v <= interval.max,
        Entry::Plane(plane) => {
            let v = plane.texel(origin[0] + n % 4, origin[1] + n / 4, scale);
            i64::from(interval.min) < v && v <= i64::from(interval.max) && interval.max != UNCOVERED
        }
        _ => false,
    }
}

/// The depth that lies in the most intervals of the texels in `left`, and how many.
fn stab(palette: &Palette, intervals: &[Interval; 16], left: u32) -> (u32, u32) {
    let mut best = (0u32, 0u32, Interval::UNCOVERED);
    for n in 0..16 {
        if left >> n & 1 == 0 {
            continue;
        }
        let v = intervals[n].min;
        let (mut count, mut max) = (0, u32::MAX);
        for (m, i) in intervals.iter().enumerate() {
            if left >> m & 1 == 1 && i.min <= v && v <= i.max {
                count += 1;
                max = max.min(i.max);
            }
        }
        if count > best.1 || (count == best.1 && max - v > best.2.max - best.2.min) {
            best = (v, count, Interval { min: v, max });
        }
    }
    (known(palette, best.2), best.1)
}
