//! `cold`: bytes of cold pages over those that they decode to, and how fast, held against zstd on the same pages, one by
//! one, level 3. Root pages are stored as they are queried and count as such in the bytes; one thread, all in memory.

use std::hint::black_box;
use std::sync::Arc;

use serde_json::json;
use umbrage::format::Kind;
use umbrage::format::cold::decode;
use umbrage::reader::{Container, FileSource, Limits};
use umbrage::writer::bake::{BakeOptions, bake};

use crate::report::{Report, Table, bytes, side};
use crate::scenes::{self, Folder, LIGHTS};
use crate::timing::Samples;
use crate::{Args, Failure};

/// Rounds in which both take turns.
const ROUNDS: usize = 9;
/// Hot bytes that are decoded in one round, at least.
const LEAST_BYTES: u64 = 100 << 20;
/// Level of zstd.
const LEVEL: i32 = 3;
/// Most cold bytes, in hot ones, and least speeds: MB/s of hot bytes, and in zstd's.
const RATIOS: [(Kind, f64); 2] = [(Kind::Mh, 0.45), (Kind::Vector, 0.65)];
const LEAST_SPEED: f64 = 300.0;
const LEAST_OF_ZSTD: f64 = 0.5;

/// Runs the suite.
pub fn run(args: &Args) -> Result<Report, Failure> {
    let mut report = Report::new("cold");
    let mut table = Table::new(
        "cold pages with their model, all pages of a file; decoding on one thread, hot bytes",
        &[
            "scene",
            "side",
            "kind",
            "pages",
            "hot",
            "cold",
            "model",
            "cold : hot",
            "zstd : hot",
            "MB/s",
            "zstd MB/s",
            "of zstd",
        ],
    );
    let resolutions = if args.resolutions.is_empty() { vec![16384] } else { args.resolutions.clone() };
    let folder = Folder::new()?;
    for name in scenes::names(&args.scenes, &["city:1"]) {
        let model = scenes::load(name, args.policy)?;
        for &resolution in &resolutions {
            for kind in [Kind::Mh, Kind::Mmh, Kind::Vector] {
                let file = folder.file();
                let options = BakeOptions { kind, cold: true, ..model.options(LIGHTS[0], resolution, false) };
                bake(&model.mesh, &options, &file, &Default::default())?;
                let container = Container::open(Arc::new(FileSource::open(&file)?), Limits::default())?;
                let s = container.structure(0)?;
                let tables = s.cold_model()?.ok_or_else(|| Failure::target("a cold bake without a model"))?;
                let (mut pages, mut zstd_pages, mut hot, mut cold, mut zstd_bytes) = (vec![], vec![], 0u64, 0u64, 0u64);
                let mut decoded = 0u64;
                for ordinal in 0..s.page_count() {
                    let page = s.page_bytes(ordinal)?;
                    let (stored, is_cold) = (page.bytes().to_vec(), page.is_cold());
                    let words = page.check_frame()?.words().to_vec();
                    let bytes: Vec<u8> = words.iter().flat_map(|w| w.to_le_bytes()).collect();
                    let packed = zstd::bulk::compress(&bytes, LEVEL).map_err(Failure::target)?;
                    hot += bytes.len() as u64;
                    cold += stored.len() as u64;
                    zstd_bytes += packed.len() as u64;
                    // Both decode the same pages.
                    if is_cold {
                        decoded += bytes.len() as u64;
                        pages.push((stored, words.len() as u16));
                        zstd_pages.push((packed, bytes.len()));
                    }
                }
                let again = (LEAST_BYTES / decoded.max(1)).max(1);
                let mut own = || {
                    for (page, words) in (0..again).flat_map(|_| &pages) {
                        black_box(decode(&tables, black_box(page), *words));
                    }
                };
                let mut context = zstd::bulk::Decompressor::new().map_err(Failure::target)?;
                let mut buffer = vec![0; 1 << 16];
                let mut other = || {
                    for (page, length) in (0..again).flat_map(|_| &zstd_pages) {
                        let found = context.decompress_to_buffer(black_box(page), &mut buffer[..*length]);
                        black_box(found.is_ok());
                    }
                };
                let [own, other] = &Samples::take(ROUNDS, &mut [&mut own, &mut other])[..] else {
                    unreachable!("two candidates")
                };
                let section = s.cold_section().map_or(0, |section| section.length.get());
                let ratio = (cold + section) as f64 / hot as f64;
                let speed = |s: &Samples| (decoded * again) as f64 / s.median() / 1e6;
                let of_zstd = speed(own) / speed(other);
                table.push([
                    name.to_string(),
                    side(resolution),
                    kind.name().to_string(),
                    s.page_count().to_string(),
                    bytes(hot),
                    bytes(cold),
                    bytes(section),
                    format!("{ratio:.4}"),
                    format!("{:.4}", zstd_bytes as f64 / hot as f64),
                    format!("{:.0}", speed(own)),
                    format!("{:.0}", speed(other)),
                    format!("{of_zstd:.2}"),
                ]);
                report.rows.push(json!({
                    "scene": name, "light": LIGHTS[0], "resolution": resolution, "kind": kind.name(),
                    "pages": s.page_count(), "cold_pages": pages.len(), "hot_bytes": hot, "cold_bytes": cold,
                    "model_bytes": section, "ratio": ratio, "zstd_bytes": zstd_bytes, "mb_per_s": speed(own),
                    "zstd_mb_per_s": speed(other), "of_zstd": of_zstd, "seconds": own.0, "zstd_seconds": other.0,
                }));
                let what = format!("{name} {}, {}", side(resolution), kind.name());
                if let Some((_, most)) = RATIOS.iter().find(|r| r.0 == kind) {
                    let goal = format!("{what}: cold over hot bytes at most {most}");
                    report.goal(ratio <= *most, goal, format!("{ratio:.4}"));
                }
                let goal = format!("{what}: at least {LEAST_SPEED} MB/s");
                report.goal(speed(own) >= LEAST_SPEED, goal, format!("{:.0}", speed(own)));
                let goal = format!("{what}: at least {LEAST_OF_ZSTD} of zstd's speed");
                report.goal(of_zstd >= LEAST_OF_ZSTD, goal, format!("{of_zstd:.2}"));
            }
        }
    }
    report.tables.push(table);
    Ok(report)
}
