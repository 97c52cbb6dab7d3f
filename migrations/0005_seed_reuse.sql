-- Seeds that runs used before, and rollouts of the planner.

ALTER TABLE runs ADD COLUMN is_seed_reused INTEGER NOT NULL DEFAULT 0; -- a run that was created before has the same seed

CREATE INDEX runs_of_seed ON runs (seed);

-- A seed of a run. Rows stay when the run is deleted. Written when a run is created.
CREATE TABLE used_run_seeds (
    seed INTEGER NOT NULL PRIMARY KEY
) STRICT;

INSERT INTO used_run_seeds (seed)
SELECT DISTINCT seed FROM runs;

UPDATE runs SET is_seed_reused = 1
WHERE EXISTS (SELECT 1 FROM runs AS earlier
              WHERE earlier.seed = runs.seed AND (earlier.created_at, earlier.id) < (runs.created_at, runs.id));

-- The server no longer rolls out the planner: its trajectories are reference plans.
UPDATE run_policies SET policy = 'off' WHERE policy = 'reference';
