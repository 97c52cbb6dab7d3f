//! What all routes have in common, told of each in the API's document.

use utoipa::openapi::path::Operation;
use utoipa::openapi::{OpenApi, RefOr};

use super::answers::MESSAGE_PACK;

const JSON: &str = "application/json";

/// Names MessagePack beside JSON, wherever bodies are read or answers given: `extract` and `answers` do that for all of `/v1`.
pub(super) fn name_forms(document: &mut OpenApi) {
    let paths = document.paths.paths.iter_mut().filter(|(path, _)| path.starts_with("/v1/"));
    for (_, item) in paths {
        let operations = [&mut item.get, &mut item.put, &mut item.post, &mut item.delete, &mut item.patch];
        operations.into_iter().flatten().for_each(name_forms_of);
    }
}

fn name_forms_of(operation: &mut Operation) {
    if let Some(RefOr::T(body)) = &mut operation.request_body
        && let Some(content) = body.content.get(JSON).cloned()
    {
        body.content.insert(MESSAGE_PACK.to_owned(), content);
    }
    for answer in operation.responses.responses.values_mut() {
        if let RefOr::T(answer) = answer
            && let Some(content) = answer.content.get(JSON).cloned()
        {
            answer.content.insert(MESSAGE_PACK.to_owned(), content);
        }
    }
}
