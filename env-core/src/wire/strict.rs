//! Writing actions: the schema that a writer can be held to, and a step in its form.

use serde::ser::{Serialize, SerializeMap, Serializer};
use serde_json::{Value, json};

use super::reader::Entries;
use crate::log::JointAction;

impl<const DIM: usize> Entries<DIM> {
    /// The schema of an action with all that [`read`](Self::read) lets pass but nobody means left out: the list is needed,
    /// numbers keep to their bounds, and nothing else may stand there. `action` is the lax schema, whose words are kept.
    pub(crate) fn strict(&self, action: &Value) -> Value {
        let (list, entry) = (&action["properties"][self.list], &action["$defs"][self.class]["properties"]);
        let agent = json!({
            "type": "integer", "minimum": 0, "maximum": self.agents.saturating_sub(1),
            "description": entry[self.agent]["description"],
        });
        let values = self.values.map(|name| {
            let about = &entry[name]["description"];
            let schema =
                json!({"type": "number", "minimum": -self.bound, "maximum": self.bound, "description": about});
            (name.to_owned(), schema)
        });
        let fields: Vec<&str> = std::iter::once(self.agent).chain(self.values).collect();
        let properties: serde_json::Map<_, _> =
            std::iter::once((self.agent.to_owned(), agent)).chain(values).collect();
        json!({
            "type": "object",
            "additionalProperties": false,
            "required": [self.list],
            "properties": {self.list: {
                "type": "array",
                "maxItems": self.agents,
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

    /// A step as an action in JSON, its fields in the order of the action space and its values within their bounds, as the
    /// environment would clamp them.
    pub(crate) fn write(&self, step: JointAction<'_>) -> String {
        let entries = step.agents.iter().zip(step.values.chunks_exact(DIM));
        let entries: Vec<_> = entries.map(|(&agent, values)| Entry { form: self, agent, values }).collect();
        // Strings as keys, and numbers: nothing in it can fail.
        serde_json::to_string(&[(self.list, entries)].into_iter().collect::<List<'_, DIM>>())
            .unwrap_or_else(|_| "{}".to_owned())
    }
}

/// The object with the list in it.
type List<'a, const DIM: usize> = std::collections::BTreeMap<&'static str, Vec<Entry<'a, DIM>>>;

struct Entry<'a, const DIM: usize> {
    form: &'a Entries<DIM>,
    agent: u32,
    values: &'a [f64],
}

impl<const DIM: usize> Serialize for Entry<'_, DIM> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut fields = serializer.serialize_map(Some(DIM + 1))?;
        fields.serialize_entry(self.form.agent, &self.agent)?;
        for (name, value) in self.form.values.iter().zip(self.values) {
            fields.serialize_entry(name, &value.clamp(-self.form.bound, self.form.bound))?;
        }
        fields.end()
    }
}
