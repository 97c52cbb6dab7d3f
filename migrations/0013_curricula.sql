-- Whether a group is to be learnt from: some curricula only look.
ALTER TABLE groups ADD COLUMN train INTEGER NOT NULL DEFAULT 1;

-- How many groups a lease may still be given in place of those whose episodes all came to the same, and how many it is owed now.
ALTER TABLE leases ADD COLUMN refills INTEGER NOT NULL DEFAULT 0;
ALTER TABLE leases ADD COLUMN owed INTEGER NOT NULL DEFAULT 0;
CREATE INDEX leases_owed ON leases (run) WHERE owed > 0;

-- What the curriculum was told when the run began, where that has changed since: events are folded from there.
ALTER TABLE runs ADD COLUMN first_curriculum TEXT;

-- How groups of more than one episode ended. Level −1 is for strategies without levels.
CREATE TABLE group_sums (
    run      TEXT    NOT NULL REFERENCES runs (id),
    task     TEXT    NOT NULL,
    level    INTEGER NOT NULL,
    complete INTEGER NOT NULL DEFAULT 0,
    partial  INTEGER NOT NULL DEFAULT 0, -- fewer than all of its episodes finished, and enough did
    lost     INTEGER NOT NULL DEFAULT 0, -- too few finished
    flat     INTEGER NOT NULL DEFAULT 0, -- of the first two, those whose episodes all have the same score
    PRIMARY KEY (run, task, level)
) STRICT, WITHOUT ROWID;

-- Versions of a run's policy that were told of.
CREATE TABLE policy_versions (
    run        TEXT    NOT NULL REFERENCES runs (id),
    version    INTEGER NOT NULL,
    checkpoint TEXT, -- where its weights are, in the trainer's own words
    notes      TEXT,
    at         INTEGER NOT NULL,
    PRIMARY KEY (run, version)
) STRICT, WITHOUT ROWID;

-- How versions of the policy fared, over the episodes that count in task_sums.
CREATE TABLE version_sums (
    run       TEXT    NOT NULL REFERENCES runs (id),
    version   INTEGER NOT NULL,
    task      TEXT    NOT NULL,
    episodes  INTEGER NOT NULL,
    successes INTEGER NOT NULL,
    score     REAL    NOT NULL,
    first_at  INTEGER NOT NULL,
    last_at   INTEGER NOT NULL,
    PRIMARY KEY (run, version, task)
) STRICT, WITHOUT ROWID;
