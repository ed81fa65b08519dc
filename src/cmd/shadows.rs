//! Who answers the shadows of a view: a GPU that pages are streamed to, or the CPU.

use serde_json::{Value, json};
use umbrage::reader::query::Map;
use umbrage::reader::{Container, Structure};
use umbrage::render::View;

use super::{Failure, TARGET, USAGE, output, picture};

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
    pub stream: Option<Streamed>,
}

/// What streaming took.
pub struct Streamed {
    /// Most bytes that the streamer may hold.
    pub budget_bytes: u64,
    /// Bytes uploaded.
    pub uploaded_bytes: u64,
    /// Frames.
    pub frames: u32,
    /// Whether every answer is exact.
    pub exact: bool,
    /// Pages evicted.
    pub evicted: u64,
    /// Most pages that found no room in a frame.
    pub starved: u32,
    /// Pages that could not be read.
    pub failed: u32,
}

/// Half of the pages' bytes within 8 to 128 MiB: less than a large file, enough for a view.
pub fn default_budget(container: &Container) -> u64 {
    (container.header().total_bytes.get() / 2).clamp(8 << 20, 128 << 20)
}

impl Shadows {
    /// Answers a view; `budget` is the most bytes that the streamer may hold, `continuous` asks for lookups at the places of
    /// receivers in their texels, which the CPU answers.
    pub fn answer(
        view: &View,
        container: &Container,
        structure: Structure,
        backend: Backend,
        budget: u64,
        continuous: bool,
    ) -> Result<Shadows, Failure> {
        if continuous && backend == Backend::Gpu {
            let message = "--continuous is answered by the CPU; leave --backend gpu out";
            return Err(Failure::new(USAGE, message));
        }
        if continuous {
            return Shadows::on_cpu(view, container, structure, "the CPU, between texel centres".to_string(), true);
        }
        if backend != Backend::Cpu {
            match gpu::answer(view, &structure, budget) {
                Err(gpu::Failed::NoDevice(why)) if backend == Backend::Auto => {
                    return Shadows::on_cpu(view, container, structure, format!("the CPU ({why})"), false);
                }
                Err(gpu::Failed::NoDevice(why)) => return Err(Failure::new(TARGET, why)),
                Err(gpu::Failed::Other(failure)) => return Err(failure),
                Ok(shadows) => return Ok(shadows),
            }
        }
        Shadows::on_cpu(view, container, structure, "the CPU".to_string(), false)
    }

    fn on_cpu(
        view: &View,
        container: &Container,
        structure: Structure,
        by: String,
        continuous: bool,
    ) -> Result<Shadows, Failure> {
        let before = container.counters().pages;
        let lit = picture::lit_by_map(view, &Map::new(structure)?, continuous)?;
        Ok(Shadows { lit, by, pages_read: container.counters().pages - before, stream: None })
    }

    /// Lines for people.
    pub fn lines(&self) -> Vec<String> {
        let mut lines = vec![format!("  shadows by        {}", self.by)];
        if let Some(s) = &self.stream {
            let exact = if s.exact { "all exact" } else { "some by coarser levels" };
            lines.push(format!(
                "  streamed          {} to the device under a budget of {}, {} frames, {exact}",
                output::mib(s.uploaded_bytes),
                output::mib(s.budget_bytes),
                s.frames
            ));
        }
        lines
    }

    /// The same for programs.
    pub fn json(&self) -> Value {
        let stream = self.stream.as_ref().map(|s| {
            json!({
                "budget_bytes": s.budget_bytes, "uploaded_bytes": s.uploaded_bytes,
                "frames_until_exact": s.exact.then_some(s.frames), "frames": s.frames, "evicted": s.evicted,
                "starved": s.starved, "failed": s.failed,
            })
        });
        json!({"by": self.by, "pages_read": self.pages_read, "stream": stream})
    }
}

#[cfg(feature = "gpu")]
mod gpu {
    use umbrage::reader::Structure;
    use umbrage::render::View;
    use umbrage::runtime::RuntimeError;
    use umbrage::runtime::gpu::{GpuStreamer, Headless, Receiver, ViewOptions};

    use super::super::{Failure, REFUSED, TARGET};
    use super::{Shadows, Streamed};

    /// Why the device did not answer.
    pub enum Failed {
        /// There is none.
        NoDevice(String),
        /// Anything else.
        Other(Failure),
    }

    impl From<RuntimeError> for Failed {
        fn from(e: RuntimeError) -> Self {
            Failed::Other(match e {
                RuntimeError::Reader(e) => e.into(),
                RuntimeError::UnsupportedKind(_) => Failure::new(REFUSED, e),
                e => Failure::new(TARGET, e),
            })
        }
    }

    /// Streams what the view needs to the device and asks there.
    pub fn answer(view: &View, structure: &Structure, budget: u64) -> Result<Shadows, Failed> {
        let device = Headless::new().map_err(|e| Failed::NoDevice(e.to_string()))?;
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
        let s = answer.stats;
        let stream = Streamed {
            budget_bytes: s.budget_bytes,
            uploaded_bytes: s.uploaded_bytes,
            frames: s.frames,
            exact: s.exact,
            evicted: s.evicted,
            starved: s.starved,
            failed: s.failed,
        };
        Ok(Shadows { lit, by: device.name.clone(), pages_read: s.pages_read, stream: Some(stream) })
    }
}

#[cfg(not(feature = "gpu"))]
mod gpu {
    use umbrage::reader::Structure;
    use umbrage::render::View;

    use super::super::Failure;
    use super::Shadows;

    /// Why the device did not answer.
    pub enum Failed {
        /// There is none.
        NoDevice(String),
        /// Never without the feature.
        #[allow(dead_code)]
        Other(Failure),
    }

    /// Says that this program has no GPU in it.
    pub fn answer(_: &View, _: &Structure, _: u64) -> Result<Shadows, Failed> {
        Err(Failed::NoDevice("built without the feature gpu; build with it or use --backend cpu".to_string()))
    }
}
