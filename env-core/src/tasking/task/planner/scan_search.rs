//! Search for plans of a scanning satellite in the coarse model.

use super::coarse::CoarseState;
use super::scan_plan::ScanPlan;
use super::scan_rule::{ORBIT_SLOTS, ORBITS, ScanRule};
use super::slots::SlotTable;

/// Thresholds of the panel's lost power, W per m² of the panel: those in the dark lose nothing.
const LOSSES_W_M2: [f64; 8] = [0.5, 35.0, 70.0, 105.0, 140.0, 180.0, 225.0, 300.0];
/// Thresholds of the wheels' speeds, as shares of the limit.
const WHEELS: [f64; 5] = [0.06, 0.15, 0.25, 0.45, 0.9];
/// Thresholds of the stored data, as shares of the storage.
const STORAGES: [f64; 1] = [0.3];
/// Reserves of the battery, as shares of its capacity.
const RESERVES: [f64; 2] = [0.07, 0.2];

/// A candidate with the rule that it began with.
#[derive(Debug, Clone)]
pub(super) struct ScanCandidate {
    pub(super) rule: ScanRule,
    pub(super) plan: ScanPlan,
}

/// Rules and their plans, best first.
pub(super) fn search(table: &SlotTable, start: &CoarseState) -> Vec<ScanCandidate> {
    let mut candidates = Vec::new();
    let area = table.args.panel_area_m2;
    for loss in LOSSES_W_M2 {
        for desaturate_above in WHEELS {
            for downlink_above in STORAGES {
                for reserve in RESERVES {
                    let rule =
                        ScanRule { loss_w: [loss * area; ORBITS], desaturate_above, downlink_above, reserve };
                    candidates.push(ScanCandidate { rule, plan: ScanPlan::of_rule(table, start, &rule) });
                }
            }
        }
    }
    sort(&mut candidates);
    candidates
}

/// Best first; equal ones stay in order.
pub(super) fn sort(candidates: &mut [ScanCandidate]) {
    candidates.sort_by(|a, b| b.plan.score.total_cmp(&a.plan.score));
}

impl ScanCandidate {
    /// Chooses the threshold of each orbit in turn.
    pub(super) fn tune_orbits(&mut self, table: &SlotTable, start: &CoarseState) {
        let area = table.args.panel_area_m2;
        let orbits = table.slots.len().div_ceil(ORBIT_SLOTS).min(ORBITS);
        for orbit in 0..orbits {
            for loss in LOSSES_W_M2 {
                let mut rule = self.rule;
                rule.loss_w[orbit] = loss * area;
                if rule == self.rule {
                    continue;
                }
                let plan = ScanPlan::of_rule(table, start, &rule);
                if plan.score > self.plan.score {
                    *self = Self { rule, plan };
                }
            }
        }
    }
}
