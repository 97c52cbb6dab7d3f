"""Satellite classes of the recorder: those of BSK-RL with a record of image actions and of every tick."""

from __future__ import annotations

from typing import Any

from bsk_rl import sats

from bsk_record.trace import Trace


class RecordedSatellite:
    """Mixin that keeps the target and window of the last image action, and a trace if one is wanted."""

    selection: dict[str, Any] | None = None
    traced = False
    trace: Trace | None = None

    def enable_target_window(self, target: Any, max_duration: float | None = None) -> None:
        """Keeps the window that BSK-RL chooses for a target, then lets BSK-RL choose it."""
        for opportunity in self.upcoming_opportunities:
            if opportunity["object"] == target:
                opening, closing = opportunity["window"]
                self.selection = {"target": target.name, "open": opening, "close": closing}
                break
        super().enable_target_window(target, max_duration=max_duration)

    def reset_during_sim_init(self) -> None:
        """Adds recorders of messages before Basilisk initialises the simulation."""
        super().reset_during_sim_init()
        if self.traced:
            self.trace = Trace(self)


def satellite_class(base: str) -> type:
    """Returns the recorded variant of a satellite class of BSK-RL."""
    return type(base, (RecordedSatellite, getattr(sats, base)), {})
