//! Plans of a scanning satellite: a mode for every slot, with its score by the coarse model.

use super::coarse::{CoarseState, MODES, Mode};
use super::scan_rule::{Resources, ScanRule};
use super::slots::SlotTable;

/// Least momentum of the wheels for which a plan tries another desaturation, N·m·s.
const MIN_MOMENTUM: f64 = 3.0;
/// Least improvement of the score that changes a plan.
const MIN_GAIN: f64 = 1e-6;

/// The mode of every slot. An action that begins with a slot takes the mode of that slot.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct ScanPlan {
    pub(super) modes: Vec<Mode>,
    /// Score by the coarse model.
    pub(super) score: f64,
}

/// Slots after which a plan with a swapped mode is compared with the plan itself: slews have ended by then.
const COMPARED_AFTER: usize = 8;
/// Difference of momenta that does not matter, N·m·s.
const SAME_MOMENTUM: f64 = 0.01;
/// Charge below which the coarse model counts a plan as failed, as a share of the battery.
const FAILED_CHARGE: f64 = 0.03;

/// Runs actions from a slot on to the end. `decide` returns the mode of each action, and `observe` sees each with its first slot and
/// the state before it. Returns the score.
pub(super) fn simulate(
    table: &SlotTable,
    mut state: CoarseState,
    from: usize,
    mut decide: impl FnMut(&CoarseState, usize) -> Mode,
    mut observe: impl FnMut(usize, Mode, &CoarseState),
) -> f64 {
    let mut index = from;
    while index < table.slots.len() {
        let mode = decide(&state, index);
        observe(index, mode, &state);
        index = run_action(table, &mut state, index, mode);
        if has_failed(table, &state) {
            return failed_score(table, &state, index);
        }
    }
    state.scanned_s / table.limit_s
}

/// Runs an action that begins with a slot. Returns the slot after it.
fn run_action(table: &SlotTable, state: &mut CoarseState, index: usize, mode: Mode) -> usize {
    let end = (index + mode.slots()).min(table.slots.len());
    for slot in index..end {
        state.step(table, slot, mode);
    }
    end
}

fn has_failed(table: &SlotTable, state: &CoarseState) -> bool {
    state.is_dead || state.battery_ws < FAILED_CHARGE * table.args.battery_capacity_ws
}

/// Score of a plan that fails before a slot. Of two such plans, the one that lives longer is better.
fn failed_score(table: &SlotTable, state: &CoarseState, index: usize) -> f64 {
    state.scanned_s / table.limit_s - 2.0 + index as f64 / table.slots.len() as f64
}

impl ScanPlan {
    /// The plan of a rule from a state on.
    pub(super) fn of_rule(table: &SlotTable, start: &CoarseState, rule: &ScanRule) -> Self {
        let mut modes = vec![Mode::Charge; table.slots.len()];
        let decide = |state: &CoarseState, index: usize| rule.decide(table, &Resources::of(state), index);
        let score = simulate(table, *start, 0, decide, |index, mode, _| {
            let end = (index + mode.slots()).min(modes.len());
            modes[index..end].fill(mode);
        });
        Self { modes, score }
    }

    /// Tries another mode for each action in turn, and keeps it where the score of the whole plan rises.
    pub(super) fn swap_modes(&mut self, table: &SlotTable, start: &CoarseState) {
        let mut baseline = self.states(table, start);
        let mut index = 0;
        let mut state = *start;
        while index < table.slots.len() {
            for mode in MODES {
                if mode == self.modes[index] || !is_useful(table, &state, index, mode) {
                    continue;
                }
                let score = self.swapped_score(table, state, index, mode, &baseline);
                if score > self.score + MIN_GAIN {
                    let end = (index + mode.slots()).min(table.slots.len());
                    self.modes[index..end].fill(mode);
                    self.score = score;
                    baseline = self.states(table, start);
                }
            }
            index = run_action(table, &mut state, index, self.modes[index]);
        }
    }

    /// States at the slots where actions begin.
    fn states(&self, table: &SlotTable, start: &CoarseState) -> Vec<Option<CoarseState>> {
        let mut states = vec![None; table.slots.len()];
        simulate(
            table,
            *start,
            0,
            |_, slot| self.modes[slot],
            |index, _, state| states[index] = Some(*state),
        );
        states
    }

    /// Score of the plan with another mode for the action that begins with a slot. It is negative infinity once the satellite is
    /// nowhere better off than by the plan itself.
    fn swapped_score(
        &self,
        table: &SlotTable,
        mut state: CoarseState,
        from: usize,
        swapped: Mode,
        baseline: &[Option<CoarseState>],
    ) -> f64 {
        let mut index = run_action(table, &mut state, from, swapped);
        while index < table.slots.len() && !has_failed(table, &state) {
            if index >= from + COMPARED_AFTER
                && let Some(before) = &baseline[index]
            {
                let scanned_s = state.scanned_s - before.scanned_s;
                let energy_ws = state.battery_ws - before.battery_ws;
                let room_bits = before.stored_bits - state.stored_bits;
                let momentum = before.momentum_size() - state.momentum_size();
                if scanned_s <= 0.0 && energy_ws <= 0.0 && room_bits <= 0.0 && momentum < SAME_MOMENTUM {
                    return f64::NEG_INFINITY;
                }
                let is_same = energy_ws == 0.0 && room_bits == 0.0 && momentum.abs() < SAME_MOMENTUM;
                if is_same {
                    return self.score + scanned_s / table.limit_s;
                }
            }
            index = run_action(table, &mut state, index, self.modes[index]);
        }
        if has_failed(table, &state) {
            failed_score(table, &state, index)
        } else {
            state.scanned_s / table.limit_s
        }
    }
}

/// True if a mode can be of use in a slot.
fn is_useful(table: &SlotTable, state: &CoarseState, index: usize, mode: Mode) -> bool {
    match mode {
        Mode::Scan | Mode::Charge => true,
        Mode::Downlink => table.slots[index].access_s > 0.0 && state.stored_bits > 0.0,
        Mode::Desaturate => state.momentum_size() > MIN_MOMENTUM,
    }
}
