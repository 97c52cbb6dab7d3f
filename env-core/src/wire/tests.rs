//! What every task's wire is held to.

mod hostile;
mod observed;

use std::io::Read;

use proptest::prelude::*;
use serde_json::{Value, json};

use super::number::{integer, number, single};
use super::read_json;

/// A recorded fixture.
pub(crate) fn unpacked(packed: &[u8]) -> Value {
    let mut text = String::new();
    flate2::read::GzDecoder::new(packed).read_to_string(&mut text).unwrap();
    serde_json::from_str(&text).unwrap()
}

fn said<T: ToString>(case: &Value, ours: Result<T, super::number::Wrong>) -> (Value, Value) {
    let theirs = match case.get("value") {
        Some(value) => json!(value),
        None => json!([case["type"], case["msg"]]),
    };
    let ours = match ours {
        Ok(value) => json!(value.to_string()),
        Err(wrong) => json!([wrong.kind, wrong.msg]),
    };
    (ours, theirs)
}

/// What pydantic itself made of each of these, kind and words of the fault included.
#[test]
fn validate_pydantic_numbers_are_read_alike() {
    let recorded = unpacked(include_bytes!("../../fixtures/pydantic-numbers.json.gz"));
    let [ints, floats] = ["int", "float"].map(|kind| recorded[kind].as_array().unwrap());
    assert_eq!((ints.len(), floats.len()), (94, 94));
    for case in ints {
        let (ours, mut theirs) = said(case, integer(&case["input"]));
        // Python's integers have no end; here one beyond 64 bits is the nearest there is: nobody's number either way.
        if let Some(Err(_)) = theirs.as_str().map(str::parse::<i64>) {
            theirs = json!(
                if theirs.as_str().unwrap().starts_with('-') { i64::MIN } else { i64::MAX }.to_string()
            );
        }
        assert_eq!(ours, theirs, "int from {}", case["input"]);
    }
    for case in floats {
        match (number(&case["input"]), case["value"].as_f64()) {
            // To the bit: both read decimal text to the nearest double.
            (Ok(ours), Some(theirs)) => assert_eq!(ours.to_bits(), theirs.to_bits(), "{}", case["input"]),
            (ours, _) => {
                let (ours, theirs) = said(case, ours);
                assert_eq!(ours, theirs, "float from {}", case["input"]);
            }
        }
    }
}

/// Deliberately otherwise: pydantic says `int_parsing` of these.
#[test]
fn a_whole_number_that_is_nan_is_not_finite() {
    for text in ["nan", "-NaN", " inf ", "Infinity", "1e400", "-1e400"] {
        assert_eq!(integer(&json!(text)).unwrap_err().kind, "finite_number", "{text}");
    }
}

#[test]
fn a_log_in_single_precision_takes_what_fits() {
    assert_eq!(single(&json!(f32::MAX)), Ok(f64::from(f32::MAX)));
    assert_eq!(single(&json!("0.1")), Ok(0.1));
    for value in [json!(1e39), json!("-3.5e38")] {
        assert!(number(&value).is_ok());
        assert_eq!(single(&value).unwrap_err().kind, "finite_number");
    }
}

#[test]
fn strange_numbers_become_words() {
    for (text, value) in [
        (r#"{"a":NaN,"b":[-Infinity,Infinity]}"#, json!({"a": "NaN", "b": ["-Infinity", "Infinity"]})),
        (r#"[1e400, -1e999,1E+400 , 1e30]"#, json!(["1e400", "-1e999", "1E+400", 1e30])),
        (r#"{"NaN\"": "say \"NaN\", NaN", "x": NaN}"#, json!({"NaN\"": "say \"NaN\", NaN", "x": "NaN"})),
        ("NaN", json!("NaN")),
    ] {
        assert_eq!(read_json(text).unwrap(), value, "{text}");
    }
    let digits = "9".repeat(400);
    assert_eq!(read_json(&format!("[{digits}]")).unwrap(), json!([digits]));
    for text in
        ["nan", "-NaN", "+Infinity", "{NaN:1}", "[NaN", "NaNNaN", "1e400x", "\"NaN", "[\"\\", "é NaN", ""]
    {
        let read = read_json(text);
        assert!(read.is_err() || text.starts_with("{NaN"), "{text}: {read:?}");
    }
}

proptest! {
    #[test]
    fn json_reads_as_it_always_did(value in crate::testing::any_json(Just(json!("NaN")), &["a", "NaN"])) {
        let text = value.to_string();
        prop_assert_eq!(read_json(&text).unwrap(), value);
    }

    #[test]
    fn any_text_is_read_or_refused(text in "(NaN|-?Infinity|[\\[\\]{}:,\"\\\\ ]|1e4[0-9]{2}|é|[a-z0-9]){0,24}") {
        match (read_json(&text), serde_json::from_str::<Value>(&text)) {
            (Ok(ours), Ok(theirs)) => prop_assert_eq!(ours, theirs),
            (Ok(_), Err(_)) => prop_assert!(text.contains("NaN") || text.contains("Inf") || text.contains("e4")),
            (Err(_), theirs) => prop_assert!(theirs.is_err()),
        }
    }
}
