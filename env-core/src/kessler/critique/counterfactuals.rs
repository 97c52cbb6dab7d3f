//! Counterfactuals: single satellites flown again against the ephemeris under other burns than the log's, and
//! evaluated together with the others as they flew. The outcome is that of the engine to the bit; a property
//! test checks it.

use crate::bracket::EpisodeOutcome;
use crate::kessler::constants::{HORIZON, SATELLITES, SURVIVAL_THRESHOLD};
use crate::kessler::kernel::{Body, ClampedBurn, clamp_burn};
use crate::kessler::planner::ephemeris::DebrisEphemeris;
use crate::kessler::planner::evaluate::{losses_with_fragments, outcome_with_losses};
use crate::kessler::planner::trajectory::{PlannedBurn, Trajectory};
use crate::kessler::reward::Objective;
use crate::kessler::setup::{InitialState, KesslerSetup};
use crate::log::ActionLog;
use crate::seed::Seed;

/// Burns of a log, and the trajectories that they give.
pub(super) struct Counterfactuals<'a> {
    objective: Objective,
    setup: &'a KesslerSetup,
    seed: Seed,
    ephemeris: &'a DebrisEphemeris,
    starts: [Body; SATELLITES],
    /// Burns that the log requests, per satellite, before clamping and regardless of fuel.
    requested: [Vec<PlannedBurn>; SATELLITES],
    /// Trajectories of the log. That of a satellite which a fragment hits goes on as if it had not been hit.
    pub(super) trajectories: [Trajectory; SATELLITES],
}

/// Single burn that is tried in place of the log's, and the fuel for it.
#[derive(Debug, Clone, Copy)]
pub(super) struct TrialBurn {
    /// Step, counted from 1.
    pub step: u32,
    /// Change of velocity along x, LU/TU.
    pub dvx: f64,
    /// Change of velocity along y, LU/TU.
    pub dvy: f64,
    /// Fuel before the burn, in fuel units.
    pub fuel: f64,
}

/// Outcome of a plan.
#[derive(Debug, Clone, Copy)]
pub(super) struct CounterfactualOutcome {
    /// Outcome that the engine would give.
    pub outcome: EpisodeOutcome,
    /// Steps survived, weighted by survival probability and summed over the satellites.
    pub survived_steps: f64,
}

impl<'a> Counterfactuals<'a> {
    /// Flies the log's burns.
    pub(super) fn new(
        objective: Objective,
        setup: &'a KesslerSetup,
        start: &InitialState,
        seed: Seed,
        ephemeris: &'a DebrisEphemeris,
        log: &ActionLog,
    ) -> Self {
        let starts = start.satellites;
        let trajectories = starts.map(|body| Trajectory::new(body, setup.fuel));
        let requested = requested_burns(log, setup.physics.upstream_compat);
        let mut counterfactuals = Self { objective, setup, seed, ephemeris, starts, requested, trajectories };
        for satellite in 0..SATELLITES {
            let mut trajectory = counterfactuals.trajectories[satellite].clone();
            counterfactuals.propagate(satellite, &mut trajectory, 1, None);
            counterfactuals.trajectories[satellite] = trajectory;
        }
        counterfactuals
    }

    /// Writes the log's trajectory without the burns of one step to `trajectory`.
    pub(super) fn without_burn(&self, satellite: usize, step: u32, trajectory: &mut Trajectory) {
        trajectory.branch_from(&self.trajectories[satellite], step);
        self.propagate(satellite, trajectory, step, Some(step));
    }

    /// Trajectory of all requested burns with unlimited fuel.
    pub(super) fn with_unlimited_fuel(&self, satellite: usize) -> Trajectory {
        let mut trajectory = Trajectory::new(self.starts[satellite], f64::MAX);
        self.propagate(satellite, &mut trajectory, 1, None);
        trajectory
    }

    /// Writes the log's trajectory up to a step, then one burn in that step, then hold, to `trajectory`. It
    /// is propagated only through step `until`.
    pub(super) fn with_trial_burn(
        &self,
        satellite: usize,
        burn: &TrialBurn,
        until: u32,
        trajectory: &mut Trajectory,
    ) {
        trajectory.branch_from(&self.trajectories[satellite], burn.step);
        trajectory.fuel[burn.step as usize - 1] = burn.fuel;
        let mut is_active = trajectory.advance(self.ephemeris, burn.step, Some((burn.dvx, burn.dvy)));
        for step in burn.step + 1..=until {
            is_active = is_active && trajectory.advance(self.ephemeris, step, None);
        }
    }

    /// Outcome if all satellites hold.
    pub(super) fn hold_outcome(&self) -> CounterfactualOutcome {
        let trajectories = self.starts.map(|body| {
            let mut trajectory = Trajectory::new(body, self.setup.fuel);
            trajectory.propagate_from(self.ephemeris, 1, &[]);
            trajectory
        });
        self.evaluate(trajectories.each_ref())
    }

    /// Outcome of the log.
    pub(super) fn logged_outcome(&self) -> CounterfactualOutcome {
        self.evaluate(self.trajectories.each_ref())
    }

    /// Outcome of the log with the trajectory of one satellite replaced.
    pub(super) fn outcome_with(&self, satellite: usize, trajectory: &Trajectory) -> CounterfactualOutcome {
        self.evaluate(self.replace(satellite, trajectory))
    }

    /// Returns true if a satellite survives through `step` on this trajectory, with the others as they flew.
    /// Points of the trajectory after `step` can at most lose the satellite later.
    pub(super) fn survives_through(&self, satellite: usize, trajectory: &Trajectory, step: u32) -> bool {
        let trajectories = self.replace(satellite, trajectory);
        let loss = losses_with_fragments(self.seed, self.ephemeris, trajectories)[satellite];
        loss.is_none_or(|loss| loss.step > step) && trajectory.survival[step as usize] >= SURVIVAL_THRESHOLD
    }

    /// Flies the requested burns of a satellite from `from` on, leaving out those of the step `skipped`.
    fn propagate(&self, satellite: usize, trajectory: &mut Trajectory, from: u32, skipped: Option<u32>) {
        let requested = &self.requested[satellite];
        let mut next = requested.partition_point(|burn| burn.step < from);
        for step in from..=HORIZON {
            let first = next;
            while requested.get(next).is_some_and(|burn| burn.step == step) {
                next += 1;
            }
            let burns = if skipped == Some(step) { &[] } else { &requested[first..next] };
            if !advance(trajectory, self.ephemeris, step, burns) {
                return;
            }
        }
    }

    fn replace<'t>(&'t self, satellite: usize, trajectory: &'t Trajectory) -> [&'t Trajectory; SATELLITES] {
        std::array::from_fn(|i| if i == satellite { trajectory } else { &self.trajectories[i] })
    }

    fn evaluate(&self, trajectories: [&Trajectory; SATELLITES]) -> CounterfactualOutcome {
        let losses = losses_with_fragments(self.seed, self.ephemeris, trajectories);
        let survived_steps = trajectories.iter().zip(losses).map(|(trajectory, loss)| {
            let last = loss.map_or(HORIZON, |loss| loss.step - 1) as usize;
            trajectory.survival[1..=last].iter().sum::<f64>()
        });
        CounterfactualOutcome {
            outcome: outcome_with_losses(self.objective, self.setup, trajectories, losses),
            survived_steps: survived_steps.sum(),
        }
    }
}

/// Burns that the log requests of each satellite: one sum per step, or every entry by itself under
/// `compat: upstream`.
fn requested_burns(log: &ActionLog, upstream: bool) -> [Vec<PlannedBurn>; SATELLITES] {
    let mut requested = [const { Vec::<PlannedBurn>::new() }; SATELLITES];
    for (step, action) in (1u32..).zip(log.steps()) {
        for (i, &agent) in action.agents.iter().enumerate() {
            let Some(burns) = requested.get_mut(agent as usize) else { continue };
            let (dvx, dvy) = (action.values[2 * i], action.values[2 * i + 1]);
            match burns.last_mut().filter(|last| last.step == step && !upstream) {
                Some(sum) => {
                    sum.dvx += dvx;
                    sum.dvy += dvy;
                }
                None => burns.push(PlannedBurn { step, dvx, dvy }),
            }
        }
    }
    requested
}

/// Advances by one step under its requested burns. Returns false once the satellite is lost.
fn advance(
    trajectory: &mut Trajectory,
    ephemeris: &DebrisEphemeris,
    step: u32,
    burns: &[PlannedBurn],
) -> bool {
    let [first, .., last] = burns else {
        return trajectory.advance(ephemeris, step, burns.first().map(|burn| (burn.dvx, burn.dvy)));
    };
    debug_assert_eq!(first.step, last.step);
    // Several burns, each applied by itself: they change the state before the step, which is restored
    // afterwards.
    let previous = step as usize - 1;
    let before = (trajectory.bodies[previous], trajectory.fuel[previous]);
    let (mut body, mut fuel) = before;
    let mut total_cost = 0.0;
    for burn in burns {
        let ClampedBurn { dvx, dvy, cost } = clamp_burn(burn.dvx, burn.dvy);
        if cost <= fuel {
            fuel -= cost;
            body.vx += dvx;
            body.vy += dvy;
            total_cost += cost;
        }
    }
    (trajectory.bodies[previous], trajectory.fuel[previous]) = (body, fuel);
    let is_active = trajectory.advance(ephemeris, step, None);
    (trajectory.bodies[previous], trajectory.fuel[previous]) = before;
    trajectory.cost[step as usize] = total_cost;
    is_active
}
