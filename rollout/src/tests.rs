//! Jobs and groups keep every bit on their way, and damaged messages are refused.

use std::sync::{Arc, LazyLock};

use env_core::{Recipe, Scenario, SeedSpace};
use jobs::JobKind;
use jobs::seeds::seed_of;
use proptest::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::{
    ChatSampling, PolicySources, RolledOutGroup, RolloutFailure, RolloutJob, RolloutPolicy, RolloutWireError,
};

const FIXTURES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/fixtures/onnx");

fn job(task: &str, policy: &str) -> RolloutJob {
    let recipe = Recipe::new(env_core::task(task).unwrap()).unwrap();
    RolloutJob {
        run: "run".to_owned(),
        policy_version: 3,
        scenario: Scenario::new(recipe, seed_of(SeedSpace::Training, 3, 1, 0)),
        policy: RolloutPolicy::Reference(policy.to_owned()),
        seeds: vec![1, (1 << 51) - 1],
        records_observations: true,
    }
}

fn threads() -> ThreadPool {
    ThreadPoolBuilder::new().num_threads(2).build().unwrap()
}

fn roll_out(job: RolloutJob, sources: &PolicySources) -> Result<RolledOutGroup, RolloutFailure> {
    let runtime = tokio::runtime::Builder::new_current_thread().build().unwrap();
    runtime.block_on(sources.roll_out(&Arc::new(job), &threads()))
}

fn text(group: &RolledOutGroup) -> String {
    serde_json::to_string(group).unwrap()
}

#[test]
fn decoded_jobs_and_groups_keep_their_bits() {
    for (task, policy) in
        [("kessler/survival", "random"), ("docking/single", "random"), ("tasking/scanning", "hold")]
    {
        let job = job(task, policy);
        let decoded = RolloutJob::decode(&job.encode().unwrap()).unwrap();
        assert_eq!((decoded.policy.kind(), decoded.policy_version), (JobKind::RolloutBuiltIn, 3));
        let group = roll_out(job.clone(), &PolicySources::default()).unwrap();
        let of_decoded = roll_out(decoded, &PolicySources::default()).unwrap();
        assert_eq!(text(&group), text(&of_decoded));
        let sent = RolledOutGroup::decode(&job, &group.clone().encode().unwrap()).unwrap();
        assert_eq!(text(&sent), text(&group));
        let logs = |group: &RolledOutGroup| {
            group
                .outcomes
                .iter()
                .map(|outcome| outcome.episode.clone().unwrap().log.encode())
                .collect::<Vec<_>>()
        };
        assert_eq!(logs(&sent), logs(&group));
    }
}

#[test]
fn settings_of_chat_travel_and_endpoints_do_not() {
    let sampling = ChatSampling { temperature: Some(0.1 + 0.2), history: 2, max_tokens: None };
    let chat = RolloutJob { policy: RolloutPolicy::Chat(sampling), ..job("kessler/survival", "") };
    let decoded = RolloutJob::decode(&chat.encode().unwrap()).unwrap();
    assert_eq!((&decoded.policy, decoded.policy.kind()), (&chat.policy, JobKind::RolloutChat));
    assert!(matches!(roll_out(decoded, &PolicySources::default()), Err(RolloutFailure::NoModel)));
}

#[test]
fn another_file_under_the_same_name_is_refused() {
    let folder = policy_files::PolicyFolder::new(FIXTURES.into());
    let sources = PolicySources { endpoint: None, folder: folder.clone() };
    let named = policy_files::PolicyReference::parse("onnx:tracks_continuous.onnx");
    let pinned = folder.pin(&named).unwrap().to_string();
    let file = job("kessler/survival", &pinned);
    assert_eq!(file.policy.kind(), JobKind::RolloutFile);
    assert!(roll_out(file, &sources).unwrap().outcomes.iter().all(|outcome| outcome.episode.is_ok()));
    for (policy, words) in [
        ("onnx:tracks_continuous.onnx@000000000000", "000000000000"),
        ("onnx:missing.onnx@000000000000", "missing.onnx cannot be read"),
    ] {
        let refused = roll_out(job("kessler/survival", policy), &sources).unwrap_err().to_string();
        assert!(refused.contains(words), "{refused}");
    }
}

/// Change of a group.
type Distortion = fn(&mut RolledOutGroup);

/// Group of `a_decoded_job…` with a change.
fn changed(
    job: &RolloutJob,
    change: impl FnOnce(&mut RolledOutGroup),
) -> Result<RolledOutGroup, RolloutWireError> {
    let mut group = roll_out(job.clone(), &PolicySources::default()).unwrap();
    change(&mut group);
    RolledOutGroup::decode(job, &group.encode().unwrap())
}

#[test]
fn a_group_that_contradicts_its_job_or_its_logs_is_refused() {
    let job = job("kessler/survival", "random");
    assert!(changed(&job, |_| ()).is_ok());
    let faults: [(&str, Distortion); 5] = [
        ("fewer episodes", |group| drop(group.outcomes.pop())),
        ("another policy", |group| group.outcomes[0].metrics = Some(api_types::TrajectoryMetrics::default())),
        ("no amount", |group| group.cost = -1.0),
        ("other actions", |group| drop(group.outcomes[1].episode.as_mut().unwrap().steps.pop())),
        ("other actions", |group| group.outcomes[0].episode.as_mut().unwrap().steps[0].action = None),
    ];
    for (words, change) in faults {
        let refused = changed(&job, change).unwrap_err().to_string();
        assert!(refused.contains(words), "{refused}");
    }
}

static ENCODED: LazyLock<(RolloutJob, Vec<u8>, Vec<u8>)> = LazyLock::new(|| {
    let job = RolloutJob { records_observations: false, ..job("kessler/survival", "hold") };
    let group = roll_out(job.clone(), &PolicySources::default()).unwrap();
    let json = serde_json::to_vec(&group).unwrap();
    (job.clone(), job.encode().unwrap(), json)
});

proptest! {
    #[test]
    fn damaged_messages_are_refused_without_a_panic(bytes in proptest::collection::vec(any::<u8>(), 0..200)) {
        prop_assert!(RolloutJob::decode(&bytes).is_err());
        prop_assert!(RolledOutGroup::decode(&ENCODED.0, &bytes).is_err());
        let compressed = zstd::bulk::compress(&bytes, 1).unwrap();
        prop_assert!(RolledOutGroup::decode(&ENCODED.0, &compressed).is_err());
    }

    #[test]
    fn changed_messages_are_refused_or_read(at in any::<usize>(), to in any::<u8>()) {
        let (job, encoded, group) = &*ENCODED;
        let mut bytes = encoded.clone();
        bytes[at % encoded.len()] = to;
        let _ = RolloutJob::decode(&bytes);
        let mut json = group.clone();
        json[at % group.len()] = to;
        let _ = RolledOutGroup::decode(job, &zstd::bulk::compress(&json, 1).unwrap());
    }
}
