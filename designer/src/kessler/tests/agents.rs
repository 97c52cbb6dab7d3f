//! The scripted agents have the weaknesses they are named for, and no others worth speaking of.

use env_core::Critique;
use env_core::critique::Verdict;

use super::*;
use crate::kessler::agents::{ALL, Weakness, agent};

/// What an agent makes of contested scenarios: satellites lost, those that hold loses, and what the critique says.
fn flights(weakness: Weakness) -> (u32, u32, Vec<Critique>) {
    let (mut lost, mut held, mut critiques) = (0, 0, Vec::new());
    for seed in 0..60 {
        let bare = base("kessler/survival", seed, &[]);
        let (scenario, bracket) = bare.task().plant_contested(&bare).unwrap();
        let mut agent = agent(weakness, &scenario).unwrap();
        let (flown, log) = env_core::rollout::fly(&scenario, &mut *agent).unwrap();
        lost += flown.lost;
        held += bracket.panel[0].lost;
        critiques.push(scenario.task().critique(&scenario, &log).unwrap());
    }
    (lost, held, critiques)
}

#[test]
fn each_is_better_than_doing_nothing_and_lost_where_it_is_weak() {
    for (name, weakness) in ALL {
        let (lost, held, critiques) = flights(weakness);
        assert!(lost < held * 2 / 3, "{name}: {lost} of the {held} that hold loses");
        let met = critiques.iter().flat_map(|c| &c.failures).filter(|f| f.mode == "collision");
        let met: Vec<_> = met.filter_map(|failure| failure.encounter.as_ref()).collect();
        let within = |bearing: f64, centre: f64, half: f64| difference(centre, bearing).abs() <= half;
        match weakness {
            // What was at the edge of the blinkers may have been seen before, or come out of them too late.
            Weakness::BlindTowardsY => {
                assert!(met.len() > 5, "{name}");
                assert!(met.iter().all(|m| within(m.bearing_inertial_deg.unwrap(), 90.0, 60.0)), "{met:?}");
            }
            Weakness::NeverLooksBehind => {
                assert!(met.len() > 5, "{name}");
                assert!(met.iter().all(|m| within(m.bearing_deg, 270.0, 80.0)), "{met:?}");
            }
            Weakness::Late => assert!(met.len() > 5, "{name}"),
            Weakness::Nervous => {
                let burns = critiques.iter().flat_map(|c| &c.actions);
                let vain = burns.clone().filter(|burn| burn.verdict != Verdict::Needed).count();
                assert!(2 * vain > burns.count(), "{name}: most of its burns are for nothing");
            }
        }
    }
}
