//! Whatever a stranger writes is read or refused in a sentence with its field; nothing panics, nothing outside the bounds
//! gets in.

use serde_json::Value;

use super::gate::{at_level, gate};
use super::*;
use crate::profile::Profile;

/// Any JSON, small.
fn json() -> impl Strategy<Value = Value> {
    let leaf = prop_oneof![
        Just(Value::Null),
        any::<bool>().prop_map(Value::from),
        any::<i64>().prop_map(Value::from),
        any::<u64>().prop_map(Value::from),
        (-500..500i32).prop_map(Value::from),
        any::<f64>().prop_map(Value::from), // NaN becomes null, as JSON has none
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

/// A design with something else in one of its places.
fn spoiled() -> impl Strategy<Value = Value> {
    const PLACES: [&str; 14] = [
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
    (prop::sample::select(PLACES.to_vec()), json()).prop_map(|(place, other)| {
        let mut design = json!({
            "name": "x", "aim": {"mode": "collision", "bearing_deg": 90}, "frame": "inertial", "params": {},
            "encounters": [{"satellite": 0, "step": 12, "bearing_deg": 90, "relative_speed": 40, "miss_distance": 3,
                            "kind": "threat", "rogue": false}],
        });
        if let Some(there) = design.pointer_mut(place) {
            *there = other;
        }
        design
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn any_design_is_read_or_refused_by_its_field(design in prop_oneof![json(), spoiled()]) {
        let brief = at_level("kessler/survival", 2, 1);
        match gate().judge(&brief, &design, [brief.sky(0)]) {
            Ok(admitted) => {
                let thought = admitted.scenario().recipe().layout().unwrap().provenance.clone().unwrap();
                let read = Design::from_json(&thought).unwrap();
                prop_assert!(read.encounters.iter().all(|encounter| encounter.check("").is_ok()));
                prop_assert!(read.name.chars().count() <= 60 && !read.name.chars().any(char::is_control));
            }
            Err(refusal) => prop_assert!(refusal.to_string().chars().count() < 700, "{refusal}"),
        }
    }

    #[test]
    fn any_profile_is_read_or_refused(text in prop_oneof![".{0,200}", json().prop_map(|value| value.to_string())]) {
        if let Ok(profile) = Profile::read(&text, None) {
            prop_assert!(profile.failures().is_finite());
        }
    }
}

/// Ten thousand encounters are refused without a look at them.
#[test]
fn too_many_are_refused_at_once() {
    let one = json!({"satellite": 0, "step": 12, "bearing_deg": 90, "relative_speed": 40, "miss_distance": 3, "kind": "threat"});
    let brief = at_level("kessler/survival", 2, 1);
    let many = json!({"name": "x", "aim": {"mode": "collision"}, "encounters": vec![one; 10_000]});
    let refused = gate().judge(&brief, &many, [brief.sky(0)]).unwrap_err();
    assert_eq!(refused.to_string(), "encounters: 10000 are given; 1 to 12 are wanted");
}
