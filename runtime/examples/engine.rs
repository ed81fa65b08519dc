//! An engine with a device of its own streams a map and shades points of the ground: `engine FILE.umb`.

use std::{error::Error, path::Path, sync::Arc};

use umbrage_reader::{Container, FileSource, Limits};
use umbrage_runtime::{GpuStreamer, lattice::FrameLattice};
use wgpu::util::DeviceExt;

const SHADER: &str = "
@group(1) @binding(0) var<uniform> sun: UmbLattice;
@group(1) @binding(1) var<storage, read_write> lit: array<u32>;
@compute @workgroup_size(8, 8)
fn shade(@builtin(global_invocation_id) id: vec3<u32>) {
    let p = umb_locate(sun, vec3<f32>(f32(id.x) - 128.0, 0.25, f32(id.y) - 128.0));
    let state = umb_shadow(0u, p.x, p.y, 0u, p.depth);
    lit[id.y * 256u + id.x] = select(UMB_LIT | UMB_OUTSIDE | UMB_EXACT, state, p.inside);
}";

/// Streams structure 0 of a file for `frames` frames; gives the bytes that the pages took on their way.
pub fn run(file: &Path, frames: u32) -> Result<u64, Box<dyn Error>> {
    let structure = Container::open(Arc::new(FileSource::open(file)?), Limits::default())?.structure(0)?;
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    let adapter = pollster::block_on(instance.request_adapter(&Default::default()))?;
    let (device, queue) = pollster::block_on(adapter.request_device(&Default::default()))?;

    let mut shadows = GpuStreamer::new(&device, &queue, &structure, 8 << 20)?;
    let source = wgpu::ShaderSource::Wgsl((shadows.module(0) + SHADER).into());
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor { label: None, source });
    let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: None,
        layout: None,
        module: &module,
        entry_point: Some("shade"),
        compilation_options: Default::default(),
        cache: None,
    });
    let sun = FrameLattice::new(&structure.lattice(), [0.0, 0.0, 0.0]);
    let init = |contents, usage| wgpu::util::BufferInitDescriptor { label: None, contents, usage };
    let sun = device.create_buffer_init(&init(bytemuck::bytes_of(&sun), wgpu::BufferUsages::UNIFORM));
    let lit = device.create_buffer_init(&init(&[0; 256 * 256 * 4], wgpu::BufferUsages::STORAGE));
    let group = |layout: u32, buffers: &[&wgpu::Buffer]| {
        let resources = (0..).zip(buffers.iter().map(|b| b.as_entire_binding()));
        let entries: Vec<_> = resources.map(|(binding, resource)| wgpu::BindGroupEntry { binding, resource }).collect();
        let layout = &pipeline.get_bind_group_layout(layout);
        device.create_bind_group(&wgpu::BindGroupDescriptor { label: None, layout, entries: &entries })
    };
    let (maps, own) = (group(0, &shadows.buffers()), group(1, &[&sun, &lit]));
    for _ in 0..frames {
        shadows.begin(&[]);
        let mut encoder = device.create_command_encoder(&Default::default());
        shadows.record(&mut encoder);
        let mut pass = encoder.begin_compute_pass(&Default::default());
        pass.set_pipeline(&pipeline);
        pass.set_bind_group(0, &maps, &[]);
        pass.set_bind_group(1, &own, &[]);
        pass.dispatch_workgroups(32, 32, 1);
        drop(pass);
        shadows.end(&mut encoder);
        queue.submit([encoder.finish()]);
    }
    Ok(shadows.streamer().stats().uploaded_bytes)
}

#[allow(dead_code)]
fn main() -> Result<(), Box<dyn Error>> {
    let file = std::env::args_os().nth(1).ok_or("usage: engine FILE.umb")?;
    println!("{} bytes of pages uploaded", run(Path::new(&file), 120)?);
    Ok(())
}
