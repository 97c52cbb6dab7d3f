-- Durations of episodes in worlds whose steps have different durations.
ALTER TABLE task_history ADD COLUMN timed_episodes INTEGER NOT NULL DEFAULT 0; -- finished episodes with a duration
ALTER TABLE task_history ADD COLUMN time_s_sum REAL NOT NULL DEFAULT 0;        -- of these
