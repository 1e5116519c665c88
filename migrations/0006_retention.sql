-- Sources that are held, and what retention does not keep.

-- How the events of a source fared lately; while it is held, what comes from it waits as `held`.
create table source (
    source_id   integer primary key,
    model_id    integer not null references model,
    name        text    not null,
    outcomes    text    not null default '',     -- of the checks of its last events, oldest first: 1 passed, 0 failed
    held_at     text,
    reason      text,                            -- why it is, or was last
    released_at text,
    unique (model_id, name)
) strict;
create index source_by_model on source (model_id, source_id);
create index source_held on source (model_id) where held_at is not null;
create index event_held on event (model_id, source) where state = 'held';

-- Events whose arrays retention did not keep, and versions whose weights it did not.
alter table event add column pruned_at text;
create index event_prunable on event (model_id, arrived_at)
    where state = 'learned' and split <> 'test' and pruned_at is null;
create table pruned (
    model_id  integer not null,
    version   integer not null,
    pruned_at text    not null,
    primary key (model_id, version),
    foreign key (model_id, version) references version (model_id, version)
) strict, without rowid;
create index version_regime_by_anchor on version_regime (anchor_id) where anchor_id is not null;
