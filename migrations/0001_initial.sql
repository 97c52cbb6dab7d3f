-- Schema of a Sparring database.
--
-- Conventions:
-- * Times (`at`, `…_at`) are milliseconds since 1970-01-01 UTC. Durations end in `_ms`.
-- * Flags (`is_…`, `success`, `avoidable`) are 0 or 1. Columns `body` hold JSON text or an encoded blob.
-- * A column that has the name of a table in the singular (`run`, `lease`, `scenario`, …) holds the key of a row of that table.
-- * `task` is the id `world/task`. `level` is the level of the task, from 0; strategies without levels store NULL, and counters,
--   which have the level in their key, store -1.
-- * `number` of a group is its index in the lease, from 0. `number` of an episode is its index in the lease, from 0: group g has
--   the episodes g · group_size to (g + 1) · group_size − 1.
-- * Of the server, only the writer writes. A comment that names a worker says which part of the server requests the change.
--
-- A change of this schema is a new file. The server copies an older database before it changes it.


-- Runs and curricula --------------------------------------------------------------------------------------------------------

-- A training run. Written by the run API; the counters of groups by each granted lease.
CREATE TABLE runs (
    id                 TEXT    NOT NULL PRIMARY KEY,
    name               TEXT    NOT NULL,               -- display name
    seed               INTEGER NOT NULL,               -- seed of the run's random streams
    status             TEXT    NOT NULL CHECK (status IN ('active', 'paused')),
    settings           TEXT    NOT NULL,               -- current settings, JSON
    policy_version     INTEGER NOT NULL DEFAULT 0,     -- newest version that a trainer reported
    created_at         INTEGER NOT NULL,
    training_groups    INTEGER NOT NULL DEFAULT 0,     -- groups that were leased for training
    designed_groups    INTEGER NOT NULL DEFAULT 0,     -- those of them that are on designed layouts
    owner              INTEGER REFERENCES tokens (id), -- token that created the run; NULL without authentication
    initial_curriculum TEXT,                           -- curriculum settings at the start, JSON; NULL until the first change
    archived_at        INTEGER                         -- archived runs are left out of lists
) STRICT;

CREATE INDEX runs_of_owner ON runs (owner) WHERE owner IS NOT NULL;

-- Settings of a run that were in force from a time on. Written when a run is created and when its settings change.
CREATE TABLE run_settings (
    run      TEXT    NOT NULL REFERENCES runs (id),
    revision INTEGER NOT NULL, -- from 0
    at       INTEGER NOT NULL,
    settings TEXT    NOT NULL, -- JSON
    PRIMARY KEY (run, revision)
) STRICT, WITHOUT ROWID;

-- An event of a run's curriculum. The curriculum is the fold of these events in the order of `seq`. Retention deletes events that
-- both snapshots cover.
CREATE TABLE curriculum_events (
    run  TEXT    NOT NULL REFERENCES runs (id),
    seq  INTEGER NOT NULL,
    body TEXT    NOT NULL, -- JSON
    at   INTEGER NOT NULL,
    PRIMARY KEY (run, seq)
) STRICT, WITHOUT ROWID;

-- State of a run's curriculum before the event `seq`. The two newest snapshots of a run are kept.
CREATE TABLE curriculum_snapshots (
    run  TEXT    NOT NULL REFERENCES runs (id),
    seq  INTEGER NOT NULL,
    body TEXT    NOT NULL, -- JSON
    PRIMARY KEY (run, seq)
) STRICT, WITHOUT ROWID;

-- A change of a task's level, with its evidence. Written with the outcome that caused it.
CREATE TABLE level_moves (
    run        TEXT    NOT NULL REFERENCES runs (id),
    seq        INTEGER NOT NULL, -- seq of the outcome
    task       TEXT    NOT NULL,
    kind       TEXT    NOT NULL, -- 'placement', 'up' or 'down'
    from_level INTEGER,          -- NULL for a placement
    to_level   INTEGER NOT NULL,
    evidence   TEXT    NOT NULL, -- JSON
    at         INTEGER NOT NULL,
    PRIMARY KEY (run, seq, task)
) STRICT, WITHOUT ROWID;

CREATE INDEX level_moves_of_task ON level_moves (run, task, seq);

-- A proposal of a run's curriculum: the durable queue of what is leased next. Written by the curriculum, the prepare worker (its
-- scenario) and granted leases.
CREATE TABLE proposals (
    run          TEXT    NOT NULL REFERENCES runs (id),
    seq          INTEGER NOT NULL,           -- seq of the event that proposed it
    state        TEXT    NOT NULL CHECK (state IN ('proposed', 'prepared', 'leased', 'dropped')),
    body         TEXT    NOT NULL,           -- JSON
    scenario     BLOB REFERENCES scenarios (id), -- NULL until it is prepared
    is_contested INTEGER,                    -- as measured, not as requested
    is_planted   INTEGER,                    -- a threat was placed to make the scenario contested
    attempts     INTEGER NOT NULL DEFAULT 0, -- number of times it was leased
    PRIMARY KEY (run, seq)
) STRICT, WITHOUT ROWID;

CREATE INDEX proposals_waiting ON proposals (run, seq) WHERE state IN ('proposed', 'prepared');
CREATE INDEX proposals_unprepared ON proposals (run, seq) WHERE state = 'proposed';
-- Covers all rows: a partial index does not serve the foreign key check when a scenario is deleted.
CREATE INDEX proposals_of_scenario ON proposals (scenario);


-- Tasks: recipes, scenarios and brackets ------------------------------------------------------------------------------------

-- A recipe: task, params, physics options and layout. Shared by all runs.
CREATE TABLE recipes (
    id   BLOB NOT NULL PRIMARY KEY, -- content hash
    body TEXT NOT NULL              -- canonical JSON
) STRICT, WITHOUT ROWID;

-- A scenario: a recipe with a seed. Shared by all runs; retention deletes those that nothing refers to.
CREATE TABLE scenarios (
    id     BLOB    NOT NULL PRIMARY KEY, -- content hash
    recipe BLOB    NOT NULL REFERENCES recipes (id),
    seed   INTEGER NOT NULL
) STRICT, WITHOUT ROWID;

CREATE INDEX scenarios_of_recipe ON scenarios (recipe);

-- The bracket of a scenario by one version of the planner. Written by the prepare worker and the audit.
CREATE TABLE brackets (
    scenario        BLOB    NOT NULL REFERENCES scenarios (id),
    planner_version INTEGER NOT NULL,
    body            BLOB    NOT NULL, -- floor, blind panel and reference: JSON, packed
    reference_plan  BLOB    NOT NULL, -- action log, packed
    PRIMARY KEY (scenario, planner_version)
) STRICT, WITHOUT ROWID;


-- Leases, groups and episodes -----------------------------------------------------------------------------------------------

-- A lease. Ids ascend and are never reused: there is one writer, and the newest lease is never deleted. A compacted lease stays
-- while a group or an episode of it stays, or a warning names it.
CREATE TABLE leases (
    id                INTEGER NOT NULL PRIMARY KEY,
    id_suffix         TEXT    NOT NULL,           -- random part of the public lease id
    run               TEXT    NOT NULL REFERENCES runs (id),
    purpose           TEXT    NOT NULL CHECK (purpose IN ('train', 'probe', 'eval')),
    form              TEXT    NOT NULL DEFAULT 'groups' CHECK (form IN ('groups', 'columns')),
    status            TEXT    NOT NULL CHECK (status IN ('active', 'done', 'released', 'expired')),
    groups            INTEGER NOT NULL,           -- number of groups
    group_size        INTEGER NOT NULL,           -- episodes of each group
    policy_version    INTEGER NOT NULL,           -- version that the lease was taken for
    ttl_ms            INTEGER NOT NULL,           -- lifetime after granting or renewal
    created_at        INTEGER NOT NULL,
    expires_at        INTEGER NOT NULL,
    is_compacted      INTEGER NOT NULL DEFAULT 0, -- results are in compacted_leases; set by retention
    owner             INTEGER,                    -- token that took the lease; NULL without authentication
    remaining_refills INTEGER NOT NULL DEFAULT 0, -- zero-variance groups that may still be replaced
    pending_refills   INTEGER NOT NULL DEFAULT 0  -- replacement groups that the lease is to be given
) STRICT;

CREATE INDEX leases_to_expire ON leases (expires_at) WHERE status = 'active';
CREATE INDEX leases_of_run ON leases (run, id);
CREATE INDEX leases_active ON leases (run) WHERE status = 'active';
CREATE INDEX leases_to_compact ON leases (run, form, id, groups, group_size)
WHERE is_compacted = 0 AND status <> 'active' AND purpose <> 'eval';
CREATE INDEX leases_compacted ON leases (run, id) WHERE is_compacted = 1;
CREATE INDEX leases_of_owner ON leases (owner) WHERE status = 'active' AND owner IS NOT NULL;
CREATE INDEX leases_pending_refills ON leases (run) WHERE pending_refills > 0;

-- A group of a lease: episodes of one scenario. Of a lease of columns, only audited groups have a row.
CREATE TABLE groups (
    lease           INTEGER NOT NULL REFERENCES leases (id),
    number          INTEGER NOT NULL,
    proposal        INTEGER,                    -- seq in the lease's run; NULL for evaluations and designed layouts
    layout          INTEGER REFERENCES layouts (id),
    scenario        BLOB    NOT NULL REFERENCES scenarios (id),
    task            TEXT    NOT NULL,
    level           INTEGER,
    role            TEXT    NOT NULL,           -- role of the proposal, 'designed' or 'suite'
    is_contested    INTEGER NOT NULL,
    state           TEXT    NOT NULL CHECK (state IN ('open', 'complete', 'partial', 'lost')),
    finished        INTEGER NOT NULL DEFAULT 0, -- episodes
    failed          INTEGER NOT NULL DEFAULT 0, -- episodes
    successes       INTEGER NOT NULL DEFAULT 0, -- episodes
    is_evidence     INTEGER NOT NULL DEFAULT 0, -- its outcome may move the curriculum
    is_for_training INTEGER NOT NULL DEFAULT 1, -- 0 if the curriculum only measures with it
    closed_at       INTEGER,
    PRIMARY KEY (lease, number)
) STRICT, WITHOUT ROWID;

CREATE INDEX groups_of_layout ON groups (layout, lease, number) WHERE layout IS NOT NULL;
CREATE INDEX groups_of_scenario ON groups (scenario);

-- Groups of a lease of columns that share a recipe, with consecutive seeds. The totals are written with the claim.
CREATE TABLE seed_ranges (
    lease       INTEGER NOT NULL REFERENCES leases (id),
    number      INTEGER NOT NULL,           -- index of the range in the lease, from 0
    proposal    INTEGER NOT NULL,           -- seq in the lease's run
    recipe      BLOB    NOT NULL REFERENCES recipes (id),
    task        TEXT    NOT NULL,
    level       INTEGER,
    role        TEXT    NOT NULL,
    first_group INTEGER NOT NULL,           -- number of its first group
    groups      INTEGER NOT NULL,           -- number of groups
    first_seed  INTEGER NOT NULL,           -- seed of the first group; each following group has the next seed
    finished    INTEGER NOT NULL DEFAULT 0, -- claimed episodes
    failed      INTEGER NOT NULL DEFAULT 0, -- claimed episodes
    score_sum   REAL    NOT NULL DEFAULT 0, -- over the finished episodes
    PRIMARY KEY (lease, number)
) STRICT, WITHOUT ROWID;

CREATE INDEX seed_ranges_of_recipe ON seed_ranges (recipe);

-- A lease that a rollout worker of the server holds. It is released when the server starts again.
CREATE TABLE rollout_leases (
    lease INTEGER NOT NULL PRIMARY KEY REFERENCES leases (id)
) STRICT;


-- Results -------------------------------------------------------------------------------------------------------------------

-- A reported episode. Episodes without a row were not reported; their state follows from the lease. Written with each report.
CREATE TABLE episodes (
    lease           INTEGER NOT NULL REFERENCES leases (id),
    number          INTEGER NOT NULL,
    state           TEXT    NOT NULL CHECK (state IN ('finished', 'failed', 'late')),
    digest          BLOB    NOT NULL, -- of the report: tells a repeated report from a contradicting one
    score           REAL,             -- by replay
    success         INTEGER,          -- by the run's rule
    skill           REAL,             -- NULL if the scenario defines none
    floor           REAL,             -- of the bracket
    reference       REAL,             -- of the bracket
    planner_version INTEGER,          -- of the bracket
    outcome         TEXT,             -- score, total_reward, steps, lost, goal and fuel_used, JSON; NULL if it was not rolled out
    policy_version  INTEGER NOT NULL,
    reason          TEXT,             -- of a failure
    metrics         TEXT,             -- that the trainer sent, JSON
    at              INTEGER NOT NULL,
    PRIMARY KEY (lease, number)
) STRICT, WITHOUT ROWID;

-- Actions of a reported episode. The key is a number of its own: in a tree by (lease, number), each long log would need a page
-- besides.
CREATE TABLE action_logs (
    id     INTEGER NOT NULL PRIMARY KEY,
    lease  INTEGER NOT NULL,
    number INTEGER NOT NULL,
    body   BLOB    NOT NULL, -- action log, packed; its first byte is the codec
    UNIQUE (lease, number)
) STRICT;

-- The columns that a trainer reported for a lease of columns.
CREATE TABLE column_claims (
    lease          INTEGER NOT NULL PRIMARY KEY REFERENCES leases (id),
    state          TEXT    NOT NULL CHECK (state IN ('claimed', 'accepted', 'refused', 'unproven')),
    digest         BLOB    NOT NULL, -- of the report: tells a repeated report from a contradicting one
    policy_version INTEGER NOT NULL,
    episodes       INTEGER NOT NULL, -- claimed
    failed         INTEGER NOT NULL, -- those of them that the infrastructure lost
    refusal_reason TEXT,             -- a sentence
    body           BLOB    NOT NULL, -- the columns; the first byte is the codec
    at             INTEGER NOT NULL
) STRICT;

-- The claimed score of an audited episode, which its replay must match.
CREATE TABLE audited_scores (
    lease  INTEGER NOT NULL REFERENCES leases (id),
    number INTEGER NOT NULL,
    score  REAL    NOT NULL,
    PRIMARY KEY (lease, number)
) STRICT, WITHOUT ROWID;

-- Counters of reported episodes of training and probe leases, by task and level. Designed groups have rows of their own.
CREATE TABLE task_counters (
    run                 TEXT    NOT NULL REFERENCES runs (id),
    task                TEXT    NOT NULL,
    level               INTEGER NOT NULL,
    is_designed         INTEGER NOT NULL CHECK (is_designed IN (0, 1)),
    episodes            INTEGER NOT NULL, -- finished
    successes           INTEGER NOT NULL,
    failed              INTEGER NOT NULL,
    expired             INTEGER NOT NULL, -- not reported before the lease ended
    score_sum           REAL    NOT NULL,
    episodes_with_skill INTEGER NOT NULL,
    skill_sum           REAL    NOT NULL,
    PRIMARY KEY (run, task, level, is_designed)
) STRICT, WITHOUT ROWID;

-- Counters of episodes that were claimed in columns, by task and level.
CREATE TABLE claim_counters (
    run       TEXT    NOT NULL REFERENCES runs (id),
    task      TEXT    NOT NULL,
    level     INTEGER NOT NULL,
    episodes  INTEGER NOT NULL,           -- finished, of accepted claims
    score_sum REAL    NOT NULL,           -- over these
    failed    INTEGER NOT NULL,           -- of accepted claims
    refused   INTEGER NOT NULL,           -- of refused claims
    unproven  INTEGER NOT NULL,           -- of claims whose audited logs did not arrive
    expired   INTEGER NOT NULL,           -- not claimed before the lease ended
    audited   INTEGER NOT NULL DEFAULT 0, -- those of `episodes` that were audited; task_counters has them, too
    PRIMARY KEY (run, task, level)
) STRICT, WITHOUT ROWID;

-- Counters of closed groups of several episodes, by task and level.
CREATE TABLE group_counters (
    run           TEXT    NOT NULL REFERENCES runs (id),
    task          TEXT    NOT NULL,
    level         INTEGER NOT NULL,
    complete      INTEGER NOT NULL DEFAULT 0, -- all episodes finished
    partial       INTEGER NOT NULL DEFAULT 0, -- enough episodes finished, but not all
    lost          INTEGER NOT NULL DEFAULT 0, -- too few episodes finished
    zero_variance INTEGER NOT NULL DEFAULT 0, -- complete and partial groups whose episodes all have the same score
    PRIMARY KEY (run, task, level)
) STRICT, WITHOUT ROWID;

-- Description of a version of a run's policy. Written when a trainer reports a version.
CREATE TABLE policy_versions (
    run        TEXT    NOT NULL REFERENCES runs (id),
    version    INTEGER NOT NULL,
    checkpoint TEXT, -- where the trainer stores the weights
    notes      TEXT,
    at         INTEGER NOT NULL,
    PRIMARY KEY (run, version)
) STRICT, WITHOUT ROWID;

-- Counters of the episodes of task_counters, by policy version and task.
CREATE TABLE policy_version_counters (
    run       TEXT    NOT NULL REFERENCES runs (id),
    version   INTEGER NOT NULL,
    task      TEXT    NOT NULL,
    episodes  INTEGER NOT NULL, -- finished
    successes INTEGER NOT NULL,
    score_sum REAL    NOT NULL,
    first_at  INTEGER NOT NULL,
    last_at   INTEGER NOT NULL,
    PRIMARY KEY (run, version, task)
) STRICT, WITHOUT ROWID;

-- Results of a task in a bucket of time: a minute (kept for a week) or an hour (kept for ever).
CREATE TABLE task_history (
    run                    TEXT    NOT NULL REFERENCES runs (id),
    task                   TEXT    NOT NULL,
    width                  INTEGER NOT NULL, -- ms: 60 000 or 3 600 000
    start                  INTEGER NOT NULL, -- a multiple of the width
    episodes               INTEGER NOT NULL, -- finished
    successes              INTEGER NOT NULL,
    score_sum              REAL    NOT NULL,
    episodes_with_skill    INTEGER NOT NULL,
    skill_sum              REAL    NOT NULL,
    failed                 INTEGER NOT NULL,
    expired                INTEGER NOT NULL,
    contested_groups       INTEGER NOT NULL, -- that are evidence
    success_rate_sum       REAL    NOT NULL, -- over these groups
    panel_groups           INTEGER NOT NULL, -- contested groups whose blind panel was replayed: a sample
    panel_success_rate_sum REAL    NOT NULL, -- of the blind plans, over these groups
    groups                 INTEGER NOT NULL, -- of several episodes, that counted
    zero_variance_groups   INTEGER NOT NULL, -- those of them whose episodes all have the same score
    claimed_episodes       INTEGER NOT NULL, -- of accepted claims
    lowest_level           INTEGER,
    highest_level          INTEGER,
    level                  INTEGER,          -- level of the latest mastery estimate
    mean                   REAL,             -- of its posterior over success; NULL without an estimate
    q10                    REAL,             -- 10 % quantile of the posterior
    q90                    REAL,             -- 90 % quantile of the posterior
    PRIMARY KEY (run, task, width, start)
) STRICT, WITHOUT ROWID;

-- Values of a param in the scenarios of a bucket of task_history.
CREATE TABLE task_history_params (
    run   TEXT    NOT NULL REFERENCES runs (id),
    task  TEXT    NOT NULL,
    width INTEGER NOT NULL, -- ms
    start INTEGER NOT NULL,
    param TEXT    NOT NULL,
    n     INTEGER NOT NULL, -- number of values
    total REAL    NOT NULL, -- sum of the values
    low   REAL    NOT NULL, -- lowest value
    high  REAL    NOT NULL, -- highest value
    PRIMARY KEY (run, task, width, start, param)
) STRICT, WITHOUT ROWID;

-- A warning that a user should see before trusting a run. Written by the audit of columns.
CREATE TABLE run_warnings (
    id      INTEGER NOT NULL PRIMARY KEY AUTOINCREMENT,
    run     TEXT    NOT NULL REFERENCES runs (id),
    kind    TEXT    NOT NULL, -- 'refused_claim' or 'unproven_claim'
    lease   INTEGER REFERENCES leases (id),
    message TEXT    NOT NULL, -- a sentence
    at      INTEGER NOT NULL
) STRICT;

CREATE INDEX run_warnings_of_run ON run_warnings (run, id);
CREATE INDEX run_warnings_of_lease ON run_warnings (lease);

-- An event of a run, as the event stream sends it. Each run keeps its newest events.
CREATE TABLE run_events (
    id   INTEGER NOT NULL PRIMARY KEY AUTOINCREMENT, -- never reused: clients resume after an id
    run  TEXT    NOT NULL REFERENCES runs (id),
    kind TEXT    NOT NULL,
    body TEXT    NOT NULL, -- JSON
    at   INTEGER NOT NULL
) STRICT;

CREATE INDEX run_events_of_run ON run_events (run, id);

-- The newest event of a run that was deleted. A run without a row has all of its events.
CREATE TABLE deleted_run_events (
    run     TEXT    NOT NULL PRIMARY KEY REFERENCES runs (id),
    last_id INTEGER NOT NULL
) STRICT, WITHOUT ROWID;

-- The policy that the server's rollout workers use for a run, and the totals of its rollouts. A run without a row has none.
CREATE TABLE run_policies (
    run        TEXT    NOT NULL PRIMARY KEY REFERENCES runs (id),
    policy     TEXT    NOT NULL,           -- 'off', 'chat', or the name of a built-in policy
    version    INTEGER NOT NULL,
    settings   TEXT    NOT NULL,           -- JSON
    groups     INTEGER NOT NULL DEFAULT 0, -- pushed to the feed
    episodes   INTEGER NOT NULL DEFAULT 0, -- in these groups
    failed     INTEGER NOT NULL DEFAULT 0, -- episodes that the infrastructure lost
    error      TEXT,                       -- the latest one, a sentence
    error_at   INTEGER,
    changed_at INTEGER NOT NULL
) STRICT;

-- Tokens and cost of the language model that a run's rollouts used on a day. Written by the rollout workers.
CREATE TABLE rollout_spend (
    run        TEXT    NOT NULL REFERENCES runs (id),
    day        INTEGER NOT NULL, -- days since 1970-01-01 UTC
    tokens_in  INTEGER NOT NULL,
    tokens_out INTEGER NOT NULL,
    cost       REAL    NOT NULL, -- in the currency of the configured prices
    PRIMARY KEY (run, day)
) STRICT, WITHOUT ROWID;

-- A finished group in the trajectory feed of its run. Written by the rollout workers; it stays for a while after the
-- acknowledgement.
CREATE TABLE trajectory_groups (
    id             INTEGER NOT NULL PRIMARY KEY AUTOINCREMENT, -- never reused
    run            TEXT    NOT NULL REFERENCES runs (id),
    lease          INTEGER NOT NULL REFERENCES leases (id),
    number         INTEGER NOT NULL,           -- of the group
    policy_version INTEGER NOT NULL,
    state          TEXT    NOT NULL CHECK (state IN ('ready', 'delivered', 'acknowledged')),
    visible_at     INTEGER NOT NULL,           -- it is delivered (again) from this time on
    deliveries     INTEGER NOT NULL DEFAULT 0, -- number of times it was delivered
    bytes          INTEGER NOT NULL,           -- size of the body as JSON
    body           BLOB    NOT NULL,           -- JSON, compressed (zstd)
    at             INTEGER NOT NULL,
    UNIQUE (lease, number)
) STRICT;

CREATE INDEX trajectory_groups_of_run ON trajectory_groups (run, id);
CREATE INDEX trajectory_groups_waiting ON trajectory_groups (run, id) WHERE state <> 'acknowledged';

-- A judgement of one step by a language model, next to the judgement by the world's rules. Written by sessions with a model judge.
CREATE TABLE step_verdicts (
    id             INTEGER PRIMARY KEY,
    at             INTEGER NOT NULL,
    run            TEXT REFERENCES runs (id), -- NULL if the session belongs to no run
    episode        TEXT    NOT NULL,          -- the client's name of the episode
    scenario       BLOB    NOT NULL,          -- no reference: sessions without a run store no scenario
    task           TEXT    NOT NULL,
    step           INTEGER NOT NULL,          -- from 1
    model          TEXT    NOT NULL,
    prompt_version TEXT    NOT NULL,
    score          REAL CHECK (score BETWEEN -1 AND 1),
    reasoning      TEXT,
    error          TEXT,                      -- why there is no score
    rule_score     REAL CHECK (rule_score BETWEEN -1 AND 1),
    rule_case      TEXT,                      -- case of the rules that applied
    is_cached      INTEGER NOT NULL CHECK (is_cached IN (0, 1)), -- the same question was asked before
    tokens_in      INTEGER NOT NULL,
    tokens_out     INTEGER NOT NULL,
    cost           REAL    NOT NULL,          -- in the currency of the configured prices
    latency_ms     INTEGER NOT NULL,
    CHECK ((score IS NULL) = (error IS NOT NULL)),
    CHECK ((score IS NULL) = (reasoning IS NULL))
) STRICT;

CREATE INDEX step_verdicts_of_run ON step_verdicts (run, id);


-- Critiques and failure profiles --------------------------------------------------------------------------------------------

-- A critique job: episodes of one lease and task. Written with the report; the critique worker deletes it in the transaction that
-- stores the result, so that each episode is counted once.
CREATE TABLE critique_queue (
    id       INTEGER NOT NULL PRIMARY KEY AUTOINCREMENT, -- never reused
    run      TEXT    NOT NULL REFERENCES runs (id),
    task     TEXT    NOT NULL,
    lease    INTEGER NOT NULL REFERENCES leases (id),
    numbers  TEXT    NOT NULL, -- numbers of the episodes, JSON list
    episodes INTEGER NOT NULL  -- length of that list
) STRICT;

CREATE INDEX critique_queue_of_lease ON critique_queue (lease);

-- Counters of a task's critiques. Columns `…_recent` halve with every half-life, counted in criticised episodes. Written by the
-- critique worker, as all tables of this section.
CREATE TABLE critique_counters (
    run              TEXT    NOT NULL REFERENCES runs (id),
    task             TEXT    NOT NULL,
    criticised       INTEGER NOT NULL, -- episodes
    skipped          INTEGER NOT NULL, -- episodes that sampling left out because the queue was long
    failed           INTEGER NOT NULL, -- episodes that could not be criticised; the log has the error
    judgement        REAL    NOT NULL, -- sum of the rules' judgements of the episodes
    judgement_recent REAL    NOT NULL,
    needed           INTEGER NOT NULL, -- actions with this verdict
    needed_recent    REAL    NOT NULL,
    harmless         INTEGER NOT NULL,
    harmless_recent  REAL    NOT NULL,
    wasteful         INTEGER NOT NULL,
    wasteful_recent  REAL    NOT NULL,
    harmful          INTEGER NOT NULL,
    harmful_recent   REAL    NOT NULL,
    PRIMARY KEY (run, task)
) STRICT, WITHOUT ROWID;

-- A cell of a failure profile: failures of one mode, bearing sector and speed band.
CREATE TABLE failure_cells (
    id          INTEGER NOT NULL PRIMARY KEY,
    run         TEXT    NOT NULL REFERENCES runs (id),
    task        TEXT    NOT NULL,
    mode        TEXT    NOT NULL,
    sector      INTEGER NOT NULL, -- bearing sector; -1 for a failure without an encounter
    band        INTEGER NOT NULL, -- speed band; -1 for a failure without an encounter
    count       INTEGER NOT NULL, -- failures
    avoidable   INTEGER NOT NULL, -- failures that could have been avoided
    unavoidable INTEGER NOT NULL, -- failures that were visible and could not be avoided
    steps_left  INTEGER NOT NULL, -- sum of the steps that were left to act
    weight      REAL    NOT NULL, -- the count, halving with every half-life, at the moment `as_of`
    as_of       INTEGER NOT NULL, -- ordinal of the last failure's episode among the task's criticised episodes
    last_at     INTEGER NOT NULL,
    UNIQUE (run, task, mode, sector, band)
) STRICT;

-- One of the newest failures of a cell. The rows of a cell are a ring: slot = ordinal mod 64.
CREATE TABLE failure_examples (
    cell            INTEGER NOT NULL REFERENCES failure_cells (id),
    slot            INTEGER NOT NULL,
    ordinal         INTEGER NOT NULL, -- of the failure in its cell, from 1
    episode_ordinal INTEGER NOT NULL, -- of the episode among the task's criticised episodes, from 1
    lease           INTEGER NOT NULL REFERENCES leases (id),
    number          INTEGER NOT NULL, -- of the episode
    agent           INTEGER NOT NULL,
    step            INTEGER NOT NULL, -- from 1
    bearing_deg     REAL,
    relative_speed  REAL,             -- in the world's unit
    steps_left      INTEGER,          -- steps that were left to act
    avoidable       INTEGER,
    PRIMARY KEY (cell, slot)
) STRICT, WITHOUT ROWID;

CREATE INDEX failure_examples_of_episode ON failure_examples (lease, number);

-- Failures of one mode and bearing sector in the inertial frame: an agent that is blind to one side of the sky fails all around
-- its orbit.
CREATE TABLE failure_inertial_sectors (
    run    TEXT    NOT NULL REFERENCES runs (id),
    task   TEXT    NOT NULL,
    mode   TEXT    NOT NULL,
    sector INTEGER NOT NULL,
    count  INTEGER NOT NULL, -- failures
    weight REAL    NOT NULL, -- as in failure_cells
    as_of  INTEGER NOT NULL, -- as in failure_cells
    PRIMARY KEY (run, task, mode, sector)
) STRICT, WITHOUT ROWID;


-- Designs -------------------------------------------------------------------------------------------------------------------

-- A request to a designer, and its result. Written by the design worker and the design API.
CREATE TABLE design_requests (
    id                        INTEGER NOT NULL PRIMARY KEY AUTOINCREMENT, -- never reused: seeds are derived from it
    run                       TEXT    NOT NULL REFERENCES runs (id),
    task                      TEXT    NOT NULL,
    level                     INTEGER,                       -- NULL before the request starts
    designer                  TEXT    NOT NULL CHECK (designer IN ('llm', 'procedural')),
    requested_by              TEXT    NOT NULL CHECK (requested_by IN ('worker', 'user')),
    state                     TEXT    NOT NULL CHECK (state IN ('waiting', 'running', 'done', 'failed')),
    wanted                    INTEGER NOT NULL,              -- layouts to design
    admitted                  INTEGER NOT NULL DEFAULT 0,    -- layouts that the gate admitted
    admitted_without_fallback INTEGER NOT NULL DEFAULT 0,    -- those of them that the requested designer made
    refused                   INTEGER NOT NULL DEFAULT 0,    -- layouts that the gate refused; at most 64 are stored
    model                     TEXT,
    prompt_version            TEXT,
    rounds                    INTEGER NOT NULL DEFAULT 0,    -- of all designers together
    tokens_in                 INTEGER NOT NULL DEFAULT 0,
    tokens_out                INTEGER NOT NULL DEFAULT 0,
    cost                      REAL    NOT NULL DEFAULT 0,    -- in the currency of the configured prices
    latency_ms                INTEGER NOT NULL DEFAULT 0,
    profile                   TEXT,                          -- failure profile at the start, JSON; NULL before
    criticised                INTEGER,                       -- criticised episodes behind the profile
    warnings                  TEXT    NOT NULL DEFAULT '[]', -- errors that did not end the request, JSON list of sentences
    error                     TEXT,                          -- why the request failed
    created_at                INTEGER NOT NULL,
    ended_at                  INTEGER
) STRICT;

CREATE INDEX design_requests_of_run ON design_requests (run, id);
CREATE INDEX design_requests_of_task ON design_requests (run, task, id);
CREATE INDEX design_requests_waiting ON design_requests (run, id) WHERE state = 'waiting';
CREATE INDEX design_requests_running ON design_requests (run, id) WHERE state = 'running';

-- A designed layout, admitted or refused, with the sums of its outcomes. Written by the design worker, granted leases, closed
-- groups and the critique worker.
CREATE TABLE layouts (
    id                          INTEGER NOT NULL PRIMARY KEY AUTOINCREMENT,
    request                     INTEGER NOT NULL REFERENCES design_requests (id),
    run                         TEXT    NOT NULL REFERENCES runs (id),
    task                        TEXT    NOT NULL,
    level                       INTEGER,
    designer                    TEXT    NOT NULL,              -- that made it: possibly the fallback of the requested one
    name                        TEXT    NOT NULL,
    design                      TEXT,                          -- JSON, in the design language of the world
    mode                        TEXT,                          -- failure mode that it aims at
    bearing_deg                 INTEGER,                       -- bearing that it aims at, in `frame`
    frame                       TEXT,
    round                       INTEGER NOT NULL,              -- of the designer, from 1
    state                       TEXT    NOT NULL CHECK (state IN ('active', 'retired', 'refused')),
    retirement_reason           TEXT CHECK (retirement_reason IN ('mastered', 'hopeless', 'user')),
    gate_check                  TEXT,                          -- check of the gate that refused it
    refusal_reason              TEXT,                          -- a sentence
    kind                        TEXT CHECK (kind IN ('threat', 'decoy')),
    novelty                     REAL,                          -- distance to the nearest earlier design, 0 to 1
    scenario                    BLOB REFERENCES scenarios (id),
    training_groups_at_creation INTEGER NOT NULL,              -- runs.training_groups when it was created
    groups                      INTEGER NOT NULL DEFAULT 0,    -- leased
    outcomes                    INTEGER NOT NULL DEFAULT 0,    -- groups with an outcome
    episodes                    INTEGER NOT NULL DEFAULT 0,    -- finished
    successes                   INTEGER NOT NULL DEFAULT 0,
    score_sum                   REAL    NOT NULL DEFAULT 0,    -- over finished episodes
    regret_sum                  REAL    NOT NULL DEFAULT 0,    -- over finished episodes
    recent_success_rates        TEXT    NOT NULL DEFAULT '[]', -- of the last outcomes, oldest first, JSON list
    zero_success_streak         INTEGER NOT NULL DEFAULT 0,    -- consecutive outcomes without a success, up to the last one
    served_at                   INTEGER,                       -- when a group was leased last
    created_at                  INTEGER NOT NULL,
    retired_at                  INTEGER,
    failure_episodes            INTEGER NOT NULL DEFAULT 0,    -- criticised episodes with a failure
    aimed_failure_episodes      INTEGER NOT NULL DEFAULT 0     -- those of them with a failure of the aimed mode
) STRICT;

CREATE INDEX layouts_of_run ON layouts (run, id);
CREATE INDEX layouts_of_task ON layouts (run, task, id);
CREATE INDEX layouts_active ON layouts (run, id) WHERE state = 'active';
CREATE INDEX layouts_retired ON layouts (run, task, level, id) WHERE state = 'retired';
CREATE INDEX layouts_probed ON layouts (run, task, level, id)
WHERE state = 'retired' AND retirement_reason IN ('mastered', 'hopeless');
CREATE INDEX layouts_admitted ON layouts (id) WHERE state != 'refused';
-- Covers all rows: a partial index does not serve the foreign key check when a scenario is deleted.
CREATE INDEX layouts_of_scenario ON layouts (scenario);

-- A change of a layout's state.
CREATE TABLE layout_transitions (
    layout INTEGER NOT NULL REFERENCES layouts (id),
    seq    INTEGER NOT NULL, -- from 0
    state  TEXT    NOT NULL, -- after the change
    reason TEXT    NOT NULL, -- a sentence
    at     INTEGER NOT NULL,
    PRIMARY KEY (layout, seq)
) STRICT, WITHOUT ROWID;

-- Number of a task's designs with one verdict of the gate: 'admitted', or the check that refused them. Counts refused designs that
-- are not stored, too.
CREATE TABLE gate_counts (
    run     TEXT    NOT NULL REFERENCES runs (id),
    task    TEXT    NOT NULL,
    verdict TEXT    NOT NULL,
    count   INTEGER NOT NULL,
    PRIMARY KEY (run, task, verdict)
) STRICT, WITHOUT ROWID;


-- Evaluations ---------------------------------------------------------------------------------------------------------------

-- An evaluation of a policy on a frozen suite. Written by the evaluation API, the evaluation worker and reports of its leases.
CREATE TABLE evaluations (
    id             INTEGER NOT NULL PRIMARY KEY AUTOINCREMENT,
    name           TEXT    NOT NULL,           -- display name
    suite          TEXT    NOT NULL,
    suite_hash     TEXT    NOT NULL,
    tasks          TEXT,                       -- tasks of the suite that are evaluated, JSON list; NULL for all
    policy         TEXT    NOT NULL,           -- a built-in policy if there is no run, else a name that the trainer chose
    run            TEXT    REFERENCES runs (id), -- run whose trainer rolls out the episodes; NULL if the server does
    policy_version INTEGER,                    -- of the run's policy
    training       TEXT,                       -- common name of trainings that differ only in their seeds
    training_seed  INTEGER,
    rollouts       INTEGER NOT NULL,           -- episodes of each scenario
    is_stochastic  INTEGER NOT NULL,           -- episodes of one scenario differ by random draws
    seed           INTEGER NOT NULL,           -- of a built-in policy that draws random numbers
    state          TEXT    NOT NULL CHECK (state IN ('open', 'running', 'complete', 'failed')),
    error          TEXT,                       -- why it failed
    scenarios      INTEGER NOT NULL,           -- number of scenarios
    scenarios_done INTEGER NOT NULL DEFAULT 0, -- scenarios with results
    retries        INTEGER NOT NULL DEFAULT 0, -- number of times that a scenario was offered again because its group was lost
    created_at     INTEGER NOT NULL,
    completed_at   INTEGER
) STRICT;

CREATE INDEX evaluations_running ON evaluations (id) WHERE state = 'running';

-- A scenario of an evaluation, by its index in the suite.
CREATE TABLE evaluation_scenarios (
    evaluation INTEGER NOT NULL REFERENCES evaluations (id),
    entry      INTEGER NOT NULL, -- from 0
    lease      INTEGER,          -- lease of the group that rolls it out; NULL while it waits
    number     INTEGER,          -- of that group
    episodes   TEXT,             -- measures of each episode, JSON; NULL until all are reported
    PRIMARY KEY (evaluation, entry)
) STRICT, WITHOUT ROWID;

CREATE INDEX evaluation_scenarios_of_lease ON evaluation_scenarios (lease, number) WHERE lease IS NOT NULL;


-- Retention -----------------------------------------------------------------------------------------------------------------

-- Several compacted leases of a run. Written by the retention worker, as all tables of this section. A lease may be in several
-- rows, since some of its groups may be compacted later.
CREATE TABLE compacted_leases (
    id          INTEGER NOT NULL PRIMARY KEY,
    run         TEXT    NOT NULL REFERENCES runs (id),
    first_lease INTEGER NOT NULL, -- lowest id
    last_lease  INTEGER NOT NULL, -- highest id
    episodes    INTEGER NOT NULL, -- reported episodes in `body`
    at          INTEGER NOT NULL,
    lease_rows  BLOB    NOT NULL, -- rows of the leases, packed
    body        BLOB    NOT NULL  -- their groups, results and claims, packed
) STRICT;

CREATE INDEX compacted_leases_of_run ON compacted_leases (run, first_lease, last_lease);

-- Consecutive contested groups of a task that were evidence and are compacted. Neighbouring rows are joined while there are many.
CREATE TABLE compacted_progress (
    run              TEXT    NOT NULL REFERENCES runs (id),
    task             TEXT    NOT NULL,
    seq              INTEGER NOT NULL, -- from 0
    at               INTEGER NOT NULL, -- when the last group closed
    lowest_level     INTEGER,
    highest_level    INTEGER,
    groups           INTEGER NOT NULL,
    success_rate_sum REAL    NOT NULL, -- over these groups
    PRIMARY KEY (run, task, seq)
) STRICT, WITHOUT ROWID;


-- Access and maintenance ----------------------------------------------------------------------------------------------------

-- An access token. Written by `sparring token`.
CREATE TABLE tokens (
    id         INTEGER NOT NULL PRIMARY KEY AUTOINCREMENT, -- never reused: it is a part of the token
    name       TEXT    NOT NULL,
    role       TEXT    NOT NULL CHECK (role IN ('viewer', 'trainer', 'admin')),
    hash       BLOB    NOT NULL, -- of the token, which is not stored
    created_at INTEGER NOT NULL,
    expires_at INTEGER,          -- NULL for never
    revoked_at INTEGER,
    used_at    INTEGER           -- last use, accurate to ten minutes
) STRICT;

-- A request that changed something. The newest rows are kept. Written by the access control.
CREATE TABLE audit_log (
    id         INTEGER NOT NULL PRIMARY KEY AUTOINCREMENT,
    at         INTEGER NOT NULL,
    token      INTEGER REFERENCES tokens (id), -- NULL for anonymous requests
    address    TEXT,                           -- of the client
    operation  TEXT    NOT NULL,               -- operation id of the API
    path       TEXT    NOT NULL,
    status     INTEGER NOT NULL,               -- HTTP status
    request_id TEXT    NOT NULL
) STRICT;

-- A request that was denied. A table of its own, so that denied requests displace no row of audit_log.
CREATE TABLE denials (
    id         INTEGER NOT NULL PRIMARY KEY AUTOINCREMENT,
    at         INTEGER NOT NULL,
    token      INTEGER REFERENCES tokens (id), -- NULL for unknown tokens
    address    TEXT,
    operation  TEXT    NOT NULL,
    path       TEXT    NOT NULL,
    status     INTEGER NOT NULL,
    request_id TEXT    NOT NULL
) STRICT;

-- The row that is written to find out whether the database can be written.
CREATE TABLE write_probe (
    id      INTEGER NOT NULL PRIMARY KEY CHECK (id = 1),
    at      INTEGER NOT NULL,
    padding BLOB    NOT NULL DEFAULT x'' -- large after a failed change: a small row may fit where the change did not
) STRICT;
