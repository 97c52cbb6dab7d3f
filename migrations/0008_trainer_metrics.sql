-- Numbers that trainers log about their training, such as a loss. Written by the run API.

-- A metric of a run, and how many points of it are stored. A metric with too many points is thinned.
CREATE TABLE trainer_metric_names (
    run    TEXT    NOT NULL REFERENCES runs (id),
    name   TEXT    NOT NULL,
    points INTEGER NOT NULL,
    PRIMARY KEY (run, name)
) STRICT, WITHOUT ROWID;

-- A point of a metric. A later report of the same step replaces it.
CREATE TABLE trainer_metrics (
    run   TEXT    NOT NULL REFERENCES runs (id),
    name  TEXT    NOT NULL,
    step  INTEGER NOT NULL,
    at    INTEGER NOT NULL, -- time of the report, Unix milliseconds
    value REAL,             -- NULL if the trainer had no finite number
    PRIMARY KEY (run, name, step)
) STRICT, WITHOUT ROWID;
