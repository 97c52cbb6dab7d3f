//! How docking's tasks speak OpenEnv, in the spirit of kessler's: a list of thrusts in, its telemetry out.

mod schema;
#[cfg(test)]
mod tests;

use std::sync::LazyLock;

use serde::ser::{Serialize, SerializeStruct, Serializer};
use serde_json::Value;

use super::constants::{DOCKING_RADIUS_M, MAX_DEPUTIES, MAX_THRUST_N};
use super::flight::Flight;
use super::reward::Reward;
use super::telemetry::MISSION;
use crate::log::{ActionLog, JointAction};
use crate::wire::{Each, Entries, Wire, WireFault};

/// The wire of all tasks of docking.
#[derive(Debug)]
pub(super) struct DockingWire;

const THRUSTS: Entries<3> = Entries {
    list: "thrusts",
    class: schema::THRUST,
    agent: "deputy_id",
    values: ["thrust_x", "thrust_y", "thrust_z"],
    agents: MAX_DEPUTIES as u32,
    bound: MAX_THRUST_N,
};

static ACTION: LazyLock<Value> = LazyLock::new(schema::action);
static STRICT: LazyLock<Value> = LazyLock::new(|| THRUSTS.strict(&ACTION));
static OBSERVATION: LazyLock<Value> = LazyLock::new(schema::observation);

impl Wire for DockingWire {
    fn action_schema(&self) -> &'static Value {
        &ACTION
    }

    fn observation_schema(&self) -> &'static Value {
        &OBSERVATION
    }

    fn read_action(&self, action: &Value, log: &mut ActionLog) -> Result<(), Vec<WireFault>> {
        THRUSTS.read(action, log)
    }

    fn strict_schema(&self) -> &'static Value {
        &STRICT
    }

    fn write_action(&self, step: JointAction<'_>) -> String {
        THRUSTS.write(step)
    }
}

/// What the agents see, without `reward` and `done`, straight from the flight and the rewards of its last step: the same
/// as [`Telemetry`](super::telemetry::Telemetry) in its order of fields.
#[derive(Debug)]
pub(super) struct Observation<'a>(pub(super) &'a Flight, pub(super) &'a [Reward]);

impl Serialize for Observation<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let Self(flight, rewards) = *self;
        let mut fields = serializer.serialize_struct("Observation", 8)?;
        fields.serialize_field("mission_objective", MISSION)?;
        fields.serialize_field("time_s", &flight.time_s())?;
        fields.serialize_field("time_limit_s", &flight.time_limit_s())?;
        fields.serialize_field("thrust_bound", &flight.setup().thrust_bound)?;
        fields.serialize_field("docking_radius", &DOCKING_RADIUS_M)?;
        fields.serialize_field("deputies", &Each(|| flight.deputies_seen(rewards)))?;
        fields.serialize_field("critical_alerts", &Each(|| flight.alerts()))?;
        fields.serialize_field("total_score", &flight.total())?;
        fields.end()
    }
}
