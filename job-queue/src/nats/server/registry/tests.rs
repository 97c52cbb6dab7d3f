//! Workers join, are refused, and are expelled.

use std::sync::Arc;

use env_core::Recipe;
use jobs::design::{DesignJob, JobDesigner};
use jobs::envelope::ReplyBody;
use jobs::{JobOutput, JobPayload};

use super::*;
use crate::nats::server::unverified::{MAX_UNVERIFIED, MAX_UNVERIFIED_DESIGNS};

fn heartbeat(id: &str, host: &str, world: &str) -> Heartbeat {
    Heartbeat {
        id: id.to_owned(),
        host: host.to_owned(),
        version: "1".to_owned(),
        world: world.to_owned(),
        kinds: vec!["audit".to_owned(), "later".to_owned()],
        concurrency: 4,
        chat_calls: 0,
        chat_model: None,
        llm_designs: 0,
        active: vec![JobId { epoch: 1, number: 2 }],
        is_waiting: false,
        is_leaving: false,
    }
}

fn unverified() -> UnverifiedJob {
    let job = JobPayload::Critique(jobs::EpisodeBatch::default());
    UnverifiedJob {
        job: Arc::new(job),
        output: JobOutput::Critique(jobs::critique::CritiqueOutput(Vec::new())),
        bytes: 10,
    }
}

fn unverified_design() -> UnverifiedDesign {
    let recipe = Arc::new(Recipe::at_level(env_core::task("kessler/survival").unwrap(), 2).unwrap());
    let job = DesignJob {
        run: "run".to_owned(),
        designer: JobDesigner::Procedural,
        brief: designer::DesignBrief::new(recipe, 2, 7),
        archive: Vec::new(),
    };
    UnverifiedDesign { job: Arc::new(job), body: ReplyBody::new(Vec::new()), bytes: 10 }
}

#[test]
fn a_worker_of_other_worlds_is_refused_with_both_versions() {
    let mut registry = WorkerRegistry::new("s".to_owned(), "w1");
    let HeartbeatReaction { answer, notice } = registry.note_heartbeat(heartbeat("a-1", "a", "w2"));
    let Some(ControlMessage::Refused { reason }) = answer else { panic!("{answer:?}") };
    assert!(reason.contains("w1") && reason.contains("w2") && reason.contains("a-1"), "{reason}");
    assert!(matches!(notice, Some(QueueNotice::Refused(..))));
    // It is announced once, and answered every time.
    let again = registry.note_heartbeat(heartbeat("a-1", "a", "w2"));
    assert!(again.notice.is_none() && again.answer.is_some());
    assert!(registry.served_kinds().is_empty() && !registry.may_work("a-1"));
}

#[test]
fn a_worker_that_waits_is_welcomed_again() {
    let mut registry = WorkerRegistry::new("s".to_owned(), "w1");
    registry.note_heartbeat(heartbeat("a-1", "a", "w1"));
    assert_eq!(registry.note_heartbeat(heartbeat("a-1", "a", "w1")).answer, None);
    registry.stall_all();
    assert_eq!(registry.slots(JobKind::Audit), 0);
    let waiting = Heartbeat { is_waiting: true, ..heartbeat("a-1", "a", "w1") };
    let HeartbeatReaction { answer, notice } = registry.note_heartbeat(waiting);
    assert!(matches!(answer, Some(ControlMessage::Welcome { .. })));
    assert!(matches!(notice, Some(QueueNotice::Joined(_))));
}

#[test]
fn an_expelled_host_stays_away_and_returns_its_jobs() {
    let mut registry = WorkerRegistry::new("s".to_owned(), "w1");
    for id in ["a-1", "a-2"] {
        let reaction = registry.note_heartbeat(heartbeat(id, "a", "w1"));
        assert!(matches!(reaction.answer, Some(ControlMessage::Welcome { .. })));
    }
    assert_eq!((registry.slots(JobKind::Audit), registry.slots(JobKind::Prepare)), (8, 0));
    assert!(registry.count_job("a-1", unverified()) && registry.count_design("a-1", 0, unverified_design()));
    registry.count_agreement("a-1", 1);
    assert!(registry.count_job("a-1", unverified()) && registry.count_job("a-2", unverified()));
    // Each layout that is judged again counts for the earlier requests of its worker only.
    assert!(registry.count_design("a-1", 1, unverified_design()));
    assert!(registry.count_design("a-1", 0, unverified_design()));
    assert!(registry.count_design("a-2", 0, unverified_design()));
    let ExpelledWorker { identity, unverified: work } = registry.expel("a-1", "wrong").unwrap();
    assert_eq!((identity.host.as_str(), work.jobs.len(), work.designs.len()), ("a", 2, 3));
    assert!(registry.expel("a-1", "wrong").is_none(), "it is expelled once");
    let is_used =
        registry.count_job("a-2", unverified()) || registry.count_design("a-2", 0, unverified_design());
    assert!(!is_used, "a result that was on its way is not used");
    assert!(!registry.may_work("a-2") && registry.slots(JobKind::Audit) == 0);
    let reaction = registry.note_heartbeat(heartbeat("a-3", "a", "w1"));
    assert!(matches!(reaction.answer, Some(ControlMessage::Expelled { .. })));
}

#[test]
fn results_are_verified_at_the_latest_when_many_are_not() {
    let mut registry = WorkerRegistry::new("s".to_owned(), "w1");
    assert!(registry.must_verify("unknown"));
    registry.note_heartbeat(heartbeat("a-1", "a", "w1"));
    for _ in 0..MAX_UNVERIFIED {
        assert!(!registry.must_verify("a-1"));
        assert!(registry.count_job("a-1", unverified()));
    }
    assert!(registry.must_verify("a-1"));
    registry.count_agreement("a-1", 1);
    assert!(!registry.must_verify("a-1"));
}

#[test]
fn a_layout_is_judged_again_at_the_latest_when_many_are_not() {
    let mut registry = WorkerRegistry::new("s".to_owned(), "w1");
    assert!(registry.must_judge("unknown"));
    registry.note_heartbeat(heartbeat("a-1", "a", "w1"));
    for _ in 0..MAX_UNVERIFIED_DESIGNS {
        assert!(!registry.must_judge("a-1"));
        assert!(registry.count_design("a-1", 0, unverified_design()));
    }
    assert!(registry.must_judge("a-1") && !registry.must_verify("a-1"));
    assert!(registry.count_design("a-1", 1, unverified_design()));
    assert!(!registry.must_judge("a-1"));
}
