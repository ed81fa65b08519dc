//! `skip`: pages that views don't read because the index settles their receivers, and the error that this causes.
//!
//! Each line reads a file anew, on the CPU. Levels are the finest one, or the one of each pixel's footprint. Without an
//! error the answers must be those of all pages; with one of e lattice steps no answer may be off by more: receivers drawn at
//! random are held against the depth intervals of their texels, made anew from the geometry by the certificate.

use rayon::prelude::*;
use serde_json::json;
use umbrage::certify::Oracle;
use umbrage::format::Kind;
use umbrage::reader::ReaderError;
use umbrage::reader::query::Map;
use umbrage::render::{Footprints, Placement, Scene};

use crate::random::Random;
use crate::report::{Report, Table, bytes, side};
use crate::scenes::{self, Folder, LIGHTS};
use crate::{Args, Failure};

/// Pictures of the recorded views.
const PICTURE: [u32; 2] = [1280, 720];
/// Errors that are asked for, in metres along the light where the scene's unit is one.
const ERRORS: [f64; 5] = [0.01, 0.1, 1.0, 10.0, 100.0];
/// Receivers held against the geometry.
const HELD: usize = 20_000;

/// A receiver: texel, depth rounded up, level.
type Asked = ([u32; 2], u32, u8);

/// Runs the suite.
///
/// # Errors
/// A scene that can't be read or baked, or a file that can't be written.
pub fn run(args: &Args) -> Result<Report, Failure> {
    let mut report = Report::new("skip");
    let folder = Folder::new()?;
    let own: &[u64] = if args.full { &[1 << 14, 1 << 16, 1 << 20] } else { &[1 << 14] };
    let resolutions = if args.resolutions.is_empty() { own } else { &args.resolutions };
    for name in scenes::names(&args.scenes, &["city:1"]) {
        let model = scenes::load(name, args.policy)?;
        for &resolution in resolutions {
            for kind in [Kind::Mh, Kind::Vector] {
                let (baked, file) = model.bake_as(kind, LIGHTS[0], resolution, &folder)?;
                let mesh = &baked.last;
                let geometry = Scene::new(mesh);
                let oracle = Oracle::new(mesh);
                let (mut finest, mut footprint, mut exact): (Vec<Asked>, Vec<Asked>, Vec<usize>) = Default::default();
                for view in scenes::views(&geometry, &model.cameras()?, PICTURE[0], PICTURE[1]) {
                    let of = Footprints::new(&view, mesh);
                    for (i, r) in view.receivers.iter().enumerate() {
                        let Some(r) = r else { continue };
                        let (texel, depth) = (r.texel(&mesh.lattice), r.depth.query());
                        if r.placement == Placement::Exact {
                            exact.push(finest.len());
                        }
                        finest.push((texel, depth, 0));
                        footprint.push((texel, depth, (of.level_of_detail(i) >> 8) as u8));
                    }
                }
                let [_, _, along] = mesh.lattice.world_to_lattice;
                let per_metre = (along[0] * along[0] + along[1] * along[1] + along[2] * along[2]).sqrt();
                let mut random = Random::new(5, 0);
                let held: Vec<usize> =
                    (0..HELD).map(|_| exact[(random.bits() % exact.len().max(1) as u64) as usize]).collect();
                let mut table = Table::new(
                    &format!("{name}, side {}, {}: four views of 1280 x 720", side(resolution), kind.name()),
                    &[
                        "level",
                        "error asked",
                        "pages read",
                        "of",
                        "bytes",
                        "of the file",
                        "answers changed",
                        "largest error",
                    ],
                );
                for (levels, asked) in [("finest", &finest), ("footprint", &footprint)] {
                    let mut all: Vec<bool> = Vec::new();
                    let errors = ERRORS.map(|e| Some((e * per_metre) as u32));
                    for error in [None, Some(0)].into_iter().chain(errors) {
                        let container = scenes::container(&file)?;
                        let mut map = Map::new(container.structure(0)?)?;
                        map.skip(error);
                        let lit: Result<Vec<bool>, ReaderError> =
                            asked.par_iter().map(|&([x, y], depth, level)| map.is_lit(x, y, level, depth)).collect();
                        let lit = lit?;
                        if error.is_none() {
                            all.clone_from(&lit);
                        }
                        let changed = lit.iter().zip(&all).filter(|(a, b)| a != b).count();
                        // Only level 0 promises a texel's interval.
                        let off = (levels == "finest").then(|| {
                            let off = held.par_iter().map(|&i| {
                                let ([x, y], depth, _) = asked[i];
                                off(&oracle, [x, y], depth, lit[i])
                            });
                            off.max().unwrap_or(0)
                        });
                        let counters = container.counters();
                        let (read, of, total) = (
                            counters.pages,
                            map.structure().page_count(),
                            std::fs::metadata(&file).map_or(0, |m| m.len()),
                        );
                        let said = match error {
                            None => "all pages".to_string(),
                            Some(e) => format!("{e} steps, {:.2} m", f64::from(e) / per_metre),
                        };
                        table.push([
                            levels.to_string(),
                            said.clone(),
                            read.to_string(),
                            of.to_string(),
                            bytes(counters.bytes),
                            format!("{:.3}", counters.bytes as f64 / total.max(1) as f64),
                            changed.to_string(),
                            off.map_or("-".to_string(), |o| o.to_string()),
                        ]);
                        report.rows.push(json!({
                            "scene": name, "resolution": resolution, "kind": kind.name(), "levels": levels,
                            "error_steps": error, "pages_read": read, "pages": of, "bytes_read": counters.bytes,
                            "file_bytes": total, "receivers": asked.len(), "changed": changed, "largest_error": off,
                        }));
                        let what = format!("{name} {} {} {levels} {said}", side(resolution), kind.name());
                        match error {
                            None => {}
                            Some(0) => {
                                report.goal(changed == 0, format!("{what}: answers changed: 0"), changed.to_string())
                            }
                            Some(e) => {
                                if let Some(o) = off {
                                    report.goal(o <= e, format!("{what}: no answer further off"), o.to_string());
                                }
                            }
                        }
                    }
                }
                report.tables.push(table);
            }
        }
    }
    report.notes.push(format!(
        "largest error: of {HELD} receivers, how far the depth where an answer changes sides must lie from the texel's interval, in \
         lattice steps"
    ));
    Ok(report)
}

/// How far from the texel's interval any value is that gives this answer; 0 where one of the interval does.
fn off(oracle: &Oracle<'_>, [x, y]: [u32; 2], depth: u32, lit: bool) -> u32 {
    let interval = oracle.texel(x, y).interval;
    match lit {
        true => depth.saturating_sub(interval.max),
        // The value is below the depth.
        false => interval.min.saturating_sub(depth.saturating_sub(1)),
    }
}
