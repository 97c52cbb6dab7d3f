"""Programs against the API, of which each returns what it saw; the expected values come from bsk_rl."""

import programs_rewards
import programs_satellites
import programs_targets
import programs_views

PROGRAMS = [
    *programs_rewards.PROGRAMS,
    *programs_views.PROGRAMS,
    *programs_satellites.PROGRAMS,
    *programs_targets.PROGRAMS,
]
SEED = 21
