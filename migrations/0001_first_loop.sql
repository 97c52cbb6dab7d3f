-- The first loop. Times are milliseconds since 1970 UTC. JSON is text. Migrations are append-only once landed.

CREATE TABLE runs (
    id             TEXT    NOT NULL PRIMARY KEY,
    name           TEXT    NOT NULL,
    seed           INTEGER NOT NULL,
    status         TEXT    NOT NULL CHECK (status IN ('active', 'paused')),
    settings       TEXT    NOT NULL,
    policy_version INTEGER NOT NULL DEFAULT 0, -- the newest a trainer has reported
    created_at     INTEGER NOT NULL
) STRICT;

-- A run's curriculum is a fold over these, in order of seq.
CREATE TABLE curriculum_events (
    run  TEXT    NOT NULL REFERENCES runs (id),
    seq  INTEGER NOT NULL,
    body TEXT    NOT NULL,
    at   INTEGER NOT NULL,
    PRIMARY KEY (run, seq)
) STRICT, WITHOUT ROWID;

-- The fold so far: everything before seq.
CREATE TABLE curriculum_snapshots (
    run  TEXT    NOT NULL REFERENCES runs (id),
    seq  INTEGER NOT NULL,
    body TEXT    NOT NULL,
    PRIMARY KEY (run, seq)
) STRICT, WITHOUT ROWID;

CREATE TABLE level_moves (
    run        TEXT    NOT NULL REFERENCES runs (id),
    seq        INTEGER NOT NULL, -- of the outcome that caused it
    task       TEXT    NOT NULL,
    kind       TEXT    NOT NULL,
    from_level INTEGER,
    to_level   INTEGER NOT NULL,
    evidence   TEXT    NOT NULL,
    at         INTEGER NOT NULL,
    PRIMARY KEY (run, seq, task)
) STRICT, WITHOUT ROWID;

CREATE TABLE recipes (
    id   BLOB NOT NULL PRIMARY KEY,
    body TEXT NOT NULL
) STRICT, WITHOUT ROWID;

CREATE TABLE scenarios (
    id     BLOB    NOT NULL PRIMARY KEY,
    recipe BLOB    NOT NULL REFERENCES recipes (id),
    seed   INTEGER NOT NULL
) STRICT, WITHOUT ROWID;

CREATE TABLE brackets (
    scenario BLOB    NOT NULL REFERENCES scenarios (id),
    planner  INTEGER NOT NULL,
    body     TEXT    NOT NULL, -- floor, panel, reference
    witness  BLOB    NOT NULL, -- an action log
    PRIMARY KEY (scenario, planner)
) STRICT, WITHOUT ROWID;

-- The durable queue of what comes next; key is the seq of the event that proposed it.
CREATE TABLE proposals (
    run       TEXT    NOT NULL REFERENCES runs (id),
    seq       INTEGER NOT NULL,
    state     TEXT    NOT NULL CHECK (state IN ('proposed', 'prepared', 'leased', 'dropped')),
    body      TEXT    NOT NULL,
    scenario  BLOB REFERENCES scenarios (id),
    contested INTEGER, -- as found, not as asked
    planted   INTEGER,
    attempts  INTEGER NOT NULL DEFAULT 0, -- how often it was leased
    PRIMARY KEY (run, seq)
) STRICT, WITHOUT ROWID;

CREATE INDEX proposals_waiting ON proposals (run, seq) WHERE state IN ('proposed', 'prepared');

CREATE INDEX proposals_unprepared ON proposals (run, seq) WHERE state = 'proposed';

CREATE TABLE leases (
    id             INTEGER NOT NULL PRIMARY KEY,
    token          TEXT    NOT NULL,
    run            TEXT    NOT NULL REFERENCES runs (id),
    purpose        TEXT    NOT NULL CHECK (purpose IN ('train', 'probe', 'eval')),
    status         TEXT    NOT NULL CHECK (status IN ('active', 'done', 'released', 'expired')),
    groups         INTEGER NOT NULL,
    group_size     INTEGER NOT NULL,
    policy_version INTEGER NOT NULL,
    ttl_ms         INTEGER NOT NULL,
    created_at     INTEGER NOT NULL,
    expires_at     INTEGER NOT NULL
) STRICT;

CREATE INDEX leases_to_expire ON leases (expires_at) WHERE status = 'active';
CREATE INDEX leases_of_run ON leases (run, id);

CREATE TABLE groups (
    lease     INTEGER NOT NULL REFERENCES leases (id),
    number    INTEGER NOT NULL,
    proposal  INTEGER, -- seq in the lease's run; none for eval
    scenario  BLOB    NOT NULL REFERENCES scenarios (id),
    task      TEXT    NOT NULL,
    level     INTEGER,
    role      TEXT    NOT NULL,
    contested INTEGER NOT NULL,
    state     TEXT    NOT NULL CHECK (state IN ('open', 'complete', 'partial', 'lost')),
    finished  INTEGER NOT NULL DEFAULT 0,
    failed    INTEGER NOT NULL DEFAULT 0,
    successes INTEGER NOT NULL DEFAULT 0,
    evidence  INTEGER NOT NULL DEFAULT 0, -- whether its outcome could move the curriculum
    closed_at INTEGER,
    metrics   TEXT,
    PRIMARY KEY (lease, number)
) STRICT, WITHOUT ROWID;

-- One row per reported episode; those not reported follow from their lease.
CREATE TABLE episodes (
    lease          INTEGER NOT NULL REFERENCES leases (id),
    number         INTEGER NOT NULL,
    state          TEXT    NOT NULL CHECK (state IN ('finished', 'failed', 'late')),
    digest         BLOB    NOT NULL, -- of what was reported, to tell a repeat from a contradiction
    score          REAL,
    success        INTEGER,
    skill          REAL,
    floor          REAL,
    reference      REAL,
    planner        INTEGER,
    flown          TEXT, -- total, steps, lost, goal, fuel_used
    policy_version INTEGER NOT NULL,
    reason         TEXT, -- why it failed
    metrics        TEXT, -- what the trainer logged
    at             INTEGER NOT NULL,
    PRIMARY KEY (lease, number)
) STRICT, WITHOUT ROWID;

CREATE TABLE action_logs (
    lease  INTEGER NOT NULL,
    number INTEGER NOT NULL,
    body   BLOB    NOT NULL, -- its first byte is the codec
    PRIMARY KEY (lease, number)
) STRICT, WITHOUT ROWID;

-- Plain sums over all episodes, beside mastery.
CREATE TABLE task_sums (
    run       TEXT    NOT NULL REFERENCES runs (id),
    task      TEXT    NOT NULL,
    level     INTEGER NOT NULL, -- -1 where the strategy has no levels
    episodes  INTEGER NOT NULL,
    successes INTEGER NOT NULL,
    failed    INTEGER NOT NULL,
    expired   INTEGER NOT NULL,
    score     REAL    NOT NULL,
    skilled   INTEGER NOT NULL, -- episodes that have a skill
    skill     REAL    NOT NULL,
    PRIMARY KEY (run, task, level)
) STRICT, WITHOUT ROWID;
