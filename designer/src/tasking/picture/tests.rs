//! Pictures: well-formed, small, and with the right content.

use std::sync::Arc;

use env_core::{Bracket, Recipe, Scenario};
use roxmltree::Document;
use serde_json::{Value, json};

use super::sky::LayoutSky;
use crate::procedural::ProceduralDesigner;
use crate::tasking::tests::{CONSTELLATION, IMAGING, SCANNING, brief_at_level, design_json, empty_gate};
use crate::test_support::profile_of_one_mode;
use crate::{AdmittedLayout, DesignBrief, LayoutView, draw_layout};

/// An admitted layout that aims at a failure mode.
struct DrawnExample {
    design: Value,
    layout: AdmittedLayout,
}

impl DrawnExample {
    fn new(task: &str, mode: &str) -> Self {
        let mut brief = brief_at_level(task, 3, 3);
        brief.count = 1;
        brief.profile = profile_of_one_mode(task, mode, Some(3), None);
        let outcome = ProceduralDesigner::design_layouts(&brief, &mut empty_gate());
        let judged = outcome.judged.into_iter().find(|judged| judged.verdict.is_ok());
        let judged = judged.expect("one of 40 attempts passes");
        Self { design: judged.design.unwrap(), layout: judged.verdict.unwrap() }
    }

    fn draw(&self, name: &str) -> String {
        draw(name, Some(&self.design), self.layout.scenario(), self.layout.bracket())
    }
}

fn draw(name: &str, design: Option<&Value>, scenario: &Scenario, bracket: &Bracket) -> String {
    draw_layout(LayoutView { name, design, scenario, bracket }).unwrap()
}

fn texts<'a>(document: &'a Document<'_>) -> Vec<&'a str> {
    let nodes = document.descendants().filter(|node| node.tag_name().name() == "text");
    nodes.filter_map(|node| node.text()).collect()
}

#[test]
fn pictures_are_well_formed_and_small() {
    for (task, mode) in [(SCANNING, "pass_missed"), (IMAGING, "low_value"), (CONSTELLATION, "duplicate")] {
        let example = DrawnExample::new(task, mode);
        let svg = example.draw("a layout");
        let document = Document::parse(&svg).unwrap();
        assert!(svg.len() < 250_000, "{task}: {} bytes", svg.len());
        assert!(!svg.contains("NaN") && !svg.contains("inf "), "{task}");
        let texts = texts(&document);
        let bracket = example.layout.bracket();
        let scores = format!("floor {:.3}, reference {:.3}", bracket.floor, bracket.reference.score);
        for expected in ["a layout", mode, &scores, "satellite 0", "Hawaii", "battery", "desaturate"] {
            assert!(texts.iter().any(|text| text.contains(expected)), "{task}: {expected:?} in {texts:?}");
        }
        let fields = example.design["fields"].as_array().unwrap().len();
        assert_eq!(
            texts.iter().filter(|text| text.starts_with('#') && text.len() > 1).count(),
            fields,
            "{task}"
        );
    }
}

/// The timeline ends with the plan's state: the curve of the battery begins at the charge of the design.
#[test]
fn curves_begin_at_the_start_of_the_design() {
    let example = DrawnExample::new(SCANNING, "power");
    let view = LayoutView {
        name: "",
        design: Some(&example.design),
        scenario: example.layout.scenario(),
        bracket: example.layout.bracket(),
    };
    let sky = LayoutSky::new(view).unwrap();
    let plan = &sky.plans[0];
    let percent = example.design["start"]["battery_percent"].as_f64().unwrap();
    assert!((100.0 * plan.resources[0].battery - percent).abs() < 0.1);
    let last = plan.resources.last().unwrap();
    assert!((last.time_s - sky.forecast.time_limit_s).abs() < 1.0, "the plan survives to the time limit");
    let covered: f64 = plan.tasks.iter().map(|task| task.end_s - task.start_s).sum();
    assert!(covered > 0.9 * last.time_s, "{covered} of {}", last.time_s);
}

#[test]
fn picture_of_a_small_layout_is_unchanged() {
    let base = {
        let mut recipe = Recipe::at_level(env_core::task(SCANNING).unwrap(), 3).unwrap();
        recipe = recipe.with_param("time_limit_s", 1800.0).unwrap();
        DesignBrief::new(Arc::new(recipe), 1, 3).base_scenario(0)
    };
    let mut design = design_json(SCANNING, "wheels");
    design["start"]["wheels_percent"] = json!(72);
    design["outages"] = json!([0, 4]);
    let (scenario, _) = empty_gate().language().build(&design, &base).unwrap();
    let bracket = scenario.task().bracket(&scenario).unwrap();
    let svg = draw("small", Some(&design), &scenario, &bracket);
    // The coast is long, and has its own test.
    let lines: Vec<&str> = svg.lines().filter(|line| !line.contains("#46566b")).collect();
    insta::assert_snapshot!(lines.join("\n"));
}

#[test]
fn layouts_without_a_design_are_drawn() {
    let scenario = Scenario::from_json(&json!({
        "task": SCANNING, "seed": 3, "params": {"time_limit_s": 3000},
        "layout": {"mode": "replace", "bodies": {"epoch": [[2010, 172, 0]], "outages": [[2]]}},
    }))
    .unwrap();
    let bracket = scenario.task().bracket(&scenario).unwrap();
    let svg = draw("by hand </text><script>", None, &scenario, &bracket);
    let document = Document::parse(&svg).unwrap();
    let texts = texts(&document);
    assert!(texts.iter().any(|text| text.starts_with("without a design")), "{texts:?}");
    assert!(texts.contains(&"Singapore"), "stations out of service are named: {texts:?}");
    assert!(document.descendants().all(|node| node.tag_name().name() != "script"));
}
