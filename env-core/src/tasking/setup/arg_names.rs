//! Names of the arguments of satellites.

use super::models::{DynamicsModel, SoftwareModel};

/// Arguments of every satellite.
const BASIC_NAMES: [&str; 33] = [
    "utc_init",
    "mass",
    "width",
    "depth",
    "height",
    "sigma_init",
    "omega_init",
    "rN",
    "vN",
    "oe",
    "mu",
    "min_orbital_radius",
    "disturbance_vector",
    "dragCoeff",
    "panelArea",
    "wheelSpeeds",
    "maxWheelSpeed",
    "u_max",
    "thrusterPowerDraw",
    "panelEfficiency",
    "nHat_B",
    "batteryStorageCapacity",
    "storedCharge_Init",
    "basePowerDraw",
    "rwBasePower",
    "rwMechToElecEfficiency",
    "rwElecToMechEfficiency",
    "controlAxes_B",
    "thrForceSign",
    "hs_min",
    "maxCounterValue",
    "thrMinFireTime",
    "desatAttitude",
];
/// Arguments of MRP steering.
const STEERING_NAMES: [&str; 5] = ["K1", "K3", "omega_max", "servo_Ki", "servo_P"];
/// Arguments of MRP feedback.
const FEEDBACK_NAMES: [&str; 3] = ["K", "Ki", "P"];
/// Arguments of an imaging flight software.
const IMAGING_NAMES: [&str; 3] = ["inst_pHat_B", "imageAttErrorRequirement", "imageRateErrorRequirement"];
/// Arguments of an instrument with its storage and transmitter.
const INSTRUMENT_NAMES: [&str; 10] = [
    "instrumentBaudRate",
    "instrumentPowerDraw",
    "transmitterBaudRate",
    "transmitterNumBuffers",
    "transmitterPacketSize",
    "transmitterPowerDraw",
    "dataStorageCapacity",
    "storageUnitValidCheck",
    "storageInit",
    "imageTargetMaximumRange",
];
/// Arguments of an instrument that images targets.
const TARGET_NAMES: [&str; 3] = ["bufferNames", "groundLocationPlanetRadius", "imageTargetMinimumElevation"];

/// Names of the arguments of a satellite's models, as in BSK-RL.
pub(super) fn argument_names(dynamics: DynamicsModel, software: SoftwareModel) -> Vec<&'static str> {
    let mut names = BASIC_NAMES.to_vec();
    if software.steering {
        names.extend(STEERING_NAMES);
    } else {
        names.extend(FEEDBACK_NAMES);
    }
    if software.imaging {
        names.extend(IMAGING_NAMES);
    }
    if dynamics.instrument {
        names.extend(INSTRUMENT_NAMES);
        if !dynamics.continuous {
            names.extend(TARGET_NAMES);
        }
    }
    if dynamics.line_of_sight {
        names.push("losMaximumRange");
    }
    names
}
