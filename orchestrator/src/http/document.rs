//! What all routes have in common, told of each in the API's document.

use axum::http::Method;
use utoipa::openapi::path::Operation;
use utoipa::openapi::security::{HttpAuthScheme, HttpBuilder, SecurityRequirement, SecurityScheme};
use utoipa::openapi::{Components, ContentBuilder, OpenApi, Ref, RefOr, ResponseBuilder};

use super::access::{Needs, operation};
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

/// What errors are called.
const PROBLEM: &str = "application/problem+json";

/// Names what errors are written as: problem details have a name of their own beside JSON.
pub(super) fn name_problems(document: &mut OpenApi) {
    for item in document.paths.paths.values_mut() {
        let operations = [&mut item.get, &mut item.put, &mut item.post, &mut item.delete, &mut item.patch];
        let answers = operations.into_iter().flatten().flat_map(|of| of.responses.responses.values_mut());
        for answer in answers {
            let RefOr::T(answer) = answer else { continue };
            let Some(RefOr::T(content)) = answer.content.get(JSON) else { continue };
            let is_problem = matches!(&content.schema, Some(RefOr::Ref(schema)) if schema.ref_location.ends_with("/Problem"));
            if is_problem && let Some(content) = answer.content.shift_remove(JSON) {
                answer.content.insert(PROBLEM.to_owned(), content);
            }
        }
    }
}

/// What the scheme of tokens is called.
const TOKEN: &str = "token";
const ABOUT_TOKENS: &str = "`Authorization: Bearer sparring_…`, by `sparring token create`. What an operation names is the least \
role it needs: viewer, trainer, admin. A server without tokens lets in whoever is on its machine; one with --openenv-public lets \
anybody to OpenEnv's routes.";

/// Says of each operation which role it needs, and how those are answered who have it not.
pub(super) fn name_roles(document: &mut OpenApi) {
    let scheme = HttpBuilder::new().scheme(HttpAuthScheme::Bearer).description(Some(ABOUT_TOKENS)).build();
    let components = document.components.get_or_insert_with(Components::new);
    components.add_security_scheme(TOKEN, SecurityScheme::Http(scheme));
    for (path, item) in &mut document.paths.paths {
        let operations = [
            (Method::GET, &mut item.get),
            (Method::PUT, &mut item.put),
            (Method::POST, &mut item.post),
            (Method::DELETE, &mut item.delete),
            (Method::PATCH, &mut item.patch),
        ];
        for (method, declared) in operations {
            let Some(declared) = declared else { continue };
            let Some(Needs::Token(role) | Needs::OpenEnv(role)) =
                operation(&method, path).map(|operation| operation.needs)
            else {
                continue;
            };
            declared.security = Some(vec![SecurityRequirement::new(TOKEN, [role.as_str()])]);
            refuse(declared, "401", "No token, or one that is not known, expired or revoked.");
            refuse(declared, "403", "The token's role may not do this.");
            refuse(declared, "429", "Asked more often than may be; see Retry-After.");
        }
    }
}

/// Names an answer that keeps somebody out, where the operation does not.
fn refuse(operation: &mut Operation, status: &str, why: &str) {
    let problem = ContentBuilder::new().schema(Some(Ref::from_schema_name("Problem"))).build();
    let answer = ResponseBuilder::new().description(why).content(PROBLEM, problem).build();
    operation.responses.responses.entry(status.to_owned()).or_insert(RefOr::T(answer));
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
