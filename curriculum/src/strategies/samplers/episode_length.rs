//! Mean lengths of episodes, in steps.

use serde::{Deserialize, Serialize};

/// Mean number of steps of the latest episodes.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct EpisodeLength {
    steps: f64,
    /// Weight of the mean, in episodes.
    episodes: f64,
}

impl EpisodeLength {
    /// Episodes that the mean remembers. Lengths change as the agent learns.
    const MEMORY: f64 = 64.0;

    /// The mean; `None` before the first episode.
    pub(super) fn mean(&self) -> Option<f64> {
        (self.episodes > 0.0 && self.steps > 0.0).then(|| self.steps / self.episodes)
    }

    /// Takes note of episodes and their steps together.
    pub(super) fn add(&mut self, steps: u64, episodes: u32) {
        let episodes = f64::from(episodes);
        let kept = (1.0 - episodes / Self::MEMORY).max(0.0);
        self.steps = self.steps * kept + steps as f64;
        self.episodes = self.episodes * kept + episodes;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mean_follows_the_latest_episodes() {
        let mut length = EpisodeLength::default();
        assert_eq!(length.mean(), None);
        (0..1000).for_each(|_| length.add(10, 1));
        (0..1000).for_each(|_| length.add(800, 8));
        assert!((length.mean().unwrap() - 100.0).abs() < 1e-6);
    }
}
