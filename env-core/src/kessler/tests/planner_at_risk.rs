//! The planner under `risk: pc`: it burns only where that pays, and it can be cancelled.

use std::cell::Cell;

use super::scenario_at_risk;
use crate::admission::{admit, admit_while};
use crate::kessler::constants::EPSILON;
use crate::rollout::replay;

/// Distant close approaches cost next to nothing, and a kick changes that a little: no reason to burn.
#[test]
fn reference_holds_where_holding_is_as_good() {
    let mut holds = 0;
    for task in ["kessler/survival", "kessler/eco_station"] {
        for seed in 0..40 {
            let scenario = scenario_at_risk(task, &[("debris", 20.0), ("spread", 1.0), ("sigma", 1.0)], seed);
            let bracket = scenario.task().bracket(&scenario).unwrap();
            assert_eq!(replay(&scenario, &bracket.reference_plan).unwrap(), bracket.reference);
            let hold = bracket.panel[0];
            let gain = bracket.reference.score - hold.score;
            assert!(gain > -EPSILON, "{task} {seed}: worse than hold by {gain}");
            if bracket.reference.fuel_used > 0.0 {
                assert!(
                    gain >= EPSILON || bracket.reference.lost < hold.lost,
                    "{task} {seed}: {} fuel for {gain}",
                    bracket.reference.fuel_used
                );
            } else {
                holds += 1;
            }
        }
    }
    assert!((10..=70).contains(&holds), "{holds} of 80 references hold: they must differ");
}

#[test]
fn regress_brackets_at_risk() {
    let cells: [&[(&str, f64)]; 3] = [
        &[("debris", 150.0)],
        &[("debris", 100.0), ("spread", 1.0), ("fuel", 5.0)],
        &[("debris", 60.0), ("spread", 1.0), ("sigma", 5.0), ("rogue_probability", 0.1)],
    ];
    let mut golden = Vec::new();
    for task in ["survival", "eco_station", "rendezvous", "formation"] {
        for params in cells {
            let scenario = scenario_at_risk(&format!("kessler/{task}"), params, 3);
            let bracket = scenario.task().bracket(&scenario).unwrap();
            golden.push(format!(
                "v{} {task} {params:?}: floor {:?} reference {:?} fuel {:.3}",
                bracket.planner_version, bracket.floor, bracket.reference.score, bracket.reference.fuel_used
            ));
        }
    }
    insta::assert_debug_snapshot!(golden);
}

/// Planning ends within a few trials after it is cancelled, and returns no partial bracket.
#[test]
fn planning_ends_soon_after_cancellation() {
    for task in ["survival", "eco_station", "rendezvous", "formation"] {
        let params = [("debris", 60.0), ("spread", 1.0), ("sigma", 10.0)];
        let scenario = scenario_at_risk(&format!("kessler/{task}"), &params, 1);
        let checks = Cell::new(0u32);
        let admit_until = |until: u32| {
            checks.set(0);
            let is_wanted = || {
                checks.set(checks.get() + 1);
                checks.get() <= until
            };
            admit_while(&scenario, &is_wanted)
        };
        assert_eq!(admit_until(u32::MAX).as_ref(), Some(&admit(&scenario)));
        let total = checks.get();
        assert!(total > 1000, "{task}: checked only {total} times");
        for until in [0, 1, total / 2, total - 1] {
            assert_eq!(admit_until(until), None);
            // Each search in progress may check once more before it ends: three satellites, two loops, and
            // their callers.
            assert!(checks.get() <= until + 20, "{task}: continued from {until} to {}", checks.get());
        }
    }
}
