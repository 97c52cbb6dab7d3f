//! Models of satellites fit together as in BSK-RL, and unknown names are errors that name them.

use super::samples::recorded_setups;
use crate::tasking::error::TaskingError;
use crate::tasking::observation::opportunity::OpportunityProperty;
use crate::tasking::observation::property::Property;
use crate::tasking::observation::spec::ObservationSpec;
use crate::tasking::orbit::OrbitalElements;
use crate::tasking::recording::setup::read_setup;
use crate::tasking::setup::actions::{ActionSpec, SoftwareAction};
use crate::tasking::setup::environment::{Communicator, Rewarder, Setup};
use crate::tasking::setup::{ArgValue, DynamicsModel, SatelliteArgs, SoftwareModel};
use crate::tasking::simulation::{AgentAction, TaskingSim};
use crate::tasking::tick::dispatch::InstructionSet;

/// A satellite of these models that only charges.
fn charging(dynamics: &str, software: &str) -> Setup {
    let mut setup = recorded_setups().into_iter().find(|setup| setup.agents.len() == 1).unwrap();
    let agent = &mut setup.agents[0];
    agent.satellite.dynamics = DynamicsModel::compose(dynamics.split('+')).unwrap();
    agent.satellite.software = SoftwareModel::compose([software]).unwrap();
    agent.actions = vec![ActionSpec::software(SoftwareAction::Charge, 120.0)];
    agent.observation = ObservationSpec::default();
    setup.rewarders = vec![Rewarder::None];
    setup.communicator = Communicator::default();
    setup
}

#[test]
fn flight_software_names_the_dynamics_that_it_needs() {
    let dynamics = [
        "BasicDynamicsModel",
        "ImagingDynModel",
        "FullFeaturedDynModel",
        "ContinuousImagingDynModel",
        "ContinuousImagingDynModel+GroundStationDynModel",
    ];
    // Flight software, and how many of the dynamics above it cannot use.
    let software = [
        ("BasicFSWModel", 0),
        ("SteeringFSWModel", 0),
        ("ImagingFSWModel", 1),
        ("SteeringImagerFSWModel", 1),
        ("ContinuousImagingFSWModel", 3),
    ];
    for (software, unfit) in software {
        for (index, dynamics) in dynamics.iter().enumerate() {
            let sim = TaskingSim::new(charging(dynamics, software));
            assert_eq!(sim.is_ok(), index >= unfit, "{software} on {dynamics}");
            let Err(error) = sim.map(|mut sim| {
                let result = sim.step(&[Some(AgentAction::Index(0))], InstructionSet::detect()).unwrap();
                assert!((119.9..=121.0).contains(&result.elapsed_s), "{software} on {dynamics}");
            }) else {
                continue;
            };
            let error = error.to_string();
            assert!(error.contains(" needs a") && error.ends_with("ImagingDynModel"), "{error}");
        }
    }
}

#[test]
fn an_instrument_without_commands_records_in_every_tick() {
    for dynamics in ["ContinuousImagingDynModel", "ImagingDynModel"] {
        let mut setup = charging(dynamics, "BasicFSWModel");
        let args = &mut setup.agents[0].satellite.args;
        (args.storage_init_bits, args.storage_capacity_bits, args.instrument_bits) = (0.0, 1e12, 7.0);
        setup.clock.tick = crate::tasking::clock::TickLength::ONE_SECOND;
        let mut sim = TaskingSim::new(setup).unwrap();
        let result = sim.step(&[Some(AgentAction::Index(0))], InstructionSet::detect()).unwrap();
        assert_eq!(sim.satellite(0).stored(), [7.0 * result.elapsed_s.round(), 0.0], "{dynamics}");
        assert_eq!(result.scanned_s, [result.elapsed_s.round()]);
    }
}

#[test]
fn images_need_a_target_model() {
    let mut setup = charging("ContinuousImagingDynModel", "ImagingFSWModel");
    setup.agents[0].actions.push(ActionSpec::image(3));
    let error = setup.check().unwrap_err().to_string();
    assert!(error.contains("an ImagingDynModel that is not continuous"), "{error}");
}

/// Reads arguments of a satellite with its orbit.
fn read(name: &str, value: ArgValue, dynamics: &str, software: &str) -> Result<SatelliteArgs, TaskingError> {
    let orbit = ArgValue::Elements(OrbitalElements {
        semi_major_axis_m: 7e6,
        eccentricity: 0.0,
        inclination_rad: 0.8,
        ascending_node_rad: 0.0,
        periapsis_rad: 0.0,
        true_anomaly_rad: 0.0,
    });
    SatelliteArgs::read(
        [("oe", orbit), (name, value)],
        DynamicsModel::compose([dynamics]).unwrap(),
        SoftwareModel::compose([software]).unwrap(),
    )
}

#[test]
fn unknown_arguments_are_errors_that_name_them() {
    for (name, dynamics, software) in [
        ("batteryCapacity", "FullFeaturedDynModel", "SteeringImagerFSWModel"),
        ("K1", "FullFeaturedDynModel", "ImagingFSWModel"),
        ("Ki", "FullFeaturedDynModel", "SteeringFSWModel"),
        ("instrumentBaudRate", "BasicDynamicsModel", "BasicFSWModel"),
        ("bufferNames", "ContinuousImagingDynModel", "ImagingFSWModel"),
        ("losMaximumRange", "ImagingDynModel", "ImagingFSWModel"),
        ("imageAttErrorRequirement", "ImagingDynModel", "BasicFSWModel"),
    ] {
        match read(name, ArgValue::Number(1.0), dynamics, software).unwrap_err() {
            TaskingError::UnknownArgument { name: named, models, known } => {
                assert_eq!(named, name);
                assert!(
                    models.contains("satellite") && known.contains("batteryStorageCapacity"),
                    "{models} {known}"
                );
            }
            other => panic!("{name}: {other}"),
        }
    }
    let error = read("batteryCapacity", ArgValue::Number(1.0), "BasicDynamicsModel", "BasicFSWModel");
    assert!(error.unwrap_err().to_string().starts_with("`batteryCapacity` is not an argument of the"));
}

#[test]
fn invalid_arguments_are_errors_that_name_them() {
    let negative = || ArgValue::Numbers(vec![1.0, 0.0]);
    for (name, value) in [
        ("mass", ArgValue::Text("heavy".to_owned())),
        ("nHat_B", negative()),
        ("storageUnitValidCheck", ArgValue::Number(1.0)),
        ("batteryStorageCapacity", ArgValue::Number(0.0)),
        ("thrForceSign", ArgValue::Number(-1.0)),
        ("u_max", ArgValue::Number(f64::NAN)),
    ] {
        let error = read(name, value, "FullFeaturedDynModel", "ImagingFSWModel").unwrap_err();
        assert!(error.to_string().contains(&format!("`{name}`")), "{name}: {error}");
    }
}

#[test]
fn unknown_properties_are_errors_that_name_them() {
    let unknown = |error: TaskingError, wanted: &str| match error {
        TaskingError::UnknownArgument { name, known, .. } => {
            assert_eq!(name, wanted);
            known
        }
        other => panic!("{wanted}: {other}"),
    };
    let known = unknown(Property::from_name("battery").unwrap_err(), "battery");
    assert!(known.contains("battery_charge_fraction"), "{known}");
    let known =
        unknown(OpportunityProperty::from_name("opportunity_opens").unwrap_err(), "opportunity_opens");
    assert!(known.contains("opportunity_open"), "{known}");
    for property in Property::ALL {
        assert_eq!(Property::from_name(property.name()), Ok(*property));
    }
    for property in OpportunityProperty::ALL {
        assert_eq!(OpportunityProperty::from_name(property.name()), Ok(property));
    }
}

#[test]
fn recordings_with_unknown_names_are_refused_by_name() {
    let path = super::recordings::recordings("recorded");
    let path = path.iter().find(|path| path.ends_with("all_observations.json.gz")).unwrap();
    let recording = super::recordings::load(path);
    let refused = |change: &dyn Fn(&mut serde_json::Value)| {
        let mut altered = recording.clone();
        change(&mut altered["satellites"][0]);
        read_setup(&altered, crate::tasking::orbit::GravityModel::Ggm10).unwrap_err()
    };
    let error = refused(&|satellite| satellite["sat_args"]["hovering"] = 1.into());
    assert!(error.starts_with("`hovering` is not an argument of the satellite's models"), "{error}");
    let error = refused(&|satellite| satellite["observations"][0]["properties"][0]["prop"] = "sigma".into());
    assert!(error.starts_with("`sigma` is not an argument of the satellite's properties"), "{error}");
}
