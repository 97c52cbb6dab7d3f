//! The designer's life: a run that loses gets layouts made for what it loses by, leases contain as many as were drawn, and
//! whatever a designer does the run goes on.

use std::collections::{BTreeMap, BTreeSet};

use designer::Profile;
use env_core::Draws;
use env_core::critique::sector;
use env_core::draws::Purpose;
use serde_json::{Value, json};
use system_tests::{Api, Lease, Server, flown, result};

use super::{TASK, caught_up, create, lose, summary, until};

/// Waits until so many layouts are active, and no ask is open.
async fn stocked(api: &Api, layouts: u64) {
    until(api, "/v1/runs/run/designs/summary", |told| told["tasks"][0]["active"].as_u64() >= Some(layouts))
        .await;
    until(api, "/v1/runs/run/designs/asks", |told| {
        told["asks"].as_array().is_some_and(|asks| asks.iter().all(|ask| ask["ended_at"].is_string()))
    })
    .await;
}

/// Layouts of a lease's groups, in order.
fn layouts_of(lease: &Lease) -> Vec<Option<String>> {
    let groups = lease.0["groups"].as_array().unwrap();
    groups.iter().map(|group| group["layout"].as_str().map(str::to_owned)).collect()
}

/// The active layouts of the run, in the order in which they were made.
async fn active(api: &Api) -> Vec<String> {
    let page = api.get("/v1/runs/run/designs?state=active&limit=500").await.expect(200);
    let ids = page["designs"].as_array().unwrap().iter().map(|d| d["id"].as_str().unwrap().to_owned());
    ids.rev().collect()
}

/// What the draws say a lease gets, where every active layout may be served and none is retired: of each group three draws.
fn drawn(seed: u64, lease: &Lease, groups: usize, share: f64, active: &[String]) -> Vec<Option<String>> {
    let number = lease.id().split_once('-').unwrap().0.parse().unwrap();
    let mut draws = Draws::new(Purpose::Serving, seed, number);
    let mut one = || {
        let designed = draws.uniform() < share;
        let (_, pick) = (draws.uniform(), draws.uniform());
        designed.then(|| active[(pick * active.len() as f64) as usize].clone())
    };
    (0..groups).map(|_| one()).collect()
}

fn held(lease: &Lease) -> Vec<Value> {
    lease.episodes().iter().map(|(episode, scenario)| result(episode, scenario, "hold")).collect()
}

#[tokio::test]
async fn a_run_that_loses_gets_layouts_and_leases_serve_what_is_drawn() {
    let mut server = Server::start().await;
    let api = server.api();
    create(&api, json!({"share": 0.5, "layout_share": 1.0, "stock": 4})).await;
    let before = lose(&api).await;
    assert_eq!(layouts_of(&before), vec![None; 24], "there is nothing in stock yet");
    stocked(&api, 4).await;
    let stock = active(&api).await;
    let mut designed = 0;
    for _ in 0..3 {
        let lease = api.lease("run", json!({"groups": 12})).await;
        assert_eq!(layouts_of(&lease), drawn(11, &lease, 12, 0.5, &stock));
        designed += layouts_of(&lease).iter().flatten().count();
        for group in lease.0["groups"].as_array().unwrap() {
            let is = group["layout"].is_string();
            assert_eq!(group["role"] == "designed", is);
            assert_eq!(lease.scenario(group).id().to_string(), group["scenario"].as_str().unwrap());
        }
    }
    assert!((6..30).contains(&designed), "{designed} of 36: both kinds are there, or this proves little");
    let told = summary(&api).await;
    assert_eq!((&told["train_groups"], &told["designed_groups"]), (&json!(60), &json!(designed)));
    // Only training is designed for.
    for purpose in ["probe", "eval"] {
        let lease = api.lease("run", json!({"groups": 12, "purpose": purpose})).await;
        assert_eq!(layouts_of(&lease), vec![None; 12]);
    }
    server.restart().await;
    let api = server.api();
    assert_eq!(active(&api).await, stock);
    let lease = api.lease("run", json!({"groups": 12})).await;
    assert_eq!(layouts_of(&lease), drawn(11, &lease, 12, 0.5, &stock));
    by_hand(&api, &stock).await;
}

/// What is shown of layouts is what the gate admitted, and can be flown by hand.
async fn by_hand(api: &Api, stock: &[String]) {
    let listed = api.get("/v1/layouts?task=kessler/survival&state=active&limit=2").await.expect(200);
    assert_eq!(listed["designs"].as_array().unwrap().len(), 2);
    let next = listed["next"].as_str().unwrap();
    let rest = api.get(&format!("/v1/layouts?limit=500&cursor={next}")).await.expect(200);
    assert_eq!(rest["designs"].as_array().unwrap().len(), stock.len() - 2);
    for id in stock {
        let layout = api.get(&format!("/v1/layouts/{id}")).await.expect(200);
        let tried = api.post("/v1/scenarios", json!({"scenario": layout["scenario"]})).await.expect(200);
        assert_eq!(tried["scenario_id"], layout["scenario_id"]);
        assert_eq!((&tried["fair"], &tried["solvable"]), (&json!(true), &json!(true)));
        assert_eq!(tried["contested"], layout["claim"] == "threat");
        assert_eq!(tried["bracket"], layout["bracket"]);
        assert_eq!(layout["witness"]["score"], layout["bracket"]["reference"]);
        let design = api.get(&format!("/v1/runs/run/designs/{id}")).await.expect(200);
        assert_eq!(design["design"], layout["design"]);
        assert_eq!(design["design"]["aim"]["mode"], design["aim"]["mode"]);
        assert_eq!(design["turns"][0]["state"], "active");
        let ask = design["ask"].as_str().unwrap();
        let ask = api.get(&format!("/v1/runs/run/designs/asks/{ask}")).await.expect(200);
        assert_eq!((&ask["state"], &ask["asked_by"]), (&json!("done"), &json!("worker")));
        let profile: Profile = serde_json::from_value(ask["profile"].clone()).unwrap();
        assert_eq!(ask["criticised"], profile.criticised);
    }
}

#[tokio::test]
async fn the_profile_shown_is_one_to_design_from() {
    let server = Server::start().await;
    let api = server.api();
    create(&api, json!({"designer": "off"})).await;
    let lease = lose(&api).await;
    let mut sectors: BTreeMap<(String, u64), u64> = BTreeMap::new();
    for (_, scenario) in lease.episodes() {
        let critique = scenario.task().critique(&scenario, &flown(&scenario, "hold").1).unwrap();
        for failure in critique.failures {
            if let Some(bearing) = failure.encounter.and_then(|e| e.bearing_inertial_deg) {
                *sectors.entry((failure.mode.to_owned(), u64::from(sector(bearing)))).or_default() += 1;
            }
        }
    }
    let answer = caught_up(&api).await;
    let profile = Profile::read(&answer.to_string(), Some(TASK)).unwrap();
    let told = profile.modes.iter().flat_map(|mode| {
        mode.inertial.iter().map(|at| ((mode.mode.clone(), u64::from(at.sector)), at.count))
    });
    assert_eq!(told.collect::<BTreeMap<_, _>>(), sectors);
    assert!(sectors.len() > 2, "failures come from several sides, or this proves little");
    for mode in profile.modes.iter().filter(|mode| mode.mode == "collision") {
        let (orbit, inertial) = (mode.rose().iter().sum::<f64>(), mode.inertial_rose().iter().sum::<f64>());
        // The same failures in another order: sums of some dozens of numbers near 1.
        assert!((orbit - inertial).abs() < 1e-9 && (mode.weight - orbit).abs() < 1e-9);
    }
    assert_eq!(answer["tasks"][0]["weight"], profile.weight);
}

/// (events, block, mastery, plain sums) of the run's task.
async fn standing(api: &Api) -> Value {
    let mastery = api.get("/v1/runs/run/mastery").await.expect(200);
    let task = &mastery["tasks"][0];
    json!([mastery["explanation"], task["status"], task["levels"], task["plain"]])
}

#[tokio::test]
async fn outcomes_of_designed_groups_move_nothing_unless_asked() {
    for evidence in [false, true] {
        let server = Server::start().await;
        let api = server.api();
        create(&api, json!({"share": 1.0, "layout_share": 1.0, "evidence": evidence, "stock": 6})).await;
        lose(&api).await;
        stocked(&api, 6).await;
        let before = standing(&api).await;
        let lease = api.lease("run", json!({"groups": 10})).await;
        assert!(layouts_of(&lease).iter().all(Option::is_some), "all are designed");
        let groups = lease.0["groups"].as_array().unwrap();
        // One scenario is one observation, however often it is served.
        let contested = groups.iter().filter(|group| group["contested"] == true);
        let contested = contested.map(|group| group["layout"].to_string()).collect::<BTreeSet<_>>().len();
        let told = api.report("run", held(&lease)).await;
        let statuses: BTreeSet<&str> =
            told["results"].as_array().unwrap().iter().map(|r| r["status"].as_str().unwrap()).collect();
        let after = standing(&api).await;
        if evidence {
            assert!(statuses.contains("counted"), "{statuses:?}");
            let n = |standing: &Value| standing[1]["block"]["n"].as_u64().unwrap();
            assert_eq!(n(&after), (n(&before) + contested as u64) % 32);
            assert_eq!(after[3], before[3], "plain sums keep designed episodes apart all the same");
        } else {
            assert_eq!(statuses, BTreeSet::from(["stored"]));
            assert_eq!(after, before);
        }
        let mastery = api.get("/v1/runs/run/mastery").await.expect(200);
        assert_eq!(mastery["tasks"][0]["designed"]["episodes"], 20);
        let profile = caught_up(&api).await;
        assert_eq!(
            profile["tasks"][0]["criticised"],
            48 + 20,
            "they show failures like all training episodes"
        );
        let flown = api.get("/v1/runs/run/designs?state=active").await.expect(200);
        let flown = flown["designs"].as_array().unwrap().iter().map(|design| (design, &design["flown"]));
        let flown: Vec<_> = flown.filter(|(_, flown)| flown["episodes"].as_u64() > Some(0)).collect();
        assert_eq!(flown.iter().map(|(_, flown)| flown["episodes"].as_u64().unwrap()).sum::<u64>(), 20);
        for (design, flown) in flown.iter().filter(|(design, _)| design["claim"] == "threat") {
            assert_eq!(flown["as_aimed"], 1.0, "who holds is hit by what the layout aims with: {design}");
        }
        let listed = api.get("/v1/runs/run/episodes?limit=500").await.expect(200);
        let designed = listed["episodes"].as_array().unwrap().iter().filter(|e| e["layout"].is_string());
        assert_eq!(designed.count(), 20);
        given_back(&api).await;
    }
}

/// A designed group that is given back just ends: its layout has it counted as leased, and learns nothing.
async fn given_back(api: &Api) {
    let lease = api.lease("run", json!({"groups": 2})).await;
    let ids: Vec<String> = layouts_of(&lease).into_iter().flatten().collect();
    assert_eq!(ids.len(), 2);
    let path = format!("/v1/runs/run/designs/{}", ids[0]);
    let before = api.get(&path).await.expect(200)["flown"].clone();
    let _ = api.post(&format!("/v1/runs/run/leases/{}/release", lease.id()), json!({})).await.expect(200);
    assert_eq!(api.get(&path).await.expect(200)["flown"], before);
    let shown = api.get(&format!("/v1/runs/run/leases/{}", lease.id())).await.expect(200);
    assert!(shown["groups"].as_array().unwrap().iter().all(|group| group["state"] == "lost"));
    let mastery = api.get("/v1/runs/run/mastery").await.expect(200);
    assert_eq!(mastery["tasks"][0]["designed"]["expired"], 4);
}

#[tokio::test]
async fn a_layout_that_was_taken_out_is_never_served_and_one_put_back_is() {
    let server = Server::start().await;
    let api = server.api();
    create(&api, json!({"share": 1.0, "layout_share": 1.0, "stock": 2})).await;
    lose(&api).await;
    stocked(&api, 2).await;
    let stock = active(&api).await;
    let path = |verb: &str| format!("/v1/runs/run/designs/{}/{verb}", stock[0]);
    let retired = api.post(&path("retire"), json!({})).await.expect(200);
    assert_eq!((&retired["state"], &retired["why"]), (&json!("retired"), &json!("hand")));
    assert_eq!(api.post(&path("retire"), json!({})).await.expect(200), retired, "twice is the same as once");
    for _ in 0..4 {
        let lease = api.lease("run", json!({"groups": 20})).await;
        assert!(!layouts_of(&lease).contains(&Some(stock[0].clone())));
    }
    let revived = api.post(&path("revive"), json!({})).await.expect(200);
    assert_eq!(revived["state"], "active");
    let lease = api.lease("run", json!({"groups": 40})).await;
    // Of at most three layouts one that is drawn 40 times is missed with a probability of 1e-7, and draws are fixed.
    assert!(layouts_of(&lease).contains(&Some(stock[0].clone())));
    let shown = api.get(&format!("/v1/runs/run/designs/{}", stock[0])).await.expect(200);
    let states: Vec<&str> =
        shown["turns"].as_array().unwrap().iter().map(|t| t["state"].as_str().unwrap()).collect();
    assert_eq!(states, ["active", "retired", "active"]);
    assert_eq!(api.post("/v1/runs/run/designs/layout-99999/retire", json!({})).await.status, 404);
}

#[tokio::test]
async fn what_is_mastered_retires_and_is_told() {
    let server = Server::start().await;
    let api = server.api();
    create(&api, json!({"share": 1.0, "layout_share": 1.0, "stock": 1})).await;
    lose(&api).await;
    stocked(&api, 1).await;
    let first = active(&api).await.remove(0);
    let layout = api.get(&format!("/v1/layouts/{first}")).await.expect(200);
    let scenario = env_core::Scenario::from_json(&layout["scenario"]).unwrap();
    let bracket = env_core::bracket::admit(&scenario).bracket.unwrap();
    let witness = system_tests::wire(&bracket.witness);
    for _ in 0..8 {
        let lease = api.lease("run", json!({"groups": 1})).await;
        let groups = lease.0["groups"].as_array().unwrap();
        if groups[0]["layout"] != json!(first) {
            break;
        }
        let fly = |(episode, _): (String, _)| json!({"episode": episode, "actions": witness});
        api.report("run", lease.episodes().into_iter().map(fly).collect()).await;
    }
    let shown = api.get(&format!("/v1/runs/run/designs/{first}")).await.expect(200);
    assert_eq!((&shown["state"], &shown["why"]), (&json!("retired"), &json!("mastered")), "{shown}");
    assert_eq!(shown["flown"]["recent"], json!(vec![1.0; 8]));
    assert_eq!(shown["episodes"].as_array().unwrap().len(), 16);
    assert_eq!(summary(&api).await["tasks"][0]["retired"]["mastered"], 1);

    // It is tried again where the draws say so, and comes back once the agent fails on it.
    let lease = api.lease("run", json!({"groups": 60})).await;
    let number = lease.id().split_once('-').unwrap().0.parse().unwrap();
    let mut draws = Draws::new(Purpose::Serving, 11, number);
    let probes: Vec<bool> = (0..60).map(|_| [(); 3].map(|()| draws.uniform())[1] < 0.05).collect();
    let served = layouts_of(&lease);
    assert!(probes.contains(&true), "60 draws of 1 in 20");
    for (layout, probes) in served.iter().zip(&probes) {
        assert_eq!(layout.as_ref() == Some(&first), *probes, "{served:?}");
    }
    assert_eq!(layout["claim"], "threat", "who holds fails on it");
    api.report("run", held(&lease)).await;
    let shown = api.get(&format!("/v1/runs/run/designs/{first}")).await.expect(200);
    assert_eq!(shown["state"], "active", "{shown}");
    assert!(shown["turns"][2]["reason"].as_str().unwrap().contains("forgotten"), "{shown}");
}

#[tokio::test]
async fn no_layout_takes_more_than_its_share() {
    let server = Server::start().await;
    let api = server.api();
    create(&api, json!({"share": 1.0, "layout_share": 0.1, "stock": 1})).await;
    lose(&api).await;
    stocked(&api, 1).await;
    let first = active(&api).await.remove(0);
    let (mut since, mut taken) = (0u32, 0u32);
    for _ in 0..5 {
        let lease = api.lease("run", json!({"groups": 16})).await;
        for layout in layouts_of(&lease) {
            taken += u32::from(layout.as_ref() == Some(&first));
            since += 1;
            assert!(f64::from(taken) <= (0.1 * f64::from(since)).max(4.0), "{taken} of {since}");
        }
    }
    assert!(taken >= 4, "four it may always take");
}

#[tokio::test]
async fn nothing_is_designed_where_nothing_is_wanted() {
    let server = Server::start().await;
    let api = server.api();
    for (id, design) in [("none", json!({"share": 0.0})), ("off", json!({"designer": "off"}))] {
        let wish = json!({
            "id": id, "seed": 11, "group_size": 2, "placement": false, "contested_share": 1.0, "tasks": [TASK],
            "design": design
        });
        let _ = api.post("/v1/runs", wish).await.expect(201);
    }
    let docking = json!({"id": "docks", "seed": 1, "tasks": ["docking/single"]});
    let _ = api.post("/v1/runs", docking).await.expect(201);
    for id in ["none", "off"] {
        let lease = api.lease(id, json!({"groups": 24})).await;
        api.report(id, held(&lease)).await;
    }
    tokio::time::sleep(std::time::Duration::from_secs(3)).await;
    for id in ["none", "off", "docks"] {
        let asks = api.get(&format!("/v1/runs/{id}/designs/asks")).await.expect(200);
        assert_eq!(asks["asks"], json!([]), "{id}");
        let told = api.get(&format!("/v1/runs/{id}/designs/summary")).await.expect(200);
        assert_eq!(told["designed_groups"], 0);
    }
    let lease = api.lease("none", json!({"groups": 24})).await;
    assert_eq!(layouts_of(&lease), vec![None; 24]);

    // Placement serves nothing else, though there is something in stock.
    let placing = json!({"id": "placing", "seed": 1, "tasks": [TASK], "design": {"share": 1.0}});
    let _ = api.post("/v1/runs", placing).await.expect(201);
    let asked = api.post("/v1/runs/placing/designs", json!({"n": 1})).await.expect(202);
    let path = format!("/v1/runs/placing/designs/asks/{}", asked["id"].as_str().unwrap());
    let ask = until(&api, &path, |ask| ask["ended_at"].is_string()).await;
    assert_eq!(ask["admitted"], 1, "{ask}");
    let lease = api.lease("placing", json!({"groups": 8})).await;
    assert_eq!(layouts_of(&lease), vec![None; 8]);
}
