-- The whole state of a Headway server. One file, one owner, one writer.
-- Names are the words of the interface; ids on the wire are these integers behind a letter ("b12", "t7").
-- Times are RFC 3339 UTC text. Arrays are little-endian f32. Every digest is SHA-256 over exactly the stored bytes.

-- A named lineage of versions. `revision` grows with every change a client can see here and is its ETag.
create table model (
    model_id     integer primary key,
    name         text    not null unique,
    method       text    not null,
    settings     text    not null,               -- resolved, JSON
    live_version integer,                        -- the version that serves
    head_version integer,                        -- the version the next task starts from
    paused       integer not null default 0 check (paused in (0, 1)),
    revision     integer not null default 1,
    created_at   text    not null
) strict;

-- The events of one upload, with provenance. Immutable but for its retraction.
create table batch (
    batch_id     integer primary key,
    model_id     integer not null references model,
    source       text,                           -- as the upload named it
    regime       text,                           -- the upload's label
    content_type text    not null,
    body_sha256  blob    not null,
    body_bytes   integer not null,
    accepted     integer not null,
    duplicates   integer not null,
    rejected     integer not null,
    summary      text    not null,               -- JSON
    created_at   text    not null,
    retracted_at text
) strict;
create index batch_by_model on batch (model_id, batch_id);

-- One leader-follower trajectory, stored once per model however often it is uploaded.
-- `claimed` events are in a queued or running task; clients see them as pending.
create table event (
    event_id       integer primary key,
    model_id       integer not null references model,
    content_sha256 blob    not null,             -- over dt_s and the arrays
    batch_id       integer not null references batch,   -- the first that stored it
    name           text    not null,             -- the client's event_id
    source         text,
    run            text,
    split          text    not null check (split in ('train', 'validation', 'test')),
    regime         text    not null,             -- resolved when it arrived
    state          text    not null check (state in ('pending', 'claimed', 'learned', 'set_aside', 'held', 'retracted')),
    dt_s           real    not null,
    steps          integer not null,
    mean_speed_mps real    not null,             -- of the follower
    arrived_at     text    not null,
    arrays         blob    not null,             -- spacing_m, follower_speed_mps, leader_speed_mps, each `steps` long
    unique (model_id, content_sha256)
) strict;
create index event_waiting on event (model_id, regime, arrived_at) where state = 'pending';

-- Which batches hold which content, in the order of the body.
create table batch_event (
    batch_id  integer not null references batch,
    ordinal   integer not null,
    event_id  integer not null references event,
    duplicate integer not null check (duplicate in (0, 1)),
    primary key (batch_id, ordinal)
) strict, without rowid;
create index batch_event_by_event on batch_event (event_id, batch_id);

-- Events that were refused, kept for inspection.
create table rejection (
    batch_id integer not null references batch,
    ordinal  integer not null,
    position integer not null,                   -- index of the event in the body
    name     text,                               -- the client's event_id, when it could be read
    place    text    not null check (place in ('pointer', 'line', 'row')),
    at       text    not null,                   -- JSON pointer, line number or row number
    code     text    not null,
    detail   text    not null,
    primary key (batch_id, ordinal)
) strict, without rowid;

-- The durable job that learns one regime from batches.
create table task (
    task_id          integer primary key,
    model_id         integer not null references model,
    state            text    not null check (state in ('queued', 'running', 'succeeded', 'failed', 'cancelled')),
    regime           text    not null,
    settings         text    not null,           -- overrides of the model's settings, JSON
    parent_version   integer,                    -- these two are fixed when it first starts
    stage            integer,
    version          integer,                    -- its outcome
    attempt          integer not null default 0, -- starts and resumptions
    crashes          integer not null default 0, -- of these, after its process died
    cancel_requested integer not null default 0 check (cancel_requested in (0, 1)),
    error_code       text,
    error_detail     text,
    created_at       text    not null,
    started_at       text,
    ended_at         text
) strict;
create index task_by_model on task (model_id, task_id);
create index task_active on task (model_id, task_id) where state in ('queued', 'running');
create table task_batch (
    task_id  integer not null references task,
    batch_id integer not null references batch,
    primary key (task_id, batch_id)
) strict, without rowid;
-- The ledger: exactly the events a task takes, whatever their split.
create table task_event (
    task_id  integer not null references task,
    event_id integer not null references event,
    primary key (task_id, event_id)
) strict, without rowid;
create index task_event_by_event on task_event (event_id, task_id);
-- Where a running task goes on after the process died. Replaced as it runs, deleted with its end.
create table checkpoint (
    task_id      integer primary key references task,
    saved_at     text not null,
    share        real not null,                  -- done, 0 to 1
    state        blob not null,
    state_sha256 blob not null
) strict;

-- The immutable outcome of a task. Rows are inserted, never updated.
create table version (
    model_id       integer not null references model,
    version        integer not null,
    task_id        integer references task,
    parent         integer,
    stage          integer not null,
    regime         text    not null,
    method         text    not null,
    settings       text    not null,             -- resolved, JSON
    seed           integer not null,
    strength       real,
    lambda         real,
    kernel         text    not null,             -- name of the arithmetic that made it
    train_events   integer not null,
    events_sha256  blob    not null,             -- over the sorted digests of the training events
    scaling        text    not null,             -- JSON
    importance     text,                         -- summary per layer, JSON
    weights_sha256 blob    not null,
    promotion      text    not null,             -- what the policy decided and why, JSON
    created_at     text    not null,
    primary key (model_id, version),
    foreign key (model_id, parent) references version (model_id, version)
) strict;
create table weights (
    model_id integer not null,
    version  integer not null,
    weights  blob    not null,                   -- one flat f32 vector
    primary key (model_id, version),
    foreign key (model_id, version) references version (model_id, version)
) strict;
create table version_note (
    model_id integer not null,
    version  integer not null,
    note     text    not null,
    noted_at text    not null,
    primary key (model_id, version),
    foreign key (model_id, version) references version (model_id, version)
) strict, without rowid;

-- What consolidation keeps of one regime: written once, shared by all later versions of the line.
create table anchor (
    anchor_id     integer primary key,
    model_id      integer not null references model,
    samples       integer not null,              -- supervised steps behind the importance
    importance    blob    not null,              -- one f32 per weight
    weights       blob    not null,              -- the weights it is anchored at
    anchor_sha256 blob    not null               -- over importance, then weights
) strict;
-- The bounded test set of one regime: ids of events, written once, shared likewise.
create table reservoir (
    reservoir_id integer primary key,
    model_id     integer not null references model,
    event_ids    blob    not null                -- little-endian i64
) strict;
-- Every regime a version's line has learned, in the order first learned.
create table version_regime (
    model_id         integer not null,
    version          integer not null,
    position         integer not null,
    regime           text    not null,
    learned_stage    integer not null,           -- the last stage that learned it
    learned_version  integer not null,
    anchor_id        integer references anchor,  -- null for methods that keep no importance
    reservoir_id     integer not null references reservoir,
    -- the evaluation of this version on the regime's test events; null without test events
    test_events      integer not null,
    test_steps       integer not null,
    spacing_mse      real,
    speed_mse        real,
    collisions       integer,
    before_spacing_mse real,                     -- the parent's, on the newly learned regime
    before_speed_mse   real,
    before_collisions  integer,
    diagonal_spacing_mse real,                   -- R[j,j]: at learned_version
    best_spacing_mse     real,                   -- least since learned_version, this version excluded
    primary key (model_id, version, position),
    foreign key (model_id, version) references version (model_id, version)
) strict, without rowid;

-- Who served when and why.
create table history (
    history_id integer primary key,
    model_id   integer not null references model,
    at         text    not null,
    action     text    not null check (action in ('promote', 'rollback', 'policy')),
    from_live  integer,
    live       integer,
    from_head  integer,
    head       integer,
    reason     text    not null,
    actor      text    not null
) strict;
create index history_by_model on history (model_id, history_id);

-- Answers to POSTs that carried an Idempotency-Key, committed with their effect.
create table idempotency (
    idempotency_key text    not null,
    route           text    not null,
    request_sha256  blob    not null,
    status          integer not null,
    headers         text    not null,            -- JSON
    body            blob    not null,
    created_at      text    not null,
    primary key (idempotency_key, route)
) strict, without rowid;
create index idempotency_by_age on idempotency (created_at);
