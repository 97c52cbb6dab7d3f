//! Leases that are compacted in several steps are read back whole.

use super::*;
use crate::episodes::EpisodeState;
use crate::groups::GroupRole;
use crate::leases::{Disclosure, LeaseForm, LeaseStatus, Purpose};

fn lease(id: i64, numbers: &[i64]) -> CompactedLease {
    let row = LeaseRow {
        id,
        id_suffix: "aaaaaa".to_owned(),
        run: "run".to_owned(),
        purpose: Purpose::Train,
        form: LeaseForm::Groups,
        status: LeaseStatus::Done,
        groups: 8,
        group_size: 1,
        policy_version: 0,
        ttl_ms: 1000,
        created_at: 5,
        expires_at: 6,
        first_expires_at: 0,
        disclosure: Disclosure::Lease,
        is_compacted: true,
        owner: None,
    };
    let group = |number: &i64| CompactedGroup {
        number: *number,
        task: "kessler/survival".to_owned(),
        level: Some(3),
        role: GroupRole::Frontier,
        layout: None,
        contested: true,
        episodes: vec![CompactedEpisode {
            number: *number,
            state: EpisodeState::Finished,
            score: Some(0.5),
            skill: None,
            success: Some(true),
            policy_version: 1,
            after_ms: 7,
        }],
    };
    CompactedLease { row, groups: numbers.iter().map(group).collect(), claim: None }
}

async fn database() -> (tempfile::TempDir, SqliteConnection) {
    let folder = tempfile::tempdir().expect("a folder");
    let mut conn = crate::open_writer(&folder.path().join("db")).await.expect("a database");
    sqlx::query("INSERT INTO runs (id, name, seed, status, settings, created_at) VALUES ('run', '', 1, 'active', '{}', 0)")
        .execute(&mut conn)
        .await
        .expect("a run");
    (folder, conn)
}

/// Every episode is read once and in order, from any lease on, and for any size of a page.
#[tokio::test]
async fn overlapping_rows_lose_no_episode() {
    let (_folder, mut conn) = database().await;
    let rows: [&[CompactedLease]; 6] = [
        &[lease(1, &[0, 1, 2]), lease(2, &[0, 7]), lease(5, &[3])],
        &[lease(5, &[4, 5]), lease(6, &[0])],
        &[lease(5, &[6]), lease(9, &[1])],
        &[lease(3, &[0, 1, 2, 3])],
        &[lease(5, &[0]), lease(8, &[0, 1])],
        &[lease(9, &[0, 2]), lease(10, &[5])],
    ];
    for leases in rows {
        insert(&mut conn, "run", leases, 9).await.expect("the row is stored");
    }
    let all = from(&mut conn, "run", 0, i64::MAX, |_| 1).await.expect("the leases are read");
    let numbers: Vec<(i64, Vec<i64>)> = all
        .iter()
        .map(|lease| (lease.row.id, lease.episodes().map(|(_, episode)| episode.number).collect()))
        .collect();
    assert_eq!(
        numbers,
        [
            (1, vec![0, 1, 2]),
            (2, vec![0, 7]),
            (3, vec![0, 1, 2, 3]),
            (5, vec![0, 3, 4, 5, 6]),
            (6, vec![0]),
            (8, vec![0, 1]),
            (9, vec![0, 1, 2]),
            (10, vec![5]),
        ]
    );
    for begin in 0..12 {
        for enough in 1..30 {
            let count = |lease: &CompactedLease| lease.episodes().count() as i64;
            let found = from(&mut conn, "run", begin, enough, count).await.expect("the leases are read");
            let wanted: Vec<&CompactedLease> = all.iter().filter(|lease| lease.row.id >= begin).collect();
            // The leases up to `enough` are complete; those after them may not be.
            let mut reached = 0;
            for (found, wanted) in found.iter().zip(&wanted) {
                if reached >= enough {
                    break;
                }
                assert_eq!(found, *wanted, "from {begin}, {enough}");
                reached += count(found);
            }
            assert!(reached >= enough || found.len() == wanted.len(), "from {begin}, {enough}: {reached}");
        }
    }
    for wanted in &all {
        let found = get(&mut conn, "run", wanted.row.id).await.expect("the lease is read");
        assert_eq!(found.as_ref(), Some(wanted));
    }
    assert_eq!(get(&mut conn, "run", 4).await.expect("the rows are read"), None);
}

#[tokio::test]
async fn later_parts_are_added_to_the_row_of_their_lease() {
    let (_folder, mut conn) = database().await;
    for leases in
        [[lease(1, &[0]), lease(5, &[3])], [lease(2, &[1]), lease(3, &[2])], [lease(6, &[1]), lease(7, &[1])]]
    {
        insert(&mut conn, "run", &leases, 9).await.expect("the row is stored");
    }
    let more =
        [lease(1, &[4]), lease(3, &[0]), lease(5, &[1, 7]), lease(6, &[0]), lease(7, &[2]), lease(20, &[5])];
    extend(&mut conn, "run", &more, 10).await.expect("the rows are stored");
    let rows: Vec<(i64, i64, i64)> =
        sqlx::query_as("SELECT first_lease, last_lease, episodes FROM compacted_leases ORDER BY id")
            .fetch_all(&mut conn)
            .await
            .expect("the rows are read");
    assert_eq!(rows, [(1, 5, 5), (2, 3, 3), (6, 7, 4), (20, 20, 1)]);
    let wanted = [
        lease(1, &[0, 4]),
        lease(2, &[1]),
        lease(3, &[0, 2]),
        lease(5, &[1, 3, 7]),
        lease(6, &[0, 1]),
        lease(7, &[1, 2]),
        lease(20, &[5]),
    ];
    assert_eq!(from(&mut conn, "run", 0, i64::MAX, |_| 1).await.expect("the leases are read"), wanted);
    for wanted in &wanted {
        let found = get(&mut conn, "run", wanted.row.id).await.expect("the lease is read");
        assert_eq!(found.as_ref(), Some(wanted));
    }
}
