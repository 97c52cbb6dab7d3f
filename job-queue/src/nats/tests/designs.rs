//! Designs by workers: the same layouts as in this process, and none that is wrong.

use std::sync::Arc;

use designer::procedural::ProceduralDesigner;
use designer::{DesignBrief, DesignOutcome};
use jobs::design::{DesignJob, DesignOutput, JobDesigner};
use jobs::envelope::{JobReply, ReplyBody};

use super::fake_worker::FakeWorker;
use super::*;
use crate::nats::server::RemoteDesignError;

fn design_job(designer: JobDesigner) -> DesignJob {
    let task = env_core::task(TASK).unwrap();
    let recipe = Arc::new(Recipe::at_level(task, 2).unwrap());
    let brief = DesignBrief::new(recipe, 2, 7).at_level(task.levels(), 2);
    DesignJob { run: "run".to_owned(), designer, brief, archive: Vec::new() }
}

fn designed_here(job: &DesignJob) -> DesignOutcome {
    ProceduralDesigner::design_layouts(&job.brief, &mut job.gate().unwrap())
}

#[tokio::test(flavor = "multi_thread")]
async fn a_worker_designs_the_same_layouts_as_this_process() {
    let Some(nats) = NatsServer::start() else { return };
    let (queue, _notices) = start_queue(&nats, 0.5, LONG);
    let designs = queue.designs();
    assert!(!designs.is_served(JobKind::DesignProcedural));
    let worker = TestWorker::start(&nats, "host");
    wait_for_workers(&queue, 1).await;
    assert!(designs.has_room(JobKind::DesignProcedural));
    let job = Arc::new(design_job(JobDesigner::Procedural));
    let expected = designed_here(&job);
    for _ in 0..4 {
        let design = designs.design(Arc::clone(&job)).await.unwrap();
        assert_eq!(DesignOutput::from(&design.result.outcome), DesignOutput::from(&expected));
        assert_eq!((design.result.designer, design.result.gate.archive().len()), ("procedural", 2));
        design.receipt.acknowledge();
    }
    let counters = queue.status().counters;
    assert_eq!((counters.done_remotely, counters.done_locally), (4, 0));
    assert!(counters.verified_items > 0);
    // The worker has no language model: it announces none, and refuses such a job.
    assert!(!designs.is_served(JobKind::DesignLlm) || !designs.has_room(JobKind::DesignLlm));
    drop(worker);
}

/// Designs a job and changes the result.
fn forged(job: &jobs::envelope::JobEnvelope, distort: impl Fn(&mut DesignOutput)) -> JobReply {
    let job = DesignJob::decode(job.body()).unwrap();
    let mut output = DesignOutput::from(&designed_here(&job));
    distort(&mut output);
    JobReply::Done { body: ReplyBody::new(output.encode().unwrap()), micros: 1 }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_worker_with_wrong_layouts_is_expelled() {
    use designer::reported::ReportedVerdict;
    let Some(nats) = NatsServer::start() else { return };
    let (queue, mut notices) = start_queue(&nats, 0.0, LONG);
    let worker = FakeWorker::join_for(&nats, "liar", JobKind::DesignProcedural).await;
    wait_for_workers(&queue, 1).await;
    let designs = queue.designs();
    let serve = async {
        let (envelope, acker) = worker.take(&nats).await;
        let reply = forged(&envelope, |output| {
            for layout in &mut output.layouts {
                if let ReportedVerdict::Admitted { bracket, .. } = &mut layout.verdict {
                    bracket.reference.score += 0.25;
                }
            }
        });
        worker.send(&nats, &envelope, reply, "forged").await;
        acker.ack().await.unwrap();
    };
    let job = Arc::new(design_job(JobDesigner::Procedural));
    let (design, ()) = tokio::join!(designs.design(job), serve);
    let Err(RemoteDesignError::Refused(reason)) = design else { panic!("the layouts were used") };
    assert!(reason.contains("wrong"), "{reason}");
    assert!(!designs.is_served(JobKind::DesignProcedural));
    let mut is_announced = false;
    while let Ok(notice) = notices.try_recv() {
        is_announced |= matches!(notice, QueueNotice::Expelled(..));
    }
    assert!(is_announced);
}
