//! Aims of layouts: which failure modes a layout can cause, and whether its encounters match its aim.

use env_core::critique::FailureModeSpec;

use super::design::{Design, Encounter};
use super::placement::PlacedBody;
use super::vocabulary::EncounterKind;
use crate::angles::angle_between;
use crate::brief::DesignBrief;
use crate::field_error::FieldError;

/// Maximum distance from the aimed bearing of the encounter that matches it, in degrees: half a sector of the failure profile.
pub(super) const AIM_TOLERANCE_DEG: f64 = 15.0;

/// Failure mode that a layout can aim at, and the encounters that it needs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct AimSpec {
    /// Name of the failure mode.
    pub(super) mode: &'static str,
    /// Kind of encounter that counts for the aim.
    pub(super) kind: EncounterKind,
    /// True if only rogues count, false if only other debris counts; `None` if both do.
    pub(super) is_rogue: Option<bool>,
    /// Needed encounters, in a few words. They are part of the prompt.
    pub(super) needs: &'static str,
}

/// All aims, in prompt order.
pub(super) const AIMS: [AimSpec; 4] = [
    AimSpec {
        mode: "collision",
        kind: EncounterKind::Threat,
        is_rogue: Some(false),
        needs: "a threat that exists from the start",
    },
    AimSpec {
        mode: "rogue",
        kind: EncounterKind::Threat,
        is_rogue: Some(true),
        needs: "a threat that is a rogue",
    },
    AimSpec {
        mode: "fuel_starvation",
        kind: EncounterKind::Threat,
        is_rogue: None,
        needs: "two threats to one satellite",
    },
    AimSpec {
        mode: "wasted_fuel",
        kind: EncounterKind::Decoy,
        is_rogue: None,
        needs: "a decoy, and no threat",
    },
];

impl AimSpec {
    fn counts(&self, encounter: &Encounter) -> bool {
        encounter.kind == self.kind && self.is_rogue.is_none_or(|is_rogue| encounter.is_rogue == is_rogue)
    }
}

/// Iterates over the aims that a layout for a brief can have.
pub(super) fn allowed_aims(brief: &DesignBrief) -> impl Iterator<Item = &'static AimSpec> {
    let modes: &'static [FailureModeSpec] = brief.recipe.task().failure_modes();
    let rogues = allows_rogues(brief);
    AIMS.iter().filter(move |aim| {
        modes.iter().any(|mode| mode.name == aim.mode) && (rogues || aim.is_rogue != Some(true))
    })
}

/// Returns true if a layout for a brief may have rogues.
pub(super) fn allows_rogues(brief: &DesignBrief) -> bool {
    brief.max_param("rogue_probability") > 0.0
}

/// Returns true if a design has a threat, and is not a layout of decoys.
pub(super) fn has_threat(design: &Design) -> bool {
    design.encounters.iter().any(|encounter| encounter.kind == EncounterKind::Threat)
}

/// Checks that the encounters of a design match its aim. `placed` has the body of each encounter.
///
/// # Errors
/// Returns an error of `aim.mode` if no layout can aim at the mode, of `aim` if the needed encounters are missing, and of
/// `aim.bearing_deg` if none of them comes from the aimed bearing.
pub(super) fn check_aim(design: &Design, placed: &[PlacedBody]) -> Result<(), FieldError> {
    let mode = &design.aim.mode;
    let Some(spec) = AIMS.iter().find(|spec| spec.mode == mode) else {
        let modes = AIMS.map(|spec| spec.mode).join(", ");
        let message = format!("must be one of {modes}, got {mode:?}");
        return Err(FieldError::new("aim.mode", message));
    };
    let counting: Vec<(&Encounter, &PlacedBody)> =
        design.encounters.iter().zip(placed).filter(|(encounter, _)| spec.counts(encounter)).collect();
    let has_enough = match mode.as_str() {
        "fuel_starvation" => counting.iter().any(|(encounter, _)| {
            counting.iter().filter(|(other, _)| other.satellite == encounter.satellite).count() > 1
        }),
        "wasted_fuel" => !counting.is_empty() && !has_threat(design),
        _ => !counting.is_empty(),
    };
    if !has_enough {
        let message = format!("{mode} needs {}; add it to the encounters, or choose another aim", spec.needs);
        return Err(FieldError::new("aim", message));
    }
    let Some(aimed) = design.aim.bearing_deg else { return Ok(()) };
    let distance = |bearing: f64| angle_between(f64::from(aimed), bearing);
    let bearings = counting.iter().map(|(_, placed)| placed.bearing_deg);
    match bearings.min_by(|a, b| distance(*a).total_cmp(&distance(*b))) {
        Some(nearest) if distance(nearest) > AIM_TOLERANCE_DEG => Err(FieldError::new(
            "aim.bearing_deg",
            format!(
                "must be within {AIM_TOLERANCE_DEG} degrees of a needed encounter, got {aimed}; the nearest one comes from \
                 {nearest:.0}"
            ),
        )),
        _ => Ok(()),
    }
}
