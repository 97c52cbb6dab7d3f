//! Search of episodes: every order is complete over all pages, and every filter excludes what it should.

use std::collections::BTreeSet;

use serde_json::{Value, json};
use system_tests::{ApiClient, Server};

use super::{create_run, report_groups};

/// Predicate that an episode must meet for a filter.
type Predicate = fn(&Value) -> bool;

const ORDERS: [&str; 6] = ["newest", "oldest", "worst_score", "best_score", "worst_skill", "best_skill"];

/// Fetches all pages of a search with `limit` episodes a page.
async fn search(api: &ApiClient, query: &str, limit: u32) -> Vec<Value> {
    let (mut all, mut cursor) = (Vec::new(), String::new());
    loop {
        let path = format!("/v1/runs/run/episodes/search?{query}&limit={limit}{cursor}");
        let page = api.get(&path).await.expect(200);
        all.extend(page["episodes"].as_array().expect("episodes").iter().cloned());
        match page["next"].as_str() {
            Some(next) => cursor = format!("&cursor={next}"),
            None => return all,
        }
    }
}

fn episode_ids(episodes: &[Value]) -> Vec<&str> {
    episodes.iter().map(|episode| episode["episode"].as_str().expect("a name")).collect()
}

/// Episodes of a group have equal scores here, so that the order of ties is tested.
#[tokio::test]
async fn every_order_is_complete_over_pages_with_ties() {
    let server = Server::start().await;
    let api = server.api();
    create_run(&api, json!({"group_size": 3})).await;
    for policy in ["hold", "heuristic", "hold"] {
        report_groups(&api, 8, policy).await;
    }
    let everything = search(&api, "order=oldest", 500).await;
    assert_eq!(everything.len(), 72);
    for order in ORDERS {
        let whole = search(&api, &format!("order={order}"), 500).await;
        for limit in [1, 7] {
            let paged = search(&api, &format!("order={order}"), limit).await;
            assert_eq!(episode_ids(&paged), episode_ids(&whole), "{order} by {limit}");
        }
        let once: BTreeSet<&str> = episode_ids(&whole).into_iter().collect();
        assert_eq!(once.len(), whole.len(), "{order}: each episode once");
        let column = order.split_once('_').map(|(_, column)| column);
        let with_value = everything.iter().filter(|e| column.is_none_or(|column| e[column].is_f64())).count();
        assert_eq!(whole.len(), with_value, "{order} excludes episodes without a value only");
        let Some(column) = column else { continue };
        let values: Vec<f64> = whole.iter().map(|e| e[column].as_f64().unwrap()).collect();
        let sorted = values.windows(2).all(|pair| match order.starts_with("worst") {
            true => pair[0] <= pair[1],
            false => pair[0] >= pair[1],
        });
        assert!(sorted && values.windows(2).any(|pair| pair[0] == pair[1]), "{order}: {values:?}");
    }
    let mut newest = search(&api, "order=newest", 5).await;
    newest.reverse();
    assert_eq!(episode_ids(&newest), episode_ids(&everything));
}

#[tokio::test]
async fn every_filter_excludes_other_episodes() {
    let server = Server::start().await;
    let api = server.api();
    create_run(&api, json!({"group_size": 2})).await;
    let reported = report_groups(&api, 12, "hold").await;
    let lease = api.lease("run", json!({"groups": 2, "policy_version": 7})).await;
    let results = lease
        .episodes()
        .into_iter()
        .map(|(name, scenario)| system_tests::episode_result(&name, &scenario, "heuristic"));
    let _ = api
        .post("/v1/runs/run/results", json!({"policy_version": 7, "results": results.collect::<Vec<_>>()}))
        .await
        .expect(200);
    let all = search(&api, "", 500).await;
    assert_eq!(all.len(), reported.len() + 4);
    let filters: [(&str, Predicate); 7] = [
        ("state=failed", |e| e["state"] == "failed"),
        ("state=finished", |e| e["state"] == "finished"),
        ("success=true", |e| e["success"] == true),
        ("success=false", |e| e["success"] == false),
        ("policy_version=7", |e| e["policy_version"] == 7),
        ("role=frontier&level=0", |e| e["role"] == "frontier" && e["level"] == 0),
        ("task=kessler/survival&role=rehearsal", |e| e["role"] == "rehearsal"),
    ];
    for (query, is_match) in filters {
        let expected: BTreeSet<&str> = episode_ids(&all)
            .into_iter()
            .zip(&all)
            .filter(|(_, e)| is_match(e))
            .map(|(name, _)| name)
            .collect();
        let found = search(&api, query, 3).await;
        assert_eq!(episode_ids(&found).into_iter().collect::<BTreeSet<_>>(), expected, "{query}");
    }
    assert_eq!(search(&api, "state=failed", 500).await.len(), 8);
    assert_eq!(search(&api, "policy_version=7", 500).await.len(), 4);
}

#[tokio::test]
async fn invalid_filters_are_rejected_with_the_valid_values() {
    let server = Server::start().await;
    let api = server.api();
    create_run(&api, json!({})).await;
    report_groups(&api, 4, "hold").await;
    let search_path = |query: &str| format!("/v1/runs/run/episodes/search?{query}");
    for (query, status, detail) in [
        ("state=lost", 400, "finished"),
        ("role=probe", 400, "frontier"),
        ("order=random", 400, "worst_score"),
        ("task=kessler/nothing", 422, "task kessler/nothing does not exist"),
        ("mode=boredom", 422, "collision"),
        ("layout=7", 400, "layout"),
        ("cursor=7", 422, "cursor"),
        ("colour=red", 400, "colour"),
    ] {
        let response = api.get(&search_path(query)).await;
        let body = response.expect(status).to_string();
        assert!(body.contains(detail), "{query}: {body}");
    }
    let page = api.get(&search_path("order=worst_score&limit=1")).await.expect(200);
    let next = page["next"].as_str().unwrap();
    let other = api
        .get(&search_path(&format!("order=best_score&limit=1&cursor={next}")))
        .await
        .expect(422)
        .to_string();
    assert!(other.contains("order=worst_score"), "{other}");
}

#[tokio::test]
async fn an_episode_has_its_neighbours_and_its_group() {
    let server = Server::start().await;
    let api = server.api();
    create_run(&api, json!({"group_size": 3})).await;
    report_groups(&api, 2, "hold").await;
    report_groups(&api, 1, "hold").await;
    let all = search(&api, "order=oldest", 500).await;
    let ids = episode_ids(&all);
    assert_eq!(ids.len(), 9);
    for (index, id) in ids.iter().enumerate() {
        let episode = api.get(&format!("/v1/runs/run/episodes/{id}")).await.expect(200);
        let neighbours = &episode["neighbours"];
        let before = index.checked_sub(1).map(|before| ids[before]);
        assert_eq!(neighbours["previous"].as_str(), before, "{id}");
        assert_eq!(neighbours["next"].as_str(), ids.get(index + 1).copied(), "{id}");
        let group = neighbours["group"].as_array().expect("episodes");
        let first = index - index % 3;
        assert_eq!(group, &all[first..first + 3], "{id}");
    }
}
