//! The planner under `risk: pc`: what it burns for, and that it can be given up.

use std::cell::Cell;

use super::at_risk;
use crate::bracket::{admit, admit_while};
use crate::kessler::constants::EPSILON;
use crate::rollout::replay;

/// Passages far off cost next to nothing, and a kick moves that a little: no reason to burn.
#[test]
fn the_reference_holds_where_holding_does_as_well() {
    let mut held = 0;
    for task in ["kessler/survival", "kessler/eco_station"] {
        for seed in 0..40 {
            let scenario = at_risk(task, &[("debris", 20.0), ("spread", 1.0), ("sigma", 1.0)], seed);
            let bracket = scenario.task().bracket(&scenario).unwrap();
            assert_eq!(replay(&scenario, &bracket.witness).unwrap(), bracket.reference);
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
                held += 1;
            }
        }
    }
    assert!((10..=70).contains(&held), "{held} of 80 hold: they must differ");
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
            let scenario = at_risk(&format!("kessler/{task}"), params, 3);
            let bracket = scenario.task().bracket(&scenario).unwrap();
            golden.push(format!(
                "v{} {task} {params:?}: floor {:?} reference {:?} fuel {:.3}",
                bracket.planner, bracket.floor, bracket.reference.score, bracket.reference.fuel_used
            ));
        }
    }
    insta::assert_debug_snapshot!(golden);
}

/// Once nobody waits for it, planning ends within a few trials, and nothing half-planned comes out.
#[test]
fn planning_is_given_up_when_nobody_wants_it() {
    for task in ["survival", "eco_station", "rendezvous", "formation"] {
        let params = [("debris", 60.0), ("spread", 1.0), ("sigma", 10.0)];
        let scenario = at_risk(&format!("kessler/{task}"), &params, 1);
        let asked = Cell::new(0u32);
        let patience = |until: u32| {
            asked.set(0);
            let wanted = || {
                asked.set(asked.get() + 1);
                asked.get() <= until
            };
            admit_while(&scenario, &wanted)
        };
        assert_eq!(patience(u32::MAX).as_ref(), Some(&admit(&scenario)));
        let whole = asked.get();
        assert!(whole > 1000, "{task}: asked {whole} times only");
        for until in [0, 1, whole / 2, whole - 1] {
            assert_eq!(patience(until), None);
            // Each search under way may ask once more before it ends: three satellites, two loops, and what is above.
            assert!(asked.get() <= until + 20, "{task}: went on from {until} to {}", asked.get());
        }
    }
}
