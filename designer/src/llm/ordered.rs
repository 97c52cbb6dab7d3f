//! JSON schemas in the order their author meant. A JSON object has no order, and ours are kept sorted by name; but
//! grammars make a model say an object's fields in the order the schema lists them, and a model that has said its aim
//! first keeps to it. `required` is a list: its order is the order of `properties`.

use serde::ser::{Serialize, SerializeMap, Serializer};
use serde_json::{Map, Value};

/// A schema that is written with its properties in the order of `required`.
pub(super) struct Ordered<'a>(pub(super) &'a Value);

impl Serialize for Ordered<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self.0 {
            Value::Object(fields) => {
                let order = fields.get("required").and_then(Value::as_array);
                let mut map = serializer.serialize_map(Some(fields.len()))?;
                for (name, value) in fields {
                    match (name.as_str(), order, value) {
                        ("properties", Some(order), Value::Object(properties)) => {
                            map.serialize_entry(name, &Properties { properties, order })?;
                        }
                        _ => map.serialize_entry(name, &Ordered(value))?,
                    }
                }
                map.end()
            }
            Value::Array(items) => serializer.collect_seq(items.iter().map(Ordered)),
            other => other.serialize(serializer),
        }
    }
}

struct Properties<'a> {
    properties: &'a Map<String, Value>,
    order: &'a [Value],
}

impl Serialize for Properties<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let first = self.order.iter().filter_map(Value::as_str);
        let first = first.filter_map(|name| self.properties.get_key_value(name));
        let named = |name: &String| self.order.iter().any(|n| n.as_str() == Some(name));
        let rest = self.properties.iter().filter(|(name, _)| !named(name));
        serializer.collect_map(first.chain(rest).map(|(name, value)| (name, Ordered(value))))
    }
}
