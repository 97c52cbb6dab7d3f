//! Kills of the server and of NATS: no group is lost, and none is delivered twice to a consumer that acknowledged it.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::Instant;

use super::*;
use crate::trajectories::{number, wait_for_rollouts};

/// Time before a kill of NATS in which acknowledgements can be forgotten, on a machine that is busy.
const FORGOTTEN: Duration = Duration::from_secs(5);

/// Groups of a trainer, in the order in which it acknowledged them.
#[derive(Debug, Default)]
struct UsedGroups {
    used: Vec<i64>,
    /// When NATS confirmed the acknowledgement of each of them.
    confirmed_at: BTreeMap<i64, Instant>,
    /// Times of confirmations before another delivery of their group.
    repeated: Vec<(i64, Instant)>,
}

/// Receives groups one by one, and acknowledges each, until `stop` is set and no group arrives.
async fn train(context: Context, name: &str, stop: &AtomicBool, used: &AtomicUsize) -> UsedGroups {
    let mut groups = UsedGroups::default();
    let mut consumer = open_consumer(&context, name).await;
    loop {
        let batch = consumer.batch().max_messages(1).expires(Duration::from_secs(1)).messages().await;
        let received = match batch {
            Ok(mut batch) => batch.next().await,
            Err(_) => None,
        };
        match received {
            Some(Ok(message)) => {
                let id = id_of(&message);
                groups
                    .repeated
                    .extend(groups.confirmed_at.remove(&id).map(|confirmed_at| (id, confirmed_at)));
                if !groups.used.contains(&id) {
                    groups.used.push(id);
                    used.fetch_add(1, Ordering::SeqCst);
                }
                // An acknowledgement that is lost is repeated with the next delivery.
                if message.double_ack().await.is_ok() {
                    groups.confirmed_at.insert(id, Instant::now());
                }
            }
            Some(Err(_)) => consumer = open_consumer(&context, name).await,
            None if stop.load(Ordering::SeqCst) => return groups,
            None => {}
        }
    }
}

/// Kills the server and NATS in turn while trainers read the feed. Returns the number of groups that the server rolled out.
async fn disturb(cluster: &mut WorkerCluster, used: &AtomicUsize, nats_killed_at: &mut Vec<Instant>) -> i64 {
    for round in 1..=6u32 {
        let due = 6 * usize::try_from(round).unwrap();
        system_tests::wait_until("the trainer goes on", async || used.load(Ordering::SeqCst) >= due).await;
        // The kill comes at another moment of each round.
        tokio::time::sleep(Duration::from_millis(u64::from(13 * round))).await;
        if round % 2 == 0 {
            let nats = cluster.nats.as_mut().unwrap();
            nats.kill();
            // NATS may have confirmed an acknowledgement until it was dead.
            nats_killed_at.push(Instant::now());
            nats.resume();
        } else {
            cluster.server.take().unwrap().kill();
            cluster.start_server();
        }
    }
    set_policy(cluster, "off", 8).await;
    wait_for_rollouts(&cluster.api()).await;
    let total = number(&policy(&cluster.api(), "run").await["groups"]);
    wait_for_acknowledged(cluster, total).await;
    total
}

#[tokio::test(flavor = "multi_thread")]
async fn kills_lose_no_group_and_repeat_none() {
    let Some(mut cluster) = start_feed(8, 2).await else { return };
    let (stop, used, second_used) = (AtomicBool::new(false), AtomicUsize::new(0), AtomicUsize::new(0));
    let (first, second) = (connect(&cluster).await, connect(&cluster).await);
    let mut killed_at = Vec::new();
    let disturbed = async {
        let total = disturb(&mut cluster, &used, &mut killed_at).await;
        stop.store(true, Ordering::SeqCst);
        total
    };
    let (total, first, second) = tokio::join!(
        disturbed,
        train(first, "first", &stop, &used),
        train(second, "second", &stop, &second_used)
    );
    for groups in [first, second] {
        assert_eq!(groups.used, (1..=total).collect::<Vec<_>>(), "each group once, in order");
        // NATS writes acknowledgements a moment after it confirms them, so that a kill forgets the latest ones. The server
        // has removed all earlier groups.
        for (id, confirmed_at) in groups.repeated {
            let is_latest = |kill: &Instant| confirmed_at < *kill && *kill - confirmed_at < FORGOTTEN;
            assert!(
                killed_at.iter().any(is_latest),
                "group {id} was acknowledged long before each kill of NATS"
            );
        }
    }
}
