//! Numbers and JSON text, compared with pydantic and `serde_json`.

use proptest::prelude::*;
use serde_json::{Value, json};

use super::{any_json, decompress};
use crate::number::{NumberError, parse_integer, parse_number, parse_single};
use crate::parse_python_json;

/// Our outcome of a recorded case and pydantic's, in the same form.
fn outcomes<T: ToString>(case: &Value, ours: Result<T, NumberError>) -> [Value; 2] {
    let theirs = match case.get("value") {
        Some(value) => json!(value),
        None => json!([case["type"], case["msg"]]),
    };
    let ours = match ours {
        Ok(value) => json!(value.to_string()),
        Err(error) => json!([error.kind, error.msg]),
    };
    [ours, theirs]
}

/// Compares with pydantic's own outcome of each case, kind and message of the error included.
#[test]
fn validate_numbers_are_read_as_pydantic_reads_them() {
    let recorded = decompress(include_bytes!("../../fixtures/pydantic-numbers.json.gz"));
    let [ints, floats] = ["int", "float"].map(|kind| recorded[kind].as_array().unwrap());
    assert_eq!((ints.len(), floats.len()), (94, 94));
    for case in ints {
        let [ours, mut theirs] = outcomes(case, parse_integer(&case["input"]));
        // Python's integers are unbounded; ours saturate at 64 bits, beyond any valid id.
        if let Some(Err(_)) = theirs.as_str().map(str::parse::<i64>) {
            theirs = json!(
                if theirs.as_str().unwrap().starts_with('-') { i64::MIN } else { i64::MAX }.to_string()
            );
        }
        assert_eq!(ours, theirs, "int from {}", case["input"]);
    }
    for case in floats {
        match (parse_number(&case["input"]), case["value"].as_f64()) {
            // Equal to the bit, since both read decimal text to the nearest double.
            (Ok(ours), Some(theirs)) => assert_eq!(ours.to_bits(), theirs.to_bits(), "{}", case["input"]),
            (ours, _) => {
                let [ours, theirs] = outcomes(case, ours);
                assert_eq!(ours, theirs, "float from {}", case["input"]);
            }
        }
    }
}

/// A deliberate difference: pydantic reports `int_parsing` for these.
#[test]
fn nan_as_an_integer_is_not_finite() {
    for text in ["nan", "-NaN", " inf ", "Infinity", "1e400", "-1e400"] {
        assert_eq!(parse_integer(&json!(text)).unwrap_err().kind, "finite_number", "{text}");
    }
}

/// The number of values is bounded before any of them takes memory. Text in a string is not counted.
#[test]
fn text_with_too_many_values_is_rejected() {
    let list = |count: usize| format!("[{}0]", "0,".repeat(count - 1));
    assert!(parse_python_json(&list(99_000)).is_ok());
    let error_of = |text: &str| parse_python_json(text).unwrap_err().to_string();
    assert_eq!(error_of(&list(200_000)), "it has more than 100000 values; send less at a time");
    assert_eq!(error_of(&"[".repeat(200_000)), "it has more than 100000 values; send less at a time");
    let object = format!("{{{}", r#""a":0,"#.repeat(60_000));
    assert_eq!(error_of(&object), "it has more than 20000 keys; send less at a time");
    assert!(parse_python_json(&format!(r#"["{}"]"#, r#"\",["#.repeat(100_000))).is_ok());
}

#[test]
fn single_precision_rejects_what_overflows_it() {
    assert_eq!(parse_single(&json!(f32::MAX)), Ok(f64::from(f32::MAX)));
    assert_eq!(parse_single(&json!("0.1")), Ok(0.1));
    for value in [json!(1e39), json!("-3.5e38")] {
        assert!(parse_number(&value).is_ok());
        assert_eq!(parse_single(&value).unwrap_err().kind, "finite_number");
    }
}

#[test]
fn python_extensions_become_strings() {
    for (text, value) in [
        (r#"{"a":NaN,"b":[-Infinity,Infinity]}"#, json!({"a": "NaN", "b": ["-Infinity", "Infinity"]})),
        (r#"[1e400, -1e999,1E+400 , 1e30]"#, json!(["1e400", "-1e999", "1E+400", 1e30])),
        (r#"{"NaN\"": "say \"NaN\", NaN", "x": NaN}"#, json!({"NaN\"": "say \"NaN\", NaN", "x": "NaN"})),
        ("NaN", json!("NaN")),
    ] {
        assert_eq!(parse_python_json(text).unwrap(), value, "{text}");
    }
    let digits = "9".repeat(400);
    assert_eq!(parse_python_json(&format!("[{digits}]")).unwrap(), json!([digits]));
    for text in
        ["nan", "-NaN", "+Infinity", "{NaN:1}", "[NaN", "NaNNaN", "1e400x", "\"NaN", "[\"\\", "é NaN", ""]
    {
        let read = parse_python_json(text);
        assert!(read.is_err(), "{text}: {read:?}");
    }
}

proptest! {
    #[test]
    fn valid_json_is_unchanged(value in any_json(Just(json!("NaN")), &["a", "NaN"])) {
        let text = value.to_string();
        prop_assert_eq!(parse_python_json(&text).unwrap(), value);
    }

    #[test]
    fn any_text_is_parsed_or_rejected(text in "(NaN|-?Infinity|[\\[\\]{}:,\"\\\\ ]|1e4[0-9]{2}|é|[a-z0-9]){0,24}") {
        match (parse_python_json(&text), serde_json::from_str::<Value>(&text)) {
            (Ok(ours), Ok(theirs)) => prop_assert_eq!(ours, theirs),
            (Ok(_), Err(_)) => prop_assert!(text.contains("NaN") || text.contains("Inf") || text.contains("e4")),
            (Err(_), theirs) => prop_assert!(theirs.is_err()),
        }
    }
}
