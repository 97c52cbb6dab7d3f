-- The shard of the server that writes this database, which is the first part of the ids that the server makes. No row for a server
-- without a shard.
CREATE TABLE shard (
    id   INTEGER NOT NULL PRIMARY KEY CHECK (id = 1),
    name TEXT    NOT NULL
) STRICT;
