-- The tasks of its suite that an evaluation flies, as JSON; none: all of them.
ALTER TABLE evaluations ADD COLUMN tasks TEXT;
