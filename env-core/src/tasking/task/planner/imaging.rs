//! Candidates for the reference of one imager.

use super::flight::{FlightResult, Pilot, fly_all};
use super::image_beam::{Effort, TargetBook, Worth};
use super::image_plan::{ImagePlan, ImagePlanSettings, plan};
use super::image_sky::ImageSky;
use super::threshold_rules;
use crate::tasking::task::run::TaskRun;

/// Typical time from one image to the next, s.
const IMAGE_S: f64 = 50.0;
/// Effort of searches for one satellite.
const EFFORT: Effort = Effort { width: 4, slots: 14 };
/// First actions of a search that are flown: as many as a block has lanes.
const TRIED: usize = 8;

/// Charge that a satellite keeps beside what it needs in the dark, as a share of the battery.
pub(super) const RESERVE: f64 = 0.05;

/// Settings in which candidates differ.
struct Variant {
    power_w: f64,
    /// Momentum of the wheels above which the satellite desaturates, N·m·s.
    desaturate_above: f64,
    reserve: f64,
}

/// The candidates: with much energy, with less of it, and with little.
const VARIANTS: [Variant; 3] = [
    Variant { power_w: 200.0, desaturate_above: f64::INFINITY, reserve: RESERVE },
    Variant { power_w: 100.0, desaturate_above: 4.0, reserve: RESERVE },
    Variant { power_w: 60.0, desaturate_above: 4.0, reserve: 0.1 },
];

/// Flies the candidates of the only satellite of a run: plans and rules.
pub(super) fn fly_candidates(start: &TaskRun) -> Vec<FlightResult> {
    let rules = threshold_rules::for_imagers().into_iter().map(|rule| Box::new(rule) as Box<dyn Pilot>);
    let mut flown = fly_all(start, rules.collect());
    let plans = plan_all(start);
    flown.extend(plans.into_iter().map(|plan| FlightResult { outcome: plan.run.outcome(), log: plan.log }));
    flown
}

/// Flown plans of all variants.
pub(super) fn plan_all(start: &TaskRun) -> Vec<ImagePlan> {
    let sky = ImageSky::new(start);
    let book = TargetBook::new(start.sim.targets().len());
    let rate = usual_rate(start);
    let mut trials = Vec::new();
    let candidates = VARIANTS.iter().map(|variant| {
        let settings = ImagePlanSettings {
            effort: EFFORT,
            worth: Worth { rate, power_w: variant.power_w },
            tried: TRIED,
            desaturate_above: variant.desaturate_above,
            reserve: variant.reserve,
        };
        plan(start, &sky, book.clone(), &settings, &mut trials)
    });
    candidates.collect()
}

/// Value of a second of imaging, as a satellite would earn by images of random targets.
pub(super) fn usual_rate(run: &TaskRun) -> f64 {
    let targets = run.sim.targets();
    let sum: f64 = targets.iter().map(|target| target.priority).sum();
    sum / targets.len().max(1) as f64 / IMAGE_S
}
