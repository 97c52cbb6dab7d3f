//! Lanes of satellites side by side, with what they need to run ticks together.

use super::attitude::Attitude;
use super::control::Gains;
use super::dispatch::{BlockLanes, InstructionSet, TickRun};
use super::guidance::Boresight;
use super::parts::{BlockParts, TickConstants};
use super::state::{BodyInputs, SkyInputs, SoftwareInputs, SupplyInputs, TickInputs, TickState};
use crate::tasking::clock::TickLength;
use crate::tasking::earth::EARTH_RATE_RAD_S;

/// A block of `W` lanes. An empty lane computes a resting body, whose numbers are not used.
#[derive(Debug, Clone)]
pub struct Block<const W: usize> {
    /// State of the lanes.
    pub state: TickState<[f64; W]>,
    /// Inputs of the lanes.
    pub inputs: TickInputs<[f64; W]>,
    /// Parts of a tick that each lane needs.
    pub parts: [BlockParts; W],
    step_s: f64,
    earth_turn: [f64; 2],
}

impl<const W: usize> Block<W> {
    /// Creates a block of empty lanes.
    #[must_use]
    pub fn new(tick: TickLength) -> Self {
        let (sin, cos) = libm::sincos(EARTH_RATE_RAD_S * tick.seconds());
        Self {
            state: empty_state(),
            inputs: empty_inputs(),
            parts: [BlockParts::default(); W],
            step_s: tick.seconds(),
            earth_turn: [cos, sin],
        }
    }

    /// Loads the state of a satellite into a lane.
    pub fn load(&mut self, lane: usize, state: &TickState<f64>) {
        self.state.zip_with(state, |lanes, value| lanes[lane] = *value);
    }

    /// Stores the state of a lane.
    pub fn store(&self, lane: usize, state: &mut TickState<f64>) {
        state.zip_with(&self.state, |value, lanes| *value = lanes[lane]);
    }

    /// Empties a lane of the block.
    pub fn clear(&mut self, lane: usize) {
        let (state, inputs) = (empty_state::<1>(), empty_inputs::<1>());
        self.state.zip_with(&state, |lanes, value| lanes[lane] = value[0]);
        self.inputs.software.is_controlled[lane] = inputs.software.is_controlled[0];
        self.inputs.supply.awaited_bits[lane] = f64::INFINITY;
        self.inputs.supply.is_listening[lane] = 0.0;
        self.inputs.body.thrust.iter_mut().for_each(|axis| axis[lane] = 0.0);
        self.parts[lane] = BlockParts::default();
    }

    /// Runs up to `ticks` ticks, fewer if an awaited image is stored. Returns their number.
    pub fn run(&mut self, ticks: u32, set: InstructionSet) -> u32
    where
        for<'a> TickRun<'a, W>: BlockLanes<W>,
    {
        let mut parts = BlockParts::default();
        for lane in &self.parts {
            parts.merge(lane);
        }
        let constants = TickConstants { step: self.step_s, earth_turn: self.earth_turn, parts };
        TickRun { state: &mut self.state, inputs: &self.inputs, constants: &constants, ticks }.run(set)
    }
}

/// State of lanes without a satellite: a body at rest.
const fn empty_state<const W: usize>() -> TickState<[f64; W]> {
    const fn zero<const W: usize>() -> [[f64; W]; 3] {
        [[0.0; W]; 3]
    }
    TickState {
        attitude: Attitude { sigma: zero(), omega: zero(), wheels: zero() },
        motor: zero(),
        command: zero(),
        previous_sigma: zero(),
        is_first: [1.0; W],
        integral: zero(),
        position: [[7e6; W], [0.0; W], [0.0; W]],
        arc_time: [0.0; W],
        earth_cos: [1.0; W],
        earth_sin: [0.0; W],
        battery: [0.0; W],
        net_power: [0.0; W],
        stored: [0.0; W],
        is_commanded: [0.0; W],
        is_imaged: [0.0; W],
    }
}

/// Inputs of lanes without a satellite. No number of them becomes infinite or NaN.
const fn empty_inputs<const W: usize>() -> TickInputs<[f64; W]> {
    let (zero, one) = ([0.0; W], [1.0; W]);
    let axis = [zero, zero, one];
    TickInputs {
        body: BodyInputs {
            inertia: [one; 3],
            hub_inertia: [one; 3],
            inverse_hub_inertia: [one; 3],
            disturbance: [zero; 3],
            thrust: [zero; 3],
            max_motor: zero,
        },
        sky: SkyInputs {
            arc: [[[7e6; W], zero, zero, zero, zero, zero], [zero; 6], [zero; 6]],
            sun: [[1.5e11; W], zero, zero],
            sun_rate: [zero; 3],
            illumination: one,
        },
        supply: SupplyInputs {
            panel_strength: zero,
            panel_normal: axis,
            sinks: zero,
            wheel_gain: zero,
            wheel_return: zero,
            battery_capacity: one,
            instrument_bits: zero,
            storage_room: zero,
            is_listening: zero,
            awaited_bits: [f64::INFINITY; W],
        },
        software: SoftwareInputs {
            is_pointing: zero,
            is_hill: zero,
            is_steering: zero,
            is_controlled: zero,
            is_triggering: zero,
            is_imager: zero,
            boresight: Boresight { axis, opposite_axis: [one, zero, zero] },
            location: [[zero; 3], [zero; 3], [zero; 3], [zero; 3]],
            location_2: zero,
            elevation_sine_2: zero,
            max_range_2: zero,
            attitude_tolerance_2: zero,
            rate_tolerance_2: zero,
            gains: Gains {
                proportional: zero,
                cubic: zero,
                max_rate: one,
                rate: zero,
                integral: zero,
                integral_limit: zero,
            },
            control_step: zero,
        },
    }
}
