//! Observations as JSON, serialised straight from the simulation.

use serde::ser::{Serialize, SerializeStruct, Serializer};

use super::event::KesslerEvent;
use super::simulation::KesslerSim;
use crate::episode_rng::EpisodeRng;
use crate::json_writer::LazySeq;

/// Observation without `reward` and `done`: the same fields in the same order as in
/// [`KesslerTelemetry`](super::telemetry::KesslerTelemetry).
#[derive(Debug)]
pub(super) struct KesslerObservation<'a, R>(pub(super) &'a KesslerSim<R>);

impl<R: EpisodeRng> Serialize for KesslerObservation<'_, R> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let sim = self.0;
        let mut fields = serializer.serialize_struct("Observation", 9)?;
        fields.serialize_field("mission_objective", sim.objective().mission_text())?;
        fields.serialize_field("target_radius", &sim.objective().target_radius())?;
        let separation = sim.objective().target_separation();
        if separation != 0.0 {
            fields.serialize_field("target_separation", &separation)?;
        }
        fields.serialize_field("satellites", &LazySeq(|| sim.satellite_telemetry()))?;
        fields.serialize_field("radar_debris", &LazySeq(|| sim.debris_telemetry(false)))?;
        if let Some(conjunctions) = sim.conjunctions(false) {
            fields.serialize_field("conjunctions", &conjunctions)?;
        }
        fields.serialize_field("radar_range", &sim.reported_radar_range())?;
        let alerts = LazySeq(|| sim.events().iter().filter_map(KesslerEvent::alert));
        fields.serialize_field("critical_alerts", &alerts)?;
        fields.serialize_field("total_score", &sim.total_reward())?;
        fields.end()
    }
}
