use jiff::{SignedDuration, Timestamp};
use sqlx::query;
use tempfile::TempDir;

use super::*;
use crate::access::Scopes;
use crate::store::Store;
use crate::store::fixture::settings;

async fn open(directory: &TempDir) -> Store {
    Store::open(&settings(directory)).await.unwrap()
}

fn wish(scope: Scope) -> KeyWish {
    KeyWish { scopes: Scopes::from_iter([scope]), ..KeyWish::default() }
}

fn now() -> Timestamp {
    Timestamp::from_second(1_000).unwrap()
}

async fn made(store: &Store, wish: &KeyWish, max_keys: u32) -> Result<Key, NoKey> {
    let mut tx = store.begin().await.unwrap();
    let key = create(&mut tx, &Issued::draw().unwrap(), wish, max_keys, now()).await.unwrap();
    tx.commit().await.unwrap();
    key
}

async fn revoked(store: &Store, key: &Key, force: bool) -> Revoked {
    let mut tx = store.begin().await.unwrap();
    let revoked = revoke(&mut tx, key.key_id, force, now()).await.unwrap();
    tx.commit().await.unwrap();
    revoked
}

#[tokio::test]
async fn a_key_is_read_back_as_it_was_made_and_its_secret_is_not_kept() {
    let directory = tempfile::tempdir().unwrap();
    let store = open(&directory).await;
    made(&store, &wish(Scope::Admin), 9).await.unwrap();
    let limited = KeyWish {
        name: Some("a van".to_owned()),
        models: Some(vec![crate::lineage::ModelName::parse("default").unwrap()]),
        expires_at: Some(now() + SignedDuration::from_hours(1)),
        ..wish(Scope::Ingest)
    };
    let issued = Issued::draw().unwrap();
    let mut tx = store.begin().await.unwrap();
    let key = create(&mut tx, &issued, &limited, 9, now()).await.unwrap().unwrap();
    assert_eq!(create(&mut tx, &issued, &limited, 9, now()).await.unwrap(), Err(NoKey::Known(issued.key_id)));
    tx.commit().await.unwrap();
    assert_eq!(store.key(key.key_id).await.unwrap().as_ref(), Some(&key));
    assert_eq!(store.keys(1, 9).await.unwrap(), [(2, key.clone())]);
    let stored = store.stored_keys().await.unwrap();
    assert_eq!(stored[1], StoredKey { key, secret_sha256: issued.secret_sha256 });
    store.close().await;
    let bytes = std::fs::read(directory.path().join("headway.db")).unwrap();
    let secret = &issued.reveal().as_bytes()[20..];
    assert!(!bytes.windows(secret.len()).any(|window| window == secret));
}

#[tokio::test]
async fn the_last_active_admin_key_stays_unless_forced() {
    let directory = tempfile::tempdir().unwrap();
    let store = open(&directory).await;
    let is_managed = async || admin_is_active(&mut store.begin().await.unwrap(), now()).await.unwrap();
    made(&store, &wish(Scope::Train), 9).await.unwrap();
    assert!(!is_managed().await);
    let first = made(&store, &wish(Scope::Admin), 9).await.unwrap();
    let other = made(&store, &wish(Scope::Train), 9).await.unwrap();
    let expired = KeyWish { expires_at: Some(now()), ..wish(Scope::Admin) };
    made(&store, &expired, 9).await.unwrap();
    assert_eq!(revoked(&store, &first, false).await, Revoked::LastAdmin);
    let second = made(&store, &wish(Scope::Admin), 9).await.unwrap();
    let ended = Key { revoked_at: Some(now()), ..first.clone() };
    for _ in 0..2 {
        assert_eq!(revoked(&store, &first, false).await, Revoked::Done(ended.clone()));
    }
    assert!(matches!(revoked(&store, &other, false).await, Revoked::Done(_)));
    assert_eq!(revoked(&store, &second, false).await, Revoked::LastAdmin);
    assert!(is_managed().await);
    assert!(matches!(revoked(&store, &second, true).await, Revoked::Done(_)));
    assert!(!is_managed().await);
    let unknown = Key { key_id: Issued::draw().unwrap().key_id, ..first };
    assert_eq!(revoked(&store, &unknown, true).await, Revoked::Unknown);
}

#[tokio::test]
async fn there_are_only_so_many_keys() {
    let directory = tempfile::tempdir().unwrap();
    let store = open(&directory).await;
    let key = made(&store, &wish(Scope::Admin), 1).await.unwrap();
    assert_eq!(made(&store, &wish(Scope::Admin), 1).await, Err(NoKey::TooMany(1)));
    revoked(&store, &key, true).await;
    assert_eq!(made(&store, &wish(Scope::Admin), 1).await, Err(NoKey::TooMany(1)), "ended ones count");
}

#[tokio::test]
async fn the_database_itself_refuses_to_delete_a_key_or_to_change_one_but_for_its_end() {
    let directory = tempfile::tempdir().unwrap();
    let store = open(&directory).await;
    made(&store, &wish(Scope::Admin), 9).await.unwrap();
    let mut tx = store.begin().await.unwrap();
    for statement in [
        "delete from access_key",
        "update access_key set scopes = '[\"predict\"]'",
        "update access_key set revoked_at = '2026-01-01T00:00:00Z', expires_at = null, name = 'x'",
    ] {
        assert!(query(statement).execute(&mut *tx).await.is_err(), "{statement}");
    }
    query("update access_key set revoked_at = '2026-01-01T00:00:00Z'").execute(&mut *tx).await.unwrap();
    assert!(query("update access_key set revoked_at = null").execute(&mut *tx).await.is_err());
}

#[tokio::test]
async fn a_database_from_before_there_were_keys_opens_and_replays_its_answers_to_the_same_caller() {
    use crate::store::idempotency::{Recollection, RequestIdentity};
    use sqlx::sqlite::{SqliteConnectOptions, SqlitePoolOptions};

    let directory = tempfile::tempdir().unwrap();
    let options = SqliteConnectOptions::new().filename(directory.path().join("headway.db")).create_if_missing(true);
    let pool = SqlitePoolOptions::new().max_connections(1).connect_with(options).await.unwrap();
    let mut before = sqlx::migrate!("./migrations");
    before.migrations = before.migrations.iter().take(3).cloned().collect::<Vec<_>>().into();
    before.run(&pool).await.unwrap();
    query(
        "insert into idempotency (idempotency_key, route, request_sha256, status, headers, body, created_at)
         values ('k', 'POST /v1/models', zeroblob(32), 201, '[]', x'7b7d', '9999-01-01T00:00:00Z')",
    )
    .execute(&pool)
    .await
    .unwrap();
    pool.close().await;
    let store = open(&directory).await;
    assert_eq!(store.stored_keys().await.unwrap(), []);
    assert_eq!(store.audit(None, 0, 9).await.unwrap(), []);
    let [mine, others] = ["local", "0123456789abcdef"].map(|caller| RequestIdentity {
        key: "k".to_owned(),
        caller: caller.to_owned(),
        route: "POST /v1/models".to_owned(),
        request_sha256: [0; 32],
    });
    let Recollection::Answered(answer) = store.recall(&mine, 60).await.unwrap() else { panic!("it is forgotten") };
    assert_eq!((answer.status, answer.body), (201, b"{}".to_vec()));
    assert_eq!(store.recall(&others, 60).await.unwrap(), Recollection::New);
}
