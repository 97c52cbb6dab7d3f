//! A model that is slow, and a designer that nobody waits for long.

use super::*;

async fn patient(llm: &Llm, count: usize, patience: u64) -> Result<Designed, LlmError> {
    let brief = Brief { patience: Some(Duration::from_secs(patience)), ..brief(count) };
    llm.designer("r").design(&brief, &mut gate(&brief)).await.map_err(|error| match error {
        crate::DesignError::Model(error) => error,
        other => panic!("{other}"),
    })
}

fn slow(count: usize) -> (Llm, Arc<Mutex<u32>>) {
    let text = list(&good(count)[..1]);
    Puppet::llm(config("http://127.0.0.1:1"), Duration::from_secs(100), [Ok(reply(&text))])
}

#[tokio::test(start_paused = true)]
async fn what_a_slow_model_gave_in_time_is_kept() {
    let (llm, asked) = slow(1);
    let designed = patient(&llm, 4, 250).await.unwrap();
    assert_eq!((designed.admitted(), designed.usage.rounds, *asked.lock().unwrap()), (1, 2, 3));
    assert_eq!(designed.troubles, ["its time was over after 250 s"]);
    // The third call was sent: it is on the bill and in the books, though it was not answered.
    let usage = &designed.usage;
    assert!(usage.tokens_in > 200 && usage.tokens_out == 100, "{usage:?}");
    assert_eq!(llm.spent("r").tokens, usage.tokens_in + usage.tokens_out);
    // That we had no more time is not the endpoint's failure.
    assert_eq!((llm.health().failures_in_a_row, llm.health().breaker), (0, "closed"));
    // Time that is over to the second begins no further call.
    let (llm, asked) = slow(1);
    let designed = patient(&llm, 4, 200).await.unwrap();
    assert_eq!((designed.usage.rounds, *asked.lock().unwrap()), (2, 2));
    assert_eq!(designed.troubles, ["its time was over after 200 s"]);
}

#[tokio::test(start_paused = true)]
async fn without_any_answer_in_time_it_is_an_error() {
    let (llm, asked) = slow(1);
    let after = Duration::from_secs(99);
    assert!(matches!(patient(&llm, 1, 99).await, Err(LlmError::Timeout { after: a }) if a >= after));
    assert_eq!(*asked.lock().unwrap(), 1);
    assert!(matches!(patient(&llm, 1, 0).await, Err(LlmError::Timeout { .. })));
    assert_eq!(*asked.lock().unwrap(), 1);
    // In time it is as without.
    let designed = patient(&llm, 1, u64::MAX).await.unwrap();
    assert_eq!((designed.admitted(), designed.troubles.len()), (1, 0));
    // Nor is a turn waited for longer than that.
    let config = LlmConfig { concurrency: 1, ..config("http://127.0.0.1:1") };
    let (llm, _) = Puppet::llm(config, Duration::from_secs(100), [Ok(reply(&list(&good(1))))]);
    let (first, second) = tokio::join!(patient(&llm, 1, 150), patient(&llm, 1, 50));
    assert_eq!((first.unwrap().admitted(), second.unwrap_err().word()), (1, "timeout"));
}

#[tokio::test(start_paused = true)]
async fn a_pause_that_outlasts_the_time_is_not_begun() {
    let limited = Err(LlmError::RateLimited { retry_after: Some(Duration::from_secs(30)) });
    let (llm, asked) = Puppet::llm(config("http://127.0.0.1:1"), Duration::from_secs(1), [limited]);
    let begun = tokio::time::Instant::now();
    assert_eq!(patient(&llm, 1, 20).await.unwrap_err().word(), "rate_limited");
    assert_eq!((*asked.lock().unwrap(), begun.elapsed().as_secs()), (1, 1));
}
