//! Reads actions: a list of entries, each for one agent.

use env_core::log::{ActionLog, MAX_ENTRIES, Precision};
use serde_json::{Map, Value, json};

use crate::action_format::ActionFormat;
use crate::number::parse_integer;
use crate::python_json::parse_python_json;
use crate::validation_error::{ErrorCollector, LocSegment, ValidationError};
use crate::value_kind::ValueError;

/// Largest length of a list that is sent as a string, in bytes: room for [`MAX_ENTRIES`] generously spaced entries.
pub const MAX_TEXT_BYTES: usize = 1 << 16;

const METADATA: &str = "metadata";
const DICT_EXPECTED: &str = "Input should be a valid dictionary";

impl<const DIM: usize> ActionFormat<DIM> {
    /// Reads one action; see [`WireFormat::read_action`](crate::WireFormat::read_action).
    pub(crate) fn read(&self, action: &Value, log: &mut ActionLog) -> Result<(), Vec<ValidationError>> {
        let mut reader = ActionReader {
            format: self,
            precision: log.precision(),
            entries: Vec::new(),
            errors: ErrorCollector::default(),
        };
        reader.read_action(action);
        reader.errors.into_result()?;
        for entry in reader.entries {
            log.push_entry(entry.agent, &entry.values);
        }
        log.end_step();
        Ok(())
    }
}

/// State while one action is read.
struct ActionReader<'a, const DIM: usize> {
    format: &'a ActionFormat<DIM>,
    precision: Precision,
    entries: Vec<ActionEntry<DIM>>,
    errors: ErrorCollector,
}

/// Action of one agent.
struct ActionEntry<const DIM: usize> {
    agent: u32,
    values: [f64; DIM],
}

/// A JSON entry and its index in the list.
#[derive(Clone, Copy)]
struct JsonEntry<'a> {
    index: usize,
    item: &'a Value,
    fields: &'a Map<String, Value>,
}

impl<const DIM: usize> ActionReader<'_, DIM> {
    fn read_action(&mut self, action: &Value) {
        let Value::Object(fields) = action else {
            return self.errors.add("dict_type", Vec::new(), DICT_EXPECTED, action);
        };
        // Pydantic's order: fields of the base class, fields of the class, then extra fields.
        if let Some(metadata) = fields.get(METADATA).filter(|value| !value.is_object()) {
            self.errors.add("dict_type", vec![METADATA.into()], DICT_EXPECTED, metadata);
        }
        match fields.get(self.format.list_field) {
            Some(text @ Value::String(_)) => self.read_list_text(text),
            Some(list) => self.read_list(list),
            None => {}
        }
        for (name, value) in fields {
            if self.errors.is_full() {
                return;
            }
            if name != METADATA && name != self.format.list_field {
                let loc = vec![name.as_str().into()];
                self.errors.add("extra_forbidden", loc, "Extra inputs are not permitted", value);
            }
        }
    }

    /// Reads a list that is sent as a string, alone or inside the wrapper that web forms add. A string within that string
    /// is not a list.
    fn read_list_text(&mut self, input: &Value) {
        let text = input.as_str().unwrap_or_default();
        let loc = vec![self.format.list_field.into()];
        if text.len() > MAX_TEXT_BYTES {
            let msg = format!("String should have at most {MAX_TEXT_BYTES} bytes");
            let ctx = json!({"max_length": MAX_TEXT_BYTES});
            return self.errors.add_with_context("string_too_long", loc, msg, input, ctx);
        }
        match parse_python_json(text) {
            Ok(value) => {
                let inner = value.get("action").unwrap_or(&value);
                self.read_list(inner.get(self.format.list_field).unwrap_or(inner));
            }
            Err(error) => {
                let reason = format!("{} is a string that is not JSON: {error}", self.format.list_field);
                let msg = format!("Value error, {reason}");
                self.errors.add_with_context("value_error", loc, msg, input, json!({"error": reason}));
            }
        }
    }

    fn read_list(&mut self, list: &Value) {
        let loc = vec![self.format.list_field.into()];
        let Value::Array(items) = list else {
            return self.errors.add("list_type", loc, "Input should be a valid list", list);
        };
        let count = items.len();
        if count > MAX_ENTRIES {
            let msg = format!("List should have at most {MAX_ENTRIES} items after validation, not {count}");
            let ctx = json!({"field_type": "List", "max_length": MAX_ENTRIES, "actual_length": count});
            return self.errors.add_with_context("too_long", loc, msg, list, ctx);
        }
        self.entries.reserve(count);
        for (index, item) in items.iter().enumerate() {
            if let Value::Object(fields) = item {
                self.read_entry(JsonEntry { index, item, fields });
            } else {
                let model = self.format.entry_model;
                let loc = vec![self.format.list_field.into(), index.into()];
                let msg = format!("{DICT_EXPECTED} or instance of {model}");
                self.errors.add_with_context("model_type", loc, msg, item, json!({"class_name": model}));
            }
        }
    }

    /// Reads one entry; unknown fields of it are ignored.
    fn read_entry(&mut self, entry: JsonEntry<'_>) {
        let agent = self
            .read_field(entry, self.format.agent_field, |value| Ok::<_, ValueError>(parse_integer(value)?));
        let (kind, precision) = (self.format.values, self.precision);
        let values = self
            .format
            .value_fields
            .map(|name| self.read_field(entry, name, |value| kind.parse(value, precision)));
        let agent = agent.and_then(|agent| u32::try_from(agent).ok());
        if let Some(agent) = agent.filter(|&agent| agent < self.format.max_agents) {
            // A missing value is an error, which discards all entries.
            self.entries.push(ActionEntry { agent, values: values.map(Option::unwrap_or_default) });
        }
    }

    fn read_field<T>(
        &mut self,
        entry: JsonEntry<'_>,
        name: &str,
        parse: impl Fn(&Value) -> Result<T, ValueError>,
    ) -> Option<T> {
        let loc =
            || -> Vec<LocSegment> { vec![self.format.list_field.into(), entry.index.into(), name.into()] };
        let Some(value) = entry.fields.get(name) else {
            self.errors.add("missing", loc(), "Field required", entry.item);
            return None;
        };
        parse(value)
            .map_err(|ValueError { kind, msg, ctx }| {
                self.errors.push(kind, loc(), msg.into_owned(), value, ctx);
            })
            .ok()
    }
}
