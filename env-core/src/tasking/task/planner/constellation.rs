//! Candidates for the reference of several imagers: a rule, and a plan in which satellites are planned one after the other. A target
//! that one images is worth nothing to those after it.
//!
//! Each satellite is flown by itself while it is planned, which is exact, since satellites do not act on each other's motion. The
//! joint flight follows the choices by target.

use std::collections::VecDeque;

use super::flight::{FlightResult, Pilot, fly_all};
use super::image_beam::{Effort, TargetBook, Worth};
use super::image_plan::{self, ImagePlan, ImagePlanSettings, PlannedAction};
use super::image_sky::ImageSky;
use super::imaging::{RESERVE, usual_rate};
use crate::tasking::access::OpportunityKind;
use crate::tasking::task::rule::TaskingRule;
use crate::tasking::task::run::TaskRun;
use crate::tasking::task::spaces::IMAGE_ACTIONS;

/// Power whose value equals that of imaging, W.
const POWER_W: f64 = 80.0;
/// Momentum above which a satellite with little energy desaturates, N·m·s.
const DESATURATE_ABOVE: f64 = 4.0;
/// Power that imaging takes from the battery, W: a satellite whose battery lasts so long does not save energy.
const USE_W: f64 = 35.0;
/// Time after an image until other satellites know it, s: steps of a constellation are shorter.
const SHARING_S: f64 = 30.0;
/// Reserves of the plans that replace one on which the satellite dies, as shares of the battery.
const CAREFUL_RESERVES: [f64; 3] = [0.12, 0.25, 0.4];
/// Number of satellites up to which searches have their whole effort.
const FEW: usize = 4;

/// Plans and flies all satellites of a run, and flies the rule.
pub(super) fn fly_candidates(start: &TaskRun) -> Vec<FlightResult> {
    let plans = plan_all(start);
    let choices = plans.into_iter().map(|plan| plan.choices.into()).collect();
    fly_all(start, vec![Box::new(ChoicePilot { choices }), Box::new(TaskingRule::HEURISTIC)])
}

/// Plans of all satellites, in order.
pub(super) fn plan_all(start: &TaskRun) -> Vec<ImagePlan> {
    let satellites = start.sim.len();
    let (effort, tried) = if satellites <= FEW {
        (Effort { width: 4, slots: 14 }, 8)
    } else {
        (Effort { width: 4, slots: 12 }, 4)
    };
    let rate = usual_rate(start);
    let mut book = TargetBook::new(start.sim.targets().len());
    let mut plans: Vec<Option<ImagePlan>> = vec![None; satellites];
    // Each satellite of a plane is ahead of those before it in the list, and sees targets first.
    for satellite in (0..satellites).rev() {
        let alone = start.only(satellite);
        let mut trials = Vec::new();
        let sky = ImageSky::new(&alone);
        let is_rich = alone.sim.satellite(0).battery_ws() > sky.limit_s * USE_W;
        let mut settings = ImagePlanSettings {
            effort,
            worth: Worth { rate, power_w: POWER_W },
            tried,
            desaturate_above: if is_rich { f64::INFINITY } else { DESATURATE_ABOVE },
            reserve: RESERVE,
        };
        let mut plan = image_plan::plan(&alone, &sky, book.clone(), &settings, &mut trials);
        for careful in CAREFUL_RESERVES {
            if !plan.run.is_dead(0) {
                break;
            }
            settings.reserve = careful;
            settings.worth.power_w *= 0.5;
            settings.desaturate_above = DESATURATE_ABOVE;
            plan = image_plan::plan(&alone, &sky, book.clone(), &settings, &mut trials);
        }
        for image in &plan.images {
            book.is_claimed[image.target] = true;
            if start.sim.shares_images() {
                book.known_from_s[image.target] = image.time_s + SHARING_S;
            }
        }
        plans[satellite] = Some(plan);
    }
    plans.into_iter().flatten().collect()
}

/// Follows the choices of each satellite.
struct ChoicePilot {
    choices: Vec<VecDeque<PlannedAction>>,
}

impl Pilot for ChoicePilot {
    fn choose(&mut self, run: &mut TaskRun, indices: &mut Vec<Option<usize>>) {
        for satellite in 0..run.sim.len() {
            let index = run.needs_action(satellite).then(|| self.next_index(run, satellite));
            indices.push(index);
        }
    }
}

impl ChoicePilot {
    /// Index of the next action of a satellite. A target that cannot be chosen is left out.
    fn next_index(&mut self, run: &mut TaskRun, satellite: usize) -> usize {
        while let Some(choice) = self.choices[satellite].pop_front() {
            match choice {
                PlannedAction::Action(action) => return action,
                PlannedAction::Target(target) => {
                    let next = run.sim.next_windows(satellite, OpportunityKind::Target, IMAGE_ACTIONS);
                    if let Some(index) = next.iter().position(|window| window.object == target) {
                        return index;
                    }
                }
            }
        }
        let count = run.sim.action_count(satellite);
        TaskingRule::HEURISTIC.choose(&run.satellite_telemetry(satellite)).index(count)
    }
}
