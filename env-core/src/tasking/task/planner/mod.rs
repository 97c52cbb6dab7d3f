//! The reference planners of the tasks. Start reading at [`fly_candidates`].
//!
//! A planner has hindsight: it knows orbit, sunlight and windows of the whole episode. Its effort is a count of searches and flights
//! that depends on the task alone, so that a scenario has the same plan on every machine. Of equal candidates the first counts.
//!
//! Scanning: [`slots`] samples the sky, [`coarse`] is a model in slots of a minute, [`scan_rule`] and [`scan_plan`] are candidates in
//! it, [`scan_search`] compares them, and [`scan_pilot`] flies the best. Imaging: [`image_beam`] searches over the times of
//! [`slew_time`], and [`image_plan`] flies what it finds. [`flight`] flies candidates side by side.

mod coarse;
mod constellation;
pub(super) mod flight;
mod image_beam;
mod image_plan;
mod image_sky;
mod imaging;
mod light;
mod scan_pilot;
mod scan_plan;
mod scan_rule;
mod scan_search;
mod scanning;
mod slew_profile;
mod slew_time;
mod slots;
#[cfg(test)]
mod tests;
mod threshold_rules;

use self::flight::{FlightResult, Pilot, fly_all};
pub(super) use self::slew_time::SlewTime;
use super::run::TaskRun;

/// Version of the planner. A change that alters any bracket increments it.
pub(super) const PLANNER_VERSION: u32 = 2;

/// Flies the pilots of the blind panel, and then the candidates for the reference.
pub(super) fn fly_candidates(start: &TaskRun, mut panel: Vec<Box<dyn Pilot>>) -> Vec<FlightResult> {
    if start.sim.targets().is_empty() {
        panel.extend(scanning::pilots(start));
        return fly_all(start, panel);
    }
    let mut flown = fly_all(start, panel);
    flown.extend(if start.sim.len() == 1 {
        imaging::fly_candidates(start)
    } else {
        constellation::fly_candidates(start)
    });
    flown
}
