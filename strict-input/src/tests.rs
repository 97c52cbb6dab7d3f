//! Tests of accepted and rejected input, and of the error messages.

use std::collections::BTreeMap;

use proptest::prelude::*;
use serde::Deserialize;
use serde_json::{Value, json};

use super::*;

#[derive(Debug, Default, Deserialize, PartialEq)]
#[serde(deny_unknown_fields, default)]
struct Request {
    count: Option<u32>,
    share: f64,
    name: String,
    kind: Kind,
    deep: Vec<Nested>,
    by_name: BTreeMap<String, Nested>,
    any: Value,
    flag: bool,
}

#[derive(Debug, Default, Deserialize, PartialEq)]
#[serde(deny_unknown_fields)]
struct Nested {
    wanted: i64,
}

#[derive(Debug, Default, Deserialize, PartialEq)]
#[serde(rename_all = "snake_case")]
enum Kind {
    #[default]
    Plain,
    Strange,
}

fn outcome(text: &str) -> String {
    match parse_json(text.as_bytes(), InputLimits::FILE).and_then(ParsedInput::finite) {
        Err(error) => error.to_string(),
        Ok(value) => match from_value::<Request>(value) {
            Err(error) => error.to_string(),
            Ok(request) => format!("{request:?}"),
        },
    }
}

#[test]
fn errors_name_the_field_in_plain_words() {
    let outcomes = [
        "null",
        "[]",
        "7",
        "",
        " \n",
        "{",
        "{} {}",
        r#"{"count": -1}"#,
        r#"{"count": 4294967296}"#,
        r#"{"count": "many"}"#,
        r#"{"count": "7"}"#,
        r#"{"count": 1.5}"#,
        r#"{"share": null}"#,
        r#"{"share": []}"#,
        r#"{"name": 1e300}"#,
        r#"{"kind": "odd"}"#,
        r#"{"kind": 3}"#,
        r#"{"kind": {}}"#,
        r#"{"kind": {"plain": null}}"#,
        r#"{"flag": 1}"#,
        r#"{"nmae": "x"}"#,
        r#"{"deep": {"wanted": 1}}"#,
        r#"{"deep": [{"wanted": 1}, [2]]}"#,
        r#"{"deep": [{"wanted": 1}, {}]}"#,
        r#"{"by_name": {"a.b": {"wanted": "x"}}}"#,
        r#"{"by_name": {"a": {"wanted": 1, "more": 2}}}"#,
        r#"{"count": 1, "count": 2}"#,
        r#"{"any": [0, {"x": {"y": 1, "z": 2, "y": 3}}]}"#,
        r#"{"share": 1e999}"#,
        r#"{"share": NaN}"#,
        r#"{"any": [0, {"x": ["", -Infinity, ""]}]}"#,
        "Infinity",
        r#"{"share": NaN, "count": }"#,
        r#"{NaN: 1}"#,
        r#"{"share": -NaN}"#,
        r#"{"share": 01e999}"#,
    ]
    .map(|text| format!("{text}\n    {}", outcome(text)));
    insta::assert_snapshot!(outcomes.join("\n"));
}

#[test]
fn valid_input_is_read_to_the_bit() {
    let text = r#"{"count": 7, "share": 0.1, "name": "é", "kind": "strange", "deep": [{"wanted": -3}],
        "by_name": {"a": {"wanted": 1}}, "any": {"x": [1, 2.5e-308, null, "s", true, 18446744073709551615]}, "flag": true}"#;
    let strict = parse_json(text.as_bytes(), InputLimits::FILE).and_then(ParsedInput::finite).unwrap();
    assert_eq!(strict, serde_json::from_str::<Value>(text).unwrap());
    assert_eq!(from_value::<Request>(strict).unwrap(), serde_json::from_str::<Request>(text).unwrap());
    assert_eq!(from_value::<Request>(json!({})).unwrap(), Request::default());
}

#[test]
fn query_pairs_are_read_as_numbers_and_booleans() {
    let of = |pairs: &[(&str, &str)]| {
        let pairs = pairs.iter().map(|(name, word)| ((*name).to_owned(), (*word).to_owned())).collect();
        from_query_pairs::<Request>(pairs).map_err(|error| error.to_string())
    };
    let request = of(&[("count", "7"), ("name", "12"), ("flag", "true"), ("kind", "strange")]).unwrap();
    assert_eq!(
        (request.count, &*request.name, request.flag, request.kind),
        (Some(7), "12", true, Kind::Strange)
    );
    let errors = [
        &[("count", "many")][..],
        &[("count", "")],
        &[("count", "-1")],
        &[("count", "1"), ("count", "2")],
        &[("limit", "1")],
        &[("kind", "odd")],
    ]
    .map(|pairs| of(pairs).unwrap_err());
    insta::assert_snapshot!(errors.join("\n"));
}

/// Any JSON value of a few levels.
pub(super) fn any_json() -> impl Strategy<Value = Value> {
    let leaf = prop_oneof![
        Just(Value::Null),
        any::<bool>().prop_map(Value::from),
        any::<i64>().prop_map(Value::from),
        any::<u64>().prop_map(Value::from),
        (-1e300..1e300f64).prop_map(Value::from),
        ".{0,12}".prop_map(Value::from),
    ];
    leaf.prop_recursive(4, 40, 6, |inner| {
        prop_oneof![
            proptest::collection::vec(inner.clone(), 0..6).prop_map(Value::from),
            proptest::collection::btree_map(".{0,6}", inner, 0..6)
                .prop_map(|fields| fields.into_iter().collect::<Value>()),
        ]
    })
}

mod packed {
    use proptest::prelude::*;
    use serde_json::json;

    use super::any_json;

    use crate::{InputError, InputLimits, ParsedInput, parse_json, parse_messagepack};

    const LIMITS: InputLimits = InputLimits::FILE;

    proptest! {
        #[test]
        fn json_and_messagepack_give_the_same_value(body in any_json()) {
            let bytes = rmp_serde::to_vec_named(&body).unwrap();
            let parsed = parse_messagepack(&bytes, LIMITS).unwrap();
            prop_assert!(parsed.non_finite.is_empty());
            prop_assert_eq!(parsed.value, body.clone());
            let parsed = parse_json(body.to_string().as_bytes(), LIMITS).unwrap();
            prop_assert_eq!(parsed, ParsedInput { value: body, non_finite: Vec::new() });
        }

        #[test]
        fn arbitrary_bytes_never_panic(bytes: Vec<u8>) {
            let _ = parse_messagepack(&bytes, LIMITS);
        }
    }

    #[test]
    fn deep_truncated_or_trailing_input_is_rejected() {
        let too_deep = [vec![0x91; 100_000], vec![0xc0]].concat();
        let trailing = vec![0xc0, 0xc0];
        let overstated_length = vec![0xdd, 0xff, 0xff, 0xff, 0xff, 0xc0];
        let duplicate_key = [&[0x82, 0xa1, b'a', 1, 0xa1, b'a', 2][..]].concat();
        for bytes in [too_deep, trailing, overstated_length, vec![0xc4, 1, 0], vec![0x81, 1, 2]] {
            assert!(matches!(parse_messagepack(&bytes, LIMITS), Err(InputError::Malformed(_))));
        }
        assert!(matches!(parse_messagepack(&duplicate_key, LIMITS), Err(InputError::Field(_))));
        assert_eq!(parse_json(b"[[1]]", LIMITS).unwrap().value, json!([[1]]));
    }

    #[test]
    fn number_of_values_and_keys_is_bounded() {
        let too_many = [vec![0xdd, 0, 0x50, 0, 0], vec![0xc0; 0x50_0000]].concat();
        let outcome = parse_messagepack(&too_many, LIMITS).unwrap_err();
        assert!(matches!(outcome, InputError::TooLarge(_)), "{outcome}");
        let text = format!("[{}0]", "0,".repeat(5_000_000));
        let outcome = parse_json(text.as_bytes(), LIMITS).unwrap_err().to_string();
        assert!(outcome.contains("more than 4000000 values"), "{outcome}");
        let limits = InputLimits { values: 7, keys: 3 };
        let of = |text: &str| parse_json(text.as_bytes(), limits).map_err(|error| error.to_string());
        assert!(of(r#"{"a": {"b": [1, 2, 3], "c": 0}}"#).is_ok(), "7 values and 3 keys");
        assert_eq!(of("[1,2,3,4,5,6,7]"), Err("it has more than 7 values; send less at a time".to_owned()));
        let keys = of(r#"{"a": 1, "b": 1, "c": {"d": 1}}"#);
        assert_eq!(keys, Err("it has more than 3 keys; send less at a time".to_owned()));
    }

    #[test]
    fn numbers_that_are_not_finite_are_listed_by_field() {
        let body = std::collections::BTreeMap::from([
            ("a", vec![1.0, f64::NAN]),
            ("b", vec![2.0]),
            ("c", vec![f64::NEG_INFINITY, f64::INFINITY]),
        ]);
        let packed = parse_messagepack(&rmp_serde::to_vec(&body).unwrap(), LIMITS).unwrap();
        let text = br#"{"a": [1.0, NaN], "b": [2.0], "c": [-1e999, Infinity]}"#;
        let json = parse_json(text, LIMITS).unwrap();
        for (parsed, infinities) in [(packed, ["-inf", "inf"]), (json, ["-1e999", "Infinity"])] {
            assert_eq!(parsed.value, json!({"a": [1.0, null], "b": [2.0], "c": [null, null]}));
            let errors: Vec<String> = parsed.non_finite.iter().map(ToString::to_string).collect();
            let expected = [("a.1", "NaN"), ("c.0", infinities[0]), ("c.1", infinities[1])]
                .map(|(field, number)| format!("{field}: must be a finite number, got {number}"));
            assert_eq!(errors, expected);
        }
    }

    #[test]
    fn number_of_non_finite_numbers_is_bounded() {
        let list = |count: usize| {
            let packed = parse_messagepack(&rmp_serde::to_vec(&vec![f64::NAN; count]).unwrap(), LIMITS);
            let text = format!("[{}NaN]", "NaN,".repeat(count - 1));
            [packed, parse_json(text.as_bytes(), LIMITS)]
        };
        for parsed in list(10_000) {
            assert_eq!(parsed.unwrap().non_finite.len(), 10_000);
        }
        for parsed in list(10_001) {
            let Err(InputError::Malformed(reason)) = parsed else { panic!("{parsed:?}") };
            assert!(reason.starts_with("it has more than 10000 numbers that are not finite"), "{reason}");
        }
    }

    #[test]
    fn keys_that_are_no_strings_are_malformed() {
        for text in
            [r#"{1e999: "x"}"#, r#"{NaN :1}"#, r#"{"a": "x", 1e999: "y", "b": NaN}"#, r#"[NaN, {NaN: ""}]"#]
        {
            assert!(matches!(parse_json(text.as_bytes(), LIMITS), Err(InputError::Malformed(_))), "{text}");
        }
    }

    proptest! {
        /// A number that is not finite changes nothing but its own place.
        #[test]
        fn rest_of_a_text_with_nan_is_read(before in any_json(), after in any_json()) {
            let text = format!(r#"{{"before": {before}, "": NaN, "after": [{after}, 1e999]}}"#);
            let parsed = parse_json(text.as_bytes(), LIMITS).unwrap();
            prop_assert_eq!(parsed.value, json!({"before": before, "": null, "after": [after, null]}));
            let fields: Vec<&str> = parsed.non_finite.iter().map(|error| &*error.field).collect();
            prop_assert_eq!(fields, ["", "after.1"]);
        }
    }
}
