//! `risk: pc` against Monte Carlo, and against the engine's own swept contacts.

use serde_json::json;

use super::staging::{StagedPass, separate_satellites, staged_scenario, start_sim};
use crate::episode_rng::{EpisodeRng, RngStream, SeededRng};
use crate::kessler::KESSLER_TASKS;
use crate::kessler::constants::{CONTACT_DISTANCE, SURVIVAL_THRESHOLD};
use crate::kessler::event::KesslerEvent;
use crate::kessler::kernel::{Gravity, collision_probability};
use crate::kessler::setup::{InitialState, KesslerSetup};
use crate::kessler::simulation::KesslerSim;
use crate::log::JointAction;
use crate::seed::Seed;

/// Number of Monte Carlo draws.
const MONTE_CARLO_DRAWS: u32 = 200_000;

/// Four standard deviations of the share of hits among the draws, each a hit with probability p. One run in
/// 16 000 is beyond.
fn tolerance(p: f64) -> f64 {
    4.0 * (p * (1.0 - p) / f64::from(MONTE_CARLO_DRAWS)).sqrt()
}

fn normals(seed: u64) -> impl FnMut() -> [f64; 2] {
    let rng = SeededRng::new(Seed::user(seed).unwrap());
    let mut number = 0;
    move || {
        number += 1;
        rng.peek_normals(RngStream::Warning { step: 0, satellite: 0, debris: number })
    }
}

/// Straight courses with a relative position that is uncertain by σ on each axis.
#[test]
fn validate_pc_against_monte_carlo() {
    let cases = [(0.0, 0.5), (1.5, 0.5), (2.0, 0.5), (3.0, 0.5), (0.0, 3.0), (4.0, 3.0), (10.0, 8.0)];
    for (case, (miss, sigma)) in (0u64..).zip(cases) {
        let mut draw = normals(case);
        let (sin, cos) = libm::sincos(0.7 + case as f64);
        let hits = (0..MONTE_CARLO_DRAWS)
            .filter(|_| {
                let [a, b] = draw();
                // Relative position at the nominal closest approach, and distance of the line through it
                // along the relative velocity (cos, sin).
                let (x, y) = (-miss * sin + sigma * a, miss * cos + sigma * b);
                (y * cos - x * sin).abs() < CONTACT_DISTANCE
            })
            .count();
        let share = hits as f64 / f64::from(MONTE_CARLO_DRAWS);
        let p = collision_probability(miss, sigma);
        println!("miss {miss}, sigma {sigma}: {share:.5}, formula {p:.5}");
        assert!((share - p).abs() <= tolerance(p), "miss {miss}, sigma {sigma}: {share} {p}");
    }
}

/// A close approach under `risk: pc` against the same encounter under `contact: swept`, with the debris
/// displaced at random at the closest approach.
///
/// Courses are straight within a step, as the formula assumes. Only debris that is displaced along its course
/// by more than half a step's way (3 LU, at most one draw in seven) is met in another step; gravity has bent
/// its path by about GM/r³·d·dt² by then, 0.03 LU. At σ = 2 that shifts a probability by 0.03 · 0.24/LU / 7 =
/// 0.001: the tolerance is four times as large.
#[test]
fn validate_pc_against_swept_contacts_of_the_engine() {
    for (case, (miss, sigma, heading)) in
        (0u64..).zip([(0.5, 0.5, -1.2), (2.2, 0.5, 0.4), (2.5, 1.5, 2.0), (0.0, 2.0, -2.4)])
    {
        let pass = StagedPass { time: 4.5, miss, speed: 6.0, heading };
        let debris = pass.start(separate_satellites()[0], Gravity::Point);
        let at_risk = staged_scenario(
            &separate_satellites(),
            &[debris],
            &json!({"risk": "pc"}),
            &json!({"sigma": sigma}),
            1,
        );
        let mut risk_sim = start_sim(&at_risk);
        let mut approaches = Vec::new();
        for _ in 0..8 {
            risk_sim.step(JointAction::HOLD).unwrap();
            approaches.extend(
                risk_sim
                    .events()
                    .iter()
                    .copied()
                    .filter(|event| matches!(event, KesslerEvent::CloseApproach { satellite: 0, .. })),
            );
        }
        let [KesslerEvent::CloseApproach { miss: actual_miss, probability, .. }] = approaches[..] else {
            panic!("{approaches:?}")
        };
        // Bound: the backward and forward trip of 5 steps closes to 1e-9.
        assert!((actual_miss - miss).abs() < 1e-9);
        assert_eq!(risk_sim.satellites()[0].survival, 1.0 - probability);

        let mut draw = normals(100 + case);
        let swept =
            staged_scenario(&separate_satellites(), &[debris], &json!({"contact": "swept"}), &json!({}), 1);
        let setup = KesslerSetup::from_recipe(swept.recipe()).unwrap();
        let mut start = InitialState {
            satellites: separate_satellites(),
            debris: vec![debris],
            ..InitialState::default()
        };
        let seed = Seed::user(1).unwrap();
        let mut sim = KesslerSim::new(KESSLER_TASKS[0].objective(), setup, &start, SeededRng::new(seed));
        let hits = (0..MONTE_CARLO_DRAWS)
            .filter(|_| {
                let [a, b] = draw();
                start.debris[0] =
                    pass.displaced_start(separate_satellites()[0], Gravity::Point, [sigma * a, sigma * b]);
                sim.reset(&start, SeededRng::new(seed));
                (0..8).any(|_| {
                    sim.step(JointAction::HOLD).unwrap();
                    !sim.satellites()[0].is_active()
                })
            })
            .count();
        let share = hits as f64 / f64::from(MONTE_CARLO_DRAWS);
        println!("miss {miss}, sigma {sigma}: {share:.5}, engine {probability:.5}");
        assert!((share - probability).abs() <= tolerance(probability), "{share} {probability}");
    }
}

/// Survival is the product of 1 − Pc over close approaches, and replaces the status in reward and success.
#[test]
fn validate_pc_survival_is_a_product() {
    let passes = [(3.5, 2.4, 0.5), (7.25, 2.1, 2.2), (12.75, 2.6, 2.8)]
        .map(|(time, miss, heading)| StagedPass { time, miss, speed: 5.0, heading });
    let debris = passes.map(|pass| pass.start(separate_satellites()[0], Gravity::Point));
    let mut sim =
        start_sim(&staged_scenario(&separate_satellites(), &debris, &json!({"risk": "pc"}), &json!({}), 1));
    let mut expected = 1.0;
    for step in 1..=15 {
        let stepped = sim.step(JointAction::HOLD).unwrap();
        for pass in passes.iter().filter(|pass| pass.time.ceil() as u32 == step) {
            expected *= 1.0 - collision_probability(pass.miss, 0.5);
        }
        // Bound: backward and forward trips of 13 steps close to 1e-9; Pc changes by at most 1/(σ√2π) = 0.8
        // per LU.
        assert!((sim.satellites()[0].survival - expected).abs() < 1e-8, "step {step}");
        let alive: f64 = sim.satellites().iter().map(|s| s.survival).sum();
        assert!((stepped.reward - alive / 3.0 * 0.998 / 50.0).abs() < 1e-15);
    }
    assert!(expected < SURVIVAL_THRESHOLD && sim.satellites()[0].is_active());
    assert_eq!(sim.outcome().lost, 1);
}
