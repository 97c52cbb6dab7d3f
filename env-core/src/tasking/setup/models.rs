//! Models of a satellite and their names in BSK-RL.

use crate::tasking::error::TaskingError;

/// Features of the dynamics model of a satellite. All models include the body, wheels, thrusters, panel and battery
/// (`BasicDynamicsModel`).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct DynamicsModel {
    /// Instrument, storage and transmitter (`ImagingDynModel`).
    pub instrument: bool,
    /// The instrument scans the ground below continuously into one buffer (`ContinuousImagingDynModel`).
    pub continuous: bool,
    /// The transmitter is connected to the world's ground stations (`GroundStationDynModel`).
    pub ground_stations: bool,
    /// Lines of sight to other satellites are observed (`LOSCommDynModel`).
    pub line_of_sight: bool,
}

impl DynamicsModel {
    /// Composes the models of a tuple of BSK-RL class names.
    ///
    /// # Errors
    /// Returns [`TaskingError::NotSupported`] if a name is not one of the supported models.
    pub fn compose<'a>(names: impl IntoIterator<Item = &'a str>) -> Result<Self, TaskingError> {
        let mut model = Self::default();
        for name in names {
            match name {
                "BasicDynamicsModel" => {}
                "ImagingDynModel" => model.instrument = true,
                "ContinuousImagingDynModel" => (model.instrument, model.continuous) = (true, true),
                "GroundStationDynModel" => (model.instrument, model.ground_stations) = (true, true),
                "LOSCommDynModel" => model.line_of_sight = true,
                "FullFeaturedDynModel" => {
                    (model.instrument, model.ground_stations, model.line_of_sight) = (true, true, true);
                }
                other => return Err(TaskingError::NotSupported(format!("the dynamics model `{other}`"))),
            }
        }
        Ok(model)
    }
}

/// Flight software model of a satellite.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SoftwareModel {
    /// Points at targets and triggers the instrument (`ImagingFSWModel`).
    pub imaging: bool,
    /// Scans the ground below (`ContinuousImagingFSWModel`).
    pub continuous: bool,
    /// Controls the attitude by MRP steering instead of MRP feedback (`SteeringFSWModel`).
    pub steering: bool,
}

impl SoftwareModel {
    /// Composes the models of a tuple of BSK-RL class names.
    ///
    /// # Errors
    /// Returns [`TaskingError::NotSupported`] if a name is not one of the supported models.
    pub fn compose<'a>(names: impl IntoIterator<Item = &'a str>) -> Result<Self, TaskingError> {
        let mut model = Self::default();
        for name in names {
            match name {
                "BasicFSWModel" => {}
                "ImagingFSWModel" => model.imaging = true,
                "ContinuousImagingFSWModel" => (model.imaging, model.continuous) = (true, true),
                "SteeringFSWModel" => model.steering = true,
                "SteeringImagerFSWModel" => (model.imaging, model.steering) = (true, true),
                other => {
                    return Err(TaskingError::NotSupported(format!("the flight software model `{other}`")));
                }
            }
        }
        Ok(model)
    }
}
