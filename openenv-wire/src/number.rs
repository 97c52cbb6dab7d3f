//! Numbers by pydantic's lax rules: a JSON number, a boolean or a string is accepted.

use serde_json::Value;

/// Largest number of digits from which pydantic, and Python, read an integer in a string.
const MAX_DIGITS: usize = 4300;
/// 2⁶³: pydantic reads no integer from a float of this magnitude or more.
const FLOAT_LIMIT: f64 = 9_223_372_036_854_775_808.0;

/// The reason why a value is not a number, in pydantic's words.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NumberError {
    /// Kind of error in pydantic's vocabulary.
    pub kind: &'static str,
    /// Description of the value that was expected.
    pub msg: &'static str,
}

const INT_TYPE: NumberError = NumberError { kind: "int_type", msg: "Input should be a valid integer" };
const INT_FROM_FLOAT: NumberError = NumberError {
    kind: "int_from_float",
    msg: "Input should be a valid integer, got a number with a fractional part",
};
const INT_PARSING: NumberError = NumberError {
    kind: "int_parsing",
    msg: "Input should be a valid integer, unable to parse string as an integer",
};
const INT_PARSING_SIZE: NumberError = NumberError {
    kind: "int_parsing_size",
    msg: "Unable to parse input string as an integer, exceeded maximum size",
};
const FLOAT_TYPE: NumberError = NumberError { kind: "float_type", msg: "Input should be a valid number" };
const FLOAT_PARSING: NumberError = NumberError {
    kind: "float_parsing",
    msg: "Input should be a valid number, unable to parse string as a number",
};
const NOT_FINITE: NumberError = NumberError { kind: "finite_number", msg: "Input should be a finite number" };

/// Reads an integer. One beyond 64 bits saturates.
///
/// # Errors
/// Returns pydantic's error if the value is not an integer by its lax rules, and `finite_number` for NaN and infinities.
pub fn parse_integer(value: &Value) -> Result<i64, NumberError> {
    match value {
        Value::Bool(truth) => Ok(i64::from(*truth)),
        Value::String(text) => parse_integer_text(text.trim()),
        Value::Number(number) => match (number.as_i64(), number.as_f64()) {
            (Some(integer), _) => Ok(integer),
            (None, _) if number.is_u64() => Ok(i64::MAX),
            (None, Some(float)) => integer_from_float(float),
            (None, None) => Err(INT_TYPE),
        },
        Value::Null | Value::Array(_) | Value::Object(_) => Err(INT_TYPE),
    }
}

/// Reads a finite number.
///
/// # Errors
/// Returns pydantic's error if the value is not a number by its lax rules, and `finite_number` for NaN and infinities.
pub fn parse_number(value: &Value) -> Result<f64, NumberError> {
    match value {
        Value::Bool(truth) => Ok(f64::from(u8::from(*truth))),
        Value::String(text) => parse_number_text(text.trim()),
        Value::Number(number) => require_finite(number.as_f64().ok_or(FLOAT_TYPE)?),
        Value::Null | Value::Array(_) | Value::Object(_) => Err(FLOAT_TYPE),
    }
}

/// Reads a number that is finite in single precision, too.
pub(crate) fn parse_single(value: &Value) -> Result<f64, NumberError> {
    parse_number(value).and_then(|v| if v.abs() <= f64::from(f32::MAX) { Ok(v) } else { Err(NOT_FINITE) })
}

#[expect(clippy::cast_possible_truncation, reason = "exact without a fraction and within bounds")]
fn integer_from_float(value: f64) -> Result<i64, NumberError> {
    if value.fract() != 0.0 {
        Err(INT_FROM_FLOAT)
    } else if value.abs() >= FLOAT_LIMIT {
        Err(INT_PARSING_SIZE)
    } else {
        Ok(value as i64)
    }
}

/// Reads an optional sign, digits (groups may be joined by single underscores) and an optional fraction of zeros.
fn parse_integer_text(text: &str) -> Result<i64, NumberError> {
    let (negative, digits) = match text.as_bytes().first() {
        Some(b'-') => (true, &text[1..]),
        Some(b'+') => (false, &text[1..]),
        _ => (false, text),
    };
    let whole = match digits.split_once('.') {
        Some((whole, zeros)) if !zeros.is_empty() && zeros.bytes().all(|b| b == b'0') => whole,
        Some(_) => return Err(not_an_integer(text)),
        None => digits,
    };
    let is_group = |group: &str| !group.is_empty() && group.bytes().all(|b| b.is_ascii_digit());
    if !whole.split('_').all(is_group) {
        return Err(not_an_integer(text));
    }
    let significant = whole.trim_start_matches(['0', '_']).bytes().filter(|&b| b != b'_');
    let (mut count, mut value) = (0, 0i64);
    for digit in significant {
        count += 1;
        let digit = i64::from(digit - b'0');
        value = value.saturating_mul(10);
        value = if negative { value.saturating_sub(digit) } else { value.saturating_add(digit) };
    }
    if count > MAX_DIGITS { Err(INT_PARSING_SIZE) } else { Ok(value) }
}

/// The error of a string that is not an integer. Pydantic reports `int_parsing` for "nan" as well; here NaN is always
/// `finite_number`.
fn not_an_integer(text: &str) -> NumberError {
    if parse_number_text(text) == Err(NOT_FINITE) { NOT_FINITE } else { INT_PARSING }
}

/// Reads a float as Rust does. Python reads the same strings, and single underscores anywhere inside.
fn parse_number_text(text: &str) -> Result<f64, NumberError> {
    let parsed = if text.contains('_') {
        if text.starts_with('_') || text.ends_with('_') || text.contains("__") {
            return Err(FLOAT_PARSING);
        }
        text.replace('_', "").parse()
    } else {
        text.parse()
    };
    require_finite(parsed.map_err(|_| FLOAT_PARSING)?)
}

fn require_finite(value: f64) -> Result<f64, NumberError> {
    if value.is_finite() { Ok(value) } else { Err(NOT_FINITE) }
}
