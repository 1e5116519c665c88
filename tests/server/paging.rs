use serde_json::{Value, json};

use crate::support::server::Server;

#[tokio::test]
async fn a_list_is_read_page_by_page_without_gap_or_repetition() {
    let server = Server::start_with("[server]\npage_size = 2\npage_size_max = 3").await;
    for name in ["a", "b", "c", "d", "e"] {
        server.post("/v1/models", &json!({"model": name, "method": "naive"})).await.expect(201);
    }
    for (query, sizes) in
        [("", vec![2, 2, 2]), ("page_size=3", vec![3, 3]), ("page_size=100", vec![3, 3]), ("page_size=1", vec![1; 6])]
    {
        let (mut names, mut seen, mut token) = (Vec::new(), Vec::new(), Value::Null);
        loop {
            let page = match token.as_str() {
                Some(token) => server.get(&format!("/v1/models?{query}&page_token={token}")).await.expect(200),
                None => server.get(&format!("/v1/models?{query}")).await.expect(200),
            };
            let models = page["models"].as_array().unwrap();
            seen.push(models.len());
            names.extend(models.iter().map(|model| model["model"].as_str().unwrap().to_owned()));
            token = page["next_page_token"].clone();
            if token.is_null() {
                break;
            }
        }
        assert_eq!(names, ["default", "a", "b", "c", "d", "e"], "{query}");
        assert_eq!(seen, sizes, "{query}");
    }
    server.stop().await;
}
