-- Who may come in, and what they did.

CREATE TABLE tokens (
    id         INTEGER NOT NULL PRIMARY KEY AUTOINCREMENT, -- never given twice: it stands in the token
    name       TEXT    NOT NULL,
    role       TEXT    NOT NULL CHECK (role IN ('viewer', 'trainer', 'admin')),
    hash       BLOB    NOT NULL, -- of the token; it is kept nowhere
    created_at INTEGER NOT NULL,
    expires_at INTEGER,          -- none: never
    revoked_at INTEGER,
    used_at    INTEGER           -- to ten minutes
) STRICT;

-- What was changed by hand, and who was refused; a ring.
CREATE TABLE audit_log (
    id         INTEGER NOT NULL PRIMARY KEY AUTOINCREMENT,
    at         INTEGER NOT NULL,
    token      INTEGER REFERENCES tokens (id), -- none: anonymous
    address    TEXT,                           -- where it came from
    operation  TEXT    NOT NULL,
    path       TEXT    NOT NULL,
    status     INTEGER NOT NULL,
    request_id TEXT    NOT NULL
) STRICT;

-- Whose it is, where a token was needed.
ALTER TABLE runs ADD COLUMN owner INTEGER REFERENCES tokens (id);
ALTER TABLE leases ADD COLUMN owner INTEGER;

CREATE INDEX runs_of_owner ON runs (owner) WHERE owner IS NOT NULL;
CREATE INDEX leases_of_owner ON leases (owner) WHERE status = 'active' AND owner IS NOT NULL;

-- Written by whoever asks whether the server is ready: that a change is committed says that one can be.
CREATE TABLE pulse (
    id INTEGER NOT NULL PRIMARY KEY CHECK (id = 1),
    at INTEGER NOT NULL
) STRICT;
