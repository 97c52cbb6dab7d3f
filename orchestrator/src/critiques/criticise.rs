//! Criticises the episodes of a job. This is pure computing; [`store_critiques`](super::store_critiques) stores the result.

use std::panic::AssertUnwindSafe;

use rayon::prelude::*;

use crate::critiques::critique_input::{CritiqueEpisode, CritiqueInput, SelectedEpisode};
use crate::critiques::critique_result::CritiqueResult;
use crate::critiques::profile::EpisodeFindings;

/// Episodes of a job at most.
pub const MAX_JOB_EPISODES: usize = 64;

/// Criticises the episodes of a job in parallel. An episode that cannot be criticised is counted and does not affect the others.
#[must_use]
pub fn criticise(input: CritiqueInput) -> CritiqueResult {
    let CritiqueInput { job, selected, skipped } = input;
    let (mut findings, mut reasons) = (Vec::with_capacity(selected.len()), Vec::new());
    let results: Vec<_> = selected.into_par_iter().map(criticise_episode).collect();
    for result in results {
        match result {
            Ok(found) => findings.push(found),
            Err(reason) => reasons.push(reason),
        }
    }
    CritiqueResult {
        job,
        findings,
        skipped,
        failed: reasons.len() as i64,
        reason: reasons.into_iter().next(),
    }
}

fn criticise_episode(selected: SelectedEpisode) -> Result<EpisodeFindings, String> {
    let number = selected.number;
    let findings = selected.episode.and_then(|CritiqueEpisode { scenario, layout, log }| {
        let task = scenario.task();
        let critique = std::panic::catch_unwind(AssertUnwindSafe(|| task.critique(&scenario, &log)))
            .map_err(|_| "the critique panicked".to_owned())?
            .map_err(|error| error.to_string())?;
        Ok(EpisodeFindings { layout, ..EpisodeFindings::of(number, &critique, task.speed_bands())? })
    });
    findings.map_err(|reason| format!("episode {number}: {reason}"))
}
