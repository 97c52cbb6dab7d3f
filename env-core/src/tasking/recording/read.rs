//! Values of a recording by their path.

use serde_json::Value;

/// The reason why a recording cannot be read.
pub type ReadResult<T> = Result<T, String>;

/// A member of an object.
///
/// # Errors
/// Returns an error with the name if there is none.
pub fn member<'a>(value: &'a Value, name: &str) -> ReadResult<&'a Value> {
    value.get(name).ok_or_else(|| format!("`{name}` is missing"))
}

/// A number; `inf` and `null` are infinite.
///
/// # Errors
/// Returns an error if the value is none of them.
pub fn number(value: &Value) -> ReadResult<f64> {
    match value {
        Value::Number(number) => number.as_f64().ok_or_else(|| format!("{number} is not a number")),
        Value::Null => Ok(f64::INFINITY),
        Value::String(text) if text == "inf" => Ok(f64::INFINITY),
        other => Err(format!("{other} is not a number")),
    }
}

/// A whole number, if the value is one.
#[must_use]
pub fn whole(value: &Value) -> Option<u64> {
    value.as_f64().filter(|number| *number >= 0.0 && number.trunc() == *number).map(|number| number as u64)
}

/// The number of a member.
///
/// # Errors
/// Returns an error with the name if it is missing or not a number.
pub fn number_of(value: &Value, name: &str) -> ReadResult<f64> {
    number(member(value, name)?).map_err(|error| format!("`{name}`: {error}"))
}

/// The whole number of a member, up to a largest one.
///
/// # Errors
/// Returns an error with the name if it is missing, not a whole number, negative or larger.
pub fn count_of(value: &Value, name: &str, most: usize) -> ReadResult<usize> {
    let count = whole(member(value, name)?).and_then(|count| usize::try_from(count).ok());
    count
        .filter(|count| *count <= most)
        .ok_or_else(|| format!("`{name}` is not a whole number from 0 to {most}"))
}

/// The truth value of a member.
///
/// # Errors
/// Returns an error with the name if it is missing or not a truth value.
pub fn flag_of(value: &Value, name: &str) -> ReadResult<bool> {
    member(value, name)?.as_bool().ok_or_else(|| format!("`{name}` is not true or false"))
}

/// The text of a member.
///
/// # Errors
/// Returns an error with the name if it is missing or not a text.
pub fn text_of<'a>(value: &'a Value, name: &str) -> ReadResult<&'a str> {
    member(value, name)?.as_str().ok_or_else(|| format!("`{name}` is not a text"))
}

/// The list of a member.
///
/// # Errors
/// Returns an error with the name if it is missing or not a list.
pub fn list_of<'a>(value: &'a Value, name: &str) -> ReadResult<&'a [Value]> {
    member(value, name)?.as_array().map(Vec::as_slice).ok_or_else(|| format!("`{name}` is not a list"))
}

/// The texts of a list member.
///
/// # Errors
/// Returns an error with the name if it is missing or not a list of texts.
pub fn texts_of<'a>(value: &'a Value, name: &str) -> ReadResult<Vec<&'a str>> {
    list_of(value, name)?
        .iter()
        .map(|text| text.as_str().ok_or_else(|| format!("`{name}` is not a list of texts")))
        .collect()
}

/// Numbers of a list.
///
/// # Errors
/// Returns an error if the value is not a list of numbers.
pub fn numbers(value: &Value) -> ReadResult<Vec<f64>> {
    value.as_array().ok_or_else(|| "is not a list of numbers".to_owned())?.iter().map(number).collect()
}

/// A vector of three numbers.
///
/// # Errors
/// Returns an error if the value is not a list of three numbers.
pub fn vector(value: &Value) -> ReadResult<[f64; 3]> {
    numbers(value)?.try_into().map_err(|_| "is not a list of three numbers".to_owned())
}

/// The vector of a member.
///
/// # Errors
/// Returns an error with the name if it is missing or not a list of three numbers.
pub fn vector_of(value: &Value, name: &str) -> ReadResult<[f64; 3]> {
    vector(member(value, name)?).map_err(|error| format!("`{name}` {error}"))
}

/// Names of the recorded satellites, in order.
///
/// # Errors
/// Returns the reason if the recording has none.
pub fn satellite_names(recording: &Value) -> ReadResult<Vec<String>> {
    list_of(recording, "satellites")?
        .iter()
        .map(|satellite| Ok(text_of(satellite, "name")?.to_owned()))
        .collect()
}
