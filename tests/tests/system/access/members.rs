//! Members of a run: the owner adds and removes principals, and other trainers take no part in the run.

use serde_json::{Value, json};
use std::process::Command;
use system_tests::{ApiClient, ApiResponse, Server, sparring_binary};

use super::{Parties, assert_denied, create_token_of};

async fn put_members(api: &ApiClient, run: &str, request: Value) -> ApiResponse {
    api.send_json("PUT", &format!("/v1/runs/{run}/members"), request).await
}

/// Runs `sparring runs members` with a client's token. Returns the exit code, the output and the errors.
async fn members_command(api: &ApiClient, arguments: &[&str]) -> (Option<i32>, String, String) {
    let mut command = Command::new(sparring_binary());
    command.args(["runs", "members", "run"]).args(arguments).args(["--url", api.base()]);
    command.env("SPARRING_TOKEN", api.token().unwrap());
    let out = tokio::task::spawn_blocking(move || command.output().unwrap()).await.unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    (out.status.code(), text(out.stdout), text(out.stderr))
}

#[tokio::test(flavor = "multi_thread")]
async fn members_take_part_until_they_are_removed() {
    let Parties { server: _server, owner, member, other, viewer, .. } = Parties::start(json!({})).await;
    let shown = viewer.get("/v1/runs/run").await.expect(200);
    assert_eq!((&shown["owner"], &shown["members"]), (&json!("owner"), &json!(["member"])));
    assert_denied(other.post("/v1/runs/run/leases", json!({"groups": 1})).await, "not_run_member");
    assert_denied(other.post("/v1/runs/run/results", json!({"results": []})).await, "not_run_member");
    // An id that is encoded otherwise is the same run.
    assert_denied(other.post("/v1/runs/%72un/leases", json!({"groups": 1})).await, "not_run_member");
    for api in [&member, &other] {
        assert_denied(put_members(api, "run", json!({"members": ["other"]})).await, "not_run_owner");
        assert_denied(
            api.send_json("PUT", "/v1/runs/run/tags", json!({"tags": ["x"]})).await,
            "not_run_owner",
        );
    }
    let lease = member.lease("run", json!({"groups": 1})).await;
    let changed = put_members(&owner, "run", json!({"members": ["other", "other"]})).await.expect(200);
    assert_eq!(changed["members"], json!(["other"]));
    // A removed member can neither report nor keep its lease.
    assert_denied(
        member.post("/v1/runs/run/results", json!({"results": lease.results("hold")})).await,
        "not_run_member",
    );
    let renew = format!("/v1/runs/run/leases/{}/renew", lease.id());
    assert_denied(member.post(&renew, json!({})).await, "not_run_member");
    let _ = other.lease("run", json!({"groups": 1})).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn invalid_members_are_rejected() {
    let Parties { server: _server, owner, admin, .. } = Parties::start(json!({})).await;
    let unknown = put_members(&owner, "run", json!({"members": ["member", "nowhere"]})).await.expect(422);
    assert_eq!(unknown["field"], "members.1");
    assert!(unknown["detail"].as_str().unwrap().contains("sparring token list"), "{unknown}");
    let many: Vec<String> = (0..101).map(|n| format!("p{n}")).collect();
    assert_eq!(put_members(&owner, "run", json!({"members": many})).await.expect(422)["field"], "members");
    let denied = put_members(&owner, "run", json!({"members": [], "owner": "other"})).await;
    assert_denied(denied, "forbidden");
    assert_eq!(put_members(&admin, "nowhere", json!({"members": []})).await.status, 404);
    assert_eq!(owner.get("/v1/runs/run").await.expect(200)["members"], json!(["member"]));
}

#[tokio::test(flavor = "multi_thread")]
async fn run_without_an_owner_is_for_every_trainer() {
    let mut server = Server::start().await;
    let local = server.api();
    let _ = local
        .post("/v1/runs", json!({"strategy": "ladder", "id": "run", "design": {"designer": "off"}}))
        .await
        .expect(201);
    let lease = local.lease("run", json!({"groups": 1})).await;
    server.stop().await;
    let db = server.db_path();
    let create = move || {
        [("one", "trainer"), ("two", "trainer"), ("admin", "admin")]
            .map(|(name, role)| create_token_of(&db, name, name, role))
    };
    let tokens = tokio::task::spawn_blocking(create).await.unwrap();
    server.restart().await;
    let [one, two, admin] = tokens.map(|token| server.api().with_token(&token));
    // A lease that was taken before there were tokens can still be reported.
    let report = one.report("run", lease.results("hold")).await;
    assert_ne!(report["results"][0]["status"], "refused", "{report}");
    let own = one.lease("run", json!({"groups": 1})).await;
    assert_denied(two.get(&format!("/v1/runs/run/leases/{}", own.id())).await, "foreign_lease");
    assert_denied(one.send_json("PUT", "/v1/runs/run/tags", json!({"tags": []})).await, "not_run_owner");
    let missing = put_members(&admin, "run", json!({"members": ["two"]})).await.expect(422);
    assert_eq!(missing["field"], "owner");
    let owned = put_members(&admin, "run", json!({"members": [], "owner": "one"})).await.expect(200);
    assert_eq!((&owned["owner"], &owned["members"]), (&json!("one"), &json!([])));
    assert_denied(two.post("/v1/runs/run/leases", json!({"groups": 1})).await, "not_run_member");
    let _ = one.send_json("PUT", "/v1/runs/run/tags", json!({"tags": []})).await.expect(200);
}

#[tokio::test(flavor = "multi_thread")]
async fn command_shows_and_changes_members() {
    let Parties { server: _server, owner, admin, .. } = Parties::start(json!({})).await;
    let (code, shown, errors) = members_command(&owner, &[]).await;
    assert_eq!((code, shown.as_str()), (Some(0), "owner of run: owner\nmembers: member\n"), "{errors}");
    let (_, shown, errors) = members_command(&owner, &["other", "--remove", "member"]).await;
    assert_eq!(shown, "owner of run: owner\nmembers: other\n", "{errors}");
    let (code, _, errors) = members_command(&owner, &["--remove", "member"]).await;
    assert!(
        code != Some(0) && errors.contains("is no member of run run; its members are: other"),
        "{errors}"
    );
    let (code, _, errors) = members_command(&owner, &["--owner", "other"]).await;
    assert!(code != Some(0) && errors.contains("only an admin can set the owner"), "{errors}");
    let (_, shown, errors) = members_command(&admin, &["--owner", "other", "--remove", "other"]).await;
    assert_eq!(shown, "owner of run: other\nmembers: none\n", "{errors}");
}

#[tokio::test(flavor = "multi_thread")]
async fn evaluations_belong_to_the_owner_of_their_run() {
    let Parties { server: _server, owner, member, other, admin, .. } = Parties::start(json!({})).await;
    let of_run = json!({"policy": "mine", "run": "run"});
    assert_denied(member.post("/v1/evaluations", of_run.clone()).await, "not_run_owner");
    assert_denied(other.post("/v1/evaluations", of_run.clone()).await, "not_run_owner");
    let evaluation = owner.post("/v1/evaluations", of_run.clone()).await.expect(201);
    let cancel = format!("/v1/evaluations/{}/cancel", evaluation["id"].as_str().unwrap());
    assert_denied(member.post(&cancel, json!({})).await, "not_run_owner");
    // A member rolls out the scenarios.
    let request = json!({"groups": 1, "purpose": "eval", "evaluation": evaluation["id"]});
    let _ = member.lease("run", request).await;
    let _ = owner.post(&cancel, json!({})).await.expect(200);
    // An evaluation without a run belongs to the principal that created it.
    for canceller in [&other, &admin] {
        let evaluation = other.post("/v1/evaluations", json!({"policy": "hold"})).await.expect(201);
        let cancel = format!("/v1/evaluations/{}/cancel", evaluation["id"].as_str().unwrap());
        assert_denied(owner.post(&cancel, json!({})).await, "foreign_evaluation");
        let cancelled = canceller.post(&cancel, json!({})).await;
        assert!([200, 409].contains(&cancelled.status), "409 if the server was faster: {}", cancelled.body);
    }
}

/// Limits of leases and runs count for a principal, whichever of its tokens it uses.
#[tokio::test(flavor = "multi_thread")]
async fn tokens_of_a_principal_share_its_limits() {
    let setup = |mut config: orchestrator::service::Config| {
        (config.client_limits.leases, config.client_limits.runs) = (1, 1);
        config
    };
    let parties = Parties::start_with(json!({}), setup).await;
    let second = parties.create_client("owner-2", "owner", "trainer").await;
    assert_denied(second.post("/v1/runs", json!({"strategy": "ladder", "id": "b"})).await, "too_many_runs");
    let _ = parties.owner.lease("run", json!({"groups": 1})).await;
    let rejected = second.post("/v1/runs/run/leases", json!({"groups": 1})).await.expect(429);
    assert_eq!(rejected["type"], "urn:sparring:problem:too_many_leases");
    let _ = parties.member.lease("run", json!({"groups": 1})).await;
}
