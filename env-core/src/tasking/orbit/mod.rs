//! Orbits: forces, propagation and elements. Start reading at [`propagator`].

pub mod dop853;
pub mod elements;
pub mod gravity;
pub mod hill;
pub mod propagator;

pub use self::elements::OrbitalElements;
pub use self::gravity::GravityModel;
pub use self::hill::hill_frame;
pub use self::propagator::{HermiteArc, Orbit, OrbitNode, Sky};
