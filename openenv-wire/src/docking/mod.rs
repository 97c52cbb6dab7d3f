//! The OpenEnv protocol of docking's tasks, in the form of kessler's: a list of thrusts in, telemetry out.

mod schema;
#[cfg(test)]
mod tests;

use env_core::docking::constants::{MAX_DEPUTIES, MAX_THRUST_N};

use crate::action_format::ActionFormat;
use crate::action_tool::FIRE_THRUSTERS;
use crate::value_kind::ValueKind;
use crate::wire_format::WorldFormat;

/// The format of all tasks of docking.
pub(crate) static FORMAT: WorldFormat<3> =
    WorldFormat::new(THRUSTS, schema::action, schema::observation, FIRE_THRUSTERS);

const THRUSTS: ActionFormat<3> = ActionFormat {
    list_field: "thrusts",
    entry_model: schema::THRUST,
    agent_field: "deputy_id",
    value_fields: ["thrust_x", "thrust_y", "thrust_z"],
    max_agents: MAX_DEPUTIES as u32,
    values: ValueKind::Number { bound: MAX_THRUST_N },
};
