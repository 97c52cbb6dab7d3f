//! Prepares critique jobs for the queue, and puts its results together. `store_critiques` stores them.

use std::sync::Arc;

use jobs::critique::CritiqueOutput;
use jobs::{EpisodeBatch, LoggedEpisode};
use store::critiques::CritiqueJob;

use crate::critiques::critique_input::{CritiqueEpisode, CritiqueInput, SelectedEpisode};
use crate::critiques::critique_result::CritiqueResult;
use crate::critiques::profile::EpisodeFindings;

/// Episodes of a job at most.
pub const MAX_JOB_EPISODES: usize = 64;

/// Critique jobs whose episodes are in the queue.
#[derive(Debug)]
pub struct PendingCritiques(Vec<PendingCritique>);

/// A critique job without its logs.
#[derive(Debug)]
struct PendingCritique {
    job: CritiqueJob,
    episodes: Vec<PendingEpisode>,
    skipped: i64,
}

/// An episode that sampling selected.
#[derive(Debug)]
struct PendingEpisode {
    number: i64,
    /// Number of the layout of a designed group, or the reason why the episode cannot be read.
    layout: Result<Option<i64>, String>,
}

impl PendingCritiques {
    /// Takes the readable episodes of jobs, in order, for the queue.
    #[must_use]
    pub fn take_episodes(inputs: Vec<CritiqueInput>) -> (Self, EpisodeBatch) {
        let mut batch = EpisodeBatch::default();
        let mut pending = Vec::with_capacity(inputs.len());
        for CritiqueInput { job, selected, skipped } in inputs {
            let take = |SelectedEpisode { number, episode }: SelectedEpisode| {
                let layout = episode.map(|CritiqueEpisode { scenario, layout, log }| {
                    batch.0.push(LoggedEpisode { scenario, log: Arc::new(log) });
                    layout
                });
                PendingEpisode { number, layout }
            };
            pending.push(PendingCritique {
                job,
                episodes: selected.into_iter().map(take).collect(),
                skipped,
            });
        }
        (Self(pending), batch)
    }

    /// Puts the results of the jobs together. An episode that could not be criticised is counted and does not affect the others.
    #[must_use]
    pub fn finish(self, output: CritiqueOutput) -> Vec<CritiqueResult> {
        let mut outcomes = output.0.into_iter();
        self.0.into_iter().map(|pending| pending.finish(&mut outcomes)).collect()
    }
}

/// Findings of an episode, or the reason why it could not be criticised.
type EpisodeCritique = Result<jobs::critique::CritiqueFindings, String>;

impl PendingCritique {
    fn finish(self, outcomes: &mut impl Iterator<Item = EpisodeCritique>) -> CritiqueResult {
        let Self { job, episodes, skipped } = self;
        let (mut findings, mut reasons) = (Vec::with_capacity(episodes.len()), Vec::new());
        for PendingEpisode { number, layout } in episodes {
            let criticised = layout.and_then(|layout| {
                let missing = || Err("its critique is missing".to_owned());
                Ok(EpisodeFindings::new(number, layout, outcomes.next().unwrap_or_else(missing)?))
            });
            match criticised {
                Ok(found) => findings.push(found),
                Err(reason) => reasons.push(format!("episode {number}: {reason}")),
            }
        }
        let failed = reasons.len() as i64;
        CritiqueResult { job, findings, skipped, failed, reason: reasons.into_iter().next() }
    }
}
