//! What a finished episode shows, from its scenario and actions alone: why score was lost, with the geometry of it; what
//! every action was worth; and a judgement from −1 to 1. Each world fills these in by its own
//! rules; nobody else needs to know them.

use serde::Serialize;

/// What a finished episode shows.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Critique {
    /// Why score was lost, in order of step.
    pub failures: Vec<Failure>,
    /// What each action was worth, in order of step: the counterfactual is the same episode without it.
    pub actions: Vec<ActionVerdict>,
    /// The deterministic judge.
    pub judged: Judged,
}

/// One reason why an episode lost score.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Failure {
    /// One of the task's failure modes.
    pub mode: &'static str,
    /// Whose.
    pub agent: u32,
    /// When, counted from 1.
    pub step: u32,
    /// With what, from where, how fast; none where nothing was met.
    pub encounter: Option<Encounter>,
    /// Further numbers that belong to the mode, each with its unit.
    pub measures: Vec<Measure>,
    /// The same in one sentence.
    pub words: String,
}

/// A number with its name and unit.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Measure {
    /// What it is.
    pub name: &'static str,
    /// How much.
    pub value: f64,
    /// Its unit, empty for a pure number.
    pub unit: &'static str,
}

/// The geometry of a meeting.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Encounter {
    /// The id of what was met, among the bodies of its kind.
    pub body: u32,
    /// Where it was, seen from the agent, some steps before (DESIGN: min(5, step), or when it became visible if that is
    /// later): degrees in [0, 360) from radial out towards in-track.
    pub bearing_deg: f64,
    /// The same from +X towards +Y of the inertial frame; none in a world without one.
    pub bearing_inertial_deg: Option<f64>,
    /// Relative speed at contact, in the world's unit of speed.
    pub relative_speed: f64,
    /// The first step after which the body was visible to the agents (0: at the start); none if it never was.
    pub first_visible_step: Option<u32>,
    /// Steps from then to the contact in which somebody could still act.
    pub steps_left: u32,
    /// Whether acting from that step on, within what was left of the fuel, would have avoided it; none if it was never
    /// visible.
    pub avoidable: Option<bool>,
    /// The cheapest such action that was found.
    pub cheapest: Option<Remedy>,
}

/// An action that would have helped.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Remedy {
    /// When, counted from 1.
    pub step: u32,
    /// Its values, as the task's action space has them.
    pub values: Vec<f64>,
    /// What it costs, in the world's unit of fuel.
    pub cost: f64,
}

/// What an action was worth.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ActionVerdict {
    /// When, counted from 1.
    pub step: u32,
    /// Whose.
    pub agent: u32,
    /// What it cost, in the world's unit of fuel.
    pub cost: f64,
    /// The verdict.
    pub verdict: Verdict,
    /// The score with it minus the score without it. In docking only the agent's own return is compared, over the number
    /// of agents: what the others would have earned had they not collided with it, or had they, is left out.
    pub gain: f64,
}

/// The verdict on one action, by the same episode without it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Without it more would have been lost.
    Needed,
    /// It changed nothing that counts.
    Harmless,
    /// It cost score or fuel that counts, and gained nothing.
    Wasteful,
    /// With it more was lost.
    Harmful,
}

/// The deterministic judge's word on an episode, from −1 to 1.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Judged {
    /// Within −1 to 1.
    pub value: f64,
    /// Which of the judge's cases it is, as `no_action_needed`.
    pub case: &'static str,
    /// The same in one sentence.
    pub words: String,
}

/// One failure mode of a task, as data.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct ModeSpec {
    /// Its name.
    pub name: &'static str,
    /// What it is, in one sentence.
    pub about: &'static str,
}

/// How a world sorts relative speeds for people: upper edges of all bands but the last.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct SpeedBands {
    /// Edges, ascending.
    pub edges: &'static [f64],
    /// Their unit.
    pub unit: &'static str,
}

/// Bearing sectors of a failure profile, 30° each; sector 0 is centred on radial out.
pub const SECTORS: u32 = 12;

/// The sector of a bearing: the first is −15° to 15°.
#[must_use]
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a whole number from 0 to 12")]
pub fn sector(bearing_deg: f64) -> u32 {
    let width = 360.0 / f64::from(SECTORS);
    let turned = (bearing_deg + 0.5 * width) / width;
    let whole = libm::floor(turned);
    let wrapped = whole - libm::floor(whole / f64::from(SECTORS)) * f64::from(SECTORS);
    (wrapped as u32).min(SECTORS - 1)
}

/// Steps before a contact at which its bearing is taken: min(5, step), or when what comes is first visible if that is later.
pub const BEARING_STEPS: u32 = 5;

/// A bearing: the angle of (first, second) from the first axis towards the second, degrees in [0, 360).
pub(crate) fn angle_deg(first: f64, second: f64) -> f64 {
    let angle = libm::atan2(second, first).to_degrees();
    // A tiny negative angle plus 360 rounds to 360 itself, and 0 is never −0.
    if angle < 0.0 { (angle + 360.0) % 360.0 } else { angle + 0.0 }
}

impl SpeedBands {
    /// The band of a speed, counted from 0.
    #[must_use]
    pub fn band(&self, speed: f64) -> u32 {
        self.edges.iter().filter(|&&edge| speed >= edge).count() as u32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sectors_are_centred_on_the_axes_and_wrap() {
        let at = [(0.0, 0), (14.9, 0), (15.1, 1), (90.0, 3), (180.0, 6), (344.9, 11), (345.1, 0), (359.9, 0)];
        for (bearing, wanted) in at {
            assert_eq!(sector(bearing), wanted, "{bearing}");
        }
        assert_eq!((sector(-20.0), sector(720.0), sector(f64::NAN)), (11, 0, 0));
    }

    #[test]
    fn angles_run_from_the_first_axis_to_the_second() {
        let around =
            [(2.0, 0.0), (1.0, 1.0), (0.0, 3.0), (-1.0, 0.0), (-1.0, -0.0), (0.0, -1.0), (1.0, -1.0)];
        for ((first, second), wanted) in around.into_iter().zip([0.0, 45.0, 90.0, 180.0, 180.0, 270.0, 315.0])
        {
            // One rounding of atan2 and one of the scale.
            assert!((angle_deg(first, second) - wanted).abs() < 1e-9, "{first} {second}");
        }
        for second in [-1e-300, -1e-17, -0.0, 0.0] {
            assert_eq!(angle_deg(1.0, second).to_bits(), 0.0_f64.to_bits(), "{second}");
        }
    }

    #[test]
    fn bands_are_half_open() {
        let bands = SpeedBands { edges: &[1.0, 3.0], unit: "LU/TU" };
        assert_eq!([0.0, 0.9, 1.0, 2.9, 3.0, 99.0].map(|v| bands.band(v)), [0, 0, 1, 1, 2, 2]);
    }
}
