//! Server rollouts of a language model: stored conversations, and which faults count for the policy.

use std::time::Duration;

use llm::{LlmClient, LlmConfig, WallClock};
use orchestrator::service::Config;
use rollout::Endpoint;
use serde_json::{Value, json};
use system_tests::Server;
use system_tests::mock_llm::{
    API_KEY, HOLD_ACTION, chat_completion, chat_response, received_bodies, start_endpoint,
};
use wiremock::ResponseTemplate;

use super::{
    assert_group_replays, claim, counted_episodes, create_run, group_scenario, number, policy, put_policy,
    wait_for_policy,
};

pub(crate) const BURN: &str = r#"{"burns":[{"satellite_id":1,"delta_vx":0.2,"delta_vy":-0.1}]}"#;

/// Configuration of a client for the endpoint at `base`, with a timeout that no response on a busy machine exceeds.
pub(crate) fn model_config(base: &str) -> LlmConfig {
    let mut config = LlmConfig::new(format!("{base}/v1"), "mock", WallClock::new(|| 0));
    config.key = Some(API_KEY.to_owned().into());
    config.retries = 0;
    config.backoff = Duration::from_millis(20);
    config.timeout = Duration::from_secs(60);
    config.concurrency = 8;
    config
}

/// Starts a server whose chat policy uses this endpoint.
pub(crate) async fn start_server(config: LlmConfig) -> Server {
    let endpoint = Endpoint { llm: LlmClient::new(config).unwrap(), temperature: Some(0.7) };
    Server::with_config(move |config| Config { endpoint: Some(endpoint.clone()), ..config }).await
}

/// Builds a response with token details in the form of vLLM.
fn response_with_tokens(content: &str) -> ResponseTemplate {
    let mut response = chat_completion(content);
    response["prompt_token_ids"] = json!([1, 15043, 29871]);
    response["prompt_logprobs"] = Value::Null;
    response["choices"][0]["token_ids"] = json!([6377, 29908, 2]);
    let token = |text: &str, logprob: f64| json!({"token": text, "logprob": logprob, "bytes": text.as_bytes(), "top_logprobs": []});
    response["choices"][0]["logprobs"] =
        json!({"content": [token("{", -0.25), token("\"", -0.5), token("", -0.001)]});
    ResponseTemplate::new(200).set_body_json(response)
}

#[tokio::test]
async fn conversations_are_stored_with_their_tokens() {
    let mock = start_endpoint([response_with_tokens(BURN)]).await;
    let server = start_server(LlmConfig { token_details: true, ..model_config(&mock.uri()) }).await;
    let api = server.api();
    // The judge of the run applies to sessions, not to server rollouts.
    create_run(&api, "run", json!({"group_size": 2, "judge": "deterministic"})).await;
    let settings = json!({"policy": "chat", "version": 7, "max_unacknowledged_groups": 1, "history": 1, "max_tokens": 99});
    assert_eq!(put_policy(&api, "run", settings).await.expect(200)["model"], "mock");
    let groups = claim(&api, "run", json!({"wait_s": 50})).await;
    let group = &groups[0];
    assert_group_replays(group);
    assert_eq!(
        (&group["policy"], &group["policy_version"], &group["messages"]),
        (&json!("chat"), &json!(7), &json!("kept"))
    );
    let episodes = group["episodes"].as_array().unwrap();
    assert_eq!(episodes.len(), 2);
    let requests = received_bodies(&mock).await;
    assert!(requests.iter().all(|one| one["return_token_ids"] == true && one["logprobs"] == true));
    assert!(requests.iter().all(|one| one["max_tokens"] == 99 && one["temperature"] == 0.7));
    let mut steps = 0;
    for episode in episodes {
        assert_eq!(episode["stopped"], Value::Null);
        for (at, step) in episode["steps"].as_array().unwrap().iter().enumerate() {
            steps += 1;
            assert_eq!(step["action"], json!([[1, 0.2, -0.1]]));
            let calls = step["completions"].as_array().unwrap();
            assert_eq!(calls.len(), 1);
            let call = &calls[0];
            assert_eq!(
                (&call["text"], &call["truncated"], &call["error"]),
                (&json!(BURN), &json!(false), &Value::Null)
            );
            assert_eq!(
                call["tokens"],
                json!({
                    "prompt": [1, 15043, 29871], "completion": [6377, 29908, 2], "logprobs": [-0.25, -0.5, -0.001],
                })
            );
            // Rules, one earlier exchange and the current observation, exactly as they were sent.
            let messages = call["messages"].as_array().unwrap();
            assert_eq!(messages.len(), if at == 0 { 2 } else { 4 });
            assert!(
                requests.iter().any(|one| one["messages"] == call["messages"]),
                "the messages equal the request"
            );
        }
        assert_eq!(
            episode["metrics"],
            json!({"temperature": 0.7, "tokens_in": 900 * 50, "tokens_out": 20 * 50,
                                              "truncated": false, "invalid_actions": 0})
        );
    }
    assert_eq!(steps, requests.len());
    let now = policy(&api, "run").await;
    assert_eq!((number(&now["tokens_in"]), number(&now["tokens_out"])), (900 * 100, 20 * 100));
    let name = episodes[0]["id"].as_str().unwrap();
    let shown = api.get(&format!("/v1/runs/run/episodes/{name}")).await.expect(200);
    assert_eq!(shown["metrics"], episodes[0]["metrics"]);
    assert_eq!(counted_episodes(&api, "run").await, 2);
    insta::assert_json_snapshot!("chat_step", episodes[0]["steps"][1], {
        ".observation" => "[observation]", ".completions[].latency_ms" => "[ms]", ".completions[].messages[0].content" => "[rules]",
    });
}

#[tokio::test]
async fn token_details_are_off_by_default() {
    let mock = start_endpoint([response_with_tokens(HOLD_ACTION)]).await;
    let server = start_server(model_config(&mock.uri())).await;
    let api = server.api();
    create_run(&api, "run", json!({"group_size": 1})).await;
    let _ = put_policy(
        &api,
        "run",
        json!({"policy": "chat", "max_unacknowledged_groups": 1, "temperature": 0.0}),
    )
    .await
    .expect(200);
    let groups = claim(&api, "run", json!({"wait_s": 50})).await;
    assert!(!groups[0].to_string().contains("logprobs"));
    for request in received_bodies(&mock).await {
        assert!(request.get("logprobs").is_none() && request.get("return_token_ids").is_none());
        assert_eq!(request["temperature"], 0.0);
    }
}

/// Invalid actions are the model's fault: the episode is completed with holds, and it counts.
#[tokio::test]
async fn faults_of_the_model_count() {
    let cut_response = |content: Value| {
        let mut response = chat_completion("");
        response["choices"][0]["message"]["content"] = content;
        response["choices"][0]["finish_reason"] = json!("length");
        ResponseTemplate::new(200).set_body_json(response)
    };
    let cases = [
        (
            "unparsable",
            vec![chat_response(BURN), chat_response("I would rather not."), chat_response("Really not.")],
        ),
        (
            "too_long",
            vec![
                chat_response(BURN),
                cut_response(json!("Let me think, ")),
                cut_response(json!("and think again, ")),
            ],
        ),
        // A model that spends all its tokens on hidden reasoning.
        ("too_long", vec![chat_response(BURN), cut_response(Value::Null), cut_response(Value::Null)]),
    ];
    for (stopped, responses) in cases {
        let mock = start_endpoint(responses).await;
        let server = start_server(model_config(&mock.uri())).await;
        let api = server.api();
        create_run(&api, "run", json!({"group_size": 1})).await;
        let _ = put_policy(&api, "run", json!({"policy": "chat", "max_unacknowledged_groups": 1}))
            .await
            .expect(200);
        let groups = claim(&api, "run", json!({"wait_s": 50})).await;
        assert_group_replays(&groups[0]);
        let episode = &groups[0]["episodes"][0];
        assert_eq!(episode["stopped"], stopped);
        let steps = episode["steps"].as_array().unwrap();
        assert_eq!(steps.len(), 2, "one valid and one missing action");
        assert_eq!(steps[1]["action"], Value::Null);
        assert!(steps[1]["error"].as_str().unwrap().contains("not an action"), "{}", steps[1]["error"]);
        assert_eq!(steps[1]["completions"].as_array().unwrap().len(), 2, "repaired once");
        assert_eq!(steps[1]["completions"][0]["truncated"], stopped == "too_long");
        assert_eq!(episode["metrics"]["invalid_actions"], 2);
        let now = policy(&api, "run").await;
        assert_eq!((number(&now["failed"]), number(&now["episodes"])), (0, 1));
        assert_eq!(counted_episodes(&api, "run").await, 1);
        let name = episode["id"].as_str().unwrap();
        let shown = api.get(&format!("/v1/runs/run/episodes/{name}")).await.expect(200);
        assert_eq!(shown["score"], episode["score"]);
    }
}

/// A timeout counts as the model's fault if the endpoint responds to other requests meanwhile.
#[tokio::test]
async fn timeout_of_one_request_counts_as_the_models_fault() {
    let slow = chat_response(HOLD_ACTION).set_delay(Duration::from_secs(300));
    let mock = start_endpoint([
        chat_response(BURN),
        chat_response(BURN),
        chat_response(BURN),
        chat_response(BURN),
        slow,
        chat_response(BURN),
    ])
    .await;
    let timeout = Duration::from_secs(10);
    let server = start_server(LlmConfig { timeout, ..model_config(&mock.uri()) }).await;
    let api = server.api();
    create_run(&api, "run", json!({"group_size": 2})).await;
    let _ =
        put_policy(&api, "run", json!({"policy": "chat", "max_unacknowledged_groups": 1})).await.expect(200);
    let groups = claim(&api, "run", json!({"wait_s": 50})).await;
    assert_group_replays(&groups[0]);
    let episodes = groups[0]["episodes"].as_array().unwrap();
    let mut outcomes: Vec<(&str, usize)> = episodes
        .iter()
        .map(|one| (one["stopped"].as_str().unwrap_or("flown"), one["steps"].as_array().unwrap().len()))
        .collect();
    outcomes.sort_unstable();
    assert_eq!(
        outcomes[0],
        ("flown", group_scenario(&groups[0]).task().horizon(group_scenario(&groups[0]).recipe()) as usize)
    );
    assert_eq!(outcomes[1].0, "too_late");
    assert!((2..=4).contains(&outcomes[1].1), "{outcomes:?}");
    assert_eq!(counted_episodes(&api, "run").await, 2);
}

/// If the endpoint does not support JSON schemas, the stored messages have the schema that was sent as text.
#[tokio::test]
async fn stored_messages_equal_the_sent_ones() {
    let no = ResponseTemplate::new(400)
        .set_body_json(json!({"error": {"message": "response_format json_schema is not supported"}}));
    let mock = start_endpoint([no.clone(), no, chat_response(HOLD_ACTION)]).await;
    let server = start_server(model_config(&mock.uri())).await;
    let api = server.api();
    create_run(&api, "run", json!({"group_size": 1})).await;
    let _ =
        put_policy(&api, "run", json!({"policy": "chat", "max_unacknowledged_groups": 1})).await.expect(200);
    let groups = claim(&api, "run", json!({"wait_s": 50})).await;
    let requests = received_bodies(&mock).await;
    let messages = &groups[0]["episodes"][0]["steps"][0]["completions"][0]["messages"];
    assert_eq!(*messages, requests[2]["messages"]);
    assert!(messages[1]["content"].as_str().unwrap().contains("JSON schema"), "{messages}");
    wait_for_policy(&api, "run", "the group is counted", |policy| number(&policy["groups"]) == 1).await;
}
