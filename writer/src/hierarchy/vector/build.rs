//! Runs over the map: a square that one entry answers is done, whatever its size; blocks of 4 x 4 texels are looked at texel
//! by texel.

use rustc_hash::FxHashMap as HashMap;
use std::sync::atomic::Ordering;

use umbrage_format::kind::mh::{Mask, NodeType};

use super::entry::{Entry, EntryId, Line, OPEN, Palette, Scale, gradient, raw_words};
use super::page::{Forest, Group, INDEX_COST, Node, SHARES};
use super::search::{BLOCK_LEVEL, Edges, SMALL_LOG2, Search, known};
use super::texels::{self, Block};
use crate::hierarchy::build::{Counts, Options, Progress, Stop, Tree};
use crate::hierarchy::mh::NONE;
use crate::hierarchy::page::{At, COARSE_DEPTH};
use crate::hierarchy::spool::Spool;
use crate::interval::ray::Rays;
use crate::interval::texel::{Scratch, is_open, level, texel};
use crate::interval::triangle::{Cover, Local, Surface, surfaces};
use crate::interval::{Event, Interval, wide};
use crate::solid::SnappedMesh;

/// Level of the squares that one thread works through alone, at least.
const TILE_LEVEL: u8 = 8;
/// A larger square is worked through alone where so few surfaces are left.
const TILE_LIST: usize = 96;
/// From this level on a node's entry is the one that answers the most of its area.
const AREA_LEVEL: u8 = 6;
/// From this level on a square may have one texel with an entry of its own: below, dividing it takes no more.
const EXCEPTED_LEVEL: u8 = 5;
/// So many triangles further what is steep beside a face is known.
const FACE_STEPS: usize = 2;
/// Entries from further up that are tried first.
const MOST_ABOVE: usize = 4;

struct Context<'a> {
    surfaces: &'a [Surface],
    edges: &'a [Edges],
    scale: Scale,
    second_surface: bool,
    guard: u32,
    spool: &'a Spool,
    progress: &'a Progress,
}

struct Part {
    forest: Forest,
    node: Node,
    counts: Counts,
}

/// Builds the `vector` tree of a mesh; its pages go to `spool`. The answer does not depend on the number of threads.
///
/// # Errors
/// [`Stop`]: cancelled, over the budget, or the spool failed.
pub fn build(mesh: &SnappedMesh, options: Options, spool: Spool, progress: &Progress) -> Result<Tree, Stop> {
    let surfaces = surfaces(mesh);
    let edges = edges(&surfaces);
    let scale = Scale { subtexel_bits: mesh.lattice.subtexel_bits, log2_resolution: mesh.lattice.log2_resolution };
    let cx = Context {
        surfaces: &surfaces,
        edges: &edges,
        scale,
        second_surface: mesh.second_surface,
        guard: options.guard,
        spool: &spool,
        progress,
    };
    let all: Vec<u32> = (0..surfaces.len() as u32).collect();
    let at = At { level: scale.log2_resolution, origin: [0, 0] };
    let part = cx.part(at, &all);
    let part = part.map(|p| (p.forest.finish(p.node, scale, &spool), p.counts));
    match (spool.failed(), part) {
        (Some(e), _) => Err(Stop::Spool(e)),
        (None, Some((root, counts))) => Ok(Tree { spool, root, counts }),
        (None, None) if progress.cancel.load(Ordering::Relaxed) => Err(Stop::Cancelled),
        (None, None) => Err(Stop::Budget),
    }
}

/// For each surface the edges at which the front of its solid ends, seen from the light (as many entering surfaces run
/// along it one way as the other everywhere else), its neighbours, and how steep these are beside its face.
fn edges(surfaces: &[Surface]) -> Vec<Edges> {
    let edge = |s: &Surface, k: usize| {
        let j = (k + 1) % 3;
        let (a, b) = ((s.x[k], s.y[k], s.z[k]), (s.x[j], s.y[j], s.z[j]));
        let enters = s.event == Event::Enter;
        if a < b { ((s.solid, enters, a, b), 1) } else { ((s.solid, enters, b, a), -1) }
    };
    // how often the edge is run along in its direction less the other, and who runs
    let mut found: HashMap<_, (i32, [u32; 2])> = HashMap::default();
    for (n, s) in (0..).zip(surfaces).filter(|(_, s)| s.event != Event::Wall) {
        for k in 0..3 {
            let (key, way) = edge(s, k);
            let e = found.entry(key).or_insert((0, [u32::MAX; 2]));
            e.0 += way;
            e.1[usize::from(way < 0)] = n;
        }
    }
    let across = |n: u32, s: &Surface, k: usize| {
        let (key, way) = edge(s, k);
        let (balance, runs) = found[&key];
        (balance == 0).then_some(runs[usize::from(way > 0)]).filter(|m| *m != n && *m != u32::MAX)
    };
    let mut out = vec![Edges { silhouettes: 0, across: [u32::MAX; 3], beside: 0.0, face: 0 }; surfaces.len()];
    (0..).zip(&mut out).for_each(|(n, e)| e.face = n);
    for (n, s) in (0..).zip(surfaces).filter(|(_, s)| s.event != Event::Wall) {
        let e = &mut out[n as usize];
        for k in 0..3 {
            match across(n, s, k) {
                None if s.event == Event::Enter => e.silhouettes |= 1 << k,
                None => {}
                Some(m) => {
                    let [x, y] = gradient(&surfaces[m as usize]);
                    e.across[k] = m;
                    e.beside = e.beside.max(x.abs() + y.abs());
                }
            }
        }
    }
    share_faces(surfaces, &mut out);
    out
}

/// What is known of one triangle of a face holds for the others: the largest stands for all, and what is steep beside one is
/// beside all.
fn share_faces(surfaces: &[Surface], edges: &mut [Edges]) {
    let size = |n: u32| (surfaces[n as usize].area(), std::cmp::Reverse(n));
    for _ in 0..FACE_STEPS {
        for n in 0..edges.len() {
            let mut own = edges[n];
            for m in own.across.into_iter().filter(|m| *m != u32::MAX) {
                let Edges { face, beside, .. } = edges[m as usize];
                if face != own.face && !lies_in(&surfaces[n], &surfaces[face as usize]) {
                    continue;
                }
                own.beside = own.beside.max(beside);
                if size(face) > size(own.face) {
                    own.face = face;
                }
            }
            edges[n] = own;
        }
    }
}

/// Whether a surface lies in another one's plane, but for what snapping does.
fn lies_in(s: &Surface, of: &Surface) -> bool {
    let [x, y] = gradient(of);
    let most = 4.0 + 2.0 * (x.abs() + y.abs());
    (0..3).all(|k| {
        let depth = of.depth(i64::from(s.x[k]), i64::from(s.y[k]));
        (depth.floor - i128::from(s.z[k])).abs() as f64 <= most
    })
}

impl Context<'_> {
    fn cancelled(&self) -> bool {
        self.progress.cancel.load(Ordering::Relaxed) || self.progress.over_budget()
    }

    fn done(&self, level: u8) {
        self.progress.texels.fetch_add(1 << (2 * level), Ordering::Relaxed);
    }

    /// The square of the node at `at`, its four quarters in parallel.
    fn part(&self, at: At, list: &[u32]) -> Option<Part> {
        if self.cancelled() {
            return None;
        }
        if list.is_empty() {
            self.done(at.level);
            return Some(Part { forest: Forest::default(), node: open(), counts: Counts::default() });
        }
        // edge functions of a tile have room for 2^26 steps
        let small = list.len() <= TILE_LIST && at.level + self.scale.subtexel_bits <= 26;
        if at.level <= TILE_LEVEL || small {
            let part = self.tile(at, list);
            if self.cancelled() {
                return None;
            }
            self.progress.hold_bytes(part.forest.bytes(), self.spool);
            if self.spool.has_failed() {
                return None;
            }
            self.done(at.level);
            return Some(part);
        }
        let quarter = |c: usize| {
            let child = at.child(c);
            let [x, y] = child.origin.map(|o| i64::from(o) << self.scale.subtexel_bits);
            let size = 1i64 << (child.level + self.scale.subtexel_bits);
            let near: Vec<u32> =
                list.iter().copied().filter(|i| self.surfaces[*i as usize].overlaps(x, y, size)).collect();
            self.part(child, &near)
        };
        let ((a, b), (c, d)) =
            rayon::join(|| rayon::join(|| quarter(0), || quarter(1)), || rayon::join(|| quarter(2), || quarter(3)));
        let mut forest = Forest::default();
        let mut counts = Counts::default();
        let mut released = 0;
        let mut take = |p: Part| {
            counts.add(&p.counts);
            released += p.forest.bytes();
            forest.absorb(p.forest, p.node)
        };
        let mut children = [take(a?), take(b?), take(c?), take(d?)];
        let node = self.merge(at, &mut children, &mut forest, &[]);
        let node = forest.compact(node);
        self.progress.hold_bytes(forest.bytes(), self.spool);
        self.progress.release(released);
        Some(Part { forest, node, counts })
    }

    fn merge(&self, at: At, children: &mut [Node; 4], forest: &mut Forest, exact: &[[Interval; 16]]) -> Node {
        let mut node = merge(at, children, forest, exact, self.scale);
        if self.scale.log2_resolution - at.level + 1 >= COARSE_DEPTH {
            forest.cut(&mut node, at, children, self.spool);
        }
        node
    }

    fn tile(&self, at: At, list: &[u32]) -> Part {
        let bits = self.scale.subtexel_bits;
        let corner = at.origin.map(|o| i64::from(o) << bits);
        let size = 1i64 << (at.level + bits);
        let locals: Vec<Local> =
            list.iter().map(|i| self.surfaces[*i as usize].local(*i, corner[0], corner[1], size)).collect();
        let held = (size_of::<Local>() * locals.capacity()) as u64;
        self.progress.take(held);
        let rays = |locals| Rays { surfaces: self.surfaces, locals, corner, second_surface: self.second_surface };
        let mut tile = Tile {
            cx: self,
            rays: rays(&locals),
            search: Search::new(rays(&locals), self.scale, self.guard, self.edges),
            forest: Forest::default(),
            stack: (0..locals.len() as u32).collect(),
            over: locals.iter().map(|l| l.cover(0, 0, size) == Cover::All).collect(),
            scratch: Scratch::default(),
            exact: Vec::new(),
            counts: Counts::default(),
        };
        let node = tile.square(at, 0, &[]);
        let node = tile.forest.compact(node);
        let mut counts = tile.counts;
        counts.edge_texels += tile.search.edge_texels;
        counts.texels_evaluated += tile.search.looked;
        counts.effort = tile.scratch.effort;
        self.progress.release(held);
        Part { forest: tile.forest, node, counts }
    }
}

struct Tile<'a> {
    cx: &'a Context<'a>,
    rays: Rays<'a>,
    search: Search<'a>,
    forest: Forest,
    /// Lists of the squares on the way down, one behind the other.
    stack: Vec<u32>,
    /// For each of the stack whether it covers the whole square.
    over: Vec<bool>,
    scratch: Scratch,
    /// Intervals of the blocks that were looked at texel by texel.
    exact: Vec<[Interval; 16]>,
    counts: Counts,
}

impl Tile<'_> {
    /// The square of the node at `at`, whose surfaces stand in the stack from `start`; `above` holds entries of squares
    /// around it.
    fn square(&mut self, at: At, start: usize, above: &[EntryId]) -> Node {
        let bits = self.cx.scale.subtexel_bits;
        let corner = self.rays.corner;
        let p = [0, 1].map(|i| (i64::from(at.origin[i]) << bits) - corner[i]);
        let size = 1i64 << (at.level + bits);
        let (list, over) = (&self.stack[start..], &self.over[start..]);
        // a cancelled tile is thrown away, so any answer will do
        if is_open(self.rays.locals, list) || self.cx.cancelled() {
            return open();
        }
        let facts = self.search.facts();
        // nodes near the root keep to what every split and mask can refer to
        let may_except = at.level >= EXCEPTED_LEVEL && self.cx.scale.log2_resolution - at.level > COARSE_DEPTH;
        let palette = &mut self.forest.palette;
        if let Some((id, proven)) = self.search.square(palette, (list, over), p, size, above, may_except) {
            let node = Node { proven: Some(proven), ..Node::leaf(id) };
            let Some((q, v)) = self.search.exception(palette) else { return node };
            let texel = [0, 1].map(|i| ((q[i] + corner[i]) >> bits) as u32);
            let value = palette.entry(Entry::Constant(v));
            return self.except(node, at.level, texel, value);
        }
        let over = |k: usize| self.over[start + k];
        if let Some(truth) = level(&self.rays, &self.stack[start..], over, p, size, &mut self.scratch) {
            self.search.forget(facts);
            self.counts.found(&truth, 1 << (2 * at.level));
            let v = known(&self.forest.palette, truth.interval.guarded(self.cx.guard));
            let id = self.forest.palette.entry(Entry::Constant(v));
            return Node { proven: Some(false), ..Node::leaf(id) };
        }
        if at.level == BLOCK_LEVEL {
            self.search.forget(facts);
            return self.block(at, start, above);
        }
        if at.level == 0 {
            let interval = self.texel(start, p, size);
            let v = super::search::fewest_bits(interval);
            return Node::leaf(self.forest.palette.entry(Entry::Constant(v)));
        }
        let end = self.stack.len();
        let mut seen: Vec<EntryId> = above.to_vec();
        let mut children = [Node::leaf(OPEN); 4];
        for (c, node) in children.iter_mut().enumerate() {
            let child = at.child(c);
            let q = [0, 1].map(|i| (i64::from(child.origin[i]) << bits) - corner[i]);
            self.descend(start, end, q, size / 2);
            *node = self.square(child, end, &seen);
            self.shorten(end);
            if node.entry != OPEN {
                seen.retain(|e| *e != node.entry);
                seen.insert(0, node.entry);
                seen.truncate(MOST_ABOVE);
            }
        }
        self.search.forget(facts);
        self.cx.merge(at, &mut children, &mut self.forest, &self.exact)
    }

    /// A leaf at this level that one texel in it has another entry than: empty nodes on the way to it.
    fn except(&mut self, leaf: Node, level: u8, texel: [u32; 2], entry: EntryId) -> Node {
        let groups = &mut self.forest.groups;
        let mut below = NONE;
        for l in 0..level {
            let c = ((texel[0] >> l & 1) + 2 * (texel[1] >> l & 1)) as usize;
            let mut group = Group { mask: Mask(0), entry: [leaf.entry; 4], below: [NONE; 4], proven: 0 };
            let mut types = [NodeType::None; 4];
            types[c] = if l == 0 { NodeType::Leaf } else { NodeType::Empty };
            group.mask = Mask::new(types);
            group.below[c] = below;
            if l == 0 {
                group.entry[c] = entry;
            }
            groups.push(group);
            below = groups.len() as u32 - 1;
        }
        let cost = u32::from(level) * super::page::GROUP_COST + self.forest.price(entry);
        Node { below, cost, ..leaf }
    }

    /// Puts what lies in a square, of the stack's `start..end`, on top of the stack.
    fn descend(&mut self, start: usize, end: usize, q: [i64; 2], size: i64) {
        for k in start..end {
            let i = self.stack[k];
            let cover = if self.over[k] { Cover::All } else { self.rays.locals[i as usize].cover(q[0], q[1], size) };
            if cover != Cover::None {
                self.stack.push(i);
                self.over.push(cover == Cover::All);
            }
        }
    }

    /// Takes what stands above `end` from the stack.
    fn shorten(&mut self, end: usize) {
        self.stack.truncate(end);
        self.over.truncate(end);
    }

    /// The exact interval of a texel whose surfaces stand in the stack from `start`.
    fn texel(&mut self, start: usize, p: [i64; 2], size: i64) -> Interval {
        self.counts.texels_evaluated += 1;
        let guard = self.cx.guard;
        let truth = texel(&self.rays, &self.stack[start..], p, size, wide(guard), &mut self.scratch);
        self.counts.found(&truth, 1);
        truth.interval.guarded(guard)
    }

    /// 4 x 4 texels, one by one.
    fn block(&mut self, at: At, start: usize, above: &[EntryId]) -> Node {
        let bits = self.cx.scale.subtexel_bits;
        let size = 1i64 << bits;
        let corner = self.rays.corner;
        let p = [0, 1].map(|i| (i64::from(at.origin[i]) << bits) - corner[i]);
        let end = self.stack.len();
        let mut intervals = [Interval::UNCOVERED; 16];
        let (mut planes, mut seen) = (Vec::new(), Vec::new());
        for n in 0..16i64 {
            let q = [p[0] + (n & 3) * size, p[1] + (n >> 2) * size];
            self.descend(start, end, q, size);
            intervals[n as usize] = self.texel(end, q, size);
            let met = self.search.met(&self.stack[end..], q.map(|c| c + size / 2));
            if let Some(met) = met.filter(|m| !seen.contains(m)) {
                seen.push(met);
                for plane in self.search.guesses(met).into_iter().flatten() {
                    if !planes.contains(&plane) && planes.len() < 12 {
                        planes.push(plane);
                    }
                }
            }
            self.shorten(end);
        }
        let all: Vec<u32> = self.stack[start..end].to_vec();
        let lines = if self.search.lines { self.search.silhouettes(&all, p, 4 * size, 6) } else { Vec::new() };
        let exact = self.exact.len() as u32;
        self.exact.push(intervals);
        let (mark, groups) = (self.forest.palette.mark(), self.forest.groups.len());
        let palette = &mut self.forest.palette;
        let mut ready = Vec::new();
        above.iter().for_each(|id| palette.simple(*id, &mut ready));
        ready.truncate(8);
        match texels::block(
            palette,
            &intervals,
            at.origin,
            &ready,
            &planes,
            self.search.lines.then_some(&lines),
            self.cx.scale,
        ) {
            Block::One(id) => {
                let proven = self.search.is_right(&self.forest.palette, id, &all, p, 4 * size);
                Node { exact, proven: Some(proven), ..Node::leaf(id) }
            }
            Block::Many(ids) => {
                let mut quarters = [Node::leaf(OPEN); 4];
                for (c, node) in quarters.iter_mut().enumerate() {
                    let first = (c & 1) * 2 + (c >> 1) * 8;
                    let mut children = [0, 1, 4, 5].map(|o| Node::leaf(ids[first + o]));
                    *node = self.cx.merge(at.child(c), &mut children, &mut self.forest, &[]);
                }
                let node = self.cx.merge(at, &mut quarters, &mut self.forest, &[]);
                let depths = super::raw::depths(&intervals);
                // nodes near the root stay in its page, which has room for the raws of 64 x 64 texels
                let log2_resolution = self.cx.scale.log2_resolution;
                let has_room = log2_resolution <= 6 || log2_resolution - at.level > COARSE_DEPTH;
                if !has_room || INDEX_COST + 16 * raw_words(&depths) >= self.forest.takes(&node, groups, mark) {
                    return node;
                }
                self.forest.groups.truncate(groups);
                self.forest.palette.back(mark);
                let raw = self.forest.palette.raw(depths);
                let mut raw = Node { exact, ..Node::leaf(self.forest.palette.entry(Entry::Raw(raw))) };
                let old = |s: &(EntryId, f32)| s.1 > 0.0 && self.forest.palette.is_older(s.0, mark);
                node.share.into_iter().filter(old).enumerate().for_each(|(i, s)| raw.share[i] = s);
                raw
            }
        }
    }
}

/// A square that nothing covers.
fn open() -> Node {
    Node { proven: Some(true), ..Node::leaf(OPEN) }
}

/// Merges four children: their parent takes over the entry that answers the most of them (Scandolo et al. 2016, section
/// 3.1, with entries in place of intervals). A proven entry and the same one unproven are two: proofs are not lost.
fn merge(at: At, children: &mut [Node; 4], forest: &mut Forest, exact: &[[Interval; 16]], scale: Scale) -> Node {
    let depth = scale.log2_resolution - at.level;
    if depth < COARSE_DEPTH && at.level > 1 && scale.log2_resolution > SMALL_LOG2 {
        children.iter_mut().for_each(|c| lower(c, forest));
    }
    let share = shares(children);
    let mut simple = share.iter().map(|s| s.0).find(|e| forest.palette.is_simple(*e));
    if simple.is_none() && (at.level >= AREA_LEVEL || depth <= COARSE_DEPTH) {
        simple = Some(forest.palette.simplified(share[0].0));
    }
    let palette = &forest.palette;
    let agrees = |(entry, proven): (EntryId, bool), c: usize| {
        let (node, at) = (&children[c], at.child(c));
        if node.proven.is_some_and(|p| p != proven) {
            return false;
        }
        node.entry == entry
            || resolve(palette, entry, at) == node.entry
            || (!proven
                && exact
                    .get(node.exact as usize)
                    .is_some_and(|intervals| texels::answers(palette, entry, intervals, at.origin, scale)))
    };
    let kept = |key: (EntryId, bool)| (0..4).filter(|c| agrees(key, *c)).fold(0u8, |w, c| w | 1 << c);
    let keys = [0, 1, 2, 3].map(|c: usize| (children[c].entry, children[c].proven.unwrap_or(true)));
    let mut best = (0u32, keys[0], 0u8);
    for i in 0..4 {
        let key = keys[i];
        if keys[..i].contains(&key) {
            continue;
        }
        // masks are of their own block
        let own = matches!(palette.get(key.0), Entry::Mask { .. } | Entry::Raw(_));
        let which = kept(key);
        let count = 2 * which.count_ones() - u32::from(own);
        if count > best.0 {
            best = (count, key, which);
        }
    }
    let (_, (mut entry, mut proven), mut which) = best;
    let areal = at.level >= AREA_LEVEL
        || matches!(palette.get(entry), Entry::Raw(_))
        || (depth <= COARSE_DEPTH && !palette.is_simple(entry));
    if let Some(simple) = simple.filter(|_| areal) {
        // the most area, not the most children: few nodes, which coarse lookups see
        entry = simple;
        let both = [true, false].map(|p| kept((entry, p)));
        proven = both[0].count_ones() >= both[1].count_ones();
        which = both[usize::from(!proven)];
    }
    let mut group = Group { mask: Mask(0), entry: [OPEN; 4], below: [NONE; 4], proven: 0 };
    let mut types = [NodeType::None; 4];
    let mut cost = 0;
    for (c, node) in children.iter().enumerate() {
        let inherits = which >> c & 1 == 1;
        types[c] = match (inherits, node.below == NONE) {
            (true, true) => NodeType::None,
            (true, false) => NodeType::Empty,
            (false, true) => NodeType::Leaf,
            (false, false) => NodeType::Inner,
        };
        group.entry[c] = node.entry;
        group.below[c] = node.below;
        group.proven |= u8::from(node.proven == Some(true)) << c;
        cost += node.cost + if inherits { 0 } else { forest.price(node.entry) };
    }
    group.mask = Mask::new(types);
    let known = (0..4).any(|c| which >> c & 1 == 1 && children[c].proven.is_some());
    let proven = known.then_some(proven);
    if group.mask.0 == 0 {
        return Node { share, proven, ..Node::leaf(entry) };
    }
    let below = forest.groups.len() as u32;
    forest.groups.push(group);
    Node { entry, below, cost: cost + super::page::GROUP_COST, share, exact: u32::MAX, proven }
}

/// Puts a leaf's split or mask one level down: the root page, which holds all nodes near the root, may hold more entries
/// than splits and masks can refer to.
fn lower(node: &mut Node, forest: &mut Forest) {
    if node.below != NONE || forest.palette.is_simple(node.entry) {
        return;
    }
    let below = forest.groups.len() as u32;
    let cost = super::page::GROUP_COST + 4 * forest.price(node.entry);
    let proven = if node.proven == Some(true) { 15 } else { 0 };
    let (mask, entry) = (Mask::new([NodeType::Leaf; 4]), [node.entry; 4]);
    forest.groups.push(Group { mask, entry, below: [NONE; 4], proven });
    *node = Node { entry: forest.palette.simplified(node.entry), below, cost, proven: None, ..*node };
}

/// Entries by their share of the four children's area, the largest first.
fn shares(children: &[Node; 4]) -> [(EntryId, f32); SHARES] {
    let mut all: Vec<(EntryId, f32)> = Vec::with_capacity(4 * SHARES);
    for (entry, share) in children.iter().flat_map(|c| c.share).filter(|s| s.1 > 0.0) {
        match all.iter_mut().find(|a| a.0 == entry) {
            Some(a) => a.1 += share / 4.0,
            None => all.push((entry, share / 4.0)),
        }
    }
    all.sort_by(|a, b| b.1.total_cmp(&a.1));
    std::array::from_fn(|i| all.get(i).copied().unwrap_or((all[0].0, 0.0)))
}

/// What an entry comes to in a square: the side of a split where all centres are on one.
pub fn resolve(palette: &Palette, mut id: EntryId, at: At) -> EntryId {
    while let Entry::Split { line, near, beyond } = palette.get(id) {
        match side(&palette.lines[line as usize], at) {
            Some(true) => id = beyond,
            Some(false) => id = near,
            None => break,
        }
    }
    id
}

/// Whether all texel centres of a square lie beyond a line, or before it, whatever page tells.
fn side(line: &Line, at: At) -> Option<bool> {
    let side = 256i64 << at.level;
    let [u, t] = if line.axis { [at.origin[1], at.origin[0]] } else { at.origin }.map(|o| i64::from(o) << 8);
    let ends = [line.boundary(u), line.boundary(u + side)];
    let (low, high) = (ends[0].min(ends[1]) - 4, ends[0].max(ends[1]) + 4);
    if (t << 12) >= high {
        Some(true)
    } else if ((t + side) << 12) < low {
        Some(false)
    } else {
        None
    }
}
