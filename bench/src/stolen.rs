//! What a virtual machine was not given: processor time that its host spent elsewhere, without which no number means much.

use crate::Row;

/// Less than this share is not worth a line.
const WORTH: f64 = 0.02;

/// Processor time since the machine started, in ticks.
pub(crate) struct Ticks {
    stolen: u64,
    all: u64,
}

impl Ticks {
    /// As Linux tells it; none elsewhere.
    pub(crate) fn now() -> Option<Self> {
        let stat = std::fs::read_to_string("/proc/stat").ok()?;
        // proc(5): user, nice, system, idle, iowait, irq, softirq, steal; what follows is in the first two already.
        let first = stat.lines().next()?.strip_prefix("cpu ")?;
        let ticks: Vec<u64> = first.split_whitespace().take(8).filter_map(|tick| tick.parse().ok()).collect();
        Some(Self { stolen: *ticks.get(7)?, all: ticks.iter().sum() })
    }

    /// A line about what was stolen since, if that was much.
    pub(crate) fn since(before: Option<Self>) -> Vec<Row> {
        let Some((before, now)) = before.zip(Self::now()) else { return Vec::new() };
        let share = (now.stolen - before.stolen) as f64 / (now.all - before.all).max(1) as f64;
        if share < WORTH {
            return Vec::new();
        }
        vec![Row {
            what: "of the processors' time meanwhile, given to others by the host".to_owned(),
            measured: format!("{:.0} %", 100.0 * share),
            goal: String::new(),
            ratio: None,
        }]
    }
}
