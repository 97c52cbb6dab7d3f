//! Bounds of integers in the OpenAPI document: the server enforces exactly these.

use serde_json::{Value, json};
use system_tests::Server;

/// Ids in place of the parameters of a path.
const PATH_IDS: [(&str, &str); 5] = [
    ("{run}", "run"),
    ("{lease}", "1-aaaaaa"),
    ("{episode}", "ep_1-aaaaaa_0"),
    ("{design}", "layout-1"),
    ("{version}", "1"),
];

/// Range in the text of an error, such as "must be an integer from 1 to 500, got -1".
fn stated_range(detail: &str) -> Option<(u64, Option<u64>)> {
    let numbers = detail.split_once("from ").or_else(|| detail.split_once("at least "))?.1;
    let mut numbers = numbers.split([' ', ',']).filter_map(|word| word.parse().ok());
    let minimum = numbers.next()?;
    // The largest number of groups depends on the form of a lease.
    let maximum = if detail.contains(" or to ") { numbers.nth(1) } else { numbers.next() };
    Some((minimum, maximum.filter(|_| !detail.contains("at least"))))
}

/// Integer of a request, with its documented bounds.
struct IntegerField {
    name: String,
    minimum: u64,
    maximum: Option<u64>,
}

impl IntegerField {
    fn new(name: &str, schema: &Value) -> Option<Self> {
        let kind = &schema["type"];
        let is_integer =
            *kind == "integer" || kind.as_array().is_some_and(|all| all.contains(&json!("integer")));
        let minimum = schema["minimum"].as_u64().filter(|_| is_integer)?;
        Some(Self { name: name.to_owned(), minimum, maximum: schema["maximum"].as_u64() })
    }
}

/// Integers in the query of an operation.
fn query_integers(operation: &Value) -> Vec<IntegerField> {
    let parameters = operation["parameters"].as_array().into_iter().flatten();
    let query = parameters.filter(|parameter| parameter["in"] == "query");
    query.filter_map(|p| IntegerField::new(p["name"].as_str()?, &p["schema"])).collect()
}

/// Integers at the top of the body of an operation.
fn body_integers(operation: &Value, document: &Value) -> Vec<IntegerField> {
    let reference = &operation["requestBody"]["content"]["application/json"]["schema"]["$ref"];
    let Some(reference) = reference.as_str() else { return Vec::new() };
    let schema = document.pointer(reference.trim_start_matches('#')).unwrap();
    let properties = schema["properties"].as_object().into_iter().flatten();
    properties.filter_map(|(name, schema)| IntegerField::new(name, schema)).collect()
}

#[tokio::test]
async fn documented_bounds_of_integers_are_those_of_the_server() {
    let server = Server::start().await;
    let api = server.api();
    let _ = api.post("/v1/runs", json!({"id": "run", "design": {"designer": "off"}})).await.expect(201);
    let document = serde_json::to_value(orchestrator::http::openapi()).unwrap();
    let mut compared = 0;
    for (path, operations) in document["paths"].as_object().unwrap() {
        let url = PATH_IDS.iter().fold(path.clone(), |path, (name, id)| path.replace(name, id));
        for (method, operation) in operations.as_object().unwrap() {
            let fields = query_integers(operation).into_iter().map(|field| (true, field));
            let fields =
                fields.chain(body_integers(operation, &document).into_iter().map(|field| (false, field)));
            for (is_query, IntegerField { name, minimum, maximum }) in fields {
                let send = async |value: i64| {
                    if is_query {
                        api.get(&format!("{url}?{name}={value}")).await
                    } else {
                        api.send_json(&method.to_uppercase(), &url, json!({ &name: value })).await
                    }
                };
                let place = format!("{method} {path}: {name}");
                let below = send(-1).await;
                assert!(below.status == 400 || below.status == 422, "{place}: {below:?}");
                assert_eq!(below.body["field"], name.as_str(), "{place}: {below:?}");
                let stated = stated_range(below.body["detail"].as_str().unwrap());
                // The document gives every 64-bit integer a maximum, which the text leaves out.
                let maximum = maximum.filter(|maximum| *maximum != u64::MAX);
                assert_eq!(stated, Some((minimum, maximum)), "{place}: {}", below.body["detail"]);
                // The response to a valid request for events does not end.
                if !path.ends_with("/events") {
                    let at_minimum = send(i64::try_from(minimum).unwrap()).await;
                    assert_ne!(
                        at_minimum.body["field"],
                        name.as_str(),
                        "{place} = {minimum}: {at_minimum:?}"
                    );
                }
                compared += 1;
            }
        }
    }
    assert!(compared >= 40, "only {compared} integers were compared");
}
