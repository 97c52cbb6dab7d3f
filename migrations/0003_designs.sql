-- The designer's life: what it is asked, what it thought of, what became of that, and where failures come from in the
-- inertial frame.

-- Failures by mode and inertial bearing sector: an agent that is blind to one side of the sky fails all around its orbit.
CREATE TABLE failure_inertial (
    run    TEXT    NOT NULL REFERENCES runs (id),
    task   TEXT    NOT NULL,
    mode   TEXT    NOT NULL,
    sector INTEGER NOT NULL,
    count  INTEGER NOT NULL,
    weight REAL    NOT NULL, -- the count, halving every half-life, as it stood at as_of
    as_of  INTEGER NOT NULL, -- the last one's place among the task's criticised episodes
    PRIMARY KEY (run, task, mode, sector)
) STRICT, WITHOUT ROWID;

-- One round of asking a designer.
CREATE TABLE design_asks (
    id         INTEGER NOT NULL PRIMARY KEY AUTOINCREMENT, -- never given twice: seeds follow from it
    run        TEXT    NOT NULL REFERENCES runs (id),
    task       TEXT    NOT NULL,
    level      INTEGER, -- none where the strategy has no levels, and before it has begun
    designer   TEXT    NOT NULL CHECK (designer IN ('llm', 'procedural')),
    asked_by   TEXT    NOT NULL CHECK (asked_by IN ('worker', 'hand')),
    state      TEXT    NOT NULL CHECK (state IN ('waiting', 'running', 'done', 'failed')),
    wanted     INTEGER NOT NULL,
    admitted   INTEGER NOT NULL DEFAULT 0,
    own        INTEGER NOT NULL DEFAULT 0, -- of these, by the designer that was asked and not by one that stood in
    refused    INTEGER NOT NULL DEFAULT 0, -- all of them; at most 64 are kept as layouts
    model      TEXT,
    prompt     TEXT, -- the version of it
    rounds     INTEGER NOT NULL DEFAULT 0,
    tokens_in  INTEGER NOT NULL DEFAULT 0,
    tokens_out INTEGER NOT NULL DEFAULT 0,
    cost       REAL    NOT NULL DEFAULT 0,
    latency_ms INTEGER NOT NULL DEFAULT 0,
    profile    TEXT, -- the failure profile as it stood; none before it has begun
    criticised INTEGER, -- episodes that the profile rests on
    troubles   TEXT    NOT NULL DEFAULT '[]',
    error      TEXT,
    created_at INTEGER NOT NULL,
    ended_at   INTEGER
) STRICT;

CREATE INDEX asks_of_run ON design_asks (run, id);
CREATE INDEX asks_of_task ON design_asks (run, task, id);
CREATE INDEX asks_waiting ON design_asks (run, id) WHERE state = 'waiting';
CREATE INDEX asks_running ON design_asks (run, id) WHERE state = 'running';

-- What designers thought of: layouts that serve or served, and what the gate refused.
CREATE TABLE layouts (
    id              INTEGER NOT NULL PRIMARY KEY AUTOINCREMENT,
    ask             INTEGER NOT NULL REFERENCES design_asks (id),
    run             TEXT    NOT NULL REFERENCES runs (id),
    task            TEXT    NOT NULL,
    level           INTEGER,
    designer        TEXT    NOT NULL, -- who thought of it: another one than was asked where that one failed
    name            TEXT    NOT NULL,
    design          TEXT, -- JSON, in the language of its world
    mode            TEXT, -- the failure mode it aims at
    bearing_deg     INTEGER, -- from where, in the frame
    frame           TEXT,
    round           INTEGER NOT NULL,
    state           TEXT    NOT NULL CHECK (state IN ('active', 'retired', 'refused')),
    why             TEXT CHECK (why IN ('mastered', 'hopeless', 'hand')), -- where retired
    gate_check      TEXT, -- where refused: which check
    reason          TEXT, -- where refused: the sentence
    claim           TEXT CHECK (claim IN ('threat', 'decoy')),
    novelty         REAL,
    scenario        BLOB REFERENCES scenarios (id),
    train_groups_at INTEGER NOT NULL, -- training groups the run had leased when it was made
    groups          INTEGER NOT NULL DEFAULT 0, -- leased
    outcomes        INTEGER NOT NULL DEFAULT 0, -- groups that came back
    episodes        INTEGER NOT NULL DEFAULT 0, -- finished
    successes       INTEGER NOT NULL DEFAULT 0,
    score           REAL    NOT NULL DEFAULT 0, -- sums over finished episodes
    regret          REAL    NOT NULL DEFAULT 0,
    recent          TEXT    NOT NULL DEFAULT '[]', -- the last outcomes: shares of success, oldest first
    barren          INTEGER NOT NULL DEFAULT 0, -- outcomes in a row without any success
    served_at       INTEGER, -- last
    created_at      INTEGER NOT NULL,
    retired_at      INTEGER
) STRICT;

CREATE INDEX layouts_of_run ON layouts (run, id);
CREATE INDEX layouts_of_task ON layouts (run, task, id);
CREATE INDEX layouts_active ON layouts (run, id) WHERE state = 'active';
CREATE INDEX layouts_retired ON layouts (run, task, level, id) WHERE state = 'retired';
CREATE INDEX layouts_probed ON layouts (run, task, level, id) WHERE state = 'retired' AND why IN ('mastered', 'hopeless');
CREATE INDEX layouts_admitted ON layouts (id) WHERE state != 'refused';

-- Every change of a layout's state, with its reason.
CREATE TABLE layout_turns (
    layout INTEGER NOT NULL REFERENCES layouts (id),
    nth    INTEGER NOT NULL,
    state  TEXT    NOT NULL,
    reason TEXT    NOT NULL,
    at     INTEGER NOT NULL,
    PRIMARY KEY (layout, nth)
) STRICT, WITHOUT ROWID;

-- What the gate said, exactly, those included that are not kept: by check, `admitted` among them.
CREATE TABLE gate_counts (
    run    TEXT    NOT NULL REFERENCES runs (id),
    task   TEXT    NOT NULL,
    verdict TEXT    NOT NULL,
    count  INTEGER NOT NULL,
    PRIMARY KEY (run, task, verdict)
) STRICT, WITHOUT ROWID;

-- Plain sums over the episodes of designed groups; task_sums has those of all others.
CREATE TABLE design_sums (
    run       TEXT    NOT NULL REFERENCES runs (id),
    task      TEXT    NOT NULL,
    episodes  INTEGER NOT NULL,
    successes INTEGER NOT NULL,
    failed    INTEGER NOT NULL,
    expired   INTEGER NOT NULL,
    score     REAL    NOT NULL,
    skilled   INTEGER NOT NULL,
    skill     REAL    NOT NULL,
    PRIMARY KEY (run, task)
) STRICT, WITHOUT ROWID;

-- The layout of a designed group; it has no proposal.
ALTER TABLE groups ADD COLUMN layout INTEGER REFERENCES layouts (id);

CREATE INDEX groups_of_layout ON groups (layout, lease, number) WHERE layout IS NOT NULL;

-- Groups leased for training, and how many of them were designed.
ALTER TABLE runs ADD COLUMN train_groups INTEGER NOT NULL DEFAULT 0;
ALTER TABLE runs ADD COLUMN designed_groups INTEGER NOT NULL DEFAULT 0;

UPDATE runs SET train_groups = (
    SELECT count(*) FROM leases l JOIN groups g ON g.lease = l.id WHERE l.run = runs.id AND l.purpose = 'train'
);
