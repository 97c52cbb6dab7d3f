//! Set-ups of the simulation: satellites with realised arguments, the world, and what is rewarded. Start reading at
//! [`environment`].

pub mod actions;
mod arg_names;
pub mod arg_value;
pub mod atmosphere;
pub mod environment;
pub mod models;
pub mod satellite_args;

pub use self::arg_value::{ArgReader, ArgValue};
pub use self::atmosphere::Atmosphere;
pub use self::environment::Setup;
pub use self::models::{DynamicsModel, SoftwareModel};
pub use self::satellite_args::{DesatAttitude, InitialOrbit, SatelliteArgs};
