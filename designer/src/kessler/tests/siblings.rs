//! Easier and harder siblings of designs.

use std::sync::Arc;

use env_core::Recipe;
use serde_json::{Value, json};

use crate::brief::{LayoutOutcome, PastLayout};
use crate::kessler::Design;
use crate::procedural::ProceduralDesigner;
use crate::test_support::siblings;
use crate::{DesignBrief, DesignLanguage, EditDirection, design_language};

fn language() -> &'static dyn DesignLanguage {
    design_language(env_core::task("kessler/survival").unwrap()).unwrap()
}

fn brief() -> DesignBrief {
    let task = env_core::task("kessler/survival").unwrap();
    let recipe = Recipe::at_level(task, 4).unwrap();
    DesignBrief::new(Arc::new(recipe), 4, 3).at_level(task.levels(), 4)
}

/// Difficulty of a design: number of encounters, sum of speeds, and, negated, sums of steps and miss distances.
fn difficulty(design: &Value) -> [i64; 4] {
    let Design { encounters, .. } = Design::from_json(design).unwrap();
    let sum =
        |of: fn(&crate::kessler::Encounter) -> u32| encounters.iter().map(|e| i64::from(of(e))).sum::<i64>();
    let [speeds, steps, misses] = [sum(|e| e.relative_speed), sum(|e| e.step), sum(|e| e.miss_distance)];
    [encounters.len() as i64, speeds, -steps, -misses]
}

#[test]
fn siblings_differ_in_one_direction() {
    for (direction, sign) in [(EditDirection::Easier, -1), (EditDirection::Harder, 1)] {
        let pairs = siblings(language(), &brief(), direction, 60);
        assert!(pairs.len() > 20, "{}", pairs.len());
        let mut changed = [0; 4];
        for [parent, sibling] in pairs {
            let (before, after) = (difficulty(&parent), difficulty(&sibling));
            let changes: [i64; 4] = std::array::from_fn(|i| sign * (after[i] - before[i]));
            assert!(changes[0] >= 0 && changes[1] >= 0, "{parent} {sibling}");
            // Other sums shrink with the number of encounters.
            assert!(changes[0] > 0 || changes[2] >= 0 && changes[3] >= 0, "{parent} {sibling}");
            (0..4).for_each(|i| changed[i] += u32::from(changes[i] > 0));
        }
        assert!(changed.iter().all(|count| *count > 0), "{direction:?}: {changed:?}");
    }
}

/// The procedural designer eases layouts on which the agent fails, and hardens those on which it succeeds.
#[test]
fn success_decides_the_direction_of_edits() {
    let encounter = |satellite: u32, step: u32| {
        json!({"satellite": satellite, "step": step, "bearing_deg": 200, "relative_speed": 45, "miss_distance": 9,
               "kind": "threat", "rogue": false})
    };
    let design = json!({
        "name": "x", "aim": {"mode": "collision", "bearing_deg": 200}, "frame": "inertial", "params": {},
        "encounters": [encounter(0, 12), encounter(1, 16), encounter(2, 20)],
    });
    for (success_rate, sign) in [(0.0, -1), (1.0, 1)] {
        let outcome = LayoutOutcome::Evaluated {
            episodes: 16,
            success_rate,
            regret: 0.5,
            aimed_share: None,
            is_retired: false,
        };
        let mut brief = brief();
        brief.past_layouts =
            vec![PastLayout { design: design.clone(), rung: brief.rung(), seed: None, outcome }];
        let designs = ProceduralDesigner::preview(&brief, language(), 80);
        // Without known failures, all samples are in the other frame.
        let children: Vec<_> = designs.iter().filter(|child| child["frame"] == "inertial").collect();
        assert!(children.len() >= 5, "{}", children.len());
        for child in children {
            let (before, after) = (difficulty(&design), difficulty(child));
            assert!(sign * (after[0] - before[0]) >= 0 && sign * (after[1] - before[1]) >= 0, "{child}");
        }
    }
}
