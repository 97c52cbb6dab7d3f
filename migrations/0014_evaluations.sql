-- What policies did on frozen suites.
CREATE TABLE evaluations (
    id            INTEGER NOT NULL PRIMARY KEY AUTOINCREMENT,
    name          TEXT    NOT NULL,
    suite         TEXT    NOT NULL,
    suite_hash    TEXT    NOT NULL,
    policy        TEXT    NOT NULL, -- a built-in one where there is no run, else whatever the trainer calls it
    run           TEXT    REFERENCES runs (id), -- whose trainer flies it; none: the server does
    version       INTEGER,          -- of the run's policy
    training      TEXT,             -- what trainings of one kind are called together
    training_seed INTEGER,
    rollouts      INTEGER NOT NULL, -- episodes of each scenario
    chance        INTEGER NOT NULL, -- whether these differ by chance
    seed          INTEGER NOT NULL,
    state         TEXT    NOT NULL CHECK (state IN ('open', 'flying', 'complete', 'failed')),
    trouble       TEXT,             -- why it failed
    scenarios     INTEGER NOT NULL,
    flown         INTEGER NOT NULL DEFAULT 0,
    created_at    INTEGER NOT NULL,
    completed_at  INTEGER
) STRICT;

CREATE INDEX evaluations_flying ON evaluations (id) WHERE state = 'flying';

-- Their scenarios, by their place in the suite.
CREATE TABLE evaluation_scenarios (
    evaluation INTEGER NOT NULL REFERENCES evaluations (id),
    entry      INTEGER NOT NULL,
    lease      INTEGER,          -- the lease and group that fly it, or did
    number     INTEGER,
    episodes   TEXT,             -- JSON: score, success, skill, lost and fuel of each, once all are in
    PRIMARY KEY (evaluation, entry)
) STRICT, WITHOUT ROWID;

CREATE INDEX evaluation_scenarios_of_lease ON evaluation_scenarios (lease, number) WHERE lease IS NOT NULL;
