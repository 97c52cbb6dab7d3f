-- Layouts are made for a place on the rungs of a task, and are served by what the agent learns from them.
ALTER TABLE layouts ADD COLUMN start_rung INTEGER; -- start rung that it was designed for; NULL if levels are the rungs

-- Results of the last groups on a layout. An earlier result is one episode, whose success is the rate of its group.
ALTER TABLE layouts ADD COLUMN recent_results TEXT NOT NULL DEFAULT '[]'; -- oldest first, JSON list of successes and episodes
UPDATE layouts SET recent_results = (
    SELECT json_group_array(json_object('successes', value, 'episodes', 1)) FROM json_each(layouts.recent_success_rates)
);
ALTER TABLE layouts DROP COLUMN recent_success_rates;
ALTER TABLE layouts DROP COLUMN zero_success_streak;

-- Learning signals of a run's training groups, one row for designed and one for ordinary ones. Sums over groups, which fade.
CREATE TABLE learning_signals (
    run             TEXT    NOT NULL REFERENCES runs (id),
    is_designed     INTEGER NOT NULL,
    weight          REAL    NOT NULL, -- groups
    success_sum     REAL    NOT NULL, -- their success rates
    signal_sum      REAL    NOT NULL, -- their learning signals
    signal_sq_sum   REAL    NOT NULL, -- squares of these
    PRIMARY KEY (run, is_designed)
) STRICT;
