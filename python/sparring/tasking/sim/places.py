"""Places on the ground that the simulation searches for access windows: numbers, positions and names."""

from __future__ import annotations

import math
from dataclasses import dataclass
from operator import is_not
from typing import Any

import numpy as np

from ..scene.targets import Target
from ..unsupported import sentence

_ARGUMENT = "imageTargetMinimumElevation"

Location = dict[str, Any]


@dataclass
class Place:
    """Target of the simulation: the user's object, and its planet-fixed position in m."""

    object: Any
    position: Any

    def is_plain(self) -> bool:
        """Returns whether the simulation can observe all properties of the object."""
        thing = self.object
        cls = type(thing)
        if cls is not Target:
            is_target = isinstance(thing, Target)
            if not is_target or cls.priority is not Target.priority or cls.r_LP_P is not Target.r_LP_P:
                return False
        return thing.r_LP_P is self.position and _number(thing.priority) is not None

    def describe(self) -> dict[str, Any]:
        """Returns the name, the position and the priority, 0 if it is not a number."""
        position = self.position
        priority = _number(getattr(self.object, "priority", None))
        return {
            "name": str(getattr(self.object, "name", self.object)),
            "r_LP_P_m": position.tolist() if isinstance(position, np.ndarray) else position,
            "priority": 0.0 if priority is None else priority,
        }


def _number(value: Any) -> float | None:
    """A finite number, or None for any other value."""
    if type(value) is not float:
        if isinstance(value, (str, bytes)):
            return None
        try:
            value = float(value)
        except (TypeError, ValueError):
            return None
    return value if math.isfinite(value) else None


def number_targets(satellites: list[Any], listed: list[Any]) -> list[Place]:
    """Numbers the targets that satellites added to their access checks, and links them to the satellites.

    Targets of several satellites have one number. Their order is that of a satellite that has all of them, else that
    of the targets that the scenario lists. A satellite sees its own targets only.
    """
    found: dict[int, Place] = {}
    known: list[tuple[Any, list[int]]] = []
    positions: list[Any] = []
    for satellite in satellites:
        if not hasattr(satellite, "locations_for_access_checking"):
            continue
        own = [item for item in satellite.locations_for_access_checking if item["type"] == "target"]
        _check_locations(satellite, own)
        identities = [id(item["object"]) for item in own]
        own_positions = [item["r_LP_P"] for item in own]
        is_repeated = bool(known) and identities == known[-1][1] and not any(map(is_not, own_positions, positions))
        if not is_repeated:
            _add_targets(found, own)
        known.append((satellite, identities))
        positions = own_positions
    most = max((len(identities) for _, identities in known), default=0)
    in_order = {} if most == len(found) else {id(item): found[id(item)] for item in listed if id(item) in found}
    in_order.update(found)
    places = list(in_order.values())
    numbers = {identity: number for number, identity in enumerate(in_order)}
    things = {number: (place.object, place.position) for number, place in enumerate(places)}
    for satellite, identities in known:
        satellite.link_targets(identities, numbers, things)
    return places


def _add_targets(found: dict[int, Place], locations: list[Location]) -> None:
    """Adds the targets of locations by their identities; each has one position."""
    for location in locations:
        thing, position = location["object"], location["r_LP_P"]
        place = found.setdefault(id(thing), Place(thing, position))
        if place.position is not position and list(place.position) != list(position):
            raise NotImplementedError(sentence(f"{thing} at several places", "give each place a target of its own"))


def _check_locations(satellite: Any, locations: list[Location]) -> None:
    """Raises NotImplementedError for targets that are added twice, or with an elevation or a start of their own."""
    if any(item["start_time"] != 0.0 for item in locations):
        raise NotImplementedError(sentence("start_time of a target", "add all targets for the whole episode"))
    elevation = satellite.sat_args.get(_ARGUMENT)
    if any(item["min_elev"] != elevation for item in locations):
        raise NotImplementedError(
            sentence(
                f"A minimum elevation of a target other than {_ARGUMENT} of the satellite",
                f"set {_ARGUMENT} in sat_args to a number",
            )
        )
