//! Comparison of the sums of an episode, and of the sky at its start and end.

use serde_json::Value;

use super::read::{ReadResult, list_of, number, vector, vector_of, whole};
use super::tolerances::{EARTH_ROTATION, SAMPLED_ILLUMINATION, SUN_ARCSEC, TIME_S};
use crate::difference_tally::DifferenceTally;
use crate::tasking::simulation::{StepResult, TaskingSim};
use crate::tasking::vector3::{cross, norm};

/// Sums over the steps of an episode.
#[derive(Debug, Clone, Default)]
pub(super) struct Totals {
    steps: u64,
    /// Sum of the rewards of all satellites, with penalties.
    returned: f64,
}

impl Totals {
    /// Adds a step to the sums.
    pub(super) fn add(&mut self, result: &StepResult) {
        self.steps += 1;
        self.returned += result.rewards.iter().chain(&result.penalties).sum::<f64>();
    }

    /// Compares the sums with what a recording has of the end of its episode.
    pub(super) fn compare(
        &self,
        recorded: &Value,
        names: &[String],
        sim: &TaskingSim,
        reward_tolerance: f64,
        tally: &mut DifferenceTally,
    ) -> ReadResult<()> {
        if let Some(theirs) = whole(&recorded["steps"]) {
            tally.compare_outcomes(&self.steps, &theirs, format_args!("number of steps"));
        }
        if let Some(theirs) = recorded.get("sim_time") {
            let what = format_args!("end of the episode");
            tally.compare_numbers("step_end", sim.time_s(), number(theirs)?, TIME_S, what);
        }
        let allowed = reward_tolerance * self.steps as f64;
        for (index, name) in names.iter().enumerate() {
            if let Some(theirs) = recorded["cum_reward"].get(name) {
                let what = format_args!("sum of the rewards of {name}");
                tally.compare_numbers("reward", sim.total_reward(index), number(theirs)?, allowed, what);
            }
        }
        let paid: f64 = (0..sim.len()).map(|index| sim.total_reward(index)).sum();
        for (field, ours) in [("cum_reward_data", paid), ("total_return", self.returned)] {
            if let Some(theirs) = recorded.get(field) {
                tally.compare_numbers("reward", ours, number(theirs)?, allowed, format_args!("`{field}`"));
            }
        }
        if let Some(theirs) = whole(&recorded["unique_imaged"]) {
            let ours = sim.rewarded_images().len() as u64;
            tally.compare_outcomes(&ours, &theirs, format_args!("number of imaged targets"));
        }
        compare_sky(recorded, sim, tally)
    }
}

/// Compares the direction of the Sun and the Earth's rotation with what a recording has of this moment.
pub(super) fn compare_sky(recorded: &Value, sim: &TaskingSim, tally: &mut DifferenceTally) -> ReadResult<()> {
    if recorded["sun_position_N_m"].is_array() {
        let (ours, theirs) = (sim.sun_position(), vector_of(recorded, "sun_position_N_m")?);
        let angle = norm(&cross(&ours, &theirs)) / (norm(&ours) * norm(&theirs));
        let arcsec = angle.to_degrees() * 3600.0;
        tally.compare_numbers("sun", arcsec, 0.0, SUN_ARCSEC, format_args!("direction of the Sun"));
    }
    if recorded["PN_dcm"].is_array() {
        for (ours, theirs) in sim.planet_from_inertial().iter().zip(list_of(recorded, "PN_dcm")?) {
            for (ours, theirs) in ours.iter().zip(vector(theirs)?) {
                let what = format_args!("rotation of the Earth");
                tally.compare_numbers("earth_rotation", *ours, theirs, EARTH_ROTATION, what);
            }
        }
    }
    Ok(())
}

/// Compares the positions of the ground stations, by their names in BSK-RL.
pub(super) fn compare_stations(
    recorded: &Value,
    sim: &TaskingSim,
    tally: &mut DifferenceTally,
) -> ReadResult<()> {
    /// Largest difference of a coordinate, m: that of rounding.
    const ROUNDING_M: f64 = 1e-6;
    for (name, position) in recorded.as_object().into_iter().flatten() {
        let is_it = |name: &str, station: &str| name.strip_prefix("GroundStation") == Some(station);
        let Some(station) = sim.stations().iter().find(|station| is_it(name, &station.name)) else {
            tally.add_mismatch(format!("there is no ground station {name}"));
            continue;
        };
        for (ours, theirs) in station.position.iter().zip(vector(position)?) {
            tally.compare_numbers("position", *ours, theirs, ROUNDING_M, format_args!("position of {name}"));
        }
    }
    Ok(())
}

/// Compares the illumination of the trajectory that is searched for eclipses.
pub(super) fn compare_sampled_light(
    recorded: &Value,
    name: &str,
    sim: &mut TaskingSim,
    tally: &mut DifferenceTally,
) -> ReadResult<()> {
    if recorded.is_null() {
        return Ok(());
    }
    for (sample, theirs) in list_of(recorded, "illumination_factor")?.iter().enumerate() {
        let what = format_args!("illumination of sample {sample} of {name}");
        let ours = sim.sampled_illumination(0, sample);
        tally.compare_numbers("sampled_illumination", ours, number(theirs)?, SAMPLED_ILLUMINATION, what);
    }
    Ok(())
}
