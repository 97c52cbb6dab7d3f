//! Jobs of every form of preparing, replaying and criticising, and their results.

use std::sync::{Arc, LazyLock};

use curriculum::{Curriculum, ScenarioSource, SequencedProposal, Settings, TaskPlan};
use env_core::rollout::roll_out;
use env_core::{Recipe, Scenario, SeedSpace};
use jobs::audit::AuditPayload;
use jobs::prepare::ParentScenario;
use jobs::prepare::job::{PendingProposal, PrepareOutcome, PreparePayload};
use jobs::prepare::unsolvable::UnsolvableParams;
use jobs::seeds::seed_of;
use jobs::{EpisodeBatch, JobContext, JobOutput, JobPayload, LoggedEpisode};

const TASKS: [&str; 2] = ["kessler/survival", "docking/single"];

/// Returns the result of a job.
pub(super) fn output_of(job: &JobPayload) -> JobOutput {
    let unsolvable = UnsolvableParams::default();
    job.run(JobContext { unsolvable: &unsolvable, is_wanted: &|| true })
}

/// An episode of each task, in which the agent does nothing.
fn episodes() -> EpisodeBatch {
    let episode = |task: &str| {
        let task = env_core::task(task).expect("the task exists");
        let recipe = Recipe::new(task).expect("the task has params");
        let scenario = Scenario::new(recipe, seed_of(SeedSpace::Training, 3, 1, 0));
        let policy = task.policies().first().expect("the task has a policy").name;
        let mut policy = task.policy(policy, &scenario, 0).expect("the policy starts");
        let log = roll_out(&scenario, &mut *policy).expect("the episode ends").log;
        LoggedEpisode { scenario, log: Arc::new(log) }
    };
    EpisodeBatch(TASKS.map(episode).to_vec())
}

/// Jobs that replay, and that compute brackets.
pub(super) fn audits() -> Vec<JobPayload> {
    static AUDITS: LazyLock<Vec<JobPayload>> = LazyLock::new(|| {
        let batch = episodes();
        let scenarios = batch.0.iter().map(|episode| episode.scenario.clone()).collect();
        [AuditPayload::Replays(batch), AuditPayload::Brackets(scenarios)].map(JobPayload::Audit).to_vec()
    });
    AUDITS.clone()
}

/// A job that criticises.
pub(super) fn critiques() -> Vec<JobPayload> {
    static CRITIQUES: LazyLock<Vec<JobPayload>> = LazyLock::new(|| vec![JobPayload::Critique(episodes())]);
    CRITIQUES.clone()
}

/// A job that draws a scenario, and one that edits it.
pub(super) fn prepares() -> Vec<JobPayload> {
    static PREPARES: LazyLock<Vec<JobPayload>> = LazyLock::new(|| {
        let plans = TASKS.map(|task| TaskPlan::standard(task).expect("the task has a plan")).to_vec();
        let mut curriculum = Curriculum::new(0, Settings::ladder(plans)).expect("the settings are valid");
        let SequencedProposal { seq, proposal } = curriculum.propose();
        let pending = PendingProposal { run_seed: 7, seq, proposal, parent: None };
        let draw = JobPayload::Prepare(PreparePayload(vec![pending.clone()]));
        let JobOutput::Prepare(output) = output_of(&draw) else { panic!("the result is of another kind") };
        let Some(PrepareOutcome::Scenario(prepared)) = output.0.first() else {
            panic!("the proposal has no scenario")
        };
        let (scenario, bracket) = (prepared.scenario.clone(), prepared.bracket.clone());
        let levels = scenario.task().levels().clone();
        let parent = ParentScenario { scenario, bracket, is_contested: true, levels };
        let mut edit = PendingProposal { parent: Some(parent), ..pending };
        edit.proposal.source = ScenarioSource::Edited { of: edit.seq };
        vec![draw, JobPayload::Prepare(PreparePayload(vec![edit]))]
    });
    PREPARES.clone()
}
