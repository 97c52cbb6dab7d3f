//! [`Place`]: where a scenario or a layout is on the rungs of its task.

use curriculum::Proposal;

/// Place on the rungs of a task: the start rung if the rungs are starts, else the level.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Place {
    /// Level; `None` under a strategy without levels.
    pub level: Option<u32>,
    /// Start rung, if the rungs of the task are starts.
    pub start_rung: Option<u32>,
}

impl Place {
    /// Place of a stored layout.
    #[must_use]
    pub fn from_stored(level: Option<i64>, start_rung: Option<i64>) -> Self {
        let rung = |stored: Option<i64>| stored.and_then(|stored| u32::try_from(stored).ok());
        Self { level: rung(level), start_rung: rung(start_rung) }
    }

    /// Place of a proposed scenario.
    #[must_use]
    pub const fn of_proposal(proposal: &Proposal) -> Self {
        Self { level: proposal.level, start_rung: proposal.start_rung }
    }

    /// Returns true if the places are at most one rung apart. Without levels every place is near.
    #[must_use]
    pub fn is_near(self, other: Self) -> bool {
        match (self.start_rung, other.start_rung) {
            (Some(a), Some(b)) => a.abs_diff(b) <= 1,
            (None, None) => self.level.zip(other.level).is_none_or(|(a, b)| a.abs_diff(b) <= 1),
            _ => false,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn level(level: u32) -> Place {
        Place { level: Some(level), start_rung: None }
    }

    fn start(level: u32, start_rung: u32) -> Place {
        Place { level: Some(level), start_rung: Some(start_rung) }
    }

    #[test]
    fn adjacent_levels_are_near() {
        assert!(level(3).is_near(level(4)) && level(4).is_near(level(3)) && !level(2).is_near(level(4)));
        assert!(Place::default().is_near(level(9)) && level(1).is_near(Place::default()));
    }

    #[test]
    fn adjacent_start_rungs_are_near_at_any_level() {
        assert!(start(0, 5).is_near(start(9, 6)) && !start(3, 5).is_near(start(3, 7)));
        assert!(!start(3, 15).is_near(level(3)) && !level(3).is_near(start(3, 15)));
    }
}
