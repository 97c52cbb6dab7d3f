//! The scripted agents have the weaknesses that they are named for.

use env_core::Critique;
use env_core::critique::Verdict;

use super::*;
use crate::kessler::agents::{Weakness, agent};

/// Episodes of an agent in 60 contested scenarios.
struct AgentEpisodes {
    /// Satellites that the agent loses.
    lost: u32,
    /// Satellites that are lost by holding.
    lost_by_holding: u32,
    critiques: Vec<Critique>,
}

fn run(weakness: Weakness) -> AgentEpisodes {
    let mut episodes = AgentEpisodes { lost: 0, lost_by_holding: 0, critiques: Vec::new() };
    for seed in 0..60 {
        let base = base_scenario("kessler/survival", seed);
        let (scenario, bracket) = base.task().make_contested(&base).unwrap();
        let mut agent = agent(weakness, &scenario).unwrap();
        let env_core::rollout::Rollout { outcome, log } =
            env_core::rollout::roll_out(&scenario, &mut *agent).unwrap();
        episodes.lost += outcome.lost;
        episodes.lost_by_holding += bracket.panel[0].lost;
        episodes.critiques.push(scenario.task().critique(&scenario, &log).unwrap());
    }
    episodes
}

#[test]
fn agents_beat_holding_and_fail_at_their_weakness() {
    for weakness in Weakness::ALL {
        let name = weakness.name();
        let AgentEpisodes { lost, lost_by_holding, critiques } = run(weakness);
        assert!(lost < lost_by_holding * 2 / 3, "{name}: {lost} of the {lost_by_holding} that hold loses");
        let collisions = critiques.iter().flat_map(|c| &c.failures).filter(|f| f.mode == "collision");
        let encounters: Vec<_> = collisions.filter_map(|failure| failure.encounter.as_ref()).collect();
        let is_near = |bearing: f64, centre: f64, max: f64| angle_between(centre, bearing) <= max;
        match weakness {
            // Debris near the edge of the blind sector may have been visible before, or leave the sector too late.
            Weakness::BlindTowardsY => {
                assert!(encounters.len() > 5, "{name}");
                assert!(
                    encounters.iter().all(|e| is_near(e.bearing_inertial_deg.unwrap(), 90.0, 60.0)),
                    "{encounters:?}"
                );
            }
            Weakness::NeverLooksBehind => {
                assert!(encounters.len() > 5, "{name}");
                assert!(encounters.iter().all(|e| is_near(e.bearing_deg, 270.0, 80.0)), "{encounters:?}");
            }
            Weakness::Late => assert!(encounters.len() > 5, "{name}"),
            Weakness::Nervous => {
                let burns = critiques.iter().flat_map(|c| &c.actions);
                let wasted = burns.clone().filter(|burn| burn.verdict != Verdict::Needed).count();
                assert!(2 * wasted > burns.count(), "{name}: most of its burns are wasted");
            }
        }
    }
}
