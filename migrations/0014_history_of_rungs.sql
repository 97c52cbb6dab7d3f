-- Results of a bucket of task_history by start rung and level: where the sampler of the task draws, and how often the agent succeeds
-- there. Written when a group of a proposal closes with enough finished episodes.
CREATE TABLE task_history_rungs (
    run        TEXT    NOT NULL REFERENCES runs (id),
    task       TEXT    NOT NULL,
    width      INTEGER NOT NULL, -- ms
    start      INTEGER NOT NULL,
    start_rung INTEGER NOT NULL, -- -1 without one
    level      INTEGER NOT NULL, -- -1 without one
    groups     INTEGER NOT NULL,
    episodes   INTEGER NOT NULL, -- finished episodes that count
    successes  INTEGER NOT NULL, -- those of them that succeeded
    PRIMARY KEY (run, task, width, start, start_rung, level)
) STRICT, WITHOUT ROWID;
