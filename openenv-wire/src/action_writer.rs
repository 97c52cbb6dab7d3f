//! Writes actions: the strict schema, and a step in that form.

use std::collections::BTreeMap;

use env_core::JointAction;
use serde::ser::{Serialize, SerializeMap, Serializer};
use serde_json::{Map, Value, json};

use crate::action_format::ActionFormat;

impl<const DIM: usize> ActionFormat<DIM> {
    /// The schema of an action without the inputs that [`read`](Self::read) tolerates but no writer intends: the list is
    /// required, numbers are within their bounds, and no extra fields are allowed. Descriptions are those of
    /// `action_schema`, the lax one.
    pub(crate) fn strict_schema(&self, action_schema: &Value) -> Value {
        let list = &action_schema["properties"][self.list_field];
        let entry = &action_schema["$defs"][self.entry_model]["properties"];
        let agent = json!({
            "type": "integer", "minimum": 0, "maximum": self.max_agents.saturating_sub(1),
            "description": entry[self.agent_field]["description"],
        });
        let values = self
            .value_fields
            .map(|name| (name.to_owned(), self.values.strict_schema(&entry[name]["description"])));
        let fields: Vec<&str> = std::iter::once(self.agent_field).chain(self.value_fields).collect();
        let properties: Map<_, _> =
            std::iter::once((self.agent_field.to_owned(), agent)).chain(values).collect();
        json!({
            "type": "object",
            "additionalProperties": false,
            "required": [self.list_field],
            "properties": {self.list_field: {
                "type": "array",
                "maxItems": self.max_agents,
                "description": list["description"],
                "items": {
                    "type": "object",
                    "additionalProperties": false,
                    "required": fields,
                    "properties": properties,
                },
            }},
        })
    }

    /// Writes a step as a JSON action: fields in the order of the action space, values clamped to their bounds as the
    /// environment would clamp them.
    pub(crate) fn write(&self, step: JointAction<'_>) -> String {
        let entries = step.agents.iter().zip(step.values.chunks_exact(DIM));
        let entries: Vec<_> =
            entries.map(|(&agent, values)| EntryJson { format: self, agent, values }).collect();
        // Serialising strings and numbers cannot fail.
        serde_json::to_string(&BTreeMap::from([(self.list_field, entries)]))
            .unwrap_or_else(|_| "{}".to_owned())
    }
}

/// One entry as a JSON object whose fields keep their order.
struct EntryJson<'a, const DIM: usize> {
    format: &'a ActionFormat<DIM>,
    agent: u32,
    values: &'a [f64],
}

impl<const DIM: usize> Serialize for EntryJson<'_, DIM> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut fields = serializer.serialize_map(Some(DIM + 1))?;
        fields.serialize_entry(self.format.agent_field, &self.agent)?;
        for (name, value) in self.format.value_fields.iter().zip(self.values) {
            fields.serialize_entry(name, &self.format.values.to_json(*value))?;
        }
        fields.end()
    }
}
