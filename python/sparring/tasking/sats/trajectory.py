"""Orbit of a satellite ahead of the simulation, as observations use it."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..unsupported import sentence
from ..utils.eclipses import NO_ECLIPSE, warn_of_no_eclipse


class Trajectory:
    """Orbit of a satellite ahead of the simulation."""

    dt = 30.0

    def __init__(self, satellite: Any) -> None:
        self._satellite = satellite

    def next_eclipse(self, t: float, max_tries: int = 2) -> tuple[float, float]:
        """Returns the times at which the next eclipse begins and the next one ends, s.

        `t` must be the time of the simulation. Both are 1.0 if there is none within hours.
        """
        satellite = self._satellite
        if t != satellite.simulator.sim_time:
            raise NotImplementedError(sentence("next_eclipse at another time", "pass simulator.sim_time"))
        start, end = satellite.simulator.native.next_eclipse(satellite.index)
        if (start, end) == NO_ECLIPSE:
            warn_of_no_eclipse()
            return start, end
        return np.float64(start), np.float64(end)

    def __getattr__(self, name: str) -> Any:
        if name in ("r_BN_N", "r_BP_P", "extend_to", "times", "sim_time"):
            raise NotImplementedError(sentence(f"trajectory.{name}", "use the satellite's opportunities or dynamics"))
        raise AttributeError(f"'Trajectory' object has no attribute {name!r}")
