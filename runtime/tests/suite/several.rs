//! Several structures on one budget: they come, go, are replaced by new versions and marked as stale while frames go on,
//! and every answer is that of the version that is there.

use std::collections::HashMap;
use std::time::Duration;

use umbrage_format::Kind;
use umbrage_reader::Structure;
use umbrage_reader::query::Map;
use umbrage_runtime::query::Pool;
use umbrage_runtime::query::filter::FilterQuery;
use umbrage_runtime::query::pool::{ANCESTOR, EXACT, NONE, STALE};
use umbrage_runtime::residency::slots::UNIT_WORDS;
use umbrage_runtime::residency::{ABSENT, Entry, Op};
use umbrage_runtime::shader::{self, Rect};
use umbrage_runtime::stream::{Streamer, StructureId};
use umbrage_runtime::{GpuStreamer, Receiver, RuntimeError, ViewOptions};
use umbrage_writer::container::{ContainerOptions, PageInput};

use crate::support::{city_as, city_of, device, opened, queries, random_merged, random_vector, shared_city};
use crate::tree::{Dice, Folder, ID, Naive, grow, pages, structure, write};

/// An executor in memory.
pub struct Cpu {
    pub streamer: Streamer,
    words: Vec<u32>,
    table: Vec<Entry>,
    maps: Vec<shader::Map>,
    stale: Vec<Rect>,
    missed: HashMap<u32, u32>,
    used: Vec<u32>,
}

impl Cpu {
    pub fn new(streamer: Streamer) -> Self {
        let words = vec![0; streamer.budget().pool() as usize / 4];
        let used = vec![0; words.len() / UNIT_WORDS as usize / 32 + 1];
        let table = vec![ABSENT; streamer.table() as usize];
        Self { streamer, words, table, maps: Vec::new(), stale: Vec::new(), missed: HashMap::new(), used }
    }

    /// Feedback of the queries since the last frame, what came since, copies.
    pub fn frame(&mut self) {
        let missed = std::mem::take(&mut self.missed);
        self.streamer.feedback(missed, &self.used, false);
        self.used.fill(0);
        self.streamer.begin(&[]);
        self.tell();
        if let Some(budget) = self.streamer.exchange() {
            self.words.resize(budget.pool() as usize / 4, 0);
            self.used.resize(self.words.len() / UNIT_WORDS as usize / 32 + 1, 0);
        }
        let frame = self.streamer.frame();
        for op in frame.ops {
            match op {
                Op::Upload { at, words } => self.words[at as usize..][..words.len()].copy_from_slice(&words),
                Op::Move { from, to, words } => {
                    self.words.copy_within(from as usize..(from + words) as usize, to as usize);
                }
            }
        }
        for (ordinal, entry) in frame.table {
            self.table[ordinal as usize] = entry;
        }
    }

    /// What the device must know of the structures.
    fn tell(&mut self) {
        if let Some((maps, stale)) = self.streamer.maps() {
            (self.maps, self.stale) = (maps, stale);
        }
    }

    /// Words of the pool.
    pub fn words(&self) -> usize {
        self.words.len()
    }

    /// New buffers: nothing of the old ones is left.
    pub fn clear(&mut self) {
        self.words = vec![0; self.streamer.budget().pool() as usize / 4];
        self.used = vec![0; self.words.len() / UNIT_WORDS as usize / 32 + 1];
        self.table.fill(ABSENT);
        self.missed.clear();
        self.tell();
    }

    /// The same after all pages that are being read have come.
    pub fn whole_frame(&mut self) {
        while self.streamer.is_loading() {
            self.streamer.wait(Duration::from_millis(50));
        }
        self.frame();
    }

    /// None before the roots have come.
    pub fn pool(&self, id: StructureId) -> Option<Pool<'_>> {
        let map = self.maps.get(id.index() as usize).filter(|m| m.kind != 0)?;
        let kind = [Kind::Mh, Kind::Mmh, Kind::Vector].into_iter().find(|k| k.code() == map.kind)?;
        Some(Pool {
            words: &self.words,
            table: &self.table,
            base: map.base,
            stale: &self.stale[map.stale_first as usize..][..map.stale_count as usize],
            kind,
            log2_resolution: map.log2_resolution as u8,
            skips: None,
        })
    }

    /// Asks as a device would: the answer's value and level, and whether it is exact.
    pub fn ask(&mut self, id: StructureId, [x, y, level, _]: [u32; 4]) -> Option<(u32, u32, bool)> {
        let d = self.pool(id)?.texel(0, x, y, level);
        if d.missing != NONE {
            *self.missed.entry(d.missing).or_default() += 1;
        }
        if let Some(&[at, ..]) = self.table.get(d.page as usize).filter(|e| e[0] != NONE) {
            self.used[(at / UNIT_WORDS / 32) as usize] |= 1 << (at / UNIT_WORDS % 32);
        }
        assert!(self.streamer.span(id).unwrap().contains(d.page), "an answer of another structure");
        Some((d.value, d.level, d.missing == NONE))
    }
}

/// Changes one leaf of a tree, the first below `turns` turns.
fn change(tree: &mut Naive, turns: &mut u32) -> bool {
    match tree {
        Naive::Leaf(v) if *turns == 0 => {
            *v ^= 0x5A5A;
            true
        }
        Naive::Leaf(_) => {
            *turns -= 1;
            false
        }
        Naive::Inner(_, kids) | Naive::Empty(kids) => kids.iter_mut().flatten().any(|k| change(k, turns)),
    }
}

/// Two versions of a structure of many pages: a leaf differs.
pub fn versions(name: &str, seed: u64, log2: u8, cuts: &[u8]) -> [(Vec<u8>, Structure); 2] {
    let mut tree = grow(&mut Dice(seed), log2, true, 7);
    [0, 1].map(|version| {
        if version == 1 {
            assert!(change(&mut tree, &mut 300));
        }
        let pages: Vec<PageInput> = pages(&tree, log2, cuts);
        let record = structure("sun", Kind::Mh, log2, pages.len());
        let bytes = write(&format!("{name}-{version}"), ContainerOptions::new(ID), &[(record, pages)]);
        (bytes.clone(), opened(bytes))
    })
}

/// What a test knows of an attached structure.
struct Known {
    id: StructureId,
    /// Its version, and the one that is to take its place.
    version: usize,
    next: Option<usize>,
}

/// Any history: whatever comes, goes and is replaced under a budget that is too small for all, every exact answer is the
/// version's that is there.
#[test]
fn answers_are_those_of_the_version_that_is_there() {
    let [a, b] = versions("several-a", 3, 10, &[8, 6, 4]).map(|v| v.1);
    let [c, d] = versions("several-c", 11, 8, &[6, 4]).map(|v| v.1);
    let all =
        [a, b, c, d, opened(random_merged("several-mmh", 3, 8).1), opened(random_vector("several-vector", 2, 10, 6).1)];
    let maps: Vec<Map> = all.iter().map(|s| Map::new(s.clone()).unwrap()).collect();
    let total: u32 = all.iter().map(Structure::page_count).sum();
    let streamer = Streamer::with_table(2 << 20, total * 2, 1 << 30, 2).unwrap();
    let mut cpu = Cpu::new(streamer);
    let mut dice = Dice(99);
    let mut known: Vec<Known> = Vec::new();
    let (mut exact, mut coarse, mut refused, mut flips) = (0u64, 0u64, 0, 0);
    for step in 0..240 {
        let which = dice.roll(all.len() as u32) as usize;
        match dice.roll(6) {
            0 | 1 if known.len() < 6 => match cpu.streamer.attach(&all[which]) {
                Ok(id) => known.push(Known { id, version: which, next: None }),
                Err(RuntimeError::Table(_) | RuntimeError::Budget(_)) => refused += 1,
                Err(e) => panic!("{e}"),
            },
            2 if !known.is_empty() => {
                let gone = known.swap_remove(dice.roll(known.len() as u32) as usize).id;
                assert!(cpu.streamer.detach(gone) && !cpu.streamer.detach(gone));
                assert!(cpu.streamer.structure(gone).is_none());
            }
            3 | 4 if !known.is_empty() => {
                let at = dice.roll(known.len() as u32) as usize;
                // Mostly another version of the same.
                let to = if dice.roll(4) != 0 { known[at].version ^ 1 } else { which };
                match cpu.streamer.swap(known[at].id, &all[to]) {
                    Ok(()) => known[at].next = Some(to),
                    Err(RuntimeError::Table(_) | RuntimeError::Budget(_)) => refused += 1,
                    Err(e) => panic!("{e}"),
                }
            }
            _ => {}
        }
        for _ in 0..1 + dice.roll(6) {
            if dice.roll(3) == 0 {
                cpu.frame()
            } else {
                cpu.whole_frame()
            }
            for k in &mut known {
                if k.next.is_some() && !cpu.streamer.is_swapping(k.id) {
                    (k.version, k.next) = (k.next.take().unwrap(), None);
                    flips += 1;
                }
                let map = &maps[k.version];
                let log2 = map.structure().record().log2_resolution;
                assert_eq!(cpu.streamer.is_ready(k.id), cpu.pool(k.id).is_some());
                for q in queries(&mut dice, log2, 60) {
                    let Some((value, level, whole)) = cpu.ask(k.id, q) else { continue };
                    let [x, y, asked, _] = q;
                    if x >> log2 != 0 || y >> log2 != 0 {
                        continue;
                    }
                    let truth = map.texel(x, y, asked.min(log2.into()) as u8).unwrap();
                    if whole {
                        assert_eq!((value, level), (truth.value, truth.level.into()), "step {step}, {q:?}");
                        exact += 1;
                    } else {
                        coarse += 1;
                    }
                }
            }
        }
    }
    let stats = cpu.streamer.stats();
    eprintln!("{exact} exact, {coarse} coarse answers, {refused} refused, {flips} versions replaced, {stats:?}");
    assert!(exact > 30_000 && coarse > 1000 && flips > 10 && stats.kept > 50 && stats.evicted > 100, "{stats:?}");
    // All goes, and the table is free again.
    known.iter().for_each(|k| assert!(cpu.streamer.detach(k.id)));
    for _ in 0..700 {
        cpu.whole_frame();
    }
    let stats = cpu.streamer.stats();
    assert_eq!((stats.resident, stats.resident_words, stats.wanted, stats.failing), (0, 0, 0, 0));
    assert!(cpu.table.iter().all(|e| *e == ABSENT));
    cpu.streamer.attach(&all[0]).unwrap();
}

/// Every page there; then a version with one more building takes its place while frames go on.
#[test]
fn a_new_version_keeps_the_slots_of_unchanged_pages() {
    let folder = Folder::new("several-swap");
    let mut mesh = umbrage_writer::scene::generated("city:1:0.05").unwrap().unwrap();
    for kind in [Kind::Mh, Kind::Vector] {
        let before = opened(city_of(&mesh, &folder.0.join("before.umb"), 2048, kind, false));
        let plain = (mesh.positions.len(), mesh.triangles.len());
        // A mast of 2 m, higher than a house and lower than the highest, so that the lattice stays.
        let at = mesh.positions.iter().fold([0.0; 3], |m: [f64; 3], p| [m[0] + p[0], m[1] + p[1], m[2] + p[2]]);
        let middle = at.map(|v| v / mesh.positions.len() as f64);
        mesh.append(&mast([middle[0] + 7.0, 0.5, middle[2] + 3.0], [2.0, 9.0, 2.0]));
        let after = opened(city_of(&mesh, &folder.0.join("after.umb"), 2048, kind, false));
        mesh.positions.truncate(plain.0);
        mesh.triangles.truncate(plain.1);
        assert_eq!(before.lattice(), after.lattice());
        let maps = [&before, &after].map(|s| Map::new(s.clone()).unwrap());
        let table = before.page_count() + after.page_count();
        let mut cpu = Cpu::new(Streamer::with_table(64 << 20, table, 1 << 30, 2).unwrap());
        let id = cpu.streamer.attach(&before).unwrap();
        let mut dice = Dice(5);
        let asked: Vec<[u32; 4]> = (0..40_000).map(|_| [dice.roll(2048), dice.roll(2048), 0, 0]).collect();
        let ask = |cpu: &mut Cpu, map: &Map| {
            let mut coarse = 0;
            for q in &asked {
                let (value, _, exact) = cpu.ask(id, *q).expect("a hole");
                coarse += u32::from(!exact);
                assert!(!exact || value == map.texel(q[0], q[1], 0).unwrap().value);
            }
            coarse
        };
        while !cpu.streamer.is_ready(id) {
            cpu.whole_frame();
        }
        while ask(&mut cpu, &maps[0]) != 0 {
            cpu.whole_frame();
        }
        let (stats, loads) = (cpu.streamer.stats(), cpu.streamer.loads());
        assert!(stats.resident > 30, "{stats:?}");
        cpu.streamer.swap(id, &after).unwrap();
        let mut version = 0;
        let coarse: Vec<u32> = (0..40)
            .map(|_| {
                cpu.whole_frame();
                version = usize::from(!cpu.streamer.is_swapping(id));
                ask(&mut cpu, &maps[version])
            })
            .collect();
        let now = cpu.streamer.stats();
        let [kept, uploaded] = [now.kept, (now.uploaded_bytes - stats.uploaded_bytes) / 1024];
        eprintln!(
            "{}: {} pages, {kept} kept, {uploaded} of {} KiB uploaded, {} read, coarse answers by frame {coarse:?}",
            kind.name(),
            stats.resident,
            stats.uploaded_bytes / 1024,
            cpu.streamer.loads() - loads
        );
        assert_eq!((version, coarse.last()), (1, Some(&0)));
        assert!(uploaded * 4 < stats.uploaded_bytes / 1024, "only what changed, and the root");
        assert!(kept * 4 > u64::from(stats.resident) * 3);
        // The changed page alone was answered from above.
        assert!(coarse.iter().all(|n| *n < 1000), "{coarse:?}");
        assert_ne!(maps[0].texel(0, 0, 11).unwrap().page, NONE);
        // What is left of the old version goes some time later.
        for _ in 0..700 {
            cpu.whole_frame();
            ask(&mut cpu, &maps[1]);
        }
        let places = |e: &&Entry| e[0] != NONE;
        assert_eq!(cpu.table.iter().filter(places).count() as u32, cpu.streamer.stats().resident);
    }
}

/// A box.
fn mast([x, y, z]: [f64; 3], [w, h, d]: [f64; 3]) -> umbrage_writer::mesh::Mesh {
    let corner = |i: u32| [x + f64::from(i & 1) * w, y + f64::from(i >> 1 & 1) * h, z + f64::from(i >> 2) * d];
    let triangles = [
        [0, 2, 1],
        [1, 2, 3],
        [4, 5, 6],
        [5, 7, 6],
        [0, 1, 4],
        [1, 5, 4],
        [2, 6, 3],
        [3, 6, 7],
        [0, 4, 2],
        [2, 4, 6],
        [1, 3, 5],
        [3, 7, 5],
    ];
    umbrage_writer::mesh::Mesh { positions: (0..8).map(corner).collect(), triangles: triangles.to_vec() }
}

/// Three kinds in one pool on the device: kernels against twins, with stale rectangles, and views of each.
#[test]
fn the_device_asks_the_structure_that_is_selected() {
    let headless = device();
    let folder = Folder::new("several-device");
    let all = [
        opened(shared_city()),
        opened(random_merged("several-device-mmh", 3, 8).1),
        opened(city_as(&folder.0.join("city.umb"), 1024, Kind::Vector)),
    ];
    let table = all.iter().map(Structure::page_count).sum();
    let mut gpu = GpuStreamer::with_table(&headless.device, &headless.queue, 64 << 20, table).unwrap();
    assert!(matches!(gpu.answer(0, &[[0; 4]]), Err(RuntimeError::Gone)), "no structure yet");
    let ids = [0, 1, 2].map(|i: usize| gpu.streamer_mut().attach(&all[i]).unwrap());
    let late = gpu.streamer_mut().attach(&all[1]).unwrap_err();
    assert!(late.to_string().starts_with("the page table has"), "{late}");
    gpu.wait_ready().unwrap();
    let mut dice = Dice(7);
    let mut stale: Vec<Vec<Rect>> = Vec::new();
    for (id, s) in ids.iter().zip(&all) {
        let side = 1 << s.record().log2_resolution;
        let rect = |_| {
            let (x, y) = (dice.roll(side), dice.roll(side));
            Rect { x0: x, y0: y, x1: x + side / 8, y1: y + side / 16 }
        };
        let rects: Vec<Rect> = (0..5).map(rect).collect();
        rects.iter().for_each(|r| gpu.streamer_mut().mark_stale(*id, *r).unwrap());
        stale.push(rects);
    }
    let mut seen = [0; 3];
    for skips in [None, Some(0)] {
        gpu.skip(skips);
        for ((id, structure), stale) in ids.iter().zip(&all).zip(&stale) {
            gpu.select(*id);
            let (log2_resolution, kind) = (structure.record().log2_resolution, structure.kind());
            let span = gpu.streamer().span(*id).unwrap().clone();
            let asked = queries(&mut dice, log2_resolution, 20_000);
            let map = Map::new(structure.clone()).unwrap();
            let answers = gpu.answer(0, &asked).unwrap();
            let (words, table) = gpu.read_back().unwrap();
            let pool = Pool { words: &words, table: &table, base: span.base, stale, kind, log2_resolution, skips };
            for (q, a) in asked.iter().zip(&answers) {
                assert_eq!(*a, pool.answer(0, *q), "{q:?}");
                assert!(a[2] == NONE || span.contains(a[2]));
                let bits = [a[1] & EXACT, a[1] & ANCESTOR, a[1] & STALE];
                bits.iter().zip(&mut seen).for_each(|(b, n)| *n += u32::from(*b != 0));
            }
            let filter = |&[x, y, _, depth]: &[u32; 4]| {
                let receiver = umbrage_runtime::query::filter::Receiver { x, y, depth, gradient: [3, -5] };
                FilterQuery { receiver, lod: 0, side: 3 }
            };
            let filters: Vec<FilterQuery> = asked.iter().map(filter).collect();
            let states = gpu.filter(0, &filters).unwrap();
            let (words, table) = gpu.read_back().unwrap();
            let pool = Pool { words: &words, table: &table, ..pool };
            for (f, s) in filters.iter().zip(&states) {
                assert_eq!(*s, pool.filter(0, f), "{f:?}");
            }
            let receivers: Vec<Receiver> = asked
                .iter()
                .filter(|q| (q[0] | q[1]) >> log2_resolution == 0)
                .map(|&[x, y, _, depth]| Receiver { x, y, depth, level: 0 })
                .collect();
            let view = gpu.answer_view(&receivers, &ViewOptions::default()).unwrap();
            assert!(view.stats.exact, "{:?}", view.stats);
            for (r, p) in receivers.iter().zip(&view.pixels) {
                assert_eq!(p.lit, r.depth <= map.texel(r.x, r.y, 0).unwrap().value, "{r:?}");
            }
        }
    }
    assert!(seen.iter().all(|n| *n > 1000), "exact, by ancestors, stale: {seen:?}");
    let stats = gpu.frame_stats();
    assert!(stats.frame > 10 && stats.resident > 20 && stats.resident_bytes > 0, "{stats:?}");
    // One goes: the others answer on.
    assert!(gpu.streamer_mut().detach(ids[0]));
    gpu.select(ids[0]);
    assert!(matches!(gpu.answer(0, &[[0; 4]]), Err(RuntimeError::Gone)));
    gpu.select(ids[2]);
    let map = Map::new(all[2].clone()).unwrap();
    assert_eq!(gpu.answer(0, &[[5, 6, 3, 0]]).unwrap()[0][0], map.texel(5, 6, 3).unwrap().value);
    // And another version takes the place of one, once the device knows that the places of the first are free.
    for _ in 0..4 {
        gpu.answer(0, &[[0; 4]]).unwrap();
    }
    gpu.streamer_mut().swap(ids[1], &all[2]).unwrap();
    gpu.wait_ready().unwrap();
    gpu.select(ids[1]);
    assert_eq!(gpu.streamer().structure(ids[1]).unwrap().kind(), Kind::Vector);
    assert_eq!(gpu.answer(0, &[[5, 6, 10, 0]]).unwrap()[0][0], map.texel(5, 6, 10).unwrap().value);
}

/// What coverage says of a point is what lookups there find.
#[test]
fn coverage_is_how_far_answers_reach() {
    let structure = opened(shared_city());
    let mut cpu = Cpu::new(Streamer::new(&structure, 64 << 20, 64 << 20, 1).unwrap());
    let id = cpu.streamer.structures().next().unwrap();
    let lattice = structure.lattice();
    // Of the middle of a texel, by the inverse of the map that the lattice is.
    let texel = f64::from(lattice.subtexel_bits).exp2();
    let point = |x: u32, y: u32| world(&lattice.world_to_lattice, [x, y].map(|v| (f64::from(v) + 0.5) * texel));
    assert_eq!(cpu.streamer.coverage(id, point(9, 9)).unwrap().level, None);
    let mut dice = Dice(3);
    let mut levels = [0; 12];
    let stale = Rect { x0: 100, y0: 0, x1: 1000, y1: 700 };
    cpu.streamer.mark_stale(id, stale).unwrap();
    while !cpu.streamer.is_ready(id) {
        cpu.whole_frame();
    }
    for _ in 0..6 {
        for _ in 0..300 {
            let [x, y] = [0; 2].map(|_: u32| dice.roll(2048));
            let c = cpu.streamer.coverage(id, point(x, y)).unwrap();
            assert_eq!((c.inside, c.stale), (true, stale.contains([x, y])));
            let level = u32::from(c.level.unwrap());
            let pool = cpu.pool(id).unwrap();
            assert_eq!(pool.texel(0, x, y, level).missing, NONE, "{x} {y} at {level}");
            assert!(level == 0 || pool.texel(0, x, y, level - 1).missing != NONE, "{x} {y}");
            levels[level as usize] += 1;
        }
        for _ in 0..3 {
            let [x, y] = [0; 2].map(|_: u32| dice.roll(2048));
            cpu.ask(id, [x, y, 0, 0]);
        }
        cpu.whole_frame();
        cpu.whole_frame();
    }
    assert!(levels.iter().filter(|n| **n != 0).count() > 1 && levels[0] > 10, "{levels:?}");
    let outside = cpu.streamer.coverage(id, point(5000, 9)).unwrap();
    assert_eq!((outside.inside, outside.level), (false, None));
    cpu.streamer.clear_stale(id);
    assert!(!cpu.streamer.coverage(id, point(500, 500)).unwrap().stale);
    cpu.streamer.detach(id);
    assert_eq!(cpu.streamer.coverage(id, point(9, 9)), None);
}

/// A world point of lattice x and y, depth 0, by Cramer's rule.
fn world(rows: &[[f64; 4]; 3], [x, y]: [f64; 2]) -> [f64; 3] {
    let det = |m: [[f64; 3]; 3]| {
        let [a, b, c] = m;
        a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0]) + a[2] * (b[0] * c[1] - b[1] * c[0])
    };
    let right = [x - rows[0][3], y - rows[1][3], -rows[2][3]];
    let matrix: [[f64; 3]; 3] = std::array::from_fn(|i| [rows[i][0], rows[i][1], rows[i][2]]);
    std::array::from_fn(|k| {
        let mut m = matrix;
        (0..3).for_each(|i| m[i][k] = right[i]);
        det(m) / det(matrix)
    })
}

/// Rectangles of stale regions are few: a structure's own grow together, and nothing that was marked is lost.
#[test]
fn stale_regions_grow_together() {
    let all = [opened(shared_city()), opened(random_merged("several-stale", 3, 8).1)];
    let table = all.iter().map(Structure::page_count).sum();
    let mut streamer = Streamer::with_table(64 << 20, table, 1 << 30, 1).unwrap();
    let [city, other] = [0, 1].map(|i: usize| streamer.attach(&all[i]).unwrap());
    let mut dice = Dice(8);
    let mut rects = Vec::new();
    for _ in 0..500 {
        let [x, y] = [0; 2].map(|_: u32| dice.roll(2000));
        let rect = Rect { x0: x, y0: y, x1: x + 1 + dice.roll(40), y1: y + 1 + dice.roll(40) };
        streamer.mark_stale(city, rect).unwrap();
        rects.push(rect);
    }
    streamer.mark_stale(city, Rect { x0: 5, y0: 5, x1: 5, y1: 9 }).unwrap();
    let mut cpu = Cpu::new(streamer);
    while !cpu.streamer.is_ready(city) {
        cpu.whole_frame();
    }
    cpu.frame();
    let kept = cpu.pool(city).unwrap().stale;
    assert_eq!(kept.len(), 64);
    assert!(rects.iter().all(|r| kept.iter().any(|k| k.union(*r) == *k)));
    let full = cpu.streamer.mark_stale(other, rects[0]).unwrap_err();
    assert!(matches!(full, RuntimeError::Stale { most: 64 }), "{full}");
    cpu.streamer.clear_stale(city);
    cpu.streamer.mark_stale(other, rects[0]).unwrap();
}
