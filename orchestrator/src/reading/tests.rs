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
