//! Conjunction warnings: exact ones come true, noisy ones err as documented, and looking shifts nothing.

use std::collections::BTreeMap;

use serde_json::json;

use super::at_level;
use super::staging::{Pass, apart, flight, staged};
use crate::kessler::kernel::{Body, Gravity, collision_probability};
use crate::kessler::telemetry::Telemetry;
use crate::kessler::warnings::{Conjunction, LOOK_AHEAD, NOISE_GROWTH, SCREENING};
use crate::log::JointAction;
use crate::scenario::Scenario;

/// Positions of one body from now on, step by step, as the engine flew it.
type Flown = Vec<(f64, f64)>;

/// The deepest closest approach of two courses made of straight lines: time, distance, relative speed. From positions
/// alone: where the slope of the distance squared turns from falling to rising, within a line or at a bend.
fn deepest(a: &Flown, b: &Flown) -> Option<(f64, f64, f64)> {
    let mut best: Option<(f64, f64, f64)> = None;
    let mut falling = false;
    for (step, (a, b)) in a.windows(2).zip(b.windows(2)).enumerate() {
        let start = (a[0].0 - b[0].0, a[0].1 - b[0].1);
        let end = (a[1].0 - b[1].0, a[1].1 - b[1].1);
        let w = (end.0 - start.0, end.1 - start.1);
        let (at_start, at_end) = (start.0 * w.0 + start.1 * w.1, end.0 * w.0 + end.1 * w.1);
        let within = if at_start < 0.0 && at_end >= 0.0 {
            Some(-at_start / (w.0 * w.0 + w.1 * w.1))
        } else {
            (falling && at_start >= 0.0).then_some(0.0)
        };
        falling = at_end < 0.0;
        if let Some(t) = within {
            let miss = (start.0 + w.0 * t).hypot(start.1 + w.1 * t);
            if miss < SCREENING && best.is_none_or(|(_, least, _)| miss < least) {
                best = Some((step as f64 + t, miss, w.0.hypot(w.1)));
            }
        }
    }
    best
}

/// Asks for warnings at `now`, holds from there, and finds in what was flown every conjunction that was foretold, and
/// no other. Rogues that came later were not foretold.
fn come_true(scenario: &Scenario, now: u32) -> usize {
    let mut flight = flight(scenario);
    let kick = [0.3, -0.2, -0.1, 0.25, 0.2, 0.2];
    for _ in 0..now {
        flight.step(JointAction { agents: &[0, 1, 2], values: &kick }).unwrap();
    }
    let told = flight.conjunctions(true).unwrap();
    let ids: Vec<u32> = (0..flight.debris().len()).map(|i| flight.debris().id(i)).collect();
    let mut satellites: [Flown; 3] = Default::default();
    let mut debris: BTreeMap<u32, Flown> = ids.iter().map(|&id| (id, Flown::new())).collect();
    for step in 0..=LOOK_AHEAD {
        for (flown, s) in satellites.iter_mut().zip(flight.satellites()).filter(|(_, s)| s.active()) {
            flown.push((s.body.x, s.body.y));
        }
        for i in 0..flight.debris().len() {
            let Body { x, y, .. } = flight.debris().body(i);
            if let Some(flown) = debris.get_mut(&flight.debris().id(i)) {
                flown.push((x, y));
            }
        }
        if step < LOOK_AHEAD {
            flight.step(JointAction::HOLD).unwrap();
        }
    }
    let mut expected = 0;
    for (number, satellite) in (0u32..).zip(&satellites) {
        for (&id, course) in &debris {
            let row = told.iter().find(|c| (c.satellite_id, c.debris_id) == (number, id));
            match (deepest(satellite, course), row) {
                (None, None) => {}
                // At the very start a bend counts if they were approaching before, which positions alone do not say.
                (None, Some(row)) => {
                    assert_eq!(row.time_to_closest_approach, 0.0, "{row:?} did not come true");
                }
                (Some(found), None) => panic!("{number} and {id}: {found:?} was not foretold"),
                (Some((time, miss, speed)), Some(row)) => {
                    expected += 1;
                    // A step and its forecast are the same operations; the courses here are differences of positions,
                    // with a rounding of 1e-14, over relative speeds of 1e-2 LU/TU and more: 1e-9 is ample.
                    assert!((row.time_to_closest_approach - time).abs() < 1e-9, "{row:?} {time}");
                    assert!((row.miss_distance - miss).abs() < 1e-9, "{row:?} {miss}");
                    assert!((row.relative_speed - speed).abs() < 1e-9, "{row:?} {speed}");
                    let sigma = flight.setup().sigma;
                    assert_eq!(row.probability, collision_probability(row.miss_distance, sigma));
                }
            }
        }
    }
    assert!(told.is_sorted_by(|a, b| {
        let key = |c: &Conjunction| (c.satellite_id, c.time_to_closest_approach);
        key(a) <= key(b)
    }));
    expected
}

/// Under `risk: pc` nothing destroys, so that every conjunction can be watched to its end.
#[test]
fn validate_warnings_exact_ones_come_true() {
    let mut found = 0;
    for (task, level) in [("survival", 3), ("eco_station", 2), ("rendezvous", 6), ("formation", 8)] {
        for gravity in ["point", "j2"] {
            for seed in 0..24 {
                let scenario = at_level(&format!("kessler/{task}"), level, seed);
                let recipe = scenario.recipe().as_ref().clone();
                let recipe = recipe.with_option("warnings", "exact").unwrap();
                let recipe =
                    recipe.with_option("risk", "pc").unwrap().with_option("gravity", gravity).unwrap();
                found += come_true(&Scenario::new(recipe, scenario.seed()), seed as u32 % 10);
            }
        }
    }
    println!("{found} conjunctions came true");
    assert!(found > 400);
}

fn warned(warnings: &str, sigma: f64, seed: u64) -> Telemetry {
    let passes = [(3.0, 3.0, 0.5), (7.5, 2.5, 2.2), (14.0, 3.0, 2.8)].map(|(time, miss, heading)| Pass {
        time,
        miss,
        speed: 5.0,
        heading,
    });
    let debris = passes.map(|pass| pass.start(apart()[0], Gravity::Point));
    let scenario = staged(&apart(), &debris, &json!({"warnings": warnings}), &json!({"sigma": sigma}), seed);
    flight(&scenario).telemetry(0.0, false)
}

/// Of each debris the row that warns satellite 0.
fn rows(telemetry: &Telemetry) -> [Conjunction; 3] {
    std::array::from_fn(|id| {
        let mut rows = telemetry.conjunctions.iter().flatten();
        *rows.find(|c| c.satellite_id == 0 && c.debris_id as usize == id).unwrap()
    })
}

/// Over many seeds: the error of the miss and, along the relative velocity, that of the time have mean 0 and the
/// standard deviation σ·4·t/15, and the probability is that of the miss told and of both uncertainties together.
#[test]
fn validate_warnings_noise_grows_with_look_ahead() {
    // So small that a miss of 2.5 LU never comes near zero, where distances are folded, and the part of the error along
    // the course never changes the miss.
    const SIGMA: f64 = 0.05;
    const SEEDS: u64 = 4_000;
    let exact = rows(&warned("exact", SIGMA, 0));
    let mut sums = [[0.0f64; 4]; 3];
    for seed in 0..SEEDS {
        for ((noisy, exact), sum) in rows(&warned("noisy", SIGMA, seed)).iter().zip(&exact).zip(&mut sums) {
            let across = noisy.miss_distance - exact.miss_distance;
            let late = noisy.time_to_closest_approach - exact.time_to_closest_approach;
            let along = late * exact.relative_speed;
            for (sum, value) in sum.iter_mut().zip([across, across * across, along, along * along]) {
                *sum += value / SEEDS as f64;
            }
            assert_eq!(noisy.relative_speed, exact.relative_speed);
            let error = SIGMA * NOISE_GROWTH * exact.time_to_closest_approach / LOOK_AHEAD as f64;
            let sigma = (SIGMA * SIGMA + error * error).sqrt();
            assert_eq!(noisy.probability, collision_probability(noisy.miss_distance, sigma));
        }
    }
    for (sum, time) in sums.iter().zip([3.0, 7.5, 14.0]) {
        let deviation = SIGMA * 4.0 * time / 15.0;
        println!(
            "{time} TU: error {deviation:.4}, found across {:.4}, along {:.4}",
            sum[1].sqrt(),
            sum[3].sqrt()
        );
        // Five standard errors: of a mean s/√n, of a mean square s²·√(2/n).
        let n = SEEDS as f64;
        for (mean, square) in [(sum[0], sum[1]), (sum[2], sum[3])] {
            assert!(mean.abs() < 5.0 * deviation / n.sqrt(), "{time}: {mean}");
            assert!(
                (square / (deviation * deviation) - 1.0).abs() < 5.0 * (2.0 / n).sqrt(),
                "{time}: {square}"
            );
        }
    }
}

/// Noise is drawn anew in each step and for each pair, belongs to the seed, and looking draws nothing from the episode.
#[test]
fn validate_warnings_shift_nothing() {
    let fly = |warnings: &str, looks: usize| {
        let scenario = at_level("kessler/rendezvous", 9, 3);
        let recipe = scenario.recipe().as_ref().clone().with_option("warnings", warnings).unwrap();
        let mut flight = flight(&Scenario::new(recipe, scenario.seed()));
        let mut seen = Vec::new();
        while !flight.done() {
            for _ in 0..looks {
                seen.push(flight.telemetry(0.0, false).conjunctions);
            }
            flight.step(JointAction::HOLD).unwrap();
        }
        (flight.state_hash(), seen)
    };
    let (never, once, twice, none) = (fly("noisy", 0), fly("noisy", 1), fly("noisy", 2), fly("none", 1));
    assert!(never.0 == once.0 && once.0 == twice.0 && none.0 == never.0);
    for (number, seen) in once.1.iter().enumerate() {
        assert!(seen == &twice.1[2 * number] && seen == &twice.1[2 * number + 1]);
    }
    assert!(none.1.iter().all(Option::is_none));
    let conjunctions = once.1.iter().flatten().map(Vec::len).sum::<usize>();
    assert!(conjunctions > 20, "{conjunctions}");
    // Hidden debris is warned of only to those who may see everything.
    let scenario = at_level("kessler/survival", 9, 3);
    let recipe = scenario.recipe().as_ref().clone().with_option("warnings", "exact").unwrap();
    let flight = flight(&Scenario::new(recipe, scenario.seed()));
    let (seen, all) = (flight.conjunctions(false).unwrap(), flight.conjunctions(true).unwrap());
    assert!(seen.len() < all.len() && seen.iter().all(|c| all.contains(c)));
}

/// The wire: nothing of it unless asked for, and what is written reads back.
#[test]
fn warnings_on_the_wire() {
    let plain = serde_json::to_value(warned("none", 0.5, 1)).unwrap();
    for field in ["conjunctions", "target_separation"] {
        assert!(plain.get(field).is_none(), "{field}");
    }
    assert!(plain["satellites"][0].get("survival_probability").is_none());
    let told = warned("exact", 0.5, 1);
    let wire = serde_json::to_value(&told).unwrap();
    let mut names: Vec<&String> = wire["conjunctions"][0].as_object().unwrap().keys().collect();
    names.sort();
    assert_eq!(
        names,
        [
            "debris_id",
            "miss_distance",
            "probability",
            "relative_speed",
            "satellite_id",
            "time_to_closest_approach"
        ]
    );
    assert_eq!(serde_json::from_value::<Telemetry>(wire).unwrap(), told);
    assert_eq!(serde_json::from_value::<Telemetry>(plain).unwrap(), warned("none", 0.5, 1));
    let formation = flight(&at_level("kessler/formation", 0, 1)).telemetry(0.0, false);
    assert_eq!(serde_json::to_value(formation).unwrap()["target_separation"], 20.0);
    let at_risk = staged(&apart(), &[], &json!({"risk": "pc"}), &json!({}), 1);
    let at_risk = serde_json::to_value(flight(&at_risk).telemetry(0.0, false)).unwrap();
    assert_eq!(at_risk["satellites"][2]["survival_probability"], 1.0);
}
