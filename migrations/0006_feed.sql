-- The fast path: leases whose episodes are recipes with ranges of seeds, and whose results come as columns; what happens in
-- a run, in order.

ALTER TABLE leases ADD COLUMN form TEXT NOT NULL DEFAULT 'groups' CHECK (form IN ('groups', 'columns'));

-- Groups of a lease that share a recipe: one seed a group, from `seed` on.
CREATE TABLE seed_ranges (
    lease    INTEGER NOT NULL REFERENCES leases (id),
    number   INTEGER NOT NULL,
    proposal INTEGER NOT NULL, -- seq in the lease's run
    recipe   BLOB    NOT NULL REFERENCES recipes (id),
    task     TEXT    NOT NULL,
    level    INTEGER,
    role     TEXT    NOT NULL,
    first    INTEGER NOT NULL, -- the lease's number of its first group
    groups   INTEGER NOT NULL,
    seed     INTEGER NOT NULL,
    finished INTEGER NOT NULL DEFAULT 0, -- of its episodes, as claimed
    failed   INTEGER NOT NULL DEFAULT 0,
    score    REAL    NOT NULL DEFAULT 0, -- sum over those that finished
    PRIMARY KEY (lease, number)
) STRICT, WITHOUT ROWID;

-- What a trainer claims of such a lease's episodes. A row's groups that are audited stand in `groups`.
CREATE TABLE column_claims (
    lease          INTEGER NOT NULL PRIMARY KEY REFERENCES leases (id),
    state          TEXT    NOT NULL CHECK (state IN ('claimed', 'accepted', 'refused', 'unproven')),
    digest         BLOB    NOT NULL, -- of what was claimed, to tell a repeat from a contradiction
    policy_version INTEGER NOT NULL,
    episodes       INTEGER NOT NULL,
    failed         INTEGER NOT NULL, -- of these, lost to infrastructure
    why            TEXT,             -- it was refused
    body           BLOB    NOT NULL, -- its first byte is the codec
    at             INTEGER NOT NULL
) STRICT;

-- The scores claimed of audited episodes: what their replay must come to.
CREATE TABLE audited_scores (
    lease  INTEGER NOT NULL REFERENCES leases (id),
    number INTEGER NOT NULL,
    score  REAL    NOT NULL,
    PRIMARY KEY (lease, number)
) STRICT, WITHOUT ROWID;

-- Plain sums over what was claimed, beside those over what was replayed. Level -1 where the strategy has no levels.
CREATE TABLE claimed_sums (
    run      TEXT    NOT NULL REFERENCES runs (id),
    task     TEXT    NOT NULL,
    level    INTEGER NOT NULL,
    episodes INTEGER NOT NULL, -- accepted, and not failed
    score    REAL    NOT NULL, -- their sum
    failed   INTEGER NOT NULL,
    refused  INTEGER NOT NULL, -- of refused claims
    unproven INTEGER NOT NULL, -- of claims whose audited logs never came
    expired  INTEGER NOT NULL, -- never claimed
    PRIMARY KEY (run, task, level)
) STRICT, WITHOUT ROWID;

-- What somebody should know of a run before trusting it.
CREATE TABLE run_marks (
    id    INTEGER NOT NULL PRIMARY KEY AUTOINCREMENT,
    run   TEXT    NOT NULL REFERENCES runs (id),
    kind  TEXT    NOT NULL,
    lease INTEGER REFERENCES leases (id),
    words TEXT    NOT NULL,
    at    INTEGER NOT NULL
) STRICT;

CREATE INDEX marks_of_run ON run_marks (run, id);

-- What happened in runs, in order; a ring for each run.
CREATE TABLE run_events (
    id   INTEGER NOT NULL PRIMARY KEY AUTOINCREMENT, -- never given twice: listeners resume after one
    run  TEXT    NOT NULL REFERENCES runs (id),
    kind TEXT    NOT NULL,
    body TEXT    NOT NULL,
    at   INTEGER NOT NULL
) STRICT;

CREATE INDEX events_of_run ON run_events (run, id);

-- Up to where they were forgotten.
CREATE TABLE forgotten_events (
    run  TEXT    NOT NULL PRIMARY KEY REFERENCES runs (id),
    last INTEGER NOT NULL
) STRICT, WITHOUT ROWID;
