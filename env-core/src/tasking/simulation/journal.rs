//! Record of what happens to the satellites of an episode, for messages to its user.

use super::TaskingSim;

/// What happened to a satellite.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SatelliteEvent {
    /// Opportunities were searched for.
    Search {
        /// Start of the searched time, s.
        from_s: f64,
        /// End of the searched time, s.
        to_s: f64,
    },
    /// The satellite was tasked with the image of a target.
    Tasked {
        /// Index of the target.
        target: usize,
        /// Opening of the target's window, s.
        open_s: f64,
        /// Close of the target's window, s.
        close_s: f64,
    },
    /// The satellite stored the image of a target.
    Imaged {
        /// Index of the target; `None` if no image was commanded.
        target: Option<usize>,
    },
    /// The window of the tasked target closed without an image.
    Missed {
        /// Index of the target; `None` if no image was commanded.
        target: Option<usize>,
    },
    /// The time of an action ended.
    TimeUp,
}

/// An entry of an episode's journal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JournalEntry {
    /// Time since the start, s.
    pub time_s: f64,
    /// Index of the satellite.
    pub satellite: usize,
    /// What happened to it.
    pub event: SatelliteEvent,
}

/// Journal of one satellite.
#[derive(Debug, Clone, Default)]
pub(super) struct Journal {
    satellite: usize,
    /// Time at which the last step ended, s.
    pub now_s: f64,
    entries: Vec<JournalEntry>,
}

impl Journal {
    /// Adds an entry of the time between two steps.
    pub(super) fn add_now(&mut self, event: SatelliteEvent) {
        self.add(self.now_s, event);
    }

    /// Adds an entry at a time, s.
    pub(super) fn add(&mut self, time_s: f64, event: SatelliteEvent) {
        self.entries.push(JournalEntry { time_s, satellite: self.satellite, event });
    }
}

impl TaskingSim {
    /// Keeps a journal of all satellites from here on.
    pub fn keep_journal(&mut self) {
        let now_s = self.time_s();
        for (satellite, agent) in self.agents.iter_mut().enumerate() {
            agent.journal = Some(Box::new(Journal { satellite, now_s, entries: Vec::new() }));
        }
    }

    /// Takes the entries of the journal since the last call: in order of time, and those of a time by satellite.
    pub fn take_journal(&mut self) -> Vec<JournalEntry> {
        let journals = self.agents.iter_mut().filter_map(|agent| agent.journal.as_deref_mut());
        let mut entries: Vec<_> = journals.flat_map(|journal| std::mem::take(&mut journal.entries)).collect();
        entries.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
        entries
    }
}
