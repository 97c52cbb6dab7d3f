//! Designs by workers: the same layouts as in this process, and none that is wrong.

use std::sync::Arc;

use designer::procedural::ProceduralDesigner;
use designer::reported::ReportedVerdict;
use designer::{DesignBrief, DesignOutcome};
use jobs::design::{DesignJob, DesignOutput, JobDesigner};
use jobs::envelope::{JobReply, ReplyBody};

use super::fake_worker::FakeWorker;
use super::*;
use crate::nats::server::{DesignQueue, RemoteDesign, RemoteDesignError};
use crate::status::WrongLayout;

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

/// Raises the score of every admitted layout, which the check of each result finds.
fn raise_references(output: &mut DesignOutput) {
    for layout in &mut output.layouts {
        if let ReportedVerdict::Admitted { bracket, .. } = &mut layout.verdict {
            bracket.reference.score += 0.25;
        }
    }
}

/// Changes the panel of the first admitted layout, which only a second judgement finds.
fn lower_panel(output: &mut DesignOutput) {
    let first = output.layouts.iter_mut().find(|layout| layout.is_admitted()).unwrap();
    let ReportedVerdict::Admitted { bracket, .. } = &mut first.verdict else { panic!("admitted") };
    bracket.panel[1].score -= 1e-9;
}

/// Lets a fake worker design, with changes of its result.
async fn design_forged(
    nats: &NatsServer,
    worker: &FakeWorker,
    designs: &DesignQueue,
    job: &Arc<DesignJob>,
    distort: impl Fn(&mut DesignOutput),
) -> Result<RemoteDesign, RemoteDesignError> {
    let serve = async {
        let (envelope, acker) = worker.take(nats).await;
        worker.send(nats, &envelope, forged(&envelope, distort), &envelope.id.to_string()).await;
        acker.ack().await.unwrap();
    };
    tokio::join!(designs.design(Arc::clone(job)), serve).0
}

#[tokio::test(flavor = "multi_thread")]
async fn earlier_layouts_of_an_expelled_worker_are_judged_again() {
    let Some(nats) = NatsServer::start() else { return };
    let (queue, mut notices) = start_queue(&nats, 0.0, LONG);
    let worker = FakeWorker::join_for(&nats, "liar", JobKind::DesignProcedural).await;
    wait_for_workers(&queue, 1).await;
    let designs = queue.designs();
    let job = Arc::new(design_job(JobDesigner::Procedural));
    let used = design_forged(&nats, &worker, &designs, &job, lower_panel).await.unwrap().result.outcome;
    assert_eq!(used.admitted(), 2, "nothing was judged again");
    let Err(RemoteDesignError::Refused(reason)) =
        design_forged(&nats, &worker, &designs, &job, raise_references).await
    else {
        panic!("the layouts were used")
    };
    assert!(reason.contains("wrong"), "{reason}");
    assert!(!designs.is_served(JobKind::DesignProcedural));
    let recomputed = async {
        let mut is_announced = false;
        loop {
            match notices.recv().await.unwrap() {
                QueueNotice::Expelled(..) => is_announced = true,
                QueueNotice::Recomputed(recomputed) if is_announced => return recomputed,
                _ => {}
            }
        }
    };
    let found = tokio::time::timeout(DEADLINE, recomputed).await.unwrap();
    let wrong = used.judged.iter().find_map(|judged| judged.verdict.as_ref().ok()).unwrap();
    let wrong = WrongLayout { run: "run".to_owned(), task: TASK.to_owned(), scenario: wrong.scenario().id() };
    assert_eq!((found.items, found.wrong.len(), found.wrong_layouts), (2, 0, vec![wrong]));
}
