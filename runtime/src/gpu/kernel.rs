//! The pipelines of [`crate::shader::kernels`] and the buffers of their queries.

use crate::error::RuntimeError;
use crate::shader;

/// Most groups in one dimension of a dispatch.
const MOST_GROUPS: u32 = 65_535;

/// Entry points for arrays of queries and for views.
#[derive(Debug)]
pub struct Kernels {
    answer: wgpu::ComputePipeline,
    pixels: wgpu::ComputePipeline,
    filtered: wgpu::ComputePipeline,
    layout: wgpu::BindGroupLayout,
    /// Buffers of the pool that they read.
    pools: u32,
}

/// Which entry point.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Entry {
    /// x, y, level, depth -> value, state, missing, page.
    Answer,
    /// x, y, depth, state -> state.
    Pixels,
    /// The same with how to filter behind: two of the array's words of four for each query.
    Filtered,
}

impl Entry {
    /// Words of four that a query takes.
    pub(super) const fn words(self) -> usize {
        match self {
            Entry::Answer | Entry::Pixels => 1,
            Entry::Filtered => 2,
        }
    }
}

/// An array of queries on the device, 16 bytes each.
#[derive(Debug)]
pub struct Queries {
    /// The queries; storage, and both ends of copies.
    pub buffer: wgpu::Buffer,
    range: wgpu::Buffer,
    group: wgpu::BindGroup,
    count: u32,
}

impl Kernels {
    /// Compiles them for a pool in so many buffers; `layout` is the streamer's, in group 0.
    pub fn new(device: &wgpu::Device, layout: &wgpu::BindGroupLayout, pools: u32) -> Self {
        let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some("umbrage kernels"),
            source: wgpu::ShaderSource::Wgsl(shader::kernels(pools).into()),
        });
        let own = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("umbrage queries"),
            entries: &[
                super::streamer::entry(0, wgpu::BufferBindingType::Storage { read_only: false }),
                super::streamer::entry(1, wgpu::BufferBindingType::Uniform),
            ],
        });
        let pipeline_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some("umbrage kernels"),
            bind_group_layouts: &[Some(layout), Some(&own)],
            immediate_size: 0,
        });
        let pipeline = |name| {
            device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: Some(name),
                layout: Some(&pipeline_layout),
                module: &module,
                entry_point: Some(name),
                compilation_options: Default::default(),
                cache: None,
            })
        };
        let [answer, pixels, filtered] = ["answer", "pixels", "filtered"].map(pipeline);
        Self { answer, pixels, filtered, layout: own, pools }
    }

    /// Buffers of the pool that they read.
    pub fn pools(&self) -> u32 {
        self.pools
    }

    /// Puts queries on the device.
    ///
    /// # Errors
    /// They are more than it binds.
    pub fn queries(&self, device: &wgpu::Device, queries: &[[u32; 4]]) -> Result<Queries, RuntimeError> {
        let size = (queries.len().max(1) * 16) as u64;
        super::streamer::fits(device, "the array of queries", size)?;
        let buffer = super::streamer::filled(
            device,
            "umbrage queries",
            size,
            wgpu::BufferUsages::STORAGE,
            bytemuck::cast_slice(queries),
        )?;
        let range = super::streamer::filled(device, "umbrage range", 16, wgpu::BufferUsages::UNIFORM, &[])?;
        let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("umbrage queries"),
            layout: &self.layout,
            entries: &[
                wgpu::BindGroupEntry { binding: 0, resource: buffer.as_entire_binding() },
                wgpu::BindGroupEntry { binding: 1, resource: range.as_entire_binding() },
            ],
        });
        Ok(Queries { buffer, range, group, count: u32::try_from(queries.len()).unwrap_or(u32::MAX) })
    }

    /// Answers queries on a root of the structure with that number. One dispatch of these queries for each submission: the
    /// range is written to the queue.
    #[allow(clippy::too_many_arguments)]
    pub fn dispatch(
        &self,
        queue: &wgpu::Queue,
        encoder: &mut wgpu::CommandEncoder,
        structure: &wgpu::BindGroup,
        entry: Entry,
        queries: &Queries,
        [root, number]: [u32; 2],
        range: std::ops::Range<u32>,
    ) {
        let end = range.end.min(queries.count / entry.words() as u32);
        let Some(count) = end.checked_sub(range.start).filter(|&n| n != 0) else { return };
        queue.write_buffer(&queries.range, 0, bytemuck::bytes_of(&[range.start, count, root, number]));
        let groups = count.div_ceil(shader::WORKGROUP);
        let across = groups.min(MOST_GROUPS);
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        pass.set_pipeline(match entry {
            Entry::Answer => &self.answer,
            Entry::Pixels => &self.pixels,
            Entry::Filtered => &self.filtered,
        });
        pass.set_bind_group(0, structure, &[]);
        pass.set_bind_group(1, &queries.group, &[]);
        pass.dispatch_workgroups(across, groups.div_ceil(across), 1);
    }
}
