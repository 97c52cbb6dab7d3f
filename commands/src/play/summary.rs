//! Text summary of all episodes.

use std::fmt::Write;

use super::episode::EpisodeResult;
use super::openenv_task::OpenEnvTask;
use super::runner::PlannedEpisode;

/// Formats the summary. With `model`, it includes the token usage.
pub(super) fn text(
    tasks: &[OpenEnvTask],
    planned: &[PlannedEpisode<'_>],
    results: &[Option<EpisodeResult>],
    model: bool,
) -> String {
    let mut text = String::new();
    let mut of_task: Vec<String> = Vec::new();
    for task in tasks {
        let of = planned.iter().zip(results).filter(|(planned, _)| planned.job.task.name == task.name);
        let scores: Vec<f64> = of
            .filter_map(|(_, result)| result.as_ref().filter(|result| result.fault.is_none()))
            .map(|result| result.score)
            .collect();
        let mean = scores.iter().sum::<f64>() / scores.len() as f64;
        let count = scores.len();
        let mean = if count == 0 { "none".to_owned() } else { format!("{mean:.3}") };
        of_task.push(format!("{} {mean} ({count})", task.name));
    }
    let ended = results.iter().flatten().filter(|result| result.fault.is_none()).count();
    let (all, broken) = (results.len(), results.iter().flatten().count() - ended);
    // Writing to a string cannot fail.
    let _ = write!(text, "{ended} of {all} episodes were run to their end");
    let _ = write!(text, "{}", if broken > 0 { format!(", {broken} were aborted") } else { String::new() });
    let left = all - ended - broken;
    let _ = write!(text, "{}", if left > 0 { format!(", {left} were not started") } else { String::new() });
    let _ = writeln!(text, ". Mean score (number of episodes): {}.", of_task.join(", "));
    if model {
        write_token_usage(results, &mut text);
    }
    text
}

fn write_token_usage(results: &[Option<EpisodeResult>], text: &mut String) {
    let sum = |of: fn(&EpisodeResult) -> u64| results.iter().flatten().map(of).fold(0, u64::saturating_add);
    let calls = sum(|results| results.calls);
    let waited: f64 = results.iter().flatten().map(|result| result.waited.as_secs_f64()).sum();
    let _ = writeln!(
        text,
        "Model: {calls} calls, {} tokens in, {} out, {:.2} s per call; {} answers were invalid, {} steps had no action.",
        sum(|results| results.tokens_in),
        sum(|results| results.tokens_out),
        waited / calls.max(1) as f64,
        sum(|results| results.invalid),
        sum(|results| results.held),
    );
}
