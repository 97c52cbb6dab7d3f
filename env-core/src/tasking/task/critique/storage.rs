//! Periods between two times at which a satellite sent data, which the modes `full` and `pass_missed` look at.

use super::trace::{SatelliteTrace, TaskingTrace};
use crate::tasking::access::{Opportunity, OpportunityKind};

/// Ticks in which a satellite sent no data: from the first to the last, while it lived.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct StoragePeriod {
    /// First tick of the period.
    pub first: u64,
    /// Last tick of the period.
    pub last: u64,
}

impl StoragePeriod {
    /// The periods of a satellite, in order.
    pub(super) fn all(satellite: &SatelliteTrace) -> Vec<Self> {
        let mut periods: Vec<Self> = Vec::new();
        let mut open: Option<Self> = None;
        for tick in 0..=satellite.last_tick() {
            if satellite.sample(tick).has_sent {
                periods.extend(open.take());
                continue;
            }
            open =
                Some(open.map_or(Self { first: tick, last: tick }, |period| Self { last: tick, ..period }));
        }
        periods.extend(open);
        periods
    }

    /// The ticks of the period.
    pub(super) fn ticks(self) -> impl Iterator<Item = u64> {
        self.first..=self.last
    }
}

/// Passes of a satellite over ground stations that are open at a time, s, or open later, in order of opening.
pub(super) fn passes_after(trace: &TaskingTrace, agent: usize, time_s: f64) -> Vec<Opportunity> {
    let upcoming = trace.run.sim.opportunities(agent).upcoming(OpportunityKind::GroundStation, time_s);
    let mut passes = upcoming.to_vec();
    passes.sort_by(|a, b| a.open_s.total_cmp(&b.open_s));
    passes
}

/// Name of the station of a pass.
pub(super) fn station_name(trace: &TaskingTrace, pass: &Opportunity) -> String {
    let station = trace.run.sim.stations().get(pass.object);
    station.map_or_else(|| format!("station {}", pass.object), |station| station.name.clone())
}
