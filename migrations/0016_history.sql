-- What came of a run over time, task by task, in buckets of a minute (kept for a week) and of an hour (kept). A run of before begins here.
CREATE TABLE history (
    run       TEXT    NOT NULL REFERENCES runs (id),
    task      TEXT    NOT NULL,
    width     INTEGER NOT NULL, -- ms: 60 000 or 3 600 000
    start     INTEGER NOT NULL, -- a multiple of the width
    episodes  INTEGER NOT NULL, -- finished
    successes INTEGER NOT NULL,
    score     REAL    NOT NULL, -- their sum
    skilled   INTEGER NOT NULL,
    skill     REAL    NOT NULL,
    failed    INTEGER NOT NULL,
    expired   INTEGER NOT NULL,
    contested INTEGER NOT NULL, -- contested groups that were evidence
    solved    REAL    NOT NULL, -- the sum of their success shares
    panels    INTEGER NOT NULL, -- contested groups whose blind panel was looked at
    panel     REAL    NOT NULL, -- the sum of the shares of blind plans that succeed there
    groups    INTEGER NOT NULL, -- groups of several episodes that counted
    flat      INTEGER NOT NULL, -- of these, those whose episodes all have the same score
    claimed   INTEGER NOT NULL, -- episodes of accepted claims
    low       INTEGER,          -- the lowest level
    high      INTEGER,          -- the highest
    level     INTEGER,          -- the level, and the posterior over success there, when it was last looked
    mean      REAL,
    q10       REAL,
    q90       REAL,
    PRIMARY KEY (run, task, width, start)
) STRICT, WITHOUT ROWID;

-- The params of the scenarios that came back, in the same buckets.
CREATE TABLE history_params (
    run   TEXT    NOT NULL REFERENCES runs (id),
    task  TEXT    NOT NULL,
    width INTEGER NOT NULL,
    start INTEGER NOT NULL,
    param TEXT    NOT NULL,
    n     INTEGER NOT NULL,
    total REAL    NOT NULL,
    low   REAL    NOT NULL,
    high  REAL    NOT NULL,
    PRIMARY KEY (run, task, width, start, param)
) STRICT, WITHOUT ROWID;

-- What a run was told, whenever it was told otherwise.
CREATE TABLE run_settings (
    run      TEXT    NOT NULL REFERENCES runs (id),
    nth      INTEGER NOT NULL,
    at       INTEGER NOT NULL,
    settings TEXT    NOT NULL,
    PRIMARY KEY (run, nth)
) STRICT, WITHOUT ROWID;

INSERT INTO run_settings (run, nth, at, settings) SELECT id, 0, created_at, settings FROM runs;

-- A run that nobody wants to see any more: paused, and left out of lists.
ALTER TABLE runs ADD COLUMN archived_at INTEGER;

-- Of the episodes that were claimed in columns, those that were audited: they are in task_sums, too.
ALTER TABLE claimed_sums ADD COLUMN audited INTEGER NOT NULL DEFAULT 0;
