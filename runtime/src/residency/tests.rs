//! Invariants of the state machine, held after every step of random histories.

use std::collections::HashMap;
use std::sync::Arc;

use proptest::prelude::*;
use umbrage_reader::query::Bounds;

use super::budget::BLOCK_BYTES;
use super::slots::{BLOCK_WORDS, UNIT_WORDS, class_of, slot_words, taken};
use super::*;

/// A made-up structure: pages in level order, each with its first child, its children and its length.
#[derive(Debug, Clone)]
struct Pages {
    records: Vec<(u32, u16, u32)>,
    roots: u32,
}

impl Pages {
    fn new(roots: u32, children: &[u16], words: &[u32]) -> Self {
        let mut records = Vec::new();
        let mut next = roots;
        let most = 400;
        for i in 0.. {
            if i as u32 == next {
                break;
            }
            let count = children[i % children.len()].min((most - next.min(most)) as u16);
            records.push((next, count, words[i % words.len()]));
            next += u32::from(count);
        }
        Self { records, roots }
    }

    fn page(&self, ordinal: u32) -> LoadedPage {
        let (first_child, child_count, words) = self.records[ordinal as usize];
        LoadedPage {
            ordinal,
            first_child,
            child_count,
            children: (first_child..first_child + u32::from(child_count)).map(|o| self.told(o)).collect(),
            dependencies: Vec::new(),
            hash: Some(content(ordinal)),
            words: vec![ordinal; words as usize].into(),
        }
    }

    fn told(&self, ordinal: u32) -> Child {
        let words = self.records[ordinal as usize].2;
        Child { bounds: bounds(ordinal), words, hash: Some(content(ordinal)) }
    }

    fn config(&self, blocks: u32) -> Config {
        Config { table: self.records.len() as u32, blocks, frame_bytes: 2 * BLOCK_BYTES, host_bytes: 4 * BLOCK_BYTES }
    }

    /// Pages from the root down to `ordinal`.
    fn path(&self, mut ordinal: u32) -> Vec<u32> {
        let mut path = vec![ordinal];
        while ordinal >= self.roots {
            let parent = self.records.iter().position(|r| (r.0..r.0 + u32::from(r.1)).contains(&ordinal)).unwrap();
            ordinal = parent as u32;
            path.insert(0, ordinal);
        }
        path
    }
}

/// Hash of a page's content: here it holds its own number.
fn content(ordinal: u32) -> u64 {
    u64::from(ordinal) << 32 | 0xABC
}

/// What the index says of a page.
fn bounds(ordinal: u32) -> Bounds {
    Bounds { min_depth: ordinal, max_depth: 2 * ordinal + 5, stop_error: 7 * ordinal }
}

/// An executor in memory, and the checks.
struct World {
    pages: Pages,
    residency: Residency,
    pool: Vec<u32>,
    table: Vec<Entry>,
    loading: Vec<u32>,
    /// Pages that came.
    reads: u64,
}

impl World {
    fn new(pages: Pages, blocks: u32) -> Self {
        let mut residency = Residency::new(pages.config(blocks));
        let roots: Vec<Child> = (0..pages.roots).map(|o| pages.told(o)).collect();
        residency.attach(pages.records.len() as u32, 0, roots.into()).unwrap();
        let (pool, table) = (vec![0; (blocks * BLOCK_WORDS) as usize], vec![ABSENT; pages.records.len()]);
        Self { pages, residency, pool, table, loading: Vec::new(), reads: 0 }
    }

    /// Walks down as a device does: what is used, what is missed.
    fn walk(&self, ordinal: u32, used: &mut [u32]) -> Option<u32> {
        let mut last = None;
        for page in self.pages.path(ordinal) {
            let at = self.table[page as usize][0];
            if at == NOT_RESIDENT {
                last.inspect(|&at: &u32| used[(at / UNIT_WORDS / 32) as usize] |= 1 << (at / UNIT_WORDS % 32));
                return Some(page);
            }
            last = Some(at);
        }
        last.inspect(|&at| used[(at / UNIT_WORDS / 32) as usize] |= 1 << (at / UNIT_WORDS % 32));
        None
    }

    /// A frame that asks for `targets`; `fails` of the loads fail. Gives how many targets were answered by ancestors.
    fn frame(&mut self, targets: &[u32], fails: impl Fn(u32) -> bool) -> usize {
        let orders = self.residency.loads();
        self.loading.extend(orders);
        for ordinal in std::mem::take(&mut self.loading) {
            if fails(ordinal) {
                self.residency.failed(ordinal);
            } else {
                self.reads += 1;
                self.residency.loaded(self.pages.page(ordinal));
            }
        }
        let frame = self.residency.frame();
        let mut bytes = 0;
        for op in frame.ops {
            match op {
                Op::Upload { at, words } => {
                    bytes += words.len() as u64 * 4;
                    self.pool[at as usize..][..words.len()].copy_from_slice(&words);
                }
                Op::Move { from, to, words } => {
                    assert!(from.abs_diff(to) >= words);
                    self.pool.copy_within(from as usize..(from + words) as usize, to as usize);
                }
            }
        }
        assert!(bytes <= self.residency.config.frame_bytes && frame.table.len() as u64 <= MAX_DIRTY);
        for (ordinal, entry) in frame.table {
            self.table[ordinal as usize] = entry;
        }
        self.check();
        let mut used = vec![0; self.pool.len() / UNIT_WORDS as usize / 32];
        let missed: Vec<(u32, u32)> = targets.iter().filter_map(|&t| Some((self.walk(t, &mut used)?, 1))).collect();
        let count = missed.len();
        self.residency.feedback(missed, &used, false);
        count
    }

    fn check(&self) {
        let r = &self.residency;
        let mut spans = Vec::new();
        for (ordinal, page) in r.residents.iter() {
            let words = self.pages.records[ordinal as usize].2;
            assert_eq!((page.words, page.at + words <= self.pool.len() as u32), (words, true));
            // Its words are in its slot, whatever was moved meanwhile.
            assert!(self.pool[page.at as usize..][..words as usize].iter().all(|&w| w == ordinal));
            spans.push((page.at, page.at + taken(words)));
            assert!(page.needs.iter().all(|&n| r.is_resident(n)), "a page without its parent");
            let dependents = r.residents.iter().filter(|(_, p)| p.needs.contains(&ordinal)).count();
            assert_eq!(page.dependents as usize, dependents);
        }
        spans.sort_unstable();
        assert!(spans.windows(2).all(|w| w[0].1 <= w[1].0), "two pages in one place");
        for (ordinal, &entry) in (0u32..).zip(&self.table) {
            let (own, told) = (r.entry(ordinal), bounds(ordinal));
            let told = [NOT_RESIDENT, told.stop_error, told.min_depth, told.max_depth];
            // What the index says comes some frames later than the parent, and stays true when it goes.
            let right = if own[0] == NOT_RESIDENT { entry == ABSENT || entry == told } else { entry == own };
            assert!(right, "the table of the device is the state's");
        }
        let ready: u64 =
            r.wants.values().map(|w| if let State::Ready(p) = &w.state { p.words.len() as u64 * 4 } else { 0 }).sum();
        let loading = r.wants.values().filter(|w| matches!(w.state, State::Loading)).count() as u64;
        assert_eq!((ready, loading), (r.ready_bytes, r.loading));
        let reserved = |w: &Want| if matches!(w.state, State::Loading) { w.bytes() } else { 0 };
        assert_eq!(r.loading_bytes, r.wants.values().map(reserved).sum::<u64>());
        assert!(ready + r.loading_bytes <= r.config.host_bytes, "host memory");
    }
}

fn structures() -> impl Strategy<Value = Pages> {
    let words = prop_oneof![2u32..200, 200u32..3000, Just(BLOCK_WORDS), Just(64), Just(2048)];
    (1u32..4, prop::collection::vec(0u16..9, 1..12), prop::collection::vec(words, 1..20))
        .prop_map(|(roots, children, words)| Pages::new(roots, &children, &words))
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn invariants_hold_in_any_history(
        pages in structures(),
        extra in 1u32..8,
        history in prop::collection::vec((prop::collection::vec(any::<u32>(), 0..40), any::<u8>()), 1..60),
    ) {
        let roots = pages.roots;
        let count = pages.records.len() as u32;
        let mut world = World::new(pages, roots + extra);
        let mut rooted = false;
        for (targets, luck) in history {
            let targets: Vec<u32> = targets.into_iter().map(|t| t % count).collect();
            world.frame(&targets, |o| o >= roots && o % 7 == u32::from(luck % 16));
            rooted |= world.residency.roots_resident();
            prop_assert!(!rooted || world.residency.roots_resident(), "a root was evicted");
            // Requests out of thin air do no harm.
            world.residency.request(u32::from(luck) * 5, u32::from(luck));
            world.residency.foresee(u32::from(luck) * 3, u32::MAX);
            world.residency.request(u32::MAX, 1);
        }
    }

    #[test]
    fn what_fits_is_admitted_whatever_was_there(
        pages in structures(),
        seed in any::<u32>(),
        noise in prop::collection::vec(prop::collection::vec(any::<u32>(), 0..60), 0..30),
    ) {
        let count = pages.records.len() as u32;
        let mut world = World::new(pages.clone(), pages.roots + 9);
        for targets in noise {
            let targets: Vec<u32> = targets.into_iter().map(|t| t % count).collect();
            world.frame(&targets, |o| o % 11 == 5 && o >= pages.roots);
        }
        let target = seed % count;
        let path = pages.path(target);
        // A block has slots of one class.
        let mut words: HashMap<u8, u32> = HashMap::new();
        for page in path.iter().copied().chain(0..pages.roots).collect::<BTreeSet<u32>>() {
            let class = class_of(pages.records[page as usize].2).unwrap();
            *words.entry(class).or_default() += slot_words(class);
        }
        let blocks: u32 = words.values().map(|w| w.div_ceil(BLOCK_WORDS)).sum();
        prop_assume!(blocks <= pages.roots + 9);
        let frames = (0..400).find(|_| world.frame(&[target], |_| false) == 0);
        prop_assert!(frames.is_some(), "page {target} never came: {:?}", world.residency.stats());
    }
}

/// Small pages all over the pool, one left in each block, then pages of a whole block.
#[test]
fn scattered_pages_move_together() {
    let mut records = vec![(1, 0, BLOCK_WORDS); 2000];
    records[0] = (1, 1999, 64);
    records[1..1800].iter_mut().for_each(|r| *r = (2000, 0, 64));
    let mut world = World::new(Pages { records, roots: 1 }, 6);
    // 256 small pages fill a block: 5 blocks and a bit are in use. Four come in a frame.
    let small: Vec<u32> = (1..1400).collect();
    assert!((0..500).any(|_| world.frame(&small, |_| false) == 0));
    // Every 20th stays in use: 70 pages in all 6 blocks; 4 pages of a whole block have room beside them.
    let mut kept: Vec<u32> = (1..1400).step_by(20).collect();
    kept.extend(1900..1904);
    let frames = (0..200).find(|_| world.frame(&kept, |_| false) == 0);
    let stats = world.residency.stats();
    assert!(frames.is_some() && stats.moved > 0, "{stats:?}");
}

#[test]
fn too_much_is_wanted_and_the_state_says_so() {
    // 100 children of a whole block each under a small root.
    let mut records = vec![(101, 0, BLOCK_WORDS); 101];
    records[0] = (1, 100, 100);
    let pages = Pages { records, roots: 1 };
    let mut world = World::new(pages, 5);
    let all: Vec<u32> = (1..101).collect();
    let left: Vec<usize> = (0..60).map(|_| world.frame(&all, |_| false)).collect();
    assert_eq!(left.last(), Some(&96), "4 blocks beside the root's");
    let stats = world.residency.stats();
    assert_eq!((stats.wanted, stats.starved + 8 >= 96), (96, true));
    // What is in use stays: nothing was evicted only to be read again.
    assert_eq!((stats.evicted, stats.admitted, world.reads), (0, 5, 5));
}

#[test]
fn nobody_goes_for_a_page_that_finds_no_room_all_the_same() {
    // The root's block, and one for page 1 and its children: page 2 wants a block, and page 1 stays.
    let records = vec![(1, 2, BLOCK_WORDS), (3, 3, 128), (6, 0, BLOCK_WORDS), (6, 0, 128), (6, 0, 128), (6, 0, 128)];
    let mut world = World::new(Pages { records, roots: 1 }, 2);
    let left: Vec<usize> = (0..100).map(|_| world.frame(&[3, 4, 5, 2], |_| false)).collect();
    assert_eq!(left[20..], [1; 80]);
    let stats = world.residency.stats();
    assert_eq!(
        (stats.evicted, stats.admitted, stats.resident, stats.resident_words),
        (0, 5, 5, u64::from(BLOCK_WORDS) + 4 * 128)
    );
    // They go as ever once nobody uses them.
    assert!((0..40).any(|_| world.frame(&[2], |_| false) == 0));
    assert_eq!((world.residency.stats().evicted, world.residency.stats().resident), (4, 2));
}

#[test]
fn a_failing_page_is_reported_once_and_tried_ever_more_rarely() {
    let mut world = World::new(Pages::new(1, &[2, 0], &[100]), 4);
    let mut tries = Vec::new();
    for frame in 0..1500u32 {
        let asked = std::cell::Cell::new(false);
        world.frame(&[1, 2], |o| {
            asked.set(asked.get() || o == 1);
            o == 1
        });
        if asked.get() {
            tries.push(frame);
        }
    }
    let waits: Vec<u32> = tries.windows(2).map(|w| w[1] - w[0]).collect();
    assert!(waits.windows(2).all(|w| w[1] >= w[0]) && *waits.last().unwrap() <= 260, "{waits:?}");
    assert!((8..20).contains(&tries.len()), "{tries:?}");
    assert!(world.residency.is_resident(2) && world.residency.stats().failing == 1);
    let mut first = Failures::default();
    assert!(first.note(3, 0) && !first.note(3, 2) && first.waits(3, 5) && !first.waits(3, 6));
    // It comes at last.
    assert!((0..300).any(|_| world.frame(&[1], |_| false) == 0));
    assert_eq!(world.residency.stats().failing, 0);
}

#[test]
fn dependencies_come_first_and_stay() {
    let mut by_ordinal: HashMap<u32, LoadedPage> = HashMap::new();
    let page = |ordinal: u32, dependencies: &[u32]| LoadedPage {
        ordinal,
        first_child: 0,
        child_count: 0,
        children: Arc::default(),
        dependencies: dependencies.to_vec(),
        hash: None,
        words: vec![ordinal; 100].into(),
    };
    // 1 needs 2; 3 and 4 need each other, which never ends and never hangs.
    for p in [page(0, &[1, 2]), page(1, &[2]), page(2, &[]), page(3, &[4]), page(4, &[3])] {
        by_ordinal.insert(p.ordinal, p);
    }
    let config = Config { table: 5, blocks: 3, frame_bytes: BLOCK_BYTES, host_bytes: BLOCK_BYTES };
    let mut residency = Residency::new(config);
    residency.attach(5, 4, vec![Child::unknown()].into()).unwrap();
    residency.request(3, 1);
    for _ in 0..60 {
        for o in residency.loads() {
            residency.loaded(by_ordinal[&o].clone());
        }
        residency.frame();
        residency.feedback([], &[], false);
        assert!(!residency.is_resident(1) || residency.is_resident(2));
        assert!(!residency.is_resident(0) || residency.is_resident(1));
    }
    assert!((0..3).all(|o| residency.is_resident(o)) && !residency.is_resident(3));
    assert_eq!(residency.stats().wanted, 0, "nobody asks for 3 any more");
}

/// A root with so many small children, the root resident.
fn many(children: u16) -> World {
    let mut records = vec![(1 + u32::from(children), 0, 64); 1 + usize::from(children)];
    records[0] = (1, children, 100);
    let mut world = World::new(Pages { records, roots: 1 }, 4);
    world.frame(&[], |_| false);
    world
}

#[test]
fn what_weighs_most_is_loaded_first_and_what_is_foreseen_last() {
    let mut world = many(20);
    let r = &mut world.residency;
    r.feedback([(1, 5), (2, 50), (3, 20)], &[], false);
    r.foresee(4, 1000);
    r.foresee(5, 2000);
    // Said again in the same round: the larger weight stays, and a receiver that misses it now counts more than foresight.
    r.request(1, 30);
    r.foresee(2, 1);
    assert_eq!(r.loads(), [2, 1, 3, 5, 4]);
    for ordinal in [5, 3] {
        r.loaded(world.pages.page(ordinal));
    }
    // What has been read waits in the order of the latest round.
    r.feedback([(5, 9), (3, 7)], &[], false);
    let ready: Vec<u32> = r.ready.iter().map(|k| k.2).collect();
    assert_eq!(ready, [5, 3]);
}

#[test]
fn a_foreseen_page_takes_no_place_that_is_in_use() {
    // Room for the root's block and one page of a whole block.
    let records = vec![(1, 2, 64), (3, 0, BLOCK_WORDS), (3, 0, BLOCK_WORDS)];
    let mut world = World::new(Pages { records, roots: 1 }, 2);
    assert!((0..20).any(|_| world.frame(&[1], |_| false) == 0));
    for _ in 0..20 {
        world.residency.foresee(2, u32::MAX);
        assert_eq!(world.frame(&[1], |_| false), 0);
    }
    assert!(world.residency.is_resident(1) && world.residency.stats().evicted == 0);
    // Once nobody uses the other it comes before anybody has missed it.
    let came = (0..KEPT + 20).any(|_| {
        world.residency.foresee(2, 1);
        world.frame(&[0], |_| false);
        world.residency.is_resident(2)
    });
    assert!(came);
}

#[test]
fn a_page_in_use_goes_only_for_what_is_worth_far_more() {
    // Room for the root and one page of a whole block.
    let records = vec![(1, 2, BLOCK_WORDS), (3, 0, BLOCK_WORDS), (3, 0, BLOCK_WORDS)];
    let mut world = World::new(Pages { records, roots: 1 }, 2);
    assert!((0..20).any(|_| world.frame(&[1], |_| false) == 0));
    // Frames until it comes.
    let mut comes = |page: u32, weight: u32, used: u32| {
        (0..KEPT + 20).find(|_| {
            world.residency.request(page, weight);
            world.frame(&[used], |_| false);
            world.residency.is_resident(page)
        })
    };
    assert_eq!(comes(2, 2, 1), None, "it came with a weight of 1");
    assert!(comes(2, 4, 1).is_some());
    assert_eq!(comes(1, 8, 2), None, "nor does it go back as soon as the other weighs more");
    let after = comes(1, 8, 0).expect("nobody uses the other any more");
    assert!(
        (HALVED..=HALVED + PARKED + GRACE).contains(&after),
        "worth half after {HALVED} rounds, seen after {after}"
    );
    let after = comes(2, 1, 0).expect("nor this one");
    assert!(after > KEPT, "kept from what is worth less for {KEPT} rounds, gone after {after}");
    // The root and those four: nothing was read that found no room.
    assert_eq!((world.residency.stats().admitted, world.reads), (5, 5));
}

#[test]
fn a_load_that_nobody_waits_for_is_abandoned() {
    let mut world = many(20);
    let r = &mut world.residency;
    r.request(7, 1);
    assert_eq!(r.loads(), [7]);
    for _ in 0..PATIENCE {
        r.feedback([], &[], false);
        assert_eq!(r.abandoned().count(), 0);
    }
    r.feedback([], &[], false);
    assert_eq!(r.abandoned().collect::<Vec<_>>(), [7]);
    r.cancelled(7);
    assert_eq!((r.abandoned().count(), r.stats().wanted, r.stats().cancelled, r.loading), (0, 0, 1, 0));
    r.cancelled(7);
    // It may be asked for again.
    r.request(7, 1);
    assert_eq!((r.loads(), r.stats().cancelled), (vec![7], 1));
}

#[test]
fn the_device_learns_of_all_children_however_many() {
    let mut world = many(3000);
    for _ in 0..4 {
        world.frame(&[], |_| false);
    }
    for ordinal in 1..=3000 {
        let b = bounds(ordinal);
        assert_eq!(world.table[ordinal as usize], [NOT_RESIDENT, b.stop_error, b.min_depth, b.max_depth]);
    }
}
