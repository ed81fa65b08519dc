//! What the figures were measured on and with.

use std::process::Command;

use serde_json::{Value, json};

/// Processor, cores, memory.
pub fn machine() -> Value {
    json!({
        "cpu": field("/proc/cpuinfo", "model name").unwrap_or_else(|| std::env::consts::ARCH.to_string()),
        "cores": std::thread::available_parallelism().map_or(1, |n| n.get()),
        "memory_bytes": kib("/proc/meminfo", "MemTotal"),
        "system": std::env::consts::OS,
    })
}

/// The commit that is checked out; `+` behind it where files differ from it.
pub fn commit() -> String {
    let git = |arguments: &[&str]| {
        let out = Command::new("git").arg("-C").arg(env!("CARGO_MANIFEST_DIR")).args(arguments).output().ok()?;
        out.status.success().then(|| String::from_utf8_lossy(&out.stdout).trim().to_string())
    };
    let Some(commit) = git(&["rev-parse", "HEAD"]) else { return "unknown".to_string() };
    let clean = git(&["status", "--porcelain"]).is_some_and(|s| s.is_empty());
    if clean { commit } else { commit + "+" }
}

/// Largest resident memory of this process so far, bytes; 0 where the system does not say.
pub fn peak_memory() -> u64 {
    kib("/proc/self/status", "VmHWM")
}

/// Resident memory of this process now, bytes; 0 where the system does not say.
pub fn resident_memory() -> u64 {
    kib("/proc/self/status", "VmRSS")
}

fn field(file: &str, name: &str) -> Option<String> {
    let text = std::fs::read_to_string(file).ok()?;
    let line = text.lines().find(|l| l.starts_with(name))?;
    Some(line.split_once(':')?.1.trim().to_string())
}

fn kib(file: &str, name: &str) -> u64 {
    let number = field(file, name).and_then(|v| v.strip_suffix("kB")?.trim().parse::<u64>().ok());
    number.map_or(0, |k| k * 1024)
}
