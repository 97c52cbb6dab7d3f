-- Notes of runs, and the values by which the list of runs is searched, filtered and sorted.

ALTER TABLE runs ADD COLUMN note TEXT NOT NULL DEFAULT '';     -- free text of the team
ALTER TABLE runs ADD COLUMN strategy TEXT NOT NULL DEFAULT ''; -- of the current settings
ALTER TABLE runs ADD COLUMN tasks TEXT NOT NULL DEFAULT '';    -- of the current settings: ids in alphabetical order, with commas

UPDATE runs SET
    strategy = coalesce(settings ->> '$.curriculum.strategy', ''),
    tasks = coalesce((SELECT group_concat(task) FROM (SELECT value ->> '$.task' AS task FROM json_each(settings, '$.curriculum.tasks')
                                                      ORDER BY task)), '');

-- A list of runs reads the values that it searches and filters from this index alone.
DROP INDEX runs_listed;
CREATE INDEX runs_listed ON runs (created_at, id, archived_at, status, strategy, tasks, name, note) WHERE deleted_at IS NULL;

-- Totals of a run's results. A row is written with the first results, and changed in the transaction of all others.
CREATE TABLE run_totals (
    run              TEXT    NOT NULL PRIMARY KEY REFERENCES runs (id),
    episodes         INTEGER NOT NULL, -- finished, or of accepted claims
    first_results_at INTEGER NOT NULL,
    last_results_at  INTEGER NOT NULL,
    skill            REAL,             -- mean of the latest episodes that have a skill; NULL before there are any
    skill_weight     REAL    NOT NULL  -- number of episodes behind `skill`; an episode's weight halves every 1 000 episodes
) STRICT, WITHOUT ROWID;

INSERT INTO run_totals (run, episodes, first_results_at, last_results_at, skill, skill_weight)
SELECT r.id,
       (SELECT coalesce(sum(episodes), 0) FROM task_counters WHERE run = r.id)
           + (SELECT coalesce(sum(episodes - audited), 0) FROM claim_counters WHERE run = r.id),
       coalesce((SELECT min(first_at) FROM task_curves WHERE run = r.id), (SELECT min(start) FROM task_history WHERE run = r.id)),
       coalesce((SELECT max(last_at) FROM task_curves WHERE run = r.id), (SELECT max(start) FROM task_history WHERE run = r.id)),
       (SELECT sum(skill_sum) / sum(episodes_with_skill) FROM task_counters WHERE run = r.id AND episodes_with_skill > 0),
       -- The weights of infinitely many episodes sum to 1 443.
       (SELECT min(1443.0, coalesce(sum(episodes_with_skill), 0)) FROM task_counters WHERE run = r.id)
FROM runs r
WHERE r.deleted_at IS NULL AND EXISTS (SELECT 1 FROM task_history WHERE run = r.id);
