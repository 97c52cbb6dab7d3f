-- The failure profile: why score was lost, from the critique of replayed episodes. It runs behind the acknowledgement.

-- Episodes that wait for their critique: some of one lease and task a row, written by the transaction that stores them.
-- The transaction that enters what they showed deletes the row, so that each is criticised, skipped or failed once.
CREATE TABLE critique_queue (
    id       INTEGER NOT NULL PRIMARY KEY AUTOINCREMENT, -- never given twice
    run      TEXT    NOT NULL REFERENCES runs (id),
    task     TEXT    NOT NULL,
    lease    INTEGER NOT NULL REFERENCES leases (id),
    numbers  TEXT    NOT NULL, -- their indices in the lease
    episodes INTEGER NOT NULL -- how many
) STRICT;

-- What a profile rests on. Columns that end in _now are sums that halve every half-life of criticised episodes.
CREATE TABLE critique_sums (
    run          TEXT    NOT NULL REFERENCES runs (id),
    task         TEXT    NOT NULL,
    criticised   INTEGER NOT NULL,
    skipped      INTEGER NOT NULL, -- sampled out, while too many waited
    failed       INTEGER NOT NULL, -- could not be criticised; the log says why
    judged       REAL    NOT NULL, -- the judge's values
    judged_now   REAL    NOT NULL,
    needed       INTEGER NOT NULL, -- actions, by verdict
    needed_now   REAL    NOT NULL,
    harmless     INTEGER NOT NULL,
    harmless_now REAL    NOT NULL,
    wasteful     INTEGER NOT NULL,
    wasteful_now REAL    NOT NULL,
    harmful      INTEGER NOT NULL,
    harmful_now  REAL    NOT NULL,
    PRIMARY KEY (run, task)
) STRICT, WITHOUT ROWID;

-- Failures by mode, bearing sector and speed band; both −1 where nothing was met.
CREATE TABLE failure_profile (
    cell        INTEGER NOT NULL PRIMARY KEY,
    run         TEXT    NOT NULL REFERENCES runs (id),
    task        TEXT    NOT NULL,
    mode        TEXT    NOT NULL,
    sector      INTEGER NOT NULL,
    band        INTEGER NOT NULL,
    count       INTEGER NOT NULL,
    avoidable   INTEGER NOT NULL, -- of these; the rest was never visible
    unavoidable INTEGER NOT NULL,
    steps_left  INTEGER NOT NULL, -- their sum
    weight      REAL    NOT NULL, -- the count, halving every half-life, as it stood at as_of
    as_of       INTEGER NOT NULL, -- the last one's place among the task's criticised episodes
    last_at     INTEGER NOT NULL,
    UNIQUE (run, task, mode, sector, band)
) STRICT;

-- The newest failures of each cell: a ring, slot = nth mod its length.
CREATE TABLE failure_examples (
    cell           INTEGER NOT NULL REFERENCES failure_profile (cell),
    slot           INTEGER NOT NULL,
    nth            INTEGER NOT NULL, -- in its cell
    place          INTEGER NOT NULL, -- of the episode, among the task's criticised ones
    lease          INTEGER NOT NULL REFERENCES leases (id),
    number         INTEGER NOT NULL,
    agent          INTEGER NOT NULL,
    step           INTEGER NOT NULL,
    bearing_deg    REAL,
    relative_speed REAL,
    steps_left     INTEGER,
    avoidable      INTEGER,
    PRIMARY KEY (cell, slot)
) STRICT, WITHOUT ROWID;

-- What was reported before there was a critique waits for it too.
INSERT INTO critique_queue (run, task, lease, numbers, episodes)
SELECT l.run, g.task, e.lease, json_group_array(e.number), count(*)
FROM leases l
JOIN groups g ON g.lease = l.id
JOIN episodes e ON e.lease = l.id AND e.number >= g.number * l.group_size AND e.number < (g.number + 1) * l.group_size
WHERE g.proposal IS NOT NULL AND e.state = 'finished'
GROUP BY e.lease, g.task, e.number / 64;
