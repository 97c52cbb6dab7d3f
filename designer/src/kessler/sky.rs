//! A sky to put encounters into, before there is a design.

use env_core::Scenario;
use env_core::chance::Seeded;
use env_core::kessler::bearing::Frame;
use env_core::kessler::setup::{Contact, Setup};

use super::hold::Hold;
use super::language::Encounter;
use super::place::{Laws, place};

/// Where satellites go that hold, and what pulls.
pub(super) struct Sky {
    hold: Hold,
    laws: Laws,
}

impl Sky {
    /// The sky of a scenario; none where it has no fair start.
    pub(super) fn of(scenario: &Scenario) -> Option<Self> {
        let setup = Setup::read(scenario.recipe()).ok()?;
        let start = setup.start(&mut Seeded::new(scenario.seed())).ok()?;
        let hold = Hold::of(&start.satellites, setup.physics.gravity, setup.radar_range);
        let laws = Laws { gravity: setup.physics.gravity, swept: setup.physics.contact == Contact::Swept };
        Some(Self { hold, laws })
    }

    /// Whether a body can be put where the encounter says.
    pub(super) fn takes(&self, encounter: &Encounter, frame: Frame) -> bool {
        encounter.check("").is_ok() && place(encounter, frame, &self.hold, self.laws).is_ok()
    }
}
