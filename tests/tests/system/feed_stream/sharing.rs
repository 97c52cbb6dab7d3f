//! Trainers of one run share a consumer, or have one each.

use super::*;
use crate::trajectories::wait_for_full_feed;

#[tokio::test(flavor = "multi_thread")]
async fn trainers_share_a_consumer_or_have_one_each() {
    let Some(cluster) = start_feed(8, 2).await else { return };
    let (api, context) = (cluster.api(), connect(&cluster).await);
    let shared = open_consumer(&context, "shared").await;
    let own = open_consumer(&context, "own").await;
    wait_for_full_feed(&api, "run").await;
    // Two trainers with one consumer, each with its own connection.
    let second = open_consumer(&connect(&cluster).await, "shared").await;
    let (mut first, mut other) = (receive(&shared, 4).await, receive(&second, 4).await);
    acknowledge(&first).await;
    acknowledge(&other).await;
    first.append(&mut other);
    let mut split: Vec<i64> = first.iter().map(id_of).collect();
    split.sort_unstable();
    assert_eq!(split, (1..=8).collect::<Vec<_>>(), "each group goes to one of them");
    tokio::time::sleep(Duration::from_secs(1)).await; // tests that nothing happens
    assert_eq!(
        policy(&api, "run").await["feed"]["acknowledged"],
        0,
        "the other consumer has the groups before it"
    );
    let all = receive(&own, 8).await;
    assert_eq!(all.iter().map(id_of).collect::<Vec<_>>(), (1..=8).collect::<Vec<_>>());
    acknowledge(&all).await;
    wait_for_acknowledged(&cluster, 8).await;
    // A group of a trainer that died goes to the other one.
    let [held] = &receive(&shared, 1).await[..] else { panic!("one group") };
    let again = receive(&second, 8).await;
    assert!(
        again.iter().any(|message| id_of(message) == id_of(held)),
        "the group comes again after `ack_wait`"
    );
}
