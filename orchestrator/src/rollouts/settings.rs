//! The policy of a run: its request, its stored settings, and the changes that set it.

use api_types::{FeedDelivery, PolicyRequest, PolicySettings};
use env_core::policy::PLANNER_POLICY;
use env_core::text::{MAX_QUOTED_CHARS, shorten};
use env_core::{TaskSpec, format_shortest};
use policy_files::{PolicyFolder, PolicyReference};
use rollout::Endpoint;
use store::ids::RunId;
use store::run_policies::{self, RunPolicy, RunPolicyRow};
use store::{from_json, to_json};

use crate::engine::change::Change;
use crate::engine::error::ServiceError;
use crate::engine::signals::Signal;
use crate::engine::write_tx::WriteTx;
use crate::runs::validate::check_range;
use crate::runs::version_step::check_version_step;

/// Parts of a server that a run's policy can use.
#[derive(Debug, Clone, Copy)]
pub struct PolicyServer<'a> {
    /// The language model of the policy `chat`, if one is configured.
    pub endpoint: Option<&'a Endpoint>,
    /// Folder of policy files, if one is configured.
    pub folder: &'a PolicyFolder,
    /// True if the server publishes feeds on NATS, where workers with a language model may join.
    pub has_nats: bool,
}

/// Sets the policy of a run, after checking that its tasks have it.
#[derive(Debug)]
pub struct SetPolicy {
    run: RunId,
    policy: RunPolicy,
    version: Option<u32>,
    settings: PolicySettings,
}

impl SetPolicy {
    /// Checks a request for a run with these tasks. Reads the policy's file, if it has one.
    ///
    /// # Errors
    /// Returns an error that names the first invalid field.
    pub fn from_request(
        run: RunId,
        request: &PolicyRequest,
        server: PolicyServer<'_>,
        tasks: &[&'static dyn TaskSpec],
    ) -> Result<Self, ServiceError> {
        let PolicyServer { endpoint, folder, has_nats } = server;
        let policy = RunPolicy::from(request.policy.clone());
        let reference = PolicyReference::parse(policy.as_str());
        if reference.is_file() {
            check_file(&reference, folder, tasks)?;
        }
        if policy == RunPolicy::Chat && endpoint.is_none() && !has_nats {
            let reason = "the server has no language model for the policy chat; start it with --policy-url and --policy-model";
            return Err(ServiceError::invalid("policy", reason));
        }
        let settings = settings_from_request(request, endpoint)?;
        if settings.delivery == FeedDelivery::Nats && !has_nats {
            let reason = "nats needs a server that publishes feeds; start it with --nats";
            return Err(ServiceError::invalid("delivery", reason));
        }
        Ok(Self { run, policy, version: request.version, settings })
    }
}

impl Change for SetPolicy {
    type Output = ();

    async fn apply(self, tx: &mut WriteTx) -> Result<(), ServiceError> {
        let run = tx.run(self.run.as_str()).await?;
        if let RunPolicy::BuiltIn(name) = &self.policy
            && !PolicyReference::parse(name).is_file()
        {
            for plan in &run.state.settings.curriculum.tasks {
                check_policy(&plan.task, name)?;
            }
        }
        let before = run_policies::get(run.conn, self.run.as_str()).await?.map_or(0, |row| row.version);
        let version = self.version.map_or(before, i64::from);
        if version < before {
            let reason = format!("must be at least {before}, the version of the run, got {version}");
            return Err(ServiceError::invalid("version", reason));
        }
        if let Some(version) = self.version {
            check_version_step("version", version, run.state.policy_version)?;
        }
        let settings = to_json(&self.settings)?;
        run_policies::put(run.conn, self.run.as_str(), &self.policy, version, &settings, run.now).await?;
        if self.settings.delivery == FeedDelivery::Http {
            run_policies::clear_error(run.conn, self.run.as_str(), FEED_ERROR).await?;
        }
        run.outbox.signal(Signal::Rollout);
        run.outbox.signal(Signal::RunStates);
        Ok(())
    }
}

/// Reads the settings of a stored policy.
///
/// # Errors
/// Returns [`ServiceError::Store`] if the stored JSON cannot be read.
pub fn settings_from_row(row: &RunPolicyRow) -> Result<PolicySettings, ServiceError> {
    settings_from_json(&row.settings)
}

/// Reads the stored settings of a policy.
///
/// # Errors
/// Returns [`ServiceError::Store`] if the stored JSON cannot be read.
pub fn settings_from_json(json: &str) -> Result<PolicySettings, ServiceError> {
    Ok(from_json("a run's policy", json)?)
}

/// Checks a request and returns complete settings.
fn settings_from_request(
    request: &PolicyRequest,
    endpoint: Option<&Endpoint>,
) -> Result<PolicySettings, ServiceError> {
    let defaults = PolicySettings::default();
    let temperature = request.temperature.or_else(|| endpoint.and_then(|endpoint| endpoint.temperature));
    if let Some(temperature) = temperature.filter(|temperature| !(0.0..=5.0).contains(temperature)) {
        return Err(ServiceError::invalid(
            "temperature",
            format!("must be from 0 to 5, got {}", format_shortest(temperature)),
        ));
    }
    let settings = PolicySettings {
        temperature,
        history: request.history.unwrap_or(defaults.history),
        max_tokens: request.max_tokens,
        observations: request.observations.unwrap_or_default(),
        max_unacknowledged_groups: request
            .max_unacknowledged_groups
            .unwrap_or(defaults.max_unacknowledged_groups),
        refill: request.refill.unwrap_or(defaults.refill),
        delivery: request.delivery.unwrap_or_default(),
    };
    check_range("history", settings.history, 0, 64)?;
    check_range("max_unacknowledged_groups", settings.max_unacknowledged_groups, 1, 4096)?;
    if let Some(tokens) = settings.max_tokens {
        check_range("max_tokens", tokens, 16, 131_072)?;
    }
    Ok(settings)
}

/// Checks that a policy file exists and its policy can act in the tasks.
fn check_file(
    reference: &PolicyReference,
    folder: &PolicyFolder,
    tasks: &[&'static dyn TaskSpec],
) -> Result<(), ServiceError> {
    let policy =
        folder.open(reference).map_err(|error| ServiceError::invalid("policy", error.to_string()))?;
    for task in tasks {
        policy.check(*task).map_err(|error| ServiceError::invalid("policy", error.to_string()))?;
    }
    Ok(())
}

/// Checks that a task has a built-in policy that the server rolls out: not the planner, whose actions are the reference plan.
fn check_policy(task: &str, policy: &str) -> Result<(), ServiceError> {
    if policy == PLANNER_POLICY {
        let reason = format!(
            "must not be {PLANNER_POLICY}: its trajectories would disclose the planner's plans; evaluate it with POST /v1/evaluations"
        );
        return Err(ServiceError::invalid("policy", reason));
    }
    let specs = env_core::task(task).map(|task| task.policies()).unwrap_or_default();
    if specs.iter().any(|spec| spec.name == policy) {
        return Ok(());
    }
    let known: Vec<&str> =
        specs.iter().map(|spec| spec.name).filter(|name| *name != PLANNER_POLICY).collect();
    let policy = shorten(policy, MAX_QUOTED_CHARS);
    let reason = format!(
        "must be {}, {}, a built-in policy of {task} ({}), or a file in the server's policy folder such as onnx:model.onnx, got {policy:?}",
        RunPolicy::Off,
        RunPolicy::Chat,
        known.join(", ")
    );
    Err(ServiceError::invalid("policy", reason))
}

/// Stores why a run's policy failed, for display.
#[derive(Debug)]
pub struct SetPolicyError {
    /// Id of the run.
    pub run: String,
    /// Why it failed, as a sentence.
    pub error: String,
}

impl Change for SetPolicyError {
    type Output = ();

    async fn apply(self, tx: &mut WriteTx) -> Result<(), ServiceError> {
        Ok(run_policies::set_error(&mut tx.conn, &self.run, &self.error, tx.now).await?)
    }
}

/// Beginning of the errors of feeds, which distinguishes them from those of rollouts.
const FEED_ERROR: &str = "the feed is not published: ";

/// Stores why NATS does not deliver a run's feed, for display; without a reason, the feed is published again.
#[derive(Debug)]
pub struct SetFeedError {
    /// Id of the run.
    pub run: String,
    /// Why the feed is not published, as a clause.
    pub reason: Option<String>,
}

impl Change for SetFeedError {
    type Output = ();

    async fn apply(self, tx: &mut WriteTx) -> Result<(), ServiceError> {
        let Self { run, reason } = self;
        match reason {
            Some(reason) => {
                let error = format!("{FEED_ERROR}{reason}");
                let stored = run_policies::get(&mut tx.conn, &run).await?.and_then(|policy| policy.error);
                if stored.as_ref() != Some(&error) {
                    run_policies::set_error(&mut tx.conn, &run, &error, tx.now).await?;
                }
            }
            None => run_policies::clear_error(&mut tx.conn, &run, FEED_ERROR).await?,
        }
        Ok(())
    }
}
