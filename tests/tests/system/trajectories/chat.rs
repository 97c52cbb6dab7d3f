//! A language model flies: what is kept of its words, and what of its failures is its own.

use std::time::Duration;

use designer::llm::{Llm, LlmConfig, WallClock};
use orchestrator::service::Config;
use orchestrator::training::rollout::Endpoint;
use serde_json::{Value, json};
use system_tests::Server;
use system_tests::model::{HOLD, KEY, completion, endpoint, says, sent};
use wiremock::ResponseTemplate;

use super::{check, counted, number, policy, pull, put, run, scenario, until};

pub(crate) const BURN: &str = r#"{"burns":[{"satellite_id":1,"delta_vx":0.2,"delta_vy":-0.1}]}"#;

/// A model that is there, with little patience.
pub(crate) fn model(base: &str) -> LlmConfig {
    let mut config = LlmConfig::new(format!("{base}/v1"), "mock", WallClock::new(|| 0));
    config.key = Some(KEY.to_owned().into());
    config.retries = 0;
    config.backoff = Duration::from_millis(20);
    config.timeout = Duration::from_secs(2);
    config.concurrency = 8;
    config
}

/// A server whose policies ask this model.
pub(crate) async fn server(config: LlmConfig) -> Server {
    let endpoint = Endpoint { llm: Llm::new(config).unwrap(), temperature: Some(0.7) };
    Server::set_up(move |config| Config { endpoint: Some(endpoint.clone()), ..config }).await
}

/// An answer as vLLM gives it.
fn with_tokens(content: &str) -> ResponseTemplate {
    let mut answer = completion(content);
    answer["prompt_token_ids"] = json!([1, 15043, 29871]);
    answer["prompt_logprobs"] = Value::Null;
    answer["choices"][0]["token_ids"] = json!([6377, 29908, 2]);
    let token = |text: &str, logprob: f64| json!({"token": text, "logprob": logprob, "bytes": text.as_bytes(), "top_logprobs": []});
    answer["choices"][0]["logprobs"] =
        json!({"content": [token("{", -0.25), token("\"", -0.5), token("", -0.001)]});
    ResponseTemplate::new(200).set_body_json(answer)
}

#[tokio::test]
async fn every_word_of_a_conversation_is_kept_with_its_tokens() {
    let mock = endpoint([with_tokens(BURN)]).await;
    let server = server(LlmConfig { tokens: true, ..model(&mock.uri()) }).await;
    let api = server.api();
    // A judge that is set for sessions has no say here.
    run(&api, "run", json!({"group_size": 2, "judge": "deterministic"})).await;
    let wish = json!({"policy": "chat", "version": 7, "ahead": 1, "history": 1, "max_tokens": 99});
    assert_eq!(put(&api, "run", wish).await.expect(200)["model"], "mock");
    let groups = pull(&api, "run", "wait_s=50").await;
    let group = &groups[0];
    check(group);
    assert_eq!(
        (&group["policy"], &group["policy_version"], &group["messages"]),
        (&json!("chat"), &json!(7), &json!("kept"))
    );
    let episodes = group["episodes"].as_array().unwrap();
    assert_eq!(episodes.len(), 2);
    let asked = sent(&mock).await;
    assert!(asked.iter().all(|one| one["return_token_ids"] == true && one["logprobs"] == true));
    assert!(asked.iter().all(|one| one["max_tokens"] == 99 && one["temperature"] == 0.7));
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
                (&call["text"], &call["cut"], &call["error"]),
                (&json!(BURN), &json!(false), &Value::Null)
            );
            assert_eq!(
                call["tokens"],
                json!({
                    "prompt": [1, 15043, 29871], "completion": [6377, 29908, 2], "logprobs": [-0.25, -0.5, -0.001],
                })
            );
            // The rules, one exchange, and what is seen now: as it was sent.
            let messages = call["messages"].as_array().unwrap();
            assert_eq!(messages.len(), if at == 0 { 2 } else { 4 });
            assert!(asked.iter().any(|one| one["messages"] == call["messages"]), "it is what was sent");
        }
        assert_eq!(
            episode["metrics"],
            json!({"temperature": 0.7, "tokens_in": 900 * 50, "tokens_out": 20 * 50,
                                              "truncated": false, "invalid_actions": 0})
        );
    }
    assert_eq!(steps, asked.len());
    let now = policy(&api, "run").await;
    assert_eq!((number(&now["tokens_in"]), number(&now["tokens_out"])), (900 * 100, 20 * 100));
    let name = episodes[0]["id"].as_str().unwrap();
    let shown = api.get(&format!("/v1/runs/run/episodes/{name}")).await.expect(200);
    assert_eq!(shown["metrics"], episodes[0]["metrics"]);
    assert_eq!(counted(&api, "run").await, 2);
    insta::assert_json_snapshot!("chat_step", episodes[0]["steps"][1], {
        ".observation" => "[observation]", ".completions[].latency_ms" => "[ms]", ".completions[].messages[0].content" => "[rules]",
    });
}

#[tokio::test]
async fn tokens_are_not_asked_for_where_nobody_says_so() {
    let mock = endpoint([with_tokens(HOLD)]).await;
    let server = server(model(&mock.uri())).await;
    let api = server.api();
    run(&api, "run", json!({"group_size": 1})).await;
    let _ = put(&api, "run", json!({"policy": "chat", "ahead": 1, "temperature": 0.0})).await.expect(200);
    let groups = pull(&api, "run", "wait_s=50").await;
    assert!(!groups[0].to_string().contains("logprobs"));
    for asked in sent(&mock).await {
        assert!(asked.get("logprobs").is_none() && asked.get("return_token_ids").is_none());
        assert_eq!(asked["temperature"], 0.0);
    }
}

/// What the model says is its own doing: the episode is finished, the rest of it flown as hold, and it counts.
#[tokio::test]
async fn what_the_agent_caused_counts() {
    let cut = |content: Value| {
        let mut answer = completion("");
        answer["choices"][0]["message"]["content"] = content;
        answer["choices"][0]["finish_reason"] = json!("length");
        ResponseTemplate::new(200).set_body_json(answer)
    };
    let cases = [
        ("unparsable", vec![says(BURN), says("I would rather not."), says("Really not.")]),
        ("too_long", vec![says(BURN), cut(json!("Let me think, ")), cut(json!("and think again, "))]),
        // A model that thinks where nobody sees it, until it may say no more.
        ("too_long", vec![says(BURN), cut(Value::Null), cut(Value::Null)]),
    ];
    for (word, answers) in cases {
        let mock = endpoint(answers).await;
        let server = server(model(&mock.uri())).await;
        let api = server.api();
        run(&api, "run", json!({"group_size": 1})).await;
        let _ = put(&api, "run", json!({"policy": "chat", "ahead": 1})).await.expect(200);
        let groups = pull(&api, "run", "wait_s=50").await;
        check(&groups[0]);
        let episode = &groups[0]["episodes"][0];
        assert_eq!(episode["stopped"], word);
        let steps = episode["steps"].as_array().unwrap();
        assert_eq!(steps.len(), 2, "one action, and none");
        assert_eq!(steps[1]["action"], Value::Null);
        assert!(steps[1]["error"].as_str().unwrap().contains("no action"), "{}", steps[1]["error"]);
        assert_eq!(steps[1]["completions"].as_array().unwrap().len(), 2, "repaired once");
        assert_eq!(steps[1]["completions"][0]["cut"], word == "too_long");
        assert_eq!(episode["metrics"]["invalid_actions"], 2);
        let now = policy(&api, "run").await;
        assert_eq!((number(&now["failed"]), number(&now["episodes"])), (0, 1));
        assert_eq!(counted(&api, "run").await, 1);
        let name = episode["id"].as_str().unwrap();
        let shown = api.get(&format!("/v1/runs/run/episodes/{name}")).await.expect(200);
        assert_eq!(shown["score"], episode["score"]);
    }
}

/// Late while the endpoint answers others: the agent's doing.
#[tokio::test]
async fn an_answer_that_is_late_while_others_are_not_is_the_agents() {
    let slow = says(HOLD).set_delay(Duration::from_secs(6));
    let mock = endpoint([says(BURN), says(BURN), says(BURN), says(BURN), slow, says(BURN)]).await;
    let server = server(model(&mock.uri())).await;
    let api = server.api();
    run(&api, "run", json!({"group_size": 2})).await;
    let _ = put(&api, "run", json!({"policy": "chat", "ahead": 1})).await.expect(200);
    let groups = pull(&api, "run", "wait_s=50").await;
    check(&groups[0]);
    let episodes = groups[0]["episodes"].as_array().unwrap();
    let mut ends: Vec<(&str, usize)> = episodes
        .iter()
        .map(|one| (one["stopped"].as_str().unwrap_or("flown"), one["steps"].as_array().unwrap().len()))
        .collect();
    ends.sort_unstable();
    assert_eq!(
        ends[0],
        ("flown", scenario(&groups[0]).task().horizon(scenario(&groups[0]).recipe()) as usize)
    );
    assert_eq!(ends[1].0, "too_late");
    assert!((2..=4).contains(&ends[1].1), "{ends:?}");
    assert_eq!(counted(&api, "run").await, 2);
}

/// Where an endpoint is not held to a schema, what it was told instead is in the messages.
#[tokio::test]
async fn messages_are_what_was_sent_whatever_the_endpoint_can() {
    let no = ResponseTemplate::new(400)
        .set_body_json(json!({"error": {"message": "response_format json_schema is not supported"}}));
    let mock = endpoint([no.clone(), no, says(HOLD)]).await;
    let server = server(model(&mock.uri())).await;
    let api = server.api();
    run(&api, "run", json!({"group_size": 1})).await;
    let _ = put(&api, "run", json!({"policy": "chat", "ahead": 1})).await.expect(200);
    let groups = pull(&api, "run", "wait_s=50").await;
    let asked = sent(&mock).await;
    let told = &groups[0]["episodes"][0]["steps"][0]["completions"][0]["messages"];
    assert_eq!(*told, asked[2]["messages"]);
    assert!(told[1]["content"].as_str().unwrap().contains("JSON schema"), "{told}");
    until(&api, "run", "counted", |told| number(&told["groups"]) == 1).await;
}
