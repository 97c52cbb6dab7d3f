-- How often scenarios of an evaluation were offered again because the groups that flew them came to nothing.
ALTER TABLE evaluations ADD COLUMN reflown INTEGER NOT NULL DEFAULT 0;
