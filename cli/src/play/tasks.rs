//! Which task is meant, and how to tell that a server flies it.

use std::fmt;

use anyhow::Context;
use env_core::{Recipe, Scenario, Seed, TaskSpec};

/// What the public kessler-env calls its tasks.
const UPSTREAM: [(&str, &str); 3] = [
    ("task_1_easy", "kessler/survival"),
    ("task_2_medium", "kessler/eco_station"),
    ("task_3_hard", "kessler/rendezvous"),
];

/// A task as it was asked for.
#[derive(Clone)]
pub(super) struct Task {
    /// By this name.
    pub(super) name: String,
    /// It.
    pub(super) spec: &'static dyn TaskSpec,
}

impl fmt::Debug for Task {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.spec.id())
    }
}

impl Task {
    /// A task by its id, by the part after the `/` where that is one task's alone, or by its name in the public kessler-env.
    pub(super) fn parse(name: &str) -> Result<Self, String> {
        let id = UPSTREAM.iter().find(|(upstream, _)| *upstream == name).map_or(name, |(_, id)| id);
        let mut meant =
            env_core::tasks().filter(|task| task.id() == id || task.id().split('/').next_back() == Some(id));
        match (meant.next(), meant.next()) {
            (Some(spec), None) => Ok(Self { name: name.to_owned(), spec }),
            _ => {
                let known: Vec<&str> = env_core::tasks().map(TaskSpec::id).collect();
                Err(format!("no task is called so; there are {}", known.join(", ")))
            }
        }
    }

    /// The three tasks of the public kessler-env.
    pub(super) fn usual() -> Vec<Self> {
        UPSTREAM.iter().filter_map(|(_, id)| Self::parse(id.split('/').next_back()?).ok()).collect()
    }

    /// The environment's name, as the public kessler-env writes it.
    pub(super) fn environment(&self) -> String {
        format!("{}-env", self.world())
    }

    /// The world without its version.
    pub(super) fn world(&self) -> &'static str {
        self.spec.world().split('@').next().unwrap_or_default()
    }

    /// Some scenario of it.
    pub(super) fn example(&self) -> anyhow::Result<Scenario> {
        let recipe = Recipe::at_level(self.spec, 0)?;
        Ok(Scenario::new(recipe, Seed::user(0)?))
    }

    /// The goal's first word, by which observations of this task are known.
    pub(super) fn mission(&self) -> anyhow::Result<String> {
        let telemetry = self.spec.start(&self.example()?)?.telemetry();
        let goal = telemetry["mission_objective"].as_str().context("an observation without a goal")?;
        Ok(first_word(goal).to_owned())
    }
}

/// What a goal begins with, before the colon.
pub(super) fn first_word(goal: &str) -> &str {
    goal.split(':').next().unwrap_or_default().trim()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tasks_have_their_names_and_goals() {
        let of = |name: &str| Task::parse(name).map(|task| (task.spec.id(), task.mission().unwrap()));
        let id = |name: &str| of(name).unwrap().0;
        assert_eq!(id("survival"), id("task_1_easy"));
        assert_eq!((id("kessler/formation"), id("multiagent")), ("kessler/formation", "docking/multiagent"));
        let usual: Vec<_> =
            Task::usual().iter().map(|task| (task.name.clone(), task.mission().unwrap())).collect();
        let wanted = [("survival", "SURVIVAL"), ("eco_station", "ECO-STATION"), ("rendezvous", "RENDEZVOUS")];
        assert_eq!(usual, wanted.map(|(a, b)| (a.to_owned(), b.to_owned())));
        assert_eq!(of("docking/single").unwrap().1, "DOCKING");
        assert_eq!(Task::usual()[0].environment(), "kessler-env");
        assert!(of("golf").unwrap_err().contains("kessler/survival, ") && of("").is_err());
    }
}
