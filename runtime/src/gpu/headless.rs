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
        let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
        descriptor.backends = wgpu::Backends::VULKAN;
        let instance = wgpu::Instance::new(descriptor);
        let options = wgpu::RequestAdapterOptions {
            power_preference: wgpu::PowerPreference::HighPerformance,
            ..Default::default()
        };
        let adapter = pollster::block_on(instance.request_adapter(&options))
            .map_err(|e| RuntimeError::NoAdapter { reason: e.to_string() })?;
        let info = adapter.get_info();
        let most = adapter.limits();
        // What every device has, but buffers as large as this one can.
        let required_limits = wgpu::Limits {
            max_storage_buffer_binding_size: most.max_storage_buffer_binding_size,
            max_buffer_size: most.max_buffer_size,
            ..wgpu::Limits::downlevel_defaults()
        };
        let descriptor =
            wgpu::DeviceDescriptor { label: Some("umbrage headless"), required_limits, ..Default::default() };
        let (device, queue) = pollster::block_on(adapter.request_device(&descriptor))
            .map_err(|e| RuntimeError::NoDevice { adapter: info.name.clone(), reason: e.to_string() })?;
        let name = format!("{} ({} {})", info.name, info.driver, info.driver_info);
        Ok(Self { device, queue, name })
    }
}
