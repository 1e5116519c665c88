-- Who may do what, and who did what.

-- Keys are shown once, when they are made; here is what recognises them. Rows stay, and are only ever revoked: a server
-- that has had a key never again answers without one.
create table access_key (
    access_key_id integer primary key,
    key_id        text    not null unique,       -- the public part, 16 hexadecimal digits
    secret_sha256 blob    not null,              -- of the secret part, 256 random bits
    name          text,                          -- for people
    scopes        text    not null,              -- JSON array
    models        text,                          -- JSON array of names; null: every model
    created_at    text    not null,
    expires_at    text,
    revoked_at    text
) strict;
create trigger access_key_stays before delete on access_key begin
    select raise(abort, 'a key is revoked, never deleted');
end;
create trigger access_key_is_only_revoked before update on access_key
when old.revoked_at is not null or new.revoked_at is null
    or (new.access_key_id, new.key_id, new.secret_sha256, new.name, new.scopes, new.models, new.created_at, new.expires_at)
        is not
       (old.access_key_id, old.key_id, old.secret_sha256, old.name, old.scopes, old.models, old.created_at, old.expires_at)
begin
    select raise(abort, 'a key is revoked once, and otherwise never changed');
end;

-- Every change of state: who, what, when, in which request. Written in the transaction of the change.
create table audit (
    audit_id   integer primary key,
    at         text    not null,
    actor      text    not null,                 -- a key's id; else 'local', 'policy' or 'server'
    action     text    not null,
    model_id   integer references model,
    resource   text,                             -- its id on the wire
    request_id text,
    detail     text    not null                  -- JSON
) strict;
create index audit_by_model on audit (model_id, audit_id);
create trigger audit_never_changes before update on audit begin
    select raise(abort, 'the audit log is append-only');
end;
-- It is bounded: so many of its newest entries stay whatever happens, and only older ones may go.
create table audit_bound (
    entries integer not null check (entries > 0)
) strict;
insert into audit_bound (entries) values (1000000);
create trigger audit_is_only_trimmed before delete on audit
when old.audit_id > (select max(audit_id) from audit) - (select entries from audit_bound) begin
    select raise(abort, 'the audit log is append-only');
end;

-- An answer is replayed to the one it was given to.
create table idempotency_of_caller (
    idempotency_key text    not null,
    caller          text    not null,            -- a key's id, or 'local'
    route           text    not null,
    request_sha256  blob    not null,
    status          integer not null,
    headers         text    not null,            -- JSON
    body            blob    not null,
    created_at      text    not null,
    primary key (idempotency_key, caller, route)
) strict, without rowid;
insert into idempotency_of_caller
    select idempotency_key, 'local', route, request_sha256, status, headers, body, created_at from idempotency;
drop table idempotency;
alter table idempotency_of_caller rename to idempotency;
create index idempotency_by_age on idempotency (created_at);
