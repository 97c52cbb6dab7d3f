//! `risk: pc` against Monte Carlo, and against the engine's own swept contacts.

use serde_json::json;

use super::staging::{Pass, apart, flight, staged};
use crate::chance::{Chance, Seeded, Stream};
use crate::kessler::TASKS;
use crate::kessler::constants::{CONTACT_DISTANCE, SURVIVED};
use crate::kessler::event::Event;
use crate::kessler::flight::Flight;
use crate::kessler::kernel::{Gravity, collision_probability};
use crate::kessler::setup::{Setup, Start};
use crate::log::JointAction;
use crate::seed::Seed;

const DRAWS: u32 = 200_000;

/// Four standard deviations of the share of `DRAWS` draws, each a hit with probability p: one run in 16 000 is beyond.
fn tolerance(p: f64) -> f64 {
    4.0 * (p * (1.0 - p) / f64::from(DRAWS)).sqrt()
}

fn normals(seed: u64) -> impl FnMut() -> (f64, f64) {
    let chance = Seeded::new(Seed::user(seed).unwrap());
    let mut number = 0;
    move || {
        number += 1;
        chance.first_normals(Stream::Warning { step: 0, satellite: 0, debris: number })
    }
}

/// Straight courses through a relative position that is uncertain by σ on each axis.
#[test]
fn validate_pc_against_monte_carlo() {
    let cases = [(0.0, 0.5), (1.5, 0.5), (2.0, 0.5), (3.0, 0.5), (0.0, 3.0), (4.0, 3.0), (10.0, 8.0)];
    for (case, (miss, sigma)) in (0u64..).zip(cases) {
        let mut draw = normals(case);
        let (sin, cos) = libm::sincos(0.7 + case as f64);
        let hits = (0..DRAWS)
            .filter(|_| {
                let (a, b) = draw();
                // Relative position at the nominal closest approach, and distance of the line through it along the
                // relative velocity (cos, sin).
                let (x, y) = (-miss * sin + sigma * a, miss * cos + sigma * b);
                (y * cos - x * sin).abs() < CONTACT_DISTANCE
            })
            .count();
        let share = hits as f64 / f64::from(DRAWS);
        let p = collision_probability(miss, sigma);
        println!("miss {miss}, sigma {sigma}: {share:.5}, formula {p:.5}");
        assert!((share - p).abs() <= tolerance(p), "miss {miss}, sigma {sigma}: {share} {p}");
    }
}

/// An encounter flown by the engine under `risk: pc`, against the same encounter flown many times by the engine under
/// `contact: swept`, the debris displaced at random where they pass. Courses are straight within
/// a step, as the formula has it; only what is displaced along its course by more than half a step's way (3 LU, at most one
/// draw in seven) is met in another step, and has been bent by about GM/r³·d·dt² on the way, 0.03 LU. At σ = 2 that shifts a
/// probability by 0.03 · 0.24/LU / 7 = 0.001: the tolerance lets four times as much through.
#[test]
fn validate_pc_of_an_encounter_that_the_engine_flies() {
    for (case, (miss, sigma, heading)) in
        (0u64..).zip([(0.5, 0.5, -1.2), (2.2, 0.5, 0.4), (2.5, 1.5, 2.0), (0.0, 2.0, -2.4)])
    {
        let pass = Pass { time: 4.5, miss, speed: 6.0, heading };
        let debris = pass.start(apart()[0], Gravity::Point);
        let at_risk = staged(&apart(), &[debris], &json!({"risk": "pc"}), &json!({"sigma": sigma}), 1);
        let mut flown = flight(&at_risk);
        let mut passed = Vec::new();
        for _ in 0..8 {
            flown.step(JointAction::HOLD).unwrap();
            passed.extend(
                flown
                    .events()
                    .iter()
                    .copied()
                    .filter(|event| matches!(event, Event::Passed { satellite: 0, .. })),
            );
        }
        let [Event::Passed { miss: told, probability, .. }] = passed[..] else { panic!("{passed:?}") };
        // The backward and forward trip of 5 steps closes to 1e-9.
        assert!((told - miss).abs() < 1e-9);
        assert_eq!(flown.satellites()[0].survival, 1.0 - probability);

        let mut draw = normals(100 + case);
        let swept = staged(&apart(), &[debris], &json!({"contact": "swept"}), &json!({}), 1);
        let setup = Setup::read(swept.recipe()).unwrap();
        let mut start = Start { satellites: apart(), debris: vec![debris], ..Start::default() };
        let seed = Seed::user(1).unwrap();
        let mut flight = Flight::new(TASKS[0].objective(), setup, &start, Seeded::new(seed));
        let hits = (0..DRAWS)
            .filter(|_| {
                let (a, b) = draw();
                start.debris[0] = pass.start_off(apart()[0], Gravity::Point, (sigma * a, sigma * b));
                flight.restart(&start, Seeded::new(seed));
                (0..8).any(|_| {
                    flight.step(JointAction::HOLD).unwrap();
                    !flight.satellites()[0].active()
                })
            })
            .count();
        let share = hits as f64 / f64::from(DRAWS);
        println!("miss {miss}, sigma {sigma}: {share:.5}, engine {probability:.5}");
        assert!((share - probability).abs() <= tolerance(probability), "{share} {probability}");
    }
}

/// Survival is the product over encounters of 1 − Pc, and stands where `active` stood in reward and success.
#[test]
fn validate_pc_survival_is_a_product_over_encounters() {
    let passes = [(3.5, 2.4, 0.5), (7.25, 2.1, 2.2), (12.75, 2.6, 2.8)].map(|(time, miss, heading)| Pass {
        time,
        miss,
        speed: 5.0,
        heading,
    });
    let debris = passes.map(|pass| pass.start(apart()[0], Gravity::Point));
    let mut flight = flight(&staged(&apart(), &debris, &json!({"risk": "pc"}), &json!({}), 1));
    let mut expected = 1.0;
    for step in 1..=15 {
        let stepped = flight.step(JointAction::HOLD).unwrap();
        for pass in passes.iter().filter(|pass| pass.time.ceil() as u32 == step) {
            expected *= 1.0 - collision_probability(pass.miss, 0.5);
        }
        // Backward and forward trips of 13 steps close to 1e-9; Pc changes by at most 1/(σ√2π) = 0.8 a LU.
        assert!((flight.satellites()[0].survival - expected).abs() < 1e-8, "step {step}");
        let alive: f64 = flight.satellites().iter().map(|s| s.survival).sum();
        assert!((stepped.reward - alive / 3.0 * 0.998 / 50.0).abs() < 1e-15);
    }
    assert!(expected < SURVIVED && flight.satellites()[0].active());
    assert_eq!(flight.flown().lost, 1);
}
