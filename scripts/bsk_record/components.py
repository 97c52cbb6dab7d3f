"""Builds an environment of BSK-RL from the settings of an episode."""

from __future__ import annotations

from typing import Any

import bsk_rl
from bsk_rl import act, comm, data, obs, scene
from bsk_rl.sim import dyn, fsw

from bsk_record.satellites import satellite_class
from bsk_record.specs import CommunicatorSpec, Component, Episode, SatelliteSpec

# Resources by name, as a recording names them.
RESOURCES = {
    "battery_charge_fraction": lambda satellite: satellite.dynamics.battery_charge_fraction,
    "sim_time": lambda satellite: satellite.simulator.sim_time,
}


def build_environment(episode: Episode) -> Any:
    """Returns the environment of an episode, before its reset."""
    satellites = [build_satellite(spec, episode.traced) for spec in episode.satellites]
    rewarders = [build_rewarder(component) for component in episode.rewarders]
    return getattr(bsk_rl, episode.cls)(
        satellites[0] if episode.cls == "SatelliteTasking" else satellites,
        scenario=build(scene, episode.scenario),
        rewarder=rewarders[0] if len(rewarders) == 1 else tuple(rewarders),
        communicator=build_communicator(episode.communicator),
        sat_arg_randomizer=episode.orbits,
        world_args=episode.world_args or None,
        log_level="CRITICAL",
        **episode.env,
    )


def build_satellite(spec: SatelliteSpec, traced: bool) -> Any:
    """Returns a satellite whose class has the models, actions and observations of its settings."""
    members = {
        "action_spec": [build(act, action) for action in spec.actions],
        "observation_spec": [build_observation(observation) for observation in spec.observations],
        "dyn_type": tuple(getattr(dyn, name) for name in spec.dyn),
        "fsw_type": tuple(getattr(fsw, name) for name in spec.fsw),
        "traced": traced,
    }
    cls = type(spec.type, (satellite_class(spec.type),), members)
    return cls(spec.name, sat_args=dict(spec.sat_args), **spec.options)


def build(module: Any, component: Component) -> Any:
    """Returns an object of a module's class with the arguments of a component."""
    return getattr(module, component.type)(**component.args)


def build_observation(component: Component) -> Any:
    """Returns an observation; the argument `properties` is passed by position, in copies that BSK-RL may change."""
    args = dict(component.args)
    properties = [dict(item) for item in args.pop("properties", ())]
    return getattr(obs, component.type)(*properties, **args)


def build_rewarder(component: Component) -> Any:
    """Returns a rewarder; a resource is given by its name."""
    args = dict(component.args)
    if "resource" in args:
        args["resource_fn"] = RESOURCES[args.pop("resource")]
    return getattr(data, component.type)(**args)


def build_communicator(spec: CommunicatorSpec) -> Any:
    """Returns a communicator of one class, or of several that are composed in their order."""
    bases = tuple(getattr(comm, name) for name in spec.types)
    cls = bases[0] if len(bases) == 1 else type("Communication", bases, {})
    return cls(min_period=spec.min_period)
