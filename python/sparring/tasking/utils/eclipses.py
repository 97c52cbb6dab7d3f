"""Eclipses that the search did not find."""

from __future__ import annotations

import logging

logger = logging.getLogger("sparring.tasking.utils.orbital")

#: Times that stand for no eclipse within the search, s, and the time that the search covers, s.
NO_ECLIPSE = (1.0, 1.0)
_SEARCHED_S = 12_000.0


def warn_of_no_eclipse() -> None:
    """Logs that the search for eclipses found none."""
    logger.warning(f"Could not find eclipse transitions in next {_SEARCHED_S:.1f} seconds")
