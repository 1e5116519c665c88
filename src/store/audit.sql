-- What is written into the audit log, all of it, and in whose name. The one connection that writes has these: they are
-- temporary, made anew with it, and so is the row that says who acts (`begin_for` of the store).

-- While rows are copied, the change is noted as one, under this name.
create temp table acting (actor text not null, request_id text, copied_as text, copied_from text) strict;
insert into acting (actor) values ('server');

-- One entry. Whoever says who, like the promotion policy, is believed; else it is who acts.
create temp view noted as select '' as action, 0 as model_id, '' as resource, '' as detail, '' as actor;
create temp trigger note instead of insert on noted begin
    insert into audit (at, actor, action, model_id, resource, request_id, detail)
    select strftime('%Y-%m-%dT%H:%M:%f000Z', 'now'), coalesce(new.actor, actor), new.action, new.model_id, new.resource,
           request_id, new.detail
    from acting;
    -- The log is bounded. A bound that was lowered is reached step by step.
    delete from audit where audit_id in (
        select audit_id from audit
        where audit_id <= (select max(audit_id) from audit) - (select entries from audit_bound)
        order by audit_id limit 16
    );
end;

create temp trigger noted_model after insert on model begin
    insert into noted select coalesce(copied_as, 'model.create'), new.model_id, new.name,
        iif(copied_as is null, json_object('method', new.method), json_object('method', new.method, 'from', copied_from)), null
    from acting;
end;
create temp trigger noted_pause after update of paused on model when new.paused <> old.paused begin
    insert into noted values (iif(new.paused, 'model.pause', 'model.resume'), new.model_id, new.name, '{}', null);
end;

-- Of a model's settings nothing else ever changes.
create temp trigger noted_retention after update of settings on model when new.settings <> old.settings begin
    insert into noted values ('model.retain', new.model_id, new.name,
        json_object('retention', json(new.settings -> '$.retention')), null);
end;

create temp trigger noted_batch after insert on batch when (select copied_as from acting) is null begin
    insert into noted values ('batch.upload', new.model_id, 'b' || new.batch_id,
        json_object('source', new.source, 'regime', new.regime, 'body_sha256', lower(hex(new.body_sha256))), null);
end;
create temp trigger noted_retraction after update of retracted_at on batch
when old.retracted_at is null and new.retracted_at is not null begin
    insert into noted values ('batch.retract', new.model_id, 'b' || new.batch_id, '{}', null);
end;

create temp trigger noted_erasure after update of erase_asked_at on batch
when old.erase_asked_at is null and new.erase_asked_at is not null begin
    insert into noted values ('batch.erase', new.model_id, 'b' || new.batch_id, '{}', null);
end;
create temp trigger noted_source after update of held_at on source
when (old.held_at is null) <> (new.held_at is null) begin
    insert into noted values (iif(new.held_at is null, 'source.release', 'source.hold'), new.model_id, new.name,
        json_object('reason', new.reason), null);
end;

create temp trigger noted_task after insert on task when (select copied_as from acting) is null begin
    insert into noted values ('task.create', new.model_id, 't' || new.task_id, json_object('regime', new.regime), null);
end;
-- Noted once: when a running task is asked to end, or when one ends that nobody asked.
create temp trigger noted_cancel after update of cancel_requested on task
when new.cancel_requested and not old.cancel_requested begin
    insert into noted values ('task.cancel', new.model_id, 't' || new.task_id, '{}', null);
end;
create temp trigger noted_end after update of state on task
when new.state in ('cancelled', 'failed') and new.state <> old.state and not new.cancel_requested begin
    insert into noted values (iif(new.state = 'failed', 'task.fail', 'task.cancel'), new.model_id, 't' || new.task_id,
        iif(new.state = 'failed', json_object('code', new.error_code), '{}'), null);
end;

create temp trigger noted_version after insert on version when (select copied_as from acting) is null begin
    insert into noted values ('version.create', new.model_id, cast(new.version as text),
        json_object('task_id', 't' || new.task_id, 'parent', new.parent, 'weights_sha256', lower(hex(new.weights_sha256))), null);
end;
create temp trigger noted_note after insert on version_note when (select copied_as from acting) is null begin
    insert into noted values ('version.note', new.model_id, cast(new.version as text), json_object('note', substr(new.note, 1, 256)), null);
end;
create temp trigger noted_other_note after update on version_note begin
    insert into noted values ('version.note', new.model_id, cast(new.version as text), json_object('note', substr(new.note, 1, 256)), null);
end;
create temp trigger noted_no_note after delete on version_note begin
    insert into noted values ('version.note', old.model_id, cast(old.version as text), json_object('note', null), null);
end;
-- A retraction that moved the head was noted with its batch.
create temp trigger noted_move after insert on history
when new.action <> 'retract' and (select copied_as from acting) is null begin
    insert into noted values (
        case new.action when 'rollback' then 'version.rollback' when 'replay' then 'version.replay' else 'version.promote' end,
        new.model_id,
        cast(new.live as text),
        json_object('history_id', 'h' || new.history_id, 'from', new.from_live, 'reason', new.reason), new.actor);
end;

-- A copy changes nothing here, and hands out everything: what is said of it is kept in no other table.
create temp view backup_taken as select '' as name, 0 as bytes;
create temp trigger noted_backup instead of insert on backup_taken begin
    insert into noted values ('backup.take', null, new.name, json_object('bytes', new.bytes), null);
end;
create temp view archive_taken as select 0 as model_id, '' as name, 0 as bytes;
create temp trigger noted_archive instead of insert on archive_taken begin
    insert into noted values ('archive.take', new.model_id, new.name, json_object('bytes', new.bytes), null);
end;

create temp trigger noted_key after insert on access_key begin
    insert into noted values ('key.create', null, new.key_id,
        json_object('scopes', json(new.scopes), 'models', json(new.models), 'expires_at', new.expires_at), null);
end;
create temp trigger noted_revocation after update of revoked_at on access_key begin
    insert into noted values ('key.revoke', null, new.key_id, '{}', null);
end;
