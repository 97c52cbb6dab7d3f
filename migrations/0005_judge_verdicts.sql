-- What a language model said of single steps, beside what the deterministic judge says of them.

CREATE TABLE judge_verdicts (
    id         INTEGER PRIMARY KEY,
    at         INTEGER NOT NULL,
    run        TEXT REFERENCES runs (id), -- NULL where nobody flew for a run
    episode    TEXT    NOT NULL,          -- what its client calls it
    scenario   BLOB    NOT NULL,          -- of those that nobody flew for a run nothing else is kept
    task       TEXT    NOT NULL,
    step       INTEGER NOT NULL,          -- counted from 1
    model      TEXT    NOT NULL,
    prompt     TEXT    NOT NULL,          -- the version of the words it was asked with
    score      REAL CHECK (score BETWEEN -1 AND 1),
    reasoning  TEXT,
    error      TEXT,                      -- why there is no score
    rule_score REAL CHECK (rule_score BETWEEN -1 AND 1),
    rule_case  TEXT,
    cached     INTEGER NOT NULL CHECK (cached IN (0, 1)), -- the same was asked before
    tokens_in  INTEGER NOT NULL,
    tokens_out INTEGER NOT NULL,
    cost       REAL    NOT NULL,
    latency_ms INTEGER NOT NULL,
    CHECK ((score IS NULL) = (error IS NOT NULL)),
    CHECK ((score IS NULL) = (reasoning IS NULL))
) STRICT;

CREATE INDEX judge_verdicts_of_run ON judge_verdicts (run, id);
