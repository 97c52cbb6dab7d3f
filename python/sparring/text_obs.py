"""Observations as text for language models."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

#: Steps over which close approaches are predicted.
LOOK_AHEAD = 15


def describe_telemetry(telemetry: Mapping[str, Any], max_debris: int = 2) -> str:
    """Describes an observation in lines of text: alerts, each satellite, and the debris that will pass nearest to it.

    Args:
        telemetry: Observation in the wire form of the public kessler-env: `Environment.telemetry()`, or a server's.
        max_debris: Maximum number of pieces of debris per satellite.
    """
    lines = [str(alert) for alert in telemetry["critical_alerts"]]
    for satellite in telemetry["satellites"]:
        if satellite["status"] != "active":
            continue
        lines.append(
            f"Satellite {satellite['id']} at ({satellite['x']:.1f}, {satellite['y']:.1f}) "
            f"moving ({satellite['vx']:.2f}, {satellite['vy']:.2f}), fuel {satellite['fuel']:.0f}"
        )
        approaches = sorted(_closest_approach(satellite, debris) for debris in telemetry["radar_debris"])
        lines += [
            f"- debris at ({it.x:+.1f}, {it.y:+.1f}) from it, moving ({it.vx:+.2f}, {it.vy:+.2f}): "
            f"{it.distance:.1f} near in {it.steps:.0f} steps"
            for it in approaches[:max_debris]
        ]
    return "\n".join(lines)


@dataclass(frozen=True, order=True)
class _Approach:
    """Closest approach of a piece of debris to a satellite; ordered by distance."""

    distance: float
    #: Steps until then.
    steps: float
    #: Position and velocity of the debris relative to the satellite, now.
    x: float
    y: float
    vx: float
    vy: float


def _closest_approach(satellite: Mapping[str, float], debris: Mapping[str, float]) -> _Approach:
    """Predicts the closest approach as if both bodies moved in straight lines."""
    x, y, vx, vy = (debris[name] - satellite[name] for name in ("x", "y", "vx", "vy"))
    steps = min(max(-(x * vx + y * vy) / max(vx * vx + vy * vy, 1e-9), 0.0), LOOK_AHEAD)
    return _Approach(math.hypot(x + vx * steps, y + vy * steps), steps, x, y, vx, vy)
