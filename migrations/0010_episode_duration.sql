-- The duration of episodes in worlds whose steps have different durations.
DROP VIEW view_episodes;
CREATE VIEW view_episodes AS
SELECT l.run, 'ep_' || l.id || '-' || l.id_suffix || '_' || e.number AS episode, l.id || '-' || l.id_suffix AS lease,
       g.number AS group_number, l.purpose, g.task, g.level, g.role, g.layout, g.is_contested AS contested, e.state, e.score, e.skill,
       e.success, e.floor, e.reference, e.outcome ->> 'total_reward' AS total_reward, e.outcome ->> 'steps' AS steps,
       e.outcome ->> 'lost' AS lost, e.outcome ->> 'fuel_used' AS fuel_used, e.outcome ->> 'time_s' AS time_s, e.reason, e.metrics,
       e.policy_version, strftime('%Y-%m-%dT%H:%M:%fZ', e.at / 1000.0, 'unixepoch') AS at
FROM episodes e
JOIN leases l ON l.id = e.lease
JOIN groups g ON g.lease = e.lease AND g.number = e.number / l.group_size
JOIN runs r ON r.id = l.run
WHERE r.deleted_at IS NULL;
