//! The walks over words of the test's own choice, without files and streamer: lookups inside texels, entries at the
//! extremes of their fields, and words that no check would let through.

use umbrage_format::Kind;
use umbrage_format::kind::vector::{Line, Plane};
use umbrage_reader::query::{PageView, vector};
use umbrage_runtime::query::pool::NONE;
use umbrage_runtime::query::{Answer, Pool};
use umbrage_runtime::residency::Entry as TableEntry;
use umbrage_runtime::shader::{self, FEEDBACK_USED, Map, View};
use wgpu::util::DeviceExt;

use crate::support::device;
use crate::tree::Dice;
use crate::vector_tree::{Entry, Node, grow, pages};

/// Asks one walk; in: root, x, y, level; fx, fy, and whether (fx, fy) counts.
const SHADER: &str = "
@group(0) @binding(0) var<storage, read_write> lookups: array<vec4<u32>>;
@compute @workgroup_size(64) fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x * 2u >= arrayLength(&lookups) { return; }
    let q = lookups[id.x * 2u];
    let r = lookups[id.x * 2u + 1u];
    var d = umb_answer(q.x, q.y, q.z, q.w);
    if r.z != 0u { d = umb_continuous(q.x, q.y, q.z, r.xy); }
    lookups[id.x * 2u] = vec4<u32>(d.value, d.level, d.page, d.word);
    lookups[id.x * 2u + 1u].x = d.missing;
}";

/// A lookup of [`Bare::ask`].
#[derive(Clone, Copy, Debug)]
struct Lookup {
    root: u32,
    at: [u32; 2],
    level: u32,
    /// The place inside the texel, at level 0.
    sub: Option<[u32; 2]>,
}

impl Lookup {
    /// By the CPU twin.
    fn twin(&self, pool: &Pool<'_>) -> Answer {
        let [x, y] = self.at;
        match self.sub {
            None => pool.texel(self.root, x, y, self.level),
            Some(sub) => pool.continuous(self.root, x, y, sub),
        }
    }
}

/// A pipeline over a pool.
struct Bare {
    pipeline: wgpu::ComputePipeline,
}

impl Bare {
    fn new() -> Self {
        let device = &device().device;
        let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: None,
            source: wgpu::ShaderSource::Wgsl((shader::module(1) + SHADER).into()),
        });
        let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: None,
            layout: None,
            module: &module,
            entry_point: Some("main"),
            compilation_options: Default::default(),
            cache: None,
        });
        Self { pipeline }
    }

    /// Holds the device's answers against the twin's and gives them.
    fn ask(&self, pool: &Pool<'_>, lookups: &[Lookup]) -> Vec<Answer> {
        let headless = device();
        let device = &headless.device;
        let used_words = 1u32;
        let map = Map {
            log2_resolution: pool.log2_resolution.into(),
            kind: pool.kind.code(),
            skips: pool.skips.is_some().into(),
            error: pool.skips.unwrap_or(0),
            ..Map::NONE
        };
        let (pool_words, pages) = (pool.words.len() as u32, pool.table.len() as u32);
        let mut view = View { pool_words, pages, used_words, ..bytemuck::Zeroable::zeroed() };
        view.tell(&[map], &[]);
        let buffer = |contents: &[u8], usage| {
            let usage = usage | wgpu::BufferUsages::COPY_SRC;
            device.create_buffer_init(&wgpu::util::BufferInitDescriptor { label: None, contents, usage })
        };
        let storage = wgpu::BufferUsages::STORAGE;
        let feedback = vec![0u32; (FEEDBACK_USED + used_words) as usize];
        let buffers = [
            buffer(bytemuck::cast_slice(pool.words), storage),
            buffer(bytemuck::cast_slice(pool.table), storage),
            buffer(bytemuck::cast_slice(&feedback), storage),
            buffer(bytemuck::bytes_of(&view), wgpu::BufferUsages::UNIFORM),
        ];
        let input: Vec<[u32; 8]> = lookups
            .iter()
            .map(|l| {
                let ([x, y], [fx, fy]) = (l.at, l.sub.unwrap_or_default());
                [l.root, x, y, l.level, fx, fy, l.sub.is_some().into(), 0]
            })
            .collect();
        let array = buffer(bytemuck::cast_slice(&input), storage);
        let back = device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: array.size(),
            usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let group = |number, buffers: &[&wgpu::Buffer]| {
            let entries: Vec<_> = (0..)
                .zip(buffers)
                .map(|(binding, b)| wgpu::BindGroupEntry { binding, resource: b.as_entire_binding() })
                .collect();
            let layout = &self.pipeline.get_bind_group_layout(number);
            device.create_bind_group(&wgpu::BindGroupDescriptor { label: None, layout, entries: &entries })
        };
        let mut encoder = device.create_command_encoder(&Default::default());
        let mut pass = encoder.begin_compute_pass(&Default::default());
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &group(0, &[&array]), &[]);
        pass.set_bind_group(1, &group(1, &buffers.each_ref()), &[]);
        pass.dispatch_workgroups((lookups.len() as u32).div_ceil(64), 1, 1);
        drop(pass);
        encoder.copy_buffer_to_buffer(&array, 0, &back, 0, array.size());
        encoder.map_buffer_on_submit(&back, wgpu::MapMode::Read, .., |r| r.unwrap());
        headless.queue.submit([encoder.finish()]);
        device.poll(wgpu::PollType::wait_indefinitely()).unwrap();
        let view = back.get_mapped_range(..).unwrap();
        let found: &[[u32; 8]] = bytemuck::cast_slice(&view);
        let answers = found.iter().zip(lookups).map(|(&[value, level, page, word, missing, ..], l)| {
            let answer = Answer { value, level, page, word, missing };
            assert_eq!(answer, l.twin(pool), "{l:?}");
            answer
        });
        answers.collect()
    }
}

/// Pages one behind the other, and their table.
fn pool(pages: &[Vec<u32>], first_children: &[u32]) -> (Vec<u32>, Vec<TableEntry>) {
    let (mut words, mut table) = (Vec::new(), Vec::new());
    for (page, first_child) in pages.iter().zip(first_children) {
        table.push([words.len() as u32, *first_child, 0, u32::MAX]);
        words.extend_from_slice(page);
    }
    (words, table)
}

/// A tree's pages, and the first child of each: children stand in the order of their parents.
fn laid(tree: &Node, log2: u8) -> (Vec<Vec<u32>>, Vec<u32>) {
    let pages: Vec<Vec<u32>> = pages(tree, log2).into_iter().map(|p| p.words).collect();
    let mut next = 1;
    let first_children = pages.iter().map(|p| {
        let first = next;
        next += p[0] >> 16;
        first
    });
    let first_children = first_children.collect();
    (pages, first_children)
}

#[test]
fn places_inside_texels_answer_as_twin_reader_and_naive_tree() {
    let bare = Bare::new();
    for (seed, log2, bushy) in [(3, 4, 7), (4, 8, 7), (9, 10, 6)] {
        let mut dice = Dice(seed);
        let tree = grow(&mut |n| dice.roll(n), log2, true, bushy);
        let (pages, first_children) = laid(&tree, log2);
        let (words, table) = pool(&pages, &first_children);
        let pool = Pool {
            words: &words,
            table: &table,
            base: 0,
            stale: &[],
            kind: Kind::Vector,
            log2_resolution: log2,
            skips: None,
        };
        let lookups: Vec<Lookup> = (0..500_000)
            .map(|_| {
                let at = [0; 2].map(|_| dice.roll(1 << log2));
                // Bits above the low 8 do not count.
                let sub = [0; 2].map(|_| dice.roll(1 << 9));
                Lookup { root: 0, at, level: 0, sub: Some(sub) }
            })
            .collect();
        let lookup = |o: u32| {
            let page = pages.get(o as usize)?;
            Some(PageView { words: page, first_child: first_children[o as usize], dependencies: &[] })
        };
        for (l, a) in lookups.iter().zip(bare.ask(&pool, &lookups)) {
            let ([x, y], sub) = (l.at, l.sub.unwrap_or_default().map(|s| s as u8));
            let d = vector::continuous(lookup, 0, log2, x, y, sub);
            let reader = (d.value, u32::from(d.level), d.page, d.word, d.missing.unwrap_or(NONE));
            assert_eq!((a.value, a.level, a.page, a.word, a.missing), reader, "{l:?}");
            assert_eq!(a.value, tree.continuous(log2, x, y, sub), "{l:?}");
        }
    }
}

/// One leaf of the largest map for every entry, asked at the corners and at random.
#[test]
fn entries_at_the_extremes_of_their_fields() {
    const LOG2: u8 = 24;
    let mut dice = Dice(77);
    let slopes = [-(1 << 24), (1 << 24) - 1, -1, 0, 1, 0x55_5555, -0xAA_AAAA];
    let mut entries: Vec<Entry> = vec![Entry::Constant(0), Entry::Constant(u32::MAX)];
    for shift in 0..64 {
        for gx in slopes {
            for gy in slopes {
                let offset = [-(1i64 << 38), (1 << 38) - 1, 0, -1, 0xFFFF_FFFE, 1 << 32, -(1 << 32), 1 << 31]
                    [dice.roll(8) as usize];
                entries.push(Entry::Plane(Plane { offset, gx, gy, shift }));
            }
        }
    }
    let fine = [-(1 << 26), (1 << 26) - 1, 1 << 24, -(1 << 24) - 1, 0x155_5555, -0x2AA_AAAA, 1, -1];
    for shift in 8..40 {
        for (gx, gy) in fine.iter().flat_map(|gx| fine.map(|gy| (*gx, gy))) {
            let offset =
                [-(1i64 << 35), (1 << 35) - 1, 0, -1, 0xFFFF_FFFE, 1 << 32, -(1 << 32), 1 << 31][dice.roll(8) as usize];
            entries.push(Entry::Plane(Plane { offset, gx, gy, shift }));
        }
    }
    let mut offsets = vec![-(1i64 << 47), (1 << 47) - 1, 0, -1, 1, 1 << 44, (1 << 44) - 1, 1 << 43, -(1 << 43)];
    offsets.extend([0xFFFF_FFFF, i32::MIN.into(), i32::MAX.into(), 1 << 31, -(1 << 31) - 1]);
    // short ones among them
    for m in [i32::MIN, i32::MAX, i32::MAX - 1, -1, -2, 0, 1, 2, 0x1234_5678, -0x1234_5678] {
        for c in offsets.iter().copied() {
            for axis in [false, true] {
                let sides = [Entry::Constant(1), Entry::Constant(2)];
                entries.push(Entry::Split(Line { m, c, axis }, Box::new(sides)));
            }
        }
    }
    for width in 0..=32 {
        let low = |v: u32| if width == 32 { v } else { v & ((1 << width) - 1) };
        entries.push(Entry::Raw(Box::new([0; 16].map(|_| low(dice.roll(u32::MAX))))));
    }
    let nodes: Vec<Node> = entries.into_iter().map(|e| Node::leaf(e).proven()).collect();
    let laid: Vec<Vec<u32>> = nodes.iter().map(|n| pages(n, LOG2).remove(0).words).collect();
    let (words, table) = pool(&laid, &vec![0; laid.len()]);
    let pool = Pool {
        words: &words,
        table: &table,
        base: 0,
        stale: &[],
        kind: Kind::Vector,
        log2_resolution: LOG2,
        skips: None,
    };
    let side = 1u32 << LOG2;
    let mut lookups = Vec::new();
    for root in 0..nodes.len() as u32 {
        let ends = [0, 1, side / 2, side - 1];
        let corners = ends.into_iter().flat_map(|y| ends.map(|x| [x, y])).collect::<Vec<_>>();
        let random = (0..24).map(|_| [0; 2].map(|_| dice.roll(side))).collect::<Vec<_>>();
        for at in corners.into_iter().chain(random) {
            let sub = [[0, 0], [255, 255], [0, 255], [128, 127]][dice.roll(4) as usize];
            lookups.push(Lookup { root, at, level: 0, sub: Some(sub) });
            lookups.extend([0, dice.roll(26), 24, u32::MAX].map(|level| Lookup { root, at, level, sub: None }));
        }
    }
    for (l, a) in lookups.iter().zip(bare_ask_in_parts(&pool, &lookups)) {
        let (node, [x, y]) = (&nodes[l.root as usize], l.at);
        let expected = match l.sub {
            Some(sub) => node.continuous(LOG2, x, y, sub.map(|s| s as u8)),
            None => node.lookup(LOG2, x, y, l.level.min(255) as u8),
        };
        assert_eq!(a.value, expected, "{l:?} {node:?}");
    }
}

/// In arrays that every device dispatches at once.
fn bare_ask_in_parts(pool: &Pool<'_>, lookups: &[Lookup]) -> Vec<Answer> {
    let bare = Bare::new();
    lookups.chunks(1 << 20).flat_map(|part| bare.ask(pool, part)).collect()
}

/// Pages with words changed that no check has seen, tables that point anywhere, frames that lie: kernel and twin end,
/// and agree.
#[test]
fn words_that_no_check_has_seen() {
    let bare = Bare::new();
    let mut dice = Dice(41);
    let mut missing = 0;
    for round in 0..400 {
        let log2 = dice.roll(9) as u8;
        let tree = grow(&mut |n| dice.roll(n), log2, true, 7);
        let (mut pages, mut first_children) = laid(&tree, log2);
        for page in &mut pages {
            for _ in 0..dice.roll(8) {
                // Most often in the frame or the header.
                let most = if dice.roll(2) == 0 { 8.min(page.len() as u32) } else { page.len() as u32 };
                let at = dice.roll(most) as usize;
                page[at] = if dice.roll(2) == 0 { dice.roll(u32::MAX) } else { page[at] ^ 1 << dice.roll(32) };
            }
        }
        if dice.roll(4) == 0 {
            first_children.iter_mut().for_each(|c| *c ^= 1 << dice.roll(32));
        }
        if dice.roll(8) == 0 {
            pages.iter_mut().flatten().for_each(|w| *w = dice.roll(u32::MAX));
        }
        let (words, mut table) = pool(&pages, &first_children);
        for entry in &mut table {
            if dice.roll(16) == 0 {
                entry[0] = [NONE, words.len() as u32 - 1, words.len() as u32, dice.roll(u32::MAX), entry[0] + 1]
                    [dice.roll(5) as usize];
            }
        }
        let kind = [Kind::Vector, Kind::Vector, Kind::Vector, Kind::Mh, Kind::Mmh, Kind::Stack][round % 6];
        // A view may lie, too.
        let log2_resolution = if dice.roll(16) == 0 { dice.roll(256) as u8 } else { log2 };
        let pool = Pool { words: &words, table: &table, base: 0, stale: &[], kind, log2_resolution, skips: None };
        let pages = table.len() as u32;
        let lookups: Vec<Lookup> = (0..4000)
            .map(|_| {
                let most = if dice.roll(8) == 0 { u32::MAX } else { 1 << log2 };
                let at = [0; 2].map(|_| dice.roll(most));
                let root = [0, dice.roll(pages + 1), 0, u32::MAX][dice.roll(4).min(dice.roll(4)) as usize];
                let sub = (dice.roll(3) == 0).then(|| [0; 2].map(|_| dice.roll(u32::MAX)));
                Lookup { root, at, level: dice.roll(u32::from(log2) + 2), sub }
            })
            .collect();
        missing += bare.ask(&pool, &lookups).iter().filter(|a| a.missing != NONE).count();
    }
    assert!(missing > 1000);
}
