-- A seal is SHA-256 over the columns of a row that never change, as the store's `seal` lists them; blobs among them stand
-- for themselves by digests of their own. Rows are sealed in the transaction that writes them, those from before when the
-- database is next opened; null until then.
alter table model add column seal blob;
alter table version add column seal blob;
alter table version_regime add column seal blob;
alter table reservoir add column seal blob;
create index model_unsealed on model (model_id) where seal is null;
create index version_unsealed on version (model_id, version) where seal is null;
create index version_regime_unsealed on version_regime (model_id, version, position) where seal is null;
create index reservoir_unsealed on reservoir (reservoir_id) where seal is null;
