//! What is refused, in which words.

use std::collections::BTreeMap;

use serde::Deserialize;
use serde_json::{Value, json};

use super::*;

#[derive(Debug, Default, Deserialize, PartialEq)]
#[serde(deny_unknown_fields, default)]
struct Wish {
    count: Option<u32>,
    share: f64,
    name: String,
    kind: Kind,
    deep: Vec<Inner>,
    by_name: BTreeMap<String, Inner>,
    any: Value,
    flag: bool,
}

#[derive(Debug, Default, Deserialize, PartialEq)]
#[serde(deny_unknown_fields)]
struct Inner {
    wanted: i64,
}

#[derive(Debug, Default, Deserialize, PartialEq)]
#[serde(rename_all = "snake_case")]
enum Kind {
    #[default]
    Plain,
    Strange,
}

fn told(text: &str) -> String {
    match value(text.as_bytes()) {
        Err(error) => error.to_string(),
        Ok(value) => match read::<Wish>(value) {
            Err(fault) => fault.to_string(),
            Ok(wish) => format!("{wish:?}"),
        },
    }
}

#[test]
fn faults_name_the_field_and_speak_plainly() {
    let told = [
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
        r#"{"flag": 1}"#,
        r#"{"nmae": "x"}"#,
        r#"{"deep": {"wanted": 1}}"#,
        r#"{"deep": [{"wanted": 1}, [2]]}"#,
        r#"{"deep": [{"wanted": 1}, {}]}"#,
        r#"{"by_name": {"a.b": {"wanted": "x"}}}"#,
        r#"{"by_name": {"a": {"wanted": 1, "more": 2}}}"#,
        r#"{"count": 1, "count": 2}"#,
        r#"{"any": [0, {"x": {"y": 1, "z": 2, "y": 3}}]}"#,
    ]
    .map(|text| format!("{text}\n    {}", told(text)));
    insta::assert_snapshot!(told.join("\n"));
}

#[test]
fn what_is_right_is_read_to_the_bit() {
    let text = r#"{"count": 7, "share": 0.1, "name": "é", "kind": "strange", "deep": [{"wanted": -3}],
        "by_name": {"a": {"wanted": 1}}, "any": {"x": [1, 2.5e-308, null, "s", true, 18446744073709551615]}, "flag": true}"#;
    let strict = value(text.as_bytes()).unwrap();
    assert_eq!(strict, serde_json::from_str::<Value>(text).unwrap());
    assert_eq!(read::<Wish>(strict).unwrap(), serde_json::from_str::<Wish>(text).unwrap());
    assert_eq!(read::<Wish>(json!({})).unwrap(), Wish::default());
}

#[test]
fn a_query_is_read_from_its_words() {
    let of = |pairs: &[(&str, &str)]| {
        let pairs = pairs.iter().map(|(name, word)| ((*name).to_owned(), (*word).to_owned())).collect();
        read_words::<Wish>(pairs).map_err(|fault| fault.to_string())
    };
    let wish = of(&[("count", "7"), ("name", "12"), ("flag", "true"), ("kind", "strange")]).unwrap();
    assert_eq!((wish.count, &*wish.name, wish.flag, wish.kind), (Some(7), "12", true, Kind::Strange));
    let faults = [
        &[("count", "many")][..],
        &[("count", "")],
        &[("count", "-1")],
        &[("count", "1"), ("count", "2")],
        &[("limit", "1")],
        &[("kind", "odd")],
    ]
    .map(|pairs| of(pairs).unwrap_err());
    insta::assert_snapshot!(faults.join("\n"));
}

mod packed {
    use proptest::prelude::*;
    use serde_json::{Value, json};

    use crate::reading::{Unread, packed_value, value};

    fn any_json() -> impl Strategy<Value = Value> {
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

    proptest! {
        #[test]
        fn the_same_in_both_forms_is_the_same(body in any_json()) {
            let bytes = rmp_serde::to_vec_named(&body).unwrap();
            prop_assert_eq!(packed_value(&bytes).unwrap(), body.clone());
            prop_assert_eq!(value(body.to_string().as_bytes()).unwrap(), body);
        }

        #[test]
        fn no_bytes_panic(bytes: Vec<u8>) {
            let _ = packed_value(&bytes);
        }
    }

    #[test]
    fn what_is_too_much_too_deep_or_goes_on_is_refused() {
        let many = [vec![0xdd, 0, 0x50, 0, 0], vec![0xc0; 0x50_0000]].concat();
        let deep = [vec![0x91; 100_000], vec![0xc0]].concat();
        let on = vec![0xc0, 0xc0];
        let claimed = vec![0xdd, 0xff, 0xff, 0xff, 0xff, 0xc0];
        let twice = [&[0x82, 0xa1, b'a', 1, 0xa1, b'a', 2][..]].concat();
        for bytes in [
            many,
            deep,
            on,
            claimed,
            vec![0xc4, 1, 0],
            vec![0x81, 1, 2],
            vec![0xcb, 0x7f, 0xf8, 0, 0, 0, 0, 0, 0],
        ] {
            assert!(matches!(packed_value(&bytes), Err(Unread::Malformed(_))));
        }
        assert!(matches!(packed_value(&twice), Err(Unread::Twice(_))));
        let text = format!("[{}0]", "0,".repeat(5_000_000));
        let told = value(text.as_bytes()).unwrap_err().to_string();
        assert!(told.contains("more than 4000000 values"), "{told}");
        assert_eq!(value(b"[[1]]").unwrap(), json!([[1]]));
    }
}
