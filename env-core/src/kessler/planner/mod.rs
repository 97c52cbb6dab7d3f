//! The reference planner: panel, floor, reference and reference plan of a scenario, without the agent. Start
//! reading at [`bracket`].
//!
//! The planner has hindsight: it knows rogues to come and debris that no radar sees. Its score is a lower
//! bound on the best, not the best. `panel` holds the blind plans; `avoidance`, `transfer` and `formation`
//! search plans per objective; `coasting_courses` keeps what a look-ahead foresaw; `evaluate` computes the outcome of a plan.

mod avoidance;
mod coasting_courses;
pub(in crate::kessler) mod ephemeris;
pub(in crate::kessler) mod evaluate;
pub(in crate::kessler) mod formation;
pub(in crate::kessler) mod look_ahead;
pub mod panel;
mod prune_burns;
pub(in crate::kessler) mod trajectory;
pub(in crate::kessler) mod transfer;

use self::ephemeris::DebrisEphemeris;
use self::evaluate::plan_outcome;
use self::panel::PANEL_SIZE;
use self::trajectory::Trajectory;
use super::constants::SATELLITES;
use super::reward::Objective;
use super::setup::{ContactModel, KesslerSetup};
use crate::bracket::{Bracket, EpisodeOutcome};
use crate::episode_rng::SeededRng;
use crate::error::ScenarioError;
use crate::log::{ActionLog, Precision};
use crate::task::Scenario;

/// Version of the planner. Any change of a bracket raises it.
pub const KESSLER_PLANNER_VERSION: u32 = 1;
/// Version of the planner under `risk: pc`, where it plans by other rules. Version 2 prunes burns that gain
/// nothing.
pub const KESSLER_PLANNER_VERSION_UNDER_PC: u32 = 2;

/// Computes panel, floor, reference and reference plan. The planner checks `is_wanted` between trials; once
/// it returns false, the result is the best found by then.
///
/// The effort is bounded by counts of trials, the same for every scenario, each of at most 50 steps against
/// every body: 400 single burns a step up to the threat and 3 000 schedules per satellite, and what transfer
/// and formation add.
///
/// # Errors
/// Returns [`ScenarioError`] if the recipe is invalid or its start is not fair.
pub fn bracket(
    objective: Objective,
    scenario: &Scenario,
    is_wanted: &dyn Fn() -> bool,
) -> Result<Bracket, ScenarioError> {
    let seed = scenario.seed();
    let setup = KesslerSetup::from_recipe(scenario.recipe())?;
    let mut rng = SeededRng::new(seed);
    let start = setup.draw_initial_state(&mut rng)?;
    let ephemeris = DebrisEphemeris::from_initial_state(&setup, &start);
    let evaluate = |plan: [&Trajectory; SATELLITES]| plan_outcome(objective, &setup, seed, &ephemeris, plan);

    let panels = start.satellites.map(|body| panel::panel_trajectories(&ephemeris, body, setup.fuel));
    let blind_plan = |i: usize| [&panels[0][i], &panels[1][i], &panels[2][i]];
    let panel: Vec<EpisodeOutcome> = (0..PANEL_SIZE).map(|i| evaluate(blind_plan(i))).collect();

    let mut planned: [Trajectory; SATELLITES] =
        std::array::from_fn(|i| avoidance::search(objective, &ephemeris, &panels[i], &mut rng, is_wanted));
    if objective == Objective::Rendezvous {
        let (body, fuel) = (start.satellites[0], setup.fuel);
        planned[0] = transfer::search(&ephemeris, body, fuel, &planned[0], &mut rng, is_wanted);
    }
    if objective == Objective::Formation {
        planned = formation::search(&setup, seed, &ephemeris, &panels, planned, &mut rng, is_wanted);
    }
    let planned_outcome = evaluate(planned.each_ref());

    let by_score = |a: &usize, b: &usize| panel[*a].score.total_cmp(&panel[*b].score);
    let best_blind = (0..PANEL_SIZE).rev().max_by(by_score).unwrap_or(0);
    let (reference, trajectories) = if planned_outcome.score >= panel[best_blind].score {
        (planned_outcome, planned.each_ref())
    } else {
        (panel[best_blind], blind_plan(best_blind))
    };
    let floor = match objective {
        Objective::Survival | Objective::EcoStation => {
            panel.iter().map(|outcome| outcome.score).sum::<f64>() / PANEL_SIZE as f64
        }
        Objective::Rendezvous | Objective::Formation => panel[0].score,
    };
    let (planner_version, reference, reference_plan) =
        if matches!(setup.physics.contact, ContactModel::Probability(_)) {
            let pruned =
                prune_burns::prune_burns(&ephemeris, blind_plan(0), trajectories, reference, evaluate);
            let plan = action_log(pruned.trajectories.each_ref(), pruned.outcome.steps);
            (KESSLER_PLANNER_VERSION_UNDER_PC, pruned.outcome, plan)
        } else {
            (KESSLER_PLANNER_VERSION, reference, action_log(trajectories, reference.steps))
        };
    Ok(Bracket { planner_version, floor, reference_plan, reference, panel })
}

/// Action log of the burns of these trajectories.
fn action_log(trajectories: [&Trajectory; SATELLITES], steps: u32) -> ActionLog {
    let mut log = ActionLog::new(2, Precision::F64);
    let mut next = [0; SATELLITES];
    for step in 1..=steps {
        for (i, trajectory) in trajectories.iter().enumerate() {
            if let Some(burn) = trajectory.burns.get(next[i]).filter(|b| b.step == step) {
                log.push_entry(i as u32, &[burn.dvx, burn.dvy]);
                next[i] += 1;
            }
        }
        log.end_step();
    }
    log
}
