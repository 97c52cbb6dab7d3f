-- How designs do. Sums of designed groups stand beside those of all others: one table, told apart by a column.

CREATE TABLE all_sums (
    run       TEXT    NOT NULL REFERENCES runs (id),
    task      TEXT    NOT NULL,
    level     INTEGER NOT NULL, -- -1 where the strategy has no levels
    designed  INTEGER NOT NULL CHECK (designed IN (0, 1)),
    episodes  INTEGER NOT NULL,
    successes INTEGER NOT NULL,
    failed    INTEGER NOT NULL,
    expired   INTEGER NOT NULL,
    score     REAL    NOT NULL,
    skilled   INTEGER NOT NULL, -- episodes that have a skill
    skill     REAL    NOT NULL,
    PRIMARY KEY (run, task, level, designed)
) STRICT, WITHOUT ROWID;

INSERT INTO all_sums
SELECT run, task, level, 0, episodes, successes, failed, expired, score, skilled, skill FROM task_sums;

-- Until now these were not kept by level.
INSERT INTO all_sums
SELECT run, task, -1, 1, episodes, successes, failed, expired, score, skilled, skill FROM design_sums;

DROP TABLE task_sums;
DROP TABLE design_sums;
ALTER TABLE all_sums RENAME TO task_sums;

-- Whether what goes wrong on a layout is what it aims at, as the critique finds it.
ALTER TABLE layouts ADD COLUMN faults INTEGER NOT NULL DEFAULT 0; -- criticised episodes in which something went wrong
ALTER TABLE layouts ADD COLUMN as_aimed INTEGER NOT NULL DEFAULT 0; -- of these, by the mode it aims at
