//! Seeds that are text.

use serde_json::{Value, json};

pub(super) fn event(name: &str, steps: usize) -> Value {
    let numbers = |from: f64| (0..steps).map(|step| from + 0.1 * step as f64).collect::<Vec<_>>();
    json!({
        "event_id": name, "source": "s", "run": "r", "split": "test", "dt_s": 0.1,
        "spacing_m": numbers(20.0), "follower_speed_mps": numbers(5.0), "leader_speed_mps": numbers(6.0),
        "rel_speed_mps": vec![1.0; steps],
    })
}

pub(super) fn documents() -> Vec<(&'static str, String)> {
    let least = r#"{"event_id":1,"spacing_m":[1],"follower_speed_mps":[2e0],"leader_speed_mps":[3.5]}"#;
    vec![
        ("two", json!({"events": [event("a", 4), event("b", 3)]}).to_string()),
        ("least", format!(r#"{{"events": [{least}, {least}]}}"#)),
        ("none", r#"{"events": []}"#.to_owned()),
        ("wrong-kinds", r#"{"events": [1, null, "x", true, [], [{}], {"event_id": {"a": [1]}, "split": "none"}]}"#.to_owned()),
        ("wrong-values", r#"{"events": [{"event_id": "a", "spacing_m": [1, null, "2", [3], {"b": 4}, false], "follower_speed_mps": 5, "leader_speed_mps": null, "rel_speed_mps": {}, "dt_s": "x"}]}"#.to_owned()),
        ("beyond", r#"{"events": [{"event_id": "a", "spacing_m": [1e999], "dt_s": -1e999}, {"event_id": "b", "spacing_m": [18446744073709551616, -0.0, 1E-5]}]}"#.to_owned()),
        ("twice", r#"{"events": [{"event_id": "a", "event_id": "b", "colour": 1, "a/b~c": {}}]}"#.to_owned()),
        ("events-twice", r#"{"events": [], "events": []}"#.to_owned()),
        ("unknown", r#"{"event": [], "a~b/c": 1}"#.to_owned()),
        ("escaped", r#"{"\u0065vents": [{"event_\u0069d": "\ud83d\ude97\"\\\n", "run": "é", "spacing_m": []}]}"#.to_owned()),
        ("array", r#"[{"events": []}]"#.to_owned()),
        ("not-an-array", r#"{"events": {"a": 1}}"#.to_owned()),
        ("cut", r#"{"events": [{"event_id": "a", "spa"#.to_owned()),
        ("more", r#"{"events": []} x"#.to_owned()),
        ("deep", format!(r#"{{"events": [{}1{}]}}"#, "[".repeat(140), "]".repeat(140))),
        ("long-text", json!({"events": [{"event_id": "x".repeat(65), "source": "", "run": null}]}).to_string()),
        ("long", json!({"events": [event("long", 201)]}).to_string()),
        ("many", json!({"events": vec![1; 101]}).to_string()),
    ]
}

pub(super) fn lines() -> Vec<(&'static str, String)> {
    let mut lines: Vec<_> = documents()
        .into_iter()
        .filter_map(|(name, document)| {
            let document: Value = serde_json::from_str(&document).ok()?;
            let events = document
                .get("events")?
                .as_array()?
                .iter()
                .map(|event| format!("{event}\n"))
                .collect::<Vec<_>>()
                .concat();
            (!events.is_empty()).then_some((name, events))
        })
        .collect();
    let good = event("a", 2);
    lines.push(("blank-lines", format!("\n  \r\n{good}\r\n\t\n")));
    lines.push(("malformed-line", format!("{{x}}\n{good} y\n{good}")));
    lines.push(("beyond", "{\"event_id\":\"a\",\"spacing_m\":[1e999]}\n{\"dt_s\":1e999}\n".to_owned()));
    lines.push(("cut", format!("{good}\n{}", &good.to_string()[..40])));
    lines.push(("cut-before-a-line-ends", format!("{}\n{good}\n", &good.to_string()[..40])));
    lines
}

pub(super) fn tables() -> Vec<(&'static str, String)> {
    const HEADER: &str = "event_id,t,spacing_m,follower_speed_mps,leader_speed_mps";
    let all =
        "source,run,split,event_id,t,dt_s,pair,follower,spacing_m,follower_speed_mps,leader_speed_mps,rel_speed_mps";
    vec![
        ("two", format!("{HEADER}\na,0,20,5,6\na,0.1,20.1,5,6\nb, 0 ,30,5,6\n")),
        ("all", format!("{all}\ns,r,test,a,0,0.1,p,human,20,5,6,1\ns,r,test,a,0.1,0.1,p,human,20.1,5,6,1\n")),
        (
            "follownet",
            "\0lv_speed,pair,rel_speed,event_id,follower,sv_speed,run,spacing,source,t\n6,p,1,a,human,5,r,20,s,0"
                .to_owned(),
        ),
        ("quoted", format!("{HEADER}\n\"a \"\"b\"\"\n\",0,20,5,6\r\n\"c,d\",0,1e1,NaN,inf\r\n")),
        (
            "wrong",
            format!(
                "{HEADER},split,dt_s\na,0,x,,6,none,0.1\na,1,20,5,6,train,0.2\nb,0,20,5\nc,0,1,2,3,,,4\nd,0,1,2,3,,\n"
            ),
        ),
        ("no-id", format!("{HEADER}\n,0,20,5,6\n,1,20,5,6\na,0,20,5,6\n")),
        ("apart", format!("{HEADER}\na,0,20,5,6\nb,0,20,5,6\na,0.1,20,5,6\n")),
        ("unknown", format!("{HEADER},lane,foo\n")),
        ("missing", "event_id,t,spacing_m,follower_speed_mps\n".to_owned()),
        ("twice", format!("{HEADER},t\n")),
        ("empty", String::new()),
        ("header", format!("{HEADER}\n")),
        ("cut", format!("{HEADER}\na,0,20,5,6\na,0.1,20")),
        ("cut-quote", format!("{HEADER}\n\"a,0,20,5,6\n")),
        ("long", format!("{HEADER}\n{}", "a,0,20,5,6\n".repeat(201))),
        ("long-text", format!("{HEADER},source\n{},0,20,5,6,{}\n", "x".repeat(65), "y".repeat(65))),
        ("many", format!("{HEADER}\n{}", (0..101).map(|i| format!("{i},0,20,5,6\n")).collect::<Vec<_>>().concat())),
    ]
}

pub(super) fn predictions() -> Vec<(&'static str, String)> {
    let window = |steps: usize| json!({"follower_speed_mps": vec![9.0; steps], "leader_speed_mps": vec![9.5; steps], "spacing_m": vec![20; steps]});
    vec![
        ("one", json!({"windows": [window(5)]}).to_string()),
        ("two-of-version", json!({"windows": [window(5), window(5)], "version": 3}).to_string()),
        ("none", json!({"windows": []}).to_string()),
        ("many", json!({"windows": vec![window(5); 21]}).to_string()),
        ("short", json!({"windows": [window(4), window(6)]}).to_string()),
        ("absurd", json!({"windows": [window(5)]}).to_string().replace("9.5", "-1e7").replace("9.0", "1e300")),
        ("beyond", json!({"windows": [window(5)]}).to_string().replace("9.5", "-1e999")),
        (
            "wrong",
            r#"{"windows": [{"follower_speed_mps": [null], "leader_speed_mps": "x", "a~b/c": {}}], "version": 1.5}"#
                .to_owned(),
        ),
        ("array", "[[[1],[2],[3]], 1]".to_owned()),
        ("window-array", r#"{"windows": [[[1],[2],[3]]]}"#.to_owned()),
        ("malformed", r#"{"windows": [{"spacing_m": [01]"#.to_owned()),
        ("more", json!({"windows": [window(5)]}).to_string() + " x"),
        ("simulation", json!({"initial": window(5), "leader_speed_mps": [9.0, 8.5, 8.0]}).to_string()),
        ("simulation-of-version", json!({"initial": window(5), "leader_speed_mps": [1e9], "version": 2}).to_string()),
        ("simulation-none", json!({"initial": window(4), "leader_speed_mps": []}).to_string()),
        ("simulation-long", json!({"initial": window(5), "leader_speed_mps": vec![9; 51]}).to_string()),
    ]
}

/// As `headway::http::reading::Call` counts them.
pub(super) fn bodies() -> Vec<(u8, &'static str, String)> {
    let all = serde_json::to_value(headway::lineage::ModelSettings::default()).unwrap();
    vec![
        (0, "model", json!({"model": "site-12", "method": "ewc"}).to_string()),
        (0, "model-settings", json!({"model": "a", "method": "mas", "settings": {"hidden": 8, "strength": "auto", "regimes": {"bands": [8, 16]}, "schedule": {"min_events": 5, "max_wait_s": 60}}}).to_string()),
        (0, "model-all-settings", json!({"model": "a", "method": "si", "settings": all}).to_string()),
        (0, "model-fork", json!({"model": "b", "method": "joint", "from": {"model": "a", "version": 3}}).to_string()),
        (0, "model-wrong", r#"{"model": "a b", "method": "none", "settings": {"hidden": 1, "hidden": 2}}"#.to_owned()),
        (0, "model-wrong-setting", r#"{"model": "a", "method": "ewc", "settings": {"colour": 1}}"#.to_owned()),
        (0, "model-preset", r#"{"model": "a", "method": "naive", "settings": {"preset": "paper", "retention": {"versions": 3}}}"#.to_owned()),
        (1, "task", json!({"batches": "pending"}).to_string()),
        (1, "task-named", json!({"batches": ["b1", "b22"], "regime": "fast", "where": {"mean_speed_mps": [5.0, 12.5]}, "settings": {"epochs": 3}}).to_string()),
        (1, "task-wrong", json!({"batches": ["b01", "t2"], "where": {"mean_speed_mps": [5.0, 1]}}).to_string()),
        (1, "task-none", json!({"batches": [], "settings": {"hidden": 3}}).to_string()),
        (1, "task-band", json!({"batches": "pending", "where": {"mean_speed_mps": [9, 1]}}).to_string()),
        (2, "promote", json!({"version": 3, "reason": "better", "force": true}).to_string()),
        (2, "promote-why", json!({"version": -3, "reason": ""}).to_string()),
        (3, "rollback", json!({"reason": "worse"}).to_string()),
        (3, "rollback-to", json!({"version": 1, "reason": "x".repeat(1025), "force": false}).to_string()),
        (4, "key", json!({"name": "lab", "scopes": ["predict", "ingest"], "models": ["a"], "expires_at": "2027-01-01T00:00:00Z"}).to_string()),
        (4, "key-admin", json!({"scopes": ["admin", "train"]}).to_string()),
        (4, "key-wrong", json!({"scopes": ["root"], "expires_at": "yesterday"}).to_string()),
        (4, "key-past", json!({"scopes": [], "models": [], "expires_at": "1960-01-01T00:00:00+01:00[Europe/Berlin]"}).to_string()),
        (4, "key-named", json!({"scopes": ["admin"], "name": "a\nb", "models": ["a"]}).to_string()),
        (5, "note", json!({"note": "good"}).to_string()),
        (5, "note-none", json!({"note": null}).to_string()),
        (5, "note-long", json!({"note": "x".repeat(4097)}).to_string()),
        (5, "note-missing", "{}".to_owned()),
        (5, "array", "[1]".to_owned()),
        (6, "retention", json!({"retention": {"events_s": 60, "versions": 3}}).to_string()),
        (6, "retention-none", json!({"retention": {"events_s": null, "versions": null}}).to_string()),
        (6, "retention-wrong", json!({"retention": {"versions": 0}}).to_string()),
        (6, "retention-twice", r#"{"retention": {"versions": 1, "versions": 2}}"#.to_owned()),
    ]
}

/// As `headway::http::reading::Asked` counts them; then headers, then names.
pub(super) fn requests() -> Vec<(u8, &'static str, String)> {
    let key = format!("hw_0123456789abcdef_{}", "Az09-_A".repeat(7).split_at(43).0);
    vec![
        (0, "page", format!("page_size=5&page_token={}", "703132")),
        (0, "page-none", "page_size=0".to_owned()),
        (0, "page-unknown", "page_token=zz&colour=1".to_owned()),
        (1, "audit", "model=a&page_size=1000&page_token=7030".to_owned()),
        (2, "upload", "preset=follownet&dt_s=0.1&spacing=centre&leader_length_m=4.5&follower_length_m=4&source=s&regime=fast".to_owned()),
        (2, "upload-wrong", "dt_s=nan&spacing=front&source=".to_owned()),
        (2, "upload-needless", "min_spacing_m=2".to_owned()),
        (2, "upload-road", "preset=ngsim&min_duration_s=5.5&max_duration_s=60&min_spacing_m=0.5&max_spacing_m=80".to_owned()),
        (2, "upload-road-needless", "preset=fcd&dt_s=0.1".to_owned()),
        (2, "upload-road-wrong", "preset=ngsim&min_duration_s=-1".to_owned()),
        (2, "upload-front", "spacing=front&leader_length_m=inf".to_owned()),
        (2, "upload-length", "spacing=front&leader_length_m=5".to_owned()),
        (3, "evaluation", "versions=1,2,2&references=idm,gipps,constant_speed&preset=headway".to_owned()),
        (3, "evaluation-wrong", "versions=1,01&references=x".to_owned()),
        (3, "evaluation-many", "versions=1,2,3,4,5,6,7,8,9".to_owned()),
        (4, "task", "wait_s=1.5".to_owned()),
        (4, "task-wrong", "wait_s=-1".to_owned()),
        (5, "retraction", "erase=true".to_owned()),
        (6, "revocation", "force=%66alse&force=true".to_owned()),
        (7, "headers", format!("content-type:text/csv; charset=utf-8\ncontent-encoding:gzip\nauthorization:Bearer {key}\nidempotency-key:k1\nif-match:\"1-3\", \"1-4\"\nx-request-id:trace-7.a:b_c\naccept:application/*;q=0.5, text/html\ncontent-length:12")),
        (7, "headers-wrong", "content-type:application/json\ncontent-encoding:br\nauthorization:Basic x\nidempotency-key:\nif-match:*\naccept:text/html;q=0".to_owned()),
        (7, "headers-twice", format!("content-type:application/x-ndjson\ncontent-encoding:zstd\nauthorization:bearer {key}\nauthorization:bearer {key}\ncontent-length:99999999999")),
        (7, "headers-absent", "content-type:application/x-npy".to_owned()),
        (7, "headers-parquet", "content-type:application/vnd.apache.parquet\ncontent-encoding:identity\naccept:*/*".to_owned()),
        (7, "headers-xml", "content-type:text/xml; charset=utf-8\ncontent-encoding:br".to_owned()),
        (8, "key", key),
        (8, "key-id", "0123456789abcdef".to_owned()),
        (8, "batch", "b12".to_owned()),
        (8, "task-id", "t7".to_owned()),
        (8, "version", "3".to_owned()),
        (8, "name", "site-12.a_B".to_owned()),
        (8, "split", "validation".to_owned()),
        (8, "reference", "idm".to_owned()),
        (8, "scope", "ingest".to_owned()),
    ]
}

pub(super) fn settings() -> Vec<(u8, &'static str, String)> {
    vec![
        (0, "file", "[server]\npage_size = 5\nlisten = \"127.0.0.1:0\"\ncors_origins = [\"https://a.example\"]\n[server.tls]\nlook_s = 5.0\n[model]\nhidden = 8\nschedule = \"manual\"\n".to_owned()),
        (0, "file-ingest", "[ingest.limits]\nmax_events = 10\n[ingest.checks]\nmax_speed_mps = 60.0\n[log]\nlevel = \"debug\"\n".to_owned()),
        (0, "file-wrong", "[server]\npage_sise = 5\n".to_owned()),
        (0, "file-malformed", "[server\n".to_owned()),
        (0, "file-nan", "[database]\nbusy_timeout_s = nan\n".to_owned()),
        (0, "file-section", "server = 3\n".to_owned()),
        (1, "flag", "server.page_size=7".to_owned()),
        (1, "flag-auto", "model.strength=auto".to_owned()),
        (1, "flag-array", "server.cors_origins=[\"https://a.example\"]".to_owned()),
        (1, "flag-table", "model.retention={versions = 3}".to_owned()),
        (1, "flag-wrong", "model.hidden=0".to_owned()),
        (2, "variables", "SERVER__PAGE_SIZE=6\nDATABASE__PATH=/data/h.db\nRECORDED_DATA=x".to_owned()),
        (2, "variables-misspelt", "SERVER_LISTEN=x".to_owned()),
    ]
}
