//! Token ids and log-probabilities out of a chat completion, where it has them as vLLM writes them.

use serde_json::Value;

use super::Tokens;

/// Tokens of an answer; none where nothing is told. A list that is not wholly of numbers is none: half of it would be worse
/// than nothing to whoever learns from it.
pub(super) fn read(answer: &Value) -> Option<Tokens> {
    let ids = |at: &str| list(answer.pointer(at)?, |id| u32::try_from(id.as_u64()?).ok());
    let logprobs = answer.pointer("/choices/0/logprobs/content");
    let tokens = Tokens {
        prompt: ids("/prompt_token_ids"),
        completion: ids("/choices/0/token_ids"),
        logprobs: logprobs.and_then(|tokens| list(tokens, |token| token.get("logprob")?.as_f64())),
    };
    (tokens != Tokens::default()).then_some(tokens)
}

fn list<T>(value: &Value, of: impl Fn(&Value) -> Option<T>) -> Option<Vec<T>> {
    value.as_array()?.iter().map(of).collect()
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn what_is_told_of_tokens_is_read_and_what_is_half_told_is_not() {
        let answer = json!({
            "prompt_token_ids": [1, 2, 3],
            "choices": [{"token_ids": [7, 8], "logprobs": {"content": [{"logprob": -0.5}, {"logprob": 0}]}}],
        });
        let tokens = Tokens {
            prompt: Some(vec![1, 2, 3]),
            completion: Some(vec![7, 8]),
            logprobs: Some(vec![-0.5, 0.0]),
        };
        assert_eq!(read(&answer), Some(tokens.clone()));
        let mut half = answer;
        half["choices"][0]["token_ids"][1] = json!(-8);
        assert_eq!(read(&half), Some(Tokens { completion: None, ..tokens }));
        for none in
            [json!({}), json!({"prompt_token_ids": "x", "choices": [{"logprobs": null}]}), json!(null)]
        {
            assert_eq!(read(&none), None, "{none}");
        }
    }
}
