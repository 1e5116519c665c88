use serde_json::json;

use super::*;
use crate::consolidation::Method;
use crate::lineage::{ModelName, ModelSettings};
use crate::store::fixture::settings;
use crate::store::{StoreSettings, model};

async fn open(directory: &tempfile::TempDir, audit_entries: u32) -> Store {
    Store::open(&StoreSettings { audit_entries, ..settings(directory) }).await.unwrap()
}

fn somebody() -> Actor {
    Actor { name: "0123456789abcdef".to_owned(), request_id: Some("r1".to_owned()) }
}

async fn make_model(store: &Store, by: &Actor, name: &str) -> i64 {
    let mut tx = store.begin_for(by).await.unwrap();
    let name = ModelName::parse(name).unwrap();
    let made = model::create(&mut tx, &name, Method::Ewc, &ModelSettings::default()).await.unwrap().unwrap();
    tx.commit().await.unwrap();
    made.model_id
}

#[tokio::test]
async fn a_change_is_noted_with_who_and_why_in_its_own_transaction() {
    let directory = tempfile::tempdir().unwrap();
    let store = open(&directory, 1000).await;
    let made = make_model(&store, &somebody(), "a").await;
    let mut tx = store.begin().await.unwrap();
    model::set_paused(&mut tx, made, true).await.unwrap();
    model::set_paused(&mut tx, made, true).await.unwrap();
    tx.commit().await.unwrap();
    // What is not committed is not noted either.
    let mut tx = store.begin_for(&somebody()).await.unwrap();
    model::set_paused(&mut tx, made, false).await.unwrap();
    drop(tx);
    let entries = store.audit(Some(made), 0, 9).await.unwrap();
    let told: Vec<_> =
        entries.iter().map(|it| (it.action.as_str(), it.actor.as_str(), it.request_id.as_deref())).collect();
    assert_eq!(told, [("model.create", "0123456789abcdef", Some("r1")), ("model.pause", "server", None)]);
    assert_eq!((entries[0].resource.as_deref(), &entries[0].detail), (Some("a"), &json!({"method": "ewc"})));
    assert_eq!(store.audit(None, entries[0].audit_id, 9).await.unwrap(), entries[1..]);
}

#[tokio::test]
async fn the_log_is_bounded_and_otherwise_only_appended_to() {
    let directory = tempfile::tempdir().unwrap();
    let store = open(&directory, 20).await;
    for n in 0..30 {
        make_model(&store, &somebody(), &format!("m{n}")).await;
    }
    let entries = store.audit(None, 0, 99).await.unwrap();
    assert_eq!(entries.len(), 20);
    assert_eq!(entries.last().unwrap().resource.as_deref(), Some("m29"));
    let mut tx = store.begin().await.unwrap();
    for statement in ["delete from audit", "update audit set actor = 'nobody'", "delete from audit where audit_id = 30"]
    {
        let refused = query(statement).execute(&mut *tx).await.unwrap_err().to_string();
        assert!(refused.contains("append-only"), "{statement}: {refused}");
    }
    drop(tx);
    store.close().await;
    drop(store);
    let store = open(&directory, 5).await;
    for n in 30..32 {
        make_model(&store, &somebody(), &format!("m{n}")).await;
    }
    assert_eq!(store.audit(None, 0, 99).await.unwrap().len(), 5, "a lower bound is reached");
}
