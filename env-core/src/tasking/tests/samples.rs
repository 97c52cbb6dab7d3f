//! Set-ups for tests, drawn at random from a seed.

use super::recordings::{load, recordings};
use crate::episode_rng::{EpisodeRng, RngStream, SeededRng};
use crate::seed::Seed;
use crate::tasking::orbit::{GravityModel, OrbitalElements};
use crate::tasking::recording::reference::to_current_format;
use crate::tasking::recording::setup::read_setup;
use crate::tasking::setup::{InitialOrbit, Setup};
use crate::tasking::simulation::{AgentAction, TaskingSim};

/// Random numbers of a test.
pub(super) struct Draws(SeededRng);

impl Draws {
    pub(super) fn new(seed: u64) -> Self {
        Self(SeededRng::new(Seed::user(seed).unwrap()))
    }

    /// A number from 0 to less than 1.
    pub(super) fn uniform(&mut self) -> f64 {
        self.0.uniform(RngStream::Policy)
    }

    /// An index below `count`.
    pub(super) fn index(&mut self, count: usize) -> usize {
        ((self.uniform() * count as f64) as usize).min(count - 1)
    }
}

/// Set-ups of all recorded episodes, traces aside.
pub(super) fn recorded_setups() -> Vec<Setup> {
    let mut setups = Vec::new();
    for path in recordings("recorded").iter().chain(&recordings("reference")) {
        if !path.to_string_lossy().contains("trace") {
            let recording = to_current_format(&load(path)).unwrap();
            setups.push(read_setup(&recording, GravityModel::Ggm10).unwrap());
        }
    }
    setups
}

/// Another scenario of the same set-up: orbits, attitudes, wheels and batteries are drawn anew.
pub(super) fn redraw(setup: &Setup, draws: &mut Draws) -> Setup {
    let mut other = setup.clone();
    let turn = draws.uniform() * 2.0 * std::f64::consts::PI;
    for agent in &mut other.agents {
        let args = &mut agent.satellite.args;
        if let InitialOrbit::Elements(elements) = args.orbit {
            let true_anomaly_rad = elements.true_anomaly_rad + turn;
            args.orbit = InitialOrbit::Elements(OrbitalElements { true_anomaly_rad, ..elements });
        }
        args.sigma_init = [0; 3].map(|_| draws.uniform());
        args.omega_init_rad_s = [0; 3].map(|_| 2e-4 * draws.uniform() - 1e-4);
        args.wheel_speeds_rpm = [0; 3].map(|_| 3000.0 * draws.uniform() - 1500.0);
        args.stored_charge_ws = args.battery_capacity_ws * draws.uniform();
    }
    other
}

/// Random actions of all satellites that need one, and now and then of others.
pub(super) fn random_actions(sim: &TaskingSim, draws: &mut Draws) -> Vec<Option<AgentAction>> {
    (0..sim.len())
        .map(|index| {
            let acts = sim.needs_action(index) || draws.uniform() < 0.1;
            acts.then(|| AgentAction::Index(draws.index(sim.action_count(index))))
        })
        .collect()
}
