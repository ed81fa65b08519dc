//! `umbrage dump`: what is in a container, by the reader's own checks.

use std::path::PathBuf;

use rayon::prelude::*;
use umbrage::format::projection::UNCOVERED;
use umbrage::reader::query::mh::MhMap;
use umbrage::render::{RgbImage, write_png};

use super::output::{self, line};
use super::{Failure, USAGE, go_on, listen, open, structure};

/// Arguments of `dump`.
#[derive(clap::Args)]
pub struct Args {
    /// The container
    file: PathBuf,
    /// Which light; may be left out where there is only one
    #[arg(long)]
    light: Option<String>,
    /// Show one page of the light
    #[arg(long, value_name = "ID", allow_negative_numbers = true)]
    page: Option<u32>,
    /// Draw the depths of a level, near is light, uncovered is blue
    #[arg(long, value_name = "OUT.png")]
    image: Option<PathBuf>,
    /// Level of the picture; the finest that fits 1024 x 1024 without it
    #[arg(long, allow_negative_numbers = true)]
    level: Option<u8>,
}

/// Runs the command.
pub fn run(args: Args) -> Result<(), Failure> {
    listen();
    let container = open(&args.file)?;
    if let Some(ordinal) = args.page {
        let s = structure(&container, args.light.as_deref())?;
        let (r, page) = (s.page_record(ordinal)?, s.page(ordinal)?);
        line(&format!("page {ordinal} of '{}': {} words at byte {}", s.name(), r.hot_words.get(), r.offset.get()))?;
        line(&format!(
            "  texels     x {} + {}, y {} + {}",
            r.origin_x.get(),
            1u64 << r.log2_x,
            r.origin_y.get(),
            1u64 << r.log2_y
        ))?;
        line(&format!("  levels     {} to {}", r.level_coarsest, r.level_finest))?;
        line(&format!("  children   {} from page {}", r.child_count.get(), r.first_child.get()))?;
        line(&format!(
            "  depths     {} to {}; error without it {}",
            r.min_depth.get(),
            r.max_depth.get(),
            r.stop_error.get()
        ))?;
        line(&format!("  hash       {:016x}, crc {:08x}", r.content_hash.get(), r.crc32.get()))?;
        for (i, words) in page.words().chunks(8).enumerate() {
            let words: Vec<String> = words.iter().map(|w| format!("{w:08x}")).collect();
            line(&format!("  {:5}  {}", i * 8, words.join(" ")))?;
        }
        return Ok(());
    }
    if let Some(path) = &args.image {
        let s = structure(&container, args.light.as_deref())?;
        let finest = s.lattice().log2_resolution;
        let level = args.level.unwrap_or(finest.saturating_sub(10));
        if level > finest || finest - level > 14 {
            let message = format!("--level {level}: expected {} to {finest}", finest.saturating_sub(14));
            return Err(Failure::new(USAGE, message));
        }
        write_png(path, &depths(&MhMap::new(s)?, level)?)?;
        return line(&path.display().to_string());
    }
    let h = container.header();
    line(&format!(
        "{}: {}, version {}.{}, {} structures",
        container.file(),
        output::bytes(h.total_bytes.get()),
        h.version_major.get(),
        h.version_minor.get(),
        container.structure_count()
    ))?;
    for s in container.structures() {
        let r = s.record();
        let l = s.lattice();
        let nodes = [r.leaf_nodes.get(), r.inner_nodes.get(), r.empty_nodes.get()];
        let all: u64 = nodes.iter().sum();
        let texels = (f64::from(l.resolution())).powi(2);
        let d = r.light_direction.map(|c| c.get());
        line(&format!(
            "light '{}': {} of {} x {} texels, along {:.4}, {:.4}, {:.4}",
            s.name(),
            s.kind().name(),
            l.resolution(),
            l.resolution(),
            d[0],
            d[1],
            d[2]
        ))?;
        line(&format!("  nodes         {all}: {} leaves, {} inner, {} empty", nodes[0], nodes[1], nodes[2]))?;
        line(&format!("  pages         {} in {} index blocks", s.page_count(), s.block_count()))?;
        line(&format!("  policy        {}", r.policy_words()))?;
        line(&format!("  right for     {}", r.guarantee_words()))?;
        if r.is_from_layers() {
            line(&format!(
                "  edge texels   all: depths are known at texel centres only; thin {}",
                r.thin_texels.get()
            ))?;
            line("  source        depth layers")?;
            continue;
        }
        line(&format!(
            "  edge texels   {} ({:.3} %), thin {}",
            r.edge_texels.get(),
            r.edge_texels.get() as f64 / texels * 100.0,
            r.thin_texels.get()
        ))?;
        line(&format!(
            "  source        {} triangles, vertices moved by at most {:.2e}",
            r.triangles.get(),
            r.snap_displacement.get()
        ))?;
    }
    Ok(())
}

/// Depths of a level, spread over the range that occurs.
fn depths(map: &MhMap, level: u8) -> Result<RgbImage, Failure> {
    let side = map.resolution() >> level;
    let rows: Result<Vec<Vec<u32>>, Failure> = (0..side)
        .into_par_iter()
        .map(|y| {
            if !go_on() {
                return Err(Failure::interrupted());
            }
            (0..side).map(|x| Ok(map.texel(x << level, y << level, level)?.value)).collect()
        })
        .collect();
    let values: Vec<u32> = rows?.into_iter().flatten().collect();
    let covered = || values.iter().copied().filter(|v| *v != UNCOVERED);
    let (low, high) = (covered().min().unwrap_or(0), covered().max().unwrap_or(1));
    let range = f64::from(high - low).max(1.0);
    let pixel = |v: &u32| match *v {
        UNCOVERED => [28, 44, 92],
        v => [(240.0 - f64::from(v - low) / range * 215.0) as u8; 3],
    };
    Ok(RgbImage { width: side, height: side, pixels: values.iter().map(pixel).collect() })
}
