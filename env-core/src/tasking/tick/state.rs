//! Memory of a block: what changes in each tick, and what is constant until the next event. `T` holds one number a lane.

use super::attitude::Attitude;
use super::control::Gains;
use super::guidance::Boresight;

/// Quantities that change in every tick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TickState<T> {
    /// Attitude, rate and wheel speeds.
    pub attitude: Attitude<T>,
    /// Motor torques that act in the next tick, N·m.
    pub motor: [T; 3],
    /// Motor torques that the flight software commanded last, N·m.
    pub command: [T; 3],
    /// Attitude error of the last tick of location pointing.
    pub previous_sigma: [T; 3],
    /// 1 until the first tick of location pointing after an action, then 0.
    pub is_first: T,
    /// Integral of the control law.
    pub integral: [T; 3],
    /// Position at the last tick, m.
    pub position: [T; 3],
    /// Time since the start of the orbit's arc, s.
    pub arc_time: T,
    /// Cosine of the Earth's rotation angle at the last tick.
    pub earth_cos: T,
    /// Sine of the Earth's rotation angle at the last tick.
    pub earth_sin: T,
    /// Charge of the battery, W·s.
    pub battery: T,
    /// Net power of the last tick, W.
    pub net_power: T,
    /// Bits in the storage that the instrument fills.
    pub stored: T,
    /// 1 if the flight software commanded the instrument in the last tick, else 0.
    pub is_commanded: T,
    /// 1 if the current target was imaged, else 0.
    pub is_imaged: T,
}

impl<T> TickState<T> {
    /// Applies a function to every quantity and the same quantity of another state.
    pub fn zip_with<U>(&mut self, other: &TickState<U>, f: impl Fn(&mut T, &U) + Copy) {
        let three = |a: &mut [T; 3], b: &[U; 3]| a.iter_mut().zip(b).for_each(|(a, b)| f(a, b));
        three(&mut self.attitude.sigma, &other.attitude.sigma);
        three(&mut self.attitude.omega, &other.attitude.omega);
        three(&mut self.attitude.wheels, &other.attitude.wheels);
        three(&mut self.motor, &other.motor);
        three(&mut self.command, &other.command);
        three(&mut self.previous_sigma, &other.previous_sigma);
        three(&mut self.integral, &other.integral);
        three(&mut self.position, &other.position);
        f(&mut self.is_first, &other.is_first);
        f(&mut self.arc_time, &other.arc_time);
        f(&mut self.earth_cos, &other.earth_cos);
        f(&mut self.earth_sin, &other.earth_sin);
        f(&mut self.battery, &other.battery);
        f(&mut self.net_power, &other.net_power);
        f(&mut self.stored, &other.stored);
        f(&mut self.is_commanded, &other.is_commanded);
        f(&mut self.is_imaged, &other.is_imaged);
    }
}

/// Inputs of the ticks that are constant until the next event of a lane. Truth values are 1 and 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TickInputs<T> {
    /// Inputs of the satellite's body.
    pub body: BodyInputs<T>,
    /// The orbit's arc and the sky.
    pub sky: SkyInputs<T>,
    /// Power supply and storage.
    pub supply: SupplyInputs<T>,
    /// Guidance, control and instrument.
    pub software: SoftwareInputs<T>,
}

/// The satellite's body and the torques on it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BodyInputs<T> {
    /// Moments of inertia about the body's axes, kg·m².
    pub inertia: [T; 3],
    /// Moments of inertia without those of the wheels, kg·m².
    pub hub_inertia: [T; 3],
    /// Inverse of `hub_inertia`, 1/(kg·m²).
    pub inverse_hub_inertia: [T; 3],
    /// Constant disturbance torque, N·m.
    pub disturbance: [T; 3],
    /// Torque of the thrusters at the start of the tick, N·m.
    pub thrust: [T; 3],
    /// Largest motor torque, N·m.
    pub max_motor: T,
}

/// The orbit's arc, the Sun and the Earth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SkyInputs<T> {
    /// Coefficients of the position by power of the arc time, for each component.
    pub arc: [[T; 6]; 3],
    /// Position of the Sun at the start of the arc, m.
    pub sun: [T; 3],
    /// Velocity of the Sun relative to the Earth, m/s.
    pub sun_rate: [T; 3],
    /// Share of the Sun that is visible, 0 to 1.
    pub illumination: T,
}

/// Power supply and storage.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SupplyInputs<T> {
    /// Power of the panel at one astronomical unit and normal incidence, times the square of that unit, W·m².
    pub panel_strength: T,
    /// Normal of the panel in body axes.
    pub panel_normal: [T; 3],
    /// Power of all sinks of the current mode and the constant draw of the wheels, W.
    pub sinks: T,
    /// Electrical per mechanical power of a wheel that is accelerated.
    pub wheel_gain: T,
    /// Electrical per mechanical power of a wheel that is braked.
    pub wheel_return: T,
    /// Capacity of the battery, W·s.
    pub battery_capacity: T,
    /// Bits that the instrument generates in a tick.
    pub instrument_bits: T,
    /// Most bits in the storage that the instrument fills.
    pub storage_room: T,
    /// 1 if the instrument obeys the flight software.
    pub is_listening: T,
    /// Bits beyond which the storage counts as increased by an image; infinite if no image is awaited.
    pub awaited_bits: T,
}

/// Guidance, control and instrument.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SoftwareInputs<T> {
    /// 1 if the boresight points at the location.
    pub is_pointing: T,
    /// 1 if the body is aligned with the Hill frame.
    pub is_hill: T,
    /// 1 if the control law is steering, 0 for feedback.
    pub is_steering: T,
    /// 1 if the wheels are controlled.
    pub is_controlled: T,
    /// 1 if the instrument controller runs.
    pub is_triggering: T,
    /// 1 if a target is imaged once, 0 if the instrument scans.
    pub is_imager: T,
    /// Axis that points at the location.
    pub boresight: Boresight<T>,
    /// Location in the inertial frame: parts that turn with the cosine and the sine of the Earth's rotation, a constant one,
    /// m, and the rate of change with the arc time, m/s.
    pub location: [[T; 3]; 4],
    /// Squared length of the location, m².
    pub location_2: T,
    /// Sine of the least elevation, times its magnitude.
    pub elevation_sine_2: T,
    /// Squared largest range, m².
    pub max_range_2: T,
    /// Squared largest attitude error of imaging.
    pub attitude_tolerance_2: T,
    /// Squared largest rate error of imaging, (rad/s)².
    pub rate_tolerance_2: T,
    /// Gains of the control law.
    pub gains: Gains<T>,
    /// Time since the last control, s.
    pub control_step: T,
}
