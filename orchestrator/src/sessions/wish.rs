//! What a session is asked to fly.

use std::sync::Arc;

use env_core::{Recipe, Scenario, ScenarioError, Seed, SeedSpace, TaskSpec};
use rand::TryRng;
use rand::rngs::SysRng;

use crate::ids::{EpisodeId, LeaseId, RunId};

/// Longest name of a group or an episode, characters.
pub const MOST_GROUP: usize = 255;

/// What is asked for at a reset. What contradicts itself is refused by [`Wish::sort`].
#[derive(Clone, Default)]
pub struct Wish {
    /// A seed from 0 to 2^51 − 1; any if none.
    pub seed: Option<u64>,
    /// What the episode is to be called, or which episode of a lease to fly.
    pub episode_id: Option<String>,
    /// The task.
    pub task: Option<&'static dyn TaskSpec>,
    /// Params that are not at their defaults.
    pub params: Vec<(String, f64)>,
    /// Physics options that are not at their defaults.
    pub physics: Vec<(String, String)>,
    /// A whole scenario.
    pub scenario: Option<Scenario>,
    /// Fly what the curriculum of this run proposes, and report the outcome to it.
    pub run: Option<RunId>,
    /// Fly episodes of this lease.
    pub lease: Option<LeaseId>,
    /// Who asks with the same name gets the same scenario.
    pub group: Option<String>,
    /// Episodes of a group that is leased for this.
    pub group_size: Option<u32>,
    /// The policy that flies.
    pub policy_version: Option<u32>,
}

impl std::fmt::Debug for Wish {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let task = self.task.map(TaskSpec::id);
        f.debug_struct("Wish").field("task", &task).field("run", &self.run).finish_non_exhaustive()
    }
}

/// A wish that cannot be.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{field}: {reason}")]
pub struct WishError {
    /// The field at fault, as a dotted path.
    pub field: String,
    /// What is wrong.
    pub reason: String,
}

impl WishError {
    fn new(field: &str, reason: impl Into<String>) -> Self {
        Self { field: field.to_owned(), reason: reason.into() }
    }
}

/// A wish, sorted by who decides what is flown.
#[derive(Debug, Clone)]
pub enum Wished {
    /// Whoever asks.
    Free(Scenario),
    /// The curriculum of a run.
    Run {
        /// The run.
        run: RunId,
        /// Of which group.
        group: Option<String>,
        /// How many episodes the group has.
        group_size: Option<u32>,
        /// The policy that flies.
        policy_version: Option<u32>,
    },
    /// Who took the lease.
    Lease {
        /// Its run.
        run: RunId,
        /// The lease.
        lease: LeaseId,
        /// Of which group.
        group: Option<String>,
        /// Which episode, where it was named.
        episode: Option<EpisodeId>,
    },
}

impl Wish {
    /// Who decides what is flown; where nobody names a task it is this one.
    ///
    /// # Errors
    /// Fields that exclude each other, or a scenario that cannot be.
    pub fn sort(self, usual: &'static dyn TaskSpec) -> Result<Wished, WishError> {
        if self.run.is_some() || self.lease.is_some() {
            self.for_run()
        } else {
            self.free(usual).map(Wished::Free)
        }
    }

    fn for_run(self) -> Result<Wished, WishError> {
        let decided = "the run's curriculum decides this; leave it out, or leave out run and lease_id";
        let own = [
            ("seed", self.seed.is_some()),
            ("task", self.task.is_some()),
            ("params", !self.params.is_empty()),
            ("physics", !self.physics.is_empty()),
            ("scenario", self.scenario.is_some()),
        ];
        if let Some((field, _)) = own.iter().find(|(_, given)| *given) {
            return Err(WishError::new(field, decided));
        }
        let Some(run) = self.run else {
            return Err(WishError::new("run", "it is missing: say whose lease it is"));
        };
        let Self { lease, group, group_size, policy_version, episode_id, .. } = self;
        let Some(lease) = lease else {
            return Ok(Wished::Run { run, group, group_size, policy_version });
        };
        if group_size.is_some() {
            return Err(WishError::new("group_size", "the lease has it already; leave it out"));
        }
        // Another name than that of an episode is what the client likes to call it.
        let episode = episode_id.and_then(|id| id.parse::<EpisodeId>().ok());
        Ok(Wished::Lease { run, lease, group, episode })
    }

    fn free(self, usual: &'static dyn TaskSpec) -> Result<Scenario, WishError> {
        if self.group_size.is_some() {
            return Err(WishError::new("group_size", "it is of a run's group; say which run"));
        }
        if let Some(scenario) = self.scenario {
            let own = [
                ("seed", self.seed.is_some()),
                ("task", self.task.is_some()),
                ("params", !self.params.is_empty()),
                ("physics", !self.physics.is_empty()),
            ];
            if let Some((field, _)) = own.iter().find(|(_, given)| *given) {
                return Err(WishError::new(field, "the scenario has it already; leave one of the two out"));
            }
            Seed::user(scenario.seed().get())
                .map_err(|error| WishError::new("scenario.seed", error.to_string()))?;
            return Ok(scenario);
        }
        let under = |section: &str, error: &ScenarioError| {
            let field = error.field();
            let field =
                if field.starts_with(section) { field.to_owned() } else { format!("{section}.{field}") };
            WishError { field, reason: error.to_string() }
        };
        let params = self.params.iter().map(|(name, value)| (name.as_str(), *value));
        let physics = self.physics.iter().map(|(name, choice)| (name.as_str(), choice.as_str()));
        let recipe =
            Recipe::with_params(self.task.unwrap_or(usual), params).map_err(|e| under("params", &e))?;
        let recipe = recipe.with_options(physics).map_err(|error| under("physics", &error))?;
        let seed = match (self.seed, &self.group) {
            (Some(_), Some(_)) => {
                let why = "the name of a group decides it, so that all who name it fly the same; leave one of the two out";
                return Err(WishError::new("seed", why));
            }
            (Some(seed), None) => {
                Seed::user(seed).map_err(|error| WishError::new("seed", error.to_string()))?
            }
            (None, Some(group)) => seed_of(group),
            (None, None) => any_seed(),
        };
        Ok(Scenario::new(Arc::new(recipe), seed))
    }
}

/// The seed of a group that flies for no run: its name decides.
fn seed_of(group: &str) -> Seed {
    let mut bits = [0; 8];
    let mut hasher = blake3::Hasher::new_derive_key("sparring 2026 groups without a run");
    hasher.update(group.as_bytes()).finalize_xof().fill(&mut bits);
    Seed::in_space(SeedSpace::User, u64::from_le_bytes(bits))
}

/// A seed nobody asked for.
fn any_seed() -> Seed {
    // Where the system has no randomness left the time would not do either: the same world then, for everybody.
    Seed::in_space(SeedSpace::User, SysRng.try_next_u64().unwrap_or_default())
}
