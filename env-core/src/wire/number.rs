//! Numbers by pydantic's lax rules: a number, a truth value or a string will do.

use serde_json::Value;

/// Digits from which pydantic, and Python, refuse to read an integer from a string.
const MOST_DIGITS: usize = 4300;
/// 2⁶³: from here on pydantic takes no integer from a float.
const TOO_LARGE: f64 = 9_223_372_036_854_775_808.0;

/// What is wrong with a number, in pydantic's words.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Wrong {
    /// The kind of fault.
    pub kind: &'static str,
    /// What should have stood there.
    pub msg: &'static str,
}

const INT_TYPE: Wrong = Wrong { kind: "int_type", msg: "Input should be a valid integer" };
const INT_FROM_FLOAT: Wrong = Wrong {
    kind: "int_from_float",
    msg: "Input should be a valid integer, got a number with a fractional part",
};
const INT_PARSING: Wrong = Wrong {
    kind: "int_parsing",
    msg: "Input should be a valid integer, unable to parse string as an integer",
};
const INT_PARSING_SIZE: Wrong = Wrong {
    kind: "int_parsing_size",
    msg: "Unable to parse input string as an integer, exceeded maximum size",
};
const FLOAT_TYPE: Wrong = Wrong { kind: "float_type", msg: "Input should be a valid number" };
const FLOAT_PARSING: Wrong = Wrong {
    kind: "float_parsing",
    msg: "Input should be a valid number, unable to parse string as a number",
};
const NOT_FINITE: Wrong = Wrong { kind: "finite_number", msg: "Input should be a finite number" };

/// A whole number; one beyond 64 bits becomes the nearest there is.
///
/// # Errors
/// What is none.
pub fn integer(value: &Value) -> Result<i64, Wrong> {
    match value {
        Value::Bool(truth) => Ok(i64::from(*truth)),
        Value::String(text) => integer_in(text.trim()),
        Value::Number(number) => match (number.as_i64(), number.as_f64()) {
            (Some(whole), _) => Ok(whole),
            (None, _) if number.is_u64() => Ok(i64::MAX),
            (None, Some(v)) => from_float(v),
            (None, None) => Err(INT_TYPE),
        },
        Value::Null | Value::Array(_) | Value::Object(_) => Err(INT_TYPE),
    }
}

#[expect(clippy::cast_possible_truncation, reason = "without a fraction and within bounds it is exact")]
fn from_float(v: f64) -> Result<i64, Wrong> {
    if v.fract() != 0.0 {
        Err(INT_FROM_FLOAT)
    } else if v.abs() >= TOO_LARGE {
        Err(INT_PARSING_SIZE)
    } else {
        Ok(v as i64)
    }
}

/// Digits, in groups joined by single underscores if one likes, after a sign and before a fraction of zeros.
fn integer_in(text: &str) -> Result<i64, Wrong> {
    let (negative, digits) = match text.as_bytes().first() {
        Some(b'-') => (true, &text[1..]),
        Some(b'+') => (false, &text[1..]),
        _ => (false, text),
    };
    let whole = match digits.split_once('.') {
        Some((whole, zeros)) if !zeros.is_empty() && zeros.bytes().all(|b| b == b'0') => whole,
        Some(_) => return Err(no_integer(text)),
        None => digits,
    };
    let joined = |group: &str| !group.is_empty() && group.bytes().all(|b| b.is_ascii_digit());
    if !whole.split('_').all(joined) {
        return Err(no_integer(text));
    }
    let significant = whole.trim_start_matches(['0', '_']).bytes().filter(|&b| b != b'_');
    let (mut count, mut value) = (0, 0i64);
    for digit in significant {
        count += 1;
        let digit = i64::from(digit - b'0');
        value = value.saturating_mul(10);
        value = if negative { value.saturating_sub(digit) } else { value.saturating_add(digit) };
    }
    if count > MOST_DIGITS { Err(INT_PARSING_SIZE) } else { Ok(value) }
}

/// What is wrong with a string that is no integer. Pydantic says `int_parsing` of "nan" too; here NaN has one name.
fn no_integer(text: &str) -> Wrong {
    if number_in(text) == Err(NOT_FINITE) { NOT_FINITE } else { INT_PARSING }
}

/// A finite number.
///
/// # Errors
/// What is none.
pub fn number(value: &Value) -> Result<f64, Wrong> {
    match value {
        Value::Bool(truth) => Ok(f64::from(u8::from(*truth))),
        Value::String(text) => number_in(text.trim()),
        Value::Number(number) => finite(number.as_f64().ok_or(FLOAT_TYPE)?),
        Value::Null | Value::Array(_) | Value::Object(_) => Err(FLOAT_TYPE),
    }
}

/// The same if it is finite in single precision too.
pub(super) fn single(value: &Value) -> Result<f64, Wrong> {
    number(value).and_then(|v| if v.abs() <= f64::from(f32::MAX) { Ok(v) } else { Err(NOT_FINITE) })
}

/// As Rust reads a float, which is as Python does but for underscores: single ones may stand anywhere inside.
fn number_in(text: &str) -> Result<f64, Wrong> {
    let parsed = if text.contains('_') {
        if text.starts_with('_') || text.ends_with('_') || text.contains("__") {
            return Err(FLOAT_PARSING);
        }
        text.replace('_', "").parse()
    } else {
        text.parse()
    };
    finite(parsed.map_err(|_| FLOAT_PARSING)?)
}

fn finite(v: f64) -> Result<f64, Wrong> {
    if v.is_finite() { Ok(v) } else { Err(NOT_FINITE) }
}
