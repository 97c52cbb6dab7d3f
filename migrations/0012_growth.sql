-- Written along where the last change did not fit: that a small row does says little.
ALTER TABLE pulse ADD COLUMN room BLOB NOT NULL DEFAULT x'';

-- Folded leases by themselves, beside what their episodes came to: a list of leases reads no more than it shows. What was folded
-- before has all of it in its body.
CREATE TABLE folds_with_heads (
    id       INTEGER NOT NULL PRIMARY KEY,
    run      TEXT    NOT NULL REFERENCES runs (id),
    first    INTEGER NOT NULL, -- lowest number of its leases
    last     INTEGER NOT NULL, -- highest
    episodes INTEGER NOT NULL, -- reported ones in it
    at       INTEGER NOT NULL,
    heads    BLOB,             -- store/folds/form.rs
    body     BLOB    NOT NULL
) STRICT;

INSERT INTO folds_with_heads (id, run, first, last, episodes, at, body)
SELECT id, run, first, last, episodes, at, body FROM folds;

DROP TABLE folds;

ALTER TABLE folds_with_heads RENAME TO folds;

CREATE INDEX folds_of_run ON folds (run, first, last);

-- Whole, not of rows that have one alone: what a foreign key is checked by when a scenario goes cannot be in part.
DROP INDEX proposals_of_scenario;
CREATE INDEX proposals_of_scenario ON proposals (scenario);

DROP INDEX layouts_of_scenario;
CREATE INDEX layouts_of_scenario ON layouts (scenario);

-- What may rest on a proposal is the next move of its task.
CREATE INDEX moves_of_task ON level_moves (run, task, seq);

-- Who was kept out, in a ring of its own: whoever tries without end drives out no line of what was changed.
CREATE TABLE denials (
    id         INTEGER NOT NULL PRIMARY KEY AUTOINCREMENT,
    at         INTEGER NOT NULL,
    token      INTEGER REFERENCES tokens (id), -- none: not known
    address    TEXT,
    operation  TEXT    NOT NULL,
    path       TEXT    NOT NULL,
    status     INTEGER NOT NULL,
    request_id TEXT    NOT NULL
) STRICT;
