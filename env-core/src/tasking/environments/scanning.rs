//! `tasking/scanning`: a satellite scans the ground below, within its power, storage and wheel speeds.
//!
//! Stephenson and Schaub (2024), "BSK-RL: Modular, High-Fidelity Reinforcement Learning Environments for Spacecraft Tasking".

use super::draws::{
    RANDOM_ALTITUDE_M, RANDOM_INCLINATION_DEG, circular_orbit, epoch, normal_vector, tumble, wheel_speeds,
};
use super::{MAX_STEP_S, ORBIT_S, WS_PER_WH};
use crate::episode_rng::{EpisodeRng, RngStream};
use crate::tasking::access::OpportunityKind;
use crate::tasking::clock::TickLength;
use crate::tasking::observation::opportunity::OpportunityProperty;
use crate::tasking::observation::property::Property;
use crate::tasking::observation::spec::{Normalised, ObservationItem, ObservationSpec};
use crate::tasking::orbit::GravityModel;
use crate::tasking::satellite::SatelliteSpec;
use crate::tasking::setup::actions::{ActionSpec, SoftwareAction};
use crate::tasking::setup::environment::{
    AgentSetup, ClockSetup, Communicator, EnvironmentMode, GenerationTimes, GroundStation, Rewarder,
    SatelliteClass,
};
use crate::tasking::setup::{
    DesatAttitude, DynamicsModel, InitialOrbit, SatelliteArgs, Setup, SoftwareModel,
};
use crate::tasking::vector3::scale;

/// Bits of a megabyte.
const BITS_PER_MB: f64 = 8e6;

/// Params of scanning; the defaults are those of the paper's environment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScanningParams {
    /// Capacity of the battery, W·h.
    pub battery_wh: f64,
    /// Least initial charge, as a share of the battery.
    pub charge_min: f64,
    /// Largest initial charge, as a share of the battery.
    pub charge_max: f64,
    /// Area of the solar panel, m².
    pub panel_m2: f64,
    /// Capacity of the storage, Gbit.
    pub storage_gbit: f64,
    /// Largest initial data, as a share of the storage.
    pub storage_fill: f64,
    /// Largest initial speed of a wheel, rpm.
    pub wheel_rpm: f64,
    /// Standard deviation of the disturbing torque about each axis, mN·m.
    pub disturbance_mnm: f64,
    /// Number of ground stations, 1 to 7.
    pub stations: u32,
    /// Time limit of the episode, s.
    pub time_limit_s: f64,
}

impl Default for ScanningParams {
    fn default() -> Self {
        Self {
            battery_wh: 200.0,
            charge_min: 0.3,
            charge_max: 1.0,
            panel_m2: 0.25,
            storage_gbit: 40.0,
            storage_fill: 0.8,
            wheel_rpm: 3000.0,
            disturbance_mnm: 0.1,
            stations: 7,
            time_limit_s: 5.0 * ORBIT_S,
        }
    }
}

impl ScanningParams {
    /// Draws a scenario of the environment.
    pub fn setup(&self, rng: &mut impl EpisodeRng) -> Setup {
        let args = self.satellite_args(rng);
        let agent = AgentSetup {
            satellite: SatelliteSpec {
                name: "Scanner".to_owned(),
                dynamics: DynamicsModel {
                    instrument: true,
                    continuous: true,
                    ground_stations: true,
                    line_of_sight: false,
                },
                software: SoftwareModel { imaging: true, continuous: true, steering: false },
                args,
            },
            class: SatelliteClass::Access(GenerationTimes::default()),
            variable_interval: true,
            actions: vec![
                ActionSpec::software(SoftwareAction::Scan, 180.0),
                ActionSpec::software(SoftwareAction::Charge, 120.0),
                ActionSpec::software(SoftwareAction::Downlink, 60.0),
                ActionSpec::software(SoftwareAction::Desaturate, 60.0),
            ],
            observation: observation(),
        };
        let mut stations = GroundStation::defaults();
        stations.truncate(self.stations.max(1) as usize);
        Setup {
            agents: vec![agent],
            epoch: epoch(rng),
            gravity: GravityModel::Ggm10,
            full_thrust: false,
            stations,
            targets: Vec::new(),
            rewarders: vec![Rewarder::ScanningTime { value_per_second: 1.0 / self.time_limit_s }],
            communicator: Communicator::default(),
            clock: ClockSetup {
                tick: TickLength::ONE_SECOND,
                max_step_s: MAX_STEP_S,
                time_limit_s: self.time_limit_s,
                terminate_on_time_limit: false,
            },
            failure_penalty: -1.0,
            mode: EnvironmentMode::General,
        }
    }

    fn satellite_args(&self, rng: &mut impl EpisodeRng) -> SatelliteArgs {
        let battery_ws = self.battery_wh * WS_PER_WH;
        let storage_bits = self.storage_gbit * 1e9;
        let (sigma_init, omega_init_rad_s) = tumble(rng);
        let wheel_speeds_rpm = wheel_speeds(rng, self.wheel_rpm);
        let disturbance = normal_vector(rng, RngStream::Attitude);
        let charge = rng.uniform_in(RngStream::Resources, self.charge_min, self.charge_max);
        let fill = rng.uniform_in(RngStream::Resources, 0.0, self.storage_fill);
        let orbit = circular_orbit(rng, RANDOM_ALTITUDE_M, RANDOM_INCLINATION_DEG);
        SatelliteArgs {
            sigma_init,
            omega_init_rad_s,
            wheel_speeds_rpm,
            max_wheel_speed_rpm: 6000.0,
            disturbance_n_m: scale(&disturbance, self.disturbance_mnm * 1e-3),
            battery_capacity_ws: battery_ws,
            stored_charge_ws: charge * battery_ws,
            storage_capacity_bits: storage_bits,
            storage_init_bits: (fill * storage_bits).floor(),
            instrument_bits: 0.5 * BITS_PER_MB,
            transmitter_baud: -50.0 * BITS_PER_MB,
            base_power_w: -10.0,
            instrument_power_w: -30.0,
            transmitter_power_w: -25.0,
            thruster_power_w: -80.0,
            panel_area_m2: self.panel_m2,
            attitude_tolerance: 0.1,
            rate_tolerance_rad_s: Some(0.1),
            desat_attitude: DesatAttitude::Nadir,
            ..SatelliteArgs::new(InitialOrbit::Elements(orbit))
        }
    }
}

/// The paper's twelve observations.
fn observation() -> ObservationSpec {
    let pi = std::f64::consts::PI;
    let property = |property: Property, norm| Normalised::new(property, property.name(), norm);
    let window = |property: OpportunityProperty| Normalised::new(property, property.name(), ORBIT_S);
    let items = vec![
        ObservationItem::Properties(vec![
            property(Property::StorageLevelFraction, 1.0),
            property(Property::BatteryChargeFraction, 1.0),
            property(Property::WheelSpeedsFraction, 1.0),
            property(Property::InstrumentPointingError, pi),
            property(Property::SolarPointingError, pi),
        ]),
        ObservationItem::Opportunities {
            kind: OpportunityKind::GroundStation,
            count: 1,
            properties: vec![window(OpportunityProperty::Open), window(OpportunityProperty::Close)],
        },
        ObservationItem::Eclipse { norm_s: ORBIT_S },
        ObservationItem::Time { norm_s: None, is_remaining: false },
    ];
    let names = ["sat_props", "ground_station", "eclipse", "time"];
    ObservationSpec::new(names.map(str::to_owned).into_iter().zip(items).collect())
}
