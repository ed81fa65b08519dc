//! A device without a window, for tools and tests.

use crate::error::RuntimeError;

/// Adapter, device and queue.
#[derive(Debug, Clone)]
pub struct Headless {
    /// The device, with the adapter's own limits for buffers.
    pub device: wgpu::Device,
    /// Its queue.
    pub queue: wgpu::Queue,
    /// Name of the adapter and its driver, for the report.
    pub name: String,
}

impl Headless {
    /// Finds a Vulkan adapter, a real one before a software one; software Vulkan (lavapipe) is enough. The drivers that
    /// are looked at can be set with `VK_ICD_FILENAMES`, as with every program that uses Vulkan.
    ///
    /// # Errors
    /// There is no adapter, and the message says what to install; or it gives no device.
    pub fn new() -> Result<Self, RuntimeError> {
        Ok(Self::of(&Self::instance(), None)?.1)
    }

    /// Vulkan, as [`new`](Self::new) takes it.
    pub fn instance() -> wgpu::Instance {
        let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
        descriptor.backends = wgpu::Backends::VULKAN;
        wgpu::Instance::new(descriptor)
    }

    /// The same with the adapter; where there is a surface, one that can draw on it.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn of(
        instance: &wgpu::Instance,
        surface: Option<&wgpu::Surface<'_>>,
    ) -> Result<(wgpu::Adapter, Self), RuntimeError> {
        let options = wgpu::RequestAdapterOptions {
            power_preference: wgpu::PowerPreference::HighPerformance,
            compatible_surface: surface,
            ..Default::default()
        };
        let adapter = pollster::block_on(instance.request_adapter(&options))
            .map_err(|e| RuntimeError::NoAdapter { reason: e.to_string() })?;
        let info = adapter.get_info();
        let most = adapter.limits();
        // What every device has, but buffers and pictures as large as this one can.
        let required_limits = wgpu::Limits {
            max_storage_buffer_binding_size: most.max_storage_buffer_binding_size,
            max_buffer_size: most.max_buffer_size,
            // WebGPU's default: a pool may lie in several.
            max_storage_buffers_per_shader_stage: most.max_storage_buffers_per_shader_stage.min(8),
            max_texture_dimension_2d: most.max_texture_dimension_2d,
            ..wgpu::Limits::downlevel_defaults()
        };
        let descriptor =
            wgpu::DeviceDescriptor { label: Some("umbrage headless"), required_limits, ..Default::default() };
        let (device, queue) = pollster::block_on(adapter.request_device(&descriptor))
            .map_err(|e| RuntimeError::NoDevice { adapter: info.name.clone(), reason: e.to_string() })?;
        let name = format!("{} ({} {})", info.name, info.driver, info.driver_info);
        Ok((adapter, Self { device, queue, name }))
    }
}
