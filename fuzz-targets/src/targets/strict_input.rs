//! Strict JSON and MessagePack, query strings, and the deserializer of values.

use std::collections::BTreeMap;

use api_types::{EpisodeResult, LeaseRequest, RunRequest, ScenarioRequest};
use serde::de::DeserializeOwned;
use serde_json::{Value, json};
use strict_input::{
    InputError, InputLimits, JsonContent, ParsedInput, from_messagepack, from_query_pairs, from_value,
    non_finite_literals, parse_json, parse_messagepack,
};

use crate::target::{Target, json_seeds, seeds_of, with_json};

pub(super) const TARGETS: &[Target] = &[
    Target::new("json", json, seeds),
    Target::new("messagepack", messagepack, packed_seeds),
    Target::new("query", query, query_seeds),
    Target::new("requests", requests, request_seeds),
];

/// Small limits, so that mutated inputs exceed them.
const LIMITS: InputLimits = InputLimits { values: 200, keys: 40 };

/// Parsed JSON is what `serde_json` parses, has no duplicate key, and is the same after it is written and parsed again. Its
/// content is within the limits, and counted without parsing. Numbers that are not finite are listed if the rest is JSON.
fn json(bytes: &[u8]) -> bool {
    let lax = serde_json::from_slice::<Value>(bytes);
    match parse_json(bytes, LIMITS) {
        Ok(ParsedInput { value, non_finite }) => {
            assert_eq!(
                lax.is_ok(),
                non_finite.is_empty(),
                "a number is not finite only for serde_json or for us"
            );
            assert!(lax.is_err() || lax.ok().as_ref() == Some(&value), "serde_json parses another value");
            assert_eq!(non_finite.len(), non_finite_literals(bytes).count());
            assert_within_limits(&value);
            assert_parses_again(&parse_json(value.to_string().as_bytes(), LIMITS), value);
            true
        }
        Err(InputError::Malformed(_)) => {
            assert!(lax.is_err(), "serde_json parses the text");
            false
        }
        Err(InputError::Field(_)) => false,
        Err(InputError::TooLarge(_)) => {
            assert!(JsonContent::count(bytes).check(LIMITS).is_err() || lax.is_ok());
            false
        }
    }
}

/// Panics unless the text of a value was parsed as that value.
fn assert_parses_again(parsed: &Result<ParsedInput, InputError>, value: Value) {
    let expected = ParsedInput { value, non_finite: Vec::new() };
    assert_eq!(parsed.as_ref().ok(), Some(&expected), "the written value differs");
}

/// Number of values and keys of a value.
#[derive(Debug, Default)]
struct Content {
    values: usize,
    keys: usize,
}

impl Content {
    fn add(&mut self, value: &Value) {
        self.values += 1;
        match value {
            Value::Array(items) => items.iter().for_each(|item| self.add(item)),
            Value::Object(fields) => {
                self.keys += fields.len();
                fields.values().for_each(|field| self.add(field));
            }
            _ => {}
        }
    }
}

fn assert_within_limits(value: &Value) {
    let mut content = Content::default();
    content.add(value);
    assert!(content.values <= LIMITS.values && content.keys <= LIMITS.keys, "{content:?} exceeds the limits");
}

/// Parsed MessagePack is within the limits, and is the same after it is written and parsed again.
fn messagepack(bytes: &[u8]) -> bool {
    let _ = from_messagepack::<Value>(bytes);
    let _ = from_messagepack::<LeaseRequest>(bytes);
    let Ok(ParsedInput { value, non_finite }) = parse_messagepack(bytes, LIMITS) else { return false };
    assert_within_limits(&value);
    assert!(non_finite.len() <= LIMITS.values);
    let written = rmp_serde::to_vec(&value).expect("a value has a MessagePack form");
    assert_parses_again(&parse_messagepack(&written, LIMITS), value);
    true
}

/// A query of strings has exactly its pairs; a typed query has numbers within the ranges of their types.
fn query(bytes: &[u8]) -> bool {
    #[derive(serde::Deserialize)]
    #[serde(deny_unknown_fields)]
    struct TypedQuery {
        #[serde(rename = "limit")]
        _limit: Option<u32>,
        #[serde(rename = "after")]
        _after: Option<i64>,
        #[serde(rename = "share")]
        share: Option<f64>,
        #[serde(rename = "telemetry")]
        _telemetry: Option<bool>,
        #[serde(rename = "task")]
        task: Option<String>,
    }
    let text = String::from_utf8_lossy(bytes);
    let pair = |part: &str| {
        let (name, value) = part.split_once('=').unwrap_or((part, ""));
        (name.to_owned(), value.to_owned())
    };
    let pairs: Vec<(String, String)> = text.split('&').map(pair).collect();
    if let Ok(parsed) = from_query_pairs::<BTreeMap<String, String>>(pairs.clone()) {
        assert_eq!(parsed, pairs.iter().cloned().collect(), "a pair was changed");
    }
    let Ok(query) = from_query_pairs::<TypedQuery>(pairs.clone()) else { return false };
    assert!(query.share.is_none_or(f64::is_finite), "{:?}", query.share);
    let given = pairs.iter().find(|(name, _)| name == "task").map(|(_, task)| task.as_str());
    assert_eq!(query.task.as_deref(), given, "the text was changed");
    true
}

/// A request is the same after it is written and parsed again, and every error names a field of bounded length.
fn requests(bytes: &[u8]) -> bool {
    with_json(bytes, |value| {
        let lease = is_stable::<LeaseRequest>(&value);
        let run = is_stable::<RunRequest>(&value);
        let result = is_stable::<EpisodeResult>(&value);
        let scenario = is_stable::<ScenarioRequest>(&value);
        lease || run || result || scenario
    })
}

fn is_stable<T: DeserializeOwned + serde::Serialize>(value: &Value) -> bool {
    match from_value::<T>(value.clone()) {
        Ok(request) => {
            let written = serde_json::to_value(&request).expect("a request has a JSON form");
            let again: T = from_value(written.clone()).expect("the written request is valid");
            let again = serde_json::to_value(&again).expect("a request has a JSON form");
            assert_eq!(again, written, "the written request differs");
            true
        }
        Err(error) => {
            assert!(!error.reason.is_empty());
            assert!(error.to_string().len() < 16 * 1024, "the error has {} bytes", error.to_string().len());
            false
        }
    }
}

fn values() -> Vec<Value> {
    vec![
        json!({"groups": 1, "group_size": 2, "policy_version": 0, "ttl_s": 5, "purpose": "train", "form": "groups"}),
        json!({"a": [1, -2, 0.5, true, null, "é\n\u{0}"], "b": {"c": {"d": []}}}),
        json!({"episode": "ep_1-aaaaaa_0", "status": "finished", "actions": {"steps": [[], [[0, 0.1, -0.2]]], "precision": "f64"}}),
        json!([0, 1e300, 18_446_744_073_709_551_615_u64, i64::MIN]),
    ]
}

fn seeds() -> Vec<Vec<u8>> {
    json_seeds(values())
}

fn packed_seeds() -> Vec<Vec<u8>> {
    values().iter().map(|value| rmp_serde::to_vec(value).expect("a value has a MessagePack form")).collect()
}

fn query_seeds() -> Vec<Vec<u8>> {
    seeds_of(&[
        "limit=50&after=-1&telemetry=true",
        "share=0.5&task=kessler/survival",
        "limit=4294967295",
        "task=1",
    ])
}

fn request_seeds() -> Vec<Vec<u8>> {
    json_seeds([
        json!({"groups": 1, "group_size": 1, "policy_version": 0, "ttl_s": 5, "purpose": "train", "form": "groups"}),
        json!({"id": "run", "seed": 1, "strategy": "ladder", "target": "half", "placement": false,
            "contested_share": 0.5, "group_size": 2, "tasks": ["kessler/survival"], "judge": "off",
            "retention": {"episodes": 100, "claimed": "all"},
            "task_settings": {"kessler/survival": {"weight": 2, "physics": {"contact": "swept"},
                "levels": {"columns": ["debris"], "rows": [[10], [20]]}}}}),
        json!({"episode": "ep_1-aaaaaa_0", "status": "finished", "policy_version": 1, "metrics": {"temperature": 0.5},
            "actions": {"steps": [[], [[0, 0.1, -0.2]]], "precision": "f32", "stopped": "too_late"}}),
        json!({"scenario": {"task": "kessler/survival", "seed": 7}, "telemetry": true}),
    ])
}
