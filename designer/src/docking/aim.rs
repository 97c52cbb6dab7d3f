//! Aims of layouts: which failure modes a layout can cause, and whether its deputies match its aim.
//!
//! Each condition compares a closed-form quantity of [`approach`](super::approach) with a threshold. The thresholds are those
//! beyond which a policy that flies at three quarters of the speed limit and brakes late begins to fail.

use env_core::docking::constants::{COLLISION_DISTANCE_M, STATE_DIM};
use env_core::docking::relative_motion::RelativeState;
use env_core::docking::setup::DockingSetup;

use super::approach::{StartApproach, nearest_pass, separation_on_arrival, step_out_of_bounds};
use super::design::{DeputyStart, DockingDesign};
use super::vocabulary::BEARING;
use crate::angles::{angle_between, whole_degrees};
use crate::brief::DesignBrief;
use crate::field_error::FieldError;

/// Maximum difference of the aimed bearing from that of a deputy that matches the aim, in degrees: half a sector of the failure
/// profile.
pub(super) const AIM_TOLERANCE_DEG: f64 = 15.0;
/// Least share of the way to the chief that braking takes, for a crash.
pub(super) const MIN_BRAKING_SHARE: f64 = 0.3;
/// Least velocity penalty that braking to the limit costs, for saturation: a tenth of the penalty that stops a deputy.
pub(super) const MIN_BRAKING_PENALTY: f64 = 0.5;
/// Least share of the time limit that an approach at the speed limit takes, for a timeout.
pub(super) const MIN_TIME_SHARE: f64 = 0.75;
/// Largest separation at which two coasting deputies are in each other's way, m: four times the distance at which they collide.
pub(super) const MEETING_DISTANCE_M: f64 = 2.0;
/// Time within which coasting deputies meet, s.
pub(super) const MEETING_TIME_S: u32 = 300;
/// Least time limit with which a coasting deputy can leave bounds and another policy can dock it, s. At the fastest start that
/// braking allows, 10 km take about 1 200 s.
const MIN_ESCAPE_TIME_S: f64 = 1200.0;

/// Failure mode that a layout can aim at, and what it needs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct DockingAimSpec {
    /// Name of the failure mode.
    pub(super) mode: &'static str,
    /// Needed deputies, in a few words. They are part of the prompt.
    pub(super) needs: &'static str,
    /// Hint for a design without such deputies, after the number that the best deputy reaches.
    fix: &'static str,
}

/// All aims, in prompt order.
pub(super) const AIMS: [DockingAimSpec; 5] = [
    DockingAimSpec {
        mode: "crash",
        needs: "a deputy whose braking to the docking speed takes at least 30 % of its way to the chief",
        fix: "choose a higher closing speed, a smaller distance or a lower thrust bound",
    },
    DockingAimSpec {
        mode: "saturation",
        needs: "a deputy above the speed limit whose braking to it costs a velocity penalty of at least 0.5",
        fix: "choose a higher speed or a lower thrust bound",
    },
    DockingAimSpec {
        mode: "timeout",
        needs: "a deputy that needs at least 75 % of the time limit at the speed limit",
        fix: "choose a larger distance, a lower closing speed or a shorter time limit",
    },
    DockingAimSpec {
        mode: "collision",
        needs: "two deputies that come within 2 m of each other, on arrival at the speed limit or while they coast",
        fix: "choose equal distances and speeds from directions less than 60 degrees apart, or paths that cross",
    },
    DockingAimSpec {
        mode: "out_of_bounds",
        needs: "a deputy that is 10 km away before the time limit if it coasts",
        fix: "choose a larger distance, a faster departure or a longer time limit",
    },
];

/// Iterates over the aims that a layout for a brief can have.
pub(super) fn allowed_aims(brief: &DesignBrief) -> impl Iterator<Item = &'static DockingAimSpec> {
    let modes = brief.recipe.task().failure_modes();
    let most_deputies = DeputyCounts::of(brief).max;
    let longest = brief.max_param("time_limit_s");
    AIMS.iter().filter(move |aim| {
        modes.iter().any(|mode| mode.name == aim.mode)
            && match aim.mode {
                "collision" => most_deputies > 1,
                "out_of_bounds" => longest >= MIN_ESCAPE_TIME_S,
                _ => true,
            }
    })
}

/// Numbers of deputies that a layout for a brief can have.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct DeputyCounts {
    /// Smallest number that is allowed.
    pub(super) min: u32,
    /// Largest number that is allowed.
    pub(super) max: u32,
}

impl DeputyCounts {
    /// Returns the numbers from the fewest to the most deputies among the brief's params and their choices.
    pub(super) fn of(brief: &DesignBrief) -> Self {
        let agents = f64::from(brief.recipe.task().agents(&brief.recipe));
        let choice = brief.param_choices.iter().find(|choice| choice.param == "deputies");
        let values = choice.into_iter().flat_map(|choice| choice.values.iter().copied());
        let (mut min, mut max) = (agents, agents);
        for value in values {
            (min, max) = (min.min(value), max.max(value));
        }
        Self { min: min as u32, max: max as u32 }
    }

    /// Returns true if a layout may have this number of deputies.
    pub(super) fn contains(self, count: usize) -> bool {
        (self.min as usize..=self.max as usize).contains(&count)
    }
}

/// Deputies of a design with their states and approaches.
pub(super) struct AimedDeputies<'a> {
    pub(super) deputies: &'a [DeputyStart],
    pub(super) states: Vec<RelativeState>,
    pub(super) approaches: Vec<StartApproach>,
    /// Time limit of the episode, s.
    time_limit: u32,
}

impl<'a> AimedDeputies<'a> {
    /// Computes states and approaches under the params of a setup.
    pub(super) fn new(deputies: &'a [DeputyStart], setup: &DockingSetup) -> Self {
        let states: Vec<RelativeState> = deputies.iter().map(DeputyStart::state).collect();
        let approaches = states.iter().map(|state| StartApproach::new(state, setup.thrust_bound)).collect();
        Self { deputies, states, approaches, time_limit: setup.recipe_time_limit }
    }

    /// Returns the quantity of a deputy that a mode compares with its threshold.
    fn measure(&self, mode: &str, index: usize) -> AimMeasure {
        let approach = &self.approaches[index];
        match mode {
            "crash" => {
                let share = approach.braking_share();
                let text = format!("braking takes {:.0} % of its way", 100.0 * share);
                AimMeasure { matches: share >= MIN_BRAKING_SHARE, value: share, text }
            }
            "saturation" => {
                let penalty = approach.braking_penalty();
                let text = format!("braking to the limit costs {penalty:.2}");
                AimMeasure { matches: penalty >= MIN_BRAKING_PENALTY, value: penalty, text }
            }
            "timeout" => {
                let share = approach.needed_time() / f64::from(self.time_limit.max(1));
                let text = format!("it needs {:.0} % of the time limit", 100.0 * share);
                AimMeasure { matches: share >= MIN_TIME_SHARE, value: share, text }
            }
            "collision" => {
                let nearest = self.nearest_other(index);
                let separation = nearest.as_ref().map_or(f64::MAX, |nearest| nearest.separation);
                let text = if self.deputies.len() < 2 {
                    "it is the only one".to_owned()
                } else {
                    format!("the nearest other one passes at {separation:.1} m")
                };
                AimMeasure { matches: nearest.is_some_and(|nearest| nearest.meets), value: -separation, text }
            }
            _ => {
                let out = step_out_of_bounds(&self.states[index], self.time_limit);
                let text = "it stays within 10 km".to_owned();
                AimMeasure { matches: out.is_some(), value: -approach.closing, text }
            }
        }
    }

    /// Returns the nearest pass of a deputy by any other, on arrival or while both coast; `None` if it is the only one.
    fn nearest_other(&self, index: usize) -> Option<NearestOther> {
        let others = (0..self.deputies.len()).filter(|other| *other != index);
        let nearest = |other: usize| {
            let angle = self.deputies[index].direction_angle_deg(&self.deputies[other]);
            let arrival = separation_on_arrival(&self.approaches[index], &self.approaches[other], angle);
            let steps = MEETING_TIME_S.min(self.time_limit);
            let coasting = nearest_pass(&self.states[index], &self.states[other], steps).separation;
            let meets = coasting < MEETING_DISTANCE_M || arrival < COLLISION_DISTANCE_M;
            NearestOther { other, separation: arrival.min(coasting), meets }
        };
        // One that it meets comes before a nearer one that it does not.
        others.map(nearest).min_by(|a, b| b.meets.cmp(&a.meets).then(a.separation.total_cmp(&b.separation)))
    }

    /// Returns the deputies that match a mode, with the bearing of the body that each is to meet.
    pub(super) fn matching(&self, mode: &str) -> Vec<MatchingDeputy> {
        let indices = (0..self.deputies.len()).filter(|index| self.measure(mode, *index).matches);
        indices.map(|index| MatchingDeputy { index, bearing_deg: self.bearing_deg(mode, index) }).collect()
    }

    /// Returns the bearing at the start, from a deputy to the chief, or in a collision to the nearest other one.
    fn bearing_deg(&self, mode: &str, index: usize) -> f64 {
        let other = (mode == "collision").then(|| self.nearest_other(index)).flatten();
        let target = other.map_or([0.0; STATE_DIM], |nearest| self.states[nearest.other]);
        let start = &self.states[index];
        libm::atan2(target[1] - start[1], target[0] - start[0]).to_degrees()
    }
}

/// Another deputy at its nearest pass.
struct NearestOther {
    other: usize,
    /// Distance at the pass, m.
    separation: f64,
    /// True if they collide on arrival, or come near each other while they coast.
    meets: bool,
}

/// Deputy that matches an aim.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct MatchingDeputy {
    /// Index of the deputy.
    pub(super) index: usize,
    /// Bearing of the body that it is to meet, in degrees.
    pub(super) bearing_deg: f64,
}

/// Quantity of a deputy that an aim compares with its threshold.
struct AimMeasure {
    matches: bool,
    /// Larger is nearer to the aim.
    value: f64,
    /// The quantity in words.
    text: String,
}

/// Checks that the deputies of a design match its aim.
///
/// # Errors
/// Returns an error of `aim.mode` if no layout can aim at the mode, of `aim` if the needed deputies are missing, and of
/// `aim.bearing_deg` if none of them has this bearing.
pub(super) fn check_aim(design: &DockingDesign, setup: &DockingSetup) -> Result<(), FieldError> {
    let mode = &design.aim.mode;
    let Some(spec) = AIMS.iter().find(|spec| spec.mode == mode) else {
        let modes = AIMS.map(|spec| spec.mode).join(", ");
        return Err(FieldError::new("aim.mode", format!("must be one of {modes}, got {mode:?}")));
    };
    let aimed = AimedDeputies::new(&design.deputies, setup);
    let matching = aimed.matching(mode);
    if matching.is_empty() {
        return Err(FieldError::new("aim", missing_text(spec, &aimed)));
    }
    let Some(aimed_deg) = design.aim.bearing_deg.map(|bearing| BEARING.value(bearing)) else { return Ok(()) };
    let distance = |bearing: f64| angle_between(aimed_deg, bearing);
    let bearings = matching.iter().map(|deputy| deputy.bearing_deg);
    match bearings.min_by(|a, b| distance(*a).total_cmp(&distance(*b))) {
        Some(nearest) if distance(nearest) > AIM_TOLERANCE_DEG => Err(FieldError::new(
            "aim.bearing_deg",
            format!(
                "must be within {AIM_TOLERANCE_DEG} degrees of what a needed deputy is to meet, got {aimed_deg}; the nearest one \
                 is at {}",
                whole_degrees(nearest)
            ),
        )),
        _ => Ok(()),
    }
}

/// Returns what a design lacks for its aim, with the deputy that comes nearest to it.
fn missing_text(spec: &DockingAimSpec, aimed: &AimedDeputies<'_>) -> String {
    let measures = (0..aimed.deputies.len()).map(|index| (index, aimed.measure(spec.mode, index)));
    let best = measures.max_by(|a, b| a.1.value.total_cmp(&b.1.value));
    let best = best.map_or_else(String::new, |(index, measure)| {
        format!("; of the deputies, deputies.{index} is nearest to it: {}", measure.text)
    });
    format!("{} needs {}{best}; {}, or choose another aim", spec.mode, spec.needs, spec.fix)
}
