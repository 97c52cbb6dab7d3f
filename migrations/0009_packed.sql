-- Action logs and brackets take less: packed where that is smaller (store/pack.rs; what is there already stays as it is), and logs by
-- a number of their own: in the tree of their key each that had more than a kilobyte took a page besides.
CREATE TABLE logs (
    id     INTEGER NOT NULL PRIMARY KEY,
    lease  INTEGER NOT NULL,
    number INTEGER NOT NULL,
    body   BLOB    NOT NULL, -- its first byte is the codec
    UNIQUE (lease, number)
) STRICT;

INSERT INTO logs (lease, number, body) SELECT lease, number, body FROM action_logs ORDER BY lease, number;
DROP TABLE action_logs;
ALTER TABLE logs RENAME TO action_logs;

CREATE TABLE packed_brackets (
    scenario BLOB    NOT NULL REFERENCES scenarios (id),
    planner  INTEGER NOT NULL,
    body     BLOB    NOT NULL, -- floor, panel, reference: JSON
    witness  BLOB    NOT NULL, -- an action log
    PRIMARY KEY (scenario, planner)
) STRICT, WITHOUT ROWID;

INSERT INTO packed_brackets (scenario, planner, body, witness)
SELECT scenario, planner, CAST(body AS BLOB), witness FROM brackets;
DROP TABLE brackets;
ALTER TABLE packed_brackets RENAME TO brackets;
