//! Tests of pictures: well-formed, small, and with the right content.

use std::sync::Arc;

use env_core::docking::end_conditions::DeputyStatus;
use env_core::docking::relative_motion::{distance, speed};
use env_core::{Recipe, Scenario};
use roxmltree::Document;
use serde_json::{Value, json};

use super::scene::DockingScene;
use crate::{AdmittedLayout, DesignBrief, Gate, LayoutView, design_language, draw_layout};

/// An admitted layout of three deputies, two of which are in each other's way.
struct DockingExample {
    design: Value,
    layout: AdmittedLayout,
}

impl DockingExample {
    fn new() -> Self {
        let task = env_core::task("docking/multiagent").unwrap();
        let recipe = Recipe::at_level(task, 4).unwrap();
        let brief = DesignBrief::new(Arc::new(recipe), 1, 3).at_level(task.levels(), 4);
        let deputy = |azimuth: i32, closing: i32, cross: i32| {
            json!({"distance": 900, "azimuth_deg": azimuth, "elevation_deg": 10, "closing_speed": closing,
                   "cross_speed": cross, "cross_deg": 0})
        };
        let deputies = [deputy(80, 40, 0), deputy(120, 40, 0), deputy(300, -20, 60)];
        let aim = json!({"mode": "collision", "bearing_deg": 190});
        let design = json!({"name": "two abreast", "aim": aim, "deputies": deputies});
        let mut gate = Gate::new(design_language(task).unwrap(), Vec::new());
        let layout = gate.judge(&brief, &design, [brief.base_scenario(0)]).unwrap();
        Self { design, layout }
    }

    fn view<'a>(&'a self, name: &'a str, design: Option<&'a Value>) -> LayoutView<'a> {
        LayoutView { name, design, scenario: self.layout.scenario(), bracket: self.layout.bracket() }
    }
}

/// Texts of a picture, in order.
fn texts<'a>(document: &'a Document<'_>) -> Vec<&'a str> {
    let nodes = document.descendants().filter(|node| node.tag_name().name() == "text");
    nodes.filter_map(|node| node.text()).collect()
}

#[test]
fn picture_is_well_formed_and_small() {
    let example = DockingExample::new();
    let svg = draw_layout(example.view("two abreast", Some(&example.design))).unwrap();
    let document = Document::parse(&svg).unwrap();
    assert!(svg.len() < 60_000, "{} bytes", svg.len());
    assert!(!svg.contains("NaN") && !svg.contains("inf "));
    let texts = texts(&document);
    for expected in
        ["two abreast", "threat, aimed at collision from 190°", "3 deputies", "in-track, 90°", "90.0"]
    {
        assert!(texts.iter().any(|text| text.contains(expected)), "{expected:?} in {texts:?}");
    }
    insta::assert_snapshot!(svg);
}

#[test]
fn tracks_begin_at_the_starts_and_end_docked() {
    let example = DockingExample::new();
    let scene = DockingScene::new(example.view("", Some(&example.design))).unwrap();
    assert_eq!(scene.deputies.len(), 3);
    assert!(scene.is_aimed(0) && scene.is_aimed(1) && !scene.is_aimed(2));
    for deputy in &scene.deputies {
        assert!((distance(&deputy.start) - 90.0).abs() < 1e-9);
        assert_eq!((deputy.reference[0], deputy.coast[0]), (deputy.start, deputy.start));
        assert_eq!(deputy.status, DeputyStatus::Docked);
        let end = deputy.reference.last().unwrap();
        assert!(distance(end) <= 0.5 && speed(end) <= 0.2 && deputy.end_step < 600);
        assert!(deputy.reference.len() < 120 && deputy.coast.len() < 120);
    }
}

#[test]
fn untrusted_name_is_escaped() {
    let example = DockingExample::new();
    let name = "</text><script>alert(1)</script>&\"'";
    let svg = draw_layout(example.view(name, Some(&example.design))).unwrap();
    let document = Document::parse(&svg).unwrap();
    assert!(document.descendants().all(|node| node.tag_name().name() != "script"));
    assert!(texts(&document).contains(&name));
}

#[test]
fn layouts_without_a_design_are_drawn() {
    let example = DockingExample::new();
    for design in [None, Some(&json!({"deputies": [{"distance": "far"}]}))] {
        let svg = draw_layout(example.view("by hand", design)).unwrap();
        let document = Document::parse(&svg).unwrap();
        let texts = texts(&document);
        assert!(texts.contains(&"without a design"), "{texts:?}");
        assert!(!texts.contains(&"deputy that matches the aim"));
    }
    let far =
        json!({"task": "docking/single", "seed": 1, "params": {"start_radius": 1000, "thrust_bound": 1}});
    let scenario = Scenario::from_json(&far).unwrap();
    let view =
        LayoutView { name: "drawn", design: None, scenario: &scenario, bracket: example.layout.bracket() };
    Document::parse(&draw_layout(view).unwrap()).unwrap();
}
