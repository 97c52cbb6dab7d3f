//! Slow models, and briefs with a time limit.

use super::*;

/// Delay of each answer of [`slow_client`].
const DELAY: Duration = Duration::from_secs(100);

async fn design_within(client: &LlmClient, count: usize, seconds: u64) -> Result<DesignOutcome, LlmError> {
    design_for(client, &DesignBrief { time_limit: Some(Duration::from_secs(seconds)), ..brief(count) }).await
}

fn offline_config() -> LlmConfig {
    test_config("http://127.0.0.1:1")
}

/// Client whose model answers each request with the same good design after [`DELAY`].
fn slow_client() -> ScriptedModel {
    let text = layouts(&good_designs(1)[..1]);
    ScriptedModel::new(offline_config(), DELAY, [Ok(chat_response(&text))])
}

#[tokio::test(start_paused = true)]
async fn layouts_before_the_time_limit_are_kept() {
    let ScriptedModel { client, calls } = slow_client();
    let designed = design_within(&client, 4, 250).await.unwrap();
    assert_eq!((designed.admitted(), designed.usage.rounds, calls.get()), (1, 2, 3));
    assert_eq!(designed.warnings, ["the time limit ended the request after 250 s"]);
    // The third call was sent but not answered: its prompt counts.
    let usage = &designed.usage;
    assert!(usage.tokens_in > 200 && usage.tokens_out == 100, "{usage:?}");
    assert_eq!(client.spending("r").tokens, usage.tokens_in + usage.tokens_out);
    // The caller's time limit is not the endpoint's failure.
    let health = client.health();
    assert_eq!((health.consecutive_failures, health.breaker), (0, BreakerState::Closed));
    // No call starts at the time limit.
    let ScriptedModel { client, calls } = slow_client();
    let designed = design_within(&client, 4, 200).await.unwrap();
    assert_eq!((designed.usage.rounds, calls.get()), (2, 2));
    assert_eq!(designed.warnings, ["the time limit ended the request after 200 s"]);
}

#[tokio::test(start_paused = true)]
async fn no_answer_within_the_time_limit_is_an_error() {
    let ScriptedModel { client, calls } = slow_client();
    let limit = Duration::from_secs(99);
    let error = design_within(&client, 1, 99).await.unwrap_err();
    assert!(matches!(error, LlmError::Timeout { after } if after >= limit));
    assert_eq!(calls.get(), 1);
    assert!(matches!(design_within(&client, 1, 0).await, Err(LlmError::Timeout { .. })));
    assert_eq!(calls.get(), 1);
    let designed = design_within(&client, 1, u64::MAX).await.unwrap();
    assert_eq!((designed.admitted(), designed.warnings.len()), (1, 0));
    // The wait for a free slot counts too.
    let config = LlmConfig { concurrency: 1, ..offline_config() };
    let ScriptedModel { client, .. } =
        ScriptedModel::new(config, DELAY, [Ok(chat_response(&layouts(&good_designs(1))))]);
    let (first, second) = tokio::join!(design_within(&client, 1, 150), design_within(&client, 1, 50));
    assert_eq!((first.unwrap().admitted(), second.unwrap_err().kind()), (1, "timeout"));
}

#[tokio::test(start_paused = true)]
async fn pause_beyond_the_time_limit_is_not_waited_for() {
    let limited = Err(LlmError::RateLimited { retry_after: Some(Duration::from_secs(30)) });
    let ScriptedModel { client, calls } =
        ScriptedModel::new(offline_config(), Duration::from_secs(1), [limited]);
    let started = tokio::time::Instant::now();
    assert_eq!(design_within(&client, 1, 20).await.unwrap_err().kind(), "rate_limited");
    assert_eq!((calls.get(), started.elapsed().as_secs()), (1, 1));
}
