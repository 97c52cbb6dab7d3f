//! Rules by which a scanning satellite chooses its modes. They know the sky of the whole episode.

use super::coarse::{CoarseState, Mode};
use super::slots::{SLOT_S, SlotTable};
use crate::tasking::constants::RAD_S_PER_RPM;

/// Largest number of orbits that have thresholds of their own.
pub(super) const ORBITS: usize = 10;
/// Slots of an orbit, 95 minutes.
pub(super) const ORBIT_SLOTS: usize = 95;
/// Share of the battery above which more charging is wasted.
const FULL_BATTERY: f64 = 0.97;
/// Least time of access for which a downlink is worth it, s.
const MIN_ACCESS_S: f64 = 20.0;
/// Factor of the energy that a satellite needs in the dark.
const DARK_MARGIN: f64 = 1.1;

/// State of the satellite on which a rule decides.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Resources {
    /// Charge of the battery, J.
    pub(super) battery_ws: f64,
    /// Data in the storage, bits.
    pub(super) stored_bits: f64,
    /// Largest speed of a wheel, rad/s.
    pub(super) fastest_wheel: f64,
}

impl Resources {
    pub(super) fn of(state: &CoarseState) -> Self {
        let CoarseState { battery_ws, stored_bits, .. } = *state;
        Self { battery_ws, stored_bits, fastest_wheel: state.fastest_wheel() }
    }
}

/// A rule: scan where the power that scanning costs is small enough.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ScanRule {
    /// Largest power of the panel that scanning may cost in each orbit, W.
    pub(super) loss_w: [f64; ORBITS],
    /// Speed of a wheel above which the satellite desaturates, as a share of the limit.
    pub(super) desaturate_above: f64,
    /// Data above which the satellite downlinks in view of a station, as a share of the storage.
    pub(super) downlink_above: f64,
    /// Charge below which the satellite charges, as a share of the battery, beside what it needs in the dark.
    pub(super) reserve: f64,
}

impl ScanRule {
    /// The mode of an action that begins with a slot.
    pub(super) fn decide(&self, table: &SlotTable, resources: &Resources, index: usize) -> Mode {
        let args = &table.args;
        let slot = &table.slots[index];
        let limit = args.max_wheel_speed_rpm * RAD_S_PER_RPM;
        if resources.fastest_wheel > self.desaturate_above * limit {
            return Mode::Desaturate;
        }
        let stored = resources.stored_bits / args.storage_capacity_bits;
        if stored > self.downlink_above && slot.access_s >= MIN_ACCESS_S {
            return Mode::Downlink;
        }
        let room_s = (args.storage_capacity_bits - resources.stored_bits) / args.instrument_bits;
        if room_s < SLOT_S {
            return Mode::Charge;
        }
        let left_s = table.limit_s - index as f64 * SLOT_S;
        let scanning_w = table.args.base_load_w() - args.instrument_power_w;
        if resources.battery_ws > left_s * scanning_w * DARK_MARGIN + self.reserve * args.battery_capacity_ws
        {
            return Mode::Scan;
        }
        if resources.battery_ws < reserve_ws(table, index) + self.reserve * args.battery_capacity_ws {
            return Mode::Charge;
        }
        if slot.panel_w > 0.0 && resources.battery_ws > FULL_BATTERY * args.battery_capacity_ws {
            return Mode::Scan;
        }
        let orbit = (index / ORBIT_SLOTS).min(ORBITS - 1);
        if slot.scan_loss_w <= self.loss_w[orbit] { Mode::Scan } else { Mode::Charge }
    }
}

/// Energy that the satellite needs to reach the next sunlight without scanning, J.
pub(super) fn reserve_ws(table: &SlotTable, index: usize) -> f64 {
    let ahead = (index + Mode::Scan.slots()).min(table.slots.len() - 1);
    let dark_s = table.slots[index].dark_s.max(table.slots[ahead].dark_s);
    dark_s * table.args.base_load_w() * DARK_MARGIN
}
