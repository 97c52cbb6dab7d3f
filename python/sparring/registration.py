"""The ids that `gymnasium.make` and `gymnasium.make_vec` know."""

from __future__ import annotations

from typing import Any

import gymnasium

from .vector import VectorEnvironment, make_vec

#: Gymnasium's ids, and the tasks they are.
ENVIRONMENTS = {
    "sparring/Survival-v0": "kessler/survival",
    "sparring/EcoStation-v0": "kessler/eco_station",
    "sparring/Rendezvous-v0": "kessler/rendezvous",
    "sparring/Formation-v0": "kessler/formation",
    "sparring/DockingSingle-v0": "docking/single",
    "sparring/DockingMultiagent-v0": "docking/multiagent",
}


def _make_vec(num_envs: int, task: str, **settings: Any) -> VectorEnvironment:
    """For `gymnasium.make_vec`, whose users wrap `RecordEpisodeStatistics` around what they get."""
    return make_vec(task, num_envs, **{"episode_statistics": False, **settings})


def register() -> None:
    """Makes the ids known; `import sparring` does it."""
    for id, task in ENVIRONMENTS.items():
        if id not in gymnasium.registry:
            gymnasium.register(
                id=id,
                entry_point="sparring.single:Environment",
                vector_entry_point="sparring.registration:_make_vec",
                kwargs={"task": task},
            )
