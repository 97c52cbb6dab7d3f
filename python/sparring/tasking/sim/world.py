"""Models of the world: gravity, eclipses, atmosphere and ground stations."""

from __future__ import annotations

import logging
from abc import ABC
from typing import Any
from weakref import proxy

import numpy as np

from ..messaging import EclipseMsgPayload, Message
from ..utils.elements import REQ_EARTH, Vector
from ..utils.functional import Resetable, collect_default_args, default_args
from ..utils.orbital import random_epoch
from .world_objects import EclipseObject, GravityFactory, GroundStation, Planet

logger = logging.getLogger(__name__)

_STATIONS = [
    {"name": "Boulder", "lat": 40.009971, "long": -105.243895, "elev": 1624},
    {"name": "Merritt", "lat": 28.3181, "long": -80.6660, "elev": 0.9144},
    {"name": "Singapore", "lat": 1.3521, "long": 103.8198, "elev": 15},
    {"name": "Weilheim", "lat": 47.8407, "long": 11.1421, "elev": 563},
    {"name": "Santiago", "lat": -33.4489, "long": -70.6693, "elev": 570},
    {"name": "Dongara", "lat": -29.2452, "long": 114.9326, "elev": 34},
    {"name": "Hawaii", "lat": 19.8968, "long": -155.5828, "elev": 9},
]
_DAY_S = 86_400.0
_CENTURY_S = 36_525.0 * _DAY_S


class WorldModelABC(ABC, Resetable):
    """Base of the world's models."""

    @classmethod
    def default_world_args(cls, **kwargs: Any) -> dict[str, Any]:
        """Returns the arguments of the model with their defaults, and with those given."""
        defaults = collect_default_args(cls)
        for name, value in kwargs.items():
            if name not in defaults:
                raise KeyError(f"{name} not a valid key for world_args")
            defaults[name] = value
        return defaults

    def __init__(self, simulator: Any, world_rate: float, priority: int = 300, **kwargs: Any) -> None:
        self.simulator = proxy(simulator)
        self.world_rate = world_rate
        self.args = kwargs
        self._setup_world_objects(**kwargs)

    def _setup_world_objects(self, **kwargs: Any) -> None:
        raise NotImplementedError("A world model must set up its objects.")


class WorldModel(WorldModelABC):
    """World with the gravity of Earth and Sun."""

    def _setup_world_objects(self, **kwargs: Any) -> None:
        self.setup_gravity_bodies(**kwargs)

    @default_args(utc_init=random_epoch)
    def setup_gravity_bodies(self, utc_init: str, **kwargs: Any) -> None:
        """Sets up Sun and Earth at an epoch such as `2018 SEP 29 21:00:00.000 (UTC)`."""
        self.utc_init = utc_init
        self.sun_index = 0
        self.body_index = 1
        self.planet = Planet(radEquator=REQ_EARTH * 1e3)
        self.gravFactory = GravityFactory(self)

    @property
    def sun_position(self) -> list[float]:
        """Position of the Sun relative to the Earth in the inertial frame, m."""
        position: list[float] = self.simulator.native.sun_position()
        return position

    @property
    def PN(self) -> Vector:
        """Rotation from the inertial frame to the planet-fixed frame."""
        return np.array(self.simulator.native.planet_from_inertial()).reshape((3, 3))

    @property
    def omega_PN_N(self) -> Vector:
        """Angular velocity of the planet in the inertial frame, rad/s (IAU_EARTH)."""
        pole = self.PN[2]
        ascension = np.arctan2(pole[1], pole[0])
        node = np.array([-np.sin(ascension), np.cos(ascension), 0.0])
        spin = np.radians(360.9856235) / _DAY_S
        drift_ascension, drift_declination = np.radians([-0.641, -0.557]) / _CENTURY_S
        drift = np.array([0.0, 0.0, drift_ascension])
        rate: Vector = spin * pole + drift - drift_declination * node
        return rate


class EclipseWorldModel(WorldModel):
    """World with eclipses of the Sun."""

    def _setup_world_objects(self, **kwargs: Any) -> None:
        super()._setup_world_objects(**kwargs)
        self.setup_eclipse_object(**kwargs)

    def setup_eclipse_object(self, **kwargs: Any) -> None:
        """Sets up the messages of eclipses, one for each satellite."""
        self.eclipseObject = EclipseObject()

    def add_eclipse_message(self, dynamics: Any) -> int:
        """Adds the message of a satellite's eclipse, and returns its index."""

        def build() -> EclipseMsgPayload:
            native = dynamics.simulator.native
            return EclipseMsgPayload(illuminationFactor=native.illumination(dynamics.satellite.index))

        self.eclipseObject.eclipseOutMsgs.append(Message(build))
        return len(self.eclipseObject.eclipseOutMsgs) - 1


class AtmosphereWorldModel(WorldModel):
    """World with an exponential atmosphere."""

    def _setup_world_objects(self, **kwargs: Any) -> None:
        super()._setup_world_objects(**kwargs)
        self.setup_atmosphere_density_model(**kwargs)

    @default_args(planetRadius=REQ_EARTH * 1e3, baseDensity=1.22, scaleHeight=8e3)
    def setup_atmosphere_density_model(self, planetRadius: float, baseDensity: float, scaleHeight: float, **kwargs: Any) -> None:
        """Sets up the atmosphere: radius and scale height in m, density in kg/m³."""
        self.planetRadius = planetRadius
        self.baseDensity = baseDensity
        self.scaleHeight = scaleHeight


class GroundStationWorldModel(WorldModel):
    """World with ground stations that receive data."""

    def _setup_world_objects(self, **kwargs: Any) -> None:
        super()._setup_world_objects(**kwargs)
        self.setup_ground_locations(**kwargs)

    @default_args(
        groundStationsData=_STATIONS,
        groundLocationPlanetRadius=REQ_EARTH * 1e3,
        gsMinimumElevation=np.radians(10.0),
        gsMaximumRange=-1,
    )
    def setup_ground_locations(
        self,
        groundStationsData: list[dict[str, Any]],
        groundLocationPlanetRadius: float,
        gsMinimumElevation: float,
        gsMaximumRange: float,
        **kwargs: Any,
    ) -> None:
        """Sets up ground stations.

        Each has `lat` and `long` in degrees, and may have `elev` in m, `name`, and values of its
        own for radius (m), minimum elevation (rad) and largest range (m, -1 for no limit).
        """
        self.groundLocationPlanetRadius = groundLocationPlanetRadius
        self.gsMinimumElevation = gsMinimumElevation
        self.gsMaximumRange = gsMaximumRange
        self.groundStations: list[GroundStation] = []
        for data in groundStationsData:
            own = {"name": str(len(self.groundStations)), **data}
            station = GroundStation(
                ModelTag="GroundStation" + own["name"],
                latitude_deg=own["lat"],
                longitude_deg=own["long"],
                height_m=own.get("elev", 0),
                planetRadius=own.get("groundLocationPlanetRadius") or groundLocationPlanetRadius,
                minimumElevation=own.get("gsMinimumElevation") or gsMinimumElevation,
                maximumRange=own.get("gsMaximumRange") or gsMaximumRange,
            )
            self.groundStations.append(station)


__all__ = [
    "AtmosphereWorldModel",
    "EclipseWorldModel",
    "GroundStationWorldModel",
    "WorldModel",
    "WorldModelABC",
]
