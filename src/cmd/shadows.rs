//! Who answers the shadows of a view: a GPU that pages are streamed to, or the CPU.

use serde_json::{Value, json};
use umbrage::reader::query::Map;
use umbrage::reader::{Container, Structure};
use umbrage::render::{Look, Surface, View, coverage};

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

/// With what.
#[derive(Clone, Copy, Debug)]
pub struct How {
    /// Who answers.
    pub backend: Backend,
    /// Most bytes that the streamer may hold.
    pub budget: u64,
    /// Pages that the index settles within this error, in lattice steps, are not read; none: all on the way are.
    pub skips: Option<u32>,
}

/// Answers and what they took.
pub struct Shadows {
    /// Share of sunlight of every pixel, 0 to 255; pixels without a receiver are lit.
    pub coverage: Vec<u8>,
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
    /// Answers a view of these triangles. The CPU answers what is asked at places in texels.
    pub fn answer(
        view: &View,
        surface: Surface<'_>,
        container: &Container,
        structure: Structure,
        how: How,
        look: Look,
    ) -> Result<Shadows, Failure> {
        let How { backend, .. } = how;
        let cpu = |by: &str| Shadows::on_cpu(view, surface, container, structure.clone(), by, (how, look));
        if look == Look::Place {
            if backend == Backend::Gpu {
                let message = "--continuous is answered by the CPU; leave --backend gpu out";
                return Err(Failure::new(USAGE, message));
            }
            return cpu("the CPU, between texel centres");
        }
        if backend != Backend::Cpu {
            match gpu::answer(view, surface, &structure, how, look) {
                Err(gpu::Failed::NoDevice(why)) if backend == Backend::Auto => {
                    return cpu(&format!("the CPU ({why})"));
                }
                Err(gpu::Failed::NoDevice(why)) => return Err(Failure::new(TARGET, why)),
                Err(gpu::Failed::Other(failure)) => return Err(failure),
                Ok(shadows) => return Ok(shadows),
            }
        }
        cpu("the CPU")
    }

    fn on_cpu(
        view: &View,
        surface: Surface<'_>,
        container: &Container,
        structure: Structure,
        by: &str,
        (how, look): (How, Look),
    ) -> Result<Shadows, Failure> {
        let before = container.counters().pages;
        let mut map = Map::new(structure)?;
        map.skip(how.skips);
        let coverage = match look {
            Look::Texel => coverage(&picture::lit_by_map(view, &map, false)?),
            Look::Place => coverage(&picture::lit_by_map(view, &map, true)?),
            Look::Filtered(filter) => picture::filtered_by_map(view, surface, &map, filter)?,
        };
        Ok(Shadows { coverage, by: by.to_string(), pages_read: container.counters().pages - before, stream: None })
    }

    /// Light or shadow of every pixel of an answer that was not filtered.
    pub fn lit(&self) -> Vec<bool> {
        self.coverage.iter().map(|c| *c == 255).collect()
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
    use rayon::prelude::*;
    use umbrage::reader::Structure;
    use umbrage::render::{Footprints, Look, Surface, View, coverage};
    use umbrage::runtime::RuntimeError;
    use umbrage::runtime::gpu::{GpuStreamer, Headless, Receiver, ViewOptions};
    use umbrage::runtime::query::filter::FilterQuery;

    use super::super::{Failure, REFUSED, TARGET};
    use super::{How, Shadows, Streamed};

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
    pub fn answer(
        view: &View,
        surface: Surface<'_>,
        structure: &Structure,
        how: How,
        look: Look,
    ) -> Result<Shadows, Failed> {
        let device = Headless::new().map_err(|e| Failed::NoDevice(e.to_string()))?;
        let lattice = structure.lattice();
        let mut streamer = GpuStreamer::new(&device.device, &device.queue, structure, how.budget)?;
        streamer.skip(how.skips);
        let options = ViewOptions::default();
        let (coverage, s) = if let Look::Filtered(filter) = look {
            let of = Footprints::new(view, surface);
            let query = |pixel| {
                let (side, lod) = filter.at(&of, pixel);
                of.receiver(pixel).map(|receiver| FilterQuery { receiver, lod, side })
            };
            let queries: Vec<Option<FilterQuery>> = (0..view.receivers.len()).into_par_iter().map(query).collect();
            let asked: Vec<FilterQuery> = queries.iter().flatten().copied().collect();
            let (states, stats) = streamer.filter_view(&asked, &options)?;
            let mut states = states.into_iter();
            let mut share = |q: &FilterQuery| states.next().map_or(255, |s| q.share(s).coverage());
            (queries.iter().map(|q| q.as_ref().map_or(255, &mut share)).collect(), stats)
        } else {
            let receiver = |r: &umbrage::render::Receiver| {
                let [x, y] = r.texel(&lattice);
                Receiver { x, y, depth: r.depth.query(), level: 0 }
            };
            let receivers: Vec<Receiver> = view.receivers.iter().flatten().map(receiver).collect();
            let answer = streamer.answer_view(&receivers, &options)?;
            let mut pixels = answer.pixels.iter();
            let lit: Vec<bool> =
                view.receivers.iter().map(|r| r.is_none() || pixels.next().is_none_or(|p| p.lit)).collect();
            (coverage(&lit), answer.stats)
        };
        let stream = Streamed {
            budget_bytes: s.budget_bytes,
            uploaded_bytes: s.uploaded_bytes,
            frames: s.frames,
            exact: s.exact,
            evicted: s.evicted,
            starved: s.starved,
            failed: s.failed,
        };
        Ok(Shadows { coverage, by: device.name.clone(), pages_read: s.pages_read, stream: Some(stream) })
    }
}

#[cfg(not(feature = "gpu"))]
mod gpu {
    use umbrage::reader::Structure;
    use umbrage::render::{Look, Surface, View};

    use super::super::Failure;
    use super::{How, Shadows};

    /// Why the device did not answer.
    pub enum Failed {
        /// There is none.
        NoDevice(String),
        /// Never without the feature.
        #[allow(dead_code)]
        Other(Failure),
    }

    /// Says that this program has no GPU in it.
    pub fn answer(_: &View, _: Surface<'_>, _: &Structure, _: How, _: Look) -> Result<Shadows, Failed> {
        Err(Failed::NoDevice("built without the feature gpu; build with it or use --backend cpu".to_string()))
    }
}
