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

    fn markdown(&self) -> String {
        let mut text = String::new();
        for (i, row) in self.rows.iter().enumerate() {
            text += &format!("| {} |\n", row.join(" | "));
            if i == 0 {
                text += &format!("|---|{}\n", "---:|".repeat(row.len().saturating_sub(1)));
            }
        }
        text
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

    /// Tables, goals and notes as Markdown, with the machine, the commit and the command.
    fn markdown(&self) -> String {
        let machine = machine::machine();
        let mut text = format!(
            "# Suite `{}`\n\n    {}\n\n{} cores of {}, commit {}.\n",
            self.suite,
            command(std::env::args()),
            machine["cores"],
            machine["cpu"].as_str().unwrap_or("?"),
            machine::commit(),
        );
        for table in &self.tables {
            text += &format!("\n{}\n\n{}", table.title, table.markdown());
        }
        let list = |title: &str, lines: Vec<String>| match lines.is_empty() {
            true => String::new(),
            false => format!("\n## {title}\n\n- {}\n", lines.join("\n- ")),
        };
        let goals = |met: bool| {
            let some = self.goals.iter().filter(|g| g.met == met);
            some.map(|g| format!("{}: {}", g.what, g.found)).collect()
        };
        text + &list("Goals missed", goals(false))
            + &list("Goals met", goals(true))
            + &list("Notes", self.notes.clone())
    }

    /// Writes the plots, and the tables as Markdown, into a folder.
    pub fn draw(&self, folder: &Path) -> Result<(), Failure> {
        let failed = |e| Failure::target(format!("{}: {e}", folder.display()));
        std::fs::create_dir_all(folder).map_err(failed)?;
        std::fs::write(folder.join(format!("{}.md", self.suite)), self.markdown()).map_err(failed)?;
        for (name, plot) in &self.plots {
            let path = folder.join(format!("{}-{name}.svg", self.suite));
            plot.write(&path)?;
            eprintln!("{}", path.display());
        }
        Ok(())
    }
}

/// The command as one types it: arguments of the program behind the alias.
fn command(arguments: impl Iterator<Item = String>) -> String {
    let quoted = |a: String| if a.contains(char::is_whitespace) { format!("'{a}'") } else { a };
    let all: Vec<String> = arguments.skip(1).map(quoted).collect();
    format!("cargo bench-umbrage {}", all.join(" "))
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reports_are_markdown() {
        let mut report = Report::new("sizes");
        let mut table = Table::new("city:1", &["method", "bytes"]);
        table.push(["vector".to_string(), bytes(1234)]);
        report.tables.push(table);
        report.goal(false, "smallest", "mh, 3 B");
        let text = report.markdown();
        assert!(text.starts_with("# Suite `sizes`\n\n    cargo bench-umbrage"), "{text}");
        assert!(text.contains("\ncity:1\n\n| method | bytes |\n|---|---:|\n| vector | 1.2 kB |\n"), "{text}");
        assert!(text.contains("## Goals missed\n\n- smallest: mh, 3 B\n") && !text.contains("Goals met"), "{text}");
        let words = ["x", "size", "--scene", "a b"].map(str::to_string);
        assert_eq!(command(words.into_iter()), "cargo bench-umbrage size --scene 'a b'");
    }
}
