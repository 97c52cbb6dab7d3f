//! Payloads and results keep every bit on their way, and damaged messages are refused.

use std::sync::Arc;

use curriculum::{Curriculum, SequencedProposal, Settings, TaskPlan};
use env_core::rollout::roll_out;
use env_core::{Recipe, Scenario, SeedSpace};
use proptest::prelude::*;

use crate::audit::AuditPayload;
use crate::envelope::{
    EnvelopeError, FencingToken, JobAddress, JobEnvelope, JobId, JobReply, MAX_ENVELOPE_BYTES, ReplyBody,
    ResultEnvelope,
};
use crate::prepare::ParentScenario;
use crate::prepare::job::{PendingProposal, PrepareOutcome, PreparePayload};
use crate::prepare::unsolvable::UnsolvableParams;
use crate::seeds::seed_of;
use crate::world_version::world_version;
use crate::{EpisodeBatch, JobContext, JobKind, JobOutput, JobPayload, LoggedEpisode};

const TASKS: [&str; 3] = ["kessler/survival", "docking/single", "tasking/scanning"];

fn run(job: &JobPayload) -> JobOutput {
    let unsolvable = UnsolvableParams::default();
    job.run(JobContext { unsolvable: &unsolvable, is_wanted: &|| true })
}

/// Two episodes of each world.
fn episodes() -> EpisodeBatch {
    let mut batch = EpisodeBatch::default();
    for name in TASKS {
        let task = env_core::task(name).unwrap();
        let recipe = Arc::new(Recipe::new(task).unwrap());
        for number in 0..2 {
            let scenario = Scenario::new(Arc::clone(&recipe), seed_of(SeedSpace::Training, 3, number, 0));
            let policy = task.policies().first().expect("a policy").name;
            let mut policy = task.policy(policy, &scenario, 0).unwrap();
            let log = roll_out(&scenario, &mut *policy).unwrap().log;
            batch.0.push(LoggedEpisode { scenario, log: Arc::new(log) });
        }
    }
    batch
}

fn proposals() -> PreparePayload {
    let plans = TASKS.map(|task| TaskPlan::standard(task).unwrap()).to_vec();
    let mut curriculum = Curriculum::new(0, Settings::ladder(plans)).unwrap();
    let pending =
        |SequencedProposal { seq, proposal }| PendingProposal { run_seed: 7, seq, proposal, parent: None };
    PreparePayload((0..4).map(|_| pending(curriculum.propose())).collect())
}

/// A proposal that edits the scenario of an earlier one.
fn edit() -> JobPayload {
    let mut pending = proposals().0.remove(0);
    let alone = run(&JobPayload::Prepare(PreparePayload(vec![pending.clone()])));
    let JobOutput::Prepare(output) = alone else { panic!("{alone:?}") };
    let PrepareOutcome::Scenario(prepared) = &output.0[0] else { panic!("{output:?}") };
    let levels = prepared.scenario.task().levels().clone();
    let (scenario, bracket) = (prepared.scenario.clone(), prepared.bracket.clone());
    pending.parent = Some(ParentScenario { scenario, bracket, is_contested: true, levels });
    pending.proposal.source = curriculum::ScenarioSource::Edited { of: pending.seq };
    JobPayload::Prepare(PreparePayload(vec![pending]))
}

#[test]
fn a_decoded_job_has_the_same_result_to_the_bit() {
    let batch = episodes();
    let scenarios = batch.0.iter().map(|episode| episode.scenario.clone()).collect();
    let jobs = [
        JobPayload::Audit(AuditPayload::Replays(batch.clone())),
        JobPayload::Audit(AuditPayload::Brackets(scenarios)),
        JobPayload::Critique(batch),
        edit(),
    ];
    let prepare = proposals().0.into_iter().map(|pending| JobPayload::Prepare(PreparePayload(vec![pending])));
    for job in jobs.into_iter().chain(prepare) {
        let output = run(&job);
        let decoded = JobPayload::decode(job.kind(), &job.encode().unwrap()).unwrap();
        assert_eq!(run(&decoded), output);
        assert_eq!(JobOutput::decode(&job, &output.encode().unwrap()).unwrap(), output);
        // Parts have the results of the whole, in order.
        let parts: Vec<JobOutput> = job.clone().split(2).iter().map(run).collect();
        assert_eq!(JobOutput::join(parts).unwrap(), output);
        for index in 0..job.len() {
            let item = job.item(index).unwrap();
            assert!(output.item_equals(index, &run(&item)), "{index} of {:?}", job.kind());
        }
        assert!(job.item(job.len()).is_none());
    }
}

#[test]
fn a_result_of_another_job_is_refused() {
    let batch = episodes();
    let critique = JobPayload::Critique(batch.clone());
    let replays = JobPayload::Audit(AuditPayload::Replays(batch));
    let bytes = run(&replays).encode().unwrap();
    assert!(JobOutput::decode(&critique, &bytes).is_err(), "another kind");
    assert!(JobOutput::decode(&replays.item(0).unwrap(), &bytes).is_err(), "more results than items");
    assert!(JobOutput::decode(&replays, &bytes).is_ok());
}

fn address(world: &str) -> JobAddress<'_> {
    let id = JobId { epoch: 1, number: 2 };
    JobAddress { world, server: "server", kind: JobKind::Audit, id, token: FencingToken(3) }
}

#[test]
fn envelopes_are_bounded_and_carry_the_token() {
    let job = JobEnvelope::read(&JobEnvelope::write(address("w"), vec![7; 100]).unwrap()).unwrap();
    assert_eq!((job.body(), job.world.as_str(), job.token), (&[7; 100][..], "w", FencingToken(3)));
    let reply = JobReply::Done { body: ReplyBody::new(vec![1, 2]), micros: 5 };
    let result = ResultEnvelope::read(&ResultEnvelope::write(&job, "worker", reply).unwrap()).unwrap();
    assert_eq!((result.id, result.token, result.worker.as_str()), (job.id, job.token, "worker"));
    // One byte of the body takes one byte of the message.
    assert!(JobEnvelope::write(address("w"), vec![255; MAX_ENVELOPE_BYTES - 100]).is_ok());
    let large = JobEnvelope::write(address("w"), vec![0; MAX_ENVELOPE_BYTES]);
    assert!(matches!(large, Err(EnvelopeError::TooLarge { .. })));
}

/// An entry of one byte can take hundreds in memory.
#[test]
fn long_lists_are_refused() {
    let job = JobPayload::Audit(AuditPayload::Brackets(vec![episodes().0[0].scenario.clone()]));
    let message = |entries: usize| {
        let none: Vec<Option<u8>> = vec![None; entries];
        rmp_serde::to_vec(&std::collections::BTreeMap::from([("Brackets", none)])).unwrap()
    };
    assert!(JobOutput::decode(&job, &message(1)).is_ok());
    let refused = JobOutput::decode(&job, &message(1 << 20)).unwrap_err().to_string();
    assert!(refused.contains("at most 65536 entries"), "{refused}");
}

#[test]
fn world_version_is_stable_within_a_program() {
    assert_eq!(world_version(), world_version());
    assert!(world_version().starts_with(env!("CARGO_PKG_VERSION")) && world_version().len() < 40);
}

proptest! {
    #[test]
    fn damaged_messages_are_refused_without_a_panic(bytes in proptest::collection::vec(any::<u8>(), 0..200)) {
        let _ = JobEnvelope::read(&bytes);
        let _ = ResultEnvelope::read(&bytes);
        for kind in JobKind::ALL {
            let _ = JobPayload::decode(kind, &bytes);
        }
    }

    #[test]
    fn changed_jobs_are_refused_or_run(at in 0usize..4000, to in any::<u8>()) {
        static ENCODED: std::sync::LazyLock<Vec<u8>> =
            std::sync::LazyLock::new(|| JobPayload::Critique(EpisodeBatch(vec![episodes().0.remove(0)])).encode().unwrap());
        let mut bytes = ENCODED.clone();
        let at = at % bytes.len();
        bytes[at] = to;
        if let Ok(job) = JobPayload::decode(JobKind::Critique, &bytes) {
            let _ = run(&job);
        }
    }
}
