-- Evidence that missing results cannot bias: slots, disclosure, deadlines that a pause suspends, and secret audit samples.

-- Whether the result of a group is evidence of mastery, and whether the trainer has received its scenario.
ALTER TABLE groups ADD COLUMN is_slot INTEGER NOT NULL DEFAULT 0;
ALTER TABLE groups ADD COLUMN is_disclosed INTEGER NOT NULL DEFAULT 1;
-- Episodes whose results count as evidence: finished, and not of too old a policy version.
ALTER TABLE groups ADD COLUMN counted INTEGER NOT NULL DEFAULT 0;
ALTER TABLE groups ADD COLUMN counted_successes INTEGER NOT NULL DEFAULT 0;
-- Episodes that a session began and left. A later attempt may have finished them.
ALTER TABLE groups ADD COLUMN abandoned INTEGER NOT NULL DEFAULT 0;

-- When a lease discloses its scenarios: all with the lease, or group by group when the trainer begins them.
ALTER TABLE leases ADD COLUMN disclosure TEXT NOT NULL DEFAULT 'lease' CHECK (disclosure IN ('lease', 'begin'));
-- When the lease would have expired without a renewal.
ALTER TABLE leases ADD COLUMN first_expires_at INTEGER NOT NULL DEFAULT 0;
UPDATE leases SET first_expires_at = created_at + ttl_ms;

-- When the run was paused; NULL while it is active. Deadlines of its leases stand still meanwhile.
ALTER TABLE runs ADD COLUMN paused_at INTEGER;
UPDATE runs SET paused_at = CAST(1000 * unixepoch('subsec') AS INTEGER) WHERE status = 'paused';

-- The groups of a lease of columns that will be audited, drawn with the lease. No client sees them before the claim, which moves
-- them into `groups`.
CREATE TABLE audit_samples (
    lease        INTEGER NOT NULL REFERENCES leases (id),
    number       INTEGER NOT NULL,                       -- of the group
    scenario     BLOB    NOT NULL REFERENCES scenarios (id),
    is_contested INTEGER NOT NULL,
    is_slot      INTEGER NOT NULL,                       -- its result is evidence of mastery
    PRIMARY KEY (lease, number)
) STRICT, WITHOUT ROWID;

CREATE INDEX audit_samples_of_scenario ON audit_samples (scenario);
