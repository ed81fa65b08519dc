//! The input of every baseline: each texel's depth interval, whole in memory (8 bytes a texel).
//!
//! The intervals are those that the writer's exhaustive builder finds texel by texel, and values keep the same guard
//! from the ends of wide ones, so that a baseline may store exactly what `mh` may.

use rayon::prelude::*;
use umbrage::writer::interval::ray::Rays;
use umbrage::writer::interval::texel::{Scratch, is_open, texel};
use umbrage::writer::interval::triangle::{Cover, Local, Surface, surfaces};
use umbrage::writer::interval::{Interval, wide};
use umbrage::writer::solid::SnappedMesh;

/// Side of the squares that are worked through one by one, in texels.
pub const TILE: usize = 256;

/// Intervals of all texels, row by row.
pub struct Image {
    /// Logarithm of the side.
    pub log2: u32,
    /// Distance that values keep from the ends of wide intervals.
    pub guard: u32,
    intervals: Vec<Interval>,
    /// Whether the interval is the whole truth; else a proven part of it.
    whole: Vec<bool>,
}

impl Image {
    /// From intervals that are at hand.
    #[cfg(test)]
    pub fn new(log2: u32, intervals: Vec<Interval>) -> Image {
        assert_eq!(intervals.len(), 1 << (2 * log2));
        Image { log2, guard: 0, whole: vec![true; intervals.len()], intervals }
    }

    /// Asks every texel of a mesh.
    pub fn of(mesh: &SnappedMesh, guard: u32) -> Image {
        let log2 = u32::from(mesh.lattice.log2_resolution);
        let side = 1usize << log2;
        let all = surfaces(mesh);
        let tile = side.min(TILE);
        let bits = mesh.lattice.subtexel_bits;
        let mut intervals = vec![Interval::UNCOVERED; side * side];
        let mut whole = vec![true; side * side];
        let strips = intervals.par_chunks_mut(side * tile).zip(whole.par_chunks_mut(side * tile));
        strips.enumerate().for_each(|(row, (rows, whole))| {
            let y = ((row * tile) as i64) << bits;
            let size = (tile as i64) << bits;
            // A strip of squares: those that overlap any of them.
            let near: Vec<u32> = (0..all.len() as u32)
                .filter(|i| {
                    let ys = all[*i as usize].y.map(i64::from);
                    ys.iter().any(|v| *v > y) && ys.iter().any(|v| *v < y + size)
                })
                .collect();
            for column in 0..side / tile {
                let corner = [((column * tile) as i64) << bits, y];
                let list: Vec<u32> =
                    near.iter().copied().filter(|i| all[*i as usize].overlaps(corner[0], y, size)).collect();
                let locals: Vec<Local> = list.iter().map(|i| all[*i as usize].local(*i, corner[0], y, size)).collect();
                let mut square = Square::new(mesh, &all, &locals, corner, guard);
                square.visit([0, 0], tile.ilog2(), 0, &mut |[x, y], interval, all| {
                    let at = y * side + column * tile + x;
                    (rows[at], whole[at]) = (interval, all);
                });
            }
        });
        Image { log2, guard, intervals, whole }
    }

    /// Texels on a side.
    pub fn side(&self) -> usize {
        1 << self.log2
    }

    /// Whether no other value is right than those of [`Image::truth`].
    pub fn is_whole(&self, x: usize, y: usize) -> bool {
        self.whole[y << self.log2 | x]
    }

    /// Right values of a texel: all of them, or those of a proof.
    #[inline]
    pub fn truth(&self, x: usize, y: usize) -> Interval {
        self.intervals[y << self.log2 | x]
    }

    /// What a method may store for a texel.
    #[inline]
    pub fn allowed(&self, x: usize, y: usize) -> Interval {
        self.truth(x, y).guarded(self.guard)
    }

    /// All squares of [`TILE`], by their first texels, with their side.
    pub fn tiles(&self) -> (Vec<[usize; 2]>, usize) {
        let tile = self.side().min(TILE);
        let across = self.side() / tile;
        ((0..across * across).map(|i| [i % across * tile, i / across * tile]).collect(), tile)
    }
}

/// One square with its surfaces.
struct Square<'a> {
    rays: Rays<'a>,
    /// Lists of the squares on the way down, one behind the other.
    stack: Vec<u32>,
    scratch: Scratch,
    bits: u8,
    wide: u64,
}

impl<'a> Square<'a> {
    fn new(mesh: &SnappedMesh, surfaces: &'a [Surface], locals: &'a [Local], corner: [i64; 2], guard: u32) -> Self {
        Square {
            rays: Rays { surfaces, locals, corner, second_surface: mesh.second_surface },
            stack: (0..locals.len() as u32).collect(),
            scratch: Scratch::default(),
            bits: mesh.lattice.subtexel_bits,
            wide: wide(guard),
        }
    }

    /// Asks the texels of the square at `at`, whose surfaces stand in the stack from `start`; uncovered ones are skipped.
    fn visit(&mut self, at: [usize; 2], level: u32, start: usize, found: &mut impl FnMut([usize; 2], Interval, bool)) {
        let list = &self.stack[start..];
        if is_open(self.rays.locals, list) {
            return;
        }
        let place = |at: [usize; 2]| at.map(|v| (v as i64) << self.bits);
        if level == 0 {
            let truth = texel(&self.rays, list, place(at), 1 << self.bits, self.wide, &mut self.scratch);
            // A centre's interval is no proof, and a narrow proof is looked into.
            let whole = !truth.certified || truth.interval.width() < self.wide;
            return found(at, truth.interval, whole);
        }
        let (end, half) = (self.stack.len(), 1usize << (level - 1));
        let size = (half as i64) << self.bits;
        for c in 0..4 {
            let child = [at[0] + (c & 1) * half, at[1] + (c >> 1) * half];
            let q = child.map(|v| (v as i64) << self.bits);
            for k in start..end {
                let i = self.stack[k];
                if self.rays.locals[i as usize].cover(q[0], q[1], size) != Cover::None {
                    self.stack.push(i);
                }
            }
            self.visit(child, level - 1, end, found);
            self.stack.truncate(end);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::city;
    use umbrage::certify::Oracle;

    /// The oracle shares no code with the rasteriser; a proven part of a wide interval is within it.
    #[test]
    fn intervals_are_those_of_the_oracle() {
        let (mesh, image) = city(256);
        let oracle = Oracle::new(&mesh);
        let (mut covered, mut whole) = (0, 0);
        for i in (0..256 * 256).step_by(37) {
            let (found, truth) = (image.truth(i % 256, i / 256), oracle.texel(i as u32 % 256, i as u32 / 256).interval);
            assert!(truth.contains(found.min) && truth.contains(found.max), "{found:?}, {truth:?}");
            covered += usize::from(found.min < u32::MAX);
            if image.is_whole(i % 256, i / 256) {
                whole += usize::from(found.min < u32::MAX);
                assert_eq!((found.min, found.max), (truth.min, truth.max));
            }
        }
        assert!(covered > 800 && whole > 100, "{covered} covered, {whole} of them whole");
    }
}
