"""Errors of the simulation in the form in which BSK-RL raises them."""

from __future__ import annotations

_NOTHING_FOUND = "No opportunities found! Use add_location_for_access_checking to add locations."


def no_opportunity(error: Exception | None = None) -> Exception:
    """Returns BSK-RL's error if an error says that there is no opportunity, else that error."""
    if error is not None and "opportunity" not in str(error):
        return error
    return RuntimeError(_NOTHING_FOUND)
