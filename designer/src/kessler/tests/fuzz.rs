//! Fuzzing: any JSON is accepted or refused with the field at fault. Nothing panics, and nothing out of bounds is accepted.

use serde_json::Value;

use super::gate::{brief_at_level, empty_gate};
use super::*;
use crate::profile::FailureProfile;

/// Any small JSON value.
fn json_value() -> impl Strategy<Value = Value> {
    let leaf = prop_oneof![
        Just(Value::Null),
        any::<bool>().prop_map(Value::from),
        any::<i64>().prop_map(Value::from),
        any::<u64>().prop_map(Value::from),
        (-500..500i32).prop_map(Value::from),
        any::<f64>().prop_map(Value::from), // NaN becomes null
        ".{0,80}".prop_map(Value::from),
        prop::sample::select(vec!["threat", "decoy", "inertial", "collision", "rogue"]).prop_map(Value::from),
    ];
    leaf.prop_recursive(3, 24, 6, |inner| {
        prop_oneof![
            prop::collection::vec(inner.clone(), 0..6).prop_map(Value::from),
            prop::collection::btree_map("[a-z_]{1,12}", inner, 0..6).prop_map(|map| json!(map)),
        ]
    })
}

/// A valid design with one of its parts replaced.
fn corrupted_design() -> impl Strategy<Value = Value> {
    const POINTERS: [&str; 14] = [
        "",
        "/name",
        "/aim",
        "/aim/mode",
        "/aim/bearing_deg",
        "/frame",
        "/params",
        "/encounters",
        "/encounters/0",
        "/encounters/0/satellite",
        "/encounters/0/step",
        "/encounters/0/relative_speed",
        "/encounters/0/kind",
        "/encounters/0/rogue",
    ];
    (prop::sample::select(POINTERS.to_vec()), json_value()).prop_map(|(pointer, replacement)| {
        let mut design = json!({
            "name": "x", "aim": {"mode": "collision", "bearing_deg": 90}, "frame": "inertial", "params": {},
            "encounters": [{"satellite": 0, "step": 12, "bearing_deg": 90, "relative_speed": 40, "miss_distance": 3,
                            "kind": "threat", "rogue": false}],
        });
        if let Some(part) = design.pointer_mut(pointer) {
            *part = replacement;
        }
        design
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn any_design_is_admitted_or_refused(design in prop_oneof![json_value(), corrupted_design()]) {
        let brief = brief_at_level("kessler/survival", 2, 1);
        match empty_gate().judge(&brief, &design, [brief.base_scenario(0)]) {
            Ok(admitted) => {
                let provenance = admitted.scenario().recipe().layout().unwrap().provenance.clone().unwrap();
                let parsed = Design::from_json(&provenance).unwrap();
                prop_assert!(parsed.encounters.iter().all(|encounter| encounter.validate("").is_ok()));
                prop_assert!(parsed.name.chars().count() <= 60 && !parsed.name.chars().any(char::is_control));
            }
            Err(refusal) => prop_assert!(refusal.to_string().chars().count() < 700, "{refusal}"),
        }
    }

    #[test]
    fn any_profile_is_parsed_or_rejected(
        text in prop_oneof![".{0,200}", json_value().prop_map(|value| value.to_string())]
    ) {
        if let Ok(profile) = FailureProfile::parse(&text, None) {
            prop_assert!(profile.total_weight().is_finite());
        }
    }
}

#[test]
fn too_many_encounters_are_refused() {
    let encounter = json!({"satellite": 0, "step": 12, "bearing_deg": 90, "relative_speed": 40, "miss_distance": 3, "kind": "threat"});
    let brief = brief_at_level("kessler/survival", 2, 1);
    let design = json!({"name": "x", "aim": {"mode": "collision"}, "encounters": vec![encounter; 10_000]});
    let refusal = empty_gate().judge(&brief, &design, [brief.base_scenario(0)]).unwrap_err();
    assert_eq!(refusal.to_string(), "encounters: must have 1 to 12 entries, got 10000");
}
