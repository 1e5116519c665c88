//! What always holds between rows. Each rule is a query that finds the places where it does not.

use sqlx::sqlite::SqliteConnection;
use sqlx::{Row, query};

use super::Findings;
use crate::store::StoreError;

/// A rule about rows.
struct Rule {
    /// What is wrong with a place that it finds.
    fault: &'static str,
    /// Gives a `place` for each row that breaks it.
    breaks: &'static str,
}

/// Every rule, by the check it belongs to.
const CHECKS: [(&str, &[Rule]); 7] = [
    ("live and head", &POINTERS),
    ("history", &HISTORY),
    ("lineage", &LINEAGE),
    ("evaluations", &EVALUATIONS),
    ("tasks", &TASKS),
    ("batches", &BATCHES),
    ("events' states", &STATES),
];

const POINTERS: [Rule; 2] = [
    Rule {
        fault: "the live version does not exist",
        breaks: "select format('model %s, version %d', name, live_version) as place from model m
                 where live_version is not null and not exists
                     (select 1 from version v where v.model_id = m.model_id and v.version = m.live_version)",
    },
    Rule {
        fault: "the head does not exist",
        breaks: "select format('model %s, version %d', name, head_version) as place from model m
                 where head_version is not null and not exists
                     (select 1 from version v where v.model_id = m.model_id and v.version = m.head_version)",
    },
];

const HISTORY: [Rule; 2] = [
    Rule {
        fault: "the live version is not the one that the last entry of the history made live",
        breaks: "select format('model %s', name) as place from model m
                 where live_version is not (select live from history h where h.model_id = m.model_id
                                            order by history_id desc limit 1)",
    },
    Rule {
        fault: "it does not begin where the entry before ended",
        breaks: "select format('history h%d', history_id) as place from
                 (select history_id, from_live, lag(live) over (partition by model_id order by history_id) as before
                  from history) where from_live is not before",
    },
];

const LINEAGE: [Rule; 5] = [
    Rule {
        fault: "its parent is not an older version of the model",
        breaks: "select format('model %d, version %d', v.model_id, v.version) as place from version v
                 left join version p on p.model_id = v.model_id and p.version = v.parent
                 where v.parent is not null and (p.version is null or p.version >= v.version)",
    },
    Rule {
        fault: "its stage is not the one after its parent's",
        breaks: "select format('model %d, version %d', v.model_id, v.version) as place from version v
                 left join version p on p.model_id = v.model_id and p.version = v.parent
                 where v.task_id is not null and v.stage <> 1 + coalesce(p.stage, 0)",
    },
    Rule {
        fault: "the task that made it did not end with it, or began elsewhere",
        breaks: "select format('model %d, version %d', v.model_id, v.version) as place from version v
                 left join task t using (task_id) where v.task_id is not null
                 and (t.state is not 'succeeded' or t.version is not v.version or t.model_id is not v.model_id
                      or t.parent_version is not v.parent or t.stage is not v.stage)",
    },
    Rule {
        fault: "it succeeded and made no version",
        breaks: "select format('task t%d', task_id) as place from learning t where state = 'succeeded' and not exists
                 (select 1 from version v where v.task_id = t.task_id and v.version = t.version)",
    },
    Rule {
        fault: "it has no weights",
        breaks: "select format('model %d, version %d', v.model_id, v.version) as place from version v where not exists
                 (select 1 from weights w where w.model_id = v.model_id and w.version = v.version)
                 and not exists (select 1 from dropped d where d.model_id = v.model_id and d.version = v.version)",
    },
];

const EVALUATIONS: [Rule; 4] = [
    Rule {
        fault: "it has no evaluation of the regime it learned",
        breaks: "select format('model %d, version %d', v.model_id, v.version) as place from version v
                 where v.task_id is not null and not exists
                 (select 1 from version_regime r where r.model_id = v.model_id and r.version = v.version
                  and r.regime = v.regime and r.learned_version = v.version and r.learned_stage = v.stage)",
    },
    Rule {
        fault: "the version that learned it is not on its line",
        breaks: "select format('model %d, version %d, regime %s', r.model_id, r.version, r.regime) as place
                 from version_regime r where not exists
                 (select 1 from version l where l.model_id = r.model_id and l.version = r.learned_version
                  and (l.stage = r.learned_stage and l.regime = r.regime
                       -- What comes from elsewhere stands for the stages before it, which are not here.
                       or l.task_id is null and l.stage >= r.learned_stage and exists
                           (select 1 from version_regime o where o.model_id = l.model_id and o.version = l.version
                            and o.regime = r.regime and o.learned_stage = r.learned_stage)))",
    },
    Rule {
        fault: "what it keeps belongs to another model",
        breaks: "select format('model %d, version %d, regime %s', r.model_id, r.version, r.regime) as place
                 from version_regime r left join anchor a using (anchor_id)
                 left join reservoir s on s.reservoir_id = r.reservoir_id
                 where a.model_id <> r.model_id or s.model_id <> r.model_id",
    },
    Rule {
        fault: "no version keeps it",
        breaks: "select format('anchor %d', anchor_id) as place from anchor a
                 where not exists (select 1 from version_regime r where r.anchor_id = a.anchor_id)",
    },
];

const TASKS: [Rule; 6] = [
    Rule {
        fault: "its ledger is empty",
        breaks: "select format('task t%d', task_id) as place from learning t
                 where t.state not in ('failed', 'cancelled') and not exists (select 1 from task_event te where te.task_id = t.task_id)",
    },
    Rule {
        fault: "its ledger holds an event of another model",
        breaks: "select distinct format('task t%d', task_id) as place from task t join task_event te using (task_id)
                 join event e using (event_id) where e.model_id <> t.model_id",
    },
    Rule {
        fault: "it has a checkpoint and has ended",
        breaks: "select format('task t%d', task_id) as place from checkpoint join task t using (task_id)
                 where t.state not in ('queued', 'running')",
    },
    Rule {
        fault: "two of its tasks run",
        breaks: "select format('model %d', model_id) as place from task where state = 'running'
                 group by model_id having count(*) > 1",
    },
    Rule {
        fault: "an older task of the model ended after it began",
        breaks: "select format('task t%d', later.task_id) as place from learning later join learning earlier using (model_id)
                 where earlier.replay_id is null and later.replay_id is null and earlier.task_id < later.task_id and earlier.state = 'succeeded' and later.state = 'succeeded'
                 and earlier.version > later.version",
    },
    Rule {
        fault: "an event of a task under way is not claimed",
        breaks: "select distinct format('task t%d', t.task_id) as place from task t join task_event te using (task_id)
                 join event e using (event_id) where t.state in ('queued', 'running') and e.state <> 'claimed'",
    },
];

const BATCHES: [Rule; 3] = [
    Rule {
        fault: "it has not as many events as it says",
        breaks: "select format('batch b%d', batch_id) as place from batch b where accepted + duplicates <>
                 (select count(*) from batch_event be where be.batch_id = b.batch_id) or duplicates <>
                 (select count(*) from batch_event be where be.batch_id = b.batch_id and be.duplicate = 1)",
    },
    Rule {
        fault: "it has not as many rejections as it says",
        breaks: "select format('batch b%d', batch_id) as place from batch b where rejected <>
                 (select count(*) from rejection r where r.batch_id = b.batch_id)",
    },
    Rule {
        fault: "its batch does not hold it",
        breaks: "select format('batch b%d, event %s', batch_id, name) as place from event e where not exists
                 (select 1 from batch_event be where be.event_id = e.event_id and be.batch_id = e.batch_id)",
    },
];

const STATES: [Rule; 2] = [
    Rule {
        fault: "it is claimed by no task under way",
        breaks: "select format('batch b%d, event %s', batch_id, name) as place from event e where e.state = 'claimed'
                 and not exists (select 1 from task_event te join task t using (task_id)
                                 where te.event_id = e.event_id and t.state in ('queued', 'running'))",
    },
    Rule {
        fault: "it is learned, and no version's task took it",
        breaks: "select format('batch b%d, event %s', batch_id, name) as place from event e where e.state = 'learned'
                 and not exists (select 1 from task_event te join version v using (task_id)
                                 where te.event_id = e.event_id)",
    },
];

pub(super) async fn look(connection: &mut SqliteConnection, findings: &mut Findings<'_>) -> Result<(), StoreError> {
    for (check, rules) in CHECKS {
        findings.begin(check, rules.len() as u64);
        let outcome = each(connection, rules, findings).await;
        findings.end(outcome)?;
    }
    Ok(())
}

async fn each(
    connection: &mut SqliteConnection,
    rules: &[Rule],
    findings: &mut Findings<'_>,
) -> Result<(), StoreError> {
    for rule in rules {
        findings.looked();
        for row in query(rule.breaks).fetch_all(&mut *connection).await? {
            findings.fault(row.try_get::<&str, _>("place")?, rule.fault);
        }
    }
    Ok(())
}
