//! Leases belong to the principal that took them: other trainers can neither use them nor run their episodes in sessions.

use serde_json::{Value, json};
use system_tests::{ApiClient, Lease, TestSocket};

use super::{Parties, assert_denied};
use crate::trajectories::{put_policy, wait_for_full_feed};

fn path(lease: &Lease, rest: &str) -> String {
    format!("/v1/runs/run/leases/{}{rest}", lease.id())
}

/// Claim that every episode of a lease of columns failed.
fn failed_columns(lease: &Lease) -> Value {
    let episodes =
        lease.0["ranges"].as_array().unwrap().iter().map(|range| range["groups"].as_u64().unwrap());
    let episodes = episodes.sum::<u64>() as usize;
    json!({"score": vec![0.0; episodes], "failed": vec![1; episodes], "steps": vec![1; episodes]})
}

async fn listed_leases(api: &ApiClient) -> Vec<String> {
    let page = api.get("/v1/runs/run/leases").await.expect(200);
    page["leases"]
        .as_array()
        .unwrap()
        .iter()
        .map(|lease| lease["lease"].as_str().unwrap().to_owned())
        .collect()
}

fn receipts(response: &Value, field: &str) -> Vec<Value> {
    response["results"].as_array().unwrap().iter().map(|receipt| receipt[field].clone()).collect()
}

#[tokio::test(flavor = "multi_thread")]
async fn lease_of_another_principal_is_refused() {
    let Parties { server: _server, owner, member, admin, .. } = Parties::start(json!({})).await;
    let lease = owner.lease("run", json!({"groups": 2})).await;
    for response in [
        member.get(&path(&lease, "")).await,
        member.post(&path(&lease, "/renew"), json!({})).await,
        member.post(&path(&lease, "/release"), json!({})).await,
    ] {
        assert_denied(response, "foreign_lease");
    }
    let refused = member.report("run", lease.results("hold")).await;
    assert_eq!(receipts(&refused, "status"), ["refused", "refused"]);
    assert_eq!(receipts(&refused, "code"), ["foreign_lease", "foreign_lease"]);
    assert!(receipts(&refused, "score").iter().all(Value::is_null), "{refused}");
    // Nothing changed, and the report did not stop the owner's one.
    let unchanged = owner.get(&path(&lease, "")).await.expect(200);
    assert_eq!(unchanged, lease.0);
    assert_eq!(owner.get("/v1/runs/run/episodes").await.expect(200)["episodes"], json!([]));
    // Failing another trainer's episodes is refused as well, and so is a report beside results of its own.
    let own = member.lease("run", json!({"groups": 1})).await;
    let failed = json!({"episode": lease.episodes()[0].0, "status": "failed", "reason": "x"});
    let mixed = member.report("run", [vec![failed], own.results("hold")].concat()).await;
    assert_eq!(receipts(&mixed, "status"), ["refused", "counted"]);
    assert_eq!(receipts(&owner.report("run", lease.results("hold")).await, "status"), ["counted", "counted"]);
    // A list has the leases of the caller; an admin's has all.
    assert_eq!(listed_leases(&owner).await, [lease.id()]);
    assert_eq!(listed_leases(&member).await, [own.id()]);
    assert_eq!(listed_leases(&admin).await, [lease.id(), own.id()]);
    let _ = admin.get(&path(&lease, "")).await.expect(200);
}

#[tokio::test(flavor = "multi_thread")]
async fn columns_of_another_principal_cannot_be_claimed() {
    let Parties { server: _server, owner, member, admin, .. } = Parties::start(json!({})).await;
    let lease = owner.lease("run", json!({"groups": 4, "form": "columns"})).await;
    let claim = failed_columns(&lease);
    assert_denied(member.post(&path(&lease, "/columns"), claim.clone()).await, "foreign_lease");
    let claimed = owner.post(&path(&lease, "/columns"), claim).await.expect(200);
    assert_eq!(claimed["failed"], 4);
    for rest in ["/columns", "/columns/entries"] {
        assert_denied(member.get(&path(&lease, rest)).await, "foreign_lease");
        let _ = admin.get(&path(&lease, rest)).await.expect(200);
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn replaced_token_keeps_the_leases_of_its_principal() {
    let parties = Parties::start(json!({})).await;
    let lease = parties.owner.lease("run", json!({"groups": 2})).await;
    let rotated = parties.create_client("owner-2", "owner", "trainer").await;
    let same_name = parties.create_client("owner", "another", "trainer").await;
    assert_denied(same_name.get(&path(&lease, "")).await, "not_run_member");
    let _ = rotated.get(&path(&lease, "")).await.expect(200);
    let _ = rotated.post(&path(&lease, "/renew"), json!({})).await.expect(200);
    let results = lease.results("hold");
    assert_eq!(receipts(&rotated.report("run", results[..1].to_vec()).await, "status"), ["counted"]);
    let in_lease = json!({"run": "run", "lease_id": lease.id()});
    let _ = rotated.clone().with_session("a").post("/reset", in_lease).await.expect(200);
    let _ = rotated
        .send_json("PUT", "/v1/runs/run/policy_version", json!({"policy_version": 3}))
        .await
        .expect(200);
    let _ = rotated.post(&path(&lease, "/release"), json!({})).await.expect(200);
}

#[tokio::test(flavor = "multi_thread")]
async fn sessions_on_another_principals_lease_are_refused() {
    let Parties { server: _server, owner, member, other, .. } = Parties::start(json!({})).await;
    let lease = owner.lease("run", json!({"groups": 2})).await;
    let in_lease = json!({"run": "run", "lease_id": lease.id()});
    // The owner's session loads the lease first, so that it is known when other clients name it.
    let mut own = TestSocket::connect(&owner, "/ws").await;
    let begun = own.request(&json!({"type": "reset", "data": in_lease})).await;
    assert_eq!(begun["type"], "observation", "{begun}");
    for (api, code) in [(&member, "foreign_lease"), (&other, "not_run_member")] {
        let is_refused = |reply: &Value| match code {
            "foreign_lease" => reply.to_string().contains("belongs to another principal"),
            _ => reply.to_string().contains("no member"),
        };
        for vector in [Value::Null, json!({"envs": 1, "autoreset": "next_step", "observe": "tracks"})] {
            let mut open = json!({"type": "open", "version": 2, "vector": vector});
            open.as_object_mut().unwrap().extend(in_lease.as_object().unwrap().clone());
            let reply = TestSocket::connect(api, "/v1/sessions").await.request(&open).await;
            assert_eq!((&reply["type"], &reply["code"]), (&json!("error"), &json!(code)), "{reply}");
        }
        let reply = api.clone().with_session("a").post("/reset", in_lease.clone()).await.expect(403);
        assert!(is_refused(&reply), "{reply}");
        let create =
            json!({"jsonrpc": "2.0", "id": 1, "method": "openenv/session/create", "params": in_lease});
        let reply = api.post("/mcp", create).await.expect(200);
        assert!(reply["error"].is_object() && is_refused(&reply), "{reply}");
        let mut socket = TestSocket::connect(api, "/ws").await;
        let reply = socket.request(&json!({"type": "reset", "data": in_lease})).await;
        assert!(reply["type"] == "error" && is_refused(&reply), "{reply}");
    }
    // A client that takes no part in the run cannot open sessions of the run either.
    let reply = other.clone().with_session("b").post("/reset", json!({"run": "run"})).await.expect(403);
    assert!(
        reply.to_string().contains("sparring runs members"),
        "the message says how to become a member: {reply}"
    );
}

/// Sessions of two principals that name the same group have a lease each, which belongs to the server.
#[tokio::test(flavor = "multi_thread")]
async fn principals_do_not_share_named_groups() {
    let Parties { server: _server, owner, member, admin, .. } =
        Parties::start(json!({"group_size": 2})).await;
    let _ = owner.lease("run", json!({"groups": 1})).await; // waits until scenarios are prepared
    let in_group = json!({"run": "run", "group_id": "g"});
    let mut leases = Vec::new();
    for (api, session) in [(&owner, "a"), (&owner, "b"), (&member, "a")] {
        let api = api.clone().with_session(session);
        let _ = api.post("/reset", in_group.clone()).await.expect(200);
        let episode = api.get("/state").await.expect(200)["episode_id"].as_str().unwrap().to_owned();
        leases.push(episode.split('_').nth(1).unwrap().to_owned());
    }
    assert_eq!(leases[0], leases[1]);
    assert_ne!(leases[0], leases[2]);
    // A report cannot replace the steps of the session.
    assert_denied(
        owner.post(&format!("/v1/runs/run/leases/{}/release", leases[0]), json!({})).await,
        "foreign_lease",
    );
    let failed = json!({"episode": format!("ep_{}_0", leases[0]), "status": "failed", "reason": "x"});
    assert_eq!(receipts(&owner.report("run", vec![failed]).await, "code"), ["foreign_lease"]);
    assert_eq!(listed_leases(&admin).await.len(), 3);
}

#[tokio::test(flavor = "multi_thread")]
async fn server_rollouts_belong_to_the_server() {
    let Parties { server: _server, owner, member, other, admin, .. } = Parties::start(json!({})).await;
    let rollouts = json!({"policy": "hold", "max_unacknowledged_groups": 2});
    assert_denied(put_policy(&member, "run", rollouts.clone()).await, "not_run_owner");
    let _ = put_policy(&owner, "run", rollouts).await.expect(200);
    wait_for_full_feed(&owner, "run").await;
    let lease = listed_leases(&admin).await[0].clone();
    assert_eq!(listed_leases(&owner).await, [""; 0]);
    for rest in ["/renew", "/release"] {
        assert_denied(
            owner.post(&format!("/v1/runs/run/leases/{lease}{rest}"), json!({})).await,
            "foreign_lease",
        );
    }
    let failed = json!({"episode": format!("ep_{lease}_0"), "status": "failed", "reason": "x"});
    assert_eq!(receipts(&owner.report("run", vec![failed]).await, "code"), ["foreign_lease"]);
    // Members pull the feed, other trainers do not.
    assert_denied(other.get("/v1/runs/run/trajectories").await, "not_run_member");
    let acknowledge = json!({"ids": [1]});
    assert_denied(other.post("/v1/runs/run/trajectories/ack", acknowledge.clone()).await, "not_run_member");
    assert_denied(other.post("/v1/runs/run/trajectories/claim", json!({})).await, "not_run_member");
    let groups = member.post("/v1/runs/run/trajectories/claim", json!({})).await.expect(200);
    assert_eq!(groups["groups"].as_array().unwrap().len(), 2);
    let _ = member.post("/v1/runs/run/trajectories/ack", acknowledge).await.expect(200);
}
