//! The mode `power`: a battery that ran empty, and where its energy was lost.

use super::death::add_last_chance;
use super::finding::Finding;
use super::sample::TickSample;
use super::trace::{Death, SatelliteTrace, TaskingTrace};
use crate::critique::{Measure, PROFILE_SECTORS, profile_sector};

/// Joules of a watt-hour.
const J_PER_WH: f64 = 3600.0;
/// Number of sectors of the orbit angle.
const SECTORS: usize = PROFILE_SECTORS as usize;
/// Causes of lost energy as parts of a sentence.
const CAUSES: [&str; 4] =
    ["by pointing the panel away from the Sun", "in eclipse", "to the thrusters", "to the wheels"];

/// Energy that was lost, by cause and sector of the orbit angle, J.
struct EnergyLosses {
    by_cause: [[f64; SECTORS]; 4],
    /// Energy of all other devices.
    devices_j: f64,
}

impl EnergyLosses {
    fn of(samples: &[TickSample], tick_s: f64) -> Self {
        let mut losses = Self { by_cause: [[0.0; SECTORS]; 4], devices_j: 0.0 };
        for sample in samples {
            let sector = profile_sector(f64::from(sample.orbit_angle_deg)) as usize;
            let powers = [sample.mispointing_w, sample.eclipse_w, sample.thrusters_w, sample.wheels_w];
            for (cause, power) in losses.by_cause.iter_mut().zip(powers) {
                cause[sector] += f64::from(power) * tick_s;
            }
            losses.devices_j += f64::from(sample.devices_w) * tick_s;
        }
        losses
    }

    fn total_wh(&self, cause: usize) -> f64 {
        self.by_cause[cause].iter().sum::<f64>() / J_PER_WH
    }

    /// Index of the cause that took most.
    fn main_cause(&self) -> usize {
        largest((0..CAUSES.len()).map(|cause| self.total_wh(cause)))
    }
}

/// Index of the first largest value.
fn largest(values: impl Iterator<Item = f64>) -> usize {
    let found =
        values.enumerate().fold(
            (0, f64::NEG_INFINITY),
            |best, (index, value)| {
                if value > best.1 { (index, value) } else { best }
            },
        );
    found.0
}

/// The finding of a satellite whose battery was empty. `last_chance` is the tick of the latest rescue that succeeded.
pub(super) fn find(trace: &TaskingTrace, agent: usize, death: &Death, last_chance: Option<u64>) -> Finding {
    let satellite = &trace.satellites[agent];
    let empty = empty_tick(satellite, death.tick);
    let peak = peak_tick(satellite, empty);
    let range = peak as usize + 1..=(empty as usize).min(satellite.samples.len() - 1);
    let samples = satellite.samples.get(range).unwrap_or_default();
    let losses = EnergyLosses::of(samples, trace.run.sim.tick_length().seconds());
    let cause = losses.main_cause();
    let sector = largest(losses.by_cause[cause].iter().copied());
    let angle_deg = sector as f64 * (360.0 / SECTORS as f64);
    let (empty_s, peak_s, died_s) = (trace.time_s(empty), trace.time_s(peak), trace.time_s(death.tick));
    let peak_wh = f64::from(satellite.sample(peak).battery_j) / J_PER_WH;
    let [mispointing, eclipse, thrusters, wheels] = [0, 1, 2, 3].map(|cause| losses.total_wh(cause));
    let devices = losses.devices_j / J_PER_WH;
    let mut finding = Finding {
        mode: "power",
        agent,
        tick: death.tick,
        orbit_angle_deg: Some(angle_deg),
        loss: 1.0,
        measures: vec![
            Measure::new("time", died_s, "s"),
            Measure::new("empty_from", empty_s, "s"),
            Measure::new("since", peak_s, "s"),
            Measure::new("charge", peak_wh, "W·h"),
            Measure::new("mispointing", mispointing, "W·h"),
            Measure::new("eclipse", eclipse, "W·h"),
            Measure::new("thrusters", thrusters, "W·h"),
            Measure::new("wheels", wheels, "W·h"),
            Measure::new("devices", devices, "W·h"),
        ],
        explanation: format!(
            "Satellite {agent} died at {died_s:.0} s: its battery was empty from {empty_s:.0} s on. Since {peak_s:.0} s, when it held \
             {peak_wh:.1} W·h, it lost {mispointing:.1} W·h by pointing the panel away from the Sun, {eclipse:.1} W·h in eclipse, \
             {thrusters:.1} W·h to the thrusters, {wheels:.1} W·h to the wheels and {devices:.1} W·h to other devices; most was lost {}, \
             mostly around {angle_deg:.0}° from local noon.",
            CAUSES[cause]
        ),
    };
    add_last_chance(&mut finding, trace, "Charging", last_chance);
    finding
}

/// The tick from which the battery was empty until the satellite died.
fn empty_tick(satellite: &SatelliteTrace, died: u64) -> u64 {
    let is_empty = |tick: &u64| satellite.sample(*tick).battery_j <= 0.0;
    (0..=died).rev().take_while(is_empty).last().unwrap_or(died)
}

/// The last tick with the largest charge before the battery ran empty.
fn peak_tick(satellite: &SatelliteTrace, empty: u64) -> u64 {
    let charge = |tick: u64| satellite.sample(tick).battery_j;
    (0..empty).fold(0, |best, tick| if charge(tick) >= charge(best) { tick } else { best })
}
