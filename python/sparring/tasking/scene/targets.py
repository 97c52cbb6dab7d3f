"""Scenarios with targets on the ground, all known to the satellites."""

from __future__ import annotations

import logging
import sys
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from ..utils.elements import REQ_EARTH
from ..utils.orbital import lla2ecef
from .cities import cities
from .scenario import Scenario

logger = logging.getLogger(__name__)


class Target:
    """Target with a planet-fixed position, m, and a priority; names need not be unique."""

    #: Number of changes of any target, by which observers of targets notice them.
    changes = 0

    def __init__(self, name: str, r_LP_P: Iterable[float], priority: float) -> None:
        self.name = name
        before = Target.changes
        self.r_LP_P = np.array(r_LP_P)
        self.priority = priority
        # A new target is no change of one that is observed.
        Target.changes = before

    @property
    def r_LP_P(self) -> Any:
        """Position in the planet-fixed frame, m."""
        return self._position

    @r_LP_P.setter
    def r_LP_P(self, value: Any) -> None:
        self._position = value
        Target.changes += 1

    @property
    def priority(self) -> Any:
        """Value of an image of the target."""
        return self._priority

    @priority.setter
    def priority(self, value: Any) -> None:
        self._priority = value
        Target.changes += 1

    @property
    def id(self) -> str:
        """Unique text of the target."""
        if not hasattr(self, "_id"):
            self._id = f"{self.name}_{id(self)}"
        return self._id

    def __repr__(self) -> str:
        return f"Target({self.name})"


def _uniform() -> float:
    """Draws a priority from 0 to 1."""
    return np.random.random()


class UniformTargets(Scenario):
    """Targets that are spread uniformly over the Earth.

    `n_targets` is a number or a range, of which the end never occurs, as in BSK-RL.
    `priority_distribution` draws priorities, by default between 0 and 1. `radius` is in m.

    Raises:
        ValueError: `n_targets` is negative, or a range without a number.
    """

    def __init__(
        self,
        n_targets: int | tuple[int, int],
        priority_distribution: Callable[[], float] | None = None,
        radius: float = REQ_EARTH * 1e3,
    ) -> None:
        smallest, end = (n_targets, n_targets + 1) if isinstance(n_targets, int) else n_targets
        if smallest < 0 or end <= smallest:
            raise ValueError(f"`n_targets` must be a number >= 0 or a range (first, end) with first < end, got {n_targets!r}")
        self._n_targets = n_targets
        if priority_distribution is None:
            priority_distribution = _uniform
        self.priority_distribution = priority_distribution
        self.radius = radius
        self.targets: list[Target] = []

    def reset_overwrite_previous(self) -> None:
        """Forgets the targets of the previous episode."""
        self.targets = []

    def reset_pre_sim_init(self) -> None:
        """Draws the targets of an episode, and adds them to the satellites' access checks."""
        if isinstance(self._n_targets, int):
            self.n_targets = self._n_targets
        else:
            self.n_targets = np.random.randint(self._n_targets[0], self._n_targets[1])
        logger.info(f"Generating {self.n_targets} targets")
        self.regenerate_targets()
        for satellite in self.satellites:
            if not hasattr(satellite, "add_location_for_access_checking"):
                continue
            elevation = satellite.sat_args_generator["imageTargetMinimumElevation"]
            for target in self.targets:
                satellite.add_location_for_access_checking(object=target, r_LP_P=target.r_LP_P, min_elev=elevation, type="target")

    def visualize_target(self, target: Target) -> None:
        """Hook that shows a target in Vizard; it does nothing."""

    def regenerate_targets(self) -> None:
        """Draws the targets; subclasses may draw others."""
        self.targets = []
        for number in range(self.n_targets):
            place = np.random.normal(size=3)
            place *= self.radius / np.linalg.norm(place)
            priority: float = self.priority_distribution()
            self.targets.append(Target(f"tgt-{number}", place, priority))


class CityTargets(UniformTargets):
    """Targets at cities, or up to `location_offset` m away.

    They are drawn from the `n_select_from` largest cities, by default all. The list is the basic
    World Cities Database of simplemaps.com.
    """

    def __init__(
        self,
        n_targets: int | tuple[int, int],
        n_select_from: int | str | None = None,
        location_offset: float = 0,
        priority_distribution: Callable[[], float] | None = None,
        radius: float = REQ_EARTH * 1e3,
    ) -> None:
        super().__init__(n_targets, priority_distribution, radius)
        is_all = n_select_from in ("all", None)
        self.n_select_from: Any = sys.maxsize if is_all else n_select_from
        self.location_offset = location_offset

    def regenerate_targets(self) -> None:
        """Draws the targets among the cities."""
        self.targets = []
        listed = cities()
        self.n_select_from = min(self.n_select_from, len(listed))
        for number in np.random.choice(self.n_select_from, self.n_targets, replace=False):
            city = listed[number]
            place = lla2ecef(city.latitude_deg, city.longitude_deg, self.radius)
            offset = np.random.normal(size=3)
            offset /= np.linalg.norm(offset)
            place += offset * self.location_offset
            place /= np.linalg.norm(place)
            place *= self.radius
            self.targets.append(Target(city.name, place, self.priority_distribution()))
