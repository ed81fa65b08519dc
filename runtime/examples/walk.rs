//! An object walks through a baked city, casting and receiving: `walk [FOLDER]` leaves eight pictures there.
//!
//! The city's shadows come from its baked map of 8,192 x 8,192 texels; the object's own from a small shadow map of what moves,
//! drawn anew for each frame. A point is lit where both let light through: the baked map knows nothing of the object, so the
//! object's points ask it as any other receiver does. Only pages that the picture needs are streamed.

use std::{error::Error, path::Path, sync::Arc};

use umbrage_reader::query::Map;
use umbrage_reader::{Container, MemorySource};
use umbrage_runtime::residency::foresee::Viewpoint;
use umbrage_runtime::{GpuStreamer, Headless, lattice::FrameLattice};
use umbrage_writer::bake::{BakeOptions, Light, bake};
use umbrage_writer::{hierarchy::build::Progress, mesh::Mesh, scene, solid::Policy};
use wgpu::util::DeviceExt;

/// Texels on a side of the small map.
const NEAR_SIDE: u32 = 1024;
/// Way of the light.
pub const LIGHT: V3 = scene::DEMO_LIGHT;
/// The object: half its sides, across, up and along its way.
const HALF: V3 = [1.3, 1.6, 4.0];

/// Bits of [`Picture::pixels`]: whether a point faces the light, whether the baked and the small map let light through, and
/// whether it belongs to what moves.
pub const FACES: u32 = 1;
/// See [`FACES`].
pub const BAKED: u32 = 2;
/// See [`FACES`].
pub const NEAR: u32 = 4;
/// See [`FACES`].
pub const MOVES: u32 = 8;

/// A place or a way in the world, metres.
pub type V3 = [f64; 3];
type Result<T> = std::result::Result<T, Box<dyn Error>>;

/// One frame.
pub struct Picture {
    /// World place, the bits above, and the cosine to the light in 1/255; none where there is nothing.
    pub pixels: Vec<Option<(V3, u32, u32)>>,
    /// What walks, in its place.
    pub object: Mesh,
}

fn dot(a: V3, b: V3) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: V3, b: V3) -> V3 {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn unit(a: V3) -> V3 {
    let length = dot(a, a).sqrt();
    a.map(|v| v / length)
}

fn minus(a: V3, b: V3) -> V3 {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// A box around `middle`.
fn block(middle: V3) -> Mesh {
    let sign = |bit: u32| if bit == 0 { -1.0 } else { 1.0 };
    let corner = |i: u32| {
        let way = [sign(i & 1), sign(i >> 1 & 1), sign(i >> 2)];
        std::array::from_fn(|k| middle[k] + way[k] * HALF[k])
    };
    #[rustfmt::skip]
    let triangles = vec![
        [0, 2, 1], [1, 2, 3], [4, 5, 6], [5, 7, 6], [0, 1, 4], [1, 5, 4],
        [2, 6, 3], [3, 6, 7], [0, 4, 2], [2, 4, 6], [1, 3, 5], [3, 7, 5],
    ];
    Mesh { positions: (0..8).map(corner).collect(), triangles }
}

/// Corners relative to the camera with the normals of their triangles, and whether they move.
fn corners(mesh: &Mesh, eye: V3, moves: bool) -> Vec<[f32; 7]> {
    let mut out = Vec::with_capacity(mesh.triangles.len() * 3);
    for t in &mesh.triangles {
        let p = t.map(|i| mesh.positions[i as usize]);
        let n = cross(minus(p[1], p[0]), minus(p[2], p[0]));
        if dot(n, n) == 0.0 {
            continue;
        }
        let n = unit(n).map(|v| v as f32);
        let w = if moves { 1.0 } else { 0.0 };
        out.extend(p.map(|p| {
            let [x, y, z] = minus(p, eye).map(|v| v as f32);
            [x, y, z, n[0], n[1], n[2], w]
        }));
    }
    out
}

/// Rows to the columns that a shader takes.
fn columns(rows: [[f64; 4]; 4]) -> [[f32; 4]; 4] {
    std::array::from_fn(|c| std::array::from_fn(|r| rows[r][c] as f32))
}

/// Clip space of a camera at the origin.
fn clip(axes: [V3; 3], half: [f64; 2]) -> [[f32; 4]; 4] {
    let near = 0.2;
    let row = |a: V3, scale: f64| [a[0] / scale, a[1] / scale, a[2] / scale, 0.0];
    let way = axes[2];
    // Depth from 1 near to 0 far away.
    columns([row(axes[0], half[0]), row(axes[1], half[1]), [0.0, 0.0, 0.0, near], [way[0], way[1], way[2], 0.0]])
}

/// Camera-relative world to the small map around a ball.
fn near(middle: V3, radius: f64) -> [[f32; 4]; 4] {
    let light = unit(LIGHT);
    let across = unit(cross(light, [0.0, 0.0, 1.0]));
    let down = cross(light, across);
    let row = |a: V3| {
        let s = 0.5 / radius;
        [a[0] * s, a[1] * s, a[2] * s, 0.5 - dot(a, middle) * s]
    };
    columns([row(across), row(down), row(light), [0.0, 0.0, 0.0, 1.0]])
}

/// Draws `frames` frames of `size` pixels of a walk through `city`; `each` takes them. Gives the name of the device.
pub fn walk(
    city: &Mesh,
    size: [u32; 2],
    frames: usize,
    mut each: impl FnMut(usize, Picture) -> Result<()>,
) -> Result<String> {
    let folder = std::env::temp_dir().join(format!("umbrage-walk-{}", std::process::id()));
    std::fs::create_dir_all(&folder)?;
    let file = folder.join("city.umb");
    let options = BakeOptions {
        lights: vec![Light { name: "sun".into(), direction: LIGHT }],
        resolution: 8192,
        policy: Policy::Closed,
        kind: umbrage_format::Kind::Vector,
        exhaustive: false,
        top_down: false,
        mmh: Default::default(),
        memory_bytes: None,
        cold: false,
    };
    let baked = bake(city, &options, &file, &Progress::default());
    let bytes = baked.map_err(Box::from).and_then(|_| std::fs::read(&file).map_err(Box::from));
    std::fs::remove_dir_all(&folder)?;
    let bytes: std::result::Result<_, Box<dyn Error>> = bytes;
    let source = MemorySource::new(bytes?, "city.umb");
    let structure = Container::open(Arc::new(source), Default::default())?.structure(0)?;

    let Headless { device, queue, name } = Headless::new()?;
    let mut shadows = GpuStreamer::new(&device, &queue, &structure, 16 << 20)?;
    let text = shadows.module(0) + include_str!("walk.wgsl");
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: None,
        source: wgpu::ShaderSource::Wgsl(text.into()),
    });
    let texture = |size: [u32; 2], format, usage| {
        device.create_texture(&wgpu::TextureDescriptor {
            label: None,
            size: wgpu::Extent3d { width: size[0], height: size[1], depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage,
            view_formats: &[],
        })
    };
    let (color, depth) = (wgpu::TextureFormat::Rgba32Float, wgpu::TextureFormat::Depth32Float);
    let attached = wgpu::TextureUsages::RENDER_ATTACHMENT;
    let target = texture(size, color, attached | wgpu::TextureUsages::COPY_SRC);
    let behind = texture(size, depth, attached).create_view(&Default::default());
    let small = texture([NEAR_SIDE; 2], depth, attached | wgpu::TextureUsages::TEXTURE_BINDING)
        .create_view(&Default::default());
    let sampler = device.create_sampler(&wgpu::SamplerDescriptor {
        compare: Some(wgpu::CompareFunction::LessEqual),
        ..Default::default()
    });
    let visibility = wgpu::ShaderStages::VERTEX_FRAGMENT;
    let uniform = wgpu::BindingType::Buffer {
        ty: wgpu::BufferBindingType::Uniform,
        has_dynamic_offset: false,
        min_binding_size: None,
    };
    let sampled = wgpu::BindingType::Texture {
        sample_type: wgpu::TextureSampleType::Depth,
        view_dimension: wgpu::TextureViewDimension::D2,
        multisampled: false,
    };
    let compared = wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Comparison);
    let layout_of = |types: &[wgpu::BindingType]| {
        let entries: Vec<_> = (0..)
            .zip(types)
            .map(|(binding, ty)| wgpu::BindGroupLayoutEntry { binding, visibility, ty: *ty, count: None })
            .collect();
        device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: None, entries: &entries })
    };
    let own = layout_of(&[uniform, uniform, sampled, compared]);
    let frame_only = layout_of(&[uniform]);
    let maps = shadows.bind_group_layout().clone();
    let pipeline =
        |entry: &str, groups: [&wgpu::BindGroupLayout; 2], fragment: Option<wgpu::FragmentState<'_>>, cull| {
            let groups = groups.map(Some);
            let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                label: None,
                bind_group_layouts: &groups,
                immediate_size: 0,
            });
            let closer = if cull { wgpu::CompareFunction::Less } else { wgpu::CompareFunction::Greater };
            device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
                label: Some(entry),
                layout: Some(&layout),
                vertex: wgpu::VertexState {
                    module: &module,
                    entry_point: Some(entry),
                    compilation_options: Default::default(),
                    buffers: &[Some(wgpu::VertexBufferLayout {
                        array_stride: 28,
                        step_mode: wgpu::VertexStepMode::Vertex,
                        attributes: &wgpu::vertex_attr_array![0 => Float32x3, 1 => Float32x4],
                    })],
                },
                primitive: wgpu::PrimitiveState {
                    // Of what moves only the sides that the light does not see.
                    cull_mode: cull.then_some(wgpu::Face::Front),
                    ..Default::default()
                },
                depth_stencil: Some(wgpu::DepthStencilState {
                    format: depth,
                    depth_write_enabled: Some(true),
                    depth_compare: Some(closer),
                    stencil: Default::default(),
                    bias: Default::default(),
                }),
                multisample: Default::default(),
                fragment,
                multiview_mask: None,
                cache: None,
            })
        };
    let shade = pipeline(
        "corner",
        [&maps, &own],
        Some(wgpu::FragmentState {
            module: &module,
            entry_point: Some("shade"),
            compilation_options: Default::default(),
            targets: &[Some(color.into())],
        }),
        false,
    );
    // A pipeline has the groups that its layout names, also such as it does not use.
    let cast = pipeline("caster", [&maps, &frame_only], None, true);

    let map = Map::new(structure.clone())?;
    let way = street(city, |p| map.visibility(p, 0).is_ok_and(|a| a.lit));
    let lattice = structure.lattice();
    for n in 0..frames {
        let at = (n as f64 + 0.5) / frames as f64 * (way.len() - 1) as f64;
        let (before, next) = (way[at as usize], way[(at as usize + 1).min(way.len() - 1)]);
        let mut middle: V3 = std::array::from_fn(|k| before[k] + at.fract() * (next[k] - before[k]));
        middle[1] += HALF[1] + 0.3;
        let eye = [middle[0] + 8.0, middle[1] + 26.0, middle[2] - 12.0];
        let ahead = unit(minus(middle, eye));
        let right = unit(cross(ahead, [0.0, 1.0, 0.0]));
        let axes = [right, cross(right, ahead), ahead];
        let half = [0.6, 0.6 * f64::from(size[1]) / f64::from(size[0])];
        let object = block(middle);
        let radius = dot(HALF, HALF).sqrt() * 1.05;
        let frame = FrameLattice::new(&lattice, eye);
        let off = frame.error_bound(&lattice, eye, 200.0)[2].ceil() + 1.0;
        // What rounding a place to a float costs: 200 m have 2^-16 m.
        let steps = lattice.world_to_lattice[2];
        let off = off + (steps[0].abs() + steps[1].abs() + steps[2].abs()) * 2f64.powi(-16);
        let light = unit(LIGHT).map(|v| v as f32);
        let words: Vec<f32> = [clip(axes, half), near(minus(middle, eye), radius)]
            .concat()
            .into_iter()
            .flatten()
            .chain([light[0], light[1], light[2], off as f32])
            .collect();
        let buffer = |contents, usage| {
            device.create_buffer_init(&wgpu::util::BufferInitDescriptor { label: None, contents, usage })
        };
        let picture = buffer(bytemuck::cast_slice(&words), wgpu::BufferUsages::UNIFORM);
        let sun = buffer(bytemuck::bytes_of(&frame), wgpu::BufferUsages::UNIFORM);
        let still = corners(city, eye, false);
        let moving = corners(&object, eye, true);
        let vertices =
            buffer(bytemuck::cast_slice(&[still.clone(), moving.clone()].concat()), wgpu::BufferUsages::VERTEX);
        let (still, all) = (still.len() as u32, (still.len() + moving.len()) as u32);
        let group = |layout, resources: Vec<wgpu::BindingResource<'_>>| {
            let entries: Vec<_> =
                (0..).zip(resources).map(|(binding, resource)| wgpu::BindGroupEntry { binding, resource }).collect();
            device.create_bind_group(&wgpu::BindGroupDescriptor { label: None, layout, entries: &entries })
        };
        let near_map = wgpu::BindingResource::TextureView(&small);
        let whole = vec![
            picture.as_entire_binding(),
            sun.as_entire_binding(),
            near_map,
            wgpu::BindingResource::Sampler(&sampler),
        ];
        let (whole, alone) = (group(&own, whole), group(&frame_only, vec![picture.as_entire_binding()]));
        let view = Viewpoint { eye, axes, half, pixels: size };
        let row = (size[0] * 16).next_multiple_of(256);
        let back = device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: u64::from(row * size[1]),
            usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        // A game shows every frame; here each picture waits until its pages are there.
        for _ in 0..300 {
            shadows.begin(&[view]);
            let mut encoder = device.create_command_encoder(&Default::default());
            shadows.record(&mut encoder);
            let far = |clear| wgpu::Operations { load: wgpu::LoadOp::Clear(clear), store: wgpu::StoreOp::Store };
            let depth_of = |view, clear| {
                Some(wgpu::RenderPassDepthStencilAttachment { view, depth_ops: Some(far(clear)), stencil_ops: None })
            };
            {
                let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                    depth_stencil_attachment: depth_of(&small, 1.0),
                    ..Default::default()
                });
                pass.set_pipeline(&cast);
                pass.set_bind_group(0, shadows.bind_group(), &[]);
                pass.set_bind_group(1, &alone, &[]);
                pass.set_vertex_buffer(0, vertices.slice(..));
                pass.draw(still..all, 0..1);
            }
            {
                let view = target.create_view(&Default::default());
                let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                    color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                        view: &view,
                        depth_slice: None,
                        resolve_target: None,
                        ops: wgpu::Operations {
                            load: wgpu::LoadOp::Clear(wgpu::Color { r: 0.0, g: 0.0, b: 0.0, a: -1.0 }),
                            store: wgpu::StoreOp::Store,
                        },
                    })],
                    depth_stencil_attachment: depth_of(&behind, 0.0),
                    ..Default::default()
                });
                pass.set_pipeline(&shade);
                pass.set_bind_group(0, shadows.bind_group(), &[]);
                pass.set_bind_group(1, &whole, &[]);
                pass.set_vertex_buffer(0, vertices.slice(..));
                pass.draw(0..all, 0..1);
            }
            shadows.end(&mut encoder);
            queue.submit([encoder.finish()]);
            device.poll(wgpu::PollType::wait_indefinitely())?;
            // The feedback of this frame.
            shadows.begin(&[view]);
            if shadows.report().missed == 0 && !shadows.streamer().is_loading() {
                break;
            }
            while shadows.streamer().is_loading() {
                shadows.streamer_mut().wait(std::time::Duration::from_millis(5));
            }
        }
        let mut encoder = device.create_command_encoder(&Default::default());
        let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(row), rows_per_image: None };
        encoder.copy_texture_to_buffer(
            target.as_image_copy(),
            wgpu::TexelCopyBufferInfo { buffer: &back, layout },
            target.size(),
        );
        encoder.map_buffer_on_submit(&back, wgpu::MapMode::Read, .., |_| ());
        queue.submit([encoder.finish()]);
        device.poll(wgpu::PollType::wait_indefinitely())?;
        let bytes = back.get_mapped_range(..)?;
        let mut pixels = Vec::with_capacity((size[0] * size[1]) as usize);
        for line in bytes.chunks_exact(row as usize) {
            for p in line[..size[0] as usize * 16].chunks_exact(16) {
                let v = [0, 4, 8, 12].map(|i| f32::from_le_bytes([p[i], p[i + 1], p[i + 2], p[i + 3]]));
                let place = || std::array::from_fn(|k| f64::from(v[k]) + eye[k]);
                pixels.push((v[3] >= 0.0).then(|| (place(), v[3] as u32 & 0xFF, v[3] as u32 >> 8)));
            }
        }
        each(n, Picture { pixels, object })?;
    }
    Ok(name)
}

/// Places on a stretch of open ground, 2 m apart, that leads through sun and shadow near the middle of the city.
fn street(city: &Mesh, lit: impl Fn(V3) -> bool) -> Vec<V3> {
    // What one stands on at (x, z): the highest triangle there.
    let top = |x: f64, z: f64| {
        let height = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|i| city.positions[i as usize]);
            let side = |a: V3, b: V3| (b[0] - a[0]) * (z - a[2]) - (b[2] - a[2]) * (x - a[0]);
            let [u, v, w] = [side(b, c), side(c, a), side(a, b)];
            let inside = (u >= 0.0 && v >= 0.0 && w >= 0.0) || (u <= 0.0 && v <= 0.0 && w <= 0.0);
            (inside && u + v + w != 0.0).then(|| (u * a[1] + v * b[1] + w * c[1]) / (u + v + w))
        };
        city.triangles.iter().filter_map(height).fold(f64::NEG_INFINITY, f64::max)
    };
    let mut shortest = vec![[0.0, top(0.0, 0.0), 0.0], [0.0, top(0.0, 10.0), 10.0]];
    for x in (0..60).map(|i| f64::from(i / 2 * 4) * if i % 2 == 0 { 1.0 } else { -1.0 }) {
        let mut way: Vec<V3> = Vec::new();
        for z in (-60..60).map(|i| f64::from(i) * 2.0) {
            let y = [0.0, -2.0, 2.0, -5.0, 5.0].map(|d| top(x + d, z));
            let even = y.iter().all(|v| v.abs() < 6.0 && (v - y[0]).abs() < 0.4);
            let on = way.last().is_none_or(|p| (p[1] - y[0]).abs() < 0.4);
            if !(even && on) {
                way.clear();
            }
            if even {
                way.push([x, y.into_iter().fold(y[0], f64::max), z]);
            }
            let sunny = way.iter().filter(|p| lit([p[0], p[1] + 2.0, p[2]])).count();
            if way.len() >= 16 && sunny * 4 > way.len() && sunny * 4 < way.len() * 3 {
                return way;
            }
            if way.len() > shortest.len() {
                shortest = way.clone();
            }
        }
    }
    shortest
}

/// Colours of a picture: bricks, and an object in red.
fn paint(picture: &Picture) -> Vec<u8> {
    let mut out = Vec::with_capacity(picture.pixels.len() * 3);
    for pixel in &picture.pixels {
        let Some((_, bits, cosine)) = *pixel else {
            out.extend([150, 180, 215]);
            continue;
        };
        let base = if bits & MOVES != 0 { [210.0, 60.0, 45.0] } else { [205.0, 200.0, 188.0] };
        let lit = bits & (FACES | BAKED | NEAR) == FACES | BAKED | NEAR;
        let light = 0.35 + if lit { 0.65 * f64::from(cosine) / 255.0 } else { 0.0 };
        out.extend(base.map(|c| (c * light) as u8));
    }
    out
}

#[allow(dead_code)]
fn main() -> Result<()> {
    let folder = std::env::args_os().nth(1).unwrap_or_else(|| "walk-out".into());
    let folder = Path::new(&folder);
    std::fs::create_dir_all(folder)?;
    let city = scene::generated("city:1:0.1").ok_or("no such scene")??;
    let size = [960, 540];
    let name = walk(&city, size, 8, |n, picture| {
        let path = folder.join(format!("walk-{n}.png"));
        let file = std::io::BufWriter::new(std::fs::File::create(&path)?);
        let mut encoder = png::Encoder::new(file, size[0], size[1]);
        encoder.set_color(png::ColorType::Rgb);
        encoder.write_header()?.write_image_data(&paint(&picture))?;
        println!("{}", path.display());
        Ok(())
    })?;
    println!("drawn on {name}");
    Ok(())
}
