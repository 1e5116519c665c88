-- What a copy takes its rows from, ORIGIN, and which: ids there, and the ids they get here. Temporary, for one copy.

create temp table chosen_version (version integer primary key) strict;
create temp table chosen_task (old integer primary key, new integer not null) strict;
create temp table chosen_event (old integer primary key, new integer not null) strict;
create temp table chosen_batch (old integer primary key, new integer not null) strict;
create temp table chosen_anchor (old integer primary key, new integer not null) strict;
create temp table chosen_reservoir (old integer primary key, new integer not null) strict;

create temp view from_model as select * from ORIGIN.model;
create temp view from_batch as select * from ORIGIN.batch;
create temp view from_event as select * from ORIGIN.event;
create temp view from_batch_event as select * from ORIGIN.batch_event;
create temp view from_rejection as select * from ORIGIN.rejection;
create temp view from_task as select * from ORIGIN.task;
create temp view from_task_batch as select * from ORIGIN.task_batch;
create temp view from_task_event as select * from ORIGIN.task_event;
create temp view from_replay as select * from ORIGIN.replay;
create temp view from_version as select * from ORIGIN.version;
create temp view from_weights as select * from ORIGIN.weights;
create temp view from_version_note as select * from ORIGIN.version_note;
create temp view from_anchor as select * from ORIGIN.anchor;
create temp view from_reservoir as select * from ORIGIN.reservoir;
create temp view from_version_regime as select * from ORIGIN.version_regime;
create temp view from_pruned as select * from ORIGIN.pruned;
create temp view from_taint as select * from ORIGIN.taint;
create temp view from_source as select * from ORIGIN.source;
create temp view from_history as select * from ORIGIN.history;
