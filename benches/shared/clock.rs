//! The CPU's clock.

use std::fs;

/// CPU seconds of this process so far, all threads (Linux).
pub fn cpu_seconds() -> f64 {
    let stat = fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let fields: Vec<f64> =
        stat.rsplit(')').next().unwrap_or("").split_whitespace().filter_map(|f| f.parse().ok()).collect();
    // After the command's name: the state is no number, so utime and stime come 11th and 12th.
    if fields.len() > 12 { (fields[10] + fields[11]) / 100.0 } else { 0.0 }
}
