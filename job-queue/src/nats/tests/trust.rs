//! Workers that compute other worlds, or wrong results.

use jobs::audit::AuditOutput;

use super::fake_worker::FakeWorker;
use super::*;
use crate::status::Recomputation;

#[tokio::test(flavor = "multi_thread")]
async fn a_worker_of_other_worlds_is_refused_on_both_sides() {
    let Some(nats) = NatsServer::start() else { return };
    let (queue, mut notices) = start_queue(&nats, 0.0, LONG);
    let mut worker = TestWorker::start_in_world(&nats, "old", "0.0.1-1-abc");
    let ended = tokio::time::timeout(DEADLINE, &mut worker.end).await.unwrap().unwrap();
    let message = ended.unwrap_err().to_string();
    for part in ["refused", "0.0.1-1-abc", world_version(), "install the same version"] {
        assert!(message.contains(part), "{message}");
    }
    let mut reason = None;
    while let Ok(notice) = notices.try_recv() {
        if let QueueNotice::Refused(identity, text) = notice {
            assert_eq!(identity.host, "old");
            reason = Some(text);
        }
    }
    assert!(reason.unwrap().contains("0.0.1-1-abc"));
    // It is listed, and gets no job.
    assert_eq!(queue.status().workers.len(), 1);
    let jobs = [replays(0, 1)];
    assert_eq!(outputs(&queue, &jobs).await, local_outputs(&jobs).await);
    assert_eq!(queue.status().counters.sent, 0);
}

/// Adds to the scores of a result.
fn raise_scores(output: &mut JobOutput) {
    if let JobOutput::Audit(AuditOutput::Replays(outcomes)) = output {
        outcomes.iter_mut().flatten().for_each(|outcome| outcome.score += 0.25);
    }
}

/// Serves audits with raised scores until it gets no more.
async fn serve_raised(worker: &FakeWorker, nats: &NatsServer) {
    loop {
        let (envelope, acker) = worker.take(nats).await;
        let reply = FakeWorker::reply(&envelope, raise_scores);
        worker.send(nats, &envelope, reply, &envelope.id.to_string()).await;
        acker.ack().await.unwrap();
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_verified_result_that_is_wrong_is_never_used() {
    let Some(nats) = NatsServer::start() else { return };
    let (queue, mut notices) = start_queue(&nats, 1.0, LONG);
    let worker = FakeWorker::join(&nats, "liar").await;
    wait_for_workers(&queue, 1).await;
    let jobs = [replays(0, 3), replays(3, 3)];
    let done = tokio::select! {
        done = outputs(&queue, &jobs) => done,
        () = serve_raised(&worker, &nats) => unreachable!(),
    };
    assert_eq!(done, local_outputs(&jobs).await);
    let listed = queue.status().workers.remove(0);
    assert_eq!((listed.state, listed.jobs, listed.errors), (crate::status::WorkerState::Expelled, 0, 1));
    assert!(listed.reason.unwrap().contains("differs from the server's"));
    let mut is_announced = false;
    while let Ok(notice) = notices.try_recv() {
        is_announced |= matches!(notice, QueueNotice::Expelled(..));
    }
    assert!(is_announced);
    // From now on the server is alone.
    let sent = queue.status().counters.sent;
    assert_eq!(outputs(&queue, &jobs).await, done);
    assert_eq!(queue.status().counters.sent, sent);
}

#[tokio::test(flavor = "multi_thread")]
async fn the_results_of_an_expelled_worker_since_the_agreement_are_recomputed() {
    let Some(nats) = NatsServer::start() else { return };
    // No result is drawn: the check comes when the most unverified jobs are reached.
    let (queue, mut notices) = start_queue(&nats, 0.0, LONG);
    let worker = FakeWorker::join(&nats, "liar").await;
    wait_for_workers(&queue, 1).await;
    let jobs: Vec<_> = (0..260).map(|number| replays(number % 20, 1)).collect();
    let run = async {
        for part in jobs.chunks(20) {
            outputs(&queue, part).await;
        }
    };
    tokio::select! {
        () = run => {}
        () = serve_raised(&worker, &nats) => unreachable!(),
    }
    let recomputed = async {
        loop {
            if let Some(QueueNotice::Recomputed(recomputed)) = notices.recv().await {
                return recomputed;
            }
        }
    };
    let Recomputation { items, wrong, .. } = tokio::time::timeout(DEADLINE, recomputed).await.unwrap();
    assert_eq!((items, wrong.len()), (256, 256));
    for wrong in wrong {
        assert_eq!(local_outputs(&[wrong.job]).await, [wrong.computed]);
    }
}
