//! Properties of an upcoming opportunity.

use super::property::{planet_body_rate, planet_velocity};
use super::view::{Moment, SatelliteView};
use crate::tasking::access::Opportunity;
use crate::tasking::error::TaskingError;
use crate::tasking::vector3::{Vector3, cross, dot, norm, rotate, rotate_back, scale, sub};

/// A property of an opportunity (`OpportunityProperties` of BSK-RL).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OpportunityProperty {
    /// Priority of the target.
    Priority,
    /// Planet-fixed position of the object, m.
    Position,
    /// Position of the object relative to the satellite in the Hill frame, m.
    HillPosition,
    /// Time until the window opens, s.
    Open,
    /// Time until the middle of the window, s.
    Middle,
    /// Time until the window closes, s.
    Close,
    /// Angle between the instrument and the object, rad.
    Angle,
    /// Rate of that angle's frame relative to the body, rad/s.
    AngleRate,
}

/// An opportunity with its object.
#[derive(Debug, Clone, Copy)]
pub struct OpportunityView {
    /// The window of access.
    pub opportunity: Opportunity,
    /// Planet-fixed position of the object, m.
    pub position: Vector3<f64>,
    /// Priority of the object, if it is a target.
    pub priority: Option<f64>,
}

impl OpportunityProperty {
    /// All properties, in BSK-RL's order.
    pub const ALL: [Self; 8] = [
        Self::Priority,
        Self::Position,
        Self::HillPosition,
        Self::Open,
        Self::Middle,
        Self::Close,
        Self::Angle,
        Self::AngleRate,
    ];

    /// Name of the property in BSK-RL.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Priority => "priority",
            Self::Position => "r_LP_P",
            Self::HillPosition => "r_LB_H",
            Self::Open => "opportunity_open",
            Self::Middle => "opportunity_mid",
            Self::Close => "opportunity_close",
            Self::Angle => "target_angle",
            Self::AngleRate => "target_angle_rate",
        }
    }

    /// Number of values of the property.
    #[must_use]
    pub const fn len(self) -> usize {
        match self {
            Self::Position | Self::HillPosition => 3,
            _ => 1,
        }
    }

    /// True if the property has no values, which none has.
    #[must_use]
    pub const fn is_empty(self) -> bool {
        self.len() == 0
    }

    /// The property of a name in BSK-RL.
    ///
    /// # Errors
    /// Returns [`TaskingError::UnknownArgument`] if there is none.
    pub fn from_name(name: &str) -> Result<Self, TaskingError> {
        Self::ALL.into_iter().find(|property| property.name() == name).ok_or_else(|| {
            TaskingError::UnknownArgument {
                name: name.to_owned(),
                models: "properties of opportunities".to_owned(),
                known: Self::ALL.map(Self::name).join(", "),
            }
        })
    }

    /// Appends the values of the property, divided by `norm`.
    pub fn write(self, view: &SatelliteView<'_>, object: &OpportunityView, divisor: f64, out: &mut Vec<f64>) {
        let Opportunity { open_s, close_s, .. } = object.opportunity;
        let value = match self {
            Self::Priority => object.priority.unwrap_or(0.0),
            Self::Position => {
                out.extend(object.position.map(|x| x / divisor));
                return;
            }
            Self::HillPosition => {
                let inertial = rotate_back(&view.moment.planet, &object.position);
                let relative = rotate(&view.hill(), &sub(&inertial, &view.state.position));
                out.extend(relative.map(|x| x / divisor));
                return;
            }
            Self::Open => open_s - view.moment.time_s,
            Self::Middle => (open_s + close_s) / 2.0 - view.moment.time_s,
            Self::Close => close_s - view.moment.time_s,
            Self::Angle => angle_to(view.moment, &object.position),
            Self::AngleRate => angle_rate(view, &object.position),
        };
        out.push(value / divisor);
    }
}

impl OpportunityProperty {
    /// Appends the values where there is no opportunity: its window is the end of the episode, `left_s` seconds from now.
    pub fn write_missing(self, left_s: f64, divisor: f64, out: &mut Vec<f64>) {
        match self {
            Self::Open | Self::Middle | Self::Close => out.push(left_s / divisor),
            _ => out.resize(out.len() + self.len(), 0.0),
        }
    }
}

/// Angle between the instrument and a planet-fixed position, rad.
pub(in crate::tasking) fn angle_to(moment: &Moment, position: &Vector3<f64>) -> f64 {
    let to_object = sub(position, &moment.planet_position);
    libm::acos((dot(&to_object, &moment.instrument_fixed) / norm(&to_object)).clamp(-1.0, 1.0))
}

/// Rate of the frame that points at a planet-fixed position, relative to the body, rad/s.
fn angle_rate(view: &SatelliteView<'_>, position: &Vector3<f64>) -> f64 {
    let to_object = sub(position, &view.moment.planet_position);
    let turn = cross(&planet_velocity(view), &to_object);
    norm(&sub(&planet_body_rate(view), &scale(&turn, 1.0 / dot(&to_object, &to_object))))
}
