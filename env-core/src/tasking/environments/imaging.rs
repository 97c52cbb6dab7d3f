//! `tasking/imaging`: an agile satellite images targets, within its power, and knows its next ten opportunities.

use super::draws::{
    RANDOM_ALTITUDE_M, RANDOM_INCLINATION_DEG, circular_orbit, city_targets, epoch, tumble, uniform_targets,
    wheel_speeds,
};
use super::{MAX_STEP_S, ORBIT_S, WS_PER_WH};
use crate::episode_rng::{EpisodeRng, RngStream};
use crate::tasking::access::OpportunityKind;
use crate::tasking::clock::TickLength;
use crate::tasking::observation::opportunity::OpportunityProperty;
use crate::tasking::observation::property::Property;
use crate::tasking::observation::spec::{Normalised, ObservationItem, ObservationSpec};
use crate::tasking::orbit::{GravityModel, OrbitalElements};
use crate::tasking::satellite::SatelliteSpec;
use crate::tasking::setup::actions::{ActionSpec, SoftwareAction};
use crate::tasking::setup::environment::{
    AgentSetup, ClockSetup, Communicator, EnvironmentMode, GenerationTimes, GroundStation, Rewarder,
    SatelliteClass,
};
use crate::tasking::setup::{
    DesatAttitude, DynamicsModel, InitialOrbit, SatelliteArgs, Setup, SoftwareModel,
};

/// Number of opportunities that a satellite observes and can image.
const TARGETS_AHEAD: usize = 10;
/// Largest initial speed of a wheel, rpm.
const WHEEL_RPM: f64 = 1500.0;

/// Params of the imaging environment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImagingParams {
    /// Number of targets on the Earth.
    pub targets: u32,
    /// True if targets are cities, at most 10 000; false if they are uniform on the Earth.
    pub are_cities: bool,
    /// Power of a uniform number that is a target's priority: the larger, the fewer valuable targets.
    pub priority_power: f64,
    /// Largest commanded rate, rad/s.
    pub omega_max_rad_s: f64,
    /// Largest torque of a wheel, N·m.
    pub u_max_n_m: f64,
    /// Largest attitude error of an image, as the norm of an MRP.
    pub attitude_error: f64,
    /// Capacity of the battery, W·h.
    pub battery_wh: f64,
    /// Least initial charge, as a share of the battery.
    pub charge_min: f64,
    /// Largest initial charge, as a share of the battery.
    pub charge_max: f64,
    /// Area of the solar panel, m².
    pub panel_m2: f64,
    /// Capacity of the storage, in images.
    pub storage_images: u32,
    /// Time limit of the episode, s.
    pub time_limit_s: f64,
}

impl Default for ImagingParams {
    fn default() -> Self {
        Self {
            targets: 1250,
            are_cities: false,
            priority_power: 1.0,
            omega_max_rad_s: 0.087,
            u_max_n_m: 0.4,
            attitude_error: 0.01,
            battery_wh: 200.0,
            charge_min: 0.3,
            charge_max: 1.0,
            panel_m2: 0.25,
            storage_images: 500,
            time_limit_s: 3.0 * ORBIT_S,
        }
    }
}

impl ImagingParams {
    /// Draws a scenario of the environment.
    pub fn setup(&self, rng: &mut impl EpisodeRng) -> Setup {
        let orbit = circular_orbit(rng, RANDOM_ALTITUDE_M, RANDOM_INCLINATION_DEG);
        let agent = self.agent("Imager".to_owned(), orbit, rng);
        self.setup_of(vec![agent], Communicator::default(), rng)
    }

    /// Draws everything but the satellites.
    pub(super) fn setup_of(
        &self,
        agents: Vec<AgentSetup>,
        communicator: Communicator,
        rng: &mut impl EpisodeRng,
    ) -> Setup {
        Setup {
            agents,
            epoch: epoch(rng),
            gravity: GravityModel::Ggm10,
            full_thrust: false,
            stations: GroundStation::defaults(),
            targets: if self.are_cities {
                city_targets(rng, self.targets, self.priority_power)
            } else {
                uniform_targets(rng, self.targets, self.priority_power)
            },
            rewarders: vec![Rewarder::UniqueImages],
            communicator,
            clock: ClockSetup {
                tick: TickLength::ONE_SECOND,
                max_step_s: MAX_STEP_S,
                time_limit_s: self.time_limit_s,
                terminate_on_time_limit: false,
            },
            failure_penalty: -1.0,
            mode: EnvironmentMode::Constellation,
        }
    }

    /// Draws a satellite on an orbit.
    pub(super) fn agent(
        &self,
        name: String,
        orbit: OrbitalElements,
        rng: &mut impl EpisodeRng,
    ) -> AgentSetup {
        let dynamics =
            DynamicsModel { instrument: true, continuous: false, ground_stations: true, line_of_sight: true };
        AgentSetup {
            satellite: SatelliteSpec {
                name,
                dynamics,
                software: SoftwareModel { imaging: true, continuous: false, steering: true },
                args: self.satellite_args(orbit, rng),
            },
            class: SatelliteClass::Imaging(GenerationTimes::default()),
            variable_interval: true,
            actions: vec![
                ActionSpec::image(TARGETS_AHEAD),
                ActionSpec::software(SoftwareAction::Charge, 120.0),
                ActionSpec::software(SoftwareAction::Downlink, 60.0),
                ActionSpec::software(SoftwareAction::Desaturate, 60.0),
            ],
            observation: observation(),
        }
    }

    fn satellite_args(&self, orbit: OrbitalElements, rng: &mut impl EpisodeRng) -> SatelliteArgs {
        let battery_ws = self.battery_wh * WS_PER_WH;
        let (sigma_init, omega_init_rad_s) = tumble(rng);
        let wheel_speeds_rpm = wheel_speeds(rng, WHEEL_RPM);
        let charge = rng.uniform_in(RngStream::Resources, self.charge_min, self.charge_max);
        let defaults = SatelliteArgs::new(InitialOrbit::Elements(orbit));
        SatelliteArgs {
            sigma_init,
            omega_init_rad_s,
            wheel_speeds_rpm,
            max_wheel_speed_rpm: 6000.0,
            battery_capacity_ws: battery_ws,
            stored_charge_ws: charge * battery_ws,
            storage_capacity_bits: f64::from(self.storage_images) * defaults.instrument_bits,
            transmitter_baud: -50.0 * defaults.instrument_bits,
            base_power_w: -10.0,
            instrument_power_w: -30.0,
            transmitter_power_w: -25.0,
            thruster_power_w: -80.0,
            panel_area_m2: self.panel_m2,
            u_max_n_m: self.u_max_n_m,
            omega_max_rad_s: self.omega_max_rad_s,
            servo_p: 30.0,
            attitude_tolerance: self.attitude_error,
            rate_tolerance_rad_s: Some(0.01),
            desat_attitude: DesatAttitude::Nadir,
            ..defaults
        }
    }
}

fn observation() -> ObservationSpec {
    let property = |property: Property| Normalised::new(property, property.name(), 1.0);
    let opportunity = |property: OpportunityProperty, norm| Normalised::new(property, property.name(), norm);
    let window =
        [opportunity(OpportunityProperty::Open, ORBIT_S), opportunity(OpportunityProperty::Close, ORBIT_S)];
    let mut target = vec![opportunity(OpportunityProperty::Priority, 1.0)];
    target.extend(window.clone());
    target.push(opportunity(OpportunityProperty::Angle, std::f64::consts::PI));
    let items = [
        (
            "target",
            ObservationItem::Opportunities {
                kind: OpportunityKind::Target,
                count: TARGETS_AHEAD,
                properties: target,
            },
        ),
        (
            "sat_props",
            ObservationItem::Properties(
                [
                    Property::StorageLevelFraction,
                    Property::BatteryChargeFraction,
                    Property::WheelSpeedsFraction,
                ]
                .map(property)
                .to_vec(),
            ),
        ),
        ("eclipse", ObservationItem::Eclipse { norm_s: ORBIT_S }),
        (
            "ground_station",
            ObservationItem::Opportunities {
                kind: OpportunityKind::GroundStation,
                count: 1,
                properties: window.to_vec(),
            },
        ),
        ("time", ObservationItem::Time { norm_s: None, is_remaining: false }),
    ];
    ObservationSpec::new(items.map(|(name, item)| (name.to_owned(), item)).into())
}
