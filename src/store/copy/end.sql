-- Nothing of a copy stays on the connection that made it.

drop view temp.from_model;
drop view temp.from_batch;
drop view temp.from_event;
drop view temp.from_batch_event;
drop view temp.from_rejection;
drop view temp.from_task;
drop view temp.from_task_batch;
drop view temp.from_task_event;
drop view temp.from_replay;
drop view temp.from_version;
drop view temp.from_weights;
drop view temp.from_version_note;
drop view temp.from_anchor;
drop view temp.from_reservoir;
drop view temp.from_version_regime;
drop view temp.from_pruned;
drop view temp.from_taint;
drop view temp.from_source;
drop view temp.from_history;

drop table temp.chosen_version;
drop table temp.chosen_task;
drop table temp.chosen_event;
drop table temp.chosen_batch;
drop table temp.chosen_anchor;
drop table temp.chosen_reservoir;
