//! Who answers the shadows of a view: a GPU that pages are streamed to, or the CPU.

use serde_json::{Value, json};
use umbrage::reader::query::mh::MhMap;
use umbrage::reader::{Container, Structure};
use umbrage::render::View;
use umbrage::runtime::RuntimeError;
use umbrage::runtime::gpu::{GpuStreamer, Headless, Receiver, ViewOptions, ViewStats};

use super::{Failure, REFUSED, TARGET, output, picture};

/// What is asked to answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Backend {
    /// A GPU if there is one, else the CPU
    Auto,
    /// A GPU
    Gpu,
    /// The CPU
    Cpu,
}

/// Answers and what they took.
pub struct Shadows {
    /// Light or shadow of every pixel; pixels without a receiver are lit.
    pub lit: Vec<bool>,
    /// Who answered.
    pub by: String,
    /// Pages read.
    pub pages_read: u64,
    /// Figures of the streamer, where one answered.
    pub stream: Option<ViewStats>,
}

impl From<RuntimeError> for Failure {
    fn from(e: RuntimeError) -> Self {
        match e {
            RuntimeError::Reader(e) => e.into(),
            RuntimeError::UnsupportedKind(_) => Failure::new(REFUSED, e),
            e => Failure::new(TARGET, e),
        }
    }
}

/// Half of the pages' bytes within 8 to 128 MiB: less than a large file, enough for a view.
pub fn default_budget(container: &Container) -> u64 {
    (container.header().total_bytes.get() / 2).clamp(8 << 20, 128 << 20)
}

impl Shadows {
    /// Answers a view; `budget` is the most bytes that the streamer may hold.
    pub fn answer(
        view: &View,
        container: &Container,
        structure: Structure,
        backend: Backend,
        budget: u64,
    ) -> Result<Shadows, Failure> {
        if backend != Backend::Cpu {
            match Headless::new() {
                Ok(device) => return Shadows::on_gpu(view, &structure, &device, budget),
                Err(e) if backend == Backend::Auto => {
                    return Shadows::on_cpu(view, container, structure, format!("the CPU ({e})"));
                }
                Err(e) => return Err(e.into()),
            }
        }
        Shadows::on_cpu(view, container, structure, "the CPU".to_string())
    }

    fn on_cpu(view: &View, container: &Container, structure: Structure, by: String) -> Result<Shadows, Failure> {
        let before = container.counters().pages;
        let lit = picture::lit_by_map(view, &MhMap::new(structure)?)?;
        Ok(Shadows { lit, by, pages_read: container.counters().pages - before, stream: None })
    }

    fn on_gpu(view: &View, structure: &Structure, device: &Headless, budget: u64) -> Result<Shadows, Failure> {
        let lattice = structure.lattice();
        let mut streamer = GpuStreamer::new(&device.device, &device.queue, structure, budget)?;
        let receivers: Vec<Receiver> = view
            .receivers
            .iter()
            .flatten()
            .map(|r| {
                let [x, y] = r.texel(&lattice);
                Receiver { x, y, depth: r.depth.query() }
            })
            .collect();
        let answer = streamer.answer_view(&receivers, &ViewOptions::default())?;
        let mut pixels = answer.pixels.iter();
        let lit = view.receivers.iter().map(|r| r.is_none() || pixels.next().is_none_or(|p| p.lit)).collect();
        let stats = answer.stats;
        Ok(Shadows { lit, by: device.name.clone(), pages_read: stats.pages_read, stream: Some(stats) })
    }

    /// Lines for people.
    pub fn lines(&self) -> Vec<String> {
        let mut lines = vec![format!("  shadows by        {}", self.by)];
        if let Some(s) = &self.stream {
            let exact = if s.exact { "all exact" } else { "some by coarser levels" };
            lines.push(format!(
                "  streamed          {} to the device under a budget of {}, {} frames, {exact}",
                output::bytes(s.uploaded_bytes),
                output::bytes(s.budget_bytes),
                s.frames
            ));
        }
        lines
    }

    /// The same for programs.
    pub fn json(&self) -> Value {
        let stream = self.stream.as_ref().map(|s| {
            json!({
                "budget_bytes": s.budget_bytes, "pool_bytes": s.pool_bytes, "uploaded_bytes": s.uploaded_bytes,
                "frames_until_exact": s.exact.then_some(s.frames), "frames": s.frames, "evicted": s.evicted,
                "starved": s.starved, "failed": s.failed,
            })
        });
        json!({"by": self.by, "pages_read": self.pages_read, "stream": stream})
    }
}
