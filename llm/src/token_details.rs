//! Token ids and log-probabilities of a chat completion, in the form that vLLM returns.

use serde_json::Value;

use crate::TokenDetails;

/// Reads the token details of a response; `None` if it has none. An array with an invalid entry counts as missing, since a
/// trainer must not learn from an incomplete one.
pub(crate) fn read(response: &Value) -> Option<TokenDetails> {
    let ids = |pointer: &str| parse_all(response.pointer(pointer)?, |id| u32::try_from(id.as_u64()?).ok());
    let logprobs = response.pointer("/choices/0/logprobs/content");
    let details = TokenDetails {
        prompt: ids("/prompt_token_ids"),
        completion: ids("/choices/0/token_ids"),
        logprobs: logprobs.and_then(|tokens| parse_all(tokens, |token| token.get("logprob")?.as_f64())),
    };
    (details != TokenDetails::default()).then_some(details)
}

fn parse_all<T>(array: &Value, parse: impl Fn(&Value) -> Option<T>) -> Option<Vec<T>> {
    array.as_array()?.iter().map(parse).collect()
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn incomplete_token_arrays_count_as_missing() {
        let response = json!({
            "prompt_token_ids": [1, 2, 3],
            "choices": [{"token_ids": [7, 8], "logprobs": {"content": [{"logprob": -0.5}, {"logprob": 0}]}}],
        });
        let details = TokenDetails {
            prompt: Some(vec![1, 2, 3]),
            completion: Some(vec![7, 8]),
            logprobs: Some(vec![-0.5, 0.0]),
        };
        assert_eq!(read(&response), Some(details.clone()));
        let mut invalid = response;
        invalid["choices"][0]["token_ids"][1] = json!(-8);
        assert_eq!(read(&invalid), Some(TokenDetails { completion: None, ..details }));
        for missing in
            [json!({}), json!({"prompt_token_ids": "x", "choices": [{"logprobs": null}]}), json!(null)]
        {
            assert_eq!(read(&missing), None, "{missing}");
        }
    }
}
