//! `check`: what trust costs. CRCs of all pages against crc32fast over the same bytes, the structure check against the
//! CRCs, from about 1 MiB to more than 1 GiB; and what opening and a first coarse answer read.
//!
//! The files are the worst case of kind `mh`: white noise of depth, in which hardly two texels agree, from a
//! [`DepthSource`]. Whole pages lie in memory before any clock runs; one thread.

use std::hint::black_box;
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::time::Instant;

use serde_json::{Value, json};
use umbrage::format::checksum::PageCrc;
use umbrage::format::kind::mh;
use umbrage::format::page::{FrameHead, PageContext, check_frame};
use umbrage::reader::query::Map;
use umbrage::reader::{Container, FileSource, Limits};
use umbrage::writer::hierarchy::build::Progress;
use umbrage::writer::layers::{DepthSource, LayersOptions, Projection, Second, SourceError, Square, bake_layers};

use crate::plot::{Plot, Series};
use crate::report::{Report, Table, bytes, side};
use crate::scenes::Folder;
use crate::timing::Samples;
use crate::{Args, Failure, machine};

/// Rounds in which both candidates take turns.
const ROUNDS: usize = 7;
/// Bytes that are checked in one round, at least.
const LEAST_BYTES: u64 = 1 << 30;
/// Openings that are timed.
const OPENINGS: usize = 51;
/// Most that CRCs may take, in crc32fast's own time.
const CRC_GOAL: f64 = 1.1;
/// Most that the structure check may take, in the CRCs' time.
const STRUCTURE_GOAL: f64 = 10.0;
/// Level of the coarse answer: 64 x 64.
const COARSE_LOG2: u8 = 6;

/// White noise.
struct Noise {
    resolution: u64,
}

impl DepthSource for Noise {
    fn name(&self) -> &str {
        "noise"
    }

    fn projection(&self) -> Projection {
        Projection::image(self.resolution).unwrap_or_else(|e| unreachable!("a power of two: {e}"))
    }

    fn second(&self) -> Second {
        Second::Exit
    }

    fn key(&self) -> Vec<u8> {
        b"white noise".to_vec()
    }

    fn render(&self, square: Square, first: &mut [f64], second: &mut [f64]) -> Result<(), SourceError> {
        for (i, (first, second)) in first.iter_mut().zip(second).enumerate() {
            let [x, y] = square.texel(i);
            let h = (u64::from(x) << 32 | u64::from(y)).wrapping_mul(0x9E37_79B9_7F4A_7C15);
            let h = (h ^ h >> 29).wrapping_mul(0xBF58_476D_1CE4_E5B9);
            *first = (h >> 40) as f64;
            *second = *first + 0.01;
        }
        Ok(())
    }
}

/// What opening took.
struct Opening {
    micros: f64,
    reads: u64,
    bytes: u64,
    coarse_reads: u64,
    coarse_bytes: u64,
    /// Resident memory that opening and the coarse answers added in a process that did nothing else.
    resident: [u64; 2],
    /// Most resident memory of that process.
    peak: u64,
}

fn open(file: &Path) -> Result<Container, Failure> {
    Ok(Container::open(Arc::new(FileSource::open(file)?), Limits::default())?)
}

fn opening(file: &Path) -> Result<Opening, Failure> {
    let mut times = Vec::new();
    for _ in 0..OPENINGS {
        let clock = Instant::now();
        black_box(open(file)?);
        times.push(clock.elapsed().as_secs_f64() * 1e6);
    }
    let container = open(file)?;
    let opened = container.counters();
    let _map = coarse_answers(&container)?;
    let coarse = container.counters();
    let memory = child(file)?;
    let memory = |key: &str| memory[key].as_u64().unwrap_or(0);
    Ok(Opening {
        micros: Samples(times).median(),
        reads: opened.reads,
        bytes: opened.bytes,
        coarse_reads: coarse.reads,
        coarse_bytes: coarse.bytes,
        resident: [memory("opened"), memory("answered")],
        peak: memory("peak"),
    })
}

/// Asks for every texel of the level of 64 x 64; the map holds what was loaded for it.
fn coarse_answers(container: &Container) -> Result<Map, Failure> {
    let map = Map::new(container.structure_named("noise")?)?;
    let level = map.resolution().ilog2() as u8 - COARSE_LOG2;
    for i in 0..1u32 << (2 * COARSE_LOG2) {
        let [x, y] = [i & 63, i >> 6].map(|v| v << level);
        black_box(map.texel(x, y, level)?);
    }
    Ok(map)
}

/// Opens a file, asks for the coarse level, and prints what memory that took: for a process of its own.
pub fn one(args: &Args) -> Result<(), Failure> {
    let Some(file) = args.scenes.first() else {
        return Err(Failure { code: 2, message: "one-open: give the file with --scene".to_string() });
    };
    let before = machine::resident_memory();
    let container = open(Path::new(file))?;
    let opened = machine::resident_memory();
    let _map = coarse_answers(&container)?;
    let answered = machine::resident_memory();
    println!(
        "{}",
        json!({
            "opened": opened.saturating_sub(before), "answered": answered.saturating_sub(before),
            "peak": machine::peak_memory(),
        })
    );
    Ok(())
}

fn child(file: &Path) -> Result<Value, Failure> {
    let this = std::env::current_exe().map_err(Failure::target)?;
    let out = Command::new(this).args(["one-open", "--scene"]).arg(file).stderr(Stdio::inherit()).output();
    let out = out.map_err(Failure::target)?;
    let failed = |why: String| Failure::target(format!("opening {}: {why}", file.display()));
    if !out.status.success() {
        return Err(failed(out.status.to_string()));
    }
    serde_json::from_slice(&out.stdout).map_err(|e| failed(e.to_string()))
}

/// Runs the suite.
pub fn run(args: &Args) -> Result<Report, Failure> {
    let mut report = Report::new("check");
    let own: &[u64] = if args.full { &[512, 1024, 2048, 4096, 8192, 16384] } else { &[512, 1024, 2048, 4096] };
    let resolutions = if args.resolutions.is_empty() { own } else { &args.resolutions };
    let folder = Folder::new()?;
    let mut table = Table::new(
        "checks, one thread, and what opening reads",
        &[
            "side",
            "bytes",
            "pages",
            "crc ms",
            "of crc32fast",
            "structure ms",
            "of crc",
            "open us",
            "open reads",
            "open bytes",
            "64 x 64 reads",
            "64 x 64 bytes",
            "open memory",
            "64 x 64 memory",
            "peak",
        ],
    );
    let mut series = [("crc32fast", Vec::new()), ("CRCs of pages", Vec::new()), ("structure check", Vec::new())];
    let (mut crc_most, mut structure_most, mut openings) = (0.0f64, 0.0f64, Vec::new());
    for &resolution in resolutions {
        let file = folder.file();
        let baked = bake_layers(&[&Noise { resolution }], &LayersOptions::default(), &file, &Progress::default())
            .map_err(|e| Failure::target(format!("{}: {e}", file.display())))?;
        let container = open(&file)?;
        let s = container.structure(0)?;
        let pages: Vec<(Vec<u8>, Vec<u32>)> = (0..s.page_count())
            .map(|o| {
                let page = s.page_bytes(o)?;
                let bytes = page.bytes().to_vec();
                Ok((bytes, page.check_frame()?.words().to_vec()))
            })
            .collect::<Result<_, Failure>>()?;
        let records = (0..s.page_count()).map(|o| Ok(s.page_record(o)?)).collect::<Result<Vec<_>, Failure>>()?;
        // small files again and again, so that every candidate takes long enough to be timed
        let again = (LEAST_BYTES / baked.bytes).max(1);
        let mut plain = || {
            for (bytes, _) in (0..again).flat_map(|_| &pages) {
                black_box(crc32fast::hash(black_box(bytes)));
            }
        };
        let crc = PageCrc::new(container.file_id(), 0);
        let mut bound = || {
            for (o, (bytes, _)) in (0..again).flat_map(|_| (0u32..).zip(&pages)) {
                black_box(crc.of(o, black_box(bytes)));
            }
        };
        let mut faults = 0;
        let mut structure = || {
            for ((o, (_, words)), page) in (0..again).flat_map(|_| (0u32..).zip(&pages).zip(&records)) {
                let cx = PageContext { structure: 0, ordinal: o, page, record: s.record() };
                let Some(head) = FrameHead::decode(black_box(words)) else { continue };
                faults += usize::from(check_frame(words, &cx).is_err() || mh::check(words, &head, &cx).is_err());
            }
        };
        let samples = Samples::take(ROUNDS, &mut [&mut plain, &mut bound, &mut structure]);
        if faults > 0 {
            return Err(Failure::input(format!("{faults} pages failed the check")));
        }
        let [plain, bound, structure] = [0, 1, 2].map(|i| samples[i].median() / again as f64);
        let o = opening(&file)?;
        let (crc, check) = (bound / plain, structure / bound);
        (crc_most, structure_most) = (crc_most.max(crc), structure_most.max(check));
        for (s, v) in series.iter_mut().zip([plain, bound, structure]) {
            s.1.push([baked.bytes as f64 / f64::from(1 << 20), v * 1e3]);
        }
        table.push([
            side(resolution),
            bytes(baked.bytes),
            pages.len().to_string(),
            format!("{:.3}", bound * 1e3),
            format!("{crc:.2}"),
            format!("{:.3}", structure * 1e3),
            format!("{check:.2}"),
            format!("{:.0}", o.micros),
            o.reads.to_string(),
            o.bytes.to_string(),
            o.coarse_reads.to_string(),
            o.coarse_bytes.to_string(),
            bytes(o.resident[0]),
            bytes(o.resident[1]),
            bytes(o.peak),
        ]);
        report.rows.push(json!({
            "resolution": resolution, "bytes": baked.bytes, "pages": pages.len(), "crc32fast_seconds": plain,
            "crc_seconds": bound, "structure_seconds": structure, "open_microseconds": o.micros,
            "open_reads": o.reads, "open_bytes": o.bytes, "coarse_reads": o.coarse_reads,
            "coarse_bytes": o.coarse_bytes, "open_resident_bytes": o.resident[0],
            "coarse_resident_bytes": o.resident[1], "open_process_peak_bytes": o.peak,
        }));
        openings.push(o);
        drop(pages);
        let _ = std::fs::remove_file(&file);
    }
    report.tables.push(table);
    report.goal(
        crc_most <= CRC_GOAL,
        format!("CRCs of pages take at most {CRC_GOAL} x crc32fast"),
        format!("{crc_most:.2} at most"),
    );
    report.goal(
        structure_most <= STRUCTURE_GOAL,
        format!("the structure check takes at most {STRUCTURE_GOAL} x the CRCs"),
        format!("{structure_most:.2} at most"),
    );
    let most = |f: &dyn Fn(&Opening) -> u64| openings.iter().map(f).max().unwrap_or(0);
    let slowest = openings.iter().map(|o| o.micros).fold(0.0, f64::max);
    report.goal(
        most(&|o| o.bytes) <= 32 << 10 && slowest <= 1000.0,
        "opening reads at most 32 KiB and takes at most 1 ms, warm",
        format!("{} bytes, {slowest:.0} us", most(&|o| o.bytes)),
    );
    report.goal(
        most(&|o| o.coarse_reads) <= 2 && most(&|o| o.coarse_bytes) <= 64 << 10,
        "a level of 64 x 64 answers after 2 reads and 64 KiB",
        format!("{} reads, {} bytes", most(&|o| o.coarse_reads), most(&|o| o.coarse_bytes)),
    );
    report.notes.push(
        "memory: what opening, and then the level of 64 x 64, add to a process that does nothing else, and its peak"
            .to_string(),
    );
    let plot = Plot {
        title: "Checks of whole files on one thread".to_string(),
        axes: ["MiB".to_string(), "ms".to_string()],
        series: series.into_iter().map(|(name, points)| Series { name: name.to_string(), points }).collect(),
        hull: false,
    };
    report.plots.push(("linear".to_string(), plot));
    Ok(report)
}
