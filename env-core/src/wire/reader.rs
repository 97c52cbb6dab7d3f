//! Reading actions: a list of entries, each of one agent.

use serde_json::{Map, Value, json};

use super::fault::{Faults, Place, WireFault};
use super::number::{Wrong, integer, number, single};
use super::text::read_json;
use crate::log::{ActionLog, MAX_ENTRIES, Precision};

/// A list given as a string may be this long: [`MAX_ENTRIES`] entries written with much air.
pub const MAX_TEXT_BYTES: usize = 1 << 16;
const METADATA: &str = "metadata";
const NO_OBJECT: &str = "Input should be a valid dictionary";

/// How a world spells its actions: `{"<list>": [{"<agent>": 0, "<value>": 0.0 …} …], "metadata": {…}}`.
#[derive(Debug)]
pub(crate) struct Entries<const DIM: usize> {
    /// The field with the list.
    pub(crate) list: &'static str,
    /// What an entry is called in the schema.
    pub(crate) class: &'static str,
    /// The field with the agent's number.
    pub(crate) agent: &'static str,
    /// The fields with the values, in the order of the action space.
    pub(crate) values: [&'static str; DIM],
    /// Agents there can be; what others do is dropped.
    pub(crate) agents: u32,
    /// What the values are clamped to, either way.
    pub(crate) bound: f64,
}

impl<const DIM: usize> Entries<DIM> {
    /// Reads one action; see [`super::Wire::read_action`].
    pub(crate) fn read(&self, action: &Value, log: &mut ActionLog) -> Result<(), Vec<WireFault>> {
        let number = match log.precision() {
            Precision::F64 => number,
            Precision::F32 => single,
        };
        let mut reading = Reading { form: self, number, entries: Vec::new(), faults: Faults::default() };
        reading.action(action);
        reading.faults.none()?;
        for (agent, values) in reading.entries {
            log.act(agent, &values);
        }
        log.end_step();
        Ok(())
    }
}

/// One action as it is read.
struct Reading<'a, const DIM: usize> {
    form: &'a Entries<DIM>,
    number: fn(&Value) -> Result<f64, Wrong>,
    entries: Vec<(u32, [f64; DIM])>,
    faults: Faults,
}

impl<const DIM: usize> Reading<'_, DIM> {
    fn action(&mut self, action: &Value) {
        let Value::Object(fields) = action else {
            return self.faults.add("dict_type", Vec::new(), NO_OBJECT, action);
        };
        // In pydantic's order: what the base class has, then what the class has, then what is too much.
        if let Some(metadata) = fields.get(METADATA).filter(|value| !value.is_object()) {
            self.faults.add("dict_type", vec![METADATA.into()], NO_OBJECT, metadata);
        }
        match fields.get(self.form.list) {
            Some(text @ Value::String(_)) => self.list_in_text(text),
            Some(list) => self.list(list),
            None => {}
        }
        for (name, value) in fields {
            if self.faults.full() {
                return;
            }
            if name != METADATA && name != self.form.list {
                let loc = vec![name.as_str().into()];
                self.faults.add("extra_forbidden", loc, "Extra inputs are not permitted", value);
            }
        }
    }

    /// The list as a string, alone or within what web forms wrap around it. A string in the string is no list.
    fn list_in_text(&mut self, whole: &Value) {
        let text = whole.as_str().unwrap_or_default();
        let loc = vec![self.form.list.into()];
        if text.len() > MAX_TEXT_BYTES {
            let msg = format!("String should have at most {MAX_TEXT_BYTES} bytes");
            let ctx = json!({"max_length": MAX_TEXT_BYTES});
            return self.faults.add_with("string_too_long", loc, msg, whole, ctx);
        }
        match read_json(text) {
            Ok(value) => {
                let inner = value.get("action").unwrap_or(&value);
                self.list(inner.get(self.form.list).unwrap_or(inner));
            }
            Err(error) => {
                let why = format!("{} is a string that is not JSON: {error}", self.form.list);
                let msg = format!("Value error, {why}");
                self.faults.add_with("value_error", loc, msg, whole, json!({"error": why}));
            }
        }
    }

    fn list(&mut self, list: &Value) {
        let loc = vec![self.form.list.into()];
        let Value::Array(items) = list else {
            return self.faults.add("list_type", loc, "Input should be a valid list", list);
        };
        let count = items.len();
        if count > MAX_ENTRIES {
            let msg = format!("List should have at most {MAX_ENTRIES} items after validation, not {count}");
            let ctx = json!({"field_type": "List", "max_length": MAX_ENTRIES, "actual_length": count});
            return self.faults.add_with("too_long", loc, msg, list, ctx);
        }
        self.entries.reserve(count);
        for (i, item) in items.iter().enumerate() {
            if let Value::Object(fields) = item {
                self.entry(i, item, fields);
            } else {
                let loc = vec![self.form.list.into(), i.into()];
                let msg = format!("{NO_OBJECT} or instance of {}", self.form.class);
                self.faults.add_with("model_type", loc, msg, item, json!({"class_name": self.form.class}));
            }
        }
    }

    /// One entry; what else stands in it is ignored.
    fn entry(&mut self, i: usize, item: &Value, fields: &Map<String, Value>) {
        let agent = self.field(i, self.form.agent, item, fields, integer);
        let values = self.form.values.map(|name| self.field(i, name, item, fields, self.number));
        let agent = agent.and_then(|agent| u32::try_from(agent).ok()).filter(|&a| a < self.form.agents);
        if let Some(agent) = agent {
            // Where one is missing there is a fault, and the entry goes nowhere.
            self.entries.push((agent, values.map(Option::unwrap_or_default)));
        }
    }

    fn field<T>(
        &mut self,
        i: usize,
        name: &str,
        item: &Value,
        fields: &Map<String, Value>,
        read: fn(&Value) -> Result<T, Wrong>,
    ) -> Option<T> {
        let place = || -> Vec<Place> { vec![self.form.list.into(), i.into(), name.into()] };
        let Some(found) = fields.get(name) else {
            self.faults.add("missing", place(), "Field required", item);
            return None;
        };
        read(found).map_err(|wrong| self.faults.add(wrong.kind, place(), wrong.msg, found)).ok()
    }
}
