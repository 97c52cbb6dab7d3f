//! The OpenEnv protocol of tasking's tasks, in the form of kessler's: a list of named actions in, telemetry out.

mod schema;
#[cfg(test)]
mod tests;
mod tools;

use env_core::TaskSpec;
use env_core::tasking::task::{IMAGING_ACTION_NAMES, MAX_SATELLITES, SCANNING_ACTION_NAMES};

use crate::action_format::ActionFormat;
use crate::action_tool::ToolFormat;
use crate::value_kind::ValueKind;
use crate::wire_format::{WireFormat, WorldFormat};

/// The format of `tasking/scanning`.
static SCANNING: WorldFormat<1> = WorldFormat::new(
    action_format(SCANNING_ACTION_NAMES),
    || schema::action(SCANNING_ACTION_NAMES),
    schema::observation,
    ToolFormat { tools: tools::scanning_tools, to_action: tools::to_action },
);

/// The format of the tasks with targets.
static IMAGING: WorldFormat<1> = WorldFormat::new(
    action_format(IMAGING_ACTION_NAMES),
    || schema::action(IMAGING_ACTION_NAMES),
    schema::observation,
    ToolFormat { tools: tools::imaging_tools, to_action: tools::to_action },
);

/// Selects the format of a task by its actions.
pub(crate) fn format(task: &dyn TaskSpec) -> &'static dyn WireFormat {
    if task.action_space().names() == SCANNING_ACTION_NAMES { &SCANNING } else { &IMAGING }
}

const fn action_format(names: &'static [&'static str]) -> ActionFormat<1> {
    ActionFormat {
        list_field: schema::ACTIONS,
        entry_model: schema::ACTION,
        agent_field: schema::SATELLITE_ID,
        value_fields: [schema::NAME],
        max_agents: MAX_SATELLITES,
        values: ValueKind::Name(names),
    }
}
