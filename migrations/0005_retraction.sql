-- Retracting what was learned: a replay and its parts, and versions that learned what is no longer wanted.

-- A `replay` ends what its parts do, ordinary tasks that learn the line's stages again: it measures what came of them.
alter table task add column kind text not null default 'learn' check (kind in ('learn', 'replay'));
alter table task add column replay_id integer references task;   -- of a part: the replay it belongs to
alter table task add column replays integer;                     -- of a part: the version whose stage it learns again
alter table task add column place integer;                       -- its turn, where that is not the order of ids
create index task_by_replay on task (replay_id, place, task_id) where replay_id is not null;

create table replay (
    task_id   integer primary key references task,
    batch_id  integer not null references batch,  -- what was retracted
    from_head integer,                            -- the head before
    report    text                                -- what came of it, JSON; null until it has ended
) strict;
create index replay_by_batch on replay (batch_id);

-- Versions that learned what was retracted later, or continue one that did.
create table taint (
    model_id   integer not null,
    version    integer not null,
    batch_id   integer not null references batch,
    tainted_at text    not null,
    primary key (model_id, version, batch_id),
    foreign key (model_id, version) references version (model_id, version)
) strict, without rowid;
create index version_by_parent on version (model_id, parent);
create index version_by_task on version (task_id);

-- Content that is to go for good, and when it had gone.
alter table batch add column erase_asked_at text;
alter table batch add column erased_at text;
create index batch_to_erase on batch (batch_id) where erase_asked_at is not null and erased_at is null;
alter table idempotency add column batch_id integer;             -- of an upload's answer: what it is about
create index idempotency_by_batch on idempotency (batch_id) where batch_id is not null;

-- The same table with further actions and the report of a replay.
create table history_with_retractions (
    history_id integer primary key,
    model_id   integer not null references model,
    at         text    not null,
    action     text    not null check (action in ('promote', 'rollback', 'policy', 'retract', 'replay')),
    from_live  integer,
    live       integer,
    from_head  integer,
    head       integer,
    reason     text    not null,
    actor      text    not null,
    report     text                               -- of a replay, JSON
) strict;
insert into history_with_retractions (history_id, model_id, at, action, from_live, live, from_head, head, reason, actor)
select history_id, model_id, at, action, from_live, live, from_head, head, reason, actor from history;
drop table history;
alter table history_with_retractions rename to history;
create index history_by_model on history (model_id, history_id);
