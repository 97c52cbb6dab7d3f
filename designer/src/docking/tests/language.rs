//! Parsing, building, editing and comparing designs.

use env_core::KeyedRng;
use env_core::keyed_rng::RngPurpose;
use proptest::prelude::*;

use super::approach::any_deputy;
use super::*;
use crate::brief::{DesignRung, LayoutOutcome, PastLayout};
use crate::docking::{DockingAim, DockingDesign, compile};
use crate::test_support::prompt_text;

proptest! {
    /// Parsing the JSON of a design returns the design, and building it twice gives one scenario.
    #[test]
    fn designs_survive_json_and_build_alike(
        deputies in prop::collection::vec(any_deputy(), 1..=5),
        mode in prop::sample::select(MODES.to_vec()),
        bearing_deg in prop::option::of(0i32..360),
    ) {
        let aim = DockingAim { mode: mode.to_owned(), bearing_deg };
        let design = DockingDesign { name: "any".to_owned(), aim, params: std::collections::BTreeMap::new(), deputies };
        let json = design.to_json();
        prop_assert_eq!(&DockingDesign::from_json(&json).unwrap(), &design);
        let base = base("docking/multiagent", &[]);
        let first = language().build(&json, &base);
        prop_assert_eq!(&first, &language().build(&json, &base));
        if let Ok((scenario, _)) = first {
            let layout = scenario.recipe().layout().unwrap();
            prop_assert_eq!(layout.provenance.as_ref(), Some(&json));
            prop_assert_eq!(layout.bodies["deputies"].len(), design.deputies.len());
        }
        prop_assert_eq!(language().distance(&json, &json), 0.0);
        prop_assert!(language().table(&json).unwrap().rows.len() == design.deputies.len());
    }

    #[test]
    fn parser_survives_any_numbers(number in any::<i64>(), field in 0usize..6) {
        let mut value = deputy([500, 0, 0, 0, 0, 0]);
        let name = value.as_object().unwrap().keys().nth(field).unwrap().clone();
        value[&name] = json!(number);
        if let Err(error) = DockingDesign::from_json(&design("crash", &[value])) {
            prop_assert_eq!(error.field, format!("deputies.0.{}", name));
        }
    }
}

#[test]
fn invalid_fields_are_named() {
    let good = deputy([500, 0, 0, 0, 0, 0]);
    let mut extra = good.clone();
    extra["spin"] = json!(1);
    let mut missing = good.clone();
    missing.as_object_mut().unwrap().remove("cross_deg");
    let mut fraction = good.clone();
    fraction["distance"] = json!(20.5);
    let valid = design("crash", std::slice::from_ref(&good));
    let with = |name: &str, value: Value| {
        let mut design = valid.clone();
        design[name] = value;
        design
    };
    for (design, field) in [
        (json!(3), "design"),
        (with("frame", json!("inertial")), "design.frame"),
        (with("aim", json!([])), "aim"),
        (with("aim", json!({"mode": 1})), "aim.mode"),
        (with("aim", json!({"mode": "crash", "bearing_deg": 360})), "aim.bearing_deg"),
        (with("params", json!({"time_limit_s": "long"})), "params.time_limit_s"),
        (with("deputies", json!([])), "deputies"),
        (with("deputies", json!(vec![good.clone(); 6])), "deputies"),
        (with("deputies", json!(["x"])), "deputies.0"),
        (with("deputies", json!([extra])), "deputies.0.spin"),
        (with("deputies", json!([good, missing])), "deputies.1.cross_deg"),
        (with("deputies", json!([fraction])), "deputies.0.distance"),
    ] {
        let error = DockingDesign::from_json(&design).unwrap_err();
        assert_eq!(error.field, field, "{design}: {error}");
    }
}

#[test]
fn brief_limits_aims_params_and_deputies() {
    let single = brief_at_level("docking/single", 5, 1);
    let team = brief_at_level("docking/multiagent", 5, 1);
    let one = deputy([500, 0, 0, 0, 0, 0]);
    let field = |brief: &DesignBrief, design: &Value| language().parse(design, brief).unwrap_err().field;
    assert_eq!(field(&single, &design("collision", std::slice::from_ref(&one))), "aim.mode");
    // A level with a short time limit cannot lose a deputy by distance.
    assert_eq!(field(&single, &design("out_of_bounds", std::slice::from_ref(&one))), "aim.mode");
    let early = brief_at_level("docking/single", 3, 1);
    assert!(language().parse(&design("out_of_bounds", std::slice::from_ref(&one)), &early).is_ok());
    assert_eq!(field(&team, &design("crash", std::slice::from_ref(&one))), "deputies");
    let mut radius = design("crash", &[one]);
    radius["params"] = json!({"start_radius": 20.0});
    assert_eq!(field(&single, &radius), "params.start_radius");
    radius["params"] = json!({"thrust_bound": 0.15});
    assert!(language().parse(&radius, &single).is_ok());
    let names: Vec<_> = language().param_choices(&single).iter().map(|choice| choice.param.clone()).collect();
    assert_eq!(names, ["time_limit_s", "thrust_bound"]);
}

#[test]
fn params_and_deputies_enter_the_recipe() {
    let mut three = design("timeout", &[0, 120, 240].map(|azimuth| deputy([900, azimuth, 0, 0, 0, 0])));
    three["params"] = json!({"time_limit_s": 300.0});
    let design = DockingDesign::from_json(&three).unwrap();
    let scenario = compile(&design, &base("docking/multiagent", &[("deputies", 5.0)])).unwrap();
    let recipe = scenario.recipe();
    assert_eq!((recipe.param("deputies"), recipe.param("time_limit_s")), (Some(3.0), Some(300.0)));
    let error = compile(&design, &base("docking/single", &[])).unwrap_err();
    assert_eq!(error.field, "deputies");
    let fast =
        DockingDesign::from_json(&super::design("crash", &[deputy([10_000, 0, 0, 500, 0, 0])])).unwrap();
    let error = compile(&fast, &base("docking/single", &[])).unwrap_err();
    assert_eq!(error.field, "deputies.0.3", "{error}");
}

#[test]
fn edited_designs_are_canonical_and_changed() {
    let brief = brief_at_level("docking/multiagent", 5, 1);
    let mut rng = KeyedRng::new(RngPurpose::Design, 1, 1);
    let base = brief.base_scenario(0);
    let mut design = language().sample(&brief, &base, &mut rng).unwrap();
    let mut edited = 0;
    for _ in 0..200 {
        let Some(child) = language().edit(&design, &brief, &base, None, &mut rng) else { continue };
        assert_ne!(child, design);
        assert_eq!(language().parse(&child, &brief).unwrap(), child);
        assert!(language().build(&child, &base).is_ok());
        design = child;
        edited += 1;
    }
    assert!(edited > 150, "{edited}");
}

#[test]
fn distance_grows_with_every_difference() {
    let reference = design("crash", &[deputy([800, 90, 0, 120, 20, 0])]);
    let distance = |numbers: [i32; 6]| language().distance(&reference, &design("crash", &[deputy(numbers)]));
    let near = distance([820, 92, 0, 122, 20, 0]);
    assert!(near > 0.0 && near < crate::MIN_NOVELTY, "{near}");
    for far in [
        [1300, 90, 0, 120, 20, 0],
        [800, 150, 0, 120, 20, 0],
        [800, 90, 40, 120, 20, 0],
        [800, 90, 0, 20, 20, 0],
        [800, 90, 0, 120, 120, 0],
    ] {
        let value = distance(far);
        assert!(value > crate::MIN_NOVELTY && value <= 1.0, "{far:?}: {value}");
    }
    let mut other_mode = reference.clone();
    other_mode["aim"]["mode"] = json!("timeout");
    assert!(language().distance(&reference, &other_mode) > crate::MIN_NOVELTY);
    // The order of deputies does not matter.
    let (a, b) = (deputy([800, 90, 0, 0, 0, 0]), deputy([500, 200, 0, 0, 0, 0]));
    let pair = [design("crash", &[a.clone(), b.clone()]), design("crash", &[b, a])];
    assert_eq!(language().distance(&pair[0], &pair[1]), 0.0);
    assert_eq!(language().distance(&pair[0], &json!(1)), 1.0);
}

#[test]
fn sampled_designs_satisfy_the_schema() {
    for task in ["docking/single", "docking/multiagent"] {
        let brief = brief_at_level(task, 5, 2);
        let schema = language().schema(&brief);
        let deputies = &schema["properties"]["deputies"];
        let range = |name: &str| deputies[name].as_u64().unwrap() as usize;
        for number in 0..20 {
            let mut rng = KeyedRng::new(RngPurpose::Design, 1, number);
            let design = language().sample(&brief, &brief.base_scenario(number), &mut rng).unwrap();
            let modes = schema["properties"]["aim"]["properties"]["mode"]["enum"].as_array().unwrap();
            assert!(modes.contains(&design["aim"]["mode"]));
            let list = design["deputies"].as_array().unwrap();
            assert!((range("minItems")..=range("maxItems")).contains(&list.len()));
            let known = deputies["items"]["properties"].as_object().unwrap();
            for (name, value) in list.iter().flat_map(|deputy| deputy.as_object().unwrap()) {
                let (low, high) = (known[name]["minimum"].as_i64(), known[name]["maximum"].as_i64());
                assert!(low <= value.as_i64() && value.as_i64() <= high, "{name} {value}");
            }
        }
    }
}

#[test]
fn prompt_for_a_team() {
    let mut brief = brief_at_level("docking/multiagent", 4, 1);
    brief.profile = aimed_profile("docking/multiagent", "collision");
    let past = json!({"name": "together", "aim": {"mode": "collision", "bearing_deg": 90}});
    let evaluated = LayoutOutcome::Evaluated {
        episodes: 14,
        success_rate: 13.0 / 14.0,
        regret: 0.1,
        aimed_share: None,
        is_retired: false,
    };
    let rung = DesignRung { level: Some(4), start_scale: Some(0.6) };
    let layout = |outcome| PastLayout { design: past.clone(), rung, seed: None, outcome };
    brief.past_layouts = [LayoutOutcome::Untested, evaluated].map(layout).to_vec();
    insta::assert_snapshot!(prompt_text(&brief, 2));
    insta::assert_json_snapshot!(language().schema(&brief));
}
