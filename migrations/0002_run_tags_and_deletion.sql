-- Tags of runs, and deletion of runs.

-- From `deleted_at` on, the API and the workers treat the run as one that does not exist. A worker deletes its rows, and this row last.
ALTER TABLE runs ADD COLUMN deleted_at INTEGER; -- NULL for a run that exists

-- Lists of runs read pages of this index.
CREATE INDEX runs_listed ON runs (created_at, id) WHERE deleted_at IS NULL;
CREATE INDEX runs_deleted ON runs (deleted_at) WHERE deleted_at IS NOT NULL;

-- A tag of a run, by which users group runs and filter lists. Written by the run API.
CREATE TABLE run_tags (
    run            TEXT    NOT NULL REFERENCES runs (id),
    tag            TEXT    NOT NULL,
    run_created_at INTEGER NOT NULL, -- created_at of the run, so that a list of the runs with a tag reads pages of the index
    PRIMARY KEY (run, tag)
) STRICT, WITHOUT ROWID;

CREATE INDEX run_tags_of_tag ON run_tags (tag, run_created_at, run);

-- The highest id of a lease when a run was deleted last. Ids of leases are never reused, although the newest lease may be deleted.
CREATE TABLE highest_deleted_lease (
    id    INTEGER NOT NULL PRIMARY KEY CHECK (id = 1),
    lease INTEGER NOT NULL
) STRICT;

-- These columns are searched when a run and what belongs to it are deleted.
CREATE INDEX layouts_of_request ON layouts (request);
CREATE INDEX evaluations_of_run ON evaluations (run);
