//! JSON schemas in the order that their author intended.
//!
//! `serde_json` keeps object fields sorted by name, but grammars make a model write fields in the order in which the schema
//! lists its properties. A model that has written its aim first follows it. `required` is an array, so its order is kept: it
//! gives the order of `properties`.

use serde::ser::{Serialize, SerializeMap, Serializer};
use serde_json::{Map, Value};

/// JSON schema that serialises its properties in the order of `required`.
#[derive(Debug)]
pub struct OrderedSchema<'a>(pub &'a Value);

impl Serialize for OrderedSchema<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self.0 {
            Value::Object(fields) => {
                let order = fields.get("required").and_then(Value::as_array);
                let mut map = serializer.serialize_map(Some(fields.len()))?;
                for (name, value) in fields {
                    match (name.as_str(), order, value) {
                        ("properties", Some(order), Value::Object(properties)) => {
                            map.serialize_entry(name, &OrderedProperties { properties, order })?;
                        }
                        _ => map.serialize_entry(name, &OrderedSchema(value))?,
                    }
                }
                map.end()
            }
            Value::Array(items) => serializer.collect_seq(items.iter().map(OrderedSchema)),
            other => other.serialize(serializer),
        }
    }
}

/// `properties` of a schema: those in `order` first, then the rest by name.
struct OrderedProperties<'a> {
    properties: &'a Map<String, Value>,
    order: &'a [Value],
}

impl Serialize for OrderedProperties<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let listed = self.order.iter().filter_map(Value::as_str);
        let listed = listed.filter_map(|name| self.properties.get_key_value(name));
        let is_listed = |name: &String| self.order.iter().any(|entry| entry.as_str() == Some(name));
        let rest = self.properties.iter().filter(|(name, _)| !is_listed(name));
        serializer.collect_map(listed.chain(rest).map(|(name, value)| (name, OrderedSchema(value))))
    }
}
