-- Principals: the owners of tokens, runs, leases and evaluations.

-- A principal: the named owner of tokens. Runs and leases belong to a principal, so that a token that replaces another one keeps its
-- access. The server itself is principal 0 and has no row. Written by `sparring token`.
CREATE TABLE principals (
    id   INTEGER NOT NULL PRIMARY KEY CHECK (id > 0),
    name TEXT    NOT NULL UNIQUE
) STRICT;

-- Until now tokens were the owners. Tokens with one name get one principal.
INSERT INTO principals (name) SELECT name FROM tokens GROUP BY name ORDER BY min(id);

ALTER TABLE tokens ADD COLUMN principal INTEGER REFERENCES principals (id); -- never NULL
UPDATE tokens SET principal = (SELECT p.id FROM principals p WHERE p.name = tokens.name);

-- Principal that created the run and may change it; NULL without authentication, and then every trainer is a member.
DROP INDEX runs_of_owner;
ALTER TABLE runs RENAME COLUMN owner TO creating_token;
ALTER TABLE runs ADD COLUMN owner INTEGER REFERENCES principals (id);
UPDATE runs SET owner = (SELECT t.principal FROM tokens t WHERE t.id = runs.creating_token);
ALTER TABLE runs DROP COLUMN creating_token;
CREATE INDEX runs_of_owner ON runs (owner) WHERE owner IS NOT NULL;

-- A principal that may take part in a run beside its owner: lease, report results, open sessions and pull trajectories.
CREATE TABLE run_members (
    run       TEXT    NOT NULL REFERENCES runs (id),
    principal INTEGER NOT NULL REFERENCES principals (id),
    PRIMARY KEY (run, principal)
) STRICT, WITHOUT ROWID;

-- `leases.owner` is the principal that took the lease: 0 for the server, NULL without authentication.
UPDATE leases SET owner = (SELECT t.principal FROM tokens t WHERE t.id = leases.owner) WHERE owner IS NOT NULL;
UPDATE leases SET owner = 0 WHERE id IN (SELECT lease FROM rollout_leases);

-- Principal that started an evaluation, and may cancel it if the evaluation has no run; NULL without authentication.
ALTER TABLE evaluations ADD COLUMN owner INTEGER REFERENCES principals (id);
