//! A page of another site changes nothing: GET has no effect on any route, and other requests of such pages are rejected.

use std::time::Duration;

use reqwest::Method;
use serde_json::json;
use system_tests::{ApiClient, Server, http_client, wait_for};

use super::{ListedOperation, operations};
use crate::run_deletion::populate::create_populated_run;
use crate::run_deletion::routes;
use crate::run_deletion::rows::{Dump, dump};
use crate::trajectories::put_policy;

/// Sends a request as a browser does for a page of another site. It sends no `Origin` for an image.
async fn send_from_other_site(api: &ApiClient, method: &str, path: &str) -> reqwest::Response {
    let request = http_client().request(method.parse().unwrap(), format!("{}{path}", api.base()));
    let request = request.header("Sec-Fetch-Site", "cross-site").header("Sec-Fetch-Mode", "no-cors");
    request.header("Content-Type", "application/json").body("{}").send().await.unwrap()
}

/// Rows of the database once workers have nothing left to write.
async fn settled_dump(server: &Server) -> Dump {
    wait_for("the database does not change any more", async || {
        let before = dump(&server.db_path()).await;
        tokio::time::sleep(Duration::from_millis(300)).await;
        (dump(&server.db_path()).await == before).then_some(before)
    })
    .await
}

/// Every GET of the document is sent to a run that has rows in all tables, with the queries that could claim or take something.
#[tokio::test(flavor = "multi_thread")]
async fn no_get_changes_the_database() {
    let server = Server::start().await;
    let api = server.api();
    let ids = create_populated_run(&api, "gone").await;
    let _ = put_policy(&api, "gone", json!({"policy": "off"})).await.expect(200);
    let before = settled_dump(&server).await;
    let mut sent = 0;
    for ListedOperation { method, path, operation, .. } in operations() {
        // The stream of events and the sessions never end.
        if method != "GET" || path.ends_with("/events") || path.ends_with("/sessions") {
            continue;
        }
        let path = routes::path(&path, &ids)
            .replace("{evaluation}", &ids.evaluation)
            .replace("{layout}", &ids.layout);
        assert!(!path.contains('{'), "{path}");
        let required = routes::query(&operation);
        for query in ["", "limit=1", "plan=hold", "wait_s=0", "ttl_s=60", "after=0", "after=0&wait_s=0"] {
            let joint = if required.is_empty() { "?" } else { "&" };
            let url = format!("{path}{required}{joint}{query}");
            let response = send_from_other_site(&api, "GET", &url).await;
            assert!(response.status().as_u16() < 500, "{url}: {}", response.status());
            sent += 1;
        }
    }
    assert!(sent > 200, "{sent} requests");
    let after = settled_dump(&server).await;
    for (table, rows) in before {
        assert_eq!(rows, after[&table], "{table}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn other_sites_cannot_change_anything() {
    let server = Server::start().await;
    let api = server.api();
    let ids = create_populated_run(&api, "gone").await;
    for ListedOperation { method, path, .. } in operations() {
        if method == "GET" {
            continue;
        }
        let path = routes::path(&path, &ids)
            .replace("{evaluation}", &ids.evaluation)
            .replace("{layout}", &ids.layout);
        let response = send_from_other_site(&api, &method, &path).await;
        let status = response.status();
        let problem: serde_json::Value = response.json().await.unwrap();
        assert_eq!(
            (status.as_u16(), &problem["type"]),
            (403, &json!("urn:sparring:problem:cross_site")),
            "{method} {path}"
        );
    }
    // The server's own pages may: a browser says `same-origin`, and other programs send no such header.
    for site in ["same-origin", "same-site", "none"] {
        let request = http_client().request(Method::POST, format!("{}/v1/runs/gone/pause", api.base()));
        let response = request.header("Sec-Fetch-Site", site).send().await.unwrap();
        assert_eq!(response.status().as_u16(), 200, "{site}");
    }
    // A page of another site can open a WebSocket without a preflight.
    let request = http_client().get(format!("{}/ws", api.base())).header("Sec-Fetch-Site", "cross-site");
    let upgrade = [
        ("Connection", "Upgrade"),
        ("Upgrade", "websocket"),
        ("Sec-WebSocket-Version", "13"),
        ("Sec-WebSocket-Key", "dGhlIHNhbXBsZSBub25jZQ=="),
    ];
    let request = upgrade.iter().fold(request, |request, (name, value)| request.header(*name, *value));
    assert_eq!(request.send().await.unwrap().status().as_u16(), 403);
}
