"""What is seen, in words that a model reads."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

#: Steps over which passes are foreseen.
LOOK_AHEAD = 15


def words(telemetry: Mapping[str, Any], most: int = 2) -> str:
    """What is seen, in lines that a model reads: alerts, each satellite, and the pieces of debris that will pass it nearest.

    Args:
        telemetry: In the wire form of the public kessler-env: `Environment.telemetry()`, or the observation of a server.
        most: Pieces of debris for each satellite.
    """
    lines = [str(alert) for alert in telemetry["critical_alerts"]]
    for own in telemetry["satellites"]:
        if own["status"] != "active":
            continue
        lines.append(
            f"Satellite {own['id']} at ({own['x']:.1f}, {own['y']:.1f}) moving ({own['vx']:.2f}, {own['vy']:.2f}), "
            f"fuel {own['fuel']:.0f}"
        )
        passes = sorted(_passes(own, other) for other in telemetry["radar_debris"])
        lines += [
            f"- debris at ({x:+.1f}, {y:+.1f}) from it, moving ({vx:+.2f}, {vy:+.2f}): {miss:.1f} near in {when:.0f} steps"
            for miss, when, x, y, vx, vy in passes[:most]
        ]
    return "\n".join(lines)


def _passes(own: Mapping[str, float], other: Mapping[str, float]) -> tuple[float, ...]:
    """How near they come and when, as if both flew straight, and where the other is and moves, as seen from the one."""
    x, y, vx, vy = (other[name] - own[name] for name in ("x", "y", "vx", "vy"))
    when = min(max(-(x * vx + y * vy) / max(vx * vx + vy * vy, 1e-9), 0.0), LOOK_AHEAD)
    return math.hypot(x + vx * when, y + vy * when), when, x, y, vx, vy
