"""Describes the parts of an environment as a recording holds them: all arguments, with BSK-RL's defaults."""

from __future__ import annotations

import inspect
from typing import Any

from bsk_rl import data, obs, scene

from bsk_record.encode import finite, plain
from bsk_record.specs import Component, Episode, SatelliteSpec

# Functions, and arguments that a recording holds in another form.
LEFT_OUT = {"self", "fn", "priority_distribution", "reward_fn", "resource_fn"}


def describe_environment(episode: Episode, env: Any) -> dict[str, Any]:
    """Returns the constructor arguments of the environment."""
    return {
        "cls": episode.cls,
        "sim_rate": env.sim_rate,
        "max_step_duration": env.max_step_duration,
        "time_limit": finite(env.time_limit),
        "failure_penalty": env.failure_penalty,
        "terminate_on_time_limit": env.terminate_on_time_limit,
        "generate_obs_retasking_only": env.generate_obs_retasking_only,
        "rewarders": [describe(data, component) for component in episode.rewarders],
        "communicator": {"types": list(episode.communicator.types), "min_period": episode.communicator.min_period},
        "scenario": describe(scene, episode.scenario),
    }


def describe(module: Any, component: Component) -> dict[str, Any]:
    """Returns the type of a component and its arguments with the defaults of its constructor."""
    parameters = inspect.signature(getattr(module, component.type).__init__).parameters
    defaults = {
        name: item.default for name, item in parameters.items() if name not in LEFT_OUT and item.default is not item.empty
    }
    return {"type": component.type, **plain(defaults | component.args)}


def describe_satellite(spec: SatelliteSpec, satellite: Any) -> dict[str, Any]:
    """Returns the settings of a satellite and its arguments as drawn by the last reset."""
    access = hasattr(satellite, "generation_duration")
    beyond = satellite.max_generation_duration_beyond_initial if access else None
    return {
        "name": spec.name,
        "type": spec.type,
        "variable_interval": satellite.variable_interval,
        "generation_duration": satellite.generation_duration if access else None,
        "initial_generation_duration": satellite.initial_generation_duration if access else None,
        "max_generation_duration_beyond_initial": finite(beyond),
        "dyn": list(spec.dyn),
        "fsw": list(spec.fsw),
        "sat_args": plain(satellite.sat_args),
        "actions": [describe_action(action) for action in satellite.action_builder.action_spec],
        "observations": [describe_observation(item) for item in satellite.observation_builder.observation_spec],
    }


def describe_action(action: Any) -> dict[str, Any]:
    """Returns the type and arguments of an action; a duration that was not given is 1e9 s."""
    description = {"type": type(action).__name__, "name": action.name}
    if description["type"] == "Image":
        return description | {"n_ahead_image": action.n_actions, "max_duration": finite(action.max_duration)}
    if description["type"] == "DiscreteFSWAction":
        description |= {"fsw_action": action.fsw_action, "reset_task": action.reset_task}
    return description | {"duration": action.duration}


def describe_observation(observation: Any) -> dict[str, Any]:
    """Returns the type and arguments of an observation, as BSK-RL completed them."""
    description = {"type": type(observation).__name__, "name": observation.name}
    if isinstance(observation, obs.SatProperties):
        return description | {"properties": properties(observation.obs_properties)}
    if isinstance(observation, obs.OpportunityProperties):
        return description | {
            "opportunity_type": observation.type,
            "n_ahead_observe": observation.n_ahead_observe,
            "properties": properties(observation.target_properties),
        }
    if isinstance(observation, obs.Time):
        description["observe_time_remaining"] = observation.return_time_remaining
    return description | {"norm": plain(observation.norm)}


def properties(items: Any) -> list[dict[str, Any]]:
    """Returns the settings of observed properties without their functions."""
    return [{key: plain(value) for key, value in item.items() if key not in LEFT_OUT} for item in items]
