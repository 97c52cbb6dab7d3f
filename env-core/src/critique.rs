//! Critiques of finished episodes, computed from scenario and actions alone: why score was lost, with the geometry; what
//! each action was worth; and a judgement from −1 to 1. Each world computes them by its own rules.

use serde::Serialize;

/// Analysis of a finished episode.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Critique {
    /// Reasons why score was lost, in order of step.
    pub failures: Vec<Failure>,
    /// Verdicts on each action, in order of step; the counterfactual is the same episode without the action.
    pub actions: Vec<ActionVerdict>,
    /// Judgement of the episode by fixed rules.
    pub assessment: Judgement,
}

/// One reason why an episode lost score.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Failure {
    /// Name of one of the task's failure modes.
    pub mode: &'static str,
    /// Number of the agent.
    pub agent: u32,
    /// Step of the loss, counted from 1.
    pub step: u32,
    /// Geometry of the contact, if there was one.
    pub encounter: Option<Encounter>,
    /// Angle of the agent along its orbit from local noon at the loss, degrees in [0, 360) in the direction of motion; `None` in a
    /// world without the Sun.
    pub orbit_angle_deg: Option<f64>,
    /// Further values that belong to the mode.
    pub measures: Vec<Measure>,
    /// Description in one sentence.
    pub explanation: String,
}

impl Failure {
    /// Angle that places the failure in a failure profile, degrees in [0, 360): the bearing of its encounter, or else its orbit angle.
    /// [`SectorQuantity`] describes it.
    #[must_use]
    pub fn sector_deg(&self) -> Option<f64> {
        self.encounter.as_ref().map(|encounter| encounter.bearing_deg).or(self.orbit_angle_deg)
    }
}

/// A number with its name and unit.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Measure {
    /// Name of the value.
    pub name: &'static str,
    /// Value in this unit.
    pub value: f64,
    /// Unit of the value, empty for a pure number.
    pub unit: &'static str,
}

impl Measure {
    /// Creates a named value with its unit.
    pub(crate) const fn new(name: &'static str, value: f64, unit: &'static str) -> Self {
        Self { name, value, unit }
    }
}

/// Geometry of a contact between an agent and another body.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Encounter {
    /// Id of the other body among the bodies of its kind.
    pub body: u32,
    /// Bearing of the body from the agent before the contact (see [`BEARING_STEPS`]), degrees in [0, 360) from radial out
    /// towards in-track.
    pub bearing_deg: f64,
    /// The same bearing from +X towards +Y of the inertial frame; `None` in a world without one.
    pub bearing_inertial_deg: Option<f64>,
    /// Relative speed at the contact, in the world's unit of speed.
    pub relative_speed: f64,
    /// First step after which the body was visible to the agents, 0 at the start; `None` if it never was.
    pub first_visible_step: Option<u32>,
    /// Number of steps from then to the contact in which the agent could still act.
    pub steps_left: u32,
    /// True if acting from that step on with the remaining fuel would have avoided the contact; `None` if the body was never
    /// visible.
    pub avoidable: Option<bool>,
    /// Cheapest such action that was found.
    pub cheapest_avoidance: Option<Remedy>,
}

/// An action that would have avoided a failure.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Remedy {
    /// Step of the action, counted from 1.
    pub step: u32,
    /// Values of the action in the order of the action space.
    pub values: Vec<f64>,
    /// Cost in the world's unit of fuel.
    pub cost: f64,
}

/// Verdict on one action of an agent.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ActionVerdict {
    /// Step of the action, counted from 1.
    pub step: u32,
    /// Number of the agent.
    pub agent: u32,
    /// Cost in the world's unit of fuel.
    pub cost: f64,
    /// Effect of the action.
    pub verdict: Verdict,
    /// Score with the action minus the score without it. In docking only the agent's own return is compared, divided by the
    /// number of agents; changes of the others' returns by collisions are left out.
    pub gain: f64,
}

/// Effect of an action, compared with the same episode without it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Without the action more would have been lost.
    Needed,
    /// The action had no relevant effect.
    Harmless,
    /// The action cost relevant score or fuel and gained nothing.
    Wasteful,
    /// With the action more was lost.
    Harmful,
}

/// Judgement of an episode or a step by fixed rules.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Judgement {
    /// Value from −1 to 1.
    pub value: f64,
    /// Name of the rule that applied, such as `no_action_needed`.
    pub case: &'static str,
    /// Description in one sentence.
    pub explanation: String,
}

/// One failure mode of a task, as data.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct FailureModeSpec {
    /// Name of the mode.
    pub name: &'static str,
    /// Description in one sentence.
    pub description: &'static str,
}

/// Bands of relative speed in reports: the upper edges of all bands but the last.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct SpeedBands {
    /// Edges in ascending order.
    pub edges: &'static [f64],
    /// Unit of the edges.
    pub unit: &'static str,
}

/// The angle by whose sectors the failure profiles of a task are divided, as data.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct SectorQuantity {
    /// Name of the angle.
    pub name: &'static str,
    /// Description of the angle, with its origin and its positive direction.
    pub description: &'static str,
    /// Names of the directions at 0°, 90°, 180° and 270°.
    pub directions: [&'static str; 4],
}

impl SectorQuantity {
    /// Bearing of a body, seen from the agent in the plane of its orbit.
    pub(crate) const BEARING: Self = Self {
        name: "bearing",
        description: "bearing of the body seen from the agent, from radial out towards in-track",
        directions: ["radial out", "+ in-track", "radial in", "− in-track"],
    };
}

/// Number of sectors of a failure profile, 30° each; sector 0 is centred on 0°.
pub const PROFILE_SECTORS: u32 = 12;

/// The sector of an angle; sector 0 is −15° to 15°.
#[must_use]
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a whole number from 0 to 12")]
pub fn profile_sector(angle_deg: f64) -> u32 {
    let width = 360.0 / f64::from(PROFILE_SECTORS);
    let turned = (angle_deg + 0.5 * width) / width;
    let whole = libm::floor(turned);
    let wrapped = whole - libm::floor(whole / f64::from(PROFILE_SECTORS)) * f64::from(PROFILE_SECTORS);
    (wrapped as u32).min(PROFILE_SECTORS - 1)
}

/// Number of steps before a contact at which its bearing is taken: min(5, step), or fewer if the body becomes visible later.
pub const BEARING_STEPS: u32 = 5;

/// Bearing of the vector (first, second) from the first axis towards the second, degrees in [0, 360).
pub(crate) fn angle_deg(first: f64, second: f64) -> f64 {
    let angle = libm::atan2(second, first).to_degrees();
    // A tiny negative angle plus 360 rounds to 360, hence the remainder; adding 0 turns −0 into 0.
    if angle < 0.0 { (angle + 360.0) % 360.0 } else { angle + 0.0 }
}

impl SpeedBands {
    /// Index of a speed's band, counted from 0.
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
            assert_eq!(profile_sector(bearing), wanted, "{bearing}");
        }
        assert_eq!((profile_sector(-20.0), profile_sector(720.0), profile_sector(f64::NAN)), (11, 0, 0));
    }

    #[test]
    fn angles_increase_from_first_to_second_axis() {
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
