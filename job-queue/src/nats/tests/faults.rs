//! Kills, lost connections, poisoned jobs, and messages that arrive twice or too late.

use super::fake_worker::FakeWorker;
use super::*;
use jobs::envelope::JobReply;

#[tokio::test(flavor = "multi_thread")]
async fn killed_workers_and_a_killed_nats_server_lose_nothing() {
    let Some(mut nats) = NatsServer::start() else { return };
    let jobs: Vec<JobPayload> = (0..60).map(|number| replays(number * 4, 4)).collect();
    let expected = local_outputs(&jobs).await;
    let (queue, mut notices) = start_queue(&nats, 0.1, SHORT);
    let queue = Arc::new(queue);
    let mut workers: Vec<_> =
        (0..3).map(|number| TestWorker::start(&nats, &format!("host{number}"))).collect();
    wait_for_workers(&queue, 3).await;
    let running = tokio::spawn({
        let (queue, jobs) = (Arc::clone(&queue), jobs.clone());
        async move {
            let mut all = Vec::new();
            for part in jobs.chunks(6) {
                all.extend(outputs(&*queue, part).await);
            }
            all
        }
    });
    let mut round = 0;
    while !running.is_finished() && round < 20 {
        tokio::time::sleep(Duration::from_millis(150)).await;
        round += 1;
        if round % 7 == 3 {
            nats.kill();
            tokio::time::sleep(Duration::from_millis(100)).await;
            nats.resume();
        } else {
            workers.remove(0);
            workers.push(TestWorker::start(&nats, &format!("host{round}")));
        }
    }
    assert!(running.await.unwrap() == expected);
    // After all of it, workers do jobs again without a restart of the server.
    wait_until("workers are back", || queue.status().degraded.is_none()).await;
    let before = queue.status().counters.done_remotely;
    assert_eq!(outputs(&*queue, &jobs[..2]).await, expected[..2]);
    assert!(queue.status().counters.done_remotely > before);
    let mut joined = 0;
    while let Ok(notice) = notices.try_recv() {
        joined += usize::from(matches!(notice, QueueNotice::Joined(_)));
    }
    assert!(joined >= 3);
}

/// Waits for a notice, and drops those before it.
async fn wait_for_notice(notices: &mut UnboundedReceiver<QueueNotice>, is_wanted: fn(&QueueNotice) -> bool) {
    let search = async { while !is_wanted(&notices.recv().await.expect("the queue runs")) {} };
    tokio::time::timeout(DEADLINE, search).await.expect("the notice comes");
}

#[tokio::test(flavor = "multi_thread")]
async fn the_server_goes_on_alone_while_nats_is_away() {
    let Some(mut nats) = NatsServer::start() else { return };
    nats.kill();
    let (queue, mut notices) = start_queue(&nats, 0.0, SHORT);
    let jobs = [replays(0, 3)];
    let expected = local_outputs(&jobs).await;
    assert_eq!(outputs(&queue, &jobs).await, expected, "before the first connection");
    wait_until("it says why", || queue.status().degraded.is_some_and(|reason| reason.contains("is away")))
        .await;
    nats.resume();
    let _worker = TestWorker::start(&nats, "host");
    wait_for_workers(&queue, 1).await;
    assert_eq!(outputs(&queue, &jobs).await, expected);
    assert!(queue.status().counters.done_remotely > 0);
    wait_for_notice(&mut notices, |notice| matches!(notice, QueueNotice::Restored)).await;
    nats.kill();
    assert_eq!(outputs(&queue, &jobs).await, expected, "after the connection was lost");
    wait_until("it says why", || queue.status().degraded.is_some()).await;
    wait_for_notice(&mut notices, |notice| matches!(notice, QueueNotice::Degraded(_))).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_poisoned_job_is_done_by_the_server() {
    let Some(nats) = NatsServer::start() else { return };
    let (queue, _notices) = start_queue(&nats, 0.0, SHORT);
    let worker = FakeWorker::join(&nats, "poisoned").await;
    wait_for_workers(&queue, 1).await;
    let jobs = [replays(0, 1)];
    let run = outputs(&queue, &jobs);
    let take = async {
        let _job = worker.take(&nats).await; // it is never acknowledged
    };
    let (done, ()) = tokio::join!(run, take);
    assert_eq!(done, local_outputs(&jobs).await);
    assert_eq!(queue.status().counters.taken_back, 1);
    let started = Instant::now();
    while worker.messages(&nats).await != [0, 0] {
        assert!(started.elapsed() < DEADLINE, "the job is deleted");
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn late_and_repeated_results_change_nothing() {
    let Some(nats) = NatsServer::start() else { return };
    let (queue, _notices) = start_queue(&nats, 0.0, LONG);
    let worker = FakeWorker::join(&nats, "twice").await;
    wait_for_workers(&queue, 1).await;
    let job = replays(0, 1);
    let expected = local_outputs(std::slice::from_ref(&job)).await.remove(0);
    let send = async {
        let (envelope, acker) = worker.take(&nats).await;
        let mut stale = envelope.clone();
        stale.token.0 ^= 1;
        // A result with another token comes first, and is wrong.
        worker.send(&nats, &stale, JobReply::Failed("stale".to_owned()), "stale").await;
        let right = || FakeWorker::reply(&envelope, |_| {});
        worker.send(&nats, &envelope, right(), "first").await;
        worker.send(&nats, &envelope, right(), "first").await; // JetStream drops it
        worker.send(&nats, &envelope, right(), "second").await;
        acker.ack().await.unwrap();
    };
    let (done, ()) = tokio::join!(queue.run(job), send);
    let CompletedJob { output, receipt } = done.unwrap();
    assert_eq!(output, expected);
    wait_until("both are ignored", || queue.status().counters.ignored_results == 2).await;
    wait_until("the worker is counted once", || queue.status().workers[0].jobs == 1).await;
    // The result stays in the stream until the caller has committed it.
    let started = Instant::now();
    while worker.messages(&nats).await != [0, 1] {
        assert!(started.elapsed() < DEADLINE, "one result is left: {:?}", worker.messages(&nats).await);
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
    receipt.acknowledge();
    while worker.messages(&nats).await != [0, 0] {
        assert!(started.elapsed() < DEADLINE, "the result is acknowledged");
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
}
