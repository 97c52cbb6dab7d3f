-- A layout retires too if the server judges it otherwise than the worker that designed it. SQLite cannot change the check of a column.
DROP INDEX layouts_probed;
ALTER TABLE layouts ADD COLUMN reason TEXT CHECK (reason IN ('mastered', 'hopeless', 'user', 'wrong'));
UPDATE layouts SET reason = retirement_reason WHERE retirement_reason IS NOT NULL;
ALTER TABLE layouts DROP COLUMN retirement_reason;
ALTER TABLE layouts RENAME COLUMN reason TO retirement_reason;
CREATE INDEX layouts_probed ON layouts (run, task, level, id)
WHERE state = 'retired' AND retirement_reason IN ('mastered', 'hopeless');
