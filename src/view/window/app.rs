//! The window and its events.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use egui_wgpu::{Renderer, RendererOptions, ScreenDescriptor};
use umbrage_format::Kind;
use umbrage_reader::{Container, Structure};
use umbrage_runtime::{Headless, RuntimeError};
use umbrage_writer::solid::SnappedMesh;
use winit::application::ApplicationHandler;
use winit::dpi::{PhysicalPosition, PhysicalSize};
use winit::error::EventLoopError;
use winit::event::{ElementState, MouseButton, MouseScrollDelta, WindowEvent};
use winit::event_loop::{ActiveEventLoop, ControlFlow, EventLoop};
use winit::keyboard::{KeyCode, PhysicalKey};
use winit::window::{Window, WindowId};

use super::panel::{Action, Controls, Facts};
use super::{KEPT_TIMES, Options, Summary};
use crate::render::{Camera, Recording, write_png, write_text};
use crate::view::{Fly, Keys, Patience, Stage, ViewError};

/// Seconds between two keys of a recording.
const RECORD_EVERY: f64 = 0.25;
/// How often a window that nobody sees asks again.
const LATER: Duration = Duration::from_millis(50);

struct App<'a> {
    container: &'a Container,
    structure: &'a Structure,
    mesh: &'a SnappedMesh,
    options: &'a Options,
    go_on: &'a dyn Fn() -> bool,
    open: Option<Open>,
    failure: Option<ViewError>,
    summary: Option<Summary>,
}

/// What there is while the window is open.
struct Open {
    window: Arc<Window>,
    surface: wgpu::Surface<'static>,
    config: wgpu::SurfaceConfiguration,
    /// Format of the views of the surface: shader and panel encode sRGB themselves.
    format: wgpu::TextureFormat,
    device: wgpu::Device,
    queue: wgpu::Queue,
    name: String,
    stage: Stage,
    panel: egui_winit::State,
    renderer: Renderer,
    controls: Controls,
    fly: Fly,
    keys: Keys,
    dragged: bool,
    /// Whether the last frame had nothing to be drawn on.
    hidden: bool,
    pointer: Option<PhysicalPosition<f64>>,
    start: Instant,
    last: Instant,
    /// Milliseconds from the frame before to this one.
    interval: f32,
    /// When the flight began.
    flown: Option<Instant>,
    recording: Option<(Instant, f64, Recording)>,
    times: Vec<[f32; 2]>,
    frames: u64,
    message: String,
    files: Vec<PathBuf>,
}

pub(super) fn run(
    container: &Container,
    structure: &Structure,
    mesh: &SnappedMesh,
    options: &Options,
    go_on: &dyn Fn() -> bool,
) -> Result<Summary, ViewError> {
    let events = EventLoop::new().map_err(|e| ViewError::Window(unopened(&e)))?;
    let mut app = App { container, structure, mesh, options, go_on, open: None, failure: None, summary: None };
    events.run_app(&mut app).map_err(|e| ViewError::Window(e.to_string()))?;
    match (app.failure, app.summary) {
        (Some(failure), _) => Err(failure),
        (None, Some(summary)) => Ok(summary),
        (None, None) => Err(ViewError::Window("the display closed before it opened".into())),
    }
}

/// Why there is no display; what the library says of it names files of its own.
fn unopened(e: &EventLoopError) -> String {
    match e {
        EventLoopError::Os(_) => "no display; DISPLAY or WAYLAND_DISPLAY must name one that answers".into(),
        e => e.to_string(),
    }
}

impl Open {
    fn new(events: &ActiveEventLoop, app: &App<'_>) -> Result<Self, ViewError> {
        let Options { size: [width, height], title, budget, .. } = app.options;
        let attributes = Window::default_attributes()
            .with_title(format!("Umbrage: {title}"))
            .with_inner_size(PhysicalSize::new(*width, *height));
        let failed = |e: &dyn std::fmt::Display| ViewError::Window(e.to_string());
        let window = Arc::new(events.create_window(attributes).map_err(|e| failed(&e))?);
        let instance = Headless::instance();
        let surface = instance.create_surface(window.clone()).map_err(|e| failed(&e))?;
        let (adapter, Headless { device, queue, name }) = Headless::of(&instance, Some(&surface))?;
        let inner = window.inner_size();
        let size = [inner.width.max(1), inner.height.max(1)];
        let mut config = surface
            .get_default_config(&adapter, size[0], size[1])
            .ok_or_else(|| failed(&format!("{name} does not draw on this display")))?;
        let formats = surface.get_capabilities(&adapter).formats;
        let plain = [wgpu::TextureFormat::Bgra8Unorm, wgpu::TextureFormat::Rgba8Unorm];
        let format = match formats.iter().find(|f| plain.contains(f)) {
            Some(format) => {
                config.format = *format;
                *format
            }
            None => {
                let format = config.format.remove_srgb_suffix();
                if !plain.contains(&format) {
                    return Err(failed(&format!("{name} has no format of 8 bits a channel for this display")));
                }
                config.view_formats.push(format);
                format
            }
        };
        let mut stage = Stage::new(&device, &queue, app.structure, app.mesh, *budget, format, size)?;
        surface.configure(&device, &config);
        stage.shadows_mut().skip(app.options.skips);
        let context = egui::Context::default();
        let most = device.limits().max_texture_dimension_2d as usize;
        let panel = egui_winit::State::new(
            context,
            egui::ViewportId::ROOT,
            &window,
            Some(window.scale_factor() as f32),
            window.theme(),
            Some(most),
        );
        let renderer = Renderer::new(&device, format, RendererOptions::default());
        let speed = app.options.speed.unwrap_or(stage.extent() / 20.0);
        let now = Instant::now();
        Ok(Self {
            window,
            surface,
            config,
            format,
            device,
            queue,
            name,
            stage,
            panel,
            renderer,
            controls: Controls::new(&app.options.style, app.options.skips, *budget, speed),
            fly: Fly::new(&app.options.start, app.options.fov, speed),
            keys: Keys::default(),
            dragged: false,
            hidden: false,
            pointer: None,
            start: now,
            last: now,
            interval: 0.0,
            flown: app.options.flight.as_ref().map(|_| now),
            recording: None,
            times: Vec::with_capacity(KEPT_TIMES),
            frames: 0,
            message: String::new(),
            files: Vec::new(),
        })
    }

    fn resize(&mut self, size: PhysicalSize<u32>) -> Result<(), ViewError> {
        // A window that is put away has no size.
        if size.width == 0 || size.height == 0 {
            return Ok(());
        }
        self.stage.resize([size.width, size.height])?;
        (self.config.width, self.config.height) = (size.width, size.height);
        self.surface.configure(&self.device, &self.config);
        Ok(())
    }

    /// The camera of this frame: the flight's while it lasts, else where keys and mouse have brought it.
    fn camera(&mut self, options: &Options) -> Result<Camera, ViewError> {
        let seconds = self.last.elapsed().as_secs_f64();
        self.last = Instant::now();
        self.interval = seconds as f32 * 1000.0;
        if let (Some(flown), Some(flight)) = (self.flown, &options.flight) {
            let frame = (flown.elapsed().as_secs_f64() * flight.frames_per_second()) as u32;
            let camera = flight.camera(frame.min(flight.frames() - 1));
            let camera = camera.map_err(|e| ViewError::Window(e.to_string()))?;
            self.fly.place(&camera);
            if frame < flight.frames() {
                return Ok(camera);
            }
            self.flown = None;
        }
        self.fly.speed = self.controls.speed;
        self.fly.go(self.keys, seconds);
        Ok(self.fly.camera()?)
    }

    /// Adds a key to the recording where it is time.
    fn record(&mut self) {
        let [eye, target] = self.fly.places();
        if let Some((start, next, recording)) = &mut self.recording {
            let seconds = start.elapsed().as_secs_f64();
            if seconds >= *next {
                recording.add(seconds, eye, target);
                *next = seconds + RECORD_EVERY;
            }
        }
    }

    fn act(&mut self, options: &Options, camera: &Camera) -> Result<(), ViewError> {
        for action in std::mem::take(&mut self.controls.actions) {
            match action {
                Action::Budget(bytes) => match self.stage.shadows_mut().set_budget(bytes) {
                    Ok(()) => self.message.clear(),
                    Err(e) => {
                        self.message = e.to_string();
                        let budget = self.stage.shadows().streamer().budget().total;
                        self.controls.budget_mib = budget as f64 / f64::from(1 << 20);
                    }
                },
                Action::Skip(error) => self.stage.shadows_mut().skip(error),
                Action::Ahead(frames) => self.stage.shadows_mut().streamer_mut().look_ahead(frames),
                Action::Picture => {
                    let still = self.stage.still(camera, &self.controls.style(), Patience::None, &|| true)?;
                    let path = self.free_name(options, "view", "png");
                    let done = write_png(&path, &still.image).map_err(|e| e.to_string());
                    self.written(path, done);
                }
                Action::Record => match self.recording.take() {
                    Some(recording) => self.save(options, recording),
                    None => {
                        let recording = Recording::new(options.start.up_axis(), options.fov);
                        self.recording = Some((Instant::now(), 0.0, recording));
                        self.message = "recording; R ends it".into();
                    }
                },
                Action::Play => {
                    self.flown = match (self.flown, &options.flight) {
                        (None, Some(_)) => Some(Instant::now()),
                        _ => None,
                    }
                }
                Action::Home => {
                    self.flown = None;
                    self.fly.place(&options.start);
                }
            }
        }
        Ok(())
    }

    /// Writes what was recorded, up to this moment.
    fn save(&mut self, options: &Options, (start, _, mut recording): (Instant, f64, Recording)) {
        let [eye, target] = self.fly.places();
        recording.add(start.elapsed().as_secs_f64(), eye, target);
        let path = self.free_name(options, "flight", "json");
        let done = write_text(&path, &recording.json()).map_err(|e| e.to_string());
        self.written(path, done);
    }

    fn written(&mut self, path: PathBuf, done: Result<(), String>) {
        self.message = match done {
            Ok(()) => {
                let text = format!("{} written", path.display());
                self.files.push(path);
                text
            }
            Err(e) => e,
        };
    }

    /// The first name of its kind that no file has.
    fn free_name(&self, options: &Options, stem: &str, end: &str) -> PathBuf {
        let name = |n: u32| options.folder.join(format!("{stem}-{n:03}.{end}"));
        (1..).map(name).find(|p| !p.exists()).unwrap_or_else(|| name(0))
    }

    /// One frame.
    fn draw(&mut self, container: &Container, structure: &Structure, options: &Options) -> Result<(), ViewError> {
        let begun = Instant::now();
        let camera = self.camera(options)?;
        self.record();
        self.act(options, &camera)?;
        if self.stage.shadows().is_lost() {
            return Err(RuntimeError::Device { reason: format!("{} was lost", self.name) }.into());
        }
        let shown = match self.surface.get_current_texture() {
            wgpu::CurrentSurfaceTexture::Success(shown) | wgpu::CurrentSurfaceTexture::Suboptimal(shown) => shown,
            wgpu::CurrentSurfaceTexture::Outdated | wgpu::CurrentSurfaceTexture::Lost => {
                self.hidden = true;
                return self.resize(self.window.inner_size());
            }
            wgpu::CurrentSurfaceTexture::Validation => {
                return Err(ViewError::Window(format!("{} gives no picture for this window", self.name)));
            }
            // Nobody sees it.
            wgpu::CurrentSurfaceTexture::Timeout | wgpu::CurrentSurfaceTexture::Occluded => {
                self.hidden = true;
                return Ok(());
            }
        };
        let view =
            shown.texture.create_view(&wgpu::TextureViewDescriptor { format: Some(self.format), ..Default::default() });
        let style = self.controls.style();
        let mut encoder = self.device.create_command_encoder(&Default::default());
        self.stage.draw(&mut encoder, &view, &camera, &style);
        let buffers = self.overlay(container, structure, options, &mut encoder, &view);
        self.queue.submit(buffers.into_iter().chain([encoder.finish()]));
        let own = begun.elapsed().as_secs_f32() * 1000.0;
        self.window.pre_present_notify();
        self.queue.present(shown);
        if self.times.len() == KEPT_TIMES {
            self.times.remove(0);
        }
        self.times.push([self.interval, own]);
        self.frames += 1;
        Ok(())
    }

    /// The panel over the picture; buffers to submit before.
    fn overlay(
        &mut self,
        container: &Container,
        structure: &Structure,
        options: &Options,
        encoder: &mut wgpu::CommandEncoder,
        view: &wgpu::TextureView,
    ) -> Vec<wgpu::CommandBuffer> {
        let input = self.panel.take_egui_input(&self.window);
        let context = self.panel.egui_ctx().clone();
        let shadows = self.stage.shadows();
        let budget = shadows.streamer().budget();
        let facts = Facts {
            title: &options.title,
            device: &self.name,
            stats: shadows.frame_stats(),
            budget: budget.total,
            pool: budget.pool(),
            pages: structure.page_count(),
            loads: shadows.streamer().loads(),
            read_bytes: container.counters().bytes,
            file_bytes: container.header().total_bytes.get(),
            times: &self.times,
            place: self.fly.places()[0],
            message: &self.message,
            recording: self.recording.is_some(),
            playing: self.flown.is_some(),
            has_flight: options.flight.is_some(),
            is_vector: structure.kind() == Kind::Vector,
        };
        let controls = &mut self.controls;
        let mut output = context.run_ui(input, |ui| controls.show(ui, &facts));
        // Keys fly: only a field that is typed in has them.
        if !context.text_edit_focused() {
            context.memory_mut(|m| m.focused().into_iter().for_each(|id| m.surrender_focus(id)));
        }
        self.panel.handle_platform_output(&self.window, output.platform_output);
        let jobs = context.tessellate(output.shapes, output.pixels_per_point);
        for (id, deltas) in output.textures_delta.set.drain() {
            for delta in deltas {
                self.renderer.update_texture(&self.device, &self.queue, id, &delta);
            }
        }
        let screen = ScreenDescriptor {
            size_in_pixels: [self.config.width, self.config.height],
            pixels_per_point: output.pixels_per_point,
        };
        let buffers = self.renderer.update_buffers(&self.device, &self.queue, encoder, &jobs, &screen);
        let pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("umbrage panel"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations { load: wgpu::LoadOp::Load, store: wgpu::StoreOp::Store },
            })],
            ..Default::default()
        });
        self.renderer.render(&mut pass.forget_lifetime(), &jobs, &screen);
        for id in output.textures_delta.free.drain() {
            self.renderer.free_texture(&id);
        }
        buffers
    }

    fn key(&mut self, code: KeyCode, pressed: bool) {
        let keys = &mut self.keys;
        match code {
            KeyCode::KeyW | KeyCode::ArrowUp => keys.forward = pressed,
            KeyCode::KeyS | KeyCode::ArrowDown => keys.back = pressed,
            KeyCode::KeyA | KeyCode::ArrowLeft => keys.left = pressed,
            KeyCode::KeyD | KeyCode::ArrowRight => keys.right = pressed,
            KeyCode::KeyE | KeyCode::PageUp => keys.up = pressed,
            KeyCode::KeyQ | KeyCode::PageDown => keys.down = pressed,
            KeyCode::ShiftLeft | KeyCode::ShiftRight => keys.hurry = pressed,
            _ => {}
        }
        if keys.any() {
            // Whoever takes the keys flies.
            self.flown = None;
        }
    }

    /// A key that was pressed; it does not repeat.
    fn pressed(&mut self, code: KeyCode, is_vector: bool) {
        let controls = &mut self.controls;
        match code {
            KeyCode::Tab => controls.shown = !controls.shown,
            KeyCode::KeyF => controls.next_look(is_vector),
            KeyCode::Digit0 => controls.set_overlay(0),
            KeyCode::Digit1 => controls.set_overlay(1),
            KeyCode::Digit2 => controls.set_overlay(2),
            KeyCode::Digit3 => controls.set_overlay(3),
            KeyCode::Digit4 => controls.set_overlay(4),
            KeyCode::Digit5 => controls.set_overlay(5),
            KeyCode::KeyP => controls.actions.push(Action::Picture),
            KeyCode::KeyR => controls.actions.push(Action::Record),
            KeyCode::Space => controls.actions.push(Action::Play),
            KeyCode::Home => controls.actions.push(Action::Home),
            _ => {}
        }
    }

    fn summary(&self) -> Summary {
        let mut times: Vec<f64> = self.times.iter().map(|t| f64::from(t[0])).collect();
        times.sort_by(f64::total_cmp);
        let median = times.get(times.len() / 2).copied().unwrap_or(0.0);
        let shadows = self.stage.shadows();
        Summary {
            device: self.name.clone(),
            frames: self.frames,
            seconds: self.start.elapsed().as_secs_f64(),
            frame_ms: [median, times.last().copied().unwrap_or(0.0)],
            last: shadows.frame_stats(),
            pages_read: shadows.streamer().loads(),
            files: self.files.clone(),
        }
    }
}

impl App<'_> {
    fn close(&mut self, events: &ActiveEventLoop) {
        if let Some(open) = &mut self.open {
            if let Some(recording) = open.recording.take() {
                open.save(self.options, recording);
            }
            self.summary = Some(open.summary());
        }
        // Before the display goes.
        self.open = None;
        events.exit();
    }

    fn fail(&mut self, events: &ActiveEventLoop, failure: ViewError) {
        self.failure = Some(failure);
        self.close(events);
    }

    fn frame(&mut self, events: &ActiveEventLoop) {
        let Some(open) = &mut self.open else { return };
        let over = self.options.seconds.is_some_and(|s| open.start.elapsed().as_secs_f64() >= s);
        match open.draw(self.container, self.structure, self.options) {
            Err(failure) => self.fail(events, failure),
            Ok(()) if over || !(self.go_on)() => self.close(events),
            Ok(()) => {}
        }
    }
}

impl ApplicationHandler for App<'_> {
    fn resumed(&mut self, events: &ActiveEventLoop) {
        if self.open.is_some() {
            return;
        }
        match Open::new(events, self) {
            Ok(open) => {
                open.window.request_redraw();
                self.open = Some(open);
            }
            Err(failure) => self.fail(events, failure),
        }
    }

    fn window_event(&mut self, events: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        let is_vector = self.structure.kind() == Kind::Vector;
        let Some(open) = &mut self.open else { return };
        let is_tab = matches!(&event, WindowEvent::KeyboardInput { event, .. } if event.physical_key == KeyCode::Tab);
        let taken = !is_tab && open.panel.on_window_event(&open.window, &event).consumed;
        match event {
            WindowEvent::CloseRequested => self.close(events),
            WindowEvent::Resized(size) => {
                if let Err(failure) = open.resize(size) {
                    self.fail(events, failure);
                }
            }
            WindowEvent::RedrawRequested => self.frame(events),
            WindowEvent::Focused(false) => (open.keys, open.dragged) = (Keys::default(), false),
            WindowEvent::KeyboardInput { event, .. } => {
                let PhysicalKey::Code(code) = event.physical_key else { return };
                let pressed = event.state == ElementState::Pressed;
                if pressed && code == KeyCode::Escape {
                    return self.close(events);
                }
                // A field of the panel that is typed in has the keys for itself; letting go always counts.
                if !pressed || !open.panel.egui_ctx().text_edit_focused() {
                    open.key(code, pressed);
                    if pressed && !event.repeat {
                        open.pressed(code, is_vector);
                    }
                }
            }
            WindowEvent::MouseInput { state, button: MouseButton::Left | MouseButton::Right, .. } => {
                open.dragged = state == ElementState::Pressed && !taken;
            }
            WindowEvent::CursorMoved { position, .. } => {
                if let Some(before) = open.pointer.replace(position).filter(|_| open.dragged) {
                    open.flown = None;
                    open.fly.look([position.x - before.x, position.y - before.y]);
                }
            }
            WindowEvent::MouseWheel { delta, .. } if !taken => {
                let lines = match delta {
                    MouseScrollDelta::LineDelta(_, y) => f64::from(y),
                    MouseScrollDelta::PixelDelta(p) => p.y / 40.0,
                };
                open.controls.speed = (open.controls.speed * 1.2f64.powf(lines)).clamp(0.01, 10_000.0);
            }
            _ => {}
        }
    }

    fn about_to_wait(&mut self, events: &ActiveEventLoop) {
        let Some(open) = &mut self.open else { return };
        if std::mem::take(&mut open.hidden) {
            // It notices all the same that it is to end.
            events.set_control_flow(ControlFlow::WaitUntil(Instant::now() + LATER));
        } else {
            // What is shown paces it.
            events.set_control_flow(ControlFlow::Wait);
            open.window.request_redraw();
        }
    }
}
