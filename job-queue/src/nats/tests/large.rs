//! Jobs and results above 512 KiB, which go through the object store.

use async_nats::jetstream::{self, Context};
use async_nats::{HeaderMap, Message};

use super::*;
use crate::nats::objects::ObjectBucket;

/// Number of messages in the bucket of jobs: chunks and descriptions of objects.
async fn stored_objects(context: &Context) -> u64 {
    context.get_stream("OBJ_SPARRING_test_JOBS").await.unwrap().cached_info().state.messages
}

#[tokio::test(flavor = "multi_thread")]
async fn large_jobs_go_to_workers_and_leave_no_object() {
    let Some(nats) = NatsServer::start() else { return };
    let mut batch = episodes(0, 2);
    // The log does not replay, whatever follows its beginning.
    let mut long = (*batch.0[1].log).clone();
    let values = vec![0.37; long.dim()];
    for _ in 0..70_000 {
        long.push_entry(0, &values);
        long.end_step();
    }
    batch.0[1].log = Arc::new(long);
    let jobs = [JobPayload::Audit(AuditPayload::Replays(batch))];
    let (queue, _notices) = start_queue(&nats, 0.0, LONG);
    let _worker = TestWorker::start(&nats, "host");
    wait_for_workers(&queue, 1).await;
    assert_eq!(outputs(&queue, &jobs).await, local_outputs(&jobs).await);
    assert!(queue.status().counters.sent > 0 && queue.status().counters.bytes_sent > 600_000);
    assert_eq!(queue.status().counters.done_locally, 0);
    let context = jetstream::new(async_nats::connect(nats.url()).await.unwrap());
    let started = Instant::now();
    while stored_objects(&context).await > 0 {
        assert!(started.elapsed() < DEADLINE, "the object is deleted");
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
}

/// Message with a payload of these bytes.
async fn wrapped(bucket: &ObjectBucket, bytes: Vec<u8>) -> Message {
    let mut headers = HeaderMap::new();
    let payload = bucket.wrap("name.1", bytes, &mut headers).await.unwrap();
    let (subject, length, payload) = ("subject".into(), payload.len(), payload.into());
    Message { subject, reply: None, payload, headers: Some(headers), status: None, description: None, length }
}

#[tokio::test(flavor = "multi_thread")]
async fn objects_carry_large_payloads_unchanged() {
    let Some(nats) = NatsServer::start() else { return };
    let context = jetstream::new(async_nats::connect(nats.url()).await.unwrap());
    let bucket = ObjectBucket::new(context, "large".to_owned(), Duration::ZERO);
    let (small, large) =
        (vec![1; 100], (0..2_000_000u32).map(|number| (number % 253) as u8).collect::<Vec<_>>());
    let inline = wrapped(&bucket, small.clone()).await;
    assert_eq!(bucket.payload(&inline, 1 << 22).await.unwrap().unwrap()[..], small);
    let message = wrapped(&bucket, large.clone()).await;
    assert!(message.payload.is_empty());
    assert_eq!(bucket.payload(&message, 1 << 22).await.unwrap().unwrap()[..], large);
    assert!(bucket.payload(&message, 1 << 20).await.is_err(), "it is larger than allowed");
    // Another payload under the same name is not the one of the message.
    let other = wrapped(&bucket, vec![7; 600_000]).await;
    assert_eq!(bucket.payload(&message, 1 << 22).await.unwrap(), None);
    assert!(bucket.payload(&other, 1 << 22).await.unwrap().is_some());
    bucket.delete("name.1").await.unwrap();
    bucket.delete("name.1").await.unwrap();
    assert_eq!(bucket.payload(&other, 1 << 22).await.unwrap(), None);
    bucket.remove().await.unwrap();
    bucket.remove().await.unwrap();
}
