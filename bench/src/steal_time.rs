//! Steal time: processor time that the host of a virtual machine gave to others. Measurements are unreliable if it is high.

use crate::Row;

/// Smallest share of steal time that is reported.
const MIN_SHARE: f64 = 0.02;

/// Processor time since the machine started, in clock ticks.
pub(crate) struct Ticks {
    stolen: u64,
    total: u64,
}

impl Ticks {
    /// Reads the counters of Linux; returns `None` on other systems.
    pub(crate) fn now() -> Option<Self> {
        let stat = std::fs::read_to_string("/proc/stat").ok()?;
        // proc(5): user, nice, system, idle, iowait, irq, softirq, steal. Later fields are part of the first two.
        let first = stat.lines().next()?.strip_prefix("cpu ")?;
        let ticks: Vec<u64> = first.split_whitespace().take(8).filter_map(|tick| tick.parse().ok()).collect();
        Some(Self { stolen: *ticks.get(7)?, total: ticks.iter().sum() })
    }

    /// Returns a row with the steal time since `before` if it is at least 2 %.
    pub(crate) fn rows_since(before: Option<Self>) -> Vec<Row> {
        let Some((before, now)) = before.zip(Self::now()) else { return Vec::new() };
        let share = (now.stolen - before.stolen) as f64 / (now.total - before.total).max(1) as f64;
        if share < MIN_SHARE {
            return Vec::new();
        }
        vec![Row {
            label: "steal time of this benchmark".to_owned(),
            measured: format!("{:.0} %", 100.0 * share),
            goal: String::new(),
            ratio: None,
        }]
    }
}
