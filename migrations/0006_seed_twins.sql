-- Both of two runs with the same seed are marked: each shows the scenarios of the other.

UPDATE runs SET is_seed_reused = 1
WHERE seed IN (SELECT seed FROM runs GROUP BY seed HAVING count(*) > 1);
