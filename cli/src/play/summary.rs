//! Text summary of all episodes.

use std::fmt::Write;

use super::episode::EpisodeResult;
use super::openenv_task::OpenEnvTask;
use super::runner::PlannedEpisode;

/// Formats the summary. With `model`, it includes the token usage.
pub(super) fn text(
    tasks: &[OpenEnvTask],
    planned: &[PlannedEpisode<'_>],
    flown: &[Option<EpisodeResult>],
    model: bool,
) -> String {
    let mut text = String::new();
    let mut of_task: Vec<String> = Vec::new();
    for task in tasks {
        let of = planned.iter().zip(flown).filter(|(planned, _)| planned.job.task.name == task.name);
        let scores: Vec<f64> = of
            .filter_map(|(_, flown)| flown.as_ref().filter(|flown| flown.fault.is_none()))
            .map(|flown| flown.score)
            .collect();
        let mean = scores.iter().sum::<f64>() / scores.len() as f64;
        let count = scores.len();
        let mean = if count == 0 { "none".to_owned() } else { format!("{mean:.3}") };
        of_task.push(format!("{} {mean} ({count})", task.name));
    }
    let ended = flown.iter().flatten().filter(|flown| flown.fault.is_none()).count();
    let (all, broken) = (flown.len(), flown.iter().flatten().count() - ended);
    // Writing to a string cannot fail.
    let _ = write!(text, "{ended} of {all} episodes were flown to their end");
    let _ =
        write!(text, "{}", if broken > 0 { format!(", {broken} were broken off") } else { String::new() });
    let left = all - ended - broken;
    let _ = write!(text, "{}", if left > 0 { format!(", {left} were not begun") } else { String::new() });
    let _ = writeln!(text, ". Mean score (of episodes): {}.", of_task.join(", "));
    if model {
        write_token_usage(flown, &mut text);
    }
    text
}

fn write_token_usage(flown: &[Option<EpisodeResult>], text: &mut String) {
    let sum = |of: fn(&EpisodeResult) -> u64| flown.iter().flatten().map(of).fold(0, u64::saturating_add);
    let calls = sum(|flown| flown.calls);
    let waited: f64 = flown.iter().flatten().map(|flown| flown.waited.as_secs_f64()).sum();
    let _ = writeln!(
        text,
        "Model: {calls} calls, {} tokens in, {} out, {:.2} s a call; {} answers were no action, {} steps went without one.",
        sum(|flown| flown.tokens_in),
        sum(|flown| flown.tokens_out),
        waited / calls.max(1) as f64,
        sum(|flown| flown.invalid),
        sum(|flown| flown.held),
    );
}
