-- Success over time is read from `task_history`, which has the slots of compacted leases too.

DROP TABLE compacted_progress;
