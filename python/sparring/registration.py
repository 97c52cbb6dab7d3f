"""Registration of the environments with `gymnasium.make` and `gymnasium.make_vec`."""

from __future__ import annotations

from typing import Any

import gymnasium

from .vector import VectorEnvironment, make_vec

#: Task of each id that is registered with Gymnasium.
ENVIRONMENTS = {
    "sparring/Survival-v0": "kessler/survival",
    "sparring/EcoStation-v0": "kessler/eco_station",
    "sparring/Rendezvous-v0": "kessler/rendezvous",
    "sparring/Formation-v0": "kessler/formation",
    "sparring/DockingSingle-v0": "docking/single",
    "sparring/DockingMultiagent-v0": "docking/multiagent",
    "sparring/Scanning-v0": "tasking/scanning",
    "sparring/Imaging-v0": "tasking/imaging",
    "sparring/Constellation-v0": "tasking/constellation",
}


def register() -> None:
    """Registers the ids; `import sparring` calls this."""
    for id, task in ENVIRONMENTS.items():
        if id not in gymnasium.registry:
            gymnasium.register(
                id=id,
                entry_point="sparring.single:Environment",
                vector_entry_point="sparring.registration:_make_vec",
                kwargs={"task": task},
            )


def _make_vec(num_envs: int, task: str, **settings: Any) -> VectorEnvironment:
    """Entry point of `gymnasium.make_vec`, whose users wrap the result in `RecordEpisodeStatistics`."""
    return make_vec(task, num_envs, **{"episode_statistics": False, **settings})
