//! Models: named lineages.

use jiff::Timestamp;
use sqlx::sqlite::{SqliteConnection, SqliteRow};
use sqlx::{Row, query};

use super::{Part, Purpose, Store, StoreError, WriteTransaction, seal};
use crate::consolidation::Method;
use crate::lineage::{Model, ModelName, ModelSettings, Retention};

/// `select` of every column, with what follows `from model`.
macro_rules! select_model {
    ($rest:literal) => {
        concat!(
            "select model_id, name, method, settings, live_version, head_version, paused, revision, created_at ",
            "from model ",
            $rest
        )
    };
}

/// Creates a model. `None` when the name is taken.
///
/// # Errors
/// When the database cannot be written.
pub async fn create(
    transaction: &mut WriteTransaction,
    name: &ModelName,
    method: Method,
    settings: &ModelSettings,
) -> Result<Option<Model>, StoreError> {
    transaction.is_for(Purpose::ModelCreated);
    let now = Timestamp::now();
    let inserted = query(
        "insert into model (name, method, settings, created_at) values (?, ?, ?, ?) \
             on conflict (name) do nothing returning model_id",
    )
    .bind(name.as_str())
    .bind(method.as_str())
    .bind(serde_json::to_string(settings).expect("settings are plain data"))
    .bind(now.to_string())
    .fetch_optional(&mut **transaction)
    .await?;
    let Some(row) = inserted else { return Ok(None) };
    seal::seal(transaction).await?;
    Ok(Some(Model {
        model_id: row.try_get(0)?,
        name: name.clone(),
        method,
        settings: settings.clone(),
        live: None,
        head: None,
        paused: false,
        revision: 1,
        created_at: now,
    }))
}

/// Holds (`true`) or releases a model's training; its revision grows when that changes anything.
///
/// # Errors
/// When the database cannot be written or the model is gone.
pub async fn set_paused(transaction: &mut WriteTransaction, model_id: i64, paused: bool) -> Result<Model, StoreError> {
    transaction.is_for(Purpose::ModelPaused);
    query("update model set paused = ?1, revision = revision + 1 where model_id = ?2 and paused <> ?1")
        .bind(paused)
        .bind(model_id)
        .execute(&mut **transaction)
        .await?;
    get(transaction, model_id).await
}

/// Says what of a model is kept from now on; its revision grows when that changes anything.
///
/// # Errors
/// When the database cannot be written, the model is gone, or it is corrupt: a new digest would hide that.
pub async fn set_retention(
    transaction: &mut WriteTransaction,
    model_id: i64,
    retention: Retention,
) -> Result<Model, StoreError> {
    transaction.is_for(Purpose::RetentionChanged);
    let model = intact(transaction, model_id).await?;
    if model.settings.retention == retention {
        return Ok(model);
    }
    let settings = ModelSettings { retention, ..model.settings };
    query("update model set settings = ?, revision = revision + 1, seal = null where model_id = ?")
        .bind(serde_json::to_string(&settings).expect("settings are plain data"))
        .bind(model_id)
        .execute(&mut **transaction)
        .await?;
    seal::seal(transaction).await?;
    get(transaction, model_id).await
}

/// The model, when its settings are what was last written.
async fn intact(connection: &mut SqliteConnection, model_id: i64) -> Result<Model, StoreError> {
    let row = query("select * from model where model_id = ?").bind(model_id).fetch_one(connection).await?;
    if !seal::MODEL.is_intact(&row)? {
        let detail = "the model's settings are corrupt: their digest does not match; restore a backup";
        return Err(StoreError::corrupt(Part::Model, detail));
    }
    model_from_row(&row)
}

/// The model as this transaction sees it.
///
/// # Errors
/// When the database cannot be read or the model is gone.
pub async fn get(connection: &mut SqliteConnection, model_id: i64) -> Result<Model, StoreError> {
    let row = query(select_model!("where model_id = ?")).bind(model_id).fetch_one(connection).await?;
    model_from_row(&row)
}

impl Store {
    /// Creates the model `default` (EWC) with `settings`, unless it is there.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn ensure_default_model(&self, settings: &ModelSettings) -> Result<(), StoreError> {
        let name = ModelName::parse("default").expect("well formed");
        let mut transaction = self.begin().await?;
        create(&mut transaction, &name, Method::Ewc, settings).await?;
        transaction.commit().await
    }

    /// The model with this row id.
    ///
    /// # Errors
    /// When the database fails or the model is gone.
    pub async fn model_by_id(&self, model_id: i64) -> Result<Model, StoreError> {
        let row = query(select_model!("where model_id = ?")).bind(model_id).fetch_one(&self.readers).await?;
        model_from_row(&row)
    }

    /// The model with this row id, when its settings are what was last written.
    ///
    /// # Errors
    /// When the database fails, the model is gone or it is corrupt.
    pub async fn intact_model(&self, model_id: i64) -> Result<Model, StoreError> {
        intact(&mut *self.readers.acquire().await?, model_id).await
    }

    /// The model of this name.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn model(&self, name: &ModelName) -> Result<Option<Model>, StoreError> {
        let row = query(select_model!("where name = ?")).bind(name.as_str()).fetch_optional(&self.readers).await?;
        row.as_ref().map(model_from_row).transpose()
    }

    /// Up to `limit` models created after the one with row id `after`, in order of creation.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn models(&self, after: i64, limit: u32) -> Result<Vec<Model>, StoreError> {
        self.models_among(None, after, limit).await
    }

    /// As [`Self::models`], of those that are named; none: of all.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn models_among(
        &self,
        names: Option<&[ModelName]>,
        after: i64,
        limit: u32,
    ) -> Result<Vec<Model>, StoreError> {
        let rows = query(select_model!(
            "where model_id > ?1 and (?3 is null or name in (select value from json_each(?3))) order by model_id limit ?2"
        ))
            .bind(after)
            .bind(limit)
            .bind(names.map(|names| serde_json::to_string(names).expect("names")))
            .fetch_all(&self.readers)
            .await?;
        rows.iter().map(model_from_row).collect()
    }
}

fn model_from_row(row: &SqliteRow) -> Result<Model, StoreError> {
    let malformed = |e: &dyn std::fmt::Display| StoreError::malformed("model", e);
    let method: String = row.try_get("method")?;
    Ok(Model {
        model_id: row.try_get("model_id")?,
        name: ModelName::parse(row.try_get("name")?).map_err(|e| malformed(&e))?,
        method: serde_json::from_value(method.into()).map_err(|e| malformed(&e))?,
        settings: serde_json::from_str(row.try_get("settings")?).map_err(|e| malformed(&e))?,
        live: row.try_get("live_version")?,
        head: row.try_get("head_version")?,
        paused: row.try_get("paused")?,
        revision: row.try_get("revision")?,
        created_at: row.try_get::<&str, _>("created_at")?.parse().map_err(|e| malformed(&e))?,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::fixture::settings;

    async fn open(directory: &tempfile::TempDir) -> Store {
        Store::open(&settings(directory)).await.unwrap()
    }

    #[tokio::test]
    async fn a_model_is_created_once_and_read_back_as_it_was() {
        let directory = tempfile::tempdir().unwrap();
        let store = open(&directory).await;
        let settings = ModelSettings { hidden: 8, ..ModelSettings::default() };
        let name = ModelName::parse("site-12").unwrap();
        let mut tx = store.begin().await.unwrap();
        let created = create(&mut tx, &name, Method::Mas, &settings).await.unwrap().unwrap();
        assert_eq!(create(&mut tx, &name, Method::Ewc, &settings).await.unwrap(), None);
        tx.commit().await.unwrap();
        assert_eq!(store.model(&name).await.unwrap(), Some(created));
    }

    #[tokio::test]
    async fn models_are_listed_by_key_and_the_default_is_made_once() {
        let directory = tempfile::tempdir().unwrap();
        let store = open(&directory).await;
        for _ in 0..2 {
            store.ensure_default_model(&ModelSettings::default()).await.unwrap();
        }
        let mut tx = store.begin().await.unwrap();
        for name in ["a", "b"] {
            let name = ModelName::parse(name).unwrap();
            create(&mut tx, &name, Method::Naive, &ModelSettings::default()).await.unwrap();
        }
        tx.commit().await.unwrap();
        let first = store.models(0, 2).await.unwrap();
        assert_eq!(first.iter().map(|m| m.name.as_str()).collect::<Vec<_>>(), ["default", "a"]);
        let rest = store.models(first[1].model_id, 2).await.unwrap();
        assert_eq!(rest.iter().map(|m| m.name.as_str()).collect::<Vec<_>>(), ["b"]);
    }

    #[tokio::test]
    async fn what_is_kept_can_be_changed_but_not_of_a_corrupt_model() {
        let directory = tempfile::tempdir().unwrap();
        let store = open(&directory).await;
        store.ensure_default_model(&ModelSettings::default()).await.unwrap();
        let before = store.models(0, 1).await.unwrap().remove(0);
        let retention = Retention { events_s: Some(60), versions: None };
        let mut tx = store.begin().await.unwrap();
        for _ in 0..2 {
            let changed = set_retention(&mut tx, before.model_id, retention).await.unwrap();
            assert_eq!(changed.settings, ModelSettings { retention, ..before.settings.clone() });
            assert_eq!(changed.revision, 2, "it grows when it changes anything");
        }
        tx.commit().await.unwrap();
        assert_eq!(store.intact_model(before.model_id).await.unwrap().settings.retention, retention);
        let mut tx = store.begin().await.unwrap();
        let flip = "update model set settings = replace(settings, '\"horizon\":10', '\"horizon\":11')";
        assert_eq!(query(flip).execute(&mut *tx).await.unwrap().rows_affected(), 1);
        let refused = set_retention(&mut tx, before.model_id, Retention::default()).await.unwrap_err();
        assert!(matches!(refused, StoreError::Corrupt { .. }), "{refused}");
    }

    #[tokio::test]
    async fn pausing_grows_the_revision_only_when_it_changes_anything() {
        let directory = tempfile::tempdir().unwrap();
        let store = open(&directory).await;
        store.ensure_default_model(&ModelSettings::default()).await.unwrap();
        let model_id = store.models(0, 1).await.unwrap()[0].model_id;
        let mut tx = store.begin().await.unwrap();
        let mut revisions = Vec::new();
        for paused in [true, true, false] {
            revisions.push(set_paused(&mut tx, model_id, paused).await.unwrap().revision);
        }
        assert_eq!(revisions, [2, 2, 3]);
    }
}
