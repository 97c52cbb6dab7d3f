//! Observations as JSON, serialised straight from the simulation.

use serde::ser::{Serialize, SerializeStruct, Serializer};

use super::constants::DOCKING_RADIUS_M;
use super::reward::DockingReward;
use super::simulation::DockingSim;
use super::telemetry::MISSION_TEXT;
use crate::json_writer::LazySeq;

/// Observation of all agents without `reward` and `done`: the same fields in the same order as
/// [`DockingTelemetry`](super::telemetry::DockingTelemetry).
#[derive(Debug)]
pub(super) struct DockingObservation<'a> {
    pub(super) sim: &'a DockingSim,
    /// Rewards of the last step, by deputy.
    pub(super) rewards: &'a [DockingReward],
}

impl Serialize for DockingObservation<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let Self { sim, rewards } = *self;
        let mut fields = serializer.serialize_struct("Observation", 8)?;
        fields.serialize_field("mission_objective", MISSION_TEXT)?;
        fields.serialize_field("time_s", &sim.time_s())?;
        fields.serialize_field("time_limit_s", &sim.time_limit_s())?;
        fields.serialize_field("thrust_bound", &sim.setup().thrust_bound)?;
        fields.serialize_field("docking_radius", &DOCKING_RADIUS_M)?;
        fields.serialize_field("deputies", &LazySeq(|| sim.deputies_telemetry(rewards)))?;
        fields.serialize_field("critical_alerts", &LazySeq(|| sim.alerts()))?;
        fields.serialize_field("total_score", &sim.total())?;
        fields.end()
    }
}
