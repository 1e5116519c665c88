use std::collections::BTreeSet;

use serde_json::json;

use crate::support::events::events;
use crate::support::server::Server;

const DASHBOARD: &str = include_str!("../../docker/grafana/headway.json");
const ALERTS: &str = include_str!("../../docker/prometheus/alerts.yml");

/// Every `headway_…` in a text, without what a histogram's series add to its name.
fn named(text: &str) -> BTreeSet<&str> {
    let ends = |c: char| !(c.is_ascii_lowercase() || c == '_');
    let names = text.match_indices("headway_").map(|(at, _)| text[at..].split(ends).next().unwrap_or_default());
    names.map(|name| name.strip_suffix("_bucket").unwrap_or(name)).collect()
}

/// The metrics, once the task that has ended is counted: nobody who waits for its end waits for that too.
async fn once_counted(server: &Server) -> String {
    loop {
        let metrics = server.get("/metrics").await.expect(200).text;
        if metrics.contains("headway_training_events_total{") {
            return metrics;
        }
        tokio::task::yield_now().await;
    }
}

#[tokio::test]
async fn the_dashboard_and_the_alerts_ask_for_metrics_that_are_there() {
    let server = Server::start().await;
    server.learn("default", "fast", &events("fast", 40, 14.0)).await;
    let (speeds, spacings) = ([14.0; 5], [1e4; 5]);
    let window = json!({"follower_speed_mps": speeds, "leader_speed_mps": speeds, "spacing_m": spacings});
    server.post("/v1/models/default/predict", &json!({"windows": [window, window]})).await.expect(200);
    let drive = json!({"initial": window, "leader_speed_mps": [14.0, 13.9]});
    server.post("/v1/models/default/simulate", &drive).await.expect(200);
    let metrics = once_counted(&server).await;
    let types = metrics.lines().filter_map(|line| line.strip_prefix("# TYPE ")?.split(' ').next());
    let there: BTreeSet<_> = types.collect();
    for text in [DASHBOARD, ALERTS] {
        let asked = named(text);
        assert!(asked.len() > 8, "{asked:?}");
        assert_eq!(asked.difference(&there).collect::<Vec<_>>(), Vec::<&&str>::new());
    }
    let value = |series: &str| {
        let line = metrics.lines().find_map(|line| line.strip_prefix(series));
        line.unwrap_or_else(|| panic!("no {series} in\n{metrics}")).trim().parse::<f64>().unwrap()
    };
    let labels = r#"model="default",version="1",kind="predict""#;
    assert_eq!(value(&format!("headway_predictions_total{{{labels}}}")), 2.0);
    assert_eq!(value(&format!(r#"headway_prediction_flags_total{{{labels},flag="out_of_range"}}"#)), 2.0);
    assert_eq!(value(&format!("headway_prediction_duration_seconds_count{{{labels}}}")), 1.0);
    assert!(value(&format!("headway_prediction_duration_seconds_sum{{{labels}}}")) > 0.0);
    assert_eq!(value(r#"headway_tasks_total{model="default",state="succeeded"}"#), 1.0);
    assert_eq!(value(r#"headway_tasks_total{model="default",state="failed"}"#), 0.0);
    let evaluated = server.get("/v1/models/default/versions/1/evaluation").await.expect(200);
    let told = value(r#"headway_live_spacing_error_square_meters{model="default",regime="fast",driver="network"}"#);
    assert_eq!(json!(told), evaluated["tasks"][0]["spacing_mse"]);
    server.stop().await;
}
