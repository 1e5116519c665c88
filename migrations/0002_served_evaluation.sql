-- How the network drives within the envelope, on the same test events; null for versions that have none.
alter table version_regime add column served_spacing_mse real;
alter table version_regime add column served_speed_mse real;
alter table version_regime add column served_collisions integer;
alter table version_regime add column served_acted_steps integer;   -- for the leader's sake
alter table version_regime add column served_held_steps integer;    -- to keep the follower from driving backwards
