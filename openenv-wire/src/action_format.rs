//! How a world spells its actions in JSON.

use crate::value_kind::ValueKind;

/// Field names and values of a world's actions: `{"<list>": [{"<agent>": 0, "<value>": 0.0, …}, …], "metadata": {…}}`.
#[derive(Debug)]
pub(crate) struct ActionFormat<const DIM: usize> {
    /// Name of the field with the list of entries.
    pub(crate) list_field: &'static str,
    /// Name of an entry's model in the schema.
    pub(crate) entry_model: &'static str,
    /// Name of an entry's field with the agent's number.
    pub(crate) agent_field: &'static str,
    /// Names of an entry's fields with the values, in the order of the action space.
    pub(crate) value_fields: [&'static str; DIM],
    /// Largest number of agents; entries of agents from this number on are dropped.
    pub(crate) max_agents: u32,
    /// Kind of the values.
    pub(crate) values: ValueKind,
}
