"""Objects of the world that users of BSK-RL read: planets, their messages and ground stations."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any
from weakref import proxy

import numpy as np

from ..messaging import Message, SpicePlanetStateMsgPayload
from ..utils.elements import Vector
from ..utils.orbital import lla2ecef


@dataclass(frozen=True)
class Planet:
    """Radius of the planet at its equator, m."""

    radEquator: float


@dataclass
class EclipseObject:
    """Messages of eclipses by satellite."""

    eclipseOutMsgs: list[Message] = field(default_factory=list)


@lru_cache(maxsize=256)
def _position(latitude_deg: float, longitude_deg: float, radius: float) -> tuple[float, ...]:
    """Planet-fixed position of a place at a radius, m."""
    return tuple(lla2ecef(latitude_deg, longitude_deg, radius))


@dataclass(frozen=True)
class GroundStation:
    """Ground station: place in degrees and m, radius of the sphere and largest range in m."""

    ModelTag: str
    latitude_deg: float
    longitude_deg: float
    height_m: float
    planetRadius: float
    minimumElevation: float
    maximumRange: float

    @property
    def position(self) -> Vector:
        """Position in the planet-fixed frame, m."""
        radius = self.planetRadius + self.height_m
        return np.array(_position(self.latitude_deg, self.longitude_deg, radius))

    @property
    def r_LP_P_Init(self) -> list[list[float]]:
        """Planet-fixed position as a column, m."""
        return [[float(value)] for value in self.position]


class SpiceObject:
    """States of the Sun and of the Earth."""

    zeroBase = "earth"

    def __init__(self, world: Any) -> None:
        world = proxy(world)

        def sun() -> SpicePlanetStateMsgPayload:
            return SpicePlanetStateMsgPayload(PositionVector=world.sun_position, PlanetName="sun")

        def earth() -> SpicePlanetStateMsgPayload:
            rotation = world.PN
            x, y, z = rotation @ world.omega_PN_N
            tilde = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
            return SpicePlanetStateMsgPayload(
                PositionVector=[0.0] * 3,
                VelocityVector=[0.0] * 3,
                J20002Pfix=rotation.tolist(),
                J20002Pfix_dot=(-tilde @ rotation).tolist(),
                PlanetName="earth",
            )

        self.planetStateOutMsgs = [Message(sun), Message(earth)]


class GravityFactory:
    """Bodies of the world."""

    def __init__(self, world: Any) -> None:
        self.spiceObject = SpiceObject(world)
