//! What goes to stdout, small files, and figures about the process.

use std::fs;
use std::io::Write as _;

use super::{Failure, TARGET};

/// Prints a line; a closed pipe ends the program quietly.
pub fn line(text: &str) -> Result<(), Failure> {
    writeln!(std::io::stdout().lock(), "{text}").map_err(|e| {
        let code = if e.kind() == std::io::ErrorKind::BrokenPipe { 0 } else { TARGET };
        Failure::new(code, format!("stdout: {e}"))
    })
}

/// Largest resident memory of this process so far, bytes; 0 where the system does not say.
pub fn peak_memory() -> u64 {
    let Ok(status) = fs::read_to_string("/proc/self/status") else { return 0 };
    let kib = status.lines().find_map(|l| l.strip_prefix("VmHWM:")).and_then(|l| l.trim().strip_suffix("kB"));
    kib.and_then(|k| k.trim().parse::<u64>().ok()).map_or(0, |k| k * 1024)
}

/// Memory, in the unit of `--memory` and `--budget`: 12345678 -> 11.8 MiB
pub fn mib(n: u64) -> String {
    format!("{:.1} MiB", n as f64 / f64::from(1 << 20))
}

/// What lies in files: 12345678 -> 12.3 MB
pub fn bytes(n: u64) -> String {
    let mut v = n as f64;
    for unit in ["B", "kB", "MB", "GB", "TB"] {
        if v < 999.5 || unit == "TB" {
            return if unit == "B" { format!("{n} B") } else { format!("{v:.1} {unit}") };
        }
        v /= 1000.0;
    }
    unreachable!("the last unit returns")
}
