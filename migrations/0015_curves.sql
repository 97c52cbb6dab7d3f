-- Results of a task in consecutive episodes, at any speed of the training: few buckets for a whole run, of about equal numbers of
-- episodes. If a task has 1 024 buckets, neighbours are joined in pairs.
CREATE TABLE task_curves (
    run           TEXT    NOT NULL REFERENCES runs (id),
    task          TEXT    NOT NULL,
    ordinal       INTEGER NOT NULL, -- from 0, in order of time
    width         INTEGER NOT NULL, -- episodes after which the next bucket begins
    first_episode INTEGER NOT NULL, -- number of the task's episodes before the bucket
    episodes      INTEGER NOT NULL, -- in the bucket: finished, or of accepted claims
    first_step    INTEGER NOT NULL, -- number of the environment steps of the task's finished episodes before the bucket
    first_at      INTEGER NOT NULL, -- time of its first results
    last_at       INTEGER NOT NULL, -- time of its latest results
    results       TEXT    NOT NULL, -- JSON, the sums of a bucket of task_history
    PRIMARY KEY (run, task, ordinal)
) STRICT, WITHOUT ROWID;
