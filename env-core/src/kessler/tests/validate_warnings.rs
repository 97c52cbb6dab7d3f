//! Conjunction warnings: exact ones come true, noisy ones have the documented errors, and reading them
//! changes nothing.

use std::collections::BTreeMap;

use serde_json::json;

use super::at_level;
use super::staging::{StagedPass, separate_satellites, staged_scenario, start_sim};
use crate::kessler::kernel::{Body, Gravity, collision_probability};
use crate::kessler::telemetry::KesslerTelemetry;
use crate::kessler::warnings::{Conjunction, NOISE_GROWTH, SCREENING_DISTANCE, WARNING_LOOK_AHEAD};
use crate::log::JointAction;
use crate::task::Scenario;

/// Positions of one body after each step, as the engine propagated it.
type RecordedPath = Vec<(f64, f64)>;

/// Closest approach of two recorded paths.
#[derive(Debug, Clone, Copy)]
struct RecordedApproach {
    /// Time, TU from the start of the paths.
    time: f64,
    /// Distance of the closest approach, LU.
    miss: f64,
    /// Relative speed at that time, LU/TU.
    speed: f64,
}

/// Deepest closest approach of two paths made of straight lines, from positions alone: where the squared
/// distance turns from falling to rising, within a line or at a bend.
fn deepest_approach(a: &RecordedPath, b: &RecordedPath) -> Option<RecordedApproach> {
    let mut best: Option<RecordedApproach> = None;
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
            if miss < SCREENING_DISTANCE && best.is_none_or(|best| miss < best.miss) {
                best = Some(RecordedApproach { time: step as f64 + t, miss, speed: w.0.hypot(w.1) });
            }
        }
    }
    best
}

/// Reads warnings at step `now`, holds from there, and finds in the recorded paths every conjunction that was
/// warned of, and no other. Rogues that arrive later have no warning. Returns the number of conjunctions.
fn count_true_warnings(scenario: &Scenario, now: u32) -> usize {
    let mut sim = start_sim(scenario);
    let kick = [0.3, -0.2, -0.1, 0.25, 0.2, 0.2];
    for _ in 0..now {
        sim.step(JointAction { agents: &[0, 1, 2], values: &kick }).unwrap();
    }
    let warnings = sim.conjunctions(true).unwrap();
    let ids: Vec<u32> = (0..sim.debris().len()).map(|i| sim.debris().id(i)).collect();
    let mut satellites: [RecordedPath; 3] = Default::default();
    let mut debris: BTreeMap<u32, RecordedPath> = ids.iter().map(|&id| (id, RecordedPath::new())).collect();
    for step in 0..=WARNING_LOOK_AHEAD {
        for (path, s) in satellites.iter_mut().zip(sim.satellites()).filter(|(_, s)| s.is_active()) {
            path.push((s.body.x, s.body.y));
        }
        for i in 0..sim.debris().len() {
            let Body { x, y, .. } = sim.debris().body(i);
            if let Some(path) = debris.get_mut(&sim.debris().id(i)) {
                path.push((x, y));
            }
        }
        if step < WARNING_LOOK_AHEAD {
            sim.step(JointAction::HOLD).unwrap();
        }
    }
    let mut expected = 0;
    for (number, satellite) in (0u32..).zip(&satellites) {
        for (&id, path) in &debris {
            let row = warnings.iter().find(|c| (c.satellite_id, c.debris_id) == (number, id));
            match (deepest_approach(satellite, path), row) {
                (None, None) => {}
                // A bend at the very start counts if they were approaching before, which positions alone do
                // not show.
                (None, Some(row)) => {
                    assert_eq!(row.time_to_closest_approach, 0.0, "{row:?} did not come true");
                }
                (Some(approach), None) => panic!("{number} and {id}: {approach:?} has no warning"),
                (Some(RecordedApproach { time, miss, speed }), Some(row)) => {
                    expected += 1;
                    // A step and its forecast are the same operations. The paths here are differences of
                    // positions with a rounding of 1e-14, over relative speeds of 1e-2 LU/TU and more: 1e-9
                    // is ample.
                    assert!((row.time_to_closest_approach - time).abs() < 1e-9, "{row:?} {time}");
                    assert!((row.miss_distance - miss).abs() < 1e-9, "{row:?} {miss}");
                    assert!((row.relative_speed - speed).abs() < 1e-9, "{row:?} {speed}");
                    let sigma = sim.setup().sigma;
                    assert_eq!(row.probability, collision_probability(row.miss_distance, sigma));
                }
            }
        }
    }
    assert!(warnings.is_sorted_by(|a, b| {
        let key = |c: &Conjunction| (c.satellite_id, c.time_to_closest_approach);
        key(a) <= key(b)
    }));
    expected
}

/// Under `risk: pc` nothing is destroyed, so every conjunction can be followed to its end.
#[test]
fn validate_warnings_exact_ones_come_true() {
    let mut conjunctions = 0;
    for (task, level) in [("survival", 3), ("eco_station", 2), ("rendezvous", 6), ("formation", 8)] {
        for gravity in ["point", "j2"] {
            for seed in 0..24 {
                let scenario = at_level(&format!("kessler/{task}"), level, seed);
                let recipe = scenario.recipe().as_ref().clone();
                let recipe = recipe.with_option("warnings", "exact").unwrap();
                let recipe =
                    recipe.with_option("risk", "pc").unwrap().with_option("gravity", gravity).unwrap();
                conjunctions +=
                    count_true_warnings(&Scenario::new(recipe, scenario.seed()), seed as u32 % 10);
            }
        }
    }
    println!("{conjunctions} conjunctions came true");
    assert!(conjunctions > 400);
}

fn telemetry_with(warnings: &str, sigma: f64, seed: u64) -> KesslerTelemetry {
    let passes = [(3.0, 3.0, 0.5), (7.5, 2.5, 2.2), (14.0, 3.0, 2.8)]
        .map(|(time, miss, heading)| StagedPass { time, miss, speed: 5.0, heading });
    let debris = passes.map(|pass| pass.start(separate_satellites()[0], Gravity::Point));
    let scenario = staged_scenario(
        &separate_satellites(),
        &debris,
        &json!({"warnings": warnings}),
        &json!({"sigma": sigma}),
        seed,
    );
    start_sim(&scenario).telemetry(0.0, false)
}

/// Warning of satellite 0 for each debris body.
fn warnings_of_satellite_0(telemetry: &KesslerTelemetry) -> [Conjunction; 3] {
    std::array::from_fn(|id| {
        let mut rows = telemetry.conjunctions.iter().flatten();
        *rows.find(|c| c.satellite_id == 0 && c.debris_id as usize == id).unwrap()
    })
}

/// Over many seeds the error of the miss and, along the relative velocity, that of the time have mean 0 and
/// the standard deviation σ·4·t/15. The probability is that of the reported miss with both uncertainties
/// together.
#[test]
fn validate_warnings_noise_grows_with_look_ahead() {
    // So small that a miss of 2.5 LU never comes near zero, where distances are folded, and that an error
    // along the course never changes the miss.
    const SIGMA: f64 = 0.05;
    const SEEDS: u64 = 4_000;
    let exact = warnings_of_satellite_0(&telemetry_with("exact", SIGMA, 0));
    let mut sums = [[0.0f64; 4]; 3];
    for seed in 0..SEEDS {
        for ((noisy, exact), sum) in
            warnings_of_satellite_0(&telemetry_with("noisy", SIGMA, seed)).iter().zip(&exact).zip(&mut sums)
        {
            let across = noisy.miss_distance - exact.miss_distance;
            let late = noisy.time_to_closest_approach - exact.time_to_closest_approach;
            let along = late * exact.relative_speed;
            for (sum, value) in sum.iter_mut().zip([across, across * across, along, along * along]) {
                *sum += value / SEEDS as f64;
            }
            assert_eq!(noisy.relative_speed, exact.relative_speed);
            let error = SIGMA * NOISE_GROWTH * exact.time_to_closest_approach / WARNING_LOOK_AHEAD as f64;
            let sigma = (SIGMA * SIGMA + error * error).sqrt();
            assert_eq!(noisy.probability, collision_probability(noisy.miss_distance, sigma));
        }
    }
    for (sum, time) in sums.iter().zip([3.0, 7.5, 14.0]) {
        let deviation = SIGMA * 4.0 * time / 15.0;
        println!(
            "{time} TU: error {deviation:.4}, measured across {:.4}, along {:.4}",
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

/// Noise is drawn anew in each step and for each pair and depends on the seed. Reading warnings draws nothing
/// from the episode.
#[test]
fn validate_warnings_change_no_draw() {
    let observe = |warnings: &str, looks: usize| {
        let scenario = at_level("kessler/rendezvous", 9, 3);
        let recipe = scenario.recipe().as_ref().clone().with_option("warnings", warnings).unwrap();
        let mut sim = start_sim(&Scenario::new(recipe, scenario.seed()));
        let mut warnings = Vec::new();
        while !sim.is_done() {
            for _ in 0..looks {
                warnings.push(sim.telemetry(0.0, false).conjunctions);
            }
            sim.step(JointAction::HOLD).unwrap();
        }
        (sim.state_hash(), warnings)
    };
    let (never, once, twice, none) =
        (observe("noisy", 0), observe("noisy", 1), observe("noisy", 2), observe("none", 1));
    assert!(never.0 == once.0 && once.0 == twice.0 && none.0 == never.0);
    for (number, warnings) in once.1.iter().enumerate() {
        assert!(warnings == &twice.1[2 * number] && warnings == &twice.1[2 * number + 1]);
    }
    assert!(none.1.iter().all(Option::is_none));
    let conjunctions = once.1.iter().flatten().map(Vec::len).sum::<usize>();
    assert!(conjunctions > 20, "{conjunctions}");
    // Only callers that see everything are warned of hidden debris.
    let scenario = at_level("kessler/survival", 9, 3);
    let recipe = scenario.recipe().as_ref().clone().with_option("warnings", "exact").unwrap();
    let sim = start_sim(&Scenario::new(recipe, scenario.seed()));
    let (visible, all) = (sim.conjunctions(false).unwrap(), sim.conjunctions(true).unwrap());
    assert!(visible.len() < all.len() && visible.iter().all(|c| all.contains(c)));
}

/// Telemetry has warnings only if the option asks for them, and it reads back unchanged.
#[test]
fn telemetry_omits_absent_fields_and_reads_back() {
    let plain = serde_json::to_value(telemetry_with("none", 0.5, 1)).unwrap();
    for field in ["conjunctions", "target_separation"] {
        assert!(plain.get(field).is_none(), "{field}");
    }
    assert!(plain["satellites"][0].get("survival_probability").is_none());
    let with_warnings = telemetry_with("exact", 0.5, 1);
    let wire = serde_json::to_value(&with_warnings).unwrap();
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
    assert_eq!(serde_json::from_value::<KesslerTelemetry>(wire).unwrap(), with_warnings);
    assert_eq!(serde_json::from_value::<KesslerTelemetry>(plain).unwrap(), telemetry_with("none", 0.5, 1));
    let formation = start_sim(&at_level("kessler/formation", 0, 1)).telemetry(0.0, false);
    assert_eq!(serde_json::to_value(formation).unwrap()["target_separation"], 20.0);
    let at_risk = staged_scenario(&separate_satellites(), &[], &json!({"risk": "pc"}), &json!({}), 1);
    let at_risk = serde_json::to_value(start_sim(&at_risk).telemetry(0.0, false)).unwrap();
    assert_eq!(at_risk["satellites"][2]["survival_probability"], 1.0);
}
