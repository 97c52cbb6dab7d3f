//! `contact: swept` against closed forms and dense sampling, and what the end-of-step check misses.

use std::collections::BTreeMap;

use proptest::prelude::*;
use serde_json::json;

use super::staging::{Pass, apart, flight, staged};
use crate::chance::{Chance, Seeded, Stream};
use crate::kessler::TASKS;
use crate::kessler::constants::{CONTACT_2, SATELLITES};
use crate::kessler::kernel::{Gravity, distance_2, swept_2};
use crate::log::JointAction;
use crate::scenario::{Recipe, Scenario};
use crate::seed::Seed;

/// A head-on crossing in the middle of a step: at both ends of it the two are 4 LU apart along their way, so that the
/// end-of-step check sees nothing, and the closest approach is the offset. Closed form: contact if it is below 2 LU.
#[test]
fn validate_swept_head_on_crossings_do_not_tunnel() {
    for (miss, touches) in [(0.0, true), (1.0, true), (1.999, true), (2.001, false), (3.0, false)] {
        for gravity in [Gravity::Point, Gravity::J2] {
            let pass = Pass { time: 4.5, miss, speed: 8.0, heading: -1.57 };
            let debris = pass.start(apart()[0], gravity);
            let lost_at = |contact: &str| {
                let word = if gravity == Gravity::J2 { "j2" } else { "point" };
                let physics = json!({"contact": contact, "gravity": word});
                let mut flight = flight(&staged(&apart(), &[debris], &physics, &json!({}), 1));
                (1..=10).find(|_| {
                    flight.step(JointAction::HOLD).unwrap();
                    !flight.satellites()[0].active()
                })
            };
            assert_eq!(lost_at("end_of_step"), None, "miss {miss}");
            assert_eq!(lost_at("swept"), touches.then_some(5), "miss {miss}");
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(256))]

    /// Against dense sampling of the time within the step.
    #[test]
    fn validate_swept_against_dense_sampling(
        d in (-20.0..20.0f64, -20.0..20.0f64),
        w in (-15.0..15.0f64, -15.0..15.0f64),
    ) {
        const SAMPLES: u32 = 10_000;
        let nearest = swept_2(d.0, d.1, w.0, w.1).sqrt();
        let sampled = (0..=SAMPLES)
            .map(|i| {
                let back = f64::from(i) / f64::from(SAMPLES);
                distance_2(d.0, d.1, w.0 * back, w.1 * back).sqrt()
            })
            .fold(f64::INFINITY, f64::min);
        // No sample is nearer than the closed form (1e-12: rounding), and some sample is at most half a sampling step,
        // half of |w|/10 000, from the nearest place.
        let step = (w.0 * w.0 + w.1 * w.1).sqrt() / f64::from(SAMPLES);
        prop_assert!(sampled >= nearest - 1e-12 && sampled <= nearest + 0.5 * step + 1e-12);
    }
}

/// Encounters in which a pair came nearer than 2 LU under random burns, and those of them that no end of a step shows.
/// Nothing destroys here (`risk: pc`), so that an encounter is counted whole: the steps in a row in which they do.
fn encounters(task: usize, size: f64) -> (u32, u32) {
    let (mut all, mut missed) = (0u32, 0u32);
    for seed in 0..400 {
        let recipe = Recipe::new(&TASKS[task]).unwrap().with_option("risk", "pc").unwrap();
        let mut flight = flight(&Scenario::new(recipe, Seed::user(seed).unwrap()));
        let mut burns = Seeded::new(Seed::user(seed).unwrap());
        // Per satellite and id of debris: was it seen at an end of a step of this encounter?
        let mut open = BTreeMap::new();
        while !flight.done() {
            let values: [f64; 2 * SATELLITES] =
                std::array::from_fn(|_| burns.between(Stream::Policy, -size, size));
            flight.step(JointAction { agents: &[0, 1, 2], values: &values }).unwrap();
            let debris = flight.debris();
            let mut still = BTreeMap::new();
            for (number, s) in flight.satellites().iter().enumerate().filter(|(_, s)| s.active()) {
                for i in 0..debris.len() {
                    let (s, d) = (s.body, debris.body(i));
                    let (dx, dy) = (s.x - d.x, s.y - d.y);
                    if swept_2(dx, dy, s.vx - d.vx, s.vy - d.vy) < CONTACT_2 {
                        let pair = (number, debris.id(i));
                        let before = open.remove(&pair).unwrap_or(false);
                        still.insert(pair, before || dx * dx + dy * dy < CONTACT_2);
                    }
                }
            }
            for (_, seen) in std::mem::replace(&mut open, still) {
                all += 1;
                missed += u32::from(!seen);
            }
        }
    }
    (all, missed)
}

/// DESIGN says 8 to 13 % under random burns. It grows with their size, since burns spread the speeds at which things
/// meet: the ranges are four standard errors (√(p(1 − p)/n), at least 1 150 encounters each) about what was found at
/// ±0.5 LU/TU, 9.5 %, and ±1, 18 %.
#[test]
fn validate_swept_share_of_contacts_that_the_end_of_steps_misses() {
    for (size, range) in [(0.5, 0.06..0.13), (1.0, 0.14..0.23)] {
        let (mut all, mut missed) = (0, 0);
        for task in 0..3 {
            let found = encounters(task, size);
            (all, missed) = (all + found.0, missed + found.1);
        }
        let share = f64::from(missed) / f64::from(all);
        println!("±{size}: {missed} of {all} contacts show at no end of a step: {:.1} %", 100.0 * share);
        assert!(all >= 1_150 && range.contains(&share), "±{size}: {missed} of {all}");
    }
}
