//! What things cost. Printed, never asserted: other programs run beside it.

use std::time::Instant;

use super::at_level;
use crate::chance::Seeded;
use crate::docking::TASKS;
use crate::docking::constants::MAX_DEPUTIES;
use crate::docking::flight::Flight;
use crate::docking::setup::Setup;
use crate::rollout::fly;
use crate::scenario::{Recipe, Scenario};
use crate::seed::Seed;
use crate::task::TaskSpec;

/// Mean milliseconds over `n` runs, each the best of seven: other programs only ever add to it.
fn milliseconds(n: u64, mut run: impl FnMut(u64)) -> f64 {
    let mut best = |i: u64| {
        let mut once = |_| {
            let start = Instant::now();
            run(i);
            start.elapsed().as_secs_f64() * 1e3
        };
        (0..7).map(&mut once).fold(f64::INFINITY, f64::min)
    };
    (0..n).map(&mut best).sum::<f64>() / n as f64
}

#[test]
#[ignore = "prints what planner, critique and engine cost"]
fn measures_costs() {
    for task in &TASKS {
        for level in [0, 2, 5, 9] {
            let plan = milliseconds(100, |seed| {
                task.bracket(&at_level(task.id(), level, seed)).unwrap();
            });
            print!("{} L{level}: bracket {plan:.2} ms", task.id());
            for name in ["heuristic", "random", "frozen", "hold"] {
                let flown: Vec<_> = (0..50)
                    .map(|seed| {
                        let scenario = at_level(task.id(), level, seed);
                        let mut policy = task.policy(name, &scenario, seed).unwrap();
                        let (_, log) = fly(&scenario, policy.as_mut()).unwrap();
                        (scenario, log)
                    })
                    .collect();
                let cost = milliseconds(50, |i| {
                    let (scenario, log) = &flown[i as usize];
                    task.critique(scenario, log).unwrap();
                });
                print!(", critique of {name} {cost:.2} ms");
            }
            println!();
        }
    }
    let recipe = Recipe::new(&TASKS[1]).unwrap();
    let scenario = Scenario::new(recipe, Seed::user(1).unwrap());
    let setup = Setup::read(scenario.recipe()).unwrap();
    let start = setup.start(&mut Seeded::new(scenario.seed())).unwrap();
    let mut flight = Flight::new(setup, &start);
    let mut seen = [0.0; 24];
    let rounds = (0..5000).map(|_| {
        let (clock, mut steps) = (Instant::now(), 0.0);
        for _ in 0..500 {
            steps += flight.live().iter().filter(|live| **live).count() as f64;
            if flight.fly([[0.1, -0.1, 0.05]; MAX_DEPUTIES]).done {
                flight.restart(&start);
            }
            flight.observe_into(&mut seen);
        }
        steps / clock.elapsed().as_secs_f64() / 1e6
    });
    println!("engine: {:.2} M agent-steps/s with observations", rounds.fold(0.0, f64::max));
}
