//! The request of a reset, and the source of the episode that it asks for.

use std::sync::Arc;

use env_core::{Recipe, Scenario, ScenarioError, Seed, SeedSpace, TaskSpec};
use evaluation::suite::file::built_in;
use rand::TryRng;
use rand::rngs::SysRng;

use store::ids::{EpisodeId, LeaseId, RunId};

/// Maximum length of the name of a group or an episode, in characters.
pub const MAX_NAME_CHARS: usize = 255;

/// Fields of a reset. [`SessionRequest::resolve`] rejects contradictions.
#[derive(Clone, Default)]
pub struct SessionRequest {
    /// Seed from 0 to 2^51 − 1; random by default.
    pub seed: Option<u64>,
    /// Name for the episode, or the id of an episode of a lease.
    pub episode_id: Option<String>,
    /// Task; the caller of [`SessionRequest::resolve`] gives the default.
    pub task: Option<&'static dyn TaskSpec>,
    /// Params by name, as far as they differ from their defaults.
    pub params: Vec<(String, f64)>,
    /// Physics options by name, as far as they differ from their defaults.
    pub physics: Vec<(String, String)>,
    /// Complete scenario, instead of seed, task, params and physics.
    pub scenario: Option<Scenario>,
    /// Scenario of a suite, instead of seed, task, params and physics.
    pub suite_scenario: Option<SuiteScenario>,
    /// Run whose curriculum proposes the scenario and receives the outcome.
    pub run: Option<RunId>,
    /// Lease of the run whose episodes are used.
    pub lease: Option<LeaseId>,
    /// Name of a group: requests with the same name get the same scenario.
    pub group: Option<String>,
    /// Number of episodes of the group that is leased.
    pub group_size: Option<u32>,
    /// Version of the policy that acts; the run's current version by default.
    pub policy_version: Option<u32>,
}

impl std::fmt::Debug for SessionRequest {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let task = self.task.map(TaskSpec::id);
        f.debug_struct("SessionRequest").field("task", &task).field("run", &self.run).finish_non_exhaustive()
    }
}

/// Error of a request with a field that is invalid or contradicts another one.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{field}: {reason}")]
pub struct SessionRequestError {
    /// Dotted path of the field.
    pub field: String,
    /// Reason why the field is rejected.
    pub reason: String,
}

impl SessionRequestError {
    /// Creates the error of a field.
    pub(super) fn new(field: &str, reason: impl Into<String>) -> Self {
        Self { field: field.to_owned(), reason: reason.into() }
    }

    /// Creates the error of a field in a section of the request, such as `params`.
    fn in_section(section: &str, error: &ScenarioError) -> Self {
        let field = error.field();
        let field = if field.starts_with(section) { field.to_owned() } else { format!("{section}.{field}") };
        Self { field, reason: error.reason() }
    }
}

/// Scenario of a built-in suite.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SuiteScenario {
    /// Name of the suite.
    pub suite: &'static str,
    /// Place of the scenario in the suite, from 0.
    pub index: usize,
}

impl SuiteScenario {
    /// Reads the scenario from its suite. The first use of a suite parses it, which takes too long for a thread of the runtime.
    ///
    /// # Errors
    /// Returns the error of the field `index` if the suite has fewer scenarios.
    pub(super) fn load(self) -> Result<Scenario, SessionRequestError> {
        let suite = built_in(self.suite).map(|loaded| &loaded.suite);
        let entry = suite.and_then(|suite| suite.entries().nth(self.index));
        let count = || suite.map_or(0, |suite| suite.entries().count());
        entry.map(|entry| entry.scenario.clone()).ok_or_else(|| {
            SessionRequestError::new(
                "index",
                format!("must be less than {}, the number of scenarios", count()),
            )
        })
    }
}

/// Source of the episode that a session runs.
#[derive(Debug, Clone)]
pub enum EpisodeSource {
    /// Scenario of the client's choice.
    Scenario(Scenario),
    /// Curriculum of a run: the session leases a group.
    Run {
        /// Id of the run.
        run: RunId,
        /// Name of the group, shared by the sessions of one group.
        group: Option<String>,
        /// Number of episodes in the group.
        group_size: Option<u32>,
        /// Version of the policy that acts.
        policy_version: Option<u32>,
    },
    /// Lease that the client took before.
    Lease {
        /// Id of the lease's run.
        run: RunId,
        /// Id of the lease.
        lease: LeaseId,
        /// Name of the group.
        group: Option<String>,
        /// Id of the episode, if the client named one.
        episode: Option<EpisodeId>,
        /// Version of the policy that acts; `None` for the version of the lease.
        policy_version: Option<u32>,
    },
}

impl SessionRequest {
    /// Resolves the source of the episode. A request without a task uses `default_task`.
    ///
    /// # Errors
    /// Returns the first field that excludes another one, or that does not make a valid scenario.
    pub async fn resolve(
        self,
        default_task: &'static dyn TaskSpec,
    ) -> Result<EpisodeSource, SessionRequestError> {
        if self.run.is_some() || self.lease.is_some() {
            self.resolve_run()
        } else if let Some(scenario) = self.suite_scenario {
            self.check_alone()?;
            let loaded = tokio::task::spawn_blocking(move || scenario.load()).await;
            let failed = |_| SessionRequestError::new("split", "cannot be read; send the request again");
            loaded.map_err(failed)?.map(EpisodeSource::Scenario)
        } else {
            self.resolve_scenario(default_task).map(EpisodeSource::Scenario)
        }
    }

    /// Checks that a scenario of a suite has no field that determines a scenario beside it.
    fn check_alone(&self) -> Result<(), SessionRequestError> {
        let reason = "must be left out with `split` and `index`, which determine the scenario";
        self.reject_scenario_fields(reason)?;
        let others = [
            ("scenario", self.scenario.is_some()),
            ("group_id", self.group.is_some()),
            ("group_size", self.group_size.is_some()),
        ];
        match others.iter().find(|(_, is_given)| *is_given) {
            Some((field, _)) => Err(SessionRequestError::new(field, reason)),
            None => Ok(()),
        }
    }

    fn resolve_run(self) -> Result<EpisodeSource, SessionRequestError> {
        let reason = "must be left out with `run` or `lease_id`: the curriculum determines it";
        self.reject_scenario_fields(reason)?;
        let scenarios = [("scenario", self.scenario.is_some()), ("split", self.suite_scenario.is_some())];
        if let Some((field, _)) = scenarios.iter().find(|(_, is_given)| *is_given) {
            return Err(SessionRequestError::new(field, reason));
        }
        let Some(run) = self.run else {
            return Err(SessionRequestError::new("run", "is required with `lease_id`"));
        };
        let Self { lease, group, group_size, policy_version, episode_id, .. } = self;
        let Some(lease) = lease else {
            return Ok(EpisodeSource::Run { run, group, group_size, policy_version });
        };
        if group_size.is_some() {
            return Err(SessionRequestError::new(
                "group_size",
                "must be left out with `lease_id`: the lease determines it",
            ));
        }
        // A text that is not an episode id is the client's own name for the episode.
        let episode = episode_id.and_then(|id| id.parse::<EpisodeId>().ok());
        Ok(EpisodeSource::Lease { run, lease, group, episode, policy_version })
    }

    fn resolve_scenario(self, default_task: &'static dyn TaskSpec) -> Result<Scenario, SessionRequestError> {
        if self.group_size.is_some() {
            return Err(SessionRequestError::new("group_size", "needs `run`"));
        }
        if let Some(scenario) = &self.scenario {
            self.reject_scenario_fields("must be left out with `scenario`, which contains it")?;
            Seed::user(scenario.seed().get())
                .map_err(|error| SessionRequestError::new("scenario.seed", error.reason()))?;
            return Ok(scenario.clone());
        }
        let params = self.params.iter().map(|(name, value)| (name.as_str(), *value));
        let physics = self.physics.iter().map(|(name, choice)| (name.as_str(), choice.as_str()));
        let recipe = Recipe::with_params(self.task.unwrap_or(default_task), params)
            .map_err(|error| SessionRequestError::in_section("params", &error))?;
        let recipe = recipe
            .with_options(physics)
            .map_err(|error| SessionRequestError::in_section("physics", &error))?;
        Ok(Scenario::new(Arc::new(recipe), self.resolve_seed()?))
    }

    fn resolve_seed(&self) -> Result<Seed, SessionRequestError> {
        match (self.seed, &self.group) {
            (Some(_), Some(_)) => {
                let reason = "must be left out with `group_id`, which determines the scenario of all sessions of the group";
                Err(SessionRequestError::new("seed", reason))
            }
            (Some(seed), None) => {
                Seed::user(seed).map_err(|error| SessionRequestError::new("seed", error.reason()))
            }
            (None, Some(group)) => Ok(seed_of_group(group)),
            (None, None) => Ok(random_seed()),
        }
    }

    /// Rejects the fields that a scenario is made of.
    fn reject_scenario_fields(&self, reason: &str) -> Result<(), SessionRequestError> {
        let fields = [
            ("seed", self.seed.is_some()),
            ("task", self.task.is_some()),
            ("params", !self.params.is_empty()),
            ("physics", !self.physics.is_empty()),
        ];
        match fields.iter().find(|(_, is_given)| *is_given) {
            Some((field, _)) => Err(SessionRequestError::new(field, reason)),
            None => Ok(()),
        }
    }
}

/// Derives the seed of a group without a run from the name of the group.
fn seed_of_group(group: &str) -> Seed {
    let mut bits = [0; 8];
    let mut hasher = blake3::Hasher::new_derive_key("sparring 2026 groups without a run");
    hasher.update(group.as_bytes()).finalize_xof().fill(&mut bits);
    Seed::in_space(SeedSpace::User, u64::from_le_bytes(bits))
}

/// Draws a seed from the system's randomness, or uses seed 0 if the system has none.
fn random_seed() -> Seed {
    Seed::in_space(SeedSpace::User, SysRng.try_next_u64().unwrap_or_default())
}
