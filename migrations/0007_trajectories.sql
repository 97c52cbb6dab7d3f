-- Policies that workers fly for a run, and the feed of what they flew.

-- The policy of a run; a run without a row has none.
CREATE TABLE run_policies (
    run        TEXT    NOT NULL PRIMARY KEY REFERENCES runs (id),
    policy     TEXT    NOT NULL, -- 'off', 'chat', or a built-in one by name
    version    INTEGER NOT NULL,
    settings   TEXT    NOT NULL, -- JSON
    groups     INTEGER NOT NULL DEFAULT 0, -- pushed to the feed so far
    episodes   INTEGER NOT NULL DEFAULT 0, -- in them
    failed     INTEGER NOT NULL DEFAULT 0, -- episodes that the infrastructure lost
    trouble    TEXT,                       -- the last thing that went wrong, in words
    trouble_at INTEGER,
    changed_at INTEGER NOT NULL
) STRICT;

-- What a language model's tokens came to, by day (since 1970 UTC).
CREATE TABLE rollout_spent (
    run        TEXT    NOT NULL REFERENCES runs (id),
    day        INTEGER NOT NULL,
    tokens_in  INTEGER NOT NULL,
    tokens_out INTEGER NOT NULL,
    cost       REAL    NOT NULL,
    PRIMARY KEY (run, day)
) STRICT, WITHOUT ROWID;

-- Leases that workers of this server fly: given back when it starts again.
CREATE TABLE rollout_leases (
    lease INTEGER NOT NULL PRIMARY KEY REFERENCES leases (id)
) STRICT;

-- Finished groups, until they are acknowledged and for a while after. An id is never used twice.
CREATE TABLE trajectory_groups (
    id             INTEGER NOT NULL PRIMARY KEY AUTOINCREMENT,
    run            TEXT    NOT NULL REFERENCES runs (id),
    lease          INTEGER NOT NULL REFERENCES leases (id),
    number         INTEGER NOT NULL, -- of the group in its lease
    policy_version INTEGER NOT NULL,
    state          TEXT    NOT NULL CHECK (state IN ('ready', 'delivered', 'acked')),
    visible_at     INTEGER NOT NULL, -- from when on it is delivered (again)
    deliveries     INTEGER NOT NULL DEFAULT 0,
    bytes          INTEGER NOT NULL, -- of the body as JSON
    body           BLOB    NOT NULL, -- JSON, compressed (zstd)
    at             INTEGER NOT NULL,
    UNIQUE (lease, number)
) STRICT;

CREATE INDEX trajectory_groups_of_run ON trajectory_groups (run, id);
CREATE INDEX trajectory_groups_waiting ON trajectory_groups (run, id) WHERE state <> 'acked';
