//! The formation task against its definition and DESIGN's measured numbers.

use super::staging::flight;
use crate::kessler::TASKS;
use crate::kessler::constants::{FORMATION_RADII, FORMATION_SIDE, GM};
use crate::kessler::reward::form;
use crate::scenario::{Recipe, Scenario};
use crate::seed::Seed;

fn formation(fuel: f64, seed: u64) -> Scenario {
    let params = [("debris", 0.0), ("fuel", fuel)];
    let recipe = Recipe::with_params(&TASKS[3], params.into_iter()).unwrap();
    Scenario::new(recipe, Seed::user(seed).unwrap())
}

/// An equilateral triangle of side 20 about a centre at 55 to 75 LU, each satellite circular and prograde at its own
/// radius; its form is 1.
#[test]
fn validate_formation_starts_are_exact() {
    for seed in 0..500 {
        let flight = flight(&formation(100.0, seed));
        let bodies = flight.satellites().map(|s| s.body);
        // Rounding: a few ulp of coordinates below 100.
        for (i, j) in [(0, 1), (0, 2), (1, 2)] {
            let side = (bodies[i].x - bodies[j].x).hypot(bodies[i].y - bodies[j].y);
            assert!((side - FORMATION_SIDE).abs() < 1e-12, "seed {seed}: {side}");
        }
        assert!((form(&bodies) - 1.0).abs() < 1e-13);
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

/// A triangle of another side, by hand: pairs 25 apart are 5 off, and 5/20 less than perfect.
#[test]
fn validate_formation_form_by_hand() {
    let start = flight(&formation(100.0, 1)).satellites().map(|s| s.body);
    let scaled = |by: f64| start.map(|b| crate::kessler::kernel::Body { x: b.x * by, y: b.y * by, ..b });
    for (by, expected) in [(1.25, 0.75), (0.75, 0.75), (1.5, 0.5), (2.0, 0.0), (3.0, 0.0), (0.01, 0.01)] {
        assert!((form(&scaled(by)) - expected).abs() < 1e-13, "{by}");
    }
}

/// What holding and the planner earn, against DESIGN §4.5.
#[test]
fn validate_formation_scores_are_those_of_the_design() {
    const SCENARIOS: u64 = 60;
    // DESIGN's .998, .94 and .77 come from a prototype's planner; this one must not be worse. At fuel 30 its two last
    // digits are within the spread between draws (0.002 of one scenario, 60 of them here), so .99 is asked.
    for (fuel, least) in [(30.0, 0.99), (15.0, 0.94), (5.0, 0.77)] {
        let (mut hold, mut reference) = (0.0, 0.0);
        for seed in 0..SCENARIOS {
            let scenario = formation(fuel, seed);
            let bracket = scenario.task().bracket(&scenario).unwrap();
            hold += bracket.hold() / SCENARIOS as f64;
            reference += bracket.reference.score / SCENARIOS as f64;
        }
        println!("fuel {fuel}: hold {hold:.3}, reference {reference:.3}");
        // The hold score depends on the triangle's turn and radius, spread about 0.05 between scenarios: four standard
        // errors of a mean of 60.
        assert!((hold - 0.69).abs() < 0.026, "{hold}");
        assert!(reference >= least, "fuel {fuel}: {reference}");
    }
}
