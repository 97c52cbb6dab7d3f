//! Replays of stored action logs, and the comparison with score, skill and success of their episodes.

use std::collections::HashMap;

use anyhow::Context;
use env_core::admission::{SuccessRule, is_success};
use env_core::rollout::replay;
use sqlx::SqliteConnection;
use store::logged_episodes::LoggedEpisode;
use store::scenarios::ScenarioLoader;
use store::{Millis, brackets, episodes, from_json, runs};

use super::findings::{FindingKind, Findings};
use orchestrator::runs::settings::RunSettings;

/// Time that a report may take: its success may follow settings that were changed meanwhile.
const REPORT_MS: Millis = 60_000;

/// Replays episodes and keeps what several of them need.
#[derive(Default)]
pub(super) struct EpisodeReplayer {
    loader: ScenarioLoader,
    /// Settings of runs with the times from which they were in force, newest first.
    settings: HashMap<String, Vec<(Millis, RunSettings)>>,
}

/// Values that the replay of an episode leads to.
struct ReplayedValues {
    score: f64,
    /// Skill and success; `None` if the episode has no bracket.
    judged: Option<JudgedValues>,
}

struct JudgedValues {
    skill: Option<f64>,
    /// Success by each rule that may have been in force.
    successes: Vec<bool>,
}

impl EpisodeReplayer {
    /// Replays an episode and adds the values that differ from the stored ones.
    pub(super) async fn check(
        &mut self,
        conn: &mut SqliteConnection,
        episode: &LoggedEpisode,
        findings: &mut Findings,
    ) {
        let id = episode.id();
        let ReplayedValues { score, judged } = match self.replay(conn, episode).await {
            Ok(replayed) => replayed,
            Err(error) => {
                return findings.add(FindingKind::Replays, format!("{id} cannot be replayed: {error:#}"));
            }
        };
        let shown = |value: Option<f64>| value.map_or_else(|| "none".to_owned(), |value| value.to_string());
        // Equal to the last bit: scores are deterministic.
        if episode.score != Some(score) {
            let stored = shown(episode.score);
            findings.add(FindingKind::Scores, format!("{id} replays to {score}, not {stored}"));
        }
        let Some(JudgedValues { skill, successes }) = judged else { return };
        if episode.skill != skill {
            let (skill, stored) = (shown(skill), shown(episode.skill));
            findings.add(FindingKind::Skills, format!("{id} replays to the skill {skill}, not {stored}"));
        }
        if !successes.iter().any(|success| episode.success == Some(*success)) {
            let word = |is_success: bool| if is_success { "a success" } else { "no success" };
            let stored = episode.success.map_or("unknown", word);
            let replayed = word(successes.first().copied().unwrap_or_default());
            findings.add(
                FindingKind::Successes,
                format!("{id} is stored as {stored}, but replays to {replayed}"),
            );
        }
    }

    async fn replay(
        &mut self,
        conn: &mut SqliteConnection,
        episode: &LoggedEpisode,
    ) -> anyhow::Result<ReplayedValues> {
        let id = episode.scenario.as_ref().context("its group is not stored")?;
        let scenario = self.loader.get(conn, id).await?;
        let log = episodes::log(conn, episode.lease, episode.number).await?;
        let outcome = replay(&scenario, &log.context("its actions are not stored")?)?;
        let Some(planner) = episode.planner_version else {
            return Ok(ReplayedValues { score: outcome.score, judged: None });
        };
        let bracket = brackets::by_planner(conn, id, planner).await?.context("its bracket is not stored")?;
        let rules = self.rules(conn, episode, scenario.task().id()).await?;
        let successes =
            rules.into_iter().map(|rule| is_success(&scenario, rule, &bracket, &outcome)).collect();
        let judged = JudgedValues { skill: bracket.skill(outcome.score), successes };
        Ok(ReplayedValues { score: outcome.score, judged: Some(judged) })
    }

    /// Success rules that may have been in force when the episode was reported, the likeliest first.
    async fn rules(
        &mut self,
        conn: &mut SqliteConnection,
        episode: &LoggedEpisode,
        task: &str,
    ) -> anyhow::Result<Vec<SuccessRule>> {
        if !self.settings.contains_key(&episode.run) {
            let history = load_settings(conn, &episode.run).await?;
            self.settings.insert(episode.run.clone(), history);
        }
        let history = self.settings.get(&episode.run).map(Vec::as_slice).unwrap_or_default();
        let mut rules = Vec::new();
        for (from, settings) in history.iter().filter(|(from, _)| *from <= episode.at) {
            rules.push(settings.rule(task));
            if *from <= episode.at - REPORT_MS {
                break;
            }
        }
        // A clock that was set back may have given the episode a time before the run.
        if rules.is_empty() {
            rules.extend(history.iter().map(|(_, settings)| settings.rule(task)));
        }
        Ok(rules)
    }
}

/// Reads all settings of a run with the times from which they were in force, newest first.
async fn load_settings(conn: &mut SqliteConnection, run: &str) -> anyhow::Result<Vec<(Millis, RunSettings)>> {
    let rows = runs::settings_history(conn, run, i64::MAX, i64::MAX).await?;
    let settings = rows.into_iter().map(|row| Ok((row.at, from_json("a run's settings", &row.settings)?)));
    settings.collect()
}
