//! Lifecycle of layouts: a run with failures gets layouts for them, leases serve layouts as drawn, and layouts retire,
//! return or are never served.

use std::collections::{BTreeMap, BTreeSet};

use designer::FailureProfile;
use env_core::KeyedRng;
use env_core::critique::profile_sector;
use env_core::keyed_rng::RngPurpose;
use serde_json::{Value, json};
use system_tests::{ApiClient, Lease, Server, run_policy};

use super::{TASK, create, design_summary, report_losses, wait_for_critiques, wait_for_response};

/// Waits until at least `layouts` layouts are active and no design request is open.
pub(super) async fn wait_for_stock(api: &ApiClient, layouts: u64) {
    wait_for_response(api, "/v1/runs/run/designs/statistics", |summary| {
        summary["tasks"][0]["active"].as_u64() >= Some(layouts)
    })
    .await;
    wait_for_response(api, "/v1/runs/run/designs/requests", |page| {
        page["requests"]
            .as_array()
            .is_some_and(|requests| requests.iter().all(|request| request["ended_at"].is_string()))
    })
    .await;
}

/// Returns the layout id of each group of a lease.
pub(super) fn layouts_of(lease: &Lease) -> Vec<Option<String>> {
    let groups = lease.0["groups"].as_array().unwrap();
    groups.iter().map(|group| group["layout"].as_str().map(str::to_owned)).collect()
}

/// Returns the ids of the active layouts, oldest first.
async fn active_layouts(api: &ApiClient) -> Vec<String> {
    let page = api.get("/v1/runs/run/designs?state=active&limit=500").await.expect(200);
    let ids = page["designs"].as_array().unwrap().iter().map(|d| d["id"].as_str().unwrap().to_owned());
    ids.rev().collect()
}

/// Computes the layouts of a lease from its draws, three a group, if every active layout may be served and none is retired.
fn expected_layouts(
    seed: u64,
    lease: &Lease,
    groups: usize,
    share: f64,
    stock: &[String],
) -> Vec<Option<String>> {
    let number = lease.id().split_once('-').unwrap().0.parse().unwrap();
    let mut draws = KeyedRng::new(RngPurpose::LayoutSelection, seed, number);
    let mut one = || {
        let designed = draws.uniform() < share;
        let (_, pick) = (draws.uniform(), draws.uniform());
        designed.then(|| stock[(pick * stock.len() as f64) as usize].clone())
    };
    (0..groups).map(|_| one()).collect()
}

#[tokio::test]
async fn leases_serve_layouts_as_drawn() {
    let mut server = Server::start().await;
    let api = server.api();
    create(&api, json!({"share": 0.5, "fixed_share": true, "layout_share": 1.0, "reserve": 4})).await;
    let before = report_losses(&api).await;
    assert_eq!(layouts_of(&before), vec![None; 24], "no layout is in stock yet");
    wait_for_stock(&api, 4).await;
    let stock = active_layouts(&api).await;
    let mut designed = 0;
    for _ in 0..3 {
        let lease = api.lease("run", json!({"groups": 12})).await;
        assert_eq!(layouts_of(&lease), expected_layouts(11, &lease, 12, 0.5, &stock));
        designed += layouts_of(&lease).iter().flatten().count();
        for group in lease.0["groups"].as_array().unwrap() {
            let is_designed = group["layout"].is_string();
            assert_eq!(group["role"] == "designed", is_designed);
            assert_eq!(lease.scenario(group).id().to_string(), group["scenario"].as_str().unwrap());
        }
    }
    assert!((6..30).contains(&designed), "{designed} of 36 groups are designed: the test needs both kinds");
    let summary = design_summary(&api).await;
    assert_eq!((&summary["train_groups"], &summary["designed_groups"]), (&json!(60), &json!(designed)));
    // Only training leases serve layouts.
    for purpose in ["probe", "eval"] {
        let lease = api.lease("run", json!({"groups": 12, "purpose": purpose})).await;
        assert_eq!(layouts_of(&lease), vec![None; 12]);
    }
    server.restart().await;
    let api = server.api();
    assert_eq!(active_layouts(&api).await, stock);
    let lease = api.lease("run", json!({"groups": 12})).await;
    assert_eq!(layouts_of(&lease), expected_layouts(11, &lease, 12, 0.5, &stock));
    assert_layouts_are_published(&api, &stock).await;
}

/// Checks that published layouts are what the gate admitted, and that they can be checked as scenarios.
async fn assert_layouts_are_published(api: &ApiClient, stock: &[String]) {
    let listed = api.get("/v1/layouts?task=kessler/survival&state=active&limit=2").await.expect(200);
    assert_eq!(listed["designs"].as_array().unwrap().len(), 2);
    let next = listed["next"].as_str().unwrap();
    let rest = api.get(&format!("/v1/layouts?limit=500&cursor={next}")).await.expect(200);
    assert_eq!(rest["designs"].as_array().unwrap().len(), stock.len() - 2);
    for id in stock {
        let layout = api.get(&format!("/v1/layouts/{id}")).await.expect(200);
        let checked = api.post("/v1/scenarios", json!({"scenario": layout["scenario"]})).await.expect(200);
        assert_eq!(checked["scenario_id"], layout["scenario_id"]);
        assert_eq!((&checked["fair"], &checked["solvable"]), (&json!(true), &json!(true)));
        assert_eq!(checked["contested"], layout["kind"] == "threat");
        assert_eq!(checked["bracket"], layout["bracket"]);
        assert_eq!(layout["reference_outcome"]["score"], layout["bracket"]["reference"]);
        let design = api.get(&format!("/v1/runs/run/designs/{id}")).await.expect(200);
        assert_eq!(design["design"], layout["design"]);
        assert_eq!(design["table"]["header"][1], "satellite");
        assert_eq!(design["design"]["aim"]["mode"], design["aim"]["mode"]);
        assert_eq!(design["transitions"][0]["state"], "active");
        let request = design["request"].as_str().unwrap();
        let request = api.get(&format!("/v1/runs/run/designs/requests/{request}")).await.expect(200);
        assert_eq!((&request["state"], &request["requested_by"]), (&json!("done"), &json!("worker")));
        let profile: FailureProfile = serde_json::from_value(request["profile"].clone()).unwrap();
        assert_eq!(request["criticised"], profile.criticised);
    }
}

#[tokio::test]
async fn failure_profile_matches_the_critiques() {
    let server = Server::start().await;
    let api = server.api();
    create(&api, json!({"designer": "off"})).await;
    let lease = report_losses(&api).await;
    let mut sectors: BTreeMap<(String, u64), u64> = BTreeMap::new();
    for (_, scenario) in lease.episodes() {
        let critique = scenario.task().critique(&scenario, &run_policy(&scenario, "hold").log).unwrap();
        for failure in critique.failures {
            if let Some(bearing) = failure.encounter.and_then(|e| e.bearing_inertial_deg) {
                *sectors.entry((failure.mode.to_owned(), u64::from(profile_sector(bearing)))).or_default() +=
                    1;
            }
        }
    }
    let answer = wait_for_critiques(&api).await;
    let profile = FailureProfile::parse(&answer.to_string(), Some(TASK)).unwrap();
    let shown = profile.modes.iter().flat_map(|mode| {
        mode.inertial_sectors.iter().map(|at| ((mode.mode.clone(), u64::from(at.sector)), at.count))
    });
    assert_eq!(shown.collect::<BTreeMap<_, _>>(), sectors);
    assert!(sectors.len() > 2, "the test needs failures from several sides");
    for mode in profile.modes.iter().filter(|mode| mode.mode == "collision") {
        let (orbit, inertial) =
            (mode.sector_weights().iter().sum::<f64>(), mode.inertial_sector_weights().iter().sum::<f64>());
        // Sums of the same numbers in another order: some dozens of weights near 1.
        assert!((orbit - inertial).abs() < 1e-9 && (mode.weight - orbit).abs() < 1e-9);
    }
    assert_eq!(answer["tasks"][0]["weight"], profile.weight);
}

/// Returns explanation, status, levels and plain sums of the task of the run.
async fn curriculum_state(api: &ApiClient) -> Value {
    let mastery = api.get("/v1/runs/run/mastery").await.expect(200);
    let task = &mastery["tasks"][0];
    json!([mastery["explanation"], task["status"], task["levels"], task["results"]])
}

#[tokio::test]
async fn designed_groups_are_no_evidence() {
    let server = Server::start().await;
    let api = server.api();
    create(&api, json!({"share": 1.0, "fixed_share": true, "layout_share": 1.0, "reserve": 6})).await;
    report_losses(&api).await;
    wait_for_stock(&api, 6).await;
    let before = curriculum_state(&api).await;
    let lease = api.lease("run", json!({"groups": 10})).await;
    assert!(layouts_of(&lease).iter().all(Option::is_some), "all groups are designed");
    let report = api.report("run", lease.results("hold")).await;
    let statuses: BTreeSet<&str> =
        report["results"].as_array().unwrap().iter().map(|r| r["status"].as_str().unwrap()).collect();
    assert_eq!(statuses, BTreeSet::from(["stored"]));
    assert_eq!(curriculum_state(&api).await, before);
    let mastery = api.get("/v1/runs/run/mastery").await.expect(200);
    assert_eq!(mastery["tasks"][0]["designed_results"]["episodes"], 20);
    let profile = wait_for_critiques(&api).await;
    assert_eq!(profile["tasks"][0]["criticised"], 48 + 20, "designed episodes are in the failure profile");
    // A layout that the policy fails in two groups retires as hopeless.
    let listed = api.get("/v1/runs/run/designs?limit=500").await.expect(200);
    let designs = listed["designs"].as_array().unwrap().iter().map(|design| (design, &design["results"]));
    let served: Vec<_> = designs.filter(|(_, results)| results["episodes"].as_u64() > Some(0)).collect();
    assert_eq!(served.iter().map(|(_, results)| results["episodes"].as_u64().unwrap()).sum::<u64>(), 20);
    for (design, results) in served.iter().filter(|(design, _)| design["kind"] == "threat") {
        assert_eq!(results["as_aimed"], 1.0, "a holding policy fails as the layout aims: {design}");
    }
    let listed = api.get("/v1/runs/run/episodes?limit=500").await.expect(200);
    let designed = listed["episodes"].as_array().unwrap().iter().filter(|e| e["layout"].is_string());
    assert_eq!(designed.count(), 20);
    assert_release_is_neutral(&api).await;
}

/// Checks that a released designed group ends as lost and does not change the statistics of its layout.
async fn assert_release_is_neutral(api: &ApiClient) {
    let lease = api.lease("run", json!({"groups": 2})).await;
    let ids: Vec<String> = layouts_of(&lease).into_iter().flatten().collect();
    assert_eq!(ids.len(), 2);
    let path = format!("/v1/runs/run/designs/{}", ids[0]);
    let before = api.get(&path).await.expect(200)["results"].clone();
    let _ = api.post(&format!("/v1/runs/run/leases/{}/release", lease.id()), json!({})).await.expect(200);
    assert_eq!(api.get(&path).await.expect(200)["results"], before);
    let shown = api.get(&format!("/v1/runs/run/leases/{}", lease.id())).await.expect(200);
    assert!(shown["groups"].as_array().unwrap().iter().all(|group| group["state"] == "lost"));
    let mastery = api.get("/v1/runs/run/mastery").await.expect(200);
    assert_eq!(mastery["tasks"][0]["designed_results"]["expired"], 4);
}

#[tokio::test]
async fn retired_layout_is_not_served_until_revived() {
    let server = Server::start().await;
    let api = server.api();
    create(&api, json!({"share": 1.0, "fixed_share": true, "layout_share": 1.0, "reserve": 2})).await;
    report_losses(&api).await;
    wait_for_stock(&api, 2).await;
    let stock = active_layouts(&api).await;
    let path = |verb: &str| format!("/v1/runs/run/designs/{}/{verb}", stock[0]);
    let retired = api.post(&path("retire"), json!({})).await.expect(200);
    assert_eq!((&retired["state"], &retired["state_reason"]), (&json!("retired"), &json!("user")));
    assert_eq!(
        api.post(&path("retire"), json!({})).await.expect(200),
        retired,
        "retiring twice has the same result"
    );
    for _ in 0..4 {
        let lease = api.lease("run", json!({"groups": 20})).await;
        assert!(!layouts_of(&lease).contains(&Some(stock[0].clone())));
    }
    let revived = api.post(&path("revive"), json!({})).await.expect(200);
    assert_eq!(revived["state"], "active");
    let lease = api.lease("run", json!({"groups": 40})).await;
    // With at most three layouts, 40 draws miss one with probability 1e-7; the draws are fixed.
    assert!(layouts_of(&lease).contains(&Some(stock[0].clone())));
    let shown = api.get(&format!("/v1/runs/run/designs/{}", stock[0])).await.expect(200);
    let states: Vec<&str> =
        shown["transitions"].as_array().unwrap().iter().map(|t| t["state"].as_str().unwrap()).collect();
    assert_eq!(states, ["active", "retired", "active"]);
    assert_eq!(api.post("/v1/runs/run/designs/layout-99999/retire", json!({})).await.status, 404);
}

#[tokio::test]
async fn mastered_layout_retires_and_returns_if_forgotten() {
    let server = Server::start().await;
    let api = server.api();
    create(&api, json!({"share": 1.0, "fixed_share": true, "layout_share": 1.0, "reserve": 1})).await;
    report_losses(&api).await;
    wait_for_stock(&api, 1).await;
    let first = active_layouts(&api).await.remove(0);
    let layout = api.get(&format!("/v1/layouts/{first}")).await.expect(200);
    let scenario = env_core::Scenario::from_json(&layout["scenario"]).unwrap();
    let bracket = env_core::admission::admit(&scenario).bracket.unwrap();
    let witness = system_tests::log_to_json(&bracket.reference_plan);
    for _ in 0..8 {
        let lease = api.lease("run", json!({"groups": 1})).await;
        let groups = lease.0["groups"].as_array().unwrap();
        if groups[0]["layout"] != json!(first) {
            break;
        }
        let replay_plan = |(episode, _): (String, _)| json!({"episode": episode, "actions": witness});
        api.report("run", lease.episodes().into_iter().map(replay_plan).collect()).await;
    }
    let shown = api.get(&format!("/v1/runs/run/designs/{first}")).await.expect(200);
    assert_eq!((&shown["state"], &shown["state_reason"]), (&json!("retired"), &json!("mastered")), "{shown}");
    assert_eq!(shown["results"]["recent"], json!([1.0, 1.0]));
    assert_eq!(shown["episodes"].as_array().unwrap().len(), 4);
    assert_eq!(design_summary(&api).await["tasks"][0]["retired"]["mastered"], 1);

    // The draws decide where the retired layout is probed; a failure of the policy revives it.
    let lease = api.lease("run", json!({"groups": 60})).await;
    let number = lease.id().split_once('-').unwrap().0.parse().unwrap();
    let mut draws = KeyedRng::new(RngPurpose::LayoutSelection, 11, number);
    let probes: Vec<bool> = (0..60).map(|_| [(); 3].map(|()| draws.uniform())[1] < 0.05).collect();
    let served = layouts_of(&lease);
    assert!(probes.contains(&true), "60 draws with probability 1/20 have a probe");
    for (layout, probes) in served.iter().zip(&probes) {
        assert_eq!(layout.as_ref() == Some(&first), *probes, "{served:?}");
    }
    assert_eq!(layout["kind"], "threat", "a holding policy fails it");
    api.report("run", lease.results("hold")).await;
    let shown = api.get(&format!("/v1/runs/run/designs/{first}")).await.expect(200);
    // The policy fails each group: the second failure retires the layout once more.
    let transitions = shown["transitions"].as_array().unwrap();
    assert_eq!(transitions[2]["state"], "active", "{shown}");
    assert!(transitions[2]["reason"].as_str().unwrap().contains("success fell to"), "{shown}");
    assert!(probes.iter().filter(|probes| **probes).count() > 1, "the test needs two probes");
    assert_eq!((&transitions[3]["state"], &shown["state_reason"]), (&json!("retired"), &json!("hopeless")));
}

#[tokio::test]
async fn layout_stays_within_its_share() {
    let server = Server::start().await;
    let api = server.api();
    create(&api, json!({"share": 1.0, "fixed_share": true, "layout_share": 0.1, "reserve": 1})).await;
    report_losses(&api).await;
    wait_for_stock(&api, 1).await;
    let first = active_layouts(&api).await.remove(0);
    let (mut leased, mut served) = (0u32, 0u32);
    for _ in 0..5 {
        let lease = api.lease("run", json!({"groups": 16})).await;
        for layout in layouts_of(&lease) {
            served += u32::from(layout.as_ref() == Some(&first));
            leased += 1;
            assert!(f64::from(served) <= (0.1 * f64::from(leased)).max(4.0), "{served} of {leased}");
        }
    }
    assert!(served >= 4, "a layout may always be served four times");
}

/// Reports episodes of a holding policy on 24 scenarios that holding fails, and waits for their critiques.
async fn report_losses_of(api: &ApiClient, run: &str) {
    let lease = api.lease(run, json!({"groups": 24})).await;
    api.report(run, lease.results("hold")).await;
    wait_for_response(api, &format!("/v1/runs/{run}"), |run| run["critique_backlog"]["waiting"] == 0).await;
}

#[tokio::test]
async fn nothing_is_designed_if_designs_are_off() {
    let server = Server::start().await;
    let api = server.api();
    for (id, design) in [("none", json!({"share": 0.0})), ("off", json!({"designer": "off"}))] {
        let settings = json!({
            "id": id, "seed": 11, "group_size": 2, "placement": false, "contested_share": 1.0, "tasks": [TASK],
            "design": design
        });
        let _ = api.post("/v1/runs", settings).await.expect(201);
    }
    report_losses_of(&api, "none").await;
    report_losses_of(&api, "off").await;
    // The worker checks the runs in the order of their ids: when it has made a request for the last one, it has checked all.
    let on = json!({
        "id": "on", "seed": 11, "group_size": 2, "placement": false, "contested_share": 1.0, "tasks": [TASK]
    });
    let _ = api.post("/v1/runs", on).await.expect(201);
    report_losses_of(&api, "on").await;
    wait_for_response(&api, "/v1/runs/on/designs/requests", |page| {
        page["requests"].as_array().is_some_and(|requests| !requests.is_empty())
    })
    .await;
    for id in ["none", "off"] {
        let page = api.get(&format!("/v1/runs/{id}/designs/requests")).await.expect(200);
        assert_eq!(page["requests"], json!([]), "{id}");
        let summary = api.get(&format!("/v1/runs/{id}/designs/statistics")).await.expect(200);
        assert_eq!(summary["designed_groups"], 0);
    }
    let lease = api.lease("none", json!({"groups": 24})).await;
    assert_eq!(layouts_of(&lease), vec![None; 24]);

    // Placement serves no layouts, although one is in stock.
    let placing =
        json!({"id": "placing", "seed": 1, "strategy": "ladder", "tasks": [TASK], "design": {"share": 1.0}});
    let _ = api.post("/v1/runs", placing).await.expect(201);
    let created = api.post("/v1/runs/placing/designs", json!({"count": 1})).await.expect(202);
    let path = format!("/v1/runs/placing/designs/requests/{}", created["id"].as_str().unwrap());
    let request = wait_for_response(&api, &path, |request| request["ended_at"].is_string()).await;
    assert_eq!(request["admitted"], 1, "{request}");
    let lease = api.lease("placing", json!({"groups": 8})).await;
    assert_eq!(layouts_of(&lease), vec![None; 8]);
}
