//! The rows themselves. In every statement ?1 is the model they are of, ?2 the model they become, and ?3 whether everything
//! is copied.

use sqlx::sqlite::SqliteConnection;
use sqlx::{Row, query};

use super::{Chosen, rows_of};
use crate::store::array::{integers, stored_integers};
use crate::store::column::stored_ids;
use crate::store::{Part, StoreError};

/// Of any copy, in an order in which references are to what is there. Nothing runs in a copy: a task that does is in line.
/// What a line learned is learned, whatever became of it in the model that it is copied from, unless it was retracted.
pub(super) const OF_ANY: [&str; 14] = [
    "insert into batch (batch_id, model_id, source, regime, content_type, body_sha256, body_bytes, accepted, duplicates,
         rejected, summary, created_at, retracted_at, erase_asked_at, erased_at)
     select c.new, ?2, b.source, b.regime, b.content_type, b.body_sha256, b.body_bytes, b.accepted, b.duplicates,
         b.rejected, b.summary, b.created_at, b.retracted_at, b.erase_asked_at, b.erased_at
     from chosen_batch c cross join from_batch b on b.batch_id = c.old",
    "insert into event (event_id, model_id, content_sha256, batch_id, name, source, run, split, regime, state, dt_s, steps,
         mean_speed_mps, arrived_at, arrays, pruned_at)
     select c.new, ?2, e.content_sha256, b.new, e.name, e.source, e.run, e.split, e.regime,
         iif(?3 or e.state = 'retracted', e.state, 'learned'), e.dt_s, e.steps, e.mean_speed_mps, e.arrived_at, e.arrays,
         e.pruned_at
     from chosen_event c cross join from_event e on e.event_id = c.old cross join chosen_batch b on b.old = e.batch_id",
    "insert into batch_event (batch_id, ordinal, event_id, duplicate)
     select b.new, be.ordinal, e.new, be.duplicate
     from chosen_batch b cross join from_batch_event be on be.batch_id = b.old
     cross join chosen_event e on e.old = be.event_id",
    "insert into task (task_id, model_id, kind, state, regime, settings, parent_version, stage, version, attempt, crashes,
         cancel_requested, error_code, error_detail, created_at, started_at, ended_at, replay_id, replays, place)
     select c.new, ?2, t.kind, iif(t.state = 'running', 'queued', t.state), t.regime, t.settings, t.parent_version, t.stage,
         t.version, t.attempt, t.crashes, t.cancel_requested, t.error_code, t.error_detail, t.created_at, t.started_at,
         t.ended_at, p.new, iif(?3, t.replays, null), iif(?3, t.place, null)
     from chosen_task c cross join from_task t on t.task_id = c.old left join chosen_task p on p.old = t.replay_id",
    "insert into task_batch (task_id, batch_id)
     select t.new, b.new from chosen_task t cross join from_task_batch tb on tb.task_id = t.old
     cross join chosen_batch b on b.old = tb.batch_id",
    "insert into task_event (task_id, event_id)
     select t.new, e.new from chosen_task t cross join from_task_event te on te.task_id = t.old
     cross join chosen_event e on e.old = te.event_id",
    "insert into version (model_id, version, task_id, parent, stage, regime, method, settings, seed, strength, lambda, kernel,
         train_events, events_sha256, scaling, importance, weights_sha256, promotion, created_at, strength_search)
     select ?2, v.version, t.new, v.parent, v.stage, v.regime, v.method, v.settings, v.seed, v.strength, v.lambda, v.kernel,
         v.train_events, v.events_sha256, v.scaling, v.importance, v.weights_sha256, v.promotion, v.created_at,
         v.strength_search
     from chosen_version c cross join from_version v on v.model_id = ?1 and v.version = c.version
     left join chosen_task t on t.old = v.task_id",
    "insert into weights (model_id, version, weights)
     select ?2, w.version, w.weights
     from chosen_version c cross join from_weights w on w.model_id = ?1 and w.version = c.version",
    "insert into version_note (model_id, version, note, noted_at)
     select ?2, n.version, n.note, n.noted_at
     from chosen_version c cross join from_version_note n on n.model_id = ?1 and n.version = c.version",
    "insert into anchor (anchor_id, model_id, samples, importance, weights, anchor_sha256)
     select c.new, ?2, a.samples, a.importance, a.weights, a.anchor_sha256
     from chosen_anchor c cross join from_anchor a on a.anchor_id = c.old",
    "insert into reservoir (reservoir_id, model_id, event_ids) select new, ?2, x'' from chosen_reservoir",
    "insert into version_regime (model_id, version, position, regime, learned_stage, learned_version, anchor_id,
         reservoir_id, test_events, test_steps, spacing_mse, speed_mse, collisions, before_spacing_mse, before_speed_mse,
         before_collisions, diagonal_spacing_mse, best_spacing_mse, served_spacing_mse, served_speed_mse, served_collisions,
         served_acted_steps, served_held_steps)
     select ?2, r.version, r.position, r.regime, r.learned_stage, r.learned_version, a.new, s.new, r.test_events,
         r.test_steps, r.spacing_mse, r.speed_mse, r.collisions, r.before_spacing_mse, r.before_speed_mse,
         r.before_collisions, r.diagonal_spacing_mse, r.best_spacing_mse, r.served_spacing_mse, r.served_speed_mse,
         r.served_collisions, r.served_acted_steps, r.served_held_steps
     from chosen_version c cross join from_version_regime r on r.model_id = ?1 and r.version = c.version
     cross join chosen_reservoir s on s.old = r.reservoir_id left join chosen_anchor a on a.old = r.anchor_id",
    "insert into pruned (model_id, version, pruned_at)
     select ?2, p.version, p.pruned_at
     from chosen_version c cross join from_pruned p on p.model_id = ?1 and p.version = c.version",
    "insert into taint (model_id, version, batch_id, tainted_at)
     select ?2, x.version, b.new, x.tainted_at
     from chosen_version c cross join from_taint x on x.model_id = ?1 and x.version = c.version
     cross join chosen_batch b on b.old = x.batch_id",
];

/// Of a copy of everything.
pub(super) const OF_ALL: [&str; 4] = [
    "insert into rejection (batch_id, ordinal, position, name, place, at, code, detail)
     select b.new, r.ordinal, r.position, r.name, r.place, r.at, r.code, r.detail
     from chosen_batch b cross join from_rejection r on r.batch_id = b.old",
    "insert into replay (task_id, batch_id, from_head, report)
     select t.new, b.new, r.from_head, r.report
     from chosen_task t cross join from_replay r on r.task_id = t.old cross join chosen_batch b on b.old = r.batch_id",
    "insert into source (model_id, name, outcomes, held_at, reason, released_at)
     select ?2, s.name, s.outcomes, s.held_at, s.reason, s.released_at from from_source s where s.model_id = ?1
     order by s.source_id",
    "insert into history (model_id, at, action, from_live, live, from_head, head, reason, actor, report)
     select ?2, h.at, h.action, h.from_live, h.live, h.from_head, h.head, h.reason, h.actor, h.report
     from from_history h where h.model_id = ?1 order by h.history_id",
];

/// Of a copy of a line: a batch holds what was copied of it.
const OF_A_LINE: [&str; 1] = ["update batch set rejected = 0,
         accepted = (select count(*) from batch_event be where be.batch_id = batch.batch_id and be.duplicate = 0),
         duplicates = (select count(*) from batch_event be where be.batch_id = batch.batch_id and be.duplicate = 1)
     where batch_id in (select new from chosen_batch)"];

pub(super) async fn write(
    connection: &mut SqliteConnection,
    of: i64,
    to: i64,
    chosen: Chosen,
) -> Result<(), StoreError> {
    let others: &[&'static str] = if chosen.is_all() { &OF_ALL } else { &OF_A_LINE };
    for statement in OF_ANY.iter().chain(others) {
        query(*statement).bind(of).bind(to).bind(chosen.is_all()).execute(&mut *connection).await?;
    }
    reservoirs(connection, to).await
}

/// Test events are named by their ids, which are new.
async fn reservoirs(connection: &mut SqliteConnection, to: i64) -> Result<(), StoreError> {
    let rows = rows_of(
        connection,
        "select c.new, r.event_ids from chosen_reservoir c cross join from_reservoir r on r.reservoir_id = c.old",
        to,
    )
    .await?;
    for row in &rows {
        let old = integers("reservoir", row.try_get("event_ids")?)?;
        let new = query(
            "select coalesce(json_group_array(new), '[]') as new from (
                 select e.new from json_each(?) i cross join chosen_event e on e.old = i.value order by i.key)",
        )
        .bind(stored_ids(&old))
        .fetch_one(&mut *connection)
        .await?;
        let new: Vec<i64> =
            serde_json::from_str(new.try_get("new")?).map_err(|e| StoreError::malformed("reservoir", e))?;
        if new.len() != old.len() {
            return Err(StoreError::corrupt(Part::Reservoir, "a test reservoir names events that its line never had"));
        }
        query("update reservoir set event_ids = ? where reservoir_id = ?")
            .bind(stored_integers(&new))
            .bind(row.try_get::<i64, _>("new")?)
            .execute(&mut *connection)
            .await?;
    }
    Ok(())
}
