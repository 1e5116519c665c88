//! A line of parents: what a version's line has learned, remembers and is tested on.

use sqlx::sqlite::SqliteRow;
use sqlx::{Row, query};

use super::array::floats;
use super::column::{count, digest, optional_count, sha256, word};
use super::version::ROLL_BACK;
use super::{Part, Store, StoreError, seal};
use crate::consolidation::RegimeMemory;
use crate::lineage::{RegimeEvaluation, ServedMeasures, TestMeasures};

/// A statement that sees `line (version, parent, task_id, regime)`: the version of model ?1 that `$first` names, and its
/// parents; a corrupt row that names itself or a younger version ends it. Further tables may follow it after a comma.
/// What is joined to it is to be cross joined: of the length of a line the planner knows nothing, and would rather read the
/// ledgers of all tasks than look up those of the line's.
macro_rules! with_line {
    ($first:literal, $statement:literal) => {
        concat!(
            "with recursive line (version, parent, task_id, regime) as (
                 select version, parent, task_id, regime from version where model_id = ?1 and version = ",
            $first,
            "
                 union all
                 select v.version, v.parent, v.task_id, v.regime from line
                 join version v on v.model_id = ?1 and v.version = line.parent and v.version < line.version
             ) ",
            $statement
        )
    };
}
pub(super) use with_line;

/// A regime a version's line has learned, with what is shared along the line.
#[derive(Debug, Clone, PartialEq)]
pub struct LineRegime {
    /// How the version drives in it.
    pub evaluation: RegimeEvaluation,
    /// What consolidation keeps of it.
    pub anchor_id: Option<i64>,
    /// Its test events.
    pub reservoir_id: i64,
}

fn measures_from(
    row: &SqliteRow,
    [spacing, speed, collisions]: [&'static str; 3],
) -> Result<Option<TestMeasures>, StoreError> {
    let (spacing_mse, speed_mse): (Option<f64>, Option<f64>) = (row.try_get(spacing)?, row.try_get(speed)?);
    let collisions: Option<u32> = optional_count(row, collisions)?;
    let (Some(spacing_mse), Some(speed_mse), Some(collisions)) = (spacing_mse, speed_mse, collisions) else {
        return Ok(None);
    };
    let (events, steps) = (count(row, "test_events")?, count(row, "test_steps")?);
    Ok(Some(TestMeasures { spacing_mse, speed_mse, collisions, events, steps }))
}

fn served_from(row: &SqliteRow) -> Result<Option<ServedMeasures>, StoreError> {
    let Some(spacing_mse) = row.try_get("served_spacing_mse")? else { return Ok(None) };
    Ok(Some(ServedMeasures {
        spacing_mse,
        speed_mse: row.try_get("served_speed_mse")?,
        collisions: count(row, "served_collisions")?,
        acted_steps: count(row, "served_acted_steps")?,
        held_steps: count(row, "served_held_steps")?,
    }))
}

fn regime_from(row: &SqliteRow) -> Result<LineRegime, StoreError> {
    Ok(LineRegime {
        evaluation: RegimeEvaluation {
            regime: word(row, "regime")?,
            learned_stage: count(row, "learned_stage")?,
            learned_version: row.try_get("learned_version")?,
            measures: measures_from(row, ["spacing_mse", "speed_mse", "collisions"])?,
            served: served_from(row)?,
            before: measures_from(row, ["before_spacing_mse", "before_speed_mse", "before_collisions"])?,
            diagonal_spacing_mse: row.try_get("diagonal_spacing_mse")?,
            best_spacing_mse: row.try_get("best_spacing_mse")?,
        },
        anchor_id: row.try_get("anchor_id")?,
        reservoir_id: row.try_get("reservoir_id")?,
    })
}

impl Store {
    /// Every regime the version's line has learned, in the order first learned.
    ///
    /// # Errors
    /// When the database cannot be read.
    pub async fn line_regimes(&self, model_id: i64, version: i64) -> Result<Vec<LineRegime>, StoreError> {
        let rows = query("select * from version_regime where model_id = ? and version = ? order by position")
            .bind(model_id)
            .bind(version)
            .fetch_all(&self.readers)
            .await?;
        for row in &rows {
            if !seal::VERSION_REGIME.is_intact(row)? {
                let detail =
                    format!("the evaluation of version {version} is corrupt: its digest does not match; {ROLL_BACK}");
                self.note_corrupt(model_id, version, &detail);
                return Err(StoreError::corrupt(Part::Version, detail));
            }
        }
        rows.iter().map(regime_from).collect()
    }

    /// The version's evaluation: one entry a regime, in the order first learned.
    ///
    /// # Errors
    /// When the database cannot be read.
    pub async fn evaluation(&self, model_id: i64, version: i64) -> Result<Vec<RegimeEvaluation>, StoreError> {
        let regimes = self.line_regimes(model_id, version).await?;
        Ok(regimes.into_iter().map(|regime| regime.evaluation).collect())
    }

    /// What consolidation keeps of the regimes of the version's line, in the order first learned.
    ///
    /// # Errors
    /// When the database cannot be read, or what it holds is not what was written.
    pub async fn memories(&self, model_id: i64, version: i64) -> Result<Vec<RegimeMemory>, StoreError> {
        let rows = query(
            "select r.regime, r.learned_stage, a.samples, a.importance, a.weights, a.anchor_sha256
             from version_regime r join anchor a on a.anchor_id = r.anchor_id
             where r.model_id = ? and r.version = ? order by r.position",
        )
        .bind(model_id)
        .bind(version)
        .fetch_all(&self.readers)
        .await?;
        let memories: Result<_, _> = rows.iter().map(memory_from).collect();
        if let Err(StoreError::Corrupt { detail, .. }) = &memories {
            self.note_corrupt(model_id, version, detail);
        }
        memories
    }
}

fn memory_from(row: &SqliteRow) -> Result<RegimeMemory, StoreError> {
    let regime: String = row.try_get("regime")?;
    let (importance, weights): (&[u8], &[u8]) = (row.try_get("importance")?, row.try_get("weights")?);
    if sha256(&[importance, weights]) != digest(row, "anchor_sha256")? {
        let detail = format!("what is kept of regime {regime} is corrupt: its digest does not match; {ROLL_BACK}");
        return Err(StoreError::corrupt(Part::Anchor, detail));
    }
    Ok(RegimeMemory {
        importance: floats("anchor", importance)?,
        anchor: floats("anchor", weights)?,
        samples: count(row, "samples")?,
        stage: count(row, "learned_stage")?,
        regime,
    })
}

#[cfg(test)]
mod tests {
    use sqlx::sqlite::{SqliteConnectOptions, SqlitePoolOptions};

    use jiff::Timestamp;

    use super::*;
    use crate::lineage::TaskKind;
    use crate::store::StoreSettings;
    use crate::store::fixture::settings;
    use crate::store::history::Action;
    use crate::store::retract::{Retracted, retract};

    /// A version as the first release wrote it, live, and the batch it learned.
    const FIRST_RELEASE: [&str; 10] = [
        "insert into model (name, method, settings, created_at) values ('m', 'naive', '{}', '2026-01-01T00:00:00Z')",
        "insert into batch (model_id, content_type, body_sha256, body_bytes, accepted, duplicates, rejected, summary, created_at)
         values (1, 'application/json', zeroblob(32), 9, 1, 0, 0, '{}', '2026-01-01T00:00:00Z')",
        "insert into event (model_id, content_sha256, batch_id, name, split, regime, state, dt_s, steps, mean_speed_mps,
             arrived_at, arrays)
         values (1, zeroblob(32), 1, 'e', 'train', 'fast', 'learned', 0.1, 0, 9.0, '2026-01-01T00:00:00.000000Z', x'')",
        "insert into batch_event (batch_id, ordinal, event_id, duplicate) values (1, 0, 1, 0)",
        "insert into task (model_id, state, regime, settings, stage, version, created_at)
         values (1, 'succeeded', 'fast', 'null', 1, 1, '2026-01-01T00:00:00Z')",
        "insert into task_event (task_id, event_id) values (1, 1)",
        "insert into version (model_id, version, task_id, stage, regime, method, settings, seed, kernel, train_events, events_sha256,
             scaling, weights_sha256, promotion, created_at)
         values (1, 1, 1, 1, 'fast', 'naive', '{\"envelope\": false}', 42, 'none', 1, zeroblob(32), '{}', zeroblob(32),
             '{\"policy\": \"auto\", \"decision\": \"promoted\", \"reason\": \"\"}', '2026-01-01T00:00:00Z')",
        "insert into reservoir (model_id, event_ids) values (1, x'')",
        "insert into version_regime (model_id, version, position, regime, learned_stage, learned_version, reservoir_id,
             test_events, test_steps, spacing_mse, speed_mse, collisions)
         values (1, 1, 0, 'fast', 1, 1, 1, 4, 400, 2.5, 0.5, 1)",
        "insert into history (model_id, at, action, live, head, reason, actor)
         values (1, '2026-01-01T00:00:00.000000Z', 'policy', 1, 1, 'nothing was live', 'policy')",
    ];

    /// A database of the first release, opened by this one.
    async fn opened(directory: &tempfile::TempDir) -> Store {
        let path = directory.path().join("headway.db");
        let options = SqliteConnectOptions::new().filename(&path).create_if_missing(true);
        let pool = SqlitePoolOptions::new().max_connections(1).connect_with(options).await.unwrap();
        let mut first = sqlx::migrate!("./migrations");
        first.migrations = first.migrations.iter().take(1).cloned().collect::<Vec<_>>().into();
        first.run(&pool).await.unwrap();
        for statement in FIRST_RELEASE {
            query(statement).execute(&pool).await.unwrap();
        }
        query("update model set live_version = 1, head_version = 1").execute(&pool).await.unwrap();
        pool.close().await;
        Store::open(&StoreSettings { backup_before_migration: false, ..settings(directory) }).await.unwrap()
    }

    #[tokio::test]
    async fn a_version_of_the_first_release_keeps_its_figures_and_has_none_of_what_came_later() {
        let directory = tempfile::tempdir().unwrap();
        let store = opened(&directory).await;
        let evaluation = store.evaluation(1, 1).await.unwrap().remove(0);
        assert_eq!(evaluation.measures.unwrap().spacing_mse, 2.5);
        assert_eq!(evaluation.served, None);
        let version = store.version(1, 1).await.unwrap().unwrap();
        assert_eq!((version.strength_search, version.tainted, version.pruned), (None, false, false));
    }

    #[tokio::test]
    async fn what_the_first_release_learned_can_be_unlearned_and_its_history_is_kept() {
        let directory = tempfile::tempdir().unwrap();
        let store = opened(&directory).await;
        let before = store.history(1, 0, 10).await.unwrap();
        assert_eq!((before.len(), before[0].action, &before[0].report), (1, Action::Policy, &None));
        let mut transaction = store.begin().await.unwrap();
        let retracted = retract(&mut transaction, 1, 1, Timestamp::now()).await.unwrap();
        assert_eq!(retracted, Retracted::Replaying { task_id: 2, stopped: Vec::new() });
        transaction.commit().await.unwrap();
        let after = store.history(1, 0, 10).await.unwrap();
        assert_eq!((after.len(), after[1].action, after[1].head), (2, Action::Retract, None));
        assert!(store.version(1, 1).await.unwrap().unwrap().tainted);
        let task = store.task(1, 1).await.unwrap().unwrap();
        assert_eq!((task.kind, task.part_of, task.parts), (TaskKind::Learn, None, Vec::new()));
    }
}
