//! Satellites that were lost: each has exactly one failure of one of these modes.

use super::Case;
use super::meeting::encounter;
use super::mode::Mode;
use super::remedy::{Danger, search};
use super::trace::{End, Met, Who};
use crate::critique::{Encounter, Failure, Measure, Remedy};
use crate::kessler::constants::{SATELLITES, SURVIVED};
use crate::significant;

/// A satellite's loss.
pub(super) struct Loss {
    pub(super) satellite: usize,
    pub(super) end: End,
    /// Whether somebody could have known and acted; none where nobody could know.
    pub(super) avoidable: Option<bool>,
    pub(super) failure: Failure,
}

/// Every satellite that was lost.
pub(super) fn all(case: &Case<'_>) -> Vec<Loss> {
    (0..SATELLITES)
        .filter_map(|satellite| {
            let end = case.trace.ends[satellite]?;
            Some(match end.met {
                Some(met) => hit(case, satellite, end, met),
                None => decayed(case, satellite, end),
            })
        })
        .collect()
}

fn hit(case: &Case<'_>, satellite: usize, end: End, met: Met) -> Loss {
    let encounter = encounter(case, satellite, end, met);
    let (mode, what) = match met.who {
        Who::Debris(_) => (Mode::Collision, "Debris"),
        Who::Rogue(_) => (Mode::Rogue, "Rogue debris"),
        Who::Fragment(_) => (Mode::Fragment, "Fragment"),
    };
    let avoidable = encounter.avoidable;
    let mut measures = vec![fuel_left(case, satellite, end.step)];
    let what = format!("{what} {}", met.id);
    let (mode, did) = match end.passed {
        None => (mode, format!("{what} hit satellite {satellite} at step {}", end.step)),
        Some(passed) => {
            let survival = case.trace.satellite(satellite, case.flown().steps).survival;
            measures.push(Measure { name: "survival", value: survival, unit: "" });
            measures.push(Measure { name: "miss", value: passed.miss, unit: "LU" });
            measures.push(Measure { name: "probability", value: passed.probability, unit: "" });
            let did = format!(
                "Satellite {satellite} was left a survival of {}: {what} passed it at {:.1} LU at step {} (probability of \
                 collision {})",
                below(survival),
                passed.miss,
                end.step,
                significant(passed.probability, 3)
            );
            (Mode::Risk, did)
        }
    };
    let words = hit_words(&did, &encounter);
    let failure = Failure {
        mode: mode.name(),
        agent: satellite as u32,
        step: end.step,
        encounter: Some(encounter),
        measures,
        words,
    };
    Loss { satellite, end, avoidable, failure }
}

/// A survival that does not suffice, in as many digits as it takes to be seen below what would.
fn below(survival: f64) -> String {
    let enough =
        |digits: &usize| *digits > 12 || significant(survival, *digits) != significant(SURVIVED, *digits);
    significant(survival, (3..).find(enough).unwrap_or(3))
}

fn hit_words(did: &str, met: &Encounter) -> String {
    let came = format!(
        "{did}, from {:.0}° (radial out towards in-track) at {:.1} LU/TU",
        met.bearing_deg, met.relative_speed
    );
    let Some(seen) = met.first_visible_step else { return format!("{came}; nobody saw it come.") };
    let left = met.steps_left;
    let steps = if left == 1 { "step" } else { "steps" };
    let way = match &met.cheapest {
        Some(remedy) => remedy_words(remedy),
        None => "no single burn within what was known and left of the fuel would have avoided it".to_owned(),
    };
    format!("{came}; it was visible from step {seen}, {left} {steps} before, and {way}.")
}

fn remedy_words(remedy: &Remedy) -> String {
    if remedy.cost > 0.0 {
        format!("one burn at step {} for {:.2} fuel would have avoided it", remedy.step, remedy.cost)
    } else {
        format!("holding from step {} on would have avoided it", remedy.step)
    }
}

/// The Earth is always in sight, so acting can begin at step 1.
fn decayed(case: &Case<'_>, satellite: usize, end: End) -> Loss {
    let danger = Danger { satellite, from: 1, step: end.step, who: None, fuel: None };
    let remedy = search(case.plans, case.sky, case.trace, danger);
    let (spent, _) = case.spent(|v| v.agent as usize == satellite);
    let way = remedy.as_ref().map_or_else(
        || "no single burn within what was known and left of the fuel would have avoided it".to_owned(),
        remedy_words,
    );
    let mut measures = vec![
        fuel_left(case, satellite, end.step),
        Measure { name: "fuel_spent", value: spent, unit: "fuel" },
        Measure { name: "avoidable", value: f64::from(u8::from(remedy.is_some())), unit: "" },
    ];
    if let Some(remedy) = &remedy {
        measures.push(Measure { name: "cheapest_step", value: f64::from(remedy.step), unit: "step" });
        measures.push(Measure { name: "cheapest_cost", value: remedy.cost, unit: "fuel" });
    }
    let failure = Failure {
        mode: Mode::Decay.name(),
        agent: satellite as u32,
        step: end.step,
        encounter: None,
        measures,
        words: format!(
            "Satellite {satellite} fell into the Earth at step {} after burns of {spent:.1} fuel; {way}.",
            end.step
        ),
    };
    Loss { satellite, end, avoidable: Some(remedy.is_some()), failure }
}

fn fuel_left(case: &Case<'_>, satellite: usize, step: u32) -> Measure {
    Measure { name: "fuel_left", value: case.trace.satellite(satellite, step).fuel, unit: "fuel" }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_survival_that_does_not_suffice_is_seen_to_be_below() {
        let told = [0.5, 0.897, 0.8996, 0.899_99, 0.001].map(below);
        assert_eq!(told, ["0.500", "0.897", "0.8996", "0.89999", "0.00100"]);
    }
}
