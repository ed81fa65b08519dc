//! Pictures of a map: depths, density of nodes, pages.

use std::sync::atomic::{AtomicU32, Ordering};

use rayon::prelude::*;
use umbrage::format::Kind;
use umbrage::format::kind::mh::{Children, Mask, Node};
use umbrage::format::kind::vector;
use umbrage::format::projection::UNCOVERED;
use umbrage::reader::query::Map;
use umbrage::render::RgbImage;

use super::super::{Failure, go_on};
use super::mmh::Walker;

/// What to draw.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Picture {
    /// Stored depths
    Depth,
    /// Nodes in each square
    Nodes,
    /// The page that answers
    Pages,
}

/// Draws a level, one pixel a texel of that level.
pub fn picture(map: &Map, level: u8, what: Picture) -> Result<RgbImage, Failure> {
    let side = map.resolution() >> level;
    let pixels = match what {
        Picture::Depth => depths(&rows(map, level, |x, y| Ok(map.texel(x, y, level)?.value))?),
        Picture::Nodes => densities(&nodes(map, level)?),
        Picture::Pages => {
            let half = (1u32 << level) >> 1;
            rows(map, level, |x, y| Ok(map.texel(x + half, y + half, 0)?.page))?.into_iter().map(colour).collect()
        }
    };
    Ok(RgbImage { width: side, height: side, pixels })
}

/// Asks the first texel of each square of a level, row by row.
fn rows(map: &Map, level: u8, ask: impl Fn(u32, u32) -> Result<u32, Failure> + Sync) -> Result<Vec<u32>, Failure> {
    let side = map.resolution() >> level;
    let row = |y: u32| -> Result<Vec<u32>, Failure> {
        if !go_on() {
            return Err(Failure::interrupted());
        }
        (0..side).map(|x| ask(x << level, y << level)).collect()
    };
    let rows: Result<Vec<Vec<u32>>, Failure> = (0..side).into_par_iter().map(row).collect();
    Ok(rows?.into_iter().flatten().collect())
}

/// Grey over the range that occurs.
fn depths(values: &[u32]) -> Vec<[u8; 3]> {
    let covered = || values.iter().copied().filter(|v| *v != UNCOVERED);
    let (low, high) = (covered().min().unwrap_or(0), covered().max().unwrap_or(1));
    let range = f64::from(high - low).max(1.0);
    let pixel = |v: &u32| match *v {
        UNCOVERED => [28, 44, 92],
        v => [(240.0 - f64::from(v - low) / range * 215.0) as u8; 3],
    };
    values.iter().map(pixel).collect()
}

/// Nodes of `level` and finer in each square of that level.
fn nodes(map: &Map, level: u8) -> Result<Vec<u32>, Failure> {
    let side = (map.resolution() >> level) as usize;
    let counts: Vec<AtomicU32> = (0..side * side).map(|_| AtomicU32::new(0)).collect();
    let count = |at_level: u8, x: u32, y: u32| {
        if at_level <= level {
            counts[(y >> level) as usize * side + (x >> level) as usize].fetch_add(1, Ordering::Relaxed);
        }
    };
    let s = map.structure();
    if s.kind() == Kind::Mmh {
        let mut walker = Walker::new(map);
        for ordinal in 0..s.record().tree_pages() {
            if !go_on() {
                return Err(Failure::interrupted());
            }
            walker.squares(ordinal, level, &mut |x, y, n| {
                let n = u32::try_from(n).unwrap_or(u32::MAX);
                let at = (y >> level) as usize * side + (x >> level) as usize;
                counts[at].store(counts[at].load(Ordering::Relaxed).saturating_add(n), Ordering::Relaxed);
            })?;
        }
        return Ok(counts.into_iter().map(AtomicU32::into_inner).collect());
    }
    (0..s.page_count()).into_par_iter().try_for_each(|ordinal| {
        if !go_on() {
            return Err(Failure::interrupted());
        }
        let (page, r) = (s.page(ordinal)?, s.page_record(ordinal)?);
        let (head, [x, y]) = (page.head(), [r.origin_x.get(), r.origin_y.get()]);
        match s.kind() {
            Kind::Vector => vector::nodes(page.words(), head, |n| count(n.level, x + n.x, y + n.y)),
            _ => walk(page.words(), 2, Mask(head.root_mask), head.root_level, [x, y], &count),
        }
        Ok(())
    })?;
    Ok(counts.into_iter().map(AtomicU32::into_inner).collect())
}

/// Every node of the group at word `start` of an `mh` page and below, with its level and first texel. The page is checked: at most
/// 25 levels.
fn walk(words: &[u32], start: u16, mask: Mask, level: u8, origin: [u32; 2], count: &impl Fn(u8, u32, u32)) {
    for c in (0..4).filter(|c| mask.child(*c).words() > 0) {
        let [x, y] = [origin[0] + ((c & 1) << level), origin[1] + ((c >> 1) << level)];
        count(level, x, y);
        if mask.child(c).has_children() {
            let node = Node::decode(words[usize::from(start) + mask.words_before(c) as usize]);
            if let Children::Here(first) = node.children {
                walk(words, first, node.mask, level - 1, [x, y], count);
            }
        }
    }
}

/// Black, violet, orange, white on a logarithmic scale.
fn densities(counts: &[u32]) -> Vec<[u8; 3]> {
    const STOPS: [[f64; 3]; 4] = [[8.0, 8.0, 16.0], [96.0, 32.0, 128.0], [240.0, 128.0, 32.0], [255.0, 250.0, 220.0]];
    let most = f64::from(counts.iter().copied().max().unwrap_or(0)).ln_1p().max(1.0);
    let pixel = |n: &u32| {
        let t = f64::from(*n).ln_1p() / most * 3.0;
        let i = (t as usize).min(2);
        let part = t - i as f64;
        [0, 1, 2].map(|k| (STOPS[i][k] + (STOPS[i + 1][k] - STOPS[i][k]) * part) as u8)
    };
    counts.iter().map(pixel).collect()
}

/// A colour that neighbours in the index do not share.
fn colour(page: u32) -> [u8; 3] {
    let h = page.wrapping_mul(0x9E37_79B9).rotate_left(15).wrapping_mul(0x85EB_CA6B);
    [h, h >> 8, h >> 16].map(|v| 48 + (v as u8) / 4 * 3)
}
