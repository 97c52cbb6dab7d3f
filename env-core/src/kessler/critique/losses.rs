//! Lost satellites: each has exactly one failure with a mode of this module.

use super::analysis::EpisodeAnalysis;
use super::encounter;
use super::failure_mode::KesslerFailureMode;
use super::remedy::{LossToAvoid, find_remedy};
use super::trace::{DebrisContact, DebrisIdentity, LossApproach, LossEvent};
use crate::critique::{Encounter, Failure, Measure, Remedy};
use crate::kessler::constants::{SATELLITES, SURVIVAL_THRESHOLD};
use crate::number_format::format_significant;

/// Text of a loss without a remedy.
const NO_REMEDY: &str = "no single burn with the known debris and the remaining fuel would have avoided it";

/// Lost satellite and its failure.
pub(super) struct SatelliteLoss {
    pub satellite: usize,
    pub event: LossEvent,
    /// True if a remedy was found; `None` if the debris was never visible.
    pub avoidable: Option<bool>,
    pub failure: Failure,
}

/// Finds all lost satellites.
pub(super) fn find(analysis: &EpisodeAnalysis<'_>) -> Vec<SatelliteLoss> {
    (0..SATELLITES)
        .filter_map(|satellite| {
            let event = analysis.trace.losses[satellite]?;
            Some(match event.debris {
                Some(debris) => loss_to_debris(analysis, satellite, event, debris),
                None => loss_by_decay(analysis, satellite, event),
            })
        })
        .collect()
}

fn loss_to_debris(
    analysis: &EpisodeAnalysis<'_>,
    satellite: usize,
    event: LossEvent,
    debris: DebrisContact,
) -> SatelliteLoss {
    let encounter = encounter::describe(analysis, satellite, event, debris);
    let (mode, kind) = match debris.identity {
        DebrisIdentity::Initial(_) => (KesslerFailureMode::Collision, "Debris"),
        DebrisIdentity::Rogue(_) => (KesslerFailureMode::Rogue, "Rogue debris"),
        DebrisIdentity::Fragment(_) => (KesslerFailureMode::Fragment, "Fragment"),
    };
    let avoidable = encounter.avoidable;
    let mut measures = vec![fuel_left(analysis, satellite, event.step)];
    let name = format!("{kind} {}", debris.id);
    let (mode, what) = match event.approach {
        None => (mode, format!("{name} hit satellite {satellite} at step {}", event.step)),
        Some(LossApproach { miss, probability }) => {
            let survival = analysis.trace.satellite(satellite, analysis.outcome().steps).survival;
            measures.push(Measure::new("survival", survival, ""));
            measures.push(Measure::new("miss", miss, "LU"));
            measures.push(Measure::new("probability", probability, ""));
            let what = format!(
                "Satellite {satellite} was left with survival {}: {name} passed it at {miss:.1} LU at step {} \
                 (probability of collision {})",
                format_low_survival(survival),
                event.step,
                format_significant(probability, 3)
            );
            (KesslerFailureMode::Risk, what)
        }
    };
    let explanation = encounter_words(&what, &encounter);
    let failure = Failure {
        mode: mode.name(),
        agent: satellite as u32,
        step: event.step,
        encounter: Some(encounter),
        orbit_angle_deg: None,
        measures,
        explanation,
    };
    SatelliteLoss { satellite, event, avoidable, failure }
}

/// Formats a survival below [`SURVIVAL_THRESHOLD`] with as many digits as are needed to show that it is below.
fn format_low_survival(survival: f64) -> String {
    let suffices = |digits: &usize| {
        *digits > 12
            || format_significant(survival, *digits) != format_significant(SURVIVAL_THRESHOLD, *digits)
    };
    format_significant(survival, (3..).find(suffices).unwrap_or(3))
}

fn encounter_words(what: &str, encounter: &Encounter) -> String {
    let came = format!(
        "{what}, from {:.0}° (radial out towards in-track) at {:.1} LU/TU",
        encounter.bearing_deg, encounter.relative_speed
    );
    let Some(visible) = encounter.first_visible_step else { return format!("{came}; it was never visible.") };
    let left = encounter.steps_left;
    let steps = if left == 1 { "step" } else { "steps" };
    let remedy = encounter.cheapest_avoidance.as_ref().map_or_else(|| NO_REMEDY.to_owned(), remedy_words);
    format!("{came}; it was visible from step {visible}, {left} {steps} before, and {remedy}.")
}

fn remedy_words(remedy: &Remedy) -> String {
    if remedy.cost > 0.0 {
        format!("one burn at step {} for {:.2} fuel would have avoided it", remedy.step, remedy.cost)
    } else {
        format!("holding from step {} on would have avoided it", remedy.step)
    }
}

/// Loss of a satellite that fell into the Earth. The Earth is always visible, so a remedy may begin at step
/// 1.
fn loss_by_decay(analysis: &EpisodeAnalysis<'_>, satellite: usize, event: LossEvent) -> SatelliteLoss {
    let loss = LossToAvoid { satellite, from: 1, step: event.step, debris: None, fuel: None };
    let remedy = find_remedy(analysis.counterfactuals, analysis.visibility, analysis.trace, loss);
    let spent = analysis.total_burns(|v| v.agent as usize == satellite).cost;
    let way = remedy.as_ref().map_or_else(|| NO_REMEDY.to_owned(), remedy_words);
    let mut measures = vec![
        fuel_left(analysis, satellite, event.step),
        Measure::new("fuel_spent", spent, "fuel"),
        Measure::new("avoidable", f64::from(u8::from(remedy.is_some())), ""),
    ];
    if let Some(remedy) = &remedy {
        measures.push(Measure::new("cheapest_step", f64::from(remedy.step), "step"));
        measures.push(Measure::new("cheapest_cost", remedy.cost, "fuel"));
    }
    let failure = Failure {
        mode: KesslerFailureMode::Decay.name(),
        agent: satellite as u32,
        step: event.step,
        encounter: None,
        orbit_angle_deg: None,
        measures,
        explanation: format!(
            "Satellite {satellite} fell into the Earth at step {} after burns of {spent:.1} fuel; {way}.",
            event.step
        ),
    };
    SatelliteLoss { satellite, event, avoidable: Some(remedy.is_some()), failure }
}

fn fuel_left(analysis: &EpisodeAnalysis<'_>, satellite: usize, step: u32) -> Measure {
    Measure::new("fuel_left", analysis.trace.satellite(satellite, step).fuel, "fuel")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn low_survival_is_shown_below_the_threshold() {
        let texts = [0.5, 0.897, 0.8996, 0.899_99, 0.001].map(format_low_survival);
        assert_eq!(texts, ["0.500", "0.897", "0.8996", "0.89999", "0.00100"]);
    }
}
