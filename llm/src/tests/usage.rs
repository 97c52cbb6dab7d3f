//! Token usage: which reported counts are accepted, and what failed attempts cost.

use super::*;

/// Prompt and completion tokens that are counted for a response of six bytes (estimated at two tokens) with this reported
/// usage. The request is estimated at 12 tokens, and 100 completion tokens are allowed.
async fn counted_tokens(reported: Value) -> (u64, u64) {
    let mut body = completion("answer");
    body["usage"] = reported;
    let server = start_endpoint([ResponseTemplate::new(200).set_body_json(body)]).await;
    let client = LlmClient::new(test_config(&server.uri())).unwrap();
    let (response, usage) = complete_with_usage(&client, "r").await;
    assert_eq!(response.unwrap().text, "answer");
    assert_eq!(client.spending("r").tokens, usage.tokens_in + usage.tokens_out);
    (usage.tokens_in, usage.tokens_out)
}

#[tokio::test]
async fn malformed_usage_is_replaced_by_the_estimate() {
    let reported = |tokens_in: Value, tokens_out: Value| json!({"prompt_tokens": tokens_in, "completion_tokens": tokens_out});
    assert_eq!(counted_tokens(reported(json!(40), json!(7))).await, (40, 7));
    assert_eq!(counted_tokens(reported(json!(40.0), json!(7.0))).await, (40, 7));
    for odd in [json!(-1), json!(-1.0), json!(1.5), json!("40"), json!(null), json!([]), json!({})] {
        assert_eq!(counted_tokens(reported(odd.clone(), odd)).await, (12, 2));
    }
    for odd in [json!(null), json!("free"), json!([]), json!({}), json!(3)] {
        assert_eq!(counted_tokens(odd).await, (12, 2));
    }
}

#[tokio::test]
async fn implausible_usage_is_limited() {
    // The limit is ten times the estimate plus 1000, or the allowed completion tokens.
    let max = json!({"prompt_tokens": u64::MAX, "completion_tokens": u64::MAX});
    assert_eq!(counted_tokens(max).await, (1_120, 1_020));
    assert_eq!(
        counted_tokens(json!({"prompt_tokens": 1e300, "completion_tokens": 1e19})).await,
        (1_120, 1_020)
    );
    // A model that reasons writes more tokens than the answer shows.
    let huge =
        ChatResponse { tokens_in: Some(u64::MAX), tokens_out: Some(u64::MAX), ..chat_response("answer") };
    let counted = |max_tokens| {
        let huge = Ok(huge.clone());
        async move {
            let ScriptedModel { client, .. } =
                ScriptedModel::new(test_config(NO_ENDPOINT), Duration::ZERO, [huge]);
            let (request, mut usage) = (ChatRequest { max_tokens, ..request() }, TokenUsage::default());
            let call = ChatCall { run: "r", request: &request, deadline: None };
            client.complete(&call, &mut usage).await.unwrap();
            usage.tokens_out
        }
    };
    assert_eq!(counted(30_000).await, 30_000);
    assert_eq!(counted(u32::MAX).await, 10_000_000);
    // Sums saturate.
    let ScriptedModel { client, .. } =
        ScriptedModel::new(test_config(NO_ENDPOINT), Duration::ZERO, [Ok(chat_response("well"))]);
    client.restore_spending("r", Spending { tokens: u64::MAX, cost: 0.0 }, 0);
    complete(&client, "r").await.unwrap();
    assert_eq!(client.spending("r"), Spending { tokens: u64::MAX, cost: 0.0 });
}

#[tokio::test]
async fn invalid_response_costs_its_reported_usage() {
    let usage = json!({"prompt_tokens": 300, "completion_tokens": 90});
    let refusal = |usage: Value| json!({"choices": [{"message": {"refusal": "no"}}], "usage": usage});
    for (body, tokens) in [
        (refusal(usage.clone()), (300, 90)),
        (json!({"choices": [], "usage": usage}), (300, 90)),
        (json!({"choices": null, "usage": {"prompt_tokens": u64::MAX}}), (1_120, 0)),
        (refusal(json!(null)), (12, 0)),
        (json!("what"), (12, 0)),
    ] {
        let server = start_endpoint([ResponseTemplate::new(200).set_body_json(body)]).await;
        let client = LlmClient::new(test_config(&server.uri())).unwrap();
        let (result, usage) = complete_with_usage(&client, "r").await;
        assert_eq!((result.unwrap_err().kind(), (usage.tokens_in, usage.tokens_out)), ("nonsense", tokens));
        assert_eq!(client.spending("r").tokens, tokens.0 + tokens.1);
    }
}

#[tokio::test(start_paused = true)]
async fn each_broken_attempt_costs_its_prompt() {
    let lost = || Err(LlmError::ConnectionLost { reason: "reset".to_owned() });
    let results = || [lost(), lost(), Ok(chat_response("well"))];
    let ScriptedModel { client, .. } =
        ScriptedModel::new(test_config(NO_ENDPOINT), Duration::ZERO, results());
    let (response, usage) = complete_with_usage(&client, "r").await;
    assert!(response.is_ok());
    assert_eq!((usage.tokens_in, usage.tokens_out), (124, 50));
    assert_eq!(client.spending("r").tokens, 174);
    // A budget for two attempts (each reserves 12 + 100) does not allow a third.
    let config = LlmConfig { tokens_per_run: Some(130), max_tokens: 100, ..test_config(NO_ENDPOINT) };
    let ScriptedModel { client, calls } = ScriptedModel::new(config, Duration::ZERO, results());
    let error = complete(&client, "r").await.unwrap_err();
    assert_eq!(error, LlmError::ConnectionLost { reason: "reset".to_owned() });
    assert_eq!((calls.get(), client.spending("r").tokens), (2, 24));
}
