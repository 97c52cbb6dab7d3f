//! What an action looks like on the wire, by its JSON schema: how doing nothing is said, how a built-in policy's action is,
//! and what is wrong with an action.

use std::sync::Arc;

use env_core::{JointAction, TaskSpec};
use serde::{Serialize, Serializer};
use serde_json::{Map, Value, json};

use super::kessler;

/// How deep schemas and values are followed.
const DEPTH: usize = 16;
/// Characters of a value that are repeated in a sentence.
const REPEATED: usize = 40;

/// An action's JSON schema that nothing can be said by.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("the JSON schema of {task}'s actions {reason}")]
pub struct ActionsError {
    /// The task.
    pub task: &'static str,
    /// What is wrong.
    pub reason: &'static str,
}

/// Actions of a task.
#[derive(Debug, Clone, PartialEq)]
pub struct Actions {
    schema: Arc<Value>,
    list: Option<List>,
}

/// The one list that an action consists of, and the fields of its entries: whose it is, then its numbers.
#[derive(Debug, Clone, PartialEq, Eq)]
struct List {
    name: String,
    fields: Vec<String>,
}

impl Actions {
    /// The actions of a task. `told` is the schema that its server tells; kessler's is known better here.
    ///
    /// # Errors
    /// A schema that is none of an object, or none where one is needed.
    pub fn new(task: &dyn TaskSpec, told: Option<&Value>) -> Result<Self, ActionsError> {
        let fault = |reason| ActionsError { task: task.id(), reason };
        if kessler::flies(task) {
            return Ok(Self::of(kessler::action_schema()));
        }
        let told = told.ok_or(fault("is not known; its server must tell it"))?;
        let mut schema = inlined(told, told, DEPTH).ok_or(fault("refers to what is not in it"))?;
        if !schema.get("properties").is_some_and(Value::is_object) {
            return Err(fault("is none of an object with properties"));
        }
        if let Some(fields) = schema.as_object_mut() {
            fields.remove("$defs");
        }
        // Openenv-core's own, and nothing that an agent does.
        if let Some(properties) = schema["properties"].as_object_mut() {
            properties.remove("metadata");
        }
        Ok(Self::of(schema))
    }

    fn of(schema: Value) -> Self {
        let list = list(&schema);
        Self { schema: Arc::new(schema), list }
    }

    /// The JSON schema that answers are held to.
    #[must_use]
    pub fn schema(&self) -> &Arc<Value> {
        &self.schema
    }

    /// Doing nothing: every list is empty.
    #[must_use]
    pub fn hold(&self) -> Value {
        let properties = self.schema["properties"].as_object().into_iter().flatten();
        let lists = properties.filter(|(_, schema)| schema["type"] == "array");
        lists.map(|(name, _)| (name.clone(), json!([]))).collect::<Map<_, _>>().into()
    }

    /// An action as text, its fields in the order that the schema requires them in, as who is held to it writes them.
    #[must_use]
    pub fn text(&self, action: &Value) -> String {
        let ordered = InOrder { schema: &self.schema, value: action };
        serde_json::to_string(&ordered).unwrap_or_else(|_| action.to_string())
    }

    /// A step of a log with `dim` values an entry; none where the schema is not one list of entries with that many.
    #[must_use]
    pub fn encode(&self, action: JointAction<'_>, dim: usize) -> Option<Value> {
        let List { name, fields } = self.list.as_ref().filter(|list| list.fields.len() == dim + 1)?;
        let entry = |(agent, values): (&u32, &[f64])| {
            let cells = std::iter::once(json!(agent)).chain(values.iter().map(|value| json!(value)));
            Value::Object(fields.iter().cloned().zip(cells).collect())
        };
        let entries: Vec<Value> =
            action.agents.iter().zip(action.values.chunks_exact(dim)).map(entry).collect();
        Some(json!({ name: entries }))
    }

    /// What is meant, where that is plain: an action within `action`, a bare list of entries, whole numbers written as
    /// `1.0`, numbers beyond their bounds (environments clamp them); properties nobody knows are left out.
    #[must_use]
    pub fn tidied(&self, mut value: Value) -> Value {
        let known = |name: &str| self.schema["properties"].get(name).is_some();
        if let Some(Value::Object(inner)) = value.get_mut("action").filter(|_| !known("action")) {
            value = Value::Object(std::mem::take(inner));
        }
        if let (Value::Array(items), Some(list)) = (&value, &self.list)
            && items.iter().all(Value::is_object)
        {
            value = json!({ &list.name: value });
        }
        if let Value::Object(fields) = &mut value {
            fields.retain(|name, _| known(name));
        }
        fit(&self.schema, &mut value, DEPTH);
        value
    }

    /// Whether an object has to do with actions at all.
    #[must_use]
    pub fn resembles(&self, value: &Value) -> bool {
        let properties = self.schema["properties"].as_object();
        properties.is_some_and(|properties| properties.keys().any(|name| value.get(name).is_some()))
    }

    /// The names of what an action has.
    pub(super) fn names(&self) -> String {
        let properties = self.schema["properties"].as_object().into_iter().flatten();
        properties.map(|(name, _)| name.as_str()).collect::<Vec<_>>().join(", ")
    }

    /// Whether it is an action.
    ///
    /// # Errors
    /// What is wrong, in half a sentence that names the field.
    pub fn check(&self, value: &Value) -> Result<(), String> {
        check(&self.schema, value, "", DEPTH)
    }
}

/// A value that is written in the order of its schema; an object of serde_json keeps none.
struct InOrder<'a> {
    schema: &'a Value,
    value: &'a Value,
}

impl Serialize for InOrder<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let inside = |schema, value| InOrder { schema, value };
        match self.value {
            Value::Object(fields) => {
                let required = self.schema["required"].as_array().into_iter().flatten();
                let order: Vec<&str> = required.filter_map(Value::as_str).collect();
                let first = order.iter().filter_map(|name| fields.get_key_value(*name));
                let rest = fields.iter().filter(|(name, _)| !order.contains(&name.as_str()));
                let of = &self.schema["properties"];
                serializer
                    .collect_map(first.chain(rest).map(|(name, value)| (name, inside(&of[name], value))))
            }
            Value::Array(items) => {
                serializer.collect_seq(items.iter().map(|item| inside(&self.schema["items"], item)))
            }
            other => other.serialize(serializer),
        }
    }
}

/// The schema with what it refers to put in its places.
fn inlined(schema: &Value, root: &Value, depth: usize) -> Option<Value> {
    let depth = depth.checked_sub(1)?;
    match schema {
        Value::Object(fields) => {
            if let Some(path) = fields.get("$ref").and_then(Value::as_str) {
                return inlined(root.pointer(path.strip_prefix('#')?)?, root, depth);
            }
            let inner = fields.iter().map(|(name, value)| Some((name.clone(), inlined(value, root, depth)?)));
            inner.collect::<Option<Map<_, _>>>().map(Value::Object)
        }
        Value::Array(items) => items.iter().map(|item| inlined(item, root, depth)).collect(),
        other => Some(other.clone()),
    }
}

/// The one list of entries, if there is one such list and nothing else.
fn list(schema: &Value) -> Option<List> {
    let mut properties = schema["properties"].as_object()?.iter();
    let (Some((name, list)), None) = (properties.next(), properties.next()) else { return None };
    let (items, of) = (&list["items"], &list["items"]["properties"]);
    let required = items["required"].as_array()?.iter().map(|name| name.as_str().map(str::to_owned));
    let fields: Vec<String> = required.collect::<Option<_>>()?;
    let (whose, numbers) = fields.split_first()?;
    let sound = of[whose]["type"] == "integer" && numbers.iter().all(|name| of[name]["type"] == "number");
    sound.then(|| List { name: name.clone(), fields })
}

/// Makes numbers what a schema says, where that is plain.
fn fit(schema: &Value, value: &mut Value, depth: usize) {
    let Some(depth) = depth.checked_sub(1) else { return };
    match value {
        Value::Object(fields) => {
            for (name, value) in fields {
                fit(&schema["properties"][name], value, depth);
            }
        }
        Value::Array(items) => items.iter_mut().for_each(|item| fit(&schema["items"], item, depth)),
        Value::Number(number) => {
            let Some(given) = number.as_f64() else { return };
            let whole = given.fract() == 0.0 && given.abs() < 1e9;
            if schema["type"] == "integer" && number.is_f64() && whole {
                *value = json!(given as i64);
            } else if schema["type"] == "number" {
                let low = schema["minimum"].as_f64().filter(|low| given < *low);
                let high = schema["maximum"].as_f64().filter(|high| given > *high);
                if let Some(bound) = low.or(high) {
                    *value = json!(bound);
                }
            }
        }
        _ => {}
    }
}

/// The keywords of JSON Schema that actions use; what else a schema asks for is for the environment to judge.
fn check(schema: &Value, value: &Value, at: &str, depth: usize) -> Result<(), String> {
    let depth = depth.checked_sub(1).ok_or_else(|| format!("{}is too deep", place(at)))?;
    let wrong = |what: String| Err(format!("{}{what}", place(at)));
    if let Some(kinds) = schema.get("anyOf").and_then(Value::as_array) {
        let mut checked = kinds.iter().map(|kind| check(kind, value, at, depth));
        return match checked.next() {
            Some(Err(first)) if !checked.any(|other| other.is_ok()) => Err(first),
            _ => Ok(()),
        };
    }
    if let Some(kind) = schema["type"].as_str().filter(|kind| !is(value, kind)) {
        return wrong(format!("{} is wanted, not {}", wanted(kind), shown(value)));
    }
    let allowed = schema["enum"].as_array();
    if allowed.is_some_and(|allowed| !allowed.contains(value)) {
        return wrong(format!("one of {} is wanted, not {}", schema["enum"], shown(value)));
    }
    match value {
        Value::Object(fields) => {
            for name in schema["required"].as_array().into_iter().flatten().filter_map(Value::as_str) {
                if !fields.contains_key(name) {
                    return wrong(format!("{name} is missing"));
                }
            }
            for (name, value) in fields {
                match schema["properties"].get(name) {
                    Some(of) => check(of, value, &inside(at, name), depth)?,
                    None if schema["additionalProperties"] == false => {
                        return wrong(format!("{} is not known", shown(&json!(name))));
                    }
                    None => {}
                }
            }
        }
        Value::Array(items) => {
            let most = schema["maxItems"].as_u64().unwrap_or(u64::MAX);
            if items.len() as u64 > most {
                return wrong(format!("there are {}, and at most {most} may be", items.len()));
            }
            if let Some(of) = schema.get("items") {
                for (index, item) in items.iter().enumerate() {
                    check(of, item, &inside(at, &index.to_string()), depth)?;
                }
            }
        }
        Value::Number(number) => {
            let (low, high) = (schema["minimum"].as_f64(), schema["maximum"].as_f64());
            let given = number.as_f64().unwrap_or(f64::NAN);
            if low.is_some_and(|low| given < low) || high.is_some_and(|high| given > high) {
                let bound = |bound: Option<f64>| bound.map_or_else(|| "any".to_owned(), env_core::told);
                return wrong(format!("{number} is outside {} to {}", bound(low), bound(high)));
            }
        }
        _ => {}
    }
    Ok(())
}

fn is(value: &Value, kind: &str) -> bool {
    match kind {
        "object" => value.is_object(),
        "array" => value.is_array(),
        "integer" => value.is_i64() || value.is_u64(),
        "number" => value.is_number(),
        "string" => value.is_string(),
        "boolean" => value.is_boolean(),
        "null" => value.is_null(),
        _ => true,
    }
}

fn wanted(kind: &str) -> &'static str {
    match kind {
        "object" => "an object",
        "array" => "a list",
        "integer" => "a whole number",
        "number" => "a number",
        "string" => "a text",
        "boolean" => "true or false",
        _ => "something else",
    }
}

/// A value in a sentence, in one line.
fn shown(value: &Value) -> String {
    let text = value.to_string();
    if text.chars().count() <= REPEATED {
        return text;
    }
    text.chars().take(REPEATED - 3).chain("...".chars()).collect()
}

fn place(at: &str) -> String {
    if at.is_empty() { String::new() } else { format!("{at}: ") }
}

fn inside(at: &str, name: &str) -> String {
    let name: String = name.chars().take(REPEATED).collect();
    if at.is_empty() { name } else { format!("{at}.{name}") }
}
