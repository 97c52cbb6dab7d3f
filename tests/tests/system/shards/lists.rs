//! Lists have the items of all shards, page by page.

use std::collections::BTreeSet;

use serde_json::json;
use system_tests::ApiClient;
use system_tests::shard_cluster::ShardCluster;

use super::{all_pages, create, ids, train};

const SORTS: [&str; 5] = ["created", "name", "episodes", "last_results", "skill"];

/// Creates six runs on two shards; three have results, and two have names that differ by their case only.
async fn create_runs(api: &ApiClient) -> Vec<String> {
    let mut runs = Vec::new();
    for (name, tags) in [
        ("east.delta", json!(["first"])),
        ("west.Alpha", json!(["first", "second"])),
        ("east.alpha", json!([])),
        ("west.beta", json!(["second"])),
        ("west.gamma", json!([])),
        ("east.Echo", json!([])),
    ] {
        let id = name.to_ascii_lowercase();
        let (_, name) = name.split_once('.').unwrap();
        assert_eq!(create(api, json!({"id": id, "name": name, "tags": tags})).await, id);
        runs.push(id);
    }
    for (run, groups) in [("west.beta", 4), ("east.alpha", 2), ("west.alpha", 2)] {
        train(api, run, groups).await;
    }
    runs
}

#[tokio::test(flavor = "multi_thread")]
async fn pages_together_are_the_runs_of_both_shards_in_every_order() {
    let cluster = ShardCluster::start().await;
    let api = cluster.api();
    let runs = create_runs(&api).await;
    let page = api.get("/v1/runs").await.expect(200);
    assert_eq!(
        (ids(&page), &page["total"]),
        (runs.clone(), &json!(6)),
        "runs are in the order of their creation"
    );
    for sort in SORTS {
        for order in ["asc", "desc"] {
            let query = format!("/v1/runs?sort={sort}&order={order}");
            let whole = ids(&api.get(&query).await.expect(200));
            assert_eq!(whole.iter().collect::<BTreeSet<_>>(), runs.iter().collect(), "{sort} {order}");
            for limit in [1, 2, 4] {
                let paged = all_pages(&api, &format!("{query}&limit={limit}"), "runs", "id").await;
                assert_eq!(paged, whole, "{sort} {order} {limit}");
            }
            // Both servers merge in the same order.
            assert_eq!(ids(&cluster.west.api().get(&query).await.expect(200)), whole, "{sort} {order}");
        }
    }
    let names = ids(&api.get("/v1/runs?sort=name").await.expect(200));
    assert_eq!(names, ["east.alpha", "west.alpha", "west.beta", "east.delta", "east.echo", "west.gamma"]);
    let episodes = ids(&api.get("/v1/runs?sort=episodes&order=desc&limit=3").await.expect(200));
    assert_eq!(episodes, ["west.beta", "west.alpha", "east.alpha"]);
    // A page that begins on one server continues on the other.
    let first = api.get("/v1/runs?sort=skill&limit=2").await.expect(200);
    let next = first["next"].as_str().unwrap();
    let rest = cluster.west.api().get(&format!("/v1/runs?sort=skill&cursor={next}")).await.expect(200);
    assert_eq!((ids(&rest).len(), &rest["total"]), (4, &json!(null)));
}

#[tokio::test(flavor = "multi_thread")]
async fn searches_filters_and_groups_concern_all_shards() {
    let cluster = ShardCluster::start().await;
    let api = cluster.api();
    create_runs(&api).await;
    for (query, found) in [
        ("search=alpha", vec!["west.alpha", "east.alpha"]),
        ("search=west", vec!["west.alpha", "west.beta", "west.gamma"]),
        ("tag=first", vec!["east.delta", "west.alpha"]),
        ("search=alpha&tag=first", vec!["west.alpha"]),
        ("strategy=uniform", vec![]),
        ("archived=true", vec![]),
    ] {
        let page = api.get(&format!("/v1/runs?{query}")).await.expect(200);
        assert_eq!(
            (ids(&page), &page["total"]),
            (found.iter().map(|id| (*id).to_owned()).collect(), &json!(found.len()))
        );
    }
    let groups = api.get("/v1/run_groups?by=tag").await.expect(200);
    let groups: Vec<_> =
        groups["groups"].as_array().unwrap().iter().map(|group| (&group["value"], &group["runs"])).collect();
    assert_eq!(
        groups,
        [(&json!(""), &json!(3)), (&json!("first"), &json!(2)), (&json!("second"), &json!(2))]
    );
    let invalid = api.get("/v1/runs?sort=size").await;
    assert!([400, 422].contains(&invalid.status), "{invalid:?}");
    let _ = api.get("/v1/runs?cursor=created.asc.east.alpha.1").await.expect(422);
    let alerts = api.get("/v1/alerts").await.expect(200);
    assert_eq!(
        (&alerts["alerts"], &alerts["lasting"], &alerts["missing_shards"]),
        (&json!([]), &json!(0), &json!([]))
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn runs_of_one_shard_are_archived_together() {
    let cluster = ShardCluster::start().await;
    let api = cluster.api();
    create_runs(&api).await;
    let mixed = api.post("/v1/archive", json!({"runs": ["east.alpha", "west.alpha"]})).await.expect(422);
    assert_eq!(mixed["field"], "runs", "{mixed}");
    for runs in [json!(["west.alpha", "west.beta"]), json!(["east.alpha"])] {
        let archived = api.post("/v1/archive", json!({ "runs": runs })).await.expect(200);
        assert_eq!(json!(ids(&archived)), runs);
    }
    let archived = api.get("/v1/runs?archived=true").await.expect(200);
    assert_eq!(ids(&archived), ["west.alpha", "east.alpha", "west.beta"]);
    assert_eq!(api.get("/v1/runs").await.expect(200)["total"], 3);
}

#[tokio::test(flavor = "multi_thread")]
async fn evaluations_of_both_shards_are_listed_and_reached_by_id() {
    let cluster = ShardCluster::start().await;
    let api = cluster.api();
    create_runs(&api).await;
    let mut created = Vec::new();
    for run in ["east.alpha", "west.alpha", "west.beta", "east.delta", "west.gamma"] {
        let evaluation = api.post("/v1/evaluations", json!({"policy": "mine", "run": run})).await.expect(201);
        let id = evaluation["id"].as_str().unwrap().to_owned();
        assert_eq!(id.split_once('.').unwrap().0, run.split_once('.').unwrap().0, "{id}");
        created.insert(0, id);
    }
    for limit in [1, 2, 50] {
        let listed = all_pages(&api, &format!("/v1/evaluations?limit={limit}"), "evaluations", "id").await;
        assert_eq!(listed, created, "{limit}");
    }
    let _ = api.get("/v1/evaluations?cursor=12.").await.expect(422);
    for id in &created {
        assert_eq!(&api.get(&format!("/v1/evaluations/{id}")).await.expect(200)["id"], id);
        assert_eq!(api.get(&format!("/v1/evaluations/{id}/scenarios?limit=1")).await.status, 200);
        let cancelled = api.post(&format!("/v1/evaluations/{id}/cancel"), json!(null)).await.expect(200);
        assert_eq!(cancelled["state"], "failed", "{cancelled}");
    }
    let [a, b] = ["east", "west"].map(|shard| created.iter().find(|id| id.starts_with(shard)).unwrap());
    let mixed = api.get(&format!("/v1/evaluations/compare?a={a}&b={b}")).await.expect(422);
    assert!(mixed["detail"].as_str().unwrap().contains("one shard"), "{mixed}");
    // The server of the other shard answers: the evaluation is not complete.
    let remote = api.get(&format!("/v1/evaluations/compare?a={b}&b={b}")).await;
    assert!(
        remote.status == 422 && remote.body["detail"].as_str().unwrap().contains("not complete"),
        "{remote:?}"
    );
    // A lease of the evaluation's run takes its scenarios.
    let evaluation =
        api.post("/v1/evaluations", json!({"policy": "mine", "run": "west.beta"})).await.expect(201);
    let wanted = json!({"groups": 1, "purpose": "eval", "evaluation": evaluation["id"]});
    assert_eq!(api.lease("west.beta", wanted).await.0["groups"].as_array().unwrap().len(), 1);
}
