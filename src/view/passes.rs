//! Pipelines and targets of the two passes.

use umbrage_runtime::{GpuStreamer, RuntimeError};

use super::uniform::{LOOKS, Uniform, overlay_code};
use super::{Overlay, ViewError};
use crate::render::shade_constants;

const IDS: wgpu::TextureFormat = wgpu::TextureFormat::R32Uint;
const DEPTH: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;

/// Pipelines, and what both passes bind.
pub(super) struct Passes {
    pub uniform: wgpu::Buffer,
    mesh: wgpu::Buffer,
    layout: wgpu::BindGroupLayout,
    first: wgpu::RenderPipeline,
    first_group: wgpu::BindGroup,
    second: wgpu::RenderPipeline,
}

/// What the passes draw into between them, and the group that reads it.
pub(super) struct Targets {
    pub size: [u32; 2],
    ids: wgpu::TextureView,
    depth: wgpu::TextureView,
    group: wgpu::BindGroup,
}

/// The shader behind the streamer's module in group 1.
fn source(shadows: &GpuStreamer) -> String {
    let looks = (0..).zip(LOOKS).map(|(n, name): (u32, _)| format!("const LOOK_{name} = {n}u;\n"));
    let overlay = |o: Overlay| {
        let name = o.name().to_uppercase();
        format!("const OVERLAY_{name} = {}u;\n", overlay_code(Some(o)))
    };
    let overlays = Overlay::ALL.into_iter().map(overlay);
    let names: String = looks.chain(overlays).collect();
    let none = format!("const OVERLAY_NONE = {}u;\n", overlay_code(None));
    [&shadows.module(1), &names, &none, &shade_constants(), include_str!("picture.wgsl")].concat()
}

impl Passes {
    pub fn new(
        device: &wgpu::Device,
        shadows: &GpuStreamer,
        mesh: &[u32],
        format: wgpu::TextureFormat,
    ) -> Result<Self, ViewError> {
        let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some("umbrage picture"),
            source: wgpu::ShaderSource::Wgsl(source(shadows).into()),
        });
        let words: &[u8] = bytemuck::cast_slice(mesh);
        let (size, usage) = (words.len().max(16) as u64, wgpu::BufferUsages::STORAGE);
        let descriptor = wgpu::BufferDescriptor { label: Some("umbrage mesh"), size, usage, mapped_at_creation: true };
        let mesh = device.create_buffer(&descriptor);
        {
            let view = mesh.get_mapped_range_mut(..);
            let mut view = view.map_err(|e| RuntimeError::Device { reason: format!("the mesh: {e}") })?;
            view.slice(..words.len()).copy_from_slice(words);
        }
        mesh.unmap();
        let uniform = device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("umbrage picture"),
            size: size_of::<Uniform>() as u64,
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });

        let entry = |binding, visibility, ty| wgpu::BindGroupLayoutEntry { binding, visibility, ty, count: None };
        let bound = |ty| wgpu::BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None };
        let both = wgpu::ShaderStages::VERTEX_FRAGMENT;
        let own = [
            entry(0, both, bound(wgpu::BufferBindingType::Uniform)),
            entry(1, both, bound(wgpu::BufferBindingType::Storage { read_only: true })),
        ];
        let ids = wgpu::BindingType::Texture {
            sample_type: wgpu::TextureSampleType::Uint,
            view_dimension: wgpu::TextureViewDimension::D2,
            multisampled: false,
        };
        let group_layout = |entries: &[wgpu::BindGroupLayoutEntry]| {
            let label = Some("umbrage picture");
            device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label, entries })
        };
        let first_layout = group_layout(&own);
        let layout = group_layout(&[own[0], own[1], entry(2, wgpu::ShaderStages::FRAGMENT, ids)]);
        let pipeline = |groups: &[Option<&wgpu::BindGroupLayout>], [vertex, fragment]: [&str; 2], target, depth| {
            let pipeline_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                label: Some("umbrage picture"),
                bind_group_layouts: groups,
                immediate_size: 0,
            });
            device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
                label: Some(fragment),
                layout: Some(&pipeline_layout),
                vertex: wgpu::VertexState {
                    module: &module,
                    entry_point: Some(vertex),
                    compilation_options: Default::default(),
                    buffers: &[],
                },
                primitive: Default::default(),
                depth_stencil: depth,
                multisample: Default::default(),
                fragment: Some(wgpu::FragmentState {
                    module: &module,
                    entry_point: Some(fragment),
                    compilation_options: Default::default(),
                    targets: &[Some(wgpu::ColorTargetState::from(target))],
                }),
                multiview_mask: None,
                cache: None,
            })
        };
        let nearer = wgpu::DepthStencilState {
            format: DEPTH,
            depth_write_enabled: Some(true),
            depth_compare: Some(wgpu::CompareFunction::Greater),
            stencil: Default::default(),
            bias: Default::default(),
        };
        let first = pipeline(&[Some(&first_layout)], ["corner", "identify"], IDS, Some(nearer));
        let groups = [Some(&layout), Some(shadows.bind_group_layout())];
        let second = pipeline(&groups, ["whole", "resolve"], format, None);
        let first_group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("umbrage mesh"),
            layout: &first_layout,
            entries: &[
                wgpu::BindGroupEntry { binding: 0, resource: uniform.as_entire_binding() },
                wgpu::BindGroupEntry { binding: 1, resource: mesh.as_entire_binding() },
            ],
        });
        Ok(Self { uniform, mesh, layout, first, first_group, second })
    }

    /// Which triangle each pixel sees.
    pub fn identify(&self, encoder: &mut wgpu::CommandEncoder, targets: &Targets, triangles: u32) {
        let clear = |view, color| wgpu::RenderPassColorAttachment {
            view,
            depth_slice: None,
            resolve_target: None,
            ops: wgpu::Operations { load: wgpu::LoadOp::Clear(color), store: wgpu::StoreOp::Store },
        };
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("umbrage triangles"),
            color_attachments: &[Some(clear(&targets.ids, wgpu::Color::TRANSPARENT))],
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: &targets.depth,
                depth_ops: Some(wgpu::Operations { load: wgpu::LoadOp::Clear(0.0), store: wgpu::StoreOp::Discard }),
                stencil_ops: None,
            }),
            ..Default::default()
        });
        pass.set_pipeline(&self.first);
        pass.set_bind_group(0, &self.first_group, &[]);
        pass.draw(0..triangles * 3, 0..1);
    }

    /// A colour for each pixel.
    pub fn resolve(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        targets: &Targets,
        shadows: &GpuStreamer,
        target: &wgpu::TextureView,
    ) {
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("umbrage light"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: target,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations { load: wgpu::LoadOp::Clear(wgpu::Color::BLACK), store: wgpu::StoreOp::Store },
            })],
            ..Default::default()
        });
        pass.set_pipeline(&self.second);
        pass.set_bind_group(0, &targets.group, &[]);
        pass.set_bind_group(1, shadows.bind_group(), &[]);
        pass.draw(0..3, 0..1);
    }
}

impl Targets {
    pub fn new(device: &wgpu::Device, passes: &Passes, size: [u32; 2]) -> Result<Self, ViewError> {
        let most = device.limits().max_texture_dimension_2d;
        let [width, height] = size;
        if size.iter().any(|n| !(1..=most).contains(n)) {
            return Err(ViewError::Size { width, height, most });
        }
        let view = |format, usage| {
            let texture = device.create_texture(&wgpu::TextureDescriptor {
                label: Some("umbrage picture"),
                size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage: wgpu::TextureUsages::RENDER_ATTACHMENT | usage,
                view_formats: &[],
            });
            texture.create_view(&Default::default())
        };
        let ids = view(IDS, wgpu::TextureUsages::TEXTURE_BINDING);
        let depth = view(DEPTH, wgpu::TextureUsages::empty());
        let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("umbrage picture"),
            layout: &passes.layout,
            entries: &[
                wgpu::BindGroupEntry { binding: 0, resource: passes.uniform.as_entire_binding() },
                wgpu::BindGroupEntry { binding: 1, resource: passes.mesh.as_entire_binding() },
                wgpu::BindGroupEntry { binding: 2, resource: wgpu::BindingResource::TextureView(&ids) },
            ],
        });
        Ok(Self { size, ids, depth, group })
    }
}
