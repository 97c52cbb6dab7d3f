"""Seeded policies that choose the actions of recorded episodes."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from bsk_rl.scene.targets import Target


@dataclass(frozen=True)
class RandomPolicy:
    """Chooses a kind of action by weight and one of its indices uniformly.

    `busy` and `dead` are the probabilities that a satellite that is busy or dead receives an action too. `in_view` is the
    probability that a satellite with data over a ground station downlinks.
    """

    weights: dict[str, float] = field(default_factory=dict)
    busy: float = 0.0
    dead: float = 0.0
    in_view: float = 0.0

    def choose(self, satellite: Any, step: int, rng: np.random.Generator) -> Any:
        """Returns an action of the satellite, or None to let it go on."""
        probability = 1.0 if satellite.requires_retasking else self.busy
        if not satellite._is_alive:
            probability = self.dead
        if rng.random() >= probability:
            return None
        kinds = satellite.action_builder.action_spec
        weights = np.array([self.weights.get(type(kind).__name__, 1.0) for kind in kinds])
        chosen = int(rng.choice(len(kinds), p=weights / weights.sum()))
        if self.in_view and rng.random() < self.in_view and over_station(satellite):
            chosen = [type(kind).__name__ for kind in kinds].index("Downlink")
        first = sum(kind.n_actions for kind in kinds[:chosen])
        return first + int(rng.integers(kinds[chosen].n_actions))


@dataclass(frozen=True)
class ScriptPolicy:
    """Gives the actions of a list in order, and begins again at its end."""

    actions: tuple[int, ...]

    def choose(self, satellite: Any, step: int, rng: np.random.Generator) -> Any:
        """Returns the action of this step."""
        return self.actions[step % len(self.actions)]


@dataclass(frozen=True)
class TargetPolicy:
    """Chooses upcoming targets by index, as an object or by identifier, one third each.

    `repeat` is the probability of the target before, whether it was imaged or not, if it has a window.
    """

    ahead: int
    repeat: float = 0.15
    busy: float = 0.2

    def choose(self, satellite: Any, step: int, rng: np.random.Generator) -> Any:
        """Returns an index, a target or the identifier of a target."""
        if not satellite.requires_retasking and rng.random() >= self.busy:
            return None
        form = int(rng.integers(3))
        if form == 0:
            return int(rng.integers(self.ahead))
        upcoming = [item["object"] for item in satellite.upcoming_opportunities if item["type"] == "target"]
        unseen = [target for target in upcoming if target not in satellite.data_store.data.imaged]
        target = unseen[int(rng.integers(min(self.ahead, len(unseen))))]
        if satellite.latest_target in upcoming and rng.random() < self.repeat:
            target = satellite.latest_target
        return target if form == 1 else target.id


def over_station(satellite: Any) -> bool:
    """Returns whether a known window of a ground station is open and the storage holds data."""
    if satellite.dynamics.storage_level <= 0:
        return False
    now = satellite.simulator.sim_time
    windows = (item["window"] for item in satellite.upcoming_opportunities if item["type"] == "ground_station")
    return any(opening <= now < closing for opening, closing in windows)


def action_value(action: Any, satellite: Any) -> Any:
    """Returns an action as a recording holds it: an integer, {"target": name} or None."""
    if isinstance(action, Target):
        return {"target": action.name}
    if isinstance(action, str):
        return {"target": next(target.name for target in satellite.known_targets if target.id == action)}
    return action
