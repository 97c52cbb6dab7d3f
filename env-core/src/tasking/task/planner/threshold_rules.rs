//! The rules by thresholds that the planner compares: in the coarse model while scanning, by flights while imaging.

use super::coarse::{CoarseState, MODES};
use super::scan_plan::simulate;
use super::slots::{SLOT_S, SlotTable};
use crate::tasking::constants::RAD_S_PER_RPM;
use crate::tasking::task::rule::TaskingRule;
use crate::tasking::task::telemetry::TaskedSatelliteTelemetry;

/// Charges below which a rule charges, as shares of the battery.
const CHARGES: [f64; 5] = [0.15, 0.25, 0.4, 0.6, 0.8];
/// Times before an eclipse from which a rule charges, s.
const ECLIPSES_S: [f64; 2] = [1000.0, 3500.0];
/// Speeds of a wheel above which a rule desaturates, as shares of the limit.
const WHEELS: [f64; 2] = [0.7, 0.15];

/// All rules: the policy `heuristic` first.
pub(super) fn all() -> Vec<TaskingRule> {
    let mut rules = vec![TaskingRule::HEURISTIC];
    for desaturate_above in WHEELS {
        for charge_below in CHARGES {
            for eclipse_within_s in ECLIPSES_S {
                rules.push(TaskingRule {
                    charge_below,
                    eclipse_within_s,
                    desaturate_above,
                    ..TaskingRule::HEURISTIC
                });
            }
        }
    }
    rules
}

/// Rules that imagers fly: the policy `heuristic` is among them.
pub(super) fn for_imagers() -> Vec<TaskingRule> {
    /// Times until the image of a target that halve its worth, s.
    const PATIENCES_S: [f64; 2] = [15.0, 60.0];
    let mut rules = Vec::new();
    for charge_below in [0.4, 0.2] {
        // A threshold above 1 never desaturates.
        for desaturate_above in [0.15, 2.0] {
            for patience_s in PATIENCES_S {
                rules.push(TaskingRule {
                    charge_below,
                    desaturate_above,
                    patience_s,
                    ..TaskingRule::HEURISTIC
                });
            }
        }
    }
    rules
}

/// The rule with the best score by the coarse model; the first of equal ones.
pub(super) fn best(table: &SlotTable, start: &CoarseState) -> TaskingRule {
    let forecast = Forecast::new(table);
    let mut best = (TaskingRule::HEURISTIC, f64::NEG_INFINITY);
    for rule in all() {
        let score = simulate(
            table,
            *start,
            0,
            |state, index| {
                let action = rule.choose(&forecast.telemetry(table, state, index));
                MODES[action.index(MODES.len())]
            },
            |_, _, _| {},
        );
        if score > best.1 {
            best = (rule, score);
        }
    }
    best.0
}

/// Times until the next events, for every slot, s.
struct Forecast {
    eclipse_start_s: Vec<f64>,
    eclipse_end_s: Vec<f64>,
    station_open_s: Vec<f64>,
}

impl Forecast {
    fn new(table: &SlotTable) -> Self {
        let slots = &table.slots;
        let is_dark = |index: usize| slots[index].panel_w <= 0.0;
        let count = slots.len();
        let [mut start_s, mut end_s, mut open_s] = [table.limit_s; 3];
        let [mut eclipse_start_s, mut eclipse_end_s, mut station_open_s] =
            [vec![0.0; count], vec![0.0; count], vec![0.0; count]];
        for index in (0..count).rev() {
            let is_last = index + 1 == count;
            start_s =
                if !is_last && !is_dark(index) && is_dark(index + 1) { SLOT_S } else { start_s + SLOT_S };
            end_s = if !is_last && is_dark(index) && !is_dark(index + 1) { SLOT_S } else { end_s + SLOT_S };
            open_s = if slots[index].access_s > 0.0 { 0.0 } else { open_s + SLOT_S };
            eclipse_start_s[index] = start_s;
            eclipse_end_s[index] = end_s;
            station_open_s[index] = open_s;
        }
        Self { eclipse_start_s, eclipse_end_s, station_open_s }
    }

    /// The observation of a rule at the start of a slot.
    fn telemetry(&self, table: &SlotTable, state: &CoarseState, index: usize) -> TaskedSatelliteTelemetry {
        let args = &table.args;
        let wheel = state.fastest_wheel() / (args.max_wheel_speed_rpm * RAD_S_PER_RPM);
        TaskedSatelliteTelemetry {
            id: 0,
            alive: true,
            needs_action: true,
            action: None,
            battery: state.battery_ws / args.battery_capacity_ws,
            storage: state.stored_bits / args.storage_capacity_bits,
            wheels: [wheel, 0.0, 0.0],
            instrument_error_deg: 0.0,
            sun_error_deg: 0.0,
            eclipse_start_s: self.eclipse_start_s[index],
            eclipse_end_s: self.eclipse_end_s[index],
            station_open_s: self.station_open_s[index],
            station_close_s: 0.0,
            targets: Vec::new(),
        }
    }
}
