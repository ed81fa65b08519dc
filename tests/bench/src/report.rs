//! What a suite found: tables, goals, rows for JSON, plots.

use std::path::Path;

use serde_json::{Value, json};

use crate::plot::Plot;
use crate::{Failure, machine};

/// Aligned columns.
#[derive(Debug, Default)]
pub struct Table {
    title: String,
    rows: Vec<Vec<String>>,
}

impl Table {
    /// A table with its column heads.
    pub fn new(title: &str, heads: &[&str]) -> Self {
        Table { title: title.to_string(), rows: vec![heads.iter().map(ToString::to_string).collect()] }
    }

    /// Adds a row.
    pub fn push<const N: usize>(&mut self, cells: [String; N]) {
        self.rows.push(cells.into());
    }

    fn lines(&self) -> Vec<String> {
        let columns = self.rows.iter().map(Vec::len).max().unwrap_or(0);
        let width = |c: usize| self.rows.iter().filter_map(|r| r.get(c)).map(|s| s.chars().count()).max().unwrap_or(0);
        let widths: Vec<usize> = (0..columns).map(width).collect();
        let mut lines = vec![self.title.clone()];
        for row in &self.rows {
            let mut line = String::from(" ");
            for (i, (cell, &w)) in row.iter().zip(&widths).enumerate() {
                // Names to the left, numbers to the right.
                line += &if i == 0 { format!(" {cell:<w$}") } else { format!("  {cell:>w$}") };
            }
            lines.push(line.trim_end().to_string());
        }
        lines
    }
}

/// Something the plan asks for, and whether this run shows it.
#[derive(Debug)]
pub struct Goal {
    /// What is asked.
    pub what: String,
    /// What was found.
    pub found: String,
    /// Whether that is enough.
    pub met: bool,
}

/// All that a suite found.
#[derive(Debug)]
pub struct Report {
    suite: &'static str,
    /// For people.
    pub tables: Vec<Table>,
    /// For programs.
    pub rows: Vec<Value>,
    /// Asked and found.
    pub goals: Vec<Goal>,
    /// What to know when reading the figures.
    pub notes: Vec<String>,
    /// Pictures by file name.
    pub plots: Vec<(String, Plot)>,
}

impl Report {
    /// An empty one.
    pub fn new(suite: &'static str) -> Self {
        Report { suite, tables: vec![], rows: vec![], goals: vec![], notes: vec![], plots: vec![] }
    }

    /// Notes a goal.
    pub fn goal(&mut self, met: bool, what: impl Into<String>, found: impl Into<String>) {
        self.goals.push(Goal { what: what.into(), found: found.into(), met });
    }

    fn text(&self) -> String {
        let mut lines: Vec<String> = Vec::new();
        for table in &self.tables {
            lines.extend(table.lines());
            lines.push(String::new());
        }
        for g in &self.goals {
            lines.push(format!("goal {}: {}; found {}", if g.met { "met" } else { "MISSED" }, g.what, g.found));
        }
        lines.extend(self.notes.iter().map(|n| format!("note: {n}")));
        lines.join("\n")
    }

    /// Prints the tables; or the JSON object, with the tables on stderr.
    pub fn show(&self, as_json: bool) {
        if !as_json {
            println!("{}", self.text());
            return;
        }
        eprintln!("{}", self.text());
        let goals: Vec<Value> =
            self.goals.iter().map(|g| json!({ "goal": g.what, "found": g.found, "met": g.met })).collect();
        let object = json!({
            "suite": self.suite,
            "machine": machine::machine(),
            "commit": machine::commit(),
            "command": std::env::args().collect::<Vec<_>>(),
            "rows": self.rows,
            "goals": goals,
            "notes": self.notes,
        });
        println!("{object}");
    }

    /// Writes the plots into a folder.
    pub fn draw(&self, folder: &Path) -> Result<(), Failure> {
        std::fs::create_dir_all(folder).map_err(|e| Failure::target(format!("{}: {e}", folder.display())))?;
        for (name, plot) in &self.plots {
            let path = folder.join(format!("{}-{name}.svg", self.suite));
            plot.write(&path)?;
            eprintln!("{}", path.display());
        }
        Ok(())
    }
}

/// 12345678 -> 12.3 MB
pub fn bytes(n: u64) -> String {
    let mut v = n as f64;
    for unit in ["B", "kB", "MB"] {
        if v < 999.5 {
            return if unit == "B" { format!("{n} B") } else { format!("{v:.1} {unit}") };
        }
        v /= 1000.0;
    }
    format!("{v:.1} GB")
}

/// 16384 -> 16K
pub fn side(n: u64) -> String {
    if n >= 1024 && n.is_multiple_of(1024) { format!("{}K", n / 1024) } else { n.to_string() }
}
