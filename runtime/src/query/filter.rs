//! Percentage-closer filtering: twin of `shader/query/filter.wgsl`. What a tap is stands in
//! [`umbrage_reader::query::filter`].

use umbrage_format::Kind;
use umbrage_format::kind::mh::ROOT_GROUP;
pub use umbrage_reader::query::filter::{MAX_SIDE, Receiver, Share, levels_around};
use umbrage_reader::query::filter::{Rect, Taps, descend};

use super::pool::{ANCESTOR, EXACT, LIT, NONE, OUTSIDE, Pool, Walk};

/// Lit taps in a state, 20 bits from here.
pub const SHARE_SHIFT: u32 = 8;

/// A receiver and how it is filtered, as the device takes it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FilterQuery {
    /// Where, and its plane.
    pub receiver: Receiver,
    /// Level in 1/256: between two, both are blended. `L << 8` for level L alone.
    pub lod: u32,
    /// Taps on a side, 1 to [`MAX_SIDE`].
    pub side: u32,
}

impl FilterQuery {
    /// Two words of four each.
    pub fn encode(&self) -> [[u32; 4]; 2] {
        let (r, [gx, gy]) = (&self.receiver, self.receiver.gradient.map(i32::cast_unsigned));
        [[r.x, r.y, r.depth, 0], [gx, gy, self.lod, self.side]]
    }

    /// The share in a state of the device or of [`Pool::filter`].
    pub fn share(&self, state: u32) -> Share {
        let side = self.side.clamp(1, MAX_SIDE);
        Share { lit: state >> SHARE_SHIFT, taps: (side * side) << 8, inside: state & OUTSIDE == 0 }
    }
}

impl<'a> Pool<'a> {
    /// Lit taps of side `side` on `level` around a receiver, on root `root`, and a page that was missing, or
    /// [`NONE`]: then ancestors answered for a part of the taps that the index could not settle.
    pub fn pcf(&self, root: u32, r: &Receiver, side: u32, level: u32) -> (Share, u32) {
        let level = u8::try_from(level).unwrap_or(u8::MAX);
        let Some(taps) = Taps::new(r, side, level, self.top()) else { return (Taps::outside(side), NONE) };
        let group = if self.kind == Kind::Vector { 0 } else { ROOT_GROUP.into() };
        let mut walk = |w: Walk<'a>, x, y, level: u8| {
            let w = self.go(w, x, y, level.into());
            (w, w.ended)
        };
        let (mut lit, mut missing) = (0, NONE);
        let mut answer = |w: &Walk<'a>, part: &Rect| {
            let level = u32::from(taps.level);
            if let Some((bounds, error)) = self.bounds(w.found.missing) {
                let value = |x: u32, y: u32| match self.kind {
                    Kind::Vector => self.vector_value(w, x << level, y << level, level),
                    _ => w.found.value,
                };
                let (some, settled) = taps.settle(part, &bounds, error, value);
                lit += some;
                missing = missing.min(if settled { NONE } else { w.found.missing });
                return;
            }
            missing = missing.min(w.found.missing);
            lit += match self.kind {
                Kind::Vector => taps.lit_each(part, |x, y| self.vector_value(w, x << level, y << level, level)),
                _ => taps.lit(part, w.found.value),
            };
        };
        descend(self.start(root, group), taps.inside, taps.level, &mut walk, &mut answer);
        (taps.share(lit), missing)
    }

    /// What the kernel `filtered` makes of a query: bits as a lookup's ([`LIT`] where all taps are), and from
    /// [`SHARE_SHIFT`] on the lit ones, each tap counting 256.
    pub fn filter(&self, root: u32, q: &FilterQuery) -> u32 {
        let (level, part) = levels_around(q.lod);
        let level = u32::from(level).min(self.top().into());
        let (finer, mut missing) = self.pcf(root, &q.receiver, q.side, level);
        let mut coarser = finer;
        if part != 0 && level < u32::from(self.top()) {
            let found = self.pcf(root, &q.receiver, q.side, level + 1);
            (coarser, missing) = (found.0, missing.min(found.1));
        }
        let share = finer.blend(&coarser, part);
        let mut state = share.lit << SHARE_SHIFT | if missing == NONE { EXACT } else { ANCESTOR };
        if share.lit == share.taps {
            state |= LIT;
        }
        if share.inside {
            state |= self.stale(q.receiver.x, q.receiver.y);
        } else {
            state |= OUTSIDE;
        }
        state
    }

    /// Goes on by the structure's kind; one that has no walk ends as one whose root is missing.
    fn go(&self, w: Walk<'a>, x: u32, y: u32, level: u32) -> Walk<'a> {
        match self.kind {
            Kind::Mh => self.go_mh(w, x, y, level),
            Kind::Mmh => self.go_mmh(w, x, y, level),
            Kind::Vector => self.go_vector(w, x, y, level),
            _ => {
                let mut w = w;
                (w.found.missing, w.ended) = (w.found.page, true);
                w
            }
        }
    }
}
