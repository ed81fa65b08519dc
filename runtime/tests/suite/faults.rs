//! What goes wrong while frames go on: sources that are slow, fail, lie or end too early, a lost device, a budget that is cut,
//! hundreds of structures, files that are replaced. Answers may become coarse and say so; none is ever wrong, and all
//! become exact again.

use std::io::{Error, ErrorKind};
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use umbrage_format::Kind;
use umbrage_reader::query::Map;
use umbrage_reader::{Container, FileSource, Limits, MemorySource, Source, Structure};
use umbrage_runtime::residency::foresee::Viewpoint;
use umbrage_runtime::residency::{Budget, BudgetError};
use umbrage_runtime::stream::{Streamer, StructureId};
use umbrage_runtime::{GpuStreamer, Headless, RuntimeError};
use umbrage_writer::container::{ContainerOptions, ContainerWriter};

use crate::several::{Cpu, versions};
use crate::support::{device, opened, queries, random_merged, random_tree, random_vector, shared_city};
use crate::tree::{Dice, Folder, ID, grow, pages, structure};

/// What a source does to reads.
const WELL: u32 = 0;
const SLOW: u32 = 1;
const FAILS: u32 = 2;
const LIES: u32 = 3;
const SHORT: u32 = 4;

/// A source that a test makes ill and well.
struct Faulty {
    bytes: MemorySource,
    state: Arc<AtomicU32>,
    reads: AtomicU32,
}

impl Source for Faulty {
    fn len(&self) -> u64 {
        self.bytes.len()
    }

    fn read_at(&self, offset: u64, out: &mut [u8]) -> std::io::Result<()> {
        let turn = self.reads.fetch_add(1, Ordering::Relaxed);
        match self.state.load(Ordering::Relaxed) {
            SLOW => std::thread::sleep(Duration::from_millis(2)),
            FAILS if !turn.is_multiple_of(3) => return Err(Error::other("a test's source fails")),
            SHORT if offset + out.len() as u64 > self.len() / 2 => return Err(ErrorKind::UnexpectedEof.into()),
            _ => {}
        }
        self.bytes.read_at(offset, out)?;
        if self.state.load(Ordering::Relaxed) == LIES && !turn.is_multiple_of(3) {
            let at = turn as usize * 7919 % out.len().max(1);
            out.iter_mut().skip(at).take(1).for_each(|b| *b ^= 1 << (turn % 8));
        }
        Ok(())
    }

    fn name(&self) -> &str {
        "faulty"
    }
}

/// Structure 0 of a file whose source obeys.
fn faulty(bytes: Vec<u8>) -> (Structure, Arc<AtomicU32>) {
    let state = Arc::new(AtomicU32::new(WELL));
    let source = Faulty { bytes: MemorySource::new(bytes, "memory"), state: state.clone(), reads: AtomicU32::new(0) };
    let file = Container::open(Arc::new(source), Limits::default()).unwrap();
    (file.structure(0).unwrap(), state)
}

/// Asks at random and holds what is exact against the map: how many answers were coarse.
fn hold(cpu: &mut Cpu, id: StructureId, map: &Map, dice: &mut Dice, count: usize) -> usize {
    let log2 = map.structure().record().log2_resolution;
    let mut coarse = 0;
    for q in queries(dice, log2, count) {
        let [x, y, level, _] = q;
        if x >> log2 != 0 || y >> log2 != 0 {
            continue;
        }
        let Some((value, _, exact)) = cpu.ask(id, q) else { continue };
        let level = level.min(log2.into()) as u8;
        assert!(!exact || value == map.texel(x, y, level).unwrap().value, "{q:?}");
        coarse += usize::from(!exact);
    }
    coarse
}

fn ready(cpu: &mut Cpu) {
    for _ in 0..2000 {
        if !cpu.streamer.is_settling() {
            return;
        }
        cpu.whole_frame();
    }
    panic!("roots never came: {:?}", cpu.streamer.stats());
}

#[test]
fn sources_that_are_slow_fail_lie_or_end_early_cost_detail_and_nothing_else() {
    let files = [
        random_tree("faults-mh", 5, 10, &[8, 6, 4]).1,
        random_merged("faults-mmh", 3, 8).1,
        random_vector("faults-vector", 2, 10, 6).1,
    ];
    for bytes in files {
        let map = Map::new(opened(bytes.clone())).unwrap();
        let (structure, state) = faulty(bytes);
        let name = structure.kind().name();
        let mut cpu = Cpu::new(Streamer::new(&structure, 16 << 20, 16 << 20, 2).unwrap());
        let id = cpu.streamer.structures().next().unwrap();
        ready(&mut cpu);
        let mut dice = Dice(4);
        for ill in [SLOW, FAILS, LIES, SHORT] {
            state.store(ill, Ordering::Relaxed);
            // All but the roots go, so that everything is read through the fault.
            cpu.streamer.restart().unwrap();
            cpu.clear();
            let (mut coarse, mut most) = (0, 0);
            for _ in 0..60 {
                cpu.whole_frame();
                coarse += hold(&mut cpu, id, &map, &mut dice, 200);
                most = most.max(cpu.streamer.frame_stats().failing);
            }
            let failures = cpu.streamer.take_failures();
            let told: Vec<String> = failures.iter().map(|f| f.error.to_string()).take(1).collect();
            eprintln!(
                "{name}, fault {ill}: {coarse} coarse answers, at most {most} failing, {} told: {told:?}",
                failures.len()
            );
            assert!((most == 0) == (ill == SLOW) && failures.len() >= most as usize);
            assert!(failures.iter().all(|f| f.structure == id && f.ordinal < structure.page_count()));
            let mut named: Vec<u32> = failures.iter().map(|f| f.ordinal).collect();
            named.sort_unstable();
            named.dedup();
            // Again only for one that came meanwhile, or when all was forgotten.
            assert!(named.len() * 2 >= failures.len());
            // Well again: in time, after the longest wait between two tries, all is exact.
            state.store(WELL, Ordering::Relaxed);
            let healed = (0..1200).find(|_| {
                cpu.whole_frame();
                hold(&mut cpu, id, &map, &mut dice, 2000) == 0
            });
            assert!(healed.is_some(), "{name}, fault {ill}: {:?}", cpu.streamer.stats());
            cpu.streamer.take_failures();
        }
    }
}

#[test]
fn a_file_that_is_cut_while_it_is_open_is_answered_by_what_is_there() {
    let folder = Folder::new("faults-cut");
    let path = folder.0.join("tree.umb");
    let (_, bytes) = random_tree("faults-cut-tree", 5, 10, &[8, 6, 4]);
    std::fs::write(&path, &bytes).unwrap();
    let map = Map::new(opened(bytes.clone())).unwrap();
    let open = || Container::open(Arc::new(FileSource::open(&path).unwrap()), Limits::default());
    let structure = open().unwrap().structure(0).unwrap();
    let mut cpu = Cpu::new(Streamer::new(&structure, 16 << 20, 16 << 20, 2).unwrap());
    let id = cpu.streamer.structures().next().unwrap();
    ready(&mut cpu);
    let file = std::fs::OpenOptions::new().write(true).open(&path).unwrap();
    file.set_len(bytes.len() as u64 / 2).unwrap();
    let mut dice = Dice(4);
    let mut coarse = 0;
    for _ in 0..100 {
        cpu.whole_frame();
        coarse = hold(&mut cpu, id, &map, &mut dice, 500);
    }
    let failures = cpu.streamer.take_failures();
    let stats = cpu.streamer.frame_stats();
    assert!(coarse > 0 && stats.failing > 0 && !failures.is_empty(), "{stats:?}");
    let text = failures[0].error.to_string();
    assert!(text.contains("tree.umb") || text.contains("file"), "{text}");
    // Opened anew it is refused, and says where.
    let refused = open().unwrap_err();
    assert_eq!(refused.rule().map(|r| r.id()), Some("header.length"), "{refused}");
    // A cut before the roots: no streamer, an error.
    file.set_len(4096).unwrap();
    let mut none = Streamer::new(&structure, 16 << 20, 16 << 20, 2);
    if let Ok(streamer) = &mut none {
        for _ in 0..50 {
            streamer.wait(Duration::from_millis(20));
            streamer.frame();
        }
        assert!(!streamer.take_failures().is_empty() && streamer.is_settling());
    }
}

#[test]
fn a_lost_device_is_noticed_and_another_one_goes_on() {
    let first = Headless::new().unwrap();
    let structure = opened(shared_city());
    let map = Map::new(structure.clone()).unwrap();
    let mut gpu = GpuStreamer::new(&first.device, &first.queue, &structure, 16 << 20).unwrap();
    let id = gpu.streamer().structures().next().unwrap();
    let asked: Vec<[u32; 4]> = (0..500).map(|i| [i * 4, 2047 - i * 3, 0, 0]).collect();
    gpu.answer(0, &asked).unwrap();
    assert!(!gpu.is_lost());
    // The driver says no more than that it is gone.
    first.device.on_uncaptured_error(Arc::new(|e| eprintln!("after the loss: {e}")));
    first.device.destroy();
    for _ in 0..5 {
        gpu.streamer_mut().wait(Duration::from_millis(20));
        gpu.begin(&[]);
        let mut encoder = first.device.create_command_encoder(&Default::default());
        gpu.record(&mut encoder);
        gpu.end(&mut encoder);
        first.queue.submit([encoder.finish()]);
    }
    assert!(gpu.is_lost());
    let second = device();
    let mut gpu = gpu.recover(&second.device, &second.queue).unwrap();
    gpu.wait_ready().unwrap();
    assert!(!gpu.is_lost() && gpu.streamer().is_ready(id));
    for _ in 0..20 {
        gpu.answer(0, &asked).unwrap();
        while gpu.streamer().is_loading() {
            gpu.streamer_mut().wait(Duration::from_millis(20));
        }
    }
    for (q, a) in asked.iter().zip(gpu.answer(0, &asked).unwrap()) {
        assert_eq!(a[0], map.texel(q[0], q[1], 0).unwrap().value);
    }
}

/// Fewest bytes that a streamer takes.
fn least(streamer: &mut Streamer) -> u64 {
    match streamer.set_budget(1) {
        Err(RuntimeError::Budget(BudgetError { needed, .. })) => needed,
        other => panic!("{other:?}"),
    }
}

/// Down to what roots and one way need, and up again, while frames go on: never a wrong answer, and never more words than
/// there are.
#[test]
fn a_budget_is_cut_to_the_least_and_given_back() {
    let structures = [opened(shared_city()), opened(random_merged("faults-budget", 3, 8).1)];
    let maps = structures.each_ref().map(|s| Map::new(s.clone()).unwrap());
    let table = structures.iter().map(Structure::page_count).sum();
    let mut cpu = Cpu::new(Streamer::with_table(16 << 20, table, 1 << 30, 2).unwrap());
    let ids = structures.each_ref().map(|s| cpu.streamer.attach(s).unwrap());
    ready(&mut cpu);
    let mut dice = Dice(6);
    let mut fly = |cpu: &mut Cpu, frames: usize| {
        let mut coarse = 0;
        for _ in 0..frames {
            cpu.whole_frame();
            coarse = (0..2).map(|i| hold(cpu, ids[i], &maps[i], &mut dice, 300)).sum();
        }
        coarse
    };
    while fly(&mut cpu, 20) != 0 {}
    let all = cpu.streamer.stats().resident;
    let least = least(&mut cpu.streamer);
    assert!(least < 3 << 20, "{least}");
    for round in 0..3 {
        cpu.streamer.set_budget(least).unwrap();
        let coarse = fly(&mut cpu, 60);
        let (budget, stats): (Budget, _) = (*cpu.streamer.budget(), cpu.streamer.stats());
        eprintln!("round {round}: {least} bytes, {coarse} coarse answers of a frame, {stats:?}");
        assert!(budget.total == least && budget.used() <= least);
        assert!(stats.resident < all && stats.resident_words * 4 <= budget.pool());
        assert_eq!(cpu.words(), budget.pool() as usize / 4);
        assert!(cpu.streamer.set_budget(least - 1).is_err() && cpu.streamer.budget().total == least);
        assert!(ids.iter().all(|id| cpu.streamer.is_ready(*id)));
        cpu.streamer.set_budget(16 << 20).unwrap();
        let exact = (0..200).any(|_| fly(&mut cpu, 3) == 0);
        assert!(exact, "{:?}", cpu.streamer.stats());
    }
    // Cut and given back at once: what was given last counts.
    cpu.streamer.set_budget(least).unwrap();
    cpu.frame();
    cpu.streamer.set_budget(16 << 20).unwrap();
    assert!((0..200).any(|_| fly(&mut cpu, 3) == 0));
    assert_eq!(cpu.streamer.budget().total, 16 << 20);
}

/// The same on a device: its buffers are exchanged.
#[test]
fn a_device_gives_memory_back() {
    let headless = device();
    let structure = opened(shared_city());
    let map = Map::new(structure.clone()).unwrap();
    let mut gpu = GpuStreamer::new(&headless.device, &headless.queue, &structure, 16 << 20).unwrap();
    let asked: Vec<[u32; 4]> = (0..2000).map(|i| [i, 2047 - i, 0, 0]).collect();
    let go = |gpu: &mut GpuStreamer, frames: usize| {
        let mut coarse = 0;
        for _ in 0..frames {
            while gpu.streamer().is_loading() {
                gpu.streamer_mut().wait(Duration::from_millis(20));
            }
            let answers = gpu.answer(0, &asked).unwrap();
            let exact = |a: &[u32; 4]| a[2] == umbrage_runtime::query::pool::NONE;
            coarse = answers.iter().filter(|a| !exact(a)).count();
            for (q, a) in asked.iter().zip(&answers).filter(|(_, a)| exact(a)) {
                assert_eq!(a[0], map.texel(q[0], q[1], 0).unwrap().value, "{q:?}");
            }
        }
        coarse
    };
    assert_eq!(go(&mut gpu, 30), 0);
    let (large, least) = (gpu.buffers()[0].size(), least(gpu.streamer_mut()));
    gpu.set_budget(least).unwrap();
    let coarse = go(&mut gpu, 40);
    let sum: u64 = gpu.buffers().iter().map(|b| b.size()).sum();
    eprintln!("{large} bytes of pool to {}: {coarse} coarse answers", gpu.buffers()[0].size());
    assert!(gpu.exchanges() == 1 && sum < least && gpu.streamer().budget().total == least);
    gpu.set_budget(16 << 20).unwrap();
    assert_eq!(go(&mut gpu, 40), 0);
    assert_eq!((gpu.exchanges(), gpu.buffers()[0].size()), (2, large));
}

#[test]
fn hundreds_of_structures_answer_and_go() {
    let kinds: Vec<Structure> = (0..4)
        .flat_map(|i| {
            [
                opened(random_tree(&format!("hundreds-mh-{i}"), 3 + i, 6, &[4]).1),
                opened(random_vector(&format!("hundreds-vector-{i}"), 2 + i, 10, 6).1),
            ]
        })
        .collect();
    let maps: Vec<Map> = kinds.iter().map(|s| Map::new(s.clone()).unwrap()).collect();
    let table = kinds.iter().map(Structure::page_count).sum::<u32>() * 40;
    let mut cpu = Cpu::new(Streamer::with_table(64 << 20, table, 1 << 30, 2).unwrap());
    let ids: Vec<StructureId> = (0..256).map(|i| cpu.streamer.attach(&kinds[i % 8]).unwrap()).collect();
    let full = cpu.streamer.attach(&kinds[0]).unwrap_err();
    assert!(matches!(full, RuntimeError::Structures { most: 256 }), "{full}");
    ready(&mut cpu);
    let mut dice = Dice(12);
    let axes = [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]];
    let (mut coarse, mut times) = (0, Vec::new());
    for n in 0..40 {
        cpu.whole_frame();
        let view = Viewpoint { eye: [f64::from(n), 3.0, 0.0], axes, half: [0.8, 0.45], pixels: [1280, 720] };
        let start = Instant::now();
        cpu.streamer.begin(&[view]);
        times.push(start.elapsed());
        coarse = ids.iter().enumerate().map(|(i, id)| hold(&mut cpu, *id, &maps[i % 8], &mut dice, 40)).sum();
    }
    times.sort();
    let stats = cpu.streamer.stats();
    eprintln!(
        "256 structures: begin takes {:?}, at most {:?}, {coarse} coarse answers, {stats:?}",
        times[20], times[39]
    );
    assert!(stats.resident > 1000 && stats.starved == 0, "{stats:?}");
    assert!(ids.iter().all(|id| cpu.streamer.detach(*id)));
    for _ in 0..100 {
        cpu.whole_frame();
    }
    assert_eq!((cpu.streamer.stats().resident, cpu.streamer.structures().count()), (0, 0));
    // Names of those that have gone name nothing, also when their numbers are given anew.
    let anew = cpu.streamer.attach(&kinds[1]).unwrap();
    assert_eq!(anew.index(), ids[0].index());
    assert!(anew != ids[0] && cpu.streamer.structure(ids[0]).is_none() && !cpu.streamer.detach(ids[0]));
}

/// Two readers stream a path while a writer replaces the file again and again: each reads the version that it has opened,
/// to the end, and a new one when it opens the path again.
#[test]
fn readers_keep_their_version_while_the_file_is_replaced() {
    let folder = Folder::new("faults-replaced");
    let path = folder.0.join("tree.umb");
    let trees: Vec<_> = (0..2).map(|i| grow(&mut Dice(40 + i), 8, true, 7)).collect();
    let save = |version: usize| {
        let pages = pages(&trees[version], 8, &[6, 4]);
        let record = structure("sun", Kind::Mh, 8, pages.len());
        let mut writer = ContainerWriter::create(&path, ContainerOptions::new(ID), vec![record]).unwrap();
        pages.iter().for_each(|p| writer.push(p).unwrap());
        writer.finish().unwrap();
    };
    save(0);
    let stop = std::sync::atomic::AtomicBool::new(false);
    let seen = [0; 2].map(AtomicUsize::new);
    let both = || seen.iter().all(|s| s.load(Ordering::Relaxed) > 0);
    // on a busy machine the one that writes may come late
    let deadline = Instant::now() + Duration::from_secs(60);
    std::thread::scope(|scope| {
        let readers: Vec<_> = (0..2)
            .map(|seed| {
                let (path, trees, seen, both) = (&path, &trees, &seen, &both);
                scope.spawn(move || {
                    let mut dice = Dice(seed);
                    let mut opened = 0;
                    while opened < 25 || (!both() && Instant::now() < deadline) {
                        opened += 1;
                        let source = FileSource::open(path).unwrap();
                        let file = Container::open(Arc::new(source), Limits::default()).unwrap();
                        let structure = file.structure(0).unwrap();
                        let mut cpu = Cpu::new(Streamer::new(&structure, 8 << 20, 8 << 20, 1).unwrap());
                        let id = cpu.streamer.structures().next().unwrap();
                        ready(&mut cpu);
                        let mut fits = [true; 2];
                        for _ in 0..12 {
                            cpu.whole_frame();
                            for _ in 0..100 {
                                let (x, y) = (dice.roll(256), dice.roll(256));
                                let (value, _, exact) = cpu.ask(id, [x, y, 0, 0]).unwrap();
                                let own = [0, 1].map(|v: usize| trees[v].lookup(8, x, y, 0) == value);
                                (0..2).for_each(|v| fits[v] &= !exact || own[v]);
                            }
                        }
                        assert!(fits[0] != fits[1], "a mixture of versions");
                        seen[usize::from(fits[1])].fetch_add(1, Ordering::Relaxed);
                        assert_eq!(cpu.streamer.stats().failing, 0);
                    }
                })
            })
            .collect();
        scope.spawn(|| {
            for version in [1, 0].into_iter().cycle() {
                if stop.load(Ordering::Relaxed) {
                    break;
                }
                save(version);
            }
        });
        let joined: Vec<_> = readers.into_iter().map(|r| r.join()).collect();
        stop.store(true, Ordering::Relaxed);
        joined.into_iter().for_each(|r| r.unwrap());
    });
    eprintln!("versions seen by the readers: {seen:?}");
    assert!(both() && seen.iter().map(|s| s.load(Ordering::Relaxed)).sum::<usize>() >= 50);
}

/// KiB of the process that are in memory, where the system says so.
fn memory() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|l| l.strip_prefix("VmRSS:"))?;
    line.split_whitespace().next()?.parse().ok()
}

/// 100,000 frames of random flight with random faults, or `UMBRAGE_SOAK` of them. At the end all but the roots goes.
#[test]
fn a_long_flight_through_all_of_this_ends_at_the_pinned_set() {
    let frames: u32 = std::env::var("UMBRAGE_SOAK").ok().and_then(|v| v.parse().ok()).unwrap_or(100_000);
    let [a, b] = versions("soak", 3, 10, &[8, 6, 4]).map(|(bytes, _)| bytes);
    let files = [a, b, random_merged("soak-mmh", 3, 8).1, random_vector("soak-vector", 2, 10, 6).1];
    let maps: Vec<Map> = files.iter().map(|f| Map::new(opened(f.clone())).unwrap()).collect();
    let all: Vec<(Structure, Arc<AtomicU32>)> = files.into_iter().map(faulty).collect();
    let table = all.iter().map(|s| s.0.page_count()).sum::<u32>() * 4;
    let mut cpu = Cpu::new(Streamer::with_table(4 << 20, table, 1 << 30, 2).unwrap());
    let mut known: Vec<(StructureId, usize, Option<usize>)> = Vec::new();
    let mut dice = Dice(77);
    let (mut coarse, mut worst, mut cuts, mut exact) = (0u64, Duration::ZERO, 0, 0u64);
    let mut early = None;
    for frame in 0..frames {
        if frame == frames / 4 {
            early = memory();
        }
        match dice.roll(40) {
            0 if known.len() < 8 => {
                let which = dice.roll(4) as usize;
                if let Ok(id) = cpu.streamer.attach(&all[which].0) {
                    known.push((id, which, None));
                }
            }
            1 if known.len() > 3 => {
                let gone = known.swap_remove(dice.roll(known.len() as u32) as usize);
                assert!(cpu.streamer.detach(gone.0));
            }
            2 if !known.is_empty() => {
                let at = dice.roll(known.len() as u32) as usize;
                let to = if known[at].1 < 2 { known[at].1 ^ 1 } else { dice.roll(4) as usize };
                if cpu.streamer.swap(known[at].0, &all[to].0).is_ok() {
                    known[at].2 = Some(to);
                }
            }
            3 | 4 => {
                let fault = [WELL, WELL, WELL, FAILS, LIES, SHORT][dice.roll(6) as usize];
                all[dice.roll(4) as usize].1.store(fault, Ordering::Relaxed);
            }
            5 => cuts += u32::from(cpu.streamer.set_budget(u64::from(dice.roll(4 << 20))).is_ok()),
            6 if frame % 500 == 13 => {
                // A structure whose index can't be read just now goes.
                let _ = cpu.streamer.restart();
                cpu.clear();
                known.retain(|k| cpu.streamer.structure(k.0).is_some());
                known.iter_mut().for_each(|k| k.2 = k.2.filter(|_| cpu.streamer.is_swapping(k.0)));
            }
            _ => {}
        }
        let start = Instant::now();
        cpu.frame();
        worst = worst.max(start.elapsed());
        for (id, version, next) in &mut known {
            if let Some(to) = next.filter(|_| !cpu.streamer.is_swapping(*id)) {
                (*version, *next) = (to, None);
            }
            let found = hold(&mut cpu, *id, &maps[*version], &mut dice, 12);
            coarse += found as u64;
            exact += 12 - found as u64;
        }
        let budget = cpu.streamer.budget();
        assert!(budget.used() <= budget.total && cpu.words() * 4 <= budget.pool() as usize);
    }
    let stats = cpu.streamer.stats();
    eprintln!(
        "{frames} frames: {coarse} coarse answers, about {exact} exact or outside, {cuts} budgets, slowest frame {worst:?}, {stats:?}"
    );
    assert!(coarse > 100 && cuts > 0 && stats.evicted > 100 && stats.failing < 4000);
    if let (Some(early), Some(late)) = (early, memory()) {
        eprintln!("memory of the process after a quarter: {early} KiB, at the end: {late} KiB");
        assert!(late < early + (8 << 10), "{early} to {late} KiB");
    }
    // All is well again, and nobody asks for anything: all pages but the roots may go.
    all.iter().for_each(|s| s.1.store(WELL, Ordering::Relaxed));
    let roots = known.len() as u32;
    for _ in 0..900 {
        cpu.whole_frame();
    }
    let least = least(&mut cpu.streamer);
    cpu.streamer.set_budget(least).unwrap();
    for _ in 0..40 {
        cpu.whole_frame();
    }
    assert!(!cpu.streamer.is_settling() && cpu.streamer.budget().total == least);
    assert!(known.iter().all(|k| cpu.streamer.is_ready(k.0)));
    let stats = cpu.streamer.stats();
    assert_eq!((stats.wanted, stats.starved, cpu.streamer.is_loading()), (0, 0, false), "{stats:?}");
    known.iter().for_each(|k| assert!(cpu.streamer.detach(k.0)));
    for _ in 0..60 {
        cpu.whole_frame();
    }
    let stats = cpu.streamer.stats();
    assert_eq!(
        (stats.resident, stats.resident_words, stats.wanted, stats.failing),
        (0, 0, 0, 0),
        "of {roots} roots: {stats:?}"
    );
}
