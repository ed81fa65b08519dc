//! Whole views: exact at last under any budget that works, never a hole, never beyond the budget.

use std::sync::Arc;
use std::time::{Duration, Instant};

use umbrage_reader::query::Map;
use umbrage_reader::{Container, FileSource, Limits, MemorySource, Source, Structure};
use umbrage_runtime::gpu::{Pixel, ViewStats};
use umbrage_runtime::lattice::FrameLattice;
use umbrage_runtime::{GpuStreamer, Receiver, RuntimeError, ViewOptions};

use crate::support::{city, device, opened, random_tree, random_vector, shared_city};
use crate::tree::{Dice, Folder};

/// Receivers all over the map and a little beyond, at depths around the stored ones.
fn receivers(map: &Map, dice: &mut Dice, count: usize) -> Vec<Receiver> {
    let side = map.resolution();
    (0..count)
        .map(|_| {
            let (x, y) = (dice.roll(side + side / 64), dice.roll(side + side / 64));
            let near = map.texel(x.min(side - 1), y.min(side - 1), 0).unwrap().value;
            Receiver { x, y, depth: near.saturating_add(dice.roll(5)).saturating_sub(2), level: 0 }
        })
        .collect()
}

/// Holds a pixel against the reader's map.
fn right(map: &Map, r: &Receiver, p: &Pixel) {
    let side = map.resolution();
    if r.x >= side || r.y >= side {
        assert!(p.lit && p.outside && !p.ancestor);
    } else {
        let answer = map.texel(r.x, r.y, 0).unwrap();
        assert_eq!((p.lit, p.outside, p.ancestor), (r.depth <= answer.value, false, false), "{r:?}");
        assert!(p.settled || p.level == answer.level);
    }
}

fn show(name: &str, stats: &ViewStats, start: Instant) {
    eprintln!(
        "{name}: {} frames, {} of {} pages read, budget {} KiB (pool {}), uploaded {} KiB, evicted {}, starved {}, {:.1} s",
        stats.frames,
        stats.pages_read,
        stats.pages,
        stats.budget_bytes >> 10,
        stats.pool_bytes >> 10,
        stats.uploaded_bytes >> 10,
        stats.evicted,
        stats.starved,
        start.elapsed().as_secs_f64()
    );
}

#[test]
fn a_city_is_exact_with_room_and_without() {
    let headless = device();
    let structure = opened(shared_city());
    let map = Map::new(structure.clone()).unwrap();
    let receivers = receivers(&map, &mut Dice(2), 300_000);
    for budget in [64 << 20, 1 << 20] {
        let start = Instant::now();
        let mut gpu = GpuStreamer::new(&headless.device, &headless.queue, &structure, budget).unwrap();
        assert!(gpu.streamer().budget().used() <= budget);
        let view = gpu.answer_view(&receivers, &ViewOptions::default()).unwrap();
        show("city", &view.stats, start);
        eprintln!("{:?}", gpu.streamer().stats());
        assert_eq!(view.stats.evicted != 0, budget == 1 << 20, "the smaller pool does not hold all");
        assert!(view.stats.exact && view.stats.failed == 0);
        receivers.iter().zip(&view.pixels).for_each(|(r, p)| right(&map, r, p));
        // Asked again with the pages there, one frame is enough.
        if view.stats.evicted == 0 {
            let again = gpu.answer_view(&receivers, &ViewOptions::default()).unwrap();
            assert_eq!((again.stats.frames, again.stats.pages_read), (1, 0));
            assert!(again.pixels.iter().zip(&view.pixels).all(|(a, b)| a.lit == b.lit && !a.ancestor));
        }
    }
}

#[test]
fn a_view_that_does_not_fit_goes_in_parts_or_stops_with_ancestors() {
    let headless = device();
    let (_, bytes) = random_tree("view-parts", 9, 11, &[9, 8, 7, 6, 5, 4]);
    let structure = opened(bytes);
    let map = Map::new(structure.clone()).unwrap();
    let receivers = receivers(&map, &mut Dice(3), 20_000);
    let smallest = match GpuStreamer::new(&headless.device, &headless.queue, &structure, 1000) {
        Err(RuntimeError::Budget(e)) => e.needed,
        other => panic!("{other:?}"),
    };
    let start = Instant::now();
    let mut gpu = GpuStreamer::new(&headless.device, &headless.queue, &structure, smallest).unwrap();
    let options = ViewOptions { in_parts: false, ..ViewOptions::default() };
    let view = gpu.answer_view(&receivers, &options).unwrap();
    show("tree, ancestors", &view.stats, start);
    assert!(!view.stats.exact && view.stats.starved > 0, "{:?}", view.stats);
    for (r, p) in receivers.iter().zip(&view.pixels) {
        if !p.ancestor {
            right(&map, r, p);
        } else {
            let coarse = map.texel(r.x, r.y, p.level).unwrap();
            assert_eq!((p.lit, p.level), (r.depth <= coarse.value, coarse.level), "the nearest ancestor's value");
        }
    }
    let start = Instant::now();
    let view = gpu.answer_view(&receivers, &ViewOptions::default()).unwrap();
    show("tree, in parts", &view.stats, start);
    assert!(view.stats.exact && view.stats.evicted > 0, "{:?}", view.stats);
    receivers.iter().zip(&view.pixels).for_each(|(r, p)| right(&map, r, p));
}

#[test]
fn a_vector_view_is_exact_with_room_and_with_little() {
    let headless = device();
    let (_, bytes) = random_vector("view-vector", 2, 10, 6);
    let structure = opened(bytes);
    let map = Map::new(structure.clone()).unwrap();
    let receivers = receivers(&map, &mut Dice(6), 2_000);
    for budget in [16 << 20, 1 << 20] {
        let start = Instant::now();
        let mut gpu = GpuStreamer::new(&headless.device, &headless.queue, &structure, budget).unwrap();
        let view = gpu.answer_view(&receivers, &ViewOptions::default()).unwrap();
        show("vector", &view.stats, start);
        assert!(view.stats.exact && view.stats.pages_read > 1, "{:?}", view.stats);
        receivers.iter().zip(&view.pixels).for_each(|(r, p)| right(&map, r, p));
    }
}

/// Pages of a way down may be of several sizes, and each size takes a block of its own.
#[test]
fn the_smallest_budget_is_exact_and_a_byte_less_is_refused() {
    let headless = device();
    let open = |budget, structure: &Structure| GpuStreamer::new(&headless.device, &headless.queue, structure, budget);
    let mut most = 0;
    let vectors = [(2, 10, 6), (5, 12, 6)].map(|(seed, log2, bushy)| random_vector("view-small", seed, log2, bushy).1);
    for bytes in vectors.into_iter().chain([random_tree("view-small", 9, 10, &[9, 8, 7, 6, 5, 4]).1]) {
        let structure = opened(bytes);
        let map = Map::new(structure.clone()).unwrap();
        let smallest = match open(1000, &structure) {
            Err(RuntimeError::Budget(e)) => e.needed,
            other => panic!("{other:?}"),
        };
        match open(smallest - 1, &structure) {
            Err(RuntimeError::Budget(e)) => {
                assert_eq!((e.budget, e.needed, e.pages), (smallest - 1, smallest, structure.page_count()));
                assert!(e.to_string().contains("raise the budget"), "{e}");
            }
            other => panic!("{other:?}"),
        }
        let mut gpu = open(smallest, &structure).unwrap();
        most = most.max(gpu.streamer().budget().blocks);
        let receivers = receivers(&map, &mut Dice(8), 3000);
        let start = Instant::now();
        let options = ViewOptions { max_frames: 100_000, ..ViewOptions::default() };
        let view = gpu.answer_view(&receivers, &options).unwrap();
        show("smallest", &view.stats, start);
        assert!(view.stats.exact, "{:?}", view.stats);
        receivers.iter().zip(&view.pixels).for_each(|(r, p)| right(&map, r, p));
    }
    assert!(most > 2, "no structure needs a third block");
}

#[test]
fn a_broken_page_is_answered_by_its_ancestor_and_named_once() {
    let headless = device();
    let (_, mut bytes) = random_tree("view-broken", 6, 8, &[6, 4]);
    let structure = opened(bytes.clone());
    let broken = 3;
    let at = structure.page_record(broken).unwrap().offset.get() as usize;
    bytes[at + 8] ^= 1;
    let whole = Map::new(structure).unwrap();
    let structure = opened(bytes);
    let mut gpu = GpuStreamer::new(&headless.device, &headless.queue, &structure, 16 << 20).unwrap();
    let receivers: Vec<_> =
        (0..256 * 256).map(|i| Receiver { x: i % 256, y: i / 256, depth: 1 << 30, level: 0 }).collect();
    let view = gpu.answer_view(&receivers, &ViewOptions::default()).unwrap();
    assert!(!view.stats.exact && view.stats.failed == 1);
    let (mut exact, mut ancestors) = (0, 0);
    for (r, p) in receivers.iter().zip(&view.pixels) {
        if p.ancestor {
            ancestors += 1;
        } else {
            exact += 1;
            right(&whole, r, p);
        }
    }
    assert!(ancestors > 0 && exact > 10 * ancestors, "{exact} {ancestors}");
    let failures = gpu.streamer_mut().take_failures();
    assert_eq!(failures.iter().map(|f| f.ordinal).collect::<Vec<_>>(), [broken]);
    assert_eq!(failures[0].error.rule().map(|r| r.id()), Some("page.crc"));
    gpu.answer_view(&receivers, &ViewOptions::default()).unwrap();
    assert!(gpu.streamer_mut().take_failures().is_empty());
}

#[test]
fn an_engine_with_its_own_device_and_a_file() {
    let folder = Folder::new("engine");
    let path = folder.0.join("city.umb");
    city(&path, 1024);
    let uploaded = crate::engine::run(&path, 30).unwrap();
    assert!(uploaded > 0);
}

/// The device's world-to-lattice against f64, outside the guard band that the bound gives.
#[test]
fn world_points_fall_where_f64_says_outside_the_guard_band() {
    let headless = device();
    let structure = opened(shared_city());
    let lattice = structure.lattice();
    let camera = [12.34, 5.67, -8.9];
    let frame = FrameLattice::new(&lattice, camera);
    let bound = frame.error_bound(&lattice, camera, 100.0);
    let mut dice = Dice(8);
    let points: Vec<[f32; 4]> = (0..50_000)
        .map(|_| [(); 4].map(|()| (f64::from(dice.roll(1 << 30)) / f64::from(1 << 29) * 100.0 - 100.0) as f32))
        .collect();
    let places = locate_on_device(headless, &frame, &points);
    let step = 2f64.powi(-i32::from(lattice.subtexel_bits));
    let mut held = 0;
    for (p, place) in points.iter().zip(places) {
        let exact = lattice.to_lattice([0, 1, 2].map(|i| camera[i] + f64::from(p[i])));
        let exact = [exact[0] * step, exact[1] * step, exact[2]];
        let clear = |i: usize| (exact[i] - exact[i].round()).abs() > bound[i];
        let side = f64::from(lattice.resolution());
        let inside = exact[..2].iter().all(|v| (0.0..side).contains(v));
        if clear(0) && clear(1) {
            assert_eq!(place[3] != 0, inside, "{exact:?}");
            held += usize::from(inside);
            if inside {
                assert_eq!([place[0], place[1]].map(f64::from), [exact[0].floor(), exact[1].floor()]);
            }
        }
        // The band of depth is many units wide: held as an interval.
        let [low, high] = [-bound[2], bound[2]].map(|e| (exact[2] + e).ceil().clamp(0.0, f64::from(u32::MAX)));
        assert!((low..=high).contains(&f64::from(place[2])), "{} not in {low} to {high}", place[2]);
    }
    eprintln!("world to lattice: {held} of {} points inside the map, clear of the band {bound:?}", points.len());
    assert!(held > 10_000);
}

fn locate_on_device(headless: &umbrage_runtime::Headless, frame: &FrameLattice, points: &[[f32; 4]]) -> Vec<[u32; 4]> {
    use wgpu::util::DeviceExt;
    let device = &headless.device;
    let source = umbrage_runtime::shader::module(1)
        + "@group(0) @binding(0) var<uniform> frame: UmbLattice;
           @group(0) @binding(1) var<storage, read_write> points: array<vec4<u32>>;
           @compute @workgroup_size(64) fn place(@builtin(global_invocation_id) id: vec3<u32>) {
               if id.x >= arrayLength(&points) { return; }
               let p = umb_locate(frame, bitcast<vec3<f32>>(points[id.x].xyz));
               points[id.x] = vec4<u32>(p.x, p.y, p.depth, u32(p.inside));
           }";
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: None,
        source: wgpu::ShaderSource::Wgsl(source.into()),
    });
    let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: None,
        layout: None,
        module: &module,
        entry_point: Some("place"),
        compilation_options: Default::default(),
        cache: None,
    });
    let buffer = |contents, usage| {
        let usage = usage | wgpu::BufferUsages::COPY_SRC;
        device.create_buffer_init(&wgpu::util::BufferInitDescriptor { label: None, contents, usage })
    };
    let frame = buffer(bytemuck::bytes_of(frame), wgpu::BufferUsages::UNIFORM);
    let array = buffer(bytemuck::cast_slice(points), wgpu::BufferUsages::STORAGE);
    let back = device.create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size: array.size(),
        usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    });
    let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: None,
        layout: &pipeline.get_bind_group_layout(0),
        entries: &[
            wgpu::BindGroupEntry { binding: 0, resource: frame.as_entire_binding() },
            wgpu::BindGroupEntry { binding: 1, resource: array.as_entire_binding() },
        ],
    });
    let mut encoder = device.create_command_encoder(&Default::default());
    let mut pass = encoder.begin_compute_pass(&Default::default());
    pass.set_pipeline(&pipeline);
    pass.set_bind_group(0, &group, &[]);
    pass.dispatch_workgroups((points.len() as u32).div_ceil(64), 1, 1);
    drop(pass);
    encoder.copy_buffer_to_buffer(&array, 0, &back, 0, array.size());
    encoder.map_buffer_on_submit(&back, wgpu::MapMode::Read, .., |r| r.unwrap());
    headless.queue.submit([encoder.finish()]);
    device.poll(wgpu::PollType::wait_indefinitely()).unwrap();
    let view = back.get_mapped_range(..).unwrap();
    bytemuck::cast_slice(&view).to_vec()
}

/// A disk that takes its time.
struct Slow(MemorySource);

impl Source for Slow {
    fn len(&self) -> u64 {
        self.0.len()
    }

    fn read_at(&self, offset: u64, out: &mut [u8]) -> std::io::Result<()> {
        std::thread::sleep(Duration::from_millis(80));
        self.0.read_at(offset, out)
    }
}

#[test]
fn no_frame_waits_for_a_slow_disk() {
    let headless = device();
    let (_, bytes) = random_tree("slow-tree", 12, 9, &[6, 3]);
    let file = Container::open(Arc::new(Slow(MemorySource::new(bytes, "slow"))), Limits::default()).unwrap();
    let structure = file.structure(0).unwrap();
    let mut gpu = GpuStreamer::new(&headless.device, &headless.queue, &structure, 16 << 20).unwrap();
    let mut times = Vec::new();
    for ordinal in 1..40 {
        gpu.streamer_mut().request(ordinal, 1);
        let start = Instant::now();
        gpu.begin(&[]);
        let mut encoder = headless.device.create_command_encoder(&Default::default());
        gpu.record(&mut encoder);
        gpu.end(&mut encoder);
        times.push(start.elapsed());
        headless.queue.submit([encoder.finish()]);
        std::thread::sleep(Duration::from_millis(10));
    }
    times.sort();
    let stats = gpu.streamer().stats();
    eprintln!("slow disk: median frame {:?}, slowest {:?}, {stats:?}", times[times.len() / 2], times[times.len() - 1]);
    assert!(stats.resident > 1 && stats.wanted > 1, "reads were under way all the time: {stats:?}");
    // A read takes 80 ms; the median leaves room for a busy machine.
    assert!(times[times.len() / 2] < Duration::from_millis(40));
}

/// A source that breaks down in the middle of the pages.
struct Panics(MemorySource);

impl Source for Panics {
    fn len(&self) -> u64 {
        self.0.len()
    }

    fn read_at(&self, offset: u64, out: &mut [u8]) -> std::io::Result<()> {
        assert!(offset < self.len() / 2, "a test's source panics");
        self.0.read_at(offset, out)
    }
}

#[test]
fn a_source_that_panics_fails_pages_and_nothing_else() {
    let headless = device();
    let (_, bytes) = random_tree("panic-tree", 12, 8, &[6, 3]);
    let file = Container::open(Arc::new(Panics(MemorySource::new(bytes, "panics"))), Limits::default()).unwrap();
    let structure = file.structure(0).unwrap();
    let mut gpu = GpuStreamer::new(&headless.device, &headless.queue, &structure, 16 << 20).unwrap();
    let receivers: Vec<_> =
        (0..256 * 256).map(|i| Receiver { x: i % 256, y: i / 256, depth: 1 << 30, level: 0 }).collect();
    let view = gpu.answer_view(&receivers, &ViewOptions::default()).unwrap();
    assert!(!view.stats.exact && view.stats.failed > 0 && view.pixels.iter().any(|p| !p.ancestor));
    assert!(gpu.streamer_mut().take_failures().iter().all(|f| f.error.to_string().contains("panicked")));
}

#[test]
fn a_file_on_disk_streams_as_one_in_memory() {
    let headless = device();
    let folder = Folder::new("stream-file");
    let path = folder.0.join("tree.umb");
    let (_, bytes) = random_tree("stream-tree", 12, 9, &[6, 3]);
    std::fs::write(&path, &bytes).unwrap();
    let file = Container::open(Arc::new(FileSource::open(&path).unwrap()), Limits::default()).unwrap();
    let map = Map::new(opened(bytes)).unwrap();
    let structure = file.structure(0).unwrap();
    let mut gpu = GpuStreamer::new(&headless.device, &headless.queue, &structure, 4 << 20).unwrap();
    let receivers = receivers(&map, &mut Dice(5), 50_000);
    let view = gpu.answer_view(&receivers, &ViewOptions::default()).unwrap();
    assert!(view.stats.exact);
    receivers.iter().zip(&view.pixels).for_each(|(r, p)| right(&map, r, p));
}
