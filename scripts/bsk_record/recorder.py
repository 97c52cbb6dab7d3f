"""Runs an episode of BSK-RL and returns its recording."""

from __future__ import annotations

from importlib.metadata import version
from typing import Any

import numpy as np

from bsk_record.components import build_environment
from bsk_record.describe import describe_environment, describe_satellite
from bsk_record.policies import action_value
from bsk_record.specs import Episode

FORMAT = "bsk-rl-recording"
FORMAT_VERSION = 1
PACKAGES = ("bsk_rl", "bsk", "numpy", "scipy", "gymnasium", "pettingzoo", "pandas")
# Policies draw from a stream of their own: BSK-RL draws from numpy's global generator.
POLICY_STREAM = 7
# Positions are recorded in every tenth step.
POSITION_PERIOD = 10


def record(episode: Episode) -> dict[str, Any]:
    """Runs an episode and returns its recording, as plain as JSON except for numpy's types."""
    env = build_environment(episode)
    observation, info = env.reset(seed=episode.seed)
    recording = {
        "format": FORMAT,
        "version": FORMAT_VERSION,
        "versions": {name: version(name) for name in PACKAGES},
        "seed": episode.seed,
        "env": describe_environment(episode, env),
        "world_args": env.world_args,
        "satellites": [
            describe_satellite(spec, satellite) | {"initial": initial_state(satellite)}
            for spec, satellite in zip(episode.satellites, env.satellites, strict=True)
        ],
        "targets": [
            {"name": target.name, "r_LP_P_m": target.r_LP_P, "priority": target.priority}
            for target in getattr(env.scenario, "targets", [])
        ],
        "initial": {"observation": by_satellite(env, observation), "info": info},
    }
    recording["steps"] = StepRecorder(episode, env).steps()
    recording["opportunities"] = {item.name: opportunities(item) for item in env.satellites if hasattr(item, "opportunities")}
    if episode.traced:
        recording["trace"] = {satellite.name: satellite.trace.values() for satellite in env.satellites}
    return recording


class StepRecorder:
    """Steps an environment to its end, and keeps the communication pairs of each step."""

    def __init__(self, episode: Episode, env: Any) -> None:
        """Watches the communicator of an environment that was reset."""
        self.episode, self.env = episode, env
        self.rng = np.random.default_rng([episode.seed, POLICY_STREAM])
        self.pairs: list[tuple[Any, Any]] = []
        communicator = env.communicator
        pairs_of = communicator.communication_pairs

        def watched_pairs() -> list[tuple[Any, Any]]:
            self.pairs = pairs_of()
            return self.pairs

        communicator.communication_pairs = watched_pairs

    def steps(self) -> list[dict[str, Any]]:
        """Runs the episode and returns its steps."""
        steps = []
        for number in range(self.episode.max_steps):
            steps.append(self.step(number))
            if self.is_over(steps[-1]):
                break
        return steps

    def step(self, number: int) -> dict[str, Any]:
        """Chooses actions, steps the environment and returns the record of the step."""
        env, satellites = self.env, self.env.satellites
        actions = {satellite.name: self.episode.policy.choose(satellite, number, self.rng) for satellite in satellites}
        recorded = {satellite.name: action_value(actions[satellite.name], satellite) for satellite in satellites}
        for satellite in satellites:
            satellite.selection = None
        self.pairs = []
        start = env.simulator.sim_time
        observation, reward, terminated, truncated, _ = env.step(self.native(actions))
        order = {satellite.name: index for index, satellite in enumerate(satellites)}
        pairs = {(sender.name, receiver.name) for sender, receiver in self.pairs}
        return {
            "t_start": start,
            "t_end": env.simulator.sim_time,
            "actions": recorded,
            "selected": {item.name: item.selection for item in satellites if item.selection},
            "reward": env.reward_dict,
            "returned": reward,
            "terminated": terminated,
            "truncated": truncated,
            "requires_retasking": {item.name: item.requires_retasking for item in satellites},
            "alive": {item.name: item._is_alive for item in satellites},
            **image_counters(satellites),
            "pairs": sorted(pairs, key=lambda pair: (order[pair[0]], order[pair[1]])),
            "states": {item.name: state(item, number % POSITION_PERIOD == POSITION_PERIOD - 1) for item in satellites},
            "observation": by_satellite(env, observation),
        }

    def native(self, actions: dict[str, Any]) -> Any:
        """Returns actions by satellite in the form that the environment's `step` expects."""
        if self.episode.cls == "ConstellationTasking":
            return {name: action for name, action in actions.items() if action is not None}
        values = list(actions.values())
        return values[0] if self.episode.cls == "SatelliteTasking" else values

    def is_over(self, step: dict[str, Any]) -> bool:
        """Returns whether the episode ends with this step."""
        if self.episode.cls == "ConstellationTasking":
            return not self.env.agents
        return bool(step["truncated"] or (step["terminated"] and not self.episode.continues_after_death))


def by_satellite(env: Any, observation: Any) -> dict[str, Any]:
    """Returns observations by name of the satellite, for every class of environment."""
    if isinstance(observation, dict):
        return observation
    observations = observation if isinstance(observation, tuple) else (observation,)
    return {satellite.name: item for satellite, item in zip(env.satellites, observations, strict=True)}


def state(satellite: Any, with_position: bool) -> dict[str, Any]:
    """Returns attitude, wheels, battery and storage of a satellite, and its position if wanted."""
    dynamics = satellite.dynamics
    values = {
        "sigma_BN": dynamics.sigma_BN,
        "omega_BN_B": dynamics.omega_BN_B,
        "wheel_speeds_rad_s": dynamics.wheel_speeds,
        "battery_Ws": dynamics.battery_charge,
        "storage": storage(dynamics) if hasattr(dynamics, "storageUnit") else {},
    }
    return values | {"r_BN_N": dynamics.r_BN_N} if with_position else values


def initial_state(satellite: Any) -> dict[str, Any]:
    """Returns the state of a satellite after a reset."""
    return state(satellite, True) | {"v_BN_N": satellite.dynamics.v_BN_N}


def storage(dynamics: Any) -> dict[str, float]:
    """Returns the stored bits by partition."""
    message = dynamics.storageUnit.storageUnitDataOutMsg.read()
    return dict(zip(message.storedDataName, message.storedData, strict=True))


def image_counters(satellites: list[Any]) -> dict[str, Any]:
    """Returns counters of images, and the images that the data stores know."""
    imagers = [item for item in satellites if hasattr(item, "imaged")]
    informed = [item for item in imagers if hasattr(item.data_store.data, "imaged")]
    return {
        "imaged": {item.name: item.imaged for item in imagers},
        "missed": {item.name: item.missed for item in imagers},
        "newly_imaged": {item.name: [target.name for target in item.data_store.new_data.imaged] for item in informed},
        "known_imaged": {item.name: len(item.data_store.data.imaged) for item in informed},
    }


def opportunities(satellite: Any) -> dict[str, Any]:
    """Returns the access windows that were computed, in BSK-RL's order, and their end time."""
    windows = [
        [item["type"], getattr(item["object"], "name", item["object"]), *item["window"]] for item in satellite.opportunities
    ]
    return {"windows": windows, "window_calculation_time": satellite.window_calculation_time}
