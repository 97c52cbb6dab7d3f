-- Retention: what a run keeps whole is a ring; older leases are folded, some of them into one row of packed columns.

-- Leases that are folded: what each episode came to, without its actions. Of what a level move, a layout or a failure's example
-- rests on the rows stay, with their lease.
CREATE TABLE folds (
    id       INTEGER NOT NULL PRIMARY KEY,
    run      TEXT    NOT NULL REFERENCES runs (id),
    first    INTEGER NOT NULL, -- lowest number of its leases
    last     INTEGER NOT NULL, -- highest
    episodes INTEGER NOT NULL, -- reported ones in it
    at       INTEGER NOT NULL,
    body     BLOB    NOT NULL  -- store/folds.rs
) STRICT;

CREATE INDEX folds_of_run ON folds (run, first, last);

-- A lease that was folded is here only as long as something of it stays.
ALTER TABLE leases ADD COLUMN folded INTEGER NOT NULL DEFAULT 0;

CREATE INDEX leases_to_fold ON leases (run, form, id, groups, group_size)
WHERE folded = 0 AND status <> 'active' AND purpose <> 'eval';

CREATE INDEX leases_folded ON leases (run, id) WHERE folded = 1;

-- Success over time of what was folded: stretches of a task's contested evidence, joined where there are many.
CREATE TABLE folded_progress (
    run     TEXT    NOT NULL REFERENCES runs (id),
    task    TEXT    NOT NULL,
    nth     INTEGER NOT NULL,
    at      INTEGER NOT NULL, -- when its last group closed
    low     INTEGER,          -- lowest level in it
    high    INTEGER,          -- highest
    n       INTEGER NOT NULL, -- contested scenarios
    success REAL    NOT NULL, -- sum of their success shares
    PRIMARY KEY (run, task, nth)
) STRICT, WITHOUT ROWID;

-- What is deleted must not be looked for by walking through those who could refer to it.
CREATE INDEX groups_of_scenario ON groups (scenario);
CREATE INDEX proposals_of_scenario ON proposals (scenario) WHERE scenario IS NOT NULL;
CREATE INDEX layouts_of_scenario ON layouts (scenario) WHERE scenario IS NOT NULL;
CREATE INDEX scenarios_of_recipe ON scenarios (recipe);
CREATE INDEX ranges_of_recipe ON seed_ranges (recipe);
CREATE INDEX critiques_of_lease ON critique_queue (lease);
CREATE INDEX examples_of_episode ON failure_examples (lease, number);
CREATE INDEX marks_of_lease ON run_marks (lease);
