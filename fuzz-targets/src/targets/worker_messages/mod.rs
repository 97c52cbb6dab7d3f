//! Messages between servers and workers: envelopes of jobs and results, the payloads of all kinds of jobs, and heartbeats.
//!
//! A server reads results and heartbeats that any worker of its NATS account can forge, and a worker reads jobs. `examples` has jobs with results of
//! all kinds, `models` the messages of designs and rollouts, and `membership` those without jobs.

mod examples;
mod membership;
mod models;

use std::fmt::Debug;

use jobs::envelope::{
    FencingToken, JobAddress, JobEnvelope, JobId, JobReply, MAX_ENVELOPE_BYTES, ReplyBody, ResultEnvelope,
};
use jobs::{JobKind, JobOutput, JobPayload};

use self::examples::{audits, critiques, output_of, prepares};
use crate::target::Target;

pub(super) const TARGETS: &[Target] = &[
    Target::new("job_envelope", job_envelope, job_envelope_seeds),
    Target::new("result_envelope", result_envelope, result_envelope_seeds),
    Target::new("prepare_job", prepare_job, || seeds(&prepares())),
    Target::new("prepare_result", prepare_result, || result_seeds(&prepares())),
    Target::new("audit_job", audit_job, || seeds(&audits())),
    Target::new("audit_result", audit_result, || result_seeds(&audits())),
    Target::new("critique_job", critique_job, || seeds(&critiques())),
    Target::new("critique_result", critique_result, || result_seeds(&critiques())),
    Target::new("design_job", models::design_job, models::design_job_seeds),
    Target::new("design_result", models::design_result, models::design_result_seeds),
    Target::new("rollout_job", models::rollout_job, models::rollout_job_seeds),
    Target::new("rollout_result", models::rollout_result, models::rollout_result_seeds).divided_by(20),
    Target::new("heartbeat", membership::heartbeat, membership::heartbeat_seeds),
    Target::new("control_message", membership::control_message, membership::control_message_seeds),
    Target::new("run_state", membership::run_state, membership::run_state_seeds),
];

/// A value that was read is the same after it is written and read again. Both forms are compared, since numbers may be no numbers.
fn is_stable<T, E: Debug>(
    value: Result<T, E>,
    write: impl Fn(&T) -> Result<Vec<u8>, E>,
    read: impl Fn(&[u8]) -> Result<T, E>,
) -> bool {
    let Ok(value) = value else { return false };
    let written = write(&value).expect("a value that was read can be written");
    let again = read(&written).expect("a written value can be read");
    assert!(write(&again).is_ok_and(|twice| twice == written), "the written form differs");
    true
}

/// An envelope keeps its address and its body.
fn job_envelope(bytes: &[u8]) -> bool {
    let Ok(envelope) = JobEnvelope::read(bytes) else { return false };
    assert!(envelope.body().len() <= bytes.len(), "the body is larger than its message");
    let JobEnvelope { world, server, kind, id, token, .. } = &envelope;
    let address = JobAddress { world, server, kind: *kind, id: *id, token: *token };
    let written = JobEnvelope::write(address, envelope.body().to_vec()).expect("it is small");
    assert!(written.len() <= MAX_ENVELOPE_BYTES);
    assert_eq!(JobEnvelope::read(&written).expect("a written envelope can be read"), envelope);
    true
}

/// An envelope with a result keeps it.
fn result_envelope(bytes: &[u8]) -> bool {
    let Ok(result) = ResultEnvelope::read(bytes) else { return false };
    if let JobReply::Done { body, .. } = &result.reply {
        assert!(body.bytes().len() <= bytes.len(), "the body is larger than its message");
    }
    let job = JobEnvelope::write(address(JobKind::Audit, result.id, result.token), Vec::new());
    let job = JobEnvelope::read(&job.expect("it is small")).expect("a written envelope can be read");
    let written = ResultEnvelope::write(&job, &result.worker, result.reply.clone()).expect("it is small");
    assert_eq!(ResultEnvelope::read(&written).expect("a written envelope can be read"), result);
    true
}

const fn address(kind: JobKind, id: JobId, token: FencingToken) -> JobAddress<'static> {
    JobAddress { world: "0.1.0-1-0123456789ab", server: "server", kind, id, token }
}

fn envelopes() -> Vec<JobEnvelope> {
    let envelope = |(kind, number): (JobKind, u64)| {
        let id = JobId { epoch: 1_700_000_000_000, number };
        let written = JobEnvelope::write(address(kind, id, FencingToken(u64::MAX - number)), vec![7; 9]);
        JobEnvelope::read(&written.expect("it is small")).expect("a written envelope can be read")
    };
    JobKind::ALL.into_iter().zip(1..).map(envelope).collect()
}

fn job_envelope_seeds() -> Vec<Vec<u8>> {
    let write = |envelope: &JobEnvelope| {
        let address = address(envelope.kind, envelope.id, envelope.token);
        JobEnvelope::write(address, envelope.body().to_vec()).expect("it is small")
    };
    envelopes().iter().map(write).collect()
}

fn result_envelope_seeds() -> Vec<Vec<u8>> {
    let replies = [
        JobReply::Done { body: ReplyBody::new(vec![1, 2, 3]), micros: 5 },
        JobReply::Failed("the computation panicked".to_owned()),
        JobReply::Refused("the job is of other worlds".to_owned()),
        JobReply::Superseded,
    ];
    let write = |(job, reply): (JobEnvelope, JobReply)| {
        ResultEnvelope::write(&job, "host-0a1b2c", reply).expect("it is small")
    };
    envelopes().into_iter().zip(replies).map(write).collect()
}

fn payload(kind: JobKind, bytes: &[u8]) -> bool {
    is_stable(JobPayload::decode(kind, bytes), JobPayload::encode, |written| {
        JobPayload::decode(kind, written)
    })
}

fn prepare_job(bytes: &[u8]) -> bool {
    payload(JobKind::Prepare, bytes)
}

fn audit_job(bytes: &[u8]) -> bool {
    payload(JobKind::Audit, bytes)
}

fn critique_job(bytes: &[u8]) -> bool {
    payload(JobKind::Critique, bytes)
}

/// A result fits one of the jobs, or is refused.
fn result(jobs: &[JobPayload], bytes: &[u8]) -> bool {
    let accepted = jobs.iter().map(|job| {
        let decode = |bytes: &[u8]| JobOutput::decode(job, bytes);
        let output = decode(bytes);
        assert!(output.as_ref().map_or(true, |output| output.len() == job.len()), "it has other results");
        is_stable(output, JobOutput::encode, decode)
    });
    accepted.fold(false, |any, accepted| any | accepted)
}

fn prepare_result(bytes: &[u8]) -> bool {
    result(&prepares(), bytes)
}

fn audit_result(bytes: &[u8]) -> bool {
    result(&audits(), bytes)
}

fn critique_result(bytes: &[u8]) -> bool {
    result(&critiques(), bytes)
}

fn seeds(jobs: &[JobPayload]) -> Vec<Vec<u8>> {
    jobs.iter().map(|job| job.encode().expect("a job can be written")).collect()
}

fn result_seeds(jobs: &[JobPayload]) -> Vec<Vec<u8>> {
    jobs.iter().map(|job| output_of(job).encode().expect("a result can be written")).collect()
}
