//! Parts of the OpenAPI document that all operations share: media types, problems and roles.

use axum::http::Method;
use utoipa::openapi::path::Operation;
use utoipa::openapi::security::{HttpAuthScheme, HttpBuilder, SecurityRequirement, SecurityScheme};
use utoipa::openapi::{Components, ContentBuilder, OpenApi, Ref, RefOr, ResponseBuilder};

use super::access::{Permission, find_operation};
use super::content_negotiation::MESSAGE_PACK;
use crate::ownership::RunPermission;

const JSON: &str = "application/json";

/// Adds MessagePack to every body and response of `/v1`, which `extract` and `content_negotiation` implement.
pub(super) fn add_messagepack(document: &mut OpenApi) {
    let paths = document.paths.paths.iter_mut().filter(|(path, _)| path.starts_with("/v1/"));
    for (_, item) in paths {
        let operations = [&mut item.get, &mut item.put, &mut item.post, &mut item.delete, &mut item.patch];
        operations.into_iter().flatten().for_each(add_messagepack_to);
    }
}

/// Media type of problem details.
const PROBLEM: &str = "application/problem+json";

/// Sets the media type of problem details, which differs from that of JSON.
pub(super) fn set_problem_media_type(document: &mut OpenApi) {
    for item in document.paths.paths.values_mut() {
        let operations = [&mut item.get, &mut item.put, &mut item.post, &mut item.delete, &mut item.patch];
        let responses =
            operations.into_iter().flatten().flat_map(|operation| operation.responses.responses.values_mut());
        for response in responses {
            let RefOr::T(response) = response else { continue };
            let Some(RefOr::T(content)) = response.content.get(JSON) else { continue };
            let is_problem = matches!(&content.schema, Some(RefOr::Ref(schema)) if schema.ref_location.ends_with("/Problem"));
            if is_problem && let Some(content) = response.content.shift_remove(JSON) {
                response.content.insert(PROBLEM.to_owned(), content);
            }
        }
    }
}

/// Name of the security scheme.
const TOKEN_SCHEME: &str = "token";
/// Description of the security scheme.
const TOKEN_DESCRIPTION: &str = "`Authorization: Bearer sparring_…`, created by `sparring token create`. Each operation names the \
lowest role that it requires: viewer, trainer or admin. `member` and `owner` after it require that the principal of the token is a \
member or the owner of the run; an admin needs neither. A server without tokens accepts requests from its own machine only; a server with \
--openenv-public needs no token for OpenEnv's routes.";

/// Description of the response to a client that takes no part in the run.
const NOT_MEMBER: &str = "The role of the token does not permit the operation, or its principal is neither the owner nor a member of the run.";
/// Description of the response to a client that does not own the run.
const NOT_OWNER: &str =
    "The role of the token does not permit the operation, or its principal does not own the run.";

/// Adds to each operation the role that it requires, and the responses of a request without it.
pub(super) fn add_roles(document: &mut OpenApi) {
    let scheme =
        HttpBuilder::new().scheme(HttpAuthScheme::Bearer).description(Some(TOKEN_DESCRIPTION)).build();
    let components = document.components.get_or_insert_with(Components::new);
    components.add_security_scheme(TOKEN_SCHEME, SecurityScheme::Http(scheme));
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
            let Some(permission) = find_operation(&method, path).map(|operation| operation.permission) else {
                continue;
            };
            let Some(role) = permission.role() else { continue };
            let (relation, denial) = match permission {
                Permission::Run(RunPermission::TakePart) => (Some("member"), NOT_MEMBER),
                Permission::Run(RunPermission::Change) => (Some("owner"), NOT_OWNER),
                _ => (None, "The role of the token does not permit the operation."),
            };
            let scopes = std::iter::once(role.as_str()).chain(relation);
            declared.security = Some(vec![SecurityRequirement::new(TOKEN_SCHEME, scopes)]);
            add_denial(
                declared,
                "401",
                "The request has no token, or its token is unknown, expired or revoked.",
            );
            add_denial(declared, "403", denial);
            add_denial(declared, "429", "The rate limit of requests is reached; retry after `Retry-After`.");
        }
    }
}

/// Adds the response of a denied request, unless the operation describes it.
fn add_denial(operation: &mut Operation, status: &str, description: &str) {
    let problem = ContentBuilder::new().schema(Some(Ref::from_schema_name("Problem"))).build();
    let response = ResponseBuilder::new().description(description).content(PROBLEM, problem).build();
    operation.responses.responses.entry(status.to_owned()).or_insert(RefOr::T(response));
}

fn add_messagepack_to(operation: &mut Operation) {
    if let Some(RefOr::T(body)) = &mut operation.request_body
        && let Some(content) = body.content.get(JSON).cloned()
    {
        body.content.insert(MESSAGE_PACK.to_owned(), content);
    }
    for response in operation.responses.responses.values_mut() {
        if let RefOr::T(response) = response
            && let Some(content) = response.content.get(JSON).cloned()
        {
            response.content.insert(MESSAGE_PACK.to_owned(), content);
        }
    }
}
