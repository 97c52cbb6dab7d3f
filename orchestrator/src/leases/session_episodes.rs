//! Episodes that sessions run now. A report of such an episode by another way cannot be its first attempt.

use std::collections::BTreeSet;

use parking_lot::Mutex;
use store::keys::EpisodeKey;

/// Episodes of leases that sessions began and did not end, of all sessions of the server.
///
/// The set is in memory only: a stop of the server ends the sessions, and clients cannot cause it.
#[derive(Debug, Default)]
pub(crate) struct SessionEpisodes(Mutex<BTreeSet<EpisodeKey>>);

impl SessionEpisodes {
    /// Adds an episode that a session begins.
    pub(crate) fn insert(&self, episode: EpisodeKey) {
        self.0.lock().insert(episode);
    }

    /// Removes an episode that a session reported or left.
    pub(crate) fn remove(&self, episode: EpisodeKey) {
        self.0.lock().remove(&episode);
    }

    /// Returns those of some episodes that a session runs.
    pub(crate) fn running_among(&self, episodes: impl Iterator<Item = EpisodeKey>) -> BTreeSet<EpisodeKey> {
        let running = self.0.lock();
        if running.is_empty() {
            return BTreeSet::new();
        }
        episodes.filter(|episode| running.contains(episode)).collect()
    }
}
