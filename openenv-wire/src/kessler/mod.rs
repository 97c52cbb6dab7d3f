//! The OpenEnv protocol of kessler's tasks: fields and schemas of the public kessler-env.

mod schema;
#[cfg(test)]
mod tests;

use env_core::kessler::constants::{MAX_BURN, SATELLITES};

use crate::action_format::ActionFormat;
use crate::action_tool::FIRE_THRUSTERS;
use crate::value_kind::ValueKind;
use crate::wire_format::WorldFormat;

/// The format of all tasks of kessler.
pub(crate) static FORMAT: WorldFormat<2> =
    WorldFormat::new(BURNS, schema::action, schema::observation, FIRE_THRUSTERS);

const BURNS: ActionFormat<2> = ActionFormat {
    list_field: "burns",
    entry_model: schema::BURN,
    agent_field: "satellite_id",
    value_fields: ["delta_vx", "delta_vy"],
    max_agents: SATELLITES as u32,
    values: ValueKind::Number { bound: MAX_BURN },
};
