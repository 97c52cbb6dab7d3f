"""
Compiled part of `sparring`. Import `sparring` instead.
"""

from _typeshed import Incomplete, SupportsGetItem
import collections.abc
import numpy
import numpy.typing
import typing
from typing import Any, Final, SupportsFloat, SupportsIndex, final

__version__: Final[str]
"""
Version of the wheel.
"""

@final
class NativeBatch:
    """
    A batch of environments of one task.
    """
    def __new__(cls, /, recipe: str, envs: SupportsIndex, *, observe: str, bodies: SupportsIndex | None, threats: SupportsIndex, look_ahead: SupportsIndex, axes: str, discrete: bool, few: bool, autoreset_mode: str, threads: SupportsIndex | None, seed: SupportsIndex, single: bool, curriculum: NativeCurriculum | None = None) -> NativeBatch:
        """
        Creates environments.

        `recipe` is a scenario without its seed, as JSON. `observe` is "all", "extended" or "tracks", `axes` is "world" or "agent".
        With `discrete`, actions are indices of the task's choices; with `few`, of its few actions. `single` drops the first axis of all arrays except flags.
        """
    def abandon(self, /) -> None:
        """
        Abandons the current episodes: the curriculum does not offer them again.
        """
    def absent_agents(self, /) -> "numpy.typing.NDArray[numpy.bool_]":
        """
        Returns which agents take no part in the current episodes.
        """
    @property
    def action_size(self, /) -> int:
        """
        Number of values of an agent's action.
        """
    def agent_results(self, /) -> "tuple[numpy.typing.NDArray[numpy.float32], numpy.typing.NDArray[numpy.bool_], numpy.typing.NDArray[numpy.bool_]]":
        """
        Returns, for the last step: each agent's reward, which agents terminated and which were truncated.
        """
    def alerts(self, /, env: SupportsIndex) -> list[str]:
        """
        Returns messages about the last step of an environment.
        """
    def columns(self, /) -> list[str]:
        """
        Returns the names of the values of an observation.
        """
    def curriculum_info(self, /) -> "tuple[numpy.typing.NDArray[numpy.int64], numpy.typing.NDArray[numpy.bool_], numpy.typing.NDArray[numpy.bool_]]":
        """
        Returns, for the current episodes: the level (-1: none), whether to train on the episode, and whether the environment
        is idle because no episode is left for it.
        """
    def episode(self, /, env: SupportsIndex) -> tuple[NativeScenario, float] | None:
        """
        Returns an environment's scenario and its score so far; None before the first reset.
        """
    def final_observations(self, /) -> "numpy.typing.NDArray[numpy.float32]":
        """
        Returns the last observations of the episodes that ended in the last step, in order of environments.

        They exist only in the autoreset mode "same_step".
        """
    def finished_episodes(self, /) -> "tuple[numpy.typing.NDArray[numpy.bool_], numpy.typing.NDArray[numpy.float64], numpy.typing.NDArray[numpy.int64], numpy.typing.NDArray[numpy.float64]]":
        """
        Returns, for the last step: which episodes ended, and their returns, lengths and durations in seconds.

        Environments whose episode did not end have zeros.
        """
    def last_actions(self, /) -> "numpy.typing.NDArray[numpy.float32]":
        """
        Returns each agent's action in the last step, along the world's axes.
        """
    @property
    def num_agents(self, /) -> int:
        """
        Number of agents of an environment.
        """
    @property
    def observation_size(self, /) -> int:
        """
        Number of values of an environment's observation.
        """
    @property
    def recipe(self, /) -> str:
        """
        Complete recipe that the environments were made with, as JSON.
        """
    def release(self, /) -> None:
        """
        Returns the current episodes to the curriculum and closes the environments.
        """
    def render(self, /, env: SupportsIndex, width: SupportsIndex, height: SupportsIndex) -> "numpy.typing.NDArray[numpy.uint8]":
        """
        Renders an environment as an array of height × width × 3.
        """
    def reset(self, /, seeds: SupportsGetItem[int, Any | None] | None = None, mask: Any | None = None, out: Any | None = None, recipes: SupportsGetItem[int, NativeScenario | None] | None = None, scenarios: SupportsGetItem[int, NativeScenario | None] | None = None) -> "numpy.typing.NDArray[numpy.float32]":
        """
        Begins the next episode of every environment, or of those in `mask`; returns all observations.

        The lists have one item or None per environment: `seeds` restart its scenario sequence, `recipes` replace its
        recipe, and `scenarios` are run once before the sequence continues. A rejected reset changes nothing.
        """
    def state_hash(self, /, env: SupportsIndex) -> bytes | None:
        """
        Returns a hash of every bit of an environment's state.
        """
    def step(self, /, actions: Any, out: tuple[Any, Any, Any, Any] | None = None, repeat: SupportsIndex = 1) -> "tuple[numpy.typing.NDArray[numpy.float32], numpy.typing.NDArray[numpy.float64], numpy.typing.NDArray[numpy.bool_], numpy.typing.NDArray[numpy.bool_], bool]":
        """
        Steps every environment, into `out` (observations, rewards, terminations, truncations) if given.

        The actions are repeated for `repeat` steps, or until an environment's episode ends; rewards add up. Returns these four arrays and whether any episode ended.
        """
    def step_times(self, /) -> "tuple[numpy.typing.NDArray[numpy.float64], numpy.typing.NDArray[numpy.bool_]]":
        """
        Returns the duration of the last step of each environment, s, and which agents need an action in the next one.

        Durations are 0 after a reset.
        """
    def telemetry(self, /, env: SupportsIndex) -> str | None:
        """
        Returns the observation of an environment's agents in the wire form (JSON).
        """
    @property
    def threads(self, /) -> int:
        """
        Number of threads that step the batch.
        """
    @property
    def total_steps(self, /) -> int:
        """
        Number of steps of all environments so far; those that only began an episode do not count.
        """

@final
class NativeCurriculum:
    """
    A run's curriculum for one trainer, with the threads that lease episodes and submit results.
    """
    def __new__(cls, /, url: str, run: str, token: str | None, *, columns: bool, groups: SupportsIndex, fallback_groups: SupportsIndex | None, group_size: SupportsIndex | None, purpose: str, evaluation: str | None, ttl_s: SupportsIndex, ahead: SupportsIndex, buffer: SupportsIndex, max_wait_s: SupportsFloat | SupportsIndex) -> NativeCurriculum:
        """
        Starts to lease episodes of a run.
        """
    def close(self, /, timeout_s: SupportsFloat | SupportsIndex) -> None:
        """
        Submits all results, releases unfinished episodes and ends the threads.

        Raises `CurriculumError` if results could not be submitted in time or were refused. After an interrupt it can be
        called again.
        """
    def flush(self, /, timeout_s: SupportsFloat | SupportsIndex) -> None:
        """
        Waits until the results of all complete leases are submitted.
        """
    @property
    def policy_version(self, /) -> int:
        """
        Policy version of the episodes that begin from now on.
        """
    @policy_version.setter
    def policy_version(self, /, version: SupportsIndex) -> None: ...
    def server_exited(self, /, reason: str) -> None:
        """
        Records that the server of this process has ended: callers stop waiting for it, unless it answers again.
        """
    def stats(self, /) -> str:
        """
        Returns counts of episodes by outcome, and the state of the queue, as JSON.
        """

@final
class NativeHttpClient:
    """
    HTTP client for single requests to a server.
    """
    def __new__(cls, /, url: str, token: str | None = None) -> NativeHttpClient: ...
    def request(self, /, method: str, path: str, body: str | None = None, *, max_wait_s: SupportsFloat | SupportsIndex = 30.0, wait_for_server: bool = False) -> str:
        """
        Sends a request and returns the JSON of the response.

        Repeats it for at most `max_wait_s` seconds while the server is busy, unless the server may have executed a request
        that is not safe to repeat. With `wait_for_server`, a GET is also repeated while the server does not answer at all.
        """

@final
class NativePolicy:
    """
    A built-in policy for one scenario.
    """
    def __new__(cls, /, name: str, scenario: NativeScenario, seed: SupportsIndex) -> NativePolicy: ...
    def act(self, /, telemetry: str) -> "numpy.typing.NDArray[numpy.float64]":
        """
        Returns the action of each agent, along the world's axes, for an observation in the wire form (JSON).
        """

@final
class NativeScenario:
    """
    A scenario: `(scenario, actions)` decides every bit of an episode.
    """
    def __eq__(self, value: object, /) -> bool: ...
    def __hash__(self, /) -> int: ...
    def __ne__(self, value: object, /) -> bool: ...
    def __new__(cls, /, text: str, any_seed: bool = False) -> NativeScenario:
        """
        Reads the wire form (JSON).

        With `any_seed`, seeds of training and evaluation are accepted too. No environment starts such a scenario.
        """
    @property
    def agents(self, /) -> int:
        """
        Number of agents at the start.
        """
    @property
    def horizon(self, /) -> int:
        """
        Number of steps after which an episode is truncated.
        """
    @property
    def id(self, /) -> str:
        """
        Id: the blake3 hash of the canonical form.
        """
    @property
    def seed(self, /) -> int:
        """
        Seed of all random draws.
        """
    @property
    def task(self, /) -> str:
        """
        Id of the task.
        """
    def to_json(self, /) -> str:
        """
        Returns the complete wire form (JSON).
        """

@final
class NativeTaskingBatch:
    """
    Episodes of satellite tasking as BSK-RL simulates them, each with as many satellites.
    """
    def __new__(cls, /, num_envs: SupportsIndex, satellites: SupportsIndex, threads: SupportsIndex | None = None) -> NativeTaskingBatch:
        """
        Creates a batch without episodes. It steps them on a number of threads, by default one per core.
        """
    def needs_action(self, /) -> "numpy.typing.NDArray[numpy.bool_]":
        """
        Returns which satellites need an action, envs × satellites.
        """
    def observe(self, /, satellite: SupportsIndex, envs: SupportsGetItem[int, SupportsIndex]) -> "numpy.typing.NDArray[numpy.float64]":
        """
        Returns the observations of a satellite in some environments, envs × values.
        """
    def start(self, /, envs: SupportsGetItem[int, SupportsIndex], setups: SupportsGetItem[int, str]) -> None:
        """
        Starts the episode of an environment for each set-up, JSON in the format of the recordings of BSK-RL.
        """
    def step(self, /, actions: "numpy.typing.NDArray[numpy.integer]", active: "numpy.typing.NDArray[numpy.bool_]") -> "tuple[numpy.typing.NDArray[numpy.float64], numpy.typing.NDArray[numpy.bool_], numpy.typing.NDArray[numpy.bool_], numpy.typing.NDArray[numpy.float64]]":
        """
        Runs a step of the environments in a mask. `actions` are envs × satellites; -1 lets a satellite go on.

        Returns rewards with penalties, terminations, truncations and durations (s). They are zero for other environments.
        """
    @property
    def threads(self, /) -> int:
        """
        Number of threads that step the episodes.
        """

@final
class NativeTaskingEpisode:
    """
    An episode of satellite tasking as BSK-RL simulates it.

    Satellites, targets and stations are given by their indices, times in seconds since the start.
    """
    def __new__(cls, /, setup: str, journal: bool = False) -> NativeTaskingEpisode:
        """
        Starts an episode from a set-up in the format of the recordings of BSK-RL, as JSON. With `journal`, the episode records what
        happens to its satellites.
        """
    def compute_opportunities(self, /, satellite: SupportsIndex, duration: SupportsFloat | SupportsIndex) -> None:
        """
        Computes the opportunities of a satellite for `duration` seconds more, to the end of a block.
        """
    def illumination(self, /, satellite: SupportsIndex) -> float:
        """
        Returns the share of sunlight that the panel of a satellite received in the last tick.
        """
    def is_alive(self, /, satellite: SupportsIndex) -> bool:
        """
        Returns True if a satellite was alive at the end of the last step.
        """
    def known_images(self, /, satellite: SupportsIndex) -> list[int]:
        """
        Returns the targets that a satellite knows to be imaged.
        """
    def needs_action(self, /, satellite: SupportsIndex) -> bool:
        """
        Returns True if a satellite needs a new action.
        """
    def next_eclipse(self, /, satellite: SupportsIndex) -> list[float]:
        """
        Returns the times at which the next eclipse begins and the next one ends, s; both 1 if there is none within hours.
        """
    def next_opportunities(self, /, satellite: SupportsIndex, kind: str, count: SupportsIndex) -> list[tuple[str, int, float, float]]:
        """
        Returns the next opportunities of a kind, without those that filters hide; fewer than `count` are padded with the last.
        """
    def observe(self, /, satellite: SupportsIndex) -> "numpy.typing.NDArray[numpy.float64]":
        """
        Returns the native items of a satellite's observation in order.
        """
    def opportunities(self, /, satellite: SupportsIndex) -> list[tuple[str, int, float, float]]:
        """
        Returns all opportunities of a satellite that are computed, in the order of their close.
        """
    def opportunities_until(self, /, satellite: SupportsIndex) -> float:
        """
        Returns the time up to which the opportunities of a satellite are computed, s.
        """
    def planet_from_inertial(self, /) -> list[float]:
        """
        Returns the rotation from the inertial to the planet-fixed frame, row by row.
        """
    def set_access_filter(self, /, satellite: SupportsIndex, accepts: "collections.abc.Callable[[str, int, float, float], bool] | None") -> None:
        """
        Sets a condition on the opportunities of a satellite: a function of kind, object, opening and close. None removes it.
        """
    def set_dead(self, /, satellite: SupportsIndex) -> None:
        """
        Declares a satellite dead: it takes no action any more, and ends no step in a constellation.
        """
    def step(self, /, actions: "list[int | None]", targets: "list[int | None]") -> NativeTaskingStep:
        """
        Runs a step with the index of an action or of a target to image for each satellite. A satellite with neither goes on.
        """
    def stored(self, /, satellite: SupportsIndex) -> list[float]:
        """
        Returns the stored data of a satellite, bits: of the instrument's partition, and of all others.
        """
    def sun_position(self, /) -> list[float]:
        """
        Returns the position of the Sun relative to the Earth in the inertial frame, m.
        """
    def take_journal(self, /) -> "list[tuple[typing.Any, ...]]":
        """
        Returns what happened to the satellites since the last call, as tuples of kind, time, satellite and details.
        """
    @property
    def time_s(self, /) -> float:
        """
        Time since the start, s.
        """
    def value(self, /, satellite: SupportsIndex, property: str) -> list[float]:
        """
        Returns the values of a property of a satellite; those of a matrix row by row.
        """

@final
class NativeTaskingStep:
    """
    Data that the satellites of an episode gained in a step. The lists have one item for each satellite.
    """
    @property
    def elapsed_s(self, /) -> float:
        """
        Duration of the step, s.
        """
    @property
    def imaged(self, /) -> list[int | None]:
        """
        Index of the target that each satellite imaged.
        """
    @property
    def is_truncated(self, /) -> bool:
        """
        True if the time limit is reached.
        """
    @property
    def pairs(self, /) -> list[list[int]]:
        """
        Pairs of satellites that shared data, each from a sender to a receiver.
        """
    @property
    def scanned_s(self, /) -> list[float]:
        """
        Time of the data that each satellite scanned, s.
        """
    @property
    def sharers(self, /) -> list[int]:
        """
        Number of satellites that share the reward of each satellite's image; 0 if it pays nothing.
        """

def bracket(scenario: NativeScenario) -> "tuple[str, numpy.typing.NDArray[numpy.float64]]":
    """
    Brackets a scenario: floor and reference as JSON, and the actions of the reference plan.
    """

def critique(scenario: NativeScenario, actions: Any, stopped: str | None = None) -> str:
    """
    Criticises an episode; returns its failures and a verdict on each action as JSON.
    """

def is_loopback(url: str) -> bool:
    """
    Returns true if the host of a URL is this machine.
    """

def replay(scenario: NativeScenario, actions: Any, stopped: str | None = None) -> str:
    """
    Replays actions on a scenario; returns the outcome as JSON.
    """

def rollout(scenario: NativeScenario, policy: str, seed: SupportsIndex) -> "tuple[str, numpy.typing.NDArray[numpy.float64]]":
    """
    Runs a built-in policy on a scenario to the end; returns the outcome as JSON, and the actions.
    """

def server_version_problem(version: str) -> str | None:
    """
    Returns the reason why a client of this version does not work with a server; None if it does. `version` is the header
    `sparring-version` of the server.
    """

def task_info(task: str) -> str:
    """
    Describes a task as JSON: params, options, levels, actions, policies.
    """

def tasks() -> list[str]:
    """
    Returns the ids of all tasks.
    """

def __getattr__(name: str) -> Incomplete: ...
