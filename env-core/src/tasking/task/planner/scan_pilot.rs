//! The pilot that flies a plan of a scanning satellite.

use std::rc::Rc;

use super::coarse::Mode;
use super::flight::Pilot;
use super::scan_plan::ScanPlan;
use super::scan_rule::reserve_ws;
use super::slots::{SLOT_S, SlotTable};
use crate::tasking::task::run::TaskRun;

/// Charge below which the pilot does not follow the plan, as a share of the battery.
const GUARD: f64 = 0.05;
/// Share of the battery above which the pilot scans instead of charging.
const FULL_BATTERY: f64 = 0.99;

/// Follows a plan, and departs from it where the flown resources forbid it.
pub(super) struct ScanPilot {
    pub(super) table: Rc<SlotTable>,
    pub(super) plan: ScanPlan,
}

impl Pilot for ScanPilot {
    fn choose(&mut self, run: &mut TaskRun, indices: &mut Vec<Option<usize>>) {
        let table = &*self.table;
        let index = ((run.sim.time_s() / SLOT_S + 0.5) as usize).min(table.slots.len() - 1);
        let satellite = run.sim.satellite(0);
        let args = &table.args;
        let battery = satellite.battery_ws();
        let room_s = (args.storage_capacity_bits - satellite.stored()[0]) / args.instrument_bits;
        let is_low = battery < reserve_ws(table, index) + GUARD * args.battery_capacity_ws;
        let mode = match self.plan.modes[index] {
            Mode::Scan | Mode::Desaturate if is_low => Mode::Charge,
            Mode::Scan if room_s < SLOT_S => {
                if table.slots[index].access_s > 0.0 {
                    Mode::Downlink
                } else {
                    Mode::Charge
                }
            }
            Mode::Charge
                if battery > FULL_BATTERY * args.battery_capacity_ws
                    && table.slots[index].panel_w > 0.0
                    && room_s > SLOT_S =>
            {
                Mode::Scan
            }
            planned => planned,
        };
        indices.push(run.needs_action(0).then_some(mode as usize));
    }
}
