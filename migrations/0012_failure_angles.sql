-- Failures have an angle in every world: the bearing of the encounter, or the orbit angle. A cell has a sector (-1 without an angle)
-- and, if there was an encounter, a speed band (else -1).
ALTER TABLE failure_examples RENAME COLUMN bearing_deg TO sector_deg;
