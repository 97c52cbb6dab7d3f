//! Comparison of a step with its recording: rewards, flags, images and communication. [`super::state`] compares the states of the
//! satellites, [`super::observation`] what they observe, [`super::windows`] the windows of access.

use std::collections::BTreeSet;

use serde_json::Value;

use super::observation::compare_observation;
use super::read::{ReadResult, number, number_of, whole};
use super::state::compare_state;
use super::tolerances::TIME_S;
use super::windows::{ChosenWindow, compare_next_station, compare_selected};
use crate::difference_tally::DifferenceTally;
use crate::tasking::simulation::{StepResult, TaskingSim};

/// What held before a step.
pub(super) struct BeforeStep {
    /// Time since the start, s.
    pub time_s: f64,
    /// Satellites that needed an action.
    pub needs_action: Vec<bool>,
}

impl BeforeStep {
    /// Takes what holds now.
    pub(super) fn of(sim: &TaskingSim) -> Self {
        let needs_action = (0..sim.len()).map(|index| sim.needs_action(index)).collect();
        Self { time_s: sim.time_s(), needs_action }
    }
}

/// A recorded step and its replay.
pub(super) struct StepComparison<'a> {
    pub step: &'a Value,
    pub names: &'a [String],
    pub before: &'a BeforeStep,
    pub result: &'a StepResult,
    /// Windows of the targets that satellites were tasked with in this step.
    pub chosen: &'a [Option<ChosenWindow>],
    /// True if only satellites that need an action are observed.
    pub observes_idle_only: bool,
    /// Largest allowed difference of rewards.
    pub reward_tolerance: f64,
    /// Length of a tick, s.
    pub tick_s: f64,
}

impl StepComparison<'_> {
    /// Compares everything that the recording has.
    pub(super) fn run(&self, sim: &mut TaskingSim, tally: &mut DifferenceTally) -> ReadResult<()> {
        self.compare_times(tally)?;
        for (index, name) in self.names.iter().enumerate() {
            self.compare_rewards(index, name, tally)?;
            self.compare_flags(index, name, sim, tally);
            if let Some(state) = self.step["states"].get(name) {
                compare_state(state, index, name, sim, self.tick_s, tally)?;
            }
            self.compare_images(index, name, sim, tally);
            if let Some(selected) = self.step.get("selected").filter(|selected| selected.is_object()) {
                compare_selected(selected, self.chosen[index].as_ref(), name, sim, tally)?;
            }
            // Some environments observe only satellites that need an action; the others see zeros.
            let is_observed = !self.observes_idle_only || sim.needs_action(index);
            if let Some(observation) = self.step["observation"].get(name).filter(|_| is_observed) {
                compare_observation(observation, index, name, sim, self.tick_s, tally)?;
            }
            if let Some(state) = self.step["states"].get(name) {
                compare_next_station(state, index, name, sim, tally)?;
            }
        }
        self.compare_pairs(tally)
    }

    fn compare_times(&self, tally: &mut DifferenceTally) -> ReadResult<()> {
        let start = number_of(self.step, "t_start")?;
        tally.compare_numbers(
            "step_end",
            self.before.time_s,
            start,
            TIME_S,
            format_args!("start of the step"),
        );
        let info = &self.step["info"];
        let durations = [self.step.get("d_ts"), info.get("d_ts"), info["__common__"].get("d_ts")];
        let of_satellites = self.names.iter().map(|name| info[name].get("d_ts"));
        let is_recorded = |value: &&Value| !value.is_null();
        for theirs in durations.into_iter().chain(of_satellites).flatten().filter(is_recorded) {
            let what = format_args!("duration of the step");
            tally.compare_numbers("step_end", self.result.elapsed_s, number(theirs)?, TIME_S, what);
        }
        Ok(())
    }

    fn compare_rewards(&self, index: usize, name: &str, tally: &mut DifferenceTally) -> ReadResult<()> {
        let Some(theirs) = self.step["reward"].get(name) else { return Ok(()) };
        let what = format_args!("reward of {name}");
        let allowed = self.reward_tolerance;
        tally.compare_numbers("reward", self.result.rewards[index], number(theirs)?, allowed, what);
        let total = self.result.rewards[index] + self.result.penalties[index];
        if let Some(theirs) = self.step["returned"].get(name) {
            let what = format_args!("reward with penalty of {name}");
            tally.compare_numbers("reward", total, number(theirs)?, allowed, what);
        } else if index == 0 && self.step["returned"].is_number() {
            let ours: f64 = self.result.rewards.iter().chain(&self.result.penalties).sum();
            let theirs = number_of(self.step, "returned")?;
            tally.compare_numbers("reward", ours, theirs, allowed, format_args!("reward of the step"));
        }
        Ok(())
    }

    fn compare_flags(&self, index: usize, name: &str, sim: &TaskingSim, tally: &mut DifferenceTally) {
        let mut compare = |what: &str, ours: bool, theirs: Option<&Value>| {
            if let Some(theirs) = theirs.and_then(Value::as_bool) {
                tally.compare_outcomes(&ours, &theirs, format_args!("{what} of {name}"));
            }
        };
        let of_satellite = |field: &str| self.step[field].get(name).or(Some(&self.step[field]));
        let info = &self.step["info"];
        let told = info[name].get("requires_retasking").or_else(|| info.get("requires_retasking"));
        // Dead satellites need no action, but BSK-RL leaves the flag of their last event.
        if sim.is_alive(index) {
            let before = self.step["required_retasking_before"].get(name);
            compare("need of an action before", self.before.needs_action[index], before);
            compare("needs_action", sim.needs_action(index), self.step["requires_retasking"].get(name));
            compare("requires_retasking in info", sim.needs_action(index), told);
        }
        compare("alive", sim.is_alive(index), self.step["alive"].get(name));
        let any_terminated = self.result.terminated.iter().any(|terminated| *terminated);
        let is_joint = self.step["terminated"].is_boolean();
        let terminated = if is_joint { any_terminated } else { self.result.terminated[index] };
        compare("terminated", terminated, of_satellite("terminated"));
        compare("truncated", self.result.truncated, of_satellite("truncated"));
    }

    fn compare_images(&self, index: usize, name: &str, sim: &TaskingSim, tally: &mut DifferenceTally) {
        let [images, misses] = sim.image_counts(index);
        let known = sim.known_images(index).len();
        let counts = [("imaged", images as usize), ("missed", misses as usize), ("known_imaged", known)];
        for (field, ours) in counts {
            if let Some(theirs) = self.step[field].get(name).and_then(whole) {
                tally.compare_outcomes(&(ours as u64), &theirs, format_args!("{field} of {name}"));
            }
        }
        if let Some(theirs) = self.step["newly_imaged"].get(name) {
            compare_imaged(theirs, self.result.imaged[index], name, sim, tally);
        }
    }

    fn compare_pairs(&self, tally: &mut DifferenceTally) -> ReadResult<()> {
        let Some(pairs) = self.step["pairs"].as_array() else { return Ok(()) };
        // Some recordings have hyphens in names where others have underscores.
        let index = |name: &Value| {
            let name = name.as_str().unwrap_or_default().replace('-', "_");
            self.names.iter().position(|other| other.replace('-', "_") == name)
        };
        let mut theirs = BTreeSet::new();
        for pair in pairs {
            match (index(&pair[0]), index(&pair[1])) {
                (Some(sender), Some(receiver)) => theirs.insert([sender, receiver]),
                _ => return Err(format!("the pair {pair} names no satellites")),
            };
        }
        let ours: BTreeSet<[usize; 2]> = self.result.pairs.iter().copied().collect();
        tally.compare_outcomes(&ours, &theirs, format_args!("pairs that shared data"));
        Ok(())
    }
}

/// Compares the names of the targets that a satellite imaged in a step.
pub(super) fn compare_imaged(
    recorded: &Value,
    imaged: Option<usize>,
    name: &str,
    sim: &TaskingSim,
    tally: &mut DifferenceTally,
) {
    let Some(theirs) = recorded.as_array() else { return };
    let theirs: Vec<&str> = theirs.iter().filter_map(Value::as_str).collect();
    let ours: Vec<&str> = imaged.iter().map(|target| sim.targets()[*target].name.as_str()).collect();
    tally.compare_outcomes(&ours, &theirs, format_args!("images of {name}"));
}

/// Compares the observations and flags of a reset, and the state after it.
pub(super) fn compare_initial(
    recording: &Value,
    names: &[String],
    sim: &mut TaskingSim,
    tick_s: f64,
    tally: &mut DifferenceTally,
) -> ReadResult<()> {
    let initial = &recording["initial"];
    for (index, name) in names.iter().enumerate() {
        if let Some(state) = recording["satellites"][index].get("initial") {
            compare_state(state, index, name, sim, tick_s, tally)?;
        }
        let info = &initial["info"];
        let told = info[name].get("requires_retasking").or_else(|| info.get("requires_retasking"));
        if let Some(theirs) = told.and_then(Value::as_bool) {
            let what = format_args!("requires_retasking of {name} after the reset");
            tally.compare_outcomes(&sim.needs_action(index), &theirs, what);
        }
        if let Some(observation) = initial["observation"].get(name).filter(|value| !value.is_null()) {
            compare_observation(observation, index, name, sim, tick_s, tally)?;
        }
    }
    Ok(())
}
