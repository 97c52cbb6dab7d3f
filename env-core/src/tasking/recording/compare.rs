//! Comparison of a step with its recording, with built-in tolerances.

use std::collections::BTreeSet;

use serde_json::Value;

use super::read::{ReadResult, member, number, number_of, numbers, vector_of};
use crate::difference_tally::DifferenceTally;
use crate::tasking::access::{Opportunity, OpportunityKind};
use crate::tasking::simulation::{StepResult, TaskingSim};
use crate::tasking::vector3::{Vector3, dot, norm, sub};

/// Compared quantities in the order of presentation.
pub const QUANTITIES: [&str; 13] = [
    "step_end",
    "reward",
    "storage",
    "battery",
    "attitude",
    "rate",
    "wheel_speed",
    "position",
    "net_power",
    "motor_torque",
    "thruster_time",
    "observation",
    "window",
];

/// Largest allowed differences of a step.
pub mod tolerances {
    /// Rewards for data: they are equal but for rounding.
    pub const REWARD: f64 = 1e-9;
    /// Rewards that include changes of a resource.
    pub const RESOURCE_REWARD: f64 = 1e-5;
    /// Battery at the ends of steps, W·s.
    pub const BATTERY_WS: f64 = 1.0;
    /// MRP of the attitude of satellites that image targets, at the ends of steps.
    pub const IMAGER_SIGMA: f64 = 1e-6;
    /// MRP of the attitude of other satellites. Wheels that drift with their last torque, and long ticks, amplify rounding.
    pub const SIGMA: f64 = 1e-5;
    /// Angular velocity at the ends of steps, rad/s.
    pub const OMEGA_RAD_S: f64 = 1e-6;
    /// Wheel speeds at the ends of steps, rad/s.
    pub const WHEELS_RAD_S: f64 = 0.02;
    /// Position, m. Basilisk propagates orbits with the length of a tick; the error of its RK4 grows with the fourth power.
    #[must_use]
    pub fn position_m(tick_s: f64) -> f64 {
        let square = tick_s * tick_s;
        0.5 * (square * square / 100.0).max(1.0)
    }
    /// Observations, relative to the larger of 1 and their magnitude.
    pub const OBSERVATION: f64 = 1e-4;
    /// Windows of ground stations, s.
    pub const STATION_WINDOW_S: f64 = 0.1;
    /// Windows of targets, s.
    pub const TARGET_WINDOW_S: f64 = 0.03;
}

/// A recorded step and its replay.
pub(super) struct StepComparison<'a> {
    pub step: &'a Value,
    pub names: &'a [String],
    pub result: &'a StepResult,
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
        for (index, name) in self.names.iter().enumerate() {
            self.compare_rewards(index, name, tally)?;
            self.compare_flags(index, name, sim, tally);
            if let Some(state) = self.step["states"].get(name) {
                compare_state(state, index, name, sim, self.tick_s, tally)?;
            }
            self.compare_images(index, name, sim, tally)?;
            // Some environments observe only satellites that need an action; the others see zeros.
            let is_observed = !self.observes_idle_only || sim.needs_action(index);
            if let Some(observation) = self.step["observation"].get(name).filter(|_| is_observed) {
                compare_observation(observation, index, name, sim, tally)?;
            }
        }
        self.compare_pairs(tally)
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
            if let Some(theirs) = theirs.and_then(Value::as_bool)
                && theirs != ours
            {
                tally.add_mismatch(format!("{what} of {name} is {ours}, recorded {theirs}"));
            }
        };
        let of_satellite = |field: &str| self.step[field].get(name).or(Some(&self.step[field]));
        // Dead satellites need no action, but BSK-RL leaves the flag of their last event.
        if sim.is_alive(index) {
            compare("needs_action", sim.needs_action(index), self.step["requires_retasking"].get(name));
        }
        compare("alive", sim.is_alive(index), self.step["alive"].get(name));
        let any_terminated = self.result.terminated.iter().any(|terminated| *terminated);
        let is_joint = self.step["terminated"].is_boolean();
        let terminated = if is_joint { any_terminated } else { self.result.terminated[index] };
        compare("terminated", terminated, of_satellite("terminated"));
        compare("truncated", self.result.truncated, of_satellite("truncated"));
    }

    fn compare_images(
        &self,
        index: usize,
        name: &str,
        sim: &TaskingSim,
        tally: &mut DifferenceTally,
    ) -> ReadResult<()> {
        let [images, misses] = sim.image_counts(index);
        let known = sim.known_images(index).len();
        let counts = [("imaged", images as usize), ("missed", misses as usize), ("known_imaged", known)];
        for (field, ours) in counts {
            if let Some(theirs) = self.step[field].get(name).and_then(Value::as_u64)
                && theirs != ours as u64
            {
                tally.add_mismatch(format!("{field} of {name} is {ours}, recorded {theirs}"));
            }
        }
        if let Some(selected) = self.step["selected"].get(name).filter(|selected| !selected.is_null()) {
            let theirs = selected["target"].as_str().unwrap_or_default();
            let ours = sim.tasked_target(index).map_or("", |target| sim.targets()[target].name.as_str());
            if ours != theirs {
                tally.add_mismatch(format!("target of {name} is {ours}, recorded {theirs}"));
            }
        }
        if let Some(theirs) = self.step["newly_imaged"].get(name).and_then(Value::as_array) {
            let theirs: Vec<&str> = theirs.iter().filter_map(Value::as_str).collect();
            let ours: Vec<&str> =
                self.result.imaged[index].iter().map(|target| sim.targets()[*target].name.as_str()).collect();
            if ours != theirs {
                tally.add_mismatch(format!("images of {name} are {ours:?}, recorded {theirs:?}"));
            }
        }
        Ok(())
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
        if ours != theirs {
            tally.add_mismatch(format!("pairs that shared data are {ours:?}, recorded {theirs:?}"));
        }
        Ok(())
    }
}

/// Compares the observations of a reset.
pub(super) fn compare_initial(
    initial: &Value,
    names: &[String],
    sim: &mut TaskingSim,
    tally: &mut DifferenceTally,
) -> ReadResult<()> {
    for (index, name) in names.iter().enumerate() {
        if let Some(observation) = initial["observation"].get(name) {
            compare_observation(observation, index, name, sim, tally)?;
        }
    }
    Ok(())
}

/// Difference of two attitudes: the smaller one to the recorded MRP or its shadow.
pub(super) fn sigma_difference(ours: &Vector3<f64>, theirs: &Vector3<f64>) -> f64 {
    let largest = |v: Vector3<f64>| v.iter().fold(0.0_f64, |max, x| max.max(x.abs()));
    let square = dot(theirs, theirs);
    let shadow = theirs.map(|x| -x / square);
    largest(sub(ours, theirs)).min(if square > 0.0 { largest(sub(ours, &shadow)) } else { f64::INFINITY })
}

fn compare_state(
    recorded: &Value,
    index: usize,
    name: &str,
    sim: &TaskingSim,
    tick_s: f64,
    tally: &mut DifferenceTally,
) -> ReadResult<()> {
    let satellite = sim.satellite(index);
    let state = &satellite.state;
    let difference = sigma_difference(&state.attitude.sigma, &vector_of(recorded, "sigma_BN")?);
    let is_imager = satellite.spec().dynamics.instrument && !satellite.spec().dynamics.continuous;
    let allowed = if is_imager { tolerances::IMAGER_SIGMA } else { tolerances::SIGMA };
    tally.compare_numbers("attitude", difference, 0.0, allowed, format_args!("attitude of {name}"));
    let vectors = [
        ("rate", &state.attitude.omega, "omega_BN_B", tolerances::OMEGA_RAD_S),
        ("wheel_speed", &state.attitude.wheels, "wheel_speeds_rad_s", tolerances::WHEELS_RAD_S),
    ];
    for (quantity, ours, field, allowed) in vectors {
        for (ours, theirs) in ours.iter().zip(vector_of(recorded, field)?) {
            tally.compare_numbers(quantity, *ours, theirs, allowed, format_args!("{quantity} of {name}"));
        }
    }
    let battery = number_of(recorded, "battery_Ws")?;
    tally.compare_numbers(
        "battery",
        state.battery,
        battery,
        tolerances::BATTERY_WS,
        format_args!("battery of {name}"),
    );
    let ours = satellite.stored();
    for (partition, bits) in member(recorded, "storage")?.as_object().into_iter().flatten() {
        let is_initial = partition == "STORED DATA" && !satellite.spec().dynamics.continuous;
        let stored = ours[usize::from(is_initial)];
        tally.compare_numbers("storage", stored, number(bits)?, 0.0, format_args!("`{partition}` of {name}"));
    }
    if let Some(position) = recorded.get("r_BN_N") {
        let theirs: Vector3<f64> =
            numbers(position)?.try_into().map_err(|_| "`r_BN_N` is not a vector".to_owned())?;
        let apart = norm(&sub(&state.position, &theirs));
        let allowed = tolerances::position_m(tick_s);
        tally.compare_numbers("position", apart, 0.0, allowed, format_args!("position of {name}"));
    }
    Ok(())
}

fn compare_observation(
    recorded: &Value,
    index: usize,
    name: &str,
    sim: &mut TaskingSim,
    tally: &mut DifferenceTally,
) -> ReadResult<()> {
    let theirs = numbers(recorded)?;
    let mut ours = Vec::with_capacity(theirs.len());
    sim.observe(index, &mut ours).map_err(|error| error.to_string())?;
    let columns = sim.observation_columns(index);
    if ours.len() != theirs.len() {
        tally.add_mismatch(format!("{name} observes {} values, recorded {}", ours.len(), theirs.len()));
        return Ok(());
    }
    for ((ours, theirs), column) in ours.iter().zip(&theirs).zip(&columns) {
        let mut allowed = tolerances::OBSERVATION * theirs.abs().max(1.0);
        // Times of windows that are not divided are in seconds.
        if column.contains("opportunity") && !column.ends_with("_normd") {
            allowed = allowed.max(tolerances::STATION_WINDOW_S);
        }
        if column.contains("r_BN") || column.contains("v_BN") || column.contains("r_L") {
            allowed = allowed.max(1e-6 * theirs.abs());
        }
        tally.compare_numbers("observation", *ours, *theirs, allowed, format_args!("{column} of {name}"));
    }
    Ok(())
}

/// Compares the lists of opportunities at the end of the episode.
pub(super) fn compare_opportunities(
    recording: &Value,
    names: &[String],
    sim: &TaskingSim,
    tally: &mut DifferenceTally,
) -> ReadResult<()> {
    for (index, name) in names.iter().enumerate() {
        let Some(list) = recording["opportunities"].get(name) else { continue };
        let ours = sim.opportunities(index);
        let end = number_of(list, "window_calculation_time")?;
        // Older recordings of scanning list the windows of the reset.
        if ours.computed_s() < end - 1e-6 {
            tally.add_mismatch(format!("windows of {name} reach {} s, recorded {end} s", ours.computed_s()));
            continue;
        }
        let mut items: Vec<Opportunity> = ours.all().into_iter().filter(|item| item.open_s < end).collect();
        items.iter_mut().for_each(|item| item.close_s = item.close_s.min(end));
        let theirs = member(list, "windows")?.as_array().ok_or("`windows` is not a list")?;
        if theirs.len() != items.len() {
            tally.add_mismatch(format!("{name} has {} windows, recorded {}", items.len(), theirs.len()));
            continue;
        }
        for (item, row) in items.iter().zip(theirs) {
            compare_window(item, row, name, sim, tally)?;
        }
    }
    Ok(())
}

fn compare_window(
    item: &Opportunity,
    row: &Value,
    name: &str,
    sim: &TaskingSim,
    tally: &mut DifferenceTally,
) -> ReadResult<()> {
    let (object, allowed) = match item.kind {
        OpportunityKind::Target => (sim.targets()[item.object].name.clone(), tolerances::TARGET_WINDOW_S),
        OpportunityKind::GroundStation => {
            (format!("GroundStation{}", sim.stations()[item.object].name), tolerances::STATION_WINDOW_S)
        }
    };
    let theirs = row[1].as_str().unwrap_or_default();
    if object != theirs {
        tally.add_mismatch(format!("a window of {name} is of {object}, recorded {theirs}"));
        return Ok(());
    }

    for (ours, theirs) in [(item.open_s, number(&row[2])?), (item.close_s, number(&row[3])?)] {
        tally.compare_numbers("window", ours, theirs, allowed, format_args!("window of {object} for {name}"));
    }
    Ok(())
}
