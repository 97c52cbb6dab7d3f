//! Tasks by their names on the command line, and the goal by which a server's task is recognised.

use std::fmt;

use super::super::names;
use anyhow::Context;
use env_core::{Recipe, Scenario, Seed, TaskSpec};

/// Names of the tasks in the public kessler-env, with their ids here.
const KESSLER_ENV_TASKS: [(&str, &str); 3] = [
    ("task_1_easy", "kessler/survival"),
    ("task_2_medium", "kessler/eco_station"),
    ("task_3_hard", "kessler/rendezvous"),
];

/// Task with the name that the user gave it.
#[derive(Clone)]
pub(super) struct OpenEnvTask {
    /// Name on the command line, which the output repeats.
    pub(super) name: String,
    /// Specification of the task.
    pub(super) spec: &'static dyn TaskSpec,
}

impl fmt::Debug for OpenEnvTask {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.spec.id())
    }
}

impl OpenEnvTask {
    /// Finds a task by its id, by the part after the `/` if that is unique, or by its name in the public kessler-env.
    ///
    /// # Errors
    /// Returns a message with the known tasks if no single task has the name.
    pub(super) fn parse(name: &str) -> Result<Self, String> {
        let id = KESSLER_ENV_TASKS.iter().find(|(upstream, _)| *upstream == name).map_or(name, |(_, id)| id);
        Ok(Self { name: name.to_owned(), spec: names::find_task(id)? })
    }

    /// Returns the three tasks of the public kessler-env.
    pub(super) fn default_tasks() -> Vec<Self> {
        KESSLER_ENV_TASKS.iter().filter_map(|(_, id)| Self::parse(id.split('/').next_back()?).ok()).collect()
    }

    /// Returns the environment's name, as the public kessler-env writes it.
    pub(super) fn environment(&self) -> String {
        format!("{}-env", self.world())
    }

    /// Returns the world's name without its version.
    pub(super) fn world(&self) -> &'static str {
        self.spec.world().split('@').next().unwrap_or_default()
    }

    /// Creates a scenario of the task at level 0.
    ///
    /// # Errors
    /// Returns an error if the task has no level 0.
    pub(super) fn example(&self) -> anyhow::Result<Scenario> {
        let recipe = Recipe::at_level(self.spec, 0)?;
        Ok(Scenario::new(recipe, Seed::user(0)?))
    }

    /// Returns the first word of the goal, which identifies the task in observations.
    ///
    /// # Errors
    /// Returns an error if the task's observations have no goal.
    pub(super) fn mission(&self) -> anyhow::Result<String> {
        let telemetry = self.spec.start(&self.example()?)?.telemetry();
        let goal = telemetry["mission_objective"].as_str().context("an observation without a goal")?;
        Ok(first_word(goal).to_owned())
    }
}

/// Returns the part of a goal before the colon.
pub(super) fn first_word(goal: &str) -> &str {
    goal.split(':').next().unwrap_or_default().trim()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tasks_are_found_by_name_and_have_goals() {
        let of = |name: &str| OpenEnvTask::parse(name).map(|task| (task.spec.id(), task.mission().unwrap()));
        let id = |name: &str| of(name).unwrap().0;
        assert_eq!(id("survival"), id("task_1_easy"));
        assert_eq!((id("kessler/formation"), id("multiagent")), ("kessler/formation", "docking/multiagent"));
        let default_tasks: Vec<_> = OpenEnvTask::default_tasks()
            .iter()
            .map(|task| (task.name.clone(), task.mission().unwrap()))
            .collect();
        let wanted = [("survival", "SURVIVAL"), ("eco_station", "ECO-STATION"), ("rendezvous", "RENDEZVOUS")];
        assert_eq!(default_tasks, wanted.map(|(a, b)| (a.to_owned(), b.to_owned())));
        assert_eq!(of("docking/single").unwrap().1, "DOCKING");
        assert_eq!(OpenEnvTask::default_tasks()[0].environment(), "kessler-env");
        assert!(of("golf").unwrap_err().contains("kessler/survival, ") && of("").is_err());
    }
}
