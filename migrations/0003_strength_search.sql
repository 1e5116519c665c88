-- What the search for a version's strength saw, JSON; null where nothing was searched.
alter table version add column strength_search text;
