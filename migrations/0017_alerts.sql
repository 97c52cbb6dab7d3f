-- Alerts: conditions that an operator should know of, and what the webhook was told. Written by the alert worker.
CREATE TABLE alerts (
    id              INTEGER NOT NULL PRIMARY KEY AUTOINCREMENT,
    rule            TEXT    NOT NULL, -- 'no_results', 'missing_share', 'low_disk', 'level_down', 'evaluation_worse' or 'worker_lost'
    run             TEXT    REFERENCES runs (id), -- NULL for the server as a whole
    subject         TEXT    NOT NULL, -- such as a task of the run, or a worker; empty for the run or the server as a whole
    message         TEXT    NOT NULL, -- a sentence
    began_at        INTEGER NOT NULL,
    ended_at        INTEGER, -- NULL while the condition lasts; began_at for an event, which does not last
    sent_at         INTEGER, -- when the webhook took the beginning; NULL until then
    end_sent_at     INTEGER, -- when it took the end
    attempts        INTEGER NOT NULL DEFAULT 0, -- failed ones for the message that is due
    next_attempt_at INTEGER, -- NULL if no message is due
    send_error      TEXT     -- of the last failed attempt
) STRICT;

CREATE UNIQUE INDEX alerts_lasting ON alerts (rule, coalesce(run, ''), subject) WHERE ended_at IS NULL;
CREATE UNIQUE INDEX alerts_events ON alerts (rule, run, subject) WHERE ended_at = began_at;
CREATE INDEX alerts_due ON alerts (next_attempt_at) WHERE next_attempt_at IS NOT NULL;
CREATE INDEX alerts_of_run ON alerts (run, id);

CREATE INDEX level_moves_down ON level_moves (at) WHERE kind = 'down';
CREATE INDEX evaluations_completed ON evaluations (completed_at) WHERE run IS NOT NULL AND state = 'complete';
CREATE INDEX run_totals_recent ON run_totals (last_results_at);
