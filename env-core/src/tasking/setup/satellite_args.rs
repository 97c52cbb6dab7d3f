//! Realised arguments of a satellite: `sat_args` of BSK-RL, without its random generators.

use super::arg_names::argument_names;
use super::arg_value::{ArgReader, ArgValue};
use super::models::{DynamicsModel, SoftwareModel};
use crate::tasking::constants::{
    ASTRONOMICAL_UNIT_M, EARTH_MU, EARTH_RADIUS_M, SOLAR_FLUX_W_M2, WHEEL_INERTIA_KG_M2,
};
use crate::tasking::error::TaskingError;
use crate::tasking::orbit::OrbitalElements;
use crate::tasking::vector3::{Vector3, norm};

/// Least distance from the Earth's centre at which an orbit can start, m.
const MIN_START_RADIUS_M: f64 = 1e6;

/// Attitude while the wheels are desaturated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DesatAttitude {
    /// The panel points at the Sun.
    Sun,
    /// The body is aligned with the Hill frame.
    Nadir,
    /// No guidance runs, so that the reference is the inertial frame.
    None,
}

/// Initial orbit of a satellite.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum InitialOrbit {
    /// Elements of an elliptic orbit.
    Elements(OrbitalElements),
    /// Position, m, and velocity, m/s, in the inertial frame.
    State([f64; 3], [f64; 3]),
}

/// Realised arguments of a satellite, with BSK-RL's defaults. `docs/worlds/tasking.md` describes each.
#[derive(Debug, Clone, PartialEq)]
#[expect(missing_docs, reason = "the fields are BSK-RL's arguments, which the page of the world describes")]
pub struct SatelliteArgs {
    pub mass_kg: f64,
    pub width_m: f64,
    pub depth_m: f64,
    pub height_m: f64,
    pub sigma_init: [f64; 3],
    pub omega_init_rad_s: [f64; 3],
    pub orbit: InitialOrbit,
    pub mu: f64,
    pub min_orbital_radius_m: f64,
    pub disturbance_n_m: [f64; 3],
    pub wheel_speeds_rpm: [f64; 3],
    pub max_wheel_speed_rpm: f64,
    pub u_max_n_m: f64,
    pub thruster_power_w: f64,
    pub panel_area_m2: f64,
    pub panel_efficiency: f64,
    pub panel_normal: [f64; 3],
    pub battery_capacity_ws: f64,
    pub stored_charge_ws: f64,
    pub base_power_w: f64,
    pub wheel_base_power_w: f64,
    pub wheel_mech_to_elec: f64,
    pub wheel_elec_to_mech: f64,
    pub desat_min_momentum: f64,
    pub desat_max_counter: u32,
    pub thruster_min_fire_s: f64,
    pub desat_attitude: DesatAttitude,
    pub feedback_k: f64,
    pub feedback_ki: f64,
    pub feedback_p: f64,
    pub steering_k1: f64,
    pub steering_k3: f64,
    pub omega_max_rad_s: f64,
    pub servo_ki: f64,
    pub servo_p: f64,
    pub instrument_axis: [f64; 3],
    pub attitude_tolerance: f64,
    pub rate_tolerance_rad_s: Option<f64>,
    pub instrument_bits: f64,
    pub instrument_power_w: f64,
    pub transmitter_baud: f64,
    pub transmitter_power_w: f64,
    pub transmitter_packet_bits: Option<f64>,
    pub storage_capacity_bits: f64,
    pub storage_init_bits: f64,
    pub storage_valid_check: bool,
    pub target_min_elevation_rad: f64,
    pub target_max_range_m: f64,
    pub link_max_range_m: f64,
}

impl InitialOrbit {
    /// Position, m, and velocity, m/s, in the inertial frame, under a gravitational parameter in m³/s².
    #[must_use]
    pub fn state(&self, mu: f64) -> (Vector3<f64>, Vector3<f64>) {
        match self {
            Self::Elements(elements) => elements.state(mu),
            Self::State(position, velocity) => (*position, *velocity),
        }
    }
}

impl SatelliteArgs {
    /// Defaults of BSK-RL 1.3.8 for an orbit. Arguments that BSK-RL draws at random have a fixed value: no tumbling, resting
    /// wheels, and a battery of 50 W·h.
    #[must_use]
    pub fn new(orbit: InitialOrbit) -> Self {
        Self {
            mass_kg: 330.0,
            width_m: 1.38,
            depth_m: 1.04,
            height_m: 1.58,
            sigma_init: [0.0; 3],
            omega_init_rad_s: [0.0; 3],
            orbit,
            mu: EARTH_MU,
            min_orbital_radius_m: EARTH_RADIUS_M + 200e3,
            disturbance_n_m: [0.0; 3],
            wheel_speeds_rpm: [0.0; 3],
            max_wheel_speed_rpm: f64::INFINITY,
            u_max_n_m: 0.2,
            thruster_power_w: 0.0,
            panel_area_m2: 1.0,
            panel_efficiency: 0.2,
            panel_normal: [0.0, 0.0, -1.0],
            battery_capacity_ws: 80.0 * 3600.0,
            stored_charge_ws: 50.0 * 3600.0,
            base_power_w: 0.0,
            wheel_base_power_w: 0.4,
            wheel_mech_to_elec: 0.0,
            wheel_elec_to_mech: 0.5,
            desat_min_momentum: 0.0,
            desat_max_counter: 4,
            thruster_min_fire_s: 0.02,
            desat_attitude: DesatAttitude::Sun,
            feedback_k: 7.0,
            feedback_ki: -1.0,
            feedback_p: 35.0,
            steering_k1: 0.25,
            steering_k3: 3.0,
            omega_max_rad_s: 3.0_f64.to_radians(),
            servo_ki: 5.0,
            servo_p: 150.0,
            instrument_axis: [0.0, 0.0, 1.0],
            attitude_tolerance: 0.01,
            rate_tolerance_rad_s: None,
            instrument_bits: 8e6,
            instrument_power_w: -30.0,
            transmitter_baud: -8e6,
            transmitter_power_w: -15.0,
            transmitter_packet_bits: None,
            storage_capacity_bits: 20.0 * 8e6,
            storage_init_bits: 0.0,
            storage_valid_check: false,
            target_min_elevation_rad: 45.0_f64.to_radians(),
            target_max_range_m: -1.0,
            link_max_range_m: -1.0,
        }
    }

    /// Reads realised arguments by their names in BSK-RL. Missing ones have their defaults.
    ///
    /// # Errors
    /// Returns [`TaskingError`] if a name is not an argument of the models, or a value is not valid.
    pub fn read<'a>(
        values: impl IntoIterator<Item = (&'a str, ArgValue)>,
        dynamics: DynamicsModel,
        software: SoftwareModel,
    ) -> Result<Self, TaskingError> {
        let mut reader = ArgReader::new(values, &argument_names(dynamics, software), "satellite's models")?;
        let mut args = Self::new(read_orbit(&mut reader)?);
        args.read_body(&mut reader)?;
        args.read_power(&mut reader)?;
        args.read_software(&mut reader)?;
        args.read_payload(&mut reader)?;
        args.check()?;
        Ok(args)
    }

    fn read_body(&mut self, reader: &mut ArgReader) -> Result<(), TaskingError> {
        reader.number("mass", &mut self.mass_kg)?;
        reader.number("width", &mut self.width_m)?;
        reader.number("depth", &mut self.depth_m)?;
        reader.number("height", &mut self.height_m)?;
        reader.vector("sigma_init", &mut self.sigma_init)?;
        reader.vector("omega_init", &mut self.omega_init_rad_s)?;
        reader.number("mu", &mut self.mu)?;
        reader.number("min_orbital_radius", &mut self.min_orbital_radius_m)?;
        reader.vector("disturbance_vector", &mut self.disturbance_n_m)?;
        reader.vector("wheelSpeeds", &mut self.wheel_speeds_rpm)?;
        reader.number("maxWheelSpeed", &mut self.max_wheel_speed_rpm)?;
        reader.number("u_max", &mut self.u_max_n_m)?;
        // There is no drag: at 500 km the density of BSK-RL's atmosphere is 2e-27 kg/m³.
        reader.ignore(&["dragCoeff", "utc_init"]);
        Ok(())
    }

    fn read_power(&mut self, reader: &mut ArgReader) -> Result<(), TaskingError> {
        reader.number("thrusterPowerDraw", &mut self.thruster_power_w)?;
        reader.number("panelArea", &mut self.panel_area_m2)?;
        reader.number("panelEfficiency", &mut self.panel_efficiency)?;
        reader.vector("nHat_B", &mut self.panel_normal)?;
        reader.number("batteryStorageCapacity", &mut self.battery_capacity_ws)?;
        reader.number("storedCharge_Init", &mut self.stored_charge_ws)?;
        reader.number("basePowerDraw", &mut self.base_power_w)?;
        reader.number("rwBasePower", &mut self.wheel_base_power_w)?;
        reader.number("rwMechToElecEfficiency", &mut self.wheel_mech_to_elec)?;
        reader.number("rwElecToMechEfficiency", &mut self.wheel_elec_to_mech)
    }

    fn read_software(&mut self, reader: &mut ArgReader) -> Result<(), TaskingError> {
        reader.number("hs_min", &mut self.desat_min_momentum)?;
        let mut counter = f64::from(self.desat_max_counter);
        reader.number("maxCounterValue", &mut counter)?;
        // With 0, a command of BSK-RL replaces the one before it is executed; no pulse would be the one that was asked for.
        if !(1.0..=1e6).contains(&counter) || counter.fract() != 0.0 {
            let requirement = "must be an integer from 1 to 1000000";
            return Err(TaskingError::invalid("maxCounterValue", requirement, counter));
        }
        self.desat_max_counter = counter as u32;
        reader.number("thrMinFireTime", &mut self.thruster_min_fire_s)?;
        self.desat_attitude = match reader.text("desatAttitude")?.as_deref() {
            None if !reader.has("desatAttitude") => DesatAttitude::Sun,
            None => DesatAttitude::None,
            Some("sun") => DesatAttitude::Sun,
            Some("nadir") => DesatAttitude::Nadir,
            Some(other) => {
                return Err(TaskingError::invalid("desatAttitude", "must be sun, nadir or None", other));
            }
        };
        let mut axes = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
        reader.numbers("controlAxes_B", &mut axes)?;
        if axes != [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0] {
            return Err(TaskingError::NotSupported("`controlAxes_B` other than the body's axes".to_owned()));
        }
        let mut sign = 1.0;
        reader.number("thrForceSign", &mut sign)?;
        if sign != 1.0 {
            return Err(TaskingError::NotSupported("`thrForceSign` other than 1".to_owned()));
        }
        reader.number("K", &mut self.feedback_k)?;
        reader.number("Ki", &mut self.feedback_ki)?;
        reader.number("P", &mut self.feedback_p)?;
        reader.number("K1", &mut self.steering_k1)?;
        reader.number("K3", &mut self.steering_k3)?;
        reader.number("omega_max", &mut self.omega_max_rad_s)?;
        reader.number("servo_Ki", &mut self.servo_ki)?;
        reader.number("servo_P", &mut self.servo_p)?;
        reader.vector("inst_pHat_B", &mut self.instrument_axis)?;
        reader.number("imageAttErrorRequirement", &mut self.attitude_tolerance)?;
        reader.optional_number("imageRateErrorRequirement", &mut self.rate_tolerance_rad_s)
    }

    fn read_payload(&mut self, reader: &mut ArgReader) -> Result<(), TaskingError> {
        reader.number("instrumentBaudRate", &mut self.instrument_bits)?;
        reader.number("instrumentPowerDraw", &mut self.instrument_power_w)?;
        reader.number("transmitterBaudRate", &mut self.transmitter_baud)?;
        reader.number("transmitterPowerDraw", &mut self.transmitter_power_w)?;
        reader.optional_number("transmitterPacketSize", &mut self.transmitter_packet_bits)?;
        reader.number("dataStorageCapacity", &mut self.storage_capacity_bits)?;
        reader.number("storageInit", &mut self.storage_init_bits)?;
        reader.flag("storageUnitValidCheck", &mut self.storage_valid_check)?;
        reader.number("imageTargetMinimumElevation", &mut self.target_min_elevation_rad)?;
        reader.number("imageTargetMaximumRange", &mut self.target_max_range_m)?;
        reader.number("losMaximumRange", &mut self.link_max_range_m)?;
        // Targets are given by their position; buffers beside the images' stay empty.
        reader.ignore(&["groundLocationPlanetRadius", "transmitterNumBuffers", "bufferNames"]);
        Ok(())
    }

    /// Checks values that would make the simulation fail.
    pub(super) fn check(&self) -> Result<(), TaskingError> {
        let positive = [
            ("mass", self.mass_kg),
            ("width", self.width_m),
            ("depth", self.depth_m),
            ("height", self.height_m),
            ("mu", self.mu),
            ("batteryStorageCapacity", self.battery_capacity_ws),
            ("rwElecToMechEfficiency", self.wheel_elec_to_mech),
            ("omega_max", self.omega_max_rad_s),
            ("dataStorageCapacity", self.storage_capacity_bits),
        ];
        for (name, value) in positive {
            if !(value > 0.0 && value.is_finite()) {
                return Err(TaskingError::invalid(name, "must be greater than 0", value));
            }
        }
        if self.stored_charge_ws < 0.0 {
            let value = self.stored_charge_ws;
            return Err(TaskingError::invalid("storedCharge_Init", "must not be negative", value));
        }
        for (name, axis) in [("nHat_B", self.panel_normal), ("inst_pHat_B", self.instrument_axis)] {
            if norm(&axis) < 0.1 {
                return Err(TaskingError::invalid(name, "must be a unit vector", format!("{axis:?}")));
            }
        }
        let (position, velocity) = self.orbit.state(self.mu);
        if !(norm(&position) >= MIN_START_RADIUS_M
            && norm(&position).is_finite()
            && norm(&velocity).is_finite())
        {
            let requirement = "must start at least 1000 km from the Earth's centre, at a finite speed";
            return Err(TaskingError::invalid("oe", requirement, format!("{:?}", self.orbit)));
        }
        let inertia = self.inertia();
        if inertia.iter().any(|axis| *axis <= 2.0 * WHEEL_INERTIA_KG_M2) {
            return Err(TaskingError::invalid(
                "mass",
                "must give the body more inertia than its wheels",
                self.mass_kg,
            ));
        }
        Ok(())
    }

    /// Power of a panel that faces the Sun at a distance, m, in W.
    #[must_use]
    pub fn facing_panel_w(&self, sun_distance_m: f64) -> f64 {
        let relative = sun_distance_m / ASTRONOMICAL_UNIT_M;
        let flux = SOLAR_FLUX_W_M2 / (relative * relative);
        flux * self.panel_area_m2 * self.panel_efficiency
    }

    /// Power of the devices that are always on, W.
    #[must_use]
    pub fn base_load_w(&self) -> f64 {
        3.0 * self.wheel_base_power_w - self.base_power_w
    }

    /// Moments of inertia of a uniform box about the body's axes, kg·m².
    #[must_use]
    pub fn inertia(&self) -> [f64; 3] {
        let twelfth = 1.0 / 12.0 * self.mass_kg;
        let (w, d, h) =
            (self.width_m * self.width_m, self.depth_m * self.depth_m, self.height_m * self.height_m);
        [twelfth * (w + d), twelfth * (d + h), twelfth * (w + h)]
    }
}

/// Reads the initial orbit: either `oe`, or `rN` and `vN`.
fn read_orbit(reader: &mut ArgReader) -> Result<InitialOrbit, TaskingError> {
    let elements = reader.elements("oe")?;
    let (mut position, mut velocity) = ([f64::NAN; 3], [f64::NAN; 3]);
    reader.vector("rN", &mut position)?;
    reader.vector("vN", &mut velocity)?;
    let has_state = !position[0].is_nan() && !velocity[0].is_nan();
    match (elements, has_state) {
        (Some(elements), false) if position[0].is_nan() && velocity[0].is_nan() => {
            Ok(InitialOrbit::Elements(elements))
        }
        (None, true) => Ok(InitialOrbit::State(position, velocity)),
        _ => Err(TaskingError::Composition(
            "the orbit must be given either by `oe`, or by `rN` and `vN`".to_owned(),
        )),
    }
}
