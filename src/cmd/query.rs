//! `umbrage query`: stored depths and light or shadow for a list of points.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use umbrage::certify::Oracle;
use umbrage::reader::query::Map;
use umbrage::reader::query::{is_lit, locate};

use super::{Failure, INPUT, go_on, listen, load_scene, open, output, picture, structure};

/// Arguments of `query`.
#[derive(clap::Args)]
pub struct Args {
    /// The container, or its address on a web server
    file: PathBuf,
    /// Which light; may be left out where there is only one
    #[arg(long)]
    light: Option<String>,
    /// World points: a header x,y,z and rows. Answers x,y,z,depth,stored,lit,certified; outside the map a point is
    /// lit and depth, stored and certified are empty
    #[arg(long, value_name = "POINTS.csv", required_unless_present = "texels", conflicts_with = "texels")]
    world: Option<PathBuf>,
    /// Texels: a header x,y[,level] and rows, x and y counted at that level. Answers x,y,level,stored,certified
    #[arg(long, value_name = "POINTS.csv")]
    texels: Option<PathBuf>,
    /// The scene it was baked from: fills in `certified`
    #[arg(long, value_name = "SCENE")]
    source: Option<String>,
}

/// Runs the command.
pub fn run(args: Args) -> Result<(), Failure> {
    listen();
    let container = open(&args.file)?;
    let structure = structure(&container, args.light.as_deref())?;
    let record = structure.record();
    let from_layers = record.is_from_layers();
    if from_layers {
        let (name, promise) = (structure.name(), record.guarantee_words());
        if args.source.is_some() {
            let message =
                format!("light '{name}' was baked from depth layers, which certify no texel; leave --source out");
            return Err(Failure::new(INPUT, message));
        }
        eprintln!("light '{name}': right for {promise}");
    }
    let snapped = match &args.source {
        Some(source) => Some(picture::snapped(&load_scene(source)?, &structure)?),
        None => None,
    };
    let oracle = snapped.as_ref().map(Oracle::new);
    let map = Map::new(structure)?;
    let certified = |x: u32, y: u32| match &oracle {
        Some(o) => {
            if o.texel(x, y).certified {
                "1"
            } else {
                "0"
            }
        }
        // No texel of depth layers is certified.
        None if from_layers => "0",
        None => "",
    };
    let mut out = String::new();
    if let Some(path) = &args.world {
        out.push_str("x,y,z,depth,stored,lit,certified\n");
        for row in Rows::read(path, &["x", "y", "z"], 3)? {
            let p = [row.number(0)?, row.number(1)?, row.number(2)?];
            let text = row.fields.join(",");
            match locate(&map.lattice(), p) {
                Some((x, y, depth)) => {
                    let v = map.texel(x, y, 0)?.value;
                    let lit = u8::from(is_lit(depth, v));
                    let _ = writeln!(out, "{text},{depth},{v},{lit},{}", certified(x, y));
                }
                None => {
                    let _ = writeln!(out, "{text},,,1,");
                }
            }
            if !go_on() {
                return Err(Failure::interrupted());
            }
        }
    } else if let Some(path) = &args.texels {
        out.push_str("x,y,level,stored,certified\n");
        let finest = map.lattice().log2_resolution;
        for row in Rows::read(path, &["x", "y", "level"], 2)? {
            let level = if row.fields.len() > 2 { row.integer(2, u64::from(finest))? as u8 } else { 0 };
            let last = (1u64 << (finest - level)) - 1;
            let (x, y) = (row.integer(0, last)? as u32, row.integer(1, last)? as u32);
            let v = map.texel(x << level, y << level, level)?.value;
            let certified = if level == 0 { certified(x, y) } else { "" };
            let _ = writeln!(out, "{x},{y},{level},{v},{certified}");
            if !go_on() {
                return Err(Failure::interrupted());
            }
        }
    }
    output::line(out.trim_end())
}

/// One row of a table of points.
struct Rows {
    file: String,
    line: usize,
    fields: Vec<String>,
}

impl Rows {
    /// Reads a table whose header names at least `least` of `columns`, in order.
    fn read(path: &Path, columns: &[&str], least: usize) -> Result<Vec<Rows>, Failure> {
        let file = path.display().to_string();
        let text = std::fs::read_to_string(path).map_err(|e| {
            Failure::new(INPUT, format!("{file}: {e}; give a text file with a header {}", columns.join(",")))
        })?;
        let mut lines = text.lines().enumerate().filter(|(_, l)| !l.trim().is_empty());
        let header: Vec<String> = lines
            .next()
            .map_or(String::new(), |(_, l)| l.to_string())
            .split(',')
            .map(|f| f.trim().to_string())
            .collect();
        if header.len() < least || header.len() > columns.len() || header.iter().zip(columns).any(|(h, c)| h != c) {
            let found = header.join(",");
            return Err(Failure::new(
                INPUT,
                format!("{file}: line 1: expected the header {}, found '{found}'", columns.join(",")),
            ));
        }
        let mut rows = Vec::new();
        for (i, l) in lines {
            let fields: Vec<String> = l.split(',').map(|f| f.trim().to_string()).collect();
            if fields.len() != header.len() {
                return Err(Failure::new(
                    INPUT,
                    format!("{file}: line {}: expected {} fields, found {}", i + 1, header.len(), fields.len()),
                ));
            }
            rows.push(Rows { file: file.clone(), line: i + 1, fields });
        }
        Ok(rows)
    }

    fn number(&self, i: usize) -> Result<f64, Failure> {
        self.fields[i].parse::<f64>().ok().filter(|v| v.is_finite()).ok_or_else(|| {
            Failure::new(
                INPUT,
                format!("{}: line {}: expected a number, found '{}'", self.file, self.line, self.fields[i]),
            )
        })
    }

    fn integer(&self, i: usize, most: u64) -> Result<u64, Failure> {
        self.fields[i].parse::<u64>().ok().filter(|v| *v <= most).ok_or_else(|| {
            let (file, line, found) = (&self.file, self.line, &self.fields[i]);
            Failure::new(
                INPUT,
                format!("{file}: line {line}: expected a whole number from 0 to {most}, found '{found}'"),
            )
        })
    }
}
