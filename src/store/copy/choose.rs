//! Which rows are copied, and the ids they get: those after what is there, in the order of the old ones.

use sqlx::query;
use sqlx::sqlite::SqliteConnection;

use super::Chosen;
use crate::store::StoreError;
use crate::store::line::with_line;

/// The version ?2 of model ?1 and its parents.
const LINE: &str = with_line!("?2", "insert into chosen_version (version) select version from line");

/// Everything that a line learned from: whatever else its batches held was none of its business. A batch that learned events
/// are in stays with them, be it retracted, and so does one that taints a version. Tasks are in the order of what they made.
const OF_THE_LINE: [&str; 3] = [
    "insert into chosen_task (old, new)
     select v.task_id, (select coalesce(max(task_id), 0) from task) + row_number() over (order by c.version)
     from chosen_version c cross join from_version v on v.model_id = ?1 and v.version = c.version
     where v.task_id is not null",
    "insert into chosen_event (old, new)
     select event_id, (select coalesce(max(event_id), 0) from event) + row_number() over (order by event_id)
     from (select te.event_id from chosen_task t cross join from_task_event te on te.task_id = t.old group by te.event_id)",
    "insert into chosen_batch (old, new)
     select batch_id, (select coalesce(max(batch_id), 0) from batch) + row_number() over (order by batch_id)
     from (select be.batch_id from chosen_event e cross join from_batch_event be on be.event_id = e.old
           union select x.batch_id from chosen_version c
           cross join from_taint x on x.model_id = ?1 and x.version = c.version)",
];

const ALL: [&str; 4] = [
    "insert into chosen_version (version) select version from from_version where model_id = ?1",
    "insert into chosen_task (old, new)
     select task_id, (select coalesce(max(task_id), 0) from task) + row_number() over (order by task_id)
     from from_task where model_id = ?1",
    "insert into chosen_event (old, new)
     select event_id, (select coalesce(max(event_id), 0) from event) + row_number() over (order by event_id)
     from from_event where model_id = ?1",
    "insert into chosen_batch (old, new)
     select batch_id, (select coalesce(max(batch_id), 0) from batch) + row_number() over (order by batch_id)
     from from_batch where model_id = ?1",
];

/// What is kept of the regimes of the versions that were chosen.
const KEPT: [&str; 2] = [
    "insert into chosen_anchor (old, new)
     select anchor_id, (select coalesce(max(anchor_id), 0) from anchor) + row_number() over (order by anchor_id)
     from (select r.anchor_id from chosen_version c
           cross join from_version_regime r on r.model_id = ?1 and r.version = c.version
           where r.anchor_id is not null group by r.anchor_id)",
    "insert into chosen_reservoir (old, new)
     select reservoir_id, (select coalesce(max(reservoir_id), 0) from reservoir) + row_number() over (order by reservoir_id)
     from (select r.reservoir_id from chosen_version c
           cross join from_version_regime r on r.model_id = ?1 and r.version = c.version group by r.reservoir_id)",
];

pub(super) async fn choose(connection: &mut SqliteConnection, of: i64, chosen: Chosen) -> Result<(), StoreError> {
    let statements: &[&'static str] = match chosen {
        Chosen::All => &ALL,
        Chosen::Line(version) => {
            query(LINE).bind(of).bind(version).execute(&mut *connection).await?;
            &OF_THE_LINE
        }
    };
    for statement in statements.iter().chain(&KEPT) {
        query(*statement).bind(of).execute(&mut *connection).await?;
    }
    Ok(())
}
