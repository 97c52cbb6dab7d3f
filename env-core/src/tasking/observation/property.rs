//! Properties of a satellite: those of BSK-RL's dynamics and flight software models, and of the paper's scanning environment.

use super::view::SatelliteView;
use crate::tasking::constants::RAD_S_PER_RPM;
use crate::tasking::error::TaskingError;
use crate::tasking::vector3::{Matrix3, Vector3, cross, dot, norm, rotate, rotate_back, scale, sub};

/// Declares the properties with their names in BSK-RL, their numbers of values, and their descriptions.
macro_rules! properties {
    ($($variant:ident, $name:literal, $count:literal, $description:literal;)*) => {
        /// A property of a satellite.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
        pub enum Property {
            $(#[doc = $description] $variant,)*
        }

        impl Property {
            /// All properties, in BSK-RL's order.
            pub const ALL: &'static [Self] = &[$(Self::$variant,)*];

            /// Name of the property in BSK-RL.
            #[must_use]
            pub const fn name(self) -> &'static str {
                match self { $(Self::$variant => $name,)* }
            }

            /// Number of values of the property.
            #[must_use]
            pub const fn len(self) -> usize {
                match self { $(Self::$variant => $count,)* }
            }

            /// Description of the property.
            #[must_use]
            pub const fn description(self) -> &'static str {
                match self { $(Self::$variant => $description,)* }
            }
        }
    };
}

properties! {
    SigmaBn, "sigma_BN", 3, "MRP of the body relative to the inertial frame.";
    Bn, "BN", 9, "Rotation matrix from the inertial frame to the body.";
    OmegaBnB, "omega_BN_B", 3, "Angular velocity of the body in body axes, rad/s.";
    Bp, "BP", 9, "Rotation matrix from the planet-fixed frame to the body.";
    Hn, "HN", 9, "Rotation matrix from the inertial frame to the Hill frame.";
    RBnN, "r_BN_N", 3, "Position in the inertial frame, m.";
    RBnP, "r_BN_P", 3, "Position in the planet-fixed frame, m.";
    VBnN, "v_BN_N", 3, "Velocity in the inertial frame, m/s.";
    VBnP, "v_BN_P", 3, "Velocity relative to the planet in the planet-fixed frame, m/s.";
    OmegaBpP, "omega_BP_P", 3, "Angular velocity relative to the planet in the planet-fixed frame, rad/s.";
    OmegaBhH, "omega_BH_H", 3, "Angular velocity relative to the Hill frame in that frame, rad/s.";
    SemiMajorAxis, "semi_major_axis", 1, "Semi-major axis at the first observation, m.";
    Eccentricity, "eccentricity", 1, "Eccentricity at the first observation.";
    Inclination, "inclination", 1, "Inclination at the first observation, rad.";
    AscendingNode, "ascending_node", 1, "Right ascension of the ascending node at the first observation, rad.";
    ArgumentOfPeriapsis, "argument_of_periapsis", 1, "Argument of periapsis at the first observation, rad.";
    TrueAnomaly, "true_anomaly", 1, "True anomaly at the first observation, rad.";
    BetaAngle, "beta_angle", 1, "Angle between the orbit normal and the Sun, rad.";
    BatteryCharge, "battery_charge", 1, "Battery charge, W·s.";
    BatteryChargeFraction, "battery_charge_fraction", 1, "Battery charge as a share of the capacity.";
    WheelSpeeds, "wheel_speeds", 3, "Speeds of the wheels, rad/s.";
    WheelSpeedsFraction, "wheel_speeds_fraction", 3, "Speeds of the wheels as shares of the failure limit.";
    StorageLevel, "storage_level", 1, "Stored data, bits.";
    StorageLevelFraction, "storage_level_fraction", 1, "Stored data as a share of the capacity.";
    CHatP, "c_hat_P", 3, "Direction of the instrument in the planet-fixed frame.";
    CHatH, "c_hat_H", 3, "Direction of the instrument in the Hill frame.";
    InstrumentPointingError, "instrument_pointing_error", 1, "Angle between the instrument and nadir, rad.";
    SolarPointingError, "solar_pointing_error", 1, "Angle between the panel's normal and the Sun, rad.";
}

impl Property {
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
        Self::ALL.iter().find(|property| property.name() == name).copied().ok_or_else(|| {
            let known: Vec<&str> = Self::ALL.iter().map(|property| property.name()).collect();
            TaskingError::UnknownArgument {
                name: name.to_owned(),
                models: "satellite's properties".to_owned(),
                known: known.join(", "),
            }
        })
    }

    /// Appends the values of the property.
    pub fn write(self, view: &SatelliteView<'_>, out: &mut Vec<f64>) {
        let state = view.state;
        match self {
            Self::SigmaBn => out.extend(state.attitude.sigma),
            Self::Bn => extend_matrix(out, &view.moment.body),
            Self::OmegaBnB => out.extend(state.attitude.omega),
            Self::Bp => extend_matrix(out, &view.moment.body.map(|row| rotate(&view.moment.planet, &row))),
            Self::Hn => extend_matrix(out, &view.hill()),
            Self::RBnN => out.extend(state.position),
            Self::RBnP => out.extend(view.moment.planet_position),
            Self::VBnN => out.extend(view.moment.velocity),
            Self::VBnP => out.extend(planet_velocity(view)),
            Self::OmegaBpP => out.extend(planet_body_rate(view)),
            Self::OmegaBhH => out.extend(hill_body_rate(view)),
            Self::BatteryCharge => out.push(state.battery),
            Self::BatteryChargeFraction => out.push(state.battery / view.spec.args.battery_capacity_ws),
            Self::WheelSpeeds => out.extend(state.attitude.wheels),
            Self::WheelSpeedsFraction => {
                let limit = view.spec.args.max_wheel_speed_rpm * RAD_S_PER_RPM;
                out.extend(state.attitude.wheels.map(|speed| speed / limit));
            }
            Self::StorageLevel => out.push(view.stored_bits),
            Self::StorageLevelFraction => {
                out.push(view.stored_bits / view.spec.args.storage_capacity_bits.floor());
            }
            Self::CHatP => out.extend(view.moment.instrument_fixed),
            Self::CHatH => out.extend(rotate(&view.hill(), &view.moment.instrument)),
            Self::InstrumentPointingError => {
                let down = scale(&state.position, -1.0 / norm(&state.position));
                out.push(libm::acos(dot(&down, &view.moment.instrument).clamp(-1.0, 1.0)));
            }
            Self::SolarPointingError => {
                let panel = rotate_back(&view.moment.body, &view.spec.args.panel_normal);
                out.push(libm::acos(
                    (dot(&panel, &view.moment.sun) / norm(&view.moment.sun)).clamp(-1.0, 1.0),
                ));
            }
            _ => out.push(self.orbital(view)),
        }
    }

    /// Value of a property of the orbit.
    fn orbital(self, view: &SatelliteView<'_>) -> f64 {
        if self == Self::BetaAngle {
            let momentum = cross(&view.state.position, &view.moment.velocity);
            return libm::acos(dot(&momentum, &view.moment.sun) / (norm(&momentum) * norm(&view.moment.sun)));
        }
        let elements = &view.moment.elements;
        match self {
            Self::SemiMajorAxis => elements.semi_major_axis_m,
            Self::Eccentricity => elements.eccentricity,
            Self::Inclination => elements.inclination_rad,
            Self::AscendingNode => elements.ascending_node_rad,
            Self::ArgumentOfPeriapsis => elements.periapsis_rad,
            _ => elements.true_anomaly_rad,
        }
    }
}

fn extend_matrix(out: &mut Vec<f64>, matrix: &Matrix3<f64>) {
    matrix.iter().for_each(|row| out.extend(row));
}

/// Velocity relative to the planet in the planet-fixed frame, m/s.
pub(super) fn planet_velocity(view: &SatelliteView<'_>) -> Vector3<f64> {
    let transport = cross(&view.planet_rate(), &view.state.position);
    rotate(&view.moment.planet, &sub(&view.moment.velocity, &transport))
}

/// Angular velocity relative to the planet in the planet-fixed frame, rad/s.
pub(super) fn planet_body_rate(view: &SatelliteView<'_>) -> Vector3<f64> {
    rotate(&view.moment.planet, &sub(&view.body_rate(), &view.planet_rate()))
}

/// Angular velocity relative to the Hill frame in that frame, rad/s.
fn hill_body_rate(view: &SatelliteView<'_>) -> Vector3<f64> {
    let hill = view.hill();
    let rate = dot(&view.moment.velocity, &hill[1]) / norm(&view.state.position);
    rotate(&hill, &sub(&view.body_rate(), &scale(&hill[2], rate)))
}
