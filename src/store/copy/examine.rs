//! A file that somebody sent, and of which nothing is believed: its tables must be those of one of this release's schemas and
//! nothing beside them, every check of a database must find it sound, and every value must be one that this release reads.

use std::path::Path;

use futures_util::TryStreamExt;
use sqlx::migrate::Migrate as _;
use sqlx::sqlite::{SqliteConnectOptions, SqliteConnection};
use sqlx::{ConnectOptions as _, Connection as _, Row, query};

use crate::car_following::Event;
use crate::driver::Scaling;
use crate::lineage::{Model, RegimeName, Split, Version};
use crate::store::backup::sound;
use crate::store::column::{time, word};
use crate::store::schema::{self, APPLIED, MIGRATIONS};
use crate::store::verify::{Looking, open};
use crate::store::{Store, StoreError};

/// Rows read at once.
const PAGE: u32 = 256;

/// Why the file is of no use, or what went wrong while it was looked at.
type Found<T> = Result<T, Flaw>;

enum Flaw {
    Unusable(String),
    Failed(StoreError),
}

impl From<StoreError> for Flaw {
    fn from(error: StoreError) -> Self {
        match error {
            error @ (StoreError::Foreign { .. }
            | StoreError::Newer { .. }
            | StoreError::Migrate(_)
            | StoreError::Sql(_)
            | StoreError::Damaged(_)
            | StoreError::Corrupt { .. }
            | StoreError::Malformed { .. }) => Self::Unusable(error.to_string()),
            StoreError::Unsound(found) => {
                let first = found.faults.first();
                let told = first.map(|fault| format!("{}: {}: {}", fault.check, fault.place, fault.detail));
                Self::Unusable(format!("{} faults, the first: {}", found.faults_in_all(), told.unwrap_or_default()))
            }
            other => Self::Failed(other),
        }
    }
}

impl From<sqlx::Error> for Flaw {
    fn from(error: sqlx::Error) -> Self {
        StoreError::from(error).into()
    }
}

fn unusable(why: impl Into<String>) -> Flaw {
    Flaw::Unusable(why.into())
}

pub(super) async fn examine(
    path: &Path,
    progress: &(dyn Fn(Looking) + Sync),
) -> Result<Result<(), String>, StoreError> {
    match look(path, progress).await {
        Ok(()) => Ok(Ok(())),
        Err(Flaw::Unusable(why)) => Ok(Err(why)),
        Err(Flaw::Failed(error)) => Err(error),
    }
}

async fn look(path: &Path, progress: &(dyn Fn(Looking) + Sync)) -> Found<()> {
    let mut connection = open(path).await?;
    let schema = definitions(&mut connection, path).await;
    connection.close().await?;
    let schema = schema?;
    sound(path, progress).await?;
    if schema < schema::newest() {
        let mut connection = SqliteConnectOptions::new().filename(path).connect().await?;
        MIGRATIONS.run(&mut connection).await.map_err(StoreError::from)?;
        connection.close().await?;
        sound(path, progress).await?;
    }
    let store = Store::open_to_read(path).await?;
    let understood = understand(&store).await;
    store.close().await;
    understood?;
    let mut connection = open(path).await?;
    let events = events(&mut connection).await;
    connection.close().await?;
    events
}

/// That what the file defines is what its schema does: no view, trigger or table that somebody added is ever looked at.
async fn definitions(connection: &mut SqliteConnection, path: &Path) -> Found<i64> {
    let schema = schema::read(connection, path).await?;
    let mut made = SqliteConnectOptions::new().in_memory(true).disable_statement_logging().connect().await?;
    made.ensure_migrations_table(APPLIED).await.map_err(StoreError::from)?;
    schema::make(&mut made, schema).await?;
    let expected = defined(&mut made).await?;
    made.close().await?;
    if defined(connection).await? == expected {
        Ok(schema)
    } else {
        Err(unusable(format!("what it defines is not what schema {schema} does")))
    }
}

async fn defined(connection: &mut SqliteConnection) -> Result<Vec<[String; 4]>, StoreError> {
    let rows =
        query("select type, name, tbl_name, coalesce(sql, '') as sql from sqlite_schema order by type, name, sql");
    let rows = rows.fetch_all(connection).await?;
    let all = |row: &sqlx::sqlite::SqliteRow| -> Result<[String; 4], StoreError> {
        Ok([row.try_get("type")?, row.try_get("name")?, row.try_get("tbl_name")?, row.try_get("sql")?])
    };
    rows.iter().map(all).collect()
}

/// That everything can be read in the words of the service, and lies where these allow.
async fn understand(store: &Store) -> Found<()> {
    let models = store.models(0, 2).await?;
    let [model] = &models[..] else { return Err(unusable("it is to hold one model, not none or several")) };
    let wrong = |error: crate::lineage::SettingsError| unusable(error.to_string());
    model.settings.check().map_err(wrong)?;
    model.settings.check_for(model.method).map_err(wrong)?;
    let id = model.model_id;
    let mut after = 0;
    while let Some(last) = versions(store, model, after).await? {
        after = last;
    }
    pages(async |after| Ok(store.batches(id, after, PAGE).await?.last().map(|batch| batch.batch_id))).await?;
    pages(async |after| Ok(store.tasks(id, after, PAGE).await?.last().map(|task| task.task_id))).await?;
    pages(async |after| Ok(store.sources(id, after, PAGE).await?.last().map(|source| source.source_id))).await?;
    pages(async |after| Ok(store.history(id, after, PAGE).await?.last().map(|entry| entry.history_id))).await
}

async fn pages(read: impl AsyncFn(i64) -> Result<Option<i64>, StoreError>) -> Found<()> {
    let mut after = 0;
    while let Some(last) = read(after).await? {
        after = last;
    }
    Ok(())
}

/// The versions after this one; gives the last of those that were read.
async fn versions(store: &Store, model: &Model, after: i64) -> Found<Option<i64>> {
    let read = store.versions(model.model_id, after, PAGE).await?;
    for version in &read {
        if let Some(detail) = &version.corrupt {
            return Err(unusable(detail.clone()));
        }
        look_at_version(store, model, version).await?;
    }
    Ok(read.last().map(|version| version.version))
}

async fn look_at_version(store: &Store, model: &Model, version: &Version) -> Found<()> {
    let number = version.version;
    version.settings.check().map_err(|error| unusable(format!("version {number}: {error}")))?;
    let (shape, expected) = (version.settings.shape(), model.settings.shape());
    if version.method != model.method || shape != expected {
        return Err(unusable(format!("version {number} is not of the model's method and shape")));
    }
    let scaling = serde_json::from_value::<Scaling>(version.scaling.clone()).map_err(|error| error.to_string());
    if let Err(error) = scaling.and_then(|scaling| scaling.check(shape)) {
        return Err(unusable(format!("the scaling of version {number}: {error}")));
    }
    store.evaluation(model.model_id, number).await?;
    if version.pruned {
        return Ok(());
    }
    let usable = |values: &[f32]| values.len() == shape.layout().len() && values.iter().all(|x| x.is_finite());
    if !usable(&store.weights(model.model_id, number).await?) {
        return Err(unusable(format!("the weights of version {number} are not those of its network")));
    }
    for memory in store.memories(model.model_id, number).await? {
        if !usable(&memory.importance) || !usable(&memory.anchor) {
            return Err(unusable(format!("what version {number} keeps of a regime is not of its network")));
        }
    }
    Ok(())
}

/// Every event that still has its arrays.
async fn events(connection: &mut SqliteConnection) -> Found<()> {
    let mut rows = query("select name, regime, split, dt_s, arrived_at, arrays from event where length(arrays) > 0")
        .fetch(connection);
    while let Some(row) = rows.try_next().await? {
        let (name, dt_s): (&str, f64) =
            (row.try_get("name").map_err(StoreError::from)?, row.try_get("dt_s").map_err(StoreError::from)?);
        let (_, _): (RegimeName, Split) = (word(&row, "regime")?, word(&row, "split")?);
        time(&row, "arrived_at")?;
        let arrays: &[u8] = row.try_get("arrays").map_err(StoreError::from)?;
        let whole = Event::from_bytes(dt_s, arrays).filter(|event| {
            let values = [event.spacing_m(), event.follower_speed_mps(), event.leader_speed_mps()];
            event.steps() > 1 && values.concat().iter().all(|x| x.is_finite())
        });
        if whole.is_none() || !(dt_s.is_finite() && dt_s > 0.0) {
            return Err(unusable(format!("event {name} has arrays that cannot be")));
        }
    }
    Ok(())
}
