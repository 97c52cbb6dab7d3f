-- Leases that are active, run by run: each lease that is taken counts them, and a run of weeks has many that are over.
CREATE INDEX leases_active ON leases (run) WHERE status = 'active';
