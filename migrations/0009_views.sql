-- Views for analysis with pandas, polars, DuckDB or SQL. docs/reference/data.md describes their columns. The server does not read them,
-- except for exports. They lack the leases that retention has compacted, which `sparring db export` includes.

CREATE VIEW view_runs AS
SELECT r.id AS run, r.name, r.seed, r.status, r.policy_version, p.name AS owner, r.settings,
       strftime('%Y-%m-%dT%H:%M:%fZ', r.created_at / 1000.0, 'unixepoch') AS created_at,
       strftime('%Y-%m-%dT%H:%M:%fZ', r.archived_at / 1000.0, 'unixepoch') AS archived_at
FROM runs r LEFT JOIN principals p ON p.id = r.owner
WHERE r.deleted_at IS NULL;

CREATE VIEW view_moves AS
SELECT m.run, m.seq, m.task, m.kind AS move, m.from_level, m.to_level, m.evidence,
       strftime('%Y-%m-%dT%H:%M:%fZ', m.at / 1000.0, 'unixepoch') AS at
FROM level_moves m JOIN runs r ON r.id = m.run
WHERE r.deleted_at IS NULL;

CREATE VIEW view_groups AS
SELECT l.run, l.id || '-' || l.id_suffix AS lease, g.number AS group_number, l.purpose, g.task, g.level, g.role, g.layout,
       g.is_contested AS contested, g.is_slot AS slot, g.state, l.group_size AS episodes, g.finished, g.failed, g.successes,
       g.counted, g.counted_successes, l.policy_version,
       strftime('%Y-%m-%dT%H:%M:%fZ', l.created_at / 1000.0, 'unixepoch') AS leased_at,
       strftime('%Y-%m-%dT%H:%M:%fZ', g.closed_at / 1000.0, 'unixepoch') AS closed_at
FROM groups g JOIN leases l ON l.id = g.lease JOIN runs r ON r.id = l.run
WHERE r.deleted_at IS NULL;

CREATE VIEW view_episodes AS
SELECT l.run, 'ep_' || l.id || '-' || l.id_suffix || '_' || e.number AS episode, l.id || '-' || l.id_suffix AS lease,
       g.number AS group_number, l.purpose, g.task, g.level, g.role, g.layout, g.is_contested AS contested, e.state, e.score, e.skill,
       e.success, e.floor, e.reference, e.outcome ->> 'total_reward' AS total_reward, e.outcome ->> 'steps' AS steps,
       e.outcome ->> 'lost' AS lost, e.outcome ->> 'fuel_used' AS fuel_used, e.reason, e.metrics, e.policy_version,
       strftime('%Y-%m-%dT%H:%M:%fZ', e.at / 1000.0, 'unixepoch') AS at
FROM episodes e
JOIN leases l ON l.id = e.lease
JOIN groups g ON g.lease = e.lease AND g.number = e.number / l.group_size
JOIN runs r ON r.id = l.run
WHERE r.deleted_at IS NULL;

-- Results by task and time: minutes as far as they are kept, and hours before.
CREATE VIEW view_mastery AS
SELECT h.run, h.task, strftime('%Y-%m-%dT%H:%M:%fZ', h.start / 1000.0, 'unixepoch') AS at, h.width / 1000 AS seconds,
       h.level, h.mean, h.q10, h.q90, h.episodes, h.successes, h.failed, h.expired,
       h.score_sum / nullif(h.episodes, 0) AS score, h.skill_sum / nullif(h.episodes_with_skill, 0) AS skill,
       h.contested_groups, h.success_rate_sum / nullif(h.contested_groups, 0) AS contested_success
FROM task_history h JOIN runs r ON r.id = h.run
WHERE r.deleted_at IS NULL
  AND (h.width = 60000
       OR NOT EXISTS (SELECT 1 FROM task_history m
                      WHERE m.run = h.run AND m.task = h.task AND m.width = 60000 AND m.start < h.start + 3600000));

CREATE VIEW view_trainer_metrics AS
SELECT m.run, m.name, m.step, m.value, strftime('%Y-%m-%dT%H:%M:%fZ', m.at / 1000.0, 'unixepoch') AS at
FROM trainer_metrics m JOIN runs r ON r.id = m.run
WHERE r.deleted_at IS NULL;
