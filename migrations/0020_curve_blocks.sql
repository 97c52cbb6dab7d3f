-- Earlier buckets of task_curves, 32 to a row and packed, so that a chart reads tens of pages of the database instead of two for each
-- bucket. Bucket 0 of block 0 is the first of the curve. Buckets of task_curves continue those of the last block.
CREATE TABLE task_curve_blocks (
    run      TEXT    NOT NULL REFERENCES runs (id),
    task     TEXT    NOT NULL,
    block    INTEGER NOT NULL, -- from 0, in order of time
    first_at INTEGER NOT NULL, -- time of its first results
    points   BLOB    NOT NULL, -- packed JSON, a list of buckets without ordinals and widths
    PRIMARY KEY (run, task, block)
) STRICT, WITHOUT ROWID;
