//! The formation task against its definition and measured scores.

use super::staging::start_sim;
use crate::kessler::KESSLER_TASKS;
use crate::kessler::constants::{FORMATION_RADII, FORMATION_SIDE, GM};
use crate::kessler::reward::formation_quality;
use crate::seed::Seed;
use crate::task::{Recipe, Scenario};

fn formation(fuel: f64, seed: u64) -> Scenario {
    let params = [("debris", 0.0), ("fuel", fuel)];
    let recipe = Recipe::with_params(&KESSLER_TASKS[3], params.into_iter()).unwrap();
    Scenario::new(recipe, Seed::user(seed).unwrap())
}

/// Starts are equilateral triangles of side 20 about a centre at 55 to 75 LU, each satellite on the circular
/// prograde orbit of its radius; their quality is 1.
#[test]
fn validate_formation_starts_are_exact() {
    for seed in 0..500 {
        let sim = start_sim(&formation(100.0, seed));
        let bodies = sim.satellites().map(|s| s.body);
        // Bound: rounding of a few ulp of coordinates below 100.
        for (i, j) in [(0, 1), (0, 2), (1, 2)] {
            let side = (bodies[i].x - bodies[j].x).hypot(bodies[i].y - bodies[j].y);
            assert!((side - FORMATION_SIDE).abs() < 1e-12, "seed {seed}: {side}");
        }
        assert!((formation_quality(&bodies) - 1.0).abs() < 1e-13);
        let centre = [bodies.map(|b| b.x), bodies.map(|b| b.y)].map(|c| c.iter().sum::<f64>() / 3.0);
        let radius = centre[0].hypot(centre[1]);
        assert!(radius > FORMATION_RADII.0 - 1e-12 && radius < FORMATION_RADII.1 + 1e-12);
        for b in bodies {
            assert!((b.radius() * (b.vx * b.vx + b.vy * b.vy) - GM).abs() < 1e-10, "circular");
            assert!((b.x * b.vx + b.y * b.vy).abs() < 1e-11, "no radial speed");
            assert!(b.x * b.vy - b.y * b.vx > 0.0, "prograde");
        }
    }
}

/// Quality of triangles of other sides: pairs 25 LU apart are 5 off, which costs 5/20.
#[test]
fn validate_formation_quality_by_hand() {
    let start = start_sim(&formation(100.0, 1)).satellites().map(|s| s.body);
    let scaled = |by: f64| start.map(|b| crate::kessler::kernel::Body { x: b.x * by, y: b.y * by, ..b });
    for (by, expected) in [(1.25, 0.75), (0.75, 0.75), (1.5, 0.5), (2.0, 0.0), (3.0, 0.0), (0.01, 0.01)] {
        assert!((formation_quality(&scaled(by)) - expected).abs() < 1e-13, "{by}");
    }
}

/// Scores of hold and of the planner, against measured values.
#[test]
fn validate_formation_scores_of_hold_and_planner() {
    const SCENARIOS: u64 = 60;
    // The planner must not be worse than the prototype's .998, .94 and .77. At fuel 30 the last two digits
    // are within the spread between draws (0.002 of one scenario, 60 of them here), so .99 is required.
    for (fuel, least) in [(30.0, 0.99), (15.0, 0.94), (5.0, 0.77)] {
        let (mut hold, mut reference) = (0.0, 0.0);
        for seed in 0..SCENARIOS {
            let scenario = formation(fuel, seed);
            let bracket = scenario.task().bracket(&scenario).unwrap();
            hold += bracket.hold_score() / SCENARIOS as f64;
            reference += bracket.reference.score / SCENARIOS as f64;
        }
        println!("fuel {fuel}: hold {hold:.3}, reference {reference:.3}");
        // The hold score depends on the triangle's rotation and radius, with a spread of 0.05 between
        // scenarios: four standard errors of a mean of 60.
        assert!((hold - 0.69).abs() < 0.026, "{hold}");
        assert!(reference >= least, "fuel {fuel}: {reference}");
    }
}
