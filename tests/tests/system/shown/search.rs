//! Episodes that are looked for: each order is one, page by page, and each word leaves out what it says.

use std::collections::BTreeSet;

use serde_json::{Value, json};
use system_tests::{Api, Server};

use super::{fly, run};

/// Whether an episode is one that was asked for.
type Holds = fn(&Value) -> bool;

const ORDERS: [&str; 6] = ["newest", "oldest", "worst_score", "best_score", "worst_skill", "best_skill"];

/// All pages of a search, a few at a time.
async fn found(api: &Api, words: &str, limit: u32) -> Vec<Value> {
    let (mut all, mut cursor) = (Vec::new(), String::new());
    loop {
        let path = format!("/v1/runs/run/episodes/search?{words}&limit={limit}{cursor}");
        let page = api.get(&path).await.expect(200);
        all.extend(page["episodes"].as_array().expect("episodes").iter().cloned());
        match page["next"].as_str() {
            Some(next) => cursor = format!("&cursor={next}"),
            None => return all,
        }
    }
}

fn names(episodes: &[Value]) -> Vec<&str> {
    episodes.iter().map(|episode| episode["episode"].as_str().expect("a name")).collect()
}

/// In groups of three on the same scenario, nobody acts: scores are equal, and what decides is the place.
#[tokio::test]
async fn every_order_is_whole_page_by_page_and_ties_are_no_trouble() {
    let server = Server::start().await;
    let api = server.api();
    run(&api, json!({"group_size": 3})).await;
    for policy in ["hold", "heuristic", "hold"] {
        fly(&api, 8, policy).await;
    }
    let everything = found(&api, "order=oldest", 500).await;
    assert_eq!(everything.len(), 72);
    for order in ORDERS {
        let whole = found(&api, &format!("order={order}"), 500).await;
        for limit in [1, 7] {
            let paged = found(&api, &format!("order={order}"), limit).await;
            assert_eq!(names(&paged), names(&whole), "{order} by {limit}");
        }
        let once: BTreeSet<&str> = names(&whole).into_iter().collect();
        assert_eq!(once.len(), whole.len(), "{order}: each once");
        let column = order.split_once('_').map(|(_, column)| column);
        let held = everything.iter().filter(|e| column.is_none_or(|column| e[column].is_f64())).count();
        assert_eq!(whole.len(), held, "{order} leaves out those without one alone");
        let Some(column) = column else { continue };
        let values: Vec<f64> = whole.iter().map(|e| e[column].as_f64().unwrap()).collect();
        let sorted = values.windows(2).all(|pair| match order.starts_with("worst") {
            true => pair[0] <= pair[1],
            false => pair[0] >= pair[1],
        });
        assert!(sorted && values.windows(2).any(|pair| pair[0] == pair[1]), "{order}: {values:?}");
    }
    let mut newest = found(&api, "order=newest", 5).await;
    newest.reverse();
    assert_eq!(names(&newest), names(&everything));
}

#[tokio::test]
async fn each_word_leaves_out_what_it_says() {
    let server = Server::start().await;
    let api = server.api();
    run(&api, json!({"group_size": 2})).await;
    let flown = fly(&api, 12, "hold").await;
    let lease = api.lease("run", json!({"groups": 2, "policy_version": 7})).await;
    let results = lease
        .episodes()
        .into_iter()
        .map(|(name, scenario)| system_tests::result(&name, &scenario, "heuristic"));
    let _ = api
        .post("/v1/runs/run/results", json!({"policy_version": 7, "results": results.collect::<Vec<_>>()}))
        .await
        .expect(200);
    let all = found(&api, "", 500).await;
    assert_eq!(all.len(), flown.len() + 4);
    let holds: [(&str, Holds); 7] = [
        ("state=failed", |e| e["state"] == "failed"),
        ("state=finished", |e| e["state"] == "finished"),
        ("success=true", |e| e["success"] == true),
        ("success=false", |e| e["success"] == false),
        ("version=7", |e| e["policy_version"] == 7),
        ("role=frontier&level=0", |e| e["role"] == "frontier" && e["level"] == 0),
        ("task=kessler/survival&role=rehearsal", |e| e["role"] == "rehearsal"),
    ];
    for (words, holds) in holds {
        let wanted: BTreeSet<&str> =
            names(&all).into_iter().zip(&all).filter(|(_, e)| holds(e)).map(|(name, _)| name).collect();
        let told = found(&api, words, 3).await;
        assert_eq!(names(&told).into_iter().collect::<BTreeSet<_>>(), wanted, "{words}");
    }
    assert_eq!(found(&api, "state=failed", 500).await.len(), 8);
    assert_eq!(found(&api, "version=7", 500).await.len(), 4);
}

#[tokio::test]
async fn words_that_mean_nothing_are_refused_with_those_that_do() {
    let server = Server::start().await;
    let api = server.api();
    run(&api, json!({})).await;
    fly(&api, 4, "hold").await;
    let at = |words: &str| format!("/v1/runs/run/episodes/search?{words}");
    for (words, status, says) in [
        ("state=lost", 400, "finished"),
        ("role=probe", 400, "frontier"),
        ("order=random", 400, "worst_score"),
        ("task=kessler/nothing", 422, "there is no task kessler/nothing"),
        ("mode=boredom", 422, "collision"),
        ("layout=7", 400, "layout"),
        ("cursor=7", 422, "cursor"),
        ("colour=red", 400, "colour"),
    ] {
        let answer = api.get(&at(words)).await;
        let body = answer.expect(status).to_string();
        assert!(body.contains(says), "{words}: {body}");
    }
    let page = api.get(&at("order=worst_score&limit=1")).await.expect(200);
    let next = page["next"].as_str().unwrap();
    let other =
        api.get(&at(&format!("order=best_score&limit=1&cursor={next}"))).await.expect(422).to_string();
    assert!(other.contains("another order: worst_score"), "{other}");
}
