use std::fmt::Write;

use headway::http::Code;
use serde_json::{Value, json};

use crate::support::contract;
use crate::support::server::Server;

/// `docs/problems.md`, as the table of problems has it.
fn page() -> String {
    let mut page = "# Problems\n\n\
        Every error is `application/problem+json` ([RFC 9457](https://www.rfc-editor.org/rfc/rfc9457)) with a stable `code`.\n\
        Its `type` is a path of the server, where the same stands as here.\n\
        `errors`, where there are some, say of each place in the request what is wrong there.\n\n\
        This page is written from the table in `src/http/problem/code.rs`: `HEADWAY_DOCS=write cargo test --test server problems_md` does it.\n\n\
        | code | status | title | remedy |\n| --- | --- | --- | --- |\n"
        .to_owned();
    for code in Code::ALL {
        let (name, status, title) = code.row();
        writeln!(page, "| `{name}` | {} | {title} | {} |", status.as_u16(), code.remedy()).unwrap();
    }
    page
}

#[test]
fn problems_md_says_what_the_table_says() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/docs/problems.md");
    if std::env::var("HEADWAY_DOCS").as_deref() == Ok("write") {
        std::fs::write(path, page()).unwrap();
    }
    assert_eq!(std::fs::read_to_string(path).unwrap_or_default(), page(), "write it anew with HEADWAY_DOCS=write");
}

#[tokio::test]
async fn the_type_of_a_problem_leads_to_its_remedy() {
    let server = Server::start().await;
    let problem = server.get("/v1/models/nobody").await.expect_problem(404, "model_not_found");
    let told = server.get(problem["type"].as_str().unwrap()).await.expect(200);
    assert_eq!((&told["code"], &told["status"], &told["title"]), (&problem["code"], &json!(404), &problem["title"]));
    assert!(told["remedy"].as_str().unwrap().contains("POST /v1/models"));
    let all = server.get("/problems").await.expect(200);
    assert!(all["problems"].as_array().unwrap().contains(&told.body));
    server.get("/problems/odd").await.expect_problem(404, "not_found");
    server.stop().await;
}

#[tokio::test]
async fn the_server_shows_its_contract_and_needs_nothing_from_elsewhere_for_it() {
    let mut server = Server::start().await;
    server.close_gate().await;
    server.key = None;
    assert_eq!(&server.get("/openapi.json").await.expect(200).body, contract::document());
    let yaml = server.get("/openapi.yaml").await.expect(200);
    assert_eq!(&serde_yaml_ng::from_str::<Value>(&yaml.text).unwrap(), contract::document());
    let page = server.get("/docs").await.expect(200);
    assert!(page.header("content-type").starts_with("text/html"));
    assert!(page.header("content-security-policy").contains("connect-src 'self'"));
    let sources: Vec<_> = ["src=\"", "href=\""]
        .iter()
        .flat_map(|attribute| page.text.split(attribute).skip(1))
        .map(|rest| rest.split('"').next().unwrap())
        .collect();
    assert_eq!(sources.len(), 4, "{sources:?}");
    for source in sources {
        let part = server.get(source).await.expect(200);
        assert!(!part.text.is_empty() && part.header("cache-control").contains("max-age"), "{source}");
    }
    server.get("/docs/..%2Fopenapi.json").await.expect_problem(404, "not_found");
    server.stop().await;
}
