//! How kessler's tasks speak OpenEnv: the public kessler-env's action and observation, to the field.

mod schema;
#[cfg(test)]
mod tests;

use std::sync::LazyLock;

use serde::ser::{Serialize, SerializeStruct, Serializer};
use serde_json::Value;

use super::constants::{MAX_BURN, SATELLITES};
use super::event::Event;
use super::flight::Flight;
use crate::chance::Chance;
use crate::log::{ActionLog, JointAction};
use crate::wire::{Each, Entries, Wire, WireFault};

/// The wire of all tasks of kessler.
#[derive(Debug)]
pub(super) struct KesslerWire;

const BURNS: Entries<2> = Entries {
    list: "burns",
    class: schema::BURN,
    agent: "satellite_id",
    values: ["delta_vx", "delta_vy"],
    agents: SATELLITES as u32,
    bound: MAX_BURN,
};

static ACTION: LazyLock<Value> = LazyLock::new(schema::action);
static STRICT: LazyLock<Value> = LazyLock::new(|| BURNS.strict(&ACTION));
static OBSERVATION: LazyLock<Value> = LazyLock::new(schema::observation);

impl Wire for KesslerWire {
    fn action_schema(&self) -> &'static Value {
        &ACTION
    }

    fn observation_schema(&self) -> &'static Value {
        &OBSERVATION
    }

    fn read_action(&self, action: &Value, log: &mut ActionLog) -> Result<(), Vec<WireFault>> {
        BURNS.read(action, log)
    }

    fn strict_schema(&self) -> &'static Value {
        &STRICT
    }

    fn write_action(&self, step: JointAction<'_>) -> String {
        BURNS.write(step)
    }
}

/// What the agents see, without `reward` and `done`, straight from the flight: the same as
/// [`Telemetry`](super::telemetry::Telemetry) in its order of fields.
#[derive(Debug)]
pub(super) struct Observation<'a, C>(pub(super) &'a Flight<C>);

impl<C: Chance> Serialize for Observation<'_, C> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let flight = self.0;
        let mut fields = serializer.serialize_struct("Observation", 9)?;
        fields.serialize_field("mission_objective", flight.objective().mission())?;
        fields.serialize_field("target_radius", &flight.objective().target_radius())?;
        let separation = flight.objective().target_separation();
        if separation != 0.0 {
            fields.serialize_field("target_separation", &separation)?;
        }
        fields.serialize_field("satellites", &Each(|| flight.satellites_seen()))?;
        fields.serialize_field("radar_debris", &Each(|| flight.debris_seen(false)))?;
        if let Some(conjunctions) = flight.conjunctions(false) {
            fields.serialize_field("conjunctions", &conjunctions)?;
        }
        fields.serialize_field("radar_range", &flight.range_told())?;
        fields
            .serialize_field("critical_alerts", &Each(|| flight.events().iter().filter_map(Event::alert)))?;
        fields.serialize_field("total_score", &flight.total())?;
        fields.end()
    }
}
