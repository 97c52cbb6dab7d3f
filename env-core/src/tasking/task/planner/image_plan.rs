//! The plan of one imager: beam search at every true completion, with the first actions flown before one is chosen.

use super::image_beam::{Beam, Effort, FirstAction, ImagerState, TargetBook, Worth};
use super::image_sky::ImageSky;
use crate::log::{ActionLog, Precision};
use crate::tasking::constants::WHEEL_INERTIA_KG_M2;
use crate::tasking::simulation::{AgentAction, step_all};
use crate::tasking::task::run::TaskRun;
use crate::tasking::task::spaces::IMAGE_ACTIONS;
use crate::tasking::tick::dispatch::InstructionSet;
use crate::tasking::vector3::norm;

/// Index of the action that desaturates.
const DESATURATE: usize = IMAGE_ACTIONS + 2;

/// Settings of a plan.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ImagePlanSettings {
    pub(super) effort: Effort,
    pub(super) worth: Worth,
    /// First actions that are flown before one is chosen.
    pub(super) tried: usize,
    /// Momentum of the wheels above which the satellite desaturates at the start, N·m·s.
    pub(super) desaturate_above: f64,
    /// Charge that the satellite keeps beside what it needs in the dark, as a share of the battery.
    pub(super) reserve: f64,
}

/// An action of a plan, by its target if it has one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum PlannedAction {
    /// Images the target of an index.
    Target(usize),
    /// Takes an action of this index that needs no target.
    Action(usize),
}

/// An image of a flown plan.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct PlannedImage {
    /// Index of the target.
    pub(super) target: usize,
    /// Time since the start, s.
    pub(super) time_s: f64,
}

/// A flown plan of one satellite.
#[derive(Debug, Clone)]
pub(super) struct ImagePlan {
    pub(super) run: TaskRun,
    pub(super) log: ActionLog,
    /// The choice of each action, in order.
    pub(super) choices: Vec<PlannedAction>,
    /// The images in order.
    pub(super) images: Vec<PlannedImage>,
    /// Satellite-seconds that were flown, trials included.
    pub(super) flown_s: f64,
}

/// Plans the only satellite of a run to the end of the episode.
pub(super) fn plan(
    start: &TaskRun,
    sky: &ImageSky,
    mut book: TargetBook,
    settings: &ImagePlanSettings,
    trials: &mut Vec<TaskRun>,
) -> ImagePlan {
    while trials.len() < settings.tried {
        trials.push(start.clone());
    }
    let mut beam = Beam::new(settings.effort, settings.worth, settings.reserve);
    let mut plan = ImagePlan {
        run: start.clone(),
        log: ActionLog::new(1, Precision::F64),
        choices: Vec::new(),
        images: Vec::new(),
        flown_s: 0.0,
    };
    let mut news = news(&book);
    while !plan.run.is_done() {
        while let Some((target, _)) = news.pop_if(|(_, time_s)| *time_s <= plan.run.sim.time_s()) {
            plan.run.sim.learn_image(0, target);
        }
        beam.momentum = momentum(&plan.run);
        let state = imager_state(&mut plan.run);
        let (action, flown) = if is_worth_desaturating(&plan.run, sky, &state, settings) {
            (DESATURATE, None)
        } else {
            let firsts = beam.search(sky, &book, state).to_vec();
            choose(&beam, sky, &firsts, &mut plan, trials, settings)
        };
        let choice = choice_of(sky, &book, state.time_s, action);
        plan.log.push_entry(0, &[action as f64]);
        plan.log.end_step();
        match flown.and_then(|trial| trials.get(trial)) {
            Some(trial) => {
                plan.run.copy_state_from(trial);
            }
            None => {
                let chosen = plan.run.choose(|_| Some(action));
                plan.run.step(&chosen);
                plan.flown_s += plan.run.last_step().elapsed_s;
            }
        }
        // A step without an end of the action goes on by itself.
        while !plan.run.is_done() && !plan.run.needs_action(0) {
            let chosen = plan.run.choose(|_| None);
            plan.log.end_step();
            plan.run.step(&chosen);
        }
        plan.choices.push(choice);
        for [_, target] in plan.run.last_step().imaged.clone() {
            book.known_from_s[target] = 0.0;
            plan.images.push(PlannedImage { target, time_s: plan.run.sim.time_s() });
        }
    }
    plan
}

/// Targets whose images other satellites report, with the times of the reports, s, latest first.
fn news(book: &TargetBook) -> Vec<(usize, f64)> {
    let times = book.known_from_s.iter().copied().enumerate();
    let mut news: Vec<(usize, f64)> = times.filter(|(_, time_s)| time_s.is_finite()).collect();
    news.sort_by(|a, b| b.1.total_cmp(&a.1));
    news
}

/// Longest time of an action that is tried, s: that of others is known, or too far ahead.
const TRIED_S: f64 = 110.0;

/// The first action that turns out best when it is flown, and the trial that flew it.
fn choose(
    beam: &Beam,
    sky: &ImageSky,
    firsts: &[FirstAction],
    plan: &mut ImagePlan,
    trials: &mut [TaskRun],
    settings: &ImagePlanSettings,
) -> (usize, Option<usize>) {
    let Some(best) = firsts.first() else { return (IMAGE_ACTIONS, None) };
    let now_s = plan.run.sim.time_s();
    let is_tried =
        |first: &&FirstAction| first.action < IMAGE_ACTIONS && first.after.time_s < now_s + TRIED_S;
    let tried: Vec<&FirstAction> = firsts.iter().filter(is_tried).take(settings.tried).collect();
    let rate = best.path[0] / best.path[1].max(1.0);
    let mut chosen = (IMAGE_ACTIONS, None);
    let mut chosen_value = f64::NEG_INFINITY;
    if let Some(first) = firsts.iter().find(|first| settings.tried == 0 || !is_tried(first)) {
        chosen = (first.action, None);
        chosen_value = first.value;
    }
    if tried.is_empty() {
        return chosen;
    }
    let trials = &mut trials[..tried.len()];
    let mut actions: Vec<Vec<Option<AgentAction>>> = Vec::with_capacity(tried.len());
    for (trial, first) in trials.iter_mut().zip(&tried) {
        trial.copy_state_from(&plan.run);
        actions.push(trial.choose(|_| Some(first.action)));
    }
    let mut sims: Vec<_> = trials.iter_mut().map(|trial| &mut trial.sim).collect();
    let results = step_all(&mut sims, &actions, InstructionSet::detect());
    for (index, ((trial, result), first)) in trials.iter_mut().zip(results).zip(&tried).enumerate() {
        trial.finish_step(result);
        plan.flown_s += trial.last_step().elapsed_s;
        let is_imaged = !trial.last_step().imaged.is_empty();
        let after = imager_state(trial);
        let mut value = first.value - rate * (after.time_s - first.after.time_s);
        value += beam.energy_value(sky, &after) - beam.energy_value(sky, &first.after);
        if !is_imaged {
            value -= first.earned;
        }
        if trial.is_dead(0) {
            value -= f64::MAX.sqrt();
        }
        if value > chosen_value {
            (chosen, chosen_value) = ((first.action, Some(index)), value);
        }
    }
    chosen
}

/// Momentum of the wheels, N·m·s.
fn momentum(run: &TaskRun) -> f64 {
    WHEEL_INERTIA_KG_M2 * norm(&run.sim.satellite(0).state.attitude.wheels)
}

/// State of the only satellite of a run.
pub(super) fn imager_state(run: &mut TaskRun) -> ImagerState {
    let moment = run.sim.moment(0);
    let satellite = run.sim.satellite(0);
    ImagerState {
        time_s: moment.time_s,
        boresight: moment.instrument_fixed,
        battery_ws: satellite.battery_ws(),
        stored_bits: satellite.stored().iter().sum(),
    }
}

/// True if the satellite desaturates now: near the start, and with energy for it.
fn is_worth_desaturating(
    run: &TaskRun,
    sky: &ImageSky,
    state: &ImagerState,
    settings: &ImagePlanSettings,
) -> bool {
    /// Time within which desaturations pay for the rest of the episode, as a share of it.
    const EARLY: f64 = 0.7;
    /// Least charge for a desaturation, as a share of the battery.
    const LEAST_CHARGE: f64 = 0.25;
    state.time_s < EARLY * sky.limit_s
        && state.battery_ws > LEAST_CHARGE * sky.args.battery_capacity_ws
        && momentum(run) > settings.desaturate_above
}

/// The target of an action, or the action itself.
fn choice_of(sky: &ImageSky, book: &TargetBook, now_s: f64, action: usize) -> PlannedAction {
    let first = sky.windows.partition_point(|window| window.close_s < now_s + 1e-12);
    let mut listed = sky.windows[first..].iter().filter(|window| book.known_from_s[window.target] > now_s);
    match listed.nth(action).filter(|_| action < IMAGE_ACTIONS) {
        Some(window) => PlannedAction::Target(window.target),
        None => PlannedAction::Action(action),
    }
}
