//! Which parts of a tick a block needs.

/// Parts of a tick that any lane of a block needs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct BlockParts {
    /// A boresight points at a location.
    pub pointing: bool,
    /// A body is aligned with the Hill frame.
    pub hill: bool,
    /// Wheels are controlled by steering.
    pub steering: bool,
    /// Wheels are controlled by feedback.
    pub feedback: bool,
    /// An instrument controller runs.
    pub triggering: bool,
    /// An instrument stores data.
    pub storing: bool,
}

impl BlockParts {
    /// Adds the parts that a lane needs.
    pub const fn merge(&mut self, lane: &Self) {
        self.pointing |= lane.pointing;
        self.hill |= lane.hill;
        self.steering |= lane.steering;
        self.feedback |= lane.feedback;
        self.triggering |= lane.triggering;
        self.storing |= lane.storing;
    }
}

/// Constants of all ticks of a block.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TickConstants {
    /// Length of a tick, s.
    pub step: f64,
    /// Cosine and sine of the Earth's rotation in a tick.
    pub earth_turn: [f64; 2],
    /// Parts that any lane needs.
    pub parts: BlockParts,
}
