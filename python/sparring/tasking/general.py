"""Environment of several satellites, for Gymnasium."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable
from copy import deepcopy
from time import time_ns
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.utils.seeding import np_random

from .comm import CommunicationMethod, NoCommunication
from .data import GlobalReward, NoReward
from .data.composition import ComposedReward
from .data.unique_image_data import UniqueImageReward, UniqueImageStore
from .no_action import is_no_action
from .sats import Satellite
from .scene import Scenario
from .sim import Simulator
from .sim.model_names import check_model
from .sim.setup import setup_text
from .sim.world import WorldModel, WorldModelABC
from .unsupported import sentence
from .utils import functional, logging_config

logger = logging.getLogger(logging_config.ROOT + ".gym")

SatArgRandomizer = Callable[[list[Satellite]], dict[Satellite, dict[str, Any]]]

#: Seeds of numpy's global generator are below this.
_SEEDS = 2**32


class GeneralSatelliteTasking(gymnasium.Env[Any, Any]):
    """Environment of several satellites with a tuple of observations and of actions."""

    metadata: dict[str, Any] = {"render_modes": []}

    def __init__(
        self,
        satellites: Satellite | list[Satellite],
        scenario: Scenario | None = None,
        rewarder: GlobalReward | Iterable[GlobalReward] | None = None,
        world_type: Any = None,
        world_args: dict[str, Any] | None = None,
        communicator: CommunicationMethod | None = None,
        sat_arg_randomizer: SatArgRandomizer | None = None,
        sim_rate: float = 1.0,
        max_step_duration: float = 1e9,
        failure_penalty: float = -1.0,
        time_limit: float | Callable[[], float] = float("inf"),
        terminate_on_time_limit: bool = False,
        generate_obs_retasking_only: bool = False,
        dtype: Any = None,
        log_level: int | str = logging.WARNING,
        log_dir: str | None = None,
        vizard_dir: str | None = None,
        vizard_settings: dict[str, Any] | None = None,
        render_mode: Any = None,
    ) -> None:
        """Creates an environment from copies of satellites, scenario, rewarder and communicator.

        Several rewarders add up. `sat_arg_randomizer` draws arguments of several satellites at
        once. Times are in seconds: `sim_rate` is the length of a tick, `max_step_duration` the
        longest step, `time_limit` truncates the episode, and may be a function that draws it. A
        dead satellite costs `failure_penalty`. `generate_obs_retasking_only` observes zeros for
        satellites that need no action. `dtype` replaces that of all observations.
        """
        self.seed: int | None = None
        logging_config.configure(self, log_level, log_dir)
        if vizard_dir is not None or vizard_settings is not None:
            logger.warning("Vizard is not supported. Ignoring vizard_dir and vizard_settings.")
        listed = [satellites] if isinstance(satellites, Satellite) else satellites
        scenario = Scenario() if scenario is None else scenario
        scenario.validate_satellite_names(listed)
        self.satellites: list[Satellite] = deepcopy(list(listed))
        self.dtype = dtype
        self._name_satellites()
        self.simulator: Simulator
        self.sat_arg_randomizer = sat_arg_randomizer or (lambda satellites: {})
        self.world_type = self._world_type(world_type)
        self.world_args_generator = self.world_type.default_world_args(**(world_args or {}))
        rewarder = NoReward() if rewarder is None else rewarder
        self._copy_parts(scenario, rewarder, NoCommunication() if communicator is None else communicator)
        self.sim_rate = sim_rate
        self.max_step_duration = max_step_duration
        self.failure_penalty = failure_penalty
        if failure_penalty > 0:
            logger.warning("Failure penalty should be nonpositive")
        self.time_limit_generator: Callable[[], float] = time_limit if callable(time_limit) else lambda: time_limit
        self.terminate_on_time_limit = terminate_on_time_limit
        self.latest_step_duration = 0.0
        self.render_mode = render_mode
        self.generate_obs_retasking_only = generate_obs_retasking_only
        self.reward_dict: dict[str, float] = {}

    def _copy_parts(
        self,
        scenario: Scenario,
        rewarder: GlobalReward | Iterable[GlobalReward],
        communicator: CommunicationMethod,
    ) -> None:
        """Copies and links scenario, rewarder and communicator; several rewarders are composed."""
        self.scenario = deepcopy(scenario)
        self.scenario.link_satellites(self.satellites)
        copied = deepcopy(rewarder)
        self.rewarder: GlobalReward = ComposedReward(*copied) if isinstance(copied, Iterable) else copied
        self.rewarder.link_scenario(self.scenario)
        self.communicator = deepcopy(communicator)
        self.communicator.link_satellites(self.satellites)

    def _name_satellites(self) -> None:
        """Numbers satellites of the same name, and sets the type of their observations."""
        names: list[str] = []
        while len(set(names)) < len(self.satellites):
            for satellite in self.satellites:
                alike = [item for item in self.satellites if item.name == satellite.name]
                if len(alike) > 1:
                    for number, item in enumerate(alike):
                        new_name = f"{item.name}_{number}"
                        logger.warning(f"Renaming satellite {item.name} to {new_name}")
                        item.name = new_name
                if self.dtype is not None:
                    satellite.observation_builder.dtype = self.dtype
            names = [satellite.name for satellite in self.satellites]

    def _world_type(self, given: Any) -> Any:
        """Class of the world: the one given, or the least that the satellites need."""
        if given is None:
            needed = [item for sat in self.satellites for item in sat.dyn_type._requires_world()]
            return functional.compose_types(*needed, WorldModel, name="World")
        logger.warning("Using user-specified world type. Generally, the env-determined world type is sufficient.")
        listed = given if isinstance(given, (list, tuple)) else (given,)
        world_type = functional.compose_types(*listed, WorldModelABC, name="World")
        check_model(world_type)
        return world_type

    def get_satellite(self, name: str) -> Satellite:
        """Returns the satellite of a name."""
        for satellite in self.satellites:
            if satellite.name == name:
                return satellite
        raise ValueError(f"Satellite with name '{name}' not found.")

    def reset(self, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Draws and starts an episode, and returns the first observation and info.

        A seed from 0 to 2³² − 1 draws BSK-RL's episode of that seed.
        """
        self.delete_simulator()
        super().reset(seed=self._seed(seed))
        self._draw_episode()
        self._start_simulation()
        observation = self._get_obs()
        info = self._get_info()
        logger.info("Environment reset")
        return observation, info

    def _draw_episode(self) -> None:
        """Draws the time limit, the arguments, the targets and the weights of an episode."""
        limit = np.ceil(self.time_limit_generator() / self.sim_rate) * self.sim_rate
        self.time_limit = np.float64(limit)
        self.scenario.reset_overwrite_previous()
        self.rewarder.reset_overwrite_previous()
        self.communicator.reset_overwrite_previous()
        for satellite in self.satellites:
            satellite.reset_overwrite_previous()
        self.latest_step_duration = 0.0
        self.world_args = {name: value() if callable(value) else value for name, value in self.world_args_generator.items()}
        overrides = self.sat_arg_randomizer(self.satellites)
        epoch = self.world_args["utc_init"]
        for satellite in self.satellites:
            satellite.generate_sat_args(utc_init=epoch, **overrides.get(satellite, {}))
        self.scenario.utc_init = epoch
        self.scenario.reset_pre_sim_init()
        self.rewarder.reset_pre_sim_init()
        self.communicator.reset_pre_sim_init()
        for satellite in self.satellites:
            self.rewarder.create_data_store(satellite)
            self.rewarder.data += satellite.data_store.data
            satellite.reset_pre_sim_init()

    def _seed(self, seed: int | None) -> int:
        """Seeds numpy's global generator, by default from the clock, and returns the seed."""
        if seed is None:
            seed = time_ns() % _SEEDS
        logger.info(f"Resetting environment with seed={seed}")
        self.seed = seed
        if not isinstance(seed, int) or seed < 0:
            # Gymnasium's error says what a seed must be.
            np_random(seed)
        if seed >= _SEEDS:
            raise ValueError(f"seed must be from 0 to 2**32 - 1, got {seed}")
        np.random.seed(seed)
        return seed

    def _simulator(self, environment: dict[str, Any]) -> Simulator:
        """Creates the models of the episode that was drawn."""
        return Simulator(
            self.satellites,
            self.world_type,
            self.world_args,
            sim_rate=self.sim_rate,
            max_step_duration=self.max_step_duration,
            time_limit=self.time_limit,
            environment=environment,
        )

    def draw_setup(self, seed: int | None, rewarders: list[dict[str, Any]], value_per_second: float) -> str:
        """Draws an episode that is simulated elsewhere, with its rewarders, and returns its set-up as JSON text."""
        self._seed(seed)
        self._draw_episode()
        environment = self._native_environment()
        environment |= {"rewarders": rewarders, "value_per_second": value_per_second}
        text = setup_text(self._simulator(environment))
        for satellite in self.satellites:
            if not all(isinstance(part, slice) for part in satellite.observation_builder.parts):
                raise NotImplementedError(sentence("A class of targets of your own in make_vec", "use Gymnasium's SyncVectorEnv"))
        return text

    def _start_simulation(self) -> None:
        """Creates the simulation of the episode that was drawn."""
        self.simulator = self._simulator(self._native_environment())
        parts = (self.simulator.world, self.scenario, self.rewarder, self.communicator)
        for part in parts:
            part.reset_during_sim_init()
        for satellite in self.satellites:
            for part in (satellite, satellite.dynamics, satellite.fsw):
                part.reset_during_sim_init()
        self.simulator.finish_init()
        for part in parts:
            part.reset_post_sim_init()
        if type(self.scenario).reset_post_sim_init is not Scenario.reset_post_sim_init:
            self.simulator.restart_if_changed()
        for satellite in self.satellites:
            for part in (satellite, satellite.dynamics, satellite.fsw):
                part.reset_post_sim_init()
            satellite.data_store.update_from_logs()

    def _native_environment(self) -> dict[str, Any]:
        """Parts of the set-up that belong to the environment."""
        rewarders = getattr(self.rewarder, "rewarders", (self.rewarder,))
        has_images = any(issubclass(item.data_store_type, UniqueImageStore) for item in rewarders)
        names = ["UniqueImageReward"] if has_images else ["NoReward"]
        if has_images and not isinstance(self.rewarder, UniqueImageReward):
            # The simulation hides imaged targets only if the rewarder of images is the only one.
            names.append("NoReward")
        return {
            "cls": type(self).native_class(),
            "failure_penalty": self.failure_penalty if np.isfinite(self.failure_penalty) else 0.0,
            "terminate_on_time_limit": self.terminate_on_time_limit,
            "rewarders": [{"type": name} for name in names],
            "value_per_second": None,
            "communicator": {
                "types": self.communicator.names(),
                "min_period": self.communicator.min_period,
            },
            "targets": getattr(self.scenario, "targets", []),
        }

    @classmethod
    def native_class(cls) -> str:
        """Name of the environment's class in the simulation."""
        return "GeneralSatelliteTasking"

    def delete_simulator(self) -> None:
        """Ends the simulation of the current episode."""
        self.__dict__.pop("simulator", None)

    def _get_obs(self) -> Any:
        """Observations of all satellites."""
        return tuple(self._observation(satellite) for satellite in self.satellites)

    def _observation(self, satellite: Satellite) -> Any:
        """Observation of a satellite; zeros if it needs no action and only such observe."""
        if self.generate_obs_retasking_only and not satellite.requires_retasking:
            space: Any = satellite.observation_space
            return space.low * 0
        return satellite.get_obs()

    def _get_info(self) -> dict[str, Any]:
        """Info of a step: which satellites need an action, and the step's duration in s."""
        info: dict[str, Any] = {
            satellite.name: {"requires_retasking": satellite.requires_retasking} for satellite in self.satellites
        }
        info["d_ts"] = self.latest_step_duration
        return info

    def _get_reward(self) -> Any:
        """Sum of rewards and penalties of a step."""
        reward = sum(self.reward_dict.values())
        for satellite in self.satellites:
            if not satellite.is_alive(log_failure=True):
                reward += self.failure_penalty
        return reward

    def _get_terminated(self) -> Any:
        """Whether the episode is over by the rules."""
        if self.terminate_on_time_limit and self._is_truncated():
            return True
        is_terminated = self.rewarder.is_terminated
        return any(not satellite.is_alive() or is_terminated(satellite) for satellite in self.satellites)

    def _is_truncated(self) -> Any:
        """Whether the time limit is reached, or the rewarder truncates the episode."""
        is_over = self.simulator.sim_time >= self.time_limit
        if is_over:
            # This is numpy's type, as in BSK-RL.
            return is_over
        return any(map(self.rewarder.is_truncated, self.satellites))

    def _get_truncated(self) -> Any:
        """Whether the episode is truncated."""
        return self._is_truncated()

    @property
    def action_space(self) -> Any:  # type: ignore[override]
        """Space of the tuple of actions."""
        return spaces.Tuple([satellite.action_space for satellite in self.satellites])

    @property
    def observation_space(self) -> Any:  # type: ignore[override]
        """Space of the tuple of observations; resets the environment if it was never reset."""
        self._require_simulator()
        return spaces.Tuple([satellite.observation_space for satellite in self.satellites])

    def _require_simulator(self) -> None:
        """Resets the environment if it was never reset."""
        if "simulator" not in self.__dict__:
            logger.info("Calling env.reset() to get observation space")
            self.reset(seed=self.seed)

    def _step(self, actions: Any) -> None:
        """Gives actions to the satellites, runs the simulation, and pays and shares new data."""
        if len(actions) != len(self.satellites):
            raise ValueError("There must be the same number of actions and satellites")
        for satellite, action in zip(self.satellites, actions, strict=True):
            self._give(satellite, action)
        start = self.simulator.sim_time
        step = self.simulator.run()
        self.latest_step_duration = self.simulator.sim_time - start
        for satellite, target in zip(self.satellites, step.imaged, strict=True):
            satellite.image_count += target is not None
        new_data = {satellite.name: satellite.data_store.update_from_logs() for satellite in self.satellites}
        self.reward_dict = self.rewarder.reward(new_data)
        self.scenario.after_step(self.simulator.sim_time)
        self.communicator.set_pairs(step.pairs)
        self.communicator.communicate()
        for satellite in self.satellites:
            if satellite.requires_retasking and satellite.logger.isEnabledFor(logging.INFO):
                satellite.logger.info(f"Satellite {satellite.name} requires retasking")

    def _give(self, satellite: Satellite, action: Any) -> None:
        """Gives an action to a satellite, or lets it go on."""
        if not is_no_action(action):
            satellite.requires_retasking = False
            satellite.set_action(action)
            satellite.check_command()
        if not satellite.is_alive():
            satellite.requires_retasking = False
        elif satellite.requires_retasking:
            satellite.logger.warning("Requires retasking but received no task.")

    def step(self, action: Any) -> Any:
        """Steps the simulation until a satellite needs an action, and returns Gymnasium's tuple."""
        logger.info("=== STARTING STEP ===")
        self._step(action)
        observation = self._get_obs()
        reward = self._get_reward()
        terminated = self._get_terminated()
        truncated = self._get_truncated()
        info = self._get_info()
        if logger.isEnabledFor(logging.INFO):
            logger.info(f"Step reward: {reward}")
            if terminated or truncated:
                logger.info(f"Episode terminated: {terminated}")
                logger.info(f"Episode truncated: {truncated}")
        return observation, reward, terminated, truncated, info

    def render(self) -> None:
        """Hook of Gymnasium; nothing is rendered."""

    def close(self) -> None:
        """Ends the simulation of the episode."""
        self.delete_simulator()
