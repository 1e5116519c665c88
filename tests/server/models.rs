use serde_json::json;

use crate::support::server::Server;

#[tokio::test]
async fn the_default_model_is_there_from_the_start() {
    let server = Server::start().await;
    let model = server.get("/v1/models/default").await.expect(200);
    assert_eq!((&model["method"], &model["live"], &model["head"]), (&json!("ewc"), &json!(null), &json!(null)));
    server.stop().await;
}

#[tokio::test]
async fn a_model_is_created_with_its_settings_resolved_and_survives_a_restart() {
    let server = Server::start().await;
    let wish = json!({"model": "site-12", "method": "mas", "settings": {"hidden": 16, "schedule": {"min_events": 3, "max_wait_s": 60}}});
    let created = server.post("/v1/models", &wish).await.expect(201);
    assert_eq!(created.header("location"), "/v1/models/site-12");
    assert_eq!((&created["settings"]["hidden"], &created["settings"]["horizon"]), (&json!(16), &json!(5)));
    let server = server.restart().await;
    let read = server.get("/v1/models/site-12").await.expect(200);
    assert_eq!(read.body, created.body);
    assert_eq!(read.header("etag"), created.header("etag"));
    server.stop().await;
}

#[tokio::test]
async fn a_name_is_taken_once() {
    let server = Server::start().await;
    let wish = json!({"model": "default", "method": "naive"});
    server.post("/v1/models", &wish).await.expect_problem(409, "model_exists");
    server.stop().await;
}

#[tokio::test]
async fn a_bad_setting_is_pointed_at() {
    let server = Server::start().await;
    let create = |settings| json!({"model": "a", "method": "ewc", "settings": settings});
    let unknown = server.post("/v1/models", &create(json!({"hiden": 3}))).await.expect_problem(422, "invalid_settings");
    assert_eq!(unknown["errors"][0]["pointer"], "/settings/hiden");
    let half = server.post("/v1/models", &create(json!({"schedule": {"min_events": 3}}))).await;
    let half = half.expect_problem(422, "invalid_settings");
    assert!(half["detail"].as_str().unwrap().contains("max_wait_s"), "{}", half.text);
    let none = server.post("/v1/models", &create(json!({"retention": {"versions": 0}}))).await;
    assert_eq!(none.expect_problem(422, "invalid_settings")["errors"][0]["pointer"], "/settings/retention");
    let torn = server.post("/v1/models", &create(json!({"memory": "window"}))).await;
    assert_eq!(torn.expect_problem(422, "invalid_settings")["errors"][0]["pointer"], "/settings/features");
    server.post("/v1/models", &create(json!([]))).await.expect_problem(422, "invalid_settings");
    server.get("/v1/models/a").await.expect_problem(404, "model_not_found");
    server.stop().await;
}

#[tokio::test]
async fn options_of_importance_are_taken_and_what_contradicts_itself_is_pointed_at() {
    let server = Server::start().await;
    let create = |model, method, settings| json!({"model": model, "method": method, "settings": settings});
    let closed = json!({"estimator": "sampled", "estimator_draws": 1, "output": "closed_loop", "accumulation": "online",
        "online_decay": 0.5, "penalty_step": "modulated"});
    let taken = server.post("/v1/models", &create("a", "ewc", closed.clone())).await.expect(201);
    assert_eq!(taken["settings"]["output"], "closed_loop");
    for (method, settings, pointer) in [
        ("mas", closed, "/settings/estimator_draws"),
        ("mas", json!({"estimator": "empirical"}), "/settings/estimator"),
        ("ewc", json!({"estimator": "empirical", "output": "closed_loop"}), "/settings/estimator"),
    ] {
        let refused = server.post("/v1/models", &create("b", method, settings)).await;
        assert_eq!(refused.expect_problem(422, "invalid_settings")["errors"][0]["pointer"], pointer);
    }
    server.stop().await;
}

#[tokio::test]
async fn a_version_is_taken_from_a_file_and_for_a_model_that_is_there() {
    let server = Server::start().await;
    server.post("/v1/models/default/versions", &json!({})).await.expect_problem(415, "unsupported_media_type");
    server.post("/v1/models/absent/versions", &json!({})).await.expect_problem(404, "model_not_found");
    server.stop().await;
}

#[tokio::test]
async fn pausing_changes_the_etag_once() {
    let server = Server::start().await;
    let before = server.get("/v1/models/default").await;
    let paused = server.post("/v1/models/default/pause", &json!({})).await.expect(200);
    assert_eq!(paused["paused"], true);
    assert_ne!(paused.header("etag"), before.header("etag"));
    let again = server.post("/v1/models/default/pause", &json!({})).await.expect(200);
    assert_eq!(again.header("etag"), paused.header("etag"));
    assert_eq!(server.post("/v1/models/default/resume", &json!({})).await.expect(200)["paused"], false);
    server.stop().await;
}

#[tokio::test]
async fn nothing_live_is_a_conflict_and_nothing_pending_too() {
    let server = Server::start().await;
    let window = crate::support::events::window(5, 10.0);
    server
        .post("/v1/models/default/predict", &json!({"windows": [window]}))
        .await
        .expect_problem(409, "no_live_version");
    let simulate = json!({"initial": window, "leader_speed_mps": [10.0]});
    server.post("/v1/models/default/simulate", &simulate).await.expect_problem(409, "no_live_version");
    let learn = json!({"batches": "pending"});
    server.post("/v1/models/default/tasks", &learn).await.expect_problem(409, "nothing_pending");
    let back = json!({"reason": "none"});
    server.post("/v1/models/default/rollback", &back).await.expect_problem(409, "no_live_version");
    let promote = json!({"version": 1, "reason": "none"});
    server.post("/v1/models/default/promote", &promote).await.expect_problem(404, "version_not_found");
    assert_eq!(server.get("/v1/models/default/history").await.expect(200)["history"], json!([]));
    server.stop().await;
}
