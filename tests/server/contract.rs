use std::collections::BTreeSet;

use headway::http::{Code, Need};
use serde_json::json;

use crate::support::contract;
use crate::support::server::Server;

#[test]
fn the_router_and_the_contract_need_the_same_scopes() {
    let routed: BTreeSet<_> = headway::http::needs()
        .into_iter()
        .map(|(path, method, need)| {
            let scopes = match need {
                Need::Nothing => json!([]),
                Need::AnyKey | Need::EveryModel => json!([{"key": []}]),
                Need::May(scope) => json!([{"key": [scope]}]),
            };
            format!("{method} {path} {scopes}")
        })
        .collect();
    let written: BTreeSet<_> = contract::operations()
        .into_iter()
        .map(|(path, method, operation)| {
            let security = operation.get("security").unwrap_or(&contract::document()["security"]);
            format!("{method} {path} {security}")
        })
        .collect();
    assert_eq!(routed, written);
}

#[tokio::test]
async fn every_method_of_the_contract_is_routed_and_no_other() {
    let server = Server::start().await;
    for (template, item) in contract::document()["paths"].as_object().unwrap() {
        let path = contract::filled(template, "absent");
        for method in ["GET", "POST", "PUT", "PATCH", "DELETE"] {
            let request = server.request(method.parse().unwrap(), &path).header("accept", "*/*");
            let answer = server.send(request).await;
            let written = item.get(method.to_lowercase()).is_some();
            assert_eq!(written, answer.status != 405, "{method} {template}: {}", answer.text);
        }
    }
    server.stop().await;
}

#[test]
fn the_contract_lists_the_codes_of_problems() {
    let codes: BTreeSet<_> = Code::ALL.iter().map(|code| code.row().0).collect();
    let written = contract::document()["components"]["schemas"]["ProblemCode"]["enum"].as_array().unwrap();
    assert_eq!(codes, written.iter().map(|code| code.as_str().unwrap()).collect());
}

#[test]
fn the_examples_of_the_contract_fit_their_schemas() {
    let examples = contract::examples();
    assert!(examples.len() > 5);
    for (at, schema, example) in examples {
        assert_eq!(contract::defects(&schema, &example), Vec::<String>::new(), "{at}");
    }
}
